//! Directions to intensities.

use super::super::vocabulary::units::Flux;

/// The angular distribution of a zone or of the whole source.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Goniogram {
    /// Rays in it; a ray shared between zones counts by its shares.
    pub rays: f64,
    /// Its flux: equal to the sum of intensity × solid angle, before and after smoothing.
    pub flux: Flux,
    /// Luminous intensity, cd, `[c][gamma]` over the fine grid.
    pub luminous_cd: Option<Vec<f64>>,
    /// Radiant intensity, W/sr, `[c][gamma]` over the fine grid.
    pub radiant_w_per_sr: Option<Vec<f64>>,
    /// Spectral radiant intensity, W/(sr nm), `[c][gamma][band]` over the spectral grid; empty without bands.
    pub spectral_w_per_sr_nm: Vec<f64>,
    /// Spectral flux, W/nm, one per band; empty without bands.
    pub spectral_flux_w_per_nm: Vec<f64>,
    /// How good it is.
    pub quality: Quality,
}

/// What the statistics of a goniogram allow to say.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Quality {
    /// Median of rays per lit cell, before smoothing.
    pub rays_per_cell_median: f64,
    /// Share of cells without a ray.
    pub empty_cell_fraction: f64,
    /// Relative standard error of the largest intensity, after smoothing.
    pub relative_noise_at_peak: f64,
    /// Widest smoothing radius, degrees; 0 when off.
    pub smoothing_deg: f64,
}
