//! Errors as clients see them (RFC 9457): the one place where an error becomes a status code.

/// What can go wrong with an upload that is to be resumed.
mod uploads;
/// Problems of outbound requests.
mod elsewhere;
/// Problems of what is made of a model.
mod models;
/// Problems of headers that are not supported.
mod headers;
/// What serde says of a wrong shape, in words of JSON.
mod shape;
/// Problems by their cause: a store, a file or the service itself.
mod causes;

pub use uploads::refusal_of;

use crate::accounts::keys::Refusal;
use crate::accounts::quota::Exceeded;
use crate::failure::Failure;
use crate::jobs::memory_budget::TooLarge;
use crate::jobs::{State, queue};
use crate::ray_sets;
use axum::Json;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::num::NonZeroU32;
use std::time::Duration;
use utoipa::ToSchema;

/// The media type of every error.
pub const MEDIA_TYPE: &str = "application/problem+json";
/// When to ask again for a place in a full queue, s: jobs take about that long.
const QUEUE_WAIT_S: u32 = 10;

/// A problem (RFC 9457): why a request failed.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Problem {
    /// `urn:lampwright:problem:<code>`.
    #[serde(rename = "type")]
    #[schema(value_type = String)]
    pub kind: Box<str>,
    /// Short title of the kind of problem.
    pub title: Cow<'static, str>,
    /// The HTTP status.
    #[schema(minimum = 400, maximum = 599)]
    pub status: u16,
    /// What is wrong in this case.
    #[schema(value_type = String)]
    pub detail: Box<str>,
    /// Stable code: programs may depend on it.
    pub code: Cow<'static, str>,
    /// Where the problem is: "byte 20", "options.hull.resolution", a path in the body.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = String, required = false)]
    pub at: Option<Box<str>>,
    /// What the client or the operator can do about it.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = String, required = false)]
    pub remedy: Option<Box<str>>,
    /// When to ask again, s: the header `Retry-After`.
    #[serde(skip)]
    pub retry_after_s: Option<NonZeroU32>,
}

/// Remedy where a body is not the file itself: this call of curl sends nothing but the bytes of the file.
pub const SEND_THE_FILE: &str = "Send the file itself as the body, as curl -X POST -T FILE URL does.";

impl Problem {
    fn new(
        status: StatusCode,
        code: impl Into<Cow<'static, str>>,
        title: impl Into<Cow<'static, str>>,
        detail: impl Into<String>,
    ) -> Problem {
        let (code, title) = (code.into(), title.into());
        let kind = format!("urn:lampwright:problem:{code}").into();
        let retry_after_s = (status == StatusCode::SERVICE_UNAVAILABLE).then_some(NonZeroU32::MIN);
        let (status, detail) = (status.as_u16(), detail.into().into());
        Problem { kind, title, status, detail, code, at: None, remedy: None, retry_after_s }
    }

    fn at(self, at: impl Into<String>) -> Problem {
        Problem { at: Some(at.into().into()), ..self }
    }

    fn remedy(self, remedy: impl Into<String>) -> Problem {
        Problem { remedy: Some(remedy.into().into()), ..self }
    }

    fn of(status: StatusCode, failure: Failure) -> Problem {
        let problem = Problem::new(status, failure.code, failure.title, failure.detail);
        Problem { at: failure.at.map(Into::into), remedy: failure.remedy.map(Into::into), ..problem }
    }

    /// The problem of a path that has no route.
    pub fn no_route(path: &str) -> Problem {
        Problem::new(
            StatusCode::NOT_FOUND,
            "request.not_found",
            "No such address",
            format!("This service has no resource at {path}."),
        )
        .remedy("See /docs for all addresses.")
    }

    /// The problem of a method that the path does not support; `Allow` names those that it does.
    pub fn method_not_allowed(method: &str) -> Problem {
        let status = StatusCode::METHOD_NOT_ALLOWED;
        Problem::new(
            status,
            "request.method_not_allowed",
            "Method not allowed",
            format!("This address does not support the method {method}."),
        )
        .remedy("Use one of the methods in the Allow header.")
    }

