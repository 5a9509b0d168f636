//! The header block (4.7.1), the known-data flags (4.7.2) and the nine texts (4.7.3).

use super::additional::{COLUMN_NAME_BYTES, utf32};
use crate::error::Error;
use crate::formats::bytes::{Cursor, ascii, i32_in, u32_in};
use crate::formats::record::{Bytes, SpectralData};
use crate::vocabulary::limits::Limits;
use crate::vocabulary::notice::Notices;
use crate::vocabulary::spectrum::Table;
use crate::vocabulary::wavelength::WavelengthUnit;

/// Bytes of header and flags.
const BLOCK: u64 = 288;
/// Code points per text.
pub const TEXT_POINTS: usize = 1000;
/// What the nine texts are, in file order.
pub const TEXT_NAMES: [&str; 9] = [
    "source_name",
    "manufacturer",
    "model_creator",
    "file_creator",
    "equipment",
    "camera",
    "operation",
    "additional_information",
    "data_reference",
];
/// A NaN that a writer swapped byte by byte (Lumileds): 2.36e-38 as a number.
const SWAPPED_NAN: u32 = 0x0100_807F;

/// Spectral data identifier (4.7.1.9).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SpectralId {
    /// 0: none.
    #[default]
    None,
    /// 1: one wavelength for all rays.
    One,
    /// 2: a wavelength per ray.
    PerRay,
    /// 3: one table for all rays.
    OneTable,
    /// 4: a table index per ray.
    IndexPerRay,
    /// A number that does not exist.
    Unknown,
}

impl SpectralId {
    /// All that exist, in the order of their numbers.
    pub const ALL: [SpectralId; 5] =
        [SpectralId::None, SpectralId::One, SpectralId::PerRay, SpectralId::OneTable, SpectralId::IndexPerRay];
}

/// Which columns the records have (4.7.2); position and direction always.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Flags {
    /// Radiant flux, W.
    pub radiant: bool,
    /// Wavelength, nm.
    pub wavelength: bool,
    /// Luminous flux, lm: tristimulus Y.
    pub luminous: bool,
    /// Stokes parameters.
    pub stokes: bool,
    /// Tristimulus X and Z.
    pub tristimulus: bool,
    /// Index of a spectral table.
    pub index: bool,
}

impl Flags {
    /// Numbers per record before the additional ones, with `stokes` columns where there are any.
    pub fn columns(&self, stokes: u64) -> u64 {
        let flag = u64::from;
        6 + flag(self.radiant)
            + flag(self.wavelength)
            + flag(self.luminous)
            + stokes * flag(self.stokes)
            + 2 * flag(self.tristimulus)
            + flag(self.index)
    }
}

/// Header, flags and texts.
#[derive(Clone, Debug, PartialEq)]
pub struct Header {
    /// Version of the standard.
    pub version: i32,
    /// 0 simulation, 1 measurement.
    pub creation_method: i32,
    /// Total luminous flux, lm; `None` for every spelling of unknown.
    pub luminous_lm: Option<f64>,
    /// Total radiant flux, W; `None` for every spelling of unknown.
    pub radiant_w: Option<f64>,
    /// Rays announced.
    pub ray_count: u64,
    /// Creation date as written.
    pub date: String,
    /// Ray start position code.
    pub start_position: i32,
    /// Spectral data identifier.
    pub spectral_id: SpectralId,
    /// The one wavelength of identifier 1, nm.
    pub wavelength_nm: Option<f64>,
    /// Smallest and largest wavelength, nm.
    pub range_nm: [Option<f64>; 2],
    /// Spectral tables announced.
    pub table_count: u32,
    /// Additional columns announced.
    pub additional_columns: u32,
    /// Bytes of additional text announced.
    pub text_bytes: u32,
    /// Columns of the records.
    pub flags: Flags,
    /// The nine texts, in the order of [`TEXT_NAMES`].
    pub texts: [String; 9],
}

