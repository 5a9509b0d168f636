//! `goniograms.json`: the angular half of the contract (`openapi/goniograms.schema.json`). Units are in the keys.

use super::ies;
use super::plots::polar;
use super::provenance::{GENERATOR, Generator, Provenance, source_name};
use crate::error::Error;
use crate::goniogram::{Goniogram, SphereGrid, Zone};
use crate::model::Model;
use crate::options::Options as RunOptions;
use crate::source::Columns;
use crate::vocabulary::space::{Bounds, Frame};
use crate::writing::number::{ARRAY_DIGITS, Matrix, Numbers, sum};
use crate::writing::{Artifact, json};
use glam::DVec3;
use serde::Serialize;

/// Name in the zip.
pub const NAME: &str = "goniograms.json";

/// The document.
///
/// # Errors
/// As [`json::document`].
pub fn artifact(model: &Model, options: &RunOptions) -> Result<Artifact, Error> {
    let goniograms = &model.goniograms;
    let document = Document {
        schema: "urn:lampwright:goniograms:1",
        format: "emitter-goniograms",
        version: "1.0",
        generator: GENERATOR,
        source: SourceFacts::new(model),
        frame: FrameFacts::new(&goniograms.frame),
        lattice: LatticeFacts::new(model),
        grid: Grid::new(&goniograms.grid),
        spectrum: model.spectral.has_bands().then(|| Spectrum::new(model)),
        observer: observer(&model.spectral.columns),
        zones: goniograms.zones.iter().map(|zone| ZoneEntry::new(zone, model)).collect(),
        total: Entry::new(&goniograms.total, model, ies::TOTAL.to_owned(), polar::TOTAL.to_owned()),
        provenance: Provenance::new(model, options),
    };
    Ok(Artifact { name: NAME.to_owned(), media_type: "application/json", bytes: json::document(&document)? })
}

/// How lumens came about.
fn observer(columns: &Columns) -> &'static str {
    match columns {
        Columns::Bands => "CIE 1931 2 degree, Km 683 lm/W, applied to each ray at its own wavelength",
        Columns::Tables { .. } => {
            "CIE 1931 2 degree, Km 683 lm/W, applied to the spectral table; the header's own lm/W where it has both totals"
        }
        Columns::None | Columns::Tristimulus => "as the file gives them",
    }
}

#[derive(Serialize)]
struct Document<'a> {
    schema: &'static str,
    format: &'static str,
    version: &'static str,
    generator: Generator,
    source: SourceFacts,
    frame: FrameFacts,
    lattice: LatticeFacts,
    grid: Grid,
    #[serde(skip_serializing_if = "Option::is_none")]
    spectrum: Option<Spectrum>,
    observer: &'static str,
    zones: Vec<ZoneEntry<'a>>,
    total: Entry<'a>,
    provenance: Provenance<'a>,
}

#[derive(Serialize)]
struct SourceFacts {
    name: String,
    ray_count: u64,
    rays_dropped: u64,
    #[serde(rename = "flux_W")]
    flux_w: Option<f64>,
    flux_lm: Option<f64>,
    spectral_basis: &'static str,
}

impl SourceFacts {
    fn new(model: &Model) -> SourceFacts {
        let ray_count = model.origins.iter().map(|origin| origin.ray_count).sum::<u64>();
        let used = model.origins.iter().map(|origin| origin.rays_used).sum::<u64>();
        SourceFacts {
            name: source_name(model),
            ray_count,
            rays_dropped: ray_count.saturating_sub(used),
            flux_w: model.flux.radiant_w.map(sum),
            flux_lm: model.flux.luminous_lm.map(sum),
            spectral_basis: model.spectral.basis(),
        }
    }
}

/// The photometric frame, in words and as vectors.
#[derive(Serialize)]
pub struct FrameFacts {
    convention: &'static str,
    axes_in_source: Axes,
    nadir: &'static str,
    c0: &'static str,
}

#[derive(Serialize)]
struct Axes {
    x: DVec3,
    y: DVec3,
    z: DVec3,
}

