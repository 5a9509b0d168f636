//! `goniograms.json`: the angular half of the contract (`openapi/goniograms.schema.json`). Units are in the keys.

use super::facts::{Box3, FrameFacts, LatticeFacts, QualityFacts, Spectrum, spectral_basis};
use super::plots::polar;
use super::provenance::{GENERATOR, Generator, Provenance, source_name};
use super::{ies, ldt};
use crate::error::Error;
use crate::goniogram::{Goniogram, SphereGrid, Zone};
use crate::model::Model;
use crate::options::Options as RunOptions;
use crate::source::{Columns, Spectral};
use crate::writing::number::{ARRAY_DIGITS, Matrix, Numbers, sum};
use crate::writing::{Artifact, json};
use schemars::JsonSchema;
use serde::Serialize;

/// Name in the zip.
pub const NAME: &str = "goniograms.json";
/// What the document calls its schema.
pub(super) const URN: &str = "urn:lampwright:goniograms:2";
const FORMAT: &str = "emitter-goniograms";
const CELLS: &str =
    "node-centred: a node's cell reaches halfway to its neighbours; the pole cells are caps shared by all C";
const INTERPOLATION: &str = "bilinear in C and gamma";
/// How spectral intensities are written.
pub(super) const ENCODING: &str = "dense";
pub(super) const ORDER: &str = "c, gamma, band";
const UNIT: &str = "W/(sr nm)";

/// The document.
///
/// # Errors
/// As [`json::document`].
pub fn artifact(model: &Model, options: &RunOptions) -> Result<Artifact, Error> {
    let goniograms = &model.goniograms;
    let document = Document {
        schema: URN,
        format: FORMAT,
        version: "2.0",
        generator: GENERATOR,
        source: SourceFacts::new(model),
        frame: FrameFacts::new(&goniograms.frame),
        lattice: LatticeFacts::new(model),
        grid: Grid::new(&goniograms.grid),
        spectrum: model.spectral.has_bands().then(|| Spectrum::new(model)),
        observer: if model.ancestors.is_empty() { observer(&model.spectral.columns) } else { "as the models have it" },
        zones: zone_entries(model),
        total: Entry::new(&goniograms.total, model, Some([ies::TOTAL, ldt::TOTAL, polar::TOTAL].map(str::to_owned))),
        provenance: Provenance::new(model, options),
    };
    Ok(Artifact { name: NAME.to_owned(), media_type: "application/json", bytes: json::document(&document)? })
}

fn zone_entries(model: &Model) -> Vec<ZoneEntry<'_>> {
    let with_files = model.goniograms.zones_with_files();
    let entry = |zone| ZoneEntry::new(zone, model, with_files.contains(&zone.id));
    model.goniograms.zones.iter().map(entry).collect()
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

/// Far-field intensity of each zone of an emitter on a (C, gamma) grid, luminous and radiant, with spectra. Every number's
/// unit is in its key's suffix (_deg, _nm, _mm, _cd, _sr, _W_per_sr, _lm, _W).
#[derive(Serialize, JsonSchema)]
#[schemars(title = "Zonal spectral goniograms of a light source", extend("$id" = URN))]
pub(super) struct Document<'a> {
    /// Which schema this follows; another number means a change that breaks readers.
    #[schemars(extend("const" = URN))]
    schema: &'static str,
    /// What kind of file this is.
    #[schemars(extend("const" = FORMAT))]
    format: &'static str,
    /// Edition of the format; what readers compare is schema.
    #[schemars(regex(pattern = r"^2\.[0-9]+$"))]
    version: &'static str,
    /// Who made it.
    generator: Generator,
    /// The whole of what was read.
    source: SourceFacts,
    /// The photometric frame that C and gamma are measured in.
    frame: FrameFacts,
    /// Where the zones lie.
    lattice: Option<LatticeFacts>,
    /// Where intensities are given.
    grid: Grid,
    /// The bands of every spectral number; left out where no spectrum is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Spectrum")]
    spectrum: Option<Spectrum>,
    /// How lumens came about.
    observer: &'static str,
    /// The goniogram of each zone; the index is the zone's id.
    #[schemars(length(min = 1))]
    zones: Vec<ZoneEntry<'a>>,
    /// The goniogram of the whole source.
    total: Entry<'a>,
    /// What makes the same bytes again.
    provenance: Provenance<'a>,
}

/// The whole of what was read.
#[derive(Serialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
struct SourceFacts {
    /// Names of the files, joined by " + ".
    name: String,
    /// Rays in the files.
    ray_count: u64,
    /// Rays that cannot be used: without flux, or impossible.
    rays_dropped: u64,
    /// Radiant flux of the usable rays, W; null where it cannot be known without guessing.
    #[serde(rename = "flux_W")]
    #[schemars(range(min = 0))]
    flux_w: Option<f64>,
    /// Luminous flux of the usable rays, lm; null where it cannot be known without guessing.
    #[schemars(range(min = 0))]
    flux_lm: Option<f64>,
    /// What spectral results are made from.
    #[schemars(extend("enum" = Spectral::BASES))]
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
            spectral_basis: spectral_basis(model),
        }
    }
}

