//! LightTools text ray files (`pipeline/formats/README.md` 3): `key: value` lines in any order, then rows.
//!
//! Ray values are relative and the header's flux is the total, in every export at hand.

use super::binary::{far_field, tristimulus_in_w};
use crate::error::Error;
use crate::formats::record::{Bytes, Facts, Format, RaySet, TOTAL_UNREADABLE, TotalRule};
use crate::formats::text::column_rules::{tell_equal_shares, under_header};
use crate::formats::text::lines::{Line, Lines, Separator};
use crate::formats::text::rows::{Grammar, LINE_OF_LIGHT, Rows, Slot, ray_columns, separator, spectral};
use crate::vocabulary::declaration::Column;
use crate::vocabulary::limits::Limits;
use crate::vocabulary::notice::Notices;
use crate::vocabulary::units::{Flux, LengthUnit};
use std::sync::Arc;

/// The line before the first row.
const START: &[u8] = b"lt_startofdata";
/// The line after the last row.
const END: &str = "lt_endofdata";

/// Opens a file of this format, its columns as declared where they are.
///
/// # Errors
/// As [`crate::formats::open`].
pub fn open(bytes: Arc<dyn Bytes>, columns: Option<&[Column]>, limits: &Limits) -> Result<RaySet, Error> {
    let mut header = Header::read(bytes.as_ref(), limits.max_text_bytes)?;
    let separator = separator(bytes.as_ref(), header.rows_at, LINE_OF_LIGHT.len())?;
    let total = header.take_total(separator);
    let mut notices = header.notices(total);
    let (columns, luminous) = match columns {
        Some(columns) => under_header(columns, header.luminous)?,
        None => (header.columns()?, header.luminous),
    };
    tell_equal_shares(&columns, &mut notices);
    let slots = Slot::of(&columns, header.length_unit.map_or(1.0, LengthUnit::mm));
    let grammar = Grammar::new(separator, slots, Some(END));
    let rows = Rows::index(bytes, header.rows_at, grammar, limits, &mut notices)?;
    if !rows.has_end() {
        let told = "The line \"lt_endofdata\" is missing: the file may be cut. Its total is the header's all the same.";
        notices.add("lighttools.no_end", told);
    }
    let facts = header.facts(&columns, luminous, total, rows.count(), notices);
    Ok(RaySet { facts, records: Box::new(rows) })
}

/// Judges the header from the first bytes of a file that is `length` bytes long, if that is known.
///
/// # Errors
/// As [`open`]; [`Error::Unreadable`] (end of file) when `bytes` holds too little to tell.
pub fn peek(bytes: &dyn Bytes, _length: Option<u64>) -> Result<(), Error> {
    Header::read(bytes, Limits::default().max_text_bytes).map(|_| ())
}

/// What a ray carries besides its line and its flux.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ColorInfo {
    None,
    Wavelength,
    Tristimulus,
}

/// The lines before the rows.
struct Header {
    /// Keys in lower case and their values, in the file's order.
    texts: Vec<(String, String)>,
    /// Flux is in lm; `None` where the file does not say.
    luminous: Option<bool>,
    /// `None` where the file says what does not exist.
    color: Option<ColorInfo>,
    /// `None` for "system", which only LightTools knew, and for what is no unit.
    length_unit: Option<LengthUnit>,
    /// `lt_radiant_flux`, also of lm, as written.
    total: Option<String>,
    origin: [f64; 3],
    /// Words that are not known, and what has to be declared for them.
    told: Notices,
    /// Offset of the line after [`START`].
    rows_at: u64,
}

impl Header {
    fn read(bytes: &dyn Bytes, max_bytes: usize) -> Result<Header, Error> {
        let mut header = Header {
            texts: Vec::new(),
            luminous: None,
            color: Some(ColorInfo::None),
            length_unit: None,
            total: None,
            origin: [0.0; 3],
            told: Notices::default(),
            rows_at: 0,
        };
        let mut lines = Lines::of(bytes);
        while let Some(line) = lines.read_next()? {
            if line.text.eq_ignore_ascii_case(START) {
                if header.color == Some(ColorInfo::Tristimulus) && header.luminous == Some(false) {
                    return Err(tristimulus_in_w(line.at));
                }
                header.rows_at = lines.at();
                return Ok(header);
            }
            if line.at > max_bytes as u64 {
                break;
            }
            header.take(line)?;
        }
        let found = "The line \"lt_startofdata\" is missing: there are no rays.";
        Err(Error::malformed("lighttools.no_data", found, "Fetch or export the file again.").at_byte(lines.at()))
    }

