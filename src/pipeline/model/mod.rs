//! 5. What a renderer needs: the radiance of a point and a direction.
//!
//! L = M(x, λ) q(ω; x, λ) / |cos θ| (`pipeline/README.md` 5).

/// What radiance and new rays need of a model.
pub mod light;
/// The model evaluated.
pub mod evaluation;
/// The numbers of a ray, which a seed and its own number give.
pub mod chance;
/// Numbers that fill their space more evenly than chance.
pub mod low_discrepancy;
/// A curve through space that does not leap.
mod curve;
/// Where new rays start.
mod places;
/// Where new rays go.
mod directions;
/// New rays from the model.
pub mod sampling;
/// Wavelengths of new rays.
pub mod wavelengths;
/// How the surface was chosen, and how good the model is.
pub mod study;
/// What the report tells of each channel of the source.
pub mod channel;
/// A model that another was made of.
pub mod ancestor;

use crate::error::Error;
use crate::flux::tally::Deposit;
use crate::flux::{self, Laid, Surface};
use crate::goniogram::{self, Goniograms};
use crate::hull::{self, Carrier, Cloud, Hull};
use crate::options::{Options, ZoneLayout};
use crate::source::{Ray, Spectral};
use crate::vocabulary::limits::Limits;
use crate::vocabulary::notice::Notice;
use crate::vocabulary::units::Flux;
use crate::vocabulary::watch::{Stage, StageWatch};
use crate::volume::{self, Volume};
use ancestor::Ancestor;
use channel::Origin;
use study::Study;

/// A continuous source model.
#[derive(Clone, Debug)]
pub struct Model {
    /// Where it came from.
    pub origins: Vec<Origin>,
    /// The models that it was made of, one for each of `origins`; none where these are ray files.
    pub ancestors: Vec<Ancestor>,
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
    /// The same light in the volume that it comes from, where that is better than its surface: then this is the model.
    pub volume: Option<Volume>,
    /// How its surface was chosen, and how good it is; `None` where that was not looked into.
    pub study: Option<Study>,
    /// Everything noticed on the way, in stage order.
    pub notices: Vec<Notice>,
}

impl Model {
    /// Makes the model of `cloud`: hull, flux and goniograms, each with its own watch. Zones are laid out by the rays of `pilot`, a sample
    /// of the same rays, so that every ray is laid on the hull once; without it, by all rays.
    ///
    /// # Errors
    /// Those of the stages.
    pub fn build<'w>(
        cloud: &Cloud<'_>,
        pilot: Option<&Cloud<'_>>,
        options: &Options,
        limits: &Limits,
        watch: impl Fn(Stage) -> Result<StageWatch<'w>, Error>,
    ) -> Result<Model, Error> {
        let hull = hull::wrap(cloud, &options.hull, limits, watch(Stage::Hull)?)?;
        let flux_stage = watch(Stage::Flux)?;
        let sample = pilot.unwrap_or(cloud).sampled_rays();
        let in_volume = (cloud.carrier == Carrier::Volume)
            .then(|| volume::plan(cloud, sample, limits, flux_stage.part(0.0, 0.1)))
            .transpose()?;
        let pilot = pilot.filter(|_| options.goniogram.zoning() == ZoneLayout::Auto).unwrap_or(cloud);
        let sketch = flux::project(pilot, &hull, &options.flux, limits, flux_stage.part(0.1, 0.3), || {
            |_: &Ray, _: Option<Laid<'_>>, _: &Deposit| ()
        })?;
        let rays = cloud.ray_count() as f64 / pilot.ray_count().max(1) as f64;
        let plan = goniogram::plan(cloud, &hull, &sketch.of_more_rays(rays), sample, &options.goniogram, limits)?;
        let begin = || {
            let (mut zones, mut nodes) = (plan.adding(&hull), in_volume.as_ref().map(volume::Plan::adding));
            move |ray: &Ray, laid: Option<Laid<'_>>, deposit: &Deposit| {
                if let Some(laid) = laid {
                    zones.add(ray, &laid, deposit);
                }
                if let Some(nodes) = &mut nodes {
                    nodes.add(ray, deposit);
                }
            }
        };
        let surface = flux::project(cloud, &hull, &options.flux, limits, flux_stage.part(0.3, 0.95), begin)?;
        let volume = in_volume
            .map(|plan| plan.measure(cloud, &surface.ray, &options.flux, flux_stage.part(0.95, 1.0)))
            .transpose()?;
        let goniograms = plan.measure(cloud, &hull, &surface, &options.goniogram, watch(Stage::Goniogram)?)?;
        let source = cloud.source;
        let stages = [&source.findings, &source.notices, &hull.notices, &surface.notices, &goniograms.notices];
        let notices = stages.into_iter().flat_map(|notices| notices.to_vec()).collect();
        let origins = source.channels.iter().map(Origin::of).collect();
        watch(Stage::Model)?.step(1.0)?;
        Ok(Model {
            origins,
            ancestors: Vec::new(),
            flux: cloud.flux(),
            spectral: cloud.spectral().clone(),
            hull,
            surface,
            goniograms,
            volume,
            study: None,
            notices,
        })
    }

    /// The model with what was found when its surface was chosen; a model that is worse than its rays says so.
    #[must_use]
    pub fn with_study(self, study: Option<Study>) -> Model {
        let notices = study.iter().flat_map(|study| study.notices().to_vec());
        let notices = self.notices.into_iter().chain(notices).collect();
        Model { study, notices, ..self }
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
