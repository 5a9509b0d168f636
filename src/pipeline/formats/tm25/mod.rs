//! IES TM-25-13 ray files, one file per block of the standard. Layout and its sources: `pipeline/formats/README.md` 1 and, in short:
//!
//! | offset | block | file |
//! |---|---|---|
//! | 0 | header, known-data flags, nine texts: 36 288 bytes | `header.rs` |
//! | 36 288 | spectral tables, zero padded to 32 bytes once after the last | `spectra.rs` |
//! | then | additional column names, 512 bytes each; additional text | `additional.rs` |
//! | then | ray records: rows of f32 | `records.rs` |
//!
//! Little-endian; text is UTF-32LE. Sections in brackets are the standard's (4.7.1.2 and so on).

/// The header block, the known-data flags and the nine texts.
pub mod header;
/// Spectral tables.
pub mod spectra;
/// Additional columns and text.
pub mod additional;
/// The ray records.
pub mod records;
/// Writing, as a stream.
pub mod writer;
#[cfg(test)]
mod tests;

use super::bytes::Cursor;
use super::record::{Bytes, Facts, Format, RaySet, SPECTRUM_UNREADABLE, SpectralData, TotalRule};
use crate::error::Error;
use crate::vocabulary::limits::Limits;
use crate::vocabulary::notice::Notices;
use crate::vocabulary::units::{Flux, LengthUnit};
use additional::Additional;
use header::{Header, SpectralId};
use header::{PREAMBLE, VERSION};
use records::{Layout, Tm25Records};
use spectra::Spectra;
use std::sync::Arc;

/// Everything before the rays.
#[derive(Clone, Debug, PartialEq)]
pub struct Preamble {
    /// Header, flags, texts.
    pub header: Header,
    /// Spectral tables.
    pub spectra: Spectra,
    /// Additional columns and text.
    pub additional: Additional,
}

impl Preamble {
    /// A preamble to be written: the header's counts of tables, columns and text are those of what follows it.
    pub fn new(header: Header, spectra: Spectra, additional: Additional) -> Preamble {
        let header = Header {
            table_count: spectra.points.len() as u32,
            additional_columns: additional.columns.len() as u32,
            text_bytes: additional.text_bytes(),
            ..header
        };
        Preamble { header, spectra, additional }
    }
}

/// Opens a file of this format.
///
/// # Errors
/// As [`super::open`].
pub fn open(bytes: Arc<dyn Bytes>, limits: &Limits) -> Result<RaySet, Error> {
    let mut notices = Notices::default();
    let (preamble, layout) = read_preamble(bytes.as_ref(), limits, &mut notices)?;
    let indexed = preamble.header.spectral_id == SpectralId::IndexPerRay;
    let tables = if indexed { preamble.spectra.points.len() as u32 } else { 0 };
    let facts = facts(preamble, &layout, notices);
    Ok(RaySet { facts, records: Box::new(Tm25Records::new(bytes, layout, tables)) })
}

/// Judges the header from the first bytes of a file that is `length` bytes long, if that is known.
///
/// # Errors
/// As [`open`]; [`Error::Unreadable`] (end of file) when `bytes` holds too little to tell.
pub fn peek(bytes: &dyn Bytes, length: Option<u64>, limits: &Limits) -> Result<(), Error> {
    let header = Header::read(bytes, &mut Notices::default())?;
    header.check_limits(limits)?;
    length.map_or(Ok(()), |length| header.check_least_length(length))
}

