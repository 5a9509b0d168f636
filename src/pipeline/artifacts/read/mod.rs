//! A model back from its own files: `emitter.glb` and `goniograms.json`, by `openapi/README.md` alone. Nothing in them is believed before it
//! was checked: sizes, counts, indices, and that every number is one.

/// The container, its JSON, and what its accessors hold.
mod glb;
/// The surface or the volume, and the light of its places.
mod places;
/// Frame, grids and intensities.
mod angles;
/// What else the files tell.
pub mod details;
#[cfg(test)]
mod tests;

use crate::error::Error;
use crate::flux::Amounts;
use crate::formats::packed::{Packing, packing};
use crate::formats::{GLDF_PRODUCT, START_BYTES, is_gldf_product, no_model, no_model_but_gldf};
use crate::goniogram::{Goniogram, Mixture, SphereGrid};
use crate::hull::Mesh;
use crate::model::evaluation::Evaluator;
use crate::model::light::Light;
use crate::source::{Columns, Spectral};
use crate::vocabulary::limits::Limits;
use crate::vocabulary::space::Frame;
use crate::vocabulary::spectrum::Bands;
use crate::volume::Volume;
use angles::Angles;
use glam::DVec3;
use glb::{AGAIN, Glb};
use places::Places;
use std::io::{Read, Seek, SeekFrom};
use zip::ZipArchive;
use zip::result::ZipError;

/// The two files.
pub const FILES: [&str; 2] = [super::gltf::NAME, super::goniograms::NAME];
/// Most bytes of either file.
pub const MOST_BYTES: u64 = 1 << 30;
/// Most bands.
const MOST_BANDS: usize = 4096;
/// Bands that stand where no spectrum is known, nm.
const VISIBLE_NM: [f64; 2] = [380.0, 780.0];

/// What the two files tell of a model: all that radiance and new rays need.
#[derive(Clone, Debug)]
pub struct StoredModel {
    /// What the source is called.
    pub name: String,
    pub(crate) vertices_mm: Vec<DVec3>,
    pub(crate) triangles: Vec<[u32; 3]>,
    pub(crate) vertices: Amounts,
    pub(crate) mixtures: Vec<Mixture>,
    pub(crate) frame: Frame,
    pub(crate) grid: SphereGrid,
    pub(crate) spectral_grid: SphereGrid,
    pub(crate) zones: Vec<Goniogram>,
    pub(crate) total: Goniogram,
    pub(crate) volume: Option<Volume>,
    pub(crate) spectral: Spectral,
}

impl<'a> From<&'a StoredModel> for Light<'a> {
    fn from(model: &'a StoredModel) -> Light<'a> {
        Light {
            mesh: Mesh { vertices_mm: &model.vertices_mm, triangles: &model.triangles },
            vertices: &model.vertices,
            mixtures: &model.mixtures,
            frame: model.frame,
            grid: &model.grid,
            spectral_grid: &model.spectral_grid,
            zones: model.zones.iter().collect(),
            total: &model.total,
            volume: model.volume.as_ref(),
            spectral: &model.spectral,
        }
    }
}

/// The model that the two files define.
///
/// # Errors
/// [`Error::Malformed`] where they are not what `lampwright` writes, or do not belong together; [`Error::Refused`] where they follow another
/// schema, or are beyond [`Limits::max_tally_values`] or [`Limits::max_lattice_cells`].
pub fn read(emitter: &[u8], goniograms: &[u8], limits: &Limits) -> Result<StoredModel, Error> {
    let glb = Glb::parse(emitter)?;
    let angles = Angles::parse(goniograms)?;
    if glb.emitter()?.frame.frame() != angles.frame {
        let found = "The two files do not belong together: their photometric frames differ.";
        return Err(Error::malformed("model.not_one", found, AGAIN));
    }
    let spectral = spectral(&glb, &angles)?;
    let Places { vertices_mm, triangles, vertices, mixtures, volume } =
        Places::read(&glb, &spectral, angles.zones.len(), limits)?;
    let Angles { name, frame, grid, spectral_grid, zones, total, .. } = angles;
    let spectral_grid = spectral_grid.unwrap_or_else(|| grid.clone());
    let model = StoredModel {
        name,
        vertices_mm,
        triangles,
        vertices,
        mixtures,
        frame,
        grid,
        spectral_grid,
        zones,
        total,
        volume,
        spectral,
    };
    check_light(&model)?;
    Ok(model)
}

