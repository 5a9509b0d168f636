//! What stands before the rays of a Zemax file. It holds W, or lm, or W and a wavelength per ray, and one description.

use super::light::{Light, TO_TM25};
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
    let wavelength_nm = light.one_wavelength("Zemax", notices);
    Ok(Header { ray_count, description: light.name(), flux: flux.unwrap_or(0.0), wavelength_nm, rows })
}

/// What the rays will carry. Where W and lm are known, W is written: readers get lm from the spectrum.
fn rows(light: &Light<'_>, notices: &mut Notices) -> Result<Rows, Error> {
    if let Some(what) = light.too_colorful(false) {
        let found = format!("Each ray has its {what}, which a Zemax file cannot hold.");
        return Err(Error::refused("zemax.color_per_ray", found, TO_TM25));
    }
    light.tell_luminous("Zemax", notices);
    Ok(match &light.spectral {
        SpectralData::Wavelength => Rows::Spectral,
        _ if light.has_radiant => Rows::Radiant,
        _ => Rows::Luminous,
    })
}
