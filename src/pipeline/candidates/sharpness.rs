//! Where the light is sharpest: planes and spheres across the main direction, each judged by how well a radiance that is a function of
//! place times a function of direction on it predicts half of the rays, when it is learnt from the other half.

use super::patch::{LEAST_COSINE, LEAST_WIDTH, quantiles};
use crate::error::Error;
use crate::hull::focal::FocalSurface;
use crate::inspection::focus;
use crate::source::Ray;
use crate::vocabulary::space::Axis;
use crate::vocabulary::watch::StageWatch;
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};

/// Most rays that are looked at.
const MOST_RAYS: usize = 20_000;
/// Fewer tell nothing: some must be left in each place.
const FEWEST_RAYS: usize = 2 << (HALVINGS + 1);
/// Without a mean direction of this length (a Lambertian surface has 2/3) light has no main direction to lie across.
const DIRECTED: f64 = 0.25;
/// A main direction within this cosine, 3°, of an axis of the frame is that axis.
const ALONG_AXIS: f64 = 0.9986;
/// Least part of the flux that must meet a surface.
const MEETS: f64 = 0.98;
/// What is predicted for a ray that does not: this part of the flux from anywhere in the source's size in any direction.
const MISSED: f64 = 1e-3;
/// Halvings of the places: a few tens of rays are left in each.
const HALVINGS: u32 = 9;
/// Bins of directions, by the angle from the axis and round it.
const BINS: [usize; 2] = [24, 48];
/// Rounds in which place and direction are fitted to each other on a curved surface.
const ROUNDS: usize = 3;
/// Surfaces are looked for from the foremost origins to so many sizes of the source behind the last, ...
const BEHIND: f64 = 1.0;
/// ... and at the virtual focus, where that is within so many sizes.
const FOCUS_WITHIN: f64 = 3.0;
/// Planes that are tried first; and depths and curvatures of spheres, in units of two over the size.
const PLANES: usize = 25;
const DEPTHS: usize = 9;
const CURVATURES: [f64; 8] = [-0.9, -0.6, -0.3, 0.2, 0.4, 0.7, 1.0, 1.4];
/// Then places around the best, in steps that are halved so often where none is better, in at most so many rounds each: first by a few rays, ...
const COARSE: Effort = Effort { rays: 5_000, halvings: HALVINGS - 2, halved: 4 };
/// ... then by all, where the few rays show that it is worth it.
const FINE: Effort = Effort { rays: MOST_RAYS, halvings: HALVINGS, halved: 8 };
const MOST_ROUNDS: usize = 25;

/// A surface, and how sharp the light is on it.
#[derive(Clone, Copy, Debug)]
pub struct Sharp {
    /// The surface.
    pub surface: FocalSurface,
    /// Mean logarithm of the radiance that is predicted for the rays held out, their flux 1, mm and sr.
    pub log_radiance: f64,
}

/// How carefully surfaces are judged: by how many rays, in places halved how often, until steps were halved how often.
struct Effort {
    rays: usize,
    halvings: u32,
    halved: usize,
}

/// Mean logarithm of the radiance, and the curvature (1/mm) and the depth (mm) of the surface that has it.
type Tried = (f64, (f64, f64));

/// How far places around the best one lie from it.
#[derive(Clone, Copy)]
struct Steps {
    curvature_per_mm: f64,
    depth_mm: f64,
    /// How often they were halved.
    halved: usize,
}

impl Steps {
    /// The places around (curvature, depth); of a plane only those before and behind it.
    fn around(&self, (curvature, depth): (f64, f64)) -> Vec<(f64, f64)> {
        let aside = [(1.0, 0.0), (-1.0, 0.0), (1.0, -1.0), (-1.0, 1.0)];
        let ahead = [(0.0, 1.0), (0.0, -1.0)];
        let is_plane = self.curvature_per_mm == 0.0;
        let places = aside.iter().filter(|_| !is_plane).chain(&ahead);
        let places = places.map(|(c, z)| (curvature + c * self.curvature_per_mm, depth + z * self.depth_mm));
        places.filter(|(c, _)| is_plane || *c != 0.0).collect()
    }

    fn half(self) -> Steps {
        let Steps { curvature_per_mm, depth_mm, halved } = self;
        Steps { curvature_per_mm: curvature_per_mm / 2.0, depth_mm: depth_mm / 2.0, halved: halved + 1 }
    }
}

