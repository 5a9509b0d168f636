//! `/v1/ray-sets`: uploads, lists, returns and deletes ray sets.

use super::addresses::link;
use super::api::Api;
use super::extract::{Page, Path, Query, cut};
use super::files::disposition;
use super::problem::Problem;
use super::ranges::{Wanted, media_type, wanted};
use super::upload_request::{RaySetPage, UploadQuery, announcement};
use crate::accounts::access::Access;
use crate::metadata::Metadata;
use crate::ray_sets;
use crate::ray_sets::announcement::Announcement;
use crate::ray_sets::declaration::FileDeclaration;
use crate::ray_sets::inspections::Drawing;
use crate::ray_sets::rows::{Deletion, LeftOut};
use crate::ray_sets::{inspections, rows};
use axum::Json;
use axum::body::Body;
use axum::extract::State;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use serde_json::Value;
use tokio_util::sync::CancellationToken;
use utoipa::ToSchema;

/// Drawings of an inspection.
const ORIGINS: &str = "origins.svg";
const FAR_FIELD: &str = "far-field.svg";
/// The media type of a drawing.
const SVG: &str = "image/svg+xml";

/// A ray set: a ray file that the service has stored.
#[derive(Serialize, ToSchema)]
pub struct RaySet {
    /// Identifier of this object.
    #[schema(format = Uuid)]
    id: String,
    /// Name of the file.
    name: String,
    /// Length of the ray file, bytes.
    byte_count: u64,
    /// SHA-256 of the file, lower-case hex.
    sha256: String,
    /// What the file says: its format, ray count, total fluxes, spectrum and texts (texts are not in lists).
    #[schema(value_type = Object)]
    header: Value,
    /// What the client declared about the file when it was uploaded; a channel of a job may override it.
    declared: FileDeclaration,
    /// The inspection of the rays, with a verdict for each check (`inspection.schema.json`); null in lists, and for files from
    /// versions without inspections.
    #[schema(value_type = Option<Object>, required)]
    inspection: Option<Value>,
    /// The archive that the file was unpacked from; null if it was not in one.
    #[schema(required)]
    packed: Option<Packed>,
    /// The client's own metadata.
    metadata: Metadata,
    /// When the upload of the file was complete, epoch ms.
    created_ms: i64,
    /// Addresses that belong to the ray set.
    links: RaySetLinks,
}

/// The gzip, zstd or zip archive that ray sets were unpacked from; the archive itself is not kept.
#[derive(Serialize, ToSchema)]
pub struct Packed {
    /// Name of the file.
    name: String,
    /// SHA-256 of the file, lower-case hex.
    sha256: String,
    /// Other files in the archive, and why they were left out; at most 100 of them.
    left_out: Vec<LeftOut>,
}

/// The result of an upload.
#[derive(Serialize, ToSchema)]
pub struct Taken {
    /// The ray sets: one, or one for each ray file in an archive.
    ray_sets: Vec<RaySet>,
    /// Other files in the archive, and why they were left out.
    left_out: Vec<LeftOut>,
}

/// Addresses that belong to a ray set.
#[derive(Serialize, ToSchema)]
pub struct RaySetLinks {
    /// Address of this object.
    #[serde(rename = "self")]
    this: String,
    /// Drawing of the ray origins; null without an inspection or without usable rays.
    #[schema(required)]
    origins: Option<String>,
    /// Drawing of the far-field intensity; null without an inspection or without usable rays.
    #[schema(required)]
    far_field: Option<String>,
}

/// Ray sets, newest first.
#[derive(Serialize, ToSchema)]
pub struct RaySetList {
    /// The entries of this page, without the texts of their headers, which may be long.
    ray_sets: Vec<RaySet>,
    /// The value of `after` for the next page; null on the last page.
    #[schema(required)]
    next: Option<String>,
}

impl From<rows::RaySet> for RaySet {
    fn from(row: rows::RaySet) -> RaySet {
        RaySet {
            links: RaySetLinks { this: link(&format!("/v1/ray-sets/{}", row.id)), origins: None, far_field: None },
            id: row.id,
            name: row.name,
            byte_count: row.byte_count,
            sha256: row.sha256,
            header: serde_json::from_str(&row.header).unwrap_or_default(),
            declared: row.declared,
            inspection: None,
            packed: row.packed.map(|rows::Packed { name, sha256, left_out }| Packed { name, sha256, left_out }),
            metadata: row.metadata,
            created_ms: row.created_ms,
        }
    }
}

