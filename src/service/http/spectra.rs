//! `/v1/spectra`: spectra of channels, from files of their own.

use super::addresses::link;
use super::api::Api;
use super::extract::{Page, Path, Query, bytes_up_to, cut};
use super::problem::Problem;
use super::upload_request::{Naming, announcement};
use crate::accounts::access::Access;
use crate::failure::StoredNotice;
use crate::hex::hex;
use crate::jobs::request::NumberPair;
use crate::ray_sets::rows::Deletion;
use crate::storage::keys::new_id;
use crate::{ray_sets, spectra};
use axum::Json;
use axum::body::Body;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use pipeline::MAX_SPECTRUM_BYTES;
use serde::Serialize;
use sha2::{Digest, Sha256};
use utoipa::ToSchema;

/// A spectrum file as it was read.
#[derive(Serialize, ToSchema)]
pub struct Spectrum {
    /// Its identifier.
    #[schema(format = Uuid)]
    id: String,
    /// What it was called.
    name: String,
    /// SHA-256 of the file, lower-case hex.
    sha256: String,
    /// What the file is: two columns, LightTools .sre, Speos .spectrum.
    format: String,
    /// Points of its table.
    points: u64,
    /// First and last wavelength, nm.
    #[schema(value_type = NumberPair)]
    range_nm: (f64, f64),
    /// Luminous efficacy of its radiation, lm/W.
    lm_per_w: f64,
    /// Its table: wavelength, nm, and spectral density, in the file's scale; null in lists.
    #[schema(value_type = Option<Vec<NumberPair>>, required)]
    nm_value: Option<Vec<(f64, f64)>>,
    /// What was repaired or odd.
    notices: Vec<StoredNotice>,
    /// When it was read, epoch ms.
    created_ms: i64,
    /// Where it is.
    links: SpectrumLinks,
}

/// Where a spectrum is.
#[derive(Serialize, ToSchema)]
pub struct SpectrumLinks {
    /// Itself.
    #[serde(rename = "self")]
    this: String,
}

/// Spectra, newest first.
#[derive(Serialize, ToSchema)]
pub struct SpectrumList {
    /// One page of them, without their tables.
    spectra: Vec<Spectrum>,
    /// The `after` of the next page; null on the last.
    #[schema(required)]
    next: Option<String>,
}

impl From<spectra::Spectrum> for Spectrum {
    fn from(row: spectra::Spectrum) -> Spectrum {
        Spectrum {
            links: SpectrumLinks { this: link(&format!("/v1/spectra/{}", row.id)) },
            nm_value: row.points().ok(),
            id: row.id,
            name: row.name,
            sha256: row.sha256,
            format: row.format,
            points: row.point_count,
            range_nm: row.range_nm,
            lm_per_w: row.lm_per_w,
            notices: serde_json::from_str(&row.notices).unwrap_or_default(),
            created_ms: row.created_ms,
        }
    }
}

