//! `convert`: a ray file as another, for programs that read only one of them.

use super::channel_argument;
use super::channel_argument::ChannelFile;
use super::inspect::notice_rows;
use super::terminal::failure::Failure;
use super::terminal::output;
use super::terminal::progress::Progress;
use super::terminal::table::{Table, count, flux};
use clap::{Args, ValueEnum};
use pipeline::convert::{Converted, Failed, Target};
use pipeline::vocabulary::watch::StageWatch;
use pipeline::{Input, Limits, Stage, convert};
use std::fs::OpenOptions;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::{fs, io};

/// Arguments of `convert`.
#[derive(Args)]
pub struct Arguments {
    /// The ray file, in any supported format; FILE:MEMBER names a file in an archive. Values after a comma override what the file
    /// says.
    #[arg(value_name = "FILE[,KEY=VALUE]..", value_parser = channel_argument::channel, long_help = channel_argument::HELP)]
    file: ChannelFile,
    /// The file to write: .tm25ray is IES TM-25, .dat and .sdf are Zemax binary.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Format to write [default: follows from the extension].
    #[arg(long, value_enum)]
    format: Option<OutputFormat>,
    /// Replace the file if it exists.
    #[arg(long)]
    force: bool,
}

/// A format that is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum OutputFormat {
    Tm25,
    Zemax,
}

impl OutputFormat {
    /// By the extension people use for it.
    fn of(path: &Path) -> Option<OutputFormat> {
        match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
            "tm25ray" | "tm25" => Some(OutputFormat::Tm25),
            "dat" | "sdf" => Some(OutputFormat::Zemax),
            _ => None,
        }
    }

    /// What the pipeline calls it.
    pub fn target(self) -> Target {
        match self {
            OutputFormat::Tm25 => Target::Tm25,
            OutputFormat::Zemax => Target::ZemaxBinary,
        }
    }

    /// What people call it.
    pub fn name(self) -> &'static str {
        match self {
            OutputFormat::Tm25 => "IES TM-25",
            OutputFormat::Zemax => "Zemax binary",
        }
    }
}

/// Writes the other file and prints what became of the rays.
///
/// # Errors
/// The file cannot be read, is refused or does not fit the format; the output file exists; or the disk refuses an operation.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let path = &arguments.output;
    let format = destination(path, arguments.format, arguments.force)?;
    let input = arguments.file.open()?;
    let converted = write(&input, format.target(), path)?;
    output::print(summary(&input, &converted, format, path))
}

/// The format of a ray file to be written, which must not exist yet unless it may be replaced.
///
/// # Errors
/// Neither flag nor extension names a format; the file exists.
pub fn destination(path: &Path, format: Option<OutputFormat>, force: bool) -> Result<OutputFormat, Failure> {
    let place = || path.display().to_string();
    let format = format.or_else(|| OutputFormat::of(path)).ok_or_else(|| {
        let found = "The extension of the output file does not name a format.";
        Failure::usage("convert.format", found, "Use the extension .tm25ray, .dat or .sdf, or give --format.")
            .at(place())
    })?;
    if path.exists() && !force {
        let found = "The output file exists already.";
        return Err(Failure::usage("convert.exists", found, "Name another output file, or give --force.").at(place()));
    }
    Ok(format)
}

fn write(input: &Input, target: Target, path: &Path) -> Result<Converted, Failure> {
    let progress = Progress::start_reading();
    let converted = write_whole(path, |out| {
        let watch = StageWatch::enter(&progress, Stage::Rays)?;
        convert::convert(input, target, &Limits::default(), out, watch)
    });
    progress.finish();
    converted.map_err(|failed| match failed {
        Failed::Read(error) => Failure::from(error).at(&input.name),
        Failed::Write(error) => Failure::disk(path, &error),
    })
}

