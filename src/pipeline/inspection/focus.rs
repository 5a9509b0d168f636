//! The virtual focus: the point nearest to all ray lines (J. Muschaweck, *Virtual focus of a ray data source*, 2019, eq. 13).
//!
//! F = argmin Σ w |(1 − d dᵀ)(F − o)|², hence A F = b with A = Σ w (1 − d dᵀ), b = Σ w (1 − d dᵀ) o. It does not change when
//! origins slide along their rays, is the true focus where there is one, and does not exist for a collimated beam.

use glam::{DMat3, DVec3};
use schemars::JsonSchema;
use serde::Serialize;
use std::f64::consts::FRAC_PI_3;

/// Largest condition number of A up to which a focus is reported. A cone of half-angle θ has about 4/θ²: this one is 2 mrad, at
/// which f32 directions (6e-8) still give the depth to 3e-5 of a distance.
const WORST_CONDITION: f64 = 1e6;

/// Where the light seems to come from: the point with the least flux-weighted sum of squared distances to the ray lines.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Focus {
    /// The point, mm.
    pub point_mm: [f64; 3],
    /// Condition number of the matrix the point is solved from: 1 for light into all directions, larger for narrow beams.
    pub condition: f64,
    /// Flux-weighted root mean square distance of the ray lines from it, mm.
    pub rms_distance_mm: f64,
    /// Distance that 99 % of the flux comes within, mm; of the sampled rays.
    pub distance_99_mm: f64,
    /// Standard error of the point along its least certain direction, mm.
    pub standard_error_mm: f64,
}

/// Sums over rays; positions are relative to a pivot near the rays, so that they do not cancel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sums {
    weight: f64,
    weight_square: f64,
    /// Σ w d dᵀ: xx, yy, zz, xy, xz, yz.
    outer: [f64; 6],
    b: DVec3,
    /// Σ w |(1 − d dᵀ) o|².
    c: f64,
    /// Σ w d.
    flux_vector: DVec3,
}

impl Sums {
    /// A ray of flux `weight` through `origin` along the unit vector `direction`.
    pub fn add(&mut self, origin: DVec3, direction: DVec3, weight: f64) {
        let d = direction;
        let foot = origin - origin.dot(d) * d;
        let wd = weight * d;
        self.weight += weight;
        self.weight_square += weight * weight;
        let products = [wd.x * d.x, wd.y * d.y, wd.z * d.z, wd.x * d.y, wd.x * d.z, wd.y * d.z];
        self.outer.iter_mut().zip(products).for_each(|(sum, product)| *sum += product);
        self.b += weight * foot;
        self.c += weight * foot.length_squared();
        self.flux_vector += wd;
    }

    /// Adds the sums of other rays.
    pub fn merge(&mut self, other: &Sums) {
        self.weight += other.weight;
        self.weight_square += other.weight_square;
        self.outer.iter_mut().zip(other.outer).for_each(|(sum, part)| *sum += part);
        self.b += other.b;
        self.c += other.c;
        self.flux_vector += other.flux_vector;
    }

    /// Flux of all rays.
    pub fn weight(&self) -> f64 {
        self.weight
    }

    /// Mean direction of the flux: 2/3 long for a Lambertian surface, 1 for a collimated beam, 0 for light into all directions.
    pub fn mean_direction(&self) -> DVec3 {
        if self.weight > 0.0 { self.flux_vector / self.weight } else { DVec3::ZERO }
    }

    /// (Σ w)² / Σ w²: how many rays of equal flux would be as noisy.
    pub fn effective_rays(&self) -> f64 {
        if self.weight_square > 0.0 { self.weight * self.weight / self.weight_square } else { 0.0 }
    }

    /// The focus, [`Focus::distance_99_mm`] still 0; `None` where rays are collimated or there are none.
    pub fn solve(&self, pivot: DVec3) -> Option<Focus> {
        if !(self.weight > 0.0 && self.weight.is_finite()) {
            return None;
        }
        let [xx, yy, zz, xy, xz, yz] = self.outer.map(|value| value / self.weight);
        let a = DMat3::from_cols(
            DVec3::new(1.0 - xx, -xy, -xz),
            DVec3::new(-xy, 1.0 - yy, -yz),
            DVec3::new(-xz, -yz, 1.0 - zz),
        );
        let [largest, smallest] = extreme_eigenvalues(a);
        let condition = largest / smallest;
        if !(smallest > 0.0 && condition <= WORST_CONDITION) {
            return None;
        }
        let b = self.b / self.weight;
        let f = a.inverse() * b;
        let square = (f.dot(a * f) - 2.0 * f.dot(b) + self.c / self.weight).max(0.0);
        // Each foot scatters by square/2 along each of its two directions: Cov F ≈ square/2 · Σw²/(Σw)² · A⁻¹.
        let standard_error_mm = (0.5 * square / (self.effective_rays() * smallest)).sqrt();
        Some(Focus {
            point_mm: (pivot + f).to_array(),
            condition,
            rms_distance_mm: square.sqrt(),
            distance_99_mm: 0.0,
            standard_error_mm,
        })
    }
}

