//! `adapter`: a model as a renderer opens it.

use super::rays::stored;
use super::terminal::destination::NewFolder;
use super::terminal::failure::Failure;
use super::terminal::output;
use super::terminal::table::{Table, count};
use clap::Args;
use pipeline::adapters::{Adapted, Renderer, adapt};
use pipeline::evaluation::Kind;
use std::path::{Path, PathBuf};

/// Arguments of `adapter`.
#[derive(Args)]
pub struct Arguments {
    /// The renderer: blender, mitsuba or radiance.
    #[arg(value_name = "RENDERER", value_parser = renderer)]
    renderer: Renderer,
    /// The model: the folder that `build` wrote, or a model.zip. Only emitter.glb and goniograms.json are read.
    #[arg(value_name = "MODEL")]
    model: PathBuf,
    /// Folder for the files; must be empty, and is created if missing. Its README.txt says what to do with them.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Which light: color (in lm), luminous (the same without colours) or radiant [default: color where the model knows it, else luminous, else
    /// radiant].
    #[arg(long, value_name = "LIGHT", value_parser = light)]
    light: Option<Kind>,
}

/// `mitsuba`.
fn renderer(text: &str) -> Result<Renderer, String> {
    let found = Renderer::ALL.into_iter().find(|renderer| renderer.name() == text);
    found.ok_or_else(|| format!("write one of {}", Renderer::ALL.map(Renderer::name).join(" ")))
}

/// `luminous`.
fn light(text: &str) -> Result<Kind, String> {
    let known = [Kind::Color, Kind::Luminous, Kind::Radiant];
    known.into_iter().find(|kind| kind.name() == text).ok_or_else(|| "write one of color luminous radiant".to_owned())
}

/// Writes the files, and prints what was written.
///
/// # Errors
/// The model cannot be read, or does not know the light; the folder is not empty; or the disk refuses an operation.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let folder = &arguments.output;
    let model = stored(&arguments.model)?;
    let adapted = adapt(&model, arguments.renderer, arguments.light)?;
    let mut made = NewFolder::make(folder)?;
    for file in &adapted.files {
        made.put(&file.name, &file.bytes)?;
    }
    made.keep();
    output::print(summary(&model.name, &adapted, folder))
}

fn summary(model: &str, adapted: &Adapted, folder: &Path) -> Table {
    let mut table = Table::default();
    table.row("model", [model.to_owned()]);
    if adapted.stands_for_volume {
        table.row("model", ["a volume: renderers find its light on its hull".to_owned()]);
    }
    table.row("surface", ["triangles".into(), count(adapted.triangles as u64)]);
    table.row("surface", ["zones".into(), count(adapted.zones as u64)]);
    table.row("light", [adapted.kind.name().to_owned(), format!("radiance in {}", adapted.unit)]);
    for file in &adapted.files {
        table.row("written", [folder.join(&file.name).display().to_string(), count(file.bytes.len() as u64)]);
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::command::rays::tests::model;
    use std::fs;

    fn asked(renderer: Renderer, model: &Path, output: &Path) -> Arguments {
        Arguments { renderer, model: model.to_owned(), output: output.to_owned(), light: None }
    }

    #[test]
    fn each_renderer_gets_a_folder_that_says_what_to_do() {
        let folder = model(20_000);
        for known in Renderer::ALL {
            assert_eq!(renderer(known.name()), Ok(known));
            let output = folder.path().join("new").join(known.name());
            run(&asked(known, folder.path(), &output)).unwrap();
            let readme = fs::read_to_string(output.join("README.txt")).unwrap();
            let named: Vec<String> = fs::read_dir(&output)
                .unwrap()
                .map(|entry| entry.unwrap().file_name().into_string().unwrap())
                .filter(|name| name != "README.txt")
                .collect();
            assert!(named.len() >= 2 && named.iter().all(|name| readme.contains(name)), "{named:?}: {readme}");
            assert!(readme.starts_with("lamp for") && readme.contains("cd/m2") && !readme.contains(['{', '}']));
            // A second time the folder is not empty.
            let again = run(&asked(known, folder.path(), &output)).unwrap_err().to_string();
            assert!(again.contains("output.not_empty"), "{again}");
        }
    }

    #[test]
    fn what_cannot_be_is_told_and_leaves_no_folder() {
        let folder = model(20_000);
        let output = folder.path().join("new");
        let missing = run(&asked(Renderer::Radiance, &folder.path().join("nowhere"), &output)).unwrap_err();
        assert!(missing.to_string().contains("file.disk"), "{missing}");
        let spectrum = Arguments { light: Some(Kind::Spectrum), ..asked(Renderer::Mitsuba, folder.path(), &output) };
        assert!(run(&spectrum).unwrap_err().to_string().contains("adapter.light"));
        assert!(!output.exists() && light("spectrum").is_err() && renderer("povray").is_err());
    }
}
