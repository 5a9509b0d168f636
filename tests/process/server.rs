//! A server process on a free loopback port, and the other verbs of the binary.

use serde_json::Value;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Output, Stdio};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use support::http::{Answer, ask};

/// Longest wait for a job of these tests, on a machine busy with others.
const PATIENCE: Duration = Duration::from_secs(240);

/// A running server; killed when dropped.
pub struct Server {
    child: Child,
    pub address: String,
}

/// The binary with `arguments`, nothing from the environment.
pub fn command(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lampwright"));
    command.args(arguments).stdin(Stdio::null());
    for (name, _) in std::env::vars().filter(|(name, _)| name.starts_with("LAMPWRIGHT_")) {
        command.env_remove(name);
    }
    command
}

/// Runs the binary to its end.
pub fn lampwright(arguments: &[&str]) -> Output {
    command(arguments).output().unwrap()
}

/// A flat chip of 3000 rays and its model, in a folder of their own.
pub fn model(folder: &Path) -> impl Fn(&str) -> String + '_ {
    let at = move |name: &str| folder.join(name).to_str().unwrap().to_owned();
    assert!(lampwright(&["sample", "flat-chip", "--rays", "3000", "-o", &at("chip.tm25ray")]).status.success());
    assert!(lampwright(&["build", &at("chip.tm25ray"), "-o", &at("model")]).status.success());
    at
}

/// What was told on stderr of a refusal.
pub fn refused(arguments: &[&str]) -> String {
    let Output { status, stderr, .. } = lampwright(arguments);
    let told = String::from_utf8(stderr).unwrap();
    assert!(matches!(status.code(), Some(1 | 2)), "{arguments:?}: {status}: {told}");
    told
}

/// Each says all of these.
#[track_caller]
pub fn says(told: &str, parts: &[&str]) {
    for part in parts {
        assert!(told.contains(part), "{part:?} is not said: {told}");
    }
}

/// How many files there are under a folder.
pub fn files_under(folder: &Path) -> usize {
    let entries = std::fs::read_dir(folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    let entries = entries.map(|entry| entry.unwrap());
    entries.map(|entry| if entry.file_type().unwrap().is_dir() { files_under(&entry.path()) } else { 1 }).sum()
}

impl Server {
    /// Starts one on `data`; returns once it has said where it is.
    pub fn start(data: &Path, arguments: &[&str]) -> Server {
        let mut command = command(&["--listen", "127.0.0.1:0", "--log", "warn", "--data"]);
        command.arg(data).args(arguments);
        Server::of(command.stdout(Stdio::piped()).spawn().unwrap())
    }

    /// Starts `command`; what it logs until it ends.
    pub fn with_log(command: &mut Command) -> (Server, JoinHandle<String>) {
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let mut log = child.stderr.take().unwrap();
        let reading = std::thread::spawn(move || {
            let mut text = String::new();
            log.read_to_string(&mut text).map(|_| text).unwrap()
        });
        (Server::of(child), reading)
    }

    fn of(mut child: Child) -> Server {
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
        let first = lines.next().expect("a first line").unwrap();
        let address = first.rsplit_once("http://").unwrap_or_else(|| panic!("no address: {first}")).1.to_owned();
        // Read on, so that the server never waits for us.
        std::thread::spawn(move || lines.for_each(drop));
        let server = Server { child, address };
        let start = Instant::now();
        while ask(&server.address, "GET", "/readyz", &[], b"").map_or(0, |answer| answer.status) != 200 {
            assert!(start.elapsed() < PATIENCE, "the server is not ready");
            std::thread::sleep(Duration::from_millis(20));
        }
        server
    }

    pub fn get(&self, path: &str) -> Answer {
        ask(&self.address, "GET", path, &[], b"").unwrap()
    }

    pub fn post(&self, path: &str, content_type: &str, body: &[u8]) -> Answer {
        ask(&self.address, "POST", path, &[("Content-Type", content_type)], body).unwrap()
    }

    /// Sends a ray file and queues a job for it; the job's id.
    pub fn job_of(&self, name: &str, bytes: &[u8]) -> String {
        let ray_set = self.post(&format!("/v1/ray-sets?name={name}"), "application/octet-stream", bytes);
        assert_eq!(ray_set.status, 201, "{ray_set:?}");
        let body = serde_json::json!({ "channels": [{"ray_set": ray_set.json()["ray_sets"][0]["id"]}] }).to_string();
        let job = self.post("/v1/jobs", "application/json", body.as_bytes());
        assert_eq!(job.status, 202, "{job:?}");
        job.json()["id"].as_str().unwrap().to_owned()
    }

    /// Polls a job until `done`; a job that ended otherwise fails the test at once.
    pub fn until(&self, job: &str, done: impl Fn(&Value) -> bool) -> Value {
        let start = Instant::now();
        loop {
            let found = self.get(&format!("/v1/jobs/{job}")).json();
            if done(&found) {
                return found;
            }
            assert!(!matches!(found["state"].as_str(), Some("failed" | "cancelled" | "succeeded") | None), "{found}");
            assert!(start.elapsed() < PATIENCE, "still {found}");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// SIGKILL: nothing of it runs its last lines.
    pub fn kill(mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }

    /// SIGTERM, and how it ended.
    pub fn terminate(self) -> ExitStatus {
        self.tell_to_stop();
        self.ended()
    }

    /// SIGTERM.
    pub fn tell_to_stop(&self) {
        // std has no SIGTERM; kill(1) is on every system that has signals.
        let told = Command::new("kill").arg(self.child.id().to_string()).status().unwrap();
        assert!(told.success());
    }

    /// How it ended, once it has.
    pub fn ended(mut self) -> ExitStatus {
        self.child.wait().unwrap()
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
