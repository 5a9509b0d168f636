//! Where the light is put: on the hull of the origins, on a plane or a sphere on which it is sharper, or in the volume that the origins
//! fill. A model of each is made of a part of a sample of the rays; the one that predicts the rays held out best is taken, the simpler one unless the other is surely better.
//!
//! Radiance does not change along a line, so models on different surfaces compare by the radiance they give to the lines of rays
//! they were not made of: the larger its mean logarithm, the better (the likelihood of the rays).

/// Rays to build candidates of, and rays to judge them by.
mod sample;
/// The part of a surface that is lit.
mod patch;
/// Planes and spheres on which the light is sharpest.
mod sharpness;
/// Mirror planes of the spectrum.
mod symmetric_spectrum;
/// A model made of a part of the rays, judged by the others.
mod verification;

use crate::error::Error;
use crate::flux::project::Projector;
use crate::hull::focal::FocalPatch;
use crate::hull::symmetry::Symmetry;
use crate::hull::{Carrier, Cloud};
use crate::model::Model;
use crate::model::evaluation::Evaluator;
use crate::model::study::{Candidate, Study};
use crate::options::{Emission, Options};
use crate::source::{Ray, Source};
use crate::vocabulary::limits::Limits;
use crate::vocabulary::watch::{Stage, StageWatch};
use crate::volume::lattice::is_filled;
use patch::patch;
use rayon::prelude::*;
pub use sample::Sample;
use sharpness::{Search, Sharp};
use std::f64::consts::PI;
use symmetric_spectrum::has_symmetric_spectrum;
use verification::{BandGroups, GROUPS, verify};

/// A focal surface is a candidate where its light is so much sharper than on a flat source's own plane, and a sphere where it is so much
/// sharper than on the best plane: gain of the mean logarithm of the radiance.
const WORTH_TRYING: f64 = 0.005;
/// A later candidate must be better by so many standard errors.
const SURELY: f64 = 2.0;
/// Part of the light that every model is taken to send from anywhere in any direction, so that no ray is impossible.
const ANYWHERE: f64 = 1e-3;
/// Cosines below this count as this: radiance along a surface has no meaning.
const LEAST_COSINE: f64 = 0.01;
/// A cloud is flat whose extent along the main direction is at most this part of its size.
const FLAT: f64 = 1e-4;
/// Candidates have at most so many cells along their longest edge: their rays fill no more.
const MOST_CELLS: u32 = 64;
/// Models of so many candidates are made at once: each has the memory of one (`memory.rs`).
const SIDE_BY_SIDE: usize = 2;
/// Of fewer rays no part is held out.
const FEWEST_RAYS: usize = 2500;
/// Where progress stands when focal surfaces have been searched for, when candidates have been compared, and when the model that is
/// verified is made.
const SEARCHED: f64 = 0.3;
const COMPARED: f64 = 0.85;
const JUDGED: f64 = 0.9;

/// What was chosen.
pub struct Chosen {
    /// Where the light is put.
    pub carrier: Carrier,
    /// What was found; `None` where there were too few rays.
    pub study: Option<Study>,
    /// The rays that were looked at.
    pub sample: Sample,
}

