//! How wide the beam is, which decides how fine its grid must be.

use super::orientation::{BELT_DEG, FLUX_OF_BELT};
use crate::inspection::beam::{Beam as Bundle, FARTHEST_DEG, NARROWEST_DEG, NODES_IN_BEAM};
use crate::rays::direction_cube::DirectionCube;
use glam::DVec3;
use std::f64::consts::{PI, TAU};

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

/// Beams narrower than this, degrees, have nodes of their own.
const NARROW_DEG: f64 = 40.0;
/// How far from the middle nodes of γ lie close together, in full widths, and how they grow apart beyond.
const CLOSE: f64 = 1.5;
const GROWTH: f64 = 1.12;
/// C planes: at least, at most, and steps of C in the beam's width where it crosses the farthest γ of the beam.
const C_PLANES: (f64, f64) = (72.0, 180.0);
const C_STEPS_IN_BEAM: f64 = 6.0;

/// Nodes in the width of a belt, and the farthest apart elsewhere, degrees.
const NODES_IN_BELT: f64 = 10.0;
const FARTHEST_FROM_BELT_DEG: f64 = 5.0;
/// Bins of γ in which belts are looked for, and the rays that three of them must hold to be bright.
const BINS: usize = 180;
const RAYS_OF_BRIGHT_BINS: f64 = 64.0;

/// Light too narrow for even steps of γ.
pub enum NarrowLight {
    /// Most rays lie near one direction.
    Beam {
        /// Least and greatest full width at half maximum, degrees.
        widths_deg: [f64; 2],
        /// Angle of its axis from γ = 0, degrees.
        axis_deg: f64,
    },
    /// Light that goes all round the axis of C at nearly one γ, as that of a lens which sends it to the sides.
    Belt {
        /// Full width at half maximum, degrees.
        width_deg: f64,
        /// Its γ, degrees.
        middle_deg: f64,
        /// Part of its nodes of γ that are lit.
        lit: f64,
    },
}

impl NarrowLight {
    /// Of rays (unit directions and weights), most of them near the `brightest` direction; `None` where they are not narrow. γ = 0 at `nadir`.
    pub fn of(rays: &[(DVec3, f64)], brightest: DVec3, nadir: DVec3) -> Option<NarrowLight> {
        NarrowLight::beam(rays, brightest, nadir).or_else(|| NarrowLight::belt(rays, nadir))
    }

    fn beam(rays: &[(DVec3, f64)], brightest: DVec3, nadir: DVec3) -> Option<NarrowLight> {
        let bundle = Bundle::of(rays, brightest).filter(|bundle| !bundle.wide)?;
        let (least_deg, greatest_deg) = bundle.gaussian_widths_deg();
        let axis_deg = nadir.cross(bundle.axis).length().atan2(nadir.dot(bundle.axis)).to_degrees();
        (least_deg < NARROW_DEG).then_some(NarrowLight::Beam { widths_deg: [least_deg, greatest_deg], axis_deg })
    }

    fn belt(rays: &[(DVec3, f64)], nadir: DVec3) -> Option<NarrowLight> {
        let mut bins = [[0.0; 2]; BINS];
        for (direction, weight) in rays {
            let gamma = nadir.cross(*direction).length().atan2(nadir.dot(*direction));
            let bin = &mut bins[((gamma / PI * BINS as f64) as usize).min(BINS - 1)];
            *bin = [bin[0] + weight, bin[1] + 1.0];
        }
        let border = |bin: usize| (PI * bin as f64 / BINS as f64).cos();
        // Means of three bins are less noisy; at the poles there is no belt.
        let window = |bin: usize| {
            let [flux, rays] = [0, 1].map(|part| bins[bin - 1..=bin + 1].iter().map(|bin| bin[part]).sum::<f64>());
            (flux / (border(bin - 1) - border(bin + 2)), rays)
        };
        let bright = (1..BINS - 1).filter(|bin| window(*bin).1 >= RAYS_OF_BRIGHT_BINS);
        let peak = bright.max_by(|a, b| window(*a).0.total_cmp(&window(*b).0))?;
        let half = 0.5 * window(peak).0;
        let first = (0..peak).rev().find(|bin| *bin == 0 || window(*bin).0 < half)? + 1;
        let end = (peak + 1..BINS).find(|bin| *bin == BINS - 1 || window(*bin).0 < half)?;
        let flux: f64 = bins[first..end].iter().map(|[flux, _]| flux).sum();
        let total: f64 = bins.iter().map(|[flux, _]| flux).sum();
        let bin_deg = 180.0 / BINS as f64;
        let width_deg = (end - first) as f64 * bin_deg;
        if !(first > 1 && end < BINS - 1 && width_deg <= BELT_DEG && flux >= FLUX_OF_BELT * total) {
            return None;
        }
        let middle_deg = 0.5 * (first + end) as f64 * bin_deg;
        let nodes = nodes_of_belt(middle_deg, width_deg);
        let is_lit = |gamma_deg: &&f64| bins[((**gamma_deg / bin_deg) as usize).min(BINS - 1)][1] > 0.0;
        let lit = nodes.iter().filter(is_lit).count() as f64 / nodes.len() as f64;
        Some(NarrowLight::Belt { width_deg, middle_deg, lit })
    }

