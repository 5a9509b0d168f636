//! A regular lattice over the box of the origins: the cells in which rays start are lit, and nodes are the corners of lit cells.

use crate::error::Error;
use crate::hull::Cloud;
use crate::smoothing::Edge;
use crate::source::Ray;
use crate::vocabulary::space::Bounds;
use crate::vocabulary::watch::StageWatch;
use glam::DVec3;
use std::sync::atomic::{AtomicBool, Ordering};

/// Rays for each node, and fewest and most nodes.
const RAYS_PER_NODE: f64 = 20.0;
const FEWEST_NODES: f64 = 2_000.0;
const MOST_NODES: f64 = 32_000.0;
/// Most spectral numbers of all nodes together: 5 MB of attributes.
const MOST_NUMBERS: f64 = 1.3e6;
/// Most cells of the box, dark ones too.
const MOST_CELLS: f64 = 4_194_304.0;
/// A lattice with so many times more nodes than were wanted (thin or ragged clouds have more corners to a cell) is made anew, at most so often.
const AT_MOST_MORE: f64 = 1.5;
const MOST_TRIES: usize = 6;
/// Cells of the lattice on which it is seen how much of the box is filled.
const COARSE_CELLS: f64 = 3_000.0;
/// A box has at least this edge, mm, and this part of its longest edge as thickness.
const LEAST_MM: f64 = 1e-6;
const LEAST_THICKNESS: f64 = 1e-6;
/// Fewer rays in a coarse cell are strays.
const FEWEST_RAYS: u32 = 2;
/// A cloud thinner than this part of its longest side has no volume.
const THINNEST: f64 = 0.05;
/// Part of the rays that start in cells with lit neighbours on all six sides where a volume is filled.
const FILLED: f64 = 0.3;
/// Where the two points lie in 0..1 whose mean is the integral of any cubic: (1 ∓ 1/√3)/2 (Gauss and Legendre).
pub const AT_GAUSS: [f64; 2] = [0.211_324_865_405_187_1, 0.788_675_134_594_812_9];

/// A regular lattice of which some cells are lit.
#[derive(Clone, Debug, PartialEq)]
pub struct VolumeLattice {
    /// Least corner, mm.
    pub min_mm: DVec3,
    /// Edges of a cell, mm.
    pub pitch_mm: DVec3,
    /// Cells along x, y and z.
    pub cells: [usize; 3],
    /// Whether rays start in a cell, `[z][y][x]`.
    pub is_lit: Vec<bool>,
    /// Number of each corner, `[z][y][x]`; `u32::MAX` where no cell round it is lit.
    number: Vec<u32>,
    /// How many nodes there are. They are numbered in the order of the corners.
    pub node_count: usize,
}

/// Shares of the corners of a cell in a point at `x`, `y`, `z` (0 to 1) in it, `[z][y][x]`: what is linear along each of them.
pub fn shares([x, y, z]: [f64; 3]) -> [f64; 8] {
    std::array::from_fn(|corner| {
        let along = |bit: usize, at: f64| if corner >> bit & 1 == 1 { at } else { 1.0 - at };
        along(0, x) * along(1, y) * along(2, z)
    })
}

/// Whether the origins of `rays` fill a volume, and do not lie on its surface.
pub fn is_filled(rays: &[Ray]) -> bool {
    let bounds = Bounds::of(rays.iter().map(|ray| ray.origin_mm));
    let size_mm = bounds.size();
    if size_mm.min_element() <= THINNEST * size_mm.max_element() {
        return false;
    }
    let coarse = VolumeLattice::regular(bounds, COARSE_CELLS);
    let counts = coarse.counts(rays);
    let is_inside = |cell: usize| {
        let [x, y, z] = coarse.unfold(cell);
        let lit = |dx: isize, dy: isize, dz: isize| {
            coarse.fold([x as isize + dx, y as isize + dy, z as isize + dz]).is_some_and(|cell| counts[cell] > 0)
        };
        lit(1, 0, 0) && lit(-1, 0, 0) && lit(0, 1, 0) && lit(0, -1, 0) && lit(0, 0, 1) && lit(0, 0, -1)
    };
    let inside: u32 = (0..counts.len()).filter(|cell| is_inside(*cell)).map(|cell| counts[cell]).sum();
    f64::from(inside) > FILLED * rays.len() as f64
}

