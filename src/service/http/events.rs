//! How clients wait for a job: a long poll, and a stream of server-sent events.

use super::addresses;
use super::api::Api;
use super::extract::Path;
use super::job::{Job, find, overall, stages};
use super::problem::Problem;
use crate::accounts::access::Access;
use crate::forwarded::Prefix;
use crate::jobs::query::JobStatus;
use crate::jobs::watcher::Watching;
use crate::jobs::{State as JobState, query};
use axum::extract::State;
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header};
use axum::response::sse::{Event, KeepAlive, Sse};
use axum::response::{IntoResponse, Response};
use futures::{Stream, stream};
use pipeline::Stage;
use serde::{Deserialize, Serialize};
use std::convert::Infallible;
use std::pin::Pin;
use std::time::Duration;
use tokio::time::{Sleep, sleep};
use utoipa::ToSchema;

/// Longest wait, s: what stands between a client and this service rarely lets a connection rest for longer.
const MAX_WAIT_S: u32 = 60;
/// A stream without news sends a comment this often, so that no proxy takes its connection for dead.
const KEEP_ALIVE: Duration = Duration::from_secs(15);
/// When a client whose stream broke asks again.
const RETRY: Duration = Duration::from_secs(2);
/// Longest stream; then the client asks again, with a key that still has to open something.
const LONGEST: Duration = Duration::from_hours(1);
/// The id of the last event of a stream: a client that has received it is answered with 204.
const ENDED: &str = "ended";

/// The query parameter of a long poll: how long to wait for a change.
#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct Waiting {
    /// Answer when the state of the job changes, or after this many seconds.
    #[param(minimum = 0, maximum = 60, default = 0)]
    #[serde(default)]
    wait: u32,
}

impl Waiting {
    /// Whether the request does not wait.
    pub fn is_none(&self) -> bool {
        self.wait == 0
    }

    /// The longest wait that was asked for.
    ///
    /// # Errors
    /// [`Problem`]: out of range.
    pub fn longest(&self) -> Result<Duration, Problem> {
        match self.wait {
            0..=MAX_WAIT_S => Ok(Duration::from_secs(self.wait.into())),
            _ => Err(Problem::out_of_range("wait", "a whole number of seconds from 0 to 60")),
        }
    }
}

/// Resolves when the state of `job` is another, after `wait`, or when the service stops.
///
/// # Errors
/// Too many clients wait.
pub async fn changed(api: &Api, access: &Access, job: &query::Job, wait: Duration) -> Result<(), Problem> {
    let mut watching = watch(api, access, job)?;
    let change = async { while watching.next().await.is_some_and(|now| now.state == job.state) {} };
    tokio::select! {
        () = change => {}
        () = sleep(wait) => {}
        () = api.draining.cancelled() => {}
    }
    Ok(())
}

fn watch(api: &Api, access: &Access, job: &query::Job) -> Result<Watching, Problem> {
    api.watcher.watch(&access.tenant, &job.id, JobStatus::from(job)).ok_or_else(Problem::busy)
}

/// Progress of a job: the data of the event `progress`.
#[derive(Serialize, ToSchema)]
pub struct JobProgress {
    /// State of the job.
    state: JobState,
    /// How often the job was started.
    attempt: u32,
    /// The stage that the computation is in; null before the first.
    #[schema(required)]
    stage: Option<&'static str>,
    /// Fraction of that stage that is done, 0 to 1.
    #[schema(minimum = 0, maximum = 1)]
    fraction: f64,
    /// Fraction of the whole job that is done, 0 to 1.
    #[schema(minimum = 0, maximum = 1)]
    progress: f64,
    /// Position in the queue from 1, while the job is queued.
    #[schema(required)]
    queue_position: Option<u64>,
}

impl From<JobStatus> for JobProgress {
    fn from(status: JobStatus) -> JobProgress {
        let JobStatus { state, attempt, stage, stage_progress, queue_position, is_evaluation } = status;
        JobProgress {
            state,
            attempt,
            stage: stage.map(Stage::name),
            fraction: stage_progress,
            progress: overall(&stages(stage, stage_progress, is_evaluation)),
            queue_position,
        }
    }
}

