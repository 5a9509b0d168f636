//! `/v1/uploads`: resumable uploads of ray files (tus 1.0.0).

use super::addresses::link;
use super::api::Api;
use super::extract::{Page, Path, Query, cut};
use super::problem::Problem;
use super::tus;
use super::upload_request::announcement;
use crate::accounts::access::Access;
use crate::metadata::Metadata;
use crate::ray_sets::announcement::Announcement;
use crate::ray_sets::declaration::FileDeclaration;
use crate::ray_sets::rows::LeftOut;
use crate::uploads::append::Piece;
use crate::uploads::checksum::Checksum;
use crate::uploads::rows::{Concat, State as UploadState};
use crate::uploads::signals::UploadResult;
use crate::uploads::{Error, refusal, rows};
use axum::Json;
use axum::body::Body;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use utoipa::ToSchema;

/// A resumable upload.
#[derive(Serialize, ToSchema)]
pub struct Upload {
    /// Identifier of this object.
    #[schema(format = Uuid)]
    id: String,
    /// State of the upload: `receiving` bytes, `finishing` (all bytes are there and are being read), `taken` (ray sets were made
    /// of it) or `refused`; a partial upload may also be `complete` (all bytes are there, but no final upload has them yet) or
    /// `joined` (its bytes belong to the upload `part_of`).
    #[schema(example = "receiving")]
    state: &'static str,
    /// Number of bytes received.
    offset: u64,
    /// Length of the whole file, bytes; null while it is not known.
    #[schema(required)]
    length: Option<u64>,
    /// Name of the file.
    name: String,
    /// What the client declared about the file.
    declared: FileDeclaration,
    /// The client's own metadata, which the ray sets that are made of the file get.
    metadata: Metadata,
    /// The ray sets that were made of the upload; empty until its state is `taken`.
    ray_sets: Vec<String>,
    /// Other files in the archive, and why they were left out.
    left_out: Vec<LeftOut>,
    /// Why the upload was `refused`; null otherwise.
    #[schema(required)]
    problem: Option<Problem>,
    /// The value of `Upload-Concat`: `partial`, or `final;` and the addresses of partial uploads; null without this header.
    #[schema(required)]
    concat: Option<String>,
    /// Identifier of the final upload that this `joined` upload is a piece of; null otherwise.
    #[schema(required, format = Uuid)]
    part_of: Option<String>,
    /// When the upload began, epoch ms.
    created_ms: i64,
    /// When the upload expires if no more bytes arrive, epoch ms. Ray sets that were made of it do not expire with it.
    expires_ms: i64,
    /// Addresses that belong to the upload.
    links: UploadLinks,
}

/// Addresses that belong to an upload.
#[derive(Serialize, ToSchema)]
pub struct UploadLinks {
    /// Address of this object.
    #[serde(rename = "self")]
    this: String,
    /// The ray sets that were made of the upload.
    ray_sets: Vec<String>,
}

/// Uploads, newest first.
#[derive(Serialize, ToSchema)]
pub struct UploadList {
    /// The entries of this page.
    uploads: Vec<Upload>,
    /// The value of `after` for the next page; null on the last page.
    #[schema(required)]
    next: Option<String>,
}

impl From<rows::Upload> for Upload {
    fn from(row: rows::Upload) -> Upload {
        let problem =
            (row.state == UploadState::Refused).then(|| refusal(&row).map_or_else(Problem::internal, Problem::from));
        let became =
            (row.state == UploadState::Taken).then(|| row.result.as_deref().map(serde_json::from_str::<UploadResult>));
        let UploadResult { ray_sets, left_out } = became.flatten().and_then(Result::ok).unwrap_or_default();
        let links = UploadLinks {
            this: address(&row.id),
            ray_sets: ray_sets.iter().map(|id| link(&format!("/v1/ray-sets/{id}"))).collect(),
        };
        Upload {
            state: row.state.name(),
            offset: row.offset,
            length: row.byte_count,
            name: row.name,
            declared: row.declared,
            metadata: row.client_metadata,
            ray_sets,
            left_out,
            problem,
            concat: row.concat.sent().map(str::to_owned),
            part_of: row.part_of,
            created_ms: row.created_ms,
            expires_ms: row.expires_ms,
            id: row.id,
            links,
        }
    }
}

