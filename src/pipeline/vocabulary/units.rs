//! Radiant and luminous flux.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;

/// Luminous efficacy of radiation at the peak of V(λ), lm/W (CIE 1924; 683.002 in the 2019 SI, rounded as every
/// photometric standard does).
pub const KM_LM_PER_W: f64 = 683.0;

/// Units of length that ray files come in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the names say it")]
pub enum LengthUnit {
    Nanometre,
    Micrometre,
    Millimetre,
    Centimetre,
    Metre,
    Inch,
    Foot,
}

impl LengthUnit {
    /// All, from small to large.
    pub const ALL: [LengthUnit; 7] = [
        LengthUnit::Nanometre,
        LengthUnit::Micrometre,
        LengthUnit::Millimetre,
        LengthUnit::Centimetre,
        LengthUnit::Inch,
        LengthUnit::Foot,
        LengthUnit::Metre,
    ];

    /// Millimetres in one of it, exact.
    pub fn mm(self) -> f64 {
        match self {
            LengthUnit::Nanometre => 1e-6,
            LengthUnit::Micrometre => 1e-3,
            LengthUnit::Millimetre => 1.0,
            LengthUnit::Centimetre => 10.0,
            LengthUnit::Metre => 1000.0,
            LengthUnit::Inch => 25.4,
            LengthUnit::Foot => 304.8,
        }
    }

    /// Its symbol: what people write, and what options and answers say.
    pub fn symbol(self) -> &'static str {
        match self {
            LengthUnit::Nanometre => "nm",
            LengthUnit::Micrometre => "um",
            LengthUnit::Millimetre => "mm",
            LengthUnit::Centimetre => "cm",
            LengthUnit::Metre => "m",
            LengthUnit::Inch => "in",
            LengthUnit::Foot => "ft",
        }
    }

    /// What a schema lists where the unit may be unknown: all symbols, and null.
    pub fn symbols_and_null() -> Vec<Option<&'static str>> {
        LengthUnit::ALL.into_iter().map(|unit| Some(unit.symbol())).chain([None]).collect()
    }

    /// The unit with this symbol.
    pub fn from_symbol(symbol: &str) -> Option<LengthUnit> {
        LengthUnit::ALL.into_iter().find(|unit| unit.symbol() == symbol)
    }

    /// The unit that a file calls so, in lower case: by its symbol or its English name, in one or many.
    pub fn from_word(word: &str) -> Option<LengthUnit> {
        LengthUnit::from_symbol(word).or(match word {
            "nanometer" | "nanometers" | "nanometre" | "nanometres" => Some(LengthUnit::Nanometre),
            "micrometer" | "micrometers" | "micrometre" | "micrometres" | "micron" | "microns" | "\u{b5}m"
            | "\u{3bc}m" => Some(LengthUnit::Micrometre),
            "millimeter" | "millimeters" | "millimetre" | "millimetres" => Some(LengthUnit::Millimetre),
            "centimeter" | "centimeters" | "centimetre" | "centimetres" => Some(LengthUnit::Centimetre),
            "meter" | "meters" | "metre" | "metres" => Some(LengthUnit::Metre),
            "inch" | "inches" => Some(LengthUnit::Inch),
            "foot" | "feet" => Some(LengthUnit::Foot),
            _ => None,
        })
    }
}

/// Which flux a number is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Quantity {
    /// Radiant flux, W.
    Radiant,
    /// Luminous flux, lm.
    Luminous,
}

