//! A ray set's parts as one file: what the pipeline reads from.

use super::blobs::Blobs;
use bytes::Bytes;
use std::collections::VecDeque;
use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::runtime::Handle;

/// Blocks kept, so that threads which read chunks next to each other do not ask twice for what lies between.
const BLOCKS: usize = 8;
/// Local files kept open, so that a part is not opened for every chunk of it.
const FILES: usize = 8;

/// One stored part of a file, which never changes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Part {
    /// Key of the blob.
    pub blob: String,
    /// Length, bytes; never 0.
    pub byte_count: u64,
}

/// The parts of a file in order, read like one file. Reading blocks: only threads of the pipeline may call it, never an async
/// one.
pub struct Parts {
    reader: PartReader,
    parts: Vec<Part>,
    /// Offset of each part in the whole, and the total length last.
    offsets: Vec<u64>,
}

/// Reads the parts of one file, each known by its number: local files straight into the reader's memory, others a block at a
/// time for all threads.
pub struct PartReader {
    blobs: Blobs,
    /// Number of bytes that one request to the store reads.
    block_bytes: u64,
    runtime: Handle,
    /// The blocks last begun, oldest first.
    blocks: Mutex<VecDeque<Block>>,
    /// The local files last opened, oldest first.
    files: Mutex<VecDeque<(usize, Arc<File>)>>,
}

/// A piece of a part: asked for by the first thread that needs it, waited for by the others.
#[derive(Clone)]
struct Block {
    part: usize,
    number: u64,
    bytes: Arc<Mutex<Option<Bytes>>>,
}

impl Parts {
    /// `parts` in order.
    pub fn new(blobs: Blobs, parts: Vec<Part>, runtime: Handle) -> Parts {
        let mut offsets = vec![0];
        let mut end = 0;
        for part in &parts {
            end += part.byte_count;
            offsets.push(end);
        }
        Parts { reader: PartReader::new(blobs, runtime), parts, offsets }
    }
}

impl PartReader {
    /// A reader of parts that are stored in `blobs`.
    pub fn new(blobs: Blobs, runtime: Handle) -> PartReader {
        let block_bytes = blobs.block_bytes();
        PartReader { blobs, block_bytes, runtime, blocks: Mutex::default(), files: Mutex::default() }
    }

    /// Fills `into` from byte `from` of `part`, whose number is `index`. Blocks: must not be called on an async thread.
    ///
    /// # Errors
    /// The store did not answer, or has less than that.
    pub fn read(&self, index: usize, part: &Part, from: u64, into: &mut [u8]) -> io::Result<()> {
        // Where that fails, the store says why.
        if let Some(file) = self.file(index, part)
            && file.read_exact_at(into, from).is_ok()
        {
            return Ok(());
        }
        let (mut rest, mut from) = (into, from);
        while !rest.is_empty() {
            let block = self.block(index, part, from / self.block_bytes)?;
            let bytes = block.get((from % self.block_bytes) as usize..).unwrap_or_default();
            if bytes.is_empty() {
                return Err(io::ErrorKind::UnexpectedEof.into());
            }
            let (now, later) = rest.split_at_mut(bytes.len().min(rest.len()));
            now.copy_from_slice(bytes.get(..now.len()).unwrap_or_default());
            from += now.len() as u64;
            rest = later;
        }
        Ok(())
    }

    /// A part that is a file of this machine, open.
    fn file(&self, index: usize, part: &Part) -> Option<Arc<File>> {
        if let Some((_, file)) = locked(&self.files).iter().find(|(number, _)| *number == index) {
            return Some(Arc::clone(file));
        }
        let file = Arc::new(File::open(self.blobs.local_file(&part.blob)?).ok()?);
        let mut files = locked(&self.files);
        if files.len() == FILES {
            files.pop_front();
        }
        files.push_back((index, Arc::clone(&file)));
        Some(file)
    }

