//! Memory for the parts that are being filled. It is taken once, given back and used again: pieces of this size that come and go
//! leave holes in the heap, and what uploads hold would be luck. So it is as many parts as there were uploads at once.

use super::PART_BYTES;
use bytes::{Bytes, BytesMut};
use std::mem;
use std::ops::Deref;
use std::sync::{Arc, Mutex, PoisonError};

/// Those that nobody has. Cheap to clone.
#[derive(Clone, Default)]
pub struct Buffers(Arc<Mutex<Vec<BytesMut>>>);

impl Buffers {
    /// An empty one; given back when dropped.
    pub fn take(&self) -> Buffer {
        let free = self.0.lock().unwrap_or_else(PoisonError::into_inner).pop();
        Buffer { home: self.clone(), bytes: free.unwrap_or_default() }
    }
}

/// A part being filled.
pub struct Buffer {
    home: Buffers,
    bytes: BytesMut,
}

impl Buffer {
    /// Takes of `bytes` what there is room for; the rest.
    pub fn fill<'a>(&mut self, bytes: &'a [u8]) -> &'a [u8] {
        if self.bytes.capacity() < PART_BYTES {
            // At once, not by doubling: pages that are not written to cost nothing.
            let mut whole = BytesMut::with_capacity(PART_BYTES);
            whole.extend_from_slice(&self.bytes);
            self.bytes = whole;
        }
        let (now, later) = bytes.split_at(bytes.len().min(PART_BYTES - self.bytes.len()));
        self.bytes.extend_from_slice(now);
        later
    }

    /// Whether there is no room in it.
    pub fn is_full(&self) -> bool {
        self.bytes.len() == PART_BYTES
    }

    /// Lends out what is in it. It is empty again when that comes back with [`Buffer::take_back`].
    pub fn lend(&mut self) -> Bytes {
        mem::take(&mut self.bytes).freeze()
    }

    /// Takes back what was lent. Where somebody keeps it, there will be new memory.
    pub fn take_back(&mut self, lent: Bytes) {
        self.bytes = lent.try_into_mut().unwrap_or_default();
        self.bytes.clear();
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
        if bytes.capacity() >= PART_BYTES {
            bytes.clear();
            self.home.0.lock().unwrap_or_else(PoisonError::into_inner).push(bytes);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_memory_serves_one_part_after_the_other() {
        let (buffers, piece) = (Buffers::default(), vec![7; PART_BYTES / 2 + 1]);
        let mut first = buffers.take();
        assert!(first.fill(&piece).is_empty() && !first.is_full());
        assert_eq!(first.fill(&piece).len(), 2);
        assert!(first.is_full());
        let memory = first.as_ptr();
        for _ in 0..3 {
            let lent = first.lend();
            assert_eq!((lent.as_ptr(), lent.len()), (memory, PART_BYTES));
            first.take_back(lent);
            assert!(first.is_empty());
            first.fill(&piece);
            first.fill(&piece);
            assert_eq!(first.as_ptr(), memory);
        }
        drop(first);
        let mut second = buffers.take();
        assert!(second.is_empty());
        second.fill(b"next");
        assert_eq!((&*second, second.as_ptr()), (b"next".as_slice(), memory));
        // Who asks meanwhile has another.
        let mut third = buffers.take();
        third.fill(b"other");
        assert_ne!(third.as_ptr(), memory);
    }

    #[test]
    fn what_somebody_keeps_is_replaced() {
        let mut buffer = Buffers::default().take();
        buffer.fill(b"kept");
        let lent = buffer.lend();
        let kept = lent.clone();
        buffer.take_back(lent);
        buffer.fill(b"new");
        assert_eq!((&*kept, &*buffer), (b"kept".as_slice(), b"new".as_slice()));
    }
}
