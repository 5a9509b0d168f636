use axum::body::{Body, Bytes};
use axum::http::{Method, StatusCode};
use base64::Engine;
use base64::engine::general_purpose::STANDARD as BASE64;
use futures::stream;
use serde_json::{Value, json};
use service::Config;
use service::ray_sets::pace::Slowest;
use service::storage::parts::PART_BYTES;
use service::storage::records::statement::sql;
use sha2::{Digest, Sha256};
use std::convert::Infallible;
use std::io;
use support::rays;
use support::runners::{prompt, sha256};
use support::site::{Reply, Site};

/// Nothing of a refused upload may be left.
pub async fn nothing_left(site: &Site) {
    site.until_blobs(<[String]>::is_empty).await;
    assert!(site.rows(sql("SELECT id FROM ray_sets")).await.is_empty());
    assert!(site.rows(sql("SELECT blob FROM parts")).await.is_empty());
}

async fn send(site: &Site, headers: &[(&str, &str)], body: impl Into<Body>) -> Reply {
    site.ask(Method::POST, "/v1/ray-sets", headers, body).await
}

fn in_chunks(bytes: &[u8], size: usize) -> Body {
    let chunks: Vec<_> = bytes.chunks(size).map(|chunk| Ok::<_, Infallible>(Bytes::copy_from_slice(chunk))).collect();
    Body::from_stream(stream::iter(chunks))
}

#[tokio::test(flavor = "multi_thread")]
async fn chunks_of_any_size_make_the_same_ray_set() {
    let site = Site::start(prompt()).await;
    let file = rays::zemax(400_000);
    for size in [1 << 14, 65_537, PART_BYTES - 1, PART_BYTES, 1 << 30] {
        let reply = send(&site, &[], in_chunks(&file, size)).await;
        assert_eq!(reply.status, StatusCode::CREATED, "{size}: {reply:?}");
        assert_eq!(reply.ray_set()["sha256"], sha256(&file));
        assert_eq!(reply.ray_set()["byte_count"], file.len());
        assert_eq!(reply.ray_set()["name"], "rays");
    }
    assert_eq!(site.blobs().len(), 5 * file.len().div_ceil(PART_BYTES));
}