/// Where intensities are given.
#[derive(Serialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
struct Grid {
    /// Nodes, increasing, first 0, last below 360 (360 is 0); one node: axially symmetric.
    #[schemars(length(min = 1))]
    c_deg: Vec<f64>,
    /// Nodes, increasing, first 0, last 180; in a narrow beam closer together.
    #[schemars(length(min = 1))]
    gamma_deg: Vec<f64>,
    /// After these degrees C begins again.
    #[schemars(extend("const" = 360))]
    c_period_deg: u32,
    /// How nodes stand for solid angles.
    #[schemars(extend("const" = CELLS))]
    cells: &'static str,
    /// Solid angle of the cell of each node of gamma, for one C plane. Their sum times the number of C planes is 4 pi; the sum
    /// of intensity times it is the flux.
    #[schemars(inner(range(min = 0)))]
    solid_angle_sr: Vec<f64>,
    /// What holds between nodes.
    #[schemars(extend("const" = INTERPOLATION))]
    interpolation: &'static str,
    /// Integral over the sphere of the hat function of each node of gamma, for one C plane. They sum to 4 pi likewise; the sum
    /// of intensity times it is what the interpolated distribution integrates to.
    #[schemars(inner(range(min = 0)))]
    interpolation_weight_sr: Vec<f64>,
}

impl Grid {
    fn new(grid: &SphereGrid) -> Grid {
        let sums = |values: Vec<f64>| values.into_iter().map(sum).collect::<Vec<f64>>();
        Grid {
            c_deg: sums(grid.c_deg()),
            gamma_deg: sums(grid.gamma_deg()),
            c_period_deg: 360,
            cells: CELLS,
            solid_angle_sr: sums(grid.plane_solid_angles_sr()),
            interpolation: INTERPOLATION,
            interpolation_weight_sr: sums(grid.interpolation_weights_sr()),
        }
    }
}

/// A zone and its goniogram.
#[derive(Serialize, JsonSchema)]
struct ZoneEntry<'a> {
    /// Its index in zones; what the glTF attribute _ZONES holds.
    id: u32,
    /// Its row in the lattice, counted from 0 along photometric y; null where zones follow the surface.
    row: Option<usize>,
    /// Its column in the lattice, counted from 0 along photometric x; null where zones follow the surface.
    column: Option<usize>,
    /// Box of its vertices.
    bounds_mm: Box3,
    /// Flux-weighted mean of its vertices, source frame, mm.
    centroid_mm: [f64; 3],
    /// Area of the surface that its vertices stand for, mm2.
    #[schemars(range(min = 0))]
    area_mm2: f64,
    /// Vertices of the surface in it.
    vertex_count: usize,
    #[serde(flatten)]
    entry: Entry<'a>,
}

impl<'a> ZoneEntry<'a> {
    fn new(zone: &'a Zone, model: &'a Model, has_files: bool) -> ZoneEntry<'a> {
        let files = has_files.then(|| [ies::zone_name(zone), ldt::zone_name(zone), polar::zone_name(zone)]);
        ZoneEntry {
            id: zone.id,
            row: zone.place.map(|place| place.row),
            column: zone.place.map(|place| place.column),
            bounds_mm: Box3::new(&zone.bounds_mm),
            centroid_mm: zone.centroid_mm.to_array().map(sum),
            area_mm2: sum(zone.area_mm2),
            vertex_count: zone.vertex_count,
            entry: Entry::new(&zone.goniogram, model, files),
        }
    }
}

/// A goniogram: luminous intensity, radiant intensity, or both.
#[derive(Serialize, JsonSchema)]
#[schemars(extend("anyOf" = [{"required": ["luminous_intensity_cd"]}, {"required": ["radiant_intensity_W_per_sr"]}]))]
struct Entry<'a> {
    /// Rays in it; a ray shared between zones counts by its shares.
    #[schemars(range(min = 0))]
    ray_count: f64,
    /// Radiant flux, W; null where it cannot be known without guessing.
    #[serde(rename = "flux_W")]
    #[schemars(range(min = 0))]
    flux_w: Option<f64>,
    /// Luminous flux, lm; null where it cannot be known without guessing.
    #[schemars(range(min = 0))]
    flux_lm: Option<f64>,
    /// The largest intensity: luminous where known, else radiant.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "MaxIntensity")]
    max_intensity: Option<MaxIntensity>,
    /// What the statistics allow to say.
    quality: QualityFacts,
    /// Files of it in the zip; left out where there are too many zones for each to have some.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Files")]
    files: Option<Files>,
    /// Spectral flux, W/nm, one number per band.
    #[serde(skip_serializing_if = "Option::is_none", rename = "spectral_flux_W_per_nm")]
    #[schemars(with = "Vec<f64>", inner(range(min = 0)))]
    spectral_flux_w_per_nm: Option<Numbers<'a>>,
    /// Luminous intensity, cd: [c][gamma] over grid.c_deg and grid.gamma_deg.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Vec<Vec<f64>>", inner(inner(range(min = 0))))]
    luminous_intensity_cd: Option<Matrix<'a>>,
    /// Radiant intensity, W/sr: [c][gamma] over grid.c_deg and grid.gamma_deg.
    #[serde(skip_serializing_if = "Option::is_none", rename = "radiant_intensity_W_per_sr")]
    #[schemars(with = "Vec<Vec<f64>>", inner(inner(range(min = 0))))]
    radiant_intensity_w_per_sr: Option<Matrix<'a>>,
    /// Intensity by band; left out where the light has one spectrum in all directions.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Dense")]
    spectral_intensity: Option<Dense<'a>>,
}