/// Header, tables and additional items, and the record layout that the length of the file proves.
///
/// # Errors
/// [`Error::Malformed`], [`Error::Refused`], [`Error::Unreadable`].
pub fn read_preamble(bytes: &dyn Bytes, limits: &Limits, notices: &mut Notices) -> Result<(Preamble, Layout), Error> {
    let header = Header::read(bytes, notices)?;
    header.check_least_length(bytes.len())?;
    header.check_limits(limits)?;
    let mut cursor = Cursor::new(bytes, PREAMBLE);
    let spectra = Spectra::read(&mut cursor, header.table_count, limits, notices)?;
    let layout = Layout::prove(&header, cursor.at(), bytes, notices)?;
    let mut cursor = Cursor::new(bytes, layout.additional_start());
    let additional = Additional::read(&mut cursor, header.additional_columns, header.text_bytes, notices)?;
    if header.version != VERSION {
        let told =
            format!("The file has version {}; it was read as 2013, which its length agrees with.", header.version);
        notices.add("tm25.version", told);
    }
    Ok((Preamble { header, spectra, additional }, layout))
}

fn facts(preamble: Preamble, layout: &Layout, mut notices: Notices) -> Facts {
    let Preamble { header, spectra, additional } = preamble;
    let spectral = spectral_data(&header, &spectra, &mut notices).unwrap_or_else(|found| {
        notices.add(SPECTRUM_UNREADABLE, found);
        SpectralData::None
    });
    if layout.has_stokes() {
        let told = "The rays are polarised; polarisation is not modelled and was left out.";
        notices.add("tm25.stokes_ignored", told);
    }
    let mut texts = header.told();
    texts.extend(additional.told());
    Facts {
        format: Format::Tm25,
        ray_count: header.ray_count,
        header_flux: Flux { radiant_w: header.radiant_w, luminous_lm: header.luminous_lm },
        total_rule: TotalRule::Header,
        has_radiant: header.flags.radiant,
        has_luminous: header.flags.luminous,
        spectral,
        length_unit: Some(LengthUnit::Millimetre),
        quantity_unknown: false,
        texts,
        notices,
    }
}

/// What the rays carry of the spectrum. A wavelength per ray wins over a table (seen with identifier 3).
///
/// # Errors
/// A sentence on a spectrum that cannot be meant: it can be declared, so it is not fatal.
fn spectral_data(header: &Header, spectra: &Spectra, notices: &mut Notices) -> Result<SpectralData, String> {
    if header.flags.wavelength {
        if header.spectral_id != SpectralId::PerRay {
            let told =
                "Rays have wavelengths although the spectral identifier says otherwise; the wavelengths were used.";
            notices.add("tm25.wavelength_column", told);
        }
        return Ok(SpectralData::Wavelength);
    }
    let table_count = spectra.points.len();
    let used = match header.spectral_id {
        SpectralId::IndexPerRay => table_count,
        SpectralId::OneTable => table_count.min(1),
        SpectralId::None | SpectralId::One | SpectralId::PerRay | SpectralId::Unknown => 0,
    };
    if table_count > used {
        let told =
            "The file holds spectral tables that its spectral identifier gives no meaning to; they were left out.";
        notices.count("tm25.unused_tables", (table_count - used) as u64, None, told);
    }
    let tables = spectra.tables(used, notices)?;
    match header.spectral_id {
        SpectralId::Unknown => Err("The spectral identifier does not exist; only 0 to 4 do.".to_owned()),
        SpectralId::None if header.flags.tristimulus => Ok(SpectralData::Tristimulus),
        SpectralId::None => Ok(SpectralData::None),
        SpectralId::PerRay => Err("A wavelength per ray is announced, and the rays have none.".to_owned()),
        SpectralId::One => header.single_wavelength(notices),
        SpectralId::OneTable | SpectralId::IndexPerRay if tables.is_empty() => {
            Err("Spectral tables are announced, and there are none.".to_owned())
        }
        SpectralId::OneTable => Ok(tables.into_iter().next().map_or(SpectralData::None, SpectralData::Table)),
        SpectralId::IndexPerRay if !header.flags.index => {
            Err("A table index per ray is announced, and the rays have none.".to_owned())
        }
        SpectralId::IndexPerRay => Ok(SpectralData::Tables(tables)),
    }
}
