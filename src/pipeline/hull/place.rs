//! From lattice nodes to the levels of the points: each vertex moves along the lattice's normal onto the plane through the levels
//! around it. Sideways it stays on the lattice, so rims and flat chips keep their exact extent.

use super::join::Joined;
use super::lattice::{Lattice, Place};
use super::light::Light;
use glam::{DMat3, DVec3};

/// A cell has a say in a vertex's place when one of its faces and the vertex's normal, or that and the plane's, agree so well.
const AGREES: f64 = 0.3;
/// How strongly a plane that the points leave open keeps to the lattice.
const STIFFNESS: f64 = 0.05;

/// Position of each vertex, mm.
pub fn place(joined: &Joined, light: &Light, lattice: &Lattice) -> Vec<DVec3> {
    let mut normals = vec![DVec3::ZERO; joined.nodes.len()];
    let mut sides = vec![0u8; lattice.len()];
    for quad in &joined.quads {
        sides[quad.cell] |= side_bit(quad.normal);
        for vertex in quad.vertices {
            normals[vertex as usize] += quad.normal;
        }
    }
    let placed = joined.nodes.iter().zip(normals).map(|(node, normal)| {
        let normal = normal.normalize_or_zero();
        let levels = levels_around(*node, normal, light, lattice, &sides);
        lattice.node_mm(*node) + normal * shift_mm(lattice.node_mm(*node), normal, &levels, lattice)
    });
    placed.collect()
}

/// One bit for each of the six axis directions.
fn side_bit(normal: DVec3) -> u8 {
    let axis = normal.abs().max_position();
    1 << (2 * axis + usize::from(normal[axis] > 0.0))
}

/// Where the surface runs through a cell near a vertex.
struct Level {
    at_mm: DVec3,
    /// Falls off with the distance from the vertex.
    weight: f64,
    /// The cell touches the vertex.
    touches: bool,
}

/// Levels of the cells within two cells of a node whose part of the surface faces `normal`.
fn levels_around(node: Place, normal: DVec3, light: &Light, lattice: &Lattice, sides: &[u8]) -> Vec<Level> {
    let faces = |cell: usize| {
        (0..6).any(|side| {
            let component = normal[side / 2] * if side % 2 == 1 { 1.0 } else { -1.0 };
            sides[cell] & (1 << side) != 0 && component > AGREES
        })
    };
    let mut levels = Vec::with_capacity(16);
    let span = |axis: usize| node[axis].saturating_sub(2)..(node[axis] + 2).min(lattice.counts[axis]);
    for z in span(2) {
        for y in span(1) {
            for x in span(0) {
                let cell = [x, y, z];
                let index = lattice.index(cell);
                let level = faces(index).then(|| light.level_mm(index, normal)).flatten();
                let steps = [0, 1, 2].map(|axis| (cell[axis] as f64 + 0.5 - node[axis] as f64).abs());
                levels.extend(level.map(|at_mm| Level {
                    at_mm,
                    weight: steps.iter().map(|step| 1.0 - 0.5 * step).product(),
                    touches: steps.iter().all(|step| *step < 1.0),
                }));
            }
        }
    }
    levels
}

/// How far along `normal` a vertex at `node_mm` has to go to lie on the plane through the levels; at most one cell.
fn shift_mm(node_mm: DVec3, normal: DVec3, levels: &[Level], lattice: &Lattice) -> f64 {
    let Some((middle_mm, _)) = moments(levels.iter()) else { return 0.0 };
    let plane = plane_normal(levels, normal, lattice);
    let near_mm = moments(levels.iter().filter(|level| level.touches)).map_or(middle_mm, |(mean_mm, _)| mean_mm);
    let most_mm = (normal * lattice.cell_mm).length();
    ((near_mm - node_mm).dot(plane) / normal.dot(plane)).clamp(-most_mm, most_mm)
}

/// Normal of the plane the levels lie in; what they leave open follows the lattice's `normal`.
fn plane_normal(levels: &[Level], normal: DVec3, lattice: &Lattice) -> DVec3 {
    let Some((_, spread)) = moments(levels.iter()) else { return normal };
    let across = DMat3::IDENTITY - outer(normal);
    let cell_mm = DMat3::from_diagonal(lattice.cell_mm * lattice.cell_mm);
    let plane = flattest(spread + across * cell_mm * across * STIFFNESS, normal);
    let plane = plane * plane.dot(normal).signum();
    if plane.dot(normal) < AGREES { normal } else { plane }
}

/// Weighted mean, mm, and covariance, mm², of levels; `None` without any.
fn moments<'a>(levels: impl Iterator<Item = &'a Level> + Clone) -> Option<(DVec3, DMat3)> {
    let total: f64 = levels.clone().map(|level| level.weight).sum();
    if total <= 0.0 {
        return None;
    }
    let mean = levels.clone().map(|level| level.at_mm * level.weight).sum::<DVec3>() / total;
    let mut spread = DMat3::ZERO;
    for level in levels {
        spread += outer(level.at_mm - mean) * (level.weight / total);
    }
    Some((mean, spread))
}

fn outer(v: DVec3) -> DMat3 {
    DMat3::from_cols(v * v.x, v * v.y, v * v.z)
}

/// Unit vector along which a covariance is least, of those that are equal the nearest to `start`: inverse iteration.
pub fn flattest(spread: DMat3, start: DVec3) -> DVec3 {
    let trace = spread.x_axis.x + spread.y_axis.y + spread.z_axis.z;
    if trace <= 0.0 {
        return start;
    }
    let inverse = (spread * (1.0 / trace) + DMat3::from_diagonal(DVec3::splat(1e-9))).inverse();
    let mut least = start;
    for _ in 0..16 {
        least = (inverse * least).normalize_or(start);
    }
    least
}
