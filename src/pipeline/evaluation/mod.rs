//! A model evaluated without noise: intensity in directions, irradiance on a plane, radiance as a camera sees it; in W, lm, bands or tristimulus
//! values, each number with the bound of its error against the model (`pipeline/README.md`, evaluation).

/// What leaves each place, and where to.
mod emission;
/// Small parts of a source as points.
mod lump;
/// Parts in groups.
mod clusters;
/// The most that a zone sends.
mod ceiling;
/// Irradiance by adaptive quadrature.
mod irradiance;
/// Radiance along lines.
mod radiance;
/// Intensity of the whole.
mod intensity;
/// Directions, planes, cameras.
mod view;
/// A plane that lies in the light.
mod cut;
/// An answer without any light.
mod dark;
/// What is asked.
mod request;
/// Numbers with their names and units.
mod answer;
/// The answer as a file.
mod file;
#[cfg(test)]
mod tests;

pub use answer::{Answer, Channel};
pub use emission::{Kind, tristimulus_of_bands};
pub use file::{Form, schema};
pub use glam::DVec3 as Vector;
pub use request::{MOST_NUMBERS, Request, TOLERANCE};
pub use view::{Camera, Plane, View, Width};

use crate::error::Error;
use crate::model::light::Light;
use crate::vocabulary::notice::Notice;
use crate::vocabulary::watch::StageWatch;
use answer::Raw;
use emission::Emission;
use glam::DVec3;
use intensity::FarField;
use irradiance::{Care, Quadrature};
use radiance::Lines;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};

/// Most parts of a source that are looked at more closely for one point.
const MOST_SPLITS: usize = 20_000;
/// Cells that a thread takes at a time.
const BLOCK: usize = 16;

/// Evaluates a model that `name` names.
///
/// # Errors
/// [`Error::Unusable`] for a request that cannot be answered; [`Error::Refused`] above [`Request::most_numbers`] or
/// [`Request::most_kept`]; [`Error::Cancelled`].
pub fn evaluate<'a>(
    light: impl Into<Light<'a>>,
    name: &str,
    request: &Request,
    watch: StageWatch<'_>,
) -> Result<Answer, Error> {
    let light = light.into();
    let (request, mut notices) = placed(request, &light)?;
    let request = &request;
    let kind = kind_of(&light, request)?;
    let [columns, rows] = request.view.shape()?;
    let emission = Emission::new(light.clone(), kind)?;
    watch.step(0.0)?;
    let raw = cells_of(&emission, request, columns * rows, watch)?;
    if let View::Plane(plane) = &request.view {
        let (sheet, normal) = plane.sheet(&light.frame)?;
        notices.extend(cut::notices(&light, &sheet, normal));
    }
    // What lies in the light is dark for a reason that is told already.
    if notices.is_empty() {
        notices = dark::notices(&light, &request.view, columns * rows, &raw.values)?;
    }
    Ok(Answer { notices, ..Answer::new(&emission, name, request, kind, raw)? })
}

/// What is asked, with the normal of a plane where none was given, and the plane moved off the surface where it lies on it, which is told.
fn placed(request: &Request, light: &Light<'_>) -> Result<(Request, Vec<Notice>), Error> {
    let request = request.facing(light);
    let View::Plane(plane) = request.view else { return Ok((request, Vec::new())) };
    let (sheet, normal) = plane.sheet(&light.frame)?;
    let Some((off_mm, notice)) = cut::off_the_surface(light, &sheet, normal) else { return Ok((request, Vec::new())) };
    let moved = Plane { center_mm: plane.center_mm - off_mm * normal, ..plane };
    Ok((Request { view: View::Plane(moved), ..request }, vec![notice]))
}

/// Refuses a request that the model cannot answer, or that would be too large; which light it is evaluated in.
///
/// # Errors
/// As [`evaluate`].
pub fn check<'a>(light: impl Into<Light<'a>>, request: &Request) -> Result<Kind, Error> {
    let light = light.into();
    // Told before the light is looked at: what no model could answer.
    request.check()?;
    kind_of(&light, &request.facing(&light))
}

/// Which light a request that says how a plane faces is evaluated in. Errors as [`evaluate`].
fn kind_of(light: &Light<'_>, request: &Request) -> Result<Kind, Error> {
    request.check()?;
    let kind = request.kind.unwrap_or_else(|| Kind::first_known(light));
    let channels = kind.channels(light)?;
    let [columns, rows] = request.view.shape()?;
    let numbers = columns.saturating_mul(rows).saturating_mul(channels);
    if numbers > request.most_numbers {
        let most = request.most_numbers;
        let found = format!("The answer would have {numbers} numbers; at most {most} are computed at once here.");
        return Err(Error::refused("evaluation.too_large", found, fewer(most)));
    }
    let kept = light.vertices.len().max(light.volume.map_or(0, |volume| volume.nodes.len()));
    if kept.saturating_mul(channels) > request.most_kept {
        let found = format!(
            "The model has {kept} places with {channels} numbers each, too many to be kept while they are evaluated here."
        );
        let remedy = "Ask for one number a cell (luminous or radiant light), or use the command lampwright evaluate or a job (POST /v1/evaluations).";
        return Err(Error::refused("evaluation.too_large", found, remedy));
    }
    Ok(kind)
}

