//! A file that is still arriving, read as if it were whole: a read beyond the bytes that have arrived waits for them. Bytes that
//! are not stored yet are read from memory, stored ones from the object store.

use crate::storage::blobs::Blobs;
use crate::storage::parts::{Part, PartReader};
use bytes::Bytes;
use std::collections::VecDeque;
use std::io;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::runtime::Handle;

/// How long is waited for the next part: with parts of 2.5 MiB, what comes more slowly than that many per second is read
/// afterwards, faster than it comes. A slow or silent sender so keeps neither thread nor memory.
const PATIENCE: Duration = Duration::from_secs(1);

/// The file. Read from a thread that may block.
pub(super) struct Arriving {
    byte_count: u64,
    reader: PartReader,
    patience: Duration,
    come: Mutex<Come>,
    more: Condvar,
}

/// What has come of it.
#[derive(Default)]
struct Come {
    /// Number of bytes that have arrived.
    byte_count: u64,
    /// Stored parts of the file, each with its offset.
    stored: Vec<(u64, Part)>,
    /// Bytes after the stored parts, each piece with its offset.
    at_hand: VecDeque<(u64, Bytes)>,
    /// The inspection has stopped.
    stopped: bool,
}

/// Where a byte of an arriving file is.
enum ByteLocation {
    /// In memory, so many bytes after the beginning of these.
    AtHand(Bytes, u64),
    /// In a stored part, whose number this is, so many bytes after its beginning.
    Stored(usize, Part, u64),
}

impl Come {
    fn location(&self, offset: u64) -> Option<ByteLocation> {
        if let Some((start, bytes)) = self.at_hand.iter().rev().find(|(start, _)| *start <= offset) {
            let from = offset - start;
            return (from < bytes.len() as u64).then(|| ByteLocation::AtHand(bytes.clone(), from));
        }
        let number = self.stored.partition_point(|(start, _)| *start <= offset).checked_sub(1)?;
        let (start, part) = self.stored.get(number)?;
        let from = offset - start;
        (from < part.byte_count).then(|| ByteLocation::Stored(number, part.clone(), from))
    }
}

impl Arriving {
    /// A file of `byte_count` bytes, of which nothing has come; its parts will be among `blobs`.
    pub fn new(blobs: Blobs, byte_count: u64, runtime: Handle) -> Arriving {
        let reader = PartReader::new(blobs, runtime);
        Arriving { byte_count, reader, patience: PATIENCE, come: Mutex::default(), more: Condvar::new() }
    }

    /// The next bytes have come; they stay at hand until they are stored.
    pub fn has_come(&self, bytes: Bytes) {
        let mut come = self.come();
        let start = come.byte_count;
        come.byte_count += bytes.len() as u64;
        come.at_hand.push_back((start, bytes));
        self.more.notify_all();
    }

    /// The first bytes at hand are stored as `part`.
    pub fn is_stored(&self, part: Part) {
        let mut come = self.come();
        if let Some((start, _)) = come.at_hand.pop_front() {
            come.stored.push((start, part));
        }
    }

    /// Ends all waiting, because no more bytes will arrive, or the inspection has stopped.
    pub fn stop(&self) {
        self.come().stopped = true;
        self.more.notify_all();
    }

    fn come(&self) -> MutexGuard<'_, Come> {
        // A thread that panicked while it held this left it whole: what is changed is changed in one step.
        self.come.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits until the byte at `offset` has come.
    fn location(&self, offset: u64) -> io::Result<ByteLocation> {
        let mut come = self.come();
        loop {
            if let Some(place) = come.location(offset) {
                return Ok(place);
            }
            if come.stopped {
                return Err(io::Error::other("the file is not needed any more"));
            }
            let before = come.byte_count;
            let is_silent = |come: &mut Come| come.byte_count == before && !come.stopped;
            let waited = self.more.wait_timeout_while(come, self.patience, is_silent);
            let (now, waited) = waited.unwrap_or_else(PoisonError::into_inner);
            if waited.timed_out() {
                return Err(io::Error::new(
                    io::ErrorKind::TimedOut,
                    "the file arrives too slowly for an inspection on the way",
                ));
            }
            come = now;
        }
    }
}

impl pipeline::Bytes for Arriving {
    fn len(&self) -> u64 {
        self.byte_count
    }

