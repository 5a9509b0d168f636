//! What a problem tells its client to do is done, word by word, and is not refused again. `tests/process/remedies.rs` looks at
//! every sentence of the source; here those with a call in them are followed.

use crate::resume::{OCTETS, VERSION, append, begin, metadata, offset, send};
use axum::body::Body;
use axum::http::{Method, StatusCode};
use serde_json::{Value, json};
use service::Config;
use service::accounts::access::Scope;
use service::storage::records::statement::sql;
use std::fs;
use std::path::Path;
use support::rays;
use support::runners::prompt;
use support::site::{Reply, Site};

/// Remedies with a call in them, each followed by a test here (`curl` by `tests/process/remedies.rs`).
const FOLLOWED: [&str; 15] = [
    "GET the upload to see its result.",
    "GET the upload to see why it was refused; then begin a new upload.",
    "Get the present offset with HEAD, and continue there.",
    "Begin a new upload with the right Upload-Length.",
    "Enable the webhook: PATCH it with {\\\"enabled\\\": true}.",
    "?dry_run=true estimates the memory without queueing the job",
    "OPTIONS /v1/uploads names the supported extensions of tus; begin a resumable upload with POST /v1/uploads.",
    "Give the length once: at the beginning, or later if the upload began with Upload-Defer-Length: 1.",
    "The request must have either Upload-Length or Upload-Defer-Length: 1.",
    "See /docs for all addresses.",
    "Use one of the methods in the Allow header.",
    "Send the header Authorization: Bearer with a valid API key; the operator of the service makes keys.",
    "Send JSON with Content-Type: application/json.",
    "Send Tus-Resumable: 1.0.0.",
    "Send the bytes with Content-Type: application/offset+octet-stream.",
];

#[test]
fn every_remedy_with_a_call_in_it_is_followed_somewhere() {
    const CALLS: [&str; 12] = [
        " GET ",
        " HEAD ",
        " PATCH ",
        " POST ",
        " DELETE ",
        "=true",
        "/docs",
        "Allow header",
        "Upload-Length",
        "Authorization:",
        "Content-Type: application/",
        "Tus-Resumable:",
    ];
    let mut found = Vec::new();
    let mut folders = vec![Path::new(env!("CARGO_MANIFEST_DIR")).join("src/service")];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            // A remedy is a sentence between quotes; where it goes on in the next line, the line tells enough.
            for line in fs::read_to_string(&path).unwrap().lines().map(str::trim) {
                let sentence = line.contains("remedy") || line.starts_with('"') || line.contains("Problem::");
                let is_doc = line.starts_with("//") || line.starts_with("(") || line.contains("description =");
                if sentence && !is_doc && CALLS.iter().any(|call| line.contains(call)) && line.contains('"') {
                    found.push(line.to_owned());
                }
            }
        }
    }
    assert!(found.len() >= FOLLOWED.len() - 3, "{found:#?}");
    for line in found {
        let known = FOLLOWED.iter().any(|remedy| line.contains(remedy)) || line.contains("curl ");
        assert!(known || !line.contains("remedy"), "nobody follows this: {line}");
    }
}