    /// The problem of a path that is malformed.
    pub fn malformed_path(detail: impl Into<String>) -> Problem {
        Problem::new(StatusCode::BAD_REQUEST, "request.malformed_path", "The path is malformed", detail)
    }

    /// The problem of a malformed header.
    pub fn malformed_header(name: &str, detail: &str) -> Problem {
        Problem::new(StatusCode::BAD_REQUEST, "request.malformed_header", "A header is malformed", detail).at(name)
    }

    /// The problem of a body with an unsupported media type.
    pub fn media_type(detail: impl Into<String>, remedy: &str) -> Problem {
        let status = StatusCode::UNSUPPORTED_MEDIA_TYPE;
        Problem::new(status, "request.media_type", "Unsupported media type", detail).remedy(remedy)
    }

    /// The problem of a body that is larger than its route accepts.
    pub fn body_too_large(limit: u64) -> Problem {
        let detail = format!("The body has more than {limit} bytes.");
        Problem::new(StatusCode::PAYLOAD_TOO_LARGE, "request.body_too_large", "The body is too large", detail)
    }

    /// The problem of a body that ended too early.
    pub fn body_truncated() -> Problem {
        let detail = "The body ended before the announced number of bytes had arrived.";
        Problem::new(StatusCode::BAD_REQUEST, "upload.truncated", "The body is incomplete", detail)
            .remedy("Send it again.")
    }

    /// The body is not JSON.
    pub fn malformed_json(detail: impl Into<String>) -> Problem {
        Problem::new(StatusCode::BAD_REQUEST, "request.malformed_json", "The body is not JSON", detail)
    }

    /// JSON or query of the wrong shape: `path` is where, `found` is serde's sentence, which is where the kinds differ. It is told in words of
    /// JSON: serde's are those of Rust.
    pub fn wrong_shape(path: &str, found: &str) -> Problem {
        let (code, title) = if found.starts_with("unknown field") {
            ("request.unknown_field", "Unknown field")
        } else if found.starts_with("missing field") {
            ("request.missing_field", "Missing field")
        } else {
            ("request.wrong_type", "Wrong value")
        };
        Problem::new(StatusCode::UNPROCESSABLE_ENTITY, code, title, shape::plainly(found)).at(path)
    }

    /// The problem of a string with the character U+0000, which PostgreSQL cannot store.
    pub fn null_character(path: &str) -> Problem {
        let detail = "The string contains the character U+0000, which is not allowed.";
        Problem::new(StatusCode::UNPROCESSABLE_ENTITY, "request.null_character", "Invalid character", detail).at(path)
    }

    /// A value of the right type and outside its range.
    pub fn out_of_range(path: &str, must: &str) -> Problem {
        let detail = format!("{path} must be {must}.");
        Problem::new(StatusCode::UNPROCESSABLE_ENTITY, "request.out_of_range", "Out of range", detail).at(path)
    }

    /// No such drawing.
    pub fn no_drawing(name: &str) -> Problem {
        let detail = format!("The ray set has no drawing {name}.");
        Problem::new(StatusCode::NOT_FOUND, "drawing.not_found", "No such drawing", detail)
            .remedy("Ray sets without usable rays have no drawings, nor have those that an earlier version without inspections stored; upload the file again to get them.")
    }

    /// No such artifact.
    pub fn no_artifact(name: &str) -> Problem {
        let detail = format!("The job has no artifact {name:?}.");
        Problem::new(StatusCode::NOT_FOUND, "artifact.not_found", "No such artifact", detail)
            .remedy("See the job's list of artifacts; it is empty until the job has succeeded.")
    }

    /// No such ray set.
    pub fn no_ray_set(id: &str) -> Problem {
        Problem::new(
            StatusCode::NOT_FOUND,
            "ray_set.not_found",
            "No such ray set",
            format!("There is no ray set {id:?}."),
        )
    }

    /// No such spectrum.
    pub fn no_spectrum(id: &str) -> Problem {
        let detail = format!("There is no spectrum {id:?}.");
        Problem::new(StatusCode::NOT_FOUND, "spectrum.not_found", "No such spectrum", detail)
    }

