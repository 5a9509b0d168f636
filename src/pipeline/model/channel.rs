//! What the report tells of each channel of the source.

use crate::source::Channel;
use crate::vocabulary::declaration::{Declared, Total};
use crate::vocabulary::units::{Flux, LengthUnit};
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

    /// What is kept of a channel whose rays were read.
    pub fn of(channel: &Channel) -> Origin {
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
