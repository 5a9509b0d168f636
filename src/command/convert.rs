//! `convert`: ray files as another one, for programs that read only one of them, or only one file, or not so many rays.

use super::channel_argument;
use super::channel_argument::ChannelFile;
use super::inspect::notice_rows;
use super::terminal::destination::NewFile;
use super::terminal::failure::Failure;
use super::terminal::progress::Progress;
use super::terminal::table::{Table, count, flux};
use super::terminal::{measure, output};
use clap::{Args, ValueEnum};
use pipeline::convert::{Converted, Failed, Take, Target, Wanted};
use pipeline::vocabulary::watch::StageWatch;
use pipeline::{Input, Limits, Stage, Total, convert};
use std::path::{Path, PathBuf};

/// Arguments of `convert`.
#[derive(Args)]
pub struct Arguments {
    /// Ray files of one source, in any supported format, which become one file; FILE:MEMBER names a file in an archive. Values after
    /// a comma override what the file says.
    #[arg(required = true, value_name = "FILE[,KEY=VALUE]..", value_parser = channel_argument::channel, long_help = channel_argument::HELP)]
    files: Vec<ChannelFile>,
    /// Total flux of the source, of which every file has a share, for example 1.2W or 337lm.
    #[arg(long, value_name = "FLUX", allow_hyphen_values = true, value_parser = channel_argument::total)]
    total: Option<Total>,
    /// The file to write: .tm25ray is IES TM-25, .dat and .sdf are Zemax binary, .ray is LightTools binary.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Format to write [default: follows from the extension].
    #[arg(long, value_enum)]
    format: Option<OutputFormat>,
    /// Write the rays in random order; the same seed gives the same order. The file may be larger than memory: it is shuffled on
    /// the disk, in parts of 64 MiB.
    #[arg(long, value_name = "SEED", value_parser = measure::whole::<u64>)]
    shuffle: Option<u64>,
    /// Write so many rays, picked at random from all of them, with their flux scaled so that the total of each file stays.
    #[arg(long, value_name = "N", value_parser = measure::rays)]
    take: Option<u64>,
    /// Which rays --take picks; the same seed picks the same rays.
    #[arg(long, value_name = "SEED", default_value_t = 1, requires = "take", value_parser = measure::whole::<u64>)]
    take_seed: u64,
    /// Replace the file if it exists.
    #[arg(long)]
    force: bool,
}

/// Bytes of a ray in all formats that are written: place, direction and flux, seven numbers; some have more.
const LEAST_RAY_BYTES: u64 = 28;

/// A format that is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum OutputFormat {
    Tm25,
    Zemax,
    #[value(name = "lighttools")]
    LightTools,
}

impl OutputFormat {
    /// By the extension people use for it.
    fn of(path: &Path) -> Option<OutputFormat> {
        match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
            "tm25ray" | "tm25" => Some(OutputFormat::Tm25),
            "dat" | "sdf" => Some(OutputFormat::Zemax),
            "ray" => Some(OutputFormat::LightTools),
            _ => None,
        }
    }

    /// What the pipeline calls it.
    pub fn target(self) -> Target {
        match self {
            OutputFormat::Tm25 => Target::Tm25,
            OutputFormat::Zemax => Target::ZemaxBinary,
            OutputFormat::LightTools => Target::LightToolsBinary,
        }
    }

    /// What people call it.
    pub fn name(self) -> &'static str {
        match self {
            OutputFormat::Tm25 => "IES TM-25",
            OutputFormat::Zemax => "Zemax binary",
            OutputFormat::LightTools => "LightTools binary",
        }
    }
}

/// Writes the other file and prints what became of the rays.
///
/// # Errors
/// A file cannot be read, is refused or does not fit the format; the output file exists; or the disk refuses an operation.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let path = &arguments.output;
    let format = format_of(path, arguments.format)?;
    let file = NewFile::at(path, arguments.force)?;
    let inputs = arguments.files.iter().map(ChannelFile::open).collect::<Result<Vec<Input>, Failure>>()?;
    let wanted = Wanted {
        target: format.target(),
        total: arguments.total,
        take: arguments.take.map(|rays| Take { rays, seed: arguments.take_seed }),
        shuffle: arguments.shuffle,
    };
    let file = file.of_size(expected_bytes(&inputs, arguments.take))?;
    let converted = write(&inputs, &wanted, &file)?;
    output::print(summary(&inputs, &converted, format, path))
}

/// Bytes of the smallest records of as many rays as the headers claim, or are taken of them; what is wrong with a header is told later.
fn expected_bytes(inputs: &[Input], take: Option<u64>) -> u64 {
    let claimed = |input| pipeline::header(input, &Limits::default()).map_or(0, |header| header.ray_count);
    let rays: u64 = inputs.iter().map(claimed).sum();
    LEAST_RAY_BYTES.saturating_mul(take.map_or(rays, |take| take.min(rays)))
}

/// The format of a ray file to be written.
///
/// # Errors
/// Neither flag nor extension names a format.
pub fn format_of(path: &Path, format: Option<OutputFormat>) -> Result<OutputFormat, Failure> {
    format.or_else(|| OutputFormat::of(path)).ok_or_else(|| {
        let found = "The extension of the output file does not name a format.";
        Failure::usage("output.format", found, "Use the extension .tm25ray, .dat, .sdf or .ray, or give --format.")
            .at(path.display().to_string())
    })
}

