//! `/v1/jobs/{id}/adapters/{renderer}`: the model of a job as a renderer opens it.

use super::api::Api;
use super::extract::{Path, Query};
use super::files::{FileFacts, Length, PartAnswers, PartHeaders, answer, unmade, without_making};
use super::problem::Problem;
use super::rays::model_files;
use crate::accounts::access::Access;
use axum::body::{Body, Bytes};
use axum::extract::State;
use axum::http::{HeaderMap, Method};
use axum::response::Response;
use pipeline::{LightKind, Renderer};
use serde::Deserialize;
use utoipa::ToSchema;
use utoipa::openapi as contract;

/// What a renderer can be given.
#[derive(Clone, Copy, Debug, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum AdapterLight {
    /// lm, in the colours of the light.
    Color,
    /// lm, without colours.
    Luminous,
    /// W.
    Radiant,
}

impl AdapterLight {
    fn kind(self) -> LightKind {
        match self {
            AdapterLight::Color => LightKind::Color,
            AdapterLight::Luminous => LightKind::Luminous,
            AdapterLight::Radiant => LightKind::Radiant,
        }
    }
}

/// A program that draws scenes, in the contract: another name is 404.
pub enum RendererName {}

impl utoipa::PartialSchema for RendererName {
    fn schema() -> contract::RefOr<contract::Schema> {
        let names = Renderer::ALL.map(Renderer::name);
        let names = contract::ObjectBuilder::new().schema_type(contract::schema::Type::String).enum_values(Some(names));
        names.description(Some("A program that draws scenes.")).into()
    }
}

impl ToSchema for RendererName {}

/// Which light.
#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct AdapterQuery {
    /// Which light. Default: color where the model knows it, else luminous, else radiant.
    #[param(inline)]
    #[serde(default)]
    pub light: Option<AdapterLight>,
}

/// Makes the files that a renderer opens of the model of a job
///
/// A zip of what `lampwright adapter` writes; its `README.txt` says what to do with the files. They are made when they are asked for; the entity tag
/// names model, renderer, light and the computation. HEAD reads no model: it tells the length of a file that this process has made before.
#[utoipa::path(
    get, path = "/v1/jobs/{id}/adapters/{renderer}", tag = "artifacts", operation_id = "adapt_model",
    params(
        ("id" = String, Path, description = "the job"), ("renderer" = inline(RendererName), Path, description = "the program that is to open the files"), AdapterQuery,
        PartHeaders,
    ),
    responses(
        (status = 200, content((inline(super::api::Binary) = "application/zip"), (inline(super::api::Binary) = "application/octet-stream")), description = "the bytes of the zip", headers(("ETag" = String, description = "names model, renderer, light and computation"))),
        (status = 206, content((inline(super::api::Binary) = "application/zip"), (inline(super::api::Binary) = "application/octet-stream")), description = "the requested range of bytes", headers(("Content-Range" = String, description = "the range that is sent, and the length of the file"))),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "there is no such job or renderer, or the job has not succeeded"),
        (status = 422, body = Problem, content_type = "application/problem+json", description = "a parameter is not valid, or the model does not know this light"),
        PartAnswers,
    )
)]
pub async fn adapt(
    State(api): State<Api>,
    access: Access,
    Path((id, renderer)): Path<(String, String)>,
    Query(wanted): Query<AdapterQuery>,
    method: Method,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let files = model_files(&api, &access, &id).await?;
    let known = Renderer::ALL.into_iter().find(|known| known.name() == renderer);
    let known = known.ok_or_else(|| Problem::no_renderer(&renderer))?;
    let light = wanted.light.map(AdapterLight::kind);
    let what = format!("{renderer}-{}", light.map_or("", LightKind::name));
    let unmade = unmade(&files, &what, format!("{renderer}.zip"), "application/zip");
    // HEAD reads no model: without an earlier request it tells no length.
    let length = || Ok(api.models.lengths.of(&unmade.etag).map_or(Length::Untold, Length::Known));
    if let Some(told) = without_making(&unmade, &method, &headers, length)? {
        return Ok(told);
    }
    let zip = api.models.adapt(&access.tenant, &api.storage.blobs, &files, known, light).await?;
    let zip = Bytes::from(zip.ok_or_else(Problem::busy)?);
    let made = FileFacts { byte_count: zip.len() as u64, ..unmade };
    api.models.lengths.keep(&made.etag, made.byte_count);
    let part = async |range: std::ops::Range<u64>| Ok(Body::from(zip.slice(range.start as usize..range.end as usize)));
    answer(&made, &method, &headers, part).await
}
