//! The rules of the house as a test: it reads the source as syntax and resolves every path it finds, in `use` lines, in code and
//! inside macros. What Cargo holds (which package may name which, and which crates) is not here.

#[cfg(test)]
mod building;
#[cfg(test)]
mod codes;
#[cfg(test)]
mod papers;
#[cfg(test)]
mod reading;

use reading::{Found, House, Target};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// The order of the computation: each part may name itself and the parts before it, nothing after it. `lib` is its front door; a
/// re-exported name counts as the part it comes from.
const PIPELINE: [&str; 23] = [
    "error",
    "vocabulary",
    "options",
    "writing",
    "formats",
    "rays",
    "known_sources",
    "inspection",
    "source",
    "convert",
    "hull",
    "smoothing",
    "flux",
    "goniogram",
    "volume",
    "model",
    "candidates",
    "artifacts",
    "combination",
    "new_rays",
    "evaluation",
    "adapters",
    "memory",
];

/// The order of the service.
const SERVICE: [&str; 25] = [
    "tls",
    "crash",
    "hex",
    "calendar",
    "machine",
    "priority",
    "telemetry",
    "metrics",
    "failure",
    "storage",
    "cause",
    "outbound",
    "accounts",
    "metadata",
    "ray_sets",
    "spectra",
    "uploads",
    "forwarded",
    "webhooks",
    "jobs",
    "models",
    "connections",
    "config",
    "upkeep",
    "http",
];

/// What the service may name inside `pipeline` besides the names its front door defines or re-exports.
const SIDE_DOORS: [&str; 1] = ["pipeline::artifacts::zip"];

/// The world, which the computation does not know.
const WORLD: [&str; 6] = ["env", "fs", "net", "process", "thread", "time"];

/// One foreign library, one file (or folder): whoever replaces it reads no other. The one with two rows is the operating system.
const HOMES: [(&str, &str); 31] = [
    ("flate2", "pipeline/formats/packed"),
    ("ruzstd", "pipeline/formats/packed/zstd"),
    ("obvhs", "pipeline/flux/bvh"),
    ("zip", "pipeline/artifacts"),
    ("tiff", "pipeline/evaluation/file/tiff"),
    ("sqlx", "service/storage/records"),
    ("object_store", "service/storage/blobs"),
    ("getrandom", "service/accounts/keys"),
    ("subtle", "service/accounts/keys"),
    ("governor", "service/accounts/rate"),
    ("hashlink", "service/jobs/recent"),
    ("hmac", "service/webhooks/signature"),
    ("reqwest", "service/outbound"),
    ("prometheus_client", "service/metrics"),
    ("httpdate", "service/http/tus"),
    ("sha1", "service/uploads/checksum"),
    ("hyper", "service/connections"),
    ("hyper_util", "service/connections"),
    ("ring", "service/ray_sets/extent"),
    ("rustix", "service/storage"),
    ("rustix", "service/priority"),
    ("percent_encoding", "service/storage/database_url"),
    ("opentelemetry", "service/telemetry/traces"),
    ("opentelemetry_otlp", "service/telemetry/traces"),
    ("opentelemetry_sdk", "service/telemetry/traces"),
    ("tracing_opentelemetry", "service/telemetry/traces"),
    ("rustls", "service/tls"),
    ("indicatif", "command/terminal/progress"),
    ("bytesize", "command/terminal/measure"),
    ("humantime", "command/terminal/measure"),
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
    let offences: Vec<String> = [arrows, loops, front_door, at_home, purity, parts, homes, budgets]
        .into_iter()
        .flat_map(|rule| rule(&house))
        .chain(budgets(&House::read_folder(root, "tests")))
        .collect();
    assert!(offences.is_empty(), "\n{}\n", offences.join("\n"));
}

/// Every part in its order: those of the computation, its front door, those of the service, its own, the command line.
fn order() -> Vec<String> {
    let within =
        |package: &str, parts: &[&str]| parts.iter().map(|part| format!("{package}/{part}")).collect::<Vec<_>>();
    let packages = [within("pipeline", &PIPELINE), vec!["pipeline".to_owned()], within("service", &SERVICE)];
    let rest = ["service", "command", "main"].map(str::to_owned).to_vec();
    packages.into_iter().flatten().chain(rest).collect()
}

