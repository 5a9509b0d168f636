//! `rays`: new rays from a model, as a ray file.

use super::convert::{OutputFormat, format_of};
use super::terminal::destination::NewFile;
use super::terminal::failure::Failure;
use super::terminal::progress::Progress;
use super::terminal::table::{Table, count, flux};
use super::terminal::{measure, output};
use clap::Args;
use pipeline::artifacts::read::{StoredModel, check_size, read, unpack};
use pipeline::new_rays::{NewRays, Request};
use pipeline::vocabulary::watch::StageWatch;
use pipeline::{Limits, MODEL_FILES, Stage};
use std::fs;
use std::fs::File;
use std::io::{BufReader, BufWriter, Write};
use std::path::{Path, PathBuf};

/// Arguments of `rays`.
#[derive(Args)]
pub struct Arguments {
    /// The model: the folder that `build` wrote, or a model.zip. Only emitter.glb and goniograms.json are read.
    #[arg(value_name = "MODEL")]
    model: PathBuf,
    /// How many rays: 1000000 or 1e6.
    #[arg(short = 'n', long = "rays", alias = "count", value_name = "N", value_parser = measure::rays)]
    count: u64,
    /// Seed of the random numbers: the same seed gives the same rays, another seed others of the same light.
    #[arg(long, value_name = "S", default_value_t = 1, value_parser = measure::whole::<u64>)]
    seed: u64,
    /// Spread the rays more evenly over places, directions and wavelengths than chance has it (a scrambled Sobol sequence): what is computed of
    /// them has less noise. Best is a power of two of them.
    #[arg(long)]
    low_discrepancy: bool,
    /// The file to write: .tm25ray is IES TM-25, .dat and .sdf are Zemax binary, .ray is LightTools binary.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Format to write [default: follows from the extension].
    #[arg(long, value_enum)]
    format: Option<OutputFormat>,
    /// Write a part of the file only, from this ray on, counted from 0; the part from ray 0 begins with the header. Parts one after another are
    /// the bytes of the file.
    #[arg(long, value_name = "K", default_value_t = 0, value_parser = measure::whole::<u64>)]
    first: u64,
    /// Number of rays of that part [default: all that follow].
    #[arg(long, value_name = "N", value_parser = measure::rays)]
    part: Option<u64>,
    /// Replace the file if it exists.
    #[arg(long)]
    force: bool,
}

/// Draws the rays, writes them, and prints what was written.
///
/// # Errors
/// The model cannot be read; the format does not hold the rays; the output file exists; or the disk refuses an operation.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let path = &arguments.output;
    let format = format_of(path, arguments.format)?;
    let file = NewFile::at(path, arguments.force)?;
    let of = arguments.count;
    let last = arguments.part.map_or(of, |part| arguments.first.saturating_add(part));
    if arguments.first >= of || last > of {
        let found = format!("Rays {} to {last} are not among the {of} that the file has.", arguments.first);
        return Err(Failure::usage("rays.part", found, "Name a part of the file: --first and --part."));
    }
    let model = stored(&arguments.model)?;
    let Arguments { seed, low_discrepancy, .. } = *arguments;
    let request = Request { count: of, seed, low_discrepancy, target: format.target() };
    let rays = NewRays::new(&model, &model.name, request)?;
    let from = if arguments.first == 0 { 0 } else { rays.byte_of_ray(arguments.first) };
    let bytes = from..if last == of { rays.byte_count() } else { rays.byte_of_ray(last) };
    let file = file.of_size(bytes.end - bytes.start)?;
    let progress = Progress::start_reading();
    let written = file.write(|file| {
        let watch = StageWatch::enter(&progress, Stage::Rays)?;
        let mut out = BufWriter::with_capacity(1 << 20, file);
        rays.write(bytes.clone(), &mut out, watch)?;
        Ok(out.flush()?)
    });
    progress.finish();
    written.map_err(|failed| file.failure(failed))?;
    let mut table = Table::default();
    table.row("model", [model.name.clone()]);
    table.row("rays", ["of the file".into(), count(of)]);
    table.row("rays", ["written".into(), count(last - arguments.first)]);
    table.row("rays", ["seed".into(), seed.to_string()]);
    table.row("rays", ["spread".into(), if low_discrepancy { "low discrepancy" } else { "random" }.into()]);
    table.row("flux", ["of all rays".into(), flux(rays.flux())]);
    table.row("file", ["written".into(), format!("{}: {}", path.display(), format.name())]);
    table.row("file", ["bytes".into(), count(bytes.end - bytes.start)]);
    output::print(table)
}

/// The model in a folder or in a zip.
///
/// # Errors
/// It cannot be read, or is none.
pub fn stored(path: &Path) -> Result<StoredModel, Failure> {
    let [emitter, angles] = files(path)?;
    let place = || path.display().to_string();
    read(&emitter, &angles, &Limits::default()).map_err(|error| Failure::from(error).at(place()))
}