/// Chooses where the light of `source` is put as the options say, and verifies the choice.
///
/// # Errors
/// `emission.no_focus` where a focal surface was asked for and there is none; those of the stages.
pub fn choose(source: &Source, options: &Options, limits: &Limits, watch: StageWatch<'_>) -> Result<Chosen, Error> {
    let emission = options.emission();
    let sample = Sample::take(source, watch.part(0.0, 0.1))?;
    let mut open = carriers(&sample, source, emission, watch.part(0.1, SEARCHED))?;
    if sample.training.rays.len() < FEWEST_RAYS || sample.held_out.is_empty() {
        return Ok(Chosen { carrier: open[0], study: None, sample });
    }
    let mut options = options.clone();
    options.hull.resolution = options.hull.resolution.map(|cells| cells.min(MOST_CELLS));
    let groups = BandGroups::of(source, &sample.training.rays);
    // The one that will be verified has its spectrum, where that is to be compared; those that are only compared do without.
    let is_only = matches!(open[..], [Carrier::Origins | Carrier::Volume]);
    // Zones that were asked for may be many and large.
    let side_by_side = if options.goniogram.zones.is_none() { SIDE_BY_SIDE } else { 1 };
    let mut compared = Compared::of(&sample);
    let mut left = watch.part(SEARCHED, COMPARED);
    while !open.is_empty() {
        let part = left.part(0.0, 0.7);
        left = left.part(0.7, 1.0);
        // Of those made side by side, progress is where all of them began.
        let told = |stage| if open.len() == 1 { part_of(part, stage) } else { part.part(0.0, 0.0) };
        let build = |carrier: &Carrier| -> Result<(Model, Vec<f64>), Error> {
            let with_spectrum = Cloud::sampled(source, &sample.training, *carrier);
            let cloud = if is_only && groups.is_some() { with_spectrum } else { with_spectrum.plain() };
            let model = Model::build(&cloud, None, &options, limits, |stage| Ok(told(stage)))?;
            let judged = log_radiances(&model, source, &sample.held_out);
            Ok((model, judged))
        };
        for carriers in open.chunks(side_by_side) {
            let built: Vec<Result<(Model, Vec<f64>), Error>> = carriers.par_iter().map(build).collect();
            for (carrier, built) in carriers.iter().zip(built) {
                match built {
                    // What is too much for the options is so for all rays too, and said there.
                    Err(Error::Refused(_)) if compared.study.candidates.is_empty() && carrier.patch().is_none() => {
                        return Ok(Chosen { carrier: *carrier, study: None, sample });
                    }
                    // What does not go with the options is no choice.
                    Err(Error::Refused(_)) if emission == Emission::Auto => {}
                    Err(error) => return Err(error),
                    Ok((model, judged)) => compared.add(*carrier, model, judged, &sample.held_out),
                }
            }
        }
        let more = more_symmetric(open[open.len() - 1], &compared.study, |patch| {
            let parts = |ray: &Ray| spectral_parts(groups.as_ref(), ray);
            has_symmetric_spectrum(patch, &sample.training.rays, parts)
        });
        open = more.into_iter().collect();
    }
    let Compared { mut study, best } = compared;
    let carrier = study.candidates[study.chosen].carrier;
    if let Some((best, _)) = best {
        let cloud = Cloud::sampled(source, &sample.training, carrier);
        let part = watch.part(COMPARED, JUDGED);
        let with_spectrum = || Model::build(&cloud, None, &options, limits, |stage| Ok(part_of(part, stage)));
        let model = if groups.is_some() && !is_only { with_spectrum()? } else { best };
        verify(&model, source, &sample, groups.as_ref(), &mut study, watch.part(JUDGED, 1.0))?;
    }
    Ok(Chosen { carrier, study: Some(study), sample })
}

/// The candidates that were compared, and the best of them.
struct Compared {
    study: Study,
    /// With the logarithms of the radiance that it gives to the lines of the rays held out.
    best: Option<(Model, Vec<f64>)>,
}

impl Compared {
    fn of(sample: &Sample) -> Compared {
        let (training_rays, compared_rays) = (sample.training.rays.len() as u64, sample.held_out.len() as u64);
        Compared { study: Study { training_rays, compared_rays, ..Study::default() }, best: None }
    }

    /// The next one, which gives the lines of `rays` radiances of the logarithms `judged`.
    fn add(&mut self, carrier: Carrier, model: Model, judged: Vec<f64>, rays: &[Ray]) {
        let gain = self.best.as_ref().map(|(_, best)| gain(&judged, best, rays));
        self.study.candidates.push(Candidate { carrier, log_radiance: mean(&judged, rays), gain });
        if gain.is_none_or(|(gain, error)| gain > SURELY * error) {
            self.best = Some((model, judged));
            self.study.chosen = self.study.candidates.len() - 1;
        }
    }
}

