//! `build`: the pipeline without a server. Ray files in, a folder of artifacts and a closing table out.

use super::channel_argument;
use super::channel_argument::ChannelFile;
use super::choices::Choices;
use super::inspect::notice_rows;
use super::terminal::destination::NewFolder;
use super::terminal::failure::Failure;
use super::terminal::progress::Progress;
use super::terminal::table::{Table, count, flux, number, percent, triple};
use super::terminal::{measure, output};
use clap::Args;
use pipeline::artifacts::zip;
use pipeline::flux::balance::Share;
use pipeline::hull::Label;
use pipeline::model::Model;
use pipeline::model::channel::Origin;
use pipeline::model::study::View;
use pipeline::{Declared, Input, Limits, Outcome, Stage, Total};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Arguments of `build`.
#[derive(Args)]
pub struct Arguments {
    /// Ray files of one source, in one coordinate frame; FILE:MEMBER names a file in a zip. Values after a comma override what
    /// the file says.
    #[arg(required = true, value_name = "FILE[,KEY=VALUE]..", value_parser = channel_argument::channel, long_help = channel_argument::HELP)]
    files: Vec<ChannelFile>,
    /// Total flux of the source, of which every file has a share, for example 1.2W or 337lm.
    #[arg(long, value_name = "FLUX", allow_hyphen_values = true, value_parser = channel_argument::total)]
    total: Option<Total>,
    /// Folder for the results; must be empty, and is created if missing.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    #[command(flatten)]
    choices: Choices,
    /// Number of threads [default: as many as the machine has].
    #[arg(long, value_name = "N", value_parser = measure::at_least_one::<usize>)]
    threads: Option<usize>,
}

/// Builds the model, writes its files, prints the closing table on stdout.
///
/// # Errors
/// A file cannot be read or is refused, an option is not valid, or the disk refuses an operation.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let mut options = arguments.choices.0.clone();
    options.rays.total = arguments.total;
    options.validate()?;
    let folder = &arguments.output;
    let made = NewFolder::make(folder)?;
    let inputs = arguments.files.iter().map(ChannelFile::open).collect::<Result<Vec<Input>, Failure>>()?;
    let progress = Progress::start();
    let outcome = on_threads(arguments.threads, || pipeline::run(&inputs, &options, &Limits::default(), &progress))?;
    let times = progress.finish();
    let outcome = outcome.map_err(|error| Failure::from(error).at(names(&inputs)))?;
    write(made, &outcome)?;
    output::print(summary(&outcome, &times, folder))
}

fn names(inputs: &[Input]) -> String {
    inputs.iter().map(|input| input.name.as_str()).collect::<Vec<_>>().join(" + ")
}

fn on_threads<T: Send>(threads: Option<usize>, work: impl FnOnce() -> T + Send) -> Result<T, Failure> {
    let Some(threads) = threads else { return Ok(work()) };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    let pool =
        pool.map_err(|error| Failure::usage("build.threads", error.to_string(), "Use fewer threads: --threads."))?;
    Ok(pool.install(work))
}

/// Writes every file of a model, and its zip.
///
/// # Errors
/// What the disk answers.
pub fn write(mut folder: NewFolder, outcome: &Outcome) -> Result<(), Failure> {
    for artifact in &outcome.artifacts {
        folder.put(&artifact.name, &artifact.bytes)?;
    }
    folder.put("model.zip", &zip(&outcome.artifacts)?)?;
    folder.keep();
    Ok(())
}

/// The closing table: what went in, what came out, where the time went.
fn summary(outcome: &Outcome, times: &[(Stage, Duration)], folder: &Path) -> Table {
    let model = &outcome.model;
    let mut table = Table::default();
    ray_rows(&mut table, model);
    channel_rows(&mut table, model);
    hull_rows(&mut table, model);
    flux_rows(&mut table, model);
    quality_rows(&mut table, model);
    zone_rows(&mut table, model);
    time_rows(&mut table, times, model.surface.balance.incoming.rays);
    notice_rows(&mut table, &outcome.notices);
    let written: u64 = outcome.artifacts.iter().map(|artifact| artifact.bytes.len() as u64).sum();
    let files = outcome.artifacts.len();
    table.row("written", [format!("{files} files, {} bytes, and model.zip in {}", count(written), folder.display())]);
    table
}