impl Default for Header {
    /// A simulation of no rays, with everything unknown.
    fn default() -> Header {
        Header {
            version: VERSION,
            creation_method: 0,
            luminous_lm: None,
            radiant_w: None,
            ray_count: 0,
            date: String::new(),
            start_position: 0,
            spectral_id: SpectralId::None,
            wavelength_nm: None,
            range_nm: [None; 2],
            table_count: 0,
            additional_columns: 0,
            text_bytes: 0,
            flags: Flags::default(),
            texts: Default::default(),
        }
    }
}

/// NaN by its bits (a signalling one must not pass through arithmetic), the swapped NaN, and what is not positive.
fn known(bits: u32) -> Option<f64> {
    let value = f32::from_bits(bits);
    (bits != SWAPPED_NAN && value.is_finite() && value > 0.0).then(|| f64::from(value))
}

impl Header {
    /// Reads and judges all of it, but for what the length of the file decides.
    ///
    /// # Errors
    /// [`Error::Malformed`] at the byte that cannot be meant.
    pub fn read(bytes: &dyn Bytes, notices: &mut Notices) -> Result<Header, Error> {
        let mut cursor = Cursor::new(bytes, 0);
        let block = cursor.block("the header", BLOCK)?;
        let count = |at: usize, what: &str| {
            u32::try_from(i32_in(&block, at)).map_err(|_| {
                let found = format!("The number of {what} is {}.", i32_in(&block, at));
                Error::malformed("tm25.negative_count", found, "Export the file again.").at_byte(at as u64)
            })
        };
        let mut header = Header {
            version: i32_in(&block, 4),
            creation_method: i32_in(&block, 8),
            luminous_lm: known(u32_in(&block, 12)),
            radiant_w: known(u32_in(&block, 16)),
            ray_count: u64::from(u32_in(&block, 20)) | u64::from(u32_in(&block, 24)) << 32,
            date: ascii(block.get(28..56).unwrap_or_default()),
            start_position: i32_in(&block, 56),
            spectral_id: spectral_id(i32_in(&block, 60)),
            wavelength_nm: known(u32_in(&block, 64)),
            range_nm: [known(u32_in(&block, 68)), known(u32_in(&block, 72))],
            table_count: count(76, "spectral tables")?,
            additional_columns: count(80, "additional columns")?,
            text_bytes: count(84, "bytes of additional text")?,
            flags: flags(&block, notices)?,
            texts: Default::default(),
        };
        header.check_flags()?;
        for (text, name) in header.texts.iter_mut().zip(TEXT_NAMES) {
            *text = utf32(&cursor.block(name, 4 * TEXT_POINTS as u64)?, notices);
        }
        Ok(header)
    }

    /// What flags and identifier say must agree (JM, LB and HT enforce the same).
    fn check_flags(&self) -> Result<(), Error> {
        let wrong = |code, at, found: &str| {
            Err(Error::malformed(code, found, "Export the file again; its header contradicts itself.").at_byte(at))
        };
        let flags = &self.flags;
        if !(flags.radiant || flags.luminous) {
            return wrong("tm25.no_flux", 264, "The rays have neither radiant nor luminous flux.");
        }
        if flags.tristimulus && !flags.luminous {
            return wrong("tm25.tristimulus", 280, "The rays have tristimulus X and Z but no Y.");
        }
        Ok(())
    }

    /// Refuses a count that the length of the file rules out, before anything is read or allocated for it.
    ///
    /// # Errors
    /// `tm25.size`, with both numbers.
    pub fn check_least_length(&self, length: u64) -> Result<(), Error> {
        let columns = self.flags.columns(3) + u64::from(self.additional_columns);
        let least = u128::from(PREAMBLE)
            + u128::from(self.additional_columns) * u128::from(COLUMN_NAME_BYTES)
            + u128::from(self.text_bytes)
            + u128::from(self.table_count) * 12
            + u128::from(self.ray_count) * u128::from(4 * columns);
        if least <= u128::from(length) {
            return Ok(());
        }
        let found = format!(
            "The header announces {} rays of {} bytes or more, which takes {least} bytes; the file has {length}.",
            self.ray_count,
            4 * columns
        );
        let remedy = "Fetch the file again; the copy is not complete, or the count is wrong.";
        Err(Error::malformed("tm25.size", found, remedy).at_byte(length.min(PREAMBLE)))
    }

