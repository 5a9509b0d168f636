//! What people call the columns of a ray, with the units they put into the name: `x [mm]`, `power_W`, `wavelength (nm)`.

use super::rows::Slot;
use crate::error::{Error, Place};
use crate::vocabulary::declaration::Column;
use crate::vocabulary::units::LengthUnit;

/// Names a header line has at least, out of those we know.
const FEWEST: usize = 3;

/// Words for where a ray starts, before or after the letter of an axis.
const POSITION: [&str; 11] =
    ["", "p", "o", "pos", "position", "origin", "start", "loc", "location", "coord", "coordinate"];
/// Words for where a ray goes, before or after the letter of an axis.
const DIRECTION: [&str; 10] = ["k", "d", "u", "v", "dir", "direction", "vec", "vector", "cos", "cosine"];
/// Words for tristimulus values, before the letter.
const TRISTIMULUS: [&str; 4] = ["tristimulus", "tri", "cie", "stimulus"];

/// A header line that names columns.
#[derive(Clone, Debug, PartialEq)]
pub struct Named {
    /// What each column holds; `None` is a wavelength of unknown unit.
    pub slots: Vec<Option<Slot>>,
    /// Names that say nothing to us.
    pub unknown: Vec<String>,
    /// Units of the three positions, where they have one.
    units: Vec<Option<LengthUnit>>,
}

impl Named {
    /// The unit of the positions, where their names say it.
    ///
    /// # Errors
    /// `columns.units` where they say different ones.
    pub fn length_unit(&self) -> Result<Option<LengthUnit>, Error> {
        let first = self.units.first().copied().flatten();
        if self.units.iter().all(|unit| *unit == first) {
            return Ok(first);
        }
        let found = "The names of x, y and z have different length units, or some have none.";
        let place = Place::Channel(0, "columns");
        let remedy = "Give all three one unit; or declare the columns and the length unit, where the names are wrong.";
        Err(Error::invalid_declaration("columns.units", place, found, remedy))
    }
}

/// The columns a line names, when it names some.
pub fn named(line: &str) -> Option<Named> {
    let mut named = Named { slots: Vec::new(), unknown: Vec::new(), units: Vec::new() };
    let mut known = 0;
    for name in names(line) {
        let meaning = Meaning::of(&name).map(|meaning| meaning.or_tristimulus(&named.slots));
        known += usize::from(meaning.is_some());
        let ignored = Some(Slot::new(Column::Ignored, 1.0));
        named.slots.push(match meaning {
            Some(Meaning::Wavelength) => None,
            Some(Meaning::Column { column, scale, unit }) => {
                if matches!(column, Column::X | Column::Y | Column::Z) {
                    named.units.push(unit);
                }
                Some(Slot { column, scale: scale * Slot::new(column, 1.0).scale })
            }
            None => {
                named.unknown.push(name);
                ignored
            }
        });
    }
    (known >= FEWEST).then_some(named)
}

/// The names of a header line: split where its numbers would be, a unit in brackets kept with its name.
fn names(line: &str) -> Vec<String> {
    let sign = [';', '\t', ','].into_iter().find(|sign| line.contains(*sign));
    if let Some(sign) = sign {
        return line.trim_end_matches(sign).split(sign).map(plain).collect();
    }
    let mut names: Vec<String> = Vec::new();
    for word in line.split_whitespace() {
        match names.last_mut() {
            Some(name) if word.starts_with(['[', '(']) => name.push_str(&plain(word)),
            _ => names.push(plain(word)),
        }
    }
    names
}

fn plain(name: &str) -> String {
    name.trim_matches(|sign: char| sign.is_whitespace() || sign == '"').to_lowercase()
}

/// What one name says.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Meaning {
    Column {
        column: Column,
        scale: f64,
        unit: Option<LengthUnit>,
    },
    /// A wavelength, in nm or µm.
    Wavelength,
}