impl RaySet {
    /// With its inspection, whose header has the texts too.
    async fn inspected(api: &Api, row: rows::RaySet) -> Result<RaySet, Problem> {
        let json = inspections::get(&api.storage.records, &row.id).await?;
        let mut ray_set = RaySet::from(row);
        let mut found: Option<Value> = json.and_then(|json| serde_json::from_str(&json).ok());
        if let Some(found) = found.as_mut().and_then(Value::as_object_mut) {
            if let Some(header) = found.remove("header") {
                ray_set.header = header;
            }
            if found.get("rays_used").and_then(Value::as_u64) > Some(0) {
                ray_set.links.origins = Some(format!("{}/{ORIGINS}", ray_set.links.this));
                ray_set.links.far_field = Some(format!("{}/{FAR_FIELD}", ray_set.links.this));
            }
        }
        ray_set.inspection = found;
        Ok(ray_set)
    }

    /// As one of a list.
    fn listed(row: rows::RaySet) -> RaySet {
        let mut ray_set = RaySet::from(row);
        if let Some(header) = ray_set.header.as_object_mut() {
            header.remove("texts");
        }
        ray_set
    }
}

/// Uploads a ray file, or an archive of ray files
///
/// The body is the file. A file whose beginning is not that of a ray file is refused at once. A readable file is stored and
/// inspected ray by ray; `inspection.verdict` says whether a job would accept it. A gzip, zstd or zip file is unpacked when all
/// of it has arrived: each ray file in it becomes a ray set, all of them at the same moment. The declarations in the query apply
/// to every one of these files.
#[utoipa::path(
    post, path = "/v1/ray-sets", tag = "ray sets", operation_id = "upload_ray_set",
    params(
        UploadQuery,
        ("Repr-Digest" = Option<String>, Header, description = "`sha-256=:<base64>:` (RFC 9530); the service verifies it"),
        ("Content-Digest" = Option<String>, Header, description = "the same as Repr-Digest"),
    ),
    request_body(content = inline(super::api::Binary), content_type = "application/octet-stream", description = "a ray file (IES TM-25, Zemax, LightTools, Speos, ASAP, TracePro, text in columns), as it is or packed with gzip, zstd or zip"),
    responses(
        (status = 201, body = Taken, description = "the file is stored", headers(("Location" = String, description = "the address of the ray set, or of the list of ray sets where there are several"))),
        (status = 400, body = Problem, content_type = "application/problem+json", description = "the file, a header or the query is malformed; the body is truncated; the digest does not match"),
        (status = 408, body = Problem, content_type = "application/problem+json", description = "the client sent too few bytes or none for too long"),
        (status = 413, body = Problem, content_type = "application/problem+json", description = "the file is larger than this service accepts, or than the storage quota of the tenant allows"),
        (status = 415, body = Problem, content_type = "application/problem+json", description = "the body is an HTML form, or has a Content-Encoding"),
        (status = 422, body = Problem, content_type = "application/problem+json", description = "the file is refused, or the query is not valid"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "the service is busy or stopping, or the database or the object store does not answer"),
        (status = 507, body = Problem, content_type = "application/problem+json", description = "the service has no storage space for this"),
    )
)]
pub async fn upload(
    State(api): State<Api>,
    access: Access,
    Query(query): Query<UploadQuery>,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    if api.draining.is_cancelled() {
        return Err(Problem::draining());
    }
    let declared = query.declaration()?;
    let metadata = query.metadata;
    let mut announcement = Announcement { declared, metadata, ..announcement(query.name, &headers, "rays")? };
    if announcement.byte_count.is_some_and(|bytes| bytes > api.intake.max_bytes) {
        return Err(ray_sets::Error::TooLarge(api.intake.max_bytes).into());
    }
    announcement.gone = CancellationToken::new();
    let _gone = announcement.gone.clone().drop_guard();
    let reader = api.clone();
    // A task of its own: when the client goes away this handler is dropped, and what was stored must still be cleaned up.
    let taken =
        tokio::spawn(async move { api.intake.take(&access.tenant, announcement, body.into_data_stream()).await });
    let taken = taken.await.map_err(|error| {
        tracing::error!(%error, "the task of an upload panicked");
        Problem::internal()
    })??;
    known(&reader, taken).await
}

