//! `combine`: models changed, and several as one, without their rays.

use super::build::write;
use super::inspect::notice_rows;
use super::model_argument;
use super::model_argument::ModelFile;
use super::terminal::destination::NewFolder;
use super::terminal::failure::Failure;
use super::terminal::output;
use super::terminal::progress::Progress;
use super::terminal::table::{Table, count, flux, percent};
use clap::Args;
use pipeline::{Component, Limits, Options, Outcome};
use std::path::{Path, PathBuf};

/// Arguments of `combine`.
#[derive(Args)]
pub struct Arguments {
    /// Models, in one coordinate frame; values after a comma change them.
    #[arg(required = true, value_name = "MODEL[,KEY=VALUE]..", value_parser = model_argument::model, long_help = model_argument::HELP)]
    models: Vec<ModelFile>,
    /// Folder for the results; must be empty, and is created if missing.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
}

/// Combines the models, writes the files of the whole, and prints what it is made of.
///
/// # Errors
/// A model cannot be read, its change cannot be made, they cannot be one, or the disk refuses an operation.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let folder = &arguments.output;
    let made = NewFolder::make(folder)?;
    let components = arguments.models.iter().map(ModelFile::open).collect::<Result<Vec<Component>, Failure>>()?;
    let progress = Progress::start_evaluating();
    let outcome = pipeline::combine(&components, &Options::default(), &Limits::default(), &progress);
    progress.finish();
    let outcome = outcome.map_err(|error| Failure::from(error).at(names(&arguments.models)))?;
    write(made, &outcome)?;
    output::print(summary(&outcome, folder))
}

fn names(models: &[ModelFile]) -> String {
    models.iter().map(|model| model.path.display().to_string()).collect::<Vec<_>>().join(" + ")
}

fn summary(outcome: &Outcome, folder: &Path) -> Table {
    let model = &outcome.model;
    let mut table = Table::default();
    for origin in &model.origins {
        table.row("models", [origin.name.clone(), flux(origin.flux), percent(origin.share_of(&model.flux), 1.0)]);
    }
    table.row("flux", ["of all".into(), flux(model.flux)]);
    table.row("hull", ["vertices".into(), count(model.hull.vertices_mm.len() as u64)]);
    table.row("zones", ["of all".into(), count(model.goniograms.zones.len() as u64)]);
    notice_rows(&mut table, &outcome.notices);
    let written: u64 = outcome.artifacts.iter().map(|artifact| artifact.bytes.len() as u64).sum();
    let files = outcome.artifacts.len();
    table.row("written", [format!("{files} files, {} bytes, and model.zip in {}", count(written), folder.display())]);
    table
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::command::rays::stored;
    use crate::command::rays::tests::model;
    use clap::Parser;
    use pipeline::model::evaluation::{Evaluator, Quantity};
    use std::fs;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        arguments: Arguments,
    }

    fn told(line: &str) -> Result<(), String> {
        let parsed = Line::try_parse_from(format!("combine {line}").split(' ')).map_err(|error| error.to_string())?;
        run(&parsed.arguments).map_err(|failure| failure.to_string())
    }

    #[test]
    fn a_folder_and_a_zip_become_one_model_that_can_be_combined_again() {
        let folder = model(20_000);
        let at = |name: &str| folder.path().join(name).display().to_string();
        told(&format!("{} {},scale=0.5,move=0:0:-1 -o {}", at(""), at("model.zip"), at("both"))).unwrap();
        let both = stored(&folder.path().join("both").join("model.zip")).unwrap();
        let flux = |model| Evaluator::new(model, Quantity::Radiant).unwrap().flux();
        assert!((flux(&both) - 1.5).abs() < 1e-6, "{}", flux(&both));
        assert_eq!(both.name, "lamp + lamp");
        told(&format!("{},flux=3W,name=two -o {}", at("both"), at("again"))).unwrap();
        assert!((flux(&stored(&folder.path().join("again")).unwrap()) - 3.0).abs() < 1e-6);
        let report = fs::read_to_string(folder.path().join("again").join("report.json")).unwrap();
        let report: serde_json::Value = serde_json::from_str(&report).unwrap();
        assert_eq!(report["models"][0]["flux_factor"], 2.0);
        assert_eq!(report["models"][0]["provenance"]["models"][1]["move_mm"], serde_json::json!([0.0, 0.0, -1.0]));
    }

    #[test]
    fn what_cannot_be_is_told() {
        let folder = model(20_000);
        let at = |name: &str| folder.path().join(name).display().to_string();
        for (models, code) in [
            (format!("{} -o {}", at(""), at("")), "output.not_empty"),
            (format!("{},scale=0 -o {}", at(""), at("new")), "combination.change"),
            (format!("{} -o {}", at("README.txt"), at("new")), "model.not_model"),
            (format!("{} -o {}", at("nowhere"), at("new")), "file.disk"),
            (format!("-o {}", at("new")), "required"),
        ] {
            let error = told(&models).unwrap_err();
            assert!(error.contains(code), "{models}: {error}");
        }
        assert!(!folder.path().join("new").exists());
    }
}