/// The part a module path (`pipeline/formats/tm25`) belongs to: the longest row that begins it.
fn part(path: &str) -> Option<usize> {
    let begins = |row: &str| path.strip_prefix(row).is_some_and(|rest| rest.is_empty() || rest.starts_with('/'));
    order().iter().enumerate().filter(|(_, row)| begins(row)).max_by_key(|(_, row)| row.len()).map(|(index, _)| index)
}

/// Nothing names a part after its own.
fn arrows(house: &House) -> Vec<String> {
    let upward = |found: &&Found| {
        let (Target::Ours { origin, .. }, Some(here)) = (&found.target, part(&found.file)) else { return false };
        part(&origin.replace("::", "/")).is_some_and(|there| there > here)
    };
    house.found.iter().filter(upward).map(|found| found.says("names a part after its own")).collect()
}

/// No two files need each other, directly or through others. Tests and re-exports do not count, nor does the name of a module.
fn loops(house: &House) -> Vec<String> {
    let files: BTreeSet<&str> = house.files.iter().map(|file| file.name.as_str()).collect();
    let mut needs: BTreeMap<&str, BTreeSet<&str>> = BTreeMap::new();
    for found in house.found.iter().filter(|found| !found.in_test && !found.is_reexport) {
        let Target::Ours { origin, .. } = &found.target else { continue };
        let origin = origin.replace("::", "/");
        if house.is_module(&origin) {
            continue;
        }
        let ends = origin.match_indices('/').map(|(end, _)| end);
        let home = ends.rev().find_map(|end| files.get(&origin[..end]));
        let here = files.get(found.file.as_str());
        if let (Some(here), Some(home)) = (here, home)
            && here != home
        {
            needs.entry(here).or_default().insert(home);
        }
    }
    // A file is in a loop if it can be reached from itself.
    let reached = |from: &str| {
        let (mut seen, mut next) = (BTreeSet::new(), vec![from]);
        while let Some(file) = next.pop() {
            for needed in needs.get(file).into_iter().flatten() {
                if seen.insert(*needed) {
                    next.push(needed);
                }
            }
        }
        seen
    };
    files
        .iter()
        .filter(|file| reached(file).contains(*file))
        .map(|file| format!("src/{file} is in a loop of files"))
        .collect()
}

/// The service sees only the front door of the pipeline.
fn front_door(house: &House) -> Vec<String> {
    let inside = |found: &&Found| {
        let Target::Ours { named, .. } = &found.target else { return false };
        let Some(name) = named.strip_prefix("pipeline::") else { return false };
        let first = name.split("::").next().unwrap_or(name);
        found.file.starts_with("service") && !house.front_door.contains(first) && !SIDE_DOORS.contains(&named.as_str())
    };
    house.found.iter().filter(inside).map(|found| found.says("goes past the front door of pipeline")).collect()
}

/// A crate with a home is named nowhere else.
fn at_home(house: &House) -> Vec<String> {
    let strays = |found: &&Found| {
        let Target::Foreign(path) = &found.target else { return false };
        let name = path.split("::").next().unwrap_or(path);
        let mut homes = HOMES.iter().filter(|(library, _)| *library == name).peekable();
        homes.peek().is_some() && !homes.any(|(_, home)| found.file.starts_with(home))
    };
    house.found.iter().filter(strays).map(|found| found.says("is named outside of its home")).collect()
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
    let front = |file: &str| matches!(file, "pipeline" | "service" | "service/build");
    let homeless = house.files.iter().filter(|file| {
        let row = part(&file.name);
        row.is_none() || !front(&file.name) && (row == part("pipeline") || row == part("service"))
    });
    let order = order();
    let stale = |row: &&String| !house.files.iter().any(|file| part(&file.name).is_some_and(|k| order[k] == **row));
    homeless
        .map(|file| format!("src/{} has no row in the order", file.name))
        .chain(order.iter().filter(stale).map(|row| format!("row {row} of the order is stale: no such file")))
        .chain(house.moved.iter().map(|file| format!("src/{file} uses #[path]")))
        .collect()
}

