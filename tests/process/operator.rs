//! The command line as an operator writes it: sizes, times, variables, names that would act on a terminal, folders of others.

use crate::server::{Server, command, lampwright};
use std::collections::BTreeSet;
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::os::unix::process::CommandExt;
use std::process::{Output, Stdio};

/// Flags of `serve` for which 0 means nothing, and is taken.
const NONE_AT_ZERO: [&str; 3] = ["--grace", "--keep-free", "--slowest-upload"];

fn told(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Flags of `serve` whose value is a number, a size or a time, from its help.
fn measured_flags() -> BTreeSet<String> {
    let help = String::from_utf8(lampwright(&["serve", "--help"]).stdout).unwrap();
    let flag = |line: &str| {
        let (flag, value) = line.trim().strip_prefix("--")?.split_once(' ')?;
        ["<N>", "<SIZE>", "<TIME>"].iter().any(|kind| value.starts_with(kind)).then(|| format!("--{flag}"))
    };
    help.lines().filter_map(flag).collect()
}

#[test]
fn zero_is_none_or_refused_and_nonsense_is_refused() {
    let flags = measured_flags();
    assert!(flags.len() > 15 && NONE_AT_ZERO.iter().all(|flag| flags.contains(*flag)), "{flags:?}");
    for flag in &flags {
        let folder = tempfile::tempdir().unwrap();
        let data = folder.path().join("data");
        let values: &[&str] = if NONE_AT_ZERO.contains(&flag.as_str()) { &["x", "-1"] } else { &["0", "x", "-1"] };
        for value in values {
            let argument = format!("{flag}={value}");
            let refused =
                lampwright(&["serve", "--listen", "127.0.0.1:0", "--data", data.to_str().unwrap(), &argument]);
            let told = told(&refused);
            assert_eq!(refused.status.code(), Some(2), "{argument}: {told}");
            assert!(told.contains(flag.as_str()) && told.contains(value), "{argument}: {told}");
        }
        assert!(!data.exists(), "{flag}: refused before anything is touched");
    }
    for threads in ["0", "-1", "many"] {
        let refused = lampwright(&["build", "lamp.ray", "-o", "out", "--threads", threads]);
        assert_eq!(refused.status.code(), Some(2), "{refused:?}");
    }
    let folder = tempfile::tempdir().unwrap();
    let zeros: Vec<&str> = NONE_AT_ZERO.iter().flat_map(|flag| [*flag, "0"]).collect();
    let server = Server::start(folder.path(), &[&zeros[..], &["--no-sample"]].concat());
    assert_eq!(server.get("/healthz").status, 200);
}

#[test]
fn sizes_and_times_are_taken_as_people_write_them_and_as_they_were() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = [
        ["--memory", "4G"],
        ["--max-upload", "100KiB"],
        ["--job-timeout", "2h"],
        ["--lease", "30s"],
        ["--garbage-age", "24h"],
        ["--grace", "2"],
        ["--slowest-upload", "60KiB"],
        ["--upload-expiry", "36h"],
        ["--quota-bytes", "10GiB"],
        ["--keep-free", "1048576"],
        ["--keep-jobs", "30d"],
        ["--keep-ray-sets", "30"],
    ];
    let server = Server::start(folder.path(), &[&arguments.concat()[..], &["--no-sample"]].concat());
    let text = |bytes: usize| server.post("/v1/ray-sets", "application/octet-stream", &vec![b' '; bytes]);
    // 100 KiB are 102 400 bytes.
    let small = text(102_400).json()["code"].as_str().unwrap().to_owned();
    assert!(text(102_401).status == 413 && !small.contains("large"), "{small}");
    let sent = server.post("/v1/ray-sets", "application/octet-stream", &support::rays::zemax(10));
    let ray_set = sent.json()["ray_sets"][0]["id"].clone();
    let asked = |seconds: u32| {
        let body = serde_json::json!({ "channels": [{"ray_set": ray_set}], "timeout_s": seconds }).to_string();
        server.post("/v1/jobs", "application/json", body.as_bytes())
    };
    let (longest, longer) = (asked(7200), asked(7201));
    assert_eq!((longest.status, longer.status, &longer.json()["at"]), (202, 422, &"timeout_s".into()));
}