/// The fields of one event of the stream.
#[derive(ToSchema)]
#[expect(dead_code, reason = "says what is written as text")]
struct JobEvent {
    /// `progress`, `ended` or `gone`.
    event: String,
    /// Value to send as `Last-Event-ID` when the connection is lost after this event.
    id: String,
    /// JSON: JobProgress, Job or Problem.
    data: String,
}

/// Streams the progress of a job
///
/// The answer is a stream of server-sent events: `progress` (data: JobProgress) at once and whenever the progress changes; the
/// last event is `ended` (data: Job), or `gone` (data: Problem) if the job was deleted. A client that connects again gets the
/// present state; if its `Last-Event-ID` is that of the last event, the answer is 204.
#[utoipa::path(
    get, path = "/v1/jobs/{id}/events", tag = "jobs", operation_id = "watch_job",
    params(
        ("id" = String, Path, description = "the job"),
        ("Last-Event-ID" = Option<String>, Header, description = "the id of the last event that the client received before the connection was lost"),
    ),
    responses(
        (status = 200, body = JobEvent, content_type = "text/event-stream", description = "the events"),
        (status = 204, description = "the client has received the last event; there are no more"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "there is no such job"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "too many clients wait for jobs, the service is stopping, or the database does not answer"),
    )
)]
pub async fn events(
    State(api): State<Api>,
    access: Access,
    Path(id): Path<String>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let job = find(&api, &access, &id).await?;
    let seen_all = headers.get("last-event-id").is_some_and(|last| last == ENDED);
    if job.state.ended() && seen_all {
        return Ok(StatusCode::NO_CONTENT.into_response());
    }
    if api.draining.is_cancelled() {
        return Err(Problem::draining());
    }
    let watching = watch(&api, &access, &job)?;
    let first = Some(JobStatus::from(&job));
    let (prefix, longest) = (addresses::prefix(), Box::pin(sleep(LONGEST)));
    let telling = Telling { api, access, id, prefix, watching, first, over: false, longest };
    let mut response = Sse::new(telling.stream()).keep_alive(KeepAlive::new().interval(KEEP_ALIVE)).into_response();
    let headers = response.headers_mut();
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    // Proxies of nginx' kind collect an answer before they pass it on, unless this header forbids it.
    headers.insert(HeaderName::from_static("x-accel-buffering"), HeaderValue::from_static("no"));
    Ok(response)
}

/// One stream of events.
struct Telling {
    api: Api,
    access: Access,
    id: String,
    /// What its links begin with.
    prefix: Prefix,
    watching: Watching,
    /// The status that is sent before any change.
    first: Option<JobStatus>,
    over: bool,
    longest: Pin<Box<Sleep>>,
}

impl Telling {
    fn stream(self) -> impl Stream<Item = Result<Event, Infallible>> {
        stream::unfold(self, async |mut telling| Some((Ok(telling.next().await?), telling)))
    }

    /// The next event; `None` after the last, when the service stops, and when the stream has lasted long enough.
    async fn next(&mut self) -> Option<Event> {
        if self.over {
            return None;
        }
        let status = match self.first.take() {
            Some(first) => Some(first),
            None => tokio::select! {
                status = self.watching.next() => status,
                () = self.api.draining.cancelled() => return None,
                () = &mut self.longest => return None,
            },
        };
        match status {
            Some(status) if !status.state.ended() => progress(status),
            _ => self.last().await,
        }
    }

    /// The last event: the whole job, or that it is gone.
    async fn last(&mut self) -> Option<Event> {
        self.over = true;
        match find(&self.api, &self.access, &self.id).await {
            Ok(job) => self.ended(job).await,
            Err(problem) if problem.status == 404 => Event::default().event("gone").id(ENDED).json_data(problem).ok(),
            // The client asks again, and a store that answers by then has it.
            Err(_) => None,
        }
    }

    /// The whole job, with links as the client that asked for the stream writes them.
    async fn ended(&self, job: query::Job) -> Option<Event> {
        let job = addresses::within(self.prefix.clone(), async { Job::from(job) }).await;
        Event::default().event("ended").id(ENDED).json_data(job).ok()
    }
}

fn progress(status: JobStatus) -> Option<Event> {
    let stage = status.stage.map_or("none", Stage::name);
    let id = format!("{}.{}.{stage}.{:.4}", status.attempt, status.state.name(), status.stage_progress);
    Event::default().event("progress").id(id).retry(RETRY).json_data(JobProgress::from(status)).ok()
}
