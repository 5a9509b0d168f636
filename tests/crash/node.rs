//! The stores of one test, and processes that work on them until something kills them.

use crate::disk::Disk;
use service::storage::Storage;
use service::webhooks::endpoints::EndpointSettings;
use service::webhooks::{Event, endpoints};
use service::{Config, crash};
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::os::unix::process::ExitStatusExt;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use support::engines;
use support::engines::Engines;
use support::http::{Answer, ask};
use support::receiver::Receiver;
use tempfile::TempDir;
use tokio::runtime::Runtime;

/// Longest wait for anything of these tests, on a machine busy with others.
pub const PATIENCE: Duration = Duration::from_secs(240);
/// Seconds after which a silent worker's job is another's.
pub const LEASE_S: u64 = 2;

/// One test's stores: files in a folder, or a schema and a prefix on the servers that `tests/engines/with` started.
pub struct World {
    /// What the data folder is on, when it is not the folder's own disk. Unmounted before the folder goes.
    pub disk: Option<Disk>,
    pub folder: TempDir,
    engines: Option<Engines>,
    pub runtime: Runtime,
}

impl World {
    pub fn new() -> World {
        let runtime = Runtime::new().unwrap();
        let engines = runtime.block_on(engines::shared());
        World { disk: None, folder: tempfile::tempdir().unwrap(), engines, runtime }
    }

    /// The same on a disk of so many bytes, where rows and blobs are files and this user may mount one.
    pub fn with_disk(bytes: u64) -> World {
        let world = World::new();
        let disk = if engines::are_shared() { None } else { Disk::mount(&world.data(), bytes) };
        World { disk, ..world }
    }

    /// Cuts every connection to these stores' database.
    pub fn cut(&self) {
        let url = &self.engines.as_ref().unwrap().database_url;
        let name = url.rsplit('=').next().unwrap();
        let cut = format!(
            "SELECT pg_terminate_backend(pid) FROM pg_stat_activity \
             WHERE application_name = '{name}' AND pid <> pg_backend_pid()"
        );
        self.runtime.block_on(engines::execute(url, cut));
    }

    fn data(&self) -> PathBuf {
        self.folder.path().join("data")
    }

    /// Both stores, seen past the service.
    pub fn storage(&self) -> Storage {
        let config = Config::new(self.data());
        let (database, store) = match &self.engines {
            Some(engines) => (engines.database_url.clone(), engines.storage_url.clone()),
            None => (config.database_url(), config.storage_url()),
        };
        self.runtime.block_on(Storage::open(&database, &store)).unwrap()
    }

    /// Somebody who hears of every job of these stores.
    pub fn receiver(&self) -> Receiver {
        std::fs::create_dir_all(self.data()).unwrap();
        let (storage, receiver) = (self.storage(), self.runtime.block_on(Receiver::start()));
        let settings =
            EndpointSettings { url: receiver.url.clone(), events: Event::ALL.to_vec(), description: String::new() };
        self.runtime.block_on(endpoints::create(&storage.records, "default", settings)).unwrap();
        self.runtime.block_on(storage.records.close());
        receiver
    }

    /// A process that lives.
    pub fn node(&self, arguments: &[&str]) -> Node {
        let node = self.armed(arguments, None);
        assert!(node.lives(), "it died at its start: {}", node.log());
        node
    }

    /// A process that lives, on a disk of any size, and meets an error where it writes more than [`Node::limit`] allows: what ends
    /// a process by default is ignored.
    pub fn shielded(&self, arguments: &[&str]) -> Node {
        let mut shell = Command::new("sh");
        shell.args(["-c", "trap '' XFSZ; exec \"$0\" \"$@\"", env!("CARGO_BIN_EXE_lampwright")]);
        let keep_free: &[&str] = if self.disk.is_some() { &["--keep-free", "0"] } else { &[] };
        let node = self.spawn(&mut shell, &[keep_free, arguments].concat(), None);
        assert!(node.lives(), "it died at its start: {}", node.log());
        node
    }

