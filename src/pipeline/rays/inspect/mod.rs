//! What can be said of a ray file before anybody makes a model of it: at its first bytes, at its header, after its rays.

/// The point nearest to all ray lines.
pub mod focus;
/// Whether rays are in random order.
pub mod order;
/// Intensity in the planes of the axes.
pub mod far_field;
/// What is collected in the one pass.
pub mod evidence;
/// Planes, boxes and spheres that origins lie on.
pub mod origins;
/// One verdict per check.
pub mod checks;

use super::super::vocabulary::limits::Limits;
use super::super::vocabulary::notice::{Notice, Notices};
use super::super::vocabulary::space::Axis;
use super::super::vocabulary::spectrum::Bands;
use super::super::vocabulary::units::{Flux, LengthUnit};
use super::super::vocabulary::watch::StageWatch;
use super::super::{Error, error::Fault};
use super::conversion::Conversion;
use super::survey::{Reading, survey, wider};
use super::{Bytes, Facts, Format, Input, RaySet, TotalRule, bands, check, detect, open, totals};
use checks::{Check, TOLD_BY_READING, Verdict, checks};
use evidence::Evidence;
use focus::Focus;
use glam::DVec3;
use order::Order;
use origins::Origins;
use serde::Serialize;
use std::io;
use std::sync::Arc;

/// Most texts of a file that are shown.
const MOST_TEXTS: usize = 256;
/// Most bytes of them together.
const MOST_TEXT_BYTES: usize = 64 << 10;

/// A name and what the file says under it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Text {
    /// Name of the field.
    pub name: String,
    /// Its content.
    pub value: String,
}

/// What a file says of itself; no ray was read for it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Header {
    /// The format it is.
    pub format: Format,
    /// Length of the file.
    pub byte_count: u64,
    /// Rays in the file, proven by its length.
    pub ray_count: u64,
    /// Totals of the header; `null` where it has none.
    pub flux: Flux,
    /// Which total holds in this format.
    pub total_rule: TotalRule,
    /// Rays carry W.
    pub has_radiant: bool,
    /// Rays carry lm.
    pub has_luminous: bool,
    /// What the rays carry of the spectrum: "none", "table", "wavelength per ray", "table per ray", "tristimulus".
    pub spectrum: &'static str,
    /// Unit of length as the file or the user says: "mm", …; `null` where neither does.
    pub length_unit: Option<&'static str>,
    /// Neither it nor the user says whether its flux is W or lm.
    pub quantity_unknown: bool,
    /// Wavelengths of its tables, nm; `null` without tables.
    pub table_range_nm: Option<(f64, f64)>,
    /// Everything else, in the file's order.
    pub texts: Vec<Text>,
    /// What was odd about the header and yet read.
    pub notices: Vec<Notice>,
}

/// A box, mm.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Extent {
    /// Smallest coordinates, mm.
    pub min: [f64; 3],
    /// Largest coordinates, mm.
    pub max: [f64; 3],
}

/// Share of the flux that goes to one side.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Hemisphere {
    /// Its middle.
    pub axis: Axis,
    /// Share of the flux, 0..=1.
    pub share: f64,
}

/// Lengths of directions as stored.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Directions {
    /// Largest | |k| − 1 |, refused rays included.
    pub worst_length_error: f64,
    /// Directions off by more than text rounding (1e-5) that were normalised.
    pub repaired: u64,
}

/// Where most of the light goes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct MainDirection {
    /// The axis nearest the flux vector Σ w d.
    pub axis: Axis,
    /// |Σ w d| / Σ w: 1 for a collimated beam, 2/3 for a Lambertian surface, 0 for light into all directions.
    pub mean_cosine: f64,
    /// Share of the flux that goes into the hemisphere opposite to `axis`, 0..=1.
    pub backward_share: f64,
}