impl Quantity {
    /// Its unit.
    pub fn unit(self) -> &'static str {
        match self {
            Quantity::Radiant => "W",
            Quantity::Luminous => "lm",
        }
    }

    /// What a unit of flux is one of, and how many W or lm it is: `mW`, `klm`, `microwatts`. A capital M alone is mega by the SI
    /// and milli where people write in capitals, so it is no unit here.
    pub fn from_unit(unit: &str) -> Option<(Quantity, f64)> {
        let names = [
            (Quantity::Radiant, ["watts", "watt", "Watts", "Watt", "WATTS", "WATT", "W", "w"].as_slice()),
            (
                Quantity::Luminous,
                ["lumens", "lumen", "Lumens", "Lumen", "LUMENS", "LUMEN", "lm", "Lm", "LM"].as_slice(),
            ),
        ];
        names.into_iter().find_map(|(quantity, names)| {
            let prefix = names.iter().find_map(|name| unit.strip_suffix(name))?;
            let lower = prefix.trim_end_matches([' ', '-']).to_lowercase();
            let scale = match (prefix, lower.as_str()) {
                (_, "") => 1.0,
                ("p", _) | (_, "pico") => 1e-12,
                ("n", _) | (_, "nano") => 1e-9,
                ("u" | "\u{b5}" | "\u{3bc}", _) | (_, "micro") => 1e-6,
                ("m", _) | (_, "milli") => 1e-3,
                ("k" | "K", _) | (_, "kilo") => 1e3,
                (_, "mega") => 1e6,
                _ => return None,
            };
            Some((quantity, scale))
        })
    }

    /// The other one.
    pub fn other(self) -> Quantity {
        match self {
            Quantity::Radiant => Quantity::Luminous,
            Quantity::Luminous => Quantity::Radiant,
        }
    }
}

/// A flux in both systems; `null` where it cannot be known without guessing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Flux {
    /// Radiant flux, W.
    pub radiant_w: Option<f64>,
    /// Luminous flux, lm.
    pub luminous_lm: Option<f64>,
}

impl Flux {
    /// The fluxes of sources that can be modelled, W or lm. Beyond them, sums, shares and densities leave the range of the 32-bit numbers of a
    /// model's files.
    pub const MODELLED: RangeInclusive<f64> = 1e-20..=1e24;

    /// Whether a source of this flux can be modelled: its primary flux lies in [`Flux::MODELLED`], and the other, which may be next to
    /// nothing as the lumens of infrared, is not above.
    pub fn is_modelled(&self) -> bool {
        let below = |flux: Option<f64>| flux.is_none_or(|flux| flux <= *Flux::MODELLED.end());
        Flux::MODELLED.contains(&self.primary()) && below(self.radiant_w) && below(self.luminous_lm)
    }

    /// The flux that weights rays where only one number is wanted: radiant where known, else luminous.
    /// Unit: [`Flux::primary_unit`].
    pub fn primary(&self) -> f64 {
        self.radiant_w.or(self.luminous_lm).unwrap_or(0.0)
    }

    /// The flux as `quantity`.
    pub fn of(&self, quantity: Quantity) -> Option<f64> {
        match quantity {
            Quantity::Radiant => self.radiant_w,
            Quantity::Luminous => self.luminous_lm,
        }
    }

    /// A flux of which only one quantity is known.
    pub fn only(quantity: Quantity, value: Option<f64>) -> Flux {
        match quantity {
            Quantity::Radiant => Flux { radiant_w: value, luminous_lm: None },
            Quantity::Luminous => Flux { radiant_w: None, luminous_lm: value },
        }
    }

    /// Unit of [`Flux::primary`].
    pub fn primary_unit(&self) -> &'static str {
        if self.radiant_w.is_some() { "W" } else { "lm" }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prefixes_of_flux_units() {
        for (unit, quantity, scale) in [
            ("W", Quantity::Radiant, 1.0),
            ("mW", Quantity::Radiant, 1e-3),
            ("uW", Quantity::Radiant, 1e-6),
            ("\u{b5}W", Quantity::Radiant, 1e-6),
            ("kW", Quantity::Radiant, 1e3),
            ("milliwatts", Quantity::Radiant, 1e-3),
            ("klm", Quantity::Luminous, 1e3),
            ("mlm", Quantity::Luminous, 1e-3),
            ("Lumens", Quantity::Luminous, 1.0),
        ] {
            assert_eq!(Quantity::from_unit(unit), Some((quantity, scale)), "{unit}");
        }
        for unit in ["MW", "Mlm", "cd", "W/m2", "", "mm", "lm/W", "xW"] {
            assert_eq!(Quantity::from_unit(unit), None, "{unit}");
        }
    }
}
