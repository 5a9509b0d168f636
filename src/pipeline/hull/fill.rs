//! Completing level grids where points are missing by chance [достроить на основании связи с окружающими вершинами].

use super::lattice::Lattice;
use super::occupancy::Occupancy;
use super::views::View;

/// Of eight neighbours so many must agree for a column to be determined by them.
const AGREEING: usize = 5;
/// Levels that differ by no more cells from the median agree.
const AGREEMENT: f64 = 1.5;
/// Amid neighbours with so many points on average an empty column is dark and not unlucky: e⁻¹² ≈ 6e-6.
const DARK_AMID: f64 = 12.0;
/// However large the size filter is, no more rings than this are added to the rim of a hole.
const MOST_RINGS: usize = 8;

/// Fills columns without a level, and columns seen through a hole in the surface, as far as their surroundings determine them.
/// Holes wider than the size filter stay: there is no light there.
pub fn fill(views: &mut [View], occupancy: &Occupancy, max_edge_mm: f64) {
    for view in views {
        for _ in 0..rings(view, &occupancy.lattice, max_edge_mm) {
            let filled: Vec<Option<usize>> =
                (0..view.levels.len()).map(|column| filled_level(view, occupancy, column)).collect();
            if filled == view.levels {
                break;
            }
            view.levels = filled;
        }
    }
}

/// How many rings close a hole as wide as the size filter.
fn rings(view: &View, lattice: &Lattice, max_edge_mm: f64) -> usize {
    let (u, v) = (lattice.cell_mm[(view.axis + 1) % 3], lattice.cell_mm[(view.axis + 2) % 3]);
    ((0.5 * max_edge_mm / u.max(v)) as usize).clamp(1, MOST_RINGS)
}

/// The level a column has, or should have by its neighbours.
fn filled_level(view: &View, occupancy: &Occupancy, column: usize) -> Option<usize> {
    let own = view.levels[column];
    let mut around = neighbours(view, column);
    if around.len() < AGREEING {
        return own;
    }
    around.sort_unstable();
    let (low, high) = (around[(around.len() - 1) / 2].0, around[around.len() / 2].0);
    let median = 0.5 * (low + high) as f64;
    around.retain(|(level, _)| (*level as f64 - median).abs() <= AGREEMENT);
    // The nearer of two middle levels: the surface stays outside of its points.
    let seen_past = own.is_none_or(|own| around.iter().all(|(level, _)| own as f64 > *level as f64 + AGREEMENT));
    if around.len() < AGREEING || !seen_past {
        return own;
    }
    let points =
        around.iter().map(|(level, at)| f64::from(occupancy.points(occupancy.lattice.index(view.cell(*at, *level)))));
    let mean = points.sum::<f64>() / around.len() as f64;
    if mean < DARK_AMID { Some(low) } else { own }
}

/// Levels of the up to eight columns around one, with the columns.
fn neighbours(view: &View, column: usize) -> Vec<(usize, usize)> {
    let (u, v) = (column % view.size[0], column / view.size[0]);
    let mut levels = Vec::with_capacity(8);
    for other_v in v.saturating_sub(1)..=(v + 1).min(view.size[1] - 1) {
        for other_u in u.saturating_sub(1)..=(u + 1).min(view.size[0] - 1) {
            let other = other_u + view.size[0] * other_v;
            if other != column {
                levels.extend(view.levels[other].map(|level| (level, other)));
            }
        }
    }
    levels
}
