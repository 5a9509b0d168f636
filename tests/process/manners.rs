//! What a person meets who uses a verb for the first time: nothing is overwritten or left behind, and messages speak of what was typed.

use crate::server::lampwright;
use std::fs;
use std::path::Path;
use std::process::Output;

/// A flat chip of 3000 rays and its model, in a folder of their own.
fn model(folder: &Path) -> impl Fn(&str) -> String + '_ {
    let at = move |name: &str| folder.join(name).to_str().unwrap().to_owned();
    assert!(lampwright(&["sample", "flat-chip", "--rays", "3000", "-o", &at("chip.tm25ray")]).status.success());
    assert!(lampwright(&["build", &at("chip.tm25ray"), "-o", &at("model")]).status.success());
    at
}

/// What was told on stderr of a refusal.
fn refused(arguments: &[&str]) -> String {
    let Output { status, stderr, .. } = lampwright(arguments);
    let told = String::from_utf8(stderr).unwrap();
    assert!(matches!(status.code(), Some(1 | 2)), "{arguments:?}: {status}: {told}");
    told
}

/// Each says all of these.
#[track_caller]
fn says(told: &str, parts: &[&str]) {
    for part in parts {
        assert!(told.contains(part), "{part:?} is not said: {told}");
    }
}

#[test]
fn a_known_source_replaces_a_file_only_where_it_may() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mine.tm25ray");
    fs::write(&path, "precious").unwrap();
    let file = path.to_str().unwrap();
    let told = refused(&["sample", "flat-chip", "--rays", "9", "-o", file]);
    says(&told, &["error sample.exists", "Name another output file, or give --force.", "mine.tm25ray"]);
    assert_eq!(fs::read(&path).unwrap(), b"precious");
    // The words of the verbs that had this rule before.
    let other = refused(&["convert", file, "-o", file]);
    assert_eq!(other.replace("convert.exists", "sample.exists"), told);
    assert!(lampwright(&["sample", "flat-chip", "--rays", "9", "--force", "-o", file]).status.success());
    assert!(fs::read(&path).unwrap().starts_with(b"TM25"));
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "no part stays behind");
}

#[test]
fn what_is_no_model_and_what_is_one_are_told_apart() {
    let folder = tempfile::tempdir().unwrap();
    let at = model(folder.path());
    fs::create_dir(at("photos")).unwrap();
    fs::create_dir(at("half")).unwrap();
    fs::copy(at("model/emitter.glb"), at("half/emitter.glb")).unwrap();
    let [photos, half, new] = ["photos", "half", "new"].map(&at);
    for line in [
        &["rays", &photos, "-n", "9", "-o", &at("new.dat")][..],
        &["evaluate", &photos, "intensity", "-o", &at("new.json")],
        &["adapter", "radiance", &photos, "-o", &new],
        &["combine", &photos, "-o", &new],
    ] {
        let told = refused(line);
        says(&told, &["The folder is no model", "no emitter.glb and no goniograms.json", &photos, "lampwright build"]);
    }
    let told = refused(&["rays", &half, "-n", "9", "-o", &at("new.dat")]);
    says(&told, &["no goniograms.json"]);
    assert!(!told.contains("no emitter.glb"), "{told}");
    // A model where rays are wanted, as folder and as zip, to every verb that reads rays.
    for taken in [at("model"), at("model/model.zip")] {
        for line in
            [&["inspect", &taken][..], &["build", &taken, "-o", &new], &["convert", &taken, "-o", &at("new.dat")]]
        {
            let told = refused(line);
            says(
                &told,
                &["error file.model", "This is a model", &taken, "lampwright rays", "evaluate, combine and adapter"],
            );
        }
    }
    says(&refused(&["inspect", &photos]), &["error file.folder", "This is a folder", &photos]);
}

#[test]
fn a_refusal_leaves_no_folder_and_a_folder_that_was_there_stays() {
    let folder = tempfile::tempdir().unwrap();
    let at = model(folder.path());
    fs::write(at("no.txt"), "no rays").unwrap();
    fs::create_dir(at("mine")).unwrap();
    let [rays, chip, scaled] = [at("no.txt"), at("model"), format!("{},scale=0", at("model"))];
    for (output, stays) in [("new", false), ("new/inner", false), ("mine", true), ("mine/inner", true)] {
        for line in [
            &["build", &rays][..],
            &["combine", &scaled],
            &["combine", &chip, &at("nowhere")],
            &["adapter", "blender", &chip, "--light", "spectrum"],
            &["adapter", "mitsuba", &at("mine")],
        ] {
            refused(&[line, &["-o", &at(output)]].concat());
            let top = folder.path().join(output.split('/').next().unwrap());
            assert_eq!(top.is_dir(), stays, "{line:?} in {output}");
            assert!(!stays || fs::read_dir(&top).unwrap().next().is_none(), "{line:?} in {output}");
        }
    }
    assert!(lampwright(&["combine", &chip, "-o", &at("new/inner")]).status.success());
    assert!(folder.path().join("new/inner/emitter.glb").is_file());
}

