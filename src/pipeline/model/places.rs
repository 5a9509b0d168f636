//! Where new rays start: on triangles, or in the lit cells of a volume, as often as these have light. What is needed of one of them lies side by
//! side in memory, in the order of a curve through space, so that numbers near each other lead to places near each other.

use super::chance::{Choices, Decision, Numbers};
use super::curve::along;
use super::evaluation::Evaluator;
use crate::goniogram::Mixture;
use crate::vocabulary::space::Bounds;
use crate::volume::Volume;
use glam::{DVec3, Vec3};

/// Where a ray starts.
#[derive(Clone, Copy, Debug)]
pub struct Start {
    /// The point, mm.
    pub point_mm: DVec3,
    /// The vertex, of a volume the node, whose light the ray is a part of.
    pub site: u32,
    /// The zone by whose goniogram it goes; 0 of a volume.
    pub zone: u32,
}

/// All places that have light.
pub struct Places<'a> {
    choices: Choices,
    what: What<'a>,
}

enum What<'a> {
    Surface(Surface<'a>),
    InVolume(InVolume),
}

struct Surface<'a> {
    faces: Vec<Face>,
    /// The zone of each vertex that has one, or [`MIXED`].
    zones: Vec<u32>,
    mixtures: &'a [Mixture],
}

const MIXED: u32 = u32::MAX;

/// A triangle in one line of the cache.
#[repr(align(64))]
struct Face {
    corner_mm: DVec3,
    /// To the other two corners.
    edges_mm: [Vec3; 2],
    vertices: [u32; 3],
    /// Which part of its light is the first corner's, and which that of the first two, of 2^16.
    parts: [u16; 2],
}

struct InVolume {
    cells: Vec<Cell>,
    min_mm: DVec3,
    pitch_mm: DVec3,
}

/// A lit cell in one line of the cache.
#[repr(align(64))]
struct Cell {
    nodes: [u32; 8],
    at: [u32; 3],
    /// Which part of its light is that of the first corner, of the first two and so on, of 2^16.
    parts: [u16; 7],
}

