//! A job as clients see it, in JSON.

use super::addresses::link;
use super::api::Api;
use super::extract::Path;
use super::problem::Problem;
use crate::accounts::access::Access;
use crate::failure::{Failure, StoredNotice};
use crate::jobs::evaluation::JobEvaluation;
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

/// Address of the artifact `name` of a job.
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

/// A job: the computation of one source model, or of one evaluation of a model.
#[derive(Serialize, ToSchema)]
pub struct Job {
    /// Identifier of this object.
    #[schema(format = Uuid)]
    id: String,
    /// State of the job.
    state: JobState,
    /// Fraction of this that is done, 0 to 1.
    #[schema(minimum = 0, maximum = 1)]
    progress: f64,
    /// The stage that the computation is in; null before the first.
    #[schema(required)]
    stage: Option<&'static str>,
    /// The progress of every stage, in order.
    stages: Vec<StageProgress>,
    /// Position in the queue of the tenant, from 1, while the job is queued: by priority, then by age. Tenants take turns.
    #[schema(required)]
    queue_position: Option<u64>,
    /// How often the job was started.
    attempt: u32,
    /// Whether a client asked to cancel the job.
    cancel_requested: bool,
    /// The channels of the source, as the client sent them.
    channels: Vec<Channel>,
    /// Total flux of the source, of which the channels have shares.
    #[schema(required)]
    total: Option<TotalFlux>,
    /// What is evaluated, of an evaluation, which has no channels; null of a job that makes a model.
    #[schema(required)]
    evaluation: Option<JobEvaluation>,
    /// The options of the job, in which null means that the value follows from the rays; null of an evaluation, which has none.
    #[schema(required, value_type = Option<JobOptions>)]
    options: Option<Options>,
    /// Priority of the job among the queued jobs of its tenant.
    priority: Priority,
    /// Longest time that an attempt may take, s; null means the limit of the service.
    #[schema(required)]
    timeout_s: Option<u32>,
    /// The client's own metadata.
    metadata: Metadata,
    /// Expected peak memory of the computation, bytes.
    memory_bytes: u64,
    /// Only in the answer to a request for a new job: true if this is an equal job that existed before.
    #[serde(skip_serializing_if = "Option::is_none")]
    reused: Option<bool>,
    /// Why the job failed; null if it did not.
    #[schema(required)]
    problem: Option<JobProblem>,
    /// Notices about data that was repaired, dropped or unusual, and the warnings of the inspections of its channels. Until
    /// the job has succeeded: only those about its channels together, whose sizes differ by the factor of a unit or whose places do
    /// not overlap.
    notices: Vec<StoredNotice>,
    /// When the job was accepted, epoch ms.
    created_ms: i64,
    /// When the job was last started, epoch ms; null if it was not.
    #[schema(required)]
    started_ms: Option<i64>,
    /// When the job ended, epoch ms.
    #[schema(required)]
    finished_ms: Option<i64>,
    /// Addresses of related objects.
    links: JobLinks,
}

/// Progress of one stage.
#[derive(Serialize, ToSchema)]
pub struct StageProgress {
    /// rays, hull, flux, goniogram, model or artifacts.
    name: &'static str,
    /// Fraction of this that is done, 0 to 1.
    #[schema(minimum = 0, maximum = 1)]
    progress: f64,
}

/// Why a job failed.
#[derive(Serialize, ToSchema)]
pub struct JobProblem {
    /// Stable code: programs may depend on it.
    code: String,
    /// Short title of the kind of failure.
    title: String,
    /// What is wrong in this case.
    detail: String,
    /// Where the problem is: "byte 20", "options.hull.resolution".
    #[schema(required)]
    at: Option<String>,
    /// What the client or the operator can do about it.
    #[schema(required)]
    remedy: Option<String>,
}

impl From<Failure> for JobProblem {
    fn from(Failure { code, title, detail, at, remedy }: Failure) -> JobProblem {
        JobProblem { code, title, detail, at, remedy }
    }
}

