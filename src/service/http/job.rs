//! A job as its clients see it.

use super::addresses::link;
use super::api::Api;
use super::extract::Path;
use super::problem::Problem;
use crate::accounts::access::Access;
use crate::failure::{Failure, StoredNotice};
use crate::jobs::options::JobOptions;
use crate::jobs::request::{Channel, TotalFlux};
use crate::jobs::{Priority, State as JobState, ZIP, query};
use crate::metadata::Metadata;
use axum::Json;
use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use pipeline::Options;
use pipeline::Stage;
use serde::Serialize;
use utoipa::ToSchema;

/// Where the artifact `name` of a job is.
pub fn href(job: &str, name: &str) -> String {
    if name == ZIP {
        return link(&format!("/v1/jobs/{job}/{ZIP}"));
    }
    let mut href = link(&format!("/v1/jobs/{job}/artifacts/"));
    for byte in name.bytes() {
        match byte {
            b'A'..=b'Z' | b'a'..=b'z' | b'0'..=b'9' | b'-' | b'.' | b'_' | b'~' | b'/' => href.push(byte.into()),
            _ => href.push_str(&format!("%{byte:02X}")),
        }
    }
    href
}

/// Share of the whole each stage stands for, in the order of [`Stage::ALL`], per cent: by how often it reads the rays (once,
/// once, once with tracing, once with spectra). Only progress bars depend on it.
const STAGE_WEIGHTS: [f64; 6] = [20.0, 15.0, 30.0, 30.0, 2.0, 3.0];

/// A job.
#[derive(Serialize, ToSchema)]
pub struct Job {
    /// Its identifier.
    #[schema(format = Uuid)]
    id: String,
    /// Where it is.
    state: JobState,
    /// How much of it is done, 0 to 1.
    #[schema(minimum = 0, maximum = 1)]
    progress: f64,
    /// The stage it is in; null before the first.
    #[schema(required)]
    stage: Option<&'static str>,
    /// Every stage, in order.
    stages: Vec<StageProgress>,
    /// Place in the line from 1, while queued: its tenant's own jobs by priority, then age. Tenants take turns.
    #[schema(required)]
    queue_position: Option<u64>,
    /// How often it was begun.
    attempt: u32,
    /// Somebody asked to cancel it.
    cancel_requested: bool,
    /// The channels of its source, as sent.
    channels: Vec<Channel>,
    /// Total flux of its source, of which the channels have shares.
    #[schema(required)]
    total: Option<TotalFlux>,
    /// What was chosen; null means from the rays.
    #[schema(value_type = JobOptions)]
    options: Options,
    /// Before which of its tenant's other jobs it comes.
    priority: Priority,
    /// Longest that an attempt may take, s; null is the service's own limit.
    #[schema(required)]
    timeout_s: Option<u32>,
    /// The client's own keys and values.
    metadata: Metadata,
    /// Most memory that computing it is expected to need, bytes.
    memory_bytes: u64,
    /// Only in the answer to a request that would have made a job: true when this one was there before.
    #[serde(skip_serializing_if = "Option::is_none")]
    reused: Option<bool>,
    /// Why it failed, if it did.
    #[schema(required)]
    problem: Option<JobProblem>,
    /// What was repaired, dropped or odd, and what an inspection of each channel warns of, once it has succeeded.
    notices: Vec<StoredNotice>,
    /// When it was accepted, epoch ms.
    created_ms: i64,
    /// When it was last begun, epoch ms.
    #[schema(required)]
    started_ms: Option<i64>,
    /// When it ended, epoch ms.
    #[schema(required)]
    finished_ms: Option<i64>,
    /// Where things are.
    links: JobLinks,
}

/// One stage's progress.
#[derive(Serialize, ToSchema)]
pub struct StageProgress {
    /// rays, hull, flux, goniogram, model or artifacts.
    name: &'static str,
    /// How much of it is done, 0 to 1.
    #[schema(minimum = 0, maximum = 1)]
    progress: f64,
}

/// Why a job failed.
#[derive(Serialize, ToSchema)]
pub struct JobProblem {
    /// Stable: programs may depend on it.
    code: String,
    /// The kind of failure, for a person.
    title: String,
    /// What was found.
    detail: String,
    /// Where: "byte 20", "options.hull.resolution".
    #[schema(required)]
    at: Option<String>,
    /// What to do.
    #[schema(required)]
    remedy: Option<String>,
}

impl From<Failure> for JobProblem {
    fn from(Failure { code, title, detail, at, remedy }: Failure) -> JobProblem {
        JobProblem { code, title, detail, at, remedy }
    }
}

