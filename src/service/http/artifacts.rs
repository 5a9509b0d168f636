//! `/v1/jobs/{id}/artifacts`: the files that a job produced.

use super::api::Api;
use super::extract::Path;
use super::files::{FileFacts, PartAnswers, PartHeaders, answer};
use super::job::{find, href};
use super::problem::Problem;
use crate::accounts::access::Access;
use crate::jobs::query::StoredArtifact;
use crate::jobs::{ZIP, query};
use axum::Json;
use axum::body::Body;
use axum::extract::State;
use axum::http::{HeaderMap, Method};
use axum::response::Response;
use serde::Serialize;
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
        PartHeaders,
    ),
    responses(
        (status = 200, content((inline(super::api::AnyFile) = "*/*"), (inline(super::api::Binary) = "application/octet-stream")), description = "the bytes of the file", headers(("ETag" = String, description = "the SHA-256 of the file"))),
        (status = 206, content((inline(super::api::AnyFile) = "*/*"), (inline(super::api::Binary) = "application/octet-stream")), description = "the requested range of bytes", headers(("Content-Range" = String, description = "the range that is sent, and the length of the file"))),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "there is no such job or artifact"),
        PartAnswers,
    )
)]
pub async fn download(
    State(api): State<Api>,
    access: Access,
    Path((id, name)): Path<(String, String)>,
    method: Method,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let job = find(&api, &access, &id).await?;
    send(&api, &job, &name, &method, &headers).await
}

/// Downloads all artifacts of a job in one zip file
///
/// The whole file, or one range of it. The entity tag is the SHA-256 of the file. The media type is that of the file, or
/// application/octet-stream where `Accept` names only that.
#[utoipa::path(
    get, path = "/v1/jobs/{id}/model.zip", tag = "artifacts", operation_id = "get_zip",
    params(
        ("id" = String, Path, description = "the job"),
        PartHeaders,
    ),
    responses(
        (status = 200, content((inline(super::api::Binary) = "application/zip"), (inline(super::api::Binary) = "application/octet-stream")), description = "the bytes of the file", headers(("ETag" = String, description = "the SHA-256 of the file"))),
        (status = 206, content((inline(super::api::Binary) = "application/zip"), (inline(super::api::Binary) = "application/octet-stream")), description = "the requested range of bytes", headers(("Content-Range" = String, description = "the range that is sent, and the length of the file"))),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "there is no such job, or it has not succeeded"),
        PartAnswers,
    )
)]
pub async fn download_zip(
    State(api): State<Api>,
    access: Access,
    Path(id): Path<String>,
    method: Method,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let job = find(&api, &access, &id).await?;
    send(&api, &job, ZIP, &method, &headers).await
}

/// Sends a file of a job that was found.
async fn send(
    api: &Api,
    job: &query::Job,
    name: &str,
    method: &Method,
    headers: &HeaderMap,
) -> Result<Response, Problem> {
    let found = query::artifact_named(&api.storage.records, &job.id, name).await?;
    let artifact = found.ok_or_else(|| match &job.evaluation {
        // Its own file comes when it has succeeded.
        Some(evaluation) if !name.starts_with("evaluation.") => Problem::of_evaluation(&job.id, &evaluation.job),
        _ => Problem::no_artifact(name),
    })?;
    let facts = FileFacts {
        etag: format!("\"{}\"", artifact.sha256),
        name: artifact.name,
        media_type: artifact.media_type,
        byte_count: artifact.byte_count,
    };
    let bytes = async |range| Ok(Body::from_stream(api.storage.blobs.stream(&artifact.blob, range).await?));
    answer(&facts, method, headers, bytes).await
}
