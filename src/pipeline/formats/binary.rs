//! Records of little-endian binary32 numbers, one after another: what the binary formats have in common.

use super::record::{Bytes, RawRay, Records};
use crate::error::Error;
use crate::vocabulary::notice::Notices;
use std::sync::Arc;

/// One record, as words.
pub type Words = [[u8; 4]];

/// Number `k` of a record; 0 past its end.
pub fn float(record: &Words, k: usize) -> f64 {
    record.get(k).map_or(0.0, |word| f64::from(f32::from_le_bytes(*word)))
}

/// Three numbers of a record from `k`, each times `scale`.
pub fn triple(record: &Words, k: usize, scale: f64) -> [f64; 3] {
    [k, k + 1, k + 2].map(|k| float(record, k) * scale)
}

/// Whether a quantity is lm, by the number that Zemax and LightTools have for it under a name of their own; one that does not exist is
/// told, and says nothing.
pub fn in_lumens(stored: i32, code: &'static str, name: &str, notices: &mut Notices) -> Option<bool> {
    match stored {
        0 => Some(false),
        1 => Some(true),
        _ => {
            let told = format!("The {name} is {stored}; only 0 (W) and 1 (lm) exist, so the quantity is not said.");
            notices.add(code, told);
            None
        }
    }
}

/// Records of `words` numbers from byte `start`; `ray` gives them their meaning.
pub struct Floats<F> {
    /// The file.
    pub bytes: Arc<dyn Bytes>,
    /// Offset of the first record.
    pub start: u64,
    /// Numbers per record, at least 1.
    pub words: usize,
    /// The ray of a record of `words` words.
    pub ray: F,
}

impl<F: Fn(&Words) -> RawRay + Send + Sync> Records for Floats<F> {
    fn read(&self, first: u64, count: usize, rays: &mut Vec<RawRay>) -> Result<(), Error> {
        let size = 4 * self.words;
        let mut block = vec![0; count * size];
        self.bytes.read_at(self.start + first * size as u64, &mut block)?;
        let (words, _) = block.as_chunks::<4>();
        rays.extend(words.chunks_exact(self.words).map(&self.ray));
        Ok(())
    }
}
