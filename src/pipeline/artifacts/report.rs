//! `report.json`: what was read, what was done, where every ray went (`openapi/report.schema.json`).

use super::goniograms::{Box3, FrameFacts, LatticeFacts, QualityFacts};
use super::provenance::{DeclaredFacts, GENERATOR, Generator};
use crate::error::Error;
use crate::flux::Balance;
use crate::flux::balance::Share;
use crate::goniogram::Zone;
use crate::hull::Label;
use crate::model::Model;
use crate::model::channel::Origin;
use crate::options::{ArtifactsOptions, FluxOptions, GoniogramOptions, HullOptions, Options as RunOptions};
use crate::vocabulary::declaration::Total;
use crate::vocabulary::notice::Notice;
use crate::vocabulary::units::{Flux, LengthUnit};
use crate::writing::number::{ARRAY_DIGITS, Numbers, sum};
use crate::writing::{Artifact, json};
use serde::Serialize;

/// Name in the zip.
pub const NAME: &str = "report.json";

/// The report; `notices` are those of writing the other artifacts.
///
/// # Errors
/// As [`json::document`].
pub fn artifact(model: &Model, options: &RunOptions, notices: &[Notice]) -> Result<Artifact, Error> {
    let report = Report {
        schema: "urn:lampwright:report:1",
        generator: GENERATOR,
        inputs: model.origins.iter().map(|origin| InputFacts::new(origin, &model.flux)).collect(),
        options: OptionsFacts::new(options),
        flux: FluxFacts::new(&model.flux),
        balance: BalanceFacts::new(&model.surface.balance),
        hull: HullFacts::new(model),
        goniogram: GoniogramFacts::new(model),
        spectrum: SpectrumFacts::new(model),
        notices: model.notices.iter().chain(notices).collect(),
    };
    Ok(Artifact { name: NAME.to_owned(), media_type: "application/json", bytes: json::document(&report)? })
}

#[derive(Serialize)]
struct Report<'a> {
    schema: &'static str,
    generator: Generator,
    inputs: Vec<InputFacts<'a>>,
    options: OptionsFacts<'a>,
    flux: FluxFacts,
    balance: BalanceFacts,
    hull: HullFacts,
    goniogram: GoniogramFacts,
    spectrum: SpectrumFacts<'a>,
    notices: Vec<&'a Notice>,
}

/// Every choice of the caller, defaults included.
#[derive(Serialize)]
struct OptionsFacts<'a> {
    rays: RaysFacts<'a>,
    hull: HullOptions,
    flux: FluxOptions,
    goniogram: GoniogramOptions,
    artifacts: ArtifactsOptions,
}

#[derive(Serialize)]
struct RaysFacts<'a> {
    band_edges_nm: &'a Option<Vec<f64>>,
    total: Option<Total>,
}

impl<'a> OptionsFacts<'a> {
    fn new(options: &'a RunOptions) -> OptionsFacts<'a> {
        let RunOptions { hull, flux, goniogram, artifacts, .. } = options.with_defaults();
        let rays = RaysFacts { band_edges_nm: &options.rays.band_edges_nm, total: options.rays.total };
        OptionsFacts { rays, hull, flux, goniogram, artifacts }
    }
}

#[derive(Serialize)]
struct FluxFacts {
    #[serde(rename = "radiant_W")]
    radiant_w: Option<f64>,
    luminous_lm: Option<f64>,
}

impl FluxFacts {
    fn new(flux: &Flux) -> FluxFacts {
        FluxFacts { radiant_w: flux.radiant_w.map(sum), luminous_lm: flux.luminous_lm.map(sum) }
    }
}

#[derive(Serialize)]
struct InputFacts<'a> {
    name: &'a str,
    channel: &'a str,
    sha256: &'a str,
    byte_count: u64,
    format: &'a str,
    ray_count: u64,
    rays_used: u64,
    flux: FluxFacts,
    /// Of the source's flux: W where the source's are known, else lm.
    share: f64,
    length_unit: Option<&'static str>,
    spectrum: InputSpectrumFacts,
    declared: DeclaredFacts,
    header_flux: FluxFacts,
    /// In W and lm, or in the file's own relative unit.
    ray_sum: FluxFacts,
    header_over_sum: Option<f64>,
    texts: Vec<Text<'a>>,
}

#[derive(Serialize)]
struct Text<'a> {
    name: &'a str,
    value: &'a str,
}