fn address(id: &str) -> String {
    link(&format!("{}/{id}", tus::PATH))
}

/// Begins a resumable upload
///
/// The protocol is tus 1.0.0 with the extensions that OPTIONS names; any tus client works. `Upload-Metadata` may have `filename`
/// (or `name`), `length_unit`, `quantity`, `columns`, `metadata` (as in the query of `POST /v1/ray-sets`) and `sha256` (hex, of
/// the whole file). The body may carry the first bytes of the file.
///
/// A file may be sent as several pieces at the same time: each piece is an upload with `Upload-Concat: partial`. When all pieces
/// are complete, a request with `Upload-Concat: final;` and the addresses of the pieces, in order and separated by spaces (at
/// most 100), makes one upload of them, with the metadata of that request. The answer comes when the file has been read, as for
/// the last byte of any other upload. A partial upload can be used once; the same request, sent again, is answered with the same
/// upload.
#[utoipa::path(
    post, path = "/v1/uploads", tag = "uploads", operation_id = "create_upload",
    params(
        ("Tus-Resumable" = String, Header, pattern = "^1[.]0[.]0$", description = "`1.0.0`"),
        ("Upload-Length" = Option<u64>, Header, description = "the length of the whole file, bytes"),
        ("Upload-Defer-Length" = Option<String>, Header, description = "`1`: a later request gives the length"),
        ("Upload-Metadata" = Option<String>, Header, description = "`key base64,key base64,..`"),
        ("Upload-Checksum" = Option<String>, Header, description = "`sha1 <base64>` or `sha256 <base64>` of the body"),
        ("Upload-Concat" = Option<String>, Header, description = "`partial`, or `final;` and the addresses of partial uploads"),
        ("Repr-Digest" = Option<String>, Header, description = "`sha-256=:<base64>:` (RFC 9530) of the whole file, which the service verifies when all bytes are there"),
    ),
    request_body(content = inline(super::api::Binary), content_type = "application/octet-stream", description = "the first bytes of the file, or nothing; the type may also be application/offset+octet-stream, as tus has it"),
    responses(
        (status = 201, description = "the upload has begun", headers(("Location" = String, description = "the upload"), ("Upload-Offset" = u64, description = "the number of bytes received; absent for a final upload that is still being read"), ("Upload-Concat" = String, description = "the value that the client sent"), ("Upload-Expires" = String, description = "when the upload expires if no more bytes arrive"))),
        (status = 400, body = Problem, content_type = "application/problem+json", description = "the file or a header is malformed, or the file is empty"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "there is no such partial upload"),
        (status = 408, body = Problem, content_type = "application/problem+json", description = "the client sent too few bytes or none for too long"),
        (status = 409, body = Problem, content_type = "application/problem+json", description = "a partial upload is not complete, or is already part of another upload"),
        (status = 412, body = Problem, content_type = "application/problem+json", description = "the request uses another version of tus"),
        (status = 413, body = Problem, content_type = "application/problem+json", description = "the file is larger than this service accepts, or than the storage quota of the tenant allows"),
        (status = 415, body = Problem, content_type = "application/problem+json", description = "the Content-Type of the body is not supported"),
        (status = 422, body = Problem, content_type = "application/problem+json", description = "the file is refused, or the metadata is not valid"),
        (status = 460, body = Problem, content_type = "application/problem+json", description = "the checksum does not match; no upload was made"),
        (status = 500, body = Problem, content_type = "application/problem+json", description = "the process that reads the file ended each time it read it"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "the service is busy or stopping, or the database or the object store does not answer"),
        (status = 507, body = Problem, content_type = "application/problem+json", description = "the service has no storage space for this"),
    )
)]
pub async fn create(
    State(api): State<Api>,
    access: Access,
    mut headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    if api.draining.is_cancelled() {
        return Err(Problem::draining());
    }
    // It is about the bytes that come along; Upload-Checksum is what tells of them here.
    headers.remove("content-digest");
    let metadata = tus::metadata(&headers)?;
    let declared = metadata.query.declaration()?;
    let client_metadata = metadata.query.metadata;
    let announced = announcement(metadata.query.name, &headers, "rays")?;
    let sha256 = announced.sha256.iter().cloned().chain(metadata.sha256).collect();
    let body_bytes = announced.byte_count;
    let whole = Announcement { declared, sha256, metadata: client_metadata, ..announced };
    let new = Creating { concat: tus::concat(&headers)?, metadata: metadata.sent, whole };
    let upload = match &new.concat {
        Concat::Final { .. } => join(api, access, new, (&headers, body_bytes)).await?,
        Concat::Whole | Concat::Partial => begin(api, access, new, (&headers, body_bytes), body).await?,
    };
    let mut response = StatusCode::CREATED.into_response();
    tus::tell(response.headers_mut(), header::LOCATION, &address(&upload.id));
    tell_progress(response.headers_mut(), &upload);
    Ok(response)
}

