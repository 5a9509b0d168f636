//! Zemax / OpticStudio text ray files (`pipeline/formats/README.md` 2): a line with count, unit and perhaps format and flux type, then rows.
//!
//! As in the binary file the total is the sum of the rays. What the first line says of its rows loses to declared columns.

use super::binary;
use crate::error::Error;
use crate::formats::record::{Bytes, Facts, Format, RaySet, TotalRule};
use crate::formats::text::column_rules::{tell_equal_shares, under_header};
use crate::formats::text::lines::{Lines, Separator, leading_numbers};
use crate::formats::text::rows::{Grammar, LINE_OF_LIGHT, Rows, Slot, ray_columns, separator, spectral};
use crate::vocabulary::declaration::Column;
use crate::vocabulary::limits::Limits;
use crate::vocabulary::notice::Notices;
use crate::vocabulary::units::{Flux, LengthUnit};
use std::sync::Arc;

/// Opens a file of this format, its columns as declared where they are.
///
/// # Errors
/// As [`crate::formats::open`].
pub fn open(bytes: Arc<dyn Bytes>, columns: Option<&[Column]>, limits: &Limits) -> Result<RaySet, Error> {
    let mut header = Header::read(bytes.as_ref())?;
    let (columns, luminous) = match columns {
        Some(columns) => under_header(columns, header.luminous)?,
        None => (header.columns()?, header.luminous),
    };
    tell_equal_shares(&columns, &mut header.notices);
    let slots = Slot::of(&columns, header.length_unit.map_or(1.0, LengthUnit::mm));
    let grammar = Grammar::new(separator(bytes.as_ref(), header.rows_at, LINE_OF_LIGHT.len())?, slots, None);
    let mut notices = std::mem::take(&mut header.notices);
    let mut rows = Rows::index(bytes, header.rows_at, grammar, limits, &mut notices)?;
    rows.hold_to(header.ray_count, &mut notices)?;
    Ok(RaySet { facts: header.facts(&columns, luminous, rows.count(), notices), records: Box::new(rows) })
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
    let row = second.map(leading_numbers);
    let tail = head.get(4..).unwrap_or_default();
    match head.len() {
        2 | 4 => row.is_none_or(|row| matches!(row, 7 | 8)),
        7 | 8 => {
            let unit = head.get(1).is_some_and(|unit| binary::length_unit(*unit).is_some());
            unit && head.iter().take(1).all(|count| *count > 0) && tail.iter().all(|number| *number == 0)
        }
        _ => false,
    }
}

/// The numbers of a line, all of them whole.
fn whole_numbers(line: &[u8]) -> Option<Vec<i32>> {
    let separator = Separator::of(line);
    let whole = |field: &[u8]| {
        let number = separator.number(field)?;
        (number.fract() == 0.0 && number.abs() <= f64::from(i32::MAX)).then_some(number as i32)
    };
    separator.fields(line).map(|(_, field)| whole(field)).collect()
}

/// The first line that is no comment.
struct Header {
    ray_count: u64,
    /// `None` where the line has a unit that does not exist.
    length_unit: Option<LengthUnit>,
    /// Rows hold a wavelength; `None` where the line has a format that does not exist.
    spectral: Option<bool>,
    /// Flux is in lm; `None` where the line ends before it says so, or says what does not exist.
    luminous: Option<bool>,
    /// The line as it stands, after the comments before it.
    texts: Vec<(String, String)>,
    notices: Notices,
    /// Offset of the line.
    at: u64,
    /// Offset of the rows.
    rows_at: u64,
}

impl Header {
    fn read(bytes: &dyn Bytes) -> Result<Header, Error> {
        let mut lines = Lines::of(bytes);
        let mut texts: Vec<(String, String)> = Vec::new();
        let (at, head) = loop {
            let Some(line) = lines.read_next()? else { break (0, None) };
            texts.push(("header".to_owned(), line.to_text()));
            if !line.is_comment() {
                break (line.at, whole_numbers(line.text));
            }
        };
        let rows_at = lines.at();
        let mut second = 0;
        while let Some(row) = lines.read_next()? {
            if !row.is_comment() {
                second = leading_numbers(row.text);
                break;
            }
        }
        let head = head.unwrap_or_default();
        let (Some(count), Some(unit)) = (head.first().and_then(|n| u64::try_from(*n).ok()), head.get(1)) else {
            let line = texts.last().map_or("", |(_, line)| line.as_str());
            let found = format!("The header \"{line}\" has no count and unit.");
            return Err(Error::malformed("zemax_text.header", found, "Export the file again.").at_byte(at));
        };
        let mut notices = Notices::default();
        let length_unit = binary::stored_unit(*unit, &mut notices);
        // A header of two numbers, or one filled up with zeros to the width of the rows, leaves the format to the rows.
        let spectral = match head.get(2) {
            Some(0) | None => Some(second == 8 && head.len() != 4),
            Some(2) => Some(true),
            Some(_) => None,
        };
        let luminous = match head.get(3) {
            _ if spectral == Some(true) => Some(false),
            None => None,
            Some(kind) => binary::stored_flux_type(*kind, &mut notices),
        };
        Ok(Header { ray_count: count, length_unit, spectral, luminous, texts, notices, at, rows_at })
    }

