//! Tells public internet addresses from private ones: those of the machine, its network or its cloud. After the special-purpose
//! address registries of IANA (RFC 6890); what they do not say is global, is not.

use std::net::{IpAddr, Ipv4Addr, Ipv6Addr};
use std::str::FromStr;

/// IPv4 that is no one's on the internet: network and prefix length.
const OWN_V4: [(Ipv4Addr, u32); 16] = [
    (Ipv4Addr::new(0, 0, 0, 0), 8),        // this network
    (Ipv4Addr::new(10, 0, 0, 0), 8),       // private
    (Ipv4Addr::new(100, 64, 0, 0), 10),    // between a provider and its customers
    (Ipv4Addr::new(127, 0, 0, 0), 8),      // loopback
    (Ipv4Addr::new(169, 254, 0, 0), 16),   // link-local; clouds tell their secrets at 169.254.169.254
    (Ipv4Addr::new(172, 16, 0, 0), 12),    // private
    (Ipv4Addr::new(192, 0, 0, 0), 24),     // protocol assignments
    (Ipv4Addr::new(192, 0, 2, 0), 24),     // documentation
    (Ipv4Addr::new(192, 88, 99, 0), 24),   // 6to4 relays, deprecated
    (Ipv4Addr::new(192, 168, 0, 0), 16),   // private
    (Ipv4Addr::new(198, 18, 0, 0), 15),    // benchmarks
    (Ipv4Addr::new(198, 51, 100, 0), 24),  // documentation
    (Ipv4Addr::new(203, 0, 113, 0), 24),   // documentation
    (Ipv4Addr::new(224, 0, 0, 0), 4),      // multicast
    (Ipv4Addr::new(240, 0, 0, 0), 4),      // reserved, and broadcast
    (Ipv4Addr::new(168, 63, 129, 16), 32), // Azure's own, on every machine there
];

/// The only part of IPv6 that is given to the internet.
const GLOBAL_V6: (Ipv6Addr, u32) = (Ipv6Addr::new(0x2000, 0, 0, 0, 0, 0, 0, 0), 3);

/// ... and what of it is not.
const OWN_V6: [(Ipv6Addr, u32); 4] = [
    (Ipv6Addr::new(0x2001, 0, 0, 0, 0, 0, 0, 0), 23), // protocol assignments, Teredo
    (Ipv6Addr::new(0x2001, 0xdb8, 0, 0, 0, 0, 0, 0), 32), // documentation
    (Ipv6Addr::new(0x2002, 0, 0, 0, 0, 0, 0, 0), 16), // 6to4: an IPv4 address in disguise, and obsolete
    (Ipv6Addr::new(0x3fff, 0, 0, 0, 0, 0, 0, 0), 20), // documentation
];

/// IPv4 behind a translator (RFC 6052): the last 32 bits are the address.
const TRANSLATED: (Ipv6Addr, u32) = (Ipv6Addr::new(0x64, 0xff9b, 0, 0, 0, 0, 0, 0), 96);

/// Whether an address is a public internet address.
pub fn is_global(address: IpAddr) -> bool {
    match address.to_canonical() {
        IpAddr::V4(v4) => !OWN_V4.iter().any(|(network, bits)| within_v4(v4, *network, *bits)),
        IpAddr::V6(v6) if within_v6(v6, TRANSLATED) => is_global(IpAddr::V4(Ipv4Addr::from_bits(v6.to_bits() as u32))),
        IpAddr::V6(v6) => within_v6(v6, GLOBAL_V6) && !OWN_V6.iter().any(|own| within_v6(v6, *own)),
    }
}

fn within_v4(address: Ipv4Addr, network: Ipv4Addr, bits: u32) -> bool {
    (address.to_bits() ^ network.to_bits()).leading_zeros() >= bits
}

fn within_v6(address: Ipv6Addr, (network, bits): (Ipv6Addr, u32)) -> bool {
    (address.to_bits() ^ network.to_bits()).leading_zeros() >= bits
}

/// A host or network that may be reached although it is not on the public internet.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Exception {
    /// A network, or one address: its first address and how many bits name it.
    Network(IpAddr, u32),
    /// A host name, whatever its addresses; in lower case.
    Host(String),
}

impl Exception {
    /// Whether the exception holds for this address.
    pub fn has_address(&self, address: IpAddr) -> bool {
        match (self, address.to_canonical()) {
            (Exception::Network(IpAddr::V4(network), bits), IpAddr::V4(v4)) => within_v4(v4, *network, *bits),
            (Exception::Network(IpAddr::V6(network), bits), IpAddr::V6(v6)) => within_v6(v6, (*network, *bits)),
            _ => false,
        }
    }

    /// Whether the exception holds for this host name.
    pub fn has_host(&self, host: &str) -> bool {
        matches!(self, Exception::Host(name) if name.eq_ignore_ascii_case(host.trim_end_matches('.')))
    }
}

impl FromStr for Exception {
    type Err = String;

