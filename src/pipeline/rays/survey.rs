//! One reading of everything: what was found when every ray was read and checked once.

use super::super::vocabulary::space::Bounds;
use glam::DVec3;

/// Cells along one edge of a face of the direction cube.
pub const CUBE_CELLS: usize = 12;

/// Flux by direction on the faces of a cube: 6 × 12 × 12 cells of known solid angle. The cube, unlike a polar grid, is the same
/// seen from each of the six axes, so a turned source gives a turned answer.
#[derive(Clone, Debug, PartialEq)]
pub struct DirectionCube {
    /// `[face][row][column]`, faces in the order of `Axis::ALL`; primary flux (W, or lm where only lm is known).
    pub flux: Vec<f64>,
    /// Rays per cell.
    pub rays: Vec<u64>,
}

/// What was found in one or more ray sets.
#[derive(Clone, Debug)]
pub struct Survey {
    /// Records read.
    pub rays_read: u64,
    /// Rays that go on: read − refused − dropped.
    pub rays_used: u64,
    /// Sum of the stored radiant values of the used rays.
    pub radiant_sum: f64,
    /// Sum of the stored luminous values of the used rays.
    pub luminous_sum: f64,
    /// Box of the used rays' origins, mm.
    pub bounds_mm: Bounds,
    /// Smallest and largest wavelength of the used rays, nm; `None` without wavelengths.
    pub wavelength_nm: Option<(f64, f64)>,
    /// Flux-weighted mean of the origins, mm.
    pub centroid_mm: DVec3,
    /// Flux by direction.
    pub directions: DirectionCube,
}
