//! 6. Results to files: a name, a media type, bytes. No file holds a time of making: same input, options and version give the
//! same bytes.

use super::model::Model;
use super::vocabulary::watch::StageWatch;
use super::{Error, Options as RunOptions};
use serde::Serialize;

/// How results are written.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Options {
    /// Where vertex spectra go in the glTF.
    pub spectra: Spectra,
    /// Edition of the IES files.
    pub ies_edition: IesEdition,
}

/// Where vertex spectra go in the glTF (`OUTPUTS.md` 3.3).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Spectra {
    /// In both, up to 2 million numbers; above, in attributes.
    #[default]
    Auto,
    /// Attributes and extras.
    Both,
    /// `_SPECTRUM_nnn` attributes only.
    Attributes,
    /// `extras.emitter` only.
    Extras,
}

/// Edition of LM-63.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub enum IesEdition {
    /// LM-63-2002: what every reader accepts.
    #[default]
    #[serde(rename = "LM-63-2002")]
    Lm63Of2002,
    /// LM-63-2019.
    #[serde(rename = "LM-63-2019")]
    Lm63Of2019,
}

/// One file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Artifact {
    /// Path in the zip and in the download list, forward slashes.
    pub name: String,
    /// Media type.
    pub media_type: &'static str,
    /// Content.
    pub bytes: Vec<u8>,
}

/// All files of a model, in the order of the zip.
///
/// # Errors
/// [`Error::Cancelled`].
pub fn write(model: &Model, options: &RunOptions, watch: StageWatch<'_>) -> Result<Vec<Artifact>, Error> {
    let _ = (model, options, watch);
    todo!()
}

/// The one zip of everything.
///
/// # Errors
/// [`Error::Unreadable`] when the archive cannot be written (not from memory).
pub fn zip(artifacts: &[Artifact]) -> Result<Vec<u8>, Error> {
    let _ = artifacts;
    todo!()
}