    /// An unfinished job needs the spectrum.
    pub fn spectrum_needed(id: &str) -> Problem {
        let detail = format!("An unfinished job needs the spectrum {id}.");
        Problem::new(StatusCode::CONFLICT, "spectrum.in_use", "The spectrum is in use", detail)
            .remedy("Cancel the job, or wait until it ends.")
    }

    /// An unfinished job needs the ray set.
    pub fn ray_set_needed(id: &str) -> Problem {
        let detail = format!("An unfinished job needs the ray set {id}.");
        Problem::new(StatusCode::CONFLICT, "ray_set.in_use", "The ray set is in use", detail)
            .remedy("Cancel the job, or wait until it ends.")
    }

    /// No such job.
    pub fn no_job(id: &str) -> Problem {
        Problem::new(StatusCode::NOT_FOUND, "job.not_found", "No such job", format!("There is no job {id:?}."))
    }

    fn job_state(state: State) -> Problem {
        let (code, title, remedy) = match state.ended() {
            true => {
                ("job.ended", "The job has ended", "An ended job cannot be changed. Delete it if you do not need it.")
            }
            false => ("job.unfinished", "The job has not ended", "Cancel the job first."),
        };
        Problem::new(StatusCode::CONFLICT, code, title, format!("The job is {}.", state.name())).remedy(remedy)
    }

    /// A job that no process could begin.
    fn job_too_large(TooLarge { needed_bytes, limit_bytes }: TooLarge) -> Problem {
        let detail = format!(
            "The job is expected to need {} MiB of memory; all jobs of one process together may use {} MiB.",
            needed_bytes.div_ceil(1 << 20),
            limit_bytes >> 20
        );
        Problem::new(StatusCode::UNPROCESSABLE_ENTITY, "job.too_large", "The job needs too much memory", detail)
            .at("options")
            .remedy(
                "Choose a lower hull.resolution, fewer goniogram.zones, wider goniogram steps or fewer rays.band_edges_nm; ?dry_run=true estimates the memory without queueing the job. Or ask the operator to raise serve --memory.",
            )
    }

    /// A key that stands for another request.
    fn key_reused(key: &str) -> Problem {
        let detail = format!("The Idempotency-Key {key:?} was used for a different request before.");
        Problem::new(
            StatusCode::UNPROCESSABLE_ENTITY,
            "idempotency.key_reused",
            "The Idempotency-Key was used before",
            detail,
        )
        .at("Idempotency-Key")
        .remedy("Use a new key for each new request; repeat a request without any change.")
    }

    /// A key whose job is gone.
    fn key_spent(key: &str) -> Problem {
        let detail = format!("The job that was made with the Idempotency-Key {key:?} was deleted.");
        Problem::new(StatusCode::GONE, "idempotency.job_deleted", "The job was deleted", detail)
            .at("Idempotency-Key")
            .remedy("To make a new job, send the request with a new key.")
    }

    /// A range outside the file.
    pub fn range_not_satisfiable(byte_count: u64) -> Problem {
        let detail = format!("The file has {byte_count} bytes.");
        let status = StatusCode::RANGE_NOT_SATISFIABLE;
        Problem::new(status, "artifact.range_not_satisfiable", "Range not satisfiable", detail)
    }

    /// The problem of an `If-Match` that does not name the entity tag of the file.
    pub fn changed(etag: &str) -> Problem {
        let detail = format!("If-Match does not name the current entity tag of this resource, {etag}.");
        let status = StatusCode::PRECONDITION_FAILED;
        Problem::new(status, "request.precondition_failed", "A precondition is false", detail)
            .at("If-Match")
            .remedy("Request the resource without If-Match, and use the ETag of that answer.")
    }

    /// The problem of more simultaneous requests than the service accepts.
    pub fn busy() -> Problem {
        let detail = "The service is processing as many requests of this kind as it can.";
        Problem::new(StatusCode::SERVICE_UNAVAILABLE, "service.busy", "The service is busy", detail)
            .remedy("Try again after the time in Retry-After.")
    }

    /// The service is stopping.
    pub fn draining() -> Problem {
        let detail = "The service is stopping and accepts no new requests.";
        Problem::new(StatusCode::SERVICE_UNAVAILABLE, "service.stopping", "The service is stopping", detail)
            .remedy("Try again after the time in Retry-After.")
    }

