//! Intensity in the three planes of the axes, for a first look at the far field.
//!
//! Rays within 5° of a plane are counted by their angle in it. By Archimedes' hat-box theorem the directions with
//! |d · n| < s whose angle in the plane spans Δφ have the solid angle 2 s Δφ, exactly.

use crate::vocabulary::space::Axis;
use glam::DVec3;
use std::f64::consts::TAU;

/// Angles in a plane: bins of 5° about 0°, 5°, 10° and so on.
pub const ANGLES: usize = 72;
/// sin 5°: half the thickness of what counts as in the plane.
const SLAB: f64 = 0.087_155_742_747_658_17;

/// Flux by angle in the planes normal to x, y and z.
#[derive(Clone, Debug, PartialEq)]
pub struct Meridians {
    flux: [[f64; ANGLES]; 3],
}

impl Meridians {
    /// No light.
    pub fn dark() -> Meridians {
        Meridians { flux: [[0.0; ANGLES]; 3] }
    }

    /// A ray of flux `weight` along the unit vector `direction`.
    pub fn add(&mut self, direction: DVec3, weight: f64) {
        for normal in 0..3 {
            if direction[normal].abs() < SLAB {
                self.flux[normal][bin(normal, direction)] += weight;
            }
        }
    }

    /// Adds the flux of other rays.
    pub fn merge(&mut self, other: &Meridians) {
        for (sums, parts) in self.flux.iter_mut().zip(&other.flux) {
            sums.iter_mut().zip(parts).for_each(|(sum, part)| *sum += part);
        }
    }

    /// Flux per sr about `direction`, which lies in the plane normal to `normal`: the mean over 5° in the plane and 10° across.
    pub fn intensity(&self, normal: Axis, direction: DVec3) -> f64 {
        let normal = normal.component();
        self.flux[normal][bin(normal, direction)] / (2.0 * SLAB * TAU / ANGLES as f64)
    }
}

fn bin(normal: usize, direction: DVec3) -> usize {
    let angle = direction[(normal + 2) % 3].atan2(direction[(normal + 1) % 3]);
    (angle / TAU * ANGLES as f64).round().rem_euclid(ANGLES as f64) as usize % ANGLES
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Evenly spread directions: 1/4π per sr everywhere, whatever the bin.
    #[test]
    fn light_into_all_directions_has_the_same_intensity_in_every_bin() {
        const RAYS: usize = 400_000;
        let mut meridians = Meridians::dark();
        for k in 0..RAYS {
            let z = 1.0 - 2.0 * (k as f64 + 0.5) / RAYS as f64;
            let c = 2.399_963_229_728_653 * k as f64;
            let direction = DVec3::new((1.0 - z * z).sqrt() * c.cos(), (1.0 - z * z).sqrt() * c.sin(), z);
            meridians.add(direction, 1.0 / RAYS as f64);
        }
        for (normal, u, v) in [
            (Axis::PosX, Axis::PosY, Axis::PosZ),
            (Axis::NegY, Axis::PosZ, Axis::PosX),
            (Axis::PosZ, Axis::PosX, Axis::NegY),
        ] {
            for step in 0..ANGLES {
                let angle = step as f64 * TAU / ANGLES as f64;
                let direction = angle.cos() * u.vector() + angle.sin() * v.vector();
                let intensity = meridians.intensity(normal, direction) * 2.0 * TAU;
                // About 480 rays a bin; a spiral is more even than chance (1/√480 = 4.6 %).
                assert!((intensity - 1.0).abs() < 0.05, "{normal:?} {step}: {intensity}");
            }
        }
    }
}
