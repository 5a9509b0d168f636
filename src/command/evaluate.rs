//! `evaluate`: intensity, irradiance or luminance of a model, as numbers or as a picture.

use super::inspect::notice_rows;
use super::rays::stored;
use super::terminal::destination::NewFile;
use super::terminal::failure::Failure;
use super::terminal::output;
use super::terminal::progress::Progress;
use super::terminal::table::{Table, count, number};
use super::terminal::{argument, measure};
use clap::{Args, Subcommand};
use pipeline::Stage;
use pipeline::evaluation::{Answer, Camera, Form, Kind, Plane, Request, TOLERANCE, Vector, View, Width, evaluate};
use pipeline::vocabulary::watch::StageWatch;
use std::path::{Path, PathBuf};

/// Arguments of `evaluate`.
#[derive(Args)]
pub struct Arguments {
    /// The model: the folder that `build` wrote, or a model.zip. Only emitter.glb and goniograms.json are read.
    #[arg(value_name = "MODEL")]
    model: PathBuf,
    #[command(subcommand)]
    view: ViewArguments,
}

#[derive(Subcommand)]
enum ViewArguments {
    /// Intensity: on a grid of C and gamma, or in directions of your own.
    ///
    /// C and gamma are those of the model (`frame` in goniograms.json): of a source that shines along +Z, gamma 0 is +Z, C0 is +X and C90 is -Y.
    Intensity(Intensity),
    /// Irradiance or illuminance on a rectangle of a plane.
    ///
    /// Places and directions are in the axes of the ray file, mm. For example: lampwright evaluate MODEL plane --center 0,0,10 --width 20 -o lux.svg
    Plane(OnPlane),
    /// Radiance or luminance as a camera sees it.
    ///
    /// Places and directions are in the axes of the ray file, mm.
    Camera(Seen),
}

#[derive(Args)]
struct Written {
    /// The file to write: .json and .csv are numbers, .tiff is a picture of floats, .svg a drawing with a scale.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Form of the file: json, csv, tiff or svg [default: follows from the extension].
    #[arg(long, value_name = "FORM", value_parser = form)]
    format: Option<Form>,
    /// Which light: luminous, radiant, spectrum or color [default: luminous where the model knows it, else radiant].
    #[arg(long, value_name = "LIGHT", value_parser = light)]
    light: Option<Kind>,
    /// Replace the file if it exists.
    #[arg(long)]
    force: bool,
}

#[derive(Args)]
struct Intensity {
    /// Step of C, degrees.
    #[arg(long, value_name = "DEG", default_value_t = View::C_STEP_DEG)]
    c_step: f64,
    /// Step of gamma, degrees.
    #[arg(long, value_name = "DEG", default_value_t = View::GAMMA_STEP_DEG)]
    gamma_step: f64,
    /// A direction in the axes of the source, as 0,0,1 or +Z, instead of the grid; can be repeated.
    #[arg(long, value_name = "X,Y,Z", value_parser = argument::direction, allow_hyphen_values = true, conflicts_with = "at")]
    direction: Vec<Vector>,
    /// A pair of C and gamma in degrees, instead of the grid; can be repeated.
    #[arg(long, value_name = "C,GAMMA", value_parser = argument::pair, allow_hyphen_values = true)]
    at: Vec<[f64; 2]>,
    #[command(flatten)]
    written: Written,
}

