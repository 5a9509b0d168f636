//! `/v1/ray-sets/ingest`: fetches ray files from URLs instead of receiving them.

use super::api::Api;
use super::extract::Body;
use super::problem::Problem;
use super::ray_sets::{Taken, known};
use super::upload_request::{percent_decoded, plain};
use crate::accounts::access::Access;
use crate::metadata::Metadata;
use crate::ray_sets::announcement::Announcement;
use crate::ray_sets::declaration::{FileDeclaration, LengthUnit, QuantityName};
use crate::ray_sets::error::in_query;
use axum::extract::State;
use axum::response::Response;
use serde::{Deserialize, Serialize};
use tokio_util::sync::CancellationToken;
use utoipa::ToSchema;

/// A request to fetch a ray file from a URL.
#[derive(Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct IngestRequest {
    /// URL of the file: `https://..`, or `s3://bucket/key` in a bucket that the operator allows.
    #[schema(pattern = "^(https?|s3)://", max_length = 2048)]
    url: String,
    /// Name of the file. Default: the last part of the URL.
    #[serde(default)]
    #[schema(max_length = 255)]
    name: Option<String>,
    /// SHA-256 of the file, hex; the service verifies it.
    #[serde(default)]
    #[schema(pattern = "^[0-9a-fA-F]{64}$")]
    sha256: Option<String>,
    /// The length unit of the positions in the file; overrides what the file says.
    #[serde(default)]
    length_unit: Option<LengthUnit>,
    /// Whether the flux values in the file are radiant (W) or luminous (lm); overrides what the file says.
    #[serde(default)]
    quantity: Option<QuantityName>,
    /// The meaning of each column, for text files only; names as in a channel.
    #[serde(default)]
    columns: Option<Vec<String>>,
    /// The client's own metadata, which every ray set that is made of the file gets.
    #[serde(default)]
    #[schema(nullable)]
    metadata: Metadata,
}

impl IngestRequest {
    fn announcement(self) -> Result<Announcement, Problem> {
        let path = self.url.split(['?', '#']).next().unwrap_or_default();
        let last = percent_decoded(path.rsplit('/').next().unwrap_or_default());
        let hex = |text: &String| text.len() == 64 && text.bytes().all(|byte| byte.is_ascii_hexdigit());
        if self.sha256.as_ref().is_some_and(|sha256| !hex(sha256)) {
            return Err(Problem::out_of_range("sha256", "64 hex digits"));
        }
        let declared =
            FileDeclaration { length_unit: self.length_unit, quantity: self.quantity, columns: self.columns };
        declared.resolve().map_err(in_query)?;
        Ok(Announcement {
            name: plain(self.name.as_deref().unwrap_or(&last), "rays")?,
            sha256: self.sha256.map(|sha256| sha256.to_ascii_lowercase()).into_iter().collect(),
            declared,
            metadata: self.metadata,
            gone: CancellationToken::new(),
            ..Announcement::default()
        })
    }
}

/// Fetches a ray file, or an archive of ray files, from a URL
///
/// The fetched file is treated as if the client had uploaded it: the same limits and the same answer apply. The answer comes when
/// the whole file has arrived, however long that takes. If the connection of the client is lost before that, nothing is stored;
/// send the request again. The host of the URL, and of each of at most three redirects, must have a public internet address.
#[utoipa::path(
    post, path = "/v1/ray-sets/ingest", tag = "ray sets", operation_id = "ingest_ray_set", request_body = IngestRequest,
    responses(
        (status = 201, body = Taken, description = "the file is stored", headers(("Location" = String, description = "the address of the ray set, or of the list of ray sets where there are several"))),
        (status = 400, body = Problem, content_type = "application/problem+json", description = "the body is not JSON; the file is malformed; the digest does not match"),
        (status = 413, body = Problem, content_type = "application/problem+json", description = "the file is larger than this service accepts, or than the storage quota of the tenant allows"),
        (status = 415, body = Problem, content_type = "application/problem+json", description = "the Content-Type is not application/json"),
        (status = 422, body = Problem, content_type = "application/problem+json", description = "a field is unknown or of the wrong type; the URL is refused; the file is refused"),
        (status = 502, body = Problem, content_type = "application/problem+json", description = "the server at the URL does not answer, gives no file, or stops in the middle of it"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "the service is busy or stopping, or the database or the object store does not answer"),
        (status = 504, body = Problem, content_type = "application/problem+json", description = "the server at the URL sent the file too slowly"),
        (status = 507, body = Problem, content_type = "application/problem+json", description = "the service has no storage space for this"),
    )
)]
pub async fn ingest(
    State(api): State<Api>,
    access: Access,
    Body(from): Body<IngestRequest>,
) -> Result<Response, Problem> {
    if api.draining.is_cancelled() {
        return Err(Problem::draining());
    }
    let url = from.url.clone();
    let announcement = from.announcement()?;
    let coming = api.ingest.open(&url).await?;
    if !api.space.has_room_for(coming.byte_count.unwrap_or(0)) {
        return Err(Problem::low_space());
    }
    let _gone = announcement.gone.clone().drop_guard();
    let (reader, at_hand) = (api.clone(), api.metrics.upload());
    // A task of its own: when the client goes away this handler is dropped, and what was stored must still be cleaned up.
    let taken = tokio::spawn(async move {
        let (_at_hand, metrics) = (at_hand, api.metrics.clone());
        coming.take(&api.intake, &access.tenant, announcement, move |bytes| metrics.upload_bytes(bytes)).await
    });
    let taken = taken.await.map_err(|error| {
        tracing::error!(%error, "the task that fetches a file panicked");
        Problem::internal()
    })??;
    known(&reader, taken).await
}
