//! `/v1/jobs/{id}/rays`: new rays from the model of a job, made while they are sent.

use super::api::Api;
use super::extract::{Path, Query};
use super::files::{FileFacts, Length, PartAnswers, PartHeaders, answer, unmade, without_making};
use super::job::find;
use super::problem::Problem;
use crate::accounts::access::Access;
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
        PartHeaders,
    ),
    responses(
        (status = 200, content((inline(super::api::Binary) = "application/octet-stream")), description = "the bytes of the file", headers(("ETag" = String, description = "names model, count, seed, spread, format and computation"))),
        (status = 206, content((inline(super::api::Binary) = "application/octet-stream")), description = "the requested range of bytes", headers(("Content-Range" = String, description = "the range that is sent, and the length of the file"))),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "there is no such job, or it has not succeeded"),
        (status = 422, body = Problem, content_type = "application/problem+json", description = "a parameter is not valid, or the format cannot hold these rays"),
        PartAnswers,
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
    let files = model_files(&api, &access, &id).await?;
    if !(1..=MOST_NEW_RAYS).contains(&wanted.count) {
        return Err(Problem::out_of_range("count", "from 1 to 1000000000000"));
    }
    let RaysQuery { count, seed, low_discrepancy, format } = wanted;
    let extension = format.extension();
    let spread = if low_discrepancy { "-low-discrepancy" } else { "" };
    let what = format!("{count}-{seed}{spread}-{extension}");
    let name = format!("rays-{count}-seed-{seed}{spread}.{extension}");
    let unmade = unmade(&files, &what, name, "application/octet-stream");
    let request = RayRequest { count, seed, low_discrepancy, target: format.target() };
    // Where no earlier request has told the length, the model is read for it.
    let length = || Ok(api.models.ray_bytes(&files, request)?.map_or(Length::OfTheFile, Length::Known));
    if let Some(told) = without_making(&unmade, &method, &headers, length)? {
        return Ok(told);
    }
    let drawing = api.models.draw(&access.tenant, &api.storage.blobs, &files, request).await?;
    let drawing = drawing.ok_or_else(Problem::busy)?;
    let made = FileFacts { byte_count: drawing.byte_count, ..unmade };
    answer(&made, &method, &headers, async |range| Ok(Body::from_stream(drawing.stream(range)))).await
}

/// The two files of the model of the job `id`.
///
/// # Errors
/// There is no such job, or it has no model; the database does not answer.
pub async fn model_files(api: &Api, access: &Access, id: &str) -> Result<[StoredArtifact; 2], Problem> {
    if let Some(evaluation) = find(api, access, id).await?.evaluation {
        return Err(Problem::of_evaluation(id, &evaluation.job));
    }
    let stored = async |name: &str| {
        let found = query::artifact_named(&api.storage.records, id, name).await?;
        found.ok_or_else(|| Problem::no_artifact(name))
    };
    Ok([stored(MODEL_FILES[0]).await?, stored(MODEL_FILES[1]).await?])
}
