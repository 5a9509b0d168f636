//! What can be said of a ray file before anybody makes a model of it: at its first bytes, at its header, after its rays.

/// The point nearest to all ray lines.
pub mod focus;
/// Whether rays are in random order.
pub mod order;
/// Intensity in the planes of the axes.
pub mod far_field;
/// What is collected in the one pass.
pub mod sample;
/// Planes, boxes and spheres that origins lie on.
pub mod origins;
/// The beam: its axis and how wide it is.
pub mod beam;
/// One verdict per check.
pub mod checks;
/// Origins and far field of a ray file.
pub mod drawings;
/// What an inspection found, as it is written: the header, the rays, a verdict for each check.
pub mod findings;

use crate::error::{Error, Fault};
use crate::formats::record::{Facts, RaySet};
use crate::rays::conversion::Conversion;
use crate::rays::declared::open;
use crate::rays::survey::{Reading, Survey, survey};
use crate::rays::{Input, bands, check, totals};
use crate::vocabulary::declaration::Total;
use crate::vocabulary::limits::Limits;
use crate::vocabulary::notice::Notices;
use crate::vocabulary::space::Axis;
use crate::vocabulary::spectrum::{Bands, wider};
use crate::vocabulary::units::{Flux, LengthUnit};
use crate::vocabulary::watch::StageWatch;
use beam::{Beam, BeamWidth, brightest};
use checks::{TOLD_BY_READING, checks};
use findings::{Check, Verdict};
use findings::{Directions, Extent, Header, Hemisphere, Inspection, JobEstimate, MainDirection, Noise, RayFlux, Text};
use focus::Focus;
use glam::DVec3;
use sample::Evidence;
use std::sync::Arc;

/// Most texts of a file that are shown.
const MOST_TEXTS: usize = 256;
/// Most bytes of them together.
const MOST_TEXT_BYTES: usize = 64 << 10;

/// The header of a file, checked against the length of the file.
///
/// # Errors
/// As [`open`].
pub fn header(input: &Input, limits: &Limits) -> Result<Header, Error> {
    Ok(Header::of(&open(Arc::clone(&input.bytes), &input.declared, limits)?.facts, input.bytes.len()))
}

/// Reads a whole file once and tells what is in it. A file whose rays a job would refuse is inspected too; the refusal is
/// one of the findings.
///
/// # Errors
/// As [`open`]; [`Error::Malformed`] where a record has no meaning; [`Error::Cancelled`].
pub fn inspect(input: &Input, limits: &Limits, watch: StageWatch<'_>) -> Result<Inspection, Error> {
    let set = open(Arc::clone(&input.bytes), &input.declared, limits)?;
    let bands: Bands = bands::asked(&crate::options::RaysOptions::default())?.into_bands();
    let radiant = Conversion::of(&set.facts).knows_radiant();
    let (reading, evidence) = observed(&set, radiant, &bands, watch)?;
    let limit = reading.judge(limits);
    // A share is one of a total that is not known here.
    let declared = input.declared.flux.filter(|flux| flux.share().is_none());
    let declared = declared.map(|flux| Total::from_override(flux, 0.0));
    let inspection = Inspection::of(&set.facts, input.bytes.len(), radiant, &reading, evidence, limit, declared)?;
    let notices = inspection.notices.iter().chain(&input.notices).cloned().collect();
    Ok(Inspection { notices, ..inspection })
}

/// Reads every ray of `set` once: what its survey says, and what the checks need besides.
///
/// # Errors
/// [`Error::Cancelled`]; as [`crate::formats::record::Records::read`].
pub fn observed(
    set: &RaySet,
    radiant: bool,
    bands: &Bands,
    watch: StageWatch<'_>,
) -> Result<(Reading, Evidence), Error> {
    let (count, pivot) = (set.facts.ray_count, pivot(set)?);
    survey(set, radiant, bands, watch, || Evidence::new(count, pivot))
}

/// What a user should know of a channel before its model is trusted: every check that is not ok, except for those that reading
/// the channel reports already ([`TOLD_BY_READING`]). `radiant`: the rays are weighted by W instead of lm.
///
/// # Errors
/// None in practice: a channel that was read has passed every rule that could fail here.
pub fn findings(
    facts: &Facts,
    byte_count: u64,
    radiant: bool,
    reading: &Reading,
    evidence: Evidence,
) -> Result<Notices, Error> {
    let inspection = Inspection::of(facts, byte_count, radiant, reading, evidence, Ok(()), None)?;
    let mut notices = Notices::default();
    let odd = |check: &&Check| check.verdict != Verdict::Ok && !TOLD_BY_READING.contains(&check.check);
    for check in inspection.checks.iter().filter(odd) {
        let sentences = [Some(check.message.as_str()), check.remedy.as_deref()];
        notices.add(check.check, sentences.into_iter().flatten().collect::<Vec<_>>().join(" "));
    }
    Ok(notices)
}

