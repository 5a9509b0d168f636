//! Several ray sets become one source; the only way to its rays.
//!
//! A source is a list of channels even while the list has one entry: vendors ship one white LED as a blue and a yellow
//! file (`MODEL.md` 2). A channel scales its rays' stored values to W and lm and gives each ray its spectral column.

use super::super::Error;
use super::super::vocabulary::limits::Limits;
use super::super::vocabulary::notice::Notices;
use super::super::vocabulary::spectrum::{Bands, Table};
use super::super::vocabulary::units::Flux;
use super::super::vocabulary::watch::StageWatch;
use super::survey::Survey;
use super::{Facts, Input, Options, RaySet};
use glam::DVec3;

/// A checked ray in the source frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Index over all channels, from 0.
    pub index: u64,
    /// Start, mm.
    pub origin_mm: DVec3,
    /// Unit direction.
    pub direction: DVec3,
    /// Radiant flux, W; 0 where the source's is unknown.
    pub radiant_w: f64,
    /// Luminous flux, lm; 0 where the source's is unknown.
    pub luminous_lm: f64,
    /// Spectral column of its radiant flux; meaningless where the source has no columns.
    pub column: u32,
    /// Tristimulus X and Z, lm (Y is the luminous flux); 0 elsewhere.
    pub xz_lm: [f64; 2],
}

/// How the source's spectrum is carried through the pipeline: rays deposit into columns, columns become bands at the end.
/// A column is a basis spectrum, so a spectral table shared by all rays costs one column and not 40 bands.
#[derive(Clone, Debug, PartialEq)]
pub enum Columns {
    /// No spectrum is known.
    None,
    /// A wavelength per ray: one column per band, and a last one for what lies outside the bands.
    Bands,
    /// One column per spectral table. `shares[table][band]`: share of the table's radiant flux in the band.
    Tables {
        /// Share of each table's radiant flux in each band; a row sums to 1 less what lies outside the bands.
        shares: Vec<Vec<f64>>,
    },
    /// Three columns, tristimulus X, Y, Z in lm.
    Tristimulus,
}

/// The spectral side of a source.
#[derive(Clone, Debug, PartialEq)]
pub struct Spectral {
    /// The bands of every spectral result.
    pub bands: Bands,
    /// What rays deposit into.
    pub columns: Columns,
}

impl Spectral {
    /// How many columns rays deposit into.
    pub fn column_count(&self) -> usize {
        match &self.columns {
            Columns::None => 0,
            Columns::Bands => self.bands.len() + 1,
            Columns::Tables { shares } => shares.len(),
            Columns::Tristimulus => 3,
        }
    }

    /// Calls `add(column, amount)` for each of the ray's deposits; amounts in W, for tristimulus in lm.
    pub fn deposit(&self, ray: &Ray, mut add: impl FnMut(usize, f64)) {
        match self.columns {
            Columns::None => {}
            Columns::Bands | Columns::Tables { .. } => add(ray.column as usize, ray.radiant_w),
            Columns::Tristimulus => {
                add(0, ray.xz_lm[0]);
                add(1, ray.luminous_lm);
                add(2, ray.xz_lm[1]);
            }
        }
    }

    /// True where columns become W/nm in bands.
    pub fn has_bands(&self) -> bool {
        matches!(self.columns, Columns::Bands | Columns::Tables { .. })
    }

    /// Spectral density of `columns` (W each) in W/nm, one number per band; empty without bands.
    pub fn bands_w_per_nm(&self, columns: &[f64]) -> Vec<f64> {
        let widths = self.bands.widths_nm();
        match &self.columns {
            Columns::None | Columns::Tristimulus => Vec::new(),
            Columns::Bands => columns.iter().zip(widths).map(|(watt, width)| watt / width).collect(),
            Columns::Tables { shares } => (0..widths.len())
                .map(|band| {
                    columns.iter().zip(shares).map(|(watt, share)| watt * share[band]).sum::<f64>() / widths[band]
                })
                .collect(),
        }
    }

    /// The words of the goniogram schema's `spectral_basis`.
    pub fn basis(&self) -> &'static str {
        match self.columns {
            Columns::None => "none",
            Columns::Bands => "per-ray wavelength",
            Columns::Tables { .. } => "spectral table of the file",
            Columns::Tristimulus => "tristimulus of the rays",
        }
    }
}

/// One ray set within a source.
pub struct Channel {
    /// Where its bytes came from: name and digest.
    pub name: String,
    /// SHA-256 of the file, lower-case hex.
    pub sha256: String,
    /// Length of the file in bytes.
    pub byte_count: u64,
    /// What was seen when every ray was read once.
    pub survey: Survey,
    /// Index of its first ray over all channels.
    first_index: u64,
    /// The file.
    set: RaySet,
}

impl Channel {
    /// What the file says of itself.
    pub fn facts(&self) -> &Facts {
        &self.set.facts
    }
}

/// A light source: checked, scaled rays in one frame.
pub struct Source {
    /// Its ray sets.
    pub channels: Vec<Channel>,
    /// Total flux of the usable rays.
    pub flux: Flux,
    /// Its spectral side.
    pub spectral: Spectral,
    /// All channels' surveys together.
    pub survey: Survey,
    /// All notices of reading.
    pub notices: Notices,
}

impl Source {
    /// See [`super::read`].
    ///
    /// # Errors
    /// As [`super::read`].
    pub fn read(inputs: &[Input], options: &Options, limits: &Limits, watch: StageWatch<'_>) -> Result<Source, Error> {
        let _ = (inputs, options, limits, watch, Table::new(&[]));
        todo!()
    }

    /// One pass over all usable rays. `work` sees each chunk (up to [`super::source::CHUNK_RAYS`] rays, in file order) on some
    /// thread of the ambient pool; `merge` folds the answers **in chunk order**, so the result does not depend on the
    /// number of threads. Memory: a bounded number of chunks.
    ///
    /// # Errors
    /// [`Error::Cancelled`], [`Error::Unreadable`], whatever `work` answers.
    pub fn fold<T: Send, A>(
        &self,
        watch: StageWatch<'_>,
        start: A,
        work: impl Fn(&[Ray]) -> Result<T, Error> + Sync,
        merge: impl FnMut(&mut A, T),
    ) -> Result<A, Error> {
        let _ = (watch, &work, &self.channels.first().map(|c| (c.first_index, &c.set)));
        let _ = merge;
        let _ = start;
        todo!()
    }
}

/// Rays per chunk of a pass.
pub const CHUNK_RAYS: usize = 1 << 14;
