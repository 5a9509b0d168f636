//! What several artifacts say alike: the frame, the lattice of zones, the bands, boxes, quality.

use crate::goniogram::Goniogram;
use crate::model::Model;
use crate::source::Spectral;
use crate::vocabulary::space::{Axis, Bounds, Frame};
use crate::writing::number::sum;
use glam::DVec3;
use schemars::JsonSchema;
use serde::Serialize;

const CONVENTION: &str = "IES type C / CIE C-gamma: gamma 0 = nadir = -z, gamma 180 = zenith = +z, C 0 = +x, C 90 = +y, \
                          C counter-clockwise seen from zenith";

/// The photometric frame, in words and as vectors.
#[derive(Serialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct FrameFacts {
    /// How C and gamma are counted.
    #[schemars(extend("const" = CONVENTION))]
    convention: &'static str,
    /// The frame's axes in the ray file's coordinates.
    axes_in_source: Axes,
    /// The source axis at gamma 0.
    #[schemars(with = "Axis")]
    nadir: &'static str,
    /// The source axis at C 0, gamma 90.
    #[schemars(with = "Axis")]
    c0: &'static str,
}

/// Unit vectors of the photometric axes in the ray file's coordinates; right-handed.
#[derive(Serialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
struct Axes {
    /// C 0, gamma 90.
    #[schemars(with = "[f64; 3]")]
    x: DVec3,
    /// C 90, gamma 90.
    #[schemars(with = "[f64; 3]")]
    y: DVec3,
    /// Zenith, gamma 180.
    #[schemars(with = "[f64; 3]")]
    z: DVec3,
}

impl FrameFacts {
    /// Of a frame.
    pub fn new(frame: &Frame) -> FrameFacts {
        FrameFacts {
            convention: CONVENTION,
            // Adding zero turns -0 into 0.
            axes_in_source: Axes { x: frame.x() + 0.0, y: frame.y() + 0.0, z: frame.z() + 0.0 },
            nadir: frame.nadir.name(),
            c0: frame.c0.name(),
        }
    }
}

/// The regular lattice of zones in the plane of photometric x (C 0) and y (C 90).
#[derive(Serialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct LatticeFacts {
    /// Zones along photometric x (C 0).
    #[schemars(range(min = 1))]
    columns: usize,
    /// Zones along photometric y (C 90).
    #[schemars(range(min = 1))]
    rows: usize,
    /// Lower corner, photometric x and y, mm.
    min_mm: [f64; 2],
    /// Upper corner, photometric x and y, mm.
    max_mm: [f64; 2],
}

impl LatticeFacts {
    /// Of a model; `None` where zones follow the surface.
    pub fn new(model: &Model) -> Option<LatticeFacts> {
        let lattice = model.goniograms.lattice.as_ref()?;
        let (columns, rows) = (lattice.columns, lattice.rows);
        Some(LatticeFacts { columns, rows, min_mm: lattice.min_mm.map(sum), max_mm: lattice.max_mm.map(sum) })
    }
}

/// What spectral results are made from; one of [`Spectral::BASES`].
pub fn spectral_basis(model: &Model) -> &'static str {
    if model.spectral.has_bands() && !model.ancestors.is_empty() { Spectral::OF_MODELS } else { model.spectral.basis() }
}

/// The bands of every spectral number.
#[derive(Serialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct Spectrum {
    /// Middles of the bands, increasing.
    #[schemars(length(min = 1))]
    wavelength_nm: Vec<f64>,
    /// Edges of the bands, increasing, one more than wavelength_nm. Densities are means over the band, so density times band
    /// width is flux.
    #[schemars(length(min = 1))]
    band_edges_nm: Vec<f64>,
}

impl Spectrum {
    /// Of a model.
    pub fn new(model: &Model) -> Spectrum {
        let bands = &model.spectral.bands;
        Spectrum { wavelength_nm: bands.centers_nm(), band_edges_nm: bands.edges_nm().to_vec() }
    }
}

/// An axis-parallel box in the source frame, mm.
#[derive(Serialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct Box3 {
    /// Smallest coordinates, mm.
    min: [f64; 3],
    /// Largest coordinates, mm.
    max: [f64; 3],
}

impl Box3 {
    /// Of bounds.
    pub fn new(bounds: &Bounds) -> Box3 {
        Box3 { min: bounds.min.to_array().map(sum), max: bounds.max.to_array().map(sum) }
    }
}

/// What the statistics of a goniogram allow to say.
#[derive(Serialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct QualityFacts {
    /// Median of rays per lit cell, before smoothing.
    #[schemars(range(min = 0))]
    rays_per_cell_median: f64,
    /// Share of cells without a ray.
    #[schemars(range(min = 0, max = 1))]
    empty_cell_fraction: f64,
    /// Relative standard error of the largest intensity, after smoothing.
    #[schemars(range(min = 0))]
    relative_noise_at_peak: f64,
    /// Radius of the cap of directions whose rays share the largest intensity, degrees; 0 when off.
    #[schemars(range(min = 0))]
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
