//! `POST /v1/jobs`: submits a job, repeats a submission, or estimates a job.

use super::api::Api;
use super::extract::{Body, Query};
use super::job::{Job, find, location};
use super::problem::Problem;
use super::upload_request::MAX_NAME_CHARS;
use crate::accounts::access::Access;
use crate::failure::StoredNotice;
use crate::jobs::estimate::JobPlan;
use crate::jobs::query;
use crate::jobs::request::NewJob;
use crate::jobs::submit::{Keyed, Queued};
use axum::Json;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Most channels of one source.
const MAX_CHANNELS: usize = 8;
/// Longest key.
const MAX_KEY_CHARS: usize = 255;
/// The header that names a request, so that it can be repeated.
const IDEMPOTENCY_KEY: &str = "idempotency-key";

/// Estimate of a job.
#[derive(Serialize, ToSchema)]
pub struct JobEstimate {
    /// Number of rays in all files together, as their headers say.
    ray_count: u64,
    /// Length of all ray files together, bytes.
    byte_count: u64,
    /// Expected peak memory of the computation, bytes.
    memory_bytes: u64,
    /// Memory that all jobs of one process may use together, bytes.
    memory_limit_bytes: u64,
    /// Whether the job fits into the memory of the service; if not, it would be refused with `job.too_large`.
    fits: bool,
    /// Identifier of the equal job that the request would be answered with; null if there is none, or if `reuse` is false.
    #[schema(required, format = Uuid)]
    reuses: Option<String>,
    /// Expected time of the computation, s, judged by the latest jobs of the service; null if there were none.
    #[schema(required)]
    seconds: Option<f64>,
    /// Number of queued jobs of the tenant that come before this one.
    jobs_ahead: u64,
    /// What the channels are told of together: sizes that differ by the factor of a unit, places that do not overlap.
    notices: Vec<StoredNotice>,
}

/// An existing job or an estimate: the body of the answer with status 200.
#[derive(Serialize, ToSchema)]
#[serde(untagged)]
pub enum JobOrEstimate {
    /// An equal job that existed before.
    Job(Box<Job>),
    /// The estimate of a job.
    Estimate(JobEstimate),
}

/// How a job is asked for.
#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct Asking {
    /// Check the request and answer with an estimate of the job; queue nothing.
    #[serde(default)]
    #[param(default = false)]
    dry_run: bool,
}

