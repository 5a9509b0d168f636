//! LightTools text ray files (`pipeline/formats/README.md` 3): `key: value` lines in any order, then rows.
//!
//! Ray values are relative and the header's flux is the total, in every export at hand.

use super::binary::{far_field, tristimulus_in_w};
use crate::error::Error;
use crate::formats::record::{Bytes, Facts, Format, RaySet, TotalRule};
use crate::formats::text::lines::{Line, Lines, Separator};
use crate::formats::text::rows::{Grammar, Rows, Slot, ray_columns, spectral};
use crate::vocabulary::declaration::Column;
use crate::vocabulary::limits::Limits;
use crate::vocabulary::notice::Notices;
use crate::vocabulary::units::{Flux, LengthUnit};
use std::sync::Arc;

/// The line before the first row.
const START: &[u8] = b"lt_startofdata";
/// The line after the last row.
const END: &str = "lt_endofdata";

/// Opens a file of this format.
///
/// # Errors
/// As [`crate::formats::open`].
pub fn open(bytes: Arc<dyn Bytes>, limits: &Limits) -> Result<RaySet, Error> {
    let header = Header::read(bytes.as_ref(), limits.max_text_bytes)?;
    let mut notices = header.notices();
    let columns = header.columns();
    let slots = Slot::of(&columns, header.length_unit.map_or(1.0, LengthUnit::mm));
    let grammar = Grammar { separator: Separator::Blank, slots, end: Some(END) };
    let rows = Rows::index(bytes, header.rows_at, grammar, limits, &mut notices)?;
    if !rows.has_end() {
        let told = "The line \"lt_endofdata\" is missing: the file may be cut. Its total is the header's all the same.";
        notices.add("lighttools.no_end", told);
    }
    Ok(RaySet { facts: header.facts(&columns, rows.count(), notices), records: Box::new(rows) })
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
    color: ColorInfo,
    /// `None` for "system", which only LightTools knew.
    length_unit: Option<LengthUnit>,
    /// `lt_radiant_flux`, also of lm.
    total: Option<f64>,
    origin: [f64; 3],
    /// Offset of the line after [`START`].
    rows_at: u64,
}

impl Header {
    fn read(bytes: &dyn Bytes, max_bytes: usize) -> Result<Header, Error> {
        let mut header = Header {
            texts: Vec::new(),
            luminous: None,
            color: ColorInfo::None,
            length_unit: None,
            total: None,
            origin: [0.0; 3],
            rows_at: 0,
        };
        let mut lines = Lines::of(bytes);
        while let Some(line) = lines.read_next()? {
            if line.text.eq_ignore_ascii_case(START) {
                if header.color == ColorInfo::Tristimulus && header.luminous == Some(false) {
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
        match key.as_str() {
            "lt_datatype" => {
                self.luminous = Some(match says.as_str() {
                    "radiant_power" | "radiant_flux" | "radiometric" => false,
                    "luminous_flux" | "luminous_power" | "photometric" => true,
                    _ => return Err(wrong("lighttools.data_type", "only radiant_power and luminous_flux are known")),
                });
            }
            "lt_far_field_data" => match says.as_str() {
                "no" | "false" | "0" | "" => {}
                "yes" | "true" | "1" => return Err(far_field(line.at)),
                _ => return Err(wrong("lighttools.far_field", "only yes and no are known")),
            },
            "lt_color_info" => {
                self.color = match says.as_str() {
                    "none" | "no" | "" => ColorInfo::None,
                    "wavelength" => ColorInfo::Wavelength,
                    "tristimulus" => ColorInfo::Tristimulus,
                    _ => {
                        return Err(wrong("lighttools.color_info", "only none, wavelength and tristimulus are known"));
                    }
                };
            }
            "lt_length_units" if !matches!(says.as_str(), "" | "system") => {
                let unit = LengthUnit::from_word(&says);
                self.length_unit = Some(unit.ok_or_else(|| wrong("lighttools.length_unit", "no such unit is known"))?);
            }
            "lt_data_origin" => {
                self.origin =
                    point(value).ok_or_else(|| wrong("lighttools.data_origin", "three numbers belong there"))?;
            }
            "lt_radiant_flux" | "lt_luminous_flux" => {
                let total = Separator::Blank.number(value.as_bytes());
                self.total = Some(total.ok_or_else(|| wrong("lighttools.total", "a number belongs there"))?);
            }
            _ => {}
        }
        self.texts.push((key, value.to_owned()));
        Ok(())
    }

    fn columns(&self) -> Vec<Column> {
        let flux = if self.luminous == Some(true) { Column::LuminousFlux } else { Column::RadiantFlux };
        match self.color {
            ColorInfo::None => ray_columns(&[flux]),
            ColorInfo::Wavelength => ray_columns(&[flux, Column::WavelengthNm]),
            ColorInfo::Tristimulus => ray_columns(&[Column::TristimulusX, Column::LuminousFlux, Column::TristimulusZ]),
        }
    }

    fn notices(&self) -> Notices {
        let mut notices = Notices::default();
        if self.known_total().is_none() {
            notices.add("lighttools.no_total", "The header has no total flux; the rays are taken as they are.");
        }
        if self.origin != [0.0; 3] {
            let [x, y, z] = self.origin;
            let told = format!("The header has a data origin, ({x}, {y}, {z}); positions were taken as they are.");
            notices.add("lighttools.data_origin", told);
        }
        notices
    }

    fn known_total(&self) -> Option<f64> {
        self.total.filter(|total| total.is_finite() && *total > 0.0)
    }

    fn facts(self, columns: &[Column], ray_count: u64, notices: Notices) -> Facts {
        let total = self.known_total();
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
            quantity_unknown: self.luminous.is_none() && !has_luminous,
            texts: self.texts,
            notices,
        }
    }
}

/// Three numbers.
fn point(text: &str) -> Option<[f64; 3]> {
    let mut numbers = Separator::Blank.fields(text.as_bytes()).map(|(_, field)| Separator::Blank.number(field));
    let point = [numbers.next()??, numbers.next()??, numbers.next()??];
    numbers.next().is_none().then_some(point)
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
        ];
        for (text, code) in told {
            assert_eq!(opened(&text).unwrap().0.notices.count_of(code), 1, "{code}");
        }
        let refused = [
            (file("lt_far", "lt_far_field_data: YES", ROW), "lighttools.far_field"),
            (file("lt_datatype", "lt_datatype: photons", ROW), "lighttools.data_type"),
            (file("lt_far", "lt_far_field_data: some", ROW), "lighttools.far_field"),
            (file("lt_color", "lt_color_info: rgb", ROW), "lighttools.color_info"),
            (file("lt_color", "lt_color_info: tristimulus", "1 2 3 0 0 1 7 8 9"), "lighttools.data_type"),
            (file("lt_length", "lt_length_units: parsec", ROW), "lighttools.length_unit"),
            (file("lt_data_origin", "lt_data_origin: 0 0", ROW), "lighttools.data_origin"),
            (file("lt_radiant", "lt_radiant_flux: much", ROW), "lighttools.total"),
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
