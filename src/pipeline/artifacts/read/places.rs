//! The surface or the volume of `emitter.glb`, and the light of its places.

use super::glb::{AGAIN, Glb, Lattice, Primitive};
use crate::artifacts::gltf::emitter::{self, spectrum_attribute};
use crate::error::Error;
use crate::flux::Amounts;
use crate::goniogram::Mixture;
use crate::goniogram::mixture::MOST;
use crate::source::{Columns, Spectral};
use crate::vocabulary::limits::Limits;
use crate::volume::Volume;
use crate::volume::lattice::VolumeLattice;
use glam::DVec3;

/// By how much the weights of a vertex may miss 1.
const WEIGHTS_MISS: f64 = 1e-3;
/// Longest length, mm: a kilometre and more of lamp is no lamp, and squares of it stay numbers.
const LONGEST_MM: f64 = 1e9;

/// What `emitter.glb` says of places.
pub struct Places {
    /// Vertices, source frame, mm.
    pub vertices_mm: Vec<DVec3>,
    /// Indices into them.
    pub triangles: Vec<[u32; 3]>,
    /// Their light.
    pub vertices: Amounts,
    /// Their zones.
    pub mixtures: Vec<Mixture>,
    /// The volume that the light comes from.
    pub volume: Option<Volume>,
}

fn surface(found: impl Into<String>) -> Error {
    Error::malformed("model.surface", found, AGAIN)
}

fn bad_spectra(found: impl Into<String>) -> Error {
    Error::malformed("model.spectra", found, AGAIN)
}

fn bad_zones(found: impl Into<String>) -> Error {
    Error::malformed("model.zones", found, AGAIN)
}

fn bad_lattice(found: impl Into<String>) -> Error {
    Error::malformed("model.volume", found, AGAIN)
}

impl Places {
    /// Reads them; `zones` is how many zones there are.
    ///
    /// # Errors
    /// As [`super::read`].
    pub fn read(glb: &Glb<'_>, spectral: &Spectral, zones: usize, limits: &Limits) -> Result<Places, Error> {
        let primitive = glb.primitive(0)?;
        let vertices_mm = positions_mm(glb, primitive)?;
        let triangles = glb.triangles(primitive)?;
        if triangles.is_empty() {
            return Err(surface("The surface has no triangles."));
        }
        if triangles.iter().flatten().any(|vertex| *vertex as usize >= vertices_mm.len()) {
            return Err(surface("A triangle of the surface names a vertex that does not exist."));
        }
        let inline = &glb.emitter()?.vertex_spectra;
        let inline = inline.as_ref().and_then(|spectra| Some((spectra.scale?, spectra.values.as_ref()?)));
        let vertices = light(glb, primitive, vertices_mm.len(), spectral, inline, limits)?;
        let mixtures = mixtures(glb, primitive, vertices_mm.len(), zones)?;
        let volume = glb.emitter()?.volume.as_ref().map(|lattice| volume(glb, lattice, spectral, limits));
        Ok(Places { vertices_mm, triangles, vertices, mixtures, volume: volume.transpose()? })
    }
}

fn positions_mm(glb: &Glb<'_>, primitive: &Primitive) -> Result<Vec<DVec3>, Error> {
    let rows = glb.rows::<3>(primitive, "POSITION")?.ok_or_else(|| surface("The surface has no positions."))?;
    let positions_mm: Vec<DVec3> = rows.into_iter().map(|[x, y, z]| 1e3 * DVec3::new(x, -z, y)).collect();
    if positions_mm.iter().any(|position_mm| position_mm.abs().max_element() > LONGEST_MM) {
        return Err(surface("A vertex of the surface is farther than 1000 km away."));
    }
    Ok(positions_mm)
}

/// One number a place, not negative.
fn amounts(glb: &Glb<'_>, primitive: &Primitive, name: &str, count: usize) -> Result<Option<Vec<f64>>, Error> {
    let Some(rows) = glb.rows::<1>(primitive, name)? else { return Ok(None) };
    let values: Vec<f64> = rows.into_iter().map(|[value]| value).collect();
    if values.len() != count || values.iter().any(|value| *value < 0.0) {
        let found = format!("{name} has a negative number, or not one number for each of {count} places.");
        return Err(Error::malformed("model.flux", found, AGAIN));
    }
    Ok(Some(values))
}

/// Flux and spectra of places; `inline` has the spectra, and the W/nm of a unit of them, where they are no attributes.
fn light(
    glb: &Glb<'_>,
    primitive: &Primitive,
    count: usize,
    spectral: &Spectral,
    inline: Option<(f64, &Vec<Vec<f64>>)>,
    limits: &Limits,
) -> Result<Amounts, Error> {
    let radiant_w = amounts(glb, primitive, emitter::FLUX_W, count)?;
    let luminous_lm = amounts(glb, primitive, emitter::FLUX_LM, count)?;
    let column_count = spectral.column_count();
    if count.saturating_mul(column_count) > limits.max_tally_values {
        let found = format!("The spectra of {count} places in {column_count} bands are more than is read.");
        return Err(Error::refused("model.too_large", found, "Build the model with wider bands."));
    }
    let columns = match spectral.columns {
        Columns::Bands => bands(glb, primitive, count, spectral, inline, radiant_w.as_deref())?,
        Columns::Tristimulus => tristimulus(glb, primitive, count)?,
        Columns::None | Columns::Tables { .. } => Vec::new(),
    };
    Ok(Amounts { rays: vec![0.0; count], radiant_w, luminous_lm, columns, column_count })
}

