//! Pass 2: where light leaves the cells at the boundary of the solid, and in which direction.

use super::cloud::Pass;
use super::covariance::flattest;
use super::lattice::{Lattice, Place};
use super::views::Solid;
use crate::error::Error;
use crate::vocabulary::watch::StageWatch;
use glam::{DMat3, DVec3};
use std::sync::{Mutex, PoisonError};

/// Rays behind a net direction from which on it is trusted alone: the mean of so many directions that point everywhere is
/// longer than [`VOLUME`] once in 1e5.
const TRUSTED: f64 = 100.0;
/// A net direction shorter than this means light that leaves in all directions: a volume (a Lambertian surface has 2/3).
const VOLUME: f64 = 0.3;
/// How many cells around are asked when a cell has too few rays of its own.
const FARTHEST: i32 = 4;
/// One, in the fixed point in which directions and positions are summed: integer sums do not depend on their order.
const ONE: f64 = (1u64 << 30) as f64;

/// The side of a cell that the surface runs along.
#[derive(Clone, Copy, Debug)]
struct Outward {
    /// Unit normal of the solid's surface at the cell.
    normal: DVec3,
    /// The solid is so thin here that the cell is its front and its back.
    two_sided: bool,
}

/// Sums over the points of one cell.
#[derive(Clone, Copy)]
struct Tally {
    count: u64,
    /// Sum of directions, fixed point.
    direction: [i64; 3],
    /// Sum of positions from the cell's middle in cells, fixed point.
    position: [i64; 3],
    /// Least and greatest distance from the cell's middle along the outward normal, mm.
    reach_mm: [f64; 2],
}

const EMPTY: Tally =
    Tally { count: 0, direction: [0; 3], position: [0; 3], reach_mm: [f64::INFINITY, f64::NEG_INFINITY] };

/// What is known of the light of each cell at the boundary of the solid.
pub struct Light {
    lattice: Lattice,
    /// Index into the lists below per cell of the lattice; `u32::MAX` inside and outside of the solid.
    slots: Vec<u32>,
    outward: Vec<Outward>,
    tallies: Vec<Tally>,
    /// Net direction of each.
    nets: Vec<Option<DVec3>>,
}

/// Pass 2 over the boundary cells of the solid.
pub fn gather(pass: &Pass<'_>, solid: &Solid, watch: StageWatch<'_>) -> Result<Light, Error> {
    let lattice = solid.lattice;
    let mut light = Light {
        lattice,
        slots: vec![u32::MAX; lattice.len()],
        outward: Vec::new(),
        tallies: Vec::new(),
        nets: Vec::new(),
    };
    let exposed = |cell: Place| SIDES.iter().any(|side| !solid.has(cell, *side));
    let boundary: Vec<usize> =
        (0..lattice.len()).filter(|index| solid.cells[*index] && exposed(lattice.place(*index))).collect();
    for index in &boundary {
        light.slots[*index] = light.outward.len() as u32;
        light.outward.push(outward(solid, lattice.place(*index)));
    }
    // One set of sums per thread at work; which thread saw which rays does not show in integer sums, least and greatest.
    let sets: Mutex<Vec<Vec<Tally>>> = Mutex::new(Vec::new());
    pass(watch, &|rays| {
        let idle = sets.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let mut tallies = idle.unwrap_or_else(|| vec![EMPTY; light.outward.len()]);
        for ray in rays {
            let Some(index) = lattice.cell_of(ray.origin_mm) else { continue };
            let slot = light.slots[index] as usize;
            if let Some(tally) = tallies.get_mut(slot) {
                let from_center_mm = ray.origin_mm - lattice.center_mm(lattice.place(index));
                tally.add(from_center_mm, from_center_mm / lattice.cell_mm, ray.direction, light.outward[slot].normal);
            }
        }
        sets.lock().unwrap_or_else(PoisonError::into_inner).push(tallies);
    })?;
    light.tallies = vec![EMPTY; light.outward.len()];
    for set in sets.into_inner().unwrap_or_else(PoisonError::into_inner) {
        light.tallies.iter_mut().zip(&set).for_each(|(sum, part)| sum.merge(part));
    }
    light.nets = boundary.iter().map(|cell| light.measured_net(*cell)).collect();
    Ok(light)
}

/// Steps to the six neighbours: against and along x, y, z.
pub const SIDES: [[i32; 3]; 6] = [[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]];

impl Tally {
    fn add(&mut self, from_center_mm: DVec3, from_center: DVec3, direction: DVec3, normal: DVec3) {
        self.count += 1;
        for axis in 0..3 {
            self.direction[axis] += (direction[axis] * ONE) as i64;
            self.position[axis] += (from_center[axis] * ONE) as i64;
        }
        let reach_mm = from_center_mm.dot(normal);
        self.reach_mm = [self.reach_mm[0].min(reach_mm), self.reach_mm[1].max(reach_mm)];
    }

    fn merge(&mut self, other: &Tally) {
        self.count += other.count;
        for axis in 0..3 {
            self.direction[axis] += other.direction[axis];
            self.position[axis] += other.position[axis];
        }
        self.reach_mm = [self.reach_mm[0].min(other.reach_mm[0]), self.reach_mm[1].max(other.reach_mm[1])];
    }

