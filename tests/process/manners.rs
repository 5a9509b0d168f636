//! What a person meets who uses a verb for the first time: nothing is overwritten or left behind, and messages speak of what was typed.

use crate::server::{lampwright, model, refused, says};
use std::fs;

#[test]
fn a_known_source_replaces_a_file_only_where_it_may() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mine.tm25ray");
    fs::write(&path, "precious").unwrap();
    let file = path.to_str().unwrap();
    let told = refused(&["sample", "flat-chip", "--rays", "9", "-o", file]);
    says(&told, &["error output.exists", "Name another output file, or give --force.", "mine.tm25ray"]);
    assert_eq!(fs::read(&path).unwrap(), b"precious");
    // The words of the verbs that had this rule before.
    let other = refused(&["convert", file, "-o", file]);
    assert_eq!(other, told);
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
                &["error detect.model", "This is a model", &taken, "lampwright rays", "evaluate, combine and adapter"],
            );
        }
    }
    says(&refused(&["inspect", &photos]), &["error file.folder", "This is a folder", &photos]);
}

/// Whatever of the results is given for a ray file, and whatever is given for a model, is told by its name, with what to do.
#[test]
fn results_in_the_place_of_rays_and_rays_in_the_place_of_a_model_are_told_by_what_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    assert!(lampwright(&["sample", "four-chips", "-n", "20000", "-o", &at("chips.tm25ray")]).status.success());
    assert!(lampwright(&["build", &at("chips.tm25ray"), "-o", &at("model")]).status.success());
    assert!(lampwright(&["evaluate", &at("model"), "intensity", "-o", &at("e.json")]).status.success());
    let verbs = ["lampwright rays", "evaluate, combine and adapter"];
    for (file, what) in [
        ("model", "a model"),
        // Its table of spectra has as many columns as rays have.
        ("model/model.zip", "a model"),
        ("model/emitter.glb", "the emitter.glb of a model"),
        ("model/goniograms.json", "the goniograms.json of a model"),
        ("model/report.json", "the report.json of a model"),
        ("model/spectra.csv", "the spectra.csv of a model"),
        ("e.json", "an evaluation of a model"),
    ] {
        let told = refused(&["inspect", &at(file)]);
        says(&told, &["error detect.model\n", &format!("This is {what}, not a ray file."), verbs[0], verbs[1]]);
        assert!(told.lines().count() == 4, "{file}: {told}");
    }
    for (file, what) in [
        ("ies/total.ies", "an IES photometric file"),
        ("ies/total.ldt", "an EULUMDAT photometric file"),
        ("total.tm33.xml", "an IES TM-33 photometric file"),
        ("source.gldf", "a GLDF file"),
    ] {
        let (file, code) =
            (at(&format!("model/{file}")), if what.contains("GLDF") { "detect.gldf" } else { "detect.photometry" });
        says(&refused(&["inspect", &file]), &[code, what]);
        says(
            &refused(&["evaluate", &file, "intensity", "-o", &at("x.json")]),
            &["model.not_model", what, ", no model."],
        );
    }
    for (file, parts) in [
        ("chips.tm25ray", ["This is a ray file (IES TM-25), no model.", "lampwright build makes one"]),
        (
            "model/emitter.glb",
            ["This is the emitter.glb of a model, not a whole one.", "Name the folder that it is in"],
        ),
        ("model/goniograms.json", ["This is the goniograms.json of a model, not a whole one.", "or the model.zip"]),
        ("model/README.txt", ["This is text, no model.", "Name a model's folder or its model.zip"]),
    ] {
        let (file, new) = (at(file), at("new"));
        for line in [
            &["rays", &file, "-n", "9", "-o", &at("new.dat")][..],
            &["evaluate", &file, "intensity", "-o", &at("new.json")],
            &["combine", &file, "-o", &new],
            &["adapter", "blender", &file, "-o", &new],
        ] {
            says(&refused(line), &["error model.not_model\n", parts[0], parts[1], &file]);
        }
    }
}

/// What clap says of a line has a code as everything has, and help is no error.
#[test]
fn a_wrong_line_has_a_code() {
    let help = "For more information, try '--help'.";
    for (line, told) in [
        (&["convert"][..], "--output <FILE>"),
        (&["sample", "dome", "--seeds", "3"], "'--seed'"),
        (&["evaluate", "m", "plane", "--center", "0,0,1", "--width", "2", "--columns", "many", "-o", "x.svg"], "1e2"),
        (&["evaluate", "m", "plane", "--center", "0,0,1", "--width", "--up", "+Z", "-o", "x.svg"], "'--width <MM>'"),
    ] {
        says(&refused(line), &["error command.line\n  what   ", "\n  do     ", told, help]);
    }
    for line in [&["keys"][..], &["evaluate"], &["tenants"]] {
        let told = refused(line);
        assert!(told.contains("\nUsage: lampwright") && !told.contains("command.line"), "{told}");
    }
    for line in [&["--help"][..], &["convert", "--help"], &["--version"]] {
        let done = lampwright(line);
        assert!(done.status.success() && !done.stdout.is_empty() && done.stderr.is_empty());
    }
    says(
        &String::from_utf8(lampwright(&["convert", "--help"]).stdout).unwrap(),
        &["lampwright convert lamp.tm25ray -o"],
    );
}