fn write(inputs: &[Input], wanted: &Wanted, file: &NewFile) -> Result<Converted, Failure> {
    let progress = Progress::start_reading();
    let converted = file.write(|file| {
        let watch = StageWatch::enter(&progress, Stage::Rays)?;
        convert::convert(inputs, wanted, &Limits::default(), file, watch)
    });
    progress.finish();
    converted.map_err(|failed| match failed {
        Failed::Read(error) => Failure::from(error).at(names(inputs)),
        other => file.failure(other),
    })
}

fn names(inputs: &[Input]) -> String {
    inputs.iter().map(|input| input.name.as_str()).collect::<Vec<_>>().join(" + ")
}

fn summary(inputs: &[Input], converted: &Converted, format: OutputFormat, path: &Path) -> Table {
    let written = format.name();
    let mut table = Table::default();
    for (input, format) in inputs.iter().zip(&converted.formats) {
        table.row("file", ["read".into(), format!("{}: {}", input.name, format.name())]);
    }
    table.row("file", ["written".into(), format!("{}: {written}", path.display())]);
    table.row("rays", ["read".into(), count(converted.rays_read)]);
    table.row("rays", ["written".into(), count(converted.rays_written)]);
    table.row("rays", ["left out".into(), count(converted.rays_read - converted.rays_used)]);
    if converted.rays_written < converted.rays_used {
        table.row("rays", ["not taken".into(), count(converted.rays_used - converted.rays_written)]);
    }
    table.row("flux", ["in".into(), flux(converted.flux_in)]);
    table.row("flux", ["out".into(), flux(converted.flux_out)]);
    notice_rows(&mut table, &converted.notices);
    table
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;
    use pipeline::known_sources::{by_name, write_tm25};
    use std::fs;
    use std::fs::File;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        convert: Arguments,
    }

    fn lamp(folder: &Path) -> PathBuf {
        let path = folder.join("lamp.tm25ray");
        write_tm25(&by_name("flat-chip").unwrap(), 1000, 1, &mut File::create(&path).unwrap()).unwrap();
        path
    }

    fn asked(file: &Path, output: &Path) -> Arguments {
        let file = channel_argument::channel(file.to_str().unwrap()).unwrap();
        Arguments {
            files: vec![file],
            total: None,
            output: output.to_owned(),
            format: None,
            shuffle: None,
            take: None,
            take_seed: 1,
            force: false,
        }
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
        let same = fs::metadata(&lamp).unwrap().len();
        let lighttools = 44 + 28_000 + 7;
        for (name, size) in
            [("a.dat", 208 + 28_000), ("b.SDF", 208 + 28_000), ("c.tm25ray", same), ("e.ray", lighttools)]
        {
            let output = folder.path().join(name);
            run(&asked(&lamp, &output)).unwrap();
            assert_eq!(fs::metadata(&output).unwrap().len(), size, "{name}");
        }
        assert!(run(&asked(&lamp, &folder.path().join("d.txt"))).unwrap_err().to_string().contains("output.format"));
        let named = Arguments { format: Some(OutputFormat::Zemax), ..asked(&lamp, &folder.path().join("d.txt")) };
        run(&named).unwrap();
        assert_eq!(names(folder.path()), ["a.dat", "b.SDF", "c.tm25ray", "d.txt", "e.ray", "lamp.tm25ray"]);
    }

    #[test]
    fn what_is_there_stays_unless_it_shall_go_and_failures_leave_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let (lamp, output) = (lamp(folder.path()), folder.path().join("out.dat"));
        fs::write(&output, "precious").unwrap();
        assert!(run(&asked(&lamp, &output)).unwrap_err().to_string().contains("output.exists"));
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

    #[test]
    fn room_is_asked_for_as_many_rays_as_there_are() {
        let folder = tempfile::tempdir().unwrap();
        let lamp = lamp(folder.path());
        let input = channel_argument::channel(lamp.to_str().unwrap()).unwrap().open().unwrap();
        let inputs = [input];
        for (take, bytes) in [(None, 28_000), (Some(10), 280), (Some(u64::MAX), 28_000)] {
            assert_eq!(expected_bytes(&inputs, take), bytes);
        }
        let most = Arguments { take: Some(u64::MAX), ..asked(&lamp, &folder.path().join("out.dat")) };
        assert!(run(&most).unwrap_err().to_string().contains("convert.take_too_many"));
        assert_eq!(names(folder.path()), ["lamp.tm25ray"]);
    }

    /// Two files in one, half of their rays, in random order: each file's share of the total holds.
    #[test]
    fn files_are_joined_thinned_out_and_shuffled() {
        let folder = tempfile::tempdir().unwrap();
        let (lamp, output) = (lamp(folder.path()), folder.path().join("both.dat"));
        let other = folder.path().join("other.tm25ray");
        write_tm25(&by_name("flat-chip").unwrap(), 1000, 2, &mut File::create(&other).unwrap()).unwrap();
        let share = |path: &Path, share: &str| format!("{},share={share}W", path.display());
        let line = ["convert", &share(&lamp, "0.9"), &share(&other, "0.1"), "--total", "2W", "--take", "500"];
        let line = line.iter().copied().chain(["--shuffle", "7", "-o", output.to_str().unwrap()]);
        run(&Line::try_parse_from(line).unwrap().convert).unwrap();
        let written = fs::read(&output).unwrap();
        assert_eq!(written.len(), 208 + 28 * 500);
        let flux = written[208..].chunks_exact(28).map(|ray| f32::from_le_bytes(ray[24..].try_into().unwrap()));
        assert!((flux.map(f64::from).sum::<f64>() - 2.0).abs() < 1e-6);
        assert_eq!(names(folder.path()), ["both.dat", "lamp.tm25ray", "other.tm25ray"]);
    }
}
