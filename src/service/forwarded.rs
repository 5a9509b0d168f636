//! The client of a request, and the path below which clients reach the service, when proxies stand between: `Forwarded` (RFC 7239)
//! and the older `X-Forwarded-For`, and `X-Forwarded-Prefix`. Only proxies that the operator trusts are believed: anybody can send
//! these headers.

use axum::http::{HeaderMap, HeaderName, header};
use ipnet::IpNet;
use std::fmt;
use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;

/// Longest path that is put before the service's own, characters.
const MAX_PREFIX_CHARS: usize = 255;

const FOR: HeaderName = HeaderName::from_static("x-forwarded-for");
const PREFIX: HeaderName = HeaderName::from_static("x-forwarded-prefix");

/// The client of a request: the other end of the connection, or the address that a trusted proxy names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Peer {
    /// IP address of the client.
    pub ip: IpAddr,
    /// Port of the client, where it is known.
    pub port: Option<u16>,
}

impl From<SocketAddr> for Peer {
    fn from(address: SocketAddr) -> Peer {
        Peer { ip: address.ip().to_canonical(), port: Some(address.port()) }
    }
}

impl fmt::Display for Peer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.port {
            Some(port) => SocketAddr::new(self.ip, port).fmt(f),
            None => self.ip.fmt(f),
        }
    }
}

/// The path that clients write before the service's own paths, as `/lampwright`; empty when there is none.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Prefix(Arc<str>);

impl Default for Prefix {
    fn default() -> Prefix {
        Prefix("".into())
    }
}

impl Prefix {
    /// Reads `/lampwright`, with or without a slash at its end; `None` when it is no plain absolute path.
    pub fn parse(text: &str) -> Option<Prefix> {
        let path = text.trim().trim_end_matches('/');
        let plain = |byte: u8| byte.is_ascii_alphanumeric() || b"/-._~%!$&'()*+,;=:@".contains(&byte);
        // Two slashes at the beginning would make the rest the name of another host.
        let is_path = path.is_empty() || (path.starts_with('/') && !path.starts_with("//"));
        let is_right = is_path && path.len() <= MAX_PREFIX_CHARS && path.bytes().all(plain);
        is_right.then(|| Prefix(path.into()))
    }

    /// The path itself.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

/// The settings about proxies in front of this service.
#[derive(Clone, Debug, Default)]
pub struct Proxies {
    /// Networks of the proxies whose headers are trusted.
    pub trusted: Vec<IpNet>,
    /// The path of the service's public URL, where the operator has said one; goes before what a proxy says.
    pub public: Option<Prefix>,
}

impl Proxies {
    /// Whether the headers of a proxy at this address are trusted.
    pub fn trusts(&self, address: IpAddr) -> bool {
        let address = address.to_canonical();
        self.trusted.iter().any(|network| network.contains(&address))
    }

    /// The client behind `peer`: the last address, seen from here, that is not a trusted proxy's.
    pub fn client(&self, peer: Peer, headers: &HeaderMap) -> Peer {
        if !self.trusts(peer.ip) {
            return peer;
        }
        // Most proxies write X-Forwarded-For alone and hand on a `Forwarded` that the client made up.
        let chain = match headers.contains_key(&FOR) {
            true => lines(headers, &FOR).flat_map(|line| line.split(',')).map(node).collect(),
            false => forwarded(headers),
        };
        let mut client = peer;
        for named in chain.into_iter().rev() {
            // What a proxy hides, or nobody can read, ends what is known.
            let Some(named) = named else { break };
            client = named;
            if !self.trusts(named.ip) {
                break;
            }
        }
        client
    }

    /// The path before the service's own for a request that `peer` brought.
    pub fn prefix(&self, peer: Peer, headers: &HeaderMap) -> Prefix {
        if let Some(public) = &self.public {
            return public.clone();
        }
        let said = headers.get(PREFIX).filter(|_| self.trusts(peer.ip));
        said.and_then(|value| Prefix::parse(value.to_str().ok()?)).unwrap_or_default()
    }
}

fn lines<'a>(headers: &'a HeaderMap, name: &HeaderName) -> impl Iterator<Item = &'a str> {
    headers.get_all(name).iter().map(|value| value.to_str().unwrap_or("?"))
}

/// The clients and proxies of `Forwarded`, in order; `None` for one that is hidden or cannot be read.
fn forwarded(headers: &HeaderMap) -> Vec<Option<Peer>> {
    let elements = lines(headers, &header::FORWARDED).flat_map(|line| outside_quotes(line, ','));
    let of = |element: &str| {
        let pairs = outside_quotes(element, ';');
        let named = pairs.into_iter().find_map(|pair| {
            let (name, value) = pair.split_once('=')?;
            name.trim().eq_ignore_ascii_case("for").then(|| value.trim())
        })?;
        node(named.trim_matches('"'))
    };
    elements.map(of).collect()
}

