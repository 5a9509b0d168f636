//! `sample`: known sources as ray files, for trying things out and for judging this and other programs.

use super::terminal::destination::NewFile;
use super::terminal::failure::Failure;
use super::terminal::table::Table;
use super::terminal::{argument, measure, output};
use clap::Args;
use pipeline::known_sources;
use pipeline::known_sources::KnownSource;
use pipeline::vocabulary::space::Axis;
use std::io::{BufWriter, Write};
use std::path::PathBuf;

/// Arguments of `sample`.
#[derive(Args)]
pub struct Arguments {
    /// Name of the source; `--list` shows all.
    name: Option<String>,
    /// List the known sources.
    #[arg(long, exclusive = true)]
    list: bool,
    /// Number of rays: 1000000 or 1e6.
    #[arg(short = 'n', long, value_name = "N", default_value_t = 1_000_000, value_parser = measure::rays)]
    rays: u64,
    /// Seed of the random numbers; the same seed gives the same file on every machine.
    #[arg(long, value_name = "S", default_value_t = 1, value_parser = measure::whole::<u64>)]
    seed: u64,
    /// Direction of the +Z axis of the source: +X -X +Y -Y +Z -Z.
    #[arg(long, value_name = "AXIS", default_value = "+Z", allow_hyphen_values = true, value_parser = argument::axis)]
    axis: Axis,
    /// The file to write [default: NAME.tm25ray].
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Replace the file if it exists.
    #[arg(long)]
    force: bool,
}

/// Lists the known sources, or writes one.
///
/// # Errors
/// The name is not that of a known source; the file exists; or the disk refuses an operation.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    if arguments.list {
        return output::print(catalogue());
    }
    let unknown = || {
        Failure::usage(
            "sample.unknown",
            "There is no known source with this name.",
            "lampwright sample --list shows all sources.",
        )
    };
    let unnamed =
        || Failure::usage("sample.unnamed", "No known source is named.", "lampwright sample --list shows all sources.");
    let name = arguments.name.as_ref().ok_or_else(unnamed)?;
    let source = known_sources::by_name(name).ok_or_else(|| unknown().at(name))?.rotate(arguments.axis);
    let path = arguments.output.clone().unwrap_or_else(|| PathBuf::from(format!("{name}.tm25ray")));
    let size = known_sources::tm25_bytes(&source, arguments.rays).map_err(|error| Failure::disk(&path, &error))?;
    let file = NewFile::at(&path, arguments.force)?.of_size(size)?;
    write(&source, arguments, &file)?;
    let place = path.display().to_string();
    let (place, seed) = (output::visible(&place), arguments.seed);
    output::print(format_args!("{place}: {} rays of {name}, seed {seed}\n", arguments.rays))
}

fn write(source: &KnownSource, arguments: &Arguments, file: &NewFile) -> Result<(), Failure> {
    let written = file.write(|file| {
        let mut out = BufWriter::new(file);
        known_sources::write_tm25(source, arguments.rays, arguments.seed, &mut out)?;
        Ok(out.flush()?)
    });
    written.map_err(|failed| file.failure(failed))
}

fn catalogue() -> Table {
    let mut table = Table::default();
    for source in known_sources::all() {
        table.row(source.name, [source.description.to_owned()]);
    }
    table
}
