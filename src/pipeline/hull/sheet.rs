//! The hull of a cloud on a focal surface: its grid, and beside it the hull of the rays that do not fit.

use super::cloud::Cloud;
use super::disjoint_sets::Groups;
use super::focal::{Crossing, FocalGrid, FocalPatch};
use super::loose::{Loose, MOST_KEPT};
use super::mesh::{Hull, Label};
use super::symmetry::Symmetry;
use crate::error::Error;
use crate::vocabulary::notice::Notices;
use crate::vocabulary::watch::StageWatch;
use glam::DVec3;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};

/// Rays to a cell of the grid, and fewest and most cells along its longest side, unless asked otherwise: the second number where most of the light
/// comes from less than a 16th of the grid, the first where it comes from more than a quarter.
const RAYS_PER_CELL: f64 = 60.0;
const FEWEST_CELLS: f64 = 16.0;
const MOST_CELLS: [f64; 2] = [64.0, 128.0];
const MOSTLY_LIT: f64 = 0.25;
/// A cell is at least this part of its length thick.
const THINNEST: f64 = 1e-3;

/// The hull of a cloud on a focal patch: the grid, and after it the hull that `wrap_loose` makes of the origins of the rays that do not fit,
/// where there are any.
pub fn wrap(
    cloud: &Cloud<'_>,
    patch: FocalPatch,
    resolution: Option<u32>,
    watch: StageWatch<'_>,
    wrap_loose: impl FnOnce(&Loose<'_>, StageWatch<'_>) -> Result<Hull, Error>,
) -> Result<Hull, Error> {
    let extent_mm = patch.max_mm - patch.min_mm;
    let cell_mm = (patch.lit_mm2 * RAYS_PER_CELL / cloud.ray_count().max(1) as f64).sqrt();
    let lit = patch.lit_mm2 / extent_mm.element_product();
    let most = (MOST_CELLS[0] * (MOSTLY_LIT / lit).sqrt()).clamp(MOST_CELLS[0], MOST_CELLS[1]);
    let by_rays = (extent_mm.max_element() / cell_mm).clamp(FEWEST_CELLS, most);
    let longest = resolution.map_or(by_rays, f64::from);
    // A symmetric grid has no middle column, which would be on neither side.
    let sides = if patch.symmetry == Symmetry::None { 1 } else { 2 };
    let along = |mm: f64| {
        let cells = (longest * mm / extent_mm.max_element()).ceil().clamp(1.0, longest.ceil());
        (cells as usize).next_multiple_of(sides)
    };
    let cells = [along(extent_mm.x), along(extent_mm.y)];
    let lit: Vec<AtomicBool> = (0..cells[0] * cells[1]).map(|_| AtomicBool::new(false)).collect();
    let light_up = |crossing: &Crossing| {
        let lit = &lit[FocalGrid::place(&patch, cells, crossing.at_mm).0];
        if !lit.load(Ordering::Relaxed) {
            lit.store(true, Ordering::Relaxed);
        }
    };
    let loose = Loose::of(cloud, patch, MOST_KEPT, watch.part(0.0, 0.4), light_up)?;
    let lit = patch.symmetry.spread(cells, lit.into_iter().map(AtomicBool::into_inner).collect());
    let sheet = of_grid(patch, cells, &lit);
    if loose.is_empty() {
        watch.step(1.0)?;
        return Ok(sheet);
    }
    let loose = wrap_loose(&loose, watch.part(0.4, 1.0))?;
    let mut grid = sheet.focal.clone();
    grid.iter_mut().for_each(|grid| grid.loose_cell_mm = loose.cell_mm);
    let hull = if sheet.triangles.is_empty() { loose } else { joined(sheet, &loose) };
    Ok(Hull { focal: grid, ..hull })
}

/// The grid of `cells` over `patch` alone, where it is `lit`, `[y][x]`.
pub fn of_grid(patch: FocalPatch, cells: [usize; 2], lit: &[bool]) -> Hull {
    let (grid, vertices_mm, triangles) = FocalGrid::new(patch, cells, lit);
    let cell_mm = FocalGrid::size_mm(&patch, cells);
    let [x, y] = [patch.surface.axes.x_axis, patch.surface.axes.y_axis];
    Hull {
        labels: vec![Label::Projected; triangles.len()],
        part_of_vertex: parts(vertices_mm.len(), &triangles),
        face_of_vertex: vec![0; vertices_mm.len()],
        place_of_vertex: (0..vertices_mm.len() as u32).collect(),
        vertices_mm,
        triangles,
        cell_mm: (x.abs() * cell_mm.x + y.abs() * cell_mm.y).max(DVec3::splat(THINNEST * cell_mm.length())),
        resolution: cells[0].max(cells[1]) as u32,
        max_edge_mm: cell_mm.length(),
        focal: Some(grid),
        notices: Notices::default(),
    }
}

/// The connected part of each vertex, numbered in the order of the smallest vertex.
fn parts(vertices: usize, triangles: &[[u32; 3]]) -> Vec<u32> {
    let mut groups = Groups::new(vertices);
    for [a, b, c] in triangles {
        groups.join(*a, *b);
        groups.join(*b, *c);
    }
    let mut numbers = BTreeMap::new();
    let mut number = |vertex: u32| {
        let next = numbers.len() as u32;
        *numbers.entry(groups.of(vertex)).or_insert(next)
    };
    (0..vertices as u32).map(&mut number).collect()
}

/// Two surfaces as one that does not hang together; what was noticed of the second concerns a few rays, and is not told.
fn joined(mut first: Hull, second: &Hull) -> Hull {
    let after = |numbers: &[u32]| numbers.iter().max().map_or(0, |last| last + 1);
    let vertices = first.vertices_mm.len() as u32;
    let [parts, faces, places] =
        [&first.part_of_vertex, &first.face_of_vertex, &first.place_of_vertex].map(|numbers| after(numbers));
    first.vertices_mm.extend(&second.vertices_mm);
    first.triangles.extend(second.triangles.iter().map(|corners| corners.map(|corner| vertices + corner)));
    first.labels.extend(&second.labels);
    first.part_of_vertex.extend(second.part_of_vertex.iter().map(|part| parts + part));
    // A few rays here and there: no faces of their own.
    first.face_of_vertex.extend(second.face_of_vertex.iter().map(|_| faces));
    first.place_of_vertex.extend(second.place_of_vertex.iter().map(|place| places + place));
    first
}
