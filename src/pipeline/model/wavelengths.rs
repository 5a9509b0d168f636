//! Wavelengths of new rays: a band as often as the spectral radiance of the ray's place and direction says, and a wavelength in it.

use super::chance::{Choice, Numbers, choices, pick};
use super::evaluation::Evaluator;
use super::light::Light;
use super::sampling::Drawn;
use crate::goniogram::{Goniogram, SphereGrid};
use std::f64::consts::TAU;

/// Draws wavelengths.
pub struct Wavelengths<'a> {
    light: Light<'a>,
    /// Bands of each place by their flux, `[site][band]`; what a place sends outside of all bands is spread over them.
    table: Vec<Choice>,
    /// The same as shares.
    shares: Vec<f32>,
    /// Of the zones whose spectrum changes with the direction, or of such a volume.
    zones: Vec<Option<Turning>>,
}

/// A zone that sends one band otherwise than another.
pub struct Turning {
    /// Normalised distribution of each band, 1/sr, `[c][gamma][band]`.
    pub nodes: Vec<f32>,
    /// Bands without flux, which are sent as the whole is.
    pub dark: Vec<bool>,
}

impl<'a> Wavelengths<'a> {
    /// Of the model that `evaluator` evaluates; `None` where it has no bands, or no light in them.
    pub fn new(evaluator: &Evaluator<'a>) -> Option<Wavelengths<'a>> {
        let light = evaluator.light().clone();
        let (sites, bands) = (light.sites(), &light.spectral.bands);
        if !light.spectral.has_bands() {
            return None;
        }
        let widths_nm = bands.widths_nm();
        let watts = |site| -> Vec<f64> {
            let densities = light.spectral.bands_w_per_nm(sites.columns_of(site));
            densities.iter().zip(&widths_nm).map(|(density, width_nm)| density * width_nm).collect()
        };
        let mut whole = vec![0.0; bands.len()];
        (0..sites.len()).for_each(|site| whole.iter_mut().zip(watts(site)).for_each(|(sum, watt)| *sum += watt));
        if !choices(&whole, &mut Vec::new()) {
            return None;
        }
        let count = sites.len() * bands.len();
        let (mut table, mut shares) = (Vec::with_capacity(count), Vec::with_capacity(count));
        for site in 0..sites.len() {
            let mut watts = watts(site);
            if !choices(&watts, &mut table) {
                // A place whose light lies outside of all bands: the spectrum of the whole source.
                table.truncate(site * bands.len());
                choices(&whole, &mut table);
                watts.clone_from(&whole);
            }
            let sum: f64 = watts.iter().sum();
            shares.extend(watts.iter().map(|watt| (watt / sum) as f32));
        }
        let turning = |goniogram: &Goniogram| Turning::new(goniogram, light.spectral_grid, bands.len());
        let zones = match light.volume {
            Some(_) => vec![turning(light.total)],
            None => light.zones.iter().map(|zone| turning(zone)).collect(),
        };
        Some(Wavelengths { light, table, shares, zones })
    }

    /// A wavelength of a ray, nm. `evaluator` is that of the model.
    pub fn draw_nm(&self, drawn: &Drawn, evaluator: &Evaluator<'_>, numbers: &mut Numbers) -> f64 {
        let edges_nm = self.light.spectral.bands.edges_nm();
        let bands = edges_nm.len() - 1;
        let from = drawn.site * bands;
        let band = match &self.zones[drawn.zone] {
            None => pick(&self.table[from..from + bands], numbers.bits()),
            Some(turning) => {
                let shares = &self.shares[from..from + bands];
                turning.band(shares, drawn, self.light.spectral_grid, evaluator, numbers.uniform())
            }
        };
        // The density of a band is its mean: even within it.
        edges_nm[band] + numbers.uniform() * (edges_nm[band + 1] - edges_nm[band])
    }
}

impl Turning {
    /// Of the `bands` of a goniogram over its spectral `grid`; `None` where all bands go the same ways.
    pub fn new(goniogram: &Goniogram, grid: &SphereGrid, bands: usize) -> Option<Turning> {
        let values = &goniogram.spectral_w_per_sr_nm;
        if values.is_empty() {
            return None;
        }
        let weights_sr = grid.interpolation_weights_sr();
        let mut integrals = vec![0.0; bands];
        for (node, values) in values.chunks_exact(bands).enumerate() {
            let weight_sr = weights_sr[node % weights_sr.len()];
            integrals.iter_mut().zip(values).for_each(|(sum, value)| *sum += weight_sr * value);
        }
        let part = |(at, value): (usize, &f64)| {
            let integral = integrals[at % bands];
            if integral > 0.0 { (value / integral) as f32 } else { 0.0 }
        };
        let nodes = values.iter().enumerate().map(part).collect();
        Some(Turning { nodes, dark: integrals.iter().map(|integral| *integral <= 0.0).collect() })
    }

    /// A band in proportion to its share of the light of the place, times its distribution in the direction.
    fn band(&self, shares: &[f32], drawn: &Drawn, grid: &SphereGrid, evaluator: &Evaluator<'_>, uniform: f64) -> usize {
        let (c, gamma) = drawn.angles;
        let c = c.rem_euclid(TAU);
        let bands = shares.len();
        let mut weights = vec![0.0_f32; bands];
        for (node, share) in grid.surroundings(c, gamma) {
            let values = &self.nodes[node * bands..][..bands];
            weights.iter_mut().zip(values).for_each(|(sum, value)| *sum += share as f32 * value);
        }
        if self.dark.iter().zip(shares).any(|(dark, share)| *dark && *share > 0.0) {
            let as_whole = evaluator.distribution_of(drawn.zone, c, gamma) as f32;
            let dark = weights.iter_mut().zip(&self.dark).filter(|(_, dark)| **dark);
            dark.for_each(|(weight, _)| *weight = as_whole);
        }
        weights.iter_mut().zip(shares).for_each(|(weight, share)| *weight *= share);
        // Where the coarser grid of the bands has no light, the place decides alone.
        let weights = if weights.iter().any(|weight| *weight > 0.0) { weights.as_slice() } else { shares };
        let mut wanted = uniform * weights.iter().map(|weight| f64::from(*weight)).sum::<f64>();
        let found = weights.iter().position(|weight| {
            wanted -= f64::from(*weight);
            wanted < 0.0
        });
        found.or_else(|| weights.iter().rposition(|weight| *weight > 0.0)).unwrap_or(0)
    }
}
