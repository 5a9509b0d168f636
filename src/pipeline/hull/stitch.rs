//! Which faces of the solid emit, and which join those that do [сшивание].
//!
//! A cloud may be a closed body, an open dome or a flat chip: faces that light leaves stay, faces it leaves *from behind* go, and
//! what lies along the light stays only where it joins two that stay.

use super::disjoint_sets::Groups;
use super::emission::{Light, SIDES};
use super::lattice::{Lattice, Place};
use super::mesh::Label;
use super::views::Solid;
use glam::DVec3;

/// A face or direction lies along the light when the cosine between them is smaller.
const ALONG: f64 = 0.3;
/// A hole of so few dropped faces in a far larger surface is closed again: it comes from noise in the net directions.
const SMALL_HOLE: u32 = 16;
/// How much larger the surface around a small hole must be.
const FAR_LARGER: u32 = 8;
/// No face, no edge.
const NONE: u32 = u32::MAX;

/// A face of a solid cell towards a cell outside.
#[derive(Clone, Copy, Debug)]
pub struct Face {
    /// Index of the solid cell.
    pub cell: usize,
    /// The same by its numbers.
    pub place: Place,
    /// Which of [`SIDES`].
    pub side: usize,
    /// Part of the surface for its own sake: light leaves here.
    pub emits: bool,
    /// How it came to be.
    pub label: Label,
}

impl Face {
    /// Outward unit normal.
    pub fn normal(&self) -> DVec3 {
        DVec3::from(SIDES[self.side].map(f64::from))
    }

    /// Its four nodes, counter-clockwise seen from outside.
    pub fn corners(&self) -> [Place; 4] {
        let (axis, far) = (self.side / 2, self.side % 2);
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let steps = if far == 1 { [[0, 0], [1, 0], [1, 1], [0, 1]] } else { [[0, 0], [0, 1], [1, 1], [1, 0]] };
        steps.map(|[step_u, step_v]| {
            let mut node = self.place;
            node[axis] += far;
            node[u] += step_u;
            node[v] += step_v;
            node
        })
    }

    /// The step from its cell to the cell outside.
    pub fn step(&self) -> [i32; 3] {
        SIDES[self.side]
    }

    /// The cell outside, as signed numbers: it may lie outside the lattice.
    pub fn outside(&self) -> [i64; 3] {
        [0, 1, 2].map(|axis| self.place[axis] as i64 + i64::from(SIDES[self.side][axis]))
    }
}

/// The boundary of a solid: its faces, and which of them meet at each edge.
pub struct Boundary {
    /// The faces, by cell and side.
    pub faces: Vec<Face>,
    /// The four edges of each face; edge k runs from corner k to corner k + 1.
    pub edges_of: Vec<[u32; 4]>,
    /// Two or four faces of each edge, padded with `u32::MAX`.
    pub faces_at: Vec<[u32; 4]>,
}

/// Why a face may stay.
#[derive(Clone, Copy, PartialEq)]
enum Standing {
    /// Light leaves here.
    Emits,
    /// Light passes along it, in this net direction: stays while it joins on both ends.
    Along(DVec3),
    /// No light near: stays while it joins all around.
    Dark,
    /// Light comes from behind.
    Behind,
}

/// The faces of the solid's surface, with the boundary they come from; `kept[face]` tells which.
pub fn surface(solid: &Solid, light: &Light) -> (Boundary, Vec<bool>) {
    let mut boundary = Boundary::of(solid);
    let standings = boundary.label(light);
    let mut kept: Vec<bool> = standings.iter().map(|standing| *standing != Standing::Behind).collect();
    boundary.peel(&standings, &mut kept);
    boundary.restore(&mut kept);
    (boundary, kept)
}

impl Boundary {
    fn of(solid: &Solid) -> Boundary {
        let mut faces = Vec::new();
        for cell in (0..solid.cells.len()).filter(|cell| solid.cells[*cell]) {
            let place = solid.lattice.place(cell);
            faces.extend((0..6).filter(|side| !solid.has(place, SIDES[*side])).map(|side| Face {
                cell,
                place,
                side,
                emits: false,
                label: Label::Stitched,
            }));
        }
        let (edges_of, faces_at) = edges(&faces, &solid.lattice);
        Boundary { faces, edges_of, faces_at }
    }

    /// Decides each face's standing and label. Each point belongs to one view, so of the faces of a surface cell only the one that its
    /// light faces most is projected.
    fn label(&mut self, light: &Light) -> Vec<Standing> {
        let mut standings = Vec::with_capacity(self.faces.len());
        for faces in self.faces.chunk_by_mut(|a, b| a.cell == b.cell) {
            let net = light.net(faces[0].cell);
            let dark = light.points(faces[0].cell) == 0;
            let most = faces.iter().map(|face| face.normal().dot(net.unwrap_or(DVec3::ZERO))).fold(0.0, f64::max);
            for face in faces {
                let standing = net.map_or(Standing::Dark, |net| standing(face.normal(), net));
                face.emits = standing == Standing::Emits;
                let foremost = face.normal().dot(net.unwrap_or(DVec3::ZERO)) >= most;
                face.label = match (dark, face.emits && foremost) {
                    (true, _) => Label::Filled,
                    (false, true) => Label::Projected,
                    (false, false) => Label::Stitched,
                };
                standings.push(standing);
            }
        }
        standings
    }

