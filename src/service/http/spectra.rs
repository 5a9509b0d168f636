//! `/v1/spectra`: spectra of channels, read from spectrum files.

use super::addresses::link;
use super::api::Api;
use super::extract::{Page, Path, Query, bytes_up_to, cut};
use super::problem::Problem;
use super::upload_request::{Naming, announcement};
use crate::accounts::access::Access;
use crate::failure::StoredNotice;
use crate::hex::hex;
use crate::jobs::evaluation::NumberPair;
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

/// A spectrum that the service has read from a file.
#[derive(Serialize, ToSchema)]
pub struct Spectrum {
    /// Identifier of this object.
    #[schema(format = Uuid)]
    id: String,
    /// Name of the file.
    name: String,
    /// SHA-256 of the file, lower-case hex.
    sha256: String,
    /// Format of the file: two columns, LightTools .sre, Speos .spectrum, IES TM-27.
    format: String,
    /// Number of points in the table.
    points: u64,
    /// First and last wavelength, nm.
    #[schema(value_type = NumberPair)]
    range_nm: (f64, f64),
    /// Luminous efficacy of radiation of the spectrum, lm/W.
    lm_per_w: f64,
    /// The table: wavelength, nm, and spectral density, in the scale of the file; null in lists.
    #[schema(value_type = Option<Vec<NumberPair>>, required)]
    nm_value: Option<Vec<(f64, f64)>>,
    /// Notices about data that was repaired or unusual.
    notices: Vec<StoredNotice>,
    /// When the file was uploaded, epoch ms.
    created_ms: i64,
    /// Addresses that belong to the spectrum.
    links: SpectrumLinks,
}

/// Addresses that belong to a spectrum.
#[derive(Serialize, ToSchema)]
pub struct SpectrumLinks {
    /// Address of this object.
    #[serde(rename = "self")]
    this: String,
}

/// Spectra, newest first.
#[derive(Serialize, ToSchema)]
pub struct SpectrumList {
    /// The entries of this page, without their tables.
    spectra: Vec<Spectrum>,
    /// The value of `after` for the next page; null on the last page.
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

/// Uploads a spectrum file
///
/// The body is the file: text of two columns (wavelength in nm or µm, spectral density) under any header, LightTools .sre, Zemax
/// .spcd, Speos .spectrum 1.0 or IES TM-27. A job names the spectrum as that of a channel.
#[utoipa::path(
    post, path = "/v1/spectra", tag = "spectra", operation_id = "upload_spectrum",
    params(
        Naming,
        ("Repr-Digest" = Option<String>, Header, description = "`sha-256=:<base64>:` (RFC 9530); the service verifies it"),
        ("Content-Digest" = Option<String>, Header, description = "the same as Repr-Digest"),
    ),
    request_body(content = inline(super::api::Binary), content_type = "application/octet-stream", description = "a spectrum, at most 1 MiB"),
    responses(
        (status = 201, body = Spectrum, description = "the file is stored", headers(("Location" = String, description = "the spectrum"))),
        (status = 400, body = Problem, content_type = "application/problem+json", description = "the file, a header or the query is malformed; the body is truncated; the digest does not match"),
        (status = 413, body = Problem, content_type = "application/problem+json", description = "the file is larger than a spectrum may be, or than the storage quota of the tenant allows"),
        (status = 415, body = Problem, content_type = "application/problem+json", description = "the body is an HTML form, or has a Content-Encoding"),
        (status = 422, body = Problem, content_type = "application/problem+json", description = "the file is refused, or the query is not valid"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "the service is busy or stopping, or the database or the object store does not answer"),
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
            tracing::error!(%error, "cannot write a spectrum as JSON");
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
        (status = 200, body = SpectrumList, description = "one page of the list"),
        (status = 422, body = Problem, content_type = "application/problem+json", description = "the query is not valid"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "the service is busy, or the database or the object store does not answer"),
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

/// Returns a spectrum
#[utoipa::path(
    get, path = "/v1/spectra/{id}", tag = "spectra", operation_id = "get_spectrum",
    params(("id" = String, Path, description = "the spectrum")),
    responses(
        (status = 200, body = Spectrum, description = "the spectrum with its table"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "there is no such spectrum"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "the service is busy, or the database or the object store does not answer"),
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
        (status = 204, description = "the spectrum is deleted"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "there is no such spectrum"),
        (status = 409, body = Problem, content_type = "application/problem+json", description = "an unfinished job needs it; cancel the job, or wait for its end"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "the database or the object store does not answer"),
    )
)]
pub async fn delete(State(api): State<Api>, access: Access, Path(id): Path<String>) -> Result<StatusCode, Problem> {
    match spectra::delete(&api.storage.records, &access.tenant, &id).await? {
        Deletion::Missing => Err(Problem::no_spectrum(&id)),
        Deletion::Needed => Err(Problem::spectrum_needed(&id)),
        Deletion::Deleted(_) => Ok(StatusCode::NO_CONTENT),
    }
}
