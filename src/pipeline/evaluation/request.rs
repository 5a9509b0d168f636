//! What is asked of a model.

use super::emission::Kind;
use super::view;
use super::view::View;
use crate::error::{Error, Place};
use crate::model::light::Light;
use crate::vocabulary::space::Bounds;

/// Error of an irradiance against its value that is aimed at where nothing is said.
pub const TOLERANCE: f64 = 1e-3;
/// Least and largest of these.
const TOLERANCES: [f64; 2] = [1e-6, 0.1];
/// Most numbers of an answer where nothing is said.
pub const MOST_NUMBERS: usize = 1 << 24;
/// Most directions in a list.
const MOST_DIRECTIONS: usize = 1 << 16;

/// What is asked of a model.
#[derive(Clone, Debug, PartialEq)]
pub struct Request {
    /// Where.
    pub view: View,
    /// Which light; luminous where nothing is said and the model knows it, else radiant.
    pub kind: Option<Kind>,
    /// Error of an irradiance against its value that is aimed at.
    pub tolerance: f64,
    /// Most numbers of the answer: cells times channels.
    pub most_numbers: usize,
    /// Most numbers of the model: vertices or nodes times channels.
    pub most_kept: usize,
}

impl View {
    /// Columns and rows of the answer.
    ///
    /// # Errors
    /// [`Error::Unusable`] where steps do not fit, or there is nothing.
    pub fn shape(&self) -> Result<[usize; 2], Error> {
        let listed = |count: usize, option: &'static str| {
            let remedy = "Give 1 to 65536 directions, or a grid.";
            let found = format!("{count} directions were given.");
            let fits = (1..=MOST_DIRECTIONS).contains(&count);
            fits.then_some([count, 1])
                .ok_or_else(|| Error::invalid_declaration("evaluation.directions", Place::Asked(option), found, remedy))
        };
        match self {
            View::Grid { c_step_deg, gamma_step_deg } => Ok([
                view::steps("view.grid.c_step_deg", *c_step_deg, 360.0)?,
                view::steps("view.grid.gamma_step_deg", *gamma_step_deg, 180.0)? + 1,
            ]),
            View::Directions(directions) => listed(directions.len(), "view.directions"),
            View::Angles(angles) => listed(angles.len(), "view.angles"),
            View::Plane(plane) => {
                view::length_mm("view.plane.width_mm", plane.width_mm)?;
                view::length_mm("view.plane.height_mm", plane.height_mm)?;
                Ok([plane.columns, plane.rows])
            }
            View::Camera(camera) => Ok([camera.columns, camera.rows]),
        }
    }
}

impl Request {
    /// Of a view, with nothing else said.
    pub fn of(view: View) -> Request {
        Request { view, kind: None, tolerance: TOLERANCE, most_numbers: MOST_NUMBERS, most_kept: usize::MAX }
    }

    /// The same, where no normal of a plane was given with that towards the source.
    #[must_use]
    pub fn facing(&self, light: &Light<'_>) -> Request {
        let View::Plane(plane) = self.view else { return self.clone() };
        let source_mm = Bounds::of(light.mesh.vertices_mm.iter().copied());
        Request { view: View::Plane(plane.facing(&light.frame, source_mm)), ..self.clone() }
    }

    /// Refuses what no model could answer: a tolerance that cannot be kept or says nothing, and a view that cannot be. Up of a plane without a
    /// normal is judged when that is known ([`Request::facing`]).
    ///
    /// # Errors
    /// [`Error::Unusable`].
    pub fn check(&self) -> Result<(), Error> {
        self.view.shape()?;
        self.view.check()?;
        if (TOLERANCES[0]..=TOLERANCES[1]).contains(&self.tolerance) {
            return Ok(());
        }
        let (place, found) = (Place::Asked("tolerance"), format!("A tolerance of {} was asked for.", self.tolerance));
        Err(Error::invalid_declaration("evaluation.tolerance", place, found, "Ask for 0.000001 to 0.1."))
    }
}
