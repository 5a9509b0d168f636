//! How much of a file has come: its length and its SHA-256 so far. Where the file may go on in another process, the digest's
//! state can be written down; where it comes in one request, it is computed about twice as fast: the only file that names ring.

use crate::hex::hex;
use crate::priority;
use base64::Engine;
use base64::engine::general_purpose::STANDARD as BASE64;
use bytes::Bytes;
use rayon::{ThreadPool, ThreadPoolBuildError, ThreadPoolBuilder};
use ring::digest::{Context, SHA256};
use sha2::digest::common::hazmat::{SerializableState, SerializedState};
use sha2::{Digest, Sha256};
use std::num::NonZero;
use std::sync::Arc;
use std::thread;
use tokio::sync::oneshot;

/// The beginning of a file.
#[derive(Clone)]
pub struct Extent {
    /// Its length, bytes.
    pub byte_count: u64,
    sha256: Running,
}

/// Threads that compute digests. They give way to those that answer, but less than those that inspect: an upload waits for its
/// digest and not for its inspection. Cheap to clone.
#[derive(Clone)]
pub struct Digests(Arc<ThreadPool>);

impl Digests {
    /// A thread per processor.
    ///
    /// # Errors
    /// The system has no threads to give.
    pub fn new() -> Result<Digests, ThreadPoolBuildError> {
        let threads = thread::available_parallelism().map_or(1, NonZero::get);
        let pool = ThreadPoolBuilder::new().num_threads(threads).thread_name(|thread| format!("digest-{thread}"));
        Ok(Digests(Arc::new(pool.start_handler(|_| priority::lower_a_little()).build()?)))
    }

    /// `extent` with the bytes that follow. If the caller stops waiting, the result is dropped.
    pub(super) async fn extend(&self, mut extent: Extent, bytes: Bytes) -> Result<Extent, oneshot::error::RecvError> {
        let (sender, receiver) = oneshot::channel();
        self.0.spawn_fifo(move || {
            extent.extend(&bytes);
            drop(bytes);
            // Nobody may be there to hear it.
            let _ = sender.send(extent);
        });
        receiver.await
    }
}

/// A digest that goes on.
#[derive(Clone)]
enum Running {
    /// Its state can be written down.
    Resumable(Sha256),
    /// With machine code for this processor. On those without instructions for SHA-256, `sha2` takes twice the time.
    Fast(Context),
}

impl Default for Extent {
    /// Nothing yet of a file that comes in several requests.
    fn default() -> Extent {
        Extent { byte_count: 0, sha256: Running::Resumable(Sha256::new()) }
    }
}

impl Extent {
    /// Nothing yet of a file that comes in one request.
    pub fn of_one_request() -> Extent {
        Extent { byte_count: 0, sha256: Running::Fast(Context::new(&SHA256)) }
    }

    /// The beginning whose digest was left at `state`; `None` where that is no such state.
    pub fn resumed(byte_count: u64, state: &str) -> Option<Extent> {
        let bytes = BASE64.decode(state).ok()?;
        let state = SerializedState::<Sha256>::try_from(bytes.as_slice()).ok()?;
        Some(Extent { byte_count, sha256: Running::Resumable(Sha256::deserialize(&state).ok()?) })
    }

    /// With the bytes that follow.
    pub fn extend(&mut self, bytes: &[u8]) {
        self.byte_count += bytes.len() as u64;
        match &mut self.sha256 {
            Running::Resumable(sha256) => sha256.update(bytes),
            Running::Fast(sha256) => sha256.update(bytes),
        }
    }

    /// The digest's state, to be resumed; it holds up to 63 bytes of the file. `None` for a file that comes in one request.
    pub fn state(&self) -> Option<String> {
        match &self.sha256 {
            Running::Resumable(sha256) => Some(BASE64.encode(sha256.serialize())),
            Running::Fast(_) => None,
        }
    }

    /// SHA-256 of it, lower-case hex.
    pub fn sha256(&self) -> String {
        match &self.sha256 {
            Running::Resumable(sha256) => hex(&sha256.clone().finalize()),
            Running::Fast(sha256) => hex(sha256.clone().finish().as_ref()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// FIPS 180-2, appendix B.3: SHA-256 of a million times "a".
    const MILLION: &str = "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0";

    #[test]
    fn a_digest_goes_on_wherever_it_was_left() {
        let million = vec![b'a'; 1_000_000];
        for cuts in [vec![0], vec![1], vec![63, 64, 65], vec![127, 500_000, 999_999], vec![1_000_000]] {
            let (mut extent, mut from) = (Extent::default(), 0);
            for cut in cuts.into_iter().chain([million.len()]) {
                extent.extend(&million[from..cut]);
                from = cut;
                extent = Extent::resumed(extent.byte_count, &extent.state().unwrap()).unwrap();
            }
            assert_eq!(extent.byte_count, 1_000_000);
            assert_eq!(extent.sha256(), MILLION);
        }
    }

    #[test]
    fn the_digest_of_one_request_is_the_same_and_has_no_state() {
        let mut extent = Extent::of_one_request();
        for piece in vec![b'a'; 1_000_000].chunks(999_983) {
            extent.extend(piece);
        }
        assert_eq!((extent.byte_count, extent.sha256().as_str(), extent.state()), (1_000_000, MILLION, None));
    }

    #[test]
    fn what_is_no_state_is_none() {
        let state = Extent::default().state().unwrap();
        assert!(Extent::resumed(0, &state).is_some());
        for wrong in ["", "AAAA", "?", &state[4..]] {
            assert!(Extent::resumed(0, wrong).is_none(), "{wrong}");
        }
    }
}
