//! `goniograms.json`: frame, grids and intensities.

use super::glb::{AGAIN, Axes, Edges};
use crate::artifacts::goniograms;
use crate::error::Error;
use crate::goniogram::{Goniogram, SphereGrid};
use crate::vocabulary::space::Frame;
use crate::vocabulary::units::Flux;
use serde::Deserialize;

/// By how many degrees a C plane may miss its even place.
const UNEVEN_DEG: f64 = 1e-6;

#[derive(Deserialize)]
struct Document {
    schema: String,
    source: Source,
    frame: Axes,
    grid: Grid,
    spectrum: Option<Edges>,
    zones: Vec<Entry>,
    total: Entry,
}

#[derive(Deserialize)]
struct Source {
    name: String,
}

#[derive(Deserialize, PartialEq)]
struct Grid {
    c_deg: Vec<f64>,
    gamma_deg: Vec<f64>,
}

#[derive(Deserialize)]
struct Entry {
    id: Option<usize>,
    #[serde(rename = "flux_W")]
    flux_w: Option<f64>,
    flux_lm: Option<f64>,
    luminous_intensity_cd: Option<Vec<Vec<f64>>>,
    #[serde(rename = "radiant_intensity_W_per_sr")]
    radiant_intensity_w_per_sr: Option<Vec<Vec<f64>>>,
    spectral_intensity: Option<Dense>,
}

#[derive(Deserialize)]
struct Dense {
    encoding: String,
    order: String,
    grid: Grid,
    values: Vec<f64>,
}

/// What `goniograms.json` says.
pub struct Angles {
    /// What the source is called.
    pub name: String,
    /// The photometric frame.
    pub frame: Frame,
    /// Grid of the luminous and radiant intensities.
    pub grid: SphereGrid,
    /// Grid of the spectral intensities, where there are any.
    pub spectral_grid: Option<SphereGrid>,
    /// Edges of the bands, nm.
    pub band_edges_nm: Option<Vec<f64>>,
    /// The goniogram of each zone.
    pub zones: Vec<Goniogram>,
    /// That of the whole source.
    pub total: Goniogram,
}

fn wrong(found: impl Into<String>) -> Error {
    Error::malformed("model.goniograms", found, AGAIN)
}

impl Angles {
    /// Reads the file.
    ///
    /// # Errors
    /// As [`super::read`].
    pub fn parse(bytes: &[u8]) -> Result<Angles, Error> {
        let document: Document = serde_json::from_slice(bytes)
            .map_err(|error| wrong(format!("goniograms.json cannot be read: {error}.")))?;
        if document.schema != goniograms::URN {
            let found = format!("goniograms.json follows another schema than {}.", goniograms::URN);
            return Err(Error::refused(
                "model.version",
                found,
                "Build the model again with this version of lampwright.",
            ));
        }
        let Document { source, frame, grid, spectrum, zones, total, .. } = document;
        let frame = frame.frame();
        if frame.nadir.component() == frame.c0.component() {
            return Err(wrong("Nadir and C0 of the photometric frame lie along one line."));
        }
        if zones.is_empty() || zones.iter().enumerate().any(|(index, zone)| zone.id != Some(index)) {
            return Err(wrong("The zones of goniograms.json are not numbered from 0."));
        }
        let band_edges_nm = spectrum.map(|spectrum| spectrum.band_edges_nm);
        let bands = band_edges_nm.as_ref().map_or(0, |edges| edges.len().saturating_sub(1));
        let sphere = grid.sphere()?;
        let entries = zones.iter().chain([&total]);
        let grids: Vec<&Grid> = entries.filter_map(|entry| Some(&entry.spectral_intensity.as_ref()?.grid)).collect();
        if grids.windows(2).any(|pair| pair[0] != pair[1]) {
            return Err(wrong("The grids of the spectral intensities differ from zone to zone."));
        }
        let spectral_grid = grids.first().map(|grid| grid.sphere()).transpose()?;
        let goniogram = |entry: Entry| entry.goniogram(&sphere, spectral_grid.as_ref(), bands);
        let zones = zones.into_iter().map(goniogram).collect::<Result<Vec<_>, Error>>()?;
        let total = goniogram(total)?;
        Ok(Angles { name: source.name, frame, grid: sphere, spectral_grid, band_edges_nm, zones, total })
    }
}

impl Grid {
    fn sphere(&self) -> Result<SphereGrid, Error> {
        let step_deg = 360.0 / self.c_deg.len().max(1) as f64;
        let mut planes = self.c_deg.iter().enumerate();
        if self.c_deg.is_empty() || !planes.all(|(at, c_deg)| (c_deg - at as f64 * step_deg).abs() <= UNEVEN_DEG) {
            return Err(wrong("The C planes of a grid do not lie evenly from 0 on."));
        }
        let ends = [self.gamma_deg.first(), self.gamma_deg.last()];
        let increases = self.gamma_deg.windows(2).all(|pair| pair[0] < pair[1]);
        if self.gamma_deg.len() < 3 || ends != [Some(&0.0), Some(&180.0)] || !increases {
            return Err(wrong("The nodes of gamma of a grid do not increase from 0 to 180."));
        }
        Ok(SphereGrid::uneven(self.gamma_deg.clone(), self.c_deg.len()))
    }
}

impl Entry {
    fn goniogram(self, grid: &SphereGrid, spectral: Option<&SphereGrid>, bands: usize) -> Result<Goniogram, Error> {
        let nodes = |matrix: Option<Vec<Vec<f64>>>| -> Result<Option<Vec<f64>>, Error> {
            let Some(matrix) = matrix else { return Ok(None) };
            let planes = matrix.iter().all(|plane| plane.len() == grid.gamma_nodes());
            if matrix.len() != grid.c_planes() || !planes {
                return Err(wrong("Intensities of a goniogram are not one for each node of its grid."));
            }
            checked(matrix.concat()).map(Some)
        };
        let dense = match (self.spectral_intensity, spectral) {
            (Some(dense), Some(grid)) => {
                let count = (grid.c_planes() * grid.gamma_nodes()).saturating_mul(bands);
                if dense.encoding != goniograms::ENCODING || dense.order != goniograms::ORDER {
                    return Err(wrong("Spectral intensities come in another encoding or order than is known."));
                }
                if dense.values.len() != count {
                    return Err(wrong("Spectral intensities are not one for each node and band."));
                }
                checked(dense.values)?
            }
            _ => Vec::new(),
        };
        Ok(Goniogram {
            flux: Flux { radiant_w: self.flux_w, luminous_lm: self.flux_lm },
            luminous_cd: nodes(self.luminous_intensity_cd)?,
            radiant_w_per_sr: nodes(self.radiant_intensity_w_per_sr)?,
            spectral_w_per_sr_nm: dense,
            ..Goniogram::default()
        })
    }
}

fn checked(values: Vec<f64>) -> Result<Vec<f64>, Error> {
    let sound = values.iter().all(|value| *value >= 0.0 && value.is_finite());
    sound.then_some(values).ok_or_else(|| wrong("An intensity is negative."))
}
