//! A ray set's parts as one file: what the pipeline reads from.

use super::blobs::Blobs;
use crate::pipeline;
use std::io;
use tokio::runtime::Handle;

/// One immutable piece of an upload.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Part {
    /// Key of its blob.
    pub blob: String,
    /// Length, bytes; never 0.
    pub byte_count: u64,
}

/// Parts in order, read like one file. Asked from the pipeline's own threads, never from an async one: it waits.
pub struct Parts {
    blobs: Blobs,
    parts: Vec<Part>,
    /// Offset of each part in the whole, and the total length last.
    offsets: Vec<u64>,
    runtime: Handle,
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
        Parts { blobs, parts, offsets, runtime }
    }
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
        for (part, start) in self.parts.iter().zip(&self.offsets).skip(first) {
            if rest.is_empty() {
                break;
            }
            let from = offset - start;
            let count = (part.byte_count - from).min(rest.len() as u64);
            let bytes =
                self.runtime.block_on(self.blobs.read(&part.blob, from..from + count)).map_err(io::Error::other)?;
            let (now, later) = rest.split_at_mut(bytes.len().min(rest.len()));
            if now.len() as u64 != count {
                return Err(io::Error::other(format!("{} gave {} of {count} bytes", part.blob, now.len())));
            }
            now.copy_from_slice(&bytes);
            (rest, offset) = (later, offset + count);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::Bytes as _;

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
}
