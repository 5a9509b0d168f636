//! Evaluations of the models of jobs, as clients ask for them: at once, or as jobs of their own, of which a row keeps the request.

use super::Priority;
use super::request::asked;
use crate::metadata::Metadata;
use pipeline::{
    Camera, Error, EvaluationForm, EvaluationRequest, LightKind, Place, Plane, TOLERANCE, Vector, View, Width,
};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// What is asked of a model.
#[derive(Clone, Debug, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewEvaluation {
    /// What is looked at.
    pub view: EvaluationView,
    /// Which light. Default: luminous where the model knows it, else radiant.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub light: Option<LightName>,
    /// Error of an irradiance that is aimed at, as a part of its value. Default: 0.001.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(minimum = 0.000_001, maximum = 0.1)]
    pub tolerance: Option<f64>,
    /// Form of the answer. Default: json.
    #[serde(default)]
    #[schema(nullable)]
    pub format: EvaluationFormat,
}

/// What is looked at. Lengths are in mm, directions are vectors in the source frame.
#[derive(Clone, Debug, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum EvaluationView {
    /// Intensity on a grid of C and gamma.
    Grid(DirectionGrid),
    /// Intensity in directions of the source frame, of any length but 0.
    #[schema(value_type = Vec<NumberTriple>)]
    Directions(Vec<[f64; 3]>),
    /// Intensity at pairs of C and gamma, degrees.
    #[schema(value_type = Vec<NumberPair>)]
    Angles(Vec<[f64; 2]>),
    /// Irradiance or illuminance on a rectangle.
    Plane(PlaneView),
    /// Radiance or luminance as a camera sees it.
    Camera(CameraView),
}

/// Two numbers.
#[derive(ToSchema)]
#[schema(min_items = 2, max_items = 2)]
pub struct NumberPair(#[expect(dead_code, reason = "a schema, never a value")] Vec<f64>);

/// Three numbers.
#[derive(ToSchema)]
#[schema(min_items = 3, max_items = 3)]
pub struct NumberTriple(#[expect(dead_code, reason = "a schema, never a value")] Vec<f64>);

/// A grid of the photometric frame, from C = 0 and gamma = 0 on.
#[derive(Clone, Copy, Debug, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct DirectionGrid {
    /// Step of C, degrees; divides 360. Default: 15.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub c_step_deg: Option<f64>,
    /// Step of gamma, degrees; divides 180. Default: 5.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gamma_step_deg: Option<f64>,
}

/// A rectangle of a plane. Its rows are those of the picture that is seen from the side that is lit.
#[derive(Clone, Copy, Debug, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PlaneView {
    /// Its middle.
    #[schema(value_type = NumberTriple)]
    pub center_mm: [f64; 3],
    /// Normal towards the side that is lit. Default: across gamma = 0, to the side on which the source lies.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<NumberTriple>)]
    pub normal: Option<[f64; 3]>,
    /// What is up in the picture. Default: +Z, and +Y of a plane across Z.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<NumberTriple>)]
    pub up: Option<[f64; 3]>,
    /// Along its rows.
    #[schema(exclusive_minimum = 0.0)]
    pub width_mm: f64,
    /// Along its columns. Default: the width.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(exclusive_minimum = 0.0)]
    pub height_mm: Option<f64>,
    /// Cells in a row. Default: 64.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(minimum = 1, maximum = 4096)]
    pub columns: Option<usize>,
    /// Rows. Default: so many that cells are square.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(minimum = 1, maximum = 4096)]
    pub rows: Option<usize>,
}

/// A camera with square cells; orthographic with `width_mm`, perspective with `field_deg`.
#[derive(Clone, Copy, Debug, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CameraView {
    /// Where it is. An orthographic camera is infinitely far away in the same direction.
    #[schema(value_type = NumberTriple)]
    pub eye_mm: [f64; 3],
    /// What is in the middle of the picture. Default: the origin.
    #[serde(default)]
    #[schema(nullable, value_type = NumberTriple)]
    pub target_mm: [f64; 3],
    /// What is up in the picture. Default: +Z, and +Y of a camera that looks along Z.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<NumberTriple>)]
    pub up: Option<[f64; 3]>,
    /// Width of what an orthographic camera sees.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(exclusive_minimum = 0.0)]
    pub width_mm: Option<f64>,
    /// Angle of the whole width of a perspective camera.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(exclusive_minimum = 0.0, exclusive_maximum = 180.0)]
    pub field_deg: Option<f64>,
    /// Cells in a row. Default: 256.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(minimum = 1, maximum = 4096)]
    pub columns: Option<usize>,
    /// Rows. Default: as many as columns.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(minimum = 1, maximum = 4096)]
    pub rows: Option<usize>,
    /// Lines along each side of a cell, whose mean is its value; 1 is the line through its middle. Default: 2.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(minimum = 1, maximum = 16)]
    pub samples: Option<usize>,
}

