//! Pass 1: how many emission points lie in each cell; which resolution they carry; which of them are strays.

use super::cloud::Pass;
use super::lattice::Lattice;
use crate::error::Error;
use crate::vocabulary::limits::Limits;
use crate::vocabulary::notice::Notices;
use crate::vocabulary::space::Bounds;
use crate::vocabulary::watch::StageWatch;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Mutex, PoisonError};

/// Resolutions that are chosen from, finest first.
const LADDER: [u32; 7] = [96, 48, 32, 24, 16, 12, 8];
/// Emission points the median occupied cell must hold, so that an empty cell means darkness: e⁻¹⁶ ≈ 1e-7.
const POINTS_PER_CELL: u32 = 16;
/// A cell is a stray's when it holds less than one in so many of the points of an ordinary cell.
const STRAY_RATIO: u64 = 8;
/// Strays are at most one in so many rays together; what is more frequent is light.
const STRAYS_ONE_IN: u64 = 1000;
/// How often the lattice is fitted anew to what remains without strays.
const REFITS: usize = 3;
/// Progress at the start of each fitting's pass, and at the end of the last.
const PROGRESS: [f64; REFITS + 2] = [0.0, 0.8, 0.88, 0.94, 1.0];

/// Emission points per cell of a lattice.
pub struct Occupancy {
    /// The cells.
    pub lattice: Lattice,
    /// Points in each.
    pub counts: Vec<u32>,
    /// Box of the points within the lattice, mm.
    extent_mm: Bounds,
    /// Points outside the lattice: strays of an earlier fitting.
    outside: u64,
}

/// Counts the points on the lattice that suits them: at `resolution`, or at the finest that they carry; strays left out.
pub fn settle(
    pass: &Pass<'_>,
    bounds_mm: Bounds,
    resolution: Option<u32>,
    limits: &Limits,
    watch: StageWatch<'_>,
    notices: &mut Notices,
) -> Result<Occupancy, Error> {
    if bounds_mm.size().max_element() == 0.0 {
        notices.add("hull.point_cloud", "All rays start in one point; a cube of 0.001 mm stands for it.");
    }
    let (mut bounds_mm, mut fitting) = (bounds_mm, 0);
    loop {
        let watch = watch.part(PROGRESS[fitting], PROGRESS[fitting + 1]);
        let counted = count(pass, start(bounds_mm, resolution, limits)?, watch)?;
        let mut occupancy = if resolution.is_some() { counted } else { counted.coarsened_to_its_points() };
        let strays = occupancy.drop_strays() + occupancy.outside;
        let rest_mm = occupancy.occupied_mm();
        // The first box is the points' own. A later one is that of some cells, and is fitted once more to the points in them.
        let enough = if fitting == 0 { 0.5 } else { 0.999 };
        if fitting == REFITS || rest_mm.size().cmpge(enough * bounds_mm.size()).all() {
            if strays > 0 {
                let sentence = "Rays start far from all others; they make no surface of their own.";
                notices.count("hull.stray_points", strays, None, sentence);
            }
            return Ok(occupancy);
        }
        (bounds_mm, fitting) = (rest_mm, fitting + 1);
    }
}

/// The lattice to count on: as asked for, or the finest of the ladder that the limit allows.
fn start(bounds_mm: Bounds, resolution: Option<u32>, limits: &Limits) -> Result<Lattice, Error> {
    let candidates = match resolution {
        Some(resolution) => vec![Lattice::fit(bounds_mm, resolution)],
        None => LADDER.iter().map(|resolution| Lattice::fit_divisible(bounds_mm, *resolution)).collect(),
    };
    let least = candidates.iter().map(Lattice::len).min().unwrap_or(0);
    candidates.into_iter().find(|lattice| lattice.len() <= limits.max_lattice_cells).ok_or_else(|| {
        Error::refused(
            "hull.too_fine",
            format!("The hull's lattice would have {least} cells; the limit is {}.", limits.max_lattice_cells),
            "Choose a lower hull.resolution.",
        )
    })
}

/// Pass 1. Atomic sums commute, so neither order nor threads show.
fn count(pass: &Pass<'_>, lattice: Lattice, watch: StageWatch<'_>) -> Result<Occupancy, Error> {
    let counts: Vec<AtomicU32> = (0..lattice.len()).map(|_| AtomicU32::new(0)).collect();
    let rest = Mutex::new((Bounds::EMPTY, 0));
    pass(watch, &|rays| {
        let (mut extent_mm, mut outside, mut run) = (Bounds::EMPTY, 0, (0, 0));
        for ray in rays {
            let Some(cell) = lattice.cell_of(ray.origin_mm) else {
                outside += 1;
                continue;
            };
            extent_mm.grow(ray.origin_mm);
            // Runs in one cell are added at once: threads do not fight over the single cell of a point source.
            if cell != run.0 {
                counts[run.0].fetch_add(run.1, Ordering::Relaxed);
                run = (cell, 0);
            }
            run.1 += 1;
        }
        counts[run.0].fetch_add(run.1, Ordering::Relaxed);
        let mut rest = rest.lock().unwrap_or_else(PoisonError::into_inner);
        *rest = (rest.0.union(extent_mm), rest.1 + outside);
    })?;
    let (extent_mm, outside) = rest.into_inner().unwrap_or_else(PoisonError::into_inner);
    let counts = counts.into_iter().map(AtomicU32::into_inner).collect();
    Ok(Occupancy { lattice, counts, extent_mm, outside })
}

