//! `serve`: the service. On an empty data folder it first takes in a known source through the same queue as any upload, so that
//! there is something to look at within seconds.

/// What clients may ask of a service.
mod limits;
/// What a service may ask elsewhere.
mod outbound;

use super::terminal::failure::Failure;
use super::terminal::{measure, output};
use axum::Router;
use axum::body::{Body, to_bytes};
use axum::http::Request;
use clap::{Args, ValueEnum};
use limits::Bounds;
use outbound::Elsewhere;
use pipeline::{Limits, known_sources};
use service::telemetry::LogFormat;
use service::upkeep::lock::LockError;
use service::{Config, Role, Service, StartError, Submitted, priority, storage, telemetry};
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use std::path::PathBuf;
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};
use tokio::signal::unix::{SignalKind, signal};
use tower::ServiceExt;

/// The known source of an empty data folder.
const SAMPLE: &str = "four-chips";
/// Its rays.
const SAMPLE_RAYS: u64 = 200_000;

/// What is still being written when the service has stopped gets this long, if the grace is not over before.
const LAST_WAIT: Duration = Duration::from_secs(1);

/// Arguments of `serve`.
#[derive(Args)]
pub struct Arguments {
    /// Address and port; port 0 takes any.
    #[arg(long, env = "LAMPWRIGHT_LISTEN", default_value = "127.0.0.1:8080", value_name = "ADDRESS")]
    listen: SocketAddr,
    /// Folder for everything that outlives the process; made if missing.
    #[arg(long, env = "LAMPWRIGHT_DATA", default_value = "data", value_name = "DIR")]
    data: PathBuf,
    /// The database: sqlite:FILE or postgres://USER:PASSWORD@HOST/NAME [default: sqlite:DIR/service.db].
    #[arg(long, env = "DATABASE_URL", value_name = "URL", hide_env_values = true)]
    database_url: Option<String>,
    /// The object store: file:DIR or s3://BUCKET/PREFIX, with AWS_* as usual [default: file:DIR/blobs].
    #[arg(long, env = "STORAGE_URL", value_name = "URL")]
    storage_url: Option<String>,
    /// What this process does.
    #[arg(long, env = "ROLE", value_enum, default_value_t)]
    role: Part,
    /// Jobs computed at once [default: 2].
    #[arg(long, env = "LAMPWRIGHT_JOBS", value_name = "N", value_parser = measure::at_least_one::<usize>)]
    jobs: Option<usize>,
    /// Threads each job computes on [default: as many as the machine has].
    #[arg(long, env = "LAMPWRIGHT_THREADS", value_name = "N", value_parser = measure::at_least_one::<usize>)]
    threads: Option<usize>,
    /// Memory that all jobs computed at once are expected to need at most; one that needs more is refused, one that does not
    /// fit now waits; as 4GiB [default: three quarters of what the machine or its control group has].
    #[arg(long, env = "LAMPWRIGHT_MEMORY", value_name = "SIZE", value_parser = measure::some_bytes)]
    memory: Option<u64>,
    /// Time that an attempt at a job may take before it is stopped and the job fails, as 90m or in seconds [default: 6h].
    #[arg(long, env = "LAMPWRIGHT_JOB_TIMEOUT", value_name = "TIME", value_parser = measure::some_seconds)]
    job_timeout: Option<Duration>,
    /// Largest file taken, and most bytes that a packed one may unpack to [default: 64GiB].
    #[arg(long, env = "LAMPWRIGHT_MAX_UPLOAD", value_name = "SIZE", value_parser = measure::some_bytes)]
    max_upload: Option<u64>,
    /// Ask for keys. Where others can reach the service it always does, and refuses to start without any: make the first with
    /// `lampwright keys create`, or say `on` and make it later.
    #[arg(long, env = "LAMPWRIGHT_AUTH", value_enum, default_value_t)]
    auth: Auth,
    /// Time that the service takes to stop at most, as 8s or in seconds; running jobs and open requests get most of it; 0 is none
    /// [default: 8s].
    #[arg(long, env = "LAMPWRIGHT_GRACE", value_name = "TIME", value_parser = measure::seconds)]
    grace: Option<Duration>,
    /// How often a job may be begun before it counts as what kills its worker [default: 3].
    #[arg(long, env = "LAMPWRIGHT_ATTEMPTS", value_name = "N", value_parser = measure::at_least_one::<u32>)]
    attempts: Option<u32>,
    /// Time that a worker may be silent before its job is given to another, as 30s or in seconds [default: 30s].
    #[arg(long, env = "LAMPWRIGHT_LEASE", value_name = "TIME", value_parser = measure::some_seconds)]
    lease: Option<Duration>,
    /// Time for which nothing was written where a blob is that no row names, before it is deleted, as 24h or in seconds
    /// [default: 24h]. Far above the longest upload, inspection and unpacking: to this clock they are silent.
    #[arg(long, env = "LAMPWRIGHT_GARBAGE_AGE", value_name = "TIME", value_parser = measure::some_seconds)]
    garbage_age: Option<Duration>,
    /// Do not begin an empty data folder with a known source.
    #[arg(long, env = "LAMPWRIGHT_NO_SAMPLE", value_parser = clap::builder::BoolishValueParser::new())]
    no_sample: bool,
    /// What is logged on standard error: error, warn, info, debug, or a filter as lampwright=debug,info.
    #[arg(long, env = "LAMPWRIGHT_LOG", default_value = "info", value_name = "FILTER")]
    log: String,
    /// How log lines look.
    #[arg(long, env = "LAMPWRIGHT_LOG_FORMAT", value_enum, default_value_t)]
    log_format: LogLines,
    // Last: their headings hold for whatever comes after them.
    #[command(flatten)]
    bounds: Bounds,
    #[command(flatten)]
    elsewhere: Elsewhere,
}

