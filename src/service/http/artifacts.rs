//! `/v1/jobs/{id}/artifacts`: the files that a job produced.

use super::api::Api;
use super::extract::Path;
use super::job::{find, href};
use super::problem::Problem;
use super::ranges::{Wanted, media_type, wanted};
use crate::accounts::access::Access;
use crate::jobs::query::StoredArtifact;
use crate::jobs::{ZIP, query};
use axum::Json;
use axum::body::{Body, Bytes};
use axum::extract::State;
use axum::http::{HeaderMap, HeaderValue, Method, StatusCode, header};
use axum::response::{IntoResponse, Response};
use futures::stream;
use serde::Serialize;
use std::io;
use std::ops::Range;
use utoipa::ToSchema;

/// A file that a job produced.
#[derive(Serialize, ToSchema)]
pub struct Artifact {
    /// Name of the file: its path in the zip file.
    name: String,
    /// Media type of the file.
    media_type: String,
    /// Length of the file, bytes.
    byte_count: u64,
    /// SHA-256 of the file, lower-case hex; also its entity tag.
    sha256: String,
    /// Address of the file.
    href: String,
}

/// The files that a job produced.
#[derive(Serialize, ToSchema)]
pub struct ArtifactList {
    /// The artifacts in the order of the zip file; empty until the job has succeeded.
    artifacts: Vec<Artifact>,
    /// The zip file of all artifacts; null until the job has succeeded.
    #[schema(required)]
    zip: Option<Artifact>,
}

/// Lists a job's artifacts
#[utoipa::path(
    get, path = "/v1/jobs/{id}/artifacts", tag = "artifacts", operation_id = "list_artifacts",
    params(("id" = String, Path, description = "the job")),
    responses(
        (status = 200, body = ArtifactList, description = "the artifacts of the job"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "there is no such job"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "the service is busy, or the database or the object store does not answer"),
    )
)]
pub async fn list(
    State(api): State<Api>,
    access: Access,
    Path(id): Path<String>,
) -> Result<Json<ArtifactList>, Problem> {
    find(&api, &access, &id).await?;
    let rows = query::artifacts(&api.storage.records, &id).await?;
    let artifact = |row: StoredArtifact| Artifact {
        href: href(&id, &row.name),
        name: row.name,
        media_type: row.media_type,
        byte_count: row.byte_count,
        sha256: row.sha256,
    };
    let (zip, artifacts): (Vec<_>, Vec<_>) = rows.into_iter().map(artifact).partition(|row| row.name == ZIP);
    Ok(Json(ArtifactList { artifacts, zip: zip.into_iter().next() }))
}

/// Downloads an artifact
///
/// The whole file, or one range of it. The entity tag is the SHA-256 of the file. The media type is that of the file, or
/// application/octet-stream where `Accept` names only that.
#[utoipa::path(
    get, path = "/v1/jobs/{id}/artifacts/{*name}", tag = "artifacts", operation_id = "get_artifact",
    params(
        ("id" = String, Path, description = "the job"), ("name" = String, Path, description = "the artifact's name"),
        ("Range" = Option<String>, Header, description = "`bytes=<first>-<last>`: one range"),
        ("If-None-Match" = Option<String>, Header, description = "entity tags of the copies that the client has; 304 if one of them is current"),
        ("If-Match" = Option<String>, Header, description = "entity tags, one of which the file must have; otherwise 412"),
        ("If-Range" = Option<String>, Header, description = "the range is sent only if the file has this entity tag; otherwise the whole file"),
    ),
    responses(
        (status = 200, content((inline(super::api::AnyFile) = "*/*"), (inline(super::api::Binary) = "application/octet-stream")), description = "the bytes of the file", headers(("ETag" = String, description = "the SHA-256 of the file"))),
        (status = 206, content((inline(super::api::AnyFile) = "*/*"), (inline(super::api::Binary) = "application/octet-stream")), description = "the requested range of bytes", headers(("Content-Range" = String, description = "the range that is sent, and the length of the file"))),
        (status = 304, description = "the copy of the client is current"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "there is no such job or artifact"),
        (status = 412, body = Problem, content_type = "application/problem+json", description = "the file does not have an entity tag that `If-Match` names"),
        (status = 416, body = Problem, content_type = "application/problem+json", description = "the range lies outside the file"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "the service is busy, or the database or the object store does not answer"),
    )
)]
pub async fn download(
    State(api): State<Api>,
    access: Access,
    Path((id, name)): Path<(String, String)>,
    method: Method,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    find(&api, &access, &id).await?;
    send(&api, &id, &name, &method, &headers).await
}

