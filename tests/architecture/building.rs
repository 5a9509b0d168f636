//! What a build is called by the numbers it gives.

#[expect(dead_code, reason = "its main is for cargo")]
#[path = "../../src/service/build.rs"]
mod build;

use build::{ORIGINS, identity};
use service::jobs::estimate::PIPELINE;
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

#[test]
fn this_build_is_named_for_the_sources_at_hand() {
    let here = identity(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src/service"), &ORIGINS).unwrap();
    assert!(PIPELINE.starts_with(&format!("{here}-")), "{PIPELINE} is not of {here}");
}

#[test]
fn any_change_of_the_computation_is_another_build() {
    let houses: [&[(&str, &str)]; 6] = [
        &[("a.rs", "one"), ("in/b.rs", "two")],
        &[("a.rs", "one"), ("in/b.rs", "twp")],
        &[("a.rs", "onet"), ("in/b.rs", "wo")],
        &[("a.rs", "two"), ("in/b.rs", "one")],
        &[("a.rs", "one"), ("in/c.rs", "two")],
        &[("a.rs", "one"), ("in/b.rs", "two"), ("z.rs", "")],
    ];
    let of = |files: &[(&str, &str)]| {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir_all(folder.path().join("src/in")).unwrap();
        files.iter().for_each(|(name, text)| fs::write(folder.path().join("src").join(name), text).unwrap());
        identity(folder.path(), &["src"]).unwrap()
    };
    assert_eq!(of(houses[0]), of(houses[0]), "wherever it lies");
    let with_a_page = [houses[0], &[(concat!("in/PAGE", ".md"), "What it means.")]].concat();
    assert_eq!(of(houses[0]), of(&with_a_page), "a page beside it");
    assert_eq!(houses.into_iter().map(of).collect::<BTreeSet<String>>().len(), houses.len());
}