/// The part of a model's watch that is a stage's.
fn part_of(part: StageWatch<'_>, stage: Stage) -> StageWatch<'_> {
    match stage {
        Stage::Rays | Stage::Hull => part.part(0.0, 0.2),
        Stage::Flux => part.part(0.2, 0.6),
        Stage::Goniogram => part.part(0.6, 0.9),
        Stage::Model | Stage::Artifacts => part.part(0.9, 1.0),
    }
}

/// Parts of the light of a ray by wavelength: groups of bands, or its shares of tristimulus X, Y and Z where there are no bands.
fn spectral_parts(groups: Option<&BandGroups>, ray: &Ray) -> [f64; GROUPS] {
    let [x, z] = ray.xz_lm;
    let sum = x + ray.luminous_lm + z;
    match groups {
        Some(groups) => groups.of_ray(ray),
        None if x + z > 0.0 => [x / sum, ray.luminous_lm / sum, z / sum, 0.0, 0.0, 0.0],
        None => [0.0; GROUPS],
    }
}

/// Whether the best focal surface is symmetric is tried last, even where another surface is better than it is alone: the most symmetric
/// first, after `tried` the next, until one is taken. Only symmetries that the spectrum has too are tried.
fn more_symmetric(tried: Carrier, study: &Study, has_spectrum: impl Fn(&FocalPatch) -> bool) -> Option<Carrier> {
    let symmetry = |carrier: Carrier| carrier.patch().map_or(Symmetry::None, |patch| patch.symmetry);
    if symmetry(study.candidates[study.chosen].carrier) != Symmetry::None {
        return None;
    }
    let plain = study.candidates.iter().filter(|candidate| symmetry(candidate.carrier) == Symmetry::None);
    let focal = plain.filter_map(|candidate| Some((candidate.log_radiance, candidate.carrier.patch()?)));
    let (_, best) = focal.max_by(|a, b| a.0.total_cmp(&b.0))?;
    let left = [Symmetry::FourMirrors, Symmetry::TwoMirrors].into_iter();
    let left = left.filter(|next| symmetry(tried) == Symmetry::None || *next < symmetry(tried));
    left.map(|next| best.with(next)).find(|patch| has_spectrum(patch)).map(Carrier::Focal)
}

/// Where the light may be put, the simplest first; at least one.
fn carriers(
    sample: &Sample,
    source: &Source,
    emission: Emission,
    watch: StageWatch<'_>,
) -> Result<Vec<Carrier>, Error> {
    let rays = &sample.training.rays;
    let focal = || -> Result<Vec<Carrier>, Error> {
        let patches = focal_patches(rays, source, emission == Emission::Auto, watch)?;
        Ok(patches.into_iter().map(Carrier::Focal).collect())
    };
    let carriers = match emission {
        Emission::Origins => vec![Carrier::Origins],
        Emission::Volume => vec![Carrier::Volume],
        Emission::Focus if rays.len() < FEWEST_RAYS => {
            return Err(no_focus("There are too few rays to find a surface on which they are sharp."));
        }
        Emission::Focus => focal()?,
        Emission::Auto if rays.len() < FEWEST_RAYS => vec![Carrier::Origins],
        Emission::Auto if is_filled(rays) => [vec![Carrier::Origins, Carrier::Volume], focal()?].concat(),
        Emission::Auto => [vec![Carrier::Origins], focal()?].concat(),
    };
    if carriers.is_empty() {
        return Err(no_focus("The rays have no surface on which they are sharper than anywhere else."));
    }
    Ok(carriers)
}

fn no_focus(found: &str) -> Error {
    Error::unusable("emission.no_focus", "hull.emission", found, "Choose hull.emission = auto, origins or volume.")
}

/// The sharpest plane, and the sharpest sphere where it is sharper; none where they are no better than a flat source's own plane, if
/// `only_where_better`.
fn focal_patches(
    rays: &[Ray],
    source: &Source,
    only_where_better: bool,
    watch: StageWatch<'_>,
) -> Result<Vec<FocalPatch>, Error> {
    let Some(search) = Search::new(rays) else { return Ok(Vec::new()) };
    let size_mm = source.survey.bounds_mm.size();
    let is_flat = |axis: glam::DVec3| size_mm.dot(axis.abs()) < FLAT * size_mm.length();
    let given = search.given().filter(|given| only_where_better && is_flat(given.surface.axes.z_axis));
    let [plane, sphere] = search.sharpest(given, watch)?;
    let better = |sharp: Option<Sharp>, than: Option<Sharp>| {
        sharp.filter(|sharp| than.is_none_or(|than| sharp.log_radiance > than.log_radiance + WORTH_TRYING))
    };
    let plane = better(plane, given);
    let sphere = better(sphere, plane.or(given));
    Ok(plane.into_iter().chain(sphere).filter_map(|sharp| patch(sharp.surface, rays)).collect())
}

/// Logarithm of the radiance that `model` gives to the line of each ray, its flux 1.
fn log_radiances(model: &Model, source: &Source, rays: &[Ray]) -> Vec<f64> {
    let flux = source.flux.primary();
    let anywhere = 1.0 / (4.0 * PI * source.survey.bounds_mm.size().length_squared()).max(f64::MIN_POSITIVE);
    let projector = Projector::new(&model.hull);
    let Some(evaluator) = Evaluator::of_primary(model) else { return vec![anywhere.ln(); rays.len()] };
    let radiance = |ray: &Ray| {
        if let Some(radiance) = evaluator.radiance_along(ray.origin_mm, ray.direction) {
            return radiance / flux;
        }
        let Some(landing) = projector.land(ray) else { return 0.0 };
        let cosine = ray.direction.dot(model.hull.normal(landing.triangle)).abs().max(LEAST_COSINE);
        let exitance = evaluator.exitance(landing.triangle, landing.shares);
        exitance * evaluator.distribution(landing.triangle, landing.shares, ray.direction) / cosine / flux
    };
    rays.par_iter().map(|ray| ((1.0 - ANYWHERE) * radiance(ray) + ANYWHERE * anywhere).ln()).collect()
}

/// Flux-weighted mean over rays.
fn mean(values: &[f64], rays: &[Ray]) -> f64 {
    let flux: f64 = rays.iter().map(Ray::weight).sum();
    values.iter().zip(rays).map(|(value, ray)| ray.weight() * value).sum::<f64>() / flux
}

/// Mean of the differences, and its standard error.
fn gain(values: &[f64], before: &[f64], rays: &[Ray]) -> (f64, f64) {
    let differences: Vec<f64> = values.iter().zip(before).map(|(value, before)| value - before).collect();
    let mean = mean(&differences, rays);
    let flux: f64 = rays.iter().map(Ray::weight).sum();
    let square: f64 =
        differences.iter().zip(rays).map(|(difference, ray)| (ray.weight() * (difference - mean)).powi(2)).sum();
    (mean, square.sqrt() / flux)
}
