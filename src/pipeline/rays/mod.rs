//! 1. Files to rays.

/// Files as vendors ship them: gzip, zstd, zip.
pub mod container;
/// Bounded reading: every failure knows its offset, no count is trusted.
pub mod bytes;
/// Which format a file is, from content alone.
pub mod detect;
/// What is no ray file, or none with a public layout.
mod foreign;
/// IES TM-25 ray files.
pub mod tm25;
/// Zemax / OpticStudio binary source files.
pub mod zemax;
/// Records of binary32 numbers, as most binary formats have them.
mod floats;
/// LightTools binary ray files.
mod lighttools;
/// Speos / OPTIS ray files.
mod speos;
/// ASAP .dis ray files.
mod asap;
/// Text: lines at random access, shared by every text format.
mod lines;
/// Rows of numbers at random access, shared by every text format.
mod rows;
/// LightTools text ray files.
mod lighttools_text;
/// Zemax text ray files.
mod zemax_text;
/// TracePro / ProSource text ray files.
mod prosource_text;
/// Rays in columns of numbers, named or not: CSV and the like.
mod columns;
/// What people call the columns of a ray.
mod column_names;
/// What a user says of a file, before the file's own word.
pub mod declared;
/// The spectrum of a channel from a file of its own.
pub mod spectrum_file;
/// What a ray must satisfy.
pub mod check;
/// From stored numbers to W and lm.
mod conversion;
/// Chunks in parallel, answers in order.
mod chunks;
/// One reading of everything: totals, box, directions, notices.
pub mod survey;
/// Whether totals can be meant.
mod totals;
/// Which spectral bands a source gets.
pub mod bands;
/// What several files must satisfy to be one source.
pub mod channels;
/// Several ray sets become one source; the only way to its rays.
pub mod source;
/// What can be said of a file before a model is made of it.
pub mod inspect;
/// Rays as rows of bytes, written as a stream.
pub mod row_writer;
/// Writing Zemax binary source files.
pub mod zemax_writer;
/// One ray file as another.
pub mod convert;
/// Known sources with closed-form answers.
pub mod synthetic;

pub use bytes::digest;
pub use declared::{Declared, Total};
pub use source::{Ray, Source};

use super::error::{Error, Place};
use super::vocabulary::limits::Limits;
use super::vocabulary::notice::{Notice, Notices};
use super::vocabulary::spectrum::Table;
use super::vocabulary::units::{Flux, LengthUnit};
use super::vocabulary::watch::StageWatch;
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

/// One ray file as handed in.
#[derive(Clone)]
pub struct Input {
    /// What the user calls it; goes into provenance, decides nothing.
    pub name: String,
    /// SHA-256 of the bytes, lower-case hex; goes into provenance.
    pub sha256: String,
    /// The bytes.
    pub bytes: Arc<dyn Bytes>,
    /// What the user says of them.
    pub declared: Declared,
    /// What was noticed of the file, or of what is declared of it, before it came here: repairs of its spectrum, files that
    /// were left out where it was unpacked.
    pub notices: Vec<Notice>,
}

impl Input {
    /// What its channel is called.
    pub fn channel_name(&self) -> &str {
        self.declared.name.as_deref().unwrap_or(&self.name)
    }
}

/// How rays are read.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Options {
    /// Edges of the spectral bands, nm, strictly increasing. Default: 380..780 in 10 nm, wider (at whole 10 nm) where the rays
    /// are.
    pub band_edges_nm: Option<Vec<f64>>,
    /// Total flux of the source, of which every channel declares its share. Default: the channels' own fluxes hold.
    pub total: Option<Total>,
}

impl Options {
    /// Whether the bands can be made and the total can be a flux.
    ///
    /// # Errors
    /// [`Error::Unusable`].
    pub fn validate(&self) -> Result<(), Error> {
        self.total.map_or(Ok(()), |total| total.validate(Place::Total))?;
        bands::asked(self).map(|_| ())
    }
}

