//! `/v1/jobs/{id}/adapters/{renderer}`: the model of a job as a renderer opens it.

use super::api::Api;
use super::artifacts::{FileFacts, answer, promise};
use super::extract::{Path, Query};
use super::job::find;
use super::problem::Problem;
use super::ranges;
use super::ranges::Wanted;
use super::rays::model_files;
use crate::accounts::access::Access;
use crate::jobs::estimate::PIPELINE;
use axum::body::{Body, Bytes};
use axum::extract::State;
use axum::http::{HeaderMap, Method};
use axum::response::Response;
use pipeline::{LightKind, Renderer};
use serde::Deserialize;
use utoipa::ToSchema;

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

/// A program that draws scenes.
#[derive(ToSchema)]
#[schema(rename_all = "lowercase")]
#[expect(dead_code, reason = "a schema, never a value: another name is 404")]
pub enum RendererName {
    /// Blender, with Cycles.
    Blender,
    /// Mitsuba 3.
    Mitsuba,
    /// Radiance.
    Radiance,
}

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
        ("Range" = Option<String>, Header, description = "`bytes=<first>-<last>`: one range"),
        ("If-None-Match" = Option<String>, Header, description = "entity tags of the copies that the client has; 304 if one of them is current"),
        ("If-Match" = Option<String>, Header, description = "entity tags, one of which the file must have; otherwise 412"),
        ("If-Range" = Option<String>, Header, description = "the range is sent only if the file has this entity tag; otherwise the whole file"),
    ),
    responses(
        (status = 200, content((inline(super::api::Binary) = "application/zip"), (inline(super::api::Binary) = "application/octet-stream")), description = "the bytes of the zip", headers(("ETag" = String, description = "names model, renderer, light and computation"))),
        (status = 206, content((inline(super::api::Binary) = "application/zip"), (inline(super::api::Binary) = "application/octet-stream")), description = "the requested range of bytes", headers(("Content-Range" = String, description = "the range that is sent, and the length of the file"))),
        (status = 304, description = "the copy of the client is current"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "there is no such job or renderer, or the job has not succeeded"),
        (status = 412, body = Problem, content_type = "application/problem+json", description = "the file does not have an entity tag that `If-Match` names"),
        (status = 416, body = Problem, content_type = "application/problem+json", description = "the range lies outside the file"),
        (status = 422, body = Problem, content_type = "application/problem+json", description = "a parameter is not valid, or the model does not know this light"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "the service is busy, or the database or the object store does not answer"),
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
    find(&api, &access, &id).await?;
    let known = Renderer::ALL.into_iter().find(|known| known.name() == renderer);
    let known = known.ok_or_else(|| Problem::no_renderer(&renderer))?;
    let files = model_files(&api, &id).await?;
    let light = wanted.light.map(AdapterLight::kind);
    let [emitter, goniograms] = &files;
    let told = light.map_or("", LightKind::name);
    let facts = |byte_count| FileFacts {
        name: format!("{renderer}.zip"),
        media_type: "application/zip".to_owned(),
        byte_count,
        etag: format!("\"{}-{}-{renderer}-{told}-{PIPELINE}\"", emitter.sha256, goniograms.sha256),
    };
    // What has no body needs no model.
    let unmade = facts(0);
    let is_unsent = matches!(ranges::wanted(&headers, &unmade.etag, 0), Wanted::Nothing | Wanted::Changed);
    if is_unsent || method == Method::HEAD {
        return promise(&unmade, api.models.lengths.of(&unmade.etag), &headers);
    }
    let zip = api.models.adapt(&access.tenant, &api.storage.blobs, &files, known, light).await?;
    let zip = Bytes::from(zip.ok_or_else(Problem::busy)?);
    let made = facts(zip.len() as u64);
    api.models.lengths.keep(&made.etag, made.byte_count);
    let part = async |range: std::ops::Range<u64>| Ok(Body::from(zip.slice(range.start as usize..range.end as usize)));
    answer(&made, &method, &headers, part).await
}
