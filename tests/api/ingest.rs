//! Files that are fetched: like those that are sent, from nowhere that the service may not ask.

use crate::connections::PATIENCE;
use axum::Router;
use axum::body::{Body, Bytes};
use axum::http::{StatusCode, header};
use axum::response::Redirect;
use axum::routing::get;
use futures::{StreamExt, stream};
use serde_json::json;
use service::Config;
use service::accounts::access::Scope;
use service::accounts::quota::Quota;
use service::storage::blobs::Blobs;
use service::storage::records::statement::sql;
use std::convert::Infallible;
use std::time::{Duration, Instant};
use support::rays::zemax;
use support::runners::{prompt, sha256};
use support::site::Site;
use tokio::net::{TcpListener, TcpSocket};

const RAYS: u32 = 1000;

/// Somebody else's files; its port.
pub async fn files() -> u16 {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let port = listener.local_addr().unwrap().port();
    let half = || Bytes::from(zemax(RAYS)[..5000].to_vec());
    let to = |to: String| get(async move || Redirect::temporary(&to));
    let router = Router::new()
        .route("/files/led%201.dat", get(async || zemax(RAYS)))
        .route("/led.gz", get(async || support::packing::gzip(&zemax(RAYS))))
        .route("/text", get(async || "this is no ray file at all, and never was one\n".repeat(4000)))
        .route("/one", to("/files/led%201.dat".into()))
        .route("/three", to("/two".into()))
        .route("/two", to("/one".into()))
        .route("/four", to("/three".into()))
        .route("/away", to(format!("http://127.0.0.1:{port}/files/led%201.dat")))
        .route("/cloud", to("http://169.254.169.254/latest/meta-data/".into()))
        .route("/file", to("file:///etc/passwd".into()))
        .route("/cut", get(async move || ([(header::CONTENT_LENGTH, "90000")], Body::from_stream(broken(half())))))
        .route(
            "/silent",
            get(async move || Body::from_stream(stream::iter([Ok::<_, Infallible>(half())]).chain(stream::pending()))),
        );
    tokio::spawn(async move { axum::serve(listener, router).await });
    port
}

/// A body that breaks in its middle: what came before is sent while it waits.
fn broken(half: Bytes) -> impl futures::Stream<Item = std::io::Result<Bytes>> {
    let breaks = async {
        tokio::task::yield_now().await;
        Err(std::io::ErrorKind::ConnectionReset.into())
    };
    stream::iter([Ok(half)]).chain(stream::once(breaks))
}

