//! How good a model is: made of a part of the rays, it is compared with rays it was not made of, in the views that users have of a
//! source. The rays that judge are two halves, and so are the rays drawn from the model: the product of their differences has no
//! noise in the mean, so small errors show although every ray is random.

use super::patch::quantiles;
use super::sample::Sample;
use crate::error::Error;
use crate::hull::{Carrier, Cloud};
use crate::model::Model;
use crate::model::chance::Numbers;
use crate::model::evaluation::Evaluator;
use crate::model::sampling::Sampler;
use crate::model::study::{Figure, Study, View};
use crate::model::wavelengths::Wavelengths;
use crate::rays::direction_cube::DirectionCube;
use crate::source::{Ray, Source};
use crate::vocabulary::space::Bounds;
use crate::vocabulary::watch::StageWatch;
use glam::DVec3;
use rayon::prelude::*;
use std::ops::Range;

/// Planes, in sizes of the source in front of it; and directions it is seen from, degrees beside the main direction.
const PLANES: [f64; 4] = [0.1, 0.5, 2.0, 10.0];
const SEEN_DEG: [f64; 3] = [0.0, 30.0, 60.0];
/// Rays within this angle of a direction show how the source is seen from there, degrees.
const CONE_DEG: f64 = 10.0;
/// Part of the flux on each side of a source that has no part in its size.
const STRAY: f64 = 0.01;
/// Planes on which the spectrum is compared.
const SPECTRAL_PLANES: [f64; 2] = [0.5, 2.0];
/// Cells along each side of a plane and of an image; of a plane where the spectrum is compared.
const SIDE: usize = 24;
const SPECTRAL_SIDE: usize = 12;
/// Groups of bands that are told apart.
pub const GROUPS: usize = 6;
/// Rays drawn for each half.
const DRAWN: u64 = 1 << 18;
/// Rays drawn at a time.
const BATCH: u64 = 1 << 13;
/// Fewer rays in a view say nothing.
const FEWEST_RAYS: f64 = 500.0;

/// The bands of a source in groups of neighbours that have about the same flux.
pub struct BandGroups {
    of_band: Vec<usize>,
    /// Of the light in each spectral column, the share in each group.
    of_column: Vec<[f64; GROUPS]>,
}

impl BandGroups {
    /// By the light of `rays`; `None` where the rays have no bands, or all the same spectrum.
    pub fn of(source: &Source, rays: &[Ray]) -> Option<BandGroups> {
        let spectral = &source.spectral;
        let mut columns = vec![0.0; spectral.column_count()];
        rays.iter().for_each(|ray| spectral.deposit(ray, |column, watt| columns[column] += watt));
        let widths_nm = spectral.bands.widths_nm();
        let bands_of = |columns: &[f64]| -> Vec<f64> {
            spectral.bands_w_per_nm(columns).iter().zip(&widths_nm).map(|(density, width)| density * width).collect()
        };
        let bands = bands_of(&columns);
        let total: f64 = bands.iter().sum();
        let differ = columns.iter().filter(|watt| **watt > 0.0).count() > 1;
        if !(spectral.has_bands() && differ && total > 0.0) {
            return None;
        }
        let mut before = 0.0;
        let group = |watt: &f64| {
            before += watt;
            (((before - 0.5 * watt) / total * GROUPS as f64) as usize).min(GROUPS - 1)
        };
        let of_band: Vec<usize> = bands.iter().map(group).collect();
        let shares = |column: usize| {
            let mut alone = vec![0.0; columns.len()];
            alone[column] = 1.0;
            let mut shares = [0.0; GROUPS];
            bands_of(&alone).iter().zip(&of_band).for_each(|(share, group)| shares[*group] += share);
            shares
        };
        let of_column = (0..columns.len()).map(shares).collect();
        Some(BandGroups { of_band, of_column })
    }

    /// The share of a ray's light in each group.
    pub fn of_ray(&self, ray: &Ray) -> [f64; GROUPS] {
        self.of_column.get(ray.column as usize).copied().unwrap_or_default()
    }
}

