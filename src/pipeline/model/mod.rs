//! 5. What a renderer needs: the radiance of a point and a direction.
//!
//! L = M(x, λ) q(ω; x, λ) / |cos θ| (`pipeline/README.md` 5).

/// The model evaluated.
pub mod evaluation;
/// What the report tells of each channel of the source.
pub mod channel;

use crate::error::Error;
use crate::flux::Surface;
use crate::goniogram::Goniograms;
use crate::hull::Hull;
use crate::source::{Source, Spectral};
use crate::vocabulary::notice::Notice;
use crate::vocabulary::units::Flux;
use crate::vocabulary::watch::StageWatch;
use channel::Origin;

/// A continuous source model.
#[derive(Clone, Debug)]
pub struct Model {
    /// Where it came from.
    pub origins: Vec<Origin>,
    /// Total flux of the rays.
    pub flux: Flux,
    /// Its spectral side.
    pub spectral: Spectral,
    /// The surface.
    pub hull: Hull,
    /// Flux on it.
    pub surface: Surface,
    /// Zones and goniograms.
    pub goniograms: Goniograms,
    /// Everything noticed on the way, in stage order.
    pub notices: Vec<Notice>,
}

impl Model {
    /// Puts the results of the stages together.
    ///
    /// # Errors
    /// [`Error::Cancelled`].
    pub fn new(
        source: &Source,
        hull: Hull,
        surface: Surface,
        goniograms: Goniograms,
        watch: StageWatch<'_>,
    ) -> Result<Model, Error> {
        let stages = [&source.findings, &source.notices, &hull.notices, &surface.notices, &goniograms.notices];
        let notices = stages.into_iter().flat_map(|notices| notices.to_vec()).collect();
        let origins = source.channels.iter().map(Origin::of).collect();
        watch.step(1.0)?;
        Ok(Model { origins, flux: source.flux, spectral: source.spectral.clone(), hull, surface, goniograms, notices })
    }

    /// Luminous flux is known, and there is some: infrared is known to have none.
    pub fn is_visible(&self) -> bool {
        self.flux.luminous_lm.is_some_and(|lumen| lumen > 0.0) && self.goniograms.total.luminous_cd.is_some()
    }

    /// Spectral flux of a vertex, W/nm per band; empty without bands.
    pub fn vertex_spectrum_w_per_nm(&self, vertex: usize) -> Vec<f64> {
        self.spectral.bands_w_per_nm(self.surface.vertices.columns_of(vertex))
    }
}
