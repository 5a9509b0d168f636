//! `/openapi.json` and `/docs`: the contract, for programs and for people. Nothing is fetched from elsewhere.

use super::addresses::{link, prefix};
use super::extract::Path;
use super::fixed::{file_or_not, tag};
use super::problem::Problem;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Redirect, Response};
use serde_json::{Value, json};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::sync::{Arc, LazyLock, Mutex, PoisonError};
use utoipa_swagger_ui::Config;

static CONTRACT: LazyLock<String> = LazyLock::new(super::openapi);
/// Relative, so that the page finds it behind a proxy's path too.
static PAGES: LazyLock<Arc<Config<'static>>> = LazyLock::new(|| Arc::new(Config::from("../openapi.json")));
/// Entity tags of pages, by their names: as many as there are pages.
static TAGS: Mutex<BTreeMap<String, String>> = Mutex::new(BTreeMap::new());

/// For how long a client need not ask again for the contract, and for a page. The contract names the path that a proxy puts before
/// the service: no shared cache hands it to others.
const CONTRACT_LIFETIME: &str = "private, max-age=300";
const PAGE_LIFETIME: &str = "public, max-age=3600";

/// The pages set styles inline and load nothing from elsewhere.
const PAGE_POLICY: &str = "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; \
                           frame-ancestors 'none'; base-uri 'none'; form-action 'none'";

/// The contract. Behind a proxy's path it says so: the addresses in it are below that path.
pub async fn contract(headers: HeaderMap) -> Result<Response, Problem> {
    let prefix = prefix();
    let text = match prefix.as_str() {
        "" => Cow::Borrowed(CONTRACT.as_str()),
        path => Cow::Owned(below(path)),
    };
    let etag = tag(text.as_bytes());
    let mut response = file_or_not(&headers, &etag, CONTRACT_LIFETIME, || text.into_owned().into_response())?;
    if response.status() == StatusCode::OK {
        response.headers_mut().insert(header::CONTENT_TYPE, HeaderValue::from_static("application/json"));
    }
    Ok(response)
}

/// The contract with `path` before its addresses.
fn below(path: &str) -> String {
    let mut contract: Value = serde_json::from_str(&CONTRACT).unwrap_or_default();
    if let Some(members) = contract.as_object_mut() {
        members.insert("servers".to_owned(), json!([{ "url": path }]));
    }
    contract.to_string()
}

/// The pages' relative links need the slash.
pub async fn index() -> Redirect {
    Redirect::permanent(&link("/docs/"))
}

/// The first page.
pub async fn first_page(headers: HeaderMap) -> Result<Response, Problem> {
    page("", &headers)
}

/// Any file of the pages.
pub async fn file(Path(path): Path<String>, headers: HeaderMap) -> Result<Response, Problem> {
    page(&path, &headers)
}

fn page(path: &str, headers: &HeaderMap) -> Result<Response, Problem> {
    let file = utoipa_swagger_ui::serve(path, Arc::clone(&PAGES)).map_err(|error| {
        tracing::error!(%error, path, "cannot serve a page of /docs");
        Problem::internal()
    })?;
    let file = file.ok_or_else(|| Problem::no_route(&format!("/docs/{path}")))?;
    let etag = {
        let mut tags = TAGS.lock().unwrap_or_else(PoisonError::into_inner);
        tags.entry(path.to_owned()).or_insert_with(|| tag(&file.bytes)).clone()
    };
    let gzipped = file.gzpipped;
    let mut response = file_or_not(headers, &etag, PAGE_LIFETIME, || {
        ([(header::CONTENT_TYPE, file.content_type)], file.bytes.into_owned()).into_response()
    })?;
    let headers = response.headers_mut();
    if gzipped && headers.contains_key(header::CONTENT_TYPE) {
        headers.insert(header::CONTENT_ENCODING, HeaderValue::from_static("gzip"));
    }
    headers.insert(header::CONTENT_SECURITY_POLICY, HeaderValue::from_static(PAGE_POLICY));
    Ok(response)
}