/// The remedy of a problem, which is to be this one.
fn told(reply: &Reply, status: u16, code: &str, remedy: &str) {
    reply.is_problem(status, code);
    let found = reply.json()["remedy"].as_str().unwrap_or_default().to_owned();
    assert!(found.contains(&remedy.replace("\\\"", "\"")), "{found:?}, expected {remedy:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn who_asks_at_a_wrong_place_is_led_to_a_right_one() {
    let site = Site::start(prompt()).await;
    told(&site.get("/v1/rays").await, 404, "request.not_found", "See /docs for all addresses.");
    let docs = site.get("/docs").await;
    assert_eq!(site.get(docs.header("location")).await.status, StatusCode::OK);
    let wrong = site.ask(Method::PUT, "/v1/jobs", &[], Body::empty()).await;
    told(&wrong, 405, "request.method_not_allowed", "Use one of the methods in the Allow header.");
    for method in wrong.header("allow").split(',').map(str::trim) {
        let reply = site.ask(method.parse().unwrap(), "/v1/jobs", &[], Body::empty()).await;
        assert_ne!(reply.status, StatusCode::METHOD_NOT_ALLOWED, "{method}");
    }
    let elsewhere = site.ask(Method::POST, "/v1/ray-sets", &[("upload-length", "9")], rays::zemax(9)).await;
    let remedy =
        "OPTIONS /v1/uploads names the supported extensions of tus; begin a resumable upload with POST /v1/uploads.";
    told(&elsewhere, 400, "request.header_not_honoured", remedy);
    let abilities = site.ask(Method::OPTIONS, "/v1/uploads", &[VERSION], Body::empty()).await;
    assert!(abilities.header("tus-extension").contains("creation"), "{abilities:?}");
    begin(&site, 9, &[]).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_body_that_was_sent_wrongly_is_sent_as_the_remedy_has_it() {
    let site = Site::start(prompt()).await;
    let ray_set = site.ray_set().await;
    let body = json!({ "channels": [{"ray_set": ray_set}] }).to_string();
    let wrong = site.ask(Method::POST, "/v1/jobs", &[("content-type", "text/plain")], body.clone()).await;
    told(&wrong, 415, "request.media_type", "Send JSON with Content-Type: application/json.");
    let right = site.ask(Method::POST, "/v1/jobs", &[("content-type", "application/json")], body).await;
    assert_eq!(right.status, StatusCode::ACCEPTED, "{right:?}");
    // What curl sends with -X POST -T FILE: the bytes, and no type.
    let form = [("content-type", "application/x-www-form-urlencoded")];
    let refused = [
        (site.ask(Method::POST, "/v1/ray-sets", &[], Body::empty()).await, 400, "upload.empty"),
        (site.ask(Method::POST, "/v1/ray-sets", &form, rays::zemax(9)).await, 415, "request.media_type"),
        (site.ask(Method::POST, "/v1/spectra", &[], Body::empty()).await, 400, "upload.empty"),
    ];
    for (reply, status, code) in refused {
        told(&reply, status, code, "curl -X POST -T FILE URL");
    }
    let sent = site.ask(Method::POST, "/v1/ray-sets", &[], rays::zemax(9)).await;
    assert_eq!(sent.status, StatusCode::CREATED, "{sent:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn who_has_no_key_is_told_how_to_show_one() {
    let site = Site::start_as(|config| Config { auth: true, ..config }, prompt()).await;
    let key = site.key_of("lab", &[Scope::JobsRead]).await;
    told(
        &site.get("/v1/jobs").await,
        401,
        "access.key_missing",
        "Send the header Authorization: Bearer with a valid API key",
    );
    let bearer = format!("Bearer {key}");
    let reply = site.ask(Method::GET, "/v1/jobs", &[("authorization", &bearer)], Body::empty()).await;
    assert_eq!(reply.status, StatusCode::OK);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_job_that_does_not_fit_is_asked_about_first() {
    let site = Site::start_as(|config| Config { memory_bytes: 5 << 20, ..config }, prompt()).await;
    let ray_set = site.ray_set().await;
    let new = json!({ "channels": [{"ray_set": ray_set}], "options": {"hull": {"resolution": 256}} });
    let refused = site.post("/v1/jobs", &new).await;
    told(&refused, 422, "job.too_large", "?dry_run=true estimates the memory without queueing the job");
    let estimate = site.post("/v1/jobs?dry_run=true", &new).await;
    assert_eq!((estimate.status, &estimate.json()["fits"]), (StatusCode::OK, &json!(false)));
}

#[tokio::test(flavor = "multi_thread")]
async fn an_upload_that_went_wrong_goes_on_as_the_remedy_has_it() {
    let site = Site::start(prompt()).await;
    let file = rays::zemax(100);
    let length = file.len().to_string();
    let silent = site.ask(Method::POST, "/v1/uploads", &[("upload-length", &*length)], Body::empty()).await;
    told(&silent, 412, "tus.version", "Send Tus-Resumable: 1.0.0.");
    let at = begin(&site, file.len(), &[]).await;
    // Another type, another place, then as told.
    let wrong = site.ask(Method::PATCH, &at, &[VERSION, ("upload-offset", "0")], file.clone()).await;
    told(&wrong, 415, "request.media_type", "Send the bytes with Content-Type: application/offset+octet-stream.");
    assert_eq!(append(&site, &at, 0, file[..1000].to_vec(), &[]).await.status, StatusCode::NO_CONTENT);
    let wrong = append(&site, &at, 0, file[..1000].to_vec(), &[]).await;
    told(&wrong, 409, "upload.offset_conflict", "Get the present offset with HEAD, and continue there.");
    let on = offset(&site, &at).await;
    assert_eq!(append(&site, &at, on, file[on..].to_vec(), &[]).await.status, StatusCode::NO_CONTENT);
    let wrong = append(&site, &at, file.len(), vec![1], &[]).await;
    told(&wrong, 409, "upload.complete", "GET the upload to see its result.");
    assert_eq!(site.get(&at).await.json()["state"], "taken");

    // A refused one says why. HEAD, which tells of it, has no body: the remedy is for who reads its GET.
    let text = begin(&site, 10, &[]).await;
    append(&site, &text, 0, b"no rays at".to_vec(), &[]).await.is_problem(400, "detect.not_rays");
    let head = site.ask(Method::HEAD, &text, &[VERSION], Body::empty()).await;
    assert_eq!(head.status, StatusCode::GONE, "GET the upload to see why it was refused; then begin a new upload.");
    assert_eq!(site.get(&text).await.json()["problem"]["code"], "detect.not_rays");
    send(&site, &file, 1000, &[("upload-metadata", &metadata(&[("name", "again")]))]).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn the_length_of_an_upload_is_said_as_the_remedy_has_it() {
    let site = Site::start(prompt()).await;
    let file = rays::zemax(100);
    let length = file.len().to_string();
    let none = site.ask(Method::POST, "/v1/uploads", &[VERSION], Body::empty()).await;
    none.is_problem(400, "request.malformed_header");
    assert_eq!(none.json()["detail"], "The request must have either Upload-Length or Upload-Defer-Length: 1.");
    let short = begin(&site, 10, &[]).await;
    let beyond = append(&site, &short, 0, file.clone(), &[]).await;
    told(&beyond, 413, "upload.beyond_length", "Begin a new upload with the right Upload-Length.");
    send(&site, &file, 5000, &[]).await;
    let short = begin(&site, 10, &[]).await;
    let twice = append(&site, &short, 0, file[..5].to_vec(), &[("upload-length", "20")]).await;
    told(
        &twice,
        400,
        "upload.length",
        "Give the length once: at the beginning, or later if the upload began with Upload-Defer-Length: 1.",
    );
    let headers = [VERSION, ("upload-defer-length", "1")];
    let begun = site.ask(Method::POST, "/v1/uploads", &headers, Body::empty()).await;
    assert_eq!(begun.status, StatusCode::CREATED, "{begun:?}");
    let headers = [VERSION, OCTETS, ("upload-offset", "0"), ("upload-length", &*length)];
    let all = site.ask(Method::PATCH, begun.header("location"), &headers, file).await;
    assert_eq!(all.status, StatusCode::NO_CONTENT, "{all:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_webhook_that_is_disabled_is_enabled_as_the_remedy_has_it() {
    let near = |config| Config { outbound_exceptions: vec!["127.0.0.0/8".parse().unwrap()], ..config };
    let site = Site::start_as(near, prompt()).await;
    let made = site.post("/v1/webhooks", &json!({ "url": "http://127.0.0.1:9/" })).await.json();
    let (at, ping) =
        (made["links"]["self"].as_str().unwrap(), format!("/v1/webhooks/{}/ping", made["id"].as_str().unwrap()));
    site.write(sql("UPDATE webhooks SET disabled_why = 'it answered 410'")).await;
    let refused = site.post(&ping, &json!({})).await;
    told(&refused, 409, "webhook.disabled", "Enable the webhook: PATCH it with {\"enabled\": true}.");
    let remedy = refused.json()["remedy"].as_str().unwrap().to_owned();
    let body: Value = serde_json::from_str(&remedy[remedy.find('{').unwrap()..=remedy.rfind('}').unwrap()]).unwrap();
    let patched = site.ask(Method::PATCH, at, &[("content-type", "application/json")], body.to_string()).await;
    assert_eq!((patched.status, &patched.json()["disabled_why"]), (StatusCode::OK, &json!(null)), "{patched:?}");
    assert!(site.post(&ping, &json!({})).await.status.is_success());
}
