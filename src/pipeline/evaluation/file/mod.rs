//! An answer as a file: JSON and CSV for programs and tables, TIFF of floats for pictures that are computed with, SVG to look at.

/// Where cells lie, for tables and axes.
mod places;
/// JSON.
mod json;
/// Comma-separated values.
mod csv;
/// TIFF of 32-bit floats.
mod tiff;
/// A picture with a scale.
mod picture;

pub use json::schema;

use super::answer::Answer;
use super::view::View;
use crate::error::{Error, Place};
use crate::writing::Artifact;

/// How an answer is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// `openapi/evaluation.schema.json`.
    Json,
    /// One line a cell.
    Csv,
    /// One page of floats a channel, then one for the bounds of each.
    Tiff,
    /// A drawing with axes and a scale.
    Svg,
}

impl Form {
    /// All.
    pub const ALL: [Form; 4] = [Form::Json, Form::Csv, Form::Tiff, Form::Svg];

    /// Extension of its files, and its name.
    pub fn extension(self) -> &'static str {
        match self {
            Form::Json => "json",
            Form::Csv => "csv",
            Form::Tiff => "tiff",
            Form::Svg => "svg",
        }
    }

    /// The form of an extension.
    pub fn of_extension(extension: &str) -> Option<Form> {
        let lower = extension.to_ascii_lowercase();
        if lower == "tif" { Some(Form::Tiff) } else { Form::ALL.into_iter().find(|form| form.extension() == lower) }
    }

    /// Media type.
    pub fn media_type(self) -> &'static str {
        match self {
            Form::Json => "application/json",
            Form::Csv => "text/csv",
            Form::Tiff => "image/tiff",
            Form::Svg => "image/svg+xml",
        }
    }
}

impl Form {
    /// Refuses a picture of what is none.
    ///
    /// # Errors
    /// [`Error::Unusable`] of a list of directions.
    pub fn check(self, view: &View) -> Result<(), Error> {
        if self != Form::Svg || !matches!(view, View::Directions(_) | View::Angles(_)) {
            return Ok(());
        }
        let found = "A list of directions is no picture.";
        let remedy = "Ask for JSON or CSV, or for a grid of C and gamma.";
        Err(Error::invalid_declaration("evaluation.no_picture", Place::Asked("format"), found, remedy))
    }
}

impl Answer {
    /// The file.
    ///
    /// # Errors
    /// [`Error::Unusable`] where a list of directions is asked for as a picture.
    pub fn write(&self, form: Form) -> Result<Artifact, Error> {
        form.check(&self.request.view)?;
        let bytes = match form {
            Form::Json => json::bytes(self)?,
            Form::Csv => csv::bytes(self)?,
            Form::Tiff => tiff::bytes(self)?,
            Form::Svg => picture::bytes(self)?,
        };
        Ok(Artifact { name: format!("evaluation.{}", form.extension()), media_type: form.media_type(), bytes })
    }
}
