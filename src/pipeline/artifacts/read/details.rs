//! What the two files tell besides what radiance and new rays need: how triangles came to be and what was counted on them, where zones lie,
//! what statistics say, and where the model came from.

use super::StoredModel;
use super::glb::{AGAIN, json_chunk};
use crate::error::Error;
use crate::flux::Amounts;
use crate::goniogram::intensity::Quality;
use crate::goniogram::zone::Place;
use crate::goniogram::{Goniogram, Lattice, Zone};
use crate::hull::Label;
use crate::vocabulary::space::Bounds;
use glam::DVec3;
use serde::Deserialize;
use serde_json::Value;

/// How triangles come to be, by the numbers in the file.
const STAGES: [Label; 3] = [Label::Projected, Label::Stitched, Label::Filled];

#[derive(Deserialize)]
struct Document {
    meshes: Vec<Mesh>,
}

#[derive(Deserialize)]
struct Mesh {
    extras: Extras,
}

#[derive(Deserialize)]
struct Extras {
    emitter: Emitter,
}

#[derive(Deserialize)]
struct Emitter {
    triangle_flux: Vec<Counted>,
    triangle_stage: Stages,
}

#[derive(Deserialize)]
struct Counted {
    unit: String,
    values: Vec<f64>,
}

#[derive(Deserialize)]
struct Stages {
    values: Vec<usize>,
}

#[derive(Deserialize)]
struct Angles {
    source: Source,
    lattice: Option<LatticeEntry>,
    zones: Vec<ZoneEntry>,
    total: Entry,
    provenance: Value,
}

#[derive(Deserialize)]
struct Source {
    ray_count: u64,
    rays_dropped: u64,
}

#[derive(Deserialize)]
struct LatticeEntry {
    columns: usize,
    rows: usize,
    min_mm: [f64; 2],
    max_mm: [f64; 2],
}

#[derive(Deserialize)]
struct Corners {
    min: [f64; 3],
    max: [f64; 3],
}

#[derive(Deserialize)]
struct ZoneEntry {
    row: Option<usize>,
    column: Option<usize>,
    bounds_mm: Corners,
    centroid_mm: [f64; 3],
    area_mm2: f64,
    vertex_count: usize,
    ray_count: f64,
    quality: QualityEntry,
    #[serde(rename = "spectral_flux_W_per_nm", default)]
    spectral_flux_w_per_nm: Vec<f64>,
}

#[derive(Deserialize)]
struct Entry {
    ray_count: f64,
    quality: QualityEntry,
    #[serde(rename = "spectral_flux_W_per_nm", default)]
    spectral_flux_w_per_nm: Vec<f64>,
}

#[derive(Deserialize)]
struct QualityEntry {
    rays_per_cell_median: f64,
    empty_cell_fraction: f64,
    relative_noise_at_peak: f64,
    smoothing_deg: f64,
}

/// What else the files tell of a model.
pub struct Details {
    /// How each triangle came to be.
    pub labels: Vec<Label>,
    /// Flux of the triangles, as counted.
    pub triangles: Amounts,
    /// The zones with their goniograms.
    pub zones: Vec<Zone>,
    /// The goniogram of the whole source.
    pub total: Goniogram,
    /// The lattice of the zones.
    pub lattice: Option<Lattice>,
    /// Rays in the files that it was made of, and those of them that were used.
    pub rays: [u64; 2],
    /// Where it came from, as the files say it.
    pub provenance: Value,
}

fn damaged(error: impl std::fmt::Display) -> Error {
    Error::malformed("model.damaged", format!("emitter.glb is damaged: {error}."), AGAIN)
}

fn wrong(found: impl Into<String>) -> Error {
    Error::malformed("model.goniograms", found, AGAIN)
}