/// A view as cells.
struct Screen {
    view: View,
    /// Its cells among those of all views; where the spectrum is compared, groups of bands within places.
    cells: Range<usize>,
    /// Cells along each side of a plane or an image.
    side: usize,
    /// Where lines are looked at: a point of the plane, its normal, two axes in it, and half its width in mm.
    at_mm: DVec3,
    normal: DVec3,
    across: [DVec3; 2],
    half_mm: f64,
    /// Least cosine of a direction to the normal.
    least_cosine: f64,
}

impl Screen {
    /// The place that a line crosses.
    fn place(&self, point_mm: DVec3, direction: DVec3) -> Option<usize> {
        if matches!(self.view, View::FarField | View::SpectralFarField) {
            return Some(DirectionCube::cell(direction));
        }
        let cosine = direction.dot(self.normal);
        if cosine <= self.least_cosine {
            return None;
        }
        let from_mm = point_mm - self.at_mm;
        let offset_mm = from_mm - from_mm.dot(self.normal) / cosine * direction;
        let place = |axis: DVec3| {
            let at = (offset_mm.dot(axis) / self.half_mm + 1.0) * 0.5 * self.side as f64;
            (0.0..self.side as f64).contains(&at).then_some(at as usize)
        };
        Some(place(self.across[0])? * self.side + place(self.across[1])?)
    }
}

/// The box of a model's light without a few stray rays.
fn lit_bounds_mm(model: &Model) -> Bounds {
    let flux = model.surface.vertices.primary();
    let range = |axis: usize| {
        let at = model.hull.vertices_mm.iter().zip(flux).map(|(vertex, flux)| (vertex[axis], *flux)).collect();
        quantiles(at, STRAY)
    };
    let [x, y, z] = [0, 1, 2].map(range);
    Bounds { min: DVec3::new(x[0], y[0], z[0]), max: DVec3::new(x[1], y[1], z[1]) }
}

/// All views of a model's source, whose light lies in `bounds_mm`; of the spectrum where that is compared.
fn screens(model: &Model, bounds_mm: Bounds, size_mm: f64, spectral: bool) -> Vec<Screen> {
    let frame = &model.goniograms.frame;
    let ahead = frame.nadir.vector();
    let middle_mm = bounds_mm.center();
    let front_mm = middle_mm + 0.5 * bounds_mm.size().dot(ahead.abs()) * ahead;
    let mut end = 0;
    let mut cells = |count: usize| {
        end += count;
        end - count..end
    };
    let plane = |view: View, sizes: f64, side: usize, cells: Range<usize>| Screen {
        view,
        cells,
        side,
        at_mm: front_mm + sizes * size_mm * ahead,
        normal: ahead,
        across: [frame.x(), frame.y()],
        half_mm: (0.5 + sizes) * size_mm,
        least_cosine: 1e-6,
    };
    let far_field = |view: View, cells: Range<usize>| Screen {
        view,
        cells,
        side: 1,
        at_mm: middle_mm,
        normal: ahead,
        across: [DVec3::ZERO; 2],
        half_mm: 1.0,
        least_cosine: -1.0,
    };
    let mut screens: Vec<Screen> =
        PLANES.iter().map(|sizes| plane(View::Plane(*sizes), *sizes, SIDE, cells(SIDE * SIDE))).collect();
    screens.push(far_field(View::FarField, cells(DirectionCube::CELLS)));
    screens.extend(SEEN_DEG.map(|degrees| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        Screen {
            view: View::Seen(degrees),
            cells: cells(SIDE * SIDE),
            side: SIDE,
            at_mm: middle_mm,
            normal: cos * ahead + sin * frame.x(),
            across: [cos * frame.x() - sin * ahead, frame.y()],
            half_mm: 0.55 * size_mm,
            least_cosine: CONE_DEG.to_radians().cos(),
        }
    }));
    if spectral {
        let places = SPECTRAL_SIDE * SPECTRAL_SIDE;
        let planes = SPECTRAL_PLANES.iter();
        screens.extend(
            planes.map(|sizes| plane(View::SpectralPlane(*sizes), *sizes, SPECTRAL_SIDE, cells(places * GROUPS))),
        );
        screens.push(far_field(View::SpectralFarField, cells(DirectionCube::CELLS * GROUPS)));
    }
    screens
}

