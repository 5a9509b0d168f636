//! 6. Results to files: a name, a media type, bytes. No file holds a time of making: same input, options and version give the
//! same bytes.

/// Files as one.
mod archive;
/// What every artifact says of where it came from.
mod provenance;
/// What several artifacts say alike.
mod facts;
/// Exitance at the vertices and the colour it shows.
mod exitance;
/// `emitter.glb`: the surface half of the contract.
pub mod gltf;
/// `goniograms.json`: the angular half of the contract.
pub mod goniograms;
/// What the files of photometry say alike.
mod photometry;
/// `ies/*.ies`: luminous intensities for lighting programs.
pub mod ies;
/// `ies/*.ldt`: the same as EULUMDAT.
pub mod ldt;
/// `total.tm33.xml`: the far field with W and spectra.
pub mod tm33;
/// `source.gldf`: the surface and its zones for lighting programs.
pub mod gldf;
/// `spectra.csv`.
pub mod spectra_csv;
/// Choice of the surface and proof of the model, in the report.
mod proof;
/// `report.json`.
pub mod report;
/// `README.txt`.
pub mod readme;
/// A model back from its own files.
pub mod read;
/// A model made by hand, whose every number has a closed form.
#[cfg(test)]
mod fixture;
/// The drawings of a model, `plots/*.svg`.
pub mod plots;

pub use archive::zip;

use crate::error::Error;
use crate::inspection::findings::Inspection;
use crate::model::Model;
use crate::options::Options as RunOptions;
use crate::vocabulary::notice::Notices;
use crate::vocabulary::watch::StageWatch;
use crate::writing::{Artifact, schema};

/// All files of a model, in the order of the zip: the page that explains the others first.
///
/// # Errors
/// [`Error::Cancelled`]; [`Error::Refused`] and [`Error::Internal`] as [`gltf::artifact`].
pub fn write(model: &Model, options: &RunOptions, watch: StageWatch<'_>) -> Result<Vec<Artifact>, Error> {
    let mut artifacts = vec![gltf::artifact(model, options)?];
    watch.step(0.3)?;
    artifacts.push(goniograms::artifact(model, options)?);
    watch.step(0.5)?;
    artifacts.extend(ies::artifacts(model, options));
    artifacts.extend(ldt::artifacts(model));
    artifacts.extend(tm33::artifact(model));
    artifacts.extend(gldf::artifact(model)?);
    artifacts.extend(spectra_csv::artifact(model));
    watch.step(0.6)?;
    artifacts.extend(plots::polar::artifacts(model));
    artifacts.push(plots::zones::artifact(model));
    watch.step(0.7)?;
    artifacts.push(plots::hull::stage(model));
    watch.step(0.8)?;
    artifacts.push(plots::hull::exitance_map(model));
    artifacts.extend(model.volume.as_ref().map(|volume| plots::volume::artifact(model, volume)));
    artifacts.extend(model.study.as_ref().and_then(|study| plots::quality::artifact(model, study)));
    watch.step(0.9)?;
    let notices = notices(model).to_vec();
    artifacts.push(report::artifact(model, options, &notices)?);
    let names: Vec<&str> = artifacts.iter().map(|artifact| artifact.name.as_str()).collect();
    artifacts.insert(0, readme::artifact(model, &notices, &names));
    watch.step(1.0)?;
    Ok(artifacts)
}

/// What could not be written, and why.
pub fn notices(model: &Model) -> Notices {
    let mut notices = Notices::default();
    if !model.is_visible() {
        notices.add(
            "artifacts.no_ies",
            "No IES, EULUMDAT and GLDF files: the luminous intensity is unknown or 0, and these formats have no radiant unit. Give the source a spectrum.",
        );
    }
    if !model.spectral.has_bands() {
        notices
            .add("artifacts.no_spectra", "No vertex spectra and no spectra.csv: the spectrum of the rays is unknown.");
    }
    let is_proven = model.study.as_ref().is_some_and(|study| !study.figures.is_empty());
    if !is_proven && model.ancestors.is_empty() {
        let rays: u64 = model.origins.iter().map(|origin| origin.rays_used).sum();
        notices.add(
            "artifacts.not_verified",
            format!(
                "Nothing was proven: {rays} rays that can be used are too few for some of them to judge a model made of the others, so nothing tells \
                 how far the model is from the lamp. Take a ray file with more rays."
            ),
        );
    }
    if tm33::leaves_out_spectra(model) {
        notices.add(
            "artifacts.no_angular_spectrum",
            "total.tm33.xml has the spectrum of the whole source, not that of each direction, which would be more than 200 000 numbers. goniograms.json has both.",
        );
    }
    notices
}

