//! `inspect`: what a file says of itself, and what its rays say. Users want these checks before they want a model.

use super::channel_argument;
use super::channel_argument::ChannelFile;
use super::terminal::argument;
use super::terminal::failure::Failure;
use super::terminal::output;
use super::terminal::progress::Progress;
use super::terminal::table::{Table, count, flux, number, triple};
use clap::Args;
use pipeline::{Header, Input, Inspection, Limits, Notice};
use service::telemetry::visible;
use std::path::{Path, PathBuf};

/// Arguments of `inspect`.
#[derive(Args)]
pub struct Arguments {
    /// The ray file, or an archive: every ray file in it, or only FILE:MEMBER. Values after a comma override what the file says.
    #[arg(value_name = "FILE[,KEY=VALUE]..", value_parser = channel_argument::channel, long_help = channel_argument::HELP)]
    file: ChannelFile,
    /// Print JSON instead of a table; one document for each ray file.
    #[arg(long)]
    json: bool,
    /// Folder for drawings of the ray origins and of the far field.
    #[arg(long, value_name = "DIR")]
    svg: Option<PathBuf>,
}

/// Reads the whole file once and prints what is in it.
///
/// # Errors
/// A file that cannot be read or is refused; the others in the same packed file are printed all the same.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let found = arguments.file.find()?;
    for (name, error) in &found.left_out {
        eprintln!("left out {} ({}): {}", visible(name), error.code(), visible(&error.to_string()));
    }
    let mut failed = None;
    for input in arguments.file.open_all(&found)? {
        let inspected = input.and_then(|input| one(arguments, &input));
        if let Some(earlier) = inspected.err().and_then(|new| failed.replace(new)) {
            eprintln!("{earlier}");
        }
    }
    failed.map_or(Ok(()), Err)
}

fn one(arguments: &Arguments, input: &Input) -> Result<(), Failure> {
    let progress = Progress::start();
    let inspected = pipeline::inspect(input, &Limits::default(), &progress);
    progress.finish();
    let inspection = inspected.map_err(|error| Failure::from(error).at(&input.name))?;
    if let Some(folder) = &arguments.svg {
        draw(&inspection, &input.name, folder)?;
    }
    if arguments.json {
        let text = serde_json::to_string_pretty(&inspection);
        let text = text.map_err(|error| Failure::failed("inspect.json", error.to_string(), "Leave out --json."))?;
        output::print(format_args!("{text}\n"))
    } else {
        let mut table = Table::default();
        table.row("file", ["name".into(), input.name.clone()]);
        table.row("file", ["sha256".into(), input.sha256.clone()]);
        header_rows(&mut table, &inspection.header);
        ray_rows(&mut table, &inspection);
        check_rows(&mut table, &inspection);
        notice_rows(&mut table, &inspection.notices);
        output::print(table)
    }
}

fn draw(inspection: &Inspection, name: &str, folder: &Path) -> Result<(), Failure> {
    std::fs::create_dir_all(folder).map_err(|error| Failure::disk(folder, &error))?;
    for drawing in pipeline::drawings(inspection, name) {
        // Several files of a packed one are drawn into one folder.
        let path = folder.join(format!("{}.{}", name.replace(['/', '\\'], "_"), drawing.name));
        std::fs::write(&path, &drawing.bytes).map_err(|error| Failure::disk(&path, &error))?;
    }
    Ok(())
}

fn header_rows(table: &mut Table, header: &Header) {
    table.row("file", ["format".into(), header.format.name().into()]);
    table.row("file", ["bytes".into(), count(header.byte_count)]);
    table.row("header", ["rays".into(), count(header.ray_count)]);
    table.row("header", ["flux".into(), flux(header.flux)]);
    table.row("header", ["spectrum".into(), header.spectrum.into()]);
    if let Some((low, high)) = header.table_range_nm {
        table.row("header", ["table".into(), format!("{} to {} nm", number(low), number(high))]);
    }
    for text in &header.texts {
        table.row("header", [text.name.clone(), text.value.clone()]);
    }
}

fn ray_rows(table: &mut Table, found: &Inspection) {
    let [used, refused, dropped] = [found.rays_used, found.rays_refused, found.rays_dropped].map(count);
    table.row("rays", ["used".into(), format!("{used}; refused {refused}, without flux {dropped}")]);
    table.row("rays", ["flux".into(), flux(found.flux)]);
    if let Some(ratio) = found.sum_over_header {
        table.row("rays", ["sum/header".into(), number(ratio)]);
    }
    if let Some(efficacy) = found.lm_per_w {
        table.row("rays", ["efficacy".into(), format!("{} lm/W", number(efficacy))]);
    }
    if let Some((low, high)) = found.wavelength_nm {
        table.row("rays", ["wavelength".into(), format!("{} to {} nm", number(low), number(high))]);
    }
    if let (Some(origins), Some(middle)) = (found.origins_mm, found.centroid_mm) {
        table.row("rays", ["origins".into(), format!("{} to {} mm", triple(origins.min), triple(origins.max))]);
        table.row("rays", ["middle".into(), format!("{} mm", triple(middle))]);
    }
    let toward = found.hemispheres.iter().map(|side| format!("{} {:.2} %", side.axis.name(), 100.0 * side.share));
    table.row("rays", ["toward".into(), toward.collect::<Vec<_>>().join(", ")]);
}

/// One line per check, with what to do below it; then the worst of them.
fn check_rows(table: &mut Table, found: &Inspection) {
    for check in &found.checks {
        table.row("checks", [check.verdict.name().into(), check.check.into(), check.message.clone()]);
        if let Some(remedy) = &check.remedy {
            let remedy = argument::with_keys(remedy, None);
            table.row("checks", [String::new(), String::new(), format!("→ {remedy}")]);
        }
    }
    table.row("verdict", [found.verdict.name().into()]);
}

/// One line per notice, with the channel it concerns.
pub fn notice_rows(table: &mut Table, notices: &[Notice]) {
    for notice in notices {
        let of = notice.channel.as_ref().map_or(String::new(), |channel| format!(" in {channel}"));
        let first = notice.first_ray.map_or(String::new(), |ray| format!(", first at ray {ray}"));
        table.row("notices", [format!("{} x {}{of}{first}: {}", notice.code, notice.count, notice.message)]);
    }
}