/// Of a few rays nothing can be proven, and of rays that were drawn from a model there are more for the asking.
#[test]
fn a_model_of_a_few_rays_says_that_nothing_was_proven() {
    let folder = tempfile::tempdir().unwrap();
    let at = model(folder.path());
    let few = at("few.tm25ray");
    assert!(lampwright(&["rays", &at("model"), "-n", "9", "-o", &few]).status.success());
    says(&String::from_utf8(lampwright(&["inspect", &few]).stdout).unwrap(), &["Draw more rays of the model"]);
    let built = lampwright(&["build", &few, "-o", &at("small")]);
    assert!(built.status.success(), "{built:?}");
    let told = "Nothing was proven";
    says(&String::from_utf8(built.stdout).unwrap(), &["artifacts.not_verified", told]);
    says(&fs::read_to_string(at("small/report.json")).unwrap(), &["artifacts.not_verified", told]);
    says(&fs::read_to_string(at("small/README.txt")).unwrap(), &[told]);
    assert!(lampwright(&["rays", &at("model"), "-n", "2e4", "-o", &at("more.tm25ray")]).status.success());
    assert!(lampwright(&["build", &at("more.tm25ray"), "-o", &at("larger")]).status.success());
    let whole = fs::read_to_string(at("larger/report.json")).unwrap();
    assert!(!whole.contains("artifacts.not_verified"), "{whole}");
}

/// A script asks for the verdict by the exit code: 3 where it is wrong, with the whole table.
#[test]
fn the_exit_code_of_an_inspection_is_its_verdict() {
    let folder = tempfile::tempdir().unwrap();
    let at = model(folder.path());
    fs::write(at("bare.txt"), "0 0 0 0 0 1 5\n0 1 0 0 0 1 5\n").unwrap();
    let bare = format!("{},columns=x:y:z:l:m:n:flux", at("bare.txt"));
    for (line, code, verdict) in [
        (bare.clone(), 3, "wrong"),
        (format!("{bare},length_unit=mm,quantity=W"), 0, "notice"),
        (at("chip.tm25ray"), 0, "notice"),
    ] {
        let done = lampwright(&["inspect", &line]);
        let told = String::from_utf8(done.stdout).unwrap();
        assert_eq!(done.status.code(), Some(code), "{line}: {told}");
        says(&told, &[&format!("verdict  {verdict}\n")]);
        assert_eq!(lampwright(&["inspect", "--json", &line]).status.code(), Some(code));
    }
    assert_eq!(lampwright(&["inspect", &at("model/README.txt")]).status.code(), Some(1));
    says(&String::from_utf8(lampwright(&["inspect", "--help"]).stdout).unwrap(), &["Exit code 3"]);
}

/// What the command line says is in its own words: its flags, and nothing of HTTP.
#[test]
fn messages_name_flags_and_no_fields_of_requests() {
    let folder = tempfile::tempdir().unwrap();
    let at = model(folder.path());
    let [chip, model, new, json] = ["chip.tm25ray", "model", "new", "new.json"].map(&at);
    let camera = ["evaluate", &model, "camera", "--eye", "0,0,9", "-o", &json, "--width"];
    for (line, parts, strange) in [
        (
            &["build", &chip, "--nadir", "+Z", "--c0", "-Z", "-o", &new][..],
            &["--c0 at right angles to --nadir"][..],
            "c0_axis at",
        ),
        (&["rays", &model, "-n", "2e12", "-o", &at("new.dat")], &["where  --rays\n"], "where  count"),
        (
            &[&camera[..], &["2", "--columns", "4096", "--rows", "4096", "--light", "color"]].concat(),
            &["evaluation.too_large"],
            "The command",
        ),
        (&[&camera[..], &["1e300"]].concat(), &["1e300 mm is no size"], "00000000"),
        (&[&camera[..], &["--rows", "2"]].concat(), &["a value is required for '--width <MM>'"], "invalid"),
        (&["sample"], &["lampwright sample --list shows all sources"], "required"),
    ] {
        let told = refused(line);
        says(&told, parts);
        assert!(!told.contains(strange), "{strange:?} is said: {told}");
    }
}

/// A picture without light says why: the light is beside it, or between its lines.
#[test]
fn a_camera_that_meets_no_light_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let at = model(folder.path());
    let [model, json] = ["model", "new.json"].map(&at);
    let told = |width: &str, target: &str| {
        let line = ["evaluate", &model, "camera", "--eye", "0,0,9", "--target", target, "--width", width];
        let done = lampwright(&[&line[..], &["--columns", "4", "--force", "-o", &json]].concat());
        assert!(done.status.success(), "{done:?}");
        String::from_utf8(done.stdout).unwrap()
    };
    says(&told("400", "0,0,0"), &["evaluation.dark x 16", "the light lies in the picture"]);
    says(&told("2", "5,0,0"), &["evaluation.dark x 16", "beside the picture"]);
    assert!(!told("2", "0,0,0").contains("evaluation.dark"));
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
        says(&told, &[&format!("{place} of model 1\n")]);
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
