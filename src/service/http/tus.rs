//! The protocol tus 1.0.0 (tus.io/protocols/resumable-upload): reads and writes its headers, and applies its rules for every
//! request and answer.

use super::api::Api;
use super::problem::Problem;
use super::upload_request::UploadQuery;
use crate::uploads::checksum::{ALGORITHMS, Checksum};
use crate::uploads::rows::{Concat, PARTIAL};
use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use base64::Engine;
use base64::engine::general_purpose::STANDARD as BASE64;
use serde_json::{Map, Value};
use std::time::{Duration, SystemTime};

/// Path of the resumable uploads.
pub const PATH: &str = "/v1/uploads";
/// Media type of the bytes that a request appends to an upload.
pub const MEDIA_TYPE: &str = "application/offset+octet-stream";
/// The same bytes from clients that were generated from the contract: their generators know no other type of bytes.
pub const PLAIN_TYPE: &str = "application/octet-stream";

const VERSION: &str = "1.0.0";
const EXTENSIONS: &str =
    "creation,creation-with-upload,creation-defer-length,termination,checksum,expiration,concatenation";
/// Most partial uploads that a final one is made of; a piece named several times counts as often.
const MAX_PARTIALS: usize = 100;

/// Version of tus of a request or an answer.
pub const RESUMABLE: HeaderName = HeaderName::from_static("tus-resumable");
/// Number of bytes received, or the offset that a request continues at.
pub const OFFSET: HeaderName = HeaderName::from_static("upload-offset");
/// Length of the whole file, bytes.
pub const LENGTH: HeaderName = HeaderName::from_static("upload-length");
/// `1`: a later request gives the length.
pub const DEFER_LENGTH: HeaderName = HeaderName::from_static("upload-defer-length");
/// Metadata of the file.
pub const METADATA: HeaderName = HeaderName::from_static("upload-metadata");
/// When the upload expires.
pub const EXPIRES: HeaderName = HeaderName::from_static("upload-expires");
/// Whether the upload is a partial upload, or a final upload made of partial ones.
pub const CONCAT: HeaderName = HeaderName::from_static("upload-concat");
const METHOD_OVERRIDE: HeaderName = HeaderName::from_static("x-http-method-override");
/// Checksum of the bytes of a request.
pub const CHECKSUM: HeaderName = HeaderName::from_static("upload-checksum");
const VERSIONS: HeaderName = HeaderName::from_static("tus-version");
const EXTENSION: HeaderName = HeaderName::from_static("tus-extension");
const MAX_SIZE: HeaderName = HeaderName::from_static("tus-max-size");
const CHECKSUM_ALGORITHM: HeaderName = HeaderName::from_static("tus-checksum-algorithm");

/// Headers of an answer that web pages of other origins may read.
pub const SEEN: [HeaderName; 11] = [
    RESUMABLE,
    OFFSET,
    LENGTH,
    DEFER_LENGTH,
    METADATA,
    EXPIRES,
    CONCAT,
    VERSIONS,
    EXTENSION,
    MAX_SIZE,
    CHECKSUM_ALGORITHM,
];

/// Replaces the method of a request by that in `X-HTTP-Method-Override`, which tus has for clients that cannot send PATCH or
/// DELETE. Must run before the route is chosen.
pub async fn override_method(mut request: Request) -> Request {
    if is_ours(request.uri().path())
        && let Some(Ok(method)) = method_override(&request)
    {
        *request.method_mut() = method;
    }
    request
}

/// Whether a path belongs to the resumable uploads.
pub fn is_ours(path: &str) -> bool {
    path == PATH || path.strip_prefix(PATH).is_some_and(|rest| rest.starts_with('/'))
}

fn method_override(request: &Request) -> Option<Result<Method, Problem>> {
    let said = request.headers().get(METHOD_OVERRIDE)?;
    let wrong = |_| Problem::malformed_header(METHOD_OVERRIDE.as_str(), "The value is not an HTTP method.");
    Some(Method::from_bytes(said.as_bytes()).map_err(wrong))
}

/// Answers OPTIONS with the supported extensions, refuses other versions of tus, and names the version in every answer.
pub async fn speak(State(api): State<Api>, request: Request, next: Next) -> Response {
    if !is_ours(request.uri().path()) {
        return next.run(request).await;
    }
    // A browser that asks before it asks is answered elsewhere.
    let asks_first = request.headers().contains_key("access-control-request-method");
    let mut response = if *request.method() == Method::OPTIONS && !asks_first {
        abilities(api.intake.max_bytes)
    } else {
        match spoken(&request) {
            Ok(()) => next.run(request).await,
            Err(problem) => {
                let mut response = problem.into_response();
                response.headers_mut().insert(VERSIONS, HeaderValue::from_static(VERSION));
                response
            }
        }
    };
    response.headers_mut().insert(RESUMABLE, HeaderValue::from_static(VERSION));
    response
}

