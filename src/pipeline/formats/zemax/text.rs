//! Zemax / OpticStudio text ray files (`pipeline/formats/README.md` 2): a line with count, unit and perhaps format and flux type, then rows.
//!
//! As in the binary file the total is the sum of the rays.

use super::binary;
use crate::error::Error;
use crate::formats::record::{Bytes, Facts, Format, RaySet, TotalRule};
use crate::formats::text::lines::{Lines, Separator};
use crate::formats::text::rows::{Grammar, Rows, Slot, ray_columns, spectral};
use crate::vocabulary::declaration::Column;
use crate::vocabulary::limits::Limits;
use crate::vocabulary::notice::Notices;
use crate::vocabulary::units::{Flux, LengthUnit};
use std::sync::Arc;

/// Opens a file of this format.
///
/// # Errors
/// As [`crate::formats::open`].
pub fn open(bytes: Arc<dyn Bytes>, limits: &Limits) -> Result<RaySet, Error> {
    let header = Header::read(bytes.as_ref())?;
    let columns = header.columns();
    let grammar =
        Grammar { separator: Separator::Blank, slots: Slot::of(&columns, header.length_unit.mm()), end: None };
    let mut notices = Notices::default();
    let mut rows = Rows::index(bytes, header.rows_at, grammar, limits, &mut notices)?;
    rows.hold_to(header.ray_count, &mut notices)?;
    Ok(RaySet { facts: header.facts(&columns, notices), records: Box::new(rows) })
}

/// Judges the header from the first bytes of a file that is `length` bytes long, if that is known.
///
/// # Errors
/// As [`open`]; [`Error::Unreadable`] (end of file) when `bytes` holds too little to tell.
pub fn peek(bytes: &dyn Bytes, _length: Option<u64>) -> Result<(), Error> {
    Header::read(bytes).map(|_| ())
}

/// Whether these two lines are a header and the first row: whole numbers for count and unit, for format and flux type if there
/// are more, and zeros up to the width of the row. No ray looks so: it would have no flux.
pub fn starts(first: &[u8], second: Option<&[u8]>) -> bool {
    let Some(head) = whole_numbers(first) else { return false };
    let row = second.map(crate::formats::text::lines::leading_numbers);
    let tail = head.get(4..).unwrap_or_default();
    match head.len() {
        2 | 4 => row.is_none_or(|row| matches!(row, 7 | 8)),
        7 | 8 => {
            let unit = head.get(1).is_some_and(|unit| binary::length_unit(*unit).is_ok());
            unit && head.iter().take(1).all(|count| *count > 0) && tail.iter().all(|number| *number == 0)
        }
        _ => false,
    }
}

/// The numbers of a line, all of them whole.
fn whole_numbers(line: &[u8]) -> Option<Vec<i32>> {
    let whole = |field: &[u8]| {
        let number = Separator::Blank.number(field)?;
        (number.fract() == 0.0 && number.abs() <= f64::from(i32::MAX)).then_some(number as i32)
    };
    Separator::Blank.fields(line).map(|(_, field)| whole(field)).collect()
}

/// The first line.
struct Header {
    ray_count: u64,
    length_unit: LengthUnit,
    /// Rows hold a wavelength.
    spectral: bool,
    /// Flux is in lm; `None` where the header ends before it says so.
    luminous: Option<bool>,
    /// The line as it stands.
    line: String,
    /// Offset of the rows.
    rows_at: u64,
}

impl Header {
    fn read(bytes: &dyn Bytes) -> Result<Header, Error> {
        let mut lines = Lines::of(bytes);
        let (at, line, head) = match lines.read_next()? {
            Some(line) => (line.at, line.to_text(), whole_numbers(line.text)),
            None => (0, String::new(), None),
        };
        let wrong = |code, found: String| Error::malformed(code, found, "Export the file again.").at_byte(at);
        let rows_at = lines.at();
        let second = lines.read_next()?.map_or(0, |row| crate::formats::text::lines::leading_numbers(row.text));
        let head = head.unwrap_or_default();
        let (Some(count), Some(unit)) = (head.first().and_then(|n| u64::try_from(*n).ok()), head.get(1)) else {
            return Err(wrong("zemax_text.header", format!("The header \"{line}\" has no count and unit.")));
        };
        let length_unit = binary::length_unit(*unit).map_err(|error| error.at_byte(at))?;
        let format = head.get(2).copied();
        // A header of two numbers, or one filled up with zeros to the width of the rows, leaves the format to the rows.
        let spectral = match format {
            Some(0) | None => second == 8 && head.len() != 4,
            Some(2) => true,
            Some(format) => {
                let found = format!("The ray format is {format}; only 0 (flux) and 2 (spectral) exist.");
                return Err(wrong("zemax.ray_format", found));
            }
        };
        let luminous = match head.get(3) {
            _ if spectral => Some(false),
            None => None,
            Some(0) => Some(false),
            Some(1) => Some(true),
            Some(kind) => {
                return Err(wrong("zemax.flux_type", format!("The flux type is {kind}; only 0 (W) and 1 (lm) exist.")));
            }
        };
        Ok(Header { ray_count: count, length_unit, spectral, luminous, line, rows_at })
    }

