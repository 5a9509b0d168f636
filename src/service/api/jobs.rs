//! `/v1/jobs`: what is to be computed, how far it is, and why it failed.

use super::super::access::Access;
use super::super::jobs::channels::{Channel, TotalFlux};
use super::super::jobs::options::JobOptions;
use super::super::jobs::recent::Known;
use super::super::jobs::{Failure, Priority, State as JobState, StoredNotice, query};
use super::super::metadata::Metadata;
use super::Api;
use super::addresses::{link, prefix};
use super::artifacts::href;
use super::events::{self, Waiting};
use super::extract::{Page, Path, Query, cut};
use super::problem::Problem;
use crate::pipeline::Stage;
use axum::Json;
use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use bytes::Bytes;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

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
    options: JobOptions,
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

/// Jobs, newest first.
#[derive(Serialize, ToSchema)]
pub struct JobList {
    /// One page of them.
    jobs: Vec<Job>,
    /// The `after` of the next page; null on the last.
    #[schema(required)]
    next: Option<String>,
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
                zip: succeeded.then(|| href(&row.id, super::super::jobs::worker::ZIP)),
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

/// Lists jobs, newest first
#[utoipa::path(
    get, path = "/v1/jobs", tag = "jobs", operation_id = "list_jobs", params(JobPage),
    responses(
        (status = 200, body = JobList, description = "one page"),
        (status = 422, body = Problem, content_type = "application/problem+json", description = "an unusable query"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "busy, or a store that does not answer"),
    )
)]
pub async fn list(
    State(api): State<Api>,
    access: Access,
    Query(page): Query<JobPage>,
) -> Result<Json<JobList>, Problem> {
    let limit = Page::limit(page.limit)?;
    let after = page.after.as_deref();
    let filter = query::Filter {
        states: page.state,
        ray_set: page.ray_set.map(|id| id.to_string()),
        priority: page.priority,
        created_after_ms: page.created_after_ms,
        created_before_ms: page.created_before_ms,
        metadata: page.metadata,
    };
    let rows = query::list(&api.storage.records, &access.tenant, &filter, after, limit as i64 + 1).await?;
    let (rows, next) = cut(rows, limit, |row| &row.id);
    Ok(Json(JobList { jobs: rows.into_iter().map(Job::from).collect(), next }))
}

/// A page of the list of jobs.
#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct JobPage {
    /// Only jobs in these states, separated by commas.
    #[param(style = Form, explode = false, min_items = 1)]
    #[serde(default, deserialize_with = "separated")]
    state: Vec<JobState>,
    /// Only jobs with this ray set among their channels.
    ray_set: Option<Uuid>,
    /// Only jobs of this priority.
    priority: Option<Priority>,
    /// Only jobs accepted later than this, epoch ms.
    #[param(minimum = 0)]
    #[serde(default, deserialize_with = "moment")]
    created_after_ms: Option<i64>,
    /// Only jobs accepted earlier than this, epoch ms.
    #[param(minimum = 0)]
    #[serde(default, deserialize_with = "moment")]
    created_before_ms: Option<i64>,
    /// Only jobs whose metadata has all of these keys and values: a JSON object of texts.
    #[param(value_type = Option<String>, example = "{\"order\":\"4711\"}")]
    #[serde(default, deserialize_with = "Metadata::from_text")]
    metadata: Metadata,
    /// Most entries to answer.
    #[param(minimum = 1, maximum = 100, default = 20)]
    #[serde(default = "Page::default_limit")]
    limit: u32,
    /// The `next` of the page before.
    after: Option<String>,
}

/// Words between commas.
fn separated<'de, D: Deserializer<'de>>(text: D) -> Result<Vec<JobState>, D::Error> {
    let words = String::deserialize(text)?;
    let state = |word: &str| {
        JobState::parse(word).ok_or_else(|| {
            let known = JobState::ALL.map(JobState::name).join(", ");
            D::Error::custom(format!("unknown state `{word}`, expected one of {known}"))
        })
    };
    words.split(',').map(state).collect()
}

/// Time since 1970 is not negative.
fn moment<'de, D: Deserializer<'de>>(number: D) -> Result<Option<i64>, D::Error> {
    let ms = u64::deserialize(number)?;
    i64::try_from(ms).map(Some).map_err(D::Error::custom)
}

/// Tells of a job
///
/// At once, or, with `wait`, when its state is another than now, when it has ended already, or when so many seconds are over:
/// ask again until `state` is succeeded, failed or cancelled.
#[utoipa::path(
    get, path = "/v1/jobs/{id}", tag = "jobs", operation_id = "get_job",
    params(("id" = String, Path, description = "the job"), Waiting),
    responses(
        (status = 200, body = Job, description = "what is known of it"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "there is none"),
        (status = 422, body = Problem, content_type = "application/problem+json", description = "an unusable query"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "busy, too many clients that wait, or a store that does not answer"),
    )
)]
pub async fn get(
    State(api): State<Api>,
    access: Access,
    Path(id): Path<String>,
    Query(waiting): Query<Waiting>,
) -> Result<Response, Problem> {
    let wait = waiting.longest()?;
    let known = api.queue.recent().get(&access.tenant, &id).await?.ok_or_else(|| Problem::no_job(&id))?;
    if wait.is_zero() || known.job.state.ended() {
        return answer(&known);
    }
    events::changed(&api, &access, &known.job, wait).await?;
    answer(&Known::new(find(&api, &access, &id).await?))
}

/// The job as it is answered; written once for all who ask while it stays as it is.
fn answer(known: &Known) -> Result<Response, Problem> {
    let body = known.answer(prefix().as_str(), |job| serde_json::to_vec(&Job::from(job.clone())).map(Bytes::from));
    let body = body.map_err(|error| {
        tracing::error!(%error, "a job cannot be written");
        Problem::internal()
    })?;
    Ok(([(header::CONTENT_TYPE, "application/json")], body).into_response())
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

/// Deletes a job and its artifacts
///
/// Its ray sets stay.
#[utoipa::path(
    delete, path = "/v1/jobs/{id}", tag = "jobs", operation_id = "delete_job",
    params(("id" = String, Path, description = "the job")),
    responses(
        (status = 204, description = "gone"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "there is none"),
        (status = 409, body = Problem, content_type = "application/problem+json", description = "it has not ended"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "a store that does not answer"),
    )
)]
pub async fn delete(State(api): State<Api>, access: Access, Path(id): Path<String>) -> Result<StatusCode, Problem> {
    api.queue.delete(&access.tenant, &id).await?;
    Ok(StatusCode::NO_CONTENT)
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
