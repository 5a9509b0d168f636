//! LightTools text ray files (`FORMATS.md` 3): `key: value` lines in any order, then rows.
//!
//! Ray values are relative and the header's flux is the total, in every export at hand.

use super::super::Error;
use super::super::vocabulary::limits::Limits;
use super::super::vocabulary::notice::Notices;
use super::super::vocabulary::units::{Flux, LengthUnit};
use super::declared::Column;
use super::lines::{Line, Lines, Separator};
use super::rows::{Grammar, Rows, Slot, ray_columns, spectral};
use super::{Bytes, Facts, Format, RaySet, TotalRule};
use std::sync::Arc;

/// The line before the first row.
const START: &[u8] = b"lt_startofdata";
/// The line after the last row.
const END: &str = "lt_endofdata";

/// Opens a file of this format.
///
/// # Errors
/// As [`super::open`].
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
                    _ => return Err(wrong("lighttools.datatype", "only radiant_power and luminous_flux are known")),
                });
            }
            "lt_far_field_data" if matches!(says.as_str(), "yes" | "true" | "1") => return Err(far_field(line.at)),
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

fn far_field(at: u64) -> Error {
    let found = "The rays are far-field data: they have directions and no start points.";
    Error::refused("lighttools.far_field", found, "Export the rays with their start points (near-field data).")
        .at_byte(at)
}

/// Three numbers.
fn point(text: &str) -> Option<[f64; 3]> {
    let mut numbers = Separator::Blank.fields(text.as_bytes()).map(|(_, field)| Separator::Blank.number(field));
    let point = [numbers.next()??, numbers.next()??, numbers.next()??];
    numbers.next().is_none().then_some(point)
}
