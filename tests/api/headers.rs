//! Headers that change what a request means, on every route of the contract: honoured or refused, never ignored. Expected statuses
//! are those of RFC 9110, of tus 1.0.0 and of the table in `openapi/README.md`.

use crate::access::{Operation, Things, lab, operations};
use crate::connections::{Listening, ended};
use crate::resume::{OCTETS, VERSION, append, begin};
use axum::body::Body;
use axum::http::{Method, StatusCode};
use serde_json::json;
use service::accounts::access::Scope;
use service::storage::records::statement::sql;
use support::rays;
use support::runners::prompt;
use support::site::{Reply, Site};

/// Things whose entity tags their own handlers judge.
const TAGGED: [&str; 6] =
    ["adapt_model", "get_artifact", "get_zip", "draw_rays", "get_origins_drawing", "get_far_field_drawing"];

/// Sends an operation with one more header.
async fn with(site: &Site, things: &Things, operation: &Operation, key: &str, header: (&str, &str)) -> Reply {
    let mut headers = vec![("authorization", key), header];
    match operation.path.starts_with("/v1/uploads") {
        true => headers.extend([VERSION, OCTETS, ("upload-offset", "0")]),
        false => headers.push(("content-type", "application/json")),
    }
    if operation.id == "create_upload" {
        headers.push(("upload-length", "488"));
    }
    let address = things.address(&operation.path);
    site.ask(operation.method.clone(), &address, &headers, things.body(&operation.id)).await
}

fn is_safe(operation: &Operation) -> bool {
    matches!(operation.method, Method::GET | Method::HEAD)
}

/// What one header comes to on an operation: a status, and the code of a problem where the answer has a body.
fn refusal(operation: &Operation, header: (&str, &str)) -> Option<(u16, &'static str)> {
    let changes = !is_safe(operation);
    let has_body = matches!(operation.method, Method::POST | Method::PATCH);
    let is_tagged = TAGGED.contains(&operation.id.as_str());
    match header {
        ("expect", _) => Some((417, "request.expectation")),
        ("x-http-method-override", _) if operation.path.starts_with("/v1/uploads") => None,
        ("x-http-method-override" | "x-http-method" | "x-method-override", _) => {
            Some((400, "request.header_not_honoured"))
        }
        ("content-encoding", _) if changes => Some((415, "request.media_type")),
        ("content-range" | "trailer", _) if changes => Some((400, "request.header_not_honoured")),
        ("upload-complete" | "upload-incomplete" | "upload-part", _) if has_body => {
            Some((400, "request.header_not_honoured"))
        }
        ("idempotency-key", _) if has_body && !["create_job", "queue_evaluation"].contains(&operation.id.as_str()) => {
            Some((400, "idempotency.not_supported"))
        }
        ("if-match", tags) if tags != "*" && !is_tagged => Some((412, "request.precondition_failed")),
        ("if-none-match", "*") if changes => Some((412, "request.precondition_failed")),
        _ => None,
    }
}

const TRIED: [(&str, &str); 15] = [
    ("expect", "200-ok"),
    ("x-http-method-override", "PUT"),
    ("x-http-method", "PUT"),
    ("x-method-override", "PUT"),
    ("content-encoding", "gzip"),
    ("content-encoding", "zstd"),
    ("content-range", "bytes 0-9/100"),
    ("trailer", "Upload-Checksum"),
    ("upload-complete", "?0"),
    ("upload-incomplete", "?1"),
    ("upload-part", "1"),
    ("idempotency-key", "\"a\""),
    ("if-match", "\"nobodys\""),
    ("if-match", "W/\"a\", \"b\""),
    ("if-none-match", "*"),
];

