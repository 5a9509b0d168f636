//! Everything a caller may choose: ranges, defaults, and how a choice is echoed in the report.

use crate::error::{Error, Place};
use crate::vocabulary::declaration::Total;
use crate::vocabulary::space::Axis;
use crate::vocabulary::spectrum::Bands;
use serde::Serialize;
use std::ops::RangeInclusive;

/// Everything a caller may choose. `Default` is what a new user gets; every choice is echoed in the report.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Options {
    /// How rays are read.
    pub rays: RaysOptions,
    /// How emission points become a surface.
    pub hull: HullOptions,
    /// How rays are laid on the surface.
    pub flux: FluxOptions,
    /// How zones and their goniograms are made.
    pub goniogram: GoniogramOptions,
    /// How results are written.
    pub artifacts: ArtifactsOptions,
}

impl Options {
    /// Whether these choices can be right for some source: ranges and contradictions, found before anything is read.
    ///
    /// # Errors
    /// [`Error::Unusable`] naming the first choice that cannot.
    pub fn validate(&self) -> Result<(), Error> {
        self.rays.validate()?;
        self.hull.validate()?;
        self.goniogram.validate()
    }
}

/// How rays are read.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct RaysOptions {
    /// Edges of the spectral bands, nm, strictly increasing. Default: 380..780 in 10 nm, wider (at whole 10 nm) where the rays
    /// are.
    pub band_edges_nm: Option<Vec<f64>>,
    /// Total flux of the source, of which every channel declares its share. Default: the channels' own fluxes hold.
    pub total: Option<Total>,
}

impl RaysOptions {
    /// Whether the bands can be made and the total can be a flux.
    ///
    /// # Errors
    /// [`Error::Unusable`].
    pub fn validate(&self) -> Result<(), Error> {
        self.total.map_or(Ok(()), |total| total.validate(Place::Total))?;
        self.bands().map(|_| ())
    }

    /// The spectral bands that were asked for; `None`: the default ones.
    ///
    /// # Errors
    /// `options.band_edges`.
    pub fn bands(&self) -> Result<Option<Bands>, Error> {
        let Some(edges) = &self.band_edges_nm else { return Ok(None) };
        if edges.len() > MOST_BANDS + 1 {
            return Err(bad_bands(format!("There are {} band edges.", edges.len())));
        }
        let bands = Bands::new(edges.clone());
        bands.map(Some).ok_or_else(|| bad_bands("The band edges do not increase.".to_owned()))
    }
}

/// Most spectral bands.
const MOST_BANDS: usize = 4096;

/// The error of bands that cannot be made.
pub fn bad_bands(found: String) -> Error {
    let remedy = format!("Give 2 to {} positive wavelengths in nm, each larger than the last.", MOST_BANDS + 1);
    Error::unusable("options.band_edges", "rays.band_edges_nm", found, remedy)
}

/// How emission points become a surface.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct HullOptions {
    /// Where light is taken to start.
    pub emission: Emission,
    /// Cells along the longest edge of the cloud's box, 4..=256. Default: from the number of rays per occupied cell.
    pub resolution: Option<u32>,
    /// The size filter [мера фильтрации]: longest edge of a stitched or filled triangle, mm. Default: from the cell size.
    pub max_edge_mm: Option<f64>,
}

impl HullOptions {
    /// Whether resolution and size filter are in range.
    ///
    /// # Errors
    /// [`Error::Unusable`].
    pub fn validate(&self) -> Result<(), Error> {
        if let Some(resolution) = self.resolution.filter(|resolution| !(4..=256).contains(resolution)) {
            return Err(Error::unusable(
                "options.hull_resolution",
                "hull.resolution",
                format!("The hull's resolution is {resolution} cells."),
                "Choose 4 to 256 cells, or leave it out.",
            ));
        }
        if let Some(edge) = self.max_edge_mm.filter(|edge| !(edge.is_finite() && *edge > 0.0)) {
            return Err(Error::unusable(
                "options.hull_max_edge",
                "hull.max_edge_mm",
                format!("The hull's size filter is {edge} mm."),
                "Choose a positive length in mm, or leave it out.",
            ));
        }
        Ok(())
    }
}

/// Where light is taken to start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Emission {
    /// The ray origins as given: the paper's form.
    #[default]
    Origins,
}

/// How rays are laid on the surface.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FluxOptions {
    /// Shepard smoothing of the exitance.
    pub smoothing: bool,
}

impl Default for FluxOptions {
    fn default() -> FluxOptions {
        FluxOptions { smoothing: true }
    }
}

/// How zones and their goniograms are made.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct GoniogramOptions {
    /// Zones along C0 and across it, 1..=32 each. Default: at most 16 zones, from the rays' density.
    pub zones: Option<(u32, u32)>,
    /// The source axis at γ = 0. Default: the axis nearest the direction of maximum intensity.
    pub nadir: Option<Axis>,
    /// The source axis at C0. Default: the next axis in cyclic order.
    pub c0: Option<Axis>,
    /// Step of γ, degrees; 180 is a whole multiple of it; 0.5..=30. Default: from the beam's width.
    pub gamma_step_deg: Option<f64>,
    /// Step of C, degrees; 360 is a whole multiple of it; 1..=90. Default 10.
    pub c_step_deg: Option<f64>,
    /// Smoothing on the grid.
    pub smoothing: bool,
}

