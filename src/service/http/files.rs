//! Files as answers: whole or in parts, stored or made when they are asked for; what a client may ask of them, and how the contract says so.

use super::problem::Problem;
use super::ranges::{Wanted, media_type, wanted};
use crate::jobs::estimate::PIPELINE;
use crate::jobs::query::StoredArtifact;
use axum::body::{Body, Bytes};
use axum::http::{HeaderMap, HeaderValue, Method, StatusCode, header};
use axum::response::{IntoResponse, Response};
use futures::stream;
use std::collections::BTreeMap;
use std::io;
use std::ops::Range;
use utoipa::openapi::content::ContentBuilder;
use utoipa::openapi::path::{Parameter, ParameterBuilder, ParameterIn};
use utoipa::openapi::response::{Response as Answer, ResponseBuilder};
use utoipa::openapi::{Ref, RefOr, Required};
use utoipa::{IntoParams, IntoResponses, PartialSchema};

/// The headers by which a client asks for a part of a file, or for one that it does not have, in the contract.
pub enum PartHeaders {}

impl IntoParams for PartHeaders {
    fn into_params(_: impl Fn() -> Option<ParameterIn>) -> Vec<Parameter> {
        let header = |(name, description)| {
            let header = ParameterBuilder::new().name(name).parameter_in(ParameterIn::Header);
            header.required(Required::False).description(Some(description)).schema(Some(String::schema())).build()
        };
        let headers = [
            ("Range", "`bytes=<first>-<last>`: one range"),
            ("If-None-Match", "entity tags of the copies that the client has; 304 if one of them is current"),
            ("If-Match", "entity tags, one of which the file must have; otherwise 412"),
            ("If-Range", "the range is sent only if the file has this entity tag; otherwise the whole file"),
        ];
        headers.into_iter().map(header).collect()
    }
}

/// What these headers are answered with where it is not the file, and that nothing can be told now, in the contract.
pub enum PartAnswers {}

impl IntoResponses for PartAnswers {
    fn responses() -> BTreeMap<String, RefOr<Answer>> {
        let told = |status: &str, description: &str| {
            let problem = ContentBuilder::new().schema(Some(Ref::from_schema_name("Problem"))).build();
            let answer = ResponseBuilder::new().description(description);
            let answer = if status == "304" { answer } else { answer.content("application/problem+json", problem) };
            (status.to_owned(), RefOr::T(answer.build()))
        };
        BTreeMap::from([
            told("304", "the copy of the client is current"),
            told("412", "the file does not have an entity tag that `If-Match` names"),
            told("416", "the range lies outside the file"),
            told("503", "the service is busy, or the database or the object store does not answer"),
        ])
    }
}

/// What an answer says of the file that it sends.
pub struct FileFacts {
    /// Its name.
    pub name: String,
    /// Its media type.
    pub media_type: String,
    /// Its length.
    pub byte_count: u64,
    /// Its entity tag, with quotes.
    pub etag: String,
}

/// Answers with a file, or the part of it that is asked for; `bytes` gives a range of it.
///
/// # Errors
/// A condition is false; those of `bytes`.
pub async fn answer(
    file: &FileFacts,
    method: &Method,
    headers: &HeaderMap,
    bytes: impl AsyncFnOnce(Range<u64>) -> Result<Body, Problem>,
) -> Result<Response, Problem> {
    let (status, range) = match wanted(headers, &file.etag, file.byte_count) {
        Wanted::Whole => (StatusCode::OK, 0..file.byte_count),
        Wanted::Part(range) => (StatusCode::PARTIAL_CONTENT, range),
        Wanted::Nothing => (StatusCode::NOT_MODIFIED, 0..0),
        Wanted::Changed => return Err(Problem::changed(&file.etag)),
        Wanted::Unsatisfiable => {
            let content_range = [(header::CONTENT_RANGE, format!("bytes */{}", file.byte_count))];
            return Ok((content_range, Problem::range_not_satisfiable(file.byte_count)).into_response());
        }
    };
    // A HEAD is answered without touching the bytes.
    let body = match *method == Method::HEAD || range.is_empty() {
        true => Body::empty(),
        false => bytes(range.clone()).await?,
    };
    let mut response = (status, body).into_response();
    describe(response.headers_mut(), file, media_type(headers, &file.media_type), status, &range);
    Ok(response)
}

/// A file that is made of a model in `files` when it is asked for, before its length is known; `what` tells it from others of the same model.
pub fn unmade(files: &[StoredArtifact; 2], what: &str, name: String, media_type: &str) -> FileFacts {
    let [emitter, goniograms] = files;
    let etag = format!("\"{}-{}-{what}-{PIPELINE}\"", emitter.sha256, goniograms.sha256);
    FileFacts { name, media_type: media_type.to_owned(), byte_count: 0, etag }
}

