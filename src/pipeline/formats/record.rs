//! What every reader gives: what a file says of itself, and its rays at random access.

use crate::error::Error;
use crate::vocabulary::declaration::Column;
use crate::vocabulary::limits::Limits;
use crate::vocabulary::notice::Notices;
use crate::vocabulary::spectrum::Table;
use crate::vocabulary::units::{Flux, LengthUnit};
use serde::{Deserialize, Serialize};
use std::io;
use std::sync::Arc;

/// Random access to the bytes of a ray file, which may be larger than memory.
pub trait Bytes: Send + Sync {
    /// Total length in bytes.
    fn len(&self) -> u64;
    /// True when there are no bytes.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }
    /// Fills all of `into` from `offset`.
    ///
    /// # Errors
    /// `UnexpectedEof` past the end; whatever the medium answers.
    fn read_at(&self, offset: u64, into: &mut [u8]) -> io::Result<()>;
}

impl Bytes for Vec<u8> {
    fn len(&self) -> u64 {
        self.as_slice().len() as u64
    }

    fn read_at(&self, offset: u64, into: &mut [u8]) -> io::Result<()> {
        let start = usize::try_from(offset).map_err(|_| io::ErrorKind::UnexpectedEof)?;
        let end = start.checked_add(into.len()).ok_or(io::ErrorKind::UnexpectedEof)?;
        into.copy_from_slice(self.get(start..end).ok_or(io::ErrorKind::UnexpectedEof)?);
        Ok(())
    }
}

/// File formats we read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(into = "&'static str", try_from = "String")]
pub enum Format {
    /// IES TM-25-13 / -20.
    Tm25,
    /// Zemax / OpticStudio binary .dat/.sdf.
    ZemaxBinary,
    /// Zemax / OpticStudio text.
    ZemaxText,
    /// LightTools binary .ray.
    LightToolsBinary,
    /// LightTools text .ray.
    LightToolsText,
    /// Speos / OPTIS .ray.
    Speos,
    /// ASAP .dis.
    Asap,
    /// TracePro / ProSource text.
    ProSourceText,
    /// Columns of numbers: CSV and the like.
    Columns,
}

/// The names people use, which are also those in artifacts and rows.
const NAMES: [(Format, &str); 9] = [
    (Format::Tm25, "IES TM-25"),
    (Format::ZemaxBinary, "Zemax binary"),
    (Format::ZemaxText, "Zemax text"),
    (Format::LightToolsBinary, "LightTools binary"),
    (Format::LightToolsText, "LightTools text"),
    (Format::Speos, "Speos"),
    (Format::Asap, "ASAP distribution"),
    (Format::ProSourceText, "TracePro text"),
    (Format::Columns, "text columns"),
];

impl Format {
    /// Rows of text, so that columns can be declared.
    pub fn is_text(self) -> bool {
        use Format::{Columns, LightToolsText, ProSourceText, ZemaxText};
        matches!(self, ZemaxText | LightToolsText | ProSourceText | Columns)
    }

    /// The name people use.
    pub fn name(self) -> &'static str {
        NAMES.iter().find(|(format, _)| *format == self).map_or("", |(_, name)| name)
    }
}

impl From<Format> for &'static str {
    fn from(format: Format) -> &'static str {
        format.name()
    }
}

impl TryFrom<String> for Format {
    type Error = String;

    fn try_from(name: String) -> Result<Format, String> {
        let known = NAMES.iter().find(|(_, known)| *known == name);
        known.map(|(format, _)| *format).ok_or_else(|| format!("unknown format {name:?}"))
    }
}

/// Opens a file; what was declared of the columns counts where it is text in free columns.
pub type Open = fn(Arc<dyn Bytes>, Option<&[Column]>, &Limits) -> Result<RaySet, Error>;

/// One row of the table of formats: how a file is known to be of the format, and what reads it.
pub struct Reader {
    /// The format.
    pub format: Format,
    /// What tells it from others.
    pub sign: Sign,
    /// Opens a file; a text file in free columns is read as the columns that are declared of it.
    pub open: Open,
    /// Judges a file by its first bytes, `length` being its full length where that is known.
    pub peek: fn(&dyn Bytes, Option<u64>, &Limits) -> Result<(), Error>,
}

/// What tells a format from others. The signs are tried in this order, those of one kind in the order of the table.
pub enum Sign {
    /// Its first bytes, which no other file begins with.
    Magic(fn(&[u8]) -> bool),
    /// Its first number, once files that have magic are excluded.
    Marker(fn(&[u8]) -> bool),
    /// Words of a text, in lower case.
    Words(fn(&str) -> bool),
    /// The lines of a text without control characters, blank ones left out; the last may be cut.
    Lines(fn(&[&[u8]]) -> bool),
    /// The layout of a binary file that has no magic; with its length, where that is known.
    Layout(fn(&[u8], Option<u64>) -> bool),
}