    fn take(&mut self, line: Line<'_>) -> Result<(), Error> {
        let text = line.to_text();
        if line.is_comment() {
            self.texts.push(("comment".to_owned(), text.trim_start_matches(['#', '!', '%', '/', ' ']).to_owned()));
            return Ok(());
        }
        let (key, value) = text.split_once(':').unwrap_or((&text, ""));
        let (key, value) = (key.trim().to_ascii_lowercase(), value.trim());
        let says = value.to_ascii_lowercase();
        let wrong = |code, what: &str| {
            let found = format!("{key} is \"{value}\"; {what}.");
            Error::malformed(code, found, "Export the file again.").at_byte(line.at)
        };
        let unknown = |what: &str| format!("{key} is \"{value}\"; {what}, so it is not said.");
        let notices = &mut self.told;
        match key.as_str() {
            "lt_datatype" => match says.as_str() {
                "radiant_power" | "radiant_flux" | "radiometric" => self.luminous = Some(false),
                "luminous_flux" | "luminous_power" | "photometric" => self.luminous = Some(true),
                _ => notices.add("lighttools.data_type", unknown("only radiant_power and luminous_flux are known")),
            },
            "lt_far_field_data" => match says.as_str() {
                "no" | "false" | "0" | "" => {}
                "yes" | "true" | "1" => return Err(far_field(line.at)),
                _ => return Err(wrong("lighttools.far_field", "only yes and no are known")),
            },
            "lt_color_info" => {
                self.color = match says.as_str() {
                    "none" | "no" | "" => Some(ColorInfo::None),
                    "wavelength" => Some(ColorInfo::Wavelength),
                    "tristimulus" => Some(ColorInfo::Tristimulus),
                    _ => None,
                };
            }
            "lt_length_units" if !matches!(says.as_str(), "" | "system") => {
                self.length_unit = LengthUnit::from_word(&says);
                if self.length_unit.is_none() {
                    notices.add("lighttools.length_unit", unknown("no such unit is known"));
                }
            }
            "lt_data_origin" => {
                self.origin =
                    point(value).ok_or_else(|| wrong("lighttools.data_origin", "three numbers belong there"))?;
            }
            "lt_radiant_flux" | "lt_luminous_flux" => self.total = Some(value.to_owned()),
            _ => {}
        }
        self.texts.push((key, value.to_owned()));
        Ok(())
    }

    fn columns(&self) -> Result<Vec<Column>, Error> {
        let flux = if self.luminous == Some(true) { Column::LuminousFlux } else { Column::RadiantFlux };
        match self.color {
            Some(ColorInfo::None) => Ok(ray_columns(&[flux])),
            Some(ColorInfo::Wavelength) => Ok(ray_columns(&[flux, Column::WavelengthNm])),
            Some(ColorInfo::Tristimulus) => {
                Ok(ray_columns(&[Column::TristimulusX, Column::LuminousFlux, Column::TristimulusZ]))
            }
            None => {
                let found = "lt_color_info has none of the words that are known: none, wavelength, tristimulus.";
                let remedy = "Declare what each column of the rows holds, or export the file again.";
                Err(Error::malformed("lighttools.color_info", found, remedy).at_byte(self.rows_at))
            }
        }
    }

    /// The header's total, written like the rows. One that cannot be read is told: the rays are relative to it.
    fn take_total(&mut self, separator: Separator) -> Option<f64> {
        let stored = self.total.take()?;
        let total = separator.number(stored.as_bytes());
        if total.is_none() {
            let told = format!("The header's total flux is \"{stored}\", which is no number as the rows have them.");
            self.told.add(TOTAL_UNREADABLE, told);
        }
        Some(total.unwrap_or(f64::NAN))
    }

