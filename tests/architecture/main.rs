//! The dependency table of the house as a test: it reads the source as syntax and resolves every path it finds, in `use`
//! lines, in code and inside macros. A rule that is not in this file, in a lint or in another test is not a rule.

#[cfg(test)]
mod building;
#[cfg(test)]
mod reading;

use reading::{Found, House, Target};
use std::path::Path;

/// Lower-triangular: each part may name itself and the parts above it, nothing below. `pipeline` is its `mod.rs`, the front
/// door; a re-exported name counts as the part it comes from.
const ORDER: [&str; 14] = [
    "pipeline/error",
    "pipeline/vocabulary",
    "pipeline/rays",
    "pipeline/hull",
    "pipeline/flux",
    "pipeline/goniogram",
    "pipeline/model",
    "pipeline/artifacts",
    "pipeline/memory",
    "pipeline",
    "service",
    "command",
    "lib",
    "main",
];

/// The only names that look up: the part, the name, and why.
const UPWARD: [(&str, &str); 2] = [
    ("pipeline/artifacts", "pipeline::Options"), // the report echoes every choice of the caller
    ("pipeline/memory", "pipeline::Options"),    // what is needed follows from every choice of the caller
];

/// What the service may name inside `pipeline` besides the names its front door defines or re-exports.
const SIDE_DOORS: [&str; 1] = ["pipeline::artifacts::zip"];

/// Every crate the computation may name.
const PIPELINE_CRATES: [&str; 13] = [
    "core",
    "flate2",
    "glam",
    "obvhs",
    "rand_chacha",
    "rayon",
    "ruzstd",
    "serde",
    "serde_json",
    "sha2",
    "std",
    "thiserror",
    "zip",
];

/// The world, which the computation does not know.
const WORLD: [&str; 6] = ["env", "fs", "net", "process", "thread", "time"];

/// One foreign library, one file (or folder): whoever replaces it reads no other. The one with two rows is the operating system.
const HOMES: [(&str, &str); 30] = [
    ("flate2", "pipeline/rays/container"),
    ("ruzstd", "pipeline/rays/container/zstd"),
    ("obvhs", "pipeline/flux/bvh"),
    ("zip", "pipeline/artifacts"),
    ("sqlx", "service/storage/records"),
    ("object_store", "service/storage/blobs"),
    ("getrandom", "service/access/keys"),
    ("subtle", "service/access/keys"),
    ("governor", "service/access/rate"),
    ("hashlink", "service/jobs/recent"),
    ("hmac", "service/webhooks/signature"),
    ("reqwest", "service/outbound"),
    ("prometheus_client", "service/metrics"),
    ("httpdate", "service/api/tus"),
    ("sha1", "service/upload/checksum"),
    ("hyper", "service/connections"),
    ("hyper_util", "service/connections"),
    ("ring", "service/upload/extent"),
    ("rustix", "service/storage"),
    ("rustix", "service/priority"),
    ("percent_encoding", "service/storage/database_file"),
    ("opentelemetry", "service/telemetry/traces"),
    ("opentelemetry_otlp", "service/telemetry/traces"),
    ("opentelemetry_sdk", "service/telemetry/traces"),
    ("tracing_opentelemetry", "service/telemetry/traces"),
    ("rustls", "service/tls"),
    ("indicatif", "command/progress"),
    ("bytesize", "command/measure"),
    ("humantime", "command/measure"),
    ("strsim", "command/environment"),
];

/// Longest file, in lines.
const LONGEST_FILE: usize = 500;
/// Names that say nothing.
const EMPTY_NAMES: [&str; 4] = ["utils", "util", "helpers", "common"];
/// Marks of unfinished work, spelt so that this file does not find itself.
const UNFINISHED: [&str; 4] =
    [concat!("TO", "DO"), concat!("FIX", "ME"), concat!("todo", "!"), concat!("unimpl", "emented!")];
/// Fewest source files there can be; fewer means that this test looked in the wrong place.
const FEWEST_FILES: usize = 40;

