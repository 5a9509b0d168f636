//! What leaves each place of a model and where it goes, in the numbers that are asked for: W, lm, bands or tristimulus values.

use crate::error::{Error, Place};
use crate::goniogram::{Goniogram, SphereGrid};
use crate::model::light::Light;
use crate::model::wavelengths::Turning;
use crate::source::Columns;
use crate::vocabulary::spectrum::{Bands, color_matching};
use crate::vocabulary::units::{KM_LM_PER_W, Quantity};
use glam::DVec3;

/// Steps in a band by which the colour-matching functions are averaged.
const STEPS_IN_BAND: usize = 32;

/// Which light is evaluated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// W.
    Radiant,
    /// lm.
    Luminous,
    /// W/nm in each band.
    Spectrum,
    /// Tristimulus values X, Y and Z of the CIE 1931 observer, lm.
    Color,
}

impl Kind {
    /// All, in the order in which they are offered.
    pub const ALL: [Kind; 4] = [Kind::Luminous, Kind::Radiant, Kind::Spectrum, Kind::Color];

    /// The name users write.
    pub fn name(self) -> &'static str {
        match self {
            Kind::Radiant => "radiant",
            Kind::Luminous => "luminous",
            Kind::Spectrum => "spectrum",
            Kind::Color => "color",
        }
    }

    /// Whether a model knows it.
    pub fn is_known(self, light: &Light<'_>) -> bool {
        let sites = light.sites();
        match self {
            Kind::Radiant => sites.radiant_w.is_some() && light.total.radiant_w_per_sr.is_some(),
            Kind::Luminous => sites.luminous_lm.is_some() && light.total.luminous_cd.is_some(),
            Kind::Spectrum => light.spectral.has_bands() && Kind::Radiant.is_known(light),
            Kind::Color => {
                Kind::Spectrum.is_known(light)
                    || (light.spectral.columns == Columns::Tristimulus && Kind::Luminous.is_known(light))
            }
        }
    }

    /// Numbers that each place and direction has.
    ///
    /// # Errors
    /// [`Error::Unusable`] where the model does not know this light.
    pub fn channels(self, light: &Light<'_>) -> Result<usize, Error> {
        let sites = light.sites();
        match self {
            _ if !self.is_known(light) => Err(unknown(light, self)),
            Kind::Spectrum | Kind::Color if light.spectral.has_bands() => Ok(light.spectral.bands.widths_nm().len()),
            Kind::Spectrum | Kind::Color => Ok(sites.columns.len() / sites.len().max(1)),
            Kind::Radiant | Kind::Luminous => Ok(1),
        }
    }

    /// Luminous where the model knows it, else radiant.
    pub fn first_known(light: &Light<'_>) -> Kind {
        // Of infrared, lumens are known to be none.
        let is_visible = light.vertices.luminous_lm.iter().flatten().any(|lumen| *lumen > 0.0);
        if Kind::Luminous.is_known(light) && is_visible { Kind::Luminous } else { Kind::Radiant }
    }
}

/// The normalised goniograms of a zone.
struct Distribution<'a> {
    /// Intensities at the nodes, `[c][gamma]`, and what they are multiplied by to be a distribution, 1/sr.
    alike: (&'a [f64], f64),
    /// The zone sends one band otherwise than another.
    turning: Option<Turning>,
}

/// Goniograms of many zones, summed: they share their grids.
pub struct Blend {
    /// `[c][gamma][channel]`, flux/sr.
    main: Vec<f64>,
    /// Of bands that zones send otherwise than others.
    spectral: Vec<f64>,
}

/// The nodes round a direction.
pub struct Toward {
    /// C and γ, radians.
    pub angles: (f64, f64),
    main: [(usize, f64); 4],
    spectral: Option<[(usize, f64); 4]>,
}

/// A model prepared to be evaluated in some channels: numbers that each place and direction has.
pub struct Emission<'a> {
    light: Light<'a>,
    channels: usize,
    weights: Vec<f64>,
    /// Exitance of each vertex, flux/mm², or emission coefficient of each node of a volume, flux/mm³, `[site][channel]`.
    density: Vec<f64>,
    /// Of each zone; a volume has one.
    zones: Vec<Distribution<'a>>,
}

