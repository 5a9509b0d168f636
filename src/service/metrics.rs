//! Metrics for Prometheus, which answer "is it stuck?": the only file that names its client. What this process does is counted as
//! it happens; what all processes share (the queue) is read from the database at each request for the metrics.

use pipeline::Stage;
use prometheus_client::encoding::{EncodeLabelSet, text};
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::metrics::histogram::{Histogram, exponential_buckets};
use prometheus_client::registry::Registry;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::AtomicU64;
use std::time::Duration;

/// The two formats in which Prometheus reads metrics.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Exposition {
    /// Prometheus' text format 0.0.4, which every tool reads.
    #[default]
    Text,
    /// OpenMetrics 1.0, for clients that ask for it, as Prometheus does.
    OpenMetrics,
}

impl Exposition {
    /// Media type of the format.
    pub fn media_type(self) -> &'static str {
        match self {
            Exposition::Text => "text/plain; version=0.0.4; charset=utf-8",
            Exposition::OpenMetrics => "application/openmetrics-text; version=1.0.0; charset=utf-8",
        }
    }
}

/// A route, not an address: as many as there are in the contract.
#[derive(Clone, Debug, PartialEq, Eq, Hash, EncodeLabelSet)]
struct Route {
    method: String,
    route: String,
}

#[derive(Clone, Debug, PartialEq, Eq, Hash, EncodeLabelSet)]
struct Answer {
    method: String,
    route: String,
    status: u16,
}

#[derive(Clone, Debug, PartialEq, Eq, Hash, EncodeLabelSet)]
struct InState {
    state: &'static str,
}

#[derive(Clone, Debug, PartialEq, Eq, Hash, EncodeLabelSet)]
struct InStage {
    stage: &'static str,
}

#[derive(Clone, Debug, PartialEq, Eq, Hash, EncodeLabelSet)]
struct Ended {
    ending: &'static str,
}

#[derive(Clone, Debug, PartialEq, Eq, Hash, EncodeLabelSet)]
struct Inspected {
    when: &'static str,
}

#[derive(Clone, Debug, PartialEq, Eq, Hash, EncodeLabelSet)]
struct Build {
    version: &'static str,
}

type Seconds = Gauge<f64, AtomicU64>;

/// All metrics of one process. Cheap to clone.
#[derive(Clone)]
pub struct Metrics(Arc<Numbers>);

struct Numbers {
    registry: Registry,
    requests: Family<Answer, Counter>,
    request_seconds: Family<Route, Histogram, fn() -> Histogram>,
    connections: Gauge,
    uploads: Gauge,
    upload_bytes: Counter,
    inspections: Family<Inspected, Counter>,
    attempts: Family<Ended, Counter>,
    attempt_seconds: Family<Ended, Histogram, fn() -> Histogram>,
    leases_lost: Counter,
    waits_for_memory: Gauge,
    job_memory: Gauge,
    jobs: Family<InState, Gauge>,
    running: Family<InStage, Gauge>,
    oldest_queued: Seconds,
    oldest_running: Seconds,
    overdue: Gauge,
    tenants_waiting: Gauge,
    longest_tenant_queue: Gauge,
    too_large: Gauge,
    free_bytes: Gauge,
    webhook_attempts: Family<Ended, Counter>,
    webhook_backlog: Gauge,
}

/// From 1 ms to half a minute.
fn request_times() -> Histogram {
    Histogram::new(exponential_buckets(0.001, 2.0, 16))
}

/// From 0.1 s to two hours.
fn attempt_times() -> Histogram {
    Histogram::new(exponential_buckets(0.1, 2.0, 17))
}

impl Default for Metrics {
    fn default() -> Metrics {
        Metrics::new()
    }
}

