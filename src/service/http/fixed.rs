//! Files that do not change while this process runs: their entity tags, and how long a client need not ask again.

use super::problem::Problem;
use super::ranges::{Wanted, wanted};
use crate::hex::hex;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use sha2::{Digest, Sha256};

/// The entity tag of these bytes: their SHA-256.
pub fn tag(bytes: &[u8]) -> String {
    format!("\"{}\"", hex(&Sha256::digest(bytes)))
}

/// All of the file, or that the client has it; `lifetime` is what `Cache-Control` says.
///
/// # Errors
/// [`Problem`]: the client wants it only with another tag.
pub fn file_or_not(
    headers: &HeaderMap,
    etag: &str,
    lifetime: &'static str,
    file: impl FnOnce() -> Response,
) -> Result<Response, Problem> {
    let mut response = match wanted(headers, etag, 0) {
        Wanted::Changed => return Err(Problem::changed(etag)),
        Wanted::Nothing => StatusCode::NOT_MODIFIED.into_response(),
        // These files are small: a range is answered with all of it.
        Wanted::Whole | Wanted::Part(_) | Wanted::Unsatisfiable => file(),
    };
    let headers = response.headers_mut();
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static(lifetime));
    if let Ok(etag) = HeaderValue::from_str(etag) {
        headers.insert(header::ETAG, etag);
    }
    Ok(response)
}