/// The parts of a text between marks that are not in a quoted string. Where a quote does not close, every mark counts: a client that
/// begins one must not hide what the proxy has added behind it.
fn outside_quotes(text: &str, mark: char) -> Vec<&str> {
    if text.matches('"').count() % 2 == 1 {
        return text.split(mark).collect();
    }
    let (mut parts, mut start, mut is_quoted) = (Vec::new(), 0, false);
    for (at, char) in text.char_indices() {
        match char {
            '"' => is_quoted = !is_quoted,
            _ if char == mark && !is_quoted => {
                parts.push(&text[start..at]);
                start = at + char.len_utf8();
            }
            _ => {}
        }
    }
    parts.push(&text[start..]);
    parts
}

/// An address as these headers write it: `192.0.2.60`, `192.0.2.60:4711`, `2001:db8::1`, `[2001:db8::1]:4711`.
fn node(text: &str) -> Option<Peer> {
    let text = text.trim();
    if let Ok(address) = text.parse::<SocketAddr>() {
        return Some(address.into());
    }
    let bare = text.strip_prefix('[').and_then(|rest| rest.strip_suffix(']')).unwrap_or(text);
    bare.parse::<IpAddr>().ok().map(|ip| Peer { ip: ip.to_canonical(), port: None })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn headers(pairs: &[(&'static str, &str)]) -> HeaderMap {
        pairs.iter().map(|(name, value)| (HeaderName::from_static(name), value.parse().unwrap())).collect()
    }

    fn proxies() -> Proxies {
        Proxies { trusted: vec!["10.0.0.0/8".parse().unwrap(), "fd00::/8".parse().unwrap()], public: None }
    }

    fn client(from: &str, pairs: &[(&'static str, &str)]) -> String {
        proxies().client(from.parse::<SocketAddr>().unwrap().into(), &headers(pairs)).to_string()
    }

    #[test]
    fn the_client_is_the_last_address_that_no_trusted_proxy_has() {
        // RFC 7239, section 4: its examples of nodes.
        let forwarded = |value: &str| client("10.0.0.1:80", &[("forwarded", value)]);
        assert_eq!(forwarded("for=192.0.2.60;proto=http;by=203.0.113.43"), "192.0.2.60");
        assert_eq!(forwarded("For=\"[2001:db8:cafe::17]:4711\""), "[2001:db8:cafe::17]:4711");
        assert_eq!(forwarded("for=192.0.2.43, for=198.51.100.17"), "198.51.100.17");
        assert_eq!(forwarded("for=192.0.2.43, for=10.1.1.1"), "192.0.2.43");
        assert_eq!(forwarded("for=192.0.2.43, for=unknown"), "10.0.0.1:80", "hidden by the proxy before ours");
        assert_eq!(forwarded("for=192.0.2.43, for=\"_gazonk\", for=10.1.1.1"), "10.1.1.1");
        let older = |value: &str| client("[fd00::1]:80", &[("x-forwarded-for", value)]);
        assert_eq!(older("203.0.113.7, 192.0.2.1, 10.2.3.4"), "192.0.2.1");
        assert_eq!(older("2001:db8::1"), "2001:db8::1");
        assert_eq!(older(""), "[fd00::1]:80");
        // Who is not trusted can say what it likes.
        assert_eq!(client("192.0.2.9:5", &[("x-forwarded-for", "10.0.0.1")]), "192.0.2.9:5");
        assert_eq!(client("192.0.2.9:5", &[("forwarded", "for=10.0.0.1")]), "192.0.2.9:5");
    }

    #[test]
    fn a_prefix_is_a_plain_path_of_a_trusted_proxy_or_of_the_operator() {
        let prefix = |from: &str, proxies: &Proxies, said: &str| {
            let peer = from.parse::<SocketAddr>().unwrap().into();
            proxies.prefix(peer, &headers(&[("x-forwarded-prefix", said)])).as_str().to_owned()
        };
        assert_eq!(prefix("10.0.0.1:80", &proxies(), "/lamps/"), "/lamps");
        assert_eq!(prefix("192.0.2.1:80", &proxies(), "/lamps"), "");
        for wrong in ["//evil.example", "lamps", "https://evil.example", "/a b", "/a?b", "/a#b", "/\\evil", "/"] {
            assert_eq!(prefix("10.0.0.1:80", &proxies(), wrong), "", "{wrong}");
        }
        let public = Proxies { public: Prefix::parse("/public"), ..proxies() };
        assert_eq!(prefix("10.0.0.1:80", &public, "/other"), "/public");
        assert_eq!(prefix("192.0.2.1:80", &public, "/other"), "/public");
    }
}