/// An upload that is asked for.
struct Creating {
    concat: Concat,
    /// `Upload-Metadata`, as it was sent.
    metadata: String,
    whole: Announcement,
}

/// Begins an upload whose bytes are to come.
async fn begin(
    api: Api,
    access: Access,
    mut new: Creating,
    (headers, body_bytes): (&HeaderMap, Option<u64>),
    body: Body,
) -> Result<rows::Upload, Problem> {
    new.whole.byte_count = tus::length(headers)?;
    match first_piece(headers, body_bytes)? {
        Some(piece) => create_with(api, access, new, piece, body).await,
        None => {
            let is_partial = new.concat == Concat::Partial;
            Ok(api.uploads.create(&access.tenant, new.metadata, new.whole, is_partial).await?)
        }
    }
}

/// Makes an upload of partial ones. In a task of its own: it ends whether or not the client waits.
async fn join(
    api: Api,
    access: Access,
    new: Creating,
    (headers, body_bytes): (&HeaderMap, Option<u64>),
) -> Result<rows::Upload, Problem> {
    for name in [tus::LENGTH, tus::DEFER_LENGTH, tus::CHECKSUM] {
        if headers.contains_key(&name) {
            return Err(Problem::malformed_header(
                name.as_str(),
                "A final upload must not have this header: its bytes are those of its partial uploads.",
            ));
        }
    }
    if is_ours(headers) || body_bytes.unwrap_or(0) > 0 {
        let detail = "A final upload has no body: its bytes are those of its partial uploads.";
        return Err(Problem::malformed_header(tus::CONCAT.as_str(), detail));
    }
    let Creating { concat, metadata, whole } = new;
    to_its_end(async move {
        let sent = concat.sent().unwrap_or_default();
        api.uploads.join(&access.tenant, metadata, whole, sent, concat.partials()).await
    })
    .await
}

/// The bytes that come with the beginning, if any do.
fn first_piece(headers: &HeaderMap, byte_count: Option<u64>) -> Result<Option<Piece>, Problem> {
    let is_ours = is_ours(headers);
    // Without a type and without a length there is no body, or one of a client that says nothing: not ours to guess.
    if byte_count.unwrap_or(0) > 0 && !is_ours {
        return Err(wrong_type());
    }
    let piece = Piece { byte_count, checksum: tus::checksum(headers)?, ..Piece::default() };
    let has_bytes = is_ours && byte_count != Some(0);
    // That of a body that is not there is checked all the same.
    match has_bytes || piece.checksum.clone().is_none_or(Checksum::holds) {
        true => Ok(has_bytes.then_some(piece)),
        false => Err(Error::Checksum.into()),
    }
}