impl VolumeLattice {
    /// Of `cells` cells from `min_mm` on, of which those that are `lit` (`[z][y][x]`, one each) are.
    pub fn of_cells(min_mm: DVec3, pitch_mm: DVec3, cells: [usize; 3], lit: Vec<bool>) -> VolumeLattice {
        VolumeLattice { min_mm, pitch_mm, cells, is_lit: Vec::new(), number: Vec::new(), node_count: 0 }.with(lit)
    }

    /// The lattice of the origins of `cloud`, with as many nodes as its rays can feed; by how much of the box the `sample` fills.
    ///
    /// # Errors
    /// As [`Cloud::fold`].
    pub fn of(cloud: &Cloud<'_>, sample: &[Ray], watch: StageWatch<'_>) -> Result<VolumeLattice, Error> {
        let bounds = cloud.bounds_mm();
        let coarse = VolumeLattice::regular(bounds, COARSE_CELLS);
        let counts = coarse.counts(sample);
        let filled = match counts.iter().filter(|rays| **rays >= FEWEST_RAYS).count() {
            0 => counts.len(),
            filled => filled,
        };
        let most = MOST_NODES.min(MOST_NUMBERS / cloud.spectral().numbers().max(1) as f64);
        let nodes = (cloud.ray_count() as f64 / RAYS_PER_NODE).clamp(FEWEST_NODES.min(most), most);
        let mut count = nodes * counts.len() as f64 / filled as f64;
        for _ in 0..MOST_TRIES {
            let lattice = VolumeLattice::regular(bounds, count.min(MOST_CELLS)).lit_by(cloud, watch)?;
            let too_many = lattice.node_count as f64 / nodes;
            if too_many < AT_MOST_MORE {
                return Ok(lattice);
            }
            count = count.min(MOST_CELLS) / too_many.powf(1.2);
        }
        VolumeLattice::regular(bounds, count).lit_by(cloud, watch)
    }

    /// The same lattice with the cells in which rays start.
    fn lit_by(self, cloud: &Cloud<'_>, watch: StageWatch<'_>) -> Result<VolumeLattice, Error> {
        let lattice = self;
        let lit: Vec<AtomicBool> =
            std::iter::repeat_with(|| AtomicBool::new(false)).take(lattice.cell_count()).collect();
        let look = |rays: &[Ray]| {
            for ray in rays {
                let flag = &lit[lattice.place(ray.origin_mm).0];
                if !flag.load(Ordering::Relaxed) {
                    flag.store(true, Ordering::Relaxed);
                }
            }
            Ok(())
        };
        cloud.fold(watch, (), look, |(), ()| ())?;
        let lit = lattice.closed(lit.into_iter().map(AtomicBool::into_inner).collect());
        Ok(lattice.with(lit))
    }

    /// About `count` cells, nearly cubes, over `bounds`; none of them lit.
    fn regular(bounds: Bounds, count: f64) -> VolumeLattice {
        let longest_mm = bounds.size().max_element().max(LEAST_MM);
        let size_mm = bounds.size().max(DVec3::splat((LEAST_THICKNESS * longest_mm).max(LEAST_MM)));
        // What is thinner than a cell has one layer of them, and the others lie side by side.
        let mut thick = size_mm.to_array().to_vec();
        thick.sort_unstable_by(f64::total_cmp);
        let edge_of = |thick: &[f64]| (thick.iter().product::<f64>() / count).powf(1.0 / thick.len() as f64);
        while thick.len() > 1 && thick[0] < edge_of(&thick) {
            thick.remove(0);
        }
        let edge_mm = edge_of(&thick);
        let cells = size_mm.to_array().map(|along| (along / edge_mm).round().max(1.0) as usize);
        let pitch_mm = size_mm / DVec3::from_array(cells.map(|count| count as f64));
        VolumeLattice { min_mm: bounds.min, pitch_mm, cells, is_lit: Vec::new(), number: Vec::new(), node_count: 0 }
    }