/// Where the first ray starts: positions are summed relative to it.
fn pivot(set: &RaySet) -> Result<DVec3, Error> {
    let mut first = Vec::new();
    set.records.read(0, set.facts.ray_count.min(1) as usize, &mut first)?;
    let origin = first.first().map_or(DVec3::ZERO, |ray| DVec3::from_array(ray.origin_mm));
    Ok(if origin.is_finite() { origin } else { DVec3::ZERO })
}

/// The texts that are shown, within bounds: what is kept of a file must not grow with its comments. And whether there are more.
fn shown(texts: &[(String, String)]) -> (Vec<Text>, bool) {
    let mut left = MOST_TEXT_BYTES;
    let filled = texts.iter().filter(|(_, value)| !value.is_empty());
    let fits = |(name, value): &&(String, String)| {
        let room = left.checked_sub(name.len() + value.len());
        left = room.unwrap_or(left);
        room.is_some()
    };
    let count = filled.clone().count();
    let shown: Vec<Text> = filled
        .take_while(fits)
        .take(MOST_TEXTS)
        .map(|(name, value)| Text { name: name.clone(), value: value.clone() })
        .collect();
    let cut = shown.len() < count;
    (shown, cut)
}

impl Header {
    fn of(facts: &Facts, byte_count: u64) -> Header {
        let (shown, cut) = shown(&facts.texts);
        let mut notices = facts.notices.clone();
        if cut {
            let told = format!(
                "The file has more than {MOST_TEXTS} texts or {MOST_TEXT_BYTES} bytes of them; the rest is not shown."
            );
            notices.add("rays.texts_cut", told);
        }
        Header {
            format: facts.format,
            byte_count,
            ray_count: facts.ray_count,
            flux: facts.header_flux,
            total_rule: facts.total_rule,
            has_radiant: facts.has_radiant,
            has_luminous: facts.has_luminous,
            spectrum: facts.spectral.name(),
            length_unit: facts.length_unit.map(LengthUnit::symbol),
            quantity_unknown: facts.quantity_unknown,
            table_range_nm: facts.spectral.tables().iter().fold(None, |all, table| wider(all, Some(table.range_nm()))),
            texts: shown,
            notices: notices.to_vec(),
        }
    }
}

/// What a rule of ours says against the rays; other errors go on.
fn fault(judged: Result<(), Error>) -> Result<Option<Fault>, Error> {
    match judged {
        Ok(()) => Ok(None),
        Err(Error::Refused(fault) | Error::Unusable(fault)) => Ok(Some(fault)),
        Err(error) => Err(error),
    }
}

impl Inspection {
    fn of(
        facts: &Facts,
        byte_count: u64,
        radiant: bool,
        reading: &Reading,
        evidence: Evidence,
        judged: Result<(), Error>,
        declared: Option<Total>,
    ) -> Result<Inspection, Error> {
        let mut notices = Notices::default();
        notices.merge(&facts.notices);
        notices.merge(&reading.notices);
        let as_stored = Conversion::of(facts).scaled(facts, &reading.sums);
        let fixed = declared.map_or(Ok(as_stored.clone()), |total| as_stored.clone().fixed(&reading.sums, total));
        let (conversion, refused) = fixed.map_or_else(|error| (as_stored, Err(error)), |fixed| (fixed, Ok(())));
        let flux = conversion.totals(&reading.sums);
        let judge = if declared.is_some() { totals::judge_declared } else { totals::judge };
        let fault = fault(judged)?.or(fault(refused)?);
        let fault = fault.or(self::fault(judge(facts, &reading.sums, &flux, &mut notices))?);
        totals::notice_size(&reading.survey, &mut notices);
        let survey = &reading.survey;
        let lit = survey.rays_used > 0;
        let shares = survey.directions.hemispheres();
        let effective_rays = evidence.focus.effective_rays();
        let focus = evidence.focus.solve(evidence.pivot);
        let (distance_99_mm, median_origin_distance_mm) =
            focus.map_or((0.0, 0.0), |focus| distances(&evidence, DVec3::from_array(focus.point_mm)));
        let mut inspection = Inspection {
            verdict: Verdict::Ok,
            checks: Vec::new(),
            header: Header::of(facts, byte_count),
            rays_used: survey.rays_used,
            rays_refused: reading.refused,
            rays_dropped: reading.dropped,
            radiant_sum: facts.has_radiant.then_some(survey.radiant_sum),
            luminous_sum: facts.has_luminous.then_some(survey.luminous_sum),
            sum_over_header: totals::ratio(facts, &reading.sums),
            flux,
            lm_per_w: flux.luminous_lm.zip(flux.radiant_w).filter(|(_, w)| *w > 0.0).map(|(lm, w)| lm / w),
            spectrum_lm_per_w: totals::spectrum_lm_per_w(facts, &flux),
            origins_mm: lit
                .then(|| Extent { min: survey.bounds_mm.min.to_array(), max: survey.bounds_mm.max.to_array() }),
            centroid_mm: lit.then(|| survey.centroid_mm.to_array()),
            wavelength_nm: survey.wavelength_nm,
            directions: Directions {
                worst_length_error: evidence.worst_length_error,
                repaired: reading.notices.count_of(check::NORMALIZED),
            },
            order: lit.then(|| evidence.order.judge()),
            ray_flux: lit.then(|| ray_flux(&evidence, conversion.scale(radiant), radiant, &flux)),
            noise: (effective_rays > 0.0).then(|| Noise {
                of_2500_cells: (2500.0 / effective_rays).sqrt(),
                cells_at_5_percent: 0.05_f64.powi(2) * effective_rays,
            }),
            focus: focus.map(|focus| Focus { distance_99_mm, ..focus }),
            origins: origins::origins(&evidence.sample, survey.rays_used),
            median_origin_distance_mm,
            main_direction: main_direction(evidence.focus.mean_direction(), &shares),
            hemispheres: std::array::from_fn(|k| Hemisphere { axis: Axis::ALL[k], share: shares[k] }),
            beam: beam_width(&evidence, survey),
            job: JobEstimate::of(survey.rays_used),
            notices: notices.to_vec(),
            evidence,
        };
        inspection.checks = checks(facts, &inspection, fault.as_ref(), declared.is_some());
        inspection.verdict = inspection.checks.iter().map(|check| check.verdict).max().unwrap_or(Verdict::Ok);
        Ok(inspection)
    }
}