/// The bytes of `emitter.glb` and `goniograms.json` in a folder or in a zip.
///
/// # Errors
/// The disk does not have them, or the zip holds no model.
pub fn files(path: &Path) -> Result<[Vec<u8>; 2], Failure> {
    if path.is_dir() {
        let missing: Vec<&str> = MODEL_FILES.into_iter().filter(|name| !path.join(name).is_file()).collect();
        if !missing.is_empty() {
            let found = format!("The folder is no model: it has no {}.", missing.join(" and no "));
            let remedy = "Name a folder that lampwright build or combine wrote, or its model.zip.";
            return Err(Failure::failed("model.missing_file", found, remedy).at(path.display().to_string()));
        }
        return Ok([in_folder(path, MODEL_FILES[0])?, in_folder(path, MODEL_FILES[1])?]);
    }
    let file = File::open(path).map_err(|error| Failure::disk(path, &error))?;
    unpack(BufReader::new(file)).map_err(|error| Failure::from(error).at(path.display().to_string()))
}

fn in_folder(folder: &Path, name: &str) -> Result<Vec<u8>, Failure> {
    let path = folder.join(name);
    let disk = |error: std::io::Error| Failure::disk(&path, &error);
    check_size(name, fs::metadata(&path).map_err(disk)?.len())?;
    fs::read(&path).map_err(disk)
}

#[cfg(test)]
pub mod tests {
    use super::*;
    use pipeline::known_sources::{by_name, write_tm25};
    use pipeline::{Declared, Input, NoProgress, Options};
    use std::sync::Arc;

    /// A folder with a model of `rays` rays of a Lambertian chip of 1 W and 1 mm², and its zip.
    pub fn model(rays: u64) -> tempfile::TempDir {
        let mut bytes = Vec::new();
        write_tm25(&by_name("flat-chip").unwrap(), rays, 1, &mut bytes).unwrap();
        let (name, sha256) = ("lamp".into(), "0".repeat(64));
        let input = Input { name, sha256, bytes: Arc::new(bytes), declared: Declared::default(), notices: Vec::new() };
        let outcome = pipeline::run(&[input], &Options::default(), &Limits::default(), &NoProgress).unwrap();
        let folder = tempfile::tempdir().unwrap();
        for artifact in outcome.artifacts.iter().filter(|artifact| !artifact.name.contains('/')) {
            fs::write(folder.path().join(&artifact.name), &artifact.bytes).unwrap();
        }
        fs::write(folder.path().join("model.zip"), pipeline::artifacts::zip(&outcome.artifacts).unwrap()).unwrap();
        folder
    }

    fn asked(model: &Path, output: &Path) -> Arguments {
        Arguments {
            model: model.to_owned(),
            count: 1000,
            seed: 7,
            low_discrepancy: false,
            output: output.to_owned(),
            format: None,
            first: 0,
            part: None,
            force: false,
        }
    }

    #[test]
    fn folder_and_zip_give_the_same_rays_and_parts_are_the_file() {
        let folder = model(20_000);
        let at = |name: &str| folder.path().join(name);
        run(&asked(folder.path(), &at("a.dat"))).unwrap();
        run(&asked(&at("model.zip"), &at("b.dat"))).unwrap();
        let whole = fs::read(at("a.dat")).unwrap();
        assert_eq!(whole.len(), 208 + 32 * 1000);
        assert!(whole == fs::read(at("b.dat")).unwrap());
        run(&Arguments { part: Some(300), ..asked(folder.path(), &at("c.dat")) }).unwrap();
        run(&Arguments { first: 300, ..asked(folder.path(), &at("d.dat")) }).unwrap();
        assert!(whole == [fs::read(at("c.dat")).unwrap(), fs::read(at("d.dat")).unwrap()].concat());
        run(&Arguments { low_discrepancy: true, ..asked(folder.path(), &at("e.dat")) }).unwrap();
        let other = fs::read(at("e.dat")).unwrap();
        assert!(other.len() == whole.len() && other != whole);
    }

    #[test]
    fn what_cannot_be_is_told_and_leaves_nothing() {
        let folder = model(20_000);
        let at = |name: &str| folder.path().join(name);
        let code = |arguments: &Arguments| run(arguments).unwrap_err().to_string();
        let output = at("new.dat");
        assert!(code(&Arguments { first: 1000, ..asked(folder.path(), &output) }).contains("rays.part"));
        assert!(
            code(&Arguments { first: 900, part: Some(101), ..asked(folder.path(), &output) }).contains("rays.part")
        );
        assert!(code(&asked(&at("README.txt"), &output)).contains("model.not_model"));
        assert!(code(&asked(&at("nowhere"), &output)).contains("file.disk"));
        assert!(code(&asked(folder.path(), &at("new.xyz"))).contains("output.format"));
        fs::write(at("emitter.glb"), "glTF").unwrap();
        assert!(code(&asked(folder.path(), &output)).contains("model.not_glb"));
        fs::write(&output, "precious").unwrap();
        assert!(code(&asked(folder.path(), &output)).contains("output.exists"));
        assert_eq!(fs::read(&output).unwrap(), b"precious");
        let left = fs::read_dir(folder.path())
            .unwrap()
            .filter(|entry| entry.as_ref().unwrap().file_name().to_string_lossy().ends_with(".part"));
        assert_eq!(left.count(), 0);
    }
}
