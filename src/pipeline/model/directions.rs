//! Where new rays go: directions of a goniogram, as often as it has light there. A ray goes round one of its nodes, and of the light that is
//! interpolated from the node it is a part.

use super::chance::{Choices, Decision, Numbers};
use super::curve::along;
use super::evaluation::Evaluator;
use crate::goniogram::SphereGrid;
use glam::{DMat3, DVec3};
use std::f64::consts::{PI, TAU};

/// The directions of all zones, or of a volume.
pub struct Directions {
    /// For each zone the flux into the surroundings of each node, in the order of `nodes`; `None` where there is none.
    zones: Vec<Option<Choices>>,
    /// C plane and γ node of each, in the order of a curve over the grid: those that follow each other lie near each other.
    nodes: Vec<[u32; 2]>,
    rings: Vec<Ring>,
    /// Angle of each C plane, and its sine and cosine.
    planes: Vec<(f64, (f64, f64))>,
    step: f64,
    source_from_photometric: DMat3,
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

impl Directions {
    /// Those of the model that `evaluator` evaluates, in its quantity.
    pub fn new(evaluator: &Evaluator<'_>) -> Directions {
        let light = evaluator.light();
        let (grid, rings) = (light.grid, light.grid.gamma_nodes());
        let weights_sr = grid.interpolation_weights_sr();
        let mut nodes: Vec<[u32; 2]> =
            (0..grid.c_planes() * rings).map(|at| [at / rings, at % rings].map(|k| k as u32)).collect();
        let size = [grid.c_planes(), rings].map(|count| count as f64);
        nodes.sort_by_cached_key(|node| along::<2>(std::array::from_fn(|k| (f64::from(node[k]) + 0.5) / size[k])));
        let zone = |values: &[f64]| {
            let weight = |[plane, ring]: &[u32; 2]| {
                values[*plane as usize * rings + *ring as usize] * weights_sr[*ring as usize]
            };
            Choices::new(&nodes.iter().map(weight).collect::<Vec<f64>>())
        };
        let zones = match evaluator.nodes_of_volume() {
            Some(values) => vec![zone(values)],
            None => (0..light.zones.len()).map(|at| zone(evaluator.nodes(at))).collect(),
        };
        let step = TAU / grid.c_planes() as f64;
        Directions {
            zones,
            nodes,
            rings: (0..rings).map(|node| Ring::new(grid, node)).collect(),
            planes: (0..grid.c_planes()).map(|plane| plane as f64 * step).map(|c| (c, c.sin_cos())).collect(),
            step,
            source_from_photometric: light.frame.source_from_photometric(),
        }
    }

    /// The number of the node of a ray of `zone`; `None` where that is dark.
    pub fn find(&self, zone: usize, numbers: &Numbers) -> Option<usize> {
        Some(self.zones[zone].as_ref()?.find(numbers.get(Decision::Node)))
    }

    /// A unit direction round that node, in the source frame, and its C and γ.
    pub fn around(&self, node: usize, numbers: &mut Numbers) -> (DVec3, (f64, f64)) {
        let [plane, ring] = self.nodes[node].map(|at| at as usize);
        let (ring, (at, at_sin_cos)) = (&self.rings[ring], self.planes[plane]);
        let along = on_both_sides(numbers.uniform(Decision::AlongC)) * self.step;
        let (sin_c, cos_c) = sin_cos_beyond(at, at_sin_cos, along);
        let (step, largest) = ring.sides[usize::from(numbers.uniform(Decision::Side) >= ring.below)];
        let (mut nearer, mut kept) = (numbers.uniform(Decision::AlongGamma), numbers.uniform(Decision::Kept));
        let (gamma, (sin, cos)) = loop {
            // Distances with the density 1 − s, kept in proportion to sin γ.
            let beyond = step * (1.0 - nearer.sqrt());
            let (sin, cos) = sin_cos_beyond(ring.gamma, ring.sin_cos, beyond);
            if kept * largest <= sin {
                break (ring.gamma + beyond, (sin, cos));
            }
            [nearer, kept] = numbers.again();
        };
        let direction = self.source_from_photometric * DVec3::new(sin * cos_c, sin * sin_c, -cos);
        (direction, (at + along, gamma))
    }
}

/// A distance of -1 to 1 with the density 1 − |s|, which grows with a number in 0..1.
fn on_both_sides(number: f64) -> f64 {
    let from_middle = 2.0 * number - 1.0;
    (1.0 - (1.0 - from_middle.abs()).sqrt()).copysign(from_middle)
}

/// Sine and cosine of an angle that lies `beyond` one, of which they are known: where that is little, as between the nodes of most grids, by
/// their series, to 10^-10, a thousandth of what a ray file holds. A third of the time of a ray would go into these functions otherwise.
fn sin_cos_beyond(angle: f64, (sin, cos): (f64, f64), beyond: f64) -> (f64, f64) {
    const LITTLE: f64 = 0.3;
    if beyond.abs() > LITTLE {
        return (angle + beyond).sin_cos();
    }
    let square = beyond * beyond;
    let series = |parts: &[f64]| parts.iter().rev().fold(1.0, |sum, part| 1.0 - square * part * sum);
    let own_sin = beyond * series(&[1.0 / 6.0, 1.0 / 20.0, 1.0 / 42.0]);
    let own_cos = series(&[1.0 / 2.0, 1.0 / 12.0, 1.0 / 30.0, 1.0 / 56.0]);
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_on_both_sides_fall_off_evenly() {
        for at in [-0.9, -0.5, -0.1, 0.0, 0.2, 0.7] {
            let below = (0..100_000).filter(|step| on_both_sides((f64::from(*step) + 0.5) / 1e5) < at).count();
            let until: f64 = 0.5 * (1.0 + at) * (1.0 + at);
            let expected = if at < 0.0 { until } else { 1.0 - 0.5 * (1.0 - at) * (1.0 - at) };
            assert!((below as f64 / 1e5 - expected).abs() < 2e-5, "{at}: {below}");
        }
    }

    #[test]
    fn angles_a_little_beyond_have_their_sine_and_cosine() {
        for k in 0..2000 {
            let (angle, beyond) = (f64::from(k) * 0.003, f64::from(k % 101) * 0.01 - 0.5);
            let (sin, cos) = sin_cos_beyond(angle, angle.sin_cos(), beyond);
            let (exact_sin, exact_cos) = (angle + beyond).sin_cos();
            // What the series leaves out: 0.3^9/9!.
            assert!((sin - exact_sin).abs() < 6e-11 && (cos - exact_cos).abs() < 6e-11, "{angle} {beyond}");
        }
    }
}
