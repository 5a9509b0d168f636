//! Where every ray and every watt went.

use super::super::vocabulary::units::Flux;
use serde::Serialize;

/// One fate of rays.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Share {
    /// How many rays.
    pub rays: u64,
    /// Their flux.
    pub flux: Flux,
}

/// Flux in = hit + snapped + rejected, in count and in flux.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Balance {
    /// All rays of the source.
    pub incoming: Share,
    /// Rays whose line meets the hull.
    pub hit: Share,
    /// Rays laid on the nearest triangle, because their line meets none.
    pub snapped: Share,
    /// Rays that are farther from the hull than the tolerance; their flux is not in the model.
    pub rejected: Share,
    /// Sum over triangles.
    pub on_triangles: Flux,
    /// Sum over vertices, before smoothing.
    pub on_vertices: Flux,
    /// Sum over vertices, after smoothing.
    pub after_smoothing: Flux,
}