/// File formats we read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Format {
    /// IES TM-25-13 / -20.
    #[serde(rename = "IES TM-25")]
    Tm25,
    /// Zemax / OpticStudio binary .dat/.sdf.
    #[serde(rename = "Zemax binary")]
    ZemaxBinary,
    /// Zemax / OpticStudio text.
    #[serde(rename = "Zemax text")]
    ZemaxText,
    /// LightTools binary .ray.
    #[serde(rename = "LightTools binary")]
    LightToolsBinary,
    /// LightTools text .ray.
    #[serde(rename = "LightTools text")]
    LightToolsText,
    /// Speos / OPTIS .ray.
    #[serde(rename = "Speos")]
    Speos,
    /// ASAP .dis.
    #[serde(rename = "ASAP distribution")]
    Asap,
    /// TracePro / ProSource text.
    #[serde(rename = "TracePro text")]
    ProSourceText,
    /// Columns of numbers: CSV and the like.
    #[serde(rename = "text columns")]
    Columns,
}

impl Format {
    /// The name people use.
    pub fn name(self) -> &'static str {
        match self {
            Format::Tm25 => "IES TM-25",
            Format::ZemaxBinary => "Zemax binary",
            Format::ZemaxText => "Zemax text",
            Format::LightToolsBinary => "LightTools binary",
            Format::LightToolsText => "LightTools text",
            Format::Speos => "Speos",
            Format::Asap => "ASAP distribution",
            Format::ProSourceText => "TracePro text",
            Format::Columns => "text columns",
        }
    }
}

/// Which total is right (`FORMATS.md` 7).
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
    /// What it is, in words.
    pub fn name(&self) -> &'static str {
        match self {
            SpectralData::None => "none",
            SpectralData::Table(_) => "table",
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

/// Opens one ray file: detects its format, decodes its header, proves its count, obeys what was declared of it. Reads no ray;
/// a text file is gone through once, because only that finds its rows.
///
/// # Errors
/// [`Error::Malformed`], [`Error::Refused`], [`Error::Unreadable`]; [`Error::Unusable`] for a declaration that cannot be right.
pub fn open(bytes: Arc<dyn Bytes>, declared: &Declared, limits: &Limits) -> Result<RaySet, Error> {
    let set = match detect::detect(bytes.as_ref())? {
        Format::Tm25 => tm25::open(bytes, limits),
        Format::ZemaxBinary => zemax::open(bytes, limits),
        Format::ZemaxText => zemax_text::open(bytes, limits),
        Format::LightToolsBinary => lighttools::open(bytes, limits),
        Format::LightToolsText => lighttools_text::open(bytes, limits),
        Format::Speos => speos::open(bytes, limits),
        Format::Asap => asap::open(bytes, limits),
        Format::ProSourceText => prosource_text::open(bytes, limits),
        Format::Columns => columns::open(bytes, declared.columns.as_deref(), limits),
    }?;
    declared::obey(set, declared)
}

/// Judges a file of a known format by its first bytes, `length` being its full length where that is known.
///
/// # Errors
/// As [`open`], as soon as the bytes at hand prove it; [`Error::Unreadable`] (end of file) when they hold too little to tell.
pub fn peek(format: Format, bytes: &dyn Bytes, length: Option<u64>, limits: &Limits) -> Result<(), Error> {
    match format {
        Format::Tm25 => tm25::peek(bytes, length, limits),
        Format::ZemaxBinary => zemax::peek(bytes, length),
        Format::ZemaxText => zemax_text::peek(bytes, length),
        Format::LightToolsBinary => lighttools::peek(bytes, length),
        Format::LightToolsText => lighttools_text::peek(bytes, length),
        Format::Speos => speos::peek(bytes, length),
        Format::Asap => asap::peek(bytes, length),
        Format::ProSourceText => prosource_text::peek(bytes, length),
        Format::Columns => columns::peek(bytes, length),
    }
}

/// Opens the ray sets of one source and surveys every ray once.
///
/// # Errors
/// As [`open`]; [`Error::Refused`] when no usable ray is left or too many had to be refused; [`Error::Cancelled`].
pub fn read(inputs: &[Input], options: &Options, limits: &Limits, watch: StageWatch<'_>) -> Result<Source, Error> {
    Source::read(inputs, options, limits, watch)
}