fn ray_rows(table: &mut Table, model: &Model) {
    for origin in &model.origins {
        let lost = origin.ray_count.saturating_sub(origin.rays_used);
        let [read, used, lost] = [origin.ray_count, origin.rays_used, lost].map(count);
        table.row("rays", [format!("{}: {}", origin.name, origin.format)]);
        table.row("rays", [format!("read {read}, used {used}, refused or dropped {lost}")]);
    }
}

/// What each channel gives to the source, if there are several channels or a declaration.
fn channel_rows(table: &mut Table, model: &Model) {
    let declared = |origin: &Origin| origin.declared != Declared::default();
    if model.origins.len() < 2 && !model.origins.iter().any(declared) {
        return;
    }
    for origin in &model.origins {
        let from = match &origin.declared.spectrum {
            Some(_) => ", declared",
            None => "",
        };
        let flux = format!("{}{}", flux(origin.flux), if origin.fixed.is_some() { ", declared" } else { "" });
        let share = percent(origin.share_of(&model.flux), 1.0);
        table.row("channels", [origin.channel.clone(), flux, share, format!("spectrum: {}{from}", origin.spectrum)]);
    }
}

fn hull_rows(table: &mut Table, model: &Model) {
    let hull = &model.hull;
    let by_label = [Label::Projected, Label::Stitched, Label::Filled].map(|label| count(hull.count(label) as u64));
    let [projected, stitched, filled] = by_label;
    let all = count(hull.triangles.len() as u64);
    let check = match hull.check().as_slice() {
        [] => "sound".to_owned(),
        [first, rest @ ..] => format!("broken: {first}, and {} more", rest.len()),
    };
    table.row("hull", ["vertices".into(), count(hull.vertices_mm.len() as u64)]);
    table.row(
        "hull",
        ["triangles".into(), format!("{all}: {projected} projected, {stitched} stitched, {filled} filled")],
    );
    table.row("hull", ["parts".into(), hull.part_count().to_string()]);
    table.row("hull", ["area".into(), format!("{} mm2", number(hull.total_area_mm2()))]);
    table.row("hull", ["box".into(), format!("{} mm", triple(hull.bounds_mm().size().to_array()))]);
    table.row("hull", ["check".into(), check]);
}

fn flux_rows(table: &mut Table, model: &Model) {
    let balance = &model.surface.balance;
    let fates: [(&str, Share); 4] =
        [("in", balance.incoming), ("hit", balance.hit), ("snapped", balance.snapped), ("rejected", balance.rejected)];
    for (fate, share) in fates {
        let portion = percent(share.flux.primary(), balance.incoming.flux.primary());
        table.row("flux", [fate.into(), format!("{}; {} rays; {portion}", flux(share.flux), count(share.rays))]);
    }
    table.row("flux", ["out".into(), flux(balance.after_smoothing)]);
}

/// Where the light was put, and how far a model of a part of the rays is from the others.
fn quality_rows(table: &mut Table, model: &Model) {
    let Some(study) = &model.study else { return };
    if let Some(surface) = study.surface() {
        let of = match study.candidates.len() {
            1 => String::new(),
            tried => format!("best of {tried}"),
        };
        table.row("light", ["put".into(), surface.to_string(), of]);
    }
    for view in [View::Plane(0.5), View::Plane(2.0), View::FarField] {
        if let Some(figure) = study.figures.iter().find(|figure| figure.view == view) {
            table.row("error", [view.to_string(), figure.to_string()]);
        }
    }
}