/// The published schemas, `openapi/<name>.schema.json`: of the three documents above, and of the inspection of a file.
pub fn schemas() -> Vec<(&'static str, serde_json::Value)> {
    vec![
        ("goniograms", schema::of::<goniograms::Document<'_>>()),
        ("report", schema::of::<report::Report<'_>>()),
        ("emitter-extras", schema::of::<gltf::emitter::Emitter<'_>>()),
        ("inspection", schema::of::<Inspection>()),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::source::Columns;
    use crate::vocabulary::watch::{NoProgress, Stage, Watch};
    use ::zip::DateTime;
    use serde_json::Value;
    use std::io::{Cursor, Read as _};

    const GONIOGRAMS: &str = include_str!("../../../openapi/goniograms.schema.json");
    const REPORT: &str = include_str!("../../../openapi/report.schema.json");
    const EXTRAS: &str = include_str!("../../../openapi/emitter-extras.schema.json");

    fn written(model: &Model) -> Vec<Artifact> {
        write(model, &RunOptions::default(), StageWatch::enter(&NoProgress, Stage::Artifacts).unwrap()).unwrap()
    }

    fn names(artifacts: &[Artifact]) -> Vec<&str> {
        artifacts.iter().map(|artifact| artifact.name.as_str()).collect()
    }

    /// A source in W without any spectrum.
    fn radiant_only() -> Model {
        let mut model = fixture::model();
        model.spectral.columns = Columns::None;
        model.flux.luminous_lm = None;
        for amounts in [&mut model.surface.vertices, &mut model.surface.triangles] {
            amounts.luminous_lm = None;
        }
        let balance = &mut model.surface.balance;
        for share in [&mut balance.incoming, &mut balance.hit, &mut balance.snapped, &mut balance.rejected] {
            share.flux.luminous_lm = None;
        }
        let zones = model.goniograms.zones.iter_mut().map(|zone| &mut zone.goniogram);
        for goniogram in zones.chain([&mut model.goniograms.total]) {
            goniogram.flux.luminous_lm = None;
            goniogram.luminous_cd = None;
            goniogram.spectral_w_per_sr_nm.clear();
            goniogram.spectral_flux_w_per_nm.clear();
        }
        model
    }

    fn hostile() -> Model {
        let mut model = fixture::model();
        let name = format!("</svg><script>\"&\u{0}\u{1b}\u{ffff}\u{202e}TILT=\r\n../../etc {}", "é".repeat(10_000));
        model.origins[0].texts = vec![(name.clone(), name.clone())];
        model.origins[0].name = name;
        model
    }

    fn assert_valid(schema: &str, document: &Value) {
        let validator = jsonschema::validator_for(&serde_json::from_str(schema).unwrap()).unwrap();
        let errors: Vec<String> = validator.iter_errors(document).map(|error| error.to_string()).collect();
        assert!(errors.is_empty(), "{errors:#?}");
    }

    fn json_of(artifacts: &[Artifact], name: &str) -> Value {
        let artifact = artifacts.iter().find(|artifact| artifact.name == name).unwrap();
        serde_json::from_slice(&artifact.bytes).unwrap()
    }

    fn extras_of(artifacts: &[Artifact]) -> Value {
        let glb = &artifacts.iter().find(|artifact| artifact.name == gltf::NAME).unwrap().bytes;
        let length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
        let document: Value = serde_json::from_slice(&glb[20..20 + length]).unwrap();
        document["meshes"][0]["extras"]["emitter"].clone()
    }

    #[test]
    fn every_document_satisfies_its_schema() {
        for model in [fixture::model(), radiant_only(), hostile()] {
            let artifacts = written(&model);
            assert_valid(GONIOGRAMS, &json_of(&artifacts, goniograms::NAME));
            assert_valid(REPORT, &json_of(&artifacts, report::NAME));
            assert_valid(EXTRAS, &extras_of(&artifacts));
        }
    }

    #[test]
    fn the_schemas_refuse_what_they_should() {
        let artifacts = written(&fixture::model());
        let mut document = json_of(&artifacts, goniograms::NAME);
        document["zones"][0]["luminous_intensity_cd"][0][0] = Value::from(-1.0);
        let validator = jsonschema::validator_for(&serde_json::from_str(GONIOGRAMS).unwrap()).unwrap();
        assert!(!validator.is_valid(&document));
        let mut document = json_of(&artifacts, report::NAME);
        document["balance"]["hit"].as_object_mut().unwrap().remove("rays");
        let validator = jsonschema::validator_for(&serde_json::from_str(REPORT).unwrap()).unwrap();
        assert!(!validator.is_valid(&document));
    }

    #[test]
    fn files_come_in_the_order_of_the_zip_and_say_what_is_missing() {
        let all = written(&fixture::model());
        let expected = [
            "README.txt",
            "emitter.glb",
            "goniograms.json",
            "ies/total.ies",
            "ies/zone_00_00.ies",
            "ies/zone_00_01.ies",
            "ies/total.ldt",
            "ies/zone_00_00.ldt",
            "ies/zone_00_01.ldt",
            "total.tm33.xml",
            "source.gldf",
            "spectra.csv",
            "plots/polar_total.svg",
            "plots/polar_zone_00_00.svg",
            "plots/polar_zone_00_01.svg",
            "plots/zones.svg",
            "plots/hull_stage.svg",
            "plots/hull_exitance.svg",
            "report.json",
        ];
        assert_eq!(names(&all), expected);
        let told = &json_of(&all, report::NAME)["notices"];
        assert_eq!((told.as_array().unwrap().len(), &told[0]["code"]), (1, &"artifacts.not_verified".into()));
        let radiant = written(&radiant_only());
        assert!(names(&radiant).iter().all(|name| {
            !name.starts_with("ies/") && !["spectra.csv", "total.tm33.xml", "source.gldf"].contains(name)
        }));
        let report = json_of(&radiant, report::NAME);
        let codes: Vec<&str> =
            report["notices"].as_array().unwrap().iter().map(|notice| notice["code"].as_str().unwrap()).collect();
        assert_eq!(codes, ["artifacts.no_ies", "artifacts.no_spectra", "artifacts.not_verified"]);
        assert_eq!(report["flux"]["luminous_lm"], Value::Null);
    }

    #[test]
    fn hostile_names_reach_no_path_and_no_markup() {
        for artifact in written(&hostile()) {
            assert!(artifact.name.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"/._".contains(&byte)));
            if artifact.media_type == "image/svg+xml" {
                let text = String::from_utf8(artifact.bytes).unwrap();
                assert!(
                    !text.contains("<script") && !text.contains(['\u{0}', '\u{1b}', '\u{ffff}']),
                    "{}",
                    artifact.name
                );
                assert_eq!(text.matches("</svg>").count(), 1);
            }
        }
    }

    #[test]
    fn numbers_that_are_not_finite_are_refused() {
        let mut model = fixture::model();
        model.goniograms.total.radiant_w_per_sr.as_mut().unwrap()[7] = f64::NAN;
        let watch = StageWatch::enter(&NoProgress, Stage::Artifacts).unwrap();
        assert!(matches!(write(&model, &RunOptions::default(), watch), Err(Error::Internal(_))));
    }

    #[test]
    fn the_same_model_gives_the_same_zip_and_a_foreign_reader_gets_it_back() {
        let artifacts = written(&fixture::model());
        let bytes = zip(&artifacts).unwrap();
        assert_eq!(bytes, zip(&written(&fixture::model())).unwrap());
        let mut archive = ::zip::ZipArchive::new(Cursor::new(bytes)).unwrap();
        assert_eq!(archive.len(), artifacts.len());
        for (at, artifact) in artifacts.iter().enumerate() {
            let mut file = archive.by_index(at).unwrap();
            assert_eq!(file.name().unwrap(), artifact.name);
            assert_eq!(file.last_modified(), Some(DateTime::DEFAULT));
            let mut content = Vec::new();
            file.read_to_end(&mut content).unwrap();
            assert_eq!(content, artifact.bytes);
        }
    }

    #[test]
    fn cancelling_stops_the_writing() {
        struct Impatient(std::sync::atomic::AtomicU32);
        impl Watch for Impatient {
            fn progress(&self, _: Stage, _: f64) {}
            fn cancelled(&self) -> bool {
                self.0.fetch_add(1, std::sync::atomic::Ordering::Relaxed) >= 2
            }
        }
        let watch = Impatient(Default::default());
        let watch = StageWatch::enter(&watch, Stage::Artifacts).unwrap();
        assert!(matches!(write(&fixture::model(), &RunOptions::default(), watch), Err(Error::Cancelled)));
    }
}