#[tokio::test(flavor = "multi_thread")]
async fn every_route_refuses_every_header_that_it_does_not_honour_and_does_nothing() {
    let (site, things) = lab().await;
    let rows = "SELECT id, state, cancel_requested AS n FROM jobs UNION ALL SELECT id, name, 0 FROM ray_sets \
                UNION ALL SELECT id, name, 0 FROM spectra UNION ALL SELECT id, state, offset_bytes FROM uploads \
                UNION ALL SELECT id, secret, 0 FROM webhooks UNION ALL SELECT id, event, 0 FROM deliveries ORDER BY 1";
    let told = async |site: &Site| {
        let rows = site.rows(sql(rows)).await;
        rows.iter()
            .map(|row| (row.text("id").unwrap(), row.text("state").unwrap(), row.number("n").unwrap()))
            .collect::<Vec<_>>()
    };
    let before = told(&site).await;
    let mut refused = 0;
    for operation in operations() {
        // Each route with a key of its own: none may ask so often.
        let key = format!("Bearer {}", site.key_of("lab", &Scope::ALL).await);
        for header in TRIED {
            let Some((status, code)) = refusal(&operation, header) else { continue };
            let reply = with(&site, &things, &operation, &key, header).await;
            assert_eq!(reply.status.as_u16(), status, "{} {header:?}: {reply:?}", operation.id);
            if operation.method != Method::HEAD {
                reply.is_problem(status, code);
                assert!(reply.json()["remedy"].is_string(), "{} {header:?}", operation.id);
            }
            if status == 415 {
                assert_eq!(reply.header("accept-encoding"), "identity");
            }
            refused += 1;
        }
    }
    assert!(refused > 250, "only {refused} were tried");
    assert_eq!(told(&site).await, before, "something was done");
    // Without a key nothing is judged but the key (RFC 9110, section 13.2.1).
    let job = operations().into_iter().find(|operation| operation.id == "get_job").unwrap();
    with(&site, &things, &job, "Bearer x", ("if-match", "\"a\"")).await.is_problem(401, "access.key_malformed");
}

#[tokio::test(flavor = "multi_thread")]
async fn what_holds_and_what_may_be_ignored_changes_no_answer() {
    let (site, things) = lab().await;
    let key = format!("Bearer {}", site.key_of("lab", &Scope::ALL).await);
    for operation in operations().iter().filter(|operation| is_safe(operation)) {
        let key = format!("Bearer {}", site.key_of("lab", &Scope::ALL).await);
        let plain = with(&site, &things, operation, &key, ("x-test", "none")).await;
        assert!(plain.status.is_success(), "{}: {plain:?}", operation.id);
        let is_tagged = TAGGED.contains(&operation.id.as_str());
        for header in [
            ("if-none-match", "\"nobodys\""),
            // Nothing here has a date of a change: such a condition is to be ignored (RFC 9110, section 13.1.4).
            ("if-unmodified-since", "Sat, 29 Oct 1994 19:43:31 GMT"),
            ("if-modified-since", "Sat, 29 Oct 2094 19:43:31 GMT"),
            // RFC 7240, section 2: what is not honoured is ignored. Preference-Applied does not say that it was.
            ("prefer", "respond-async, wait=1, return=minimal, handling=strict"),
            ("idempotency-key", "\"a\""),
            ("expect", "100-Continue"),
            ("content-encoding", "gzip"),
        ] {
            let reply = with(&site, &things, operation, &key, header).await;
            assert_eq!(reply.status, plain.status, "{} {header:?}: {reply:?}", operation.id);
            assert_eq!(reply.headers.get("preference-applied"), None);
        }
        if is_tagged {
            continue;
        }
        let there = with(&site, &things, operation, &key, ("if-match", "*")).await;
        assert_eq!(there.status, plain.status, "{}", operation.id);
        // A part of what has no tag is answered with all of it (RFC 9110, section 14.2).
        let part = with(&site, &things, operation, &key, ("range", "bytes=0-0")).await;
        assert_eq!(part.status, plain.status, "{}", operation.id);
        let known = with(&site, &things, operation, &key, ("if-none-match", "*")).await;
        assert_eq!((known.status, known.body.len()), (StatusCode::NOT_MODIFIED, 0), "{}", operation.id);
        let wrong = with(&site, &things, operation, &key, ("if-match", "nobodys")).await;
        assert_eq!(wrong.status, StatusCode::BAD_REQUEST, "{}", operation.id);
    }
    // What changes something, under conditions that hold.
    for header in [
        ("if-match", "*"),
        ("if-none-match", "\"nobodys\""),
        ("prefer", "return=minimal"),
        ("content-encoding", "identity"),
    ] {
        for operation in operations().iter().filter(|operation| {
            ["create_job", "create_webhook", "change_webhook", "upload_ray_set"].contains(&operation.id.as_str())
        }) {
            let reply = with(&site, &things, operation, &key, header).await;
            assert!(reply.status.is_success(), "{} {header:?}: {reply:?}", operation.id);
        }
    }
    // A thing that is not there: there is none, whatever the condition.
    let missing = "/v1/jobs/0190b5a0-0000-7000-8000-000000000000";
    for (name, value) in [("if-match", "*"), ("if-match", "\"a\""), ("if-none-match", "*")] {
        let reply = site.ask(Method::GET, missing, &[("authorization", &key), (name, value)], Body::empty()).await;
        reply.is_problem(404, "job.not_found");
    }
    let reply = site.ask(Method::DELETE, missing, &[("authorization", &key), ("if-match", "*")], Body::empty()).await;
    reply.is_problem(404, "job.not_found");
    let wrong =
        site.ask(Method::DELETE, missing, &[("authorization", &key), ("if-match", "nobodys")], Body::empty()).await;
    wrong.is_problem(400, "request.malformed_header");
}

