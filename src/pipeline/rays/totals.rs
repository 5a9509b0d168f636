//! Whether the totals of a source can be meant.

use super::conversion::{Sums, header_lm_per_w};
use super::survey::Survey;
use crate::error::Error;
use crate::formats::record::{Facts, SpectralData, TotalRule};
use crate::vocabulary::notice::Notices;
use crate::vocabulary::units::Flux;

/// Header and rays differ by more than rounding of f32 sums.
pub const RATIO_NOTICED: f64 = 1e-3;
/// Header efficacy and spectrum differ by more than coarse tables explain (OSRAM's own: 1.6 %, `pipeline/formats/README.md` 1).
pub const EFFICACY_NOTICED: f64 = 0.05;
/// Boxes larger or smaller than this, mm, are seldom light sources but often wrong units.
pub const LIKELY_SIZE_MM: (f64, f64) = (1e-3, 1e3);

/// Code of the notice that a box looks like a wrong unit.
pub const UNLIKELY_SIZE: &str = "rays.unlikely_size";

/// Ray sum over header total, of the quantity that is both stored per ray and in the header.
pub fn ratio(facts: &Facts, sums: &Sums) -> Option<f64> {
    let radiant = facts.header_flux.radiant_w.filter(|_| facts.has_radiant).map(|header| sums.radiant / header);
    let luminous = facts.header_flux.luminous_lm.filter(|_| facts.has_luminous).map(|header| sums.luminous / header);
    radiant.or(luminous)
}

/// Compares header, rays and spectrum; tells what disagrees.
///
/// # Errors
/// `rays.no_flux` when the total is not a positive number.
pub fn judge(facts: &Facts, sums: &Sums, flux: &Flux, notices: &mut Notices) -> Result<(), Error> {
    let rule = match facts.total_rule {
        TotalRule::Header => "the header's total holds and the rays were scaled to it",
        TotalRule::RaySum => "in this format the rays hold and the header was not believed",
    };
    judge_by(rule, facts, sums, flux, notices)
}

/// As [`judge`], where a declared flux holds and neither header nor rays do.
///
/// # Errors
/// As [`judge`].
pub fn judge_declared(facts: &Facts, sums: &Sums, flux: &Flux, notices: &mut Notices) -> Result<(), Error> {
    judge_by("the declared flux holds", facts, sums, flux, notices)
}

fn judge_by(rule: &str, facts: &Facts, sums: &Sums, flux: &Flux, notices: &mut Notices) -> Result<(), Error> {
    if !(flux.primary() > 0.0 && flux.primary().is_finite()) {
        let found = format!("The total flux is {} {}.", flux.primary(), flux.primary_unit());
        return Err(Error::refused("rays.no_flux", found, "Export the file again with flux per ray."));
    }
    let largest = flux.radiant_w.unwrap_or(0.0).max(flux.luminous_lm.unwrap_or(0.0));
    let (total, unit) = (flux.primary(), flux.primary_unit());
    let (least, most) = (Flux::MODELLED.start(), Flux::MODELLED.end());
    let remedy =
        "Export the file again, if its flux is damaged; or declare the source's flux as its data sheet has it.";
    if largest > *most {
        let found =
            format!("The total flux is {total:e} {unit}, more than the {most:e} that the numbers of a model hold.");
        return Err(Error::refused("rays.flux_too_large", found, remedy));
    }
    if total < *least {
        let found =
            format!("The total flux is {total:e} {unit}, less than the {least:e} that the numbers of a model hold.");
        return Err(Error::refused("rays.flux_too_small", found, remedy));
    }
    if let Some(ratio) = ratio(facts, sums).filter(|ratio| (ratio - 1.0).abs() > RATIO_NOTICED) {
        let times = six_digits(ratio);
        notices.add("rays.total_ratio", format!("The rays sum to {times} times the header's total; {rule}."));
    }
    judge_efficacy(facts, flux, notices);
    Ok(())
}

/// `value`, positive, to six digits: more are rounding of f32 sums.
fn six_digits(value: f64) -> f64 {
    let scale = 10_f64.powf((5.0 - value.log10().floor()).max(0.0));
    let rounded = (value * scale).round() / scale;
    if rounded.is_finite() { rounded } else { value }
}

/// What the spectrum alone says, lm/W; `flux` are the totals of the rays.
pub fn spectrum_lm_per_w(facts: &Facts, flux: &Flux) -> Option<f64> {
    match &facts.spectral {
        SpectralData::Table(table) => Some(table.lm_per_w()),
        SpectralData::Tables(_) | SpectralData::Wavelength => {
            flux.luminous_lm.zip(flux.radiant_w).filter(|(_, radiant)| *radiant > 0.0).map(|(l, r)| l / r)
        }
        SpectralData::None | SpectralData::Tristimulus => None,
    }
}

/// The header's lm/W against the spectrum's, where a spectrum is there to compare.
fn judge_efficacy(facts: &Facts, flux: &Flux, notices: &mut Notices) {
    if let (Some(header), Some(spectrum)) = (header_lm_per_w(facts), spectrum_lm_per_w(facts, flux))
        && (header - spectrum).abs() > EFFICACY_NOTICED * header.max(spectrum)
    {
        let told = format!("The header's totals give {header:.1} lm/W, the spectrum gives {spectrum:.1} lm/W.");
        notices.add("rays.efficacy_differs", told);
    }
}

/// Tells when the box of the origins looks like a wrong unit.
pub fn notice_size(survey: &Survey, notices: &mut Notices) {
    let size = survey.bounds_mm.size().max_element();
    if size > LIKELY_SIZE_MM.1 || (size > 0.0 && size < LIKELY_SIZE_MM.0) {
        let told = format!("The origins span {size} mm: the length unit of the file may be wrong.");
        notices.add(UNLIKELY_SIZE, told);
    }
}
