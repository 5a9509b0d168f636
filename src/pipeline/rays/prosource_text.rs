//! TracePro / ProSource text ray files (`FORMATS.md` 6): lines of words, among them a count and a length factor, then seven
//! columns. The file does not say whether its flux is W or lm; its total is the sum of the rays.

use super::super::Error;
use super::super::vocabulary::limits::Limits;
use super::super::vocabulary::notice::Notices;
use super::super::vocabulary::units::{Flux, LengthUnit};
use super::declared::Column;
use super::lines::{Lines, Separator, leading_numbers};
use super::rows::{Grammar, Rows, Slot, ray_columns};
use super::{Bytes, Facts, Format, RaySet, SpectralData, TotalRule};
use std::sync::Arc;

/// Words before the number of rays in the file, in lower case.
const GENERATED: &str = "nbrrays generated:";
/// Words before the number of file units in a metre, in lower case.
const PER_METRE: &str = "conversion factor from meters";
/// Factors that differ from a unit's by less are that unit, written with few digits.
const UNIT_TOLERANCE: f64 = 1e-4;

/// Opens a file of this format.
///
/// # Errors
/// As [`super::open`].
pub fn open(bytes: Arc<dyn Bytes>, limits: &Limits) -> Result<RaySet, Error> {
    let header = Header::read(bytes.as_ref(), limits.max_text_bytes)?;
    let mut notices = Notices::default();
    let columns = ray_columns(&[Column::Flux]);
    let slots = Slot::of(&columns, header.length_unit.map_or(1.0, LengthUnit::mm));
    let grammar = Grammar { separator: Separator::Blank, slots, end: None };
    let mut rows = Rows::index(bytes, header.rows_at, grammar, limits, &mut notices)?;
    if let Some(announced) = header.ray_count {
        rows.hold_to(announced, &mut notices)?;
    }
    let facts = Facts {
        format: Format::ProSourceText,
        ray_count: rows.count(),
        header_flux: Flux::default(),
        total_rule: TotalRule::RaySum,
        has_radiant: true,
        has_luminous: false,
        spectral: SpectralData::None,
        length_unit: header.length_unit,
        quantity_unknown: true,
        texts: header.texts,
        notices,
    };
    Ok(RaySet { facts, records: Box::new(rows) })
}

/// Judges the header from the first bytes of a file that is `length` bytes long, if that is known.
///
/// # Errors
/// As [`open`]; [`Error::Unreadable`] (end of file) when `bytes` holds too little to tell.
pub fn peek(bytes: &dyn Bytes, _length: Option<u64>) -> Result<(), Error> {
    Header::read(bytes, Limits::default().max_text_bytes).map(|_| ())
}

/// The lines before the rows.
struct Header {
    texts: Vec<(String, String)>,
    /// Rays in the file, where it says so.
    ray_count: Option<u64>,
    length_unit: Option<LengthUnit>,
    /// Offset of the first row.
    rows_at: u64,
}

impl Header {
    fn read(bytes: &dyn Bytes, max_bytes: usize) -> Result<Header, Error> {
        let mut header = Header { texts: Vec::new(), ray_count: None, length_unit: None, rows_at: 0 };
        let mut lines = Lines::of(bytes);
        while let Some(line) = lines.read_next()? {
            if leading_numbers(line.text) > 0 {
                header.rows_at = line.at;
                return Ok(header);
            }
            if line.at > max_bytes as u64 {
                break;
            }
            let (at, text) = (line.at, line.to_text());
            header.take(text.trim_start_matches(['!', '#', ' '])).map_err(|error| error.at_byte(at))?;
        }
        let found = "No row of numbers follows the header: there are no rays.";
        Err(Error::malformed("prosource.no_data", found, "Fetch or export the file again.").at_byte(lines.at()))
    }

    fn take(&mut self, text: &str) -> Result<(), Error> {
        self.texts.push(("header".to_owned(), text.to_owned()));
        let lower = text.to_ascii_lowercase();
        if let Some(count) = number_after(&lower, GENERATED) {
            self.ray_count = count.parse().ok();
        }
        if let Some(factor) = number_after(&lower, PER_METRE) {
            let factor = Separator::Blank.number(factor.as_bytes()).unwrap_or(f64::NAN);
            let near = |unit: &LengthUnit| (factor * unit.mm() / LengthUnit::Metre.mm() - 1.0).abs() < UNIT_TOLERANCE;
            let unit = LengthUnit::ALL.into_iter().find(near);
            self.length_unit = Some(unit.ok_or_else(|| {
                let found = format!("A metre is {factor} of the file's length units; no unit we know has this length.");
                Error::refused("prosource.unit", found, "Export the file in mm or m.")
            })?);
        }
        Ok(())
    }
}

/// The word after `key`.
fn number_after<'a>(text: &'a str, key: &str) -> Option<&'a str> {
    let (_, rest) = text.split_once(key)?;
    rest.split([' ', '\t', ',', ':']).find(|word| !word.is_empty())
}