/// The rays by which surfaces are judged.
pub struct Search {
    rays: Vec<Ray>,
    axis: DVec3,
    center_mm: DVec3,
    size_mm: f64,
}

impl Search {
    /// Over some of `rays`, which are in random order; `None` where the light has no main direction.
    pub fn new(rays: &[Ray]) -> Option<Search> {
        let rays: Vec<Ray> = rays.iter().take(MOST_RAYS).copied().collect();
        let flux: f64 = rays.iter().map(Ray::weight).sum();
        let mean: DVec3 = rays.iter().map(|ray| ray.weight() * ray.direction).sum::<DVec3>() / flux;
        if rays.len() < FEWEST_RAYS || mean.is_nan() || mean.length() < DIRECTED {
            return None;
        }
        let nearest = Axis::nearest(mean).vector();
        let axis = if mean.normalize().dot(nearest) > ALONG_AXIS { nearest } else { mean.normalize() };
        let (across, _) = axis.any_orthonormal_pair();
        let mut range = [across, axis.cross(across), axis].map(|along| {
            let at = rays.iter().map(|ray| (ray.origin_mm.dot(along), ray.weight())).collect();
            quantiles(at, 1e-3)
        });
        let across_mm = (range[0][1] - range[0][0]).max(range[1][1] - range[1][0]);
        if range[2][1] - range[2][0] < 1e-9 * across_mm {
            range[2] = [0.5 * (range[2][0] + range[2][1]); 2];
        }
        let size_mm = range.iter().map(|[low, high]| high - low).fold(0.0, f64::max);
        let along = |at: [f64; 3]| at[0] * across + at[1] * axis.cross(across) + at[2] * axis;
        let center_mm = along([0.5 * (range[0][0] + range[0][1]), 0.5 * (range[1][0] + range[1][1]), range[2][1]]);
        (size_mm > 0.0).then_some(Search { rays, axis, center_mm, size_mm })
    }

    /// The plane across the main direction through the origins farthest ahead: what a flat source is.
    pub fn given(&self) -> Option<Sharp> {
        self.try_at(0.0, 0.0, &FINE)
    }