#[test]
fn an_empty_variable_is_as_if_absent_and_a_misspelt_one_is_told() {
    let help = String::from_utf8(lampwright(&["serve", "--help"]).stdout).unwrap();
    let names: Vec<&str> =
        help.split("[env: ").skip(1).filter_map(|rest| rest.split(['=', ']']).next()).map(str::trim).collect();
    assert!(names.len() > 25 && names.contains(&"ROLE") && names.contains(&"LAMPWRIGHT_MEMORY"), "{names:?}");
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    let mut serve = command(&["--listen", "127.0.0.1:0", "--no-sample", "--data"]);
    serve.arg(&data).envs(names.iter().map(|name| (*name, ""))).stderr(Stdio::piped());
    serve.env("LAMPWRIGHT_MEMROY", "4G");
    let (server, log) = Server::with_log(&mut serve);
    assert_eq!(server.get("/readyz").status, 200);
    assert!(data.join("service.db").exists(), "an empty DATABASE_URL is none");
    assert!(server.terminate().success());
    let log = log.join().unwrap();
    let unknown: Vec<&str> = log.lines().filter(|line| line.contains("is not known")).collect();
    assert!(unknown.len() == 1 && unknown[0].contains("LAMPWRIGHT_MEMROY"), "{unknown:?}");
    assert!(unknown[0].contains("LAMPWRIGHT_MEMORY"), "{unknown:?}");
    let told = told(&command(&["openapi"]).env("LAMPWRIGHT_DTA", "x").output().unwrap());
    assert!(told.contains("LAMPWRIGHT_DTA") && told.contains("LAMPWRIGHT_DATA"), "{told}");
    // A switch is set as people set switches.
    let mut serve = command(&["--listen", "127.0.0.1:0", "--data", data.to_str().unwrap()]);
    let (server, _) = Server::with_log(serve.env("LAMPWRIGHT_NO_SAMPLE", "1"));
    assert_eq!(server.get("/v1/jobs").json()["jobs"], serde_json::json!([]));
    assert_eq!(serve.env("LAMPWRIGHT_NO_SAMPLE", "perhaps").output().unwrap().status.code(), Some(2));
}

#[test]
fn a_name_cannot_act_on_the_terminal_that_it_is_printed_on() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let evil = "lamp\u{1b}[2J\u{202e}\u{2066}\u{200b}\n\u{9b}31m.tm25ray";
    let shown = r"lamp\u{1b}[2J\u{202e}\u{2066}\u{200b}\u{a}\u{9b}31m.tm25ray";
    let plain = |output: &Output| {
        let text = format!("{}{}", String::from_utf8_lossy(&output.stdout), told(output));
        let acts = |c: &char| (c.is_control() && *c != '\n') || "\u{202e}\u{2066}\u{200b}".contains(*c);
        assert_eq!(text.chars().find(acts), None, "{text:?}");
        assert!(text.contains(shown), "{text}");
    };
    plain(&lampwright(&["sample", "flat-chip", "--rays", "2000", "-o", &path(evil)]));
    plain(&lampwright(&["inspect", &path(evil)]));
    plain(&lampwright(&["build", &path(evil), "-o", &path("out")]));
    plain(&lampwright(&["convert", &path(evil), "-o", &path("lamp.dat")]));
    // What is refused is told with its name, in a packed file too.
    std::fs::write(path(&format!("letter-{evil}")), "This is a letter.").unwrap();
    plain(&lampwright(&["inspect", &path(&format!("letter-{evil}"))]));
    std::fs::write(path("packed.zip"), support::packing::zip(&[(evil, b"This is a letter.")])).unwrap();
    let packed = lampwright(&["inspect", &path("packed.zip")]);
    assert!(!told(&packed).contains(['\u{1b}', '\u{202e}', '\u{9b}']), "{packed:?}");
    // JSON is for programs: the name as it is, by JSON's own rules.
    let json = lampwright(&["inspect", "--json", &path(evil)]);
    assert!(serde_json::from_slice::<serde_json::Value>(&json.stdout).is_ok(), "{json:?}");
    let data = path("data");
    assert!(lampwright(&["keys", "create", "--name", evil, "--data", &data]).status.success());
    plain(&lampwright(&["keys", "list", "--data", &data]));
}

#[test]
fn a_folder_of_another_user_is_told_with_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let is_root = std::fs::metadata("/proc/self").unwrap().uid() == 0;
    // As a container's user on a folder of the host: that user must be able to run the binary, wherever the build is.
    std::fs::set_permissions(folder.path(), PermissionsExt::from_mode(0o755)).unwrap();
    let binary = folder.path().join("lampwright");
    // Copied by a process of its own: a file that this one writes to cannot be run while another thread starts a process.
    let copied = std::process::Command::new("cp").arg(env!("CARGO_BIN_EXE_lampwright")).arg(&binary).status().unwrap();
    assert!(copied.success());
    let data = folder.path().join("data");
    std::fs::create_dir(&data).unwrap();
    std::fs::set_permissions(&data, PermissionsExt::from_mode(if is_root { 0o755 } else { 0o555 })).unwrap();
    for verb in [["keys", "create"].as_slice(), &["serve", "--listen", "127.0.0.1:0"]] {
        let mut command = std::process::Command::new(&binary);
        command.args(verb).arg("--data").arg(&data).stdin(Stdio::null()).current_dir("/");
        if is_root {
            command.uid(65532).gid(65532);
        }
        let refused = command.output().unwrap();
        let told = told(&refused);
        assert_eq!(refused.status.code(), Some(1), "{told}");
        assert!(told.contains(data.to_str().unwrap()) && told.contains("chown") && told.contains("--user"), "{told}");
        assert!(!is_root || (told.contains("user 65532") && told.contains("belongs to user 0")), "{told}");
    }
}
