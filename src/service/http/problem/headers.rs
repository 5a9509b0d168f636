//! Headers that change what a request means and are not honoured.

use super::Problem;
use axum::http::StatusCode;

impl Problem {
    /// A header that would change what the request means, and does not here.
    pub fn not_honoured(name: &str, detail: &str, remedy: &str) -> Problem {
        let title = "A header is not supported here";
        Problem::new(StatusCode::BAD_REQUEST, "request.header_not_honoured", title, detail).at(name).remedy(remedy)
    }

    /// `Expect` with something else than 100-continue.
    pub fn expectation() -> Problem {
        let detail = "The service supports no expectation except 100-continue.";
        let status = StatusCode::EXPECTATION_FAILED;
        Problem::new(status, "request.expectation", "The expectation cannot be met", detail)
            .at("Expect")
            .remedy("Send the request without Expect, or with Expect: 100-continue.")
    }

    /// A body in a content coding.
    pub fn content_encoding(coding: &str) -> Problem {
        let remedy = "Send the body without Content-Encoding. The ray file itself may be a gzip, zstd or zip file.";
        Problem::media_type(format!("The body is encoded as {coding:?}."), remedy).at("Content-Encoding")
    }

    /// A precondition that is false of a thing without an entity tag.
    pub fn precondition(name: &str) -> Problem {
        let detail = match name {
            "If-None-Match" => "If-None-Match: * asks that this resource does not exist, but it exists.",
            _ => "This resource has no entity tag, so that the condition cannot be true.",
        };
        let status = StatusCode::PRECONDITION_FAILED;
        Problem::new(status, "request.precondition_failed", "A precondition is false", detail).at(name).remedy(
            "Nothing was changed. Send the request without the condition; If-Match: * asks only that the resource exists.",
        )
    }

    /// `Idempotency-Key` where requests are not remembered.
    pub fn no_keys_here(route: &str) -> Problem {
        let detail = format!("{route} does not support Idempotency-Key.");
        let status = StatusCode::BAD_REQUEST;
        Problem::new(status, "idempotency.not_supported", "Idempotency-Key is not supported here", detail).at("Idempotency-Key").remedy(
            "Send the request without the header. Before you repeat it, look in the list of resources whether the first request succeeded.",
        )
    }
}