    /// Part of the nodes of γ that are lit, at most.
    pub fn lit(&self) -> f64 {
        match self {
            NarrowLight::Beam { .. } => 1.0,
            NarrowLight::Belt { lit, .. } => *lit,
        }
    }

    /// A direction as it is counted: of a beam that is narrower than any grid, turned by a random angle that depends on the `seed` alone, so that the
    /// beam is a Gaussian of the least width.
    pub fn shown(&self, direction: DVec3, seed: u64) -> DVec3 {
        match self {
            NarrowLight::Beam { widths_deg: [least_deg, _], .. } if *least_deg <= NARROWEST_DEG => {}
            _ => return direction,
        }
        let part = |bits: u64| ((bits & 0xffff_ffff) as f64 + 0.5) / 4_294_967_296.0;
        let radius = (NARROWEST_DEG / 2.355).to_radians() * (-2.0 * part(seed).ln()).sqrt();
        let (sin, cos) = (TAU * part(seed >> 32)).sin_cos();
        let (u, v) = direction.any_orthonormal_pair();
        (direction + radius * (cos * u + sin * v)).normalize()
    }

    /// Nodes of γ, degrees, close together in the light, and how many C planes.
    pub fn nodes(&self) -> (Vec<f64>, usize) {
        match *self {
            NarrowLight::Beam { widths_deg, axis_deg } => nodes_of_beam(widths_deg, axis_deg),
            NarrowLight::Belt { width_deg, middle_deg, .. } => {
                (nodes_of_belt(middle_deg, width_deg), C_PLANES.0 as usize)
            }
        }
    }
}

/// Nodes of γ round a beam, degrees, and how many C planes.
fn nodes_of_beam([least_deg, greatest_deg]: [f64; 2], axis_deg: f64) -> (Vec<f64>, usize) {
    let from_pole_deg = axis_deg.min(180.0 - axis_deg);
    let is_centred = from_pole_deg < 0.5 * least_deg;
    let pole_deg = if axis_deg < 90.0 { 0.0 } else { 180.0 };
    let nodes = nodes_near(if is_centred { pole_deg } else { axis_deg }, least_deg, NODES_IN_BEAM, FARTHEST_DEG);
    let outermost_deg = if is_centred { 0.5 * greatest_deg } else { from_pole_deg };
    let across_deg = outermost_deg.min(90.0).to_radians().sin() * 360.0;
    let is_round = is_centred && greatest_deg < 1.3 * least_deg;
    let (fewest, most) = C_PLANES;
    let wanted = if is_round { fewest } else { C_STEPS_IN_BEAM * across_deg / least_deg };
    (nodes, (wanted.clamp(fewest, most) / 12.0).ceil() as usize * 12)
}

fn nodes_of_belt(middle_deg: f64, width_deg: f64) -> Vec<f64> {
    nodes_near(middle_deg, width_deg, NODES_IN_BELT, FARTHEST_FROM_BELT_DEG)
}

/// Nodes of γ from 0 to 180, degrees: so many in a width round the middle, farther and farther apart beyond.
fn nodes_near(middle_deg: f64, width_deg: f64, nodes_in_width: f64, farthest_deg: f64) -> Vec<f64> {
    // A millionth of a degree is what files hold.
    let rounded = |at: f64| (at * 1e6).round() / 1e6;
    let middle_deg = rounded(middle_deg);
    let walk = |sign: f64| {
        let (mut nodes, mut at, mut step) = (Vec::new(), middle_deg, width_deg / nodes_in_width);
        let end = if sign > 0.0 { 180.0 } else { 0.0 };
        while sign * (end - at) > 1.5 * step {
            if (at - middle_deg).abs() >= CLOSE * width_deg {
                step = (step * GROWTH).min(farthest_deg);
            }
            at += sign * step;
            nodes.push(rounded(at));
        }
        nodes.retain(|at| (at - end).abs() > 0.5 * step);
        nodes.push(end);
        nodes
    };
    let mut nodes = vec![middle_deg];
    for sign in [1.0, -1.0].into_iter().filter(|sign| if *sign > 0.0 { middle_deg < 180.0 } else { middle_deg > 0.0 }) {
        nodes.extend(walk(sign));
    }
    nodes.sort_unstable_by(f64::total_cmp);
    nodes.dedup();
    nodes
}
