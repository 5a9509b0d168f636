//! Names the computation: results are used again for equal questions, and a build that computes otherwise must not answer with
//! what another one gave. A version number would have to be thought of; the sources change by themselves.

use std::hash::{DefaultHasher, Hasher};
use std::path::Path;
use std::{env, fs, io};

/// What numbers come from: our sources, and which libraries they use.
pub const ORIGINS: [&str; 2] = ["../pipeline", "../../Cargo.lock"];

fn main() -> io::Result<()> {
    for origin in ORIGINS {
        println!("cargo:rerun-if-changed={origin}");
    }
    let target = env::var("TARGET").unwrap_or_default();
    println!("cargo:rustc-env=LAMPWRIGHT_PIPELINE={}-{target}", identity(Path::new("."), &ORIGINS)?);
    Ok(())
}

/// The same for the same files of the same names and bytes in `root`. It is no protection against deliberate collisions.
pub fn identity(root: &Path, origins: &[&str]) -> io::Result<String> {
    let mut hasher = DefaultHasher::new();
    for origin in origins {
        add(&mut hasher, root, origin)?;
    }
    Ok(format!("{:016x}", hasher.finish()))
}

fn add(hasher: &mut DefaultHasher, root: &Path, name: &str) -> io::Result<()> {
    let path = root.join(name);
    if !path.is_dir() {
        for bytes in [name.as_bytes(), &fs::read(path)?] {
            hasher.write_usize(bytes.len());
            hasher.write(bytes);
        }
        return Ok(());
    }
    let entries = fs::read_dir(path)?.map(|entry| Ok(entry?.file_name().to_string_lossy().into_owned()));
    let mut names = entries.collect::<io::Result<Vec<String>>>()?;
    // A page beside the sources computes nothing.
    names.retain(|entry| !entry.ends_with(".md"));
    names.sort();
    names.iter().try_for_each(|entry| add(hasher, root, &format!("{name}/{entry}")))
}
