//! Answers, compressed where a client can read that and where it pays. What is compressed has a weak entity tag: its bytes are others
//! than those that ranges are counted in.

use axum::body::HttpBody;
use axum::extract::Request;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::middleware::Next;
use axum::response::Response;
use tower_http::CompressionLevel;
use tower_http::compression::{CompressionLayer, Predicate};

/// Shorter answers are sent as they are, bytes: they fit a packet or two.
const SHORTEST: u64 = 1024;

/// Kinds of text, with what they begin with. Events are not among them: each has to be seen at once.
const TEXTS: [&str; 8] = [
    "application/json",
    "application/problem+json",
    "application/openmetrics-text",
    "application/javascript",
    "image/svg+xml",
    "model/gltf+json",
    "text/",
    "application/x-ies",
];

/// Whether an answer is worth it.
#[derive(Clone, Copy, Debug)]
pub struct Worthwhile;

impl Predicate for Worthwhile {
    fn should_compress<B: HttpBody>(&self, response: &axum::http::Response<B>) -> bool {
        let text = |name| response.headers().get(name).and_then(|value| value.to_str().ok());
        let kind = text(header::CONTENT_TYPE).unwrap_or_default();
        // The answer to HEAD has no body: its header says how long it would be.
        let length = text(header::CONTENT_LENGTH).and_then(|length| length.parse::<u64>().ok());
        let length = length.or(response.body().size_hint().exact());
        let is_text = kind != "text/event-stream" && TEXTS.iter().any(|text| kind.starts_with(text));
        response.status() != StatusCode::PARTIAL_CONTENT && is_text && length.is_none_or(|length| length >= SHORTEST)
    }
}

/// How hard to try, of 1 to 9 for gzip and 1 to 22 for zstd: jobs are computed on the same processors. One step less and gzip makes
/// goniograms half as long again.
const LEVEL: CompressionLevel = CompressionLevel::Precise(3);

/// Compresses with zstd or gzip.
pub fn layer() -> CompressionLayer<Worthwhile> {
    CompressionLayer::new().quality(LEVEL).compress_when(Worthwhile)
}

/// Asks [`layer`] for what it can do only, and gives what it compressed a weak tag.
pub async fn tagged(mut request: Request, next: Next) -> Response {
    let accepted = known(request.headers());
    let headers = request.headers_mut();
    match accepted.as_deref().map(HeaderValue::from_str) {
        Some(Ok(known)) => drop(headers.insert(header::ACCEPT_ENCODING, known)),
        _ => drop(headers.remove(header::ACCEPT_ENCODING)),
    }
    let has: Vec<HeaderValue> = request.headers().get_all(header::IF_NONE_MATCH).iter().cloned().collect();
    let mut response = next.run(request).await;
    let is_known = response.status() == StatusCode::NOT_MODIFIED;
    let headers = response.headers_mut();
    // What a client has already it has under the tag that it sent.
    let has_weak = || headers.get(header::ETAG).is_some_and(|tag| has.iter().any(|tags| has_weak(tags, tag)));
    if headers.contains_key(header::CONTENT_ENCODING) || (is_known && has_weak()) {
        weaken(headers);
    }
    if is_known && headers.contains_key(header::ETAG) {
        headers.append(header::VARY, HeaderValue::from_static("accept-encoding"));
    }
    response
}

/// The encodings that both sides know, as the client wrote them. The rest is nothing that an answer could be refused for: as it is,
/// it can always be read.
fn known(headers: &HeaderMap) -> Option<String> {
    let lines = headers.get_all(header::ACCEPT_ENCODING).iter().filter_map(|value| value.to_str().ok());
    let elements = lines.flat_map(|line| line.split(',')).map(str::trim);
    let ours = elements.filter(|element| {
        let name = element.split(';').next().unwrap_or_default().trim();
        ["gzip", "x-gzip", "zstd"].iter().any(|known| name.eq_ignore_ascii_case(known))
    });
    let ours: Vec<&str> = ours.collect();
    (!ours.is_empty()).then(|| ours.join(", "))
}

/// Whether a list of tags has this one as a weak tag.
fn has_weak(tags: &HeaderValue, tag: &HeaderValue) -> bool {
    let (Ok(tags), Ok(tag)) = (tags.to_str(), tag.to_str()) else { return false };
    tags.split(',').any(|known| known.trim().strip_prefix("W/") == Some(tag))
}

fn weaken(headers: &mut HeaderMap) {
    let strong = headers.get(header::ETAG).and_then(|tag| tag.to_str().ok()).filter(|tag| !tag.starts_with("W/"));
    if let Some(Ok(weak)) = strong.map(|tag| HeaderValue::try_from(format!("W/{tag}"))) {
        headers.insert(header::ETAG, weak);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_encodings_that_both_know_are_asked_for() {
        let asked = |value: &str| {
            let mut headers = HeaderMap::new();
            headers.append(header::ACCEPT_ENCODING, value.parse().unwrap());
            known(&headers)
        };
        assert_eq!(asked("gzip, deflate, br, zstd").as_deref(), Some("gzip, zstd"));
        assert_eq!(asked("GZIP;q=0.5, *;q=0").as_deref(), Some("GZIP;q=0.5"));
        for nothing in ["", "br", "identity;q=0", "*", "gzipped"] {
            assert_eq!(asked(nothing), None, "{nothing}");
        }
        assert_eq!(known(&HeaderMap::new()), None);
    }
}