/// The answer to the upload of these ray sets.
pub(super) async fn known(api: &Api, taken: ray_sets::Taken) -> Result<Response, Problem> {
    let mut answer = Taken { ray_sets: Vec::new(), left_out: taken.left_out };
    for row in taken.ray_sets {
        answer.ray_sets.push(RaySet::inspected(api, row).await?);
    }
    let location = match answer.ray_sets.as_slice() {
        [ray_set] => ray_set.links.this.clone(),
        _ => link("/v1/ray-sets"),
    };
    Ok((StatusCode::CREATED, [(header::LOCATION, location)], Json(answer)).into_response())
}

/// Lists ray sets, newest first
#[utoipa::path(
    get, path = "/v1/ray-sets", tag = "ray sets", operation_id = "list_ray_sets", params(RaySetPage),
    responses(
        (status = 200, body = RaySetList, description = "one page of the list"),
        (status = 422, body = Problem, content_type = "application/problem+json", description = "the query is not valid"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "the service is busy, or the database or the object store does not answer"),
    )
)]
pub async fn list(
    State(api): State<Api>,
    access: Access,
    Query(page): Query<RaySetPage>,
) -> Result<Json<RaySetList>, Problem> {
    let limit = Page::limit(page.limit)?;
    let (name, sha256) = (page.name.as_deref(), page.sha256.map(|digest| digest.to_ascii_lowercase()));
    if sha256.as_ref().is_some_and(|digest| digest.len() != 64 || !digest.bytes().all(|b| b.is_ascii_hexdigit())) {
        return Err(Problem::out_of_range("sha256", "64 hexadecimal digits"));
    }
    let wanted = rows::Wanted { name, sha256: sha256.as_deref(), metadata: page.metadata };
    let (records, after) = (&api.storage.records, page.after.as_deref());
    let rows = rows::list(records, &access.tenant, wanted, after, limit as i64 + 1).await?;
    let (rows, next) = cut(rows, limit, |row| &row.id);
    Ok(Json(RaySetList { ray_sets: rows.into_iter().map(RaySet::listed).collect(), next }))
}

/// Returns a ray set
#[utoipa::path(
    get, path = "/v1/ray-sets/{id}", tag = "ray sets", operation_id = "get_ray_set",
    params(("id" = String, Path, description = "the ray set")),
    responses(
        (status = 200, body = RaySet, description = "the ray set"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "there is no such ray set"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "the service is busy, or the database or the object store does not answer"),
    )
)]
pub async fn get(State(api): State<Api>, access: Access, Path(id): Path<String>) -> Result<Json<RaySet>, Problem> {
    Ok(Json(RaySet::inspected(&api, find(&api, &access, &id).await?).await?))
}

/// The ray set `id` of the tenant of the request, or 404.
async fn find(api: &Api, access: &Access, id: &str) -> Result<rows::RaySet, Problem> {
    let row = rows::get(&api.storage.records, &access.tenant, id).await?;
    row.ok_or_else(|| Problem::no_ray_set(id))
}

/// Draws the origins of the rays of a ray set
///
/// The drawing shows three projections on one scale, mm: the density of a sample of the ray origins.
#[utoipa::path(
    get, path = "/v1/ray-sets/{id}/origins.svg", tag = "ray sets", operation_id = "get_origins_drawing",
    params(
        ("id" = String, Path, description = "the ray set"),
        ("If-None-Match" = Option<String>, Header, description = "entity tags of the copies that the client has; 304 if one of them is current"),
        ("If-Match" = Option<String>, Header, description = "entity tags, one of which the file must have; otherwise 412"),
    ),
    responses(
        (status = 200, content((String = "image/svg+xml"), (inline(super::api::Binary) = "application/octet-stream")), description = "the drawing as SVG; as application/octet-stream where `Accept` names only that", headers(("ETag" = String, description = "the SHA-256 of the file"))),
        (status = 304, description = "the copy of the client is current"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "there is no such ray set or drawing"),
        (status = 412, body = Problem, content_type = "application/problem+json", description = "the file does not have an entity tag that `If-Match` names"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "the service is busy, or the database or the object store does not answer"),
    )
)]
pub async fn origins(
    State(api): State<Api>,
    access: Access,
    Path(id): Path<String>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    drawing(&api, &access, &id, ORIGINS, &headers).await
}

