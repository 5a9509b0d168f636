//! Everything a caller may choose, once: names, ranges, defaults. Requests and stored jobs are read as these structs; the contract,
//! the flags of `build` and the report's echo follow from them. What is left out is the default.

use crate::error::{Error, Place};
use crate::vocabulary::declaration::Total;
use crate::vocabulary::space::Axis;
use crate::vocabulary::spectrum::Bands;
use schemars::{JsonSchema, Schema, schema_for};
use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;

/// Most spectral bands.
const MOST_BANDS: usize = 4096;
/// Cells along the longest edge of the emission's box.
const RESOLUTION: RangeInclusive<u32> = 4..=256;
/// Zones along one side of the lattice.
const ZONES_ALONG: RangeInclusive<u32> = 1..=32;
/// Step of γ, degrees.
const GAMMA_STEP_DEG: RangeInclusive<f64> = 0.5..=30.0;
/// Step of C, degrees.
const C_STEP_DEG: RangeInclusive<f64> = 1.0..=90.0;
/// Most cells of an angular grid: more than any reader of IES files wants.
const MOST_CELLS: usize = 40_000;

/// Options of the computation.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Options {
    /// How the rays are read.
    pub rays: RaysOptions,
    /// How the emission points become a surface.
    pub hull: HullOptions,
    /// How the rays are assigned to the surface.
    pub flux: FluxOptions,
    /// How the zones and their goniograms are computed.
    pub goniogram: GoniogramOptions,
    /// How the artifacts are written.
    pub artifacts: ArtifactsOptions,
}

/// How the rays are read.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct RaysOptions {
    /// Edges of the spectral bands, nm: 2 to 4097 values, positive, strictly increasing. Default: 380 to 780 in steps of 10,
    /// extended to the wavelengths of the rays.
    #[schemars(length(min = 2, max = MOST_BANDS + 1), example = some_edges())]
    pub band_edges_nm: Option<Vec<f64>>,
    /// Total flux of the source, of which every channel declares its share; said with the channels, not among the options.
    /// Default: the channels' own fluxes hold.
    #[serde(skip)]
    pub total: Option<Total>,
}

/// How the emission points become a surface.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct HullOptions {
    /// Where on the rays' lines the light is put. Default: auto; origins with the paper's zones.
    pub emission: Option<Emission>,
    /// Number of cells along the longest edge of the bounding box of the emission. Default: follows from the number of rays.
    #[schemars(range(min = *RESOLUTION.start(), max = *RESOLUTION.end()))]
    pub resolution: Option<u32>,
    /// Longest edge of a stitched or filled triangle of the surface round the origins, mm: the size filter [мера фильтрации]. Default: follows from
    /// the cell size.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub max_edge_mm: Option<f64>,
}

/// How the rays are assigned to the surface.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct FluxOptions {
    /// Whether the exitance is smoothed, as far as the rays do not support what was counted. Default: true.
    pub smoothing: Option<bool>,
}

/// How the zones and their goniograms are computed.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct GoniogramOptions {
    /// Where zones lie. Default: auto; paper where zones are given, and without smoothing.
    pub zoning: Option<ZoneLayout>,
    /// The lattice of zones. Default: none where zones follow the surface; for paper, as many as the density of the rays allows, at
    /// most 16.
    pub zones: Option<Zones>,
    /// The source axis that points to γ = 0. Default: the axis nearest to the direction of maximum intensity, or that of a narrow belt of light.
    pub nadir_axis: Option<Axis>,
    /// The source axis that points to C0; must not be parallel to `nadir_axis`. Default: the next axis in cyclic order.
    pub c0_axis: Option<Axis>,
    /// Step of the γ angle, degrees; must divide 180. Default: follows from the width of the beam or belt and from the number of zones, at most 5.
    #[schemars(range(min = *GAMMA_STEP_DEG.start(), max = *GAMMA_STEP_DEG.end()))]
    pub gamma_step_deg: Option<f64>,
    /// Step of the C angle, degrees; must divide 360. Default: 5.
    #[schemars(range(min = *C_STEP_DEG.start(), max = *C_STEP_DEG.end()))]
    pub c_step_deg: Option<f64>,
    /// Whether the intensities are smoothed, as far as the rays do not support what was counted. Default: true.
    pub smoothing: Option<bool>,
}

/// How the artifacts are written.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ArtifactsOptions {
    /// Where the glTF file has the vertex spectra. Default: auto.
    pub spectra: Option<Spectra>,
    /// Edition of the IES files. Default: LM-63-2002.
    pub ies_edition: Option<IesEdition>,
}

/// Where zones lie.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ZoneLayout {
    /// Along the surface: its faces, areas of one spectrum, and parts of them with their share of the rays.
    #[default]
    Auto,
    /// A regular lattice in the plane across γ = 0: the paper's form.
    Paper,
}

