//! The surface of a model in the numbers that renderers take: exitance in red, green and blue, and a normalised distribution of each zone.

use super::colour::{Primaries, unit_luminance};
use crate::error::{Error, Place};
use crate::evaluation::{Kind, tristimulus_of_bands};
use crate::model::evaluation::{Evaluator, Quantity};
use crate::model::light::Light;
use crate::source::Columns;

/// mm² of a m².
const MM2_PER_M2: f64 = 1e6;

/// A surface prepared for renderers.
pub struct Surface<'a> {
    /// The model, its volume left out.
    pub light: Light<'a>,
    /// Which light.
    pub kind: Kind,
    /// The model is a volume.
    pub stands_for_volume: bool,
    /// Exitance M of each vertex, lm/m² or W/m².
    pub exitance: Vec<f64>,
    /// Of each zone: q at the nodes of the grid, `[c][gamma]`, 1/sr; its bilinear interpolation integrates to 1.
    pub distributions: Vec<Vec<f64>>,
    /// Tristimulus values of each vertex, in any unit; empty unless the light has colours.
    xyz: Vec<[f64; 3]>,
}

impl<'a> Surface<'a> {
    /// Of the light that is asked for; without, colour where the model knows it, else lm, else W.
    ///
    /// # Errors
    /// As [`super::adapt`].
    pub fn new(light: impl Into<Light<'a>>, kind: Option<Kind>) -> Result<Surface<'a>, Error> {
        let whole = light.into();
        let stands_for_volume = whole.volume.is_some();
        let light = Light { volume: None, ..whole };
        let first = Kind::first_known(&light);
        let first = if first == Kind::Luminous && Kind::Color.is_known(&light) { Kind::Color } else { first };
        let kind = kind.unwrap_or(first);
        let quantity = match kind {
            Kind::Radiant => Quantity::Radiant,
            Kind::Luminous | Kind::Color => Quantity::Luminous,
            Kind::Spectrum => {
                let found = "A renderer's files hold one number or three, no spectra.";
                return Err(unusable("adapter.light", found, "Ask for luminous, radiant or color light."));
            }
        };
        let evaluator = Evaluator::new(light.clone(), quantity).filter(|_| kind.is_known(&light));
        let Some(evaluator) = evaluator else {
            let found = format!("The model does not know \"{}\" light: its rays did not say it.", kind.name());
            let remedy = format!("Ask for {} light, or build the model with a spectrum declared.", first.name());
            return Err(unusable("adapter.unknown_light", found, remedy));
        };
        let flux = match quantity {
            Quantity::Radiant => light.vertices.radiant_w.as_deref(),
            Quantity::Luminous => light.vertices.luminous_lm.as_deref(),
        };
        let areas_mm2 = light.mesh.vertex_areas_mm2();
        let per = |(flux, area_mm2): (&f64, &f64)| if *area_mm2 > 0.0 { MM2_PER_M2 * flux / area_mm2 } else { 0.0 };
        let exitance: Vec<f64> = flux.unwrap_or_default().iter().zip(&areas_mm2).map(per).collect();
        if exitance.iter().all(|exitance| *exitance <= 0.0) {
            let found = format!("The model has no {} light at all.", kind.name());
            return Err(unusable("adapter.dark", found, format!("Ask for {} light.", first.name())));
        }
        let distribution = |zone: usize| {
            let nodes = evaluator.nodes(zone);
            let integral = light.grid.integral(nodes);
            nodes.iter().map(|node| if integral > 0.0 { node / integral } else { 0.0 }).collect()
        };
        let distributions = (0..light.zones.len()).map(distribution).collect();
        let xyz = if kind == Kind::Color { tristimulus(&light) } else { Vec::new() };
        Ok(Surface { kind, stands_for_volume, exitance, distributions, xyz, light })
    }

    /// Unit of radiance.
    pub fn unit(&self) -> &'static str {
        if self.kind == Kind::Radiant { "W/(m2 sr)" } else { "cd/m2" }
    }

    /// Exitance of each vertex in red, green and blue; its luminance is [`Surface::exitance`], in colours that the primaries cannot show too.
    pub fn rgb(&self, primaries: &Primaries) -> Vec<[f64; 3]> {
        let colour = |vertex: usize| self.xyz.get(vertex).map_or([1.0; 3], |xyz| unit_luminance(*xyz, primaries));
        let scaled = |(vertex, exitance): (usize, &f64)| colour(vertex).map(|part| part * exitance);
        self.exitance.iter().enumerate().map(scaled).collect()
    }
}

/// X, Y, Z of each vertex, by its spectrum or as its rays had them.
fn tristimulus(light: &Light<'_>) -> Vec<[f64; 3]> {
    let sites = light.vertices;
    if light.spectral.columns == Columns::Tristimulus {
        let own = |site: usize| <[f64; 3]>::try_from(sites.columns_of(site)).unwrap_or_default();
        return (0..sites.len()).map(own).collect();
    }
    let weights = tristimulus_of_bands(&light.spectral.bands);
    let own = |site: usize| {
        let bands = light.spectral.bands_w_per_nm(sites.columns_of(site));
        let sum = |axis: usize| bands.iter().zip(&weights).map(|(band, weight)| band * weight[axis]).sum();
        [sum(0), sum(1), sum(2)]
    };
    (0..sites.len()).map(own).collect()
}

fn unusable(code: &'static str, found: impl Into<String>, remedy: impl Into<String>) -> Error {
    Error::invalid_declaration(code, Place::Asked("light"), found, remedy)
}