/// Where a job's things are.
#[derive(Serialize, ToSchema)]
pub struct JobLinks {
    /// Itself.
    #[serde(rename = "self")]
    this: String,
    /// POST here to cancel; null once it has ended.
    #[schema(required)]
    cancel: Option<String>,
    /// The list of its artifacts; null until it has succeeded.
    #[schema(required)]
    artifacts: Option<String>,
    /// All of them in one zip; null until it has succeeded.
    #[schema(required)]
    zip: Option<String>,
    /// Its ray sets.
    ray_sets: Vec<String>,
}

impl From<query::Job> for Job {
    fn from(row: query::Job) -> Job {
        let stages = stages(row.stage, row.stage_progress);
        let this = link(&format!("/v1/jobs/{}", row.id));
        let succeeded = row.state == JobState::Succeeded;
        Job {
            progress: overall(&stages),
            stage: row.stage.map(Stage::name),
            stages,
            links: JobLinks {
                cancel: (!row.state.ended()).then(|| format!("{this}/cancel")),
                artifacts: succeeded.then(|| format!("{this}/artifacts")),
                zip: succeeded.then(|| href(&row.id, ZIP)),
                ray_sets: row.channels.iter().map(|set| link(&format!("/v1/ray-sets/{}", set.ray_set))).collect(),
                this,
            },
            id: row.id,
            state: row.state,
            queue_position: row.queue_position,
            attempt: row.attempt,
            cancel_requested: row.cancel_requested,
            channels: row.channels,
            total: row.total,
            options: row.options,
            priority: row.priority,
            timeout_s: row.timeout_s,
            metadata: row.metadata,
            memory_bytes: row.memory_bytes,
            reused: None,
            problem: row.failure.map(JobProblem::from),
            notices: row.notices,
            created_ms: row.created_ms,
            started_ms: row.started_ms,
            finished_ms: row.finished_ms,
        }
    }
}

impl Job {
    /// As the answer to a request that would have made it.
    #[must_use]
    pub fn reused(self, reused: bool) -> Job {
        Job { reused: Some(reused), ..self }
    }
}

/// How much of the whole is done, 0 to 1.
pub(super) fn overall(stages: &[StageProgress]) -> f64 {
    stages.iter().zip(STAGE_WEIGHTS).map(|(stage, weight)| stage.progress * weight).sum::<f64>()
        / STAGE_WEIGHTS.iter().sum::<f64>()
}

/// Every stage's progress, when `within` of the stage `reached` is done.
pub(super) fn stages(reached: Option<Stage>, within: f64) -> Vec<StageProgress> {
    let done = |stage: Stage| match reached {
        Some(reached) if stage == reached => within,
        Some(reached) if stage < reached => 1.0,
        _ => 0.0,
    };
    Stage::ALL.into_iter().map(|stage| StageProgress { name: stage.name(), progress: done(stage) }).collect()
}

/// Cancels a job
///
/// A queued job ends at once, a running one within seconds.
#[utoipa::path(
    post, path = "/v1/jobs/{id}/cancel", tag = "jobs", operation_id = "cancel_job",
    params(("id" = String, Path, description = "the job")),
    responses(
        (status = 202, body = Job, description = "it will be", headers(
            ("Location" = String, description = "the job"), ("Retry-After" = u64, description = "when to look, s"))),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "there is none"),
        (status = 409, body = Problem, content_type = "application/problem+json", description = "it has ended"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "a store that does not answer"),
    )
)]
pub async fn cancel(State(api): State<Api>, access: Access, Path(id): Path<String>) -> Result<Response, Problem> {
    api.queue.cancel(&access.tenant, &id).await?;
    accepted(&api, &access, &id).await
}

/// The job `id` of whoever asks, or 404.
pub async fn find(api: &Api, access: &Access, id: &str) -> Result<query::Job, Problem> {
    query::get(&api.storage.records, &access.tenant, id).await?.ok_or_else(|| Problem::no_job(id))
}

async fn accepted(api: &Api, access: &Access, id: &str) -> Result<Response, Problem> {
    Ok(location(StatusCode::ACCEPTED, find(api, access, id).await?.into()))
}

/// A job that is to be asked for again.
pub fn location(status: StatusCode, job: Job) -> Response {
    let headers = [(header::LOCATION, job.links.this.clone()), (header::RETRY_AFTER, "1".to_owned())];
    (status, headers, Json(job)).into_response()
}
