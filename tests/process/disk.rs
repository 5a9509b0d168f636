//! The data folder as other users of the machine meet it, and what is no data folder.

use crate::server::{command, lampwright};
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::{Command, Output};
use std::time::{Duration, Instant};

/// Runs the binary as who creates files that everybody may read and write.
fn careless(arguments: &[&str]) -> Output {
    let mut shell = Command::new("sh");
    shell.args(["-c", "umask 0; exec \"$0\" \"$@\"", env!("CARGO_BIN_EXE_lampwright")]).args(arguments);
    shell.output().unwrap()
}

/// What in a folder, and whether the folder itself, is open to others.
fn open_to_others(folder: &Path) -> Vec<String> {
    let mut open = Vec::new();
    let mode = fs::metadata(folder).unwrap().permissions().mode() & 0o777;
    if mode & 0o077 != 0 {
        open.push(format!("{} {mode:o}", folder.display()));
    }
    if folder.is_dir() {
        let entries = fs::read_dir(folder).unwrap();
        open.extend(entries.flat_map(|entry| open_to_others(&entry.unwrap().path())));
    }
    open
}

#[test]
fn keys_and_backups_are_for_nobody_else_to_read() {
    let folder = tempfile::tempdir().unwrap();
    let (data, copy) = (folder.path().join("new/data"), folder.path().join("copy"));
    let (data_text, copy_text) = (data.to_str().unwrap(), copy.to_str().unwrap());
    let made = careless(&["keys", "create", "--data", data_text]);
    assert!(made.status.success(), "{made:?}");
    assert!(data.join("service.db").is_file());
    assert_eq!(open_to_others(&data), Vec::<String>::new());
    let copied = careless(&["backup", "--data", data_text, "--to", copy_text]);
    assert!(copied.status.success(), "{copied:?}");
    assert_eq!(open_to_others(&copy), Vec::<String>::new());
}

#[test]
fn a_folder_that_was_open_to_others_is_closed_and_that_is_said_once() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    assert!(lampwright(&["keys", "create", "--data", data.to_str().unwrap()]).status.success());
    // The address is taken: it ends by itself, once its stores are open.
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    let told = || {
        let done =
            command(&["--no-sample", "--log", "warn", "--listen", &address, "--data"]).arg(&data).output().unwrap();
        let told = String::from_utf8(done.stderr).unwrap();
        assert!(told.contains("error serve.listen"), "{told}");
        told.lines().filter(|line| line.contains("other users")).map(str::to_owned).collect::<Vec<_>>()
    };
    let none: Vec<String> = Vec::new();
    assert_eq!(told(), none, "nothing was open");
    let chmod = |path: &Path, mode| fs::set_permissions(path, fs::Permissions::from_mode(mode)).unwrap();
    chmod(&data, 0o755);
    chmod(&data.join("service.db"), 0o644);
    let once = told();
    // The database, and what SQLite keeps beside it while it is open.
    assert!(once.len() == 1 && once[0].contains("folders=1 files=3"), "{once:?}");
    assert!(once[0].contains("data/service.db,"), "{once:?}");
    assert_eq!(open_to_others(&data), none);
    assert_eq!(told(), none, "they are closed");
}

/// Refused in a second (and what a busy machine takes), with one line that names the file.
fn refused(arguments: &[&str], code: &str, names: &Path) {
    for verb in [["serve", "--listen", "127.0.0.1:0"].as_slice(), &["keys", "list"]] {
        let begun = Instant::now();
        let done = lampwright(&[verb, arguments].concat());
        let told = String::from_utf8(done.stderr).unwrap();
        assert!(begun.elapsed() < Duration::from_secs(5), "{verb:?} took {:?}: {told}", begun.elapsed());
        assert_eq!(done.status.code(), Some(1), "{verb:?}: {told}");
        let lines: Vec<&str> = told.lines().filter(|line| line.contains(names.to_str().unwrap())).collect();
        assert!(told.starts_with(&format!("error {code}\n")) && lines.len() == 1, "{verb:?}: {told}");
        assert!(lines[0].starts_with("  what   "), "{verb:?}: {told}");
    }
}

/// Makes a database with another program.
fn sqlite(file: &Path, script: &str) {
    let program = "import sqlite3, sys; d = sqlite3.connect(sys.argv[1]); d.executescript(sys.argv[2]); d.commit()";
    let done = Command::new("python3").args(["-c", program]).arg(file).arg(script).output().unwrap();
    assert!(done.status.success(), "{done:?}");
}

#[test]
fn what_is_no_database_of_ours_is_refused_at_once_and_named() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    let (text, file) = (data.to_str().unwrap(), data.join("service.db"));
    fs::create_dir_all(&data).unwrap();
    let noise: Vec<u8> = (0..8192_u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
    let named = [b"SQLite format 3\0".as_slice(), &noise[16..]].concat();
    for wrong in [b"This is a letter.".as_slice(), b"x", &noise, &named] {
        fs::write(&file, wrong).unwrap();
        refused(&["--data", text], "storage.not_a_database", &file);
        assert_eq!(fs::read(&file).unwrap(), wrong, "it was written to");
    }
    fs::remove_file(&file).unwrap();
    fs::create_dir(&file).unwrap();
    refused(&["--data", text], "storage.not_a_database", &file);
    fs::remove_dir(&file).unwrap();
    sqlite(&file, "CREATE TABLE letters (text TEXT); INSERT INTO letters VALUES ('a');");
    let before = fs::read(&file).unwrap();
    refused(&["--data", text], "storage.foreign_database", &file);
    assert_eq!(fs::read(&file).unwrap(), before, "it was written to");
    fs::remove_file(&file).unwrap();
    assert!(lampwright(&["keys", "create", "--data", text]).status.success());
    let newer = "INSERT INTO _sqlx_migrations (version, description, success, checksum, execution_time) \
                 VALUES (9999, 'later', 1, x'00', 0);";
    sqlite(&file, newer);
    refused(&["--data", text], "storage.newer_database", &file);
    let missing = folder.path().join("nowhere/rows.db");
    refused(
        &["--data", text, "--database-url", &format!("sqlite:{}?mode=rw", missing.display())],
        "storage.no_database",
        &missing,
    );
}