/// Largest and smallest eigenvalue of a symmetric matrix (the trigonometric closed form of the cubic).
fn extreme_eigenvalues(m: DMat3) -> [f64; 2] {
    let mean = (m.x_axis.x + m.y_axis.y + m.z_axis.z) / 3.0;
    let rest = m - DMat3::from_diagonal(DVec3::splat(mean));
    let square = rest.x_axis.length_squared() + rest.y_axis.length_squared() + rest.z_axis.length_squared();
    let p = (square / 6.0).sqrt();
    if p <= 1e-15 * mean.abs() {
        return [mean; 2];
    }
    let angle = (0.5 * (rest * (1.0 / p)).determinant()).clamp(-1.0, 1.0).acos() / 3.0;
    [mean + 2.0 * p * angle.cos(), mean + 2.0 * p * (angle + 2.0 * FRAC_PI_3).cos()]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A spiral of directions about +Z, evenly over solid angle: cos γ from 1 down to `to`.
    fn directions(count: usize, to: f64) -> impl Iterator<Item = DVec3> {
        (0..count).map(move |k| {
            let z = 1.0 - (1.0 - to) * (k as f64 + 0.5) / count as f64;
            let c = 2.399_963_229_728_653 * k as f64;
            DVec3::new((1.0 - z * z).sqrt() * c.cos(), (1.0 - z * z).sqrt() * c.sin(), z)
        })
    }

    #[test]
    fn rays_through_one_point_have_it_as_their_focus_wherever_they_start() {
        let (focus, pivot) = (DVec3::new(-0.684, 0.836, -0.449), DVec3::new(5.0, 0.0, 30.0));
        let mut sums = Sums::default();
        for (k, d) in directions(500, 0.3).enumerate() {
            sums.add(focus + (7.0 + k as f64 % 11.0) * d - pivot, d, 1.0 + (k % 3) as f64);
        }
        let found = sums.solve(pivot).unwrap();
        assert!((DVec3::from_array(found.point_mm) - focus).length() < 1e-10, "{found:?}");
        assert!(found.rms_distance_mm < 1e-5 && found.standard_error_mm < 1e-5, "{found:?}");
    }

    /// Lambertian emission has ⟨d dᵀ⟩ = diag(¼, ¼, ½), so A/W = diag(¾, ¾, ½), its condition is 1.5; light into all directions
    /// has diag(⅓, ⅓, ⅓) and condition 1. For light from one point at `o` the residual is 0.
    #[test]
    fn the_condition_number_is_that_of_the_closed_form() {
        let (mut lambert, mut sphere) = (Sums::default(), Sums::default());
        directions(20_000, 0.0).for_each(|d| lambert.add(DVec3::ZERO, d, d.z));
        directions(20_000, -1.0).for_each(|d| sphere.add(DVec3::ZERO, d, 1.0));
        let condition = |sums: &Sums| sums.solve(DVec3::ZERO).unwrap().condition;
        assert!((condition(&lambert) - 1.5).abs() < 1e-3 && (condition(&sphere) - 1.0).abs() < 1e-3);
        assert!((lambert.mean_direction() - DVec3::new(0.0, 0.0, 2.0 / 3.0)).length() < 1e-3);
        assert!(sphere.mean_direction().length() < 1e-3);
    }

    #[test]
    fn a_collimated_beam_has_no_focus() {
        let mut sums = Sums::default();
        for k in 0..100 {
            sums.add(DVec3::new(f64::from(k % 10), f64::from(k / 10), 0.0), DVec3::new(0.6, 0.0, 0.8), 1.0);
        }
        assert_eq!(sums.solve(DVec3::ZERO), None);
        assert_eq!(Sums::default().solve(DVec3::ZERO), None);
    }
}
