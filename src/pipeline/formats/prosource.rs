//! TracePro / ProSource text ray files (`pipeline/formats/README.md` 6): lines of words, among them a count and a length factor, then seven
//! columns. The file does not say whether its flux is W or lm; its total is the sum of the rays.

use super::record::{Bytes, DEFAULT_UNIT, Facts, Format, RaySet, TotalRule};
use super::text::column_rules::{tell_equal_shares, under_header};
use super::text::lines::{Lines, Separator, leading_numbers};
use super::text::rows::{Grammar, LINE_OF_LIGHT, Rows, Slot, ray_columns, separator, spectral};
use crate::error::Error;
use crate::vocabulary::declaration::Column;
use crate::vocabulary::limits::Limits;
use crate::vocabulary::notice::Notices;
use crate::vocabulary::units::{Flux, LengthUnit};
use std::sync::Arc;

/// Words before the number of rays in the file, in lower case.
const GENERATED: &str = "nbrrays generated:";
/// Words before the number of file units in a metre, in lower case.
const PER_METRE: &str = "conversion factor from meters";
/// What is told of a factor of 1.
const IN_METRES: &str = "The header says that lengths are in m, by a conversion factor of 1. Programs leave this factor at 1 whatever \
    the unit is: the file may be in mm. Compare the size with the data sheet, and declare length_unit as m or as mm.";
/// Factors that differ from a unit's by less are that unit, written with few digits.
const UNIT_TOLERANCE: f64 = 1e-4;