/// Downloads all artifacts of a job in one zip file
///
/// The whole file, or one range of it. The entity tag is the SHA-256 of the file. The media type is that of the file, or
/// application/octet-stream where `Accept` names only that.
#[utoipa::path(
    get, path = "/v1/jobs/{id}/model.zip", tag = "artifacts", operation_id = "get_zip",
    params(
        ("id" = String, Path, description = "the job"),
        ("Range" = Option<String>, Header, description = "`bytes=<first>-<last>`: one range"),
        ("If-None-Match" = Option<String>, Header, description = "entity tags of the copies that the client has; 304 if one of them is current"),
        ("If-Match" = Option<String>, Header, description = "entity tags, one of which the file must have; otherwise 412"),
        ("If-Range" = Option<String>, Header, description = "the range is sent only if the file has this entity tag; otherwise the whole file"),
    ),
    responses(
        (status = 200, content((inline(super::api::Binary) = "application/zip"), (inline(super::api::Binary) = "application/octet-stream")), description = "the bytes of the file", headers(("ETag" = String, description = "the SHA-256 of the file"))),
        (status = 206, content((inline(super::api::Binary) = "application/zip"), (inline(super::api::Binary) = "application/octet-stream")), description = "the requested range of bytes", headers(("Content-Range" = String, description = "the range that is sent, and the length of the file"))),
        (status = 304, description = "the copy of the client is current"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "there is no such job, or it has not succeeded"),
        (status = 412, body = Problem, content_type = "application/problem+json", description = "the file does not have an entity tag that `If-Match` names"),
        (status = 416, body = Problem, content_type = "application/problem+json", description = "the range lies outside the file"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "the service is busy, or the database or the object store does not answer"),
    )
)]
pub async fn download_zip(
    State(api): State<Api>,
    access: Access,
    Path(id): Path<String>,
    method: Method,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    find(&api, &access, &id).await?;
    send(&api, &id, ZIP, &method, &headers).await
}

/// Sends a file of a job that was found.
async fn send(api: &Api, id: &str, name: &str, method: &Method, headers: &HeaderMap) -> Result<Response, Problem> {
    let found = query::artifact_named(&api.storage.records, id, name).await?;
    let artifact = found.ok_or_else(|| Problem::no_artifact(name))?;
    let facts = FileFacts {
        etag: format!("\"{}\"", artifact.sha256),
        name: artifact.name,
        media_type: artifact.media_type,
        byte_count: artifact.byte_count,
    };
    let bytes = async |range| Ok(Body::from_stream(api.storage.blobs.stream(&artifact.blob, range).await?));
    answer(&facts, method, headers, bytes).await
}

/// What an answer says of the file that it sends.
pub struct FileFacts {
    /// Its name.
    pub name: String,
    /// Its media type.
    pub media_type: String,
    /// Its length.
    pub byte_count: u64,
    /// Its entity tag, with quotes.
    pub etag: String,
}