fn abilities(max_bytes: u64) -> Response {
    let headers =
        [(VERSIONS, VERSION.to_owned()), (EXTENSION, EXTENSIONS.to_owned()), (MAX_SIZE, max_bytes.to_string())];
    let headers = headers.into_iter().chain([(CHECKSUM_ALGORITHM, ALGORITHMS.join(","))]);
    let mut response = StatusCode::NO_CONTENT.into_response();
    for (name, value) in headers {
        tell(response.headers_mut(), name, &value);
    }
    response
}

/// Whether a request speaks our version. Those that only look or delete need not say.
fn spoken(request: &Request) -> Result<(), Problem> {
    method_override(request).transpose()?;
    let found = request.headers().get(RESUMABLE).map(|version| version.to_str().unwrap_or("?"));
    match found {
        Some(VERSION) => Ok(()),
        None if !matches!(*request.method(), Method::POST | Method::PATCH) => Ok(()),
        _ if !is_route(request) => Ok(()),
        other => Err(Problem::tus_version(other)),
    }
}

/// Whether the request has a route: without one, it is answered with 404 or 405 in any version of tus.
fn is_route(request: &Request) -> bool {
    let is_list = request.uri().path() == PATH;
    match *request.method() {
        Method::GET | Method::HEAD => true,
        Method::POST => is_list,
        Method::DELETE | Method::PATCH => !is_list,
        _ => false,
    }
}

/// Adds a header whose value was made of plain characters.
pub fn tell(headers: &mut HeaderMap, name: HeaderName, value: &str) {
    if let Ok(value) = HeaderValue::try_from(value) {
        headers.insert(name, value);
    }
}

/// A time in the format of HTTP headers.
pub fn date(epoch_ms: i64) -> String {
    httpdate::fmt_http_date(SystemTime::UNIX_EPOCH + Duration::from_millis(epoch_ms.max(0).unsigned_abs()))
}

fn text<'a>(headers: &'a HeaderMap, name: &HeaderName) -> Option<&'a str> {
    headers.get(name).map(|value| value.to_str().unwrap_or("?"))
}

/// Reads a header whose value is a number of bytes.
///
/// # Errors
/// `request.malformed_header`.
pub fn bytes(headers: &HeaderMap, name: &HeaderName) -> Result<Option<u64>, Problem> {
    let wrong = || Problem::malformed_header(name.as_str(), "The value is not a number of bytes.");
    // A number of a row is signed.
    let read = |text: &str| text.parse().ok().filter(|bytes| *bytes <= i64::MAX.unsigned_abs()).ok_or_else(wrong);
    text(headers, name).map(read).transpose()
}

/// The length of a new upload; `None` if a later request gives it.
///
/// # Errors
/// `request.malformed_header`: neither or both are said.
pub fn length(headers: &HeaderMap) -> Result<Option<u64>, Problem> {
    match (bytes(headers, &LENGTH)?, text(headers, &DEFER_LENGTH)) {
        (Some(length), None) => Ok(Some(length)),
        (None, Some("1")) => Ok(None),
        _ => {
            let detail = "The request must have either Upload-Length or Upload-Defer-Length: 1.";
            Err(Problem::malformed_header(LENGTH.as_str(), detail))
        }
    }
}

/// Reads `Upload-Concat`: whether a new upload is whole, partial or final.
///
/// # Errors
/// `request.malformed_header`, `request.out_of_range`: too many pieces.
pub fn concat(headers: &HeaderMap) -> Result<Concat, Problem> {
    let Some(sent) = text(headers, &CONCAT) else { return Ok(Concat::Whole) };
    if sent == PARTIAL {
        return Ok(Concat::Partial);
    }
    let wrong = |detail: &str| Problem::malformed_header(CONCAT.as_str(), detail);
    let list = sent.strip_prefix("final;").ok_or_else(|| {
        wrong("The value is neither partial nor final; with the addresses of partial uploads, separated by spaces.")
    })?;
    let partials: Option<Vec<String>> = list.split(' ').filter(|url| !url.is_empty()).map(upload_id).collect();
    match partials {
        None => Err(wrong(
            "The value names addresses that are not uploads: each must end in /v1/uploads/ and an identifier.",
        )),
        Some(none) if none.is_empty() => Err(wrong("The value names no partial upload.")),
        Some(many) if many.len() > MAX_PARTIALS => {
            Err(Problem::out_of_range(CONCAT.as_str(), &format!("final; and at most {MAX_PARTIALS} partial uploads")))
        }
        Some(partials) => Ok(Concat::Final { sent: sent.to_owned(), partials }),
    }
}