    fn columns(&self) -> Vec<Column> {
        let flux = if self.luminous == Some(true) { Column::LuminousFlux } else { Column::RadiantFlux };
        if self.spectral { ray_columns(&[flux, Column::WavelengthUm]) } else { ray_columns(&[flux]) }
    }

    fn facts(self, columns: &[Column], notices: Notices) -> Facts {
        let luminous = self.luminous == Some(true);
        Facts {
            format: Format::ZemaxText,
            ray_count: self.ray_count,
            header_flux: Flux::default(),
            total_rule: TotalRule::RaySum,
            has_radiant: !luminous,
            has_luminous: luminous,
            spectral: spectral(columns),
            length_unit: Some(self.length_unit),
            quantity_unknown: self.luminous.is_none(),
            texts: vec![("header".to_owned(), self.line)],
            notices,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::record::{RawRay, SpectralData};

    fn opened(text: &str) -> Result<(Facts, Vec<RawRay>), Error> {
        let set = open(Arc::new(text.as_bytes().to_vec()), &Limits::default())?;
        let mut rays = Vec::new();
        set.records.read(0, set.facts.ray_count as usize, &mut rays)?;
        Ok((set.facts, rays))
    }

    const ROW: &str = "1 2 0.5 0 0 1 0.25\n";
    const COLORED: &str = "1 2 0.5 0 0 1 0.25 0.45\n";

    #[test]
    fn headers_of_every_width() {
        // Header, row, lm, spectral, quantity unknown.
        let cases = [
            ("1 4\n", ROW, false, false, true),
            ("1 4\n", COLORED, false, true, false),
            ("1 4 0 0\n", ROW, false, false, false),
            ("1 4 0 1\n", ROW, true, false, false),
            ("1 4 2 0\n", COLORED, false, true, false),
            ("1.000000\t4.000000\t0.000000\t0.000000\t0.000000\t0.000000\t0.000000\n", ROW, false, false, false),
            ("1.0 4.0 0.0 0.0 0.0 0.0 0.0 0.0\n", COLORED, false, true, false),
            ("1 4 2 0 0 0 0 0\n", COLORED, false, true, false),
            ("1 4 0 1 0 0 0\n", ROW, true, false, false),
        ];
        for (header, row, luminous, colored, unknown) in cases {
            assert!(starts(header.as_bytes(), Some(row.as_bytes())), "{header}");
            let (facts, rays) = opened(&[header, row].concat()).unwrap();
            assert_eq!((facts.has_luminous, facts.has_radiant), (luminous, !luminous), "{header}");
            assert_eq!(facts.quantity_unknown, unknown, "{header}");
            assert_eq!(facts.spectral, if colored { SpectralData::Wavelength } else { SpectralData::None });
            assert_eq!(facts.total_rule, TotalRule::RaySum);
            assert_eq!([rays[0].luminous, rays[0].radiant], if luminous { [0.25, 0.0] } else { [0.0, 0.25] });
            assert_eq!(rays[0].wavelength_nm, if colored { 450.0 } else { 0.0 });
            assert_eq!(facts.notices, Notices::default());
        }
    }

    #[test]
    fn units() {
        for (unit, mm) in [(0, 1000.0), (1, 25.4), (2, 10.0), (3, 304.8), (4, 1.0)] {
            let (_, rays) = opened(&format!("1 {unit} 0 0\n{ROW}")).unwrap();
            assert_eq!(rays[0].origin_mm, [mm, 2.0 * mm, 0.5 * mm]);
        }
    }

    #[test]
    fn wrong_headers_and_rows() {
        let cases = [
            ("1 5 0 0\n", ROW, "zemax.unit"),
            ("1 4 1 0\n", ROW, "zemax.ray_format"),
            ("1 4 0 2\n", ROW, "zemax.flux_type"),
            ("-1 4 0 0\n", ROW, "zemax_text.header"),
            ("2 4 0 0\n", ROW, "text.row_count"),
            ("1 4 2 0\n", ROW, "text.columns"),
            ("1 4 0 0\n", COLORED, "text.columns"),
        ];
        for (header, row, code) in cases {
            assert_eq!(opened(&[header, row].concat()).unwrap_err().code(), code, "{header}");
        }
    }

    #[test]
    fn a_ray_is_no_header() {
        for line in ["1 2 0 0 0 1 1", "1 2 0 0 0 0 1", "1 2 0.5 0 0 1 0.25", "x y", "1", "1 2 3", "0 4 0 0 0 0 0"] {
            assert!(!starts(line.as_bytes(), Some(ROW.as_bytes())), "{line}");
        }
        assert!(!starts(b"380 0", Some(b"390 0.1")));
    }
}