impl Occupancy {
    /// Points in the cell of `index`.
    pub fn points(&self, index: usize) -> u32 {
        self.counts[index]
    }

    /// On the finest lattice of the ladder on which the median occupied cell holds enough points, or on the coarsest.
    fn coarsened_to_its_points(self) -> Occupancy {
        let finest = self.lattice.resolution();
        let mut best = None;
        for resolution in LADDER.into_iter().filter(|resolution| *resolution <= finest) {
            let coarse = self.coarsened(self.lattice.factors(resolution));
            let enough = coarse.median() >= POINTS_PER_CELL;
            best = Some(coarse);
            if enough {
                break;
            }
        }
        best.unwrap_or(self)
    }

    /// The same points on the lattice whose cells are `factors` cells of this one.
    fn coarsened(&self, factors: [usize; 3]) -> Occupancy {
        let lattice = self.lattice.coarsened(factors);
        let mut counts = vec![0; lattice.len()];
        for (index, count) in self.counts.iter().enumerate().filter(|(_, count)| **count > 0) {
            let cell = self.lattice.place(index);
            counts[lattice.index([0, 1, 2].map(|axis| cell[axis] / factors[axis]))] += count;
        }
        Occupancy { lattice, counts, ..*self }
    }

    /// Counts of the occupied cells, ascending.
    fn sorted(&self) -> Vec<u32> {
        let mut counts: Vec<u32> = self.counts.iter().copied().filter(|count| *count > 0).collect();
        counts.sort_unstable();
        counts
    }

    /// Points in the median occupied cell.
    fn median(&self) -> u32 {
        let counts = self.sorted();
        counts.get(counts.len() / 2).copied().unwrap_or(0)
    }

    /// Points in the cell of the median point: what an ordinary cell holds, however many strays there are.
    fn median_of_points(&self) -> u64 {
        let counts = self.sorted();
        let all: u64 = counts.iter().map(|count| u64::from(*count)).sum();
        let mut seen = 0;
        let median = counts.into_iter().find(|count| {
            seen += u64::from(*count);
            2 * seen >= all
        });
        u64::from(median.unwrap_or(0))
    }

    /// Empties the cells of strays: alone, nearly empty, and few. Answers how many points they held.
    fn drop_strays(&mut self) -> u64 {
        let ordinary = self.median_of_points();
        let stray = |index: &usize| {
            let count = u64::from(self.counts[*index]);
            count > 0
                && count * STRAY_RATIO < ordinary
                && self
                    .lattice
                    .around(self.lattice.place(*index), 1)
                    .all(|(_, other)| other == *index || self.counts[other] == 0)
        };
        let cells: Vec<usize> = (0..self.counts.len()).filter(stray).collect();
        let strays: u64 = cells.iter().map(|cell| u64::from(self.counts[*cell])).sum();
        let all = self.outside + self.counts.iter().map(|count| u64::from(*count)).sum::<u64>();
        if (strays + self.outside) * STRAYS_ONE_IN > all {
            return 0;
        }
        for cell in cells {
            self.counts[cell] = 0;
        }
        strays
    }

    /// Box of the occupied cells as far as points lie in it, mm.
    fn occupied_mm(&self) -> Bounds {
        let (mut first, mut last) = (self.lattice.counts, [0; 3]);
        for index in (0..self.counts.len()).filter(|index| self.counts[*index] > 0) {
            let cell = self.lattice.place(index);
            first = [0, 1, 2].map(|axis| first[axis].min(cell[axis]));
            last = [0, 1, 2].map(|axis| last[axis].max(cell[axis]));
        }
        let cells_mm = self.lattice.bounds_mm(first, last);
        Bounds { min: cells_mm.min.max(self.extent_mm.min), max: cells_mm.max.min(self.extent_mm.max) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::source::Ray;
    use crate::vocabulary::watch::{NoProgress, Stage};
    use glam::DVec3;

    #[test]
    fn adding_up_fine_cells_is_counting_on_coarse_ones() {
        let golden = 0.5 * (5.0_f64.sqrt() - 1.0);
        let rays: Vec<Ray> = (0..5000)
            .map(|k| f64::from(k) * golden)
            .map(|t| Ray {
                origin_mm: DVec3::new(3.0 * t.fract(), 1.3 * (7.0 * t).fract(), 0.4 * (31.0 * t).fract()),
                direction: DVec3::Z,
                radiant_w: 1.0,
                luminous_lm: 0.0,
                column: 0,
                xz_lm: [0.0; 2],
            })
            .collect();
        let bounds_mm = Bounds::of(rays.iter().map(|ray| ray.origin_mm));
        let count_on = |lattice| {
            let pass = |_: StageWatch<'_>, visit: &(dyn Fn(&[Ray]) + Sync)| {
                rays.chunks(77).for_each(visit);
                Ok(())
            };
            count(&pass, lattice, StageWatch::enter(&NoProgress, Stage::Hull).unwrap()).unwrap()
        };
        let fine = count_on(Lattice::fit_divisible(bounds_mm, 96));
        assert_eq!(fine.counts.iter().sum::<u32>(), 5000);
        for resolution in LADDER {
            let coarse = fine.coarsened(fine.lattice.factors(resolution));
            assert_eq!(coarse.lattice.resolution(), resolution);
            assert_eq!(coarse.counts, count_on(coarse.lattice).counts, "at {resolution}");
        }
    }
}
