//! What an operator may choose. Plain values: the command line reads arguments and environment into it.

use crate::accounts::quota::Quota;
use crate::connections::Bounds;
use crate::forwarded::Proxies;
use crate::jobs::shares::Shares;
use crate::ray_sets::pace::Slowest;
use crate::storage::database_url;
use crate::{machine, outbound, webhooks};
use std::net::{Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};
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
    /// The slowest upload that is not given up.
    pub slowest: Slowest,
    /// How long an upload that can be resumed is kept when nothing more comes, and what became of it when all came.
    pub upload_expiry: Duration,
    /// Ask for keys on loopback too; elsewhere they always are.
    pub auth: bool,
    /// Web pages of these origins may use the service: `https://portal.example`.
    pub cors_origins: Vec<String>,
    /// What a tenant may use that has no quota of its own.
    pub quota: Quota,
    /// Requests a second that a key may make on and on.
    pub rate_per_second: u32,
    /// Requests that a key may make at once after a rest.
    pub rate_burst: u32,
    /// What connections may ask of this process.
    pub bounds: Bounds,
    /// Who stands between the service and its clients.
    pub proxies: Proxies,
    /// What may be reached although it is not the internet's: by webhooks, and to fetch files.
    pub outbound_exceptions: Vec<outbound::Exception>,
    /// Fetch files from addresses; `None`: where keys are asked for.
    pub ingest: Option<bool>,
    /// Buckets that files may be fetched from: `s3://bucket/prefix`.
    pub ingest_buckets: Vec<String>,
    /// How webhooks are told.
    pub webhooks: webhooks::Policy,
    /// Bytes kept free on local disks: with less, nothing new is taken and `/readyz` is 503.
    pub keep_free: u64,
    /// What is kept, and for how long.
    pub retention: Retention,
    /// Jobs computed at once.
    pub concurrency: usize,
    /// Threads each of them computes on.
    pub threads: usize,
    /// What all jobs computed at once may need together, bytes.
    pub memory_bytes: u64,
    /// Longest that an attempt at a job may take.
    pub job_timeout: Duration,
    /// How often a job may be begun before it counts as what kills its worker.
    pub max_attempts: u32,
    /// How long a worker may be silent before its job is given to another.
    pub lease: Duration,
    /// How often an idle worker looks for jobs it was not told of.
    pub poll: Duration,
    /// For how long nothing was written where a blob is that no row names, before the blob is deleted.
    pub garbage_age: Duration,
    /// How long a service takes to stop at most: for running jobs, open connections and everything else together.
    pub grace: Duration,
    /// What a ray file may ask of this machine.
    pub limits: pipeline::Limits,
}

/// What is kept, and for how long.
#[derive(Clone, Copy, Debug)]
pub struct Retention {
    /// Ended jobs and their artifacts, from their end; `None`: until somebody deletes them.
    pub jobs: Option<Duration>,
    /// Ray sets, from their last use; `None`: until somebody deletes them.
    pub ray_sets: Option<Duration>,
    /// How often to look.
    pub every: Duration,
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
            // A kilobyte a second: a poor radio link is faster.
            slowest: Slowest { interval: Duration::from_secs(60), bytes: 60 << 10 },
            upload_expiry: Duration::from_hours(7 * 24),
            auth: false,
            cors_origins: Vec::new(),
            quota: Quota::default(),
            rate_per_second: 50,
            rate_burst: 200,
            bounds: Bounds::default(),
            proxies: Proxies::default(),
            outbound_exceptions: Vec::new(),
            ingest: None,
            ingest_buckets: Vec::new(),
            webhooks: webhooks::Policy::default(),
            keep_free: 512 << 20,
            retention: Retention { jobs: None, ray_sets: None, every: Duration::from_mins(10) },
            concurrency: 2,
            threads: available_parallelism().map_or(1, usize::from),
            memory_bytes: machine::memory_bytes().map_or(u64::MAX, |bytes| bytes / 4 * 3),
            // Far above the longest honest job: 2 billion rays are read in an hour.
            job_timeout: Duration::from_hours(6),
            max_attempts: 3,
            lease: Duration::from_secs(30),
            poll: Duration::from_secs(1),
            garbage_age: Duration::from_secs(24 * 3600),
            grace: Duration::from_secs(8),
            limits: pipeline::Limits::default(),
        }
    }

    /// How often a worker renews its lease, tells of its progress and hears of a cancellation.
    pub fn renew_every(&self) -> Duration {
        (self.lease / 3).min(Duration::from_secs(1))
    }

    /// Clients that may wait for their jobs at once: each holds a connection, and a quarter of these is for everybody else. A tenant
    /// has a share of them; where no keys are asked for there is one tenant only.
    pub fn waiting(&self) -> Shares {
        Shares::new((self.bounds.connections * 3 / 4).max(1), self.asks_for_keys())
    }

    /// How webhooks are told, with links below the path of the public URL.
    pub fn webhook_policy(&self) -> webhooks::Policy {
        webhooks::Policy { prefix: self.proxies.public.clone().unwrap_or_default(), ..self.webhooks.clone() }
    }

    /// Whether keys are asked for: always, but where only this machine can reach the service.
    pub fn asks_for_keys(&self) -> bool {
        self.auth || !self.listen.ip().to_canonical().is_loopback()
    }

    /// Whether files are fetched from addresses: without keys, only if somebody says so.
    pub fn ingests(&self) -> bool {
        self.ingest.unwrap_or(self.asks_for_keys())
    }

    /// The local folders that are written to.
    pub fn local_folders(&self) -> Vec<PathBuf> {
        let records = database_url::path(&self.database_url()).map(|file| match file.parent() {
            Some(folder) if folder != Path::new("") => folder.to_owned(),
            _ => PathBuf::from("."),
        });
        let blobs = self.storage_url().strip_prefix("file:").map(PathBuf::from);
        records.into_iter().chain(blobs).collect()
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
        let url = self.database_url.clone().unwrap_or_else(|| database_url::url(&self.data.join("service.db")));
        // A file that is not there is a first start.
        let bare = url.starts_with("sqlite:") && !url.contains('?');
        if bare { format!("{url}?mode=rwc") } else { url }
    }

    /// The object store to open.
    pub fn storage_url(&self) -> String {
        self.storage_url.clone().unwrap_or_else(|| format!("file:{}", self.data.join("blobs").display()))
    }
}
