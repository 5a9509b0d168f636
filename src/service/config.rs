//! What an operator may choose. Plain values: the command line reads arguments and environment into it.

use crate::pipeline;
use std::net::{Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::thread::available_parallelism;
use std::time::Duration;

/// What a process does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Role {
    /// Answers clients; computes nothing.
    Api,
    /// Computes; answers only whether it is well.
    Worker,
    /// Both.
    #[default]
    All,
}

impl Role {
    /// Answers clients.
    pub fn answers(self) -> bool {
        self != Role::Worker
    }

    /// Computes.
    pub fn computes(self) -> bool {
        self != Role::Api
    }
}

/// Everything a service is started with; [`Config::new`] has the defaults.
#[derive(Clone, Debug)]
pub struct Config {
    /// The folder that holds everything which is not elsewhere by its URL; one process at a time.
    pub data: PathBuf,
    /// What this process does.
    pub role: Role,
    /// Where to listen; port 0 takes any.
    pub listen: SocketAddr,
    /// The database, `sqlite:` or `postgres:`. Default: `sqlite:<data>/service.db`.
    pub database_url: Option<String>,
    /// The object store, `file:` or `s3://`. Default: `file:<data>/blobs`.
    pub storage_url: Option<String>,
    /// Largest file taken, and largest ray file in a packed one, bytes.
    pub max_upload_bytes: u64,
    /// Longest silence in an upload before it is given up.
    pub upload_idle: Duration,
    /// Jobs computed at once.
    pub concurrency: usize,
    /// Threads each of them computes on.
    pub threads: usize,
    /// How often a job may be begun before it counts as what kills its worker.
    pub max_attempts: u32,
    /// How long a worker may be silent before its job is given to another.
    pub lease: Duration,
    /// How often an idle worker looks for jobs it was not told of.
    pub poll: Duration,
    /// For how long nothing was written where a blob is that no row names, before the blob is deleted.
    pub garbage_age: Duration,
    /// How long a stopping service waits for running jobs and open connections.
    pub grace: Duration,
    /// What a ray file may ask of this machine.
    pub limits: pipeline::Limits,
}

impl Config {
    /// The defaults, with everything kept in the folder `data`.
    pub fn new(data: impl Into<PathBuf>) -> Config {
        Config {
            data: data.into(),
            role: Role::All,
            listen: SocketAddr::from((Ipv4Addr::LOCALHOST, 8080)),
            database_url: None,
            storage_url: None,
            max_upload_bytes: 64 << 30,
            upload_idle: Duration::from_secs(60),
            concurrency: 2,
            threads: available_parallelism().map_or(1, usize::from),
            max_attempts: 3,
            lease: Duration::from_secs(30),
            poll: Duration::from_secs(1),
            garbage_age: Duration::from_secs(24 * 3600),
            grace: Duration::from_secs(10),
            limits: pipeline::Limits::default(),
        }
    }

    /// How often a worker renews its lease, tells of its progress and hears of a cancellation.
    pub fn beat(&self) -> Duration {
        (self.lease / 3).min(Duration::from_secs(1))
    }

    /// True when both stores are on this machine and belong to one process at a time. Then a lock on the data folder proves
    /// at the start that whoever wrote before is gone; on shared engines only leases and the age of a blob can tell.
    pub fn is_alone(&self) -> bool {
        self.database_url().starts_with("sqlite:") && self.storage_url().starts_with("file:")
    }

    /// How often garbage is looked for.
    pub fn garbage_period(&self) -> Duration {
        (self.garbage_age / 24).max(Duration::from_secs(1))
    }

    /// The database to open.
    pub fn database_url(&self) -> String {
        let file = self.data.join("service.db");
        self.database_url.clone().unwrap_or_else(|| format!("sqlite:{}?mode=rwc", file.display()))
    }

    /// The object store to open.
    pub fn storage_url(&self) -> String {
        self.storage_url.clone().unwrap_or_else(|| format!("file:{}", self.data.join("blobs").display()))
    }
}