    /// A process that dies at `point`, perhaps while it starts.
    pub fn armed(&self, arguments: &[&str], point: Option<&str>) -> Node {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lampwright"));
        self.spawn(&mut command, arguments, point)
    }

    /// `command` with the arguments of a node.
    pub fn spawn(&self, command: &mut Command, arguments: &[&str], point: Option<&str>) -> Node {
        for (name, _) in std::env::vars().filter(|(name, _)| name.starts_with("LAMPWRIGHT_")) {
            command.env_remove(name);
        }
        for name in ["DATABASE_URL", "STORAGE_URL", "ROLE"] {
            command.env_remove(name);
        }
        if let Some(engines) = &self.engines {
            command.env("DATABASE_URL", &engines.database_url).env("STORAGE_URL", &engines.storage_url);
        }
        if let Some(point) = point {
            assert!(crash::POINTS.contains(&point.split(':').next().unwrap()), "{point} is no point");
            command.env("LAMPWRIGHT_CRASH_AT", point);
        }
        let log = self.folder.path().join(format!("{}.log", uuid::Uuid::now_v7()));
        command.args(["--listen", "127.0.0.1:0", "--no-sample", "--jobs", "1", "--threads", "1", "--data"]);
        command.arg(self.data()).args(["--lease", &LEASE_S.to_string()]).args(arguments);
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(File::create(&log).unwrap());
        let mut child = command.spawn().unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
        let first = lines.next().and_then(Result::ok).unwrap_or_default();
        let address = first.rsplit_once("http://").map(|(_, address)| address.to_owned());
        // Read on, so that the process never waits for us.
        std::thread::spawn(move || lines.for_each(drop));
        Node { child, address: address.unwrap_or_default(), log }
    }
}

/// A process; killed when dropped.
pub struct Node {
    child: Child,
    /// Empty when it died before it said where it is.
    pub address: String,
    log: PathBuf,
}

impl Node {
    pub fn lives(&self) -> bool {
        !self.address.is_empty()
    }

    pub fn log(&self) -> String {
        std::fs::read_to_string(&self.log).unwrap()
    }

    pub fn get(&self, path: &str) -> Option<Answer> {
        get(&self.address, path)
    }

    /// SIGKILL: nothing of it runs its last lines.
    pub fn kill(mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }

    /// SIGSTOP, SIGCONT: std has neither; kill(1) is on every system that has signals.
    pub fn signal(&self, name: &str) {
        assert!(Command::new("kill").args(["-s", name, &self.child.id().to_string()]).status().unwrap().success());
    }

    /// What prlimit(1) sets of the running process.
    pub fn limit(&self, limit: &str) {
        let id = self.child.id().to_string();
        assert!(Command::new("prlimit").args(["--pid", &id, limit]).status().unwrap().success(), "{limit}");
    }

    /// The signal that it died of, once it has.
    pub fn died(&mut self) -> Option<i32> {
        self.child.try_wait().unwrap().map(|status| status.signal().unwrap_or(0))
    }

    /// Waits for its death; the signal.
    pub fn death(&mut self) -> i32 {
        until("a death", || self.died())
    }
}

impl Drop for Node {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
        if std::thread::panicking() {
            eprintln!("--- a node's log\n{}", self.log());
        }
    }
}

/// `None` when no whole answer came.
pub fn get(address: &str, path: &str) -> Option<Answer> {
    ask(address, "GET", path, &[], b"").ok()
}

/// Asks until there is something.
#[track_caller]
pub fn until<T>(what: &str, mut ask: impl FnMut() -> Option<T>) -> T {
    let start = Instant::now();
    loop {
        if let Some(found) = ask() {
            return found;
        }
        assert!(start.elapsed() < PATIENCE, "still waiting for {what}");
        std::thread::sleep(Duration::from_millis(20));
    }
}
