//! `report.json`: what was read, what was done, where every ray went (`openapi/report.schema.json`).

use super::facts::{Box3, FrameFacts, LatticeFacts, QualityFacts};
use super::proof::{EmissionFacts, QualityOfModel};
use super::provenance::{DeclaredFacts, GENERATOR, Generator, ModelFacts, OptionsEcho, models};
use crate::error::Error;
use crate::flux::Balance;
use crate::flux::balance::Share;
use crate::goniogram::Zone;
use crate::hull::Label;
use crate::inspection::findings::SPECTRA;
use crate::model::Model;
use crate::model::channel::Origin;
use crate::options::Options as RunOptions;
use crate::source::Spectral;
use crate::vocabulary::notice::Notice;
use crate::vocabulary::units::{Flux, LengthUnit};
use crate::volume::Volume;
use crate::writing::number::{ARRAY_DIGITS, Numbers, sum};
use crate::writing::schema::{SHA256, WHOLE};
use crate::writing::{Artifact, json};
use schemars::JsonSchema;
use serde::Serialize;

/// Name in the zip.
pub const NAME: &str = "report.json";
/// What the document calls its schema.
const URN: &str = "urn:lampwright:report:2";

/// The report; `notices` are those of writing the other artifacts.
///
/// # Errors
/// As [`json::document`].
pub fn artifact(model: &Model, options: &RunOptions, notices: &[Notice]) -> Result<Artifact, Error> {
    let report = Report {
        schema: URN,
        generator: GENERATOR,
        inputs: model.origins.iter().map(|origin| InputFacts::new(origin, &model.flux)).collect(),
        options: OptionsEcho::new(options),
        models: models(model),
        flux: FluxFacts::new(&model.flux),
        balance: BalanceFacts::new(&model.surface.balance, model.volume.as_ref()),
        hull: HullFacts::new(model),
        emission: model.study.as_ref().map(EmissionFacts::new),
        quality: model.study.as_ref().filter(|study| !study.figures.is_empty()).map(QualityOfModel::new),
        goniogram: GoniogramFacts::new(model),
        spectrum: SpectrumFacts::new(model),
        notices: model.notices.iter().chain(notices).collect(),
    };
    Ok(Artifact { name: NAME.to_owned(), media_type: "application/json", bytes: json::document(&report)? })
}

/// What was read, what was done, where every ray and every watt went.
#[derive(Serialize, JsonSchema)]
#[schemars(title = "Report of a run", extend("$id" = URN))]
pub(super) struct Report<'a> {
    /// Which schema this follows; another number means a change that breaks readers.
    #[schemars(extend("const" = URN))]
    schema: &'static str,
    /// Who made it.
    generator: Generator,
    /// What was read: one entry per channel; of a combination one per model, whose sha256 and byte_count are those of its emitter.glb.
    #[schemars(length(min = 1))]
    inputs: Vec<InputFacts<'a>>,
    /// Every option of the run; null: chosen by the program, and the choice is below.
    options: OptionsEcho<'a>,
    /// What was changed of each model of a combination, in the order of inputs; left out where inputs are ray files.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Vec<ModelFacts>")]
    models: Option<Vec<ModelFacts<'a>>>,
    /// Flux of the usable rays.
    flux: FluxFacts,
    /// Where every ray and every watt went.
    balance: BalanceFacts,
    /// The surface the light leaves from.
    hull: HullFacts,
    /// On which surface the light was put, and why; null where there were too few rays to compare surfaces.
    emission: Option<EmissionFacts>,
    /// How good a model of this kind, made of a part of the rays, is when the other rays judge it; null where there were too few.
    quality: Option<QualityOfModel>,
    /// Where the light goes.
    goniogram: GoniogramFacts,
    /// What is known of the spectrum.
    spectrum: SpectrumFacts<'a>,
    /// What was repaired, dropped or not written, and what an inspection of each channel warns of.
    notices: Vec<&'a Notice>,
}

/// A flux; null where it cannot be known without guessing.
#[derive(Serialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
struct FluxFacts {
    /// Radiant flux, W.
    #[serde(rename = "radiant_W")]
    #[schemars(range(min = 0))]
    radiant_w: Option<f64>,
    /// Luminous flux, lm.
    #[schemars(range(min = 0))]
    luminous_lm: Option<f64>,
}