impl Metrics {
    /// Metrics that start at zero.
    pub fn new() -> Metrics {
        let mut numbers = Numbers {
            registry: Registry::with_prefix("lampwright"),
            requests: Family::default(),
            request_seconds: Family::new_with_constructor(request_times),
            connections: Gauge::default(),
            uploads: Gauge::default(),
            upload_bytes: Counter::default(),
            inspections: Family::default(),
            attempts: Family::default(),
            attempt_seconds: Family::new_with_constructor(attempt_times),
            leases_lost: Counter::default(),
            waits_for_memory: Gauge::default(),
            job_memory: Gauge::default(),
            jobs: Family::default(),
            running: Family::default(),
            oldest_queued: Seconds::default(),
            oldest_running: Seconds::default(),
            overdue: Gauge::default(),
            tenants_waiting: Gauge::default(),
            longest_tenant_queue: Gauge::default(),
            too_large: Gauge::default(),
            free_bytes: Gauge::default(),
            webhook_attempts: Family::default(),
            webhook_backlog: Gauge::default(),
        };
        for when in ["arriving", "stored"] {
            numbers.inspections.get_or_create(&Inspected { when }).inc_by(0);
        }
        numbers.register_own();
        numbers.register_shared();
        Metrics(Arc::new(numbers))
    }

    /// Counts an open connection until the returned value is dropped.
    pub fn connection(&self) -> AtHand {
        AtHand::of(&self.0.connections)
    }

    /// Counts a running upload until the returned value is dropped.
    pub fn upload(&self) -> AtHand {
        AtHand::of(&self.0.uploads)
    }

    /// Counts received bytes of an upload.
    pub fn upload_bytes(&self, bytes: u64) {
        self.0.upload_bytes.inc_by(bytes);
    }

    /// The rays of an uploaded file were all read, while it came or after it was stored.
    pub fn inspected(&self, while_it_came: bool) {
        let when = if while_it_came { "arriving" } else { "stored" };
        self.0.inspections.get_or_create(&Inspected { when }).inc();
    }

    /// A request was answered: its body may still be on its way.
    pub fn answered(&self, method: &str, route: &str, status: u16, took: Duration) {
        let (method, route) = (method.to_owned(), route.to_owned());
        let seconds =
            self.0.request_seconds.get_or_create_owned(&Route { method: method.clone(), route: route.clone() });
        seconds.observe(took.as_secs_f64());
        self.0.requests.get_or_create(&Answer { method, route, status }).inc();
    }

    /// Counts an attempt at a job by its ending and duration.
    pub fn attempted(&self, ending: &'static str, took: Duration) {
        self.0.attempts.get_or_create(&Ended { ending }).inc();
        self.0.attempt_seconds.get_or_create(&Ended { ending }).observe(took.as_secs_f64());
    }

    /// Counts jobs whose worker lost its lease.
    pub fn leases_lost(&self, jobs: u64) {
        self.0.leases_lost.inc_by(jobs);
    }

    /// Notes whether the next job of the queue waits for memory.
    pub fn waits_for_memory(&self, waits: bool) {
        self.0.waits_for_memory.set(i64::from(waits));
    }

    /// Changes the memory that is reserved for running jobs by this many bytes.
    pub fn job_memory(&self, more_bytes: i64) {
        self.0.job_memory.inc_by(more_bytes);
    }

    /// Counts an attempt to deliver a webhook event, by whether it was accepted.
    pub fn webhook_attempted(&self, taken: bool) {
        let ending = if taken { "delivered" } else { "failed" };
        self.0.webhook_attempts.get_or_create(&Ended { ending }).inc();
    }

    /// All metrics as text, in the format that Prometheus asked for.
    pub fn text(&self, exposition: Exposition, backlog: &Backlog, free_bytes: Option<u64>) -> String {
        self.0.look(backlog, free_bytes);
        let mut text = String::new();
        // Writing to a string does not fail.
        let _ = text::encode(&mut text, &self.0.registry);
        match exposition {
            Exposition::OpenMetrics => text,
            Exposition::Text => plain(&text),
        }
    }
}