/// Draws the far-field intensity of a ray set
///
/// The drawing shows the intensity in the planes C0-180 and C90-270 about the main direction, in bins of 5° by 10°.
#[utoipa::path(
    get, path = "/v1/ray-sets/{id}/far-field.svg", tag = "ray sets", operation_id = "get_far_field_drawing",
    params(
        ("id" = String, Path, description = "the ray set"),
        ("If-None-Match" = Option<String>, Header, description = "entity tags of the copies that the client has; 304 if one of them is current"),
        ("If-Match" = Option<String>, Header, description = "entity tags, one of which the file must have; otherwise 412"),
    ),
    responses(
        (status = 200, content((String = "image/svg+xml"), (inline(super::api::Binary) = "application/octet-stream")), description = "the drawing as SVG; as application/octet-stream where `Accept` names only that", headers(("ETag" = String, description = "the SHA-256 of the file"))),
        (status = 304, description = "the copy of the client is current"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "there is no such ray set or drawing"),
        (status = 412, body = Problem, content_type = "application/problem+json", description = "the file does not have an entity tag that `If-Match` names"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "the service is busy, or the database or the object store does not answer"),
    )
)]
pub async fn far_field(
    State(api): State<Api>,
    access: Access,
    Path(id): Path<String>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    drawing(&api, &access, &id, FAR_FIELD, &headers).await
}

async fn drawing(api: &Api, access: &Access, id: &str, name: &str, headers: &HeaderMap) -> Result<Response, Problem> {
    find(api, access, id).await?;
    let found = inspections::drawing(&api.storage.records, id, name).await?;
    let Drawing { sha256, svg, .. } = found.ok_or_else(|| Problem::no_drawing(name))?;
    let etag = format!("\"{sha256}\"");
    // A drawing is small: a range is answered with all of it.
    let asked = wanted(headers, &etag, svg.len() as u64);
    if asked == Wanted::Changed {
        return Err(Problem::changed(&etag));
    }
    let known = asked == Wanted::Nothing;
    let mut response = if known { StatusCode::NOT_MODIFIED.into_response() } else { svg.into_response() };
    let headers = response.headers_mut();
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("private, no-cache"));
    if let Ok(etag) = HeaderValue::try_from(etag) {
        headers.insert(header::ETAG, etag);
    }
    if !known {
        let media_type = media_type(headers, SVG);
        headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(media_type));
        headers.insert(header::VARY, HeaderValue::from_static("accept"));
        if let Ok(disposition) = HeaderValue::try_from(disposition(name, media_type)) {
            headers.insert(header::CONTENT_DISPOSITION, disposition);
        }
    }
    Ok(response)
}

/// Deletes a ray set
///
/// Jobs that have ended keep their artifacts.
#[utoipa::path(
    delete, path = "/v1/ray-sets/{id}", tag = "ray sets", operation_id = "delete_ray_set",
    params(("id" = String, Path, description = "the ray set")),
    responses(
        (status = 204, description = "the ray set is deleted"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "there is no such ray set"),
        (status = 409, body = Problem, content_type = "application/problem+json", description = "an unfinished job needs it; cancel the job, or wait for its end"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "the database or the object store does not answer"),
    )
)]
pub async fn delete(State(api): State<Api>, access: Access, Path(id): Path<String>) -> Result<StatusCode, Problem> {
    match rows::delete(&api.storage.records, &access.tenant, &id).await? {
        Deletion::Missing => Err(Problem::no_ray_set(&id)),
        Deletion::Needed => Err(Problem::ray_set_needed(&id)),
        Deletion::Deleted(folders) => {
            api.storage.blobs.delete_folders(&folders).await?;
            Ok(StatusCode::NO_CONTENT)
        }
    }
}