/// How the flux is spread over rays.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RayFlux {
    /// "W" or "lm".
    pub unit: &'static str,
    /// Smallest flux of a ray.
    pub smallest: f64,
    /// Largest flux of a ray.
    pub largest: f64,
    /// Smallest and largest differ by rounding of f32 only.
    pub equal: bool,
    /// Largest over total.
    pub largest_share: f64,
    /// (Σ w)² / Σ w²: how many rays of equal flux would be as noisy.
    pub effective_rays: f64,
}

/// Monte-Carlo noise of what is made of these rays: a cell that gets n effective rays is known to 1/√n.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Noise {
    /// Relative noise of a picture of 50 x 50 cells, evenly lit.
    pub of_2500_cells: f64,
    /// Cells of a picture with 5 % noise: 400 effective rays each.
    pub cells_at_5_percent: f64,
}

/// What a job with this file alone is likely to take, with default options: (least, most).
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct JobEstimate {
    /// Peak memory, bytes. Does not grow with the rays.
    pub memory_bytes: (u64, u64),
    /// Seconds of one core; a job spreads over the cores it is given.
    pub core_seconds: (f64, f64),
}

/// A file's header and what its rays say.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Inspection {
    /// The worst of the checks.
    pub verdict: Verdict,
    /// One verdict per check, in reading order.
    pub checks: Vec<Check>,
    /// What the file says of itself.
    pub header: Header,
    /// Rays that can be used.
    pub rays_used: u64,
    /// Rays that cannot be meant.
    pub rays_refused: u64,
    /// Rays without flux.
    pub rays_dropped: u64,
    /// Sum of the stored radiant values: W, or relative; `null` where rays carry none.
    pub radiant_sum: Option<f64>,
    /// Sum of the stored luminous values: lm, or relative; `null` where rays carry none.
    pub luminous_sum: Option<f64>,
    /// Ray sum over header total.
    pub sum_over_header: Option<f64>,
    /// Totals of a model of this file.
    pub flux: Flux,
    /// Luminous efficacy of the radiation, lm/W.
    pub lm_per_w: Option<f64>,
    /// Luminous efficacy by the spectrum of tables or wavelengths alone, lm/W.
    pub spectrum_lm_per_w: Option<f64>,
    /// Box of the origins; `null` without usable rays, like all that follows from rays.
    pub origins_mm: Option<Extent>,
    /// Flux-weighted mean of the origins, mm.
    pub centroid_mm: Option<[f64; 3]>,
    /// Smallest and largest wavelength, nm.
    pub wavelength_nm: Option<(f64, f64)>,
    /// Lengths of directions.
    pub directions: Directions,
    /// Order of the rays.
    pub order: Option<Order>,
    /// How the flux is spread over rays.
    pub ray_flux: Option<RayFlux>,
    /// Noise of what is made of these rays.
    pub noise: Option<Noise>,
    /// Virtual focus; `null` for collimated rays.
    pub focus: Option<Focus>,
    /// What origins lie on.
    pub origins: Option<Origins>,
    /// Median distance of the sampled origins from the virtual focus, mm; 0 without one.
    pub median_origin_distance_mm: f64,
    /// Where most of the light goes.
    pub main_direction: Option<MainDirection>,
    /// Share of the flux in the hemisphere round each axis.
    pub hemispheres: [Hemisphere; 6],
    /// What a job would take.
    pub job: JobEstimate,
    /// What was odd about header and rays.
    pub notices: Vec<Notice>,
    /// What drawings are made of.
    #[serde(skip)]
    pub evidence: Evidence,
}

/// Judges a file by its first bytes, `length` being its full length where that is known. `Some` means: so far a file of this
/// format; `None`: too few bytes to tell.
///
/// # Errors
/// As [`open`], as soon as the bytes at hand prove it.
pub fn peek(prefix: &[u8], length: Option<u64>, limits: &Limits) -> Result<Option<Format>, Error> {
    let start = prefix.get(..prefix.len().min(detect::LOOK)).unwrap_or_default();
    let Some(format) = detect::detect_start(start, length)? else { return Ok(None) };
    let bytes = Prefix { bytes: prefix, length: length.unwrap_or(u64::MAX) };
    match super::peek(format, &bytes, length, limits) {
        Err(Error::Unreadable(_)) | Ok(()) => Ok(Some(format)),
        Err(error) => Err(error),
    }
}

