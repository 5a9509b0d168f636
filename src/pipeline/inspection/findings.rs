//! What an inspection found, as it is written: the header, the rays, a verdict for each check.

use super::beam::BeamWidth;
use super::focus::Focus;
use super::order::Order;
use super::origins::Origins;
use super::sample::Evidence;
use crate::formats::record::{Format, TotalRule};
use crate::vocabulary::notice::Notice;
use crate::vocabulary::space::Axis;
use crate::vocabulary::units::{Flux, LengthUnit};
use crate::writing::schema::WHOLE;
use schemars::JsonSchema;
use serde::Serialize;

/// What an inspection calls its schema.
const URN: &str = "urn:lampwright:inspection:1";
/// What rays may carry of the spectrum, by the names of [`crate::formats::record::SpectralData::name`].
pub const SPECTRA: [&str; 5] = ["none", "table", "wavelength per ray", "table per ray", "tristimulus"];
/// The names of all checks, in reading order.
const CHECKS: [&str; 16] = [
    "rays.usable",
    "rays.length_unit",
    "rays.quantity",
    "rays.size",
    "rays.total",
    "rays.spectrum",
    "rays.efficacy",
    "rays.directions",
    "rays.order",
    "rays.ray_flux",
    "rays.noise",
    "rays.focus",
    "rays.origins",
    "rays.backward",
    "rays.beam",
    "rays.job",
];

/// What to think of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// As it should be.
    Ok,
    /// To be known before a model is trusted.
    Notice,
    /// A model would be wrong, or there would be none.
    Wrong,
}

impl Verdict {
    /// "ok", "notice", "wrong".
    pub fn name(self) -> &'static str {
        match self {
            Verdict::Ok => "ok",
            Verdict::Notice => "notice",
            Verdict::Wrong => "wrong",
        }
    }
}

/// One check.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Check {
    /// Stable name: programs may depend on it; more may come.
    #[schemars(extend("enum" = CHECKS))]
    pub check: &'static str,
    /// What to think of it.
    pub verdict: Verdict,
    /// What was found; a sentence that may be reworded. The numbers are in the inspection's other fields.
    pub message: String,
    /// What to do; `null` where nothing is to be done.
    pub remedy: Option<String>,
}

/// A name and what the file says under it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, JsonSchema)]
pub struct Text {
    /// Name of the field.
    pub name: String,
    /// Its content.
    pub value: String,
}

/// What a file says of itself; no ray was read for it. In answers of the service it stands beside the inspection.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Header {
    /// The format it is.
    #[schemars(with = "String")]
    pub format: Format,
    /// Length of the file, bytes.
    pub byte_count: u64,
    /// Rays in the file, proven by its length.
    pub ray_count: u64,
    /// Totals of the header; `null` where it has none.
    pub flux: Flux,
    /// Which total holds in this format.
    #[schemars(with = "String", extend("enum" = ["header", "ray_sum"]))]
    pub total_rule: TotalRule,
    /// Rays carry W.
    pub has_radiant: bool,
    /// Rays carry lm.
    pub has_luminous: bool,
    /// What the rays carry of the spectrum.
    #[schemars(extend("enum" = SPECTRA))]
    pub spectrum: &'static str,
    /// Unit of length as the file or the user says: "mm", …; `null` where neither does.
    #[schemars(extend("enum" = LengthUnit::symbols_and_null()))]
    pub length_unit: Option<&'static str>,
    /// Neither the file nor the user says whether its flux is W or lm.
    pub quantity_unknown: bool,
    /// Wavelengths of its tables, nm; `null` without tables.
    pub table_range_nm: Option<(f64, f64)>,
    /// Everything else, in the file's order.
    pub texts: Vec<Text>,
    /// What was odd about the header and yet read.
    pub notices: Vec<Notice>,
}

/// A box, mm.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Extent {
    /// Smallest coordinates, mm.
    pub min: [f64; 3],
    /// Largest coordinates, mm.
    pub max: [f64; 3],
}

/// Share of the flux that goes to one side.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Hemisphere {
    /// Its middle.
    pub axis: Axis,
    /// Share of the flux, 0..=1.
    #[schemars(range(min = 0, max = WHOLE))]
    pub share: f64,
}

/// Lengths of directions as stored.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Directions {
    /// Largest | |k| − 1 |, refused rays included.
    pub worst_length_error: f64,
    /// Directions off by more than text rounding (1e-5) that were normalised.
    pub repaired: u64,
}

