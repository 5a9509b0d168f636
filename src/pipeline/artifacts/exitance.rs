//! Exitance at the vertices and the colour it shows: M_l = flux_l / A_l, A_l a third of the areas of the vertex's triangles.
//! Linear interpolation of M over the mesh integrates to the flux exactly (`pipeline/README.md` 3).

use crate::flux::Amounts;
use crate::model::Model;
use crate::source::Columns;
use crate::vocabulary::spectrum::{color_matching, linear_srgb};
use crate::vocabulary::units::KM_LM_PER_W;
use std::f64::consts::PI;

/// Exitance per vertex, in `unit`.
pub struct Exitance {
    /// One per vertex.
    pub values: Vec<f64>,
    /// "lm/mm²" where luminous flux is known, else "W/mm²".
    pub unit: &'static str,
}

/// The exitance a person looks at: luminous where known, else radiant.
pub fn exitance(model: &Model) -> Exitance {
    let vertices = &model.surface.vertices;
    let areas = model.hull.vertex_areas_mm2();
    let (flux, unit) = match (&vertices.luminous_lm, &vertices.radiant_w) {
        (Some(luminous), _) => (luminous.as_slice(), "lm/mm²"),
        (None, Some(radiant)) => (radiant.as_slice(), "W/mm²"),
        (None, None) => (&[][..], "W/mm²"),
    };
    Exitance { values: areas.iter().zip(flux).map(|(area, flux)| per_measure(*flux, *area)).collect(), unit }
}

fn per_measure(flux: f64, measure: f64) -> f64 {
    if measure > 0.0 { flux / measure } else { 0.0 }
}

/// Colours for a preview, and what they stand for.
pub struct Colors {
    /// Linear sRGB per site, 0..=1: one global maximum is 1, negative components (outside the gamut) are 0.
    pub linear_srgb: Vec<[f32; 3]>,
    /// cd/m² that a relative luminance (0.2126 R + 0.7152 G + 0.0722 B) of 1 stands for, if the surface were Lambertian: M/π.
    /// `None` where luminous flux is unknown.
    pub luminance_scale_cd_m2: Option<f64>,
}

/// The colour of each vertex's exitance.
pub fn colors(model: &Model) -> Colors {
    colors_of(model, &model.surface.vertices, &model.hull.vertex_areas_mm2())
}

/// The colour of the flux of sites per measure (area, volume): from their spectra or tristimulus, grey where neither is known or all is
/// invisible.
pub fn colors_of(model: &Model, sites: &Amounts, measures: &[f64]) -> Colors {
    let flux = sites.luminous_lm.as_ref().or(sites.radiant_w.as_ref()).map_or(&[][..], Vec::as_slice);
    let density: Vec<f64> = flux.iter().zip(measures).map(|(flux, measure)| per_measure(*flux, *measure)).collect();
    let chromatic: Vec<[f64; 3]> = tristimulus(model, sites, measures, &density).into_iter().map(linear_srgb).collect();
    let is_visible = chromatic.iter().flatten().any(|component| *component > 0.0);
    let rgb = if is_visible { chromatic } else { density.iter().map(|value| [*value; 3]).collect() };
    let max = rgb.iter().flatten().copied().fold(0.0, f64::max);
    let scale = if max > 0.0 { max } else { 1.0 };
    Colors {
        linear_srgb: rgb.iter().map(|rgb| rgb.map(|component| (component / scale).clamp(0.0, 1.0) as f32)).collect(),
        luminance_scale_cd_m2: sites.luminous_lm.is_some().then_some(scale * 1e6 / PI),
    }
}

/// XYZ of the flux of each site per measure, in lumens where luminous flux is known; empty without spectrum or tristimulus.
fn tristimulus(model: &Model, sites: &Amounts, measures: &[f64], density: &[f64]) -> Vec<[f64; 3]> {
    let observer = observer_per_band(model);
    let of_site = |site: usize| -> [f64; 3] {
        if model.spectral.columns == Columns::Tristimulus {
            let columns = sites.columns_of(site);
            return std::array::from_fn(|k| per_measure(columns[k], measures[site]));
        }
        let spectrum = model.spectral.bands_w_per_nm(sites.columns_of(site));
        let xyz: [f64; 3] = std::array::from_fn(|k| {
            observer.iter().zip(&spectrum).map(|(observer, density)| observer[k] * density).sum()
        });
        // Bands give the hue; the rays, weighted each at its own wavelength, know the luminance better.
        let known_y = sites.luminous_lm.is_some() && xyz[1] > 0.0;
        let factor = if known_y { density[site] / xyz[1] } else { per_measure(1.0, measures[site]) };
        xyz.map(|component| component * factor)
    };
    match model.spectral.columns {
        Columns::None => Vec::new(),
        _ => (0..sites.len()).map(of_site).collect(),
    }
}

/// 683 ∫ [x̄, ȳ, z̄] dλ over each band, lm/W times nm: the midpoint rule at 1 nm or finer.
fn observer_per_band(model: &Model) -> Vec<[f64; 3]> {
    let of_band = |edge: &[f64]| {
        let steps = (edge[1] - edge[0]).ceil().clamp(1.0, 1000.0) as usize;
        let step = (edge[1] - edge[0]) / steps as f64;
        let mut sum = [0.0; 3];
        for at in 0..steps {
            let matching = color_matching(edge[0] + (at as f64 + 0.5) * step);
            sum = std::array::from_fn(|k| sum[k] + KM_LM_PER_W * step * matching[k]);
        }
        sum
    };
    model.spectral.bands.edges_nm().windows(2).map(of_band).collect()
}