    fn mean(&self, sum: [i64; 3]) -> DVec3 {
        DVec3::from(sum.map(|value| value as f64)) / (ONE * self.count as f64)
    }
}

/// The outward normal at a boundary cell, from the solid around it: away from the middle of the solid cells near it. Where they lie
/// on both sides alike the solid is a thin sheet, and the normal that of the plane they lie in.
fn outward(solid: &Solid, cell: Place) -> Outward {
    let lattice = &solid.lattice;
    let (mut away, mut spread, mut count) = (DVec3::ZERO, DMat3::ZERO, 0.0);
    for (offset, _) in lattice.around(cell, 2).filter(|(_, index)| solid.cells[*index]) {
        let offset = DVec3::from(offset.map(f64::from));
        away -= offset;
        let offset_mm = offset * lattice.cell_mm;
        spread += DMat3::from_cols(offset_mm * offset_mm.x, offset_mm * offset_mm.y, offset_mm * offset_mm.z);
        count += 1.0;
    }
    // A flat surface on a half-space has 75 cells and |away| = 75; the rim of a sheet one cell thick 15 cells and 15.
    if count > 30.0 && away.length() > 0.2 * count {
        return Outward { normal: (away / lattice.cell_mm).normalize(), two_sided: false };
    }
    let sides: DVec3 = SIDES
        .iter()
        .filter(|side| !solid.has(cell, **side))
        .map(|side| DVec3::from(side.map(|step| f64::from(step.abs()))))
        .sum();
    Outward { normal: flattest(spread, sides.normalize_or(DVec3::Z)), two_sided: true }
}

impl Light {
    fn slot(&self, cell: usize) -> Option<usize> {
        let slot = self.slots[cell] as usize;
        (slot < self.tallies.len()).then_some(slot)
    }

    /// A cloud without extent has one cell, which stands for a body.
    fn is_point(&self) -> bool {
        self.lattice.len() == 1
    }

    /// Points in a boundary cell.
    pub fn points(&self, cell: usize) -> u64 {
        self.slot(cell).map_or(0, |slot| self.tallies[slot].count)
    }

    /// Net direction of the light of a cell; shorter the wider it spreads. With too few rays in the cell, of as few cells around it as
    /// have enough. `None` where there is no light near, zero where light leaves in all directions (a volume).
    pub fn net(&self, cell: usize) -> Option<DVec3> {
        // Cells that were added to the solid later have no slot.
        self.slot(cell).map_or_else(|| self.measured_net(cell), |slot| self.nets[slot])
    }

    fn measured_net(&self, cell: usize) -> Option<DVec3> {
        if self.is_point() {
            return Some(DVec3::ZERO);
        }
        let (mut sum, mut rays) = (DVec3::ZERO, 0.0);
        for reach in 0..=FARTHEST {
            (sum, rays) = self.sum_around(cell, reach);
            // A cell without own light takes after its nearest neighbours only.
            if rays >= TRUSTED || (reach > 0 && self.points(cell) == 0) {
                break;
            }
        }
        let mean = sum / rays;
        // The mean of few directions is long by chance.
        let chance = 3.0 / rays.sqrt();
        (rays > 0.0).then(|| if mean.length() < VOLUME.max(chance.min(0.6)) { DVec3::ZERO } else { mean })
    }

    /// Sum of directions and number of rays within `reach` cells. Bright cells count for no more than they need to be trusted, so that
    /// they do not drown out the sides of a box.
    fn sum_around(&self, cell: usize, reach: i32) -> (DVec3, f64) {
        let (mut sum, mut rays) = (DVec3::ZERO, 0.0);
        for (_, other) in self.lattice.around(self.lattice.place(cell), reach) {
            let Some(tally) = self.slot(other).map(|slot| &self.tallies[slot]).filter(|tally| tally.count > 0) else {
                continue;
            };
            let counted = (tally.count as f64).min(TRUSTED);
            sum += counted * tally.mean(tally.direction);
            rays += counted;
        }
        (sum, rays)
    }

    /// Where the surface runs through a cell, seen against `normal`, mm: for a surface the middle of the points (all lie on it), for a
    /// volume its outermost point. `None` without points, and where the cell faces elsewhere.
    pub fn level_mm(&self, cell: usize, normal: DVec3) -> Option<DVec3> {
        let slot = self.slot(cell).filter(|_| !self.is_point())?;
        let (tally, outward) = (&self.tallies[slot], self.outward[slot]);
        if tally.count == 0 {
            return None;
        }
        let center_mm = self.lattice.center_mm(self.lattice.place(cell));
        if self.net(cell).is_some_and(|net| net != DVec3::ZERO) {
            return Some(center_mm + tally.mean(tally.position) * self.lattice.cell_mm);
        }
        let facing = outward.normal.dot(normal);
        if facing > VOLUME {
            Some(center_mm + outward.normal * tally.reach_mm[1])
        } else if outward.two_sided && facing < -VOLUME {
            Some(center_mm + outward.normal * tally.reach_mm[0])
        } else {
            None
        }
    }
}