    /// The bytes of one block, the last of a part being shorter.
    fn block(&self, index: usize, part: &Part, number: u64) -> io::Result<Bytes> {
        let block = self.remembered(index, number);
        let mut bytes = locked(&block.bytes);
        if let Some(bytes) = bytes.as_ref() {
            return Ok(bytes.clone());
        }
        let start = number * self.block_bytes;
        let range = start..part.byte_count.min(start + self.block_bytes);
        let (blobs, blob) = (self.blobs.clone(), part.blob.clone());
        // Asked by a task of the runtime: this thread may have a lower priority than those that the store's work needs, and what
        // is started from here would have it too.
        let read = self.runtime.spawn(async move { blobs.read(&blob, range).await });
        let read = self.runtime.block_on(read).map_err(io::Error::other)?.map_err(io::Error::other)?;
        *bytes = Some(read.clone());
        Ok(read)
    }

    /// A block that is kept, with its bytes or for those to come.
    fn remembered(&self, part: usize, number: u64) -> Block {
        let mut blocks = locked(&self.blocks);
        if let Some(block) = blocks.iter().find(|block| (block.part, block.number) == (part, number)) {
            return block.clone();
        }
        if blocks.len() == BLOCKS {
            blocks.pop_front();
        }
        let block = Block { part, number, bytes: Arc::default() };
        blocks.push_back(block.clone());
        block
    }
}

