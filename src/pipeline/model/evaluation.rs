//! The model evaluated: L = M(x) q(ω; x) / |cos θ| (`pipeline/README.md` 5).
//!
//! M is the exitance, linear over each triangle between the vertices' M_l = ρ_l / A_l; q mixes the zones' normalised goniograms by
//! the zone weights of the triangle's corners, as M is mixed. Another program that reads only emitter.glb and
//! goniograms.json computes the same; `openapi/README.md` has the formulas.

use super::Model;
use glam::DVec3;

/// Which of the two systems.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// W.
    Radiant,
    /// lm.
    Luminous,
}

/// A model prepared for evaluation in one quantity. "Flux" below is W or lm.
pub struct Evaluator<'a> {
    model: &'a Model,
    /// M_l, flux per mm².
    exitance: Vec<f64>,
    /// Per zone: `[c][gamma]` values and their integral over the sphere.
    goniograms: Vec<(&'a [f64], f64)>,
    /// Per zone: ∫ M w dA, flux.
    zone_flux: Vec<f64>,
}

impl<'a> Evaluator<'a> {
    /// Of the radiant quantity where that is known, else of the luminous one; `None` of a model without either.
    pub fn of_primary(model: &'a Model) -> Option<Evaluator<'a>> {
        Evaluator::new(model, Quantity::Radiant).or_else(|| Evaluator::new(model, Quantity::Luminous))
    }

    /// `None` where the model does not know the quantity.
    pub fn new(model: &'a Model, quantity: Quantity) -> Option<Evaluator<'a>> {
        let vertices = &model.surface.vertices;
        let flux = match quantity {
            Quantity::Radiant => vertices.radiant_w.as_ref()?,
            Quantity::Luminous => vertices.luminous_lm.as_ref()?,
        };
        let per_area = |(flux, area): (&f64, f64)| if area > 0.0 { flux / area } else { 0.0 };
        let exitance: Vec<f64> = flux.iter().zip(model.hull.vertex_areas_mm2()).map(per_area).collect();
        let mut goniograms = Vec::new();
        for zone in &model.goniograms.zones {
            let nodes = match quantity {
                Quantity::Radiant => zone.goniogram.radiant_w_per_sr.as_ref()?,
                Quantity::Luminous => zone.goniogram.luminous_cd.as_ref()?,
            };
            goniograms.push((nodes.as_slice(), model.goniograms.grid.integral(nodes)));
        }
        let mut evaluator = Evaluator { model, exitance, zone_flux: vec![0.0; goniograms.len()], goniograms };
        for triangle in 0..model.hull.triangles.len() {
            // ∫ of a product of two linear functions over a triangle is A/12 (Σ a_i b_i + Σ a_i Σ b_i); b is 1 at the zone's corners.
            let corners = model.hull.triangles[triangle].map(|vertex| vertex as usize);
            let sum: f64 = corners.iter().map(|corner| evaluator.exitance[*corner]).sum();
            for corner in corners {
                let flux = model.hull.area_mm2(triangle) / 12.0 * (evaluator.exitance[corner] + sum);
                for (zone, weight) in model.goniograms.mixtures[corner].parts() {
                    evaluator.zone_flux[zone] += weight * flux;
                }
            }
        }
        Some(evaluator)
    }

    /// The intensities of a zone at the nodes, `[c][gamma]`.
    pub fn nodes(&self, zone: usize) -> &'a [f64] {
        self.goniograms[zone].0
    }

    /// Exitance M at the point of `triangle` with barycentric `shares`, flux/mm².
    pub fn exitance(&self, triangle: usize, shares: [f64; 3]) -> f64 {
        let corners = self.model.hull.triangles[triangle];
        corners.iter().zip(shares).map(|(vertex, share)| self.exitance[*vertex as usize] * share).sum()
    }

    /// Normalised angular distribution q of the light of a point in unit `direction`, 1/sr.
    pub fn distribution(&self, triangle: usize, shares: [f64; 3], direction: DVec3) -> f64 {
        let (c, gamma) = self.model.goniograms.frame.angles(direction);
        let corners = self.model.hull.triangles[triangle];
        let of = |vertex: &u32| -> f64 {
            let parts = self.model.goniograms.mixtures[*vertex as usize].parts();
            parts.map(|(zone, weight)| weight * self.zone_distribution(zone, c, gamma)).sum()
        };
        corners.iter().zip(shares).map(|(vertex, share)| share * of(vertex)).sum()
    }

    fn zone_distribution(&self, zone: usize, c: f64, gamma: f64) -> f64 {
        let (nodes, integral) = self.goniograms[zone];
        if integral > 0.0 { self.model.goniograms.grid.interpolate(nodes, c, gamma) / integral } else { 0.0 }
    }

    /// Radiance L of a point in unit `direction`, flux/(mm² sr); 0 along the surface, where it has no meaning.
    pub fn radiance(&self, triangle: usize, shares: [f64; 3], direction: DVec3) -> f64 {
        let cosine = direction.dot(self.model.hull.normal(triangle)).abs();
        if cosine > 0.0 {
            self.exitance(triangle, shares) * self.distribution(triangle, shares, direction) / cosine
        } else {
            0.0
        }
    }

    /// Intensity of the whole source in unit `direction`, flux/sr.
    pub fn intensity(&self, direction: DVec3) -> f64 {
        let (c, gamma) = self.model.goniograms.frame.angles(direction);
        self.zone_flux.iter().enumerate().map(|(zone, flux)| flux * self.zone_distribution(zone, c, gamma)).sum()
    }

    /// Irradiance or illuminance at `point_mm` on a plane with unit `normal`, flux/mm²: E = ∫ M q cos θ′ / r² dA by the three-point
    /// rule on each triangle (exact to second order; the point must be some triangles away from the surface). Nothing is
    /// shadowed: rays of a ray set have already left.
    pub fn irradiance(&self, point_mm: DVec3, normal: DVec3) -> f64 {
        let hull = &self.model.hull;
        let mut sum = 0.0;
        for triangle in 0..hull.triangles.len() {
            let [a, b, c] = hull.corners_mm(triangle);
            for heavy in 0..3 {
                let mut shares = [1.0 / 6.0; 3];
                shares[heavy] = 2.0 / 3.0;
                let to_point = point_mm - (shares[0] * a + shares[1] * b + shares[2] * c);
                let (distance_mm, direction) = (to_point.length(), to_point.normalize_or_zero());
                let cosine = -direction.dot(normal);
                if cosine > 0.0 {
                    let from = self.exitance(triangle, shares) * self.distribution(triangle, shares, direction);
                    sum += hull.area_mm2(triangle) / 3.0 * from * cosine / (distance_mm * distance_mm);
                }
            }
        }
        sum
    }
}
