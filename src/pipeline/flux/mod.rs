//! 3. Rays onto the surface [Расчет поверхностного распределения светового потока].

/// The spatial index over the hull: the only file that names the BVH library.
pub mod bvh;
/// One ray: hit, snapped or rejected, counted exactly once.
pub mod project;
/// Sums per site that do not depend on the number of threads.
pub mod tally;
/// Shepard smoothing that conserves.
pub mod smooth;
/// Flux in equals flux on the surface plus rejected.
pub mod balance;

pub use balance::Balance;
pub use tally::Amounts;

use super::Error;
use super::hull::{Cloud, Hull};
use super::vocabulary::notice::Notices;
use super::vocabulary::watch::StageWatch;
use serde::Serialize;

/// How rays are laid on the surface.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Options {
    /// Shepard smoothing of the exitance.
    pub smoothing: bool,
}

impl Default for Options {
    fn default() -> Options {
        Options { smoothing: true }
    }
}

/// Flux on the surface.
#[derive(Clone, Debug)]
pub struct Surface {
    /// F_t: flux per triangle as counted [(1)]; sites are triangles, no columns.
    pub triangles: Amounts,
    /// ρ_l: flux per vertex, with its spectral columns [(2)], smoothed where asked; sites are vertices.
    pub vertices: Amounts,
    /// Where every ray and every watt went.
    pub balance: Balance,
    /// What happened on the way.
    pub notices: Notices,
}

/// Lays every ray on the hull.
///
/// # Errors
/// [`Error::Cancelled`], [`Error::Unreadable`].
pub fn project(cloud: &Cloud<'_>, hull: &Hull, options: &Options, watch: StageWatch<'_>) -> Result<Surface, Error> {
    let _ = (cloud, hull, options, watch);
    todo!()
}
