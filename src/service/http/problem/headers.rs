//! Headers that change what a request means and are not honoured.

use super::Problem;
use axum::http::StatusCode;

impl Problem {
    /// A header that would change what the request means, and does not here.
    pub fn not_honoured(name: &str, detail: &str, remedy: &str) -> Problem {
        let title = "A header is not honoured here";
        Problem::new(StatusCode::BAD_REQUEST, "request.header_not_honoured", title, detail).at(name).remedy(remedy)
    }

    /// `Expect` with something else than 100-continue.
    pub fn expectation() -> Problem {
        let detail = "The only expectation that can be met is 100-continue.";
        let status = StatusCode::EXPECTATION_FAILED;
        Problem::new(status, "request.expectation", "The expectation cannot be met", detail)
            .at("Expect")
            .remedy("Send the request without Expect, or with Expect: 100-continue.")
    }

    /// A body in a content coding.
    pub fn content_encoding(coding: &str) -> Problem {
        let remedy =
            "Send the body without Content-Encoding. A ray file may be packed with gzip, zstd or zip as a file.";
        Problem::media_type(format!("The body is encoded as {coding:?}."), remedy).at("Content-Encoding")
    }

    /// A precondition that is false of a thing without an entity tag.
    pub fn precondition(name: &str) -> Problem {
        let detail = match name {
            "If-None-Match" => "There is something at this address, which If-None-Match: * excludes.",
            _ => "What is at this address has no entity tag, so that none can be its own.",
        };
        let status = StatusCode::PRECONDITION_FAILED;
        Problem::new(status, "request.precondition_failed", "A precondition is false", detail).at(name).remedy(
            "Nothing was done. Send the request without the condition; If-Match: * asks that there be something.",
        )
    }

    /// `Idempotency-Key` where requests are not remembered.
    pub fn no_keys_here(route: &str) -> Problem {
        let detail = format!("{route} does not remember requests by their key.");
        let status = StatusCode::BAD_REQUEST;
        Problem::new(status, "idempotency.not_supported", "No keys here", detail).at("Idempotency-Key").remedy(
            "Send it without the key. Before it is repeated, look whether the first one came through: the lists tell.",
        )
    }
}
