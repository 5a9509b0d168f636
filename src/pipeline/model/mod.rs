//! 5. What a renderer needs: the radiance of a point and a direction.
//!
//! L = M(x, λ) q(ω; x, λ) / cos θ (`MODEL.md` 7).

/// The model evaluated.
pub mod radiance;

use super::Error;
use super::flux::Surface;
use super::goniogram::Goniograms;
use super::hull::Hull;
use super::rays::source::{Channel, Spectral};
use super::rays::{Declared, Source, Total};
use super::vocabulary::notice::Notice;
use super::vocabulary::units::{Flux, LengthUnit};
use super::vocabulary::watch::StageWatch;
use serde::Serialize;

/// What the model keeps of one ray set: provenance and what was read.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Origin {
    /// What the user calls the file.
    pub name: String,
    /// What the user calls the channel it is.
    pub channel: String,
    /// SHA-256 of the file, lower-case hex.
    pub sha256: String,
    /// Bytes in the file.
    pub byte_count: u64,
    /// "IES TM-25", …
    pub format: &'static str,
    /// Rays in the file.
    pub ray_count: u64,
    /// Rays that went on after the check.
    pub rays_used: u64,
    /// Total flux of the channel.
    pub flux: Flux,
    /// What its declared flux came to.
    pub fixed: Option<Total>,
    /// What was declared of it.
    pub declared: Declared,
    /// Length unit its positions were read in.
    pub length_unit: Option<LengthUnit>,
    /// What is known of its spectrum: "none", "table", …
    pub spectrum: &'static str,
    /// Totals in the header.
    pub header_flux: Flux,
    /// Sum of the stored ray values (W and lm, or relative).
    pub ray_sum: Flux,
    /// Header total over ray sum, of the quantity the rays carry; `None` where the header has none.
    pub header_over_sum: Option<f64>,
    /// Texts of the header.
    pub texts: Vec<(String, String)>,
}

impl Origin {
    /// Share of the source's flux: of W where the source's are known, else of lm.
    pub fn share_of(&self, source: &Flux) -> f64 {
        let own = if source.radiant_w.is_some() { self.flux.radiant_w } else { self.flux.luminous_lm };
        own.unwrap_or(0.0) / source.primary()
    }

    fn of(channel: &Channel) -> Origin {
        let (facts, survey) = (channel.facts(), &channel.survey);
        let ray_sum = Flux {
            radiant_w: facts.has_radiant.then_some(survey.radiant_sum),
            luminous_lm: facts.has_luminous.then_some(survey.luminous_sum),
        };
        let ratio = |header: Option<f64>, sum: Option<f64>| Some(header? / sum.filter(|sum| *sum > 0.0)?);
        Origin {
            name: channel.file.clone(),
            channel: channel.name.clone(),
            sha256: channel.sha256.clone(),
            byte_count: channel.byte_count,
            format: facts.format.name(),
            ray_count: facts.ray_count,
            rays_used: survey.rays_used,
            flux: channel.flux,
            fixed: channel.fixed,
            declared: channel.declared.clone(),
            length_unit: facts.length_unit,
            spectrum: facts.spectral.name(),
            header_flux: facts.header_flux,
            ray_sum,
            header_over_sum: ratio(facts.header_flux.radiant_w, ray_sum.radiant_w)
                .or_else(|| ratio(facts.header_flux.luminous_lm, ray_sum.luminous_lm)),
            texts: facts.texts.clone(),
        }
    }
}

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
