//! `evaluation.json` (`openapi/evaluation.schema.json`).

use crate::error::Error;
use crate::evaluation::answer::{Answer, Channel};
use crate::evaluation::view::{View, Width};
use crate::vocabulary::notice::Notice;
use crate::writing::json::document;
use crate::writing::number::{Numbers, SUM_DIGITS, sum};
use crate::writing::schema;
use schemars::JsonSchema;
use serde::Serialize;
use serde_json::Value;

const URN: &str = "urn:lampwright:evaluation:1";

/// A model evaluated: what was asked, and one number a cell in each channel, with the bound of its error against the model.
#[derive(Serialize, JsonSchema)]
#[schemars(title = "Evaluation of a model of a light source", extend("$id" = URN))]
struct Document<'a> {
    /// Which schema this follows; another number means a change that breaks readers.
    #[schemars(extend("const" = URN))]
    schema: &'static str,
    /// What the source is called.
    model: &'a str,
    /// What the numbers are.
    quantity: &'static str,
    /// Which light.
    light: &'static str,
    /// What was looked at.
    view: Seen,
    /// Error of an irradiance against its value that was aimed at; null of other views.
    tolerance: Option<f64>,
    /// Points and directions of the model that were evaluated.
    evaluations: u64,
    /// Cells in a row. Of a grid of directions they are C planes, of a list the directions.
    columns: usize,
    /// Rows, from the top of the picture. Of a grid of directions they are nodes of gamma.
    rows: usize,
    /// What whoever reads the numbers must know: that a plane lies in the light. In many cases none.
    notices: &'a [Notice],
    /// The numbers.
    channels: Vec<ChannelFacts<'a>>,
}

/// What was looked at; lengths in mm, directions in the source frame.
#[derive(Serialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
enum Seen {
    /// Intensity on a grid of the photometric frame, from C = 0 and gamma = 0 on.
    Grid {
        /// Step of C, degrees.
        c_step_deg: f64,
        /// Step of gamma, degrees.
        gamma_step_deg: f64,
    },
    /// Intensity in directions of the source frame.
    Directions(Vec<[f64; 3]>),
    /// Intensity at pairs of C and gamma, degrees.
    Angles(Vec<[f64; 2]>),
    /// Irradiance on a rectangle, seen from the side that is lit.
    Plane {
        /// Its middle.
        center_mm: [f64; 3],
        /// Unit normal towards the side that is lit.
        normal: [f64; 3],
        /// From the first cell of the first row to the next in the row.
        column_step_mm: [f64; 3],
        /// From the first cell of the first row to that of the next row.
        row_step_mm: [f64; 3],
        /// The middle of the first cell of the first row.
        first_mm: [f64; 3],
    },
    /// Radiance as a camera sees it.
    Camera {
        /// Where it is; an orthographic one is infinitely far away in the same direction.
        eye_mm: [f64; 3],
        /// What is in the middle of the picture.
        target_mm: [f64; 3],
        /// Width of the picture; null of a perspective camera.
        width_mm: Option<f64>,
        /// The angle of the whole width; null of an orthographic camera.
        field_deg: Option<f64>,
        /// Lines along each side of a cell, whose mean its value is.
        samples: usize,
    },
}

/// One of the numbers of each cell.
#[derive(Serialize, JsonSchema)]
struct ChannelFacts<'a> {
    /// Its name: the quantity; X, Y, Z, x, y; or the band.
    name: &'a str,
    /// Its unit.
    unit: &'static str,
    /// The band that it is the mean of, nm; null where it is none.
    band_nm: Option<[f64; 2]>,
    /// The largest value.
    largest: f64,
    /// The largest bound.
    largest_bound: f64,
    /// Row by row.
    #[schemars(with = "Vec<Vec<f64>>")]
    values: Vec<Numbers<'a>>,
    /// Bounds of the errors of these values against the model; 0 where they are closed forms.
    #[schemars(with = "Vec<Vec<f64>>")]
    bounds: Vec<Numbers<'a>>,
}

/// The schema of the document.
pub fn schema() -> Value {
    schema::of::<Document<'_>>()
}

/// The document.
///
/// # Errors
/// As [`document`] and the view's own.
pub fn bytes(answer: &Answer) -> Result<Vec<u8>, Error> {
    document(&Document {
        schema: URN,
        model: &answer.model,
        quantity: answer.quantity,
        light: answer.kind.name(),
        view: seen(answer)?,
        tolerance: matches!(answer.request.view, View::Plane(_)).then_some(answer.request.tolerance),
        evaluations: answer.evaluations,
        columns: answer.columns,
        rows: answer.rows,
        notices: &answer.notices,
        channels: answer.channels.iter().map(|channel| facts(channel, answer.columns)).collect(),
    })
}

fn facts(channel: &Channel, columns: usize) -> ChannelFacts<'_> {
    let largest = |numbers: &[f64]| sum(numbers.iter().copied().fold(0.0, f64::max));
    ChannelFacts {
        name: &channel.name,
        unit: channel.unit,
        band_nm: channel.band_nm,
        largest: largest(&channel.values),
        largest_bound: largest(&channel.bounds),
        values: channel.values.chunks(columns).map(|row| Numbers(row, SUM_DIGITS)).collect(),
        bounds: channel.bounds.chunks(columns).map(|row| Numbers(row, SUM_DIGITS)).collect(),
    }
}

fn seen(answer: &Answer) -> Result<Seen, Error> {
    Ok(match &answer.request.view {
        View::Grid { c_step_deg, gamma_step_deg } => {
            Seen::Grid { c_step_deg: *c_step_deg, gamma_step_deg: *gamma_step_deg }
        }
        View::Directions(directions) => Seen::Directions(directions.iter().map(|along| along.to_array()).collect()),
        View::Angles(angles) => Seen::Angles(angles.clone()),
        View::Plane(plane) => {
            let (sheet, normal) = plane.sheet(&answer.frame)?;
            let [right, down] = sheet.steps_mm();
            Seen::Plane {
                center_mm: plane.center_mm.to_array(),
                normal: normal.to_array(),
                column_step_mm: right.to_array(),
                row_step_mm: down.to_array(),
                first_mm: sheet.receiver(0, normal).point_mm.to_array(),
            }
        }
        View::Camera(camera) => Seen::Camera {
            eye_mm: camera.eye_mm.to_array(),
            target_mm: camera.target_mm.to_array(),
            width_mm: if let Width::Orthographic(width_mm) = camera.width { Some(width_mm) } else { None },
            field_deg: if let Width::Perspective(field_deg) = camera.width { Some(field_deg) } else { None },
            samples: camera.samples,
        },
    })
}
