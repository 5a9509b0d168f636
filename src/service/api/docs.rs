//! `/openapi.json` and `/docs`: the contract, for programs and for people. Nothing is fetched from elsewhere.

use super::extract::Path;
use super::problem::Problem;
use axum::http::{HeaderValue, header};
use axum::response::{IntoResponse, Redirect, Response};
use std::sync::{Arc, LazyLock};
use utoipa_swagger_ui::Config;

static CONTRACT: LazyLock<String> = LazyLock::new(super::openapi);
static PAGES: LazyLock<Arc<Config<'static>>> = LazyLock::new(|| Arc::new(Config::from("/openapi.json")));

/// The pages set styles inline and load nothing from elsewhere.
const PAGE_POLICY: &str = "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; \
                           frame-ancestors 'none'; base-uri 'none'; form-action 'none'";

/// The contract.
pub async fn contract() -> Response {
    ([(header::CONTENT_TYPE, "application/json")], CONTRACT.as_str()).into_response()
}

/// A person at the front door is shown the interface, until there is a portal.
pub async fn front() -> Redirect {
    Redirect::temporary("/docs/")
}

/// The pages' relative links need the slash.
pub async fn index() -> Redirect {
    Redirect::permanent("/docs/")
}

/// The first page.
pub async fn first_page() -> Result<Response, Problem> {
    page("")
}

/// Any file of the pages.
pub async fn file(Path(path): Path<String>) -> Result<Response, Problem> {
    page(&path)
}

fn page(path: &str) -> Result<Response, Problem> {
    let file = utoipa_swagger_ui::serve(path, Arc::clone(&PAGES)).map_err(|error| {
        tracing::error!(%error, path, "a page of /docs");
        Problem::internal()
    })?;
    let file = file.ok_or_else(|| Problem::no_route(&format!("/docs/{path}")))?;
    let mut response = ([(header::CONTENT_TYPE, file.content_type)], file.bytes.into_owned()).into_response();
    let headers = response.headers_mut();
    if file.gzpipped {
        headers.insert(header::CONTENT_ENCODING, HeaderValue::from_static("gzip"));
    }
    headers.insert(header::CONTENT_SECURITY_POLICY, HeaderValue::from_static(PAGE_POLICY));
    Ok(response)
}
