//! The regular lattice the six views share: cells, nodes, and who lies where.

use crate::vocabulary::space::Bounds;
use glam::DVec3;

/// Thickness of a cell along an axis in which the cloud has no extent, in cells of the other axes.
const FLAT: f64 = 0.01;
/// Edge of the cube that stands for a cloud without any extent, mm.
pub const POINT_EDGE_MM: f64 = 1e-3;
/// Cell numbers with many divisors: a lattice with so many cells along its axes can be coarsened by whole factors.
const DIVISIBLE: [usize; 22] = [1, 2, 3, 4, 6, 8, 10, 12, 16, 18, 20, 24, 28, 32, 36, 40, 48, 60, 72, 80, 84, 96];

/// A cell or node by its numbers along x, y, z.
pub type Place = [usize; 3];

/// Equal cells over a box: the first and the last node of each axis lie on the box exactly.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lattice {
    /// First node, mm.
    pub min_mm: DVec3,
    /// Edge lengths of a cell, mm; all positive.
    pub cell_mm: DVec3,
    /// Cells along x, y, z; all positive.
    pub counts: [usize; 3],
}

impl Lattice {
    /// About `resolution` cells along the longest edge of `bounds`, and nearly as long ones along the others.
    pub fn fit(bounds: Bounds, resolution: u32) -> Lattice {
        Lattice::fit_by(bounds, resolution, |ideal| ideal.round().max(1.0) as usize)
    }

    /// As [`Lattice::fit`], with cell numbers that have many divisors (`resolution` should).
    pub fn fit_divisible(bounds: Bounds, resolution: u32) -> Lattice {
        Lattice::fit_by(bounds, resolution, |ideal| nearest(DIVISIBLE.into_iter(), ideal))
    }

    fn fit_by(bounds: Bounds, resolution: u32, count: impl Fn(f64) -> usize) -> Lattice {
        let (size, center) = (bounds.size(), bounds.center());
        let longest = size.max_element();
        let ideal = if longest > 0.0 { longest / f64::from(resolution) } else { POINT_EDGE_MM };
        // Below the rounding of the coordinates themselves a cell could not hold its points.
        let thinnest = if longest > 0.0 { FLAT * ideal } else { POINT_EDGE_MM }.max(1e-12 * center.abs().max_element());
        let mut lattice = Lattice { min_mm: bounds.min, cell_mm: DVec3::ONE, counts: [1; 3] };
        for axis in 0..3 {
            if size[axis] < thinnest {
                lattice.cell_mm[axis] = thinnest;
                lattice.min_mm[axis] = center[axis] - 0.5 * thinnest;
            } else {
                lattice.counts[axis] = count(size[axis] / ideal);
                lattice.cell_mm[axis] = size[axis] / lattice.counts[axis] as f64;
            }
        }
        lattice
    }

    /// How many cells of this lattice make one with about `resolution` along the longest edge, along each axis.
    pub fn factors(&self, resolution: u32) -> [usize; 3] {
        let size = self.cell_mm * self.counts_f64();
        let ideal = size.max_element() / f64::from(resolution);
        [0, 1, 2].map(|axis| {
            let count = self.counts[axis];
            let divisors = (1..=count).filter(|divisor| count.is_multiple_of(*divisor));
            count / nearest(divisors, size[axis] / ideal)
        })
    }

    /// The lattice whose cells are `factors` cells of this one.
    pub fn coarsened(&self, factors: [usize; 3]) -> Lattice {
        let scale = DVec3::from(factors.map(|factor| factor as f64));
        Lattice { cell_mm: self.cell_mm * scale, counts: [0, 1, 2].map(|a| self.counts[a] / factors[a]), ..*self }
    }

    fn counts_f64(&self) -> DVec3 {
        DVec3::from(self.counts.map(|count| count as f64))
    }

    /// Cells along the axis that has most.
    pub fn resolution(&self) -> u32 {
        self.counts.into_iter().max().unwrap_or(1) as u32
    }

    /// Number of cells.
    pub fn len(&self) -> usize {
        self.counts.iter().product()
    }

    /// The box of some cells, from the first to the last, mm.
    pub fn bounds_mm(&self, first: Place, last: Place) -> Bounds {
        Bounds { min: self.node_mm(first), max: self.node_mm(last.map(|n| n + 1)) }
    }

    /// The cell in which `point_mm` lies; `None` outside the box. Points on the far faces of the box belong to the last cells.
    pub fn cell_of(&self, point_mm: DVec3) -> Option<usize> {
        let at = (point_mm - self.min_mm) / self.cell_mm;
        let counts = self.counts_f64();
        // A point on the far face may come out a rounding beyond it.
        if !(at.cmpge(DVec3::ZERO).all() && at.cmple(counts * (1.0 + 1e-12)).all()) {
            return None;
        }
        let at = at.min(counts - 0.5);
        Some(self.index([at.x as usize, at.y as usize, at.z as usize]))
    }