#[test]
fn the_house_keeps_its_own_rules() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let house = House::read(root);
    assert!(house.files.len() >= FEWEST_FILES, "only {} source files were read", house.files.len());
    let offences: Vec<String> = [arrows, front_door, crates, purity, parts, homes, budgets]
        .into_iter()
        .flat_map(|rule| rule(&house))
        .chain(budgets(&House::read_folder(root, "tests")))
        .collect();
    assert!(offences.is_empty(), "\n{}\n", offences.join("\n"));
}

/// The part a module path (`pipeline/rays/tm25`) belongs to: the longest row of the table that begins it.
fn part(path: &str) -> Option<usize> {
    let begins = |row: &str| path.strip_prefix(row).is_some_and(|rest| rest.is_empty() || rest.starts_with('/'));
    (0..ORDER.len()).filter(|k| begins(ORDER[*k])).max_by_key(|k| ORDER[*k].len())
}

/// Nothing names a part below its own row.
fn arrows(house: &House) -> Vec<String> {
    let upward = |found: &&Found| {
        let (Target::Ours { origin, named }, Some(here)) = (&found.target, part(&found.file)) else { return false };
        let known = UPWARD.contains(&(ORDER[here], named.as_str()));
        !known && part(&origin.replace("::", "/")).is_some_and(|there| there > here)
    };
    house.found.iter().filter(upward).map(|found| found.says("looks up the table")).collect()
}

/// The service sees only the front door of the pipeline.
fn front_door(house: &House) -> Vec<String> {
    let inside = |found: &&Found| {
        let Target::Ours { named, .. } = &found.target else { return false };
        let Some(name) = named.strip_prefix("pipeline::") else { return false };
        let first = name.split("::").next().unwrap_or(name);
        part(&found.file).is_some_and(|row| ORDER[row] == "service")
            && !house.front_door.contains(first)
            && !SIDE_DOORS.contains(&named.as_str())
    };
    house.found.iter().filter(inside).map(|found| found.says("goes past the front door of pipeline")).collect()
}

/// The computation names only the crates of its short list (its tests may name others), and a crate with a home is named nowhere else.
fn crates(house: &House) -> Vec<String> {
    let mut offences = Vec::new();
    for found in &house.found {
        let Target::Foreign(path) = &found.target else { continue };
        let name = path.split("::").next().unwrap_or(path);
        if found.file.starts_with("pipeline") && !found.in_test && !PIPELINE_CRATES.contains(&name) {
            offences.push(found.says("is not on the pipeline's list of crates"));
        }
        let homes: Vec<&str> = HOMES.iter().filter(|(library, _)| *library == name).map(|(_, home)| *home).collect();
        if !homes.is_empty() && !homes.iter().any(|home| found.file.starts_with(home)) {
            offences.push(found.says(&format!("names {name}, whose home is {}", homes.join(" or "))));
        }
    }
    offences
}

/// The computation knows no disk, clock, network, thread or async.
fn purity(house: &House) -> Vec<String> {
    let worldly = |found: &&Found| {
        let Target::Foreign(path) = &found.target else { return false };
        let mut segments = path.split("::");
        let standard = matches!(segments.next(), Some("std" | "core" | "alloc"));
        let within = segments.next();
        standard && within.is_none_or(|name| name == "*" || WORLD.contains(&name))
    };
    let impure =
        |found: &&Found| found.file.starts_with("pipeline") && (found.target == Target::Async || worldly(found));
    house.found.iter().filter(impure).map(|found| found.says("is of the world; the pipeline is pure")).collect()
}

/// Every file has a row and every row a file; `#[path]` would make both meaningless.
fn parts(house: &House) -> Vec<String> {
    let homeless = house.files.iter().filter(|file| {
        part(&file.name).is_none() || file.name.starts_with("pipeline/") && part(&file.name) == part("pipeline")
    });
    let stale = |row: &&&str| !house.files.iter().any(|file| part(&file.name).is_some_and(|k| ORDER[k] == **row));
    homeless
        .map(|file| format!("src/{} has no row in ORDER", file.name))
        .chain(ORDER.iter().filter(stale).map(|row| format!("row {row} of ORDER is stale: no such file")))
        .chain(house.moved.iter().map(|file| format!("src/{file} uses #[path]")))
        .collect()
}

