//! `/v1/jobs`: lists, returns and deletes jobs.

use super::addresses::prefix;
use super::api::Api;
use super::events;
use super::events::Waiting;
use super::extract::{Page, Path, Query, cut};
use super::job::Job;
use super::problem::Problem;
use crate::accounts::access::Access;
use crate::jobs::recent::KnownJob;
use crate::jobs::{Priority, State as JobState, query};
use crate::metadata::Metadata;
use axum::Json;
use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use bytes::Bytes;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

/// Jobs, newest first.
#[derive(Serialize, ToSchema)]
pub struct JobList {
    /// The entries of this page.
    jobs: Vec<Job>,
    /// The value of `after` for the next page; null on the last page.
    #[schema(required)]
    next: Option<String>,
}

/// Lists jobs, newest first
#[utoipa::path(
    get, path = "/v1/jobs", tag = "jobs", operation_id = "list_jobs", params(JobPage),
    responses(
        (status = 200, body = JobList, description = "one page of the list"),
        (status = 422, body = Problem, content_type = "application/problem+json", description = "the query is not valid"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "the service is busy, or the database or the object store does not answer"),
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
        evaluation: page.evaluation,
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
    /// Only evaluations (true), or only jobs that make models (false).
    #[serde(default)]
    evaluation: Option<bool>,
    /// Only jobs whose metadata has all of these keys and values: a JSON object of strings.
    #[param(value_type = Option<String>, example = "{\"order\":\"4711\"}")]
    #[serde(default, deserialize_with = "Metadata::from_text")]
    metadata: Metadata,
    /// The largest number of entries in the answer.
    #[param(minimum = 1, maximum = 100, default = 20)]
    #[serde(default = "Page::default_limit")]
    limit: u32,
    /// The value of `next` in the page before this one.
    #[param(value_type = Option<String>, pattern = "^([0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12})?$")]
    #[serde(default, deserialize_with = "Page::cursor")]
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

/// Returns a job
///
/// Without `wait`, the answer comes at once. With `wait`, it comes when the state of the job changes, or after that many seconds;
/// at once if the job has ended. Ask again until `state` is succeeded, failed or cancelled.
#[utoipa::path(
    get, path = "/v1/jobs/{id}", tag = "jobs", operation_id = "get_job",
    params(("id" = String, Path, description = "the job"), Waiting),
    responses(
        (status = 200, body = Job, description = "the job"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "there is no such job"),
        (status = 422, body = Problem, content_type = "application/problem+json", description = "the query is not valid"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "the service is busy, too many clients wait for jobs, or the database does not answer"),
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
    // By the cache too: an answer that is newer than what others are told would let them go back.
    let now = api.queue.recent().get(&access.tenant, &id).await?.ok_or_else(|| Problem::no_job(&id))?;
    answer(&now)
}

/// The job as it is answered; written once for all who ask while it stays as it is.
fn answer(known: &KnownJob) -> Result<Response, Problem> {
    let body = known.answer(prefix().as_str(), |job| serde_json::to_vec(&Job::from(job.clone())).map(Bytes::from));
    let body = body.map_err(|error| {
        tracing::error!(%error, "cannot write a job as JSON");
        Problem::internal()
    })?;
    Ok(([(header::CONTENT_TYPE, "application/json")], body).into_response())
}

/// Deletes a job and its artifacts
///
/// The ray sets of the job are not deleted.
#[utoipa::path(
    delete, path = "/v1/jobs/{id}", tag = "jobs", operation_id = "delete_job",
    params(("id" = String, Path, description = "the job")),
    responses(
        (status = 204, description = "the job is deleted"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "there is no such job"),
        (status = 409, body = Problem, content_type = "application/problem+json", description = "the job has not ended; cancel it first"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "the database or the object store does not answer"),
    )
)]
pub async fn delete(State(api): State<Api>, access: Access, Path(id): Path<String>) -> Result<StatusCode, Problem> {
    api.queue.delete(&access.tenant, &id).await?;
    Ok(StatusCode::NO_CONTENT)
}