/// Takes in a spectrum file
///
/// The body is the file: text of two columns (wavelength in nm or µm, spectral density) under any header, LightTools .sre, Zemax
/// .spcd or Speos .spectrum 1.0. Jobs name it as the spectrum of a channel.
#[utoipa::path(
    post, path = "/v1/spectra", tag = "spectra", operation_id = "upload_spectrum",
    params(
        Naming,
        ("Repr-Digest" = Option<String>, Header, description = "`sha-256=:<base64>:` (RFC 9530): verified when sent"),
        ("Content-Digest" = Option<String>, Header, description = "as Repr-Digest"),
    ),
    request_body(content = inline(super::api::Binary), content_type = "application/octet-stream", description = "a spectrum, at most 1 MiB"),
    responses(
        (status = 201, body = Spectrum, description = "taken in", headers(("Location" = String, description = "the spectrum"))),
        (status = 400, body = Problem, content_type = "application/problem+json", description = "malformed file, header or query; truncated body; wrong digest"),
        (status = 413, body = Problem, content_type = "application/problem+json", description = "larger than a spectrum is, or than there is quota for"),
        (status = 415, body = Problem, content_type = "application/problem+json", description = "a form or an encoded body"),
        (status = 422, body = Problem, content_type = "application/problem+json", description = "a file that is refused; an unusable query"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "busy, stopping, or a store that does not answer"),
    )
)]
pub async fn upload(
    State(api): State<Api>,
    access: Access,
    Query(naming): Query<Naming>,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    if api.draining.is_cancelled() {
        return Err(Problem::draining());
    }
    let announcement = announcement(naming.name, &headers, "spectrum")?;
    let bytes = bytes_up_to(body, MAX_SPECTRUM_BYTES).await?;
    let found = hex(&Sha256::digest(&bytes));
    if let Some(announced) = announcement.sha256.into_iter().find(|announced| *announced != found) {
        return Err(ray_sets::Error::Digest { announced, found }.into());
    }
    if bytes.is_empty() {
        return Err(ray_sets::Error::Empty.into());
    }
    let read = pipeline::spectrum(&bytes)?;
    let points: Vec<(f64, f64)> = read.table.points().collect();
    let notices: Vec<StoredNotice> = read.notices.iter().map(StoredNotice::from).collect();
    let json = |text: serde_json::Result<String>| {
        text.map_err(|error| {
            tracing::error!(%error, "a spectrum cannot be written");
            Problem::internal()
        })
    };
    let row = spectra::Spectrum {
        id: new_id(),
        name: announcement.name,
        sha256: found,
        format: read.format.name().to_owned(),
        point_count: points.len() as u64,
        range_nm: read.table.range_nm(),
        lm_per_w: read.table.lm_per_w(),
        nm_value: json(serde_json::to_string(&points))?,
        notices: json(serde_json::to_string(&notices))?,
        created_ms: 0,
    };
    let row = spectra::insert(&api.storage.records, &access.tenant, api.intake.quota, row).await??;
    let spectrum = Spectrum::from(row);
    let location = [(header::LOCATION, spectrum.links.this.clone())];
    Ok((StatusCode::CREATED, location, Json(spectrum)).into_response())
}

/// Lists spectra, newest first
#[utoipa::path(
    get, path = "/v1/spectra", tag = "spectra", operation_id = "list_spectra", params(Page),
    responses(
        (status = 200, body = SpectrumList, description = "one page"),
        (status = 422, body = Problem, content_type = "application/problem+json", description = "an unusable query"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "busy, or a store that does not answer"),
    )
)]
pub async fn list(
    State(api): State<Api>,
    access: Access,
    Query(page): Query<Page>,
) -> Result<Json<SpectrumList>, Problem> {
    let limit = Page::limit(page.limit)?;
    let rows = spectra::list(&api.storage.records, &access.tenant, page.after.as_deref(), limit as i64 + 1).await?;
    let (rows, next) = cut(rows, limit, |row| &row.id);
    Ok(Json(SpectrumList { spectra: rows.into_iter().map(Spectrum::from).collect(), next }))
}

/// Tells of a spectrum
#[utoipa::path(
    get, path = "/v1/spectra/{id}", tag = "spectra", operation_id = "get_spectrum",
    params(("id" = String, Path, description = "the spectrum")),
    responses(
        (status = 200, body = Spectrum, description = "what is known of it, and its table"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "there is none"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "busy, or a store that does not answer"),
    )
)]
pub async fn get(State(api): State<Api>, access: Access, Path(id): Path<String>) -> Result<Json<Spectrum>, Problem> {
    let row = spectra::get(&api.storage.records, &access.tenant, &id).await?;
    Ok(Json(row.ok_or_else(|| Problem::no_spectrum(&id))?.into()))
}

/// Deletes a spectrum
///
/// Jobs that have ended keep their artifacts.
#[utoipa::path(
    delete, path = "/v1/spectra/{id}", tag = "spectra", operation_id = "delete_spectrum",
    params(("id" = String, Path, description = "the spectrum")),
    responses(
        (status = 204, description = "gone"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "there is none"),
        (status = 409, body = Problem, content_type = "application/problem+json", description = "an unfinished job needs it"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "a store that does not answer"),
    )
)]
pub async fn delete(State(api): State<Api>, access: Access, Path(id): Path<String>) -> Result<StatusCode, Problem> {
    match spectra::delete(&api.storage.records, &access.tenant, &id).await? {
        Deletion::Missing => Err(Problem::no_spectrum(&id)),
        Deletion::Needed => Err(Problem::spectrum_needed(&id)),
        Deletion::Deleted(_) => Ok(StatusCode::NO_CONTENT),
    }
}
