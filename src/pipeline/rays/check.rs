//! What a ray must satisfy. Refused: it cannot be meant. Dropped: it carries no light. Repaired: its direction is normalised.

use super::conversion::Conversion;
use crate::formats::proof::LENGTH_TOLERANCE;
use crate::formats::record::{Facts, RawRay, SpectralData};
use crate::vocabulary::wavelength::is_of_another_unit;
use glam::DVec3;

/// Errors of length above this are told: text with 6 decimals stays below it.
const LENGTH_NOTICED: f64 = 1e-5;

/// Code of the notice for a direction that was off by more than text rounding.
pub const NORMALIZED: &str = "rays.direction_normalized";
/// Sentence of [`NORMALIZED`].
pub const NORMALIZED_MESSAGE: &str = "The direction was not of unit length; it was normalised.";
/// Code of the notice for a negative tristimulus X or Z.
pub const NEGATIVE_XZ: &str = "rays.tristimulus_negative";
/// Sentence of [`NEGATIVE_XZ`].
pub const NEGATIVE_XZ_MESSAGE: &str = "Tristimulus X or Z was negative; it was set to 0.";

/// Why a ray does not go on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Flaw {
    /// A number is NaN or infinite.
    NotFinite,
    /// | |k| − 1 | > 1e-3.
    DirectionLength,
    /// Flux below 0.
    NegativeFlux,
    /// Flux of 0: dropped, not refused.
    NoFlux,
    /// Not a positive wavelength.
    Wavelength,
    /// A wavelength that is light only in another unit than those of the other rays.
    NotLight,
    /// No such spectral table.
    TableIndex,
    /// Lumens from a spectrum that has none: its W cannot be known.
    InvisibleLumens,
}

impl Flaw {
    /// Stable code.
    pub fn code(self) -> &'static str {
        match self {
            Flaw::NotFinite => "rays.not_finite",
            Flaw::DirectionLength => "rays.direction_length",
            Flaw::NegativeFlux => "rays.flux_negative",
            Flaw::NoFlux => "rays.flux_zero",
            Flaw::Wavelength => "rays.wavelength",
            Flaw::NotLight => "rays.not_light",
            Flaw::TableIndex => "rays.table_index",
            Flaw::InvisibleLumens => "rays.invisible_lumens",
        }
    }

    /// What was found and done.
    pub fn message(self) -> &'static str {
        match self {
            Flaw::NotFinite => "A position, direction or flux is not a finite number; the ray was refused.",
            Flaw::DirectionLength => "The direction is not a unit vector within 0.001; the ray was refused.",
            Flaw::NegativeFlux => "The flux is negative; the ray was refused.",
            Flaw::NoFlux => "The flux is 0; the ray was dropped.",
            Flaw::Wavelength => "The wavelength is not a positive number; the ray was refused.",
            Flaw::NotLight => {
                "The wavelength is light only in another unit than nm, as which those of the rays were read; the ray was refused."
            }
            Flaw::TableIndex => "The ray names a spectral table the file does not have; it was refused.",
            Flaw::InvisibleLumens => "The ray has lumens at a wavelength nobody can see; it was refused.",
        }
    }

    /// Dropped, not refused.
    pub fn is_harmless(self) -> bool {
        self == Flaw::NoFlux
    }
}

/// A ray that goes on.
#[derive(Clone, Copy, Debug)]
pub struct Checked {
    /// Unit direction.
    pub direction: DVec3,
    /// `[W, lm]`, scaled; 0 where unknown.
    pub flux: [f64; 2],
    /// Tristimulus X and Z, lm, not negative.
    pub xz_lm: [f64; 2],
    /// How far the direction's length was from 1.
    pub length_error: f64,
    /// The direction was repaired by more than text rounding.
    pub normalized: bool,
    /// X or Z was set to 0.
    pub xz_repaired: bool,
}

/// Checks one ray.
///
/// # Errors
/// The first [`Flaw`] found.
pub fn check(facts: &Facts, conversion: &Conversion, raw: &RawRay) -> Result<Checked, Flaw> {
    let direction = DVec3::from_array(raw.direction);
    let finite = DVec3::from_array(raw.origin_mm).is_finite()
        && direction.is_finite()
        && (raw.radiant + raw.luminous + raw.xz[0] + raw.xz[1]).is_finite();
    if !finite {
        return Err(Flaw::NotFinite);
    }
    let length = direction.length();
    let off = (length - 1.0).abs();
    if off > LENGTH_TOLERANCE {
        return Err(Flaw::DirectionLength);
    }
    if raw.radiant < 0.0 || raw.luminous < 0.0 {
        return Err(Flaw::NegativeFlux);
    }
    if raw.radiant == 0.0 && raw.luminous == 0.0 {
        return Err(Flaw::NoFlux);
    }
    match &facts.spectral {
        SpectralData::Wavelength if !(raw.wavelength_nm > 0.0 && raw.wavelength_nm.is_finite()) => {
            return Err(Flaw::Wavelength);
        }
        SpectralData::Wavelength if is_of_another_unit(raw.wavelength_nm) => return Err(Flaw::NotLight),
        SpectralData::Tables(tables) if raw.table as usize >= tables.len() => return Err(Flaw::TableIndex),
        _ => {}
    }
    let flux = conversion.flux(raw);
    if conversion.knows_radiant() && flux[0] == 0.0 && !facts.has_radiant {
        return Err(Flaw::InvisibleLumens);
    }
    let xz = conversion.xz_lm(raw);
    Ok(Checked {
        direction: direction / length,
        flux,
        xz_lm: xz.map(|value| value.max(0.0)),
        length_error: off,
        normalized: off > LENGTH_NOTICED,
        xz_repaired: xz[0] < 0.0 || xz[1] < 0.0,
    })
}