/// What to do about an answer that is too large where `most` numbers are computed.
fn fewer(most: usize) -> String {
    let less = "Ask for fewer cells, or for one number a cell (luminous or radiant light).";
    if most >= MOST_NUMBERS {
        return less.to_owned();
    }
    format!("{less} The command lampwright evaluate and a job (POST /v1/evaluations) compute up to {MOST_NUMBERS}.")
}

/// The numbers of all cells.
fn cells_of(emission: &Emission<'_>, request: &Request, cells: usize, watch: StageWatch<'_>) -> Result<Raw, Error> {
    let frame = emission.light().frame;
    let shape = request.view.shape()?;
    let raw = |(values, bounds, evaluations)| Raw { shape, values, bounds, evaluations };
    let far = |direction: &(dyn Fn(usize) -> DVec3 + Sync)| {
        let field = FarField::new(emission);
        cell_by_cell(
            emission,
            cells,
            watch,
            || (),
            |(), cell, values, _| {
                field.add(direction(cell), values);
                Ok(1)
            },
        )
    };
    match &request.view {
        View::Grid { c_step_deg, gamma_step_deg } => {
            let [columns, _] = shape;
            far(&|cell| {
                let (c_deg, gamma_deg) =
                    ((cell % columns) as f64 * c_step_deg, (cell / columns) as f64 * gamma_step_deg);
                frame.direction(c_deg.to_radians(), gamma_deg.to_radians())
            })
        }
        View::Directions(directions) => {
            let units = directions.iter().map(|along| view::unit("view.directions", *along));
            let units = units.collect::<Result<Vec<DVec3>, Error>>()?;
            far(&|cell| units[cell])
        }
        View::Angles(angles) => {
            let [c, gamma] = [0, 1].map(|k| angles.iter().map(|pair| pair[k].to_radians()).collect::<Vec<f64>>());
            far(&|cell| frame.direction(c[cell], gamma[cell]))
        }
        View::Plane(plane) => {
            let (sheet, normal) = plane.sheet(&frame)?;
            let quadrature = Quadrature::new(emission);
            let care = Care { tolerance: request.tolerance, most_splits: MOST_SPLITS };
            cell_by_cell(emission, cells, watch, irradiance::Scratch::default, |scratch, cell, values, bounds| {
                let before = scratch.evaluations;
                let at = sheet.receiver(cell, normal);
                quadrature
                    .irradiance(at, care, scratch, (values, bounds), || watch.step(cell as f64 / cells as f64))?;
                Ok(scratch.evaluations - before)
            })
        }
        View::Camera(camera) => {
            let (lens, lines) = (camera.lens()?, Lines::new(emission));
            cell_by_cell(emission, cells, watch, radiance::Scratch::default, |scratch, cell, values, bounds| {
                let before = scratch.evaluations;
                mean_of_lines(&lens, &lines, cell, scratch, values, bounds);
                Ok(scratch.evaluations - before)
            })
        }
    }
    .map(raw)
}

/// Mean of the lines of a cell. Where an edge of the light crosses it, as many of n² lines as the edge is long may lie on the wrong side: the
/// error is at most the range of the values by n. One line alone is exact.
fn mean_of_lines(
    lens: &view::Lens,
    lines: &Lines<'_, '_>,
    cell: usize,
    scratch: &mut radiance::Scratch,
    values: &mut [f64],
    bounds: &mut [f64],
) {
    let samples = lens.samples();
    let mut own = vec![0.0; values.len()];
    let (mut least, mut most) = (vec![f64::INFINITY; values.len()], vec![0.0_f64; values.len()]);
    lens.lines(cell, |line| {
        own.fill(0.0);
        lines.add(line, scratch, &mut own);
        for (channel, value) in own.iter().enumerate() {
            values[channel] += value / (samples * samples) as f64;
            least[channel] = least[channel].min(*value);
            most[channel] = most[channel].max(*value);
        }
    });
    for (bound, (least, most)) in bounds.iter_mut().zip(least.iter().zip(&most)).filter(|_| samples > 1) {
        *bound = (most - least) / samples as f64;
    }
}

/// Values and bounds `[cell][channel]` and how many points were evaluated: each cell by itself, so that threads do not change them.
fn cell_by_cell<S: Send>(
    emission: &Emission<'_>,
    cells: usize,
    watch: StageWatch<'_>,
    scratch: impl Fn() -> S + Sync + Send,
    cell: impl Fn(&mut S, usize, &mut [f64], &mut [f64]) -> Result<u64, Error> + Sync + Send,
) -> Result<(Vec<f64>, Vec<f64>, u64), Error> {
    let channels = emission.channels();
    let (mut values, mut bounds) = (vec![0.0; cells * channels], vec![0.0; cells * channels]);
    let (done, evaluations) = (AtomicUsize::new(0), AtomicU64::new(0));
    let numbers = BLOCK * channels;
    let blocks = values.par_chunks_mut(numbers).zip(bounds.par_chunks_mut(numbers)).enumerate();
    blocks.try_for_each_init(scratch, |scratch, (block, (values, bounds))| {
        watch.step(done.fetch_add(BLOCK, Ordering::Relaxed) as f64 / cells as f64)?;
        let own = values.chunks_exact_mut(channels).zip(bounds.chunks_exact_mut(channels));
        for (at, (values, bounds)) in own.enumerate() {
            evaluations.fetch_add(cell(scratch, block * BLOCK + at, values, bounds)?, Ordering::Relaxed);
        }
        Ok::<(), Error>(())
    })?;
    Ok((values, bounds, evaluations.into_inner()))
}
