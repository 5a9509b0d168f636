//! What stands before the rays of a LightTools file. It holds W or lm, each with a wavelength per ray, or tristimulus values.

use super::light::{Light, TO_TM25};
use crate::error::Error;
use crate::formats::lighttools::writer::{Color, Header, Rows};
use crate::formats::record::SpectralData;
use crate::vocabulary::notice::Notices;

/// The header for the rays of `light`.
///
/// # Errors
/// `lighttools.color_per_ray`.
pub fn header(light: &Light<'_>, notices: &mut Notices) -> Result<Header, Error> {
    if let Some(what) = light.too_colorful(true) {
        let found = format!("Each ray has its {what}, which a LightTools file cannot hold.");
        return Err(Error::refused("lighttools.color_per_ray", found, TO_TM25));
    }
    let color = match light.spectral {
        SpectralData::Wavelength => Color::Wavelength,
        SpectralData::Tristimulus => Color::Tristimulus,
        _ if light.one_wavelength("LightTools", notices).is_some() => Color::Wavelength,
        _ => Color::None,
    };
    let luminous = color == Color::Tristimulus || !light.has_radiant;
    if !luminous {
        light.tell_luminous("LightTools", notices);
    } else if light.has_radiant {
        let told = "Tristimulus values of a LightTools file are lm; the W of the rays were left out.";
        notices.add("convert.radiant_left_out", told);
    }
    let flux = if luminous { light.flux.luminous_lm } else { light.flux.radiant_w };
    Ok(Header { ray_count: light.ray_count, flux: flux.unwrap_or(0.0), rows: Rows { luminous, color } })
}
