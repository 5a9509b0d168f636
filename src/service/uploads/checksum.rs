//! What a client says of the bytes of one request, to find out whether they came as sent.

use sha1::Sha1;
use sha2::{Digest, Sha256};

/// Those known; tus asks for the first of every server.
pub const ALGORITHMS: [&str; 2] = ["sha1", "sha256"];

/// A digest that is announced, and what has come so far.
#[derive(Clone, Debug)]
pub struct Checksum {
    announced: Vec<u8>,
    so_far: SoFar,
}

#[derive(Clone, Debug)]
enum SoFar {
    Sha1(Sha1),
    Sha256(Sha256),
}

impl Checksum {
    /// The digest `announced`; `None` for an algorithm that is not known.
    pub fn new(algorithm: &str, announced: Vec<u8>) -> Option<Checksum> {
        let so_far = match algorithm {
            "sha1" => SoFar::Sha1(Sha1::new()),
            "sha256" => SoFar::Sha256(Sha256::new()),
            _ => return None,
        };
        Some(Checksum { announced, so_far })
    }

    /// Takes the next bytes.
    pub fn update(&mut self, bytes: &[u8]) {
        match &mut self.so_far {
            SoFar::Sha1(so_far) => so_far.update(bytes),
            SoFar::Sha256(so_far) => so_far.update(bytes),
        }
    }

    /// Whether what came is what was announced.
    pub fn holds(self) -> bool {
        let found = match self.so_far {
            SoFar::Sha1(so_far) => so_far.finalize().to_vec(),
            SoFar::Sha256(so_far) => so_far.finalize().to_vec(),
        };
        found == self.announced
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_checksum_holds_for_its_bytes_only() {
        // FIPS 180-2, appendices A.1 and B.1: "abc".
        let hex = |text: &str| -> Vec<u8> {
            (0..text.len()).step_by(2).map(|k| u8::from_str_radix(&text[k..k + 2], 16).unwrap()).collect()
        };
        let known = [
            ("sha1", "a9993e364706816aba3e25717850c26c9cd0d89d"),
            ("sha256", "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"),
        ];
        assert_eq!(known.map(|(algorithm, _)| algorithm), ALGORITHMS);
        for (algorithm, digest) in known {
            for (pieces, holds) in [(["a", "bc"], true), (["ab", "d"], false), (["", "abc"], true), (["", ""], false)] {
                let mut checksum = Checksum::new(algorithm, hex(digest)).unwrap();
                for piece in pieces {
                    checksum.update(piece.as_bytes());
                }
                assert_eq!(checksum.holds(), holds, "{algorithm} {pieces:?}");
            }
        }
        assert!(Checksum::new("md5", Vec::new()).is_none() && Checksum::new("SHA1", Vec::new()).is_none());
    }
}
