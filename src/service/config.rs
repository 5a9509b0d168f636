//! The settings of a service, as plain values: the command line reads them from arguments and environment variables.

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

/// Role of a process.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Role {
    /// The process answers requests of clients and computes no jobs.
    Api,
    /// The process computes jobs and answers only health checks and metrics.
    Worker,
    /// The process does both.
    #[default]
    All,
}

impl Role {
    /// Whether the process answers requests of clients.
    pub fn answers(self) -> bool {
        self != Role::Worker
    }

    /// Whether the process computes jobs.
    pub fn computes(self) -> bool {
        self != Role::Api
    }
}

/// All settings of a service; [`Config::new`] has the defaults.
#[derive(Clone, Debug)]
pub struct Config {
    /// The data folder, for the database and the blobs that have no URL of their own; one process at a time may use it.
    pub data: PathBuf,
    /// Role of this process.
    pub role: Role,
    /// Address to listen on; port 0 chooses a free port.
    pub listen: SocketAddr,
    /// The database, `sqlite:` or `postgres:`. Default: `sqlite:<data>/service.db`.
    pub database_url: Option<String>,
    /// The object store, `file:` or `s3://`. Default: `file:<data>/blobs`.
    pub storage_url: Option<String>,
    /// Largest file that is accepted, and largest ray file in an archive, bytes.
    pub max_upload_bytes: u64,
    /// The slowest upload that is not aborted.
    pub slowest: Slowest,
    /// Time after which an unfinished resumable upload expires when no more bytes arrive, and the result of a finished one.
    pub upload_expiry: Duration,
    /// Require API keys on loopback too; on other addresses they are always required.
    pub auth: bool,
    /// Web pages of these origins may use the service: `https://portal.example`.
    pub cors_origins: Vec<String>,
    /// Quota of a tenant that has none of its own.
    pub quota: Quota,
    /// Sustained rate of one API key, requests per second.
    pub rate_per_second: u32,
    /// Largest burst of requests of one API key after a pause.
    pub rate_burst: u32,
    /// Limits for connections.
    pub bounds: Bounds,
    /// The proxies between the service and its clients.
    pub proxies: Proxies,
    /// Hosts and networks that webhooks and fetches may reach although they are not on the public internet.
    pub outbound_exceptions: Vec<outbound::Exception>,
    /// Whether files are fetched from URLs; `None`: only where API keys are required.
    pub ingest: Option<bool>,
    /// Buckets that files may be fetched from, as `s3://bucket/prefix`.
    pub ingest_buckets: Vec<String>,
    /// Timing of webhook deliveries.
    pub webhooks: webhooks::Policy,
    /// Space to keep free on local disks, bytes: below it, new data is refused and `/readyz` is 503.
    pub keep_free: u64,
    /// How long ended jobs and unused ray sets are kept.
    pub retention: Retention,
    /// Number of jobs computed at the same time.
    pub concurrency: usize,
    /// Number of threads for each job.
    pub threads: usize,
    /// Memory budget for all running jobs together, bytes.
    pub memory_bytes: u64,
    /// Time limit of an attempt at a job.
    pub job_timeout: Duration,
    /// Number of attempts at a job whose worker is lost, before the job fails.
    pub max_attempts: u32,
    /// Time without a renewal of its lease after which a job is given to another worker.
    pub lease: Duration,
    /// How often an idle worker looks for jobs that other processes queued.
    pub poll: Duration,
    /// Time without any write in the folder of a blob that the database does not name, before the blob is deleted.
    pub garbage_age: Duration,
    /// Longest time that a service takes to stop: for running jobs, open connections and everything else together.
    pub grace: Duration,
    /// Limits for ray files on this machine.
    pub limits: pipeline::Limits,
}

/// How long ended jobs and unused ray sets are kept.
#[derive(Clone, Copy, Debug)]
pub struct Retention {
    /// Time after its end after which a job is deleted with its artifacts; `None`: never.
    pub jobs: Option<Duration>,
    /// Time after its last use after which a ray set is deleted; `None`: never.
    pub ray_sets: Option<Duration>,
    /// How often to look for jobs and ray sets to delete.
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

    /// How often a worker renews the lease of its job, stores its progress and learns of a cancellation.
    pub fn renew_every(&self) -> Duration {
        (self.lease / 3).min(Duration::from_secs(1))
    }

    /// Clients that may wait for their jobs at once: each holds a connection, and a quarter of these is for everybody else. A tenant
    /// has a share of them; where no keys are asked for there is one tenant only.
    pub fn waiting(&self) -> Shares {
        Shares::new((self.bounds.connections * 3 / 4).max(1), self.asks_for_keys())
    }

    /// The policy for webhook deliveries, with links below the path of the public URL.
    pub fn webhook_policy(&self) -> webhooks::Policy {
        webhooks::Policy { prefix: self.proxies.public.clone().unwrap_or_default(), ..self.webhooks.clone() }
    }

    /// Whether API keys are required: always, except where only this machine can reach the service.
    pub fn asks_for_keys(&self) -> bool {
        self.auth || !self.listen.ip().to_canonical().is_loopback()
    }

    /// Whether files are fetched from URLs: without API keys, only if the operator enables it.
    pub fn ingests(&self) -> bool {
        self.ingest.unwrap_or(self.asks_for_keys())
    }

    /// The local folders that the service writes to.
    pub fn local_folders(&self) -> Vec<PathBuf> {
        let records = database_url::path(&self.database_url()).map(|file| match file.parent() {
            Some(folder) if folder != Path::new("") => folder.to_owned(),
            _ => PathBuf::from("."),
        });
        let blobs = self.storage_url().strip_prefix("file:").map(PathBuf::from);
        records.into_iter().chain(blobs).collect()
    }

    /// True when both stores are on this machine and belong to one process at a time. Then a lock on the data folder proves at the
    /// start that the process before has ended; on shared engines only leases and the age of a blob show that.
    pub fn is_alone(&self) -> bool {
        self.database_url().starts_with("sqlite:") && self.storage_url().starts_with("file:")
    }

    /// How often the garbage collection runs.
    pub fn garbage_period(&self) -> Duration {
        (self.garbage_age / 24).max(Duration::from_secs(1))
    }

    /// URL of the database to open.
    pub fn database_url(&self) -> String {
        let url = self.database_url.clone().unwrap_or_else(|| database_url::url(&self.data.join("service.db")));
        // A file that is not there is a first start.
        let bare = url.starts_with("sqlite:") && !url.contains('?');
        if bare { format!("{url}?mode=rwc") } else { url }
    }

    /// URL of the object store to open.
    pub fn storage_url(&self) -> String {
        self.storage_url.clone().unwrap_or_else(|| format!("file:{}", self.data.join("blobs").display()))
    }
}