/// No row of the crate tables is stale.
fn homes(house: &House) -> Vec<String> {
    let used = |library: &str, home: &str| {
        let by =
            |found: &&Found| matches!(&found.target, Target::Foreign(path) if path.split("::").next() == Some(library));
        house.found.iter().filter(by).any(|found| found.file.starts_with(home))
    };
    let idle_home = HOMES.iter().filter(|(library, home)| !used(library, home));
    let idle_crate =
        PIPELINE_CRATES.iter().filter(|library| !matches!(**library, "core" | "std") && !used(library, "pipeline"));
    idle_home
        .map(|(library, home)| format!("row ({library}, {home}) of HOMES is stale: it is not used there"))
        .chain(idle_crate.map(|library| format!("{library} of PIPELINE_CRATES is stale: the pipeline does not use it")))
        .collect()
}

/// What clippy cannot count: the length of files, empty names, unfinished work.
fn budgets(house: &House) -> Vec<String> {
    let mut offences = Vec::new();
    for file in &house.files {
        let lines = file.text.lines().count();
        if lines > LONGEST_FILE {
            offences.push(format!("{}: {lines} lines, at most {LONGEST_FILE}", file.name));
        }
        if file.name.split('/').any(|name| EMPTY_NAMES.contains(&name)) {
            offences.push(format!("{}: a name that says nothing", file.name));
        }
        offences.extend(
            house
                .modules_in(file)
                .filter(|name| EMPTY_NAMES.contains(&name.as_str()))
                .map(|name| format!("{}: mod {name} says nothing", file.name)),
        );
        for (number, line) in file.text.lines().enumerate() {
            if let Some(mark) = UNFINISHED.iter().find(|mark| line.contains(*mark)) {
                offences.push(format!("{}:{}: {mark}", file.name, number + 1));
            }
        }
    }
    offences
}

/// Each rule is seen to fail: one small wrong house per case, and a word its complaint must contain.
mod every_rule_can_fail {
    use super::*;

    /// A house of two files: a right front door, and `text` at `name`.
    fn house(name: &str, text: &str) -> House {
        let door = "pub mod vocabulary; pub mod rays; pub mod flux; pub mod artifacts; mod error; pub use error::Error; pub use rays::Input; pub struct Options; pub fn run() {}";
        let vocabulary = "pub mod units;";
        House::from_texts(&[("pipeline/mod", door), ("pipeline/vocabulary/mod", vocabulary), (name, text)])
    }

    fn broken(rule: fn(&House) -> Vec<String>, name: &str, text: &str) -> bool {
        !rule(&house(name, text)).is_empty()
    }

    #[test]
    fn arrows_point_up_the_table_only() {
        for wrong in [
            "use super::super::flux::Surface;",
            "use crate::flux;",
            "use super::super::{vocabulary::units, flux::{bvh}};",
            "fn f() -> crate::flux::Surface { g() }",
            "fn f() { let _ = format!(\"{}\", super::super::flux::count()); }",
            "use super::super as door; fn f() { door::flux::count() }",
            "use super::super::Options;",
            "use super::super::*;",
            "fn f() { lampwright::service::start() }",
            "mod inner { use super::super::super::flux::Surface; }",
            "mod tests { fn f() { lampwright::command::serve() } }",
        ] {
            assert!(broken(arrows, "pipeline/rays/check", wrong), "{wrong}");
        }
        for right in [
            "use super::super::vocabulary::units::Flux; use super::super::{Error, Input}; use super::source::Ray;",
            "use crate::vocabulary::units::Flux; use crate::Input;",
            "fn f() { let flux = 1; let _ = format!(\"{flux}\"); }",
            "mod flux { pub fn count() {} } fn f() { flux::count() }",
        ] {
            assert_eq!(arrows(&house("pipeline/rays/check", right)), [""; 0], "{right}");
        }
        assert_eq!(arrows(&house("pipeline/artifacts/report", "use super::super::Options;")), [""; 0]);
        assert!(broken(arrows, "pipeline/vocabulary/units", "use super::super::rays::Ray;"));
        assert!(broken(arrows, "service/mod", "use crate::command;"));
    }