    /// Reads `10.20.0.0/16`, `fd00::/8`, `10.20.0.7` or `receiver.lab`.
    fn from_str(text: &str) -> Result<Exception, String> {
        let wrong = || {
            format!(
                "{text:?} is not a network, an address or a host name: write 10.20.0.0/16, fd00::/8 or receiver.lab"
            )
        };
        if let Ok(address) = text.parse::<IpAddr>() {
            let address = address.to_canonical();
            return Ok(Exception::Network(address, if address.is_ipv4() { 32 } else { 128 }));
        }
        if let Some((network, bits)) = text.split_once('/') {
            let network: IpAddr = network.parse().map_err(|_| wrong())?;
            let most = if network.is_ipv4() { 32 } else { 128 };
            return match bits.parse() {
                Ok(bits) if bits <= most => Ok(Exception::Network(network, bits)),
                _ => Err(wrong()),
            };
        }
        let plain = |byte: u8| byte.is_ascii_alphanumeric() || matches!(byte, b'-' | b'.' | b'_');
        match !text.is_empty() && text.bytes().all(plain) {
            true => Ok(Exception::Host(text.trim_end_matches('.').to_ascii_lowercase())),
            false => Err(wrong()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// First and last addresses of IANA's registries of special purposes, by hand; and those in disguise.
    const OWN: &str = "\
        0.0.0.0 0.255.255.255 10.0.0.0 10.255.255.255 100.64.0.0 100.127.255.255 127.0.0.1 127.255.255.255 \
        168.63.129.16 169.254.0.0 169.254.169.254 172.16.0.0 172.31.255.255 192.0.0.8 192.0.2.1 192.88.99.1 \
        192.168.0.0 192.168.255.255 198.18.0.0 198.19.255.255 198.51.100.1 203.0.113.255 224.0.0.1 \
        239.255.255.255 240.0.0.1 255.255.255.255 :: ::1 ::ffff:127.0.0.1 ::ffff:169.254.169.254 \
        ::ffff:10.0.0.1 ::127.0.0.1 ::8.8.8.8 64:ff9b::127.0.0.1 64:ff9b::a9fe:a9fe 64:ff9b::192.168.1.1 \
        64:ff9b:1::8.8.8.8 100::1 2001::1 2001:0:7f00:1:: 2001:10::1 2001:db8::1 2002:7f00:1:: \
        2002:808:808::1 3fff::1 5f00::1 fc00::1 fd12:3456::1 fdff:ffff:: fe80::1 febf::1 fec0::1 ff02::1 \
        fd00:ec2::254";
    /// Their neighbours, and some that everybody knows.
    const GLOBAL: &str = "\
        1.1.1.1 8.8.8.8 9.255.255.255 11.0.0.0 100.63.255.255 100.128.0.0 126.255.255.255 128.0.0.0 \
        169.253.255.255 169.255.0.0 172.15.255.255 172.32.0.0 192.0.1.0 192.167.255.255 192.169.0.0 \
        198.17.255.255 198.20.0.0 223.255.255.255 ::ffff:8.8.8.8 64:ff9b::8.8.8.8 2001:200::1 \
        2001:4860:4860::8888 2606:4700::1111 2a00:1450::1 3ffe::1";

    fn judged(address: &str) -> bool {
        is_global(address.parse().unwrap())
    }

    #[test]
    fn what_is_not_the_internets_is_refused_in_every_spelling() {
        for own in OWN.split(' ') {
            assert!(!judged(own), "{own}");
        }
        for global in GLOBAL.split(' ') {
            assert!(judged(global), "{global}");
        }
    }

    #[test]
    fn an_exception_holds_for_its_own_and_nothing_else() {
        let read = |text: &str| text.parse::<Exception>();
        let network = read("10.20.0.0/16").unwrap();
        for (address, within) in [
            ("10.20.0.1", true),
            ("10.20.255.255", true),
            ("::ffff:10.20.3.4", true),
            ("10.21.0.0", false),
            ("fd00::1", false),
        ] {
            assert_eq!(network.has_address(address.parse().unwrap()), within, "{address}");
        }
        assert!(read("127.0.0.1").unwrap().has_address("127.0.0.1".parse().unwrap()));
        assert!(!read("127.0.0.1").unwrap().has_address("127.0.0.2".parse().unwrap()));
        assert!(read("fd00::/8").unwrap().has_address("fd12::1".parse().unwrap()));
        assert!(read("0.0.0.0/0").unwrap().has_address("192.168.0.1".parse().unwrap()));
        let host = read("Receiver.Lab").unwrap();
        assert!(host.has_host("receiver.lab") && host.has_host("RECEIVER.LAB."));
        assert!(!host.has_host("receiver.lab.evil.example") && !host.has_host("x.receiver.lab"));
        assert!(!host.has_address("10.0.0.1".parse().unwrap()));
        for wrong in ["", "10.0.0.0/33", "10.0.0.0/", "fd00::/129", "10.0.0/8", "a b", "http://receiver", "*"] {
            assert!(read(wrong).is_err(), "{wrong}");
        }
    }
}