    /// The sharpest plane and the sharpest sphere: the plane where it is sharper than the one that is `given`, the sphere where it is sharper
    /// than both. Few rays tell that first.
    ///
    /// # Errors
    /// [`Error::Cancelled`].
    pub fn sharpest(&self, given: Option<Sharp>, watch: StageWatch<'_>) -> Result<[Option<Sharp>; 2], Error> {
        let depth_mm = |k: usize, count: usize| {
            let behind = self.depth_mm() + BEHIND * self.size_mm;
            -behind * (1.0 - k as f64 / (count - 1) as f64)
        };
        let mut planes: Vec<(f64, f64)> = (0..PLANES).map(|k| (0.0, depth_mm(k, PLANES))).collect();
        planes.extend(self.focus_depth_mm().map(|depth_mm| (0.0, depth_mm)));
        let spheres: Vec<(f64, f64)> = CURVATURES
            .iter()
            .flat_map(|curvature| (0..DEPTHS).map(move |k| (2.0 * curvature / self.size_mm, depth_mm(k, DEPTHS))))
            .collect();
        let mut least = given.and_then(|_| self.try_at(0.0, 0.0, &COARSE)).map(|given| given.log_radiance);
        let mut sharpest =
            |places: &[(f64, f64)], curvature_per_mm: f64, watch: StageWatch<'_>| -> Result<Option<Sharp>, Error> {
                let steps = Steps { curvature_per_mm, depth_mm: self.size_mm / 8.0, halved: 0 };
                let found = self.climb(places, steps, &COARSE, watch.part(0.0, 0.5))?;
                let Some((best, steps)) = found.filter(|(best, _)| least.is_none_or(|least| best.0 > least)) else {
                    return Ok(None);
                };
                least = Some(best.0);
                let found = self.climb(&[best.1], steps, &FINE, watch.part(0.5, 1.0))?;
                Ok(found.and_then(|((_, at), _)| self.try_at(at.0, at.1, &FINE)))
            };
        Ok([
            sharpest(&planes, 0.0, watch.part(0.0, 0.3))?,
            sharpest(&spheres, 0.6 / self.size_mm, watch.part(0.3, 1.0))?,
        ])
    }

    /// Where the virtual focus lies along the axis, mm; `None` where there is none within reach.
    fn focus_depth_mm(&self) -> Option<f64> {
        let mut sums = focus::Sums::default();
        self.rays.iter().for_each(|ray| sums.add(ray.origin_mm - self.center_mm, ray.direction, ray.weight()));
        let depth_mm = DVec3::from_array(sums.solve(DVec3::ZERO)?.point_mm).dot(self.axis);
        (depth_mm.abs() < FOCUS_WITHIN * self.size_mm).then_some(depth_mm)
    }

    /// How deep the origins lie behind those farthest ahead, mm.
    fn depth_mm(&self) -> f64 {
        let depth = |ray: &Ray| (self.center_mm - ray.origin_mm).dot(self.axis);
        quantiles(self.rays.iter().map(|ray| (depth(ray), ray.weight())).collect(), 1e-3)[1].max(0.0)
    }

    /// The best of `places` (curvature, depth), then of those around it in ever smaller steps; and the steps that are left. `None` where no
    /// place has a sharpness.
    fn climb(
        &self,
        places: &[(f64, f64)],
        mut steps: Steps,
        effort: &Effort,
        watch: StageWatch<'_>,
    ) -> Result<Option<(Tried, Steps)>, Error> {
        let best_of = |places: &[(f64, f64)], halved: usize| -> Result<Option<Tried>, Error> {
            let sharp = |at: &(f64, f64)| {
                watch.step(halved as f64 / effort.halved as f64)?;
                Ok(self.try_at(at.0, at.1, effort).map(|sharp| (sharp.log_radiance, *at)))
            };
            let tried = places.par_iter().map(sharp).collect::<Result<Vec<_>, Error>>()?;
            Ok(tried.into_iter().flatten().reduce(|best, next| if next.0 > best.0 { next } else { best }))
        };
        let Some(mut best) = best_of(places, steps.halved)? else { return Ok(None) };
        for _ in 0..MOST_ROUNDS {
            if steps.halved >= effort.halved {
                break;
            }
            match best_of(&steps.around(best.1), steps.halved)?.filter(|next| next.0 > best.0) {
                Some(next) => best = next,
                None => steps = steps.half(),
            }
        }
        Ok(Some((best, steps)))
    }

    fn try_at(&self, curvature_per_mm: f64, depth_mm: f64, effort: &Effort) -> Option<Sharp> {
        let surface = FocalSurface::new(self.center_mm + depth_mm * self.axis, self.axis, curvature_per_mm);
        let log_radiance =
            predicted(&surface, &self.rays[..self.rays.len().min(effort.rays)], self.size_mm, effort.halvings)
                .filter(|log| log.is_finite())?;
        Some(Sharp { surface, log_radiance })
    }
}

/// A ray on the surface that is judged.
struct Met {
    at_mm: DVec2,
    normal: DVec3,
    cosine: f64,
    bin: usize,
    weight: f64,
}

