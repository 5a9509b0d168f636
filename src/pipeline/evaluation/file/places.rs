//! Where the cells of an answer lie.

use crate::error::Error;
use crate::evaluation::answer::Answer;
use crate::evaluation::view::{View, Width};
use glam::DVec3;

/// What is told of the place of a cell besides its column and row.
pub struct Places {
    /// Names with units; as many as each place has numbers.
    pub names: &'static [&'static str],
    /// Row by row.
    pub places: Vec<Vec<f64>>,
}

impl Places {
    /// Of all cells.
    ///
    /// # Errors
    /// As the view's own.
    pub fn of(answer: &Answer) -> Result<Places, Error> {
        let cells = 0..answer.columns * answer.rows;
        let column_and_row = |cell: usize| ((cell % answer.columns) as f64, (cell / answer.columns) as f64);
        let places = |names, of: &dyn Fn(usize) -> Vec<f64>| Places { names, places: cells.clone().map(of).collect() };
        let vector = |vector: DVec3| vector.to_array().to_vec();
        Ok(match &answer.request.view {
            View::Grid { c_step_deg, gamma_step_deg } => places(&["c_deg", "gamma_deg"], &|cell| {
                let (column, row) = column_and_row(cell);
                vec![column * c_step_deg, row * gamma_step_deg]
            }),
            View::Directions(directions) => places(&["x", "y", "z"], &|cell| vector(directions[cell])),
            View::Angles(angles) => places(&["c_deg", "gamma_deg"], &|cell| angles[cell].to_vec()),
            View::Plane(plane) => {
                let (sheet, normal) = plane.sheet(&answer.frame)?;
                places(&["x_mm", "y_mm", "z_mm"], &|cell| vector(sheet.receiver(cell, normal).point_mm))
            }
            View::Camera(camera) => {
                let edge = |width: f64| width / answer.columns as f64;
                let at = |cell: usize, edge: f64| {
                    let (column, row) = column_and_row(cell);
                    let across = column + 0.5 - 0.5 * answer.columns as f64;
                    [edge * across, edge * (0.5 * answer.rows as f64 - row - 0.5)]
                };
                match camera.width {
                    Width::Orthographic(width_mm) => {
                        places(&["right_mm", "up_mm"], &|cell| at(cell, edge(width_mm)).to_vec())
                    }
                    Width::Perspective(field_deg) => {
                        let edge = edge(2.0 * (0.5 * field_deg).to_radians().tan());
                        places(&["right_deg", "up_deg"], &|cell| {
                            at(cell, edge).map(|at| at.atan().to_degrees()).to_vec()
                        })
                    }
                }
            }
        })
    }
}