impl FrameFacts {
    /// Of a frame.
    pub fn new(frame: &Frame) -> FrameFacts {
        FrameFacts {
            convention: "IES type C / CIE C-gamma: gamma 0 = nadir = -z, gamma 180 = zenith = +z, C 0 = +x, C 90 = +y, \
                         C counter-clockwise seen from zenith",
            // Adding zero turns -0 into 0.
            axes_in_source: Axes { x: frame.x() + 0.0, y: frame.y() + 0.0, z: frame.z() + 0.0 },
            nadir: frame.nadir.name(),
            c0: frame.c0.name(),
        }
    }
}

/// The zone lattice in the plane of photometric x and y.
#[derive(Serialize)]
pub struct LatticeFacts {
    columns: usize,
    rows: usize,
    min_mm: [f64; 2],
    max_mm: [f64; 2],
}

impl LatticeFacts {
    /// Of a model.
    pub fn new(model: &Model) -> LatticeFacts {
        let lattice = &model.goniograms.lattice;
        let (columns, rows) = (lattice.columns, lattice.rows);
        LatticeFacts { columns, rows, min_mm: lattice.min_mm.map(sum), max_mm: lattice.max_mm.map(sum) }
    }
}

#[derive(Serialize)]
struct Grid {
    c_deg: Vec<f64>,
    gamma_deg: Vec<f64>,
    c_period_deg: u32,
    cells: &'static str,
    solid_angle_sr: Vec<f64>,
    interpolation: &'static str,
    interpolation_weight_sr: Vec<f64>,
}

impl Grid {
    fn new(grid: &SphereGrid) -> Grid {
        let sums = |values: Vec<f64>| values.into_iter().map(sum).collect::<Vec<f64>>();
        Grid {
            c_deg: sums(grid.c_deg()),
            gamma_deg: sums(grid.gamma_deg()),
            c_period_deg: 360,
            cells: "node-centred: a node's cell reaches halfway to its neighbours; the pole cells are caps shared by all C",
            solid_angle_sr: sums(grid.plane_solid_angles_sr()),
            interpolation: "bilinear in C and gamma",
            interpolation_weight_sr: sums(grid.interpolation_weights_sr()),
        }
    }
}

/// The bands of every spectral number.
#[derive(Serialize)]
pub struct Spectrum {
    wavelength_nm: Vec<f64>,
    band_edges_nm: Vec<f64>,
}

impl Spectrum {
    /// Of a model.
    pub fn new(model: &Model) -> Spectrum {
        let bands = &model.spectral.bands;
        Spectrum { wavelength_nm: bands.centers_nm(), band_edges_nm: bands.edges_nm().to_vec() }
    }
}

#[derive(Serialize)]
struct ZoneEntry<'a> {
    id: u32,
    row: usize,
    column: usize,
    bounds_mm: Box3,
    centroid_mm: [f64; 3],
    area_mm2: f64,
    vertex_count: usize,
    #[serde(flatten)]
    entry: Entry<'a>,
}

impl<'a> ZoneEntry<'a> {
    fn new(zone: &'a Zone, model: &'a Model) -> ZoneEntry<'a> {
        ZoneEntry {
            id: zone.id,
            row: zone.row,
            column: zone.column,
            bounds_mm: Box3::new(&zone.bounds_mm),
            centroid_mm: zone.centroid_mm.to_array().map(sum),
            area_mm2: sum(zone.area_mm2),
            vertex_count: zone.vertex_count,
            entry: Entry::new(&zone.goniogram, model, ies::zone_name(zone), polar::zone_name(zone)),
        }
    }
}

/// A box, source frame, mm.
#[derive(Serialize)]
pub struct Box3 {
    min: [f64; 3],
    max: [f64; 3],
}

impl Box3 {
    /// Of bounds.
    pub fn new(bounds: &Bounds) -> Box3 {
        Box3 { min: bounds.min.to_array().map(sum), max: bounds.max.to_array().map(sum) }
    }
}

#[derive(Serialize)]
struct Entry<'a> {
    ray_count: f64,
    #[serde(rename = "flux_W")]
    flux_w: Option<f64>,
    flux_lm: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    max_intensity: Option<MaxIntensity>,
    quality: QualityFacts,
    files: Files,
    #[serde(skip_serializing_if = "Option::is_none")]
    #[serde(rename = "spectral_flux_W_per_nm")]
    spectral_flux_w_per_nm: Option<Numbers<'a>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    luminous_intensity_cd: Option<Matrix<'a>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    #[serde(rename = "radiant_intensity_W_per_sr")]
    radiant_intensity_w_per_sr: Option<Matrix<'a>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    spectral_intensity: Option<Dense<'a>>,
}

