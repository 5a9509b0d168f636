//! Bounded reading: every failure knows its offset, no count is trusted, nothing is allocated before the file is known to be
//! long enough.

use super::record::Bytes;
use crate::error::Error;
use sha2::{Digest, Sha256};
use std::io;

/// Bytes per block of [`digest`].
const DIGEST_BLOCK: usize = 1 << 20;

/// Reads forward through [`Bytes`], little-endian.
pub struct Cursor<'a> {
    bytes: &'a dyn Bytes,
    at: u64,
}

impl<'a> Cursor<'a> {
    /// A cursor at `offset`.
    pub fn new(bytes: &'a dyn Bytes, offset: u64) -> Cursor<'a> {
        Cursor { bytes, at: offset }
    }

    /// Offset of the next byte.
    pub fn at(&self) -> u64 {
        self.at
    }

    /// `count` as a size, when as many bytes are left for `what`.
    ///
    /// # Errors
    /// `rays.truncated` when the file ends before.
    pub fn fits(&self, what: &str, count: u64) -> Result<usize, Error> {
        let left = self.bytes.len().saturating_sub(self.at);
        usize::try_from(count).ok().filter(|_| count <= left).ok_or_else(|| {
            Error::malformed(
                "rays.truncated",
                format!("The file ends inside {what}: {count} bytes are announced and {left} are left."),
                "Fetch the file again; the copy is not complete.",
            )
            .at_byte(self.at)
        })
    }

    /// The next `count` bytes, which are `what`.
    ///
    /// # Errors
    /// `rays.truncated` when the file ends before; nothing is allocated then.
    pub fn block(&mut self, what: &str, count: u64) -> Result<Vec<u8>, Error> {
        let mut block = vec![0; self.fits(what, count)?];
        self.bytes.read_at(self.at, &mut block)?;
        self.at += count;
        Ok(block)
    }

    /// The next number.
    ///
    /// # Errors
    /// `rays.truncated`.
    pub fn i32(&mut self, what: &str) -> Result<i32, Error> {
        Ok(i32_in(&self.block(what, 4)?, 0))
    }
}

/// Four bytes of `block` from `at`; zeros past its end.
pub fn word_in(block: &[u8], at: usize) -> [u8; 4] {
    block.get(at..).and_then(|rest| rest.first_chunk()).copied().unwrap_or_default()
}

/// A little-endian i32 in `block`; 0 past its end.
pub fn i32_in(block: &[u8], at: usize) -> i32 {
    i32::from_le_bytes(word_in(block, at))
}

/// A little-endian u32 in `block`; 0 past its end.
pub fn u32_in(block: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(word_in(block, at))
}

/// A little-endian u16 in `block`; 0 past its end.
pub fn u16_in(block: &[u8], at: usize) -> u16 {
    block.get(at..).and_then(|rest| rest.first_chunk()).map_or(0, |word| u16::from_le_bytes(*word))
}

/// A little-endian u64 in `block`; 0 past its end.
pub fn u64_in(block: &[u8], at: usize) -> u64 {
    block.get(at..).and_then(|rest| rest.first_chunk()).map_or(0, |word| u64::from_le_bytes(*word))
}

/// A little-endian binary32 in `block`; 0 past its end.
pub fn f32_in(block: &[u8], at: usize) -> f32 {
    f32::from_le_bytes(word_in(block, at))
}

/// Text up to the first NUL, spaces trimmed; what is not ASCII becomes `?`.
pub fn ascii(block: &[u8]) -> String {
    let text = block.split(|byte| *byte == 0).next().unwrap_or_default();
    let shown = text.iter().map(|b| if b.is_ascii() && !b.is_ascii_control() { char::from(*b) } else { '?' });
    shown.collect::<String>().trim().to_owned()
}

/// SHA-256 of all bytes, lower-case hex, read in blocks.
///
/// # Errors
/// What the medium answers.
pub fn digest(bytes: &dyn Bytes) -> io::Result<String> {
    let mut hash = Sha256::new();
    let mut block = vec![0; DIGEST_BLOCK];
    let mut at = 0;
    while at < bytes.len() {
        let count = usize::try_from(bytes.len() - at).unwrap_or(usize::MAX).min(DIGEST_BLOCK);
        let part = block.get_mut(..count).unwrap_or_default();
        bytes.read_at(at, part)?;
        hash.update(part);
        at += count as u64;
    }
    Ok(hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect())
}

/// Bytes looked at.
pub const LOOK: usize = 4096;

#[cfg(test)]
mod tests {
    use super::*;

    /// FIPS 180-2 appendix B.1 and B.3.
    #[test]
    fn digest_of_the_standards_messages() {
        assert_eq!(
            digest(&b"abc".to_vec()).unwrap(),
            "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
        );
        assert_eq!(
            digest(&vec![b'a'; 1_000_000]).unwrap(),
            "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0"
        );
    }

    #[test]
    fn a_claim_beyond_the_end_allocates_nothing_and_names_its_offset() {
        let bytes = vec![0_u8; 100];
        let mut cursor = Cursor::new(&bytes, 60);
        let error = cursor.block("the table", u64::MAX).unwrap_err();
        assert_eq!(error.code(), "rays.truncated");
        assert!(error.to_string().contains("byte 60"), "{error}");
        assert_eq!(cursor.block("the rest", 40).unwrap().len(), 40);
        assert_eq!(cursor.i32("one more").unwrap_err().code(), "rays.truncated");
    }

    #[test]
    fn text_stops_at_nul_and_never_fails() {
        assert_eq!(ascii(b"  made by hand \0rest"), "made by hand");
        assert_eq!(ascii(&[0xff, b'a', 7]), "?a?");
        assert_eq!(i32_in(&[1, 0], 0), 0);
    }
}