/// Mean logarithm of the radiance predicted for every second ray, learnt from the others; `None` where too many rays miss the surface.
fn predicted(surface: &FocalSurface, rays: &[Ray], size_mm: f64, halvings: u32) -> Option<f64> {
    let (mut halves, mut missed) = ([Vec::new(), Vec::new()], 0.0);
    for (k, ray) in rays.iter().enumerate() {
        match surface.meet(ray.origin_mm, ray.direction) {
            Some(crossing) => halves[k % 2].push(Met {
                at_mm: crossing.at_mm,
                normal: crossing.normal,
                cosine: crossing.cosine.max(LEAST_COSINE),
                bin: bin(surface.axes.transpose() * ray.direction),
                weight: ray.weight(),
            }),
            None => missed += ray.weight(),
        }
    }
    let [mut training, held_out] = halves;
    let met: f64 = training.iter().chain(&held_out).map(|met| met.weight).sum();
    if met < MEETS * (met + missed) || training.len() < 2 << halvings {
        return None;
    }
    let flux: f64 = training.iter().map(|met| met.weight).sum();
    training.iter_mut().for_each(|met| met.weight /= flux);
    let places = Places::of(&mut training, (LEAST_WIDTH * size_mm).powi(2), halvings);
    let solid_angles_sr = solid_angles_sr();
    let mut sent = vec![0.0; solid_angles_sr.len()];
    training.iter().for_each(|met| sent[met.bin] += met.weight);
    let floor = 1.0 / training.len() as f64;
    sent.iter_mut().zip(&solid_angles_sr).for_each(|(sent, sr)| *sent += 0.3 * floor * sr / (2.0 * TAU));
    let log_of = |of: &dyn Fn(&Met) -> f64| {
        let judged: f64 = held_out.iter().map(|met| met.weight).sum();
        let sum: f64 = held_out.iter().map(|met| met.weight * of(met).max(f64::MIN_POSITIVE).ln()).sum();
        let anywhere = MISSED / (4.0 * PI * size_mm * size_mm);
        (met * sum / judged + missed * anywhere.ln()) / (met + missed)
    };
    if surface.curvature_per_mm == 0.0 {
        let whole: f64 = sent.iter().sum();
        return Some(log_of(&|met| {
            places.exitance(places.find(met.at_mm)) * sent[met.bin] / solid_angles_sr[met.bin] / whole / met.cosine
        }));
    }
    // Radiance B(place) l(direction): both fitted until the sums over either are those of the rays.
    let directions = bin_directions();
    let normals = places.normals(&training);
    let inverse = surface.axes.transpose();
    let projected: Vec<Vec<f64>> = normals
        .iter()
        .map(|normal| directions.iter().map(|d| d.dot(inverse * *normal).max(LEAST_COSINE)).collect())
        .collect();
    let (mut of_place, mut of_direction) = (vec![0.0; normals.len()], vec![1.0; sent.len()]);
    (0..normals.len()).for_each(|place| of_place[place] = places.exitance(place));
    for _ in 0..ROUNDS {
        let mut met = vec![0.0; sent.len()];
        for (place, projected) in projected.iter().enumerate() {
            let scale = of_place[place] * places.areas_mm2[place];
            met.iter_mut().zip(projected).for_each(|(sum, cosine)| *sum += scale * cosine);
        }
        for bin in 0..sent.len() {
            of_direction[bin] = sent[bin] / (solid_angles_sr[bin] * met[bin]).max(f64::MIN_POSITIVE);
        }
        let light: Vec<f64> = of_direction.iter().zip(&solid_angles_sr).map(|(l, sr)| l * sr).collect();
        for (place, projected) in projected.iter().enumerate() {
            of_place[place] = places.exitance(place) / dot(projected, &light).max(f64::MIN_POSITIVE);
        }
    }
    Some(log_of(&|met| of_place[places.find(met.at_mm)] * of_direction[met.bin]))
}

/// Sum of products; in sums side by side, which need not wait for each other.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 8];
    for (a, b) in a.chunks(sums.len()).zip(b.chunks(sums.len())) {
        sums.iter_mut().zip(a.iter().zip(b)).for_each(|(sum, (a, b))| *sum += a * b);
    }
    sums.iter().sum()
}

/// A rectangle halved again and again where half of the rays lie: places with about equally many rays.
struct Places {
    /// Axis and coordinate of each cut, as a heap from 1.
    cuts: Vec<(usize, f64)>,
    areas_mm2: Vec<f64>,
    flux: Vec<f64>,
}

impl Places {
    fn of(rays: &mut [Met], least_mm2: f64, halvings: u32) -> Places {
        let count = 1 << halvings;
        let mut places = Places { cuts: vec![(0, 0.0); count], areas_mm2: vec![0.0; count], flux: vec![0.0; count] };
        let (mut least, mut greatest) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        rays.iter().for_each(|met| (least, greatest) = (least.min(met.at_mm), greatest.max(met.at_mm)));
        places.halve(1, rays, least, greatest);
        places.areas_mm2.iter_mut().for_each(|area| *area = area.max(least_mm2));
        places
    }

    fn halve(&mut self, node: usize, rays: &mut [Met], least: DVec2, greatest: DVec2) {
        if node >= self.cuts.len() {
            let place = node - self.cuts.len();
            self.areas_mm2[place] = (greatest - least).element_product();
            self.flux[place] = rays.iter().map(|met| met.weight).sum();
            return;
        }
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        rays.iter().for_each(|met| (low, high) = (low.min(met.at_mm), high.max(met.at_mm)));
        let axis = usize::from(high.y - low.y > high.x - low.x);
        let middle = rays.len() / 2;
        rays.select_nth_unstable_by(middle, |a, b| a.at_mm[axis].total_cmp(&b.at_mm[axis]));
        let cut = rays[middle].at_mm[axis];
        self.cuts[node] = (axis, cut);
        let (near, far) = rays.split_at_mut(middle);
        let (mut upper, mut lower) = (greatest, least);
        upper[axis] = cut;
        lower[axis] = cut;
        self.halve(2 * node, near, least, upper);
        self.halve(2 * node + 1, far, lower, greatest);
    }