/// Over the sample: the distance from `focus` that the lines of 99 % of the flux come within, and the median distance of
/// the origins; mm.
fn distances(evidence: &Evidence, focus: DVec3) -> (f64, f64) {
    let mut lines = Vec::with_capacity(evidence.sample.len());
    let mut starts = Vec::with_capacity(evidence.sample.len());
    for ray in &evidence.sample {
        let away = ray.origin_mm - focus;
        lines.push((away.cross(ray.direction).length(), ray.weight));
        starts.push(away.length());
    }
    lines.sort_by(|a, b| a.0.total_cmp(&b.0));
    starts.sort_by(f64::total_cmp);
    let enough = 0.99 * lines.iter().map(|(_, weight)| weight).sum::<f64>();
    let mut seen = 0.0;
    let last = lines.iter().find(|(_, weight)| {
        seen += weight;
        seen >= enough
    });
    (last.map_or(0.0, |(distance, _)| *distance), starts.get(starts.len() / 2).copied().unwrap_or(0.0))
}

/// `scale`: from the weights that were collected to W where `radiant`, else to lm.
fn ray_flux(evidence: &Evidence, scale: f64, radiant: bool, flux: &Flux) -> RayFlux {
    let (smallest, largest) = evidence.weights;
    let (unit, total) = if radiant { ("W", flux.radiant_w) } else { ("lm", flux.luminous_lm) };
    RayFlux {
        unit,
        smallest: scale * smallest,
        largest: scale * largest,
        equal: largest - smallest <= 1e-6 * largest,
        largest_share: total.filter(|total| *total > 0.0).map_or(0.0, |total| scale * largest / total),
        effective_rays: evidence.focus.effective_rays(),
    }
}

fn beam_width(evidence: &Evidence, survey: &Survey) -> Option<BeamWidth> {
    let rays: Vec<(DVec3, f64)> = evidence.sample.iter().map(|ray| (ray.direction, ray.weight)).collect();
    Beam::of(&rays, brightest(&survey.directions)).map(|beam| beam.width())
}

fn main_direction(mean: DVec3, shares: &[f64; 6]) -> Option<MainDirection> {
    (shares.iter().sum::<f64>() > 0.0).then(|| {
        let axis = Axis::nearest(mean);
        let behind = Axis::ALL.iter().position(|other| other.vector() == -axis.vector());
        let backward_share = behind.and_then(|k| shares.get(k)).copied().unwrap_or(0.0);
        MainDirection { axis, mean_cosine: mean.length(), backward_share }
    })
}

impl JobEstimate {
    /// A constant part for hull, zones and files, and a part per ray. Measured on a 2-core x86-64 of 2020: 1.5 s and 33 MB for
    /// 2e5 rays of a flat chip, 8 s and 29 MB for 2e6 of four chips, 11 s and 30 MB for 2e6 of a glowing cylinder. The
    /// range is wide: half to four times as fast or slow, and room for options and large files' tables.
    fn of(rays: u64) -> JobEstimate {
        const MEMORY_BYTES: (u64, u64) = (30_000_000, 250_000_000);
        const CONSTANT_S: (f64, f64) = (0.3, 4.0);
        const PER_RAY_S: (f64, f64) = (2e-6, 2e-5);
        let rays = rays as f64;
        let core_seconds = (CONSTANT_S.0 + PER_RAY_S.0 * rays, CONSTANT_S.1 + PER_RAY_S.1 * rays);
        JobEstimate { memory_bytes: MEMORY_BYTES, core_seconds }
    }
}