/// The upload at an address, absolute or relative. What stands before our own path is the name and the path by which a proxy is
/// reached, which is not known here: the identifier says all, and only the sender's own uploads are looked for.
fn upload_id(url: &str) -> Option<String> {
    let path = match url.split_once("://") {
        Some((_, rest)) => rest.split_once('/')?.1,
        None => url.strip_prefix('/')?,
    };
    let (before, id) = path.trim_end_matches('/').rsplit_once('/')?;
    let is_ours =
        before.strip_suffix(PATH.trim_start_matches('/')).is_some_and(|rest| rest.is_empty() || rest.ends_with('/'));
    let is_id = !id.is_empty() && id.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'-');
    (is_ours && is_id).then(|| id.to_owned())
}

/// Reads the checksum of the bytes of a request.
///
/// # Errors
/// `request.malformed_header`.
pub fn checksum(headers: &HeaderMap) -> Result<Option<Checksum>, Problem> {
    let Some(value) = text(headers, &CHECKSUM) else { return Ok(None) };
    let wrong = || {
        let detail =
            format!("The value is not one of {}, followed by a space and a digest in base64.", ALGORITHMS.join(", "));
        Problem::malformed_header(CHECKSUM.as_str(), &detail)
    };
    let (algorithm, digest) = value.split_once(' ').ok_or_else(wrong)?;
    let digest = BASE64.decode(digest).map_err(|_| wrong())?;
    Checksum::new(algorithm, digest).map(Some).ok_or_else(wrong)
}

/// The parsed `Upload-Metadata`.
#[derive(Default)]
pub struct Metadata {
    /// The header as the client sent it.
    pub sent: String,
    /// The name and the declarations, the same as in the query of `POST /v1/ray-sets`.
    pub query: UploadQuery,
    /// SHA-256 of the whole file, lower-case hex.
    pub sha256: Option<String>,
}