/// A regular lattice of zones.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Zones {
    /// Zones along C0.
    #[schemars(range(min = *ZONES_ALONG.start(), max = *ZONES_ALONG.end()))]
    pub columns: u32,
    /// Zones along C90.
    #[schemars(range(min = *ZONES_ALONG.start(), max = *ZONES_ALONG.end()))]
    pub rows: u32,
}

/// Where on the rays' lines the light is put.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Emission {
    /// Whichever of the following predicts rays best that the model was not made of.
    #[default]
    Auto,
    /// The ray origins as given: the paper's form.
    Origins,
    /// Where the rays' lines meet the plane or the sphere across the main direction on which the light is sharpest; rays that do
    /// not meet it well keep their origins.
    Focus,
    /// The volume that the ray origins fill: light that comes through itself, as a flame's.
    Volume,
}

/// Where the glTF file has the vertex spectra.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Spectra {
    /// In both places, up to 500 000 numbers; above, in attributes.
    #[default]
    Auto,
    /// Attributes and extras.
    Both,
    /// Vertex attributes only (`_SPECTRUM_nnn`).
    Attributes,
    /// Extras only (`extras.emitter`).
    Extras,
}

/// Edition of LM-63.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum IesEdition {
    /// What every reader accepts.
    #[default]
    #[serde(rename = "LM-63-2002")]
    Lm63Of2002,
    /// The newest.
    #[serde(rename = "LM-63-2019")]
    Lm63Of2019,
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

    /// Where on the rays' lines the light is put.
    pub fn emission(&self) -> Emission {
        let or_default = if self.goniogram.zoning() == ZoneLayout::Paper { Emission::Origins } else { Emission::Auto };
        self.hull.emission.unwrap_or(or_default)
    }

    /// These choices, with the default in the place of what was left out where that does not depend on the source.
    #[must_use]
    pub fn with_defaults(&self) -> Options {
        let mut all = self.clone();
        all.hull.emission = Some(self.emission());
        all.flux.smoothing.get_or_insert(true);
        all.goniogram.zoning = Some(self.goniogram.zoning());
        all.goniogram.smoothing.get_or_insert(true);
        all.artifacts.spectra.get_or_insert_default();
        all.artifacts.ies_edition.get_or_insert_default();
        all
    }

    /// The JSON schema of what a client may choose, for the contract and for command lines.
    pub fn schema() -> Schema {
        schema_for!(Options)
    }
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

/// Edges as a client may give them.
fn some_edges() -> [f64; 5] {
    [380.0, 480.0, 580.0, 680.0, 780.0]
}

/// The error of bands that cannot be made.
pub fn bad_bands(found: String) -> Error {
    let remedy = format!("Give 2 to {} positive wavelengths in nm, each larger than the last.", MOST_BANDS + 1);
    Error::unusable("options.band_edges", "rays.band_edges_nm", found, remedy)
}

impl HullOptions {
    /// Whether resolution and size filter are in range.
    ///
    /// # Errors
    /// [`Error::Unusable`].
    pub fn validate(&self) -> Result<(), Error> {
        if let Some(resolution) = self.resolution.filter(|resolution| !RESOLUTION.contains(resolution)) {
            return Err(Error::unusable(
                "options.hull_resolution",
                "hull.resolution",
                format!("The hull's resolution is {resolution} cells."),
                format!("Choose {} to {} cells, or leave it out.", RESOLUTION.start(), RESOLUTION.end()),
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

impl FluxOptions {
    /// Whether the exitance is smoothed.
    pub fn smooths(&self) -> bool {
        self.smoothing.unwrap_or(true)
    }
}

impl GoniogramOptions {
    /// Whether the intensities are smoothed.
    pub fn smooths(&self) -> bool {
        self.smoothing.unwrap_or(true)
    }

    /// Where zones lie.
    pub fn zoning(&self) -> ZoneLayout {
        let paper = self.zones.is_some() || !self.smooths();
        self.zoning.unwrap_or(if paper { ZoneLayout::Paper } else { ZoneLayout::Auto })
    }

    /// What can be said of the options without a source.
    ///
    /// # Errors
    /// [`Error::Unusable`] naming the option.
    pub fn validate(&self) -> Result<(), Error> {
        if let Some(Zones { columns, rows }) = self.zones {
            for (option, count) in [("goniogram.zones.columns", columns), ("goniogram.zones.rows", rows)] {
                if !ZONES_ALONG.contains(&count) {
                    let found = format!("{columns} x {rows} zones were asked for.");
                    let remedy = format!("Ask for {} to {} each way.", ZONES_ALONG.start(), ZONES_ALONG.end());
                    return Err(Error::unusable("options.zones", option, found, remedy));
                }
            }
        }
        if let (Some(nadir), Some(c0)) = (self.nadir_axis, self.c0_axis)
            && nadir.component() == c0.component()
        {
            return Err(parallel(nadir, c0));
        }
        let gamma = whole_steps(self.gamma_step_deg, 180.0, GAMMA_STEP_DEG, "goniogram.gamma_step_deg")?;
        let c = whole_steps(self.c_step_deg, 360.0, C_STEP_DEG, "goniogram.c_step_deg")?;
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
