//! Units, wherever people write them: in brackets behind a name, in a row of their own below the names, in lines of words
//! (`Units: mm`, `Flux unit: lumen`).

use crate::vocabulary::units::{LengthUnit, Quantity};

/// What one word or field says of a unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Unit {
    /// A unit of length.
    Length(LengthUnit),
    /// A unit of flux: which, and how many W or lm it is.
    Flux(Quantity, f64),
    /// Nothing, or that there is none.
    None,
}

/// What people write for numbers without a unit.
const NONE: [&str; 8] = ["", "-", "--", "1", "none", "unitless", "n/a", "dimensionless"];

impl Unit {
    /// What a field of a row of units says; `None` where it is no unit.
    pub fn of(field: &str) -> Option<Unit> {
        let word = field.trim_matches(['[', ']', '(', ')', '"', ' ', '\t']);
        let lower = word.to_lowercase();
        if NONE.contains(&lower.as_str()) {
            return Some(Unit::None);
        }
        let length = LengthUnit::from_word(&lower).map(Unit::Length);
        length.or_else(|| Quantity::from_unit(word).map(|(quantity, scale)| Unit::Flux(quantity, scale)))
    }
}

/// The units of a row of its own, one for each of `width` columns; `None` where the line is none.
pub fn row(fields: &[String], width: usize) -> Option<Vec<Unit>> {
    let units: Vec<Unit> = fields.iter().map(|field| Unit::of(field)).collect::<Option<_>>()?;
    (units.len() == width && units.iter().any(|unit| *unit != Unit::None)).then_some(units)
}

/// Units that a line of words tells.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Told {
    /// Of the positions.
    pub length: Option<LengthUnit>,
    /// Of the flux.
    pub flux: Option<(Quantity, f64)>,
}

impl Told {
    /// What `line` tells: after a word of units or lengths, and a colon or an equals sign, the units of what it names.
    pub fn of(line: &str) -> Told {
        let mut told = Told::default();
        let Some((key, value)) = line.split_once([':', '=']) else { return told };
        let key = key.to_lowercase();
        if !["unit", "length", "dimension"].iter().any(|word| key.contains(word)) {
            return told;
        }
        let of = |words: &[&str]| words.iter().any(|word| key.contains(word));
        if of(&["wave", "lambda", "angle", "angular", "time"]) {
            return told;
        }
        let (only_flux, only_length) = (of(&["flux", "power", "energy"]), of(&["length", "position", "coord"]));
        // A length of something is no unit of everything.
        if value.split(' ').any(|word| word.parse::<f64>().is_ok()) {
            return told;
        }
        for word in value.split([' ', '\t', ',', ';', '/']) {
            match Unit::of(word) {
                Some(Unit::Length(unit)) if !only_flux => told.length = told.length.or(Some(unit)),
                Some(Unit::Flux(quantity, scale)) if !only_length => told.flux = told.flux.or(Some((quantity, scale))),
                _ => {}
            }
        }
        told
    }

    /// The same, with what `other` tells where this tells nothing.
    pub fn or(self, other: Told) -> Told {
        Told { length: self.length.or(other.length), flux: self.flux.or(other.flux) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_that_tell_units() {
        let mm = Some(LengthUnit::Millimetre);
        let lm = Some((Quantity::Luminous, 1.0));
        for (line, length, flux) in [
            ("Units: mm", mm, None),
            ("Length unit = millimeters", mm, None),
            ("Flux unit: lumen", None, lm),
            ("Units: mm, lm", mm, lm),
            ("Power units: mW", None, Some((Quantity::Radiant, 1e-3))),
            ("Wavelength unit: nm", None, None),
            ("Flux unit: mm", None, None),
            ("Dimensions: mm", mm, None),
            ("LED length: 3.5 mm", None, None),
            ("made in mm", None, None),
            ("unit mm", None, None),
        ] {
            assert_eq!(Told::of(line), Told { length, flux }, "{line}");
        }
    }

    #[test]
    fn rows_of_units() {
        let fields = |text: &str| text.split(',').map(str::to_owned).collect::<Vec<_>>();
        let units = row(&fields("mm,[mm],(mm),,-,,mW"), 7).unwrap();
        assert_eq!(units[6], Unit::Flux(Quantity::Radiant, 1e-3));
        assert_eq!(units[1], Unit::Length(LengthUnit::Millimetre));
        for (text, width) in [("mm,mm,mm", 7), ("a,b,c", 3), (",,", 3)] {
            assert_eq!(row(&fields(text), width), None, "{text}");
        }
    }
}
