//! The hull of a cloud on a focal surface: its grid, and beside it the hull of the rays that do not fit.

use super::cloud::Cloud;
use super::focal::{FocalGrid, FocalPatch};
use super::mesh::{Hull, Label};
use crate::error::Error;
use crate::source::Ray;
use crate::vocabulary::notice::Notices;
use crate::vocabulary::watch::StageWatch;

/// Rays to a cell of the grid, and fewest and most cells along its longest side, unless asked otherwise.
const RAYS_PER_CELL: f64 = 60.0;
const FEWEST_CELLS: f64 = 16.0;
const MOST_CELLS: f64 = 64.0;

/// What the first pass finds: rays per cell, and the box of those that do not fit.
struct Found {
    rays: Vec<u32>,
    loose: u64,
}

/// The hull of a cloud on a focal patch: the grid, and after it the hull that `wrap_loose` makes of the origins of the rays that do not fit,
/// where there are any.
pub fn wrap(
    cloud: &Cloud<'_>,
    patch: FocalPatch,
    resolution: Option<u32>,
    watch: StageWatch<'_>,
    wrap_loose: impl FnOnce(StageWatch<'_>) -> Result<Hull, Error>,
) -> Result<Hull, Error> {
    let extent_mm = patch.max_mm - patch.min_mm;
    let cell_mm = (patch.lit_mm2 * RAYS_PER_CELL / cloud.ray_count().max(1) as f64).sqrt();
    let by_rays = (extent_mm.max_element() / cell_mm).clamp(FEWEST_CELLS, MOST_CELLS);
    let longest = resolution.map_or(by_rays, f64::from);
    let along = |mm: f64| (longest * mm / extent_mm.max_element()).ceil().clamp(1.0, longest.ceil()) as usize;
    let cells = [along(extent_mm.x), along(extent_mm.y)];
    let count = |rays: &[Ray]| {
        let mut found = Found { rays: vec![0; cells[0] * cells[1]], loose: 0 };
        for ray in rays {
            match patch.meet(ray) {
                Some(crossing) => found.rays[FocalGrid::place(&patch, cells, crossing.at_mm).0] += 1,
                None => found.loose += 1,
            }
        }
        Ok(found)
    };
    let start = Found { rays: vec![0; cells[0] * cells[1]], loose: 0 };
    let found = cloud.without_images().fold(watch.part(0.0, 0.4), start, count, |all, part| {
        all.rays.iter_mut().zip(part.rays).for_each(|(sum, rays)| *sum = sum.saturating_add(rays));
        all.loose += part.loose;
    })?;
    let lit = patch.symmetry.spread(cells, found.rays.iter().map(|rays| *rays > 0).collect());
    let (mut grid, vertices_mm, triangles) = FocalGrid::new(patch, cells, &lit);
    let cell_mm = FocalGrid::size_mm(&patch, cells);
    let sheet = Hull {
        labels: vec![Label::Projected; triangles.len()],
        part_of_vertex: vec![0; vertices_mm.len()],
        face_of_vertex: vec![0; vertices_mm.len()],
        place_of_vertex: (0..vertices_mm.len() as u32).collect(),
        vertices_mm,
        triangles,
        cell_mm: (patch.surface.axes * cell_mm.extend(0.0)).abs(),
        resolution: cells[0].max(cells[1]) as u32,
        max_edge_mm: cell_mm.length(),
        focal: None,
        notices: Notices::default(),
    };
    if found.loose == 0 {
        watch.step(1.0)?;
        return Ok(Hull { focal: Some(grid), ..sheet });
    }
    let loose = wrap_loose(watch.part(0.4, 1.0))?;
    grid.loose_cell_mm = loose.cell_mm;
    let mut hull = if sheet.triangles.is_empty() { loose } else { joined(sheet, &loose) };
    hull.focal = Some(grid);
    Ok(hull)
}

/// Two surfaces as one that does not hang together.
fn joined(mut first: Hull, second: &Hull) -> Hull {
    let after = |numbers: &[u32]| numbers.iter().max().map_or(0, |last| last + 1);
    let vertices = first.vertices_mm.len() as u32;
    let [parts, faces, places] =
        [&first.part_of_vertex, &first.face_of_vertex, &first.place_of_vertex].map(|numbers| after(numbers));
    first.vertices_mm.extend(&second.vertices_mm);
    first.triangles.extend(second.triangles.iter().map(|corners| corners.map(|corner| vertices + corner)));
    first.labels.extend(&second.labels);
    first.part_of_vertex.extend(second.part_of_vertex.iter().map(|part| parts + part));
    first.face_of_vertex.extend(second.face_of_vertex.iter().map(|face| faces + face));
    first.place_of_vertex.extend(second.place_of_vertex.iter().map(|place| places + place));
    first.notices.merge(&second.notices);
    first
}
