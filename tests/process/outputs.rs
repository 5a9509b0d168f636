//! What a verb writes, where, and what is left when it is stopped.

use crate::server::{command, lampwright, model, refused, says};
use std::fs;
use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

/// Longest wait for a process of these tests, on a machine busy with others.
const PATIENCE: Duration = Duration::from_secs(240);

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// Every verb that writes a file, with the same words for what is in the way.
#[test]
fn what_is_in_the_way_of_a_file_is_told_by_every_verb_that_writes_one() {
    let folder = tempfile::tempdir().unwrap();
    let at = model(folder.path());
    let [chip, model] = ["chip.tm25ray", "model"].map(&at);
    fs::create_dir(at("taken.dat")).unwrap();
    for extension in ["dat", "svg"] {
        fs::write(at(&format!("mine.{extension}")), "precious").unwrap();
    }
    fs::create_dir(at("taken.svg")).unwrap();
    let camera = ["evaluate", &model, "camera", "--eye", "0,0,9", "--width", "2", "--columns", "4"];
    for (line, extension) in [
        (&["convert", &chip][..], "dat"),
        (&["rays", &model, "-n", "9"], "dat"),
        (&["sample", "flat-chip", "-n", "9"], "dat"),
        (&camera, "svg"),
    ] {
        let to = |name: &str, parts: &[&str]| {
            let file = at(&format!("{name}.{extension}"));
            says(&refused(&[line, &["-o", &file]].concat()), &[parts, &[file.as_str()]].concat());
        };
        to("mine", &["error output.exists", "give --force"]);
        to("taken", &["error output.folder", "A folder has the name"]);
        to("nowhere/new", &["error output.no_folder", "nowhere, is not there", "Make the folder first"]);
        to("mine.dat/new", &["error output.no_folder"]);
        assert_eq!(fs::read(at(&format!("mine.{extension}"))).unwrap(), b"precious");
    }
    for line in [&["build", &chip][..], &["combine", &model], &["adapter", "radiance", &model]] {
        let to = |folder: &str, parts: &[&str]| says(&refused(&[line, &["-o", &at(folder)]].concat()), parts);
        to("mine.dat", &["error output.file", "mine.dat is a file, no folder"]);
        to("mine.dat/new", &["error output.file", "mine.dat is a file, no folder"]);
        to("model", &["error output.not_empty"]);
    }
    assert_eq!(names(folder.path()), ["chip.tm25ray", "mine.dat", "mine.svg", "model", "taken.dat", "taken.svg"]);
}

#[test]
fn drawings_are_not_replaced_unasked() {
    let folder = tempfile::tempdir().unwrap();
    let at = model(folder.path());
    let [chip, drawings] = ["chip.tm25ray", "drawings"].map(&at);
    let inspect = ["inspect", &chip, "--svg", &drawings];
    assert!(lampwright(&inspect).status.success());
    let origins = at("drawings/chip.tm25ray.origins.svg");
    fs::write(&origins, "edited").unwrap();
    says(&refused(&inspect), &["error output.exists", &origins, "give --force"]);
    assert_eq!(fs::read(&origins).unwrap(), b"edited");
    assert!(lampwright(&[&inspect[..], &["--force"]].concat()).status.success());
    assert!(fs::read(&origins).unwrap().starts_with(b"<svg"));
    says(&refused(&["inspect", &chip, "--svg", &chip]), &["error output.file"]);
    // Two files of one name have drawings of their own.
    fs::create_dir(at("other")).unwrap();
    let other = at("other/chip.tm25ray");
    assert!(lampwright(&["sample", "dome", "-n", "3000", "-o", &other]).status.success());
    let both = at("both");
    assert!(lampwright(&["inspect", &chip, &other, "--svg", &both]).status.success());
    let drawn = |name: &str| fs::read(at(&format!("both/{name}.origins.svg"))).unwrap();
    assert!(names(Path::new(&both)).len() == 4 && drawn("chip.tm25ray") != drawn("chip.tm25ray.2"));
}

#[test]
fn rays_for_which_there_is_no_room_are_refused_before_they_are_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let at = model(folder.path());
    let began = Instant::now();
    let [model, new] = ["model", "new.tm25ray"].map(&at);
    // 32 bytes a ray with a wavelength, 28 without.
    for (line, size) in [(&["rays", &model][..], "32000.0 GB"), (&["sample", "flat-chip"], "28000.0 GB")] {
        let line = [line, &["-n", "1e12", "-o", &new]].concat();
        says(
            &refused(&line),
            &["error output.no_space", &format!("The file will have {size}"), "room for", "fewer rays"],
        );
    }
    assert!(began.elapsed() < PATIENCE, "{:?}", began.elapsed());
    assert!(!names(folder.path()).contains(&"new.tm25ray".to_owned()));
}

/// A verb that works for long, once it has begun to write.
fn working(line: &[&str], begun: impl Fn() -> bool) -> Child {
    let mut child = command(line).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let from = Instant::now();
    while !begun() {
        assert!(from.elapsed() < PATIENCE, "{line:?} has not begun");
        assert!(child.try_wait().unwrap().is_none(), "{line:?} ended before it was stopped");
        std::thread::sleep(Duration::from_millis(5));
    }
    child
}

fn stop(child: &mut Child, signal: &str) -> (Option<i32>, Option<i32>) {
    let sent = std::process::Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap();
    assert!(sent.success());
    let status = child.wait().unwrap();
    (status.code(), status.signal())
}

#[test]
fn what_is_interrupted_leaves_nothing_and_what_was_killed_goes_with_the_next_run() {
    let folder = tempfile::tempdir().unwrap();
    let at = model(folder.path());
    let before = names(folder.path());
    let [model, chip, new, out] = ["model", "chip.tm25ray", "new.tm25ray", "deep/out"].map(&at);
    let part = || names(folder.path()).iter().any(|name| name.ends_with(".part"));
    let rays = ["rays", &model, "-n", "6e7", "-o", &new];
    for (signal, code) in [("-INT", 130), ("-TERM", 143)] {
        assert_eq!(stop(&mut working(&rays, part), signal), (Some(code), None), "{signal}");
        assert_eq!(names(folder.path()), before, "{signal}");
    }
    // A folder for a model, while the model is being made.
    assert!(lampwright(&["sample", "four-chips", "-n", "3e6", "--force", "-o", &chip]).status.success());
    let build = ["build", &chip, "-o", &out];
    assert_eq!(stop(&mut working(&build, || Path::new(&out).is_dir()), "-INT"), (Some(130), None));
    assert_eq!(names(folder.path()), before);
    // Nobody hears of a kill -9.
    assert_eq!(stop(&mut working(&rays, part), "-KILL"), (None, Some(9)));
    assert!(part());
    assert!(lampwright(&["rays", &model, "-n", "9", "-o", &new]).status.success());
    assert!(!part(), "{:?}", names(folder.path()));
}