    fn notices(&mut self, total: Option<f64>) -> Notices {
        let mut notices = std::mem::take(&mut self.told);
        if known(total).is_none() && notices.count_of(TOTAL_UNREADABLE) == 0 {
            notices.add("lighttools.no_total", "The header has no total flux; the rays are taken as they are.");
        }
        if self.origin != [0.0; 3] {
            let [x, y, z] = self.origin;
            let told = format!("The header has a data origin, ({x}, {y}, {z}); positions were taken as they are.");
            notices.add("lighttools.data_origin", told);
        }
        notices
    }

    fn facts(
        self,
        columns: &[Column],
        luminous: Option<bool>,
        total: Option<f64>,
        ray_count: u64,
        notices: Notices,
    ) -> Facts {
        let total = known(total);
        let has_luminous = columns.contains(&Column::LuminousFlux);
        Facts {
            format: Format::LightToolsText,
            ray_count,
            header_flux: Flux {
                radiant_w: total.filter(|_| !has_luminous),
                luminous_lm: total.filter(|_| has_luminous),
            },
            total_rule: TotalRule::Header,
            has_radiant: !has_luminous,
            has_luminous,
            spectral: spectral(columns),
            length_unit: self.length_unit,
            quantity_unknown: luminous.is_none() && !has_luminous,
            texts: self.texts,
            notices,
        }
    }
}

fn known(total: Option<f64>) -> Option<f64> {
    total.filter(|total| total.is_finite() && *total > 0.0)
}

