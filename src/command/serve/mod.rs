//! `serve`: the service. On an empty data folder it first takes in a known source through the same queue as any upload, so that
//! there is something to look at within seconds.

/// Arguments that limit clients.
mod limits;
/// Arguments about outbound requests.
mod outbound;

use super::terminal::failure::Failure;
use super::terminal::{measure, output};
use axum::Router;
use axum::body::{Body, to_bytes};
use axum::http::Request;
use clap::{Args, ValueEnum};
use limits::Bounds;
use outbound::OutboundArguments;
use pipeline::{Limits, SAMPLE, write_sample};
use service::telemetry::LogFormat;
use service::upkeep::lock::LockError;
use service::{Config, Role, Service, StartError, Submitted, priority, storage, telemetry};
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use std::path::PathBuf;
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};
use tokio::signal::unix::{SignalKind, signal};
use tower::ServiceExt;

/// What is still being written when the service has stopped gets this long, if the grace is not over before.
const LAST_WAIT: Duration = Duration::from_secs(1);

/// Arguments of `serve`.
#[derive(Args)]
pub struct Arguments {
    /// Address and port to listen on; port 0 chooses a free port.
    #[arg(long, env = "LAMPWRIGHT_LISTEN", default_value = "127.0.0.1:8080", value_name = "ADDRESS")]
    listen: SocketAddr,
    /// Folder for the database and the files of the service; created if missing.
    #[arg(long, env = "LAMPWRIGHT_DATA", default_value = "data", value_name = "DIR")]
    data: PathBuf,
    /// The database: sqlite:FILE or postgres://USER:PASSWORD@HOST/NAME [default: sqlite:DIR/service.db].
    #[arg(long, env = "DATABASE_URL", value_name = "URL", hide_env_values = true)]
    database_url: Option<String>,
    /// The object store: file:DIR or s3://BUCKET/PREFIX, with credentials from the AWS_* variables [default: file:DIR/blobs].
    #[arg(long, env = "STORAGE_URL", value_name = "URL")]
    storage_url: Option<String>,
    /// Role of this process.
    #[arg(long, env = "ROLE", value_enum, default_value_t)]
    role: Part,
    /// Number of jobs computed at the same time [default: 2].
    #[arg(long, env = "LAMPWRIGHT_JOBS", value_name = "N", value_parser = measure::at_least_one::<usize>)]
    jobs: Option<usize>,
    /// Number of threads for each job [default: as many as the machine has].
    #[arg(long, env = "LAMPWRIGHT_THREADS", value_name = "N", value_parser = measure::at_least_one::<usize>)]
    threads: Option<usize>,
    /// Memory for all running jobs together, as 4GiB; a job that needs more is refused, a job that does not fit now waits
    /// [default: three quarters of the memory of the machine or its control group].
    #[arg(long, env = "LAMPWRIGHT_MEMORY", value_name = "SIZE", value_parser = measure::some_bytes)]
    memory: Option<u64>,
    /// Time limit for each attempt at a job, after which the job fails, as 90m or in seconds [default: 6h].
    #[arg(long, env = "LAMPWRIGHT_JOB_TIMEOUT", value_name = "TIME", value_parser = measure::some_seconds)]
    job_timeout: Option<Duration>,
    /// Largest file that is accepted, and largest unpacked size of an archive [default: 64GiB].
    #[arg(long, env = "LAMPWRIGHT_MAX_UPLOAD", value_name = "SIZE", value_parser = measure::some_bytes)]
    max_upload: Option<u64>,
    /// When API keys are required. A service that other machines can reach always requires keys, and does not start without any:
    /// make the first with `lampwright keys create`, or use `on` and make it later.
    #[arg(long, env = "LAMPWRIGHT_AUTH", value_enum, default_value_t)]
    auth: Auth,
    /// Longest time that the service takes to stop, as 8s or in seconds; running jobs and open requests get most of it; 0 stops
    /// at once [default: 8s].
    #[arg(long, env = "LAMPWRIGHT_GRACE", value_name = "TIME", value_parser = measure::seconds)]
    grace: Option<Duration>,
    /// Number of attempts at a job whose worker is lost, before the job fails [default: 3].
    #[arg(long, env = "LAMPWRIGHT_ATTEMPTS", value_name = "N", value_parser = measure::at_least_one::<u32>)]
    attempts: Option<u32>,
    /// Time without a sign of life from a worker after which another worker takes its job, as 30s or in seconds [default: 30s].
    #[arg(long, env = "LAMPWRIGHT_LEASE", value_name = "TIME", value_parser = measure::some_seconds)]
    lease: Option<Duration>,
    /// Age after which a blob that the database does not name is deleted, as 24h or in seconds [default: 24h]. Must be far above
    /// the longest time that an upload, an inspection or an unpacking takes.
    #[arg(long, env = "LAMPWRIGHT_GARBAGE_AGE", value_name = "TIME", value_parser = measure::some_seconds)]
    garbage_age: Option<Duration>,
    /// Do not compute the built-in sample in an empty data folder.
    #[arg(long, env = "LAMPWRIGHT_NO_SAMPLE", value_parser = clap::builder::BoolishValueParser::new())]
    no_sample: bool,
    /// Log level on standard error: error, warn, info, debug, or a filter such as lampwright=debug,info.
    #[arg(long, env = "LAMPWRIGHT_LOG", default_value = "info", value_name = "FILTER")]
    log: String,
    /// Format of the log lines.
    #[arg(long, env = "LAMPWRIGHT_LOG_FORMAT", value_enum, default_value_t)]
    log_format: LogLines,
    // Last: their headings hold for whatever comes after them.
    #[command(flatten)]
    bounds: Bounds,
    #[command(flatten)]
    outbound: OutboundArguments,
}

