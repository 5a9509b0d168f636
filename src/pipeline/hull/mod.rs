//! 2. Rays to a surface [Построение геометрии оболочки источника света].

/// From rays to emission points.
pub mod cloud;
/// Vertices, triangles, areas, normals.
pub mod mesh;
/// What every hull must satisfy.
pub mod check;

pub use cloud::{Cloud, Emission};
pub use mesh::{Hull, Label};

use super::Error;
use super::vocabulary::limits::Limits;
use super::vocabulary::watch::StageWatch;
use serde::Serialize;

/// How emission points become a surface.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Options {
    /// Where light is taken to start.
    pub emission: Emission,
    /// Cells along the longest edge of the cloud's box, 4..=256. Default: from the number of rays per occupied cell.
    pub resolution: Option<u32>,
    /// The size filter [мера фильтрации]: longest edge of a stitched or filled triangle, mm. Default: from the cell size.
    pub max_edge_mm: Option<f64>,
}

/// Wraps the cloud in a triangle surface.
///
/// # Errors
/// [`Error::Unusable`] for options out of range; [`Error::Refused`] above [`Limits::max_lattice_cells`]; [`Error::Cancelled`].
pub fn wrap(cloud: &Cloud<'_>, options: &Options, limits: &Limits, watch: StageWatch<'_>) -> Result<Hull, Error> {
    let _ = (cloud, options, limits, watch);
    todo!()
}