#[derive(Serialize)]
struct Files {
    #[serde(skip_serializing_if = "Option::is_none")]
    ies: Option<String>,
    svg: String,
}

impl<'a> Entry<'a> {
    fn new(goniogram: &'a Goniogram, model: &'a Model, ies: String, svg: String) -> Entry<'a> {
        let grid = &model.goniograms.grid;
        let matrix = |values: &'a Option<Vec<f64>>| values.as_ref().map(|values| Matrix(values, grid.gamma_nodes()));
        let has_bands = model.spectral.has_bands();
        Entry {
            ray_count: sum(goniogram.rays),
            flux_w: goniogram.flux.radiant_w.map(sum),
            flux_lm: goniogram.flux.luminous_lm.map(sum),
            max_intensity: MaxIntensity::new(goniogram, grid),
            quality: QualityFacts::new(goniogram),
            files: Files { ies: model.is_visible().then_some(ies), svg },
            spectral_flux_w_per_nm: has_bands.then(|| Numbers(&goniogram.spectral_flux_w_per_nm, ARRAY_DIGITS)),
            luminous_intensity_cd: matrix(&goniogram.luminous_cd),
            radiant_intensity_w_per_sr: matrix(&goniogram.radiant_w_per_sr),
            spectral_intensity: has_bands.then(|| Dense::new(goniogram, model)),
        }
    }
}

#[derive(Serialize)]
struct MaxIntensity {
    #[serde(skip_serializing_if = "Option::is_none")]
    value_cd: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    #[serde(rename = "value_W_per_sr")]
    value_w_per_sr: Option<f64>,
    c_deg: f64,
    gamma_deg: f64,
}

impl MaxIntensity {
    /// Of the luminous intensity where known, else of the radiant.
    fn new(goniogram: &Goniogram, grid: &SphereGrid) -> Option<MaxIntensity> {
        let values = goniogram.luminous_cd.as_ref().or(goniogram.radiant_w_per_sr.as_ref())?;
        // The first of equal values, so that the answer is one.
        let (at, value) = values.iter().enumerate().rev().max_by(|a, b| a.1.total_cmp(b.1))?;
        let luminous = goniogram.luminous_cd.is_some();
        Some(MaxIntensity {
            value_cd: luminous.then(|| sum(*value)),
            value_w_per_sr: (!luminous).then(|| sum(*value)),
            c_deg: sum((at / grid.gamma_nodes()) as f64 * 360.0 / grid.c_planes() as f64),
            gamma_deg: sum((at % grid.gamma_nodes()) as f64 * 180.0 / (grid.gamma_nodes() - 1) as f64),
        })
    }
}

/// What the statistics of a goniogram allow to say.
#[derive(Serialize)]
pub struct QualityFacts {
    rays_per_cell_median: f64,
    empty_cell_fraction: f64,
    relative_noise_at_peak: f64,
    smoothing_deg: f64,
}

impl QualityFacts {
    /// Of a goniogram.
    pub fn new(goniogram: &Goniogram) -> QualityFacts {
        let quality = &goniogram.quality;
        QualityFacts {
            rays_per_cell_median: sum(quality.rays_per_cell_median),
            empty_cell_fraction: sum(quality.empty_cell_fraction),
            relative_noise_at_peak: sum(quality.relative_noise_at_peak),
            smoothing_deg: sum(quality.smoothing_deg),
        }
    }
}

#[derive(Serialize)]
struct Dense<'a> {
    encoding: &'static str,
    order: &'static str,
    unit: &'static str,
    shape: [usize; 3],
    grid: Grid,
    values: Numbers<'a>,
}

impl<'a> Dense<'a> {
    fn new(goniogram: &'a Goniogram, model: &Model) -> Dense<'a> {
        let grid = &model.goniograms.spectral_grid;
        Dense {
            encoding: "dense",
            order: "c, gamma, band",
            unit: "W/(sr nm)",
            shape: [grid.c_planes(), grid.gamma_nodes(), model.spectral.bands.len()],
            grid: Grid::new(grid),
            values: Numbers(&goniogram.spectral_w_per_sr_nm, ARRAY_DIGITS),
        }
    }
}
