//! Ray files as vendors write them, each read into the same stored rays.

/// What every reader gives: what a file says of itself, and its rays at random access.
pub mod record;
/// Bounded reading: every failure knows its offset, no count is trusted.
pub mod bytes;
/// Proof by size and by directions that a file has the layout its header promises.
pub mod proof;
/// Records of binary32 numbers, as most binary formats have them.
mod binary;
/// Rays as rows of bytes, written as a stream.
pub mod writer;
/// Text files: lines, rows of numbers, and free columns.
pub mod text;
/// IES TM-25 ray files.
pub mod tm25;
/// Zemax / OpticStudio source files, binary and text.
pub mod zemax;
/// LightTools ray files, binary and text.
mod lighttools;
/// Speos / OPTIS ray files.
mod speos;
/// ASAP .dis ray files.
mod asap;
/// TracePro / ProSource text ray files.
mod prosource;
/// What is no ray file, or none with a public layout.
mod foreign;
/// Which format a file is, from content alone.
pub mod detect;
/// Files as vendors ship them: gzip, zstd, zip.
pub mod packed;
/// The spectrum of a channel from a file of its own.
pub mod spectrum_file;

use crate::error::Error;
use crate::vocabulary::declaration::Column;
use crate::vocabulary::limits::Limits;
use record::{Bytes, Format, RaySet};
use std::io;
use std::sync::Arc;

/// Opens one ray file: detects its format, decodes its header, proves its count. Reads no ray; a text file is gone through once,
/// because only that finds its rows. `columns`: what was declared of the columns of a text file.
///
/// # Errors
/// [`Error::Malformed`], [`Error::Refused`], [`Error::Unreadable`].
pub fn open(bytes: Arc<dyn Bytes>, columns: Option<&[Column]>, limits: &Limits) -> Result<RaySet, Error> {
    match detect::detect(bytes.as_ref())? {
        Format::Tm25 => tm25::open(bytes, limits),
        Format::ZemaxBinary => zemax::binary::open(bytes, limits),
        Format::ZemaxText => zemax::text::open(bytes, limits),
        Format::LightToolsBinary => lighttools::binary::open(bytes, limits),
        Format::LightToolsText => lighttools::text::open(bytes, limits),
        Format::Speos => speos::open(bytes, limits),
        Format::Asap => asap::open(bytes, limits),
        Format::ProSourceText => prosource::open(bytes, limits),
        Format::Columns => text::columns::open(bytes, columns, limits),
    }
}

/// Judges a file of a known format by its first bytes, `length` being its full length where that is known.
///
/// # Errors
/// As [`open`], as soon as the bytes at hand prove it; [`Error::Unreadable`] (end of file) when they hold too little to tell.
fn peek_as(format: Format, bytes: &dyn Bytes, length: Option<u64>, limits: &Limits) -> Result<(), Error> {
    match format {
        Format::Tm25 => tm25::peek(bytes, length, limits),
        Format::ZemaxBinary => zemax::binary::peek(bytes, length),
        Format::ZemaxText => zemax::text::peek(bytes, length),
        Format::LightToolsBinary => lighttools::binary::peek(bytes, length),
        Format::LightToolsText => lighttools::text::peek(bytes, length),
        Format::Speos => speos::peek(bytes, length),
        Format::Asap => asap::peek(bytes, length),
        Format::ProSourceText => prosource::peek(bytes, length),
        Format::Columns => text::columns::peek(bytes, length),
    }
}

/// Judges a file by its first bytes, `length` being its full length where that is known. `Some` means: so far a file of this
/// format; `None`: too few bytes to tell.
///
/// # Errors
/// As [`open`], as soon as the bytes at hand prove it.
pub fn peek(prefix: &[u8], length: Option<u64>, limits: &Limits) -> Result<Option<Format>, Error> {
    let start = prefix.get(..prefix.len().min(bytes::LOOK)).unwrap_or_default();
    let Some(format) = detect::detect_start(start, length)? else { return Ok(None) };
    let bytes = Prefix { bytes: prefix, length: length.unwrap_or(u64::MAX) };
    match peek_as(format, &bytes, length, limits) {
        Err(Error::Unreadable(_)) | Ok(()) => Ok(Some(format)),
        Err(error) => Err(error),
    }
}

/// The first bytes of a longer file.
struct Prefix<'a> {
    bytes: &'a [u8],
    length: u64,
}

impl Bytes for Prefix<'_> {
    fn len(&self) -> u64 {
        self.length
    }

    fn read_at(&self, offset: u64, into: &mut [u8]) -> io::Result<()> {
        let from = usize::try_from(offset).ok().and_then(|start| self.bytes.get(start..));
        let found = from.and_then(|rest| rest.get(..into.len())).ok_or(io::ErrorKind::UnexpectedEof)?;
        into.copy_from_slice(found);
        Ok(())
    }
}
