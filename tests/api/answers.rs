//! How answers are sent (compressed, under entity tags, with limits told) and under which addresses the service is reached.

use crate::connections::{Listening, ROOMY, bounded};
use axum::body::Body;
use axum::http::Method;
use flate2::read::GzDecoder;
use serde_json::Value;
use service::Config;
use service::accounts::access::Scope;
use service::forwarded::Prefix;
use std::io::Read;
use support::runners::{pattern, prompt, sha256};
use support::site::{Reply, Site};

/// The artifact of [`pattern`].
const PATTERN: &str = "artifacts/ies/total%20%22%C3%BC%22.ies";

fn gunzip(bytes: &[u8]) -> Vec<u8> {
    let mut plain = Vec::new();
    GzDecoder::new(bytes).read_to_end(&mut plain).unwrap();
    plain
}

fn unzstd(bytes: &[u8]) -> Vec<u8> {
    let mut plain = Vec::new();
    ruzstd::decoding::StreamingDecoder::new(bytes).unwrap().read_to_end(&mut plain).unwrap();
    plain
}

async fn asked(site: &Site, path: &str, headers: &[(&str, &str)]) -> Reply {
    site.ask(Method::GET, path, headers, Body::empty()).await
}

async fn finished(site: &Site) -> String {
    let job = site.job(&site.ray_set().await).await;
    site.until_state(&job, "succeeded").await;
    job
}

