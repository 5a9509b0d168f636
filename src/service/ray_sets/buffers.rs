//! Memory for the parts of files that come. It is taken once, given back and used again: pieces of this size that come and go
//! leave holes in the heap, and what uploads hold would be luck. Each upload fills one part; [`AHEAD`] more may be on their way
//! to the store while the next ones are filled.

use crate::storage::parts::PART_BYTES;
use bytes::Bytes;
use std::mem;
use std::ops::Deref;
use std::sync::{Arc, Mutex, PoisonError};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

/// Full parts that may be hashed and stored while their uploads fill the next, in all uploads together. Without this bound
/// memory would be two parts per upload; where many uploads come at once, the processors are busy without it.
const AHEAD: usize = 2;

/// The unused part buffers of one process. Cheap to clone.
#[derive(Clone)]
pub struct Buffers(Arc<Pool>);

struct Pool {
    free: Mutex<Vec<Vec<u8>>>,
    ahead: Arc<Semaphore>,
}

impl Default for Buffers {
    fn default() -> Buffers {
        Buffers(Arc::new(Pool { free: Mutex::default(), ahead: Arc::new(Semaphore::new(AHEAD)) }))
    }
}

impl Buffers {
    /// An empty part; it has memory from its first byte on and gives it back when it is dropped.
    pub fn take(&self) -> Buffer {
        Buffer { home: self.clone(), bytes: Vec::new() }
    }

    /// The right to fill the next part while a full one is on its way; `None` while [`AHEAD`] others have it.
    pub fn ahead(&self) -> Option<OwnedSemaphorePermit> {
        Arc::clone(&self.0.ahead).try_acquire_owned().ok()
    }

    /// An unused buffer for a part, or a new one.
    fn memory(&self) -> Vec<u8> {
        let free = self.0.free.lock().unwrap_or_else(PoisonError::into_inner).pop();
        // At once, not by doubling: pages that are not written to cost nothing.
        free.unwrap_or_else(|| Vec::with_capacity(PART_BYTES))
    }
}

/// A part that is being filled.
pub struct Buffer {
    home: Buffers,
    bytes: Vec<u8>,
}

/// A part that is filled no more, and the right to fill another one meanwhile.
struct Full {
    buffer: Buffer,
    _ahead: Option<OwnedSemaphorePermit>,
}

impl AsRef<[u8]> for Full {
    fn as_ref(&self) -> &[u8] {
        &self.buffer
    }
}

impl Buffer {
    /// Takes of `bytes` what there is room for; the rest.
    pub fn fill<'a>(&mut self, bytes: &'a [u8]) -> &'a [u8] {
        if self.bytes.capacity() == 0 {
            self.bytes = self.home.memory();
        }
        let (now, later) = bytes.split_at(bytes.len().min(PART_BYTES - self.bytes.len()));
        self.bytes.extend_from_slice(now);
        later
    }

    /// Whether there is no room in it.
    pub fn is_full(&self) -> bool {
        self.bytes.len() == PART_BYTES
    }

    /// Its bytes, to be read by several at once. The memory, and the right `ahead`, go back with the last of them.
    pub fn into_bytes(self, ahead: Option<OwnedSemaphorePermit>) -> Bytes {
        Bytes::from_owner(Full { buffer: self, _ahead: ahead })
    }
}

impl Deref for Buffer {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        &self.bytes
    }
}

impl Drop for Buffer {
    fn drop(&mut self) {
        let mut bytes = mem::take(&mut self.bytes);
        if bytes.capacity() > 0 {
            bytes.clear();
            self.home.0.free.lock().unwrap_or_else(PoisonError::into_inner).push(bytes);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_memory_serves_one_part_after_the_other() {
        let (buffers, piece) = (Buffers::default(), vec![7; PART_BYTES / 2 + 1]);
        let mut memory = None;
        for _ in 0..3 {
            let mut part = buffers.take();
            assert!(part.fill(&piece).is_empty() && !part.is_full());
            assert_eq!(part.fill(&piece).len(), 2);
            assert!(part.is_full());
            assert_eq!(*memory.get_or_insert(part.as_ptr()), part.as_ptr());
            let bytes = part.into_bytes(None);
            assert_eq!((Some(bytes.as_ptr()), bytes.len()), (memory, PART_BYTES));
        }
        // One that is given up gives its memory back too; who asks meanwhile has another.
        let mut second = buffers.take();
        second.fill(b"next");
        assert_eq!((&*second, Some(second.as_ptr())), (b"next".as_slice(), memory));
        let mut third = buffers.take();
        third.fill(b"other");
        assert_ne!(Some(third.as_ptr()), memory);
    }

    #[test]
    fn memory_goes_back_with_the_last_reader_and_so_does_the_right_to_fill_ahead() {
        let buffers = Buffers::default();
        let mut part = buffers.take();
        part.fill(b"kept");
        let ahead: Vec<_> = (0..AHEAD).map(|_| buffers.ahead().unwrap()).collect();
        assert!(buffers.ahead().is_none());
        let bytes = part.into_bytes(ahead.into_iter().next());
        assert!(buffers.ahead().is_some(), "all but one were dropped");
        let _others: Vec<_> = (1..AHEAD).map(|_| buffers.ahead().unwrap()).collect();
        let (memory, reader) = (bytes.as_ptr(), bytes.slice(1..));
        drop(bytes);
        assert!(buffers.ahead().is_none());
        let mut other = buffers.take();
        other.fill(b"other");
        assert_eq!(&*reader, b"ept");
        drop(reader);
        assert!(buffers.ahead().is_some());
        let mut next = buffers.take();
        next.fill(b"next");
        assert_eq!(next.as_ptr(), memory);
    }
}