/// Begins an upload with its first bytes; where they fail nothing is begun, since its sender would not know of it. What was
/// refused is told by its answer alone.
async fn create_with(
    api: Api,
    access: Access,
    new: Creating,
    piece: Piece,
    body: Body,
) -> Result<rows::Upload, Problem> {
    to_its_end(async move {
        let Access { tenant, .. } = &access;
        let Creating { concat, metadata, whole } = new;
        let upload = api.uploads.create(tenant, metadata, whole, concat == Concat::Partial).await?;
        let appended = api.uploads.append(tenant, &upload.id, piece, body.into_data_stream()).await;
        if appended.is_err() {
            api.uploads.abandon(tenant, &upload.id).await;
        }
        appended
    })
    .await
}

/// Appends bytes to an upload
///
/// The body is appended to the bytes that the upload has. If the connection is lost, the bytes that arrived are kept, unless the
/// request has a checksum: HEAD says how many. The answer to the request with the last byte waits up to 10 seconds for the file
/// to be read; if the file is refused within that time, the answer is that refusal. Under `/v1/uploads`, the header
/// `X-HTTP-Method-Override` replaces the method of the request.
#[utoipa::path(
    patch, path = "/v1/uploads/{id}", tag = "uploads", operation_id = "append_to_upload",
    params(
        ("id" = String, Path, description = "the upload"),
        ("Tus-Resumable" = String, Header, pattern = "^1[.]0[.]0$", description = "`1.0.0`"),
        ("Upload-Offset" = u64, Header, description = "the number of bytes that the upload has before this request"),
        ("Upload-Length" = Option<u64>, Header, description = "the length of the whole file, bytes, if no request gave it before"),
        ("Upload-Checksum" = Option<String>, Header, description = "`sha1 <base64>` or `sha256 <base64>` of the body"),
    ),
    request_body(content = inline(super::api::Binary), content_type = "application/octet-stream", description = "the bytes that follow; the type may also be application/offset+octet-stream, as tus has it"),
    responses(
        (status = 204, description = "the bytes are stored", headers(("Upload-Offset" = u64, description = "the number of bytes that the upload has now"), ("Upload-Expires" = String, description = "when the upload expires if no more bytes arrive"))),
        (status = 400, body = Problem, content_type = "application/problem+json", description = "the file or a header is malformed; the body is truncated; the digest does not match"),
        (status = 403, body = Problem, content_type = "application/problem+json", description = "nothing can be appended to a final upload, or the API key lacks the scope uploads:write"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "there is no such upload"),
        (status = 408, body = Problem, content_type = "application/problem+json", description = "the client sent too few bytes or none for too long"),
        (status = 409, body = Problem, content_type = "application/problem+json", description = "Upload-Offset is not the number of bytes received, or the upload is complete"),
        (status = 412, body = Problem, content_type = "application/problem+json", description = "the request uses another version of tus"),
        (status = 413, body = Problem, content_type = "application/problem+json", description = "the body goes beyond the announced length, or the storage quota of the tenant"),
        (status = 415, body = Problem, content_type = "application/problem+json", description = "the Content-Type of the body is not supported"),
        (status = 422, body = Problem, content_type = "application/problem+json", description = "the file is refused"),
        (status = 460, body = Problem, content_type = "application/problem+json", description = "the checksum does not match; the bytes of this request were not stored"),
        (status = 500, body = Problem, content_type = "application/problem+json", description = "the process that reads the file ended each time it read it"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "the service is busy or stopping, or the database or the object store does not answer"),
        (status = 507, body = Problem, content_type = "application/problem+json", description = "the service has no storage space for this"),
    )
)]
pub async fn append(
    State(api): State<Api>,
    access: Access,
    Path(id): Path<String>,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    if api.draining.is_cancelled() {
        return Err(Problem::draining());
    }
    if !is_ours(&headers) {
        return Err(wrong_type());
    }
    let missing = || Problem::malformed_header(tus::OFFSET.as_str(), "The request has no Upload-Offset header.");
    let piece = Piece {
        offset: tus::bytes(&headers, &tus::OFFSET)?.ok_or_else(missing)?,
        byte_count: tus::bytes(&headers, &header::CONTENT_LENGTH)?,
        whole: tus::bytes(&headers, &tus::LENGTH)?,
        checksum: tus::checksum(&headers)?,
    };
    if headers.contains_key(tus::CONCAT) && find(&api, &access, &id).await?.concat == Concat::Whole {
        let remedy = "Send the request without this header; it belongs to the request that begins an upload.";
        return Err(Problem::not_honoured(tus::CONCAT.as_str(), "The upload is not a partial one.", remedy));
    }
    let (uploads, tenant, upload) = (api.uploads.clone(), access.tenant.clone(), id.clone());
    let appended = async move { uploads.append(&tenant, &upload, piece, body.into_data_stream()).await };
    match to_its_end(appended).await {
        Ok(upload) => {
            let mut response = StatusCode::NO_CONTENT.into_response();
            tell_progress(response.headers_mut(), &upload);
            Ok(response)
        }
        Err(problem) => Ok(refused(&api, &access, &id, problem).await),
    }
}

