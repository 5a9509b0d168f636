//! 4. Flux to angles [Расчет углового распределения яркости].

/// The grid of directions: the one owner of the binning rule.
pub mod sphere;
/// The zone lattice and which point belongs where.
pub mod zone;
/// Directions to intensities.
pub mod intensity;

pub use intensity::Goniogram;
pub use sphere::SphereGrid;
pub use zone::{Lattice, Zone};

use super::Error;
use super::flux::Surface;
use super::hull::{Cloud, Hull};
use super::vocabulary::notice::Notices;
use super::vocabulary::space::{Axis, Frame};
use super::vocabulary::watch::StageWatch;
use serde::Serialize;

/// How zones and their goniograms are made.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Options {
    /// Zones along C0 and across it, 1..=32 each. Default: at most 16 zones, from the rays' density.
    pub zones: Option<(u32, u32)>,
    /// The source axis at γ = 0. Default: the axis nearest the direction of maximum intensity.
    pub nadir: Option<Axis>,
    /// The source axis at C0. Default: the next axis in cyclic order.
    pub c0: Option<Axis>,
    /// Step of γ, degrees; divides 180, 0.5..=30. Default: from the beam's width.
    pub gamma_step_deg: Option<f64>,
    /// Step of C, degrees; divides 360, 1..=90. Default 10.
    pub c_step_deg: Option<f64>,
    /// Smoothing on the grid.
    pub smoothing: bool,
}

impl Default for Options {
    fn default() -> Options {
        Options { zones: None, nadir: None, c0: None, gamma_step_deg: None, c_step_deg: None, smoothing: true }
    }
}

/// Zones and their goniograms.
#[derive(Clone, Debug)]
pub struct Goniograms {
    /// The photometric frame.
    pub frame: Frame,
    /// The zone lattice.
    pub lattice: Lattice,
    /// Grid of the luminous and radiant intensities.
    pub grid: SphereGrid,
    /// Coarser grid of the spectral intensities.
    pub spectral_grid: SphereGrid,
    /// Zones that hold light, ids 0.. in row-major lattice order; a zone's id is its index.
    pub zones: Vec<Zone>,
    /// Zone id of each vertex of the hull (hard zones: one zone, weight 1).
    pub zone_of_vertex: Vec<u32>,
    /// The whole source.
    pub total: Goniogram,
    /// What happened on the way.
    pub notices: Notices,
}

/// Makes the zones and measures a goniogram for each, and one for the whole source.
///
/// # Errors
/// [`Error::Unusable`] for options out of range; [`Error::Cancelled`]; [`Error::Unreadable`].
pub fn measure(
    cloud: &Cloud<'_>,
    hull: &Hull,
    surface: &Surface,
    options: &Options,
    watch: StageWatch<'_>,
) -> Result<Goniograms, Error> {
    let _ = (cloud, hull, surface, options, watch);
    todo!()
}
