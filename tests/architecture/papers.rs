//! What comments and pages cite is in the repository, and what is tested is run.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// Folders whose files are read, and files beside them.
const READ: [&str; 6] = ["src", "tests", "openapi", "README.md", "Cargo.toml", "Dockerfile"];
/// Endings of files in which something is cited.
const ENDINGS: [&str; 4] = ["rs", "md", "toml", "sql"];

/// Every file below `path` that can cite something.
fn gather(path: &Path, into: &mut Vec<PathBuf>) {
    if path.is_dir() {
        let entries = fs::read_dir(path).unwrap().map(|entry| entry.unwrap().path());
        entries.for_each(|entry| gather(&entry, into));
    } else if path.extension().is_none_or(|end| ENDINGS.iter().any(|known| end == *known)) {
        into.push(path.to_owned());
    }
}

/// The documents that a text names: words that end in `.md`.
fn cited(text: &str) -> BTreeSet<&str> {
    let is_part = |c: char| c.is_ascii_alphanumeric() || "_-./".contains(c);
    let words = text.split(|c: char| !is_part(c)).map(|word| word.trim_end_matches('.'));
    words.filter(|word| word.ends_with(".md") && word.len() > 3 && !word.contains("//")).collect()
}

/// The targets of the links in a page that lead to files.
fn linked(text: &str) -> BTreeSet<&str> {
    let targets = text.split("](").skip(1).filter_map(|rest| rest.split([')', '#', ' ']).next());
    targets.filter(|target| !target.is_empty() && !target.contains(':')).collect()
}

/// What `file` cites or links to and is not there; a name counts from the file's folder, from `src` and from the root.
fn missing(root: &Path, file: &Path, text: &str) -> Vec<String> {
    let folder = file.parent().unwrap_or(root);
    let places = [folder.to_owned(), root.join("src"), root.to_owned()];
    let lost = |name: &&&str| !places.iter().any(|place| place.join(name.trim_start_matches('/')).exists());
    let links = if file.extension().is_some_and(|end| end == "md") { linked(text) } else { BTreeSet::new() };
    let dead = links.iter().filter(|target| !folder.join(target).exists());
    let cited = cited(text);
    let found = cited.iter().filter(lost).chain(dead);
    found.map(|name| format!("{}: {name} is not there", file.display())).collect()
}

/// The tests of `manifest` that `script`, which names those it runs, does not run.
fn left_out(manifest: &str, script: &str) -> Vec<String> {
    let tests = manifest.split("[[test]]").skip(1).filter_map(|rest| rest.split('"').nth(1));
    let is_run = |name: &str| script.split("--test ").skip(1).any(|rest| rest.split([' ', '\n']).next() == Some(name));
    tests.filter(|name| !is_run(name)).map(str::to_owned).collect()
}

#[test]
fn every_test_of_the_manifest_is_run() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let text = |name: &str| fs::read_to_string(root.join(name)).unwrap();
    let manifest = text("Cargo.toml");
    assert_eq!(left_out(&manifest, &text("tests/run")), [""; 0]);
    assert_eq!(
        left_out(&(manifest + "[[test]]\nname = \"proc\"\n"), "--test process\n--test api"),
        ["architecture", "pipeline", "accuracy", "crash", "proc"]
    );
}

#[test]
fn every_cited_document_and_every_link_is_there() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut files = Vec::new();
    READ.iter().for_each(|name| gather(&root.join(name), &mut files));
    assert!(files.len() > 300, "only {} files were read", files.len());
    let this = root.join(file!());
    let texts =
        files.iter().filter(|file| **file != this).filter_map(|file| Some((file, fs::read_to_string(file).ok()?)));
    let missing: Vec<String> = texts.flat_map(|(file, text)| missing(root, file, &text)).collect();
    assert!(missing.is_empty(), "\n{}\n", missing.join("\n"));
}

#[test]
fn what_is_not_there_is_found() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let lost = |name: &str, text: &str| missing(root, &root.join(name), text).len();
    assert_eq!(lost("src/pipeline/lib.rs", "//! `README.md` has the conventions, see `../service/README.md`."), 0);
    assert_eq!(lost("src/pipeline/lib.rs", "/// As `NOWHERE.md` 7 says, and openapi/README.md."), 1);
    assert_eq!(
        lost("README.md", "[here](src/README.md#order) and [there](https://example.org/x.md) and [nowhere](nope/)."),
        1
    );
}