/// The first bytes of a longer file.
struct Prefix<'a> {
    bytes: &'a [u8],
    length: u64,
}

impl Bytes for Prefix<'_> {
    fn len(&self) -> u64 {
        self.length
    }

    fn read_at(&self, offset: u64, into: &mut [u8]) -> io::Result<()> {
        let from = usize::try_from(offset).ok().and_then(|start| self.bytes.get(start..));
        let found = from.and_then(|rest| rest.get(..into.len())).ok_or(io::ErrorKind::UnexpectedEof)?;
        into.copy_from_slice(found);
        Ok(())
    }
}

/// What a file says of itself, with its length as witness.
///
/// # Errors
/// As [`open`].
pub fn header(input: &Input, limits: &Limits) -> Result<Header, Error> {
    Ok(Header::of(&open(Arc::clone(&input.bytes), &input.declared, limits)?.facts, input.bytes.len()))
}

/// Reads a whole file once and tells what is in it. A file that a job would refuse for its rays is told of too.
///
/// # Errors
/// As [`open`]; [`Error::Malformed`] where a record has no meaning; [`Error::Cancelled`].
pub fn inspect(input: &Input, limits: &Limits, watch: StageWatch<'_>) -> Result<Inspection, Error> {
    let set = open(Arc::clone(&input.bytes), &input.declared, limits)?;
    let bands: Bands = bands::asked(&super::Options::default())?.into_bands();
    let radiant = Conversion::of(&set.facts).knows_radiant();
    let (reading, evidence) = observed(&set, radiant, &bands, watch)?;
    let limit = reading.judge(limits);
    let inspection = Inspection::of(&set.facts, input.bytes.len(), radiant, &reading, evidence, limit)?;
    let notices = inspection.notices.iter().chain(&input.notices).cloned().collect();
    Ok(Inspection { notices, ..inspection })
}

/// Reads every ray of `set` once: what its survey says, and what the checks need besides.
///
/// # Errors
/// [`Error::Cancelled`]; as [`super::Records::read`].
pub fn observed(
    set: &RaySet,
    radiant: bool,
    bands: &Bands,
    watch: StageWatch<'_>,
) -> Result<(Reading, Evidence), Error> {
    let (count, pivot) = (set.facts.ray_count, pivot(set)?);
    survey(set, radiant, bands, watch, || Evidence::new(count, pivot))
}

/// What a user should know of a channel before its model is trusted: every check that is not as it should be, but for those
/// whose findings reading itself tells. `radiant`: W weight its rays, not lm.
///
/// # Errors
/// Never of a channel that was read: what can be wrong is refused there.
pub fn findings(
    facts: &Facts,
    byte_count: u64,
    radiant: bool,
    reading: &Reading,
    evidence: Evidence,
) -> Result<Notices, Error> {
    let inspection = Inspection::of(facts, byte_count, radiant, reading, evidence, Ok(()))?;
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
        Err(Error::Refused(fault)) => Ok(Some(fault)),
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
    ) -> Result<Inspection, Error> {
        let mut notices = Notices::default();
        notices.merge(&facts.notices);
        notices.merge(&reading.notices);
        let conversion = Conversion::of(facts).scaled(facts, &reading.sums);
        let flux = conversion.totals(&reading.sums);
        let fault = fault(judged)?.or(fault(totals::judge(facts, &reading.sums, &flux, &mut notices))?);
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
            job: JobEstimate::of(survey.rays_used),
            notices: notices.to_vec(),
            evidence,
        };
        inspection.checks = checks(facts, &inspection, fault.as_ref());
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
