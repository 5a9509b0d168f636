//! `/v1/jobs/{id}/evaluations`: intensity, irradiance and radiance of the model of a job.

use super::api::Api;
use super::extract::{Body, Path};
use super::files::whole;
use super::job::Job;
use super::problem::Problem;
use super::rays::model_files;
use super::submission::{answer, key, timeout_in_range};
use crate::accounts::access::Access;
use crate::jobs::estimate::{plan_evaluation, planned};
use crate::jobs::evaluation::{JobEvaluation, NewEvaluation, NewEvaluationJob};
use crate::jobs::request::NewJob;
use crate::jobs::submit::Keyed;
use crate::models::Evaluated;
use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::Response;

/// Most numbers of an answer: cells times channels.
const MOST_NUMBERS: usize = 1 << 18;
/// Most numbers of a model that are kept while it is evaluated, vertices or nodes times channels.
const MOST_KEPT: usize = 1 << 21;

/// Evaluates the model of a job
///
/// Intensity, irradiance or radiance without noise, each number with the bound of its error against the model. An answer has at most 262144
/// numbers (cells times channels) and takes about 20 s at most; what is larger is a job (`POST /v1/evaluations`). Nothing is stored, so the request can
/// be repeated.
#[utoipa::path(
    post, path = "/v1/jobs/{id}/evaluations", tag = "artifacts", operation_id = "evaluate_model", request_body = NewEvaluation,
    params(("id" = String, Path, description = "the job")),
    responses(
        (status = 200, content((inline(super::api::AnyFile) = "application/json"), (inline(super::api::AnyFile) = "text/csv"), (inline(super::api::Binary) = "image/tiff"), (inline(super::api::AnyFile) = "image/svg+xml")), description = "the answer, in the form that was asked for; JSON follows openapi/evaluation.schema.json"),
        (status = 400, body = Problem, content_type = "application/problem+json", description = "the body is not JSON"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "there is no such job, or it has not succeeded"),
        (status = 413, body = Problem, content_type = "application/problem+json", description = "the body is too large"),
        (status = 415, body = Problem, content_type = "application/problem+json", description = "the Content-Type is not application/json"),
        (status = 422, body = Problem, content_type = "application/problem+json", description = "a field is unknown, of the wrong type or out of range; the model does not know this light; the answer would be too large or take too long"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "the service is busy or stopping, or the database or the object store does not answer"),
    )
)]
pub async fn evaluate(
    State(api): State<Api>,
    access: Access,
    Path(id): Path<String>,
    Body(new): Body<NewEvaluation>,
) -> Result<Response, Problem> {
    let files = model_files(&api, &access, &id).await?;
    let form = new.format.form();
    let request = new.request(MOST_NUMBERS, MOST_KEPT)?;
    match api.models.evaluate(&access.tenant, &api.storage.blobs, &files, request, form).await? {
        Evaluated::File(file) => Ok(whole(&file.name, file.media_type, file.bytes)),
        Evaluated::Busy => Err(Problem::busy()),
        Evaluated::TooLong => Err(Problem::evaluation_too_long()),
        Evaluated::Stopping => Err(Problem::draining()),
    }
}

/// Queues an evaluation of the model of a job
///
/// A job like any other, for what is too large to be answered at once: at most 16777216 numbers, within the time limit of jobs. Its artifact is
/// `evaluation.json`, `.csv`, `.tiff` or `.svg`. The model must be there when the job begins; afterwards it may be deleted. `Idempotency-Key` and `reuse`
/// have the meaning that they have for `POST /v1/jobs`. What cannot be evaluated is refused here; what only a large model tells, by the job.
#[utoipa::path(
    post, path = "/v1/evaluations", tag = "jobs", operation_id = "queue_evaluation", request_body = NewEvaluationJob,
    params(
        ("Idempotency-Key" = Option<String>, Header, min_length = 1, max_length = 257,
         description = "a key that the client chooses for this request: 1 to 255 printable ASCII characters, plain or quoted (draft-ietf-httpapi-idempotency-key-header)",
         example = "\"8e03978e-40d5-43dd-bc93-6894a57f9324\""),
    ),
    responses(
        (status = 200, body = Job, description = "an equal job that existed before", headers(
            ("Location" = String, description = "the address of the job"))),
        (status = 202, body = Job, description = "the job is queued", headers(
            ("Location" = String, description = "the job"), ("Retry-After" = u64, description = "the seconds to wait before asking for the state of the job"))),
        (status = 400, body = Problem, content_type = "application/problem+json", description = "the body is not JSON, or the Idempotency-Key is malformed"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "there is no such job, or it has no model"),
        (status = 410, body = Problem, content_type = "application/problem+json", description = "the job that was made with this Idempotency-Key was deleted"),
        (status = 413, body = Problem, content_type = "application/problem+json", description = "the body is too large, or the tenant has used its storage quota"),
        (status = 415, body = Problem, content_type = "application/problem+json", description = "the Content-Type is not application/json"),
        (status = 422, body = Problem, content_type = "application/problem+json", description = "a field is unknown, of the wrong type or out of range; the answer would be too large; the job needs more memory than the service has; the Idempotency-Key was used for another request"),
        (status = 429, body = Problem, content_type = "application/problem+json", description = "the tenant has reached its quota of queued jobs, or this API key made too many requests"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "the service is busy or stopping, or the database or the object store does not answer"),
    )
)]
pub async fn queue(
    State(api): State<Api>,
    access: Access,
    headers: HeaderMap,
    Body(new): Body<NewEvaluationJob>,
) -> Result<Response, Problem> {
    let keyed = key(&headers)?.map(|key| Keyed::new(key, &new)).transpose()?;
    if let Some(keyed) = &keyed
        && let Some(queued) = api.queue.answered(&access.tenant, keyed).await?
    {
        return answer(&api, &access, queued).await;
    }
    if api.draining.is_cancelled() {
        return Err(Problem::draining());
    }
    timeout_in_range(&api, new.timeout_s)?;
    let files = model_files(&api, &access, &new.job).await?;
    api.queue.use_model(&access.tenant, &new.job).await?;
    let evaluation = JobEvaluation { job: new.job, evaluation: new.evaluation };
    let (form, mut request) = (evaluation.evaluation.format.form(), planned(&evaluation.evaluation)?);
    // What the model alone tells is told now where it is at hand, else by the job.
    let light = api.models.check(&access.tenant, &api.storage.blobs, &files, &request, form).await?;
    request.kind = request.kind.or(light);
    let plan = plan_evaluation(&evaluation, &request, &files)?;
    let new = NewJob {
        channels: Vec::new(),
        priority: new.priority,
        timeout_s: new.timeout_s,
        metadata: new.metadata,
        reuse: new.reuse,
        evaluation: Some(evaluation),
        ..NewJob::of("")
    };
    let queued = api.queue.enqueue(&access.tenant, &new, &plan, keyed.as_ref()).await?;
    tracing::info!(job = queued.id, reused = queued.reused, "evaluation queued");
    answer(&api, &access, queued).await
}
