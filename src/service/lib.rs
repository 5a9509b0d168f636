//! The HTTP service: sockets, disk and time. Its parts are put together here and nowhere else; the computation is in [`pipeline`].

/// The cryptography of TLS.
pub mod tls;
/// Crash points, at which a test ends the process.
pub mod crash;
/// Bytes, written.
mod hex;
/// Times, written as RFC 3339.
pub mod calendar;
/// How much memory there is.
mod machine;
/// Priorities of threads: computations give way to requests.
pub mod priority;
/// Logs and traces.
pub mod telemetry;
/// Metrics of this process.
pub mod metrics;
/// Why a job failed or an upload was refused, as it is stored and shown.
pub mod failure;
/// The database and the object store.
pub mod storage;
/// Causes of errors: the input, a store or the service.
pub mod cause;
/// Outbound HTTP requests.
pub mod outbound;
/// API keys, tenants and quotas.
pub mod accounts;
/// Metadata: the client's own keys and values.
pub mod metadata;
/// Uploads of ray files, and stored ray sets.
pub mod ray_sets;
/// Rows of spectra.
pub mod spectra;
/// Uploads that come in several requests (tus): append, finish, outcome.
mod uploads;
/// The client of a request behind trusted proxies.
pub mod forwarded;
/// Webhooks, which report ended jobs.
pub mod webhooks;
/// The job queue and its workers.
pub mod jobs;
/// Models read back, and new rays of them.
pub mod models;
/// Accepts and limits TCP connections.
pub mod connections;
/// What an operator may choose.
pub mod config;
/// What keeps the stores in order: retention, backup, garbage.
pub mod upkeep;
/// The HTTP API.
pub mod http;

pub use config::{Config, Role};

use accounts::access::DEFAULT_TENANT;
use accounts::rate::RateLimit;
use accounts::{Authenticator, keys};
use axum::Router;
use connections::{Server, Stopping};
use http::api::{Api, Services};
use jobs::memory_budget::Memory;
use jobs::outbox;
use jobs::query::Filter;
use jobs::queue;
use jobs::queue::Queue;
use jobs::recent::Recent;
use jobs::request::NewJob;
use jobs::watcher::Watcher;
use jobs::worker::{Runner, Worker, pipeline_runner};
use metrics::Metrics;
use models::Models;
use outbound::Outbound;
use ray_sets::announcement::Announcement;
use ray_sets::fetch::Ingest;
use ray_sets::intake::Intake;
use ray_sets::{Buffers, Digests, Places};
use std::fs::File;
use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;
use storage::space::Space;
use storage::{Storage, private};
use tokio::io::AsyncRead;
use tokio::net::TcpListener;
use tokio::task::{JoinError, JoinSet};
use tokio::time::{Instant, MissedTickBehavior, interval, timeout, timeout_at};
use tokio_util::io::ReaderStream;
use tokio_util::sync::CancellationToken;
use tokio_util::task::AbortOnDropHandle;
use upkeep::garbage::Collected;
use upkeep::lock::{LockError, lock};
use upkeep::{garbage, owner};
use uploads::{Uploads, outcome};
use webhooks::deliveries;
use webhooks::dispatcher::Dispatcher;

/// Longest time that running jobs get, of the grace of a stopping service, to go back to the queue.
const GIVING_BACK: Duration = Duration::from_secs(2);
/// Longest time for the object store to say, at the start, which database it belongs to.
const OWNER_LOOK: Duration = Duration::from_secs(5);

