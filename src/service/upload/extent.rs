//! How much of a file has come: its length and its SHA-256 so far, which goes on in another process.

use super::super::hex::hex;
use base64::Engine;
use base64::engine::general_purpose::STANDARD as BASE64;
use sha2::digest::common::hazmat::{SerializableState, SerializedState};
use sha2::{Digest, Sha256};

/// The beginning of a file.
#[derive(Clone, Debug, Default)]
pub(super) struct Extent {
    /// Its length, bytes.
    pub byte_count: u64,
    sha256: Sha256,
}

impl Extent {
    /// The beginning whose digest was left at `state`; `None` where that is no such state.
    pub fn resumed(byte_count: u64, state: &str) -> Option<Extent> {
        let bytes = BASE64.decode(state).ok()?;
        let state = SerializedState::<Sha256>::try_from(bytes.as_slice()).ok()?;
        Some(Extent { byte_count, sha256: Sha256::deserialize(&state).ok()? })
    }

    /// With the bytes that follow.
    pub fn extend(&mut self, bytes: &[u8]) {
        self.byte_count += bytes.len() as u64;
        self.sha256.update(bytes);
    }

    /// The digest's state, to be resumed. It holds up to 63 bytes of the file.
    pub fn state(&self) -> String {
        BASE64.encode(self.sha256.serialize())
    }

    /// SHA-256 of it, lower-case hex.
    pub fn sha256(&self) -> String {
        hex(&self.sha256.clone().finalize())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_digest_goes_on_wherever_it_was_left() {
        // FIPS 180-2, appendix B.3: a million times "a".
        let million = vec![b'a'; 1_000_000];
        for cuts in [vec![0], vec![1], vec![63, 64, 65], vec![127, 500_000, 999_999], vec![1_000_000]] {
            let (mut extent, mut from) = (Extent::default(), 0);
            for cut in cuts.into_iter().chain([million.len()]) {
                extent.extend(&million[from..cut]);
                from = cut;
                extent = Extent::resumed(extent.byte_count, &extent.state()).unwrap();
            }
            assert_eq!(extent.byte_count, 1_000_000);
            assert_eq!(extent.sha256(), "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0");
        }
    }

    #[test]
    fn what_is_no_state_is_none() {
        let state = Extent::default().state();
        assert!(Extent::resumed(0, &state).is_some());
        for wrong in ["", "AAAA", "?", &state[4..]] {
            assert!(Extent::resumed(0, wrong).is_none(), "{wrong}");
        }
    }
}