/// Declarations: what a remedy says is typed as it stands, and leads to the next question or the model.
#[test]
fn refusals_name_the_key_that_was_typed() {
    let folder = tempfile::tempdir().unwrap();
    let at = model(folder.path());
    fs::write(at("bare.txt"), "0 0 0 0 0 1 5\n0 1 0 0 0 1 5\n").unwrap();
    let [chip, bare, model, new] = ["chip.tm25ray", "bare.txt", "model", "new"].map(&at);
    let columns = format!("{bare},columns=x:y:z:l:m:n:flux");
    for (file, place, written) in [
        (columns.clone(), "length_unit= of file 1", "FILE,length_unit=mm"),
        (format!("{columns},length_unit=mm"), "quantity= of file 1", "FILE,quantity=lm"),
        (format!("{bare},columns=x:y:z"), "columns= of file 1", "FILE,columns=x:y:z:l:m:n:flux"),
        (format!("{chip},flux=-1W"), "flux= or share= of file 1", "FILE,flux=1.2W"),
        (format!("{chip},share=0.5W"), "flux= or share= of file 1", "--total 98lm"),
    ] {
        let told = refused(&["build", &file, "-o", &new]);
        says(&told, &[&format!(", {place}\n"), written]);
    }
    assert!(
        lampwright(&["build", &format!("{columns},length_unit=mm,quantity=lm"), "-o", &at("bare")]).status.success()
    );
    let inspected = lampwright(&["inspect", &columns]);
    says(&String::from_utf8(inspected.stdout).unwrap(), &["FILE,length_unit=mm.", "FILE,quantity=lm."]);
    for (key, place) in [("scale=-1", "scale="), ("move=1e99:0:0", "move="), ("turn=0:0:0:1", "turn=")] {
        let told = refused(&["combine", &format!("{model},{key}"), "-o", &new]);
        says(&told, &[&format!("{place}\n")]);
    }
}

/// The help of a verb has the flag that a refusal says it is at. Negative numbers arrive as values.
#[test]
fn refusals_name_the_flag_that_was_typed() {
    let folder = tempfile::tempdir().unwrap();
    let at = model(folder.path());
    let [chip, model, new, json] = ["chip.tm25ray", "model", "new", "new.json"].map(&at);
    let plane = ["evaluate", &model, "plane", "--center", "0,0,1", "-o", &json];
    let camera = ["evaluate", &model, "camera", "--eye", "-1,-2,9", "-o", &json];
    let intensity = ["evaluate", &model, "intensity", "-o", &json];
    let build = ["build", &chip, "-o", &new];
    for (line, flag, value) in [
        (&plane[..], "--width", "-2"),
        (&[&plane[..], &["--width", "2"]].concat(), "--tolerance", "-1e-3"),
        (&[&plane[..], &["--width", "2"]].concat(), "--height", "-2"),
        (&[&plane[..], &["--width", "2"]].concat(), "--normal", "-0,0,0"),
        (&[&plane[..], &["--width", "2"]].concat(), "--rows", "0"),
        (&camera, "--field", "-20"),
        (&[&camera[..], &["--width", "2"]].concat(), "--samples", "99"),
        (&intensity, "--c-step", "-5"),
        (&intensity, "--gamma-step", "-5"),
        (&intensity, "--at", "-5,inf"),
        (&build, "--gamma-step", "-5"),
        (&build, "--max-edge", "-.5"),
        (&build, "--total", "-5W"),
    ] {
        let told = refused(&[line, &[flag, value]].concat());
        says(&told, &[&format!("\n  where  {flag}\n")]);
        let verbs: Vec<&str> =
            line.iter().copied().filter(|word| ["evaluate", "plane", "camera", "intensity"].contains(word)).collect();
        let verbs = if verbs.is_empty() { vec![line[0]] } else { verbs };
        let help = String::from_utf8(lampwright(&[&verbs[..], &["--help"]].concat()).stdout).unwrap();
        says(&help, &[flag]);
    }
}

#[test]
fn a_number_below_0_is_taken_where_it_can_be_meant() {
    let folder = tempfile::tempdir().unwrap();
    let at = model(folder.path());
    let [model, new, json] = ["model", "new", "new.json"].map(&at);
    for line in [
        &["evaluate", &model, "intensity", "--at", "-5,10", "-o", &json][..],
        &["evaluate", &model, "intensity", "--direction", "-1,0,1", "--force", "-o", &json],
        &[
            "evaluate",
            &model,
            "plane",
            "--center",
            "-1,-2,3",
            "--up",
            "-1,0,0",
            "--width",
            "1",
            "--columns",
            "2",
            "--force",
            "-o",
            &json,
        ],
        &["combine", &format!("{model},move=-1:-2:-3,turn=+X:-90"), "-o", &new],
    ] {
        let done = lampwright(line);
        assert!(done.status.success(), "{line:?}: {}", String::from_utf8_lossy(&done.stderr));
    }
}

#[test]
fn a_plane_in_the_light_is_told_and_drawings_name_the_axes() {
    let folder = tempfile::tempdir().unwrap();
    let at = model(folder.path());
    let [model, json, svg] = ["model", "e.json", "e.svg"].map(&at);
    let plane = |center: &str, normal: &str, file: &str| {
        let line =
            ["evaluate", &model, "plane", "--center", center, "--normal", normal, "--width", "2", "--columns", "4"];
        let done = lampwright(&[&line[..], &["--force", "-o", file]].concat());
        assert!(done.status.success(), "{done:?}");
        String::from_utf8(done.stdout).unwrap()
    };
    let notices = || {
        let document: serde_json::Value = serde_json::from_slice(&fs::read(&json).unwrap()).unwrap();
        document["notices"].as_array().unwrap().iter().map(|notice| notice["code"].clone()).collect::<Vec<_>>()
    };
    says(&plane("0.1,0,0", "1,0,0", &json), &["evaluation.in_light"]);
    assert_eq!(notices(), ["evaluation.in_light"]);
    assert!(!plane("0,0,1", "0,0,-1", &json).contains("evaluation.in_light"));
    assert!(notices().is_empty());
    plane("0,0,1", "0,0,-1", &svg);
    // Looked at along +Z with +Y up, +X lies on the left.
    says(&fs::read_to_string(&svg).unwrap(), &["right (\u{2212}X), mm", "up (+Y), mm"]);
}
