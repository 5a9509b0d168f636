//! From lattice faces to quads that share vertices: no edge with more than two quads, no vertex in which surfaces only touch.

use super::disjoint_sets::Groups;
use super::emission::Light;
use super::lattice::Place;
use super::mesh::Label;
use super::stitch::{Boundary, surface};
use super::views::Solid;
use glam::DVec3;
use std::collections::BTreeMap;

/// How often the solid is mended before offending faces are dropped instead.
const MENDINGS: usize = 8;

/// A face of the surface.
#[derive(Clone, Copy, Debug)]
pub struct Quad {
    /// Vertices, counter-clockwise seen from outside.
    pub vertices: [u32; 4],
    /// Outward normal on the lattice.
    pub normal: DVec3,
    /// Index of the solid cell it belongs to.
    pub cell: usize,
    /// How it came to be.
    pub label: Label,
}

/// The surface on the lattice.
pub struct Joined {
    /// Its faces.
    pub quads: Vec<Quad>,
    /// The lattice node of each vertex; surfaces that only touch have vertices of their own at the same node.
    pub nodes: Vec<Place>,
}

impl Joined {
    /// The vertices that share an edge with each vertex; none on the rim of an open surface.
    pub fn neighbours(&self) -> Vec<Vec<u32>> {
        let mut next: Vec<Vec<u32>> = vec![Vec::new(); self.nodes.len()];
        let mut previous = next.clone();
        for quad in &self.quads {
            for k in 0..4 {
                let (from, to) = (quad.vertices[k], quad.vertices[(k + 1) % 4]);
                next[from as usize].push(to);
                previous[to as usize].push(from);
            }
        }
        // Inside of a surface every edge is run along both ways.
        let inside = next.into_iter().zip(&mut previous).map(|(mut next, previous)| {
            next.sort_unstable();
            previous.sort_unstable();
            if next == *previous { next } else { Vec::new() }
        });
        inside.collect()
    }
}

/// Joins the surface of the solid. Where it cannot be joined properly (two surfaces that touch in an edge, and around both of its ends),
/// the solid is mended: the cells between them are added.
pub fn join(solid: &mut Solid, light: &Light) -> Joined {
    for _ in 0..MENDINGS {
        let (boundary, kept) = surface(solid, light);
        let corners = weld(&boundary, &kept);
        let tangled = tangled_edges(&boundary, &kept, &corners);
        if tangled.is_empty() {
            return quads(&boundary, &kept, &corners);
        }
        for face in tangled.iter().flat_map(|edge| boundary.faces_at[*edge as usize]) {
            let outside =
                boundary.faces.get(face as usize).and_then(|face| solid.lattice.beside(face.place, face.step()));
            if let Some(cell) = outside {
                let index = solid.lattice.index(cell);
                solid.cells[index] = true;
            }
        }
    }
    let (boundary, mut kept) = surface(solid, light);
    loop {
        let corners = weld(&boundary, &kept);
        let tangled = tangled_edges(&boundary, &kept, &corners);
        if tangled.is_empty() {
            return quads(&boundary, &kept, &corners);
        }
        for edge in tangled {
            let meeting = boundary.kept_at(edge, &kept);
            let least = meeting.iter().min_by_key(|face| (boundary.faces[**face as usize].emits, **face));
            if let Some(face) = least {
                kept[*face as usize] = false;
            }
        }
    }
}

impl Boundary {
    fn kept_at(&self, edge: u32, kept: &[bool]) -> Vec<u32> {
        self.faces_at[edge as usize].into_iter().filter(|face| kept.get(*face as usize) == Some(&true)).collect()
    }

    /// Which of a face's edges `edge` is.
    fn position(&self, face: u32, edge: u32) -> usize {
        self.edges_of[face as usize].iter().position(|other| *other == edge).unwrap_or(0)
    }

    /// Node at which `edge` starts, going round the face.
    fn start(&self, face: u32, edge: u32) -> Place {
        self.faces[face as usize].corners()[self.position(face, edge)]
    }

    /// Which kept faces continue each other over an edge. Of four, those that look into the same cell outside: a thin slanting sheet
    /// hangs together. Of three, the two that emit.
    fn pairs(&self, edge: u32, kept: &[bool]) -> Vec<(u32, u32)> {
        let meeting = self.kept_at(edge, kept);
        let face = |index: u32| &self.faces[index as usize];
        let mut candidates = Vec::new();
        for (k, a) in meeting.iter().enumerate() {
            for b in &meeting[k + 1..] {
                let same_outside = face(*a).outside() == face(*b).outside();
                // Faces that run along the edge in the same direction face each other's backs.
                if self.start(*a, edge) != self.start(*b, edge) {
                    let emitting = u8::from(face(*a).emits) + u8::from(face(*b).emits);
                    candidates.push((std::cmp::Reverse((emitting, same_outside)), *a, *b));
                }
            }
        }
        if meeting.len() == 4 {
            candidates.retain(|(_, a, b)| face(*a).outside() == face(*b).outside());
            return candidates.into_iter().map(|(_, a, b)| (a, b)).collect();
        }
        candidates.sort_unstable();
        candidates.first().map(|(_, a, b)| (*a, *b)).into_iter().collect()
    }
}

/// Joins corners over shared edges. Answers the group of each corner, `4 face + k`.
fn weld(boundary: &Boundary, kept: &[bool]) -> Vec<u32> {
    let mut groups = Groups::new(4 * boundary.faces.len());
    for edge in 0..boundary.faces_at.len() as u32 {
        for (a, b) in boundary.pairs(edge, kept) {
            let (at_a, at_b) = (boundary.position(a, edge) as u32, boundary.position(b, edge) as u32);
            groups.join(4 * a + at_a, 4 * b + (at_b + 1) % 4);
            groups.join(4 * a + (at_a + 1) % 4, 4 * b + at_b);
        }
    }
    (0..4 * boundary.faces.len() as u32).map(|corner| groups.of(corner)).collect()
}

/// Edges along which two faces run from the same vertex to the same vertex.
fn tangled_edges(boundary: &Boundary, kept: &[bool], corners: &[u32]) -> Vec<u32> {
    let mut tangled = Vec::new();
    for edge in 0..boundary.faces_at.len() as u32 {
        let ends = boundary.kept_at(edge, kept).into_iter().map(|face| {
            let k = boundary.position(face, edge);
            (corners[4 * face as usize + k], corners[4 * face as usize + (k + 1) % 4])
        });
        let mut ends: Vec<(u32, u32)> = ends.collect();
        ends.sort_unstable();
        if ends.windows(2).any(|pair| pair[0] == pair[1]) {
            tangled.push(edge);
        }
    }
    tangled
}

/// Numbers the vertices in the order in which the faces name them.
fn quads(boundary: &Boundary, kept: &[bool], corners: &[u32]) -> Joined {
    let mut joined = Joined { quads: Vec::new(), nodes: Vec::new() };
    let mut vertices: BTreeMap<u32, u32> = BTreeMap::new();
    for (index, face) in boundary.faces.iter().enumerate().filter(|(index, _)| kept[*index]) {
        let nodes = face.corners();
        let named = [0, 1, 2, 3].map(|k| {
            *vertices.entry(corners[4 * index + k]).or_insert_with(|| {
                joined.nodes.push(nodes[k]);
                joined.nodes.len() as u32 - 1
            })
        });
        joined.quads.push(Quad { vertices: named, normal: face.normal(), cell: face.cell, label: face.label });
    }
    joined
}