    #[test]
    fn the_service_stays_at_the_front_door() {
        for wrong in [
            "use crate::pipeline::rays::Input;",
            "use crate::pipeline::*;",
            "use crate::pipeline; fn f() { pipeline::vocabulary::units::f() }",
            "fn f() { let _ = vec![crate::pipeline::rays::open()]; }",
        ] {
            assert!(broken(front_door, "service/jobs/worker", wrong), "{wrong}");
        }
        let right = "use crate::pipeline::{self, Error, Input, Options, artifacts::zip}; fn f() { pipeline::run() }";
        assert_eq!(front_door(&house("service/jobs/worker", right)), [""; 0]);
        assert_eq!(front_door(&house("command/build", "use crate::pipeline::rays::open;")), [""; 0]);
    }

    #[test]
    fn crates_stay_at_home() {
        for (name, wrong) in [
            ("pipeline/rays/check", "use tokio::fs;"),
            ("pipeline/rays/check", "use undeclared::Thing;"),
            ("pipeline/rays/check", "#[derive(utoipa::ToSchema)] struct A;"),
            ("pipeline/rays/check", "extern crate uuid;"),
            ("pipeline/rays/check", "fn f() { let _ = tower_http::trace::new(); }"),
            ("pipeline/flux/project", "use obvhs::Bvh;"),
            ("service/api/mod", "fn f() { sqlx::query() }"),
            ("service/storage/records", "use object_store::path;"),
        ] {
            assert!(broken(crates, name, wrong), "{name}: {wrong}");
        }
        assert!(!broken(crates, "pipeline/flux/bvh", "use obvhs::Bvh; use glam::DVec3;"));
        assert!(!broken(crates, "pipeline/rays/check", "#[cfg(test)] mod tests { use tempfile::tempdir; }"));
        let outside = ("pipeline/hull/mod", "#[cfg(test)] mod tests;");
        let texts = [outside, ("pipeline/hull/tests", "use tempfile::tempdir;")];
        assert_eq!(crates(&House::from_texts(&texts)), [""; 0]);
        assert!(broken(crates, "pipeline/rays/check", "#[cfg(unix)] mod tests { use tempfile::tempdir; }"));
    }

    #[test]
    fn the_pipeline_is_pure() {
        for wrong in [
            "use std::{io, fs};",
            "use std::time::Instant;",
            "use std as world;",
            "use std::*;",
            "use std; fn f() { std::thread::sleep(d) }",
            "fn f() { println!(\"{}\", std::env::args().count()) }",
            "async fn f() {}",
            "fn f() { async { 1 }; }",
            "#[cfg(test)] mod tests { fn f() { std::fs::read(\"x\"); } }",
        ] {
            assert!(broken(purity, "pipeline/rays/check", wrong), "{wrong}");
        }
        assert!(!broken(
            purity,
            "pipeline/rays/check",
            "use std::io; use std::sync::Arc; fn f() { std::iter::empty() }"
        ));
        assert!(!broken(purity, "service/upload", "use std::fs; async fn f() {}"));
    }

    #[test]
    fn tables_have_no_gap_and_no_stale_row() {
        let complaints = parts(&house("pipeline/newcomer/mod", ""));
        assert!(complaints.iter().any(|line| line.contains("newcomer")), "{complaints:?}");
        assert!(
            complaints.iter().any(|line| line.contains("pipeline/hull") && line.contains("stale")),
            "{complaints:?}"
        );
        assert!(parts(&house("elsewhere", "")).iter().any(|line| line.contains("elsewhere")));
        assert!(
            parts(&house("pipeline/rays/mod", "#[path = \"x.rs\"] mod x;")).iter().any(|line| line.contains("#[path]"))
        );
        assert!(homes(&house("pipeline/rays/mod", "")).iter().any(|line| line.contains("obvhs")));
    }

    #[test]
    fn budgets_are_counted() {
        assert!(broken(budgets, "pipeline/rays/check", &"\n".repeat(LONGEST_FILE + 1)));
        assert!(!broken(budgets, "pipeline/rays/check", &"\n".repeat(LONGEST_FILE)));
        assert!(broken(budgets, "pipeline/rays/helpers", ""));
        assert!(broken(budgets, "pipeline/rays/check", "mod utils {}"));
        for mark in UNFINISHED {
            assert!(broken(budgets, "pipeline/rays/check", &format!("// {mark}")), "{mark}");
        }
    }
}