impl Numbers {
    /// What this process did.
    fn register_own(&mut self) {
        let build = Family::<Build, Gauge>::default();
        build.get_or_create(&Build { version: env!("CARGO_PKG_VERSION") }).set(1);
        let registry = &mut self.registry;
        registry.register("build", "1, with the version as a label", build);
        registry.register("requests", "Requests answered, by route and status", self.requests.clone());
        let help = "Seconds until the answer to a request began, by route";
        registry.register("request_seconds", help, self.request_seconds.clone());
        registry.register("connections", "Open connections", self.connections.clone());
        registry.register("uploads", "Uploads that are running", self.uploads.clone());
        registry.register("upload_bytes", "Bytes received by uploads", self.upload_bytes.clone());
        let help = "Uploaded files whose rays were all read, by when: while the file arrived, or after it was stored";
        registry.register("inspections", help, self.inspections.clone());
        let help = "Ended attempts of this process at jobs, by their ending; jobs of the endings put back and lost are tried again";
        registry.register("job_attempts", help, self.attempts.clone());
        let help = "Duration of attempts at jobs in seconds, by their ending";
        registry.register("job_attempt_seconds", help, self.attempt_seconds.clone());
        let help = "Jobs that this process put back into the queue because their worker lost its lease";
        registry.register("leases_lost", help, self.leases_lost.clone());
        let help = "1 while the next job of the queue waits for memory of this process";
        registry.register("waits_for_memory", help, self.waits_for_memory.clone());
        let help = "Expected memory of the jobs that this process computes, bytes";
        registry.register("job_memory_bytes", help, self.job_memory.clone());
        let help = "Attempts of this process to deliver a webhook event, by their ending";
        registry.register("webhook_attempts", help, self.webhook_attempts.clone());
    }

    /// What all processes share.
    fn register_shared(&mut self) {
        let registry = &mut self.registry;
        registry.register("jobs", "Unfinished jobs, by state", self.jobs.clone());
        registry.register("running_jobs", "Running jobs, by stage", self.running.clone());
        let help = "Age of the oldest queued job in seconds; it grows when the queue is stuck";
        registry.register("oldest_queued_seconds", help, self.oldest_queued.clone());
        let help = "Time in seconds that the oldest running job has run";
        registry.register("oldest_running_seconds", help, self.oldest_running.clone());
        let help = "Running jobs whose worker has not renewed its lease in time";
        registry.register("overdue_jobs", help, self.overdue.clone());
        registry.register("waiting_tenants", "Tenants with queued jobs", self.tenants_waiting.clone());
        let help = "Queued jobs of the tenant that has most of them";
        registry.register("longest_tenant_queue", help, self.longest_tenant_queue.clone());
        let help = "Queued jobs that need more memory than this process has and that it therefore never starts";
        registry.register("jobs_too_large", help, self.too_large.clone());
        let help =
            "Webhook deliveries that wait for their next attempt; the number grows when receivers accept nothing";
        registry.register("webhook_backlog", help, self.webhook_backlog.clone());
        registry.register("free_bytes", "Free bytes on the fullest local disk; -1 if unknown", self.free_bytes.clone());
    }

    fn look(&self, backlog: &Backlog, free_bytes: Option<u64>) {
        let running = backlog.running.values().sum::<u64>();
        for (state, count) in [("queued", backlog.queued), ("running", running)] {
            self.jobs.get_or_create(&InState { state }).set(count.cast_signed());
        }
        for stage in std::iter::once("none").chain(Stage::ALL.map(Stage::name)) {
            let count = backlog.running.get(stage).copied().unwrap_or(0);
            self.running.get_or_create(&InStage { stage }).set(count.cast_signed());
        }
        self.oldest_queued.set(backlog.oldest_queued.as_secs_f64());
        self.oldest_running.set(backlog.oldest_running.as_secs_f64());
        self.overdue.set(backlog.overdue.cast_signed());
        self.tenants_waiting.set(backlog.tenants_waiting.cast_signed());
        self.longest_tenant_queue.set(backlog.longest_tenant_queue.cast_signed());
        self.too_large.set(backlog.too_large.cast_signed());
        self.webhook_backlog.set(backlog.deliveries.cast_signed());
        self.free_bytes.set(free_bytes.map_or(-1, |bytes| i64::try_from(bytes).unwrap_or(i64::MAX)));
    }
}

/// OpenMetrics as text format 0.0.4, which the library does not write. Our numbers differ in this only: OpenMetrics describes a
/// counter without the `_total` of its samples, says units in lines of their own, and marks its end.
fn plain(openmetrics: &str) -> String {
    let typed = openmetrics.lines().filter_map(|line| line.strip_prefix("# TYPE ")?.strip_suffix(" counter"));
    let counters: Vec<&str> = typed.collect();
    let mut plain = String::with_capacity(openmetrics.len() + 64);
    for line in openmetrics.lines().filter(|line| *line != "# EOF" && !line.starts_with("# UNIT ")) {
        let described = ["# HELP ", "# TYPE "].into_iter().find_map(|mark| Some((mark, line.strip_prefix(mark)?)));
        let words = described.and_then(|(mark, rest)| Some((mark, rest.split_once(' ')?)));
        match words {
            Some((mark, (name, rest))) if counters.contains(&name) => {
                plain.extend([mark, name, "_total ", rest, "\n"]);
            }
            _ => plain.extend([line, "\n"]),
        }
    }
    plain
}

