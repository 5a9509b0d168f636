//! The model evaluated: L = M(x) q(ω; x) / |cos θ|, of a volume L = q(ω) ∫ j ds (`pipeline/README.md` 5).
//!
//! M is the exitance, linear over each triangle between the vertices' M_l = ρ_l / A_l; q mixes the zones' normalised goniograms by
//! the zone weights of the triangle's corners, as M is mixed. Another program that reads only emitter.glb and
//! goniograms.json computes the same; `openapi/README.md` has the formulas.

use super::light::Light;
use crate::flux::Amounts;
use crate::goniogram::Goniogram;
use crate::volume::Volume;
use crate::volume::lattice::AT_GAUSS;
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
    light: Light<'a>,
    /// M_l, flux per mm².
    exitance: Vec<f64>,
    /// Per zone: `[c][gamma]` values and their integral over the sphere.
    goniograms: Vec<(&'a [f64], f64)>,
    /// Per zone: ∫ M w dA, flux.
    zone_flux: Vec<f64>,
    in_volume: Option<InVolume<'a>>,
}

/// What is needed of a volume.
struct InVolume<'a> {
    volume: &'a Volume,
    /// Emission coefficient j of each node, integrated over all directions, flux per mm³.
    density: Vec<f64>,
    /// The whole source's `[c][gamma]` values and their integral over the sphere.
    goniogram: (&'a [f64], f64),
    flux: f64,
}

/// Flux of sites in `quantity`.
fn flux_of(sites: &Amounts, quantity: Quantity) -> Option<&Vec<f64>> {
    match quantity {
        Quantity::Radiant => sites.radiant_w.as_ref(),
        Quantity::Luminous => sites.luminous_lm.as_ref(),
    }
}

/// Intensities at the nodes in `quantity`.
fn intensities_of(goniogram: &Goniogram, quantity: Quantity) -> Option<&Vec<f64>> {
    match quantity {
        Quantity::Radiant => goniogram.radiant_w_per_sr.as_ref(),
        Quantity::Luminous => goniogram.luminous_cd.as_ref(),
    }
}

fn per(flux: &[f64], measures: &[f64]) -> Vec<f64> {
    flux.iter().zip(measures).map(|(flux, measure)| if *measure > 0.0 { flux / measure } else { 0.0 }).collect()
}

impl<'a> Evaluator<'a> {
    /// Of the radiant quantity where that is known, else of the luminous one; `None` of a model without either.
    pub fn of_primary(light: impl Into<Light<'a>>) -> Option<Evaluator<'a>> {
        let light = light.into();
        Evaluator::new(light.clone(), Quantity::Radiant).or_else(|| Evaluator::new(light, Quantity::Luminous))
    }

    /// `None` where the model does not know the quantity.
    pub fn new(light: impl Into<Light<'a>>, quantity: Quantity) -> Option<Evaluator<'a>> {
        let light = light.into();
        let exitance = per(flux_of(light.vertices, quantity)?, &light.mesh.vertex_areas_mm2());
        let normalised = |goniogram: &'a Goniogram| {
            let nodes = intensities_of(goniogram, quantity)?;
            Some((nodes.as_slice(), light.grid.integral(nodes)))
        };
        // Light that smoothing gave to a zone in which no ray landed goes as that of the whole source.
        let of_zone =
            |zone| normalised(zone).and_then(|own| if own.1 > 0.0 { Some(own) } else { normalised(light.total) });
        let goniograms = light.zones.iter().map(|zone| of_zone(zone)).collect::<Option<Vec<_>>>()?;
        let in_volume = |volume: &'a Volume| {
            let flux = flux_of(&volume.nodes, quantity)?;
            let density = per(flux, &volume.volumes_mm3);
            Some(InVolume { volume, density, goniogram: normalised(light.total)?, flux: flux.iter().sum() })
        };
        let in_volume = light.volume.and_then(in_volume);
        let zone_flux = vec![0.0; goniograms.len()];
        let mut evaluator = Evaluator { light, exitance, zone_flux, goniograms, in_volume };
        for triangle in 0..evaluator.light.mesh.triangles.len() {
            // ∫ of a product of two linear functions over a triangle is A/12 (Σ a_i b_i + Σ a_i Σ b_i); b is 1 at the zone's corners.
            let corners = evaluator.light.mesh.triangles[triangle].map(|vertex| vertex as usize);
            let sum: f64 = corners.iter().map(|corner| evaluator.exitance[*corner]).sum();
            for corner in corners {
                let flux = evaluator.light.mesh.area_mm2(triangle) / 12.0 * (evaluator.exitance[corner] + sum);
                for (zone, weight) in evaluator.light.mixtures[corner].parts() {
                    evaluator.zone_flux[zone] += weight * flux;
                }
            }
        }
        Some(evaluator)
    }

