//! Which surface the light is put on: the hull of the origins, a plane or a sphere on which it is sharper. A model of each is made of a part
//! of a sample of the rays; the one that predicts the rays held out best is taken, the simpler one unless the other is surely better.
//!
//! Radiance does not change along a line, so models on different surfaces compare by the radiance they give to the lines of rays
//! they were not made of: the larger its mean logarithm, the better (the likelihood of the rays).

/// Rays to build candidates of, and rays to judge them by.
mod sample;
/// Planes and spheres on which the light is sharpest.
mod sharpness;
/// A model made of a part of the rays, judged by the others.
mod verification;

use crate::error::Error;
use crate::flux::project::Projector;
use crate::hull::Cloud;
use crate::hull::focal::{FocalPatch, Symmetry};
use crate::model::Model;
use crate::model::evaluation::Evaluator;
use crate::model::study::{Candidate, Study};
use crate::options::{Emission, Options};
use crate::source::{Ray, Source};
use crate::vocabulary::limits::Limits;
use crate::vocabulary::watch::StageWatch;
use rayon::prelude::*;
pub use sample::Sample;
use sharpness::{Search, Sharp, patch, weight};
use std::collections::VecDeque;
use std::f64::consts::PI;
use verification::verify;

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
/// Of fewer rays no part is held out.
const FEWEST_RAYS: usize = 2500;

/// What was chosen.
pub struct Chosen {
    /// Where rays are slid to; `None`: they keep their origins.
    pub patch: Option<FocalPatch>,
    /// What was found; `None` where there were too few rays.
    pub study: Option<Study>,
    /// The rays that were looked at.
    pub sample: Sample,
}

/// Chooses the surface of `source` as the options say, and verifies the choice.
///
/// # Errors
/// `emission.no_focus` where a focal surface was asked for and there is none; those of the stages.
pub fn choose(source: &Source, options: &Options, limits: &Limits, watch: StageWatch<'_>) -> Result<Chosen, Error> {
    let emission = options.emission();
    let sample = Sample::take(source, watch.part(0.0, 0.1))?;
    let mut open: VecDeque<Option<FocalPatch>> = VecDeque::new();
    if emission != Emission::Focus {
        open.push_back(None);
    }
    if emission == Emission::Focus && sample.training.rays.len() < FEWEST_RAYS {
        return Err(no_focus("There are too few rays to find a surface on which they are sharp."));
    }
    if emission != Emission::Origins {
        open.extend(focal_patches(&sample, source, emission == Emission::Auto));
    }
    if open.is_empty() {
        return Err(no_focus("The rays have no surface on which they are sharper than anywhere else."));
    }
    if sample.training.rays.len() < FEWEST_RAYS || sample.held_out.is_empty() {
        return Ok(Chosen { patch: open[0], study: None, sample });
    }
    let mut study = Study {
        training_rays: sample.training.rays.len() as u64,
        compared_rays: sample.held_out.len() as u64,
        ..Study::default()
    };
    let mut options = options.clone();
    options.hull.resolution = options.hull.resolution.map(|cells| cells.min(MOST_CELLS));
    let mut best: Option<(Model, Vec<f64>)> = None;
    while let Some(patch) = open.pop_front() {
        let cloud = Cloud::sampled(source, &sample.training, patch).plain();
        let tried = study.candidates.len() as f64;
        let part = watch.part(1.0 - 0.8_f64.powf(tried + 1.0), 1.0 - 0.8_f64.powf(tried + 2.0)).part(0.0, 0.9);
        part.step(0.0)?;
        let model = match Model::build(&cloud, None, &options, limits, |_| Ok(part.part(0.0, 0.0))) {
            // What is too much for the options is so for all rays too, and said there.
            Err(Error::Refused(_)) if patch.is_none() && study.candidates.is_empty() => {
                return Ok(Chosen { patch: None, study: None, sample });
            }
            // A focal surface that does not go with the options is no choice.
            Err(Error::Refused(_)) if emission == Emission::Auto => continue,
            model => model?,
        };
        let judged = log_radiances(&model, source, &sample.held_out);
        let gain = best.as_ref().map(|(_, best)| gain(&judged, best, &sample.held_out));
        study.candidates.push(Candidate { patch, log_radiance: mean(&judged, &sample.held_out), gain });
        if gain.is_none_or(|(gain, error)| gain > SURELY * error) {
            best = Some((model, judged));
            study.chosen = study.candidates.len() - 1;
        }
        // Whether the best surface is symmetric is tried last: the most symmetric first.
        if let (true, Some(chosen)) = (open.is_empty(), study.candidates[study.chosen].patch) {
            let next = match (patch.map(|patch| patch.symmetry), chosen.symmetry) {
                (None | Some(Symmetry::None), Symmetry::None) => Some(Symmetry::FourMirrors),
                (Some(Symmetry::FourMirrors), Symmetry::None) => Some(Symmetry::TwoMirrors),
                _ => None,
            };
            open.extend(next.map(|symmetry| Some(chosen.with(symmetry))));
        }
    }
    if let Some((model, _)) = best {
        verify(&model, source, &sample, &mut study, watch.part(0.9, 1.0))?;
    }
    Ok(Chosen { patch: study.candidates[study.chosen].patch, study: Some(study), sample })
}