/// Writes under another name first, so that no program sees an incomplete file, and the old file stays until the new one is
/// complete.
///
/// # Errors
/// Those of `fill`, or of the disk.
pub fn write_whole<T>(path: &Path, fill: impl FnOnce(&mut dyn Write) -> Result<T, Failed>) -> Result<T, Failed> {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let part = path.with_file_name(format!(".{name}.{}.part", std::process::id()));
    let file = OpenOptions::new().write(true).create_new(true).open(&part)?;
    let filled = || {
        let mut out = BufWriter::with_capacity(1 << 20, file);
        let filled = fill(&mut out)?;
        out.into_inner().map_err(io::IntoInnerError::into_error)?.sync_all()?;
        fs::rename(&part, path)?;
        Ok(filled)
    };
    let done = filled();
    if done.is_err() {
        // What went wrong is told already; a part that stays behind is only untidy.
        let _ = fs::remove_file(&part);
    }
    done
}

fn summary(input: &Input, converted: &Converted, format: OutputFormat, path: &Path) -> Table {
    let written = format.name();
    let left_out = converted.rays_read - converted.rays_written;
    let mut table = Table::default();
    table.row("file", ["read".into(), format!("{}: {}", input.name, converted.format.name())]);
    table.row("file", ["written".into(), format!("{}: {written}", path.display())]);
    table.row("rays", ["read".into(), count(converted.rays_read)]);
    table.row("rays", ["written".into(), count(converted.rays_written)]);
    table.row("rays", ["left out".into(), count(left_out)]);
    table.row("flux", ["in".into(), flux(converted.flux_in)]);
    table.row("flux", ["out".into(), flux(converted.flux_out)]);
    notice_rows(&mut table, &converted.notices);
    table
}

#[cfg(test)]
mod tests {
    use super::*;
    use pipeline::known_sources::{by_name, write_tm25};
    use std::fs::File;

    fn lamp(folder: &Path) -> PathBuf {
        let path = folder.join("lamp.tm25ray");
        write_tm25(&by_name("flat-chip").unwrap(), 1000, 1, &mut File::create(&path).unwrap()).unwrap();
        path
    }

    fn asked(file: &Path, output: &Path) -> Arguments {
        let file = channel_argument::channel(file.to_str().unwrap()).unwrap();
        Arguments { file, output: output.to_owned(), format: None, force: false }
    }

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<String> =
            fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn the_extension_says_the_format() {
        let folder = tempfile::tempdir().unwrap();
        let lamp = lamp(folder.path());
        for (name, size) in
            [("a.dat", 208 + 28_000), ("b.SDF", 208 + 28_000), ("c.tm25ray", fs::metadata(&lamp).unwrap().len())]
        {
            let output = folder.path().join(name);
            run(&asked(&lamp, &output)).unwrap();
            assert_eq!(fs::metadata(&output).unwrap().len(), size, "{name}");
        }
        assert!(run(&asked(&lamp, &folder.path().join("d.ray"))).unwrap_err().to_string().contains("convert.format"));
        let named = Arguments { format: Some(OutputFormat::Zemax), ..asked(&lamp, &folder.path().join("d.ray")) };
        run(&named).unwrap();
        assert_eq!(names(folder.path()), ["a.dat", "b.SDF", "c.tm25ray", "d.ray", "lamp.tm25ray"]);
    }

    #[test]
    fn what_is_there_stays_unless_it_shall_go_and_failures_leave_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let (lamp, output) = (lamp(folder.path()), folder.path().join("out.dat"));
        fs::write(&output, "precious").unwrap();
        assert!(run(&asked(&lamp, &output)).unwrap_err().to_string().contains("convert.exists"));
        let damaged = folder.path().join("damaged.tm25ray");
        fs::write(&damaged, &fs::read(&lamp).unwrap()[..40_000]).unwrap();
        let forced = |file: &Path| run(&Arguments { force: true, ..asked(file, &output) });
        assert!(forced(&damaged).unwrap_err().to_string().contains("tm25.size"));
        assert_eq!(fs::read(&output).unwrap(), b"precious");
        forced(&lamp).unwrap();
        assert_eq!(fs::metadata(&output).unwrap().len(), 208 + 28_000);
        // A file may be converted onto itself: it is read until the end and replaced after it.
        let whole = fs::read(&lamp).unwrap();
        run(&Arguments { force: true, ..asked(&lamp, &lamp) }).unwrap();
        assert!(fs::read(&lamp).unwrap() == whole);
        assert_eq!(names(folder.path()), ["damaged.tm25ray", "lamp.tm25ray", "out.dat"]);
    }
}