    /// The caller's bounds.
    ///
    /// # Errors
    /// [`Error::Refused`].
    pub fn check_limits(&self, limits: &Limits) -> Result<(), Error> {
        let claims = [
            ("rays.too_many", "rays", self.ray_count, limits.max_rays, 20),
            ("tm25.too_many_tables", "spectral tables", self.table_count.into(), limits.max_tables as u64, 76),
            (
                "tm25.too_many_columns",
                "additional columns",
                self.additional_columns.into(),
                limits.max_additional_columns as u64,
                80,
            ),
            ("tm25.long_text", "bytes of text", self.text_bytes.into(), limits.max_text_bytes as u64, 84),
        ];
        for (code, what, claim, limit, at) in claims {
            if claim > limit {
                let found = format!("The file holds {claim} {what}; {limit} are allowed.");
                return Err(Error::refused(code, found, "Thin the file out, or raise the limit.").at_byte(at));
            }
        }
        Ok(())
    }

    /// Identifier 1 as a table of one line.
    ///
    /// # Errors
    /// A sentence, where there is no wavelength of light.
    pub fn single_wavelength(&self, notices: &mut Notices) -> Result<SpectralData, String> {
        let stored = self.wavelength_nm.ok_or("One wavelength is announced for all rays, and none is given.")?;
        let unit = WavelengthUnit::of([stored])
            .map_err(|stray| format!("One wavelength is announced for all rays, {stray} nm, which is no light."))?;
        if unit == WavelengthUnit::Micrometre {
            let told = "The one wavelength of all rays is in \u{b5}m by its size; it was read as such.";
            notices.add("tm25.table_micrometres", told);
        }
        Ok(Table::new(&[(stored * unit.nm(), 1.0)]).map_or(SpectralData::None, SpectralData::Table))
    }

    /// What a person wants to see of it.
    pub fn told(&self) -> Vec<(String, String)> {
        let numbers = [
            ("version", self.version.to_string()),
            ("creation_method", self.creation_method.to_string()),
            ("creation_date", self.date.clone()),
            ("start_position", self.start_position.to_string()),
        ];
        let texts = TEXT_NAMES.into_iter().zip(self.texts.iter().cloned());
        numbers.into_iter().chain(texts).map(|(name, value)| (name.to_owned(), value)).collect()
    }
}

fn spectral_id(stored: i32) -> SpectralId {
    usize::try_from(stored).ok().and_then(|k| SpectralId::ALL.get(k)).copied().unwrap_or(SpectralId::Unknown)
}

/// The eight known-data flags; any number but 0 is a yes.
fn flags(block: &[u8], notices: &mut Notices) -> Result<Flags, Error> {
    let stored: [i32; 8] = std::array::from_fn(|k| i32_in(block, 256 + 4 * k));
    if stored.iter().any(|flag| !matches!(flag, 0 | 1)) {
        notices.add("tm25.flags", "A known-data flag is neither 0 nor 1; it was taken as 1.");
    }
    let [position, direction, radiant, wavelength, luminous, stokes, tristimulus, index] = stored.map(|flag| flag != 0);
    if !(position && direction) {
        let found = "The file says that its rays have no position or no direction.";
        return Err(Error::malformed("tm25.no_rays", found, "Export the file again.").at_byte(256));
    }
    Ok(Flags { radiant, wavelength, luminous, stokes, tristimulus, index })
}

/// Where the spectral tables start (4.7.2 ends): header 256, flags 32, nine texts of 4000 bytes.
pub const PREAMBLE: u64 = 36_288;
/// Blocks of variable length are padded to multiples of this many bytes.
pub const ALIGNMENT: u64 = 32;
/// The version all public files have.
pub const VERSION: i32 = 2013;

#[cfg(test)]
mod tests {
    use super::known;

    /// `pipeline/formats/README.md` 1: the spellings of unknown seen in vendors' files.
    #[test]
    fn every_spelling_of_unknown() {
        for bits in [0x7F80_0001, 0x7FC0_0001, 0x0100_807F, 0, (-1.0_f32).to_bits(), f32::INFINITY.to_bits()] {
            assert_eq!(known(bits), None, "{bits:#x}");
        }
        assert_eq!(known(337.0_f32.to_bits()), Some(337.0));
    }
}