fn zone_rows(table: &mut Table, model: &Model) {
    let goniograms = &model.goniograms;
    let frame = &goniograms.frame;
    let lit = goniograms.zones.len();
    let rays = goniograms.zones.iter().map(|zone| zone.goniogram.rays);
    let (fewest, most) = rays.fold((f64::INFINITY, 0.0_f64), |(low, high), rays| (low.min(rays), high.max(rays)));
    let layout = match &goniograms.lattice {
        Some(lattice) => format!("{} x {} lattice, {lit} lit", lattice.columns, lattice.rows),
        None => format!("{lit} along the surface"),
    };
    table.row("zones", ["layout".into(), layout]);
    table.row("zones", ["frame".into(), format!("gamma 0 at {}, C0 at {}", frame.nadir.name(), frame.c0.name())]);
    if lit > 0 {
        let [fewest, most] = [fewest, most].map(|rays| count(rays.round() as u64));
        table.row("zones", ["rays".into(), format!("{fewest} to {most} per zone")]);
    }
}

fn time_rows(table: &mut Table, times: &[(Stage, Duration)], rays: u64) {
    for (stage, time) in times {
        let seconds = time.as_secs_f64();
        let rate = match stage {
            Stage::Model | Stage::Artifacts => String::new(),
            _ => format!("{} rays/s", count((rays as f64 / seconds.max(1e-6)) as u64)),
        };
        table.row("time", [stage.name().into(), format!("{seconds:.2} s"), rate]);
    }
    let total: f64 = times.iter().map(|(_, time)| time.as_secs_f64()).sum();
    table.row("time", ["all".into(), format!("{total:.2} s"), String::new()]);
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;
    use pipeline::Options;
    use pipeline::options::{IesEdition, Spectra, Zones};
    use pipeline::vocabulary::space::Axis;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        build: Arguments,
    }

    fn options(flags: &str) -> Result<Options, clap::Error> {
        let line = format!("build a.ray -o out {flags}");
        Line::try_parse_from(line.split_whitespace()).map(|line| line.build.choices.0)
    }

    #[test]
    fn no_flag_is_the_pipelines_default() {
        assert_eq!(options("").unwrap(), Options::default());
    }

    #[test]
    fn every_flag_arrives() {
        let given = "--resolution 40 --max-edge .5 --zones 4x2 --nadir -Z --c0 Y --gamma-step 2.5 --c-step 15 \
                     --bands 400:700:20 --no-smoothing --spectra extras --ies-edition 2019";
        let mut expected = Options::default();
        expected.hull.resolution = Some(40);
        expected.hull.max_edge_mm = Some(0.5);
        expected.goniogram.zones = Some(Zones { columns: 4, rows: 2 });
        expected.goniogram.nadir_axis = Some(Axis::NegZ);
        expected.goniogram.c0_axis = Some(Axis::PosY);
        expected.goniogram.gamma_step_deg = Some(2.5);
        expected.goniogram.c_step_deg = Some(15.0);
        expected.rays.band_edges_nm = Some((0..=15).map(|k| 400.0 + 20.0 * f64::from(k)).collect());
        expected.flux.smoothing = Some(false);
        expected.goniogram.smoothing = Some(false);
        expected.artifacts.spectra = Some(Spectra::Extras);
        expected.artifacts.ies_edition = Some(IesEdition::Lm63Of2019);
        assert_eq!(options(given).unwrap(), expected);
    }

    #[test]
    fn nonsense_is_wrong_usage() {
        for flags in [
            "--zones 4",
            "--zones 4xx",
            "--nadir up",
            "--bands 700:400:10",
            "--bands 400:700",
            "--spectra x",
            "--resolution 40.5",
            "--resolution -5",
            "--zones 4.5x4",
        ] {
            assert_eq!(options(flags).unwrap_err().exit_code(), 2, "{flags}");
        }
    }

    #[test]
    fn options_that_cannot_be_used_are_said_before_anything_is_touched() {
        let folder = tempfile::tempdir().unwrap();
        let output = folder.path().join("out");
        let line = ["build", "no-such.ray", "--gamma-step", "7", "-o"].map(Into::into);
        let line = line.into_iter().chain([output.clone().into_os_string()]);
        let failure = run(&Line::try_parse_from(line).unwrap().build).unwrap_err();
        assert!(failure.to_string().contains("where  --gamma-step"), "{failure}");
        assert!(!output.exists());
    }
}
