//! Light from a volume: a flame, a discharge or a phosphor that can be seen through. The paper's hull bounds such a volume, but the
//! light of a point inside leaves through the whole hull, so place and direction hang together there; inside they do not.
//!
//! L = q(ω) ∫ j(x, λ) ds along the line (`pipeline/README.md` 5), j linear between the nodes of a lattice.

/// Cells where rays start, and the nodes at their corners.
pub mod lattice;

use crate::error::Error;
use crate::flux::Amounts;
use crate::flux::exitance;
use crate::flux::tally::{self, Deposit, Kept, Quanta, Tally};
use crate::hull::Cloud;
use crate::options::FluxOptions;
use crate::smoothing::{Levels, PLACES, Sharing};
use crate::source::Ray;
use crate::vocabulary::limits::Limits;
use crate::vocabulary::units::Flux;
use crate::vocabulary::watch::StageWatch;
use lattice::VolumeLattice;

/// Flux in a volume.
#[derive(Clone, Debug, PartialEq)]
pub struct Volume {
    /// Where the nodes are.
    pub lattice: VolumeLattice,
    /// Flux and spectral columns of each node, smoothed where asked.
    pub nodes: Amounts,
    /// The volume that each node stands for: an eighth of its lit cells, mm³. The emission coefficient integrated over all
    /// directions is the node's flux divided by this.
    pub volumes_mm3: Vec<f64>,
}

/// A lattice, and what is counted at its nodes while the rays are laid on the hull.
pub struct Plan {
    lattice: VolumeLattice,
    tally: Tally,
}

/// Finds the cells in which rays of `cloud` start; a `sample` of them shows how much of their box is filled.
///
/// # Errors
/// [`Error::Refused`] above [`Limits::max_tally_values`]; as [`Cloud::fold`].
pub fn plan(cloud: &Cloud<'_>, sample: &[Ray], limits: &Limits, watch: StageWatch<'_>) -> Result<Plan, Error> {
    let lattice = VolumeLattice::of(cloud, sample, watch)?;
    let tally = Tally::new(&Quanta::of(cloud), lattice.node_count, Kept::All, limits)?;
    Ok(Plan { lattice, tally })
}

/// What one thread adds to a [`Plan`].
pub struct Adding<'a> {
    lattice: &'a VolumeLattice,
    nodes: tally::Adding<'a>,
}

impl Adding<'_> {
    /// Shares a ray among the corners of the cell it starts in.
    pub fn add(&mut self, ray: &Ray, deposit: &Deposit) {
        let (cell, at) = self.lattice.place(ray.origin_mm);
        let parts = deposit.split(lattice::shares(at));
        self.lattice.corners(cell).into_iter().zip(parts).for_each(|(node, part)| self.nodes.add(node as usize, &part));
    }
}

impl Plan {
    /// Begins to add on this thread.
    pub fn adding(&self) -> Adding<'_> {
        Adding { lattice: &self.lattice, nodes: self.tally.adding() }
    }

    /// The volume of what was counted. `ray`: what a typical ray carries.
    ///
    /// # Errors
    /// [`Error::Cancelled`].
    pub fn measure(
        self,
        cloud: &Cloud<'_>,
        ray: &Flux,
        options: &FluxOptions,
        watch: StageWatch<'_>,
    ) -> Result<Volume, Error> {
        let Plan { lattice, tally } = self;
        let (mut nodes, volumes_mm3) = (tally.amounts(), lattice.volumes_mm3());
        if options.smooths() {
            let (points_mm, edges) = (lattice.points_mm(), lattice.edges());
            let spacing_mm = lattice.pitch_mm.element_product().cbrt();
            let kinds = vec![0; points_mm.len()];
            let levels = Levels::new(&points_mm, &kinds, &edges, spacing_mm, Sharing::EightCorners, PLACES);
            exitance::smooth_amounts(&levels, &volumes_mm3, &mut nodes, ray, cloud.spectral(), watch)?;
        }
        watch.step(1.0)?;
        Ok(Volume { lattice, nodes, volumes_mm3 })
    }
}