/// The bands of both files, which must be the same.
fn spectral(glb: &Glb<'_>, angles: &Angles) -> Result<Spectral, Error> {
    let emitter = glb.emitter()?;
    let edges_nm = emitter.spectrum.as_ref().map(|spectrum| &spectrum.band_edges_nm);
    if edges_nm != angles.band_edges_nm.as_ref() {
        let found = "The two files do not belong together: their spectral bands differ.";
        return Err(Error::malformed("model.not_one", found, AGAIN));
    }
    let columns = match edges_nm {
        Some(_) => Columns::Bands,
        None if emitter.vertex_tristimulus.is_some() => Columns::Tristimulus,
        None => Columns::None,
    };
    let edges_nm = edges_nm.cloned().unwrap_or_else(|| VISIBLE_NM.to_vec());
    let bands = Bands::new(edges_nm).filter(|bands| bands.len() <= MOST_BANDS).ok_or_else(|| {
        let found = "The edges of the spectral bands do not increase, or are more than 4097.";
        Error::malformed("model.bands", found, AGAIN)
    })?;
    Ok(Spectral { bands, columns })
}

/// There is light in a quantity that places and directions both have, and no zone has a flux without directions.
fn check_light(model: &StoredModel) -> Result<(), Error> {
    let evaluator = Evaluator::of_primary(model).ok_or_else(|| {
        let found = "The places have a flux (W, lm) whose intensities goniograms.json does not have.";
        Error::malformed("model.quantity", found, AGAIN)
    })?;
    let flux = evaluator.flux();
    if !(flux > 0.0 && flux.is_finite()) {
        let found = "The model has no light: the fluxes of its places sum to 0, or to no number.";
        return Err(Error::malformed("model.dark", found, AGAIN));
    }
    // A zone without flux is no fault: what smoothing put there goes as the light of the whole source.
    let is_dark = |zone: &Goniogram| {
        let nodes = zone.radiant_w_per_sr.as_ref().or(zone.luminous_cd.as_ref());
        zone.flux.primary() > 0.0 && nodes.is_none_or(|nodes| nodes.iter().all(|intensity| *intensity <= 0.0))
    };
    if let Some(zone) = model.zones.iter().chain([&model.total]).position(is_dark) {
        let found = format!("Goniogram {zone} has a flux and no intensity in goniograms.json.");
        return Err(Error::malformed("model.dark_zone", found, AGAIN));
    }
    Ok(())
}

/// The bytes of `emitter.glb` and `goniograms.json` in a `model.zip`.
///
/// # Errors
/// [`Error::Malformed`], [`Error::Refused`], [`Error::Unreadable`]; `model.not_model` where it is something else, with its name.
pub fn unpack(mut archive: impl Read + Seek) -> Result<[Vec<u8>; 2], Error> {
    let unzipped = |error: ZipError| match error {
        ZipError::Io(error) => Error::Unreadable(error),
        ZipError::FileNotFound => {
            let found = "The archive holds no model: emitter.glb or goniograms.json is missing.";
            let remedy = "Name the model.zip of a job or its folder; of ray files, packed or not, lampwright build makes a model.";
            Error::malformed("model.missing_file", found, remedy)
        }
        other => {
            let found = format!("This is a zip archive that cannot be read: {other}.");
            Error::malformed("model.archive", found, "Fetch the model.zip again; the copy is not complete, or damaged.")
        }
    };
    let mut start = Vec::new();
    archive.by_ref().take(START_BYTES as u64).read_to_end(&mut start)?;
    if packing(&start) != Some(Packing::Zip) {
        return Err(no_model(&start, archive.seek(SeekFrom::End(0))?));
    }
    archive.rewind()?;
    let mut archive = ZipArchive::new(archive).map_err(unzipped)?;
    if archive.by_name(FILES[0]).is_err() {
        let mut product = Vec::new();
        if let Ok(file) = archive.by_name(GLDF_PRODUCT) {
            file.take(START_BYTES as u64).read_to_end(&mut product)?;
        }
        if is_gldf_product(&product) {
            return Err(no_model_but_gldf());
        }
    }
    let mut file = |name: &str| -> Result<Vec<u8>, Error> {
        let mut bytes = Vec::new();
        archive.by_name(name).map_err(unzipped)?.take(MOST_BYTES + 1).read_to_end(&mut bytes)?;
        check_size(name, bytes.len() as u64)?;
        Ok(bytes)
    };
    Ok([file(FILES[0])?, file(FILES[1])?])
}

/// Refuses a file that is larger than any model needs.
///
/// # Errors
/// [`Error::Refused`] above [`MOST_BYTES`].
pub fn check_size(name: &str, bytes: u64) -> Result<(), Error> {
    if bytes <= MOST_BYTES {
        return Ok(());
    }
    let found = format!("{name} is larger than {MOST_BYTES} bytes.");
    Err(Error::refused("model.too_large", found, "Build the model with a lower hull.resolution or wider bands."))
}