/// Which light.
#[derive(Clone, Copy, Debug, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum LightName {
    /// lm.
    Luminous,
    /// W.
    Radiant,
    /// W/nm in each band of the model.
    Spectrum,
    /// Tristimulus values X, Y, Z and chromaticity x, y of the CIE 1931 observer.
    Color,
}

/// Form of an answer.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum EvaluationFormat {
    /// `openapi/evaluation.schema.json`.
    #[default]
    Json,
    /// One line a cell.
    Csv,
    /// One page of 32-bit floats a channel, then one for the bounds of each.
    Tiff,
    /// A drawing with axes and a scale.
    Svg,
}

impl NewEvaluation {
    /// In the pipeline's words, with at most `most_numbers` of the answer and `most_kept` of the model.
    ///
    /// # Errors
    /// [`Error::Unusable`]: a camera without a width, or with two.
    pub fn request(self, most_numbers: usize, most_kept: usize) -> Result<EvaluationRequest, Error> {
        let vector = Vector::from_array;
        let view = match self.view {
            EvaluationView::Grid(DirectionGrid { c_step_deg, gamma_step_deg }) => View::Grid {
                c_step_deg: c_step_deg.unwrap_or(View::C_STEP_DEG),
                gamma_step_deg: gamma_step_deg.unwrap_or(View::GAMMA_STEP_DEG),
            },
            EvaluationView::Directions(directions) => View::Directions(directions.into_iter().map(vector).collect()),
            EvaluationView::Angles(angles) => View::Angles(angles),
            EvaluationView::Plane(plane) => View::Plane(plane.plane()),
            EvaluationView::Camera(camera) => View::Camera(camera.camera()?),
        };
        let kind = self.light.map(|light| match light {
            LightName::Luminous => LightKind::Luminous,
            LightName::Radiant => LightKind::Radiant,
            LightName::Spectrum => LightKind::Spectrum,
            LightName::Color => LightKind::Color,
        });
        let tolerance = self.tolerance.unwrap_or(TOLERANCE);
        Ok(EvaluationRequest { view, kind, tolerance, most_numbers, most_kept })
    }
}

impl PlaneView {
    fn plane(self) -> Plane {
        let (width_mm, height_mm) = (self.width_mm, self.height_mm.unwrap_or(self.width_mm));
        let columns = self.columns.unwrap_or(Plane::COLUMNS);
        Plane {
            center_mm: Vector::from_array(self.center_mm),
            normal: self.normal.map(Vector::from_array),
            up: self.up.map(Vector::from_array),
            width_mm,
            height_mm,
            columns,
            rows: self.rows.unwrap_or_else(|| Plane::square_rows(width_mm, height_mm, columns)),
        }
    }
}

impl CameraView {
    fn camera(self) -> Result<Camera, Error> {
        let columns = self.columns.unwrap_or(Camera::COLUMNS);
        Ok(Camera {
            eye_mm: Vector::from_array(self.eye_mm),
            target_mm: Vector::from_array(self.target_mm),
            up: self.up.map(Vector::from_array),
            width: match (self.width_mm, self.field_deg) {
                (Some(width_mm), None) => Width::Orthographic(width_mm),
                (None, Some(field_deg)) => Width::Perspective(field_deg),
                _ => {
                    let found = "The camera has no width, or two: width_mm and field_deg.";
                    let remedy = "Give width_mm of an orthographic camera, or field_deg of a perspective one.";
                    let place = Place::Asked("view.camera.width_mm");
                    return Err(Error::invalid_declaration("evaluation.geometry", place, found, remedy));
                }
            },
            columns,
            rows: self.rows.unwrap_or(columns),
            samples: self.samples.unwrap_or(Camera::SAMPLES),
        })
    }
}

impl EvaluationFormat {
    /// In the pipeline's words.
    pub fn form(self) -> EvaluationForm {
        match self {
            EvaluationFormat::Json => EvaluationForm::Json,
            EvaluationFormat::Csv => EvaluationForm::Csv,
            EvaluationFormat::Tiff => EvaluationForm::Tiff,
            EvaluationFormat::Svg => EvaluationForm::Svg,
        }
    }
}

asked! {
    /// A request for an evaluation as a job.
    pub struct NewEvaluationJob {
        /// Identifier of the job whose model is evaluated; it has succeeded.
        #[schema(format = Uuid)]
        pub job: String,
        /// What is asked of it.
        pub evaluation: NewEvaluation,
    }
}

/// What an evaluation job computes, as its row has it.
#[derive(Clone, Debug, Serialize, Deserialize, ToSchema)]
pub struct JobEvaluation {
    /// Identifier of the job whose model is evaluated.
    #[schema(format = Uuid)]
    pub job: String,
    /// What is asked of it.
    pub evaluation: NewEvaluation,
}