/// A refusal with the time until which the upload can be resumed: every answer to a PATCH tells it.
async fn refused(api: &Api, access: &Access, id: &str, problem: Problem) -> Response {
    let upload = rows::get(&api.storage.records, &access.tenant, id).await;
    let mut response = problem.into_response();
    // Where there is none, or nobody knows, there is no time to tell.
    if let Ok(Some(upload)) = upload {
        tus::tell(response.headers_mut(), tus::EXPIRES, &tus::date(upload.expires_ms));
    }
    response
}

/// Takes bytes in a task of its own: when the client goes away its handler is dropped, and what came must still be stored.
async fn to_its_end(
    taking: impl Future<Output = Result<rows::Upload, Error>> + Send + 'static,
) -> Result<rows::Upload, Problem> {
    let taken = tokio::spawn(taking).await.map_err(|error| {
        tracing::error!(%error, "the task of an upload panicked");
        Problem::internal()
    })?;
    Ok(taken?)
}

fn is_ours(headers: &HeaderMap) -> bool {
    let media_type = headers.get(header::CONTENT_TYPE).and_then(|value| value.to_str().ok()).unwrap_or_default();
    [tus::MEDIA_TYPE, tus::PLAIN_TYPE].iter().any(|known| media_type.trim().eq_ignore_ascii_case(known))
}

fn wrong_type() -> Problem {
    let remedy = "Send the bytes with Content-Type: application/offset+octet-stream.";
    Problem::media_type("The Content-Type of the body is not that of tus.", remedy)
}

fn tell_progress(headers: &mut HeaderMap, upload: &rows::Upload) {
    // Until the pieces of a final upload are one file, its offset is not told.
    if upload.concat.partials().is_empty() || upload.state == UploadState::Taken {
        tus::tell(headers, tus::OFFSET, &upload.offset.to_string());
    }
    if let Some(sent) = upload.concat.sent() {
        tus::tell(headers, tus::CONCAT, sent);
    }
    tus::tell(headers, tus::EXPIRES, &tus::date(upload.expires_ms));
}