/// Answers with a file, or the part of it that is asked for; `bytes` gives a range of it.
///
/// # Errors
/// A condition is false; those of `bytes`.
pub async fn answer(
    file: &FileFacts,
    method: &Method,
    headers: &HeaderMap,
    bytes: impl AsyncFnOnce(Range<u64>) -> Result<Body, Problem>,
) -> Result<Response, Problem> {
    let (status, range) = match wanted(headers, &file.etag, file.byte_count) {
        Wanted::Whole => (StatusCode::OK, 0..file.byte_count),
        Wanted::Part(range) => (StatusCode::PARTIAL_CONTENT, range),
        Wanted::Nothing => (StatusCode::NOT_MODIFIED, 0..0),
        Wanted::Changed => return Err(Problem::changed(&file.etag)),
        Wanted::Unsatisfiable => {
            let content_range = [(header::CONTENT_RANGE, format!("bytes */{}", file.byte_count))];
            return Ok((content_range, Problem::range_not_satisfiable(file.byte_count)).into_response());
        }
    };
    // A HEAD is answered without touching the bytes.
    let body = match *method == Method::HEAD || range.is_empty() {
        true => Body::empty(),
        false => bytes(range.clone()).await?,
    };
    let mut response = (status, body).into_response();
    describe(response.headers_mut(), file, media_type(headers, &file.media_type), status, &range);
    Ok(response)
}

/// Answers what has no body (HEAD, or a condition that keeps the file from being sent) for a file that is made when it is asked for, without
/// making it: `byte_count` is left out where only that would tell it (RFC 9110, section 9.3.2), and a range is that of a GET (14.2).
///
/// # Errors
/// `If-Match` is false.
pub fn promise(file: &FileFacts, byte_count: Option<u64>, headers: &HeaderMap) -> Result<Response, Problem> {
    let status = match wanted(headers, &file.etag, 0) {
        Wanted::Nothing => StatusCode::NOT_MODIFIED,
        Wanted::Changed => return Err(Problem::changed(&file.etag)),
        Wanted::Whole | Wanted::Part(_) | Wanted::Unsatisfiable => StatusCode::OK,
    };
    // A body whose length nobody knows, so that none is told.
    let mut response = (status, Body::from_stream(stream::empty::<io::Result<Bytes>>())).into_response();
    let range = 0..byte_count.unwrap_or_default();
    describe(response.headers_mut(), file, media_type(headers, &file.media_type), status, &range);
    if byte_count.is_none() {
        response.headers_mut().remove(header::CONTENT_LENGTH);
    }
    Ok(response)
}

fn describe(headers: &mut HeaderMap, file: &FileFacts, media_type: &str, status: StatusCode, range: &Range<u64>) {
    let mut set = |name, value: String| {
        // Only our own names and numbers: always a legal header.
        if let Ok(value) = HeaderValue::try_from(value) {
            headers.insert(name, value);
        }
    };
    set(header::ETAG, file.etag.clone());
    // What has this name under this job never changes, but the job may be deleted: ask again, cheaply.
    set(header::CACHE_CONTROL, "private, no-cache".into());
    if status == StatusCode::NOT_MODIFIED {
        return;
    }
    set(header::ACCEPT_RANGES, "bytes".into());
    set(header::CONTENT_TYPE, media_type.to_owned());
    set(header::VARY, "accept".into());
    set(header::CONTENT_LENGTH, (range.end - range.start).to_string());
    set(header::CONTENT_DISPOSITION, disposition(&file.name, &file.media_type));
    if status == StatusCode::PARTIAL_CONTENT {
        let (start, end) = (range.start, range.end.saturating_sub(1));
        set(header::CONTENT_RANGE, format!("bytes {start}-{end}/{}", file.byte_count));
    }
}

/// A drawing is shown where it is asked for, any other file is kept.
pub fn disposition(name: &str, media_type: &str) -> String {
    let kind = if media_type == "image/svg+xml" { "inline" } else { "attachment" };
    format!("{kind}; filename=\"{}\"", file_name(name))
}

/// The last part of a name, without what a quoted string may not hold.
fn file_name(name: &str) -> String {
    let last = name.rsplit('/').next().unwrap_or(name);
    last.chars().map(|c| if c.is_ascii_graphic() && c != '"' && c != '\\' { c } else { '_' }).collect()
}