impl FluxFacts {
    fn new(flux: &Flux) -> FluxFacts {
        FluxFacts { radiant_w: flux.radiant_w.map(sum), luminous_lm: flux.luminous_lm.map(sum) }
    }
}

/// A channel: a ray file and its part in the source.
#[derive(Serialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
struct InputFacts<'a> {
    /// Name of the file.
    name: &'a str,
    /// What the user calls the channel; else the file's name.
    channel: &'a str,
    /// SHA-256 of the file.
    #[schemars(regex(pattern = SHA256))]
    sha256: &'a str,
    /// Length of the file, bytes.
    byte_count: u64,
    /// The format it was read as, e.g. "IES TM-25".
    format: &'a str,
    /// Rays in the file.
    ray_count: u64,
    /// Rays of it that can be used.
    rays_used: u64,
    /// What the channel gives to the source.
    flux: FluxFacts,
    /// Share of the source's flux: of W where the source's are known, else of lm.
    #[schemars(range(min = 0, max = WHOLE))]
    share: f64,
    /// Unit the positions were read in.
    #[schemars(extend("enum" = LengthUnit::symbols_and_null()))]
    length_unit: Option<&'static str>,
    /// Where its spectrum is from.
    spectrum: InputSpectrumFacts,
    /// What the user said of it.
    declared: DeclaredFacts,
    /// Totals in the file's header.
    header_flux: FluxFacts,
    /// Sum of the stored ray values: W and lm, or in the file's own relative unit.
    ray_sum: FluxFacts,
    /// The header's total over the sum of the rays; null where either is unknown.
    #[schemars(range(min = 0))]
    header_over_sum: Option<f64>,
    /// Texts of the header, in the file's order.
    texts: Vec<Text<'a>>,
}

/// A name and what the file says under it.
#[derive(Serialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
struct Text<'a> {
    /// Name of the field.
    name: &'a str,
    /// Its content.
    value: &'a str,
}

/// Where a channel's spectrum is from.
#[derive(Serialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
struct InputSpectrumFacts {
    /// "declared": the user's, in place of the file's.
    #[schemars(extend("enum" = ["none", "file", "declared"]))]
    source: &'static str,
    /// What the rays carry of the spectrum.
    #[schemars(extend("enum" = SPECTRA))]
    kind: &'static str,
}