/// Counts something in a gauge until this value is dropped.
pub struct AtHand(Gauge);

impl AtHand {
    fn of(gauge: &Gauge) -> AtHand {
        gauge.inc();
        AtHand(gauge.clone())
    }
}

impl Drop for AtHand {
    fn drop(&mut self) {
        self.0.dec();
    }
}

/// Queued and running jobs and waiting deliveries of all processes together.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Backlog {
    /// Number of queued jobs.
    pub queued: u64,
    /// Running jobs by the stage they are in, "none" before the first.
    pub running: BTreeMap<String, u64>,
    /// How long the oldest queued job has waited.
    pub oldest_queued: Duration,
    /// How long the oldest running job has run.
    pub oldest_running: Duration,
    /// Number of running jobs whose lease has ended.
    pub overdue: u64,
    /// Number of tenants with queued jobs.
    pub tenants_waiting: u64,
    /// Number of queued jobs that need more memory than this process has; [`backlog`] does not count them.
    pub too_large: u64,
    /// Number of queued jobs of the tenant that has most of them.
    pub longest_tenant_queue: u64,
    /// Number of webhook deliveries that wait.
    pub deliveries: u64,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The numbers of a process that has done something of everything.
    fn numbers() -> Metrics {
        let metrics = Metrics::new();
        metrics.answered("GET", "/v1/jobs", 200, Duration::from_millis(3));
        metrics.upload_bytes(7);
        metrics.attempted("succeeded", Duration::from_secs(2));
        metrics.leases_lost(1);
        metrics.webhook_attempted(true);
        metrics
    }

    /// The rules of `promtool check metrics` (prometheus/client_golang, `testutil/promlint`), as far as they can be broken here.
    #[test]
    fn the_text_format_keeps_the_rules_of_promlint() {
        let text = numbers().text(Exposition::Text, &Backlog::default(), Some(1));
        let described = |mark: &str| -> Vec<(String, String)> {
            let lines = text.lines().filter_map(|line| line.strip_prefix(mark)?.split_once(' '));
            lines.map(|(name, rest)| (name.to_owned(), rest.to_owned())).collect()
        };
        let (helps, types) = (described("# HELP "), described("# TYPE "));
        assert!(types.len() > 20 && !text.contains("# EOF"), "{text}");
        for sample in text.lines().filter(|line| !line.starts_with('#')) {
            let name = sample.split(['{', ' ']).next().unwrap();
            let family = types.iter().find(|(family, kind)| match kind.as_str() {
                "histogram" => {
                    name.strip_prefix(family.as_str()).is_some_and(|rest| ["_bucket", "_sum", "_count"].contains(&rest))
                }
                _ => name == family,
            });
            let (family, kind) = family.unwrap_or_else(|| panic!("{name} has no type"));
            let help = helps.iter().find(|(name, _)| name == family).map_or("", |(_, help)| help);
            assert!(!help.is_empty(), "{family} has no help");
            assert_eq!(family.ends_with("_total"), kind == "counter", "{family}: counters and only they end in _total");
            assert!(!["_count", "_sum", "_bucket", "_info"].iter().any(|end| family.ends_with(end)), "{family}");
            assert!(family.bytes().all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'_'), "{family}");
            assert!(!["gauge", "counter", "histogram"].iter().any(|kind| family.contains(kind)), "{family}");
            for other in ["milliseconds", "minutes", "hours", "kilobytes", "megabytes", "_ms", "_kb", "_mb", "percent"]
            {
                assert!(!family.contains(other), "{family} is not in a base unit");
            }
        }
    }

    #[test]
    fn openmetrics_describes_counters_without_their_total() {
        let text = numbers().text(Exposition::OpenMetrics, &Backlog::default(), None);
        assert!(text.contains("# TYPE lampwright_upload_bytes counter\nlampwright_upload_bytes_total 7\n"), "{text}");
        assert!(text.ends_with("# EOF\n"));
    }
}
