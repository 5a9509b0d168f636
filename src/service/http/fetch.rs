//! `/v1/ray-sets/ingest`: ray files that are fetched instead of sent.

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

/// A ray file that is elsewhere.
#[derive(Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Elsewhere {
    /// Where: `https://..`, or `s3://bucket/key` in a bucket that the operator allows.
    #[schema(pattern = "^(https?|s3)://", max_length = 2048)]
    url: String,
    /// What to call it; else the last part of the address.
    #[serde(default)]
    #[schema(max_length = 255)]
    name: Option<String>,
    /// Its SHA-256, hex: verified when given.
    #[serde(default)]
    #[schema(pattern = "^[0-9a-fA-F]{64}$")]
    sha256: Option<String>,
    /// Unit of its positions; goes before the file's own word.
    #[serde(default)]
    length_unit: Option<LengthUnit>,
    /// What its flux values are, W or lm; goes before the file's own word.
    #[serde(default)]
    quantity: Option<QuantityName>,
    /// What stands in each column, for text in columns only.
    #[serde(default)]
    columns: Option<Vec<String>>,
    /// The client's own keys and values, which every ray set that comes of it gets.
    #[serde(default)]
    #[schema(nullable)]
    metadata: Metadata,
}

impl Elsewhere {
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

/// Fetches a ray file, or those in a packed one
///
/// As if it had been sent: the same bounds, the same answer. It is answered when all of it is there, however long that takes; if the
/// connection breaks before, nothing is kept, and asking again is right. An address must be the internet's, and so must be each
/// of at most three redirects.
#[utoipa::path(
    post, path = "/v1/ray-sets/ingest", tag = "ray sets", operation_id = "ingest_ray_set", request_body = Elsewhere,
    responses(
        (status = 201, body = Taken, description = "taken in", headers(("Location" = String, description = "the ray set, or the list where there are several"))),
        (status = 400, body = Problem, content_type = "application/problem+json", description = "not JSON; a malformed file; wrong digest"),
        (status = 413, body = Problem, content_type = "application/problem+json", description = "larger than this service takes, or than there is quota for"),
        (status = 415, body = Problem, content_type = "application/problem+json", description = "not JSON by its Content-Type"),
        (status = 422, body = Problem, content_type = "application/problem+json", description = "unknown field, wrong type; an address that is refused; a file that is refused"),
        (status = 502, body = Problem, content_type = "application/problem+json", description = "the address does not answer, gives no file, or breaks off"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "busy, stopping, or a store that does not answer"),
        (status = 504, body = Problem, content_type = "application/problem+json", description = "the file came too slowly"),
        (status = 507, body = Problem, content_type = "application/problem+json", description = "no room for more"),
    )
)]
pub async fn ingest(State(api): State<Api>, access: Access, Body(from): Body<Elsewhere>) -> Result<Response, Problem> {
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
        tracing::error!(%error, "a file that is fetched stopped");
        Problem::internal()
    })??;
    known(&reader, taken).await
}
