//! What the report says of the choice of the surface, and how good the model is.

use crate::model::study::{Candidate, Figure, Study, View};
use crate::writing::number::{rounded, sum};
use schemars::JsonSchema;
use serde::Serialize;

/// Significant digits of errors, which are themselves uncertain.
const QUALITY_DIGITS: usize = 5;

/// The surfaces that were compared: a model of each was made of some of the rays, and the logarithm of the radiance that it gives to
/// the lines of other rays was averaged. The larger that is, the better the model predicts rays.
#[derive(Serialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct EmissionFacts {
    /// Index of the candidate that was taken.
    chosen: usize,
    /// All candidates, the simplest first; a later one is taken where it is better than the best before it by two standard errors.
    #[schemars(length(min = 1))]
    candidates: Vec<CandidateFacts>,
    /// Rays of which the candidates were made.
    training_rays: u64,
    /// Rays by which they were compared.
    compared_rays: u64,
}

/// A surface on which the light may be put.
#[derive(Serialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
struct CandidateFacts {
    /// "origins": the hull of where the rays start. "plane", "sphere": rays are slid along their lines to such a surface across the main
    /// direction. "volume": light comes from the lattice of points in emitter.glb.
    #[schemars(extend("enum" = ["origins", "plane", "sphere", "volume"]))]
    surface: &'static str,
    /// Where the surface meets its axis, source frame, mm; null of origins and volume.
    apex_mm: Option<[f64; 3]>,
    /// Unit vector of its axis: where the light goes; null of origins and volume.
    axis: Option<[f64; 3]>,
    /// One over its radius, 1/mm: 0 of a plane, positive where the centre lies ahead; null of origins and volume.
    curvature_per_mm: Option<f64>,
    /// Mirror planes through the axis that the light is taken to have: 0, 2 or 4.
    mirrors: u8,
    /// Mean natural logarithm of the radiance of the lines of the judging rays, for a source of flux 1, mm and sr.
    log_radiance: f64,
    /// How much that is above the best candidate before; null of the first.
    gain: Option<f64>,
    /// Standard error of the gain.
    #[schemars(range(min = 0))]
    gain_error: Option<f64>,
}

impl EmissionFacts {
    pub fn new(study: &Study) -> EmissionFacts {
        EmissionFacts {
            chosen: study.chosen,
            candidates: study.candidates.iter().map(CandidateFacts::new).collect(),
            training_rays: study.training_rays,
            compared_rays: study.compared_rays,
        }
    }
}

impl CandidateFacts {
    fn new(candidate: &Candidate) -> CandidateFacts {
        let surface = candidate.carrier.patch().map(|patch| patch.surface);
        CandidateFacts {
            surface: candidate.surface(),
            apex_mm: surface.map(|surface| surface.apex_mm.to_array().map(sum)),
            axis: surface.map(|surface| surface.axes.z_axis.to_array().map(sum)),
            curvature_per_mm: surface.map(|surface| sum(surface.curvature_per_mm)),
            mirrors: candidate.carrier.patch().map_or(0, |patch| patch.symmetry.mirrors()),
            log_radiance: sum(candidate.log_radiance),
            gain: candidate.gain.map(|(gain, _)| sum(gain)),
            gain_error: candidate.gain.map(|(_, error)| sum(error)),
        }
    }
}

/// A model of the chosen surface, made of the training rays alone, compared with up to a million others. The errors are root mean squares,
/// relative to the root mean square of what is compared; the noise of the judging rays and of those drawn from the model is
/// taken out. The model of the artifacts is made of all rays, and better.
#[derive(Serialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct QualityOfModel {
    /// Rays of which the judged model was made.
    training_rays: u64,
    /// Rays that judge.
    judging_rays: u64,
    /// Rays that were drawn from the model.
    drawn_rays: u64,
    /// The views in which enough rays are to be seen.
    figures: Vec<FigureFacts>,
}

/// A view: a plane across the main direction in front of the source (irradiance), all directions (intensity), or the source as it is
/// seen from a side (luminance). The spectral ones tell six groups of neighbouring bands apart, each with about a sixth of the flux; they are
/// left out where all light has one spectrum.
#[derive(Serialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
struct FigureFacts {
    /// What is compared.
    #[schemars(extend("enum" = ["plane", "far_field", "seen", "spectral_plane", "spectral_far_field"]))]
    view: &'static str,
    /// Distance of the plane from the front of the source, in its longest edges; null of the others.
    sizes: Option<f64>,
    /// Angle of the view from the main direction, degrees; null of the others.
    angle_deg: Option<f64>,
    /// Error of the model; 0 where the noise hides it.
    #[schemars(range(min = 0))]
    model_error: f64,
    /// Error of the training rays themselves.
    #[schemars(range(min = 0))]
    rays_error: f64,
    /// Error that a perfect model would seem to have by chance: what is below cannot be told from nothing.
    #[schemars(range(min = 0))]
    noise: f64,
    /// Normalised cross-correlation of the model and the truth: 1 where both have one form.
    #[schemars(range(max = 1))]
    correlation: f64,
}

impl QualityOfModel {
    pub fn new(study: &Study) -> QualityOfModel {
        QualityOfModel {
            training_rays: study.training_rays,
            judging_rays: study.judging_rays,
            drawn_rays: study.drawn_rays,
            figures: study.figures.iter().map(FigureFacts::new).collect(),
        }
    }
}

impl FigureFacts {
    fn new(figure: &Figure) -> FigureFacts {
        let (view, sizes, angle_deg) = match figure.view {
            View::Plane(sizes) => ("plane", Some(sizes), None),
            View::FarField => ("far_field", None, None),
            View::Seen(degrees) => ("seen", None, Some(degrees)),
            View::SpectralPlane(sizes) => ("spectral_plane", Some(sizes), None),
            View::SpectralFarField => ("spectral_far_field", None, None),
        };
        let [model_error, rays_error, noise, correlation] =
            [figure.model, figure.rays, figure.noise, figure.correlation].map(|value| rounded(value, QUALITY_DIGITS));
        FigureFacts { view, sizes, angle_deg, model_error, rays_error, noise, correlation }
    }
}
