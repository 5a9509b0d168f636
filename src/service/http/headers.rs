//! Headers that change the meaning of a request: on every route, each of them is honoured or refused, never ignored. This is the
//! one place that checks the headers which no handler honours. `openapi/README.md` has the table that clients read.

use super::api::Api;
use super::openapi::{can_fail, operations};
use super::problem::Problem;
use super::tus;
use crate::uploads::rows::PARTIAL;
use axum::extract::{MatchedPath, Request};
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode, header};
use axum::middleware::{Next, from_fn};
use axum::response::{IntoResponse, Response};
use utoipa_axum::router::UtoipaMethodRouter;

/// The routes that honour `Idempotency-Key`.
const KEYED_ROUTES: [&str; 2] = ["/v1/jobs", "/v1/evaluations"];
const IDEMPOTENCY_KEY: HeaderName = HeaderName::from_static("idempotency-key");
/// What asks for another method than the request's own. tus has the first; its requests have their method by the time they are here.
const METHOD_OVERRIDES: [&str; 3] = ["x-http-method-override", "x-http-method", "x-method-override"];

/// Routes that honour or refuse every header that changes what a request means.
pub fn honoured(routes: UtoipaMethodRouter<Api>) -> UtoipaMethodRouter<Api> {
    let (schemas, mut paths, handlers) = routes;
    for operation in operations(&mut paths) {
        can_fail(operation, "400", "the path is not valid UTF-8; a header is malformed or not supported here");
        can_fail(operation, "412", "a precondition (If-Match, If-None-Match) is false");
        can_fail(operation, "417", "the Expect header asks for something other than 100-continue");
    }
    for item in paths.paths.values_mut() {
        for operation in [&mut item.post, &mut item.put, &mut item.patch, &mut item.delete].into_iter().flatten() {
            can_fail(operation, "415", "the body has a Content-Encoding, which is not supported");
        }
    }
    (schemas, paths, handlers.route_layer(from_fn(answer)))
}

async fn answer(request: Request, next: Next) -> Response {
    let conditions = match judge(&request) {
        Ok(conditions) => conditions,
        Err(problem) => return refused(problem),
    };
    let response = next.run(request).await;
    conditions.hold_for(response)
}

/// A refusal; that of a content coding tells which one is read (RFC 9110, section 15.5.16): none.
fn refused(problem: Problem) -> Response {
    let is_coding = problem.status == StatusCode::UNSUPPORTED_MEDIA_TYPE;
    let mut response = problem.into_response();
    if is_coding {
        response.headers_mut().insert(header::ACCEPT_ENCODING, HeaderValue::from_static("identity"));
    }
    response
}

/// Whether a request can be answered at all, and what must hold of a thing that is only looked at.
fn judge(request: &Request) -> Result<Conditions, Problem> {
    let (method, headers) = (request.method(), request.headers());
    let is_safe = matches!(*method, Method::GET | Method::HEAD);
    framing(headers)?;
    expectation(headers)?;
    method_override(method, headers)?;
    if !is_safe {
        let route = request.extensions().get::<MatchedPath>().map_or("", MatchedPath::as_str);
        content(headers)?;
        key(method, route, headers)?;
        if matches!(*method, Method::POST | Method::PATCH) {
            of_an_upload(method, tus::is_ours(request.uri().path()), headers)?;
        }
    }
    Conditions::of(headers, is_safe)
}

fn text<'a>(headers: &'a HeaderMap, name: &str) -> Option<&'a str> {
    headers.get(name).map(|value| value.to_str().unwrap_or("?"))
}

/// Two lengths of one body are how requests are smuggled past a proxy (RFC 9112, section 6.1).
fn framing(headers: &HeaderMap) -> Result<(), Problem> {
    match headers.contains_key(header::TRANSFER_ENCODING) && headers.contains_key(header::CONTENT_LENGTH) {
        true => Err(Problem::not_honoured(
            "Content-Length",
            "The request has Transfer-Encoding and Content-Length.",
            "Send only one of the two.",
        )),
        false => Ok(()),
    }
}

/// `Expect: 100-continue` is answered when the body is asked for; there is no other expectation (RFC 9110, section 10.1.1).
fn expectation(headers: &HeaderMap) -> Result<(), Problem> {
    let is_known = |value: &HeaderValue| value.as_bytes().eq_ignore_ascii_case(b"100-continue");
    match headers.get_all(header::EXPECT).iter().all(is_known) {
        true => Ok(()),
        false => Err(Problem::expectation()),
    }
}