    /// The index of a cell: x runs fastest.
    pub fn index(&self, cell: Place) -> usize {
        cell[0] + self.counts[0] * (cell[1] + self.counts[1] * cell[2])
    }

    /// The cell of an index.
    pub fn place(&self, index: usize) -> Place {
        let rest = index / self.counts[0];
        [index % self.counts[0], rest % self.counts[1], rest / self.counts[1]]
    }

    /// The cell `offset` away; `None` outside.
    pub fn beside(&self, cell: Place, offset: [i32; 3]) -> Option<Place> {
        let mut beside = cell;
        for axis in 0..3 {
            beside[axis] = cell[axis].checked_add_signed(offset[axis] as isize)?;
            if beside[axis] >= self.counts[axis] {
                return None;
            }
        }
        Some(beside)
    }

    /// All cells within `reach` steps along each axis, `cell` itself included, with their offsets.
    pub fn around(&self, cell: Place, reach: i32) -> impl Iterator<Item = ([i32; 3], usize)> {
        let span = -reach..=reach;
        span.clone()
            .flat_map(move |z| {
                let span = -reach..=reach;
                span.clone().flat_map(move |y| (-reach..=reach).map(move |x| [x, y, z]))
            })
            .filter_map(move |offset| self.beside(cell, offset).map(|beside| (offset, self.index(beside))))
    }

    /// Position of a node, mm.
    pub fn node_mm(&self, node: Place) -> DVec3 {
        self.min_mm + self.cell_mm * DVec3::from(node.map(|n| n as f64))
    }

    /// Middle of a cell, mm.
    pub fn center_mm(&self, cell: Place) -> DVec3 {
        self.node_mm(cell) + 0.5 * self.cell_mm
    }

    /// The index of a node: x runs fastest.
    pub fn node_index(&self, node: Place) -> usize {
        node[0] + (self.counts[0] + 1) * (node[1] + (self.counts[1] + 1) * node[2])
    }
}

/// The candidate nearest to `ideal` by ratio, the smaller one of two that are equally near; 1 without candidates.
fn nearest(candidates: impl Iterator<Item = usize>, ideal: f64) -> usize {
    let distance = |count: usize| (count as f64 / ideal).ln().abs();
    candidates.min_by(|a, b| distance(*a).total_cmp(&distance(*b))).unwrap_or(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sized(x: f64, y: f64, z: f64) -> Bounds {
        Bounds { min: DVec3::new(-1.0, 2.0, 5.0), max: DVec3::new(-1.0 + x, 2.0 + y, 5.0 + z) }
    }

    #[test]
    fn first_and_last_node_lie_on_the_box() {
        let bounds = sized(3.0, 1.1, 0.7);
        for lattice in [Lattice::fit(bounds, 30), Lattice::fit_divisible(bounds, 96)] {
            let all = lattice.bounds_mm([0; 3], lattice.counts.map(|n| n - 1));
            assert!((all.min - bounds.min).length() < 1e-12 && (all.max - bounds.max).length() < 1e-12);
            assert!(lattice.cell_mm.max_element() < 1.3 * lattice.cell_mm.min_element(), "{lattice:?}");
        }
    }

    #[test]
    fn missing_extents_get_thin_centred_cells() {
        let flat = Lattice::fit(sized(2.0, 1.0, 0.0), 10);
        assert_eq!(flat.counts, [10, 5, 1]);
        assert!((flat.cell_mm - DVec3::new(0.2, 0.2, 0.002)).length() < 1e-12);
        assert!((flat.center_mm([0, 0, 0]).z - 5.0).abs() < 1e-12);
        let point = Lattice::fit(sized(0.0, 0.0, 0.0), 10);
        assert_eq!((point.counts, point.cell_mm), ([1; 3], DVec3::splat(POINT_EDGE_MM)));
    }

    #[test]
    fn corners_belong_to_the_outermost_cells_and_outside_to_none() {
        let bounds = sized(0.3, 0.1, 0.7);
        let lattice = Lattice::fit(bounds, 7);
        assert_eq!(lattice.cell_of(bounds.min), Some(0));
        assert_eq!(lattice.cell_of(bounds.max), Some(lattice.len() - 1));
        assert_eq!(lattice.cell_of(bounds.max + DVec3::X), None);
        assert_eq!(lattice.cell_of(bounds.min - DVec3::Z), None);
        for index in 0..lattice.len() {
            assert_eq!(lattice.cell_of(lattice.center_mm(lattice.place(index))), Some(index));
        }
    }
}
