//! What people call the columns of a ray, with the units they put into the name: `x [mm]`, `power_W`, `wavelength (nm)`.

use super::rows::Slot;
use super::units::Unit;
use crate::error::{Error, Place};
use crate::vocabulary::declaration::Column;
use crate::vocabulary::units::{LengthUnit, Quantity};

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
    /// All names.
    pub names: Vec<String>,
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

    /// The unit that a row below the names gives each column, where the names give none.
    pub fn with_units(mut self, units: &[Unit]) -> Named {
        let mut positions = self.units.iter_mut();
        for (slot, unit) in self.slots.iter_mut().zip(units) {
            let column = slot.map(|slot| slot.column);
            match (column, unit) {
                (Some(Column::X | Column::Y | Column::Z), _) => {
                    let stored = positions.next();
                    if let (Some(own @ None), Unit::Length(length)) = (stored, unit) {
                        *own = Some(*length);
                        *slot = slot.map(|slot| Slot { scale: slot.scale * length.mm(), ..slot });
                    }
                }
                (Some(Column::Flux), Unit::Flux(quantity, scale)) => *slot = Some(flux_slot(*quantity, *scale)),
                (None, Unit::Length(LengthUnit::Nanometre)) => *slot = Some(Slot::new(Column::WavelengthNm, 1.0)),
                (None, Unit::Length(LengthUnit::Micrometre)) => *slot = Some(Slot::new(Column::WavelengthUm, 1.0)),
                _ => {}
            }
        }
        self
    }

    /// The unit that a line of words gives the positions.
    pub fn in_unit(mut self, unit: LengthUnit) -> Named {
        if self.units.iter().all(Option::is_none) {
            let position = |column| matches!(column, Column::X | Column::Y | Column::Z);
            for slot in self.slots.iter_mut().flatten().filter(|slot| position(slot.column)) {
                slot.scale *= unit.mm();
            }
            self.units.iter_mut().for_each(|own| *own = Some(unit));
        }
        self
    }
}

/// A column of flux of this quantity, in `scale` W or lm.
pub fn flux_slot(quantity: Quantity, scale: f64) -> Slot {
    let column = match quantity {
        Quantity::Radiant => Column::RadiantFlux,
        Quantity::Luminous => Column::LuminousFlux,
    };
    Slot { column, scale }
}

/// The columns a line names, when it names some; of the ways to split it, the first that gives `width` names, or else the first.
pub fn named(line: &str, width: usize) -> Option<Named> {
    let ways = [names(line), wide_names(line), grouped_names(line, width)];
    let best = ways.iter().find(|names| names.len() == width).or(ways.first())?;
    naming(best)
}

fn naming(names: &[String]) -> Option<Named> {
    let mut named = Named { slots: Vec::new(), unknown: Vec::new(), names: names.to_vec(), units: Vec::new() };
    let mut known = 0;
    for name in names {
        let meaning = Meaning::of(name).map(|meaning| meaning.or_tristimulus(&named.slots));
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
                named.unknown.push(name.clone());
                ignored
            }
        });
    }
    (known >= FEWEST).then_some(named)
}

/// The names of a header line: split where its numbers would be, a unit in brackets kept with its name.
pub fn names(line: &str) -> Vec<String> {
    let sign = [';', '\t', ','].into_iter().find(|sign| line.contains(*sign));
    if let Some(sign) = sign {
        let line = line.strip_suffix(sign).filter(|line| !line.ends_with(sign)).unwrap_or(line);
        return line.split(sign).map(plain).collect();
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

/// The names of a header line whose names have blanks in them: split where there are two blanks or a tab.
fn wide_names(line: &str) -> Vec<String> {
    let tabs = line.replace('\t', "  ");
    tabs.split("  ").map(plain).filter(|name| !name.is_empty()).collect()
}

/// The names of a header line in which every name has as many words as every other: `X Pos Y Pos Z Pos`.
fn grouped_names(line: &str, width: usize) -> Vec<String> {
    let words: Vec<&str> = line.split_whitespace().collect();
    if width == 0 || words.is_empty() || !words.len().is_multiple_of(width) {
        return Vec::new();
    }
    words.chunks(words.len() / width).map(|group| plain(&group.join(" "))).collect()
}

fn plain(name: &str) -> String {
    name.trim_matches(|sign: char| sign.is_whitespace() || sign == '"').to_owned()
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
        let plain = |stem: &str| stem.to_lowercase().replace(['_', ' ', '-', '.'], "");
        let split = || {
            let (stem, unit) = stem.trim().rsplit_once(['_', ' ', '-', '.', '/'])?;
            Meaning::with_unit(&plain(stem), unit)
        };
        // MW is mega by the SI and milli where people write in capitals.
        if Quantity::from_unit(name).is_none() && Quantity::from_unit(&name.to_lowercase()).is_some() {
            return None;
        }
        // What is measured in W or lm is flux, whatever it is called.
        let measured = || bracket.and_then(|_| flux(unit));
        Meaning::with_unit(&plain(stem), unit).or_else(split).or_else(measured)
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
            "p" | "phi" | "\u{3c6}" => flux(unit),
            "radiantflux" | "radiantpower" => flux(if unit.is_empty() { "w" } else { unit }),
            "luminousflux" => flux(if unit.is_empty() { "lm" } else { unit }),
            "wavelength" | "wl" | "lambda" | "wave" | "\u{3bb}" => wavelength(&unit.to_lowercase()),
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

/// A wavelength, in this unit if there is one.
fn wavelength(unit: &str) -> Option<Meaning> {
    let (column, scale) = match (LengthUnit::from_word(unit), unit) {
        (Some(LengthUnit::Nanometre), _) => (Column::WavelengthNm, 1.0),
        (Some(LengthUnit::Micrometre), _) => (Column::WavelengthUm, 1.0),
        (_, "angstrom" | "angstroms" | "\u{e5}" | "\u{212b}" | "a") => (Column::WavelengthNm, 0.1),
        _ => return unit.is_empty().then_some(Meaning::Wavelength),
    };
    Some(Meaning::Column { column, scale, unit: None })
}

/// A flux of known unit.
fn flux(unit: &str) -> Option<Meaning> {
    let (quantity, scale) = Quantity::from_unit(unit)?;
    Some(Meaning::Column { column: flux_slot(quantity, scale).column, scale, unit: None })
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
                let known = LengthUnit::from_word(&unit.to_lowercase());
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