impl Meaning {
    fn of(name: &str) -> Option<Meaning> {
        let bracket = name.find(['[', '(']);
        let (stem, unit) = match bracket {
            Some(at) => (name.get(..at)?, name.get(at..)?.trim_matches(['[', ']', '(', ')', ' '])),
            None => (name, ""),
        };
        let whole = stem.replace(['_', ' ', '-', '.'], "");
        Meaning::with_unit(&whole, unit).or_else(|| {
            let (stem, unit) = stem.trim().rsplit_once(['_', ' ', '-', '.', '/'])?;
            Meaning::with_unit(&stem.replace(['_', ' ', '-', '.'], ""), unit)
        })
    }

    fn with_unit(stem: &str, unit: &str) -> Option<Meaning> {
        let plain = |column| Some(Meaning::Column { column, scale: 1.0, unit: None });
        match stem {
            "l" | "dirl" => plain(Column::L),
            "m" | "dirm" => plain(Column::M),
            "n" | "dirn" => plain(Column::N),
            "flux" | "rayflux" | "incflux" | "power" | "raypower" | "energy" | "intensity" | "weight" => {
                flux(unit).or(plain(Column::Flux).filter(|_| unit.is_empty()))
            }
            "radiantflux" | "radiantpower" => flux(if unit.is_empty() { "w" } else { unit }),
            "luminousflux" => flux(if unit.is_empty() { "lm" } else { unit }),
            "wavelength" | "wl" | "lambda" | "wave" | "\u{3bb}" => match LengthUnit::from_word(unit) {
                Some(LengthUnit::Nanometre) => plain(Column::WavelengthNm),
                Some(LengthUnit::Micrometre) => plain(Column::WavelengthUm),
                _ => unit.is_empty().then_some(Meaning::Wavelength),
            },
            "nm" => plain(Column::WavelengthNm),
            "um" | "\u{b5}m" | "\u{3bc}m" | "micron" | "microns" => plain(Column::WavelengthUm),
            _ => flux(stem).or_else(|| axis(stem, unit)),
        }
    }

    /// A second x, y or z is a tristimulus value: `x,y,z,kx,ky,kz,X,Y,Z`.
    fn or_tristimulus(self, before: &[Option<Slot>]) -> Meaning {
        let Meaning::Column { column, .. } = self else { return self };
        let again = before.iter().flatten().any(|slot| slot.column == column);
        let column = match column {
            Column::X if again => Column::TristimulusX,
            Column::Y if again => Column::LuminousFlux,
            Column::Z if again => Column::TristimulusZ,
            _ => return self,
        };
        Meaning::Column { column, scale: 1.0, unit: None }
    }
}

/// A flux of known unit.
fn flux(unit: &str) -> Option<Meaning> {
    let (column, scale) = match unit {
        "w" | "watt" | "watts" => (Column::RadiantFlux, 1.0),
        "mw" | "milliwatt" | "milliwatts" => (Column::RadiantFlux, 1e-3),
        "lm" | "lumen" | "lumens" => (Column::LuminousFlux, 1.0),
        "mlm" | "millilumen" | "millilumens" => (Column::LuminousFlux, 1e-3),
        _ => return None,
    };
    Some(Meaning::Column { column, scale, unit: None })
}

/// A name made of a word and the letter of an axis.
fn axis(stem: &str, unit: &str) -> Option<Meaning> {
    let spatial = [('x', Column::X, Column::L), ('y', Column::Y, Column::M), ('z', Column::Z, Column::N)];
    let stimuli = [Column::TristimulusX, Column::LuminousFlux, Column::TristimulusZ];
    for ((letter, position, direction), stimulus) in spatial.into_iter().zip(stimuli) {
        let after = stem.strip_suffix(letter);
        for word in [after, stem.strip_prefix(letter)].into_iter().flatten() {
            let one = |column| Some(Meaning::Column { column, scale: 1.0, unit: None });
            if POSITION.contains(&word) {
                let known = LengthUnit::from_word(unit);
                let mm = known.map_or(1.0, LengthUnit::mm);
                let meaning = Meaning::Column { column: position, scale: mm, unit: known };
                return (unit.is_empty() || known.is_some()).then_some(meaning);
            }
            if DIRECTION.contains(&word) {
                return one(direction);
            }
            if TRISTIMULUS.contains(&word) && after == Some(word) {
                return one(stimulus);
            }
        }
    }
    None
}