impl<'a> Places<'a> {
    /// Those of the model that `evaluator` evaluates, in its quantity; `None` of a dark one.
    pub fn new(evaluator: &Evaluator<'a>) -> Option<Places<'a>> {
        match evaluator.light().volume {
            Some(volume) => Places::in_volume(evaluator, volume),
            None => Places::on_surface(evaluator),
        }
    }

    fn on_surface(evaluator: &Evaluator<'a>) -> Option<Places<'a>> {
        let light = evaluator.light();
        let mesh = &light.mesh;
        let of = |triangle: usize| {
            let alone = |corner| std::array::from_fn(|k| if k == corner { 1.0 } else { 0.0 });
            let weights = [0, 1, 2].map(|corner| mesh.area_mm2(triangle) * evaluator.exitance(triangle, alone(corner)));
            let [a, b, c] = mesh.corners_mm(triangle);
            let edges_mm = [b - a, c - a].map(|edge| edge.as_vec3());
            let face = Face { corner_mm: a, edges_mm, vertices: mesh.triangles[triangle], parts: parts(&weights) };
            ((a + b + c) / 3.0, weights.iter().sum(), face)
        };
        let (choices, faces) = in_order((0..mesh.triangles.len()).map(of).collect())?;
        let zone = |mixture: &Mixture| if mixture.weights[0] < 1.0 { MIXED } else { mixture.zones[0] };
        let zones = light.mixtures.iter().map(zone).collect();
        Some(Places { choices, what: What::Surface(Surface { faces, zones, mixtures: light.mixtures }) })
    }

    fn in_volume(evaluator: &Evaluator<'a>, volume: &Volume) -> Option<Places<'a>> {
        let lattice = &volume.lattice;
        let of = |cell: usize| {
            let nodes = lattice.corners(cell);
            let weights = nodes.map(|node| evaluator.density(node as usize));
            let middle_mm = lattice.point_mm(cell, [0.5; 3]);
            let at = ((middle_mm - lattice.min_mm) / lattice.pitch_mm).to_array().map(|along| along as u32);
            (middle_mm, weights.iter().sum(), Cell { nodes, at, parts: parts(&weights) })
        };
        let (choices, cells) = in_order(lattice.lit_cells().map(of).collect())?;
        let (min_mm, pitch_mm) = (lattice.min_mm, lattice.pitch_mm);
        Some(Places { choices, what: What::InVolume(InVolume { cells, min_mm, pitch_mm }) })
    }

    /// The number of the place of a ray.
    pub fn find(&self, numbers: &Numbers) -> usize {
        self.choices.find(numbers.get(Decision::Place))
    }

    /// The corner of that place whose light the ray is a part of.
    #[inline]
    pub fn corner(&self, place: usize, numbers: &Numbers) -> usize {
        match &self.what {
            What::Surface(surface) => part(&surface.faces[place].parts, numbers.get(Decision::Corner)),
            What::InVolume(volume) => part(&volume.cells[place].parts, numbers.get(Decision::Corner)),
        }
    }

    /// Where a ray of that corner starts.
    pub fn start(&self, place: usize, corner: usize, numbers: &Numbers) -> Start {
        match &self.what {
            What::Surface(surface) => surface.start(place, corner, numbers),
            What::InVolume(volume) => volume.start(place, corner, numbers),
        }
    }
}

impl Surface<'_> {
    fn start(&self, place: usize, corner: usize, numbers: &Numbers) -> Start {
        let face = &self.faces[place];
        // The four stretches between three even numbers in order; one corner has two of them: barycentric coordinates distributed as
        // Dirichlet (2, 1, 1), which is the density of its light.
        let [a, b, c] =
            [Decision::Inside, Decision::AgainInside, Decision::OnceMoreInside].map(|which| numbers.get(which));
        let (low, high) = (a.min(b), a.max(b));
        let (first, second, third) = (low.min(c), high.min(low.max(c)), high.max(c));
        let mut shares = [second - first, third - second, u32::MAX - third];
        shares[corner] += first;
        let [_, along, across] = shares.map(|share| f64::from(share) / f64::from(u32::MAX));
        let [to_second, to_third] = face.edges_mm.map(|edge| edge.as_dvec3());
        let second = numbers.get(Decision::SecondCorner);
        let by = usize::from(second >= shares[0]) + usize::from(second >= shares[0] + shares[1]);
        let vertex = face.vertices[by] as usize;
        Start {
            point_mm: face.corner_mm + to_second * along + to_third * across,
            site: face.vertices[corner],
            zone: match self.zones[vertex] {
                MIXED => zone_of(&self.mixtures[vertex], numbers.uniform(Decision::Zone)),
                zone => zone,
            },
        }
    }
}

impl InVolume {
    fn start(&self, place: usize, corner: usize, numbers: &Numbers) -> Start {
        let cell = &self.cells[place];
        let along =
            [Decision::Inside, Decision::AgainInside, Decision::OnceMoreInside].map(|which| numbers.uniform(which));
        let at: [f64; 3] = std::array::from_fn(|axis| {
            // Shares of a corner fall from 1 to 0 along each axis.
            let nearer = 1.0 - along[axis].sqrt();
            f64::from(cell.at[axis]) + if corner >> axis & 1 == 1 { 1.0 - nearer } else { nearer }
        });
        Start { point_mm: self.min_mm + self.pitch_mm * DVec3::from_array(at), site: cell.nodes[corner], zone: 0 }
    }
}

/// Places and the weights of their light, those without any left out, in the order of a curve through their middles.
fn in_order<T>(places: Vec<(DVec3, f64, T)>) -> Option<(Choices, Vec<T>)> {
    let bounds = Bounds::of(places.iter().map(|(middle_mm, ..)| *middle_mm));
    let longest_mm = bounds.size().max_element();
    let mut keyed: Vec<(u64, f64, T)> = places
        .into_iter()
        .filter(|(_, weight, _)| *weight > 0.0)
        .map(|(middle_mm, weight, place)| (along(((middle_mm - bounds.min) / longest_mm).to_array()), weight, place))
        .collect();
    keyed.sort_by_key(|(key, ..)| *key);
    let weights: Vec<f64> = keyed.iter().map(|(_, weight, _)| *weight).collect();
    Some((Choices::new(&weights)?, keyed.into_iter().map(|(.., place)| place).collect()))
}

/// The parts of the first weight, of the first two and so on, of 2^16; all but the last.
fn parts<const N: usize, const M: usize>(weights: &[f64; N]) -> [u16; M] {
    let total: f64 = weights.iter().sum();
    let last = weights.iter().rposition(|weight| *weight > 0.0).unwrap_or(0);
    let until = |k: usize| {
        if k >= last { u16::MAX } else { (weights[..=k].iter().sum::<f64>() / total * 65536.0).round() as u16 }
    };
    std::array::from_fn(until)
}

/// The corner that a number leads to.
fn part<const M: usize>(parts: &[u16; M], number: u32) -> usize {
    // The last corner that has light has no end beyond it.
    let number = ((number >> 16) as u16).min(u16::MAX - 1);
    parts.iter().map(|part| usize::from(*part <= number)).sum()
}

/// The zone that a number in 0..1 leads to.
fn zone_of(mixture: &Mixture, mut number: f64) -> u32 {
    let found = mixture.weights.iter().position(|weight| {
        number -= weight;
        number < 0.0
    });
    // What rounding leaves over belongs to the weightiest, which is the first.
    mixture.zones[found.unwrap_or(0)]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Corners are picked by their weights, to 2^-16, and those without any never.
    #[test]
    fn corners_without_light_are_never_picked() {
        for weights in [[0.0, 1.0, 3.0], [1.0, 0.0, 0.0], [0.0, 0.0, 2.0], [5.0, 1.0, 0.0], [1e-9, 1.0, 0.0]] {
            let parts: [u16; 2] = parts(&weights);
            let mut counted = [0.0; 3];
            (0..=u16::MAX).for_each(|number| counted[part(&parts, u32::from(number) << 16 | 0xffff)] += 1.0 / 65536.0);
            for (share, weight) in counted.into_iter().zip(weights) {
                let expected = weight / weights.iter().sum::<f64>();
                assert!(
                    (share - expected).abs() < 2.0 / 65536.0 && (weight > 0.0 || share == 0.0),
                    "{weights:?} {counted:?}"
                );
            }
        }
    }
}