#[tokio::test(flavor = "multi_thread")]
async fn the_same_bytes_twice_are_two_ray_sets() {
    let site = Site::start(prompt()).await;
    assert_ne!(site.ray_set().await, site.ray_set().await);
    assert_eq!(site.rows(sql("SELECT id FROM ray_sets")).await.len(), 2);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_name_comes_from_the_query_or_the_header() {
    let site = Site::start(prompt()).await;
    let disposition = [("content-disposition", "attachment; filename=\"blue.dat\"")];
    let named = async |path: &str, headers: &[(&str, &str)]| {
        site.ask(Method::POST, path, headers, rays::zemax(3)).await.ray_set()["name"].as_str().unwrap().to_owned()
    };
    assert_eq!(named("/v1/ray-sets", &disposition).await, "blue.dat");
    assert_eq!(named("/v1/ray-sets?name=%C3%BC.dat", &disposition).await, "ü.dat");
    assert_eq!(named("/v1/ray-sets?name=../../x", &[]).await, "x");
    let long = format!("/v1/ray-sets?name={}", "x".repeat(256));
    site.ask(Method::POST, &long, &[], rays::zemax(3)).await.is_problem(422, "request.out_of_range");
    site.ask(Method::POST, "/v1/ray-sets?nam=x", &[], rays::zemax(3)).await.is_problem(422, "request.unknown_field");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_digest_is_verified_when_sent() {
    let site = Site::start(prompt()).await;
    let file = rays::zemax(20);
    let right = format!("sha-256=:{}:", BASE64.encode(Sha256::digest(&file)));
    let wrong = format!("sha-256=:{}:", BASE64.encode(Sha256::digest(b"other")));
    for name in ["repr-digest", "content-digest"] {
        send(&site, &[(name, &wrong)], file.clone()).await.is_problem(400, "upload.digest_mismatch");
        send(&site, &[(name, "sha-256=:x:")], file.clone()).await.is_problem(400, "request.malformed_header");
        nothing_left(&site).await;
    }
    let reply = send(&site, &[("repr-digest", &right), ("content-digest", &wrong)], file.clone()).await;
    reply.is_problem(400, "upload.digest_mismatch");
    nothing_left(&site).await;
    // RFC 9530, section 2: an algorithm that the recipient does not know is ignored, alone or among others.
    let unknown = format!("sha-512=:{}:", BASE64.encode([0; 64]));
    for name in ["repr-digest", "content-digest"] {
        assert_eq!(send(&site, &[(name, &unknown)], file.clone()).await.status, StatusCode::CREATED);
        let with_wrong = format!("{unknown}, {wrong}");
        send(&site, &[(name, &with_wrong)], file.clone()).await.is_problem(400, "upload.digest_mismatch");
    }
    for name in ["repr-digest", "content-digest"] {
        assert_eq!(send(&site, &[(name, &right)], file.clone()).await.status, StatusCode::CREATED);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn too_large_is_said_before_the_body_is_read() {
    let site = Site::start_as(|config| Config { max_upload_bytes: 1000, ..config }, prompt()).await;
    // A body that may not be touched.
    let untouchable = || {
        Body::from_stream(stream::poll_fn(|_| -> std::task::Poll<Option<io::Result<Bytes>>> {
            panic!("the body was read")
        }))
    };
    send(&site, &[("content-length", "1001")], untouchable()).await.is_problem(413, "upload.too_large");
    send(&site, &[("content-length", "many")], untouchable()).await.is_problem(400, "request.malformed_header");
    for media_type in ["multipart/form-data; boundary=x", "application/x-www-form-urlencoded"] {
        send(&site, &[("content-type", media_type)], untouchable()).await.is_problem(415, "request.media_type");
    }
    send(&site, &[("content-encoding", "gzip")], untouchable()).await.is_problem(415, "request.media_type");
    // Without a length, as soon as it is too much.
    send(&site, &[], in_chunks(&rays::zemax(40), 100)).await.is_problem(413, "upload.too_large");
    nothing_left(&site).await;
    assert_eq!(send(&site, &[], in_chunks(&rays::zemax(28), 100)).await.status, StatusCode::CREATED);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_truncated_body_leaves_nothing() {
    let site = Site::start(prompt()).await;
    // More than one part, so that something has been stored when it breaks.
    let file = rays::zemax(400_000);
    let broken = || {
        let chunks = [Ok(Bytes::copy_from_slice(&file[..9 << 20])), Err(io::Error::other("connection reset"))];
        Body::from_stream(stream::iter(chunks))
    };
    send(&site, &[], broken()).await.is_problem(400, "upload.truncated");
    nothing_left(&site).await;
    let length = file.len().to_string();
    let short = in_chunks(&file[..9 << 20], 1 << 20);
    send(&site, &[("content-length", &length)], short).await.is_problem(400, "upload.truncated");
    nothing_left(&site).await;
    send(&site, &[], Body::empty()).await.is_problem(400, "upload.empty");
    nothing_left(&site).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_silent_sender_is_given_up() {
    let site = Site::start(prompt()).await;
    let start = Bytes::copy_from_slice(&rays::zemax(1000)[..20_000]);
    let body = stream::unfold(Some(start), |next| async {
        match next {
            Some(bytes) => Some((Ok::<_, Infallible>(bytes), None)),
            None => futures::future::pending().await,
        }
    });
    send(&site, &[], Body::from_stream(body)).await.is_problem(408, "upload.idle");
    nothing_left(&site).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_client_that_goes_away_leaves_nothing() {
    // So that it is gone before it is too slow.
    let slowest = Slowest { interval: std::time::Duration::from_secs(60), bytes: 1 };
    let site = Site::start_as(|config| Config { slowest, ..config }, prompt()).await;
    let file = Bytes::from(rays::zemax(400_000));
    let (sender, receiver) = tokio::sync::mpsc::channel::<io::Result<Bytes>>(1);
    let body = Body::from_stream(stream::unfold(receiver, |mut receiver| async {
        receiver.recv().await.map(|chunk| (chunk, receiver))
    }));
    let length = file.len().to_string();
    let headers = [("content-length", length.as_str())];
    let upload = send(&site, &headers, body);
    let client = async {
        sender.send(Ok(file.slice(..9 << 20))).await.unwrap();
        while site.blobs().is_empty() {
            tokio::time::sleep(std::time::Duration::from_millis(5)).await;
        }
    };
    tokio::select! {
        _ = upload => panic!("answered without the rest"),
        () = client => {}
    }
    drop(sender);
    nothing_left(&site).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn what_is_no_ray_file_is_refused_at_its_beginning() {
    let site = Site::start(prompt()).await;
    // Refused after the first 64 KiB: the rest is never asked for.
    let mut chunks = 0;
    let endless = stream::poll_fn(move |_| {
        chunks += 1;
        assert!(chunks <= 3, "read on after what cannot be a ray file");
        std::task::Poll::Ready(Some(Ok::<_, Infallible>(Bytes::from(vec![0x55; 40_000]))))
    });
    let reply = send(&site, &[], Body::from_stream(endless)).await;
    assert!(reply.status == 400 || reply.status == 422, "{reply:?}");
    assert!(reply.json()["remedy"].is_string(), "{}", reply.json());
    nothing_left(&site).await;

    // A count that its length disproves: with a length at the beginning, without at the end.
    let mut liar = rays::zemax(100_000);
    liar[4..8].copy_from_slice(&100_001_u32.to_le_bytes());
    let length = liar.len().to_string();
    for headers in [&[("content-length", length.as_str())][..], &[]] {
        let reply = send(&site, headers, in_chunks(&liar, 1 << 16)).await;
        assert!(reply.status == 400 || reply.status == 422, "{reply:?}");
        nothing_left(&site).await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_ray_set_above_the_limits_is_refused_by_policy() {
    let few = |config: Config| Config { limits: pipeline::Limits { max_rays: 99, ..config.limits }, ..config };
    let site = Site::start_as(few, prompt()).await;
    send(&site, &[], rays::zemax(100)).await.is_problem(422, "rays.too_many");
    nothing_left(&site).await;
    assert_eq!(send(&site, &[], rays::zemax(99)).await.status, StatusCode::CREATED);
}

#[tokio::test(flavor = "multi_thread")]
async fn parts_stay_until_the_next_start_when_the_database_fails_as_it_takes_their_row() {
    if support::engines::are_shared() {
        return;
    }
    let mut site = Site::start(prompt()).await;
    let known = site.ray_set().await;
    let fail = "CREATE TRIGGER fail BEFORE INSERT ON parts BEGIN SELECT RAISE(ABORT, 'disk I/O error'); END";
    site.write(sql(fail)).await;
    site.upload(rays::zemax(10)).await.is_problem(503, "storage.unavailable");
    // For all that the service knows, the row may be there.
    assert_eq!(site.blobs().len(), 2);
    site.kill().await;
    site.restart(prompt()).await;
    assert_eq!(site.blobs(), [format!("ray-sets/{known}/000000")]);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_list_leaves_out_what_may_be_long() {
    let site = Site::start(prompt()).await;
    let id = site.ray_set().await;
    let mut one = site.get(&format!("/v1/ray-sets/{id}")).await.json();
    let texts = one["header"].as_object_mut().unwrap().remove("texts").unwrap();
    assert!(texts.as_array().is_some_and(|texts| !texts.is_empty()), "{texts}");
    assert!(one["inspection"].is_object() && one["links"]["origins"].is_string(), "{one}");
    one["inspection"] = Value::Null;
    one["links"] = json!({"self": one["links"]["self"], "origins": null, "far_field": null});
    let list = site.get("/v1/ray-sets").await.json();
    assert_eq!(list["ray_sets"][0], one);
}