/// Opens a file of this format, its columns as declared where they are.
///
/// # Errors
/// As [`super::open`].
pub fn open(bytes: Arc<dyn Bytes>, columns: Option<&[Column]>, limits: &Limits) -> Result<RaySet, Error> {
    let header = Header::read(bytes.as_ref(), limits.max_text_bytes)?;
    let mut notices = header.told;
    let (columns, luminous) = match columns {
        Some(columns) => under_header(columns, None)?,
        None => (ray_columns(&[Column::RadiantFlux]), None),
    };
    tell_equal_shares(&columns, &mut notices);
    let slots = Slot::of(&columns, header.length_unit.map_or(1.0, LengthUnit::mm));
    let separator = separator(bytes.as_ref(), header.rows_at, LINE_OF_LIGHT.len())?;
    let grammar = Grammar::new(separator, slots, None);
    let mut rows = Rows::index(bytes, header.rows_at, grammar, limits, &mut notices)?;
    if let Some(announced) = header.ray_count {
        rows.hold_to(announced, &mut notices)?;
    }
    let facts = Facts {
        format: Format::ProSourceText,
        ray_count: rows.count(),
        header_flux: Flux::default(),
        total_rule: TotalRule::RaySum,
        has_radiant: luminous != Some(true),
        has_luminous: luminous == Some(true),
        spectral: spectral(&columns),
        length_unit: header.length_unit,
        quantity_unknown: luminous.is_none(),
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
    /// What is odd about them.
    told: Notices,
    /// Offset of the first row.
    rows_at: u64,
}

impl Header {
    fn read(bytes: &dyn Bytes, max_bytes: usize) -> Result<Header, Error> {
        let told = Notices::default();
        let mut header = Header { texts: Vec::new(), ray_count: None, length_unit: None, told, rows_at: 0 };
        let mut lines = Lines::of(bytes);
        while let Some(line) = lines.read_next()? {
            if leading_numbers(line.text) > 0 {
                header.rows_at = line.at;
                return Ok(header);
            }
            if line.at > max_bytes as u64 {
                break;
            }
            header.take(line.to_text().trim_start_matches(['!', '#', ' ']));
        }
        let found = "No row of numbers follows the header: there are no rays.";
        Err(Error::malformed("prosource.no_data", found, "Fetch or export the file again.").at_byte(lines.at()))
    }

    fn take(&mut self, text: &str) {
        self.texts.push(("header".to_owned(), text.to_owned()));
        let lower = text.to_ascii_lowercase();
        if let Some(count) = number_after(&lower, GENERATED) {
            self.ray_count = count.parse().ok();
            if self.ray_count.is_none() {
                self.told.add("prosource.count", format!("The number of rays is \"{count}\", which is no number."));
            }
        }
        let Some(stored) = number_after(&lower, PER_METRE) else { return };
        let factor = Separator::Blank.number(stored.as_bytes()).unwrap_or(f64::NAN);
        let near = |unit: &LengthUnit| (factor * unit.mm() / LengthUnit::Metre.mm() - 1.0).abs() < UNIT_TOLERANCE;
        self.length_unit = LengthUnit::ALL.into_iter().find(near);
        match self.length_unit {
            None => {
                let told = format!(
                    "A metre is \"{stored}\" of the file's length units; no unit we know has this length, so it is not said."
                );
                self.told.add("prosource.unit", told);
            }
            Some(LengthUnit::Metre) => self.told.add(DEFAULT_UNIT, IN_METRES),
            Some(_) => {}
        }
    }
}

/// The word after `key`, whole: a comma inside of it is part of it.
fn number_after<'a>(text: &'a str, key: &str) -> Option<&'a str> {
    let (_, rest) = text.split_once(key)?;
    rest.split([' ', '\t', ':']).map(|word| word.trim_end_matches(',')).find(|word| !word.is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::record::RawRay;

    /// The layout of `pipeline/formats/README.md` 6.
    fn file(generated: &str, factor: &str) -> String {
        format!(
            "!! Source file: led.dat\n# NbrRays Requested: 9,  NbrRays Generated: {generated}\n\
             Angular Range PolarBeg: 0.0, PolarEnd: 90.0, AzimuthBeg: 0.0, AzimuthEnd: 360.0\nRotation AboutX 0.0 AboutY 0.0\n\
             Translation X 0.0 Y 0.0 Z 0.0\nScale X 1.0 Y 1.0 Z 1.0\n{factor}\
             X Pos    Y Pos    Z Pos    X Vec    Y Vec    Z Vec    Inc Flux\n\
             1.000000E+000 2.000000E+000 5.000000E-001 0.000000E+000 0.000000E+000 1.000000E+000 2.500000E-001\n"
        )
    }

    fn opened(text: &str) -> Result<(Facts, Vec<RawRay>), Error> {
        open(Arc::new(text.as_bytes().to_vec()), None, &Limits::default())?.read_all()
    }

    #[test]
    fn the_factor_is_the_unit_and_the_flux_is_not_said() {
        for (factor, mm, unit) in [
            ("1.000000E+000", 1000.0, LengthUnit::Metre),
            ("1000.0", 1.0, LengthUnit::Millimetre),
            ("39.37008", 25.4, LengthUnit::Inch),
        ] {
            let (facts, rays) = opened(&file("1", &format!("Conversion Factor From Meters {factor}\n"))).unwrap();
            assert_eq!(facts.length_unit, Some(unit));
            assert_eq!(rays[0].origin_mm, [mm, 2.0 * mm, 0.5 * mm]);
            assert_eq!((rays[0].direction, rays[0].radiant), ([0.0, 0.0, 1.0], 0.25));
            assert!(facts.quantity_unknown && facts.total_rule == TotalRule::RaySum);
            assert_eq!(facts.notices.count_of(DEFAULT_UNIT), u64::from(unit == LengthUnit::Metre));
            assert_eq!(facts.texts.len(), 8);
        }
        assert_eq!(opened(&file("1", "")).unwrap().0.length_unit, None);
    }

    #[test]
    fn counts_and_factors_that_cannot_be() {
        let cases = [(file("2", ""), "text.row_count"), ("# NbrRays Requested: 1\n".to_owned(), "prosource.no_data")];
        for (text, code) in cases {
            assert_eq!(opened(&text).unwrap_err().code(), code);
        }
        for factor in ["7.0", "none", "1,000"] {
            let (facts, _) = opened(&file("1", &format!("Conversion Factor From Meters {factor}\n"))).unwrap();
            assert_eq!((facts.length_unit, facts.notices.count_of("prosource.unit")), (None, 1));
        }
        assert_eq!(opened(&file("1,000", "")).unwrap().0.notices.count_of("prosource.count"), 1);
        assert_eq!(opened(&file("0", "")).unwrap().0.notices.count_of("text.more_rows"), 1);
    }
}
