//! One rule for wavelengths, wherever they stand: in columns and records, in tables and headers, in spectrum files.

use std::ops::RangeInclusive;

/// Wavelengths of light, nm. Those in µm are a thousandth of these, and the two ranges do not overlap.
pub const LIGHT_NM: RangeInclusive<f64> = 100.0..=20_000.0;
/// Nanometres per micrometre.
pub const NM_PER_UM: f64 = 1000.0;
/// Share of the highest value of a spectrum down to which negative values are a spectrometer's dark noise; with room for f32.
const DARK_NOISE: f64 = 0.01 * (1.0 + 1e-6);

/// The unit a wavelength is written in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WavelengthUnit {
    /// nm.
    Nanometre,
    /// µm.
    Micrometre,
}

impl WavelengthUnit {
    /// Nanometres in one of it.
    pub fn nm(self) -> f64 {
        match self {
            WavelengthUnit::Nanometre => 1.0,
            WavelengthUnit::Micrometre => NM_PER_UM,
        }
    }

    /// Whether `value` in this unit is a wavelength of light.
    pub fn is_light(self, value: f64) -> bool {
        LIGHT_NM.contains(&(value * self.nm()))
    }

    /// The unit in which all of `values` are wavelengths of light; the first of them decides.
    ///
    /// # Errors
    /// The first value that is none: no light at all, or written in the other unit.
    pub fn of(values: impl IntoIterator<Item = f64>) -> Result<WavelengthUnit, f64> {
        let mut values = values.into_iter().peekable();
        let micrometres = values.peek().is_some_and(|first| WavelengthUnit::Micrometre.is_light(*first));
        let unit = if micrometres { WavelengthUnit::Micrometre } else { WavelengthUnit::Nanometre };
        values.find(|value| !unit.is_light(*value)).map_or(Ok(unit), Err)
    }
}

/// Whether a wavelength that is taken to be in nm is light only in µm, or only if nm were taken for µm.
pub fn is_of_another_unit(nm: f64) -> bool {
    LIGHT_NM.contains(&(nm * NM_PER_UM)) || LIGHT_NM.contains(&(nm / NM_PER_UM))
}

/// The lowest value that dark noise explains in a spectrum whose highest value is `most`.
pub fn lowest_dark(most: f64) -> f64 {
    -DARK_NOISE * most
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_unit_is_that_in_which_everything_is_light() {
        assert_eq!(WavelengthUnit::of([400.0, 700.0]), Ok(WavelengthUnit::Nanometre));
        assert_eq!(WavelengthUnit::of([0.4, 0.7]), Ok(WavelengthUnit::Micrometre));
        assert_eq!(WavelengthUnit::of([0.4, 700.0]), Err(700.0));
        assert_eq!(WavelengthUnit::of([400.0, 0.7]), Err(0.7));
        assert_eq!(WavelengthUnit::of([50.0]), Err(50.0));
        assert_eq!(WavelengthUnit::of([]), Ok(WavelengthUnit::Nanometre));
        assert!(WavelengthUnit::of([f64::NAN]).is_err());
        assert_eq!([0.5, 500_000.0, 500.0, 50.0, 30_000.0].map(is_of_another_unit), [true, true, false, false, false]);
    }
}