impl<'a> Emission<'a> {
    /// Of the channels that `kind` needs.
    ///
    /// # Errors
    /// [`Error::Unusable`] where the model does not know them.
    pub fn new(light: Light<'a>, kind: Kind) -> Result<Emission<'a>, Error> {
        let emission = kind.is_known(&light).then(|| Emission::known(&light, kind)).flatten();
        emission.ok_or_else(|| unknown(&light, kind))
    }

    fn known(light: &Light<'a>, kind: Kind) -> Option<Emission<'a>> {
        let has_bands = light.spectral.has_bands();
        let bands = matches!(kind, Kind::Spectrum | Kind::Color) && has_bands;
        let quantity = match kind {
            Kind::Radiant | Kind::Spectrum => Quantity::Radiant,
            Kind::Color if has_bands => Quantity::Radiant,
            Kind::Luminous | Kind::Color => Quantity::Luminous,
        };
        let sites = light.sites();
        let flux: Vec<f64> = match kind {
            _ if bands => {
                (0..sites.len()).flat_map(|site| light.spectral.bands_w_per_nm(sites.columns_of(site))).collect()
            }
            Kind::Color | Kind::Spectrum => sites.columns.clone(),
            Kind::Radiant => sites.radiant_w.clone()?,
            Kind::Luminous => sites.luminous_lm.clone()?,
        };
        let measures = match light.volume {
            Some(volume) => volume.volumes_mm3.clone(),
            None => light.mesh.vertex_areas_mm2(),
        };
        let channels = flux.len() / sites.len().max(1);
        let per = |(at, flux): (usize, &f64)| {
            let measure = measures[at / channels];
            if measure > 0.0 { flux / measure } else { 0.0 }
        };
        let density = flux.iter().enumerate().map(per).collect();
        let weights = if bands { light.spectral.bands.widths_nm() } else { vec![1.0; channels] };
        let whole = alike(light.total, light.grid, quantity)?;
        let of_zone = |goniogram: &&'a Goniogram| {
            let own = alike(goniogram, light.grid, quantity)?;
            let turning = bands.then(|| Turning::new(goniogram, light.spectral_grid, channels)).flatten();
            // Light that smoothing gave to a zone in which no ray landed goes as that of the whole source.
            Some(Distribution { alike: if own.1 > 0.0 { own } else { whole }, turning })
        };
        let zones = match light.volume {
            Some(_) => [light.total].iter().map(of_zone).collect::<Option<Vec<_>>>()?,
            None => light.zones.iter().map(of_zone).collect::<Option<Vec<_>>>()?,
        };
        Some(Emission { light: light.clone(), channels, weights, density, zones })
    }

    /// What is evaluated.
    pub fn light(&self) -> &Light<'a> {
        &self.light
    }

    /// How many numbers each place and direction has.
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// What makes one flux of the channels: their widths where they are bands, else 1.
    pub fn weights(&self) -> &[f64] {
        &self.weights
    }

    /// The channels as one number.
    pub fn weighed(&self, values: &[f64]) -> f64 {
        values.iter().zip(&self.weights).map(|(value, weight)| value * weight).sum()
    }

    /// Exitance of a vertex or emission coefficient of a node, one number a channel.
    pub fn density(&self, site: usize) -> &[f64] {
        &self.density[site * self.channels..][..self.channels]
    }

    /// One channel of all places.
    pub fn densities(&self, channel: usize) -> Vec<f64> {
        self.density.iter().skip(channel).step_by(self.channels).copied().collect()
    }

    /// How many zones.
    pub fn zone_count(&self) -> usize {
        self.zones.len()
    }

    /// Zones and weights of a vertex.
    pub fn parts(&self, vertex: usize) -> impl Iterator<Item = (usize, f64)> {
        self.light.mixtures[vertex].parts()
    }

    /// Looks up a unit direction.
    pub fn toward(&self, direction: DVec3) -> Toward {
        let (c, gamma) = self.light.frame.angles(direction);
        let is_turning = self.zones.iter().any(|zone| zone.turning.is_some());
        let spectral = is_turning.then(|| self.light.spectral_grid.surroundings(c, gamma));
        Toward { angles: (c, gamma), main: self.light.grid.surroundings(c, gamma), spectral }
    }

    /// Adds `factor` × flux × q of a zone to `sums`, each with one number a channel.
    pub fn add(&self, zone: usize, toward: &Toward, flux: &[f64], factor: f64, sums: &mut [f64]) {
        let distribution = &self.zones[zone];
        let (nodes, scale) = distribution.alike;
        let alike = factor * scale * toward.main.iter().map(|(node, share)| nodes[*node] * share).sum::<f64>();
        match (&distribution.turning, &toward.spectral) {
            (Some(turning), Some(around)) => {
                for (channel, (sum, flux)) in sums.iter_mut().zip(flux).enumerate() {
                    let at = |node: usize| f64::from(turning.nodes[node * self.channels + channel]);
                    let own = || factor * around.iter().map(|(node, share)| at(*node) * share).sum::<f64>();
                    *sum += flux * if turning.dark[channel] { alike } else { own() };
                }
            }
            _ => sums.iter_mut().zip(flux).for_each(|(sum, flux)| *sum += flux * alike),
        }
    }

