//! `inspect`: what a file says of itself, and what its rays say. Users want these checks before they want a model, and scripts the verdict.

use super::channel_argument;
use super::channel_argument::ChannelFile;
use super::terminal::argument;
use super::terminal::destination::{NewFile, can_be_folder, make_folder};
use super::terminal::failure::Failure;
use super::terminal::output;
use super::terminal::progress::Progress;
use super::terminal::table::{Table, count, flux, number, triple};
use clap::Args;
use pipeline::{DRAWINGS, Header, Input, Inspection, Limits, Notice, Verdict};
use service::telemetry::visible;
use std::collections::BTreeSet;
use std::path::PathBuf;
use std::process::ExitCode;

/// Arguments of `inspect`.
#[derive(Args)]
pub struct Arguments {
    /// Ray files, one after another; of an archive every ray file in it, or only FILE:MEMBER. Values after a comma override what the file says.
    #[arg(required = true, value_name = "FILE[,KEY=VALUE]..", value_parser = channel_argument::channel, long_help = channel_argument::HELP)]
    files: Vec<ChannelFile>,
    /// Print JSON instead of a table; one document for each ray file.
    #[arg(long)]
    json: bool,
    /// Folder for drawings of the ray origins and of the far field.
    #[arg(long, value_name = "DIR")]
    svg: Option<PathBuf>,
    /// Replace drawings that are there.
    #[arg(long, requires = "svg")]
    force: bool,
}

/// Exit code where a verdict is `wrong`: 1 is of files that could not be inspected at all.
pub const WRONG: u8 = 3;

/// Reads the whole file once and prints what is in it. The exit code tells a script the verdict.
///
/// # Errors
/// A file that cannot be read or is refused; the others in the same packed file are printed all the same. A drawing that is there already.
pub fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let (mut failed, mut worst, mut drawn) = (None, Verdict::Ok, BTreeSet::new());
    for inspected in arguments.files.iter().flat_map(|file| each(arguments, file, &mut drawn)) {
        match inspected {
            Ok(verdict) => worst = worst.max(verdict),
            Err(new) => {
                if let Some(earlier) = failed.replace(new) {
                    eprintln!("{earlier}");
                }
            }
        }
    }
    let told = if worst == Verdict::Wrong { ExitCode::from(WRONG) } else { ExitCode::SUCCESS };
    failed.map_or(Ok(told), Err)
}

/// Inspects the ray files that `file` is or holds, one after another; `drawn` are the names of drawings that others of this call have.
fn each(arguments: &Arguments, file: &ChannelFile, drawn: &mut BTreeSet<String>) -> Vec<Result<Verdict, Failure>> {
    let mut all = || {
        let found = file.find()?;
        for (name, error) in &found.left_out {
            eprintln!("left out {} ({}): {}", visible(name), error.code(), visible(error.found()));
        }
        let names: Vec<String> = found.names().map(|name| of_its_own(name, drawn)).collect();
        for name in &names {
            drawings(arguments, name)?;
        }
        Ok(file.open_all(&found)?.zip(&names).map(|(input, name)| one(arguments, &input?, name)).collect())
    };
    all().unwrap_or_else(|failure| vec![Err(failure)])
}

/// The name that the drawings of the ray file `name` begin with: numbered where another file of the same name was drawn before.
fn of_its_own(name: &str, drawn: &mut BTreeSet<String>) -> String {
    let plain = name.replace(['/', '\\'], "_");
    let mut own = plain.clone();
    for number in 2_u32.. {
        if drawn.insert(own.clone()) {
            break;
        }
        own = format!("{plain}.{number}");
    }
    own
}

fn one(arguments: &Arguments, input: &Input, name: &str) -> Result<Verdict, Failure> {
    let progress = Progress::start();
    let inspected = pipeline::inspect(input, &Limits::default(), &progress);
    progress.finish();
    let inspection = inspected.map_err(|error| Failure::from(error).at(&input.name))?;
    if let Some(folder) = &arguments.svg {
        make_folder(folder)?;
        let files = drawings(arguments, name)?;
        for (drawing, file) in pipeline::drawings(&inspection, &input.name).iter().zip(files) {
            file.write_all(&drawing.bytes)?;
        }
    }
    if arguments.json {
        let text = serde_json::to_string_pretty(&inspection);
        let text = text.map_err(|error| Failure::failed("inspect.json", error.to_string(), "Leave out --json."))?;
        output::print(format_args!("{text}\n"))?;
    } else {
        let mut table = Table::default();
        table.row("file", ["name".into(), input.name.clone()]);
        table.row("file", ["sha256".into(), input.sha256.clone()]);
        header_rows(&mut table, &inspection.header);
        ray_rows(&mut table, &inspection);
        check_rows(&mut table, &inspection);
        notice_rows(&mut table, &inspection.notices);
        output::print(table)?;
    }
    Ok(inspection.verdict)
}

/// The drawings that begin with `name`: several files of a packed one are drawn into one folder, which is made when there is a drawing.
///
/// # Errors
/// One is there, and is not to be replaced.
fn drawings(arguments: &Arguments, name: &str) -> Result<Vec<NewFile>, Failure> {
    let Some(folder) = &arguments.svg else { return Ok(Vec::new()) };
    can_be_folder(folder)?;
    if !folder.exists() {
        return Ok(Vec::new());
    }
    let path = |drawing: &str| folder.join(format!("{name}.{drawing}"));
    DRAWINGS.into_iter().map(|drawing| NewFile::at(&path(drawing), arguments.force)).collect()
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
        table.row("checks", [check.verdict.name().into(), check.check.into(), argument::in_flags(&check.message)]);
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
        table.row(
            "notices",
            [format!("{} x {}{of}{first}: {}", notice.code, notice.count, argument::in_flags(&notice.message))],
        );
    }
}