    /// The problem of a key that lacks a scope.
    pub fn scope_missing(scope: &str) -> Problem {
        let detail = format!("This key lacks the scope {scope}.");
        Problem::new(StatusCode::FORBIDDEN, "access.scope_missing", "The key lacks a scope", detail)
            .remedy("Use a key with this scope; the operator makes one with lampwright keys create --scope.")
    }

    /// The problem of a Host that is not this machine, while no API keys are required.
    pub fn foreign_host(host: &str) -> Problem {
        let detail = format!(
            "The Host {host:?} is not allowed: without API keys, this service answers only requests to localhost."
        );
        Problem::new(StatusCode::FORBIDDEN, "access.foreign_host", "This Host is not allowed", detail)
            .remedy("Send the request to localhost, or start the service with API keys: serve --auth on.")
    }

    /// The problem of an Origin that is not allowed, while no API keys are required.
    pub fn foreign_origin(origin: &str) -> Problem {
        let detail = format!("Web pages of the origin {origin} are not allowed to use this service.");
        Problem::new(StatusCode::FORBIDDEN, "access.foreign_origin", "This Origin is not allowed", detail)
            .remedy("The operator can allow the origin: serve --cors-origin.")
    }

    /// The problem of a key that exceeded its rate limit.
    pub fn too_often(wait: Duration) -> Problem {
        let detail = "This key has made more requests than its rate limit allows.";
        let problem = Problem::new(StatusCode::TOO_MANY_REQUESTS, "access.rate", "Too many requests", detail)
            .remedy("Wait for the time in Retry-After before the next request, and send requests less often.");
        let wait_s = u32::try_from(wait.as_secs()).unwrap_or(u32::MAX).saturating_add(1);
        Problem { retry_after_s: NonZeroU32::new(wait_s), ..problem }
    }

    /// The problem of too little free storage space.
    pub fn low_space() -> Problem {
        let detail = "The free space on the storage of the service is below the limit that the operator reserves.";
        Problem::new(StatusCode::INSUFFICIENT_STORAGE, "storage.low_space", "The storage is almost full", detail)
            .remedy("Delete jobs and ray sets that you do not need, or ask the operator for more storage space.")
    }

    /// The same problem with status 503, the only one that readiness probes know.
    #[must_use]
    pub fn not_ready(self) -> Problem {
        Problem { status: StatusCode::SERVICE_UNAVAILABLE.as_u16(), retry_after_s: Some(NonZeroU32::MIN), ..self }
    }

    /// A request that took too long.
    pub fn timeout() -> Problem {
        let detail = "The service did not answer within its time limit.";
        Problem::new(StatusCode::GATEWAY_TIMEOUT, "request.timeout", "The request took too long", detail)
            .remedy("Try again.")
    }

    /// The problem of an error in the service itself. Its details are in the log, not in the answer.
    pub fn internal() -> Problem {
        let detail = "The service failed because of an error in the service itself.";
        Problem::new(StatusCode::INTERNAL_SERVER_ERROR, "service.internal", "Internal error", detail)
            .remedy("Report this to the operator with the x-request-id of this response.")
    }
}

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        let status = StatusCode::from_u16(self.status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
        let retry_after_s = self.retry_after_s;
        let mut response = (status, Json(self)).into_response();
        let headers = response.headers_mut();
        headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(MEDIA_TYPE));
        if let Some(wait_s) = retry_after_s {
            headers.insert(header::RETRY_AFTER, HeaderValue::from(wait_s.get()));
        }
        if status == StatusCode::UNAUTHORIZED {
            headers.insert(header::WWW_AUTHENTICATE, HeaderValue::from_static("Bearer realm=\"lampwright\""));
        }
        response
    }
}