/// Queues a job
///
/// The answer comes as soon as the job is stored durably: the job will be computed even if this process fails. Channels that
/// cannot form one source (unknown units, W beside lm without a spectrum, shares that do not add up to 1) are refused here; `at`
/// names the field to change.
///
/// Where the tenant has an equal job that is queued, is running or has succeeded, the answer is that job, with status 200 and
/// `reused`. That job then has the more urgent of the two priorities and, while it is queued, the longer of the two `timeout_s`.
/// A running job with a shorter `timeout_s` is not equal. If the request has metadata, a job with other metadata is not equal
/// either. `"reuse": false` always makes a new job.
///
/// With an `Idempotency-Key`, the request can be repeated for 24 hours: the answer has the same status and shows the same job in
/// its present state, or is 410 if the job was deleted. With `dry_run=true` the answer is an estimate, no job is queued, and the
/// key has no effect.
#[utoipa::path(
    post, path = "/v1/jobs", tag = "jobs", operation_id = "create_job", request_body = NewJob,
    params(
        Asking,
        ("Idempotency-Key" = Option<String>, Header, min_length = 1, max_length = 257,
         description = "a key that the client chooses for this request: 1 to 255 printable ASCII characters, plain or quoted (draft-ietf-httpapi-idempotency-key-header)",
         example = "\"8e03978e-40d5-43dd-bc93-6894a57f9324\""),
    ),
    responses(
        (status = 200, body = JobOrEstimate, description = "an equal job that existed before, or the estimate that `dry_run` asks for", headers(
            ("Location" = String, description = "the address of the job; absent for an estimate"))),
        (status = 202, body = Job, description = "the job is queued", headers(
            ("Location" = String, description = "the job"), ("Retry-After" = u64, description = "the seconds to wait before asking for the state of the job"))),
        (status = 400, body = Problem, content_type = "application/problem+json", description = "the body is not JSON, or the Idempotency-Key is malformed"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "there is no such ray set or spectrum"),
        (status = 410, body = Problem, content_type = "application/problem+json", description = "the job that was made with this Idempotency-Key was deleted"),
        (status = 413, body = Problem, content_type = "application/problem+json", description = "the body is too large, or the tenant has used its storage quota"),
        (status = 415, body = Problem, content_type = "application/problem+json", description = "the Content-Type is not application/json"),
        (status = 429, body = Problem, content_type = "application/problem+json", description = "the tenant has reached its quota of queued jobs, or this API key made too many requests"),
        (status = 422, body = Problem, content_type = "application/problem+json", description = "a field is unknown, of the wrong type or out of range; the channels cannot form one source; the job needs more memory than the service has; the Idempotency-Key was used for another request"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "the service is busy or stopping, or the database or the object store does not answer"),
    )
)]
pub async fn create(
    State(api): State<Api>,
    access: Access,
    Query(asking): Query<Asking>,
    headers: HeaderMap,
    Body(new): Body<NewJob>,
) -> Result<Response, Problem> {
    let keyed = key(&headers)?.filter(|_| !asking.dry_run).map(|key| Keyed::new(key, &new)).transpose()?;
    // Before anything is judged: what was said once is said again, whatever became of ray sets and limits.
    if let Some(keyed) = &keyed
        && let Some(queued) = api.queue.answered(&access.tenant, keyed).await?
    {
        return answer(&api, &access, queued).await;
    }
    if api.draining.is_cancelled() {
        return Err(Problem::draining());
    }
    in_range(&api, &new)?;
    let plan = api.queue.plan(&access.tenant, &new).await?;
    if asking.dry_run {
        return Ok(Json(estimate(&api, &access, &new, &plan).await?).into_response());
    }
    let queued = api.queue.enqueue(&access.tenant, &new, &plan, keyed.as_ref()).await?;
    // Ties the job to the request that asked for it.
    tracing::info!(job = queued.id, reused = queued.reused, "job queued");
    answer(&api, &access, queued).await
}

fn in_range(api: &Api, new: &NewJob) -> Result<(), Problem> {
    if !(1..=MAX_CHANNELS).contains(&new.channels.len()) {
        return Err(Problem::out_of_range("channels", "a list of 1 to 8 channels"));
    }
    for (index, channel) in new.channels.iter().enumerate() {
        if channel.name.as_ref().is_some_and(|name| name.is_empty() || name.chars().count() > MAX_NAME_CHARS) {
            return Err(Problem::out_of_range(&format!("channels[{index}].name"), "1 to 255 characters long"));
        }
    }
    timeout_in_range(api, new.timeout_s)
}

/// Refuses a time limit that no attempt may have.
///
/// # Errors
/// It is 0, or longer than the service allows.
pub fn timeout_in_range(api: &Api, timeout_s: Option<u32>) -> Result<(), Problem> {
    let most_s = api.queue.longest().as_secs();
    if timeout_s.is_some_and(|seconds| seconds == 0 || u64::from(seconds) > most_s) {
        return Err(Problem::out_of_range("timeout_s", &format!("a whole number of seconds from 1 to {most_s}")));
    }
    Ok(())
}

/// The answer to a request for a job.
///
/// # Errors
/// The job is gone already; the database does not answer.
pub async fn answer(api: &Api, access: &Access, Queued { id, reused }: Queued) -> Result<Response, Problem> {
    let job = Job::from(find(api, access, &id).await?).reused(reused);
    Ok(location(if reused { StatusCode::OK } else { StatusCode::ACCEPTED }, job))
}

