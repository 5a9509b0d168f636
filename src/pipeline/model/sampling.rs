//! New rays from a model: places and directions drawn from exactly the radiance that the evaluation gives, all of the same flux.

use super::chance::{Choice, Numbers, choices, pick};
use super::evaluation::Evaluator;
use super::light::Light;
use crate::goniogram::SphereGrid;
use glam::{DMat3, DVec3};
use std::f64::consts::{PI, TAU};

/// Draws rays of equal flux.
pub struct Sampler<'a> {
    light: Light<'a>,
    /// The flux at each corner of each triangle; of a volume, at each corner of each lit cell.
    corners: Vec<Choice>,
    /// Of a volume: its lit cells, and the nodes at their corners.
    cells: Vec<(usize, [u32; 8])>,
    /// For each zone, or for a volume, the flux into the surroundings of each node; empty where there is none.
    zones: Vec<Vec<Choice>>,
    rings: Vec<Ring>,
    /// Angle of each C plane, and its sine and cosine.
    planes: Vec<(f64, (f64, f64))>,
    source_from_photometric: DMat3,
}

/// A ray that was drawn.
#[derive(Clone, Copy, Debug)]
pub struct Drawn {
    /// Where it starts, mm.
    pub point_mm: DVec3,
    /// Its unit direction.
    pub direction: DVec3,
    /// The vertex, of a volume the node, whose light it is a part of: of all rays at a point, each corner has its share of the exitance.
    pub site: usize,
    /// The zone whose goniogram gave its direction; 0 of a volume, whose total goniogram did.
    pub zone: usize,
    /// C and γ of its direction, radians; C may be beyond a turn.
    pub angles: (f64, f64),
}

/// The light round one node of γ.
struct Ring {
    gamma: f64,
    /// Sine and cosine of that.
    sin_cos: (f64, f64),
    /// The part of it on the side of smaller γ; exactly 0 and 1 at the poles.
    below: f64,
    /// Towards smaller and towards larger γ: signed distance to the next node, and the largest sine on the way.
    sides: [(f64, f64); 2],
}

impl<'a> Sampler<'a> {
    /// Of the quantity that `evaluator` evaluates; `None` of a dark model.
    pub fn new(evaluator: &Evaluator<'a>) -> Option<Sampler<'a>> {
        let light = evaluator.light().clone();
        let of_cells = |volume: &'a crate::volume::Volume| {
            let lattice = &volume.lattice;
            lattice.lit_cells().map(|cell| (cell, lattice.corners(cell))).collect::<Vec<_>>()
        };
        let cells = light.volume.map(of_cells).unwrap_or_default();
        let weights: Vec<f64> = if light.volume.is_some() {
            cells.iter().flat_map(|(_, nodes)| nodes.map(|node| evaluator.density(node as usize))).collect()
        } else {
            (0..light.mesh.triangles.len())
                .flat_map(|triangle| {
                    let area_mm2 = light.mesh.area_mm2(triangle);
                    let of = |corner| std::array::from_fn(|k| if k == corner { 1.0 } else { 0.0 });
                    [0, 1, 2].map(|corner| area_mm2 * evaluator.exitance(triangle, of(corner)))
                })
                .collect()
        };
        let mut corners = Vec::with_capacity(weights.len());
        let is_lit = choices(&weights, &mut corners);
        let weights_sr = light.grid.interpolation_weights_sr();
        let zone = |nodes: &[f64]| {
            let weigh = |(node, intensity): (usize, &f64)| intensity * weights_sr[node % weights_sr.len()];
            let mut table = Vec::with_capacity(nodes.len());
            let is_lit = choices(&nodes.iter().enumerate().map(weigh).collect::<Vec<f64>>(), &mut table);
            if is_lit { table } else { Vec::new() }
        };
        let zones = match evaluator.nodes_of_volume() {
            Some(nodes) => vec![zone(nodes)],
            None => (0..light.zones.len()).map(|at| zone(evaluator.nodes(at))).collect(),
        };
        let rings = (0..light.grid.gamma_nodes()).map(|node| Ring::new(light.grid, node)).collect();
        let step = TAU / light.grid.c_planes() as f64;
        let planes = (0..light.grid.c_planes()).map(|plane| plane as f64 * step).map(|c| (c, c.sin_cos())).collect();
        let source_from_photometric = light.frame.source_from_photometric();
        is_lit.then_some(Sampler { light, corners, cells, zones, rings, planes, source_from_photometric })
    }

    /// Ray number `ray` of the rays of `seed`; `None` where its zone is dark.
    pub fn ray(&self, seed: u64, ray: u64) -> Option<Drawn> {
        self.draw(&mut Numbers::of(seed, ray))
    }

    /// A ray of these numbers; `None` where its zone is dark.
    pub fn draw(&self, numbers: &mut Numbers) -> Option<Drawn> {
        let corner = pick(&self.corners, numbers.bits());
        let (point_mm, site, zone) = match self.light.volume {
            Some(volume) => {
                let (cell, nodes) = self.cells[corner / 8];
                // Shares of a corner fall from 1 to 0 along each axis: the smaller of two even numbers.
                let at = std::array::from_fn(|axis| {
                    let nearer = numbers.uniform().min(numbers.uniform());
                    if corner >> axis & 1 == 1 { 1.0 - nearer } else { nearer }
                });
                (volume.lattice.point_mm(cell, at), nodes[corner % 8] as usize, 0)
            }
            None => self.on_surface(corner / 3, corner % 3, numbers),
        };
        let (direction, angles) = self.direction(zone, numbers)?;
        Some(Drawn { point_mm, direction, site, zone, angles })
    }