/// No row of the homes is stale.
fn homes(house: &House) -> Vec<String> {
    let used = |library: &str, home: &str| {
        let by =
            |found: &&Found| matches!(&found.target, Target::Foreign(path) if path.split("::").next() == Some(library));
        house.found.iter().filter(by).any(|found| found.file.starts_with(home))
    };
    let idle = HOMES.iter().filter(|(library, home)| !used(library, home));
    idle.map(|(library, home)| format!("row ({library}, {home}) of HOMES is stale: it is not used there")).collect()
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
        let door = "pub mod vocabulary; pub mod rays; pub mod flux; pub mod artifacts; mod error; pub use error::Error; pub use rays::Input; pub fn run() {}";
        let vocabulary = "pub mod units;";
        House::from_texts(&[("pipeline/lib", door), ("pipeline/vocabulary/mod", vocabulary), (name, text)])
    }

    fn broken(rule: fn(&House) -> Vec<String>, name: &str, text: &str) -> bool {
        !rule(&house(name, text)).is_empty()
    }

    #[test]
    fn arrows_point_back_only() {
        for wrong in [
            "use super::super::flux::Surface;",
            "use crate::flux;",
            "use super::super::{vocabulary::units, flux::{bvh}};",
            "fn f() -> crate::flux::Surface { g() }",
            "fn f() { let _ = format!(\"{}\", super::super::flux::count()); }",
            "use super::super as door; fn f() { door::flux::count() }",
            "use super::super::*;",
            "fn f() { service::start() }",
            "mod inner { use super::super::super::flux::Surface; }",
            "mod tests { fn f() { service::http::router() } }",
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
        assert!(broken(arrows, "pipeline/vocabulary/units", "use super::super::rays::Ray;"));
        assert!(broken(arrows, "service/jobs/worker", "use crate::http::Problem;"));
        assert!(!broken(arrows, "service/jobs/worker", "use crate::storage::Error; use pipeline::rays::Ray;"));
        assert!(!broken(arrows, "command/build", "use service::http::router; use crate::command::Failure;"));
    }

    #[test]
    fn loops_of_files_are_found() {
        let texts = |b: &'static str, child: &'static str| {
            House::from_texts(&[
                ("pipeline/hull/mod", "mod a; mod b; mod c; pub use a::first; pub fn wrap() { a::first() }"),
                ("pipeline/hull/a", "pub fn first() { super::b::second() }"),
                ("pipeline/hull/b", b),
                ("pipeline/hull/c", child),
            ])
        };
        let (calm, child) = ("pub fn second() {}", "pub fn third() {}");
        assert_eq!(loops(&texts(calm, child)), [""; 0]);
        assert_eq!(loops(&texts("use super::a; pub fn second() {} fn f() { a::first() }", child)).len(), 2);
        assert_eq!(loops(&texts("pub fn second() { super::c::third() }", "use super::a::first;")).len(), 3);
        assert_eq!(loops(&texts("pub fn second() { super::wrap() }", child)).len(), 3, "through the folder's own file");
        assert_eq!(loops(&texts("pub fn second() {} mod tests { use super::super::a::first; }", child)).len(), 2);
        let tests = "pub fn second() {} #[cfg(test)] mod tests { use super::super::a::first; }";
        assert_eq!(loops(&texts(tests, child)), [""; 0]);
    }

    #[test]
    fn the_service_stays_at_the_front_door() {
        for wrong in [
            "use pipeline::rays::Input;",
            "use pipeline::*;",
            "use pipeline; fn f() { pipeline::vocabulary::units::f() }",
            "fn f() { let _ = vec![pipeline::rays::open()]; }",
        ] {
            assert!(broken(front_door, "service/jobs/worker", wrong), "{wrong}");
        }
        let right = "use pipeline::{Error, Input, artifacts::zip}; fn f() { pipeline::run() }";
        assert_eq!(front_door(&house("service/jobs/worker", right)), [""; 0]);
        assert_eq!(front_door(&house("command/build", "use pipeline::rays::open;")), [""; 0]);
    }

    #[test]
    fn crates_stay_at_home() {
        for (name, wrong) in [
            ("pipeline/flux/project", "use obvhs::Bvh;"),
            ("service/http/mod", "fn f() { sqlx::query() }"),
            ("service/storage/records", "use object_store::path;"),
            ("service/http/mod", "extern crate sqlx;"),
        ] {
            assert!(broken(at_home, name, wrong), "{name}: {wrong}");
        }
        assert!(!broken(at_home, "pipeline/flux/bvh", "use obvhs::Bvh; use glam::DVec3;"));
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
        assert!(!broken(purity, "service/ray_sets", "use std::fs; async fn f() {}"));
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