#[derive(Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
enum Auth {
    /// Only if other machines can reach the service.
    #[default]
    Auto,
    /// Always.
    On,
}

#[derive(Clone, Copy, Default, ValueEnum)]
enum Part {
    /// Answer requests of clients; compute no jobs.
    Api,
    /// Compute jobs; answer only health checks and metrics.
    Worker,
    /// Both.
    #[default]
    All,
}

#[derive(Clone, Copy, Default, ValueEnum)]
enum LogLines {
    /// Text for people.
    #[default]
    Text,
    /// JSON for log collectors.
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
            ..self.outbound.over(self.bounds.over(defaults))
        }
    }
}

/// Serves until SIGINT or SIGTERM. `unknown_variables` are logged: see [`super::environment::unread`].
///
/// # Errors
/// The data folder, the address or a store cannot be used.
pub fn run(arguments: &Arguments, unknown_variables: &[String]) -> Result<(), Failure> {
    let format = match arguments.log_format {
        LogLines::Text => LogFormat::Text,
        LogLines::Json => LogFormat::Json,
    };
    let _telemetry = telemetry::init(format, &arguments.log);
    unknown_variables.iter().for_each(|warning| tracing::warn!("{warning}"));
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build();
    let runtime = runtime.map_err(|error| {
        Failure::failed("serve.runtime", error.to_string(), "Allow this process more threads and open files.")
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
        say(&format!("  built-in sample {site}/v1/jobs/{}  ({SAMPLE})", sample.job));
        tokio::spawn(tell_when_done(service.router(), site, sample));
    }
    let listener =
        |error: std::io::Error| Failure::failed("serve.listener", error.to_string(), "Start the service again.");
    service.run_until(stop).await.map_err(listener)
}

/// Prints a line for the person who started the service, which goes on if the line cannot be written.
fn say(line: &str) {
    let _ = output::print(format_args!("{line}\n"));
}

/// Gives an empty service its first job.
async fn begin(service: &Service, unwanted: bool) -> Result<Option<Submitted>, Failure> {
    let failed = |error: String| Failure::failed("serve.sample", error, "Start the service with --no-sample.");
    if unwanted || !service.is_empty().await.map_err(|error| failed(error.to_string()))? {
        return Ok(None);
    }
    let mut bytes = Vec::new();
    write_sample(&mut bytes).map_err(|error| failed(error.to_string()))?;
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
                say(&format!("The model of the built-in sample is ready: curl -O {site}{address}/model.zip"));
                return;
            }
            other => {
                say(&format!(
                    "The job of the built-in sample did not succeed ({}): see {site}{address}",
                    other.unwrap_or("deleted")
                ));
                return;
            }
        }
    }
}

/// Resolves at SIGINT or SIGTERM, and notes when it was `told`. Listens from the call on, so that no signal is missed while starting.
fn stopping(told: Arc<OnceLock<Instant>>) -> Result<impl Future<Output = ()>, Failure> {
    let failed = |error: std::io::Error| {
        Failure::failed("serve.signals", error.to_string(), "Allow this process to install signal handlers.")
    };
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
            StartError::Listen { .. } => {
                ("serve.listen", "Name another address with --listen; port 0 chooses a free port.")
            }
            StartError::NoKeys(_) => (
                "serve.no_keys",
                "Make a key for this database: lampwright keys create --tenant NAME. Or start with --auth on and make a key later, or listen on 127.0.0.1.",
            ),
            StartError::Storage(storage::Error::Unusable(error)) => (error.code(), error.remedy()),
            StartError::Storage(storage::Error::Unsupported(_, remedy)) => ("serve.storage", *remedy),
            StartError::Storage(_) => (
                "serve.storage",
                "Check that the data folder is complete and has free space, and that the servers named by DATABASE_URL and STORAGE_URL answer.",
            ),
            StartError::Threads(_) => ("serve.threads", "Use fewer threads: --threads or --jobs."),
        };
        Failure::failed(code, error.to_string(), remedy)
    }
}