#[tokio::test(flavor = "multi_thread")]
async fn texts_are_compressed_for_those_who_can_read_that() {
    let site = Site::start(prompt()).await;
    let plain = site.get("/openapi.json").await;
    assert_eq!(plain.header("vary"), "accept-encoding");
    assert!(!plain.headers.contains_key("content-encoding"));
    for (accepted, encoding, read) in [
        ("gzip", "gzip", gunzip as fn(&[u8]) -> Vec<u8>),
        ("gzip, deflate, br, zstd", "zstd", unzstd as fn(&[u8]) -> Vec<u8>),
        ("br, GZIP;q=0.4", "gzip", gunzip as fn(&[u8]) -> Vec<u8>),
    ] {
        let reply = asked(&site, "/openapi.json", &[("accept-encoding", accepted)]).await;
        assert_eq!(
            (reply.header("content-encoding"), reply.header("vary")),
            (encoding, "accept-encoding"),
            "{accepted}"
        );
        assert!(read(&reply.body) == plain.body && 4 * reply.body.len() < plain.body.len(), "{accepted}");
        let head = site.ask(Method::HEAD, "/openapi.json", &[("accept-encoding", accepted)], Body::empty()).await;
        for name in ["content-encoding", "vary", "etag", "content-type"] {
            assert_eq!(head.headers.get(name), reply.headers.get(name), "{name}");
        }
        assert!(!head.headers.contains_key("content-length"), "nobody knows it before it is compressed");
    }
    // RFC 9110, section 12.5.3: what is not named can still be sent as it is.
    for accepted in ["", "br", "identity", "gzip;q=0", "identity;q=0", "*;q=0"] {
        let reply = asked(&site, "/openapi.json", &[("accept-encoding", accepted)]).await;
        assert!(reply.status == 200 && !reply.headers.contains_key("content-encoding"), "{accepted}");
        assert_eq!(reply.body, plain.body);
    }
    // What is short, packed already, or a stream of events.
    let job = finished(&site).await;
    for path in ["/healthz".to_owned(), format!("/v1/jobs/{job}/model.zip"), format!("/v1/jobs/{job}/events")] {
        let reply = asked(&site, &path, &[("accept-encoding", "gzip, zstd")]).await;
        assert!(reply.status == 200 && !reply.headers.contains_key("content-encoding"), "{path}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_compressed_file_has_a_weak_tag_and_ranges_are_of_the_file_itself() {
    let site = Site::start(prompt()).await;
    let path = format!("/v1/jobs/{}/{PATTERN}", finished(&site).await);
    let (strong, zipped) = (format!("\"{}\"", sha256(&pattern())), ("accept-encoding", "gzip"));
    let weak = format!("W/{strong}");
    let whole = asked(&site, &path, &[zipped]).await;
    assert_eq!((whole.header("etag"), whole.header("content-encoding")), (weak.as_str(), "gzip"));
    assert!(gunzip(&whole.body) == pattern() && !whole.headers.contains_key("accept-ranges"));
    assert_eq!(asked(&site, &path, &[]).await.header("etag"), strong);
    for known in [&strong, &weak] {
        let reply = asked(&site, &path, &[zipped, ("if-none-match", known)]).await;
        assert_eq!((reply.status.as_u16(), reply.header("etag")), (304, known.as_str()));
        assert_eq!(reply.header("vary"), "accept-encoding");
    }
    let part = asked(&site, &path, &[zipped, ("range", "bytes=0-9999")]).await;
    assert_eq!((part.status.as_u16(), part.header("etag")), (206, strong.as_str()));
    assert!(part.body == pattern()[..10_000] && !part.headers.contains_key("content-encoding"));
    // A part of the compressed file cannot be had: all of it comes.
    let whole = asked(&site, &path, &[zipped, ("range", "bytes=0-9999"), ("if-range", &weak)]).await;
    assert_eq!((whole.status.as_u16(), whole.header("content-encoding")), (200, "gzip"));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_file_that_is_not_the_expected_one_is_refused() {
    let site = Site::start(prompt()).await;
    let job = finished(&site).await;
    let ray_set = site.ray_set().await;
    let mut paths =
        vec![format!("/v1/jobs/{job}/{PATTERN}"), format!("/v1/jobs/{job}/model.zip"), "/openapi.json".into()];
    paths.extend(["/docs/".into(), "/docs/swagger-ui.css".into()]);
    paths.extend(["origins.svg", "far-field.svg"].map(|name| format!("/v1/ray-sets/{ray_set}/{name}")));
    for path in paths {
        let etag = site.get(&path).await.header("etag").to_owned();
        for right in [etag.as_str(), "*"] {
            assert_eq!(asked(&site, &path, &[("if-match", right)]).await.status, 200, "{path} {right}");
        }
        for wrong in ["\"other\"", &format!("W/{etag}")] {
            asked(&site, &path, &[("if-match", wrong)]).await.is_problem(412, "request.precondition_failed");
        }
        let known = asked(&site, &path, &[("if-none-match", &etag)]).await;
        assert_eq!((known.status.as_u16(), known.body.len()), (304, 0), "{path}");
        if path.starts_with("/v1/ray-sets") {
            let drawing = site.get(&path).await;
            assert!(drawing.header("content-disposition").starts_with("inline; filename="), "{drawing:?}");
            assert!(drawing.header("content-security-policy").contains("sandbox"));
        }
        if !path.starts_with("/v1") {
            assert!(known.header("cache-control").contains(", max-age="), "{path}");
        }
    }
}

/// Every link in a body.
fn links(value: &Value) -> Vec<String> {
    match value {
        Value::String(text) if text.contains("/v1/") => vec![text.clone()],
        Value::Array(list) => list.iter().flat_map(links).collect(),
        Value::Object(members) => members.values().flat_map(links).collect(),
        _ => Vec::new(),
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn behind_a_path_every_link_begins_with_it() {
    let public = Prefix::parse("/lamps");
    let change = |mut config: Config| {
        config.proxies.public.clone_from(&public);
        config
    };
    let site = Site::start_as(change, prompt()).await;
    let job = finished(&site).await;
    let rays = support::rays::zemax(10);
    let length = rays.len().to_string();
    let begun = [("tus-resumable", "1.0.0"), ("upload-length", length.as_str())];
    let upload = site.ask(Method::POST, "/v1/uploads", &begun, Body::empty()).await;
    let spectrum = site.ask(Method::POST, "/v1/spectra", &[], "440 0\n450 1\n460 0\n").await;
    let made = [site.upload(rays).await, upload, spectrum];
    for reply in &made {
        assert!(reply.status == 201 && reply.header("location").starts_with("/lamps/v1/"), "{reply:?}");
    }
    let mut seen = 0;
    for path in [
        format!("/v1/jobs/{job}"),
        "/v1/jobs".to_owned(),
        format!("/v1/jobs/{job}/artifacts"),
        "/v1/ray-sets".to_owned(),
        "/v1/uploads".to_owned(),
        "/v1/spectra".to_owned(),
        made[0].header("location")["/lamps".len()..].to_owned(),
    ] {
        let found = links(&site.get(&path).await.json());
        assert!(!found.is_empty(), "{path}");
        for link in found {
            let own = link.strip_prefix("/lamps").unwrap_or_else(|| panic!("{path}: {link}"));
            let ours = site.ask(Method::GET, own, &[], Body::empty()).await;
            assert!(ours.status == 200 || ours.status == 405, "{link}: {ours:?}");
            seen += 1;
        }
    }
    assert!(seen > 15, "{seen}");
    let events = String::from_utf8(site.get(&format!("/v1/jobs/{job}/events")).await.body).unwrap();
    assert!(events.contains("\"/lamps/v1/jobs/") && !events.contains("\"/v1/"), "{events}");
    assert_eq!(site.get("/docs").await.header("location"), "/lamps/docs/");
    assert_eq!(site.get("/openapi.json").await.json()["servers"], serde_json::json!([{"url": "/lamps"}]));
}

#[tokio::test(flavor = "multi_thread")]
async fn what_a_proxy_says_of_the_path_is_believed_if_it_is_trusted() {
    for (network, expected) in [("127.0.0.1", "/lamps/v1/jobs/"), ("192.0.2.0/24", "/v1/jobs/")] {
        let change = |mut config: Config| {
            config.proxies.trusted = vec![network.parse().unwrap_or_else(|_| format!("{network}/32").parse().unwrap())];
            bounded(ROOMY)(config)
        };
        let mut site = Site::start_as(change, prompt()).await;
        let job = finished(&site).await;
        let service = Listening::on(&mut site);
        let request = format!(
            "GET /v1/jobs/{job} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\nX-Forwarded-Prefix: /lamps/\r\n\r\n"
        );
        let answer = service.ask(&request).await;
        assert!(answer.contains(&format!("\"self\":\"{expected}")), "{answer}");
        service.stop().await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_slash_at_the_end_changes_nothing() {
    let site = Site::start(prompt()).await;
    let job = finished(&site).await;
    let paths = ["/v1/jobs", "/v1/ray-sets", "/healthz", "/readyz", "/metrics", "/openapi.json"].map(str::to_owned);
    for path in paths.into_iter().chain([format!("/v1/jobs/{job}"), format!("/v1/jobs/{job}/model.zip")]) {
        assert_eq!(site.get(&format!("{path}/")).await.status, 200, "{path}/");
    }
    let created = site.ask(Method::POST, "/v1/ray-sets/?name=led.dat", &[], support::rays::zemax(10)).await;
    assert_eq!((created.status.as_u16(), created.ray_set()["name"].as_str()), (201, Some("led.dat")));
    site.get("/v1/nothing/").await.is_problem(404, "request.not_found");
    assert_eq!(site.delete(&format!("/v1/jobs/{job}/")).await.status, 204);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_request_says_which_host_it_means() {
    let mut site = Site::start_as(bounded(ROOMY), prompt()).await;
    let service = Listening::on(&mut site);
    let ask = async |head: &str| service.ask(&format!("{head}Connection: close\r\n\r\n")).await;
    // RFC 9112, section 3.2.
    for wrong in ["", "Host: localhost\r\nHost: localhost\r\n", "Host: a b\r\n", "Host: localhost\r\nHost: other\r\n"] {
        let answer = ask(&format!("GET /healthz HTTP/1.1\r\n{wrong}")).await;
        assert!(answer.starts_with("HTTP/1.1 400 Bad Request\r\n"), "{wrong:?}: {answer}");
        assert!(answer.contains("request.malformed_header"), "{wrong:?}: {answer}");
    }
    assert!(ask("GET /healthz HTTP/1.0\r\n").await.starts_with("HTTP/1.0 200 OK\r\n"));
    // Section 3.2.2: the address of the request goes before its Host.
    let absolute = ask("GET http://evil.example/v1/jobs HTTP/1.1\r\nHost: localhost\r\n").await;
    assert!(absolute.contains("access.foreign_host"), "{absolute}");
    assert!(
        ask("GET http://localhost/v1/jobs HTTP/1.1\r\nHost: localhost\r\n").await.starts_with("HTTP/1.1 200 OK\r\n")
    );
    // A status that HTTP does not know has its words too.
    let head = "POST /v1/uploads HTTP/1.1\r\nHost: localhost\r\nTus-Resumable: 1.0.0\r\nUpload-Length: 10\r\nConnection: close\r\n\
                Content-Type: application/offset+octet-stream\r\nContent-Length: 4\r\n\
                Upload-Checksum: sha1 Kq5sNclPz7QV2+lfQIuc6R7oRu0=\r\n\r\nrays";
    let answer = service.ask(head).await;
    assert!(answer.starts_with("HTTP/1.1 460 Checksum Mismatch\r\n"), "{answer}");
    service.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_key_is_told_how_often_it_may_ask() {
    let change = |config| Config { auth: true, rate_per_second: 2, rate_burst: 5, ..config };
    let mut site = Site::start_as(change, prompt()).await;
    site.key = Some(site.key_of("lab", &Scope::OF_A_TENANT).await);
    let first = site.get("/v1/jobs").await;
    // draft-ietf-httpapi-ratelimit-headers-09: quota and window of the policy; what is left, and when there is all of it again.
    assert_eq!(first.header("ratelimit-policy"), "\"requests\";q=5;w=3");
    assert_eq!(first.header("ratelimit"), "\"requests\";r=4;t=1");
    let many = futures::future::join_all((0..40).map(|_| site.get("/v1/jobs"))).await;
    let refused = many.iter().find(|reply| reply.status == 429).unwrap();
    assert_eq!(refused.header("ratelimit"), format!("\"requests\";r=0;t={}", refused.header("retry-after")));
    for path in ["/healthz", "/openapi.json"] {
        assert!(!site.get(path).await.headers.contains_key("ratelimit"), "{path} is not counted");
    }
}
