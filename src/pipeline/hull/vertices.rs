//! From lattice nodes to the levels of the points: each vertex moves along the lattice's normal onto the plane through the levels
//! around it. Sideways it stays on the lattice, so rims and flat chips keep their exact extent.

use super::covariance::{flattest, outer, trace};
use super::emission::Light;
use super::lattice::{Lattice, Place};
use super::weld::Joined;
use glam::{DMat3, DVec3};

/// A cell has a say in a vertex's place when one of its faces and the vertex's normal, or that and the plane's, agree so well.
const AGREES: f64 = 0.3;
/// How strongly a plane that the points leave open keeps to the lattice.
const STIFFNESS: f64 = 0.05;
/// Neighbouring normals with a smaller cosine make a crease.
const CREASE: f64 = 0.5;
/// Levels lie on a crease when their variance off the plane is more than this share of that within.
const CREASED: f64 = 0.06;
/// A face of a box is flat when its levels vary less, in cells.
const EVEN: f64 = 0.03;
/// Rounds in which vertices are evened out.
const RELAXATIONS: usize = 8;

/// A vertex where the points want it.
#[derive(Clone, Copy, Debug)]
pub struct Placed {
    /// Position, mm.
    pub at_mm: DVec3,
    /// Unit normal of the surface there.
    pub normal: DVec3,
    /// May move sideways; vertices without points around them stay at their lattice nodes, those of sharp edges in the edge.
    evens_out: bool,
}

/// Places each vertex.
pub fn place(joined: &Joined, light: &Light, lattice: &Lattice) -> Vec<Placed> {
    let mut normals = vec![DVec3::ZERO; joined.nodes.len()];
    let mut sides = vec![0u8; lattice.len()];
    for quad in &joined.quads {
        sides[quad.cell] |= side_bit(quad.normal);
        for vertex in quad.vertices {
            normals[vertex as usize] += quad.normal;
        }
    }
    let on_plane = |(node, normal): (&Place, DVec3)| {
        let (node_mm, normal) = (lattice.node_mm(*node), normal.normalize_or_zero());
        let levels = levels_around(*node, normal, light, lattice, &sides);
        match plane(&levels, normal, lattice) {
            Some(plane) => {
                let at_mm = node_mm + normal * plane.shift_mm(node_mm, normal, lattice);
                let sharp_mm = plane.creased.then(|| sharpened_mm(at_mm, normal, &levels, lattice)).flatten();
                Placed { at_mm: sharp_mm.unwrap_or(at_mm), normal: plane.normal, evens_out: sharp_mm.is_none() }
            }
            None => Placed { at_mm: node_mm, normal, evens_out: false },
        }
    };
    let mut places: Vec<Placed> = joined.nodes.iter().zip(normals).map(on_plane).collect();
    relax(joined, &mut places);
    // All points lie within the lattice's box, and so does their surface.
    let last = lattice.counts.map(|count| count - 1);
    let box_mm = lattice.bounds_mm([0; 3], last);
    for place in &mut places {
        place.at_mm = place.at_mm.clamp(box_mm.min, box_mm.max);
    }
    places
}

/// Evens out the distances between vertices, each within its plane: steps of the lattice are folded where they were moved together.
/// Rims and creases stay.
fn relax(joined: &Joined, places: &mut [Placed]) {
    let smooth = |vertex: usize, around: &Vec<u32>| {
        let normal = places[vertex].normal;
        places[vertex].evens_out && around.iter().all(|other| places[*other as usize].normal.dot(normal) > CREASE)
    };
    let neighbours: Vec<Vec<u32>> = joined.neighbours();
    let movable: Vec<usize> =
        (0..places.len()).filter(|v| !neighbours[*v].is_empty() && smooth(*v, &neighbours[*v])).collect();
    for _ in 0..RELAXATIONS {
        let moved = movable.iter().map(|vertex| {
            let (place, around) = (&places[*vertex], &neighbours[*vertex]);
            let middle_mm =
                around.iter().map(|other| places[*other as usize].at_mm).sum::<DVec3>() / around.len() as f64;
            place.at_mm + 0.5 * (middle_mm - place.at_mm).reject_from_normalized(place.normal)
        });
        for (vertex, at_mm) in movable.iter().zip(moved.collect::<Vec<_>>()) {
            places[*vertex].at_mm = at_mm;
        }
    }
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
    /// Faces of the cell that are part of the surface, one bit each.
    sides: u8,
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
                    sides: sides[index],
                    weight: steps.iter().map(|step| 1.0 - 0.5 * step).product(),
                    touches: steps.iter().all(|step| *step < 1.0),
                }));
            }
        }
    }
    levels
}

/// A plane through levels.
#[derive(Clone, Copy)]
struct Plane {
    at_mm: DVec3,
    normal: DVec3,
    /// The levels are far from lying in one plane.
    creased: bool,
}

impl Plane {
    /// How far along `normal` a vertex at `node_mm` has to go to lie on the plane; at most through one cell.
    fn shift_mm(&self, node_mm: DVec3, normal: DVec3, lattice: &Lattice) -> f64 {
        let most_mm = normal.abs().dot(lattice.cell_mm);
        ((self.at_mm - node_mm).dot(self.normal) / normal.dot(self.normal)).clamp(-most_mm, most_mm)
    }
}

/// The plane through the levels of the cells that touch the vertex, in the direction of all; what they leave open follows the
/// lattice's `normal`. `None` without levels.
fn plane(levels: &[Level], normal: DVec3, lattice: &Lattice) -> Option<Plane> {
    let (middle_mm, spread) = moments(levels.iter())?;
    let at_mm = moments(levels.iter().filter(|level| level.touches)).map_or(middle_mm, |(near_mm, _)| near_mm);
    let across = DMat3::IDENTITY - outer(normal);
    let cell_mm = DMat3::from_diagonal(lattice.cell_mm * lattice.cell_mm);
    let flattest = flattest(spread + across * cell_mm * across * STIFFNESS, normal);
    let flattest = flattest * flattest.dot(normal).signum();
    let off_plane = flattest.dot(spread * flattest);
    let creased = off_plane > CREASED * 0.5 * (trace(spread) - off_plane);
    Some(Plane { at_mm, normal: if flattest.dot(normal) < AGREES { normal } else { flattest }, creased })
}

/// A vertex near the edge of a box: moved onto those flat faces of the box that it belongs to, by the cells that have no part in
/// another face. `None` where there is no flat face.
fn sharpened_mm(at_mm: DVec3, normal: DVec3, levels: &[Level], lattice: &Lattice) -> Option<DVec3> {
    let mut sharp_mm = at_mm;
    let mut found = false;
    for axis in (0..3).filter(|axis| normal[*axis].abs() > AGREES) {
        let only = side_bit(DVec3::AXES[axis] * normal[axis]);
        let Some((mean_mm, spread)) = moments(levels.iter().filter(|level| level.sides == only)) else { continue };
        if spread.col(axis)[axis] < (EVEN * lattice.cell_mm[axis]).powi(2) {
            sharp_mm[axis] = mean_mm[axis];
            found = true;
        }
    }
    found.then_some(sharp_mm)
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
