//! A file on disk as the pipeline wants its bytes: random access, never more in memory than is asked for.

use super::Failure;
use crate::pipeline::{Bytes, Declared, Input};
use sha2::{Digest, Sha256};
use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::sync::Arc;

/// An open file and the length it had when it was opened.
struct OpenFile {
    file: File,
    byte_count: u64,
}

impl Bytes for OpenFile {
    fn len(&self) -> u64 {
        self.byte_count
    }

    fn read_at(&self, offset: u64, into: &mut [u8]) -> io::Result<()> {
        self.file.read_exact_at(into, offset)
    }
}

/// Opens a ray file and takes its digest: one reading of all of it.
///
/// # Errors
/// Whatever the disk answers.
pub fn open(path: &Path) -> Result<Input, Failure> {
    let disk = |error: io::Error| Failure::disk(path, &error);
    let mut file = File::open(path).map_err(disk)?;
    let mut digest = Sha256::new();
    let byte_count = io::copy(&mut file, &mut Digested(&mut digest)).map_err(disk)?;
    let sha256 = digest.finalize().iter().map(|byte| format!("{byte:02x}")).collect();
    let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
    Ok(Input { name, sha256, bytes: Arc::new(OpenFile { file, byte_count }), declared: Declared::default() })
}

/// Writing into a digest.
struct Digested<'a>(&'a mut Sha256);

impl io::Write for Digested<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.update(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_its_bytes_anywhere() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("abc.ray");
        std::fs::write(&path, "abc").unwrap();
        let input = open(&path).unwrap();
        // FIPS 180-4, example B.1.
        assert_eq!(input.sha256, "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
        assert_eq!((input.name.as_str(), input.bytes.len()), ("abc.ray", 3));
        let mut two = [0; 2];
        input.bytes.read_at(1, &mut two).unwrap();
        assert_eq!(&two, b"bc");
        assert_eq!(input.bytes.read_at(2, &mut two).unwrap_err().kind(), io::ErrorKind::UnexpectedEof);
    }
}