/// Where most of the light goes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct MainDirection {
    /// The axis nearest the flux vector Σ w d.
    pub axis: Axis,
    /// |Σ w d| / Σ w: 1 for a collimated beam, 2/3 for a Lambertian surface, 0 for light into all directions.
    pub mean_cosine: f64,
    /// Share of the flux that goes into the hemisphere opposite to `axis`, 0..=1.
    #[schemars(range(min = 0, max = WHOLE))]
    pub backward_share: f64,
}

/// How the flux is spread over rays.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct RayFlux {
    /// Unit of the flux of rays.
    #[schemars(extend("enum" = ["W", "lm"]))]
    pub unit: &'static str,
    /// Smallest flux of a ray.
    pub smallest: f64,
    /// Largest flux of a ray.
    pub largest: f64,
    /// Smallest and largest differ by rounding of f32 only.
    pub equal: bool,
    /// Largest over total.
    pub largest_share: f64,
    /// (Σ w)² / Σ w²: how many rays of equal flux would be as noisy.
    pub effective_rays: f64,
}

/// Monte-Carlo noise of what is made of these rays: a cell that gets n effective rays is known to 1/√n.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Noise {
    /// Relative noise of a picture of 50 x 50 cells, evenly lit.
    pub of_2500_cells: f64,
    /// Cells of a picture with 5 % noise: 400 effective rays each.
    pub cells_at_5_percent: f64,
}

/// What a job with this file alone is likely to take, with default options: least and most.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct JobEstimate {
    /// Peak memory, bytes. Does not grow with the rays.
    pub memory_bytes: (u64, u64),
    /// Seconds of one core; a job spreads over the cores it is given.
    pub core_seconds: (f64, f64),
}

/// What a ray file says of itself and what its rays say. Readers ignore keys they do not know.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
#[schemars(title = "Inspection of a ray file", extend("$id" = URN))]
pub struct Inspection {
    /// The worst of the checks.
    pub verdict: Verdict,
    /// One verdict per check, in reading order.
    #[schemars(length(min = 3))]
    pub checks: Vec<Check>,
    /// What the file says of itself.
    pub header: Header,
    /// Rays that can be used.
    pub rays_used: u64,
    /// Rays that cannot be meant.
    pub rays_refused: u64,
    /// Rays without flux.
    pub rays_dropped: u64,
    /// Sum of the stored radiant values: W, or relative; `null` where rays carry none.
    pub radiant_sum: Option<f64>,
    /// Sum of the stored luminous values: lm, or relative; `null` where rays carry none.
    pub luminous_sum: Option<f64>,
    /// Ray sum over header total.
    pub sum_over_header: Option<f64>,
    /// Totals of a model of this file.
    pub flux: Flux,
    /// Luminous efficacy of the radiation, lm/W.
    pub lm_per_w: Option<f64>,
    /// Luminous efficacy by the spectrum of tables or wavelengths alone, lm/W.
    pub spectrum_lm_per_w: Option<f64>,
    /// Box of the origins; `null` without usable rays, like all that follows from rays.
    pub origins_mm: Option<Extent>,
    /// Flux-weighted mean of the origins, mm.
    pub centroid_mm: Option<[f64; 3]>,
    /// Smallest and largest wavelength, nm.
    pub wavelength_nm: Option<(f64, f64)>,
    /// Lengths of directions.
    pub directions: Directions,
    /// Whether rays stand in random order.
    pub order: Option<Order>,
    /// How the flux is spread over rays.
    pub ray_flux: Option<RayFlux>,
    /// Noise of what is made of these rays.
    pub noise: Option<Noise>,
    /// Virtual focus; `null` for collimated rays.
    pub focus: Option<Focus>,
    /// What origins lie on.
    pub origins: Option<Origins>,
    /// Median distance of the sampled origins from the virtual focus, mm; 0 without one.
    pub median_origin_distance_mm: f64,
    /// Where most of the light goes.
    pub main_direction: Option<MainDirection>,
    /// Share of the flux in the hemisphere round each axis.
    pub hemispheres: [Hemisphere; 6],
    /// The beam that most of the light is in; `null` for light into all directions, several beams, or fewer than 200 rays.
    pub beam: Option<BeamWidth>,
    /// What a job would take.
    pub job: JobEstimate,
    /// What was odd about header and rays.
    pub notices: Vec<Notice>,
    /// What drawings are made of.
    #[serde(skip)]
    pub evidence: Evidence,
}