/// Why a service does not start.
#[derive(Debug, thiserror::Error)]
pub enum StartError {
    /// The data folder cannot be used, or another process has it.
    #[error(transparent)]
    DataFolder(#[from] LockError),
    /// The address cannot be listened on.
    #[error("cannot listen on {address}: {error}")]
    Listen {
        /// The address to listen on.
        address: SocketAddr,
        /// The error of the system.
        error: io::Error,
    },
    /// Other machines could reach the service, but there is no API key.
    #[error("other machines can reach this service at {0}, but it has no API keys yet")]
    NoKeys(SocketAddr),
    /// The database or the object store cannot be opened.
    #[error(transparent)]
    Storage(#[from] storage::error::Error),
    /// The computing threads cannot be started.
    #[error("cannot start the computing threads: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
}

/// Why [`Service::submit`] did not queue a job.
#[derive(Debug, thiserror::Error)]
pub enum SubmitError {
    /// The ray file was not stored.
    #[error(transparent)]
    Upload(#[from] ray_sets::error::Error),
    /// The job was not queued.
    #[error(transparent)]
    Queue(#[from] queue::Error),
}

/// What [`Service::submit`] made of a ray file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Submitted {
    /// Identifier of the ray set.
    pub ray_set: String,
    /// Identifier of the job.
    pub job: String,
}

/// A running service: it works on its queue from the start and answers once [`Service::run_until`] is called. Dropped, it
/// stops at once, as if killed; the next one on the same folder goes on.
pub struct Service {
    config: Config,
    api: Api,
    listener: TcpListener,
    address: SocketAddr,
    slots: JoinSet<()>,
    stopping: Stopping,
    release: CancellationToken,
    /// Tasks that run until the service stops: garbage collection, retention, finishing of uploads and webhooks.
    upkeep: JoinSet<()>,
    /// Lock on the data folder, held as long as the service lives: proves that no other process uses the folder.
    _lock: Option<File>,
}

impl Service {
    /// Starts a service that computes with [`pipeline::run`]. Needs a tokio runtime of several threads.
    ///
    /// # Errors
    /// [`StartError`].
    pub async fn start(config: Config) -> Result<Service, StartError> {
        Service::start_with(config, pipeline_runner()).await
    }

    /// Starts a service that computes with `runner`.
    ///
    /// # Errors
    /// [`StartError`].
    pub async fn start_with(config: Config, runner: Runner) -> Result<Service, StartError> {
        tls::install();
        let (lock, storage) = open(&config).await?;
        // Safe, and of no use to anybody: most likely the keys are elsewhere. Who means it says so.
        let answers_nobody = config.role.answers() && config.asks_for_keys() && !config.auth;
        if answers_nobody && !keys::any(&storage.records).await? {
            return Err(StartError::NoKeys(config.listen));
        }
        let metrics = Metrics::new();
        let queue = Queue::new(storage.clone(), config.lease, config.max_attempts);
        let queue = queue.remembered(Recent::new(storage.records.clone(), lock.is_some(), config.poll));
        let queue = queue.bounded(config.quota, metrics.clone());
        let memory = Memory::new(config.memory_bytes, metrics.clone());
        let queue = queue.within(memory, config.threads, config.job_timeout);
        let mut left_alone = 0;
        if lock.is_some() {
            // The lock proves that whoever ran these jobs and wrote these blobs is gone. Where there is none, leases and
            // the age of what lies about say it later.
            queue.recover().await?;
            queue.give_up().await?;
            outcome::recover(&storage.records).await?;
            deliveries::recover(&storage.records).await?;
            left_alone = collect(&storage, Duration::ZERO).await?.log_left_alone(left_alone);
        }
        tracing::info!(alone = lock.is_some(), role = ?config.role, "storage opened");
        let (stopping, release) = (Stopping::default(), CancellationToken::new());
        let stop = stopping.draining.clone();
        let mut upkeep = JoinSet::new();
        upkeep.spawn(until(stop.clone(), collect_garbage(storage.clone(), config.clone(), left_alone)));
        upkeep.spawn(until(stop.clone(), upkeep::retention::keep_up(storage.clone(), queue.clone(), config.retention)));
        let watcher = Watcher::new(config.waiting());
        let (records, recent) = (storage.records.clone(), queue.recent().clone());
        let watching = watcher.clone().keep_up(records, recent, queue.changes(), config.poll);
        upkeep.spawn(until(stop.clone(), watching));
        let outbound = Outbound::new(config.outbound_exceptions.clone());
        let dispatcher = Dispatcher::new(storage.records.clone(), outbound, config.webhook_policy(), metrics.clone());
        if config.role.answers() {
            let (records, changes) = (storage.records.clone(), queue.changes());
            let announcing = outbox::keep_up(records, dispatcher.clone(), changes, config.poll);
            upkeep.spawn(until(stop.clone(), announcing));
            upkeep.spawn(dispatcher.clone().keep_up(config.poll, stop.clone()));
        }
        let listen = |error| StartError::Listen { address: config.listen, error };
        let listener = TcpListener::bind(config.listen).await.map_err(listen)?;
        let address = listener.local_addr().map_err(listen)?;
        let worker = Worker {
            storage: storage.clone(),
            queue: queue.clone(),
            runner,
            limits: config.limits,
            poll: config.poll,
            renew_every: config.renew_every(),
            patience: config.lease.saturating_mul(10),
            metrics: metrics.clone(),
            stop: stop.clone(),
            release: release.clone(),
        };
        let slots = match config.role.computes() {
            true => worker.spawn(config.concurrency, config.threads)?,
            false => JoinSet::new(),
        };
        let api = Service::api(&config, storage, queue, (watcher, dispatcher), metrics, stop)?;
        if config.role.answers() {
            upkeep.spawn(until(api.draining.clone(), api.uploads.clone().keep_up()));
            // Stops by itself, and gives back what it has begun.
            upkeep.spawn(api.uploads.clone().finish_all(config.poll));
        }
        Ok(Service { config, api, listener, address, slots, stopping, release, upkeep, _lock: lock })
    }

    fn api(
        config: &Config,
        storage: Storage,
        queue: Queue,
        (watcher, dispatcher): (Watcher, Dispatcher),
        metrics: Metrics,
        draining: CancellationToken,
    ) -> Result<Api, StartError> {
        let (max_bytes, slowest, limits) = (config.max_upload_bytes, config.slowest, config.limits);
        let rate = RateLimit::new(config.rate_per_second, config.rate_burst);
        let outbound = config.ingests().then(|| dispatcher.outbound().clone());
        let space = Space::new(config.local_folders(), config.keep_free);
        let intake = Intake {
            storage: storage.clone(),
            max_bytes,
            slowest,
            quota: config.quota,
            space: space.clone(),
            limits,
            buffers: Buffers::default(),
            digests: Digests::new()?,
            inspections: Places::new()?,
            metrics: metrics.clone(),
        };
        Ok(Api::new(Services {
            ingest: Ingest::new(outbound, &config.ingest_buckets)?,
            uploads: Uploads {
                intake: intake.clone(),
                expiry: config.upload_expiry,
                lease: config.lease,
                max_attempts: config.max_attempts,
                refusal_of: http::problem::refusal_of,
                ends: Arc::default(),
                stopping: draining.clone(),
            },
            intake,
            authenticator: Authenticator::new(storage.records.clone(), config.asks_for_keys(), rate),
            origins: config.cors_origins.clone().into(),
            prefix: config.proxies.public.clone().unwrap_or_default(),
            space,
            readiness: http::readiness::readiness(storage.clone()),
            storage,
            queue,
            models: Models::new(draining.clone()),
            watcher,
            dispatcher,
            metrics,
            draining,
        }))
    }

    /// The address that the service listens on.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// The router of the HTTP API, for requests from within this process.
    pub fn router(&self) -> Router {
        match self.config.role.answers() {
            true => http::router(self.api.clone()),
            false => http::health_router(self.api.clone()),
        }
    }

    /// Takes in a ray file, or the ray files in a packed one, and queues a job for each with default options, the way any
    /// client's would be.
    ///
    /// # Errors
    /// [`SubmitError`]; nothing is left behind, but for ray sets when only a job fails.
    pub async fn submit(&self, name: &str, reader: impl AsyncRead) -> Result<Vec<Submitted>, SubmitError> {
        let announcement = Announcement { name: name.to_owned(), ..Announcement::default() };
        let taken = self.api.intake.take(DEFAULT_TENANT, announcement, ReaderStream::new(reader)).await?;
        let mut submitted = Vec::new();
        for ray_set in taken.ray_sets.into_iter().map(|ray_set| ray_set.id) {
            let (queue, new) = (&self.api.queue, NewJob::of(&ray_set));
            let plan = queue.plan(DEFAULT_TENANT, &new).await?;
            let job = queue.enqueue(DEFAULT_TENANT, &new, &plan, None).await?.id;
            submitted.push(Submitted { ray_set, job });
        }
        Ok(submitted)
    }

    /// Whether the service has neither ray sets nor jobs: its data folder was not used before.
    ///
    /// # Errors
    /// The database did not answer.
    pub async fn is_empty(&self) -> Result<bool, storage::error::Error> {
        let records = &self.api.storage.records;
        let ray_sets =
            ray_sets::rows::list(records, DEFAULT_TENANT, ray_sets::rows::Wanted::default(), None, 1).await?;
        Ok(ray_sets.is_empty()
            && jobs::query::list(records, DEFAULT_TENANT, &Filter::default(), None, 1).await?.is_empty())
    }

    /// Answers until `shutdown` resolves; then begins nothing new and tells so, also on new connections, until running jobs and open
    /// requests have ended. Towards the end of the configured grace jobs go back to the queue, their attempt not counted, and
    /// connections are cut. Uploads that are being finished go back at once. A computation that does not look whether it is
    /// still wanted is left behind.
    ///
    /// # Errors
    /// The listener failed; a task that looks after the stores hit a fault of ours.
    pub async fn run_until(mut self, shutdown: impl Future<Output = ()>) -> io::Result<()> {
        tracing::info!(address = %self.address, "listening");
        let server = Server {
            router: self.router(),
            bounds: self.config.bounds,
            proxies: Arc::new(self.config.proxies.clone()),
            metrics: self.api.metrics.clone(),
            stopping: self.stopping.clone(),
        };
        let serving = connections::serve(self.listener, server);
        let mut serving = AbortOnDropHandle::new(tokio::spawn(serving));
        tokio::select! {
            () = shutdown => {}
            served = &mut serving => return served.map_err(io::Error::other),
            // Without it the service would seem well and do half of its work: whoever looks after the process starts another.
            fault = fault(&mut self.upkeep) => return Err(io::Error::other(fault)),
        }
        let stopping = self.stopping;
        tracing::info!("stopping");
        let Phases { give_back, cut, end } = Phases::of(self.config.grace);
        stopping.draining.cancel();
        stopping.requests.close();
        let tasks = (&mut self.slots, &mut self.upkeep);
        if timeout_at(give_back, drained(&stopping, tasks)).await.is_err() {
            self.release.cancel();
            let _ = timeout_at(cut, drained(&stopping, (&mut self.slots, &mut self.upkeep))).await;
        }
        stopping.closing.cancel();
        let _ = timeout_at(cut, &mut serving).await;
        serving.abort();
        self.upkeep.abort_all();
        let _ = timeout_at(end, self.api.storage.records.close()).await;
        tracing::info!("stopped");
        Ok(())
    }
}

/// When a stopping service does what, at the latest.
struct Phases {
    /// Running jobs are given back to the queue.
    give_back: Instant,
    /// Connections are cut.
    cut: Instant,
    /// The database is left.
    end: Instant,
}

impl Phases {
    /// The end of a service that is to stop now within `grace`: half of it, at most two seconds, is for giving jobs back, and
    /// a quarter of that for the end.
    fn of(grace: Duration) -> Phases {
        let (now, last) = (Instant::now(), (grace / 2).min(GIVING_BACK));
        Phases { give_back: now + (grace - last), cut: now + (grace - last / 4), end: now + grace }
    }
}

/// Resolves when nothing is at hand any more: no job, no request from before the stop, no delivery and no upload being finished.
async fn drained(stopping: &Stopping, (slots, upkeep): (&mut JoinSet<()>, &mut JoinSet<()>)) {
    while slots.join_next().await.is_some() {}
    stopping.requests.wait().await;
    while upkeep.join_next().await.is_some() {}
}

/// A task that is given up when the service is `stopping`: nothing of it is left half done.
async fn until(stopping: CancellationToken, task: impl Future<Output = ()>) {
    stopping.run_until_cancelled(task).await;
}

/// Resolves when a task has hit a fault; one that ends by itself had nothing to do.
async fn fault(tasks: &mut JoinSet<()>) -> JoinError {
    loop {
        match tasks.join_next().await {
            Some(Ok(())) => {}
            Some(Err(fault)) => return fault,
            None => std::future::pending().await,
        }
    }
}

/// Deletes the blobs that the database does not name, again and again. `left_alone`: number of other objects in the store when it was last logged.
async fn collect_garbage(storage: Storage, config: Config, mut left_alone: usize) {
    let mut ticker = interval(config.garbage_period());
    ticker.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        ticker.tick().await;
        match collect(&storage, config.garbage_age).await {
            Ok(collected) => left_alone = collected.log_left_alone(left_alone),
            Err(error) => tracing::warn!(%error, "cannot search for garbage; trying again later"),
        }
    }
}

/// Deletes what no row names. That the blobs belong to this database is seen each time before: the start may not have waited for it.
async fn collect(storage: &Storage, age: Duration) -> Result<Collected, storage::error::Error> {
    owner::check(storage).await?;
    garbage::collect(storage, age).await
}

/// Opens the stores; where they belong to one process at a time, with the lock that keeps others out.
async fn open(config: &Config) -> Result<(Option<File>, Storage), StartError> {
    let lock = if config.is_alone() { Some(lock(&config.data)?) } else { None };
    if lock.is_some() {
        let failed = |error| LockError::Folder { folder: config.data.clone(), error };
        upkeep::backup::begin_to_serve(&config.data).map_err(failed)?;
    }
    let storage = Storage::open(&config.database_url(), &config.storage_url()).await?;
    // A store that is away holds up no start; garbage is not collected before it has answered.
    match timeout(OWNER_LOOK, owner::check(&storage)).await {
        Ok(Err(error @ storage::error::Error::Unusable(_))) => return Err(error.into()),
        Ok(Err(error)) => {
            tracing::warn!(%error, "cannot check yet whether the object store belongs to this database; trying again")
        }
        Err(_) => {
            tracing::warn!("the object store does not answer yet: cannot check whether it belongs to this database")
        }
        Ok(Ok(())) => {}
    }
    // Not before it is known that they are ours.
    private::Closed::of_service(&config.data, &config.database_url(), &config.storage_url()).log();
    Ok((lock, storage))
}
