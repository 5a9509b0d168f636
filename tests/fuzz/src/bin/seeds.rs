//! Writes the seeds of every target: `seeds FOLDER` makes FOLDER/TARGET/seed-N.

use lampwright_fuzz::{Kind, seeds};
use std::path::PathBuf;

fn main() -> std::io::Result<()> {
    let folder = PathBuf::from(std::env::args_os().nth(1).expect("a folder for the seeds"));
    for (kind, name) in Kind::ALL {
        let folder = folder.join(name);
        std::fs::create_dir_all(&folder)?;
        for (k, bytes) in seeds::of(kind).into_iter().enumerate() {
            std::fs::write(folder.join(format!("seed-{k}")), bytes)?;
        }
    }
    Ok(())
}