impl From<Refusal> for Problem {
    fn from(refusal: Refusal) -> Problem {
        let (code, detail) = match refusal {
            Refusal::Missing => ("access.key_missing", "The request has no API key."),
            Refusal::Malformed => (
                "access.key_malformed",
                "The value of Authorization is not an API key of this service: Bearer lw_<id>_<secret>.",
            ),
            Refusal::Unknown => ("access.key_unknown", "The service does not know this API key."),
            Refusal::Expired => ("access.key_expired", "This API key has expired."),
            Refusal::Revoked => ("access.key_revoked", "This API key was revoked."),
        };
        Problem::new(StatusCode::UNAUTHORIZED, code, "An API key is required", detail).remedy(
            "Send the header Authorization: Bearer with a valid API key; the operator of the service makes keys.",
        )
    }
}

impl From<Exceeded> for Problem {
    fn from(exceeded: Exceeded) -> Problem {
        match exceeded {
            Exceeded::StoredBytes { used, limit } => Problem::new(
                StatusCode::PAYLOAD_TOO_LARGE,
                "quota.stored_bytes",
                "The storage quota is used up",
                format!("The tenant uses {used} of {limit} bytes, and this request needs more than the rest."),
            )
            .remedy("Delete jobs and ray sets that you do not need, or ask the operator for a larger quota."),
            Exceeded::QueuedJobs { limit } => {
                let status = StatusCode::TOO_MANY_REQUESTS;
                let detail = format!("{limit} jobs of the tenant are queued, which is its limit.");
                let problem = Problem::new(status, "quota.queued_jobs", "Too many jobs are queued", detail)
                    .remedy("Send the request again after the time in Retry-After, or cancel a queued job.");
                Problem { retry_after_s: NonZeroU32::new(QUEUE_WAIT_S), ..problem }
            }
        }
    }
}

impl From<ray_sets::Error> for Problem {
    fn from(error: ray_sets::Error) -> Problem {
        use crate::ray_sets::error::Error;
        match error {
            Error::TooLarge(limit) => Problem::new(
                StatusCode::PAYLOAD_TOO_LARGE,
                "upload.too_large",
                "The file is too large",
                format!("The service accepts files of at most {limit} bytes."),
            )
            .remedy("Send a file with fewer rays, or ask the operator for a larger limit: serve --max-upload."),
            Error::Empty => {
                Problem::new(StatusCode::BAD_REQUEST, "upload.empty", "The body is empty", "The request has no body.")
                    .remedy(SEND_THE_FILE)
            }
            Error::Truncated(found) | Error::Broken(found) => {
                tracing::debug!(found, "the transfer of a body was interrupted");
                Problem::body_truncated()
            }
            Error::Slow(slow) => {
                let status = StatusCode::REQUEST_TIMEOUT;
                let (code, title) = match slow.bytes {
                    0 => ("upload.idle", "The upload has stalled"),
                    _ => ("upload.slow", "The upload is too slow"),
                };
                Problem::new(status, code, title, format!("{slow}."))
                    .remedy("Send the file again over a faster connection, or use a resumable upload: /v1/uploads.")
            }
            Error::Digest { announced, found } => Problem::new(
                StatusCode::BAD_REQUEST,
                "upload.digest_mismatch",
                "The digest does not match",
                format!("The SHA-256 of the received bytes is {found}; the request announced {announced}."),
            )
            .remedy("Send it again."),
            Error::Unfit(error) | Error::Packed(error) => error.into(),
            Error::Quota(exceeded) => exceeded.into(),
            Error::LowSpace => Problem::low_space(),
            Error::Storage(error) => error.into(),
        }
    }
}

impl From<queue::Error> for Problem {
    fn from(error: queue::Error) -> Problem {
        match error {
            queue::Error::Missing(id) => Problem::no_job(&id),
            queue::Error::MissingRaySet(id) => Problem::no_ray_set(&id),
            queue::Error::MissingSpectrum(id) => Problem::no_spectrum(&id),
            queue::Error::State(state) => Problem::job_state(state),
            queue::Error::Quota(exceeded) => exceeded.into(),
            queue::Error::Unfit(error) => error.into(),
            queue::Error::TooLarge(too_large) => Problem::job_too_large(too_large),
            queue::Error::KeyReused(key) => Problem::key_reused(&key),
            queue::Error::KeySpent(key) => Problem::key_spent(&key),
            queue::Error::Storage(error) => error.into(),
        }
    }
}