    /// What the header says of the rows.
    fn columns(&self) -> Result<Vec<Column>, Error> {
        let flux = if self.luminous == Some(true) { Column::LuminousFlux } else { Column::RadiantFlux };
        match self.spectral {
            Some(true) => Ok(ray_columns(&[flux, Column::WavelengthUm])),
            Some(false) => Ok(ray_columns(&[flux])),
            None => {
                let found = "The header has a ray format that does not exist; only 0 (flux) and 2 (spectral) do.";
                let remedy = "Declare what each column of the rows holds, or export the file again.";
                Err(Error::malformed("zemax.ray_format", found, remedy).at_byte(self.at))
            }
        }
    }

    fn facts(self, columns: &[Column], luminous: Option<bool>, ray_count: u64, notices: Notices) -> Facts {
        Facts {
            format: Format::ZemaxText,
            ray_count,
            header_flux: Flux::default(),
            total_rule: TotalRule::RaySum,
            has_radiant: luminous != Some(true),
            has_luminous: luminous == Some(true),
            spectral: spectral(columns),
            length_unit: self.length_unit,
            quantity_unknown: luminous.is_none(),
            texts: self.texts,
            notices,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::record::{RawRay, SpectralData};

    fn opened(text: &str) -> Result<(Facts, Vec<RawRay>), Error> {
        open(Arc::new(text.as_bytes().to_vec()), None, &Limits::default())?.read_all()
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
            ("1 4 1 0\n", ROW, "zemax.ray_format"),
            ("-1 4 0 0\n", ROW, "zemax_text.header"),
            ("2 4 0 0\n", ROW, "text.row_count"),
            ("1 4 2 0\n", ROW, "text.columns"),
            ("1 4 0 0\n", COLORED, "text.columns"),
        ];
        for (header, row, code) in cases {
            assert_eq!(opened(&[header, row].concat()).unwrap_err().code(), code, "{header}");
        }
    }

    /// What does not exist is not said, and has to be declared.
    #[test]
    fn units_and_flux_types_that_do_not_exist() {
        let (facts, rays) = opened(&["1 5 0 0\n", ROW].concat()).unwrap();
        assert_eq!((facts.length_unit, facts.notices.count_of("zemax.unit"), rays.len()), (None, 1, 1));
        let (facts, _) = opened(&["1 4 0 2\n", ROW].concat()).unwrap();
        assert!(facts.quantity_unknown && facts.notices.count_of("zemax.flux_type") == 1);
    }

    #[test]
    fn comments_before_the_header_and_other_signs_between_numbers() {
        for text in [
            "! source\n# of light\n1 4 0 1\n1 2 0.5 0 0 1 0.25\n",
            "1,4,0,1\n1,2,0.5,0,0,1,0.25\n",
            "1;4;0;1\n1;2;0,5;0;0;1;0,25\n",
            "1 4 0 1\n1 2 0,5 0 0 1 0,25\n",
        ] {
            let (facts, rays) = opened(text).unwrap();
            assert_eq!((facts.length_unit, facts.has_luminous), (Some(LengthUnit::Millimetre), true), "{text}");
            assert_eq!((rays[0].origin_mm, rays[0].luminous), ([1.0, 2.0, 0.5], 0.25), "{text}");
        }
    }

    #[test]
    fn declared_columns_hold_over_the_header() {
        use Column::{Flux, Ignored, WavelengthUm};
        for (header, more) in [("1 4 0 1\n", Ignored), ("1 4 1 0\n", WavelengthUm), ("1 4 0 0\n", WavelengthUm)] {
            let text = [header, COLORED].concat().into_bytes();
            let columns = ray_columns(&[Flux, more]);
            let set = open(Arc::new(text), Some(&columns), &Limits::default()).unwrap();
            let mut rays = Vec::new();
            set.records.read(0, 1, &mut rays).unwrap();
            let wavelength = if more == Ignored { SpectralData::None } else { SpectralData::Wavelength };
            assert_eq!((set.facts.spectral, set.facts.has_luminous), (wavelength, header == "1 4 0 1\n"), "{header}");
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