    /// What it evaluates.
    pub fn light(&self) -> &Light<'a> {
        &self.light
    }

    /// Flux of the model: that of all vertices, or of all nodes of a volume.
    pub fn flux(&self) -> f64 {
        self.in_volume.as_ref().map_or_else(|| self.zone_flux.iter().sum(), |inside| inside.flux)
    }

    /// Flux of the light that a zone gives its directions, ∫ M w dA; of a volume, all of it.
    pub fn zone_flux(&self, zone: usize) -> f64 {
        self.in_volume.as_ref().map_or_else(|| self.zone_flux[zone], |inside| inside.flux)
    }

    /// The intensities of a zone at the nodes, `[c][gamma]`.
    pub fn nodes(&self, zone: usize) -> &'a [f64] {
        self.goniograms[zone].0
    }

    /// The intensities of a volume at the nodes, `[c][gamma]`; `None` of a surface.
    pub fn nodes_of_volume(&self) -> Option<&'a [f64]> {
        self.in_volume.as_ref().map(|inside| inside.goniogram.0)
    }

    /// Emission coefficient j of a node of a volume, integrated over all directions, flux/mm³; 0 of a surface.
    pub fn density(&self, node: usize) -> f64 {
        self.in_volume.as_ref().map_or(0.0, |inside| inside.density[node])
    }

    /// Exitance M at the point of `triangle` with barycentric `shares`, flux/mm².
    pub fn exitance(&self, triangle: usize, shares: [f64; 3]) -> f64 {
        let corners = self.light.mesh.triangles[triangle];
        corners.iter().zip(shares).map(|(vertex, share)| self.exitance[*vertex as usize] * share).sum()
    }

    /// Normalised angular distribution q of the light of a point in unit `direction`, 1/sr.
    pub fn distribution(&self, triangle: usize, shares: [f64; 3], direction: DVec3) -> f64 {
        let (c, gamma) = self.light.frame.angles(direction);
        let corners = self.light.mesh.triangles[triangle];
        let of = |vertex: &u32| -> f64 {
            let parts = self.light.mixtures[*vertex as usize].parts();
            parts.map(|(zone, weight)| weight * self.zone_distribution(zone, c, gamma)).sum()
        };
        corners.iter().zip(shares).map(|(vertex, share)| share * of(vertex)).sum()
    }

    /// Normalised angular distribution of a zone, or of a volume, 1/sr, at C and γ in radians.
    pub fn distribution_of(&self, zone: usize, c: f64, gamma: f64) -> f64 {
        match &self.in_volume {
            Some(inside) => self.normalised(inside.goniogram, c, gamma),
            None => self.zone_distribution(zone, c, gamma),
        }
    }

    fn zone_distribution(&self, zone: usize, c: f64, gamma: f64) -> f64 {
        self.normalised(self.goniograms[zone], c, gamma)
    }

    fn normalised(&self, (nodes, integral): (&[f64], f64), c: f64, gamma: f64) -> f64 {
        if integral > 0.0 { self.light.grid.interpolate(nodes, c, gamma) / integral } else { 0.0 }
    }

    /// Radiance of a volume along the line through a point in unit `direction`, flux/(mm² sr); `None` of a surface.
    pub fn radiance_along(&self, point_mm: DVec3, direction: DVec3) -> Option<f64> {
        let inside = self.in_volume.as_ref()?;
        let (c, gamma) = self.light.frame.angles(direction);
        let path = inside.volume.lattice.integral(point_mm, direction, &inside.density);
        Some(self.normalised(inside.goniogram, c, gamma) * path)
    }

    /// Radiance L of a point of the surface in unit `direction`, flux/(mm² sr); 0 along the surface, where it has no meaning.
    pub fn radiance(&self, triangle: usize, shares: [f64; 3], direction: DVec3) -> f64 {
        let cosine = direction.dot(self.light.mesh.normal(triangle)).abs();
        if cosine > 0.0 {
            self.exitance(triangle, shares) * self.distribution(triangle, shares, direction) / cosine
        } else {
            0.0
        }
    }

    /// Intensity of the whole source in unit `direction`, flux/sr.
    pub fn intensity(&self, direction: DVec3) -> f64 {
        let (c, gamma) = self.light.frame.angles(direction);
        if let Some(inside) = &self.in_volume {
            return inside.flux * self.normalised(inside.goniogram, c, gamma);
        }
        self.zone_flux.iter().enumerate().map(|(zone, flux)| flux * self.zone_distribution(zone, c, gamma)).sum()
    }

    /// Irradiance or illuminance at `point_mm` on a plane with unit `normal`, flux/mm²: E = ∫ M q cos θ′ / r² dA by the three-point
    /// rule on each triangle (exact to second order; the point must be some triangles away from the surface). Nothing is
    /// shadowed: rays of a ray set have already left. Of a volume E = ∫ j q cos θ′ / r² dV by the eight-point rule on each cell.
    pub fn irradiance(&self, point_mm: DVec3, normal: DVec3) -> f64 {
        if let Some(inside) = &self.in_volume {
            return self.irradiance_of(inside, point_mm, normal);
        }
        let mesh = &self.light.mesh;
        let mut sum = 0.0;
        for triangle in 0..mesh.triangles.len() {
            let [a, b, c] = mesh.corners_mm(triangle);
            for heavy in 0..3 {
                let mut shares = [1.0 / 6.0; 3];
                shares[heavy] = 2.0 / 3.0;
                let to_point = point_mm - (shares[0] * a + shares[1] * b + shares[2] * c);
                let (distance_mm, direction) = (to_point.length(), to_point.normalize_or_zero());
                let cosine = -direction.dot(normal);
                if cosine > 0.0 {
                    let from = self.exitance(triangle, shares) * self.distribution(triangle, shares, direction);
                    sum += mesh.area_mm2(triangle) / 3.0 * from * cosine / (distance_mm * distance_mm);
                }
            }
        }
        sum
    }

    fn irradiance_of(&self, inside: &InVolume<'_>, point_mm: DVec3, normal: DVec3) -> f64 {
        let lattice = &inside.volume.lattice;
        let part_mm3 = lattice.pitch_mm.element_product() / 8.0;
        let mut sum = 0.0;
        for cell in lattice.lit_cells() {
            for corner in 0..8_usize {
                let at: [f64; 3] = std::array::from_fn(|axis| AT_GAUSS[corner >> axis & 1]);
                let to_point = point_mm - lattice.point_mm(cell, at);
                let (distance_mm, direction) = (to_point.length(), to_point.normalize_or_zero());
                let cosine = -direction.dot(normal);
                if cosine > 0.0 {
                    let (c, gamma) = self.light.frame.angles(direction);
                    let density = lattice.interpolate(cell, at, &inside.density);
                    let from = density * self.normalised(inside.goniogram, c, gamma);
                    sum += part_mm3 * from * cosine / (distance_mm * distance_mm);
                }
            }
        }
        sum
    }
}
