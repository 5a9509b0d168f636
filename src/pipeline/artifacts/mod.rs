//! 6. Results to files: a name, a media type, bytes. No file holds a time of making: same input, options and version give the
//! same bytes.

/// Numbers as text: the one place where digits are counted.
mod number;
/// JSON that people can read too.
mod json;
/// What every artifact says of where it came from.
mod provenance;
/// Exitance at the vertices and the colour it shows.
mod exitance;
/// `emitter.glb`: the surface half of the contract.
pub mod gltf;
/// What the glTF's attributes mean: `meshes[0].extras.emitter`.
mod emitter;
/// `goniograms.json`: the angular half of the contract.
pub mod goniograms;
/// `ies/*.ies`: luminous intensities for lighting programs.
pub mod ies;
/// `spectra.csv`.
pub mod csv;
/// `plots/*.svg`.
pub mod svg;
/// `report.json`.
pub mod report;
/// `README.txt`.
pub mod readme;
/// A model made by hand, whose every number has a closed form.
#[cfg(test)]
mod fixture;

use super::model::Model;
use super::vocabulary::notice::Notices;
use super::vocabulary::watch::StageWatch;
use super::{Error, Options as RunOptions};
use serde::Serialize;
use std::io::{Cursor, Write as _};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, ZipWriter};

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

/// All files of a model, in the order of the zip: the page that explains the others first.
///
/// # Errors
/// [`Error::Cancelled`]; [`Error::Refused`] and [`Error::Unreadable`] as [`gltf::artifact`].
pub fn write(model: &Model, options: &RunOptions, watch: StageWatch<'_>) -> Result<Vec<Artifact>, Error> {
    let mut artifacts = vec![gltf::artifact(model, options)?];
    watch.step(0.3)?;
    artifacts.push(goniograms::artifact(model, options)?);
    watch.step(0.5)?;
    artifacts.extend(ies::artifacts(model, options));
    artifacts.extend(csv::artifact(model));
    watch.step(0.6)?;
    artifacts.extend(svg::polar::artifacts(model));
    artifacts.push(svg::zones::artifact(model));
    watch.step(0.7)?;
    artifacts.push(svg::hull::stage(model));
    watch.step(0.8)?;
    artifacts.push(svg::hull::exitance_map(model));
    watch.step(0.9)?;
    artifacts.push(report::artifact(model, options, &notices(model).to_vec())?);
    let names: Vec<&str> = artifacts.iter().map(|artifact| artifact.name.as_str()).collect();
    artifacts.insert(0, readme::artifact(model, &names));
    watch.step(1.0)?;
    Ok(artifacts)
}

/// What could not be written, and why.
fn notices(model: &Model) -> Notices {
    let mut notices = Notices::default();
    if model.goniograms.total.luminous_cd.is_none() {
        notices.add(
            "artifacts.no_ies",
            "No IES files: the luminous intensity is unknown, and LM-63 has no radiant unit. Give the source a spectrum.",
        );
    }
    if !model.spectral.has_bands() {
        notices
            .add("artifacts.no_spectra", "No vertex spectra and no spectra.csv: the spectrum of the rays is unknown.");
    }
    notices
}

/// The one zip of everything: files in order, deflated, dated 1980-01-01.
///
/// # Errors
/// [`Error::Unreadable`] when the archive cannot be written (not from memory).
pub fn zip(artifacts: &[Artifact]) -> Result<Vec<u8>, Error> {
    let options = SimpleFileOptions::default()
        .compression_method(CompressionMethod::Deflated)
        .last_modified_time(DateTime::DEFAULT)
        .unix_permissions(0o644);
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    for artifact in artifacts {
        let options = options.large_file(u32::try_from(artifact.bytes.len()).is_err());
        archive.start_file(artifact.name.as_str(), options).map_err(std::io::Error::other)?;
        archive.write_all(&artifact.bytes)?;
    }
    Ok(archive.finish().map_err(std::io::Error::other)?.into_inner())
}
