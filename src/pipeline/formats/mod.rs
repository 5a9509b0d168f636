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
pub mod lighttools;
/// Speos / OPTIS ray files.
mod speos;
/// ASAP .dis ray files.
mod asap;
/// TracePro / ProSource text ray files.
mod prosource;
/// What is no ray file, or none with a public layout.
mod foreign;
/// What Lampwright itself writes.
mod own;
/// Wavelengths of rays in another unit than their format has.
mod wavelengths;
/// Which format a file is, from content alone.
pub mod detect;
/// What a file is where another one was expected.
mod taken;
/// Files as vendors ship them: gzip, zstd, zip.
pub mod packed;
/// IES TM-27 spectra.
mod spectrum_xml;
/// The spectrum of a channel from a file of its own.
pub mod spectrum_file;

pub use foreign::{GLDF_PRODUCT, is_gldf_product};
pub use own::{MODEL, model};
pub use taken::no_model_but_gldf;

use crate::error::Error;
use crate::vocabulary::declaration::Column;
use crate::vocabulary::limits::Limits;
use record::{Bytes, Format, RaySet, Reader, Sign};
use spectrum_file::SpectrumFile;
use std::io;
use std::sync::Arc;
use text::lines::{is_comment, leading_numbers};

/// Every format that is read, in the order in which a file is tried.
const FORMATS: [Reader; 9] = [
    Reader {
        format: Format::Tm25,
        sign: Sign::Magic(|start| start.starts_with(b"TM25")),
        open: |bytes, _, limits| tm25::open(bytes, limits),
        peek: tm25::peek,
    },
    Reader {
        format: Format::LightToolsBinary,
        sign: Sign::Magic(|start| start.starts_with(b"LTRF")),
        open: |bytes, _, limits| lighttools::binary::open(bytes, limits),
        peek: |bytes, length, _| lighttools::binary::peek(bytes, length),
    },
    Reader {
        format: Format::ZemaxBinary,
        sign: Sign::Magic(zemax::binary::begins),
        open: |bytes, _, limits| zemax::binary::open(bytes, limits),
        peek: |bytes, length, _| zemax::binary::peek(bytes, length),
    },
    Reader {
        format: Format::Asap,
        sign: Sign::Marker(asap::begins),
        open: |bytes, _, limits| asap::open(bytes, limits),
        peek: |bytes, length, _| asap::peek(bytes, length),
    },
    Reader {
        format: Format::LightToolsText,
        sign: Sign::Words(|text| text.contains("lt_rdf_version") || text.contains("lt_startofdata")),
        open: lighttools::text::open,
        peek: |bytes, length, _| lighttools::text::peek(bytes, length),
    },
    Reader {
        format: Format::ProSourceText,
        sign: Sign::Words(|text| text.contains("nbrrays requested")),
        open: prosource::open,
        peek: |bytes, length, _| prosource::peek(bytes, length),
    },
    Reader {
        format: Format::ZemaxText,
        sign: Sign::Lines(|lines| {
            let mut said = lines.iter().filter(|line| !is_comment(line));
            said.next().is_some_and(|first| zemax::text::starts(first, said.next().copied()))
        }),
        open: zemax::text::open,
        peek: |bytes, length, _| zemax::text::peek(bytes, length),
    },
    Reader {
        format: Format::Columns,
        sign: Sign::Lines(|lines| lines.iter().any(|line| leading_numbers(line) >= text::columns::FEWEST)),
        open: text::columns::open,
        peek: |bytes, length, _| text::columns::peek(bytes, length),
    },
    Reader {
        format: Format::Speos,
        sign: Sign::Layout(speos::is_speos),
        open: |bytes, _, limits| speos::open(bytes, limits),
        peek: |bytes, length, _| speos::peek(bytes, length),
    },
];

/// Opens one ray file: detects its format, decodes its header, proves its count. Reads no ray; a text file is gone through once,
/// because only that finds its rows. `columns`: what was declared of the columns of a text file.
///
/// # Errors
/// [`Error::Malformed`], [`Error::Refused`], [`Error::Unreadable`].
pub fn open(bytes: Arc<dyn Bytes>, columns: Option<&[Column]>, limits: &Limits) -> Result<RaySet, Error> {
    let reader = detect::detect(&FORMATS, bytes.as_ref())?;
    let set = (reader.open)(bytes, columns, limits)?;
    // Whoever declares columns declares the unit of their wavelengths too.
    Ok(if columns.is_none() { wavelengths::in_nm(set) } else { set })
}

/// Judges a file by its first bytes, `length` being its full length where that is known. `Some` means: so far a file of this
/// format; `None`: too few bytes to tell.
///
/// # Errors
/// As [`open`], as soon as the bytes at hand prove it.
pub fn peek(prefix: &[u8], length: Option<u64>, limits: &Limits) -> Result<Option<Format>, Error> {
    let start = prefix.get(..prefix.len().min(detect::MOST)).unwrap_or_default();
    let Some(reader) = detect::detect_start(&FORMATS, start, length)? else { return Ok(None) };
    let bytes = Prefix { bytes: prefix, length: length.unwrap_or(u64::MAX) };
    match (reader.peek)(&bytes, length, limits) {
        Err(Error::Unreadable(_)) | Ok(()) => Ok(Some(reader.format)),
        Err(error) => Err(error),
    }
}

/// Bytes that [`no_model`] wants to see of a file.
pub const START_BYTES: usize = bytes::LOOK;

/// The refusal of a file that starts with `start`, its first [`START_BYTES`], and is `length` bytes long, where a model is wanted: it says
/// what the file is.
pub fn no_model(start: &[u8], length: u64) -> Error {
    taken::no_model(&FORMATS, start, length)
}

/// Reads the spectrum file `bytes`; what is none at all is told by what it is.
///
/// # Errors
/// As [`spectrum_file::parse`]; `spectrum.not_spectrum`.
pub fn spectrum(bytes: &[u8]) -> Result<SpectrumFile, Error> {
    spectrum_file::parse(bytes).map_err(|error| taken::no_spectrum(&FORMATS, bytes).unwrap_or(error))
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