/// What can be told of the length of a file before it is made.
pub enum Length {
    /// Its bytes.
    Known(u64),
    /// Nothing, and a HEAD is answered without it.
    Untold,
    /// Nothing yet, and a HEAD is answered as soon as the file says it.
    OfTheFile,
}

/// The answer that needs no file, for one that is made when it is asked for: a condition keeps it from being sent, or it is a HEAD whose
/// `length` does not wait for the file.
///
/// # Errors
/// `If-Match` is false; those of `length`.
pub fn without_making(
    file: &FileFacts,
    method: &Method,
    headers: &HeaderMap,
    length: impl FnOnce() -> Result<Length, Problem>,
) -> Result<Option<Response>, Problem> {
    if matches!(wanted(headers, &file.etag, 0), Wanted::Nothing | Wanted::Changed) {
        return promise(file, None, headers).map(Some);
    }
    if *method != Method::HEAD {
        return Ok(None);
    }
    match length()? {
        Length::Known(byte_count) => promise(file, Some(byte_count), headers).map(Some),
        Length::Untold => promise(file, None, headers).map(Some),
        Length::OfTheFile => Ok(None),
    }
}

/// Answers what has no body (HEAD, or a condition that keeps the file from being sent) for a file that is made when it is asked for, without
/// making it: `byte_count` is left out where only that would tell it (RFC 9110, section 9.3.2), and a range is that of a GET (14.2).
///
/// # Errors
/// `If-Match` is false.
fn promise(file: &FileFacts, byte_count: Option<u64>, headers: &HeaderMap) -> Result<Response, Problem> {
    let status = match wanted(headers, &file.etag, 0) {
        Wanted::Nothing => StatusCode::NOT_MODIFIED,
        Wanted::Changed => return Err(Problem::changed(&file.etag)),
        Wanted::Whole | Wanted::Part(_) | Wanted::Unsatisfiable => StatusCode::OK,
    };
    // A body whose length nobody knows, so that none is told.
    let mut response = (status, Body::from_stream(stream::empty::<io::Result<Bytes>>())).into_response();
    let range = 0..byte_count.unwrap_or_default();
    describe(response.headers_mut(), file, media_type(headers, &file.media_type), status, &range);
    if byte_count.is_none() {
        response.headers_mut().remove(header::CONTENT_LENGTH);
    }
    Ok(response)
}

fn describe(headers: &mut HeaderMap, file: &FileFacts, media_type: &str, status: StatusCode, range: &Range<u64>) {
    let mut set = |name, value: String| {
        // Only our own names and numbers: always a legal header.
        if let Ok(value) = HeaderValue::try_from(value) {
            headers.insert(name, value);
        }
    };
    set(header::ETAG, file.etag.clone());
    // What has this name under this job never changes, but the job may be deleted: ask again, cheaply.
    set(header::CACHE_CONTROL, "private, no-cache".into());
    if status == StatusCode::NOT_MODIFIED {
        return;
    }
    set(header::ACCEPT_RANGES, "bytes".into());
    set(header::CONTENT_TYPE, media_type.to_owned());
    set(header::VARY, "accept".into());
    set(header::CONTENT_LENGTH, (range.end - range.start).to_string());
    set(header::CONTENT_DISPOSITION, disposition(&file.name, &file.media_type));
    if status == StatusCode::PARTIAL_CONTENT {
        let (start, end) = (range.start, range.end.saturating_sub(1));
        set(header::CONTENT_RANGE, format!("bytes {start}-{end}/{}", file.byte_count));
    }
}

/// A file that is not kept, whole.
pub fn whole(name: &str, media_type: &str, bytes: Vec<u8>) -> Response {
    let headers = [(header::CONTENT_TYPE, media_type), (header::CONTENT_DISPOSITION, &disposition(name, media_type))];
    (headers, bytes).into_response()
}

/// A drawing is shown where it is asked for, any other file is kept.
pub fn disposition(name: &str, media_type: &str) -> String {
    let kind = if media_type == "image/svg+xml" { "inline" } else { "attachment" };
    format!("{kind}; filename=\"{}\"", file_name(name))
}

/// The last part of a name, without what a quoted string may not hold.
fn file_name(name: &str) -> String {
    let last = name.rsplit('/').next().unwrap_or(name);
    last.chars().map(|c| if c.is_ascii_graphic() && c != '"' && c != '\\' { c } else { '_' }).collect()
}