/// Reads `Upload-Metadata`. Keys that the service does not know are kept and not checked, because clients have their own.
///
/// # Errors
/// `request.malformed_header`; what the query of a plain upload is refused for.
pub fn metadata(headers: &HeaderMap) -> Result<Metadata, Problem> {
    let sent = text(headers, &METADATA).unwrap_or_default();
    let wrong = |detail: &str| Problem::malformed_header(METADATA.as_str(), detail);
    let mut known = Map::new();
    for pair in sent.split(',').map(str::trim).filter(|pair| !pair.is_empty()) {
        let (key, value) = pair.split_once(' ').unwrap_or((pair, ""));
        let value = BASE64.decode(value.trim()).map_err(|_| wrong(&format!("The value of {key} is not base64.")))?;
        if ["filename", "name", "sha256", "length_unit", "quantity", "columns", "metadata"].contains(&key) {
            let value = String::from_utf8(value).map_err(|_| wrong(&format!("The value of {key} is not UTF-8.")))?;
            if known.insert(key.to_owned(), Value::String(value)).is_some() {
                return Err(wrong(&format!("The key {key} occurs twice.")));
            }
        }
    }
    let sha256 = known.remove("sha256").and_then(|value| value.as_str().map(str::to_ascii_lowercase));
    if sha256.as_ref().is_some_and(|hex| hex.len() != 64 || !hex.bytes().all(|byte| byte.is_ascii_hexdigit())) {
        return Err(wrong("The value of sha256 is not 64 hexadecimal digits."));
    }
    if let Some(name) = known.remove("filename") {
        known.insert("name".to_owned(), name);
    }
    let query: UploadQuery = serde_path_to_error::deserialize(Value::Object(known))
        .map_err(|error| Problem::wrong_shape(&error.path().to_string(), &error.inner().to_string()))?;
    Ok(Metadata { sent: sent.to_owned(), query, sha256 })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn headers(pairs: &[(&'static str, &str)]) -> HeaderMap {
        let pairs = pairs.iter().map(|(name, value)| (HeaderName::from_static(name), value.parse().unwrap()));
        pairs.collect()
    }

    #[test]
    fn metadata_is_read_as_tus_writes_it() {
        // The example of the protocol's chapter on creation, and the digest of FIPS 180-2, B.1, in capitals.
        let sent = "filename d29ybGRfZG9taW5hdGlvbl9wbGFuLnBkZg==,is_confidential";
        let read = metadata(&headers(&[("upload-metadata", sent)])).unwrap();
        assert_eq!((read.sent.as_str(), read.query.name.as_deref()), (sent, Some("world_domination_plan.pdf")));
        let hex = "BA7816BF8F01CFEA414140DE5DAE2223B00361A396177A9CB410FF61F20015AD";
        let sent = format!("name bGVkLmRhdA==, length_unit bW0=,sha256 {}", BASE64.encode(hex));
        let read = metadata(&headers(&[("upload-metadata", &sent)])).unwrap();
        assert_eq!(read.sha256, Some(hex.to_lowercase()));
        assert_eq!(read.query.name.as_deref(), Some("led.dat"));
        let declared = serde_json::to_value(read.query.declaration().unwrap()).unwrap();
        assert_eq!(declared, serde_json::json!({"length_unit": "mm"}));
        for (wrong, code) in [
            ("filename ?", "request.malformed_header"),
            ("filename YQ==,filename Yg==", "request.malformed_header"),
            ("filename /w==", "request.malformed_header"),
            ("sha256 YWJj", "request.malformed_header"),
            ("length_unit ZnVybG9uZw==", "request.wrong_type"),
        ] {
            let problem = metadata(&headers(&[("upload-metadata", wrong)])).err().unwrap();
            assert_eq!(problem.code, code, "{wrong}");
        }
    }

    #[test]
    fn a_final_upload_names_its_pieces_in_order_by_absolute_and_relative_addresses() {
        let read = |value: &str| concat(&headers(&[("upload-concat", value)]));
        assert_eq!(concat(&HeaderMap::new()).unwrap(), Concat::Whole);
        assert_eq!(read("partial").unwrap(), Concat::Partial);
        // The example of the protocol's chapter, at our path; and as they look to whoever is in front of a proxy.
        for sent in [
            "final;/v1/uploads/b /v1/uploads/a /v1/uploads/b",
            "final;https://tus.example.org/v1/uploads/b http://[::1]:80/v1/uploads/a /rays/v1/uploads/b/",
            "final; /v1/uploads/b  /v1/uploads/a /v1/uploads/b ",
        ] {
            let partials = ["b", "a", "b"].map(str::to_owned).to_vec();
            assert_eq!(read(sent).unwrap(), Concat::Final { sent: sent.to_owned(), partials });
        }
        for wrong in [
            "",
            "Partial",
            "final",
            "final;",
            "final; ",
            "partial;/v1/uploads/a",
            "final;/v1/uploads/",
            "final;/v1/uploads",
            "final;a",
            "final;v1/uploads/a",
            "final;/v1/jobs/a",
            "final;/xv1/uploads/a",
            "final;/v1/uploads/a?b=c",
            "final;/v1/uploads/%61",
            "final;https://tus.example.org",
        ] {
            assert_eq!(read(wrong).unwrap_err().code, "request.malformed_header", "{wrong}");
        }
        let many = |count: usize| format!("final;{}", vec!["/v1/uploads/a"; count].join(" "));
        assert_eq!(read(&many(100)).unwrap().partials().len(), 100);
        assert_eq!(read(&many(101)).unwrap_err().code, "request.out_of_range");
    }

    #[test]
    fn lengths_offsets_and_checksums_are_said_once_and_rightly() {
        let said =
            |pairs: &[(&'static str, &str)]| length(&headers(pairs)).map_err(|problem| problem.code.into_owned());
        assert_eq!(said(&[("upload-length", "100")]), Ok(Some(100)));
        assert_eq!(said(&[("upload-defer-length", "1")]), Ok(None));
        let wrong = Err("request.malformed_header".to_owned());
        for pairs in [
            &[][..],
            &[("upload-length", "1"), ("upload-defer-length", "1")],
            &[("upload-defer-length", "0")],
            &[("upload-length", "-1")],
            &[("upload-length", "1.0")],
            &[("upload-length", "9223372036854775808")],
        ] {
            assert_eq!(said(pairs), wrong, "{pairs:?}");
        }
        // The example of the protocol's chapter on checksums.
        let check = |value| checksum(&headers(&[("upload-checksum", value)]));
        assert!(check("sha1 Kq5sNclPz7QV2+lfQIuc6R7oRu0=").unwrap().is_some());
        assert!(checksum(&HeaderMap::new()).unwrap().is_none());
        for wrong in ["sha1", "md5 Kq5sNclPz7QV2+lfQIuc6R7oRu0=", "sha1 ?", "SHA1 Kq5sNclPz7QV2+lfQIuc6R7oRu0="] {
            assert_eq!(check(wrong).unwrap_err().code, "request.malformed_header", "{wrong}");
        }
        // RFC 9110, section 5.6.7.
        assert_eq!(date(784_111_777_000), "Sun, 06 Nov 1994 08:49:37 GMT");
    }
}