#[derive(Args)]
struct OnPlane {
    /// Middle of the rectangle, mm.
    #[arg(long, value_name = "X,Y,Z", value_parser = argument::vector, allow_hyphen_values = true)]
    center: Vector,
    /// Normal towards the side that is lit, in the ray file's axes, as 0,0,-1 or -Z [default: across the model's gamma = 0, to the side of the source].
    #[arg(long, value_name = "X,Y,Z", value_parser = argument::direction, allow_hyphen_values = true)]
    normal: Option<Vector>,
    /// What is up in the picture [default: +Z, and +Y of a plane across Z].
    #[arg(long, value_name = "X,Y,Z", value_parser = argument::direction, allow_hyphen_values = true)]
    up: Option<Vector>,
    /// Width of the rectangle, mm.
    #[arg(long, value_name = "MM")]
    width: f64,
    /// Its height, mm [default: its width].
    #[arg(long, value_name = "MM")]
    height: Option<f64>,
    /// Cells in a row.
    #[arg(long, value_name = "N", default_value_t = Plane::COLUMNS, value_parser = measure::whole::<usize>)]
    columns: usize,
    /// Rows [default: so many that cells are square].
    #[arg(long, value_name = "N", value_parser = measure::whole::<usize>)]
    rows: Option<usize>,
    /// Error that is aimed at, as a part of each value.
    #[arg(long, value_name = "PART", default_value_t = TOLERANCE)]
    tolerance: f64,
    #[command(flatten)]
    written: Written,
}

#[derive(Args)]
struct Seen {
    /// Where the camera is, mm. With --width it is infinitely far away in the same direction.
    #[arg(long, value_name = "X,Y,Z", value_parser = argument::vector, allow_hyphen_values = true)]
    eye: Vector,
    /// What is in the middle of the picture, mm.
    #[arg(long, value_name = "X,Y,Z", value_parser = argument::vector, allow_hyphen_values = true, default_value = "0,0,0")]
    target: Vector,
    /// What is up in the picture [default: +Z, and +Y of a camera that looks along Z].
    #[arg(long, value_name = "X,Y,Z", value_parser = argument::direction, allow_hyphen_values = true)]
    up: Option<Vector>,
    /// Orthographic: width of the picture, mm.
    #[arg(long, value_name = "MM", conflicts_with = "field", required_unless_present = "field")]
    width: Option<f64>,
    /// Perspective: angle of the whole width, degrees.
    #[arg(long, value_name = "DEG")]
    field: Option<f64>,
    /// Cells in a row.
    #[arg(long, value_name = "N", default_value_t = Camera::COLUMNS, value_parser = measure::whole::<usize>)]
    columns: usize,
    /// Rows [default: as many as columns].
    #[arg(long, value_name = "N", value_parser = measure::whole::<usize>)]
    rows: Option<usize>,
    /// Lines along each side of a cell, whose mean is its value; 1 is the line through its middle.
    #[arg(long, value_name = "N", default_value_t = Camera::SAMPLES, value_parser = measure::whole::<usize>)]
    samples: usize,
    #[command(flatten)]
    written: Written,
}

/// `json`.
fn form(text: &str) -> Result<Form, String> {
    Form::of_extension(text).ok_or_else(|| "write one of json csv tiff svg".to_owned())
}

/// `luminous`.
fn light(text: &str) -> Result<Kind, String> {
    let found = Kind::ALL.into_iter().find(|kind| kind.name() == text);
    found.ok_or_else(|| "write one of luminous radiant spectrum color".to_owned())
}

impl ViewArguments {
    fn written(&self) -> &Written {
        match self {
            ViewArguments::Intensity(asked) => &asked.written,
            ViewArguments::Plane(asked) => &asked.written,
            ViewArguments::Camera(asked) => &asked.written,
        }
    }

    fn request(&self) -> Request {
        let of = |view: View| Request { kind: self.written().light, ..Request::of(view) };
        match self {
            ViewArguments::Intensity(asked) if !asked.direction.is_empty() => {
                of(View::Directions(asked.direction.clone()))
            }
            ViewArguments::Intensity(asked) if !asked.at.is_empty() => of(View::Angles(asked.at.clone())),
            ViewArguments::Intensity(Intensity { c_step, gamma_step, .. }) => {
                of(View::Grid { c_step_deg: *c_step, gamma_step_deg: *gamma_step })
            }
            ViewArguments::Plane(asked) => {
                let height_mm = asked.height.unwrap_or(asked.width);
                let square = || Plane::square_rows(asked.width, height_mm, asked.columns);
                let plane = Plane {
                    center_mm: asked.center,
                    normal: asked.normal,
                    up: asked.up,
                    width_mm: asked.width,
                    height_mm,
                    columns: asked.columns,
                    rows: asked.rows.unwrap_or_else(square),
                };
                Request { tolerance: asked.tolerance, ..of(View::Plane(plane)) }
            }
            ViewArguments::Camera(asked) => of(View::Camera(Camera {
                eye_mm: asked.eye,
                target_mm: asked.target,
                up: asked.up,
                // One of the two is required.
                width: match (asked.width, asked.field) {
                    (Some(width_mm), _) => Width::Orthographic(width_mm),
                    (None, field_deg) => Width::Perspective(field_deg.unwrap_or_default()),
                },
                columns: asked.columns,
                rows: asked.rows.unwrap_or(asked.columns),
                samples: asked.samples,
            })),
        }
    }
}