/// What the files tell besides `model`, which was read from them.
///
/// # Errors
/// [`Error::Malformed`] where something of it is missing, or has not one number for each triangle, zone or band.
pub fn of(emitter: &[u8], goniograms: &[u8], model: &StoredModel) -> Result<Details, Error> {
    let json = json_chunk(emitter).ok_or_else(|| damaged("it has no JSON"))?;
    let document: Document = serde_json::from_slice(json).map_err(damaged)?;
    let mesh = document.meshes.into_iter().next().ok_or_else(|| damaged("it has no mesh"))?;
    let Emitter { triangle_flux, triangle_stage } = mesh.extras.emitter;
    let count = model.triangles.len();
    let label = |stage: usize| STAGES.get(stage).copied().ok_or_else(|| damaged("a triangle has no stage"));
    let labels = triangle_stage.values.into_iter().map(label).collect::<Result<Vec<Label>, Error>>()?;
    let flux_in = |unit: &str| triangle_flux.iter().find(|flux| flux.unit == unit).map(|flux| flux.values.clone());
    let triangles =
        Amounts { rays: vec![0.0; count], radiant_w: flux_in("W"), luminous_lm: flux_in("lm"), ..Amounts::none() };
    let fluxes = [&triangles.radiant_w, &triangles.luminous_lm].into_iter().flatten();
    if labels.len() != count || fluxes.into_iter().any(|flux| flux.len() != count) {
        return Err(damaged("triangle_flux or triangle_stage has not one number for each triangle"));
    }
    let angles: Angles = serde_json::from_slice(goniograms)
        .map_err(|error| wrong(format!("goniograms.json cannot be read: {error}.")))?;
    let bands = if model.spectral.has_bands() { model.spectral.bands.len() } else { 0 };
    let spectra = angles.zones.iter().map(|zone| &zone.spectral_flux_w_per_nm);
    let spectra = spectra.chain([&angles.total.spectral_flux_w_per_nm]);
    if angles.zones.len() != model.zones.len() || spectra.into_iter().any(|spectrum| spectrum.len() != bands) {
        return Err(wrong("A zone of goniograms.json has not one spectral flux for each band."));
    }
    let zones = angles.zones.into_iter().zip(&model.zones).enumerate();
    let zones = zones.map(|(id, (entry, goniogram))| entry.zone(id as u32, goniogram)).collect();
    let lattice = angles.lattice.map(|lattice| Lattice {
        frame: model.frame,
        columns: lattice.columns,
        rows: lattice.rows,
        min_mm: lattice.min_mm,
        max_mm: lattice.max_mm,
    });
    let Entry { ray_count, quality, spectral_flux_w_per_nm } = angles.total;
    let total =
        Goniogram { rays: ray_count, quality: quality.quality(), spectral_flux_w_per_nm, ..model.total.clone() };
    let used = angles.source.ray_count.saturating_sub(angles.source.rays_dropped);
    let rays = [angles.source.ray_count, used];
    Ok(Details { labels, triangles, zones, total, lattice, rays, provenance: angles.provenance })
}

impl ZoneEntry {
    fn zone(self, id: u32, goniogram: &Goniogram) -> Zone {
        let goniogram = Goniogram {
            rays: self.ray_count,
            quality: self.quality.quality(),
            spectral_flux_w_per_nm: self.spectral_flux_w_per_nm,
            ..goniogram.clone()
        };
        let place = self.row.zip(self.column).map(|(row, column)| Place { row, column });
        let bounds_mm = Bounds { min: self.bounds_mm.min.into(), max: self.bounds_mm.max.into() };
        let centroid_mm = DVec3::from_array(self.centroid_mm);
        let (area_mm2, vertex_count) = (self.area_mm2, self.vertex_count);
        Zone { id, place, bounds_mm, centroid_mm, area_mm2, vertex_count, goniogram }
    }
}

impl QualityEntry {
    fn quality(self) -> Quality {
        Quality {
            rays_per_cell_median: self.rays_per_cell_median,
            empty_cell_fraction: self.empty_cell_fraction,
            relative_noise_at_peak: self.relative_noise_at_peak,
            smoothing_deg: self.smoothing_deg,
        }
    }
}