#[derive(Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
enum Auth {
    /// Where others than this machine can reach the service.
    #[default]
    Auto,
    /// Always.
    On,
}

#[derive(Clone, Copy, Default, ValueEnum)]
enum Part {
    /// Answer clients; compute nothing.
    Api,
    /// Compute; answer only whether it is well.
    Worker,
    /// Both.
    #[default]
    All,
}

#[derive(Clone, Copy, Default, ValueEnum)]
enum LogLines {
    /// For a person.
    #[default]
    Text,
    /// For a collector.
    Json,
}

impl Arguments {
    fn config(&self) -> Config {
        let defaults = Config::new(&self.data);
        let max_upload_bytes = self.max_upload.unwrap_or(defaults.max_upload_bytes);
        Config {
            role: match self.role {
                Part::Api => Role::Api,
                Part::Worker => Role::Worker,
                Part::All => Role::All,
            },
            database_url: self.database_url.clone(),
            storage_url: self.storage_url.clone(),
            max_attempts: self.attempts.unwrap_or(defaults.max_attempts),
            lease: self.lease.unwrap_or(defaults.lease),
            garbage_age: self.garbage_age.unwrap_or(defaults.garbage_age),
            listen: self.listen,
            concurrency: self.jobs.unwrap_or(defaults.concurrency),
            threads: self.threads.unwrap_or(defaults.threads),
            memory_bytes: self.memory.unwrap_or(defaults.memory_bytes),
            job_timeout: self.job_timeout.unwrap_or(defaults.job_timeout),
            max_upload_bytes,
            limits: Limits { max_expanded_bytes: max_upload_bytes, ..defaults.limits },
            grace: self.grace.unwrap_or(defaults.grace),
            auth: self.auth == Auth::On,
            ..self.elsewhere.over(self.bounds.over(defaults))
        }
    }
}

/// Serves until SIGINT or SIGTERM. `unread` is told in the log: see [`super::environment::unread`].
///
/// # Errors
/// A data folder, an address or a store that cannot be had.
pub fn run(arguments: &Arguments, unread: &[String]) -> Result<(), Failure> {
    let format = match arguments.log_format {
        LogLines::Text => LogFormat::Text,
        LogLines::Json => LogFormat::Json,
    };
    let _telemetry = telemetry::init(format, &arguments.log);
    unread.iter().for_each(|told| tracing::warn!("{told}"));
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build();
    let runtime = runtime.map_err(|error| {
        Failure::failed("serve.runtime", error.to_string(), "Allow this process more threads and files.")
    })?;
    priority::lower_shared_pool();
    let told = Arc::new(OnceLock::new());
    let served = runtime.block_on(serve(arguments, Arc::clone(&told)));
    // Dropping the runtime would wait without end for a computation that does not look whether it is still wanted.
    let grace = arguments.config().grace;
    let left = told.get().map_or(LAST_WAIT, |told: &Instant| grace.saturating_sub(told.elapsed()));
    runtime.shutdown_timeout(left.min(LAST_WAIT));
    served
}

async fn serve(arguments: &Arguments, told: Arc<OnceLock<Instant>>) -> Result<(), Failure> {
    let stop = stopping(told)?;
    let config = arguments.config();
    let asks_for_keys = config.asks_for_keys();
    // A database of its own is a first start; one that others share is not to be filled by each of them. And with keys, the
    // sample would be a tenant's whom nobody asked.
    let unwanted = arguments.no_sample || asks_for_keys || !config.is_alone();
    let service = Service::start(config).await?;
    let site = format!("http://{}", reachable(service.address()));
    let key = if asks_for_keys { " -H \"Authorization: Bearer $KEY\"" } else { "" };
    say(&format!(
        "Lampwright {} is at {site}\n  documentation   {site}/docs\n  send a file     curl -X POST{key} -T FILE '{site}/v1/ray-sets?name=FILE'",
        env!("CARGO_PKG_VERSION")
    ));
    if let Some(sample) = begin(&service, unwanted).await? {
        say(&format!("  built-in sample {site}/v1/jobs/{}  ({SAMPLE}, {SAMPLE_RAYS} rays)", sample.job));
        tokio::spawn(tell_when_done(service.router(), site, sample));
    }
    let listener = |error: std::io::Error| Failure::failed("serve.listener", error.to_string(), "Start it again.");
    service.run_until(stop).await.map_err(listener)
}