/// Evaluates the model, writes the file, and prints what was found.
///
/// # Errors
/// The model cannot be read, or does not know what is asked; the output file exists; or the disk refuses an operation.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let written = arguments.view.written();
    let path = &written.output;
    let form = form_of(path, written)?;
    let file = NewFile::at(path, written.force)?;
    let model = stored(&arguments.model)?;
    let progress = Progress::start_evaluating();
    let evaluated = StageWatch::enter(&progress, Stage::Model)
        .and_then(|watch| evaluate(&model, &model.name, &arguments.view.request(), watch));
    progress.finish();
    let answer = evaluated?;
    let bytes = answer.write(form)?.bytes;
    file.write_all(&bytes)?;
    output::print(summary(&answer, path, bytes.len() as u64))
}

/// The form of the file.
fn form_of(path: &Path, written: &Written) -> Result<Form, Failure> {
    let by_extension = || Form::of_extension(path.extension()?.to_str()?);
    written.format.or_else(by_extension).ok_or_else(|| {
        let found = "The extension of the output file does not name a form.";
        Failure::usage("output.form", found, "Use the extension .json, .csv, .tiff or .svg, or give --format.")
            .at(path.display().to_string())
    })
}

fn summary(answer: &Answer, path: &Path, bytes: u64) -> Table {
    let mut table = Table::default();
    table.row("model", [answer.model.clone()]);
    table.row("view", [format!("{}, {} x {}", answer.quantity, answer.columns, answer.rows)]);
    let (values, name, unit) = answer.brightness();
    let largest = values.iter().copied().fold(0.0, f64::max);
    table.row(name, ["largest".into(), format!("{} {unit}", number(largest))]);
    if let [channel] = answer.channels.as_slice() {
        let bound = channel.bounds.iter().copied().fold(0.0, f64::max);
        table.row(name, ["largest bound of an error".into(), format!("{} {unit}", number(bound))]);
    }
    table.row("evaluations", [count(answer.evaluations)]);
    notice_rows(&mut table, &answer.notices);
    table.row("file", ["written".into(), path.display().to_string()]);
    table.row("file", ["bytes".into(), count(bytes)]);
    table
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::command::rays::tests::model;
    use clap::Parser;
    use std::fs;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        arguments: Arguments,
    }

    /// What a line of arguments does; FOLDER is the model's.
    fn told(folder: &Path, line: &str) -> Result<(), String> {
        let line = format!("evaluate {line}").replace("FOLDER", folder.to_str().unwrap());
        let parsed = Line::try_parse_from(line.split(' ')).map_err(|error| error.to_string())?;
        run(&parsed.arguments).map_err(|failure| failure.to_string())
    }

    fn values(path: &Path) -> Vec<f64> {
        let json: serde_json::Value = serde_json::from_slice(&fs::read(path).unwrap()).unwrap();
        let rows = json["channels"][0]["values"].as_array().unwrap();
        rows.iter().flat_map(|row| row.as_array().unwrap()).map(|value| value.as_f64().unwrap()).collect()
    }

    /// Closed forms of the chip, within the noise of 200 000 rays: E = 0.2394 W/mm² 1 mm above it, I = 1/π W/sr on its axis, L = 1/π W/(mm² sr).
    #[test]
    fn a_chip_is_evaluated_as_its_closed_forms() {
        let folder = model(200_000);
        let at = |name: &str| folder.path().join(name);
        told(folder.path(), "FOLDER plane --center 0,0,1 --width 1e-6 --columns 1 --light radiant -o FOLDER/e.json")
            .unwrap();
        assert!((values(&at("e.json"))[0] / 0.2394e6 - 1.0).abs() < 0.01);
        told(
            folder.path(),
            "FOLDER/model.zip intensity --direction 0,0,1 --direction -1,0,1 --light radiant -o FOLDER/i.json",
        )
        .unwrap();
        let [axis, aslant] = values(&at("i.json"))[..] else { panic!("two directions") };
        assert!((axis * std::f64::consts::PI - 1.0).abs() < 0.02, "{axis}");
        assert!((aslant * std::f64::consts::PI / 0.5_f64.sqrt() - 1.0).abs() < 0.02, "{aslant}");
        told(folder.path(), "FOLDER camera --eye 0,0,9 --width 2 --columns 8 --light radiant -o FOLDER/l.json")
            .unwrap();
        let seen = values(&at("l.json"));
        let lit: f64 = [27, 28, 35, 36].map(|cell: usize| seen[cell]).iter().sum::<f64>() / 4.0;
        assert!((lit * 1e-6 * std::f64::consts::PI - 1.0).abs() < 0.03, "{lit}");
        assert!(seen[0] == 0.0 && seen[63] == 0.0);
        // Every form, and the forms of words.
        for file in ["e.csv", "e.tiff", "e.svg", "e.tif"] {
            told(
                folder.path(),
                &format!("FOLDER plane --center 0,0,1 --normal -Z --up +Y --width 3 --height 2 --columns 6e0 -o FOLDER/{file}"),
            )
            .unwrap();
            assert!(fs::metadata(at(file)).unwrap().len() > 100);
        }
        told(folder.path(), "FOLDER intensity --light color --format csv -o FOLDER/odd.bin").unwrap();
        assert_eq!(fs::read_to_string(at("odd.bin")).unwrap().lines().count(), 24 * 37 + 1);
    }

    #[test]
    fn what_cannot_be_is_told_and_leaves_nothing() {
        let folder = model(200_000);
        let before = fs::read_dir(folder.path()).unwrap().count();
        for (line, code) in [
            ("FOLDER plane --center 0,0,1 --width 2 -o FOLDER/new.exr", "output.form"),
            ("FOLDER plane --center 0,0,1 --width 0 -o FOLDER/new.json", "evaluation.geometry"),
            ("FOLDER plane --center 0,0,1 --width 1 --tolerance 1 -o FOLDER/new.json", "evaluation.tolerance"),
            ("FOLDER plane --center 0,0,1 --normal Q --width 1 -o FOLDER/new.json", "as +Z"),
            ("FOLDER plane --center 0,0 --width 1 -o FOLDER/new.json", "three numbers"),
            ("FOLDER camera --eye 0,0,9 -o FOLDER/new.json", "--width"),
            ("FOLDER camera --eye 0,0,9 --width 1 --field 2 -o FOLDER/new.json", "cannot be used with"),
            ("FOLDER camera --eye 0,0,9 --field 180 -o FOLDER/new.json", "evaluation.geometry"),
            ("FOLDER camera --eye 0,0,0 --width 1 -o FOLDER/new.json", "evaluation.geometry"),
            ("FOLDER intensity --c-step 7 -o FOLDER/new.json", "evaluation.geometry"),
            ("FOLDER intensity --at 1 -o FOLDER/new.json", "two numbers"),
            ("FOLDER intensity --at 1,2 -o FOLDER/new.svg", "evaluation.no_picture"),
            ("FOLDER intensity --light blue -o FOLDER/new.json", "luminous radiant"),
            ("FOLDER intensity -o FOLDER/report.json", "output.exists"),
            ("FOLDER/README.txt intensity -o FOLDER/new.json", "model.not_model"),
        ] {
            let found = told(folder.path(), line).unwrap_err();
            assert!(found.contains(code), "{line}: {found}");
        }
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), before);
    }
}
