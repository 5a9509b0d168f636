//! A model and what is changed of it, as one argument: `led,scale=0.5,turn=+X:180,move=0:0:5`.

use super::channel_argument::{path_and_keys, spectrum, total};
use super::rays::files;
use super::terminal::argument;
use super::terminal::failure::Failure;
use pipeline::{Change, Component, Strength, Turn};
use std::path::PathBuf;

/// Help of the argument.
pub const HELP: &str = "\
Models: folders that `build` or `combine` wrote, or a model.zip; only emitter.glb and goniograms.json are read. What is changed follows
after commas; first the spectrum, then the flux, then the turns in their order, about the origin, then the move:
  spectrum=FILE    all of its light gets this spectrum: its W stay and its lm follow; files as for `build`
  scale=FACTOR     its flux times FACTOR
  flux=FLUX        its flux, as 1.2W or 337lm; the other quantity goes along
  turn=AXIS:DEG    turned about an axis of the ray file, +X -X +Y -Y +Z -Z or three numbers (0:1:1:30), counter-clockwise as seen from
                   where the axis points to; can be repeated
  move=X:Y:Z       moved, mm
  name=NAME        what it is called in the report

Two LEDs back to back, and a white LED of the bin that its data sheet names:
  lampwright combine led led,turn=+X:180 -o both
  lampwright combine yellow,flux=91lm blue,flux=7lm -o white";

/// The keys, in the order of [`HELP`].
const KEYS: [&str; 6] = ["spectrum", "scale", "flux", "turn", "move", "name"];

/// A model with what is changed of it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ModelFile {
    /// A folder or a zip.
    pub path: PathBuf,
    name: Option<String>,
    spectrum: Option<PathBuf>,
    change: Change,
    is_moved: bool,
}

impl ModelFile {
    /// Reads its two files.
    ///
    /// # Errors
    /// Whatever the disk answers, or the zip holds no model.
    pub fn open(&self) -> Result<Component, Failure> {
        let [emitter, goniograms] = files(&self.path)?;
        let spectrum = self.spectrum.as_deref().map(spectrum).transpose()?;
        let change = Change { spectrum: spectrum.map(|read| read.table), ..self.change.clone() };
        Ok(Component { name: self.name.clone(), emitter, goniograms, change })
    }

    fn say(&mut self, key: &str, value: &str) -> Result<(), String> {
        let strength = match key {
            "turn" => {
                self.change.turns.push(turn(value)?);
                return Ok(());
            }
            "move" if self.is_moved => return Err("move is given twice".to_owned()),
            "move" => {
                self.is_moved = true;
                let vector = argument::vector(&value.replace(':', ","));
                self.change.move_mm = vector.map_err(|_| "write a move in mm as 0:0:5".to_owned())?;
                return Ok(());
            }
            "spectrum" => return once(&mut self.spectrum, PathBuf::from(value), "spectrum"),
            "name" => return once(&mut self.name, value.to_owned(), "name"),
            "flux" => Strength::Flux(total(value)?),
            _ => Strength::Factor(value.trim().parse().map_err(|_| "write a scale as 0.5".to_owned())?),
        };
        once(&mut self.change.strength, strength, "scale or flux")
    }
}

fn once<T>(place: &mut Option<T>, value: T, key: &str) -> Result<(), String> {
    place.replace(value).map_or(Ok(()), |_| Err(format!("{key} is given twice")))
}

/// `+X:180` or `0:1:1:30`.
fn turn(text: &str) -> Result<Turn, String> {
    let wrong = || "write a turn as +X:180, or with an axis of three numbers as 0:1:1:30".to_owned();
    let (axis, degrees) = text.rsplit_once(':').ok_or_else(wrong)?;
    let axis = argument::direction(&axis.replace(':', ",")).map_err(|_| wrong())?;
    Ok(Turn { axis, degrees: degrees.trim().parse().map_err(|_| wrong())? })
}

/// `led,scale=0.5,turn=+X:180`.
pub fn model(text: &str) -> Result<ModelFile, String> {
    let mut model = ModelFile::default();
    let path = path_and_keys(text, &KEYS, |key, value| model.say(key, value))?;
    Ok(ModelFile { path, ..model })
}

#[cfg(test)]
mod tests {
    use super::*;
    use pipeline::Total;
    use pipeline::evaluation::Vector;

    #[test]
    fn everything_that_can_be_said_arrives() {
        let said = "a,b/model.zip,spectrum=s.txt,scale=0.5,turn=+X:180,turn=0:1:1:-30,move=0:-1.5:1e2,name=left, low";
        let expected = ModelFile {
            path: "a,b/model.zip".into(),
            name: Some("left, low".into()),
            spectrum: Some("s.txt".into()),
            change: Change {
                spectrum: None,
                strength: Some(Strength::Factor(0.5)),
                turns: vec![
                    Turn { axis: Vector::X, degrees: 180.0 },
                    Turn { axis: Vector::new(0.0, 1.0, 1.0), degrees: -30.0 },
                ],
                move_mm: Vector::new(0.0, -1.5, 100.0),
            },
            is_moved: true,
        };
        assert_eq!(model(said), Ok(expected));
        assert_eq!(model("lamp,flux=337lm").unwrap().change.strength, Some(Strength::Flux(Total::LuminousLm(337.0))));
        assert_eq!(model("out"), Ok(ModelFile { path: "out".into(), ..ModelFile::default() }));
    }

    #[test]
    fn nonsense_says_what_to_write() {
        for (said, complaint) in [
            ("a,rotate=1", "unknown key \"rotate\""),
            ("a,scale=half", "0.5"),
            ("a,scale=1,flux=1W", "twice"),
            ("a,flux=5", "1.2W or 337lm"),
            ("a,turn=90", "+X:180"),
            ("a,turn=Q:90", "+X:180"),
            ("a,turn=+X:x", "+X:180"),
            ("a,move=1:2", "0:0:5"),
            ("a,move=1:2:3,move=1:2:3", "twice"),
            ("a,name=", "empty"),
        ] {
            let error = model(said).unwrap_err();
            assert!(error.contains(complaint), "{said}: {error}");
        }
    }
}