/// Three numbers.
fn point(text: &str) -> Option<[f64; 3]> {
    let separator = Separator::of(text.as_bytes());
    let mut numbers = separator.fields(text.as_bytes()).map(|(_, field)| separator.number(field));
    let point = [numbers.next()??, numbers.next()??, numbers.next()??];
    numbers.next().is_none().then_some(point)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::record::{RawRay, SpectralData};

    fn opened(text: &str) -> Result<(Facts, Vec<RawRay>), Error> {
        open(Arc::new(text.as_bytes().to_vec()), None, &Limits::default())?.read_all()
    }

    const LINES: [&str; 9] = [
        "# LightTools 8.7.0 ",
        "lt_rdf_version: 2.0",
        "dataname: untitledRayData",
        "lt_datatype: radiant_power",
        "lt_far_field_data: no",
        "lt_color_info: none",
        "lt_length_units: millimeters",
        "lt_data_origin:          0          0          0",
        "lt_radiant_flux: 3.5",
    ];

    /// The header with one key said differently, `""` to leave it out, and one row.
    fn file(key: &str, line: &str, row: &str) -> String {
        let lines = LINES.map(|given| if !key.is_empty() && given.starts_with(key) { line } else { given });
        format!("{}\r\nlt_startofdata\r\n    {row}\r\nlt_endofdata", lines.join("\r\n"))
    }

    const ROW: &str = "1 -1.886318e-015 3 0 0 1 0.25";

    #[test]
    fn the_header_is_the_total_in_the_unit_of_the_datatype() {
        let (facts, rays) = opened(&file("", "", ROW)).unwrap();
        assert_eq!(rays[0].origin_mm, [1.0, -1.886318e-15, 3.0]);
        assert_eq!((rays[0].radiant, rays[0].luminous), (0.25, 0.0));
        assert_eq!(facts.header_flux, Flux { radiant_w: Some(3.5), luminous_lm: None });
        assert_eq!((facts.total_rule, facts.spectral), (TotalRule::Header, SpectralData::None));
        assert_eq!(facts.texts[2], ("dataname".to_owned(), "untitledRayData".to_owned()));
        assert_eq!(facts.notices, Notices::default());
        // `lt_radiant_flux` is the total of lumens too.
        let (facts, rays) = opened(&file("lt_datatype", "LT_DATATYPE: Luminous_Flux", ROW)).unwrap();
        assert_eq!((rays[0].radiant, rays[0].luminous), (0.0, 0.25));
        assert_eq!(facts.header_flux, Flux { radiant_w: None, luminous_lm: Some(3.5) });
        let (facts, _) = opened(&file("lt_datatype", "", ROW)).unwrap();
        assert!(facts.quantity_unknown);
    }

    #[test]
    fn keys_in_any_order_case_and_line_end() {
        let mut lines = LINES.map(str::to_uppercase);
        lines.reverse();
        for end in ["\n", "\r\n", "\n\r", "\r"] {
            let text = [&lines.join(end), "LT_STARTOFDATA", ROW, "LT_ENDOFDATA", ""].join(end);
            let (facts, rays) = opened(&text).unwrap();
            assert_eq!(
                (rays.len(), facts.header_flux.radiant_w, facts.length_unit),
                (1, Some(3.5), Some(LengthUnit::Millimetre))
            );
            assert_eq!(facts.notices, Notices::default());
        }
    }

    #[test]
    fn units_and_colors() {
        for (word, mm) in
            [("centimeters", 10.0), ("meters", 1000.0), ("inches", 25.4), ("feet", 304.8), ("microns", 1e-3)]
        {
            let (_, rays) = opened(&file("lt_length_units", &format!("lt_length_units: {word}"), ROW)).unwrap();
            assert_eq!((rays[0].origin_mm[0], rays[0].origin_mm[2]), (mm, 3.0 * mm));
        }
        let (facts, _) = opened(&file("lt_length_units", "lt_length_units: system", ROW)).unwrap();
        assert_eq!(facts.length_unit, None);
        let (facts, rays) = opened(&file("lt_color", "lt_color_info: wavelength", "1 2 3 0 0 1 0.25 550")).unwrap();
        assert_eq!((rays[0].wavelength_nm, facts.spectral), (550.0, SpectralData::Wavelength));
        let tristimulus = file("lt_color", "lt_color_info: tristimulus", "1 2 3 0 0 1 7 8 9");
        let (facts, rays) = opened(&tristimulus.replace("radiant_power", "luminous_flux")).unwrap();
        assert_eq!((rays[0].xz, rays[0].luminous, facts.spectral), ([7.0, 9.0], 8.0, SpectralData::Tristimulus));
    }

    #[test]
    fn damage_is_told_or_refused() {
        let told = [
            (file("", "", ROW).replace("lt_endofdata", ""), "lighttools.no_end"),
            (file("lt_radiant", "", ROW), "lighttools.no_total"),
            (file("lt_radiant", "lt_radiant_flux: 0", ROW), "lighttools.no_total"),
            (file("lt_data_origin", "lt_data_origin: 0 0 1.5", ROW), "lighttools.data_origin"),
            // What has to be declared in their place.
            (file("lt_datatype", "lt_datatype: photons", ROW), "lighttools.data_type"),
            (file("lt_length", "lt_length_units: parsec", ROW), "lighttools.length_unit"),
            (file("lt_radiant", "lt_radiant_flux: much", ROW), "rays.total_unreadable"),
            (file("lt_radiant", "lt_radiant_flux: 0,5", ROW), "rays.total_unreadable"),
        ];
        for (text, code) in told {
            assert_eq!(opened(&text).unwrap().0.notices.count_of(code), 1, "{code}");
        }
        let refused = [
            (file("lt_far", "lt_far_field_data: YES", ROW), "lighttools.far_field"),
            (file("lt_far", "lt_far_field_data: some", ROW), "lighttools.far_field"),
            (file("lt_color", "lt_color_info: rgb", ROW), "lighttools.color_info"),
            (file("lt_color", "lt_color_info: tristimulus", "1 2 3 0 0 1 7 8 9"), "lighttools.data_type"),
            (file("lt_data_origin", "lt_data_origin: 0 0", ROW), "lighttools.data_origin"),
            (file("lt_color", "lt_color_info: wavelength", ROW), "text.columns"),
            (LINES.join("\n"), "lighttools.no_data"),
        ];
        for (text, code) in refused {
            let error = opened(&text).unwrap_err();
            let (Error::Malformed(fault) | Error::Refused(fault)) = &error else { panic!("{error}") };
            assert!(fault.code == code && fault.at.is_some(), "{code}: {error}");
        }
    }
}