impl<'a> InputFacts<'a> {
    fn new(origin: &'a Origin, source: &Flux) -> InputFacts<'a> {
        InputFacts {
            name: &origin.name,
            channel: &origin.channel,
            sha256: &origin.sha256,
            byte_count: origin.byte_count,
            format: origin.format,
            ray_count: origin.ray_count,
            rays_used: origin.rays_used,
            flux: FluxFacts::new(&origin.flux),
            share: sum(origin.share_of(source)),
            length_unit: origin.length_unit.map(LengthUnit::symbol),
            spectrum: InputSpectrumFacts {
                source: match (&origin.declared.spectrum, origin.spectrum) {
                    (Some(_), _) => "declared",
                    (None, "none") => "none",
                    (None, _) => "file",
                },
                kind: origin.spectrum,
            },
            declared: DeclaredFacts::new(origin),
            header_flux: FluxFacts::new(&origin.header_flux),
            ray_sum: FluxFacts::new(&origin.ray_sum),
            header_over_sum: origin.header_over_sum.map(sum),
            texts: origin.texts.iter().map(|(name, value)| Text { name, value }).collect(),
        }
    }
}

/// Rays and what they carry.
#[derive(Serialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
struct ShareFacts {
    /// How many rays.
    rays: u64,
    /// Their flux.
    flux: FluxFacts,
}

impl ShareFacts {
    fn new(share: &Share) -> ShareFacts {
        ShareFacts { rays: share.rays, flux: FluxFacts::new(&share.flux) }
    }
}

/// Incoming = hit + snapped + rejected, in rays and in flux; the flux of hit + snapped = on_triangles = on_vertices =
/// after_smoothing.
#[derive(Serialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
struct BalanceFacts {
    /// All usable rays.
    incoming: ShareFacts,
    /// Rays whose line meets the surface.
    hit: ShareFacts,
    /// Rays laid on the nearest triangle, because their line meets none.
    snapped: ShareFacts,
    /// Rays that are farther from the surface than the tolerance; their flux is not in the model.
    rejected: ShareFacts,
    /// Flux on the triangles.
    on_triangles: FluxFacts,
    /// Flux on the vertices, before smoothing.
    on_vertices: FluxFacts,
    /// Flux on the vertices, after smoothing: the model's.
    after_smoothing: FluxFacts,
    /// Flux of the nodes of the volume, after smoothing: the model's; null where the light is put on a surface.
    in_volume: Option<FluxFacts>,
}

impl BalanceFacts {
    fn new(balance: &Balance, volume: Option<&Volume>) -> BalanceFacts {
        BalanceFacts {
            incoming: ShareFacts::new(&balance.incoming),
            hit: ShareFacts::new(&balance.hit),
            snapped: ShareFacts::new(&balance.snapped),
            rejected: ShareFacts::new(&balance.rejected),
            on_triangles: FluxFacts::new(&balance.on_triangles),
            on_vertices: FluxFacts::new(&balance.on_vertices),
            after_smoothing: FluxFacts::new(&balance.after_smoothing),
            in_volume: volume.map(|volume| FluxFacts::new(&volume.nodes.total())),
        }
    }
}

/// The surface the light leaves from.
#[derive(Serialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
struct HullFacts {
    /// How many vertices.
    vertices: usize,
    /// How many triangles: projected, stitched and filled ones.
    triangles: usize,
    /// Triangles from the views along the axes.
    projected: usize,
    /// Triangles that join the levels of the views.
    stitched: usize,
    /// Triangles completed from their surroundings.
    filled: usize,
    /// Connected parts.
    parts: usize,
    /// Area of all triangles, mm2.
    #[schemars(range(min = 0))]
    area_mm2: f64,
    /// Box of the vertices.
    bounds_mm: Box3,
    /// Cells along the longest edge of the cloud's box.
    resolution: u32,
    /// Size of a cell along x, y and z, mm.
    cell_mm: [f64; 3],
    /// The size filter: longest edge of a stitched or filled triangle, mm.
    #[schemars(range(min = 0))]
    max_edge_mm: f64,
    /// Edges of a single triangle: 0 for a closed surface.
    boundary_edges: usize,
    /// Broken rules, a sentence each; empty for a sound hull.
    broken_rules: Vec<String>,
}

impl HullFacts {
    fn new(model: &Model) -> HullFacts {
        let hull = &model.hull;
        HullFacts {
            vertices: hull.vertices_mm.len(),
            triangles: hull.triangles.len(),
            projected: hull.count(Label::Projected),
            stitched: hull.count(Label::Stitched),
            filled: hull.count(Label::Filled),
            parts: hull.part_count(),
            area_mm2: sum(hull.total_area_mm2()),
            bounds_mm: Box3::new(&hull.bounds_mm()),
            resolution: hull.resolution,
            cell_mm: hull.cell_mm.to_array().map(sum),
            max_edge_mm: sum(hull.max_edge_mm),
            boundary_edges: hull.boundary_edges(),
            broken_rules: hull.check().iter().map(ToString::to_string).collect(),
        }
    }
}

/// Where the light goes.
#[derive(Serialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
struct GoniogramFacts {
    /// The photometric frame.
    frame: FrameFacts,
    /// Where the zones lie.
    lattice: Option<LatticeFacts>,
    /// Grid of luminous and radiant intensities.
    grid: GridFacts,
    /// Grid of spectral intensities.
    spectral_grid: GridFacts,
    /// The zones; the index is the zone's id.
    #[schemars(length(min = 1))]
    zones: Vec<ZoneFacts>,
    /// The whole source.
    total: PartFacts,
}

/// A grid of C and gamma.
#[derive(Serialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
struct GridFacts {
    /// Number of C planes.
    c_planes: usize,
    /// Number of nodes of gamma, 0 and 180 included.
    gamma_nodes: usize,
    /// Step of C, degrees.
    #[schemars(range(min = 0))]
    c_step_deg: f64,
    /// Least step of gamma, degrees: in a narrow beam steps are uneven.
    #[schemars(range(min = 0))]
    gamma_step_deg: f64,
}

impl GridFacts {
    fn new(grid: &crate::goniogram::SphereGrid) -> GridFacts {
        let (c_planes, gamma_nodes) = (grid.c_planes(), grid.gamma_nodes());
        let c_step = 360.0 / c_planes as f64;
        let gamma_step = grid.gamma_deg().windows(2).map(|pair| pair[1] - pair[0]).fold(180.0, f64::min);
        GridFacts { c_planes, gamma_nodes, c_step_deg: sum(c_step), gamma_step_deg: sum(gamma_step) }
    }
}

/// A goniogram's rays and flux.
#[derive(Serialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
struct PartFacts {
    /// Rays in it; a ray shared between zones counts by its shares.
    #[schemars(range(min = 0))]
    rays: f64,
    /// Their flux.
    flux: FluxFacts,
    /// What the statistics allow to say.
    quality: QualityFacts,
}

impl PartFacts {
    fn new(goniogram: &crate::goniogram::Goniogram) -> PartFacts {
        PartFacts {
            rays: sum(goniogram.rays),
            flux: FluxFacts::new(&goniogram.flux),
            quality: QualityFacts::new(goniogram),
        }
    }
}

/// A zone.
#[derive(Serialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
struct ZoneFacts {
    /// Its index in zones.
    id: u32,
    /// Its row in the lattice, counted from 0 along photometric y; null where zones follow the surface.
    row: Option<usize>,
    /// Its column in the lattice, counted from 0 along photometric x; null where zones follow the surface.
    column: Option<usize>,
    /// Area of the surface that its vertices stand for, mm2.
    #[schemars(range(min = 0))]
    area_mm2: f64,
    #[serde(flatten)]
    part: PartFacts,
}

impl ZoneFacts {
    fn new(zone: &Zone) -> ZoneFacts {
        let part = PartFacts::new(&zone.goniogram);
        ZoneFacts {
            id: zone.id,
            row: zone.place.map(|place| place.row),
            column: zone.place.map(|place| place.column),
            area_mm2: sum(zone.area_mm2),
            part,
        }
    }
}

impl GoniogramFacts {
    fn new(model: &Model) -> GoniogramFacts {
        let goniograms = &model.goniograms;
        GoniogramFacts {
            frame: FrameFacts::new(&goniograms.frame),
            lattice: LatticeFacts::new(model),
            grid: GridFacts::new(&goniograms.grid),
            spectral_grid: GridFacts::new(&goniograms.spectral_grid),
            zones: goniograms.zones.iter().map(ZoneFacts::new).collect(),
            total: PartFacts::new(&goniograms.total),
        }
    }
}

/// What is known of the spectrum.
#[derive(Serialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
struct SpectrumFacts<'a> {
    /// What spectral results are made from.
    #[schemars(extend("enum" = Spectral::BASES))]
    basis: &'static str,
    /// Edges of the bands, nm; null without spectral results.
    #[schemars(with = "Option<Vec<f64>>")]
    band_edges_nm: Option<Numbers<'a>>,
    /// Share of the radiant flux outside the bands: in the totals, not in the spectra.
    #[schemars(range(min = 0, max = 1))]
    outside_share: Option<f64>,
}

impl<'a> SpectrumFacts<'a> {
    fn new(model: &'a Model) -> SpectrumFacts<'a> {
        let bands = &model.spectral.bands;
        let total = &model.goniograms.total;
        let inside: f64 = total.spectral_flux_w_per_nm.iter().zip(bands.widths_nm()).map(|(w, nm)| w * nm).sum();
        let outside = total.flux.radiant_w.filter(|flux| *flux > 0.0).map(|flux| (1.0 - inside / flux).clamp(0.0, 1.0));
        SpectrumFacts {
            basis: super::facts::spectral_basis(model),
            band_edges_nm: model.spectral.has_bands().then(|| Numbers(bands.edges_nm(), ARRAY_DIGITS)),
            // What is below 1e-9 is rounding.
            outside_share: outside.filter(|_| model.spectral.has_bands()).map(|share| (share * 1e9).round() / 1e9),
        }
    }
}