/// Paths in the zip.
#[derive(Serialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
struct Files {
    /// LM-63; left out where luminous intensity is unknown.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "String")]
    ies: Option<String>,
    /// EULUMDAT; left out likewise.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "String")]
    ldt: Option<String>,
    /// Polar chart.
    svg: String,
}

impl<'a> Entry<'a> {
    fn new(goniogram: &'a Goniogram, model: &'a Model, files: Option<[String; 3]>) -> Entry<'a> {
        let grid = &model.goniograms.grid;
        let matrix = |values: &'a Option<Vec<f64>>| values.as_ref().map(|values| Matrix(values, grid.gamma_nodes()));
        let has_bands = model.spectral.has_bands();
        Entry {
            ray_count: sum(goniogram.rays),
            flux_w: goniogram.flux.radiant_w.map(sum),
            flux_lm: goniogram.flux.luminous_lm.map(sum),
            max_intensity: MaxIntensity::new(goniogram, grid),
            quality: QualityFacts::new(goniogram),
            files: files.map(|[ies, ldt, svg]| {
                let if_visible = |name| model.is_visible().then_some(name);
                Files { ies: if_visible(ies), ldt: if_visible(ldt), svg }
            }),
            spectral_flux_w_per_nm: has_bands.then(|| Numbers(&goniogram.spectral_flux_w_per_nm, ARRAY_DIGITS)),
            luminous_intensity_cd: matrix(&goniogram.luminous_cd),
            radiant_intensity_w_per_sr: matrix(&goniogram.radiant_w_per_sr),
            spectral_intensity: (!goniogram.spectral_w_per_sr_nm.is_empty()).then(|| Dense::new(goniogram, model)),
        }
    }
}

/// The node of the largest intensity, the first of equal ones.
#[derive(Serialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
struct MaxIntensity {
    /// Luminous, cd; left out where it is unknown.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "f64", range(min = 0))]
    value_cd: Option<f64>,
    /// Radiant, W/sr; left out where luminous intensity is known.
    #[serde(skip_serializing_if = "Option::is_none", rename = "value_W_per_sr")]
    #[schemars(with = "f64", range(min = 0))]
    value_w_per_sr: Option<f64>,
    /// Its C.
    #[schemars(range(min = 0))]
    c_deg: f64,
    /// Its gamma.
    #[schemars(range(min = 0))]
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
            gamma_deg: sum(grid.gamma_deg()[at % grid.gamma_nodes()]),
        })
    }
}

/// Spectral intensity: a number for each node of its own, coarser grid and each band.
#[derive(Serialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
struct Dense<'a> {
    /// All numbers in one list.
    #[schemars(extend("const" = ENCODING))]
    encoding: &'static str,
    /// The last index runs fastest.
    #[schemars(extend("const" = ORDER))]
    order: &'static str,
    /// Unit of the values.
    #[schemars(extend("const" = UNIT))]
    unit: &'static str,
    /// Number of C planes, of nodes of gamma, of bands.
    #[schemars(inner(range(min = 1)))]
    shape: [usize; 3],
    /// Its own, coarser grid.
    grid: Grid,
    /// The numbers, in that order.
    #[schemars(with = "Vec<f64>", inner(range(min = 0)))]
    values: Numbers<'a>,
}

impl<'a> Dense<'a> {
    fn new(goniogram: &'a Goniogram, model: &Model) -> Dense<'a> {
        let grid = &model.goniograms.spectral_grid;
        Dense {
            encoding: ENCODING,
            order: ORDER,
            unit: UNIT,
            shape: [grid.c_planes(), grid.gamma_nodes(), model.spectral.bands.len()],
            grid: Grid::new(grid),
            values: Numbers(&goniogram.spectral_w_per_sr_nm, ARRAY_DIGITS),
        }
    }
}