/// Where a channel's spectrum is from.
#[derive(Serialize)]
struct InputSpectrumFacts {
    source: &'static str,
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

#[derive(Serialize)]
struct ShareFacts {
    rays: u64,
    flux: FluxFacts,
}

impl ShareFacts {
    fn new(share: &Share) -> ShareFacts {
        ShareFacts { rays: share.rays, flux: FluxFacts::new(&share.flux) }
    }
}

/// Incoming = hit + snapped + rejected, in rays and in flux; what is not rejected lies on triangles and on vertices.
#[derive(Serialize)]
struct BalanceFacts {
    incoming: ShareFacts,
    hit: ShareFacts,
    snapped: ShareFacts,
    rejected: ShareFacts,
    on_triangles: FluxFacts,
    on_vertices: FluxFacts,
    after_smoothing: FluxFacts,
}

impl BalanceFacts {
    fn new(balance: &Balance) -> BalanceFacts {
        BalanceFacts {
            incoming: ShareFacts::new(&balance.incoming),
            hit: ShareFacts::new(&balance.hit),
            snapped: ShareFacts::new(&balance.snapped),
            rejected: ShareFacts::new(&balance.rejected),
            on_triangles: FluxFacts::new(&balance.on_triangles),
            on_vertices: FluxFacts::new(&balance.on_vertices),
            after_smoothing: FluxFacts::new(&balance.after_smoothing),
        }
    }
}

#[derive(Serialize)]
struct HullFacts {
    vertices: usize,
    triangles: usize,
    projected: usize,
    stitched: usize,
    filled: usize,
    parts: usize,
    area_mm2: f64,
    bounds_mm: Box3,
    resolution: u32,
    cell_mm: [f64; 3],
    max_edge_mm: f64,
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

#[derive(Serialize)]
struct GoniogramFacts {
    frame: FrameFacts,
    lattice: LatticeFacts,
    grid: GridFacts,
    spectral_grid: GridFacts,
    zones: Vec<ZoneFacts>,
    total: PartFacts,
}

#[derive(Serialize)]
struct GridFacts {
    c_planes: usize,
    gamma_nodes: usize,
    c_step_deg: f64,
    gamma_step_deg: f64,
}

impl GridFacts {
    fn new(grid: &crate::goniogram::SphereGrid) -> GridFacts {
        let (c_planes, gamma_nodes) = (grid.c_planes(), grid.gamma_nodes());
        let (c_step, gamma_step) = (360.0 / c_planes as f64, 180.0 / (gamma_nodes - 1) as f64);
        GridFacts { c_planes, gamma_nodes, c_step_deg: sum(c_step), gamma_step_deg: sum(gamma_step) }
    }
}

#[derive(Serialize)]
struct PartFacts {
    rays: f64,
    flux: FluxFacts,
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

#[derive(Serialize)]
struct ZoneFacts {
    id: u32,
    row: usize,
    column: usize,
    area_mm2: f64,
    #[serde(flatten)]
    part: PartFacts,
}

impl ZoneFacts {
    fn new(zone: &Zone) -> ZoneFacts {
        let part = PartFacts::new(&zone.goniogram);
        ZoneFacts { id: zone.id, row: zone.row, column: zone.column, area_mm2: sum(zone.area_mm2), part }
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

#[derive(Serialize)]
struct SpectrumFacts<'a> {
    basis: &'static str,
    band_edges_nm: Option<Numbers<'a>>,
    /// Share of the radiant flux outside the bands: in the totals, not in the spectra.
    outside_share: Option<f64>,
}

impl<'a> SpectrumFacts<'a> {
    fn new(model: &'a Model) -> SpectrumFacts<'a> {
        let bands = &model.spectral.bands;
        let total = &model.goniograms.total;
        let inside: f64 = total.spectral_flux_w_per_nm.iter().zip(bands.widths_nm()).map(|(w, nm)| w * nm).sum();
        let outside = total.flux.radiant_w.filter(|flux| *flux > 0.0).map(|flux| (1.0 - inside / flux).clamp(0.0, 1.0));
        SpectrumFacts {
            basis: model.spectral.basis(),
            band_edges_nm: model.spectral.has_bands().then(|| Numbers(bands.edges_nm(), ARRAY_DIGITS)),
            // What is below 1e-9 is rounding.
            outside_share: outside.filter(|_| model.spectral.has_bands()).map(|share| (share * 1e9).round() / 1e9),
        }
    }
}
