//! New rays from a model: drawn from exactly the radiance that the evaluation gives.

use super::Model;
use super::evaluation::Evaluator;
use crate::goniogram::SphereGrid;
use crate::known_sources::uniform;
use glam::DVec3;
use rand_chacha::ChaCha8Rng;
use std::f64::consts::{PI, TAU};

/// Draws rays of equal flux.
pub struct Sampler<'a> {
    model: &'a Model,
    /// Running sums of the flux at each corner of each triangle; of a volume, of the density at each corner of each lit cell, which are alike.
    corners: Vec<f64>,
    /// Of a volume: its lit cells.
    cells: Vec<usize>,
    /// For each zone, or for a volume, the flux into the surroundings of each node, running.
    zones: Vec<Vec<f64>>,
    /// Of the light round a node of γ, the part on the side of smaller γ.
    below: Vec<f64>,
}

impl<'a> Sampler<'a> {
    /// Of the quantity that `evaluator` evaluates.
    pub fn new(model: &'a Model, evaluator: &Evaluator<'_>) -> Sampler<'a> {
        let (hull, grid) = (&model.hull, &model.goniograms.grid);
        let mut corners = Vec::new();
        let mut sum = 0.0;
        let cells: Vec<usize> = model.volume.iter().flat_map(|volume| volume.lattice.lit_cells()).collect();
        for (volume, cell) in model.volume.iter().flat_map(|volume| cells.iter().map(move |cell| (volume, cell))) {
            for node in volume.lattice.corners(*cell) {
                sum += evaluator.density(node as usize);
                corners.push(sum);
            }
        }
        let on_surface = if model.volume.is_some() { 0 } else { hull.triangles.len() };
        for triangle in 0..on_surface {
            let area_mm2 = hull.area_mm2(triangle);
            for corner in 0..3 {
                let mut shares = [0.0; 3];
                shares[corner] = 1.0;
                sum += area_mm2 * evaluator.exitance(triangle, shares);
                corners.push(sum);
            }
        }
        let weights_sr = grid.interpolation_weights_sr();
        let running = |nodes: &[f64]| {
            let mut sum = 0.0;
            let add = |(node, intensity): (usize, &f64)| {
                sum += intensity * weights_sr[node % weights_sr.len()];
                sum
            };
            nodes.iter().enumerate().map(add).collect()
        };
        let zones = match evaluator.nodes_of_volume() {
            Some(nodes) => vec![running(nodes)],
            None => (0..model.goniograms.zones.len()).map(|zone| running(evaluator.nodes(zone))).collect(),
        };
        Sampler { model, corners, cells, zones, below: below(grid) }
    }

    /// Point and direction of a ray; `None` of a dark model.
    pub fn draw(&self, random: &mut ChaCha8Rng) -> Option<(DVec3, DVec3)> {
        let total = *self.corners.last().filter(|total| **total > 0.0)?;
        let wanted = total * uniform(random);
        let corner = self.corners.partition_point(|running| *running <= wanted).min(self.corners.len() - 1);
        if let Some(volume) = &self.model.volume {
            // Shares of a corner fall from 1 to 0 along each axis: the smaller of two even numbers.
            let at = std::array::from_fn(|axis| {
                let nearer = uniform(random).min(uniform(random));
                if corner >> axis & 1 == 1 { 1.0 - nearer } else { nearer }
            });
            return Some((volume.lattice.point_mm(self.cells[corner / 8], at), self.direction(0, random)?));
        }
        let (triangle, corner) = (corner / 3, corner % 3);
        // A point of density p of the corner: barycentric coordinates distributed as Dirichlet (2, 1, 1).
        let mut shares = [0.0; 3].map(|_: f64| exponential(random));
        shares[corner] += exponential(random);
        let sum: f64 = shares.iter().sum();
        let vertices = self.model.hull.triangles[triangle];
        let corners_mm = self.model.hull.corners_mm(triangle);
        let point_mm = corners_mm.iter().zip(shares).map(|(corner, share)| *corner * (share / sum)).sum();
        let vertex = vertices[pick(random, shares.into_iter())] as usize;
        let mixture = &self.model.goniograms.mixtures[vertex];
        let zone = mixture.zones[pick(random, mixture.weights.into_iter())] as usize;
        Some((point_mm, self.direction(zone, random)?))
    }

    /// A direction of a zone: a node, and of the light that is interpolated from it a part.
    fn direction(&self, zone: usize, random: &mut ChaCha8Rng) -> Option<DVec3> {
        let grid = &self.model.goniograms.grid;
        let running = &self.zones[zone];
        let total = *running.last().filter(|total| **total > 0.0)?;
        let wanted = total * uniform(random);
        let node = running.partition_point(|running| *running <= wanted).min(running.len() - 1);
        let (c, k) = (node / grid.gamma_nodes(), node % grid.gamma_nodes());
        let dc = TAU / grid.c_planes() as f64;
        let c = (c as f64 + uniform(random) - uniform(random)) * dc;
        let from = grid.gamma(k);
        let below = uniform(random) < self.below[k];
        let (sign, next) = if below { (-1.0, k - 1) } else { (1.0, k + 1) };
        let dg = (grid.gamma(next) - from).abs();
        let largest =
            from.sin().max((from + sign * dg).sin()).max(if (from - PI / 2.0).abs() < dg { 1.0 } else { 0.0 });
        let gamma = loop {
            // Distances with the density 1 − s, kept in proportion to sin γ.
            let gamma = from + sign * dg * (1.0 - uniform(random).sqrt());
            if uniform(random) * largest <= gamma.sin() {
                break gamma;
            }
        };
        Some(self.model.goniograms.frame.direction(c, gamma))
    }
}

/// Of ∫ hat(γ) sin γ dγ round each node, the part on the side of smaller γ.
fn below(grid: &SphereGrid) -> Vec<f64> {
    let part = |k: usize| grid.hat_side(k, -1.0) / (grid.hat_side(k, -1.0) + grid.hat_side(k, 1.0));
    // Exactly 0 and 1 at the poles, beyond which there is nothing.
    (0..grid.gamma_nodes()).map(part).collect()
}

/// An index, as often as its weight says.
fn pick(random: &mut ChaCha8Rng, weights: impl Iterator<Item = f64> + Clone) -> usize {
    let mut wanted = uniform(random) * weights.clone().sum::<f64>();
    let found = weights.clone().position(|weight| {
        wanted -= weight;
        wanted < 0.0
    });
    found.unwrap_or(0)
}

fn exponential(random: &mut ChaCha8Rng) -> f64 {
    -uniform(random).ln()
}