impl Default for GoniogramOptions {
    fn default() -> GoniogramOptions {
        GoniogramOptions { zones: None, nadir: None, c0: None, gamma_step_deg: None, c_step_deg: None, smoothing: true }
    }
}

/// Most zones along a side of the lattice.
pub const MOST_ZONES_ALONG: u32 = 32;
/// Most cells of an angular grid: more than any reader of IES files wants.
const MOST_CELLS: usize = 40_000;

impl GoniogramOptions {
    /// What can be said of the options without a source.
    ///
    /// # Errors
    /// [`Error::Unusable`] naming the option.
    pub fn validate(&self) -> Result<(), Error> {
        if let Some((columns, rows)) = self.zones {
            for (option, count) in [("goniogram.zones.columns", columns), ("goniogram.zones.rows", rows)] {
                if !(1..=MOST_ZONES_ALONG).contains(&count) {
                    let found = format!("{columns} x {rows} zones were asked for.");
                    return Err(Error::unusable("options.zones", option, found, "Ask for 1 to 32 each way."));
                }
            }
        }
        if let (Some(nadir), Some(c0)) = (self.nadir, self.c0)
            && nadir.component() == c0.component()
        {
            return Err(parallel(nadir, c0));
        }
        let gamma = whole_steps(self.gamma_step_deg, 180.0, 0.5..=30.0, "goniogram.gamma_step_deg")?;
        let c = whole_steps(self.c_step_deg, 360.0, 1.0..=90.0, "goniogram.c_step_deg")?;
        if let (Some(gamma), Some(c)) = (gamma, c)
            && gamma * c > MOST_CELLS
        {
            let found = format!("{gamma} steps of gamma times {c} of C are {} cells.", gamma * c);
            let remedy = format!("Choose wider steps: at most {MOST_CELLS} cells, e.g. 0.5 by 5 degrees.");
            return Err(Error::unusable("options.angle_step", "goniogram.c_step_deg", found, remedy));
        }
        Ok(())
    }
}

/// How many of `step_deg` make `whole_deg`.
///
/// # Errors
/// [`Error::Unusable`] when out of `range` or no whole number of them does.
pub fn whole_steps(
    step_deg: Option<f64>,
    whole_deg: f64,
    range: RangeInclusive<f64>,
    option: &'static str,
) -> Result<Option<usize>, Error> {
    let Some(step_deg) = step_deg else { return Ok(None) };
    let count = (whole_deg / step_deg).round();
    if range.contains(&step_deg) && (count * step_deg - whole_deg).abs() < 1e-9 * whole_deg {
        return Ok(Some(count as usize));
    }
    let found = format!("A step of {step_deg} degrees was asked for.");
    let remedy =
        format!("Choose {} to {} degrees, a whole number of which make {whole_deg}.", range.start(), range.end());
    Err(Error::unusable("options.angle_step", option, found, remedy))
}

/// The error of axes along one line.
pub fn parallel(nadir: Axis, c0: Axis) -> Error {
    let found = format!("C0 at {} does not lie across γ = 0 at {}.", c0.name(), nadir.name());
    Error::unusable("options.c0_axis", "goniogram.c0_axis", found, "Choose a c0_axis at right angles to nadir_axis.")
}

/// How results are written.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ArtifactsOptions {
    /// Where vertex spectra go in the glTF.
    pub spectra: Spectra,
    /// Edition of the IES files.
    pub ies_edition: IesEdition,
}

/// Where vertex spectra go in the glTF.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Spectra {
    /// In both, up to 2 million numbers; above, in attributes.
    #[default]
    Auto,
    /// Attributes and extras.
    Both,
    /// `_SPECTRUM_nnn` attributes only.
    Attributes,
    /// `extras.emitter` only.
    Extras,
}

/// Edition of LM-63.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub enum IesEdition {
    /// LM-63-2002: what every reader accepts.
    #[default]
    #[serde(rename = "LM-63-2002")]
    Lm63Of2002,
    /// LM-63-2019.
    #[serde(rename = "LM-63-2019")]
    Lm63Of2019,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_must_make_a_whole() {
        assert_eq!(whole_steps(Some(2.5), 180.0, 0.5..=30.0, "x").unwrap(), Some(72));
        assert_eq!(whole_steps(None, 180.0, 0.5..=30.0, "x").unwrap(), None);
        for bad in [7.0, 0.0, -5.0, f64::NAN, 90.0, 0.1] {
            assert_eq!(whole_steps(Some(bad), 180.0, 0.5..=30.0, "x").unwrap_err().code(), "options.angle_step");
        }
    }
}