    /// Drops faces that join nothing, until all that are left do. The outcome does not depend on the order.
    fn peel(&self, standings: &[Standing], kept: &mut [bool]) {
        let mut meeting: Vec<u32> = self
            .faces_at
            .iter()
            .map(|faces| faces.iter().filter(|face| is_kept(kept, **face)).count() as u32)
            .collect();
        let mut doubtful: Vec<usize> = (0..kept.len()).filter(|face| kept[*face]).collect();
        while let Some(face) = doubtful.pop() {
            if !kept[face] || self.joins(face, standings[face], &meeting) {
                continue;
            }
            kept[face] = false;
            for edge in self.edges_of[face] {
                meeting[edge as usize] -= 1;
                doubtful.extend(
                    self.faces_at[edge as usize].iter().filter(|face| is_kept(kept, **face)).map(|face| *face as usize),
                );
            }
        }
    }

    fn joins(&self, face: usize, standing: Standing, meeting: &[u32]) -> bool {
        let met = |k: usize| meeting[self.edges_of[face][k] as usize] > 1;
        match standing {
            Standing::Emits => true,
            Standing::Behind => false,
            Standing::Dark => (0..4).all(met),
            // Its flanks may be open: the riser between two terraces of a tilted chip ends at the chip's rim.
            Standing::Along(net) => {
                (0..4).all(|k| met(k) || self.faces[face].towards(k).dot(net).abs() <= ALONG * net.length())
            }
        }
    }

    /// Takes back dropped faces: small holes in far larger surfaces, and whole bodies of which nothing would be left (light that
    /// only goes inwards).
    fn restore(&self, kept: &mut [bool]) {
        let (mut like, mut all) = (Groups::new(kept.len()), Groups::new(kept.len()));
        let pairs = |faces: &[u32; 4]| {
            let faces = *faces;
            (1..4).filter(move |k| faces[*k] != NONE).map(move |k| (faces[0], faces[k]))
        };
        for (a, b) in self.faces_at.iter().flat_map(pairs) {
            all.join(a, b);
        }
        for faces in &self.faces_at {
            for (a, b) in [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)].map(|(a, b)| (faces[a], faces[b])) {
                if a != NONE && b != NONE && kept[a as usize] == kept[b as usize] {
                    like.join(a, b);
                }
            }
        }
        let sizes = like.sizes();
        let mut around = vec![0; kept.len()];
        for (a, b) in self.faces_at.iter().flat_map(pairs).flat_map(|(a, b)| [(a, b), (b, a)]) {
            if !kept[a as usize] && kept[b as usize] {
                let hole = like.of(a) as usize;
                around[hole] = sizes[like.of(b) as usize].max(around[hole]);
            }
        }
        let mut lit = vec![false; kept.len()];
        for face in (0..kept.len()).filter(|face| kept[*face]) {
            lit[all.of(face as u32) as usize] = true;
        }
        for face in 0..kept.len() as u32 {
            let hole = like.of(face) as usize;
            let small = sizes[hole] <= SMALL_HOLE && around[hole] > FAR_LARGER * sizes[hole];
            kept[face as usize] |= small || !lit[all.of(face) as usize];
        }
    }
}

impl Face {
    /// Unit direction from the middle of the face to that of its edge `k`.
    fn towards(&self, k: usize) -> DVec3 {
        let corners = self.corners().map(|node| DVec3::from(node.map(|n| n as f64)));
        let middle = 0.5 * (corners[0] + corners[2]);
        2.0 * (0.5 * (corners[k] + corners[(k + 1) % 4]) - middle)
    }
}

fn is_kept(kept: &[bool], face: u32) -> bool {
    face != NONE && kept[face as usize]
}

/// A volume's light leaves through all its faces.
fn standing(normal: DVec3, net: DVec3) -> Standing {
    let cosine = normal.dot(net.normalize_or_zero());
    if net == DVec3::ZERO || cosine > ALONG {
        Standing::Emits
    } else if cosine < -ALONG {
        Standing::Behind
    } else {
        Standing::Along(net)
    }
}

/// Numbers the edges: those of each face, and the faces at each.
fn edges(faces: &[Face], lattice: &Lattice) -> (Vec<[u32; 4]>, Vec<[u32; 4]>) {
    let mut ends: Vec<(usize, usize, u32, usize)> = Vec::with_capacity(4 * faces.len());
    for (face, corners) in faces.iter().map(Face::corners).enumerate() {
        let nodes = corners.map(|node| lattice.node_index(node));
        for k in 0..4 {
            let (a, b) = (nodes[k], nodes[(k + 1) % 4]);
            ends.push((a.min(b), a.max(b), face as u32, k));
        }
    }
    ends.sort_unstable();
    let (mut edges_of, mut faces_at) = (vec![[NONE; 4]; faces.len()], Vec::new());
    for edge in ends.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
        let mut meeting = [NONE; 4];
        for (place, (_, _, face, k)) in edge.iter().enumerate() {
            edges_of[*face as usize][*k] = faces_at.len() as u32;
            meeting[place] = *face;
        }
        faces_at.push(meeting);
    }
    (edges_of, faces_at)
}