/// Another method than the request's own.
fn method_override(method: &Method, headers: &HeaderMap) -> Result<(), Problem> {
    let other =
        METHOD_OVERRIDES.into_iter().find(|name| text(headers, name).is_some_and(|said| said != method.as_str()));
    let Some(name) = other else { return Ok(()) };
    let detail = format!("The method of the request is {method}, but {name} asks for a different method.");
    let remedy = "Send the request with the intended method. X-HTTP-Method-Override works under /v1/uploads only.";
    Err(Problem::not_honoured(name, &detail, remedy))
}

/// What a body would be: encoded, a part of something, followed by headers.
fn content(headers: &HeaderMap) -> Result<(), Problem> {
    let coding = headers.get_all(header::CONTENT_ENCODING).iter().map(|value| value.to_str().unwrap_or("?"));
    if let Some(coding) = coding.into_iter().find(|coding| !coding.trim().eq_ignore_ascii_case("identity")) {
        // A coding is the connection's, a packed file is the user's: its name and digest are those of the file.
        return Err(Problem::content_encoding(coding));
    }
    if headers.contains_key(header::CONTENT_RANGE) {
        let remedy = "Send the whole body. To send a ray file in several requests, use /v1/uploads (tus 1.0).";
        return Err(Problem::not_honoured("Content-Range", "This address does not accept a part of a body.", remedy));
    }
    if headers.contains_key(header::TRAILER) {
        let remedy = "Send the field as a header, before the body.";
        return Err(Problem::not_honoured("Trailer", "The service does not read trailers.", remedy));
    }
    Ok(())
}

/// A key under which a request could be repeated. DELETE can be repeated without one.
fn key(method: &Method, route: &str, headers: &HeaderMap) -> Result<(), Problem> {
    let is_honoured = *method == Method::DELETE || (*method == Method::POST && KEYED_ROUTES.contains(&route));
    match is_honoured || !headers.contains_key(IDEMPOTENCY_KEY) {
        true => Ok(()),
        false => Err(Problem::no_keys_here(&format!("{method} {route}"))),
    }
}

/// Headers of tus, of extensions of it that there are not, and of its successor.
fn of_an_upload(method: &Method, is_tus: bool, headers: &HeaderMap) -> Result<(), Problem> {
    for name in headers.keys().filter(|name| name.as_str().starts_with("upload-")) {
        if headers.get_all(name).iter().count() > 1 {
            return Err(Problem::malformed_header(name.as_str(), "The request has this header more than once."));
        }
        let value = text(headers, name.as_str()).unwrap_or_default();
        let is_known = match (is_tus, method) {
            // tus-js-client says it with every request of a partial upload; whether it is one is the handler's to tell.
            (true, &Method::PATCH) if *name == tus::CONCAT => value == PARTIAL,
            (true, &Method::PATCH) => [tus::OFFSET, tus::LENGTH, tus::CHECKSUM].contains(name),
            // An upload begins at its beginning.
            (true, _) if *name == tus::OFFSET => value == "0",
            (true, _) => [tus::LENGTH, tus::DEFER_LENGTH, tus::METADATA, tus::CHECKSUM, tus::CONCAT].contains(name),
            // draft-ietf-httpbis-resumable-upload: a whole body is taken by who does not know how to resume.
            (false, _) if name.as_str() == "upload-complete" => value == "?1",
            (false, _) => name.as_str() == "upload-draft-interop-version",
        };
        if !is_known {
            let detail = format!("This request does not support {name}: {value}.");
            let remedy = "OPTIONS /v1/uploads names the supported extensions of tus; begin a resumable upload with POST /v1/uploads.";
            return Err(Problem::not_honoured(name.as_str(), &detail, remedy));
        }
    }
    Ok(())
}

/// Entity tags that a precondition names (RFC 9110, section 13.1).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Tags {
    /// `*`: any.
    Any,
    /// Some.
    Some,
}

/// The conditions of a request, which must hold before a resource is sent or changed. Things of JSON have no entity tag and no
/// date of a change, so that no tag is theirs, and dates are left alone, as RFC 9110, section 13.1.4, has it. Where a resource has
/// an entity tag, its handler checks it.
#[derive(Clone, Copy, Debug, Default)]
struct Conditions {
    if_match: Option<Tags>,
    if_none_match: Option<Tags>,
}

