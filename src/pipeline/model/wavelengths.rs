//! Wavelengths of new rays: a band as often as the spectral radiance of the ray's place and direction says, and a wavelength in it.

use super::chance::{Choice, Decision, Numbers, choices, pick};
use super::evaluation::Evaluator;
use super::light::Light;
use super::sampling::{Batch, Drawn};
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
    /// None of them is such.
    is_of_places: bool,
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
        let zones: Vec<Option<Turning>> = match light.volume {
            Some(_) => vec![turning(light.total)],
            None => light.zones.iter().map(|zone| turning(zone)).collect(),
        };
        let is_of_places = zones.iter().all(Option::is_none);
        Some(Wavelengths { light, table, shares, zones, is_of_places })
    }

    /// A wavelength of a ray, nm. `evaluator` is that of the model.
    pub fn draw_nm(&self, drawn: &Drawn, evaluator: &Evaluator<'_>, numbers: &mut Numbers) -> f64 {
        self.within_nm(self.band(drawn, evaluator, numbers, &mut Vec::new()), numbers)
    }

    /// A wavelength of each ray of a batch that was drawn, nm, as [`Wavelengths::draw_nm`] draws it.
    pub fn draw_all_nm(&self, batch: &mut Batch, evaluator: &Evaluator<'_>) {
        let Batch { numbers, drawn, bands, wavelengths_nm, weights, .. } = batch;
        bands.clear();
        let rays = drawn.iter().zip(&*numbers);
        if self.is_of_places {
            // The tables are larger than a cache: the less is done for each ray, the more of them are on their way at once.
            bands.extend(rays.map(|(drawn, numbers)| self.band_of_place(drawn, numbers)));
        } else {
            bands.extend(rays.map(|(drawn, numbers)| self.band(drawn, evaluator, numbers, weights)));
        }
        wavelengths_nm.clear();
        wavelengths_nm.extend(bands.iter().zip(numbers).map(|(band, numbers)| self.within_nm(*band, numbers)));
    }

    /// The band of a ray. `weights` is memory for those of all bands.
    fn band(&self, drawn: &Drawn, evaluator: &Evaluator<'_>, numbers: &Numbers, weights: &mut Vec<f32>) -> usize {
        match &self.zones[drawn.zone] {
            None => self.band_of_place(drawn, numbers),
            Some(turning) => {
                let bands = self.light.spectral.bands.len();
                let from = drawn.site * bands;
                let shares = &self.shares[from..from + bands];
                turning.weigh(shares, drawn, self.light.spectral_grid, evaluator, weights);
                // Where the coarser grid of the bands has no light, the place decides alone.
                let is_lit = weights.iter().any(|weight| *weight > 0.0);
                by_weight(if is_lit { weights } else { shares }, numbers.uniform(Decision::Band))
            }
        }
    }

    #[inline]
    fn band_of_place(&self, drawn: &Drawn, numbers: &Numbers) -> usize {
        let bands = self.light.spectral.bands.len();
        let from = drawn.site * bands;
        pick(&self.table[from..from + bands], numbers.get(Decision::Band))
    }

    /// The density of a band is its mean: even within it.
    fn within_nm(&self, band: usize, numbers: &Numbers) -> f64 {
        let edges_nm = self.light.spectral.bands.edges_nm();
        edges_nm[band] + numbers.uniform(Decision::WithinBand) * (edges_nm[band + 1] - edges_nm[band])
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

    /// The weight of each band: its share of the light of the place, times its distribution in the direction.
    fn weigh(
        &self,
        shares: &[f32],
        drawn: &Drawn,
        grid: &SphereGrid,
        evaluator: &Evaluator<'_>,
        weights: &mut Vec<f32>,
    ) {
        let (c, gamma) = drawn.angles;
        let c = c.rem_euclid(TAU);
        let bands = shares.len();
        weights.clear();
        weights.resize(bands, 0.0);
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
    }
}

/// The place that a number in 0..1 leads to, in the order of the weights.
fn by_weight(weights: &[f32], number: f64) -> usize {
    let mut wanted = number * weights.iter().map(|weight| f64::from(*weight)).sum::<f64>();
    let found = weights.iter().position(|weight| {
        wanted -= f64::from(*weight);
        wanted < 0.0
    });
    found.or_else(|| weights.iter().rposition(|weight| *weight > 0.0)).unwrap_or(0)
}
