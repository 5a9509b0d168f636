//! What stands before the rays of a Zemax file. It holds W, or lm, or W and a wavelength per ray, and one description.

use super::labels::{called, total};
use crate::error::Error;
use crate::formats::record::{Facts, SpectralData};
use crate::formats::zemax::writer::{Header, Rows};
use crate::rays::Input;
use crate::source::Channel;
use crate::vocabulary::notice::Notices;

/// The header for the rays of `channel`.
///
/// # Errors
/// `zemax.color_per_ray`, `zemax.too_many_rays`.
pub fn header(input: &Input, channel: &Channel, notices: &mut Notices) -> Result<Header, Error> {
    let facts = channel.facts();
    let rows = rows(facts, notices)?;
    let ray_count = u32::try_from(channel.survey.rays_used).map_err(|_| {
        let found = format!("A Zemax file holds at most {} rays; these are {}.", u32::MAX, channel.survey.rays_used);
        Error::refused("zemax.too_many_rays", found, "Convert to TM-25.")
    })?;
    let flux = total(channel, |flux| if rows == Rows::Luminous { flux.luminous_lm } else { flux.radiant_w });
    Ok(Header {
        ray_count,
        description: called(input, facts).to_owned(),
        flux: flux.unwrap_or(0.0),
        wavelength_nm: one_wavelength(facts, notices),
        rows,
    })
}

/// What the rays will carry. Where W and lm are known, W is written: readers get lm from the spectrum.
fn rows(facts: &Facts, notices: &mut Notices) -> Result<Rows, Error> {
    let no = |found: &str| {
        let remedy = "Convert to TM-25, which holds it.";
        Err(Error::refused("zemax.color_per_ray", found, remedy))
    };
    match &facts.spectral {
        SpectralData::Tables(_) => no("Each ray names its spectral table, which a Zemax file cannot hold."),
        SpectralData::Tristimulus => no("Each ray has a tristimulus colour, which a Zemax file cannot hold."),
        SpectralData::Wavelength => {
            if facts.has_luminous {
                left_out(notices, "lm follow from W and the wavelength");
            }
            Ok(Rows::Spectral)
        }
        SpectralData::None | SpectralData::Table(_) if facts.has_radiant => {
            if facts.has_luminous {
                left_out(notices, "W were written");
            }
            Ok(Rows::Radiant)
        }
        SpectralData::None | SpectralData::Table(_) => Ok(Rows::Luminous),
    }
}

fn left_out(notices: &mut Notices, why: &str) {
    let told = format!("Rays of a Zemax file have one flux: {why}, and the lm of the file were left out.");
    notices.add("convert.luminous_left_out", told);
}

/// The one wavelength of all rays. A spectrum has no place: users keep it in a file beside (.spcd).
fn one_wavelength(facts: &Facts, notices: &mut Notices) -> Option<f64> {
    let SpectralData::Table(table) = &facts.spectral else { return None };
    let (first, last) = table.range_nm();
    if first == last {
        return Some(first);
    }
    let told = "A Zemax file has no place for the spectrum of its rays; keep it beside the file.";
    notices.add("convert.spectrum_left_out", told);
    None
}
