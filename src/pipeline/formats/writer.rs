//! Rays as rows of bytes, written as a stream: the count comes first, the rows after it, memory does not grow with them.

use super::record::RawRay;
use std::io;
use std::io::Write;

/// How a format lays out one ray; can be used on any thread.
pub trait Encode: Sync {
    /// Bytes per ray.
    fn row_bytes(&self) -> usize;
    /// Appends one ray, rounded to what the format holds. [`RawRay::table`] counts from 0.
    fn encode_ray(&self, ray: &RawRay, rows: &mut Vec<u8>);
    /// What stands after the last ray.
    fn end(&self) -> &'static [u8] {
        &[]
    }
}

/// Appends numbers as 32-bit ones.
#[inline]
pub fn put<const N: usize>(numbers: [f64; N], rows: &mut Vec<u8>) {
    rows.extend_from_slice(numbers.map(|number| (number as f32).to_le_bytes()).as_flattened());
}

/// A ray file being written; each format has its own `start`.
pub struct Writer<'a, R> {
    out: &'a mut dyn Write,
    rows: R,
    rays_left: u64,
}

impl<'a, R: Encode + Copy> Writer<'a, R> {
    /// A file whose header, announcing `ray_count` rays, has been written to `out`.
    pub fn announced(out: &'a mut dyn Write, rows: R, ray_count: u64) -> Writer<'a, R> {
        Writer { out, rows, rays_left: ray_count }
    }

    /// The encoder of this file's rows.
    pub fn rows(&self) -> R {
        self.rows
    }

    /// Writes rows that the encoder made.
    ///
    /// # Errors
    /// `InvalidInput` when there are more rays than announced; what the stream answers.
    pub fn write(&mut self, rows: &[u8]) -> io::Result<()> {
        let count = (rows.len() / self.rows.row_bytes()) as u64;
        let Some(left) = self.rays_left.checked_sub(count) else {
            return Err(io::Error::new(io::ErrorKind::InvalidInput, "more rays than announced"));
        };
        self.rays_left = left;
        self.out.write_all(rows)
    }

    /// Ends the file.
    ///
    /// # Errors
    /// `InvalidInput` when rays are missing; what the stream answers.
    pub fn finish(self) -> io::Result<()> {
        if self.rays_left > 0 {
            return Err(io::Error::new(io::ErrorKind::InvalidInput, "fewer rays than announced"));
        }
        self.out.write_all(self.rows.end())?;
        self.out.flush()
    }
}