/// Flux in the cells of all views, and what its noise follows from.
#[derive(Clone)]
struct Counts {
    flux: Vec<f64>,
    /// Σ w² per cell.
    squares: Vec<f64>,
    total: f64,
    /// The part of it that lies in groups of bands.
    grouped: f64,
    rays: u64,
}

impl Counts {
    fn none(screens: &[Screen]) -> Counts {
        let cells = screens.last().map_or(0, |screen| screen.cells.end);
        Counts { flux: vec![0.0; cells], squares: vec![0.0; cells], total: 0.0, grouped: 0.0, rays: 0 }
    }

    /// Adds a ray; `groups`: its shares in the groups of bands.
    fn add(&mut self, screens: &[Screen], line: (DVec3, DVec3), weight: f64, groups: &[f64; GROUPS]) {
        self.total += weight;
        self.grouped += weight * groups.iter().sum::<f64>();
        self.rays += 1;
        for screen in screens {
            let Some(place) = screen.place(line.0, line.1) else { continue };
            if !screen.view.is_spectral() {
                self.add_to(screen.cells.start + place, weight);
                continue;
            }
            for (group, share) in groups.iter().enumerate().filter(|(_, share)| **share > 0.0) {
                self.add_to(screen.cells.start + place * GROUPS + group, weight * share);
            }
        }
    }

    fn add_to(&mut self, cell: usize, weight: f64) {
        self.flux[cell] += weight;
        self.squares[cell] += weight * weight;
    }

    fn merge(&mut self, other: &Counts) {
        self.flux.iter_mut().zip(&other.flux).for_each(|(sum, part)| *sum += part);
        self.squares.iter_mut().zip(&other.squares).for_each(|(sum, part)| *sum += part);
        self.total += other.total;
        self.grouped += other.grouped;
        self.rays += other.rays;
    }

    /// Share of the flux in a cell of a view, and the variance of that. Light outside of all bands has no part in spectral views.
    fn share(&self, view: View, cell: usize) -> (f64, f64) {
        let total = if view.is_spectral() { self.grouped } else { self.total };
        if total > 0.0 { (self.flux[cell] / total, self.squares[cell] / (total * total)) } else { (0.0, 0.0) }
    }
}

