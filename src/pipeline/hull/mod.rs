//! 2. Rays to a surface [Построение геометрии оболочки источника света].
//!
//! The paper's six views look at one regular lattice over the cloud's box, so that neighbouring views meet on common lattice
//! nodes: stitching is exact, and the surface manifold by construction. The modules below are the steps, in order.

/// From rays to emission points.
pub mod cloud;
/// Mirror planes of the light.
pub mod symmetry;
/// Planes and spheres where the light is sharper than where the rays start.
pub mod focal;
/// Mirror images of the places of a symmetric grid.
pub mod images;
/// The rays that do not fit on a focal surface.
mod loose;
/// The hull on a focal surface.
pub(crate) mod sheet;
/// The regular lattice the six views share.
pub(crate) mod lattice;
/// Pass 1: how many emission points lie in each cell; which resolution they carry; strays.
mod occupancy;
/// Six projections and their level grids; the solid they carve.
mod views;
/// Completing level grids where points are missing by chance.
mod fill;
/// Pass 2: where light leaves the cells at the boundary of the solid, and in which direction.
mod emission;
/// Which faces of the solid emit, and which join those that do.
mod stitch;
/// From lattice faces to quads that share vertices.
mod weld;
/// From lattice nodes to the levels of the points.
mod vertices;
/// Groups of things that hang together.
mod disjoint_sets;
/// Vertices, triangles, areas, normals.
pub mod mesh;
/// A surface whose vertices and triangles are given.
mod given;
/// From quads to triangles.
mod triangles;
/// Faces: the hull cut along its creases.
mod creases;
/// What every hull must satisfy.
pub mod check;
/// Clouds with known surfaces.
#[cfg(test)]
mod tests;
/// Symmetric 3 x 3 matrices of second moments: along which direction points spread least.
mod covariance;

use crate::options::HullOptions;
use cloud::Pass;
pub use cloud::{Carrier, Cloud};
pub use mesh::{Hull, Label, Mesh};

use crate::error::Error;
use crate::source::Ray;
use crate::vocabulary::limits::Limits;
use crate::vocabulary::notice::Notices;
use crate::vocabulary::space::Bounds;
use crate::vocabulary::watch::StageWatch;

/// The size filter's default, in diagonals of a lattice cell: no triangle of an ordinary curved surface is as long.
const MAX_EDGE_DIAGONALS: f64 = 4.0;

/// Wraps the cloud in a triangle surface.
///
/// # Errors
/// [`Error::Unusable`] for options out of range; [`Error::Refused`] above [`Limits::max_lattice_cells`]; [`Error::Cancelled`].
pub fn wrap(cloud: &Cloud<'_>, options: &HullOptions, limits: &Limits, watch: StageWatch<'_>) -> Result<Hull, Error> {
    let Some(patch) = cloud.carrier.patch() else {
        let pass = |watch: StageWatch<'_>, visit: &(dyn Fn(&[Ray]) + Sync)| {
            let visit_chunk = |rays: &[Ray]| {
                visit(rays);
                Ok(())
            };
            cloud.fold(watch, (), visit_chunk, |(), ()| ())
        };
        return Ok(creases::cut(wrap_points(&pass, cloud.bounds_mm(), options, limits, watch)?));
    };
    options.validate()?;
    sheet::wrap(cloud, patch, options.resolution, watch, |loose, watch| {
        let bounds_mm = loose.bounds_mm(watch.part(0.0, 0.2))?;
        let pass = |watch: StageWatch<'_>, visit: &(dyn Fn(&[Ray]) + Sync)| loose.pass(watch, visit);
        let options = HullOptions { resolution: None, max_edge_mm: None, ..options.clone() };
        Ok(creases::cut(wrap_points(&pass, bounds_mm, &options, limits, watch.part(0.2, 1.0))?))
    })
}

/// The order of the steps.
fn wrap_points(
    pass: &Pass<'_>,
    bounds_mm: Bounds,
    options: &HullOptions,
    limits: &Limits,
    watch: StageWatch<'_>,
) -> Result<Hull, Error> {
    options.validate()?;
    let mut notices = Notices::default();
    let occupancy = occupancy::settle(pass, bounds_mm, options.resolution, limits, watch.part(0.0, 0.5), &mut notices)?;
    let lattice = occupancy.lattice;
    let max_edge_mm = options.max_edge_mm.unwrap_or(MAX_EDGE_DIAGONALS * lattice.cell_mm.length());

    let mut views = views::six(&occupancy);
    fill::fill(&mut views, &occupancy, max_edge_mm);
    let mut solid = views::carve(lattice, &views);

    let light = emission::gather(pass, &solid, watch.part(0.5, 0.95))?;
    let joined = weld::join(&mut solid, &light);
    watch.step(0.97)?;
    let places = vertices::place(&joined, &light, &lattice);
    watch.step(0.98)?;
    let hull = triangles::build(&joined, &places, &lattice, max_edge_mm, notices);
    if hull.triangles.is_empty() {
        return Err(Error::refused(
            "hull.empty",
            format!("The size filter of {max_edge_mm} mm leaves no triangle of the surface."),
            "Choose a larger hull.max_edge_mm, or leave it out.",
        ));
    }
    watch.step(1.0)?;
    Ok(hull)
}