/// A service that fetches, also from the name of this machine.
pub fn near(config: Config) -> Config {
    Config { ingest: Some(true), outbound_exceptions: vec!["localhost".parse().unwrap()], ..config }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_file_that_is_fetched_is_like_one_that_was_sent() {
    let (site, port) = (Site::start_as(near, prompt()).await, files().await);
    let at = |path: &str| format!("http://localhost:{port}{path}");
    let file = zemax(RAYS);
    for path in ["/files/led%201.dat?token=x", "/one", "/three"] {
        let body = json!({"url": at(path), "sha256": sha256(&file).to_uppercase(), "length_unit": "mm"});
        let reply = site.post("/v1/ray-sets/ingest", &body).await;
        assert_eq!(reply.status, StatusCode::CREATED, "{reply:?}");
        let ray_set = reply.ray_set();
        assert_eq!(reply.header("location"), ray_set["links"]["self"].as_str().unwrap());
        assert_eq!((&ray_set["sha256"], &ray_set["byte_count"]), (&json!(sha256(&file)), &json!(file.len())));
        assert_eq!(ray_set["declared"]["length_unit"], "mm");
        let name = if path.starts_with("/files") { "led 1.dat" } else { &path[1..] };
        assert_eq!(ray_set["name"], name);
    }
    let packed =
        site.post("/v1/ray-sets/ingest", &json!({"url": at("/led.gz"), "name": "lamp.dat.gz"})).await.ray_set();
    assert_eq!((&packed["sha256"], &packed["packed"]["name"]), (&json!(sha256(&file)), &json!("lamp.dat.gz")));
    let job = site.job(packed["id"].as_str().unwrap()).await;
    site.until_state(&job, "succeeded").await;
    let text = String::from_utf8(site.get("/metrics").await.body).unwrap();
    let came = 3 * file.len() + support::packing::gzip(&file).len();
    assert!(text.contains(&format!("lampwright_upload_bytes_total {came}\n")), "{text}");
}

#[tokio::test(flavor = "multi_thread")]
async fn what_cannot_be_fetched_is_said_and_leaves_nothing() {
    let (site, port) = (Site::start_as(near, prompt()).await, files().await);
    let at = |path: &str| format!("http://localhost:{port}{path}");
    // Bound and never listened on: nobody answers there, and nobody else gets it meanwhile.
    let closed = TcpSocket::new_v4().unwrap();
    closed.bind("127.0.0.1:0".parse().unwrap()).unwrap();
    let refused = closed.local_addr().unwrap().port();
    for (url, status, code) in [
        (at("/nothing"), 502, "ingest.status"),
        (at("/four"), 502, "ingest.redirects"),
        (at("/cut"), 502, "ingest.broken"),
        (at("/silent"), 504, "ingest.slow"),
        (at("/text"), 400, "detect.not_rays"),
        (format!("http://localhost:{refused}/"), 502, "ingest.unreachable"),
        // Only the name is an exception: neither its address nor what a redirect says is.
        (format!("http://127.0.0.1:{port}/one"), 422, "ingest.address_refused"),
        (at("/away"), 422, "ingest.address_refused"),
        (at("/cloud"), 422, "ingest.address_refused"),
        (at("/file"), 422, "ingest.url"),
        ("https://[::ffff:127.0.0.1]/".into(), 422, "ingest.address_refused"),
        ("http://example.org/led.dat".into(), 422, "ingest.url"),
        ("file:///etc/passwd".into(), 422, "ingest.url"),
        ("s3://anybody/led.dat".into(), 422, "ingest.bucket_refused"),
        ("".into(), 422, "ingest.url"),
    ] {
        let reply = site.post("/v1/ray-sets/ingest", &json!({ "url": url })).await;
        assert_eq!((reply.status.as_u16(), reply.problem().1.as_str()), (status, code), "{url}: {}", reply.json());
    }
    let led = at("/one");
    for (body, status, code) in [
        (json!({"url": led, "sha256": "0".repeat(64)}), 400, "upload.digest_mismatch"),
        (json!({"url": led, "sha256": "0"}), 422, "request.out_of_range"),
        (json!({"url": led, "columns": ["x", "nonsense"]}), 422, "rays.column_unknown"),
        (json!({"url": led, "name": "x".repeat(256)}), 422, "request.out_of_range"),
        (json!({"address": led}), 422, "request.unknown_field"),
        (json!({}), 422, "request.missing_field"),
    ] {
        site.post("/v1/ray-sets/ingest", &body).await.is_problem(status, code);
    }
    assert!(site.rows(sql("SELECT id FROM ray_sets")).await.is_empty());
    site.until_blobs(<[String]>::is_empty).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn the_bounds_of_uploads_hold_and_who_goes_away_ends_it() {
    let small = |config| Config { max_upload_bytes: 10_000, ..near(config) };
    let (site, port) = (Site::start_as(small, prompt()).await, files().await);
    let from = |path: &str| json!({ "url": format!("http://localhost:{port}{path}") });
    site.post("/v1/ray-sets/ingest", &from("/one")).await.is_problem(413, "upload.too_large");
    let poor = |config| near(Config { quota: Quota { stored_bytes: 1000, ..Quota::default() }, ..config });
    let site = Site::start_as(poor, prompt()).await;
    site.post("/v1/ray-sets/ingest", &from("/one")).await.is_problem(413, "quota.stored_bytes");

    // So slow is allowed here that only its client can end it.
    let patient = |config: Config| {
        let slowest = service::ray_sets::pace::Slowest { interval: PATIENCE * 10, ..config.slowest };
        near(Config { slowest, ..config })
    };
    let site = Site::start_as(patient, prompt()).await;
    let uploads = async |site: &Site| {
        let text = String::from_utf8(site.get("/metrics").await.body).unwrap();
        text.lines().find_map(|line| line.strip_prefix("lampwright_uploads ")).unwrap().to_owned()
    };
    let begun = async {
        while uploads(&site).await != "1" {
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    };
    let silent = from("/silent");
    tokio::select! {
        reply = site.post("/v1/ray-sets/ingest", &silent) => panic!("{reply:?}"),
        () = begun => {}
    }
    let gone = Instant::now();
    while uploads(&site).await != "0" {
        assert!(gone.elapsed() < PATIENCE, "it is fetched for nobody");
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    assert!(site.rows(sql("SELECT id FROM ray_sets")).await.is_empty());
    site.until_blobs(<[String]>::is_empty).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn without_keys_nothing_is_fetched_unless_somebody_says_so() {
    let site = Site::start(prompt()).await;
    let body = json!({"url": "https://127.0.0.1/led.dat"});
    site.post("/v1/ray-sets/ingest", &body).await.is_problem(403, "ingest.off");
    let mut site = Site::start_as(|config| Config { auth: true, ..config }, prompt()).await;
    site.key = Some(site.key_of("lab", &Scope::OF_A_TENANT).await);
    site.post("/v1/ray-sets/ingest", &body).await.is_problem(422, "ingest.address_refused");
    let never = |config| Config { auth: true, ingest: Some(false), ..config };
    let mut site = Site::start_as(never, prompt()).await;
    site.key = Some(site.key_of("lab", &Scope::OF_A_TENANT).await);
    site.post("/v1/ray-sets/ingest", &body).await.is_problem(403, "ingest.off");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_bucket_that_the_operator_names_is_read_and_no_other() {
    if !support::engines::are_shared() {
        println!("LEFT OUT: no S3 server");
        return;
    }
    // Of a site's own prefix one folder may be read, and the one beside it may not.
    let named = |config: Config| {
        let bucket = format!("{}/shared", config.storage_url());
        Config { ingest_buckets: vec![bucket], ..config }
    };
    let site = Site::start_as(named, prompt()).await;
    let (bucket, file) = (site.config.ingest_buckets[0].clone(), zemax(RAYS));
    let (shared, beside) = (Blobs::open(&bucket).unwrap(), Blobs::open(&format!("{bucket}-not")).unwrap());
    shared.put("vendor/led.dat", file.clone().into()).await.unwrap();
    beside.put("led.dat", file.clone().into()).await.unwrap();
    let fetch = async |url: String| site.post("/v1/ray-sets/ingest", &json!({ "url": url })).await;
    let ray_set = fetch(format!("{bucket}/vendor/led.dat")).await.ray_set();
    assert_eq!((&ray_set["name"], &ray_set["sha256"]), (&json!("led.dat"), &json!(sha256(&file))));
    for missing in [
        "vendor/other.dat",
        "vendor",
        "../shared-not/led.dat",
        "vendor/../../shared-not/led.dat",
        "",
        "%2e%2e/shared-not/led.dat",
    ] {
        fetch(format!("{bucket}/{missing}")).await.is_problem(422, "ingest.missing");
    }
    for other in [format!("{bucket}-not/led.dat"), bucket.clone(), "s3://other/led.dat".into()] {
        fetch(other).await.is_problem(422, "ingest.bucket_refused");
    }
}
