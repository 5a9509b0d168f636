//! How wide the beam is, which decides how fine its grid must be.

use crate::rays::direction_cube::DirectionCube;
use glam::DVec3;
use std::f64::consts::TAU;

/// The part of the far field above half maximum.
pub struct Beam {
    solid_angle_sr: f64,
    pub rays: f64,
}

impl Beam {
    pub fn of(directions: &DirectionCube) -> Beam {
        let cells = directions.flux.iter().zip(&directions.rays).enumerate();
        let mut bright: Vec<(f64, f64, f64)> = cells
            .map(|(cell, (flux, rays))| {
                (flux / DirectionCube::solid_angle_sr(cell), DirectionCube::solid_angle_sr(cell), *rays as f64)
            })
            .filter(|(intensity, ..)| *intensity > 0.0)
            .collect();
        bright.sort_by(|a, b| b.0.total_cmp(&a.0));
        // The maximum of many noisy cells is mostly noise: take the mean of those that carry the brightest twentieth of the flux.
        let total: f64 = bright.iter().map(|(intensity, solid_angle, _)| intensity * solid_angle).sum();
        let (mut flux, mut solid_angle_sr) = (0.0, 0.0);
        for (intensity, solid_angle, _) in &bright {
            if flux >= 0.05 * total {
                break;
            }
            flux += intensity * solid_angle;
            solid_angle_sr += solid_angle;
        }
        let half = 0.5 * flux / solid_angle_sr;
        let mut beam = Beam { solid_angle_sr: 0.0, rays: 0.0 };
        for (_, solid_angle, rays) in bright.iter().take_while(|(intensity, ..)| *intensity >= half) {
            beam.solid_angle_sr += solid_angle;
            beam.rays += rays;
        }
        beam
    }

    /// Full width at half maximum, degrees: that of the round beam of the same solid angle.
    pub fn full_width_deg(&self) -> f64 {
        let cosine = 1.0 - self.solid_angle_sr / TAU;
        2.0 * cosine.clamp(-1.0, 1.0).acos().to_degrees()
    }

    /// Edge of the square cell that holds `rays` of the beam's rays, degrees.
    pub fn cell_deg(&self, rays: f64) -> f64 {
        (rays * self.solid_angle_sr / self.rays).sqrt().to_degrees()
    }
}

/// Rays within so many times the half width of a beam belong to it.
const REACH: f64 = 4.0;
/// Rounds in which axis and half width of a beam are found, from this width on, degrees.
const ROUNDS: usize = 24;
const WIDEST_DEG: f64 = 90.0;
/// Beams narrower than this, degrees, have nodes of their own, ...
const NARROW_DEG: f64 = 40.0;
/// ... and those narrower than this are written as wide as this: intensities of parallel light have no other meaning.
const NARROWEST_DEG: f64 = 0.02;
/// Fewer rays tell nothing of a beam, and this part of all must belong to it.
const FEWEST_RAYS: usize = 200;
const LEAST_PART: f64 = 0.5;
/// Nodes of γ in the full width at half maximum, how far from the middle they lie so close, in full widths, and how they grow apart beyond.
const NODES_IN_BEAM: f64 = 16.0;
const CLOSE: f64 = 1.5;
const GROWTH: f64 = 1.12;
const FARTHEST_DEG: f64 = 2.5;
/// C planes: at least, at most, and steps of C in the beam's width where it crosses the farthest γ of the beam.
const C_PLANES: (f64, f64) = (72.0, 180.0);
const C_STEPS_IN_BEAM: f64 = 6.0;

/// A beam too narrow for even steps of γ: its least and greatest full width at half maximum, and the angle of its axis from γ = 0.
pub struct NarrowBeam {
    least_deg: f64,
    greatest_deg: f64,
    axis_deg: f64,
}