/// Greets whoever has started it; a service goes on when nobody reads that.
fn say(line: &str) {
    let _ = output::print(format_args!("{line}\n"));
}

/// Gives an empty service its first job.
async fn begin(service: &Service, unwanted: bool) -> Result<Option<Submitted>, Failure> {
    let failed = |error: String| Failure::failed("serve.sample", error, "Start it with --no-sample.");
    if unwanted || !service.is_empty().await.map_err(|error| failed(error.to_string()))? {
        return Ok(None);
    }
    let Some(source) = known_sources::by_name(SAMPLE) else { return Ok(None) };
    let mut bytes = Vec::new();
    known_sources::write_tm25(&source, SAMPLE_RAYS, 1, &mut bytes).map_err(|error| failed(error.to_string()))?;
    let submitted = service.submit(&format!("{SAMPLE}.tm25ray"), bytes.as_slice()).await;
    Ok(submitted.map_err(|error| failed(error.to_string()))?.pop())
}

/// Says where the sample's model is, once it is, or why there is none.
async fn tell_when_done(router: Router, site: String, sample: Submitted) {
    let address = format!("/v1/jobs/{}", sample.job);
    loop {
        tokio::time::sleep(Duration::from_millis(250)).await;
        let Ok(request) = Request::get(&address).body(Body::empty()) else { return };
        let Ok(response) = router.clone().oneshot(request).await;
        let Ok(body) = to_bytes(response.into_body(), 1 << 20).await else { return };
        let Ok(job) = serde_json::from_slice::<serde_json::Value>(&body) else { return };
        match job.get("state").and_then(serde_json::Value::as_str) {
            Some("queued" | "running") => {}
            Some("succeeded") => {
                say(&format!("The sample's model is finished: curl -O {site}{address}/model.zip"));
                return;
            }
            other => {
                say(&format!("The sample gave no model ({}): see {site}{address}", other.unwrap_or("deleted")));
                return;
            }
        }
    }
}

/// Resolves at SIGINT or SIGTERM, and notes when it was `told`. Listens from the call on, so that no signal is missed while starting.
fn stopping(told: Arc<OnceLock<Instant>>) -> Result<impl Future<Output = ()>, Failure> {
    let failed = |error: std::io::Error| Failure::failed("serve.signals", error.to_string(), "Allow signal handlers.");
    let mut interrupt = signal(SignalKind::interrupt()).map_err(failed)?;
    let mut terminate = signal(SignalKind::terminate()).map_err(failed)?;
    Ok(async move {
        tokio::select! {
            _ = interrupt.recv() => {}
            _ = terminate.recv() => {}
        }
        let _ = told.set(Instant::now());
    })
}

/// The address a client on this machine can use: "any" is not one.
pub(super) fn reachable(address: SocketAddr) -> SocketAddr {
    let ip = match address.ip() {
        IpAddr::V4(ip) if ip.is_unspecified() => Ipv4Addr::LOCALHOST.into(),
        IpAddr::V6(ip) if ip.is_unspecified() => Ipv6Addr::LOCALHOST.into(),
        ip => ip,
    };
    SocketAddr::new(ip, address.port())
}

impl From<StartError> for Failure {
    fn from(error: StartError) -> Failure {
        let (code, remedy) = match &error {
            StartError::DataFolder(LockError::Folder { folder, error }) => {
                return Failure::folder("serve.folder", folder, error);
            }
            StartError::DataFolder(LockError::Locked(_)) => {
                ("serve.locked", "Stop the other process, or name another folder with --data.")
            }
            StartError::Listen { .. } => ("serve.listen", "Name another with --listen; port 0 takes any free one."),
            StartError::NoKeys(_) => (
                "serve.no_keys",
                "Make one for this database: lampwright keys create --tenant NAME. Or start with --auth on and make it later, \
                 or listen on 127.0.0.1.",
            ),
            StartError::Storage(storage::Error::Unusable(error)) => (error.code(), error.remedy()),
            StartError::Storage(storage::Error::Unsupported(_, remedy)) => ("serve.storage", *remedy),
            StartError::Storage(_) => (
                "serve.storage",
                "See that the data folder is whole and has room, and that the engines named by DATABASE_URL and STORAGE_URL answer.",
            ),
            StartError::Threads(_) => ("serve.threads", "Give fewer with --threads or --jobs."),
        };
        Failure::failed(code, error.to_string(), remedy)
    }
}