async fn estimate(api: &Api, access: &Access, new: &NewJob, plan: &JobPlan) -> Result<JobEstimate, Problem> {
    let (records, tenant) = (&api.storage.records, access.tenant.as_str());
    let seconds = query::seconds_per_ray(records).await?.map(|per_ray| per_ray * plan.ray_count as f64);
    Ok(JobEstimate {
        ray_count: plan.ray_count,
        byte_count: plan.byte_count,
        memory_bytes: plan.memory_bytes,
        memory_limit_bytes: api.queue.memory().limit_bytes(),
        fits: api.queue.memory().check_fits(plan.memory_bytes).is_ok(),
        reuses: api.queue.equal(tenant, new, plan).await?,
        seconds,
        jobs_ahead: query::ahead(records, tenant, new.priority).await?,
        notices: plan.notices.clone(),
    })
}

/// The key of a request: a string of RFC 8941 (the draft's form), or the same without its quotes (everybody's).
///
/// # Errors
/// It is neither.
pub fn key(headers: &HeaderMap) -> Result<Option<String>, Problem> {
    let mut values = headers.get_all(IDEMPOTENCY_KEY).iter();
    let Some(value) = values.next() else { return Ok(None) };
    let wrong = |found: &str| Err(Problem::malformed_header("Idempotency-Key", found));
    if values.next().is_some() {
        return wrong("The request has this header more than once.");
    }
    let text = value.to_str().map(str::trim).unwrap_or_default();
    let key = match text.strip_prefix('"') {
        Some(rest) => unquoted(rest),
        None => Some(text.to_owned()),
    };
    match key {
        Some(key)
            if (1..=MAX_KEY_CHARS).contains(&key.len()) && key.bytes().all(|byte| matches!(byte, b' '..=b'~')) =>
        {
            Ok(Some(key))
        }
        _ => wrong("The value is not 1 to 255 printable ASCII characters, plain or between quotes."),
    }
}

/// What stands before the closing quote, which is the end; a backslash stands before a quote or a backslash only.
fn unquoted(rest: &str) -> Option<String> {
    let (mut key, mut chars) = (String::new(), rest.chars());
    while let Some(char) = chars.next() {
        match char {
            '"' => return chars.next().is_none().then_some(key),
            '\\' => key.push(chars.next().filter(|escaped| matches!(escaped, '"' | '\\'))?),
            char => key.push(char),
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_is_read_as_the_draft_writes_it_and_as_everybody_sends_it() {
        let read = |value: &[u8]| {
            let mut headers = HeaderMap::new();
            headers.append(IDEMPOTENCY_KEY, value.try_into().unwrap());
            key(&headers)
        };
        // Section 2 of the draft, and RFC 8941 section 3.3.3.
        let draft = "8e03978e-40d5-43dd-bc93-6894a57f9324";
        assert_eq!(read(format!("\"{draft}\"").as_bytes()).unwrap().as_deref(), Some(draft));
        assert_eq!(read(draft.as_bytes()).unwrap().as_deref(), Some(draft));
        assert_eq!(read(br#""a\"b\\c""#).unwrap().as_deref(), Some(r#"a"b\c"#));
        assert_eq!(read("x".repeat(255).as_bytes()).unwrap().map(|key| key.len()), Some(255));
        assert_eq!(key(&HeaderMap::new()).unwrap(), None);
        let long = "x".repeat(256);
        for wrong in ["", "\"\"", "\"", "\"a", "\"a\"b", r#""a\b""#, "ä", &long] {
            assert_eq!(read(wrong.as_bytes()).unwrap_err().code, "request.malformed_header", "{wrong}");
        }
        let mut twice = HeaderMap::new();
        twice.append(IDEMPOTENCY_KEY, "a".try_into().unwrap());
        twice.append(IDEMPOTENCY_KEY, "b".try_into().unwrap());
        assert_eq!(key(&twice).unwrap_err().status, 400);
    }
}