/// Judges `model`, which was made of the training rays of `sample`, by other rays of `source`, and puts the figures into `study`; its
/// spectrum in `groups` of bands, where there are any.
///
/// # Errors
/// As [`Source::fold`].
pub fn verify(
    model: &Model,
    source: &Source,
    sample: &Sample,
    groups: Option<&BandGroups>,
    study: &mut Study,
    watch: StageWatch<'_>,
) -> Result<(), Error> {
    let bounds_mm = lit_bounds_mm(model);
    let size_mm = bounds_mm.size().max_element();
    let Some(evaluator) = Evaluator::of_primary(model).filter(|_| size_mm > 0.0) else { return Ok(()) };
    let screens = screens(model, bounds_mm, size_mm, groups.is_some());
    let none = Counts::none(&screens);
    let count = |counts: &mut Counts, ray: &Ray| {
        let groups = groups.map_or([0.0; GROUPS], |groups| groups.of_ray(ray));
        counts.add(&screens, (ray.origin_mm, ray.direction), ray.weight(), &groups);
    };
    let judge = |rays: &[Ray]| {
        let mut halves = [none.clone(), none.clone()];
        for ray in rays {
            if let Some(half) = sample.judging_half(ray) {
                count(&mut halves[half], ray);
            }
        }
        Ok(halves)
    };
    let merge = |all: &mut [Counts; 2], part: [Counts; 2]| all.iter_mut().zip(&part).for_each(|(a, b)| a.merge(b));
    let truth =
        Cloud::new(source, Carrier::Origins).fold(watch.part(0.0, 0.5), [none.clone(), none.clone()], judge, merge)?;
    let drawing = watch.part(0.5, 1.0);
    let mut rays = none.clone();
    sample.training.rays.iter().for_each(|ray| count(&mut rays, ray));
    let Some(sampler) = Sampler::new(&evaluator) else { return Ok(()) };
    let colors = groups.and_then(|groups| Some((groups, Wavelengths::new(&evaluator)?)));
    let draw = |half: u64| {
        let batch = |number: u64| -> Result<Counts, Error> {
            drawing.step((half as f64 + number as f64 * BATCH as f64 / DRAWN as f64) / 2.0)?;
            let mut counts = none.clone();
            for ray in number * BATCH..(number + 1) * BATCH {
                let mut numbers = Numbers::of(half, ray);
                let Some(drawn) = sampler.draw(&mut numbers) else { continue };
                let mut shares = [0.0; GROUPS];
                if let Some((groups, wavelengths)) = &colors {
                    let nm = wavelengths.draw_nm(&drawn, &evaluator, &mut numbers);
                    source.spectral.bands.band(nm).into_iter().for_each(|band| shares[groups.of_band[band]] = 1.0);
                }
                counts.add(&screens, (drawn.point_mm, drawn.direction), 1.0, &shares);
            }
            Ok(counts)
        };
        // Sums of whole numbers: any order of the batches gives the same.
        (0..DRAWN / BATCH).into_par_iter().map(batch).try_reduce(
            || none.clone(),
            |mut all, part| {
                all.merge(&part);
                Ok(all)
            },
        )
    };
    let drawn = [draw(0)?, draw(1)?];
    study.judging_rays = truth.iter().map(|half| half.rays).sum();
    study.drawn_rays = drawn.iter().map(|half| half.rays).sum();
    study.figures = screens.iter().filter_map(|screen| figure(screen, &truth, &drawn, &rays)).collect();
    Ok(())
}

/// The errors in a view; `None` where too few rays are in it.
fn figure(screen: &Screen, truth: &[Counts; 2], drawn: &[Counts; 2], rays: &Counts) -> Option<Figure> {
    let (mut power, mut of_model, mut of_rays, mut noise) = (0.0, 0.0, 0.0, 0.0);
    let (mut common, mut drawn_power, mut judging) = (0.0, 0.0, 0.0);
    for cell in screen.cells.clone() {
        let [(t1, vt1), (t2, vt2)] = [truth[0].share(screen.view, cell), truth[1].share(screen.view, cell)];
        let [(m1, vm1), (m2, vm2)] = [drawn[0].share(screen.view, cell), drawn[1].share(screen.view, cell)];
        let (r, _) = rays.share(screen.view, cell);
        power += t1 * t2;
        of_model += (t1 - m1) * (t2 - m2);
        of_rays += (t1 - r) * (t2 - r);
        noise += (vt1 + vm1) * (vt2 + vm2);
        common += 0.25 * (t1 + t2) * (m1 + m2);
        drawn_power += m1 * m2;
        for (share, variance) in [(t1, vt1), (t2, vt2)] {
            judging += if variance > 0.0 { share * share / variance } else { 0.0 };
        }
    }
    // Σ (t1 − x)(t2 − x) may be negative by chance where the error is small.
    let relative = |square: f64| (square.max(0.0) / power).sqrt();
    (judging >= FEWEST_RAYS && power > 0.0 && drawn_power > 0.0).then(|| Figure {
        view: screen.view,
        model: relative(of_model),
        rays: relative(of_rays),
        noise: relative(noise.sqrt()),
        correlation: (common / (power * drawn_power).sqrt()).min(1.0),
    })
}