/// Returns the number of bytes received of an upload
#[utoipa::path(
    head, path = "/v1/uploads/{id}", tag = "uploads", operation_id = "upload_offset",
    params(("id" = String, Path, description = "the upload")),
    responses(
        (status = 200, description = "the headers have the number of bytes received", headers(("Upload-Offset" = u64, description = "the number of bytes received; absent for a final upload that is still being read"), ("Upload-Length" = u64, description = "the length of the whole file, bytes; absent while it is not known"), ("Upload-Defer-Length" = String, description = "`1` while the length is not known"), ("Upload-Metadata" = String, description = "the value that the client sent"), ("Upload-Concat" = String, description = "the value that the client sent"), ("Upload-Expires" = String, description = "when the upload expires if no more bytes arrive"))),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "there is no such upload"),
        (status = 410, body = Problem, content_type = "application/problem+json", description = "the upload was refused; GET says why"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "the service is busy, or the database or the object store does not answer"),
    )
)]
pub async fn offset(State(api): State<Api>, access: Access, Path(id): Path<String>) -> Result<Response, Problem> {
    let upload = find(&api, &access, &id).await?;
    if upload.state == UploadState::Refused {
        let mut response = Problem::gone(&id).into_response();
        if let Some(sent) = upload.concat.sent() {
            tus::tell(response.headers_mut(), tus::CONCAT, sent);
        }
        return Ok(response);
    }
    let mut response = StatusCode::OK.into_response();
    let headers = response.headers_mut();
    tell_progress(headers, &upload);
    match upload.byte_count {
        Some(length) => tus::tell(headers, tus::LENGTH, &length.to_string()),
        None => tus::tell(headers, tus::DEFER_LENGTH, "1"),
    }
    if !upload.metadata.is_empty() {
        tus::tell(headers, tus::METADATA, &upload.metadata);
    }
    Ok(response)
}

/// Returns an upload and its result
#[utoipa::path(
    get, path = "/v1/uploads/{id}", tag = "uploads", operation_id = "get_upload",
    params(("id" = String, Path, description = "the upload")),
    responses(
        (status = 200, body = Upload, description = "the upload"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "there is no such upload"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "the service is busy, or the database or the object store does not answer"),
    )
)]
pub async fn get(State(api): State<Api>, access: Access, Path(id): Path<String>) -> Result<Json<Upload>, Problem> {
    Ok(Json(find(&api, &access, &id).await?.into()))
}

async fn find(api: &Api, access: &Access, id: &str) -> Result<rows::Upload, Problem> {
    let upload = rows::get(&api.storage.records, &access.tenant, id).await?;
    upload.ok_or_else(|| Problem::no_upload(id))
}

/// Lists uploads, newest first
///
/// The list has the unfinished uploads, and the ended ones that have not expired.
#[utoipa::path(
    get, path = "/v1/uploads", tag = "uploads", operation_id = "list_uploads", params(Page),
    responses(
        (status = 200, body = UploadList, description = "one page of the list"),
        (status = 422, body = Problem, content_type = "application/problem+json", description = "the query is not valid"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "the service is busy, or the database or the object store does not answer"),
    )
)]
pub async fn list(
    State(api): State<Api>,
    access: Access,
    Query(page): Query<Page>,
) -> Result<Json<UploadList>, Problem> {
    let limit = Page::limit(page.limit)?;
    let rows = rows::list(&api.storage.records, &access.tenant, page.after.as_deref(), limit as i64 + 1).await?;
    let (rows, next) = cut(rows, limit, |row| &row.id);
    Ok(Json(UploadList { uploads: rows.into_iter().map(Upload::from).collect(), next }))
}

/// Deletes an upload
///
/// The bytes of the upload are deleted. Ray sets that were made of it are not.
#[utoipa::path(
    delete, path = "/v1/uploads/{id}", tag = "uploads", operation_id = "delete_upload",
    params(("id" = String, Path, description = "the upload")),
    responses(
        (status = 204, description = "the upload is deleted"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "there is no such upload"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "the database or the object store does not answer"),
    )
)]
pub async fn delete(State(api): State<Api>, access: Access, Path(id): Path<String>) -> Result<StatusCode, Problem> {
    api.uploads.delete(&access.tenant, &id).await.map_err(|error: Error| Problem::from(error))?;
    Ok(StatusCode::NO_CONTENT)
}
