//! Files as one: the zip of everything, and the archives that are files themselves (GLDF, L3D).

use crate::error::Error;
use crate::writing::Artifact;
use crate::writing::json::unwritten;
use std::io::{Cursor, Write as _};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, ZipWriter};

/// The one zip of everything: files in order, deflated, dated 1980-01-01.
///
/// # Errors
/// [`Error::Internal`] when the archive cannot be written.
pub fn zip(artifacts: &[Artifact]) -> Result<Vec<u8>, Error> {
    let options = SimpleFileOptions::default()
        .compression_method(CompressionMethod::Deflated)
        .last_modified_time(DateTime::DEFAULT)
        .unix_permissions(0o644);
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    for artifact in artifacts {
        let options = options.large_file(u32::try_from(artifact.bytes.len()).is_err());
        archive.start_file(artifact.name.as_str(), options).map_err(unwritten)?;
        archive.write_all(&artifact.bytes).map_err(unwritten)?;
    }
    Ok(archive.finish().map_err(unwritten)?.into_inner())
}
