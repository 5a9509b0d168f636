//! The zone lattice and which point belongs where.

use super::super::vocabulary::space::{Bounds, Frame};
use super::intensity::Goniogram;
use glam::DVec3;

/// A regular lattice of zones over the emission, in the plane normal to γ = 0. Columns run along C0 (photometric x), rows along
/// C90 (photometric y).
#[derive(Clone, Debug, PartialEq)]
pub struct Lattice {
    /// The frame whose x and y span the plane.
    pub frame: Frame,
    /// Zones along C0.
    pub columns: usize,
    /// Zones along C90.
    pub rows: usize,
    /// Lower corner in the plane, photometric x and y, mm.
    pub min_mm: [f64; 2],
    /// Upper corner in the plane, photometric x and y, mm.
    pub max_mm: [f64; 2],
}

impl Lattice {
    /// Row and column of a point; points outside belong to the nearest zone.
    pub fn place(&self, point_mm: DVec3) -> (usize, usize) {
        let along = |axis: usize, count: usize, at: f64| {
            let span = self.max_mm[axis] - self.min_mm[axis];
            if !(span > 0.0) {
                return 0;
            }
            (((at - self.min_mm[axis]) / span * count as f64).floor().max(0.0) as usize).min(count - 1)
        };
        let column = along(0, self.columns, point_mm.dot(self.frame.x()));
        let row = along(1, self.rows, point_mm.dot(self.frame.y()));
        (row, column)
    }
}

/// A zone that holds light.
#[derive(Clone, Debug, PartialEq)]
pub struct Zone {
    /// Its index among the zones that hold light.
    pub id: u32,
    /// Row in the lattice.
    pub row: usize,
    /// Column in the lattice.
    pub column: usize,
    /// Box of its vertices, source frame, mm.
    pub bounds_mm: Bounds,
    /// Flux-weighted mean of its vertices, source frame, mm.
    pub centroid_mm: DVec3,
    /// Area of the surface that its vertices stand for, mm².
    pub area_mm2: f64,
    /// How many vertices.
    pub vertex_count: usize,
    /// What it sends where.
    pub goniogram: Goniogram,
}