fn no_focus(found: &str) -> Error {
    Error::unusable("emission.no_focus", "hull.emission", found, "Choose hull.emission = auto or origins.")
}

/// The sharpest plane, and the sharpest sphere where it is sharper; none where they are no better than a flat source's own plane, if
/// `only_where_better`.
fn focal_patches(sample: &Sample, source: &Source, only_where_better: bool) -> Vec<Option<FocalPatch>> {
    let Some(search) = Search::new(&sample.training.rays) else { return Vec::new() };
    let [plane, sphere] = search.sharpest();
    let size_mm = source.survey.bounds_mm.size();
    let is_flat = |axis: glam::DVec3| size_mm.dot(axis.abs()) < FLAT * size_mm.length();
    let given = search.given().filter(|given| only_where_better && is_flat(given.surface.axes.z_axis));
    let better = |sharp: Option<Sharp>, than: Option<Sharp>| {
        sharp.filter(|sharp| than.is_none_or(|than| sharp.log_radiance > than.log_radiance + WORTH_TRYING))
    };
    let plane = better(plane, given);
    let sphere = better(sphere, plane.or(given));
    let patch = |sharp: Sharp| patch(sharp.surface, &sample.training.rays);
    plane.into_iter().chain(sphere).filter_map(patch).map(Some).collect()
}

/// Logarithm of the radiance that `model` gives to the line of each ray, its flux 1.
fn log_radiances(model: &Model, source: &Source, rays: &[Ray]) -> Vec<f64> {
    let flux = source.flux.primary();
    let anywhere = 1.0 / (4.0 * PI * source.survey.bounds_mm.size().length_squared()).max(f64::MIN_POSITIVE);
    let projector = Projector::new(&model.hull);
    let Some(evaluator) = Evaluator::of_primary(model) else { return vec![anywhere.ln(); rays.len()] };
    let radiance = |ray: &Ray| {
        let Some(landing) = projector.land(ray) else { return 0.0 };
        let cosine = ray.direction.dot(model.hull.normal(landing.triangle)).abs().max(LEAST_COSINE);
        let exitance = evaluator.exitance(landing.triangle, landing.shares);
        exitance * evaluator.distribution(landing.triangle, landing.shares, ray.direction) / cosine / flux
    };
    rays.par_iter().map(|ray| ((1.0 - ANYWHERE) * radiance(ray) + ANYWHERE * anywhere).ln()).collect()
}

/// Flux-weighted mean over rays.
fn mean(values: &[f64], rays: &[Ray]) -> f64 {
    let flux: f64 = rays.iter().map(weight).sum();
    values.iter().zip(rays).map(|(value, ray)| weight(ray) * value).sum::<f64>() / flux
}

/// Mean of the differences, and its standard error.
fn gain(values: &[f64], before: &[f64], rays: &[Ray]) -> (f64, f64) {
    let differences: Vec<f64> = values.iter().zip(before).map(|(value, before)| value - before).collect();
    let mean = mean(&differences, rays);
    let flux: f64 = rays.iter().map(weight).sum();
    let square: f64 =
        differences.iter().zip(rays).map(|(difference, ray)| (weight(ray) * (difference - mean)).powi(2)).sum();
    (mean, square.sqrt() / flux)
}