    /// About `count` cells over `bounds`, all lit.
    #[cfg(test)]
    pub fn all_lit(bounds: Bounds, count: f64) -> VolumeLattice {
        let regular = VolumeLattice::regular(bounds, count);
        let lit = vec![true; regular.cell_count()];
        regular.with(lit)
    }

    /// The same lattice with the cells that are `lit`, and their nodes.
    fn with(self, lit: Vec<bool>) -> VolumeLattice {
        let mut lattice = VolumeLattice { is_lit: lit, ..self };
        let mut is_node = vec![false; lattice.cells.map(|count| count + 1).iter().product()];
        for cell in lattice.lit_cells() {
            lattice.corner_places(cell).into_iter().for_each(|place| is_node[place] = true);
        }
        let mut next = 0;
        let number = |is_node: &bool| {
            next += u32::from(*is_node);
            if *is_node { next - 1 } else { u32::MAX }
        };
        lattice.number = is_node.iter().map(number).collect();
        lattice.node_count = next as usize;
        lattice
    }

    /// Lit cells, and dark ones between lit ones where there is room for one only: those have no ray by chance.
    fn closed(&self, lit: Vec<bool>) -> Vec<bool> {
        let near = |marked: &[bool], outside: bool, all: bool| -> Vec<bool> {
            let of = |cell: usize| {
                let [x, y, z] = self.unfold(cell).map(|at| at as isize);
                let near = [[0, 0, 0], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]];
                let mut marks = near
                    .into_iter()
                    .map(|[dx, dy, dz]| self.fold([x + dx, y + dy, z + dz]).map_or(outside, |cell| marked[cell]));
                if all { marks.all(|mark| mark) } else { marks.any(|mark| mark) }
            };
            (0..marked.len()).map(of).collect()
        };
        let closed = near(&near(&lit, false, false), true, true);
        // Cells at the border of the box have no neighbours beyond it that would keep them dark.
        let is_border =
            |cell: usize| self.unfold(cell).into_iter().zip(self.cells).any(|(at, n)| at == 0 || at + 1 == n);
        lit.iter().zip(closed).enumerate().map(|(cell, (lit, closed))| *lit || (closed && !is_border(cell))).collect()
    }

    fn cell_count(&self) -> usize {
        self.cells.iter().product()
    }

    fn unfold(&self, cell: usize) -> [usize; 3] {
        let [x, y, _] = self.cells;
        [cell % x, cell / x % y, cell / (x * y)]
    }

    fn fold(&self, at: [isize; 3]) -> Option<usize> {
        let inside = at.iter().zip(self.cells).all(|(at, count)| (0..count as isize).contains(at));
        let [x, y, z] = at.map(|at| at as usize);
        inside.then(|| (z * self.cells[1] + y) * self.cells[0] + x)
    }

    fn counts(&self, rays: &[Ray]) -> Vec<u32> {
        let mut counts = vec![0; self.cell_count()];
        rays.iter().for_each(|ray| counts[self.place(ray.origin_mm).0] += 1);
        counts
    }

    /// The cell of a point and where it lies in it, 0 to 1 along x, y and z; a point outside belongs to the nearest cell.
    pub fn place(&self, point_mm: DVec3) -> (usize, [f64; 3]) {
        let at = ((point_mm - self.min_mm) / self.pitch_mm).to_array();
        let cell: [usize; 3] = std::array::from_fn(|k| (at[k].max(0.0) as usize).min(self.cells[k] - 1));
        let within = std::array::from_fn(|k| (at[k] - cell[k] as f64).clamp(0.0, 1.0));
        ((cell[2] * self.cells[1] + cell[1]) * self.cells[0] + cell[0], within)
    }

    /// The point that lies `at` in a cell, mm.
    pub fn point_mm(&self, cell: usize, at: [f64; 3]) -> DVec3 {
        let corner = self.unfold(cell).map(|at| at as f64);
        self.min_mm + self.pitch_mm * (DVec3::from_array(corner) + DVec3::from_array(at))
    }

    fn corner_places(&self, cell: usize) -> [usize; 8] {
        let [x, y, z] = self.unfold(cell);
        let [columns, rows, _] = self.cells.map(|count| count + 1);
        std::array::from_fn(|k| ((z + (k >> 2)) * rows + y + (k >> 1 & 1)) * columns + x + (k & 1))
    }

    /// The nodes at the corners of a lit cell, `[z][y][x]`.
    pub fn corners(&self, cell: usize) -> [u32; 8] {
        self.corner_places(cell).map(|place| self.number[place])
    }

    /// Indices of the lit cells, ascending.
    pub fn lit_cells(&self) -> impl Iterator<Item = usize> + '_ {
        self.is_lit.iter().enumerate().filter(|(_, lit)| **lit).map(|(cell, _)| cell)
    }

    /// Where the nodes are, mm.
    pub fn points_mm(&self) -> Vec<DVec3> {
        let [columns, rows, _] = self.cells.map(|count| count + 1);
        let point = |place: usize| {
            let at = [place % columns, place / columns % rows, place / (columns * rows)];
            self.min_mm + self.pitch_mm * DVec3::from_array(at.map(|at| at as f64))
        };
        (0..self.number.len()).filter(|place| self.number[*place] != u32::MAX).map(point).collect()
    }

    /// The volume that each node stands for, mm³.
    pub fn volumes_mm3(&self) -> Vec<f64> {
        let eighth_mm3 = self.pitch_mm.element_product() / 8.0;
        let mut volumes_mm3 = vec![0.0; self.node_count];
        for cell in self.lit_cells() {
            self.corners(cell).into_iter().for_each(|node| volumes_mm3[node as usize] += eighth_mm3);
        }
        volumes_mm3
    }

    /// Nodes side by side, joined by the part of the four cells round their edge that is lit.
    pub fn edges(&self) -> Vec<Edge> {
        let mut edges: Vec<(u32, u32)> = Vec::new();
        for cell in self.lit_cells() {
            let corners = self.corners(cell);
            for axis in [1, 2, 4] {
                edges.extend((0..8).filter(|k| k & axis == 0).map(|k| (corners[k], corners[k | axis])));
            }
        }
        edges.sort_unstable();
        edges.chunk_by(|a, b| a == b).map(|same| (same[0].0, same[0].1, 0.25 * same.len() as f64)).collect()
    }

    /// What is linear between `values` at the nodes, at a point of a lit cell.
    pub fn interpolate(&self, cell: usize, at: [f64; 3], values: &[f64]) -> f64 {
        self.corners(cell).into_iter().zip(shares(at)).map(|(node, share)| share * values[node as usize]).sum()
    }

    /// ∫ of that along the whole line through a point, ds in mm. Exact: along a line it is a cubic in each cell.
    pub fn integral(&self, point_mm: DVec3, direction: DVec3, values: &[f64]) -> f64 {
        self.integral_up_to(point_mm, direction, f64::INFINITY, values)
    }

    /// The same along the line up to `end_mm` beyond the point.
    pub fn integral_up_to(&self, point_mm: DVec3, direction: DVec3, end_mm: f64, values: &[f64]) -> f64 {
        let from = ((point_mm - self.min_mm) / self.pitch_mm).to_array();
        let per_mm = (direction / self.pitch_mm).to_array();
        let (mut enter, mut leave) = (f64::NEG_INFINITY, end_mm);
        for k in 0..3 {
            let (low, high) = (-from[k] / per_mm[k], (self.cells[k] as f64 - from[k]) / per_mm[k]);
            if per_mm[k] != 0.0 {
                (enter, leave) = (enter.max(low.min(high)), leave.min(low.max(high)));
            } else if !(0.0..=self.cells[k] as f64).contains(&from[k]) {
                return 0.0;
            }
        }
        if enter >= leave {
            return 0.0;
        }
        let at = |t: f64| -> [f64; 3] { std::array::from_fn(|k| from[k] + t * per_mm[k]) };
        let start = at(enter);
        let mut cell: [isize; 3] = std::array::from_fn(|k| (start[k] as isize).clamp(0, self.cells[k] as isize - 1));
        // Where the line leaves the present cell along each axis.
        let border = |k: usize, cell: isize| match per_mm[k] {
            0.0 => f64::INFINITY,
            speed => (cell as f64 + f64::from(speed > 0.0) - from[k]) / speed,
        };
        let mut next: [f64; 3] = std::array::from_fn(|k| border(k, cell[k]));
        let (mut t, mut sum) = (enter, 0.0);
        while let Some(place) = self.fold(cell).filter(|_| t < leave) {
            let axis = (0..3).fold(0, |best, k| if next[k] < next[best] { k } else { best });
            let end = next[axis].clamp(t, leave);
            if self.is_lit[place] && end > t {
                for part in AT_GAUSS {
                    let point = at(t + part * (end - t));
                    let within = std::array::from_fn(|k| (point[k] - cell[k] as f64).clamp(0.0, 1.0));
                    sum += 0.5 * (end - t) * self.interpolate(place, within, values);
                }
            }
            t = end;
            cell[axis] += if per_mm[axis] > 0.0 { 1 } else { -1 };
            next[axis] = border(axis, cell[axis]);
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A box of 2 x 1 x 1 mm from the origin on, 20 x 10 x 10 cells, all lit but those `dark`.
    fn lattice(dark: impl Fn([usize; 3]) -> bool) -> VolumeLattice {
        let bounds = Bounds { min: DVec3::ZERO, max: DVec3::new(2.0, 1.0, 1.0) };
        let regular = VolumeLattice::regular(bounds, 2000.0);
        assert_eq!(regular.cells, [20, 10, 10]);
        let lit = (0..regular.cell_count()).map(|cell| !dark(regular.unfold(cell))).collect();
        regular.with(lit)
    }

    /// Numbers in 0..1 without a generator: multiples of irrational numbers.
    fn scatter(k: usize) -> [f64; 4] {
        [2f64.sqrt(), 3f64.sqrt(), 5f64.sqrt(), 7f64.sqrt()].map(|root| (k as f64 * root).fract())
    }

    /// The path of a line through a box, by slabs.
    fn path(min: DVec3, max: DVec3, point: DVec3, direction: DVec3) -> f64 {
        let (low, high) = ((min - point) / direction, (max - point) / direction);
        (low.max(high).min_element() - low.min(high).max_element()).max(0.0)
    }

    /// Of 1 everywhere the integral is the length of the path, less that through what is dark.
    #[test]
    fn integrals_are_paths_through_lit_cells() {
        let hole = |[x, y, z]: [usize; 3]| (4..8).contains(&x) && (3..6).contains(&y) && (2..7).contains(&z);
        let lattice = lattice(hole);
        let ones = vec![1.0; lattice.node_count];
        for k in 1..2000 {
            let [x, y, z, w] = scatter(k);
            let direction = DVec3::new(z - 0.5, w - 0.5, (x * 7.0).fract() - 0.5).normalize();
            let point = DVec3::new(3.0 * x - 0.5, 2.0 * y - 0.5, 2.0 * w - 0.5);
            let whole = path(DVec3::ZERO, DVec3::new(2.0, 1.0, 1.0), point, direction);
            let dark = path(DVec3::new(0.4, 0.3, 0.2), DVec3::new(0.8, 0.6, 0.7), point, direction);
            let found = lattice.integral(point, direction, &ones);
            assert!((found - (whole - dark)).abs() < 1e-9, "{k}: {found} of {whole} - {dark}");
        }
        let along = lattice.integral(DVec3::new(9.0, 0.5, 0.9), DVec3::X, &ones);
        assert!((along - 2.0).abs() < 1e-12, "{along}");
        assert_eq!(lattice.integral(DVec3::new(9.0, 1.5, 0.9), DVec3::X, &ones), 0.0);
    }

    /// ∫ x ds along a diagonal of the box, whose middle is at x = 1.
    #[test]
    fn what_is_linear_is_integrated_exactly() {
        let lattice = lattice(|_| false);
        let values: Vec<f64> = lattice.points_mm().iter().map(|point| point.x).collect();
        let found = lattice.integral(DVec3::ZERO, DVec3::new(2.0, 1.0, 1.0).normalize(), &values);
        assert!((found - 6f64.sqrt()).abs() < 1e-9, "{found}");
    }

    #[test]
    fn nodes_stand_for_all_of_the_lit_volume() {
        let lattice = lattice(|[x, ..]| x == 3);
        let sum: f64 = lattice.volumes_mm3().iter().sum();
        assert!((sum - 1.9).abs() < 1e-12, "{sum}");
        assert_eq!(lattice.points_mm().len(), lattice.node_count);
        for k in 0..100 {
            let [x, y, z, _] = scatter(k);
            assert!((shares([x, y, z]).iter().sum::<f64>() - 1.0).abs() < 1e-15);
        }
        // 21 x 11 x 11 corners have 20 x 11 x 11 + 2 x 21 x 10 x 11 edges; those of the dark layer along x are none.
        assert_eq!(lattice.edges().len(), 19 * 121 + 2 * 21 * 110);
    }

    #[test]
    fn single_cells_without_a_ray_are_filled_and_hollows_are_not() {
        let one = |[x, y, z]: [usize; 3]| [x, y, z] == [5, 5, 5];
        let lattice_of = lattice(one);
        assert!(lattice_of.closed(lattice_of.is_lit.clone()).iter().all(|lit| *lit));
        let hollow = |at: [usize; 3]| at.iter().all(|at| (3..7).contains(at));
        let lattice_of = lattice(hollow);
        let closed = lattice_of.closed(lattice_of.is_lit.clone());
        // Its edges are rounded.
        let inside = |cell: usize| lattice_of.unfold(cell).iter().all(|at| (4..6).contains(at));
        assert!((0..closed.len()).filter(|cell| inside(*cell)).all(|cell| !closed[cell]));
    }

    #[test]
    fn a_ball_is_filled_and_its_surface_is_not() {
        let ray = |origin_mm: DVec3| Ray {
            origin_mm,
            direction: DVec3::Z,
            radiant_w: 1.0,
            luminous_lm: 0.0,
            column: 0,
            xz_lm: [0.0; 2],
        };
        let within = |k: usize| {
            let [x, y, z, _] = scatter(k);
            2.0 * DVec3::new(x, y, z) - DVec3::ONE
        };
        let ball: Vec<DVec3> = (1..40_000).map(within).filter(|at| at.length() < 1.0).collect();
        assert!(is_filled(&ball.iter().map(|at| ray(*at)).collect::<Vec<_>>()));
        assert!(!is_filled(&ball.iter().map(|at| ray(at.normalize())).collect::<Vec<_>>()));
        assert!(!is_filled(&ball.iter().map(|at| ray(*at * DVec3::new(1.0, 1.0, 0.0))).collect::<Vec<_>>()));
        assert!(!is_filled(&[]));
    }
}
