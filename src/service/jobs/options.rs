//! Options of a job, as clients send them and as they are stored. Every field may be left out; the pipeline has the defaults. The
//! pipeline checks the values before the job is queued.

use pipeline::Axis;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Options of the computation.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct JobOptions {
    /// How the rays are read.
    #[schema(nullable)]
    pub rays: RaysOptions,
    /// How the emission points become a surface.
    #[schema(nullable)]
    pub hull: HullOptions,
    /// How the rays are assigned to the surface.
    #[schema(nullable)]
    pub flux: FluxOptions,
    /// How the zones and their goniograms are computed.
    #[schema(nullable)]
    pub goniogram: GoniogramOptions,
    /// How the artifacts are written.
    #[schema(nullable)]
    pub artifacts: ArtifactsOptions,
}

/// How the rays are read.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct RaysOptions {
    /// Edges of the spectral bands, nm: 2 to 4097 values, positive, strictly increasing. Default: 380 to 780 in steps of 10,
    /// extended to the wavelengths of the rays.
    #[schema(min_items = 2, max_items = 4097, example = json!([380.0, 480.0, 580.0, 680.0, 780.0]))]
    pub band_edges_nm: Option<Vec<f64>>,
}

/// How the emission points become a surface.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct HullOptions {
    /// Which points of the rays are taken as the emitting surface. Default: origins.
    pub emission: Option<Emission>,
    /// Number of cells along the longest edge of the bounding box of the emission. Default: follows from the number of rays.
    #[schema(minimum = 4, maximum = 256)]
    pub resolution: Option<u32>,
    /// Longest edge of a stitched or filled triangle, mm. Default: follows from the cell size.
    #[schema(exclusive_minimum = 0.0)]
    pub max_edge_mm: Option<f64>,
}

/// How the rays are assigned to the surface.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct FluxOptions {
    /// Whether the exitance is smoothed. Default: true.
    pub smoothing: Option<bool>,
}

/// How the zones and their goniograms are computed.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct GoniogramOptions {
    /// The lattice of zones. Default: follows from the density of the rays, at most 16 zones.
    pub zones: Option<Zones>,
    /// The source axis that points to γ = 0. Default: the axis nearest to the direction of maximum intensity.
    pub nadir_axis: Option<AxisName>,
    /// The source axis that points to C0; must not be parallel to `nadir_axis`. Default: the next axis in cyclic order.
    pub c0_axis: Option<AxisName>,
    /// Step of the γ angle, degrees; must divide 180. Default: follows from the beam width.
    #[schema(minimum = 0.5, maximum = 30)]
    pub gamma_step_deg: Option<f64>,
    /// Step of the C angle, degrees; must divide 360. Default: 10.
    #[schema(minimum = 1, maximum = 90)]
    pub c_step_deg: Option<f64>,
    /// Whether the intensities are smoothed on the angular grid. Default: true.
    pub smoothing: Option<bool>,
}

/// How the artifacts are written.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ArtifactsOptions {
    /// Where the glTF file has the vertex spectra. Default: auto.
    pub spectra: Option<Spectra>,
    /// Edition of the IES files. Default: LM-63-2002.
    pub ies_edition: Option<IesEdition>,
}

/// A regular lattice of zones.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Zones {
    /// Zones along C0.
    #[schema(minimum = 1, maximum = 32)]
    pub columns: u32,
    /// Zones along C90.
    #[schema(minimum = 1, maximum = 32)]
    pub rows: u32,
}

/// Which points of the rays are taken as the emitting surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Emission {
    /// The ray origins as given.
    Origins,
}

/// A signed axis of the source frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[expect(missing_docs, reason = "the names say it")]
pub enum AxisName {
    #[serde(rename = "+X")]
    PosX,
    #[serde(rename = "-X")]
    NegX,
    #[serde(rename = "+Y")]
    PosY,
    #[serde(rename = "-Y")]
    NegY,
    #[serde(rename = "+Z")]
    PosZ,
    #[serde(rename = "-Z")]
    NegZ,
}

/// Where the glTF file has the vertex spectra.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Spectra {
    /// In both places, up to 2 million numbers; above, in attributes.
    Auto,
    /// Attributes and extras.
    Both,
    /// Vertex attributes only.
    Attributes,
    /// Extras only.
    Extras,
}

/// Edition of LM-63.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub enum IesEdition {
    /// What every reader accepts.
    #[serde(rename = "LM-63-2002")]
    Lm63Of2002,
    /// The newest.
    #[serde(rename = "LM-63-2019")]
    Lm63Of2019,
}

impl JobOptions {
    /// The pipeline's own words for it.
    ///
    /// # Errors
    /// [`pipeline::Error::Unusable`]: the first choice that no ray set could make right.
    pub fn resolve(&self) -> Result<pipeline::Options, pipeline::Error> {
        let mut options = pipeline::Options::default();
        options.rays.band_edges_nm = self.rays.band_edges_nm.clone();
        if let Some(Emission::Origins) = self.hull.emission {
            options.hull.emission = pipeline::Emission::Origins;
        }
        options.hull.resolution = self.hull.resolution;
        options.hull.max_edge_mm = self.hull.max_edge_mm;
        put(&mut options.flux.smoothing, self.flux.smoothing);
        let goniogram = &self.goniogram;
        options.goniogram.zones = goniogram.zones.map(|zones| (zones.columns, zones.rows));
        options.goniogram.nadir = goniogram.nadir_axis.map(AxisName::axis);
        options.goniogram.c0 = goniogram.c0_axis.map(AxisName::axis);
        options.goniogram.gamma_step_deg = goniogram.gamma_step_deg;
        options.goniogram.c_step_deg = goniogram.c_step_deg;
        put(&mut options.goniogram.smoothing, goniogram.smoothing);
        put(&mut options.artifacts.spectra, self.artifacts.spectra.map(Spectra::spectra));
        put(&mut options.artifacts.ies_edition, self.artifacts.ies_edition.map(IesEdition::edition));
        options.validate()?;
        Ok(options)
    }
}

fn put<T>(place: &mut T, choice: Option<T>) {
    if let Some(choice) = choice {
        *place = choice;
    }
}

impl AxisName {
    fn axis(self) -> Axis {
        match self {
            AxisName::PosX => Axis::PosX,
            AxisName::NegX => Axis::NegX,
            AxisName::PosY => Axis::PosY,
            AxisName::NegY => Axis::NegY,
            AxisName::PosZ => Axis::PosZ,
            AxisName::NegZ => Axis::NegZ,
        }
    }
}

impl Spectra {
    fn spectra(self) -> pipeline::Spectra {
        match self {
            Spectra::Auto => pipeline::Spectra::Auto,
            Spectra::Both => pipeline::Spectra::Both,
            Spectra::Attributes => pipeline::Spectra::Attributes,
            Spectra::Extras => pipeline::Spectra::Extras,
        }
    }
}

impl IesEdition {
    fn edition(self) -> pipeline::IesEdition {
        match self {
            IesEdition::Lm63Of2002 => pipeline::IesEdition::Lm63Of2002,
            IesEdition::Lm63Of2019 => pipeline::IesEdition::Lm63Of2019,
        }
    }
}
