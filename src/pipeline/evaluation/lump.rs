//! Small parts of a source, each as one point: how much flux of each zone it has, where its middle is, and how far it reaches.

use super::emission::Emission;
use crate::vocabulary::space::Bounds;
use crate::volume::lattice::{VolumeLattice, shares};
use glam::DVec3;

/// A part as a point.
#[derive(Clone, Debug, Default)]
pub struct Lump {
    /// Middle of its flux, mm.
    pub center_mm: DVec3,
    /// No point of it is farther from the middle, mm.
    pub radius_mm: f64,
    /// The box that it lies in, mm.
    pub bounds_mm: Option<Bounds>,
    /// Its area, mm², or its volume, mm³.
    pub extent: f64,
    /// Zones whose directions its light takes.
    pub zones: Vec<u32>,
    /// Flux of each, `[zone][channel]`.
    pub flux: Vec<f64>,
    corners: Vec<f64>,
}

/// A part that a triangle or a cell is cut into.
#[derive(Clone, Copy, Debug)]
pub enum Piece {
    /// A part of a triangle: its corners, as barycentric coordinates in the whole.
    Triangle(u32, [[f64; 3]; 3]),
    /// A part of a lit cell: its least corner, 0 to 1 in the whole, and its edge.
    Cell(u32, [f64; 3], f64),
}

impl Piece {
    /// All of a triangle.
    pub fn triangle(triangle: u32) -> Piece {
        Piece::Triangle(triangle, [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    }

    /// All of a cell.
    pub fn cell(cell: u32) -> Piece {
        Piece::Cell(cell, [0.0; 3], 1.0)
    }

    /// Its edges as a part of the whole's.
    pub fn edge(&self) -> f64 {
        match self {
            Piece::Triangle(_, [a, b, _]) => a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max),
            Piece::Cell(_, _, edge) => *edge,
        }
    }

    /// Calls `visit` with its parts: four of a triangle, eight of a cell.
    pub fn split(&self, mut visit: impl FnMut(Piece)) {
        match *self {
            Piece::Triangle(triangle, [a, b, c]) => {
                let middle = |a: [f64; 3], b: [f64; 3]| -> [f64; 3] { std::array::from_fn(|k| 0.5 * (a[k] + b[k])) };
                let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
                for corners in [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]] {
                    visit(Piece::Triangle(triangle, corners));
                }
            }
            Piece::Cell(cell, from, edge) => {
                let half = 0.5 * edge;
                for corner in 0..8_usize {
                    let at = std::array::from_fn(|k| from[k] + if corner >> k & 1 == 1 { half } else { 0.0 });
                    visit(Piece::Cell(cell, at, half));
                }
            }
        }
    }

    /// Fills in its flux.
    pub fn fill(&self, emission: &Emission<'_>, lump: &mut Lump) {
        lump.zones.clear();
        lump.flux.clear();
        match *self {
            Piece::Triangle(triangle, corners) => lump.fill_triangle(emission, triangle as usize, corners),
            Piece::Cell(cell, from, edge) => {
                if let Some(volume) = emission.light().volume {
                    lump.fill_cell(emission, &volume.lattice, cell as usize, from, edge);
                }
            }
        }
    }
}

impl Lump {
    /// Middle between `points_mm` weighted by `weights`, and the farthest of them.
    fn center(&mut self, points_mm: &[DVec3], weights: &[f64]) {
        let sum: f64 = weights.iter().sum();
        let even = 1.0 / points_mm.len() as f64;
        let weight = |weight: f64| if sum > 0.0 { weight / sum } else { even };
        self.center_mm = points_mm.iter().zip(weights).map(|(point, own)| weight(*own) * *point).sum();
        let farthest = |most: f64, point: &DVec3| most.max(point.distance(self.center_mm));
        self.radius_mm = points_mm.iter().fold(0.0, farthest);
        self.bounds_mm = Some(Bounds::of(points_mm.iter().copied()));
    }

    /// M is linear on the triangle, and so are the shares p of its corners: ∫ M p dA = A/12 (Σ m_i p_i + Σ m_i Σ p_i).
    fn fill_triangle(&mut self, emission: &Emission<'_>, triangle: usize, pieces: [[f64; 3]; 3]) {
        let mesh = emission.light().mesh;
        let (vertices, corners_mm, channels) =
            (mesh.triangles[triangle], mesh.corners_mm(triangle), emission.channels());
        let points_mm = pieces.map(|at| at[0] * corners_mm[0] + at[1] * corners_mm[1] + at[2] * corners_mm[2]);
        self.extent = 0.5 * (points_mm[1] - points_mm[0]).cross(points_mm[2] - points_mm[0]).length();
        self.corners.clear();
        self.corners.resize(4 * channels, 0.0);
        for (piece, at) in pieces.iter().enumerate() {
            for (vertex, share) in vertices.iter().zip(at).filter(|(_, share)| **share > 0.0) {
                for (channel, density) in emission.density(*vertex as usize).iter().enumerate() {
                    self.corners[piece * channels + channel] += share * density;
                    self.corners[3 * channels + channel] += share * density;
                }
            }
        }
        let [sum, own] = [&self.corners[3 * channels..], &self.corners[..3 * channels]];
        let all = emission.weighed(sum);
        let weights: [f64; 3] = std::array::from_fn(|k| emission.weighed(&own[k * channels..][..channels]) + all);
        for (corner, vertex) in vertices.iter().enumerate() {
            let part: f64 = pieces.iter().map(|at| at[corner]).sum();
            for (zone, weight) in emission.parts(*vertex as usize) {
                let at = self.zones.iter().position(|known| *known == zone as u32).unwrap_or_else(|| {
                    self.zones.push(zone as u32);
                    self.flux.resize(self.zones.len() * channels, 0.0);
                    self.zones.len() - 1
                });
                for channel in 0..channels {
                    let one = |piece: usize| self.corners[piece * channels + channel] * pieces[piece][corner];
                    let shared = one(0) + one(1) + one(2) + self.corners[3 * channels + channel] * part;
                    self.flux[at * channels + channel] += weight * self.extent / 12.0 * shared;
                }
            }
        }
        self.center(&points_mm, &weights);
    }

    /// j is linear along each edge of the cell: its mean is that of the eight corners.
    fn fill_cell(&mut self, emission: &Emission<'_>, lattice: &VolumeLattice, cell: usize, from: [f64; 3], edge: f64) {
        let channels = emission.channels();
        let nodes = lattice.corners(cell);
        self.extent = lattice.pitch_mm.element_product() * edge.powi(3);
        self.zones.push(0);
        self.flux.resize(channels, 0.0);
        let mut weights = [0.0; 8];
        let at = |corner: usize| std::array::from_fn(|k| from[k] + if corner >> k & 1 == 1 { edge } else { 0.0 });
        for (corner, weight) in weights.iter_mut().enumerate() {
            for (node, share) in nodes.iter().zip(shares(at(corner))).filter(|(_, share)| *share > 0.0) {
                let density = emission.density(*node as usize);
                *weight += share * emission.weighed(density);
                let part = share * self.extent / 8.0;
                self.flux.iter_mut().zip(density).for_each(|(sum, density)| *sum += part * density);
            }
        }
        // Along each axis the middle of a corner's light lies at a third from it.
        let mut near = [0.0; 8];
        for (corner, weight) in weights.iter().enumerate() {
            (0..8_usize).for_each(|other| near[other] += weight * 2_f64.powi(3 - (corner ^ other).count_ones() as i32));
        }
        self.center(&std::array::from_fn::<DVec3, 8, _>(|corner| lattice.point_mm(cell, at(corner))), &near);
    }
}