/// W in each band, and the rest of the flux, which lies outside of all bands.
fn bands(
    glb: &Glb<'_>,
    primitive: &Primitive,
    count: usize,
    spectral: &Spectral,
    inline: Option<(f64, &Vec<Vec<f64>>)>,
    radiant_w: Option<&[f64]>,
) -> Result<Vec<f64>, Error> {
    let radiant_w = radiant_w.ok_or_else(|| bad_spectra("There are spectra, and no radiant flux (_FLUX_W)."))?;
    let widths_nm = spectral.bands.widths_nm();
    let stride = widths_nm.len() + 1;
    let mut columns = vec![0.0; count * stride];
    for (band, width_nm) in widths_nm.iter().enumerate() {
        match (amounts(glb, primitive, &spectrum_attribute(band), count)?, inline) {
            (Some(densities), _) => {
                densities
                    .iter()
                    .enumerate()
                    .for_each(|(site, density)| columns[site * stride + band] = density * width_nm);
            }
            (None, Some((scale, rows))) if rows.len() == count && scale > 0.0 && scale.is_finite() => {
                for (site, row) in rows.iter().enumerate() {
                    let value = row.get(band).filter(|value| **value >= 0.0 && value.is_finite());
                    let value =
                        value.ok_or_else(|| bad_spectra("vertex_spectra.values has not one number for each band."))?;
                    columns[site * stride + band] = value * scale * width_nm;
                }
            }
            _ => return Err(bad_spectra("A band has no spectral flux, neither as attribute nor in vertex_spectra.")),
        }
    }
    for (columns, flux) in columns.chunks_exact_mut(stride).zip(radiant_w) {
        let within: f64 = columns.iter().sum();
        columns[stride - 1] = (flux - within).max(0.0);
    }
    Ok(columns)
}

fn tristimulus(glb: &Glb<'_>, primitive: &Primitive, count: usize) -> Result<Vec<f64>, Error> {
    let rows = glb.rows::<3>(primitive, emitter::XYZ_LM)?.unwrap_or_default();
    if rows.len() != count || rows.iter().flatten().any(|value| *value < 0.0) {
        let found = format!("{} does not have three numbers for each of {count} places.", emitter::XYZ_LM);
        return Err(Error::malformed("model.flux", found, AGAIN));
    }
    Ok(rows.concat())
}

fn mixtures(glb: &Glb<'_>, primitive: &Primitive, count: usize, zones: usize) -> Result<Vec<Mixture>, Error> {
    let ids = glb.rows::<MOST>(primitive, emitter::ZONES)?.unwrap_or_default();
    let weights = glb.rows::<MOST>(primitive, emitter::WEIGHTS)?.unwrap_or_default();
    if ids.len() != count || weights.len() != count {
        return Err(bad_zones("Not every vertex has its zones and their weights."));
    }
    let mixture = |(ids, weights): ([f64; MOST], [f64; MOST])| {
        if ids.iter().any(|id| id.fract() != 0.0 || *id < 0.0 || *id >= zones as f64) {
            return Err(bad_zones("A vertex names a zone that goniograms.json does not have."));
        }
        let sum: f64 = weights.iter().sum();
        if weights.iter().any(|weight| *weight < 0.0) || (sum - 1.0).abs() > WEIGHTS_MISS {
            return Err(bad_zones("The zone weights of a vertex are negative, or do not sum to 1."));
        }
        Ok(Mixture { zones: ids.map(|id| id as u32), weights: weights.map(|weight| weight / sum) })
    };
    ids.into_iter().zip(weights).map(mixture).collect()
}

fn volume(glb: &Glb<'_>, facts: &Lattice, spectral: &Spectral, limits: &Limits) -> Result<Volume, Error> {
    let cells = facts.cells.iter().try_fold(1_usize, |product, count| product.checked_mul(*count));
    let cells = cells.filter(|cells| *cells > 0 && *cells <= limits.max_lattice_cells).ok_or_else(|| {
        let found = format!("The lattice of the volume has no cells, or more than {}.", limits.max_lattice_cells);
        Error::refused("model.too_large", found, AGAIN)
    })?;
    let is_length = |mm: &f64| mm.abs() <= LONGEST_MM;
    let sound = facts.min_mm.iter().all(is_length) && facts.pitch_mm.iter().all(|mm| is_length(mm) && *mm > 0.0);
    if !sound {
        return Err(bad_lattice("The corner or the pitch of the lattice of the volume is no length."));
    }
    let sum = facts.lit_runs.iter().try_fold(0_usize, |sum, run| sum.checked_add(*run));
    if sum != Some(cells) {
        return Err(bad_lattice("The runs of dark and lit cells do not sum to all cells."));
    }
    let runs = facts.lit_runs.iter().enumerate();
    let lit = runs.flat_map(|(run, length)| std::iter::repeat_n(run % 2 == 1, *length)).collect();
    let lattice = VolumeLattice::of_cells(facts.min_mm.into(), facts.pitch_mm.into(), facts.cells, lit);
    let nodes = light(glb, glb.primitive(facts.primitive)?, lattice.node_count, spectral, None, limits)?;
    Ok(Volume { volumes_mm3: lattice.volumes_mm3(), lattice, nodes })
}