/// Addresses that belong to a job.
#[derive(Serialize, ToSchema)]
pub struct JobLinks {
    /// Address of this object.
    #[serde(rename = "self")]
    this: String,
    /// Address to POST to in order to cancel the job; null once the job has ended.
    #[schema(required)]
    cancel: Option<String>,
    /// List of the artifacts; null until the job has succeeded.
    #[schema(required)]
    artifacts: Option<String>,
    /// Zip file of all artifacts; null until the job has succeeded, and of an evaluation.
    #[schema(required)]
    zip: Option<String>,
    /// The ray sets of the channels.
    ray_sets: Vec<String>,
}

impl From<query::Job> for Job {
    fn from(row: query::Job) -> Job {
        let stages = stages(row.stage, row.stage_progress, row.evaluation.is_some());
        let this = link(&format!("/v1/jobs/{}", row.id));
        let succeeded = row.state == JobState::Succeeded;
        Job {
            progress: overall(&stages),
            stage: row.stage.map(Stage::name),
            stages,
            links: JobLinks {
                cancel: (!row.state.ended()).then(|| format!("{this}/cancel")),
                artifacts: succeeded.then(|| format!("{this}/artifacts")),
                zip: (succeeded && row.evaluation.is_none()).then(|| href(&row.id, ZIP)),
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
            options: row.evaluation.is_none().then_some(row.options),
            evaluation: row.evaluation,
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
    /// The job as the answer to the request that would have made it, with the field `reused`.
    #[must_use]
    pub fn reused(self, reused: bool) -> Job {
        Job { reused: Some(reused), ..self }
    }
}

/// Fraction of the whole job that is done, 0 to 1.
pub(super) fn overall(stages: &[StageProgress]) -> f64 {
    if let [only] = stages {
        return only.progress;
    }
    stages.iter().zip(STAGE_WEIGHTS).map(|(stage, weight)| stage.progress * weight).sum::<f64>()
        / STAGE_WEIGHTS.iter().sum::<f64>()
}

/// Every stage's progress, when `within` of the stage `reached` is done; an evaluation has one stage.
pub(super) fn stages(reached: Option<Stage>, within: f64, is_evaluation: bool) -> Vec<StageProgress> {
    if is_evaluation {
        let progress = if reached.is_some() { within } else { 0.0 };
        return vec![StageProgress { name: Stage::Model.name(), progress }];
    }
    let done = |stage: Stage| match reached {
        Some(reached) if stage == reached => within,
        Some(reached) if stage < reached => 1.0,
        _ => 0.0,
    };
    Stage::ALL.into_iter().map(|stage| StageProgress { name: stage.name(), progress: done(stage) }).collect()
}

/// Cancels a job
///
/// A queued job ends at once, a running job within seconds.
#[utoipa::path(
    post, path = "/v1/jobs/{id}/cancel", tag = "jobs", operation_id = "cancel_job",
    params(("id" = String, Path, description = "the job")),
    responses(
        (status = 202, body = Job, description = "the job will be cancelled", headers(
            ("Location" = String, description = "the job"), ("Retry-After" = u64, description = "the seconds to wait before asking for the state of the job"))),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "there is no such job"),
        (status = 409, body = Problem, content_type = "application/problem+json", description = "the job has ended already"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "the database or the object store does not answer"),
    )
)]
pub async fn cancel(State(api): State<Api>, access: Access, Path(id): Path<String>) -> Result<Response, Problem> {
    api.queue.cancel(&access.tenant, &id).await?;
    accepted(&api, &access, &id).await
}

/// The job `id` of the tenant of the request, or 404.
pub async fn find(api: &Api, access: &Access, id: &str) -> Result<query::Job, Problem> {
    let job = query::get(&api.storage.records, &access.tenant, id).await?.ok_or_else(|| Problem::no_job(id))?;
    // The cache must not answer with less than the client of this request is about to learn.
    api.queue.recent().correct(&access.tenant, &job);
    Ok(job)
}

async fn accepted(api: &Api, access: &Access, id: &str) -> Result<Response, Problem> {
    Ok(location(StatusCode::ACCEPTED, find(api, access, id).await?.into()))
}

/// The answer with a job that has not ended: the headers `Location` and `Retry-After`.
pub fn location(status: StatusCode, job: Job) -> Response {
    let headers = [(header::LOCATION, job.links.this.clone()), (header::RETRY_AFTER, "1".to_owned())];
    (status, headers, Json(job)).into_response()
}