    fn read_at(&self, offset: u64, into: &mut [u8]) -> io::Result<()> {
        if offset.checked_add(into.len() as u64).is_none_or(|end| end > self.byte_count) {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        let (mut rest, mut offset) = (into, offset);
        while !rest.is_empty() {
            let place = self.location(offset)?;
            let there = match &place {
                ByteLocation::AtHand(bytes, from) => bytes.len() as u64 - from,
                ByteLocation::Stored(_, part, from) => part.byte_count - from,
            };
            let length = usize::try_from(there).unwrap_or(usize::MAX).min(rest.len());
            let (now, later) = rest.split_at_mut(length);
            match place {
                ByteLocation::AtHand(bytes, from) => {
                    now.copy_from_slice(bytes.get(from as usize..).and_then(|it| it.get(..length)).unwrap_or_default());
                }
                ByteLocation::Stored(number, part, from) => self.reader.read(number, &part, from, now)?,
            }
            offset += length as u64;
            rest = later;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pipeline::Bytes as _;
    use std::sync::Arc;
    use std::sync::atomic::{AtomicBool, Ordering};
    use std::thread;
    use tokio::runtime::Runtime;

    /// Longer than any test takes: what is waited for comes.
    const LONG: Duration = Duration::from_secs(600);

    /// A file on its way: its parts are stored in a folder, which is deleted at the end.
    struct Sent {
        folder: tempfile::TempDir,
        runtime: Runtime,
        whole: Vec<u8>,
    }

    impl Sent {
        fn new(length: usize) -> Sent {
            let byte = |at: usize| ((at as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 56) as u8;
            let runtime = tokio::runtime::Builder::new_multi_thread().build().unwrap();
            Sent { folder: tempfile::tempdir().unwrap(), runtime, whole: (0..length).map(byte).collect() }
        }

        fn blobs(&self) -> Blobs {
            Blobs::open(&format!("file:{}", self.folder.path().display())).unwrap()
        }

        fn arriving(&self, patience: Duration) -> Arc<Arriving> {
            let arriving = Arriving::new(self.blobs(), self.whole.len() as u64, self.runtime.handle().clone());
            Arc::new(Arriving { patience, ..arriving })
        }

        /// Sends the file in pieces of these lengths again and again, each stored when the next has come.
        fn send(&self, arriving: &Arriving, lengths: &[usize]) {
            let (blobs, mut rest, mut before) = (self.blobs(), self.whole.as_slice(), None);
            for (number, length) in lengths.iter().cycle().enumerate() {
                let (now, later) = rest.split_at((*length).min(rest.len()));
                arriving.has_come(Bytes::copy_from_slice(now));
                if let Some(part) = before.take() {
                    arriving.is_stored(part);
                }
                if now.is_empty() {
                    break;
                }
                let blob = format!("ray-sets/x/{number}");
                self.runtime.block_on(blobs.put(&blob, Bytes::copy_from_slice(now))).unwrap();
                before = Some(Part { blob, byte_count: now.len() as u64 });
                rest = later;
            }
        }

        fn reads(&self, arriving: &Arriving, from: usize, length: usize) {
            let end = self.whole.len().min(from + length);
            let mut into = vec![0; end - from];
            arriving.read_at(from as u64, &mut into).unwrap();
            assert!(into == self.whole[from..end], "{from}, {length} bytes");
        }
    }

    /// In order, as binary files are read; backwards and at the end first, as trailers are; at odd places by several threads.
    /// The readers begin before anything has come.
    #[test]
    fn whoever_reads_in_whatever_order_gets_the_bytes_of_the_file() {
        let sent = Sent::new(100_003);
        let arriving = sent.arriving(LONG);
        assert_eq!(arriving.len(), 100_003);
        thread::scope(|scope| {
            let (sent, arriving) = (&sent, &arriving);
            scope.spawn(|| (0..100_003).step_by(997).for_each(|from| sent.reads(arriving, from, 997)));
            scope.spawn(|| (0..100_003).step_by(1009).rev().for_each(|from| sent.reads(arriving, from, 2000)));
            scope.spawn(|| (0..500).for_each(|k| sent.reads(arriving, k * 7919 % 100_003, 1 + k * 31 % 9000)));
            scope.spawn(|| sent.send(arriving, &[4096, 1, 10_000, 777]));
        });
        // And again when all of it is stored, and only there.
        assert!(arriving.come().at_hand.iter().all(|(_, bytes)| bytes.is_empty()));
        sent.reads(&arriving, 0, 100_003);
    }

    #[test]
    fn what_is_at_hand_is_not_asked_of_the_store() {
        let sent = Sent::new(10);
        let arriving = sent.arriving(LONG);
        arriving.has_come(Bytes::copy_from_slice(&sent.whole[..6]));
        sent.reads(&arriving, 0, 6);
        // The store has no such part: whoever asks it is told so.
        arriving.is_stored(Part { blob: "ray-sets/x/none".into(), byte_count: 6 });
        assert!(arriving.read_at(0, &mut [0; 6]).is_err());
        arriving.has_come(Bytes::copy_from_slice(&sent.whole[6..]));
        sent.reads(&arriving, 6, 4);
    }

    #[test]
    fn nobody_waits_for_bytes_beyond_the_end_or_for_a_silent_sender() {
        let sent = Sent::new(10);
        let arriving = sent.arriving(Duration::from_millis(10));
        let kind = |from, length| arriving.read_at(from, &mut vec![0; length]).unwrap_err().kind();
        assert_eq!(kind(0, 11), io::ErrorKind::UnexpectedEof);
        assert_eq!(kind(u64::MAX, 1), io::ErrorKind::UnexpectedEof);
        assert_eq!(kind(0, 1), io::ErrorKind::TimedOut);
        arriving.has_come(Bytes::copy_from_slice(&sent.whole[..6]));
        sent.reads(&arriving, 0, 6);
        assert_eq!(kind(0, 7), io::ErrorKind::TimedOut);
    }

    #[test]
    fn who_waits_when_the_upload_ends_is_told_at_once() {
        let sent = Sent::new(10);
        let arriving = sent.arriving(LONG);
        let told = AtomicBool::new(false);
        thread::scope(|scope| {
            scope.spawn(|| {
                let error = arriving.read_at(3, &mut [0; 2]).unwrap_err();
                assert_eq!(error.kind(), io::ErrorKind::Other);
                told.store(true, Ordering::SeqCst);
            });
            arriving.has_come(Bytes::copy_from_slice(&sent.whole[..4]));
            assert!(!told.load(Ordering::SeqCst));
            arriving.stop();
        });
        // What is there can be read all the same.
        sent.reads(&arriving, 0, 4);
    }
}