    fn find(&self, at_mm: DVec2) -> usize {
        let mut node = 1;
        while node < self.cuts.len() {
            let (axis, cut) = self.cuts[node];
            node = 2 * node + usize::from(at_mm[axis] >= cut);
        }
        node - self.cuts.len()
    }

    fn exitance(&self, place: usize) -> f64 {
        self.flux[place] / self.areas_mm2[place]
    }

    fn normals(&self, rays: &[Met]) -> Vec<DVec3> {
        let mut sums = vec![DVec3::ZERO; self.flux.len()];
        rays.iter().for_each(|met| sums[self.find(met.at_mm)] += met.normal);
        sums.into_iter().map(DVec3::normalize_or_zero).collect()
    }
}

/// The bin of a direction in the frame of a surface.
fn bin(direction: DVec3) -> usize {
    let [polar, round] = BINS;
    let angle = direction.z.clamp(-1.0, 1.0).acos() / PI;
    let turn = (direction.y.atan2(direction.x) / TAU).rem_euclid(1.0);
    let along = |part: f64, count: usize| ((part * count as f64) as usize).min(count - 1);
    along(angle, polar) * round + along(turn, round)
}

fn bin_directions() -> Vec<DVec3> {
    let [polar, round] = BINS;
    let direction = |k: usize| {
        let (angle, turn) = ((k / round) as f64 + 0.5, (k % round) as f64 + 0.5);
        let ((sin, cos), (y, x)) = ((angle * PI / polar as f64).sin_cos(), (turn * TAU / round as f64).sin_cos());
        DVec3::new(sin * x, sin * y, cos)
    };
    (0..polar * round).map(direction).collect()
}

fn solid_angles_sr() -> Vec<f64> {
    let [polar, round] = BINS;
    let edge = |k: usize| (k as f64 * PI / polar as f64).cos();
    (0..polar * round).map(|k| (edge(k / round) - edge(k / round + 1)) * TAU / round as f64).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::known_sources::uniform;
    use crate::vocabulary::watch::{NoProgress, Stage};
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;

    /// Lambertian light of points of `surface` within a square of 1 mm, its origins slid `slide_mm` ahead.
    fn rays(surface: &FocalSurface, slide_mm: f64) -> Vec<Ray> {
        let mut random = ChaCha8Rng::seed_from_u64(5);
        let mut ray = || {
            let [x, y, u, turn] = [0; 4].map(|_| uniform(&mut random));
            let direction = DVec3::new(u.sqrt() * (TAU * turn).cos(), u.sqrt() * (TAU * turn).sin(), (1.0 - u).sqrt());
            let aim_mm = surface.apex_mm + surface.axes * DVec3::new(x - 0.5, y - 0.5, 0.0);
            let origin_mm = aim_mm + slide_mm / direction.z * (surface.axes * direction);
            let direction = surface.axes * direction;
            Ray { origin_mm, direction, radiant_w: 1.0, luminous_lm: 0.0, column: 0, xz_lm: [0.0; 2] }
        };
        (0..20_000).map(|_| ray()).collect()
    }

    /// The edge of a square of 1 mm is sharp within some hundredths of a millimetre where it lies, and nowhere else.
    #[test]
    fn the_plane_of_a_square_is_found_from_rays_that_start_elsewhere() {
        for axis in [DVec3::Z, DVec3::NEG_Y, DVec3::new(0.6, 0.0, 0.8)] {
            let truth = FocalSurface::new(DVec3::new(3.0, -1.0, 2.0), axis, 0.0);
            let search = Search::new(&rays(&truth, 1.0)).unwrap();
            let watch = StageWatch::enter(&NoProgress, Stage::Hull).unwrap();
            let [plane, _] = search.sharpest(None, watch).unwrap();
            let found = plane.unwrap().surface;
            assert!(found.axes.z_axis.dot(axis) > 0.9998, "{found:?}");
            let off_mm = (found.apex_mm - truth.apex_mm).dot(axis);
            assert!(off_mm.abs() < 0.03, "{off_mm} mm off");
        }
    }

    #[test]
    fn light_without_direction_and_few_rays_have_no_focal_surface() {
        let truth = FocalSurface::new(DVec3::ZERO, DVec3::Z, 0.0);
        let mut all = rays(&truth, 1.0);
        assert!(Search::new(&all[..FEWEST_RAYS - 1]).is_none());
        all.iter_mut().step_by(2).for_each(|ray| ray.direction = -ray.direction);
        assert!(Search::new(&all).is_none());
    }
}