    /// A point of a triangle with the density of its `corner`; that corner's vertex, and a zone at the point.
    fn on_surface(&self, triangle: usize, corner: usize, numbers: &mut Numbers) -> (DVec3, usize, usize) {
        // The four stretches between three even numbers in order; one corner has two of them: barycentric coordinates distributed as
        // Dirichlet (2, 1, 1).
        let [a, b, c] = [numbers.uniform(), numbers.uniform(), numbers.uniform()];
        let (low, high) = (a.min(b), a.max(b));
        let (first, second, third) = (low.min(c), high.min(c.max(low)), high.max(c));
        let mut shares = [second - first, third - second, 1.0 - third];
        shares[corner] += first;
        let vertices = self.light.mesh.triangles[triangle];
        let corners_mm = self.light.mesh.corners_mm(triangle);
        let point_mm = corners_mm[0] * shares[0] + corners_mm[1] * shares[1] + corners_mm[2] * shares[2];
        let mixture = &self.light.mixtures[vertices[index(&shares, numbers)] as usize];
        // The first zone is the only one of most vertices.
        let place = if mixture.weights[0] < 1.0 { index(&mixture.weights, numbers) } else { 0 };
        (point_mm, vertices[corner] as usize, mixture.zones[place] as usize)
    }

    /// A direction of a zone, and its C and γ: a node, and of the light that is interpolated from it a part.
    fn direction(&self, zone: usize, numbers: &mut Numbers) -> Option<(DVec3, (f64, f64))> {
        let nodes = &self.zones[zone];
        if nodes.is_empty() {
            return None;
        }
        let node = pick(nodes, numbers.bits());
        let (plane, ring) = (node / self.rings.len(), &self.rings[node % self.rings.len()]);
        let (at, at_sin_cos) = self.planes[plane];
        let along = (numbers.uniform() - numbers.uniform()) * TAU / self.planes.len() as f64;
        let (sin_c, cos_c) = sin_cos_beyond(at, at_sin_cos, along);
        let side = if numbers.uniform() < ring.below { 0 } else { 1 };
        let (step, largest) = ring.sides[side];
        let (gamma, (sin, cos)) = loop {
            // Distances with the density 1 − s, kept in proportion to sin γ.
            let beyond = step * (1.0 - numbers.uniform().sqrt());
            let (sin, cos) = sin_cos_beyond(ring.gamma, ring.sin_cos, beyond);
            if numbers.uniform() * largest <= sin {
                break (ring.gamma + beyond, (sin, cos));
            }
        };
        let direction = self.source_from_photometric * DVec3::new(sin * cos_c, sin * sin_c, -cos);
        Some((direction, (at + along, gamma)))
    }
}

/// Sine and cosine of an angle that lies `beyond` one, of which they are known: where that is little, as between the nodes of most grids, by
/// their series, to the last digit. A third of the time of a ray would go into these functions otherwise.
fn sin_cos_beyond(angle: f64, (sin, cos): (f64, f64), beyond: f64) -> (f64, f64) {
    const LITTLE: f64 = 0.3;
    if beyond.abs() > LITTLE {
        return (angle + beyond).sin_cos();
    }
    let square = beyond * beyond;
    let series = |parts: &[f64]| parts.iter().rev().fold(1.0, |sum, part| 1.0 - square * part * sum);
    let own_sin = beyond * series(&[1.0 / 6.0, 1.0 / 20.0, 1.0 / 42.0, 1.0 / 72.0, 1.0 / 110.0]);
    let own_cos = series(&[1.0 / 2.0, 1.0 / 12.0, 1.0 / 30.0, 1.0 / 56.0, 1.0 / 90.0, 1.0 / 132.0]);
    (sin * own_cos + cos * own_sin, cos * own_cos - sin * own_sin)
}

impl Ring {
    fn new(grid: &SphereGrid, node: usize) -> Ring {
        let [down, up] = [grid.hat_side(node, -1.0), grid.hat_side(node, 1.0)];
        let gamma = grid.gamma(node);
        let side = |next: Option<usize>| {
            let next = next.filter(|next| *next < grid.gamma_nodes()).map_or(gamma, |next| grid.gamma(next));
            let crosses = (next - PI / 2.0) * (gamma - PI / 2.0) < 0.0;
            (next - gamma, if crosses { 1.0 } else { gamma.sin().max(next.sin()) })
        };
        Ring {
            gamma,
            sin_cos: gamma.sin_cos(),
            below: down / (down + up),
            sides: [side(node.checked_sub(1)), side(Some(node + 1))],
        }
    }
}

/// An index, as often as its weight says. The weights sum to 1, but for rounding.
fn index<const N: usize>(weights: &[f64; N], numbers: &mut Numbers) -> usize {
    let mut wanted = numbers.uniform();
    let found = weights.iter().position(|weight| {
        wanted -= weight;
        wanted < 0.0
    });
    // What rounding leaves over belongs to the weightiest, which is the first of a mixture.
    found.unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_a_little_beyond_have_their_sine_and_cosine() {
        for k in 0..2000 {
            let (angle, beyond) = (f64::from(k) * 0.003, f64::from(k % 101) * 0.01 - 0.5);
            let (sin, cos) = sin_cos_beyond(angle, angle.sin_cos(), beyond);
            let (exact_sin, exact_cos) = (angle + beyond).sin_cos();
            // The sum of two angles of up to 6 is rounded to 4e-16 itself.
            assert!((sin - exact_sin).abs() < 2e-15 && (cos - exact_cos).abs() < 2e-15, "{angle} {beyond}");
        }
    }
}