impl Conditions {
    /// What a request asks for. What would change something is refused here where its condition is false, or would be if the thing
    /// were there: where it is not, nothing is changed either.
    fn of(headers: &HeaderMap, is_safe: bool) -> Result<Conditions, Problem> {
        let if_match = tags(headers, &header::IF_MATCH)?;
        let if_none_match = match tags(headers, &header::IF_NONE_MATCH) {
            // At worst it is told again.
            Err(_) if is_safe => None,
            tags => tags?,
        };
        let conditions = Conditions { if_match, if_none_match };
        match conditions.is_false(is_safe) {
            Some(name) if !is_safe => Err(Problem::precondition(name)),
            _ => Ok(conditions),
        }
    }

    /// The precondition that is false of a thing that is there and has no entity tag.
    fn is_false(self, is_safe: bool) -> Option<&'static str> {
        match (self.if_match, self.if_none_match) {
            (Some(Tags::Some), _) => Some("If-Match"),
            (_, Some(Tags::Any)) if !is_safe => Some("If-None-Match"),
            _ => None,
        }
    }

    /// The answer to a GET or HEAD request, if these conditions hold for its content.
    fn hold_for(self, response: Response) -> Response {
        let has_tag = response.headers().contains_key(header::ETAG);
        if has_tag || !response.status().is_success() {
            return response;
        }
        match self {
            Conditions { if_match: Some(Tags::Some), .. } => Problem::precondition("If-Match").into_response(),
            Conditions { if_none_match: Some(Tags::Any), .. } => StatusCode::NOT_MODIFIED.into_response(),
            _ => response,
        }
    }
}

/// The entity tags of one header: `*`, or quoted texts with commas between, some of them weak.
fn tags(headers: &HeaderMap, name: &HeaderName) -> Result<Option<Tags>, Problem> {
    let values: Vec<&str> = headers.get_all(name).iter().map(|value| value.to_str().unwrap_or("?")).collect();
    let list = values.join(",");
    match list.trim() {
        _ if values.is_empty() => Ok(None),
        "*" => Ok(Some(Tags::Any)),
        list if is_tag_list(list) => Ok(Some(Tags::Some)),
        _ => {
            Err(Problem::malformed_header(name.as_str(), "The value is neither * nor a list of entity tags in quotes."))
        }
    }
}

/// Whether a text is `[W/]"..", ..` and at least one of them. Commas may stand in a tag.
fn is_tag_list(list: &str) -> bool {
    let mut rest = list;
    loop {
        let tag = rest.trim_start_matches([' ', '\t', ',']);
        let Some((inner, after)) = tag.trim_start_matches("W/").strip_prefix('"').and_then(|tag| tag.split_once('"'))
        else {
            return false;
        };
        let after = after.trim_start();
        if !inner.bytes().all(|byte| byte != b' ' && !byte.is_ascii_control())
            || !(after.is_empty() || after.starts_with(','))
        {
            return false;
        }
        if after.trim_matches([' ', '\t', ',']).is_empty() {
            return true;
        }
        rest = after;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entity_tags_are_those_of_rfc_9110() {
        // RFC 9110, sections 8.8.3 and 13.1.1: the examples there.
        let read = |value: &str| {
            let headers = [(header::IF_MATCH, value.parse().unwrap())].into_iter().collect();
            tags(&headers, &header::IF_MATCH).map_err(|problem| problem.code.into_owned())
        };
        for some in
            ["\"xyzzy\"", "W/\"xyzzy\"", "\"\"", "\"xyzzy\", \"r2d2xxxx\", \"c3piozzzz\"", "\"a,b\"", "\"a\",W/\"b\" ,"]
        {
            assert_eq!(read(some), Ok(Some(Tags::Some)), "{some}");
        }
        assert_eq!((read("*"), read(" * ")), (Ok(Some(Tags::Any)), Ok(Some(Tags::Any))));
        for wrong in ["", "xyzzy", "\"xyzzy", "\"a\" \"b\"", "*, \"a\"", "w/\"a\"", "\"a b\"", ","] {
            assert_eq!(read(wrong), Err("request.malformed_header".to_owned()), "{wrong}");
        }
        assert_eq!(tags(&HeaderMap::new(), &header::IF_MATCH).ok(), Some(None));
    }
}
