//! Flux by direction on the faces of a cube.

use crate::vocabulary::space::Axis;
use glam::DVec3;

/// Cells along one edge of a face of the direction cube. Even, so that every hemisphere along an axis is a set of cells.
pub const CUBE_CELLS: usize = 12;

/// Flux by direction on the faces of a cube: 6 × 12 × 12 cells of known solid angle. The cube, unlike a polar grid, is the same
/// seen from each of the six axes, so a turned source gives a turned answer.
#[derive(Clone, Debug, PartialEq)]
pub struct DirectionCube {
    /// `[face][row][column]`, faces in the order of `Axis::ALL`; primary flux (W, or lm where only lm is known). Rows run
    /// along the axis after the face's in cyclic order (x → y → z → x), columns along the one after that.
    pub flux: Vec<f64>,
    /// Rays per cell.
    pub rays: Vec<u64>,
}

impl DirectionCube {
    /// Cells of all six faces.
    pub const CELLS: usize = 6 * CUBE_CELLS * CUBE_CELLS;

    /// No light.
    pub fn dark() -> DirectionCube {
        DirectionCube { flux: vec![0.0; Self::CELLS], rays: vec![0; Self::CELLS] }
    }

    /// The cell a direction (any length but 0) falls into.
    pub fn cell(direction: DVec3) -> usize {
        let size = direction.abs();
        // Ties go to z, then x: the order of `Axis::ALL`.
        let (pair, k) = match size {
            DVec3 { x, y, z } if z >= x && z >= y => (0, 2),
            DVec3 { x, y, .. } if x >= y => (2, 0),
            _ => (4, 1),
        };
        let face = pair + usize::from(direction[k] < 0.0);
        let depth = size[k];
        let slot = |component: f64| {
            let place = 0.5 * CUBE_CELLS as f64 * (component / depth + 1.0);
            (place as usize).min(CUBE_CELLS - 1)
        };
        (face * CUBE_CELLS + slot(direction[(k + 1) % 3])) * CUBE_CELLS + slot(direction[(k + 2) % 3])
    }

    /// Solid angle of a cell, sr, exact: a rectangle at unit distance spans atan(uv/√(1+u²+v²)) from the foot point to
    /// its corner (u, v).
    pub fn solid_angle_sr(cell: usize) -> f64 {
        let corner = |u: f64, v: f64| (u * v / (1.0 + u * u + v * v).sqrt()).atan();
        let (row, column) = (cell / CUBE_CELLS % CUBE_CELLS, cell % CUBE_CELLS);
        let (u0, u1, v0, v1) = (edge(row), edge(row + 1), edge(column), edge(column + 1));
        corner(u1, v1) - corner(u0, v1) - corner(u1, v0) + corner(u0, v0)
    }

    /// Unit direction through the middle of a cell.
    pub fn center(cell: usize) -> DVec3 {
        let axis = Axis::ALL[(cell / (CUBE_CELLS * CUBE_CELLS)).min(5)];
        let (row, column) = (cell / CUBE_CELLS % CUBE_CELLS, cell % CUBE_CELLS);
        let mut direction = axis.vector();
        direction[(axis.component() + 1) % 3] = 0.5 * (edge(row) + edge(row + 1));
        direction[(axis.component() + 2) % 3] = 0.5 * (edge(column) + edge(column + 1));
        direction.normalize()
    }

    /// Share of the flux in the open hemisphere round each axis, in the order of `Axis::ALL`; exact, because cells end there.
    pub fn hemispheres(&self) -> [f64; 6] {
        let total: f64 = self.flux.iter().sum();
        Axis::ALL.map(|axis| {
            let ahead = |(cell, _): &(usize, &f64)| DirectionCube::center(*cell).dot(axis.vector()) > 0.0;
            let part: f64 = self.flux.iter().enumerate().filter(ahead).map(|(_, flux)| flux).sum();
            if total > 0.0 { part / total } else { 0.0 }
        })
    }

    /// Adds a ray of this direction (any length but 0) and flux.
    pub fn add(&mut self, direction: DVec3, flux: f64) {
        let cell = DirectionCube::cell(direction);
        self.flux[cell] += flux;
        self.rays[cell] += 1;
    }

    /// Adds the flux and the rays of another cube.
    pub fn merge(&mut self, other: &DirectionCube) {
        self.flux.iter_mut().zip(&other.flux).for_each(|(sum, part)| *sum += part);
        self.rays.iter_mut().zip(&other.rays).for_each(|(sum, part)| *sum += part);
    }
}

/// Edge `k` of the cells on a face at unit distance, −1..=1.
fn edge(k: usize) -> f64 {
    2.0 * k as f64 / CUBE_CELLS as f64 - 1.0
}
