//! Radiant and luminous flux.

use serde::Serialize;

/// Luminous efficacy of radiation at the peak of V(λ), lm/W (CIE 1924; 683.002 in the 2019 SI, rounded as every
/// photometric standard does).
pub const KM_LM_PER_W: f64 = 683.0;

/// A flux in both systems; `None` where it cannot be known without guessing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Flux {
    /// Radiant flux, W.
    pub radiant_w: Option<f64>,
    /// Luminous flux, lm.
    pub luminous_lm: Option<f64>,
}

impl Flux {
    /// The flux that weights rays where only one number is wanted: radiant where known, else luminous.
    /// Unit: [`Flux::primary_unit`].
    pub fn primary(&self) -> f64 {
        self.radiant_w.or(self.luminous_lm).unwrap_or(0.0)
    }

    /// Unit of [`Flux::primary`].
    pub fn primary_unit(&self) -> &'static str {
        if self.radiant_w.is_some() { "W" } else { "lm" }
    }
}