/// A thread that panicked while it held this left it whole: it is only ever replaced.
fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl pipeline::Bytes for Parts {
    fn len(&self) -> u64 {
        self.offsets.last().copied().unwrap_or(0)
    }

    fn read_at(&self, offset: u64, into: &mut [u8]) -> io::Result<()> {
        if offset.checked_add(into.len() as u64).is_none_or(|end| end > self.len()) {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        let first = self.offsets.partition_point(|start| *start <= offset).saturating_sub(1);
        let (mut rest, mut offset) = (into, offset);
        for (index, (part, start)) in self.parts.iter().zip(&self.offsets).enumerate().skip(first) {
            let there = (start + part.byte_count).saturating_sub(offset);
            let length = usize::try_from(there).unwrap_or(usize::MAX).min(rest.len());
            let (now, later) = rest.split_at_mut(length);
            if !now.is_empty() {
                self.reader.read(index, part, offset - start, now)?;
            }
            offset += length as u64;
            rest = later;
        }
        Ok(())
    }
}

/// Longest part, bytes: every upload at hand holds one or two in memory, and eight at once are to stay below 64 MB with all they
/// need. Less would be more rows, more requests to a store, and more waiting for a disk.
pub const PART_BYTES: usize = 5 << 19;

#[cfg(test)]
mod tests {
    use super::*;
    use pipeline::Bytes as _;

    #[test]
    fn every_range_of_three_parts_is_that_range_of_the_whole() {
        let folder = tempfile::tempdir().unwrap();
        let runtime = tokio::runtime::Builder::new_multi_thread().build().unwrap();
        let blobs = Blobs::open(&format!("file:{}", folder.path().display())).unwrap();
        let whole: Vec<u8> = (0..23).collect();
        let mut parts = Vec::new();
        for (number, piece) in [&whole[..8], &whole[8..16], &whole[16..]].into_iter().enumerate() {
            let blob = format!("ray-sets/x/{number}");
            runtime.block_on(blobs.put(&blob, piece.to_vec().into())).unwrap();
            parts.push(Part { blob, byte_count: piece.len() as u64 });
        }
        let parts = Parts::new(blobs, parts, runtime.handle().clone());
        assert_eq!(parts.len(), 23);
        for start in 0..=23 {
            for end in start..=23 {
                let mut into = vec![0; end - start];
                parts.read_at(start as u64, &mut into).unwrap();
                assert_eq!(into, whole[start..end]);
            }
        }
        let past = parts.read_at(20, &mut [0; 4]).unwrap_err();
        assert_eq!(past.kind(), io::ErrorKind::UnexpectedEof);
        assert_eq!(parts.read_at(u64::MAX, &mut [0; 1]).unwrap_err().kind(), io::ErrorKind::UnexpectedEof);
    }

    /// The `nice` values of this process's threads called `name`: field 19 of proc(5), counted after the name.
    #[cfg(target_os = "linux")]
    fn nice_of(name: &str) -> Vec<i32> {
        let lines = std::fs::read_dir("/proc/self/task").unwrap().filter_map(|task| {
            // A thread may end while it is looked at.
            std::fs::read_to_string(task.unwrap().path().join("stat")).ok()
        });
        let named = lines.filter(|line| line.contains(&format!("({name})")));
        named
            .map(|line| line.rsplit_once(')').unwrap().1.split_whitespace().nth(16).unwrap().parse().unwrap())
            .collect()
    }

    #[cfg(target_os = "linux")]
    #[tokio::test]
    async fn reading_for_a_thread_of_lower_priority_lowers_no_thread_of_the_runtime() {
        use crate::priority::compute;
        let folder = tempfile::tempdir().unwrap();
        let blobs = Blobs::open(&format!("file:{}", folder.path().display())).unwrap();
        blobs.put("ray-sets/x/0", vec![7; 100].into()).await.unwrap();
        let parts = || vec![Part { blob: "ray-sets/x/0".into(), byte_count: 100 }];
        // Each runtime has no blocking thread yet: the first read of the store starts one.
        let runtime = |name: &str| {
            tokio::runtime::Builder::new_multi_thread()
                .worker_threads(1)
                .enable_all()
                .thread_name(name)
                .build()
                .unwrap()
        };
        let (right, wrong) = (runtime("reads-aside"), runtime("reads-itself"));
        let read = Parts::new(blobs.clone(), parts(), right.handle().clone());
        // Local files are read without the runtime; blocks are what is asked of other stores.
        let part = parts().remove(0);
        assert_eq!(compute("computes", move || read.reader.block(0, &part, 0)).await.unwrap().unwrap().len(), 100);
        let (handle, blobs) = (wrong.handle().clone(), blobs.clone());
        compute("computes", move || handle.block_on(blobs.read("ray-sets/x/0", 0..100))).await.unwrap().unwrap();
        let (right_nice, wrong_nice) = (nice_of("reads-aside"), nice_of("reads-itself"));
        assert!(right_nice.len() > 1 && right_nice.iter().all(|nice| *nice <= 0), "{right_nice:?}");
        assert!(wrong_nice.iter().any(|nice| *nice > 0), "asked without a task, it would be lowered: {wrong_nice:?}");
        right.shutdown_background();
        wrong.shutdown_background();
    }

    #[test]
    fn many_threads_read_what_was_written_block_by_block() {
        let folder = tempfile::tempdir().unwrap();
        let runtime = tokio::runtime::Builder::new_multi_thread().build().unwrap();
        let blobs = Blobs::open(&format!("file:{}", folder.path().display())).unwrap();
        // Two parts of many blocks, the last ones short; no byte like that a block before.
        let byte = |at: usize| ((at as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 56) as u8;
        let block = blobs.block_bytes() as usize;
        let lengths = [20 * block + 7, 24 * block + 1];
        let whole: Vec<u8> = (0..lengths[0] + lengths[1]).map(byte).collect();
        let mut parts = Vec::new();
        for (number, piece) in [&whole[..lengths[0]], &whole[lengths[0]..]].into_iter().enumerate() {
            let blob = format!("ray-sets/x/{number}");
            runtime.block_on(blobs.put(&blob, piece.to_vec().into())).unwrap();
            parts.push(Part { blob, byte_count: piece.len() as u64 });
        }
        let parts = Parts::new(blobs, parts, runtime.handle().clone());
        std::thread::scope(|scope| {
            for thread in 0..4 {
                let (parts, whole) = (&parts, &whole);
                scope.spawn(move || {
                    for start in (thread * 300_007..whole.len()).step_by(4 * 300_007) {
                        let end = whole.len().min(start + 300_007);
                        let mut into = vec![0; end - start];
                        parts.read_at(start as u64, &mut into).unwrap();
                        assert!(into == whole[start..end], "{start}");
                    }
                });
            }
        });
    }
}