impl NarrowBeam {
    /// Of rays (unit directions and weights), most of them near the `brightest` direction; `None` where they are no narrow beam. γ = 0 at `nadir`.
    pub fn of(rays: &[(DVec3, f64)], brightest: DVec3, nadir: DVec3) -> Option<NarrowBeam> {
        let total: f64 = rays.iter().map(|(_, weight)| weight).sum();
        let (mut axis, mut reach) = (brightest, WIDEST_DEG.to_radians());
        let angle = |axis: DVec3, direction: DVec3| axis.cross(direction).length().atan2(axis.dot(direction));
        let mut within: Vec<(f64, f64)> = Vec::new();
        for _ in 0..ROUNDS {
            let near = || rays.iter().filter(|(direction, _)| angle(axis, *direction) <= reach);
            axis = near().map(|(direction, weight)| *weight * *direction).sum::<DVec3>().normalize_or(axis);
            let near = || rays.iter().map(|(direction, weight)| (angle(axis, *direction), *weight));
            within = near().filter(|(off, _)| *off <= reach).collect();
            within.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
            let all: f64 = within.iter().map(|(_, weight)| weight).sum();
            let mut seen = 0.0;
            let half = within.iter().find(|(_, weight)| {
                seen += weight;
                2.0 * seen >= all
            });
            let (half_width, _) = half?;
            let next = (REACH * half_width).max(NARROWEST_DEG.to_radians());
            if next > WIDEST_DEG.to_radians() {
                return None;
            }
            reach = next;
        }
        let part: f64 = within.iter().map(|(_, weight)| weight).sum::<f64>() / total;
        if within.len() < FEWEST_RAYS || part < LEAST_PART {
            return None;
        }
        // Second moments across the axis; of a Gaussian the full width is 2.355 standard deviations.
        let (u, v) = axis.any_orthonormal_pair();
        let (mut moments, mut weights) = ([0.0; 3], 0.0);
        for (direction, weight) in rays.iter().filter(|(direction, _)| angle(axis, *direction) <= reach) {
            let (x, y) = (direction.dot(u), direction.dot(v));
            moments = [moments[0] + weight * x * x, moments[1] + weight * x * y, moments[2] + weight * y * y];
            weights += weight;
        }
        let [xx, xy, yy] = moments.map(|moment| moment / weights);
        let (mean, spread) = (0.5 * (xx + yy), (0.5 * (xx - yy)).hypot(xy));
        let width_deg = |variance: f64| (2.355 * variance.max(0.0).sqrt()).to_degrees().max(NARROWEST_DEG);
        let beam = NarrowBeam {
            least_deg: width_deg(mean - spread),
            greatest_deg: width_deg(mean + spread),
            axis_deg: angle(nadir, axis).to_degrees(),
        };
        (beam.least_deg < NARROW_DEG).then_some(beam)
    }

    /// A direction as it is counted: of a beam that is narrower than any grid, turned by a random angle that depends on the `seed` alone, so that the
    /// beam is a Gaussian of the least width.
    pub fn shown(&self, direction: DVec3, seed: u64) -> DVec3 {
        if self.least_deg > NARROWEST_DEG {
            return direction;
        }
        let part = |bits: u64| ((bits & 0xffff_ffff) as f64 + 0.5) / 4_294_967_296.0;
        let radius = (NARROWEST_DEG / 2.355).to_radians() * (-2.0 * part(seed).ln()).sqrt();
        let (sin, cos) = (TAU * part(seed >> 32)).sin_cos();
        let (u, v) = direction.any_orthonormal_pair();
        (direction + radius * (cos * u + sin * v)).normalize()
    }

    /// Nodes of γ, degrees, close together in the beam, and how many C planes.
    pub fn nodes(&self) -> (Vec<f64>, usize) {
        let close_deg = self.least_deg / NODES_IN_BEAM;
        let from_pole_deg = self.axis_deg.min(180.0 - self.axis_deg);
        let centred = from_pole_deg < 0.5 * self.least_deg;
        let pole_deg = if self.axis_deg < 90.0 { 0.0 } else { 180.0 };
        let middle_deg = if centred { pole_deg } else { (self.axis_deg * 1e6).round() / 1e6 };
        let reach_deg = CLOSE * self.least_deg;
        let walk = |sign: f64| {
            let (mut nodes, mut at, mut step) = (Vec::new(), middle_deg, close_deg);
            let end = if sign > 0.0 { 180.0 } else { 0.0 };
            while sign * (end - at) > 1.5 * step {
                if (at - middle_deg).abs() >= reach_deg {
                    step = (step * GROWTH).min(FARTHEST_DEG);
                }
                at += sign * step;
                // A millionth of a degree is what files hold.
                nodes.push((at * 1e6).round() / 1e6);
            }
            nodes.retain(|at| (at - end).abs() > 0.5 * step);
            nodes.push(end);
            nodes
        };
        let mut nodes = vec![middle_deg];
        for sign in
            [1.0, -1.0].into_iter().filter(|sign| if *sign > 0.0 { middle_deg < 180.0 } else { middle_deg > 0.0 })
        {
            nodes.extend(walk(sign));
        }
        nodes.sort_unstable_by(f64::total_cmp);
        nodes.dedup();
        let farthest_deg = if centred { 0.5 * self.greatest_deg } else { from_pole_deg };
        let across_deg = farthest_deg.min(90.0).to_radians().sin() * 360.0;
        let round = centred && self.greatest_deg < 1.3 * self.least_deg;
        let (fewest, most) = C_PLANES;
        let wanted = if round { fewest } else { C_STEPS_IN_BEAM * across_deg / self.least_deg };
        (nodes, (wanted.clamp(fewest, most) / 12.0).ceil() as usize * 12)
    }
}