#[tokio::test(flavor = "multi_thread")]
async fn headers_of_tus_are_honoured_where_they_mean_something() {
    let site = Site::start(prompt()).await;
    let file = rays::zemax(20);
    let at = begin(&site, file.len(), &[]).await;
    for header in [("upload-concat", "partial"), ("upload-metadata", "name YQ=="), ("upload-defer-length", "1")] {
        append(&site, &at, 0, file.clone(), &[header]).await.is_problem(400, "request.header_not_honoured");
    }
    append(&site, &at, 0, file.clone(), &[("upload-concat", "final;/v1/uploads/a")])
        .await
        .is_problem(400, "request.header_not_honoured");
    append(&site, &at, 0, file.clone(), &[("upload-offset", "0")]).await.is_problem(400, "request.malformed_header");
    append(&site, &at, 0, file.clone(), &[("trailer", "Upload-Checksum")])
        .await
        .is_problem(400, "request.header_not_honoured");
    append(&site, &at, 0, file.clone(), &[("content-encoding", "gzip")]).await.is_problem(415, "request.media_type");
    let length = file.len().to_string();
    let first = [VERSION, OCTETS, ("upload-length", length.as_str())];
    let begun = async |more: (&str, &str)| {
        site.ask(Method::POST, "/v1/uploads", &[&first[..], &[more]].concat(), file.clone()).await
    };
    begun(("upload-offset", "10")).await.is_problem(400, "request.header_not_honoured");
    assert_eq!(begun(("upload-offset", "0")).await.status, StatusCode::CREATED);
    // The checksum of a body that is not there is held against nothing: FIPS 180-2, SHA-1 of "abc", and of nothing.
    for (checksum, status) in [("sha1 qZk+NkcGgWq6PiVxeFDCbJzQ2J0=", 460), ("sha1 2jmj7l5rSw0yVb/vlWAYkK/YBwk=", 201)] {
        let headers = [VERSION, ("upload-length", length.as_str()), ("upload-checksum", checksum)];
        assert_eq!(site.ask(Method::POST, "/v1/uploads", &headers, Body::empty()).await.status.as_u16(), status);
    }
    // An upload of tus that went to the address of plain ones would be an empty file, one of its successor half a file.
    let plain = async |more: (&str, &str)| site.ask(Method::POST, "/v1/ray-sets", &[more], file.clone()).await;
    for header in
        [("upload-length", "488"), ("upload-offset", "9"), ("upload-complete", "?0"), ("upload-concat", "partial")]
    {
        plain(header).await.is_problem(400, "request.header_not_honoured");
    }
    for header in [("upload-complete", "?1"), ("upload-draft-interop-version", "8")] {
        assert_eq!(plain(header).await.status, StatusCode::CREATED, "{header:?}");
    }
    // The method itself may be said twice.
    assert_eq!(plain(("x-http-method-override", "POST")).await.status, StatusCode::CREATED);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_body_has_one_length() {
    let mut site = Site::start(prompt()).await;
    let listening = Listening::on(&mut site);
    let body = json!({"url": "https://a.example/"}).to_string();
    let chunked = format!("{:x}\r\n{body}\r\n0\r\n\r\n", body.len());
    let (chunks, length) = ("Transfer-Encoding: chunked\r\n", format!("Content-Length: {}\r\n", body.len()));
    let begin = "POST /v1/webhooks HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n";
    let next = "GET /healthz HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n";
    for both in [format!("{length}{chunks}"), format!("{chunks}{length}")] {
        let mut stream = listening.open(format!("{begin}{both}\r\n{chunked}{next}").as_bytes()).await;
        let answers = ended(&mut stream).await;
        // RFC 9112, section 6.1: refused, or read by its chunks; never by its length, which would leave a request of the rest.
        let is_refused = answers.starts_with("HTTP/1.1 400 ");
        let is_by_chunks = answers.starts_with("HTTP/1.1 201 ") && answers.matches("HTTP/1.1 ").count() <= 2;
        assert!(is_refused || is_by_chunks, "{both:?}: {answers}");
        assert!(!answers.contains("request.method_not_allowed"), "{answers}");
    }
    // An expectation is answered before the body is asked for.
    let expecting = format!("{begin}Content-Length: 9000\r\nExpect: a-miracle\r\nConnection: close\r\n\r\n");
    let answer = ended(&mut listening.open(expecting.as_bytes()).await).await;
    assert!(answer.starts_with("HTTP/1.1 417 "), "{answer}");
    listening.stop().await;
}
