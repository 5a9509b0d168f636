//! What stands before the rays of a Zemax file. It holds W, or lm, or W and a wavelength per ray, and one description.

use super::light::Light;
use super::{one_wavelength, refuse_color, tell_luminous};
use crate::error::Error;
use crate::formats::record::SpectralData;
use crate::formats::zemax::writer::{Header, Rows};
use crate::vocabulary::notice::Notices;

/// The header for the rays of `light`.
///
/// # Errors
/// `zemax.color_per_ray`, `zemax.too_many_rays`.
pub fn header(light: &Light<'_>, notices: &mut Notices) -> Result<Header, Error> {
    let rows = rows(light, notices)?;
    let ray_count = u32::try_from(light.ray_count).map_err(|_| {
        let found = format!("A Zemax file holds at most {} rays; these are {}.", u32::MAX, light.ray_count);
        Error::refused("zemax.too_many_rays", found, "Convert to TM-25, or take fewer rays (--take).")
    })?;
    let flux = if rows == Rows::Luminous { light.flux.luminous_lm } else { light.flux.radiant_w };
    let wavelength_nm = one_wavelength("Zemax", light, notices);
    Ok(Header { ray_count, description: light.name(), flux: flux.unwrap_or(0.0), wavelength_nm, rows })
}

/// What the rays will carry. Where W and lm are known, W is written: readers get lm from the spectrum.
fn rows(light: &Light<'_>, notices: &mut Notices) -> Result<Rows, Error> {
    refuse_color("zemax.color_per_ray", "Zemax", &light.spectral, false)?;
    tell_luminous("Zemax", light, notices);
    Ok(match &light.spectral {
        SpectralData::Wavelength => Rows::Spectral,
        _ if light.has_radiant => Rows::Radiant,
        _ => Rows::Luminous,
    })
}
