//! What stands before the rays of a LightTools file. It holds W or lm, each with a wavelength per ray, or tristimulus values.

use super::light::Light;
use super::{one_wavelength, refuse_color, tell_luminous};
use crate::error::Error;
use crate::formats::lighttools::writer::{Color, Header, Rows};
use crate::formats::record::SpectralData;
use crate::vocabulary::notice::Notices;

/// The header for the rays of `light`.
///
/// # Errors
/// `lighttools.color_per_ray`.
pub fn header(light: &Light<'_>, notices: &mut Notices) -> Result<Header, Error> {
    refuse_color("lighttools.color_per_ray", "LightTools", &light.spectral, true)?;
    let color = match light.spectral {
        SpectralData::Wavelength => Color::Wavelength,
        SpectralData::Tristimulus => Color::Tristimulus,
        _ if one_wavelength("LightTools", light, notices).is_some() => Color::Wavelength,
        _ => Color::None,
    };
    let luminous = color == Color::Tristimulus || !light.has_radiant;
    if !luminous {
        tell_luminous("LightTools", light, notices);
    } else if light.has_radiant {
        let told = "Tristimulus values of a LightTools file are lm; the W of the rays were left out.";
        notices.add("convert.radiant_left_out", told);
    }
    let flux = if luminous { light.flux.luminous_lm } else { light.flux.radiant_w };
    Ok(Header { ray_count: light.ray_count, flux: flux.unwrap_or(0.0), rows: Rows { luminous, color } })
}
