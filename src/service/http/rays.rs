//! `/v1/jobs/{id}/rays`: new rays from the model of a job, made while they are sent.

use super::api::Api;
use super::artifacts::{FileFacts, answer, promise};
use super::extract::{Path, Query};
use super::job::find;
use super::problem::Problem;
use super::ranges;
use super::ranges::Wanted;
use crate::accounts::access::Access;
use crate::jobs::estimate::PIPELINE;
use crate::jobs::query;
use crate::jobs::query::StoredArtifact;
use axum::body::Body;
use axum::extract::State;
use axum::http::{HeaderMap, Method};
use axum::response::Response;
use pipeline::{MODEL_FILES, MOST_NEW_RAYS, RayRequest, Target};
use serde::de::Error as _;
use serde::{Deserialize, Deserializer};
use utoipa::ToSchema;

/// The format that rays are written in.
#[derive(Clone, Copy, Debug, Default, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum RayFormat {
    /// IES TM-25.
    #[default]
    Tm25,
    /// Zemax binary.
    Zemax,
    /// LightTools binary.
    LightTools,
}

impl RayFormat {
    fn target(self) -> Target {
        match self {
            RayFormat::Tm25 => Target::Tm25,
            RayFormat::Zemax => Target::ZemaxBinary,
            RayFormat::LightTools => Target::LightToolsBinary,
        }
    }

    fn extension(self) -> &'static str {
        match self {
            RayFormat::Tm25 => "tm25ray",
            RayFormat::Zemax => "dat",
            RayFormat::LightTools => "ray",
        }
    }
}

/// Which rays.
#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct RaysQuery {
    /// How many rays: 1000000 or 1e6.
    #[param(minimum = 1, maximum = 1_000_000_000_000_u64)]
    #[serde(deserialize_with = "count")]
    pub count: u64,
    /// Seed of the random numbers: the same seed gives the same rays, another seed others of the same light.
    #[param(minimum = 0, default = 1)]
    #[serde(default = "RaysQuery::first_seed")]
    pub seed: u64,
    /// Rays are spread more evenly over places, directions and wavelengths than chance has it (a scrambled Sobol sequence): what is computed of
    /// them has less noise. Best is a power of two of them.
    #[param(default = false)]
    #[serde(default)]
    pub low_discrepancy: bool,
    /// Format of the file; tm25 where none is named.
    #[param(inline)]
    #[serde(default)]
    pub format: RayFormat,
}

/// A number of rays as people write it, here and on the command line.
fn count<'de, D: Deserializer<'de>>(deserializer: D) -> Result<u64, D::Error> {
    let text = String::deserialize(deserializer)?;
    // 0 is a number, out of its range.
    text.parse()
        .ok()
        .or_else(|| pipeline::count(&text))
        .ok_or_else(|| D::Error::custom(format!("{text:?} is no number of rays, as 1000000 or 1e6")))
}

impl RaysQuery {
    fn first_seed() -> u64 {
        1
    }
}

/// Draws new rays from the model of a job
///
/// A ray file with as many rays as are asked for, all of the same flux, made while it is sent: ray i depends on the seed and on i alone, so a
/// range of bytes is the same whoever asks for it when, and a download can be resumed. The entity tag names model, count, seed, how rays are spread,
/// format and the computation. HEAD reads the model once only: what is needed for lengths is kept.
#[utoipa::path(
    get, path = "/v1/jobs/{id}/rays", tag = "artifacts", operation_id = "draw_rays",
    params(
        ("id" = String, Path, description = "the job"), RaysQuery,
        ("Range" = Option<String>, Header, description = "`bytes=<first>-<last>`: one range"),
        ("If-None-Match" = Option<String>, Header, description = "entity tags of the copies that the client has; 304 if one of them is current"),
        ("If-Match" = Option<String>, Header, description = "entity tags, one of which the file must have; otherwise 412"),
        ("If-Range" = Option<String>, Header, description = "the range is sent only if the file has this entity tag; otherwise the whole file"),
    ),
    responses(
        (status = 200, content((inline(super::api::Binary) = "application/octet-stream")), description = "the bytes of the file", headers(("ETag" = String, description = "names model, count, seed, spread, format and computation"))),
        (status = 206, content((inline(super::api::Binary) = "application/octet-stream")), description = "the requested range of bytes", headers(("Content-Range" = String, description = "the range that is sent, and the length of the file"))),
        (status = 304, description = "the copy of the client is current"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "there is no such job, or it has not succeeded"),
        (status = 412, body = Problem, content_type = "application/problem+json", description = "the file does not have an entity tag that `If-Match` names"),
        (status = 416, body = Problem, content_type = "application/problem+json", description = "the range lies outside the file"),
        (status = 422, body = Problem, content_type = "application/problem+json", description = "a parameter is not valid, or the format cannot hold these rays"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "the service is busy, or the database or the object store does not answer"),
    )
)]
pub async fn draw(
    State(api): State<Api>,
    access: Access,
    Path(id): Path<String>,
    Query(wanted): Query<RaysQuery>,
    method: Method,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    find(&api, &access, &id).await?;
    if !(1..=MOST_NEW_RAYS).contains(&wanted.count) {
        return Err(Problem::out_of_range("count", "from 1 to 1000000000000"));
    }
    let files = model_files(&api, &id).await?;
    let RaysQuery { count, seed, low_discrepancy, format } = wanted;
    let extension = format.extension();
    let spread = if low_discrepancy { "-low-discrepancy" } else { "" };
    let [emitter, goniograms] = &files;
    let facts = |byte_count| FileFacts {
        name: format!("rays-{count}-seed-{seed}{spread}.{extension}"),
        media_type: "application/octet-stream".to_owned(),
        byte_count,
        etag: format!("\"{}-{}-{count}-{seed}{spread}-{extension}-{PIPELINE}\"", emitter.sha256, goniograms.sha256),
    };
    // What a condition keeps from being sent needs no model, nor does a length that an earlier request has told.
    let unmade = facts(0);
    if matches!(ranges::wanted(&headers, &unmade.etag, 0), Wanted::Nothing | Wanted::Changed) {
        return promise(&unmade, None, &headers);
    }
    let request = RayRequest { count, seed, low_discrepancy, target: format.target() };
    if method == Method::HEAD
        && let Some(byte_count) = api.models.ray_bytes(&files, request)?
    {
        return promise(&unmade, Some(byte_count), &headers);
    }
    let drawing = api.models.draw(&access.tenant, &api.storage.blobs, &files, request).await?;
    let drawing = drawing.ok_or_else(Problem::busy)?;
    answer(&facts(drawing.byte_count), &method, &headers, async |range| Ok(Body::from_stream(drawing.stream(range))))
        .await
}

/// The two files of the model of a job that was found.
///
/// # Errors
/// The job has none; the database does not answer.
pub async fn model_files(api: &Api, id: &str) -> Result<[StoredArtifact; 2], Problem> {
    let stored = async |name: &str| {
        let found = query::artifact_named(&api.storage.records, id, name).await?;
        found.ok_or_else(|| Problem::no_artifact(name))
    };
    Ok([stored(MODEL_FILES[0]).await?, stored(MODEL_FILES[1]).await?])
}