/// Code of the notice for a spectrum that the file has and that cannot be meant; it has to be declared in its place.
pub const SPECTRUM_UNREADABLE: &str = "rays.spectrum_unreadable";
/// Code of the notice for a total that the file has and that cannot be read, where its rays are relative to it.
pub const TOTAL_UNREADABLE: &str = "rays.total_unreadable";
/// How the header of rays that were drawn from a model says so.
pub const DRAWN: &str = "New rays drawn from a model";
/// How the header of rays that were drawn by a sequence says so.
pub const LOW_DISCREPANCY: &str = "of low discrepancy";
/// Code of the notice for a length unit that is what a program writes where nobody chose one.
pub const DEFAULT_UNIT: &str = "rays.default_unit";
/// Code of the notice for rays without flux, which have equal shares of a declared one.
pub const EQUAL_SHARES: &str = "rays.equal_shares";
/// Sentence of [`EQUAL_SHARES`].
pub const EQUAL_SHARES_MESSAGE: &str =
    "No column holds flux, as declared: every ray has an equal share of the declared flux.";

/// Which total is right (`pipeline/formats/README.md` 7).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TotalRule {
    /// The header's; ray values are relative.
    Header,
    /// The sum of the rays.
    RaySum,
}

/// Which spectral information the rays of a file carry.
#[derive(Clone, Debug, PartialEq)]
pub enum SpectralData {
    /// None.
    None,
    /// One spectrum for all rays: a table, or one wavelength (a table of one point).
    Table(Table),
    /// A wavelength per ray.
    Wavelength,
    /// A table index per ray, [`RawRay::table`] counting from 0.
    Tables(Vec<Table>),
    /// Tristimulus X, Y (= luminous flux), Z per ray.
    Tristimulus,
}

impl SpectralData {
    /// The word for one table that holds for all rays.
    pub const ONE_TABLE: &str = "table";

    /// What it is, in words.
    pub fn name(&self) -> &'static str {
        match self {
            SpectralData::None => "none",
            SpectralData::Table(_) => SpectralData::ONE_TABLE,
            SpectralData::Wavelength => "wavelength per ray",
            SpectralData::Tables(_) => "table per ray",
            SpectralData::Tristimulus => "tristimulus",
        }
    }

    /// The tables, where the spectrum comes in tables.
    pub fn tables(&self) -> &[Table] {
        match self {
            SpectralData::Table(table) => std::slice::from_ref(table),
            SpectralData::Tables(tables) => tables,
            SpectralData::None | SpectralData::Wavelength | SpectralData::Tristimulus => &[],
        }
    }
}

/// What a file says of itself.
#[derive(Clone, Debug)]
pub struct Facts {
    /// The format it is.
    pub format: Format,
    /// Rays in the file, proven by its size.
    pub ray_count: u64,
    /// Totals in the header, where it has any.
    pub header_flux: Flux,
    /// Which total is right.
    pub total_rule: TotalRule,
    /// Rays carry radiant flux.
    pub has_radiant: bool,
    /// Rays carry luminous flux.
    pub has_luminous: bool,
    /// What they carry of the spectrum.
    pub spectral: SpectralData,
    /// Length unit of the file; `None` where it does not say and none was declared: it is then read as if in mm.
    pub length_unit: Option<LengthUnit>,
    /// The file does not say whether its flux is W or lm, and nothing was declared: values stand in [`RawRay::radiant`].
    pub quantity_unknown: bool,
    /// Everything else worth telling, `(name, value)` in the file's order: texts, dates, versions, codes.
    pub texts: Vec<(String, String)>,
    /// What was odd about the header and yet read.
    pub notices: Notices,
}

/// One record as the file has it: converted to mm, nm and f64, not checked, not scaled. Absent values are 0.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RawRay {
    /// Start, mm.
    pub origin_mm: [f64; 3],
    /// Direction, as stored.
    pub direction: [f64; 3],
    /// Radiant flux as stored: W, or relative.
    pub radiant: f64,
    /// Luminous flux (tristimulus Y) as stored: lm, or relative.
    pub luminous: f64,
    /// Wavelength, nm.
    pub wavelength_nm: f64,
    /// Index of the spectral table, from 0; `u32::MAX` where the file's is out of range.
    pub table: u32,
    /// Tristimulus X and Z as stored, in the unit of `luminous`.
    pub xz: [f64; 2],
}

/// Random access to the records of one file.
pub trait Records: Send + Sync {
    /// Appends records `first..first + count` to `rays`. The range lies within [`Facts::ray_count`].
    ///
    /// # Errors
    /// [`Error::Unreadable`] from the medium; [`Error::Malformed`] where a record has no meaning at all.
    fn read(&self, first: u64, count: usize, rays: &mut Vec<RawRay>) -> Result<(), Error>;
}

/// One ray file, opened: header decoded, count proven, records at hand.
pub struct RaySet {
    /// What the file says of itself.
    pub facts: Facts,
    /// Its records.
    pub records: Box<dyn Records>,
}

#[cfg(test)]
impl RaySet {
    /// What the file says, and all of its rays, for tests of readers.
    pub fn read_all(self) -> Result<(Facts, Vec<RawRay>), Error> {
        let mut rays = Vec::new();
        self.records.read(0, self.facts.ray_count as usize, &mut rays)?;
        Ok((self.facts, rays))
    }
}

/// Rays per chunk of a pass.
pub const CHUNK_RAYS: usize = 1 << 14;