    /// The sum over all zones of flux × q, for [`Emission::add_blend`]; `flux` is `[zone][channel]`.
    pub fn blend(&self, flux: &[f64]) -> Blend {
        let nodes = |grid: &SphereGrid| vec![0.0; grid.c_planes() * grid.gamma_nodes() * self.channels];
        let is_turning = self.zones.iter().any(|zone| zone.turning.is_some());
        let spectral = if is_turning { nodes(self.light.spectral_grid) } else { Vec::new() };
        let mut blend = Blend { main: nodes(self.light.grid), spectral };
        for (distribution, flux) in self.zones.iter().zip(flux.chunks_exact(self.channels)) {
            let (nodes, scale) = distribution.alike;
            let turns = |channel: usize| distribution.turning.as_ref().filter(|turning| !turning.dark[channel]);
            for (channel, flux) in flux.iter().enumerate() {
                if let Some(turning) = turns(channel) {
                    let sums = blend.spectral.iter_mut().skip(channel).step_by(self.channels);
                    let values = turning.nodes.iter().skip(channel).step_by(self.channels);
                    sums.zip(values).for_each(|(sum, value)| *sum += flux * f64::from(*value));
                } else {
                    let sums = blend.main.iter_mut().skip(channel).step_by(self.channels);
                    sums.zip(nodes).for_each(|(sum, value)| *sum += flux * scale * value);
                }
            }
        }
        blend
    }

    /// Adds what a blend sends there to `sums`, flux/sr, one number a channel.
    pub fn add_blend(&self, blend: &Blend, toward: &Toward, sums: &mut [f64]) {
        let mut add = |nodes: &[f64], around: &[(usize, f64); 4]| {
            for (node, share) in around {
                let own = &nodes[node * self.channels..][..self.channels];
                sums.iter_mut().zip(own).for_each(|(sum, value)| *sum += share * value);
            }
        };
        add(&blend.main, &toward.main);
        if let Some(around) = toward.spectral.as_ref().filter(|_| !blend.spectral.is_empty()) {
            add(&blend.spectral, around);
        }
    }

    /// The largest and the smallest distribution of a zone at each γ node, over all C planes, 1/sr.
    pub fn extremes(&self, zone: usize) -> [Vec<f64>; 2] {
        let (nodes, scale) = self.zones[zone].alike;
        let gamma_nodes = self.light.grid.gamma_nodes();
        extremes(gamma_nodes, nodes.iter().enumerate().map(|(at, value)| (at % gamma_nodes, value * scale)))
    }

    /// The same of its bands, over the spectral grid; `None` where all bands go the same ways.
    pub fn spectral_extremes(&self, zone: usize) -> Option<[Vec<f64>; 2]> {
        let turning = self.zones[zone].turning.as_ref()?;
        let gamma_nodes = self.light.spectral_grid.gamma_nodes();
        let node = |at: usize| at / self.channels % gamma_nodes;
        let values = turning.nodes.iter().enumerate();
        Some(extremes(gamma_nodes, values.map(|(at, value)| (node(at), f64::from(*value)))))
    }
}

/// The most and the least of the values of each node.
fn extremes(nodes: usize, values: impl Iterator<Item = (usize, f64)>) -> [Vec<f64>; 2] {
    let (mut most, mut least) = (vec![0.0_f64; nodes], vec![f64::INFINITY; nodes]);
    for (node, value) in values {
        most[node] = most[node].max(value);
        least[node] = least[node].min(value);
    }
    [most, least]
}

/// Intensities at the nodes, and one over their integral; 0 where there is no light.
fn alike<'a>(goniogram: &'a Goniogram, grid: &SphereGrid, quantity: Quantity) -> Option<(&'a [f64], f64)> {
    let nodes = match quantity {
        Quantity::Radiant => goniogram.radiant_w_per_sr.as_ref(),
        Quantity::Luminous => goniogram.luminous_cd.as_ref(),
    }?;
    let integral = grid.integral(nodes);
    Some((nodes, if integral > 0.0 { integral.recip() } else { 0.0 }))
}

/// What X, Y and Z a W/nm in each band is, lm: 683 lm/W times the mean of the colour-matching functions over the band, times its width.
pub fn tristimulus_of_bands(bands: &Bands) -> Vec<[f64; 3]> {
    let of_band = |edges_nm: &[f64]| {
        let (from, width) = (edges_nm[0], edges_nm[1] - edges_nm[0]);
        let mut sums = [0.0; 3];
        for step in 0..STEPS_IN_BAND {
            let matching = color_matching(from + width * (step as f64 + 0.5) / STEPS_IN_BAND as f64);
            sums.iter_mut().zip(matching).for_each(|(sum, value)| *sum += value);
        }
        sums.map(|sum| KM_LM_PER_W * width * sum / STEPS_IN_BAND as f64)
    };
    bands.edges_nm().windows(2).map(of_band).collect()
}

fn unknown(light: &Light<'_>, kind: Kind) -> Error {
    let known: Vec<&str> = Kind::ALL.into_iter().filter(|kind| kind.is_known(light)).map(Kind::name).collect();
    let found = format!("The model does not know \"{}\" light: its rays did not say it.", kind.name());
    let remedy = format!("Ask for one of: {}; or build the model with a spectrum declared.", known.join(", "));
    Error::invalid_declaration("evaluation.unknown_quantity", Place::Asked("light"), found, remedy)
}
