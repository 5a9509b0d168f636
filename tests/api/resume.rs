//! tus 1.0.0, as a client sees it: expected statuses and headers are those of its text.

use crate::uploads::nothing_left;
use axum::body::{Body, Bytes};
use axum::http::{Method, StatusCode};
use base64::Engine;
use base64::engine::general_purpose::STANDARD as BASE64;
use futures::stream;
use serde_json::{Value, json};
use service::Config;
use service::accounts::quota::Quota;
use service::storage::records::statement::sql;
use sha2::{Digest, Sha256};
use std::io;
use support::rays;
use support::runners::{prompt, sha256};
use support::site::{Reply, Site};

pub const VERSION: (&str, &str) = ("tus-resumable", "1.0.0");
pub const OCTETS: (&str, &str) = ("content-type", "application/offset+octet-stream");

/// `Upload-Metadata` of these.
pub fn metadata(pairs: &[(&str, &str)]) -> String {
    let pairs: Vec<String> = pairs.iter().map(|(key, value)| format!("{key} {}", BASE64.encode(value))).collect();
    pairs.join(",")
}

/// Begins an upload of so many bytes; where it is.
pub async fn begin(site: &Site, length: usize, more: &[(&str, &str)]) -> String {
    let length = length.to_string();
    let headers = [&[VERSION, ("upload-length", length.as_str())], more].concat();
    let begun = site.ask(Method::POST, "/v1/uploads", &headers, Body::empty()).await;
    assert_eq!((begun.status, begun.header("tus-resumable")), (StatusCode::CREATED, "1.0.0"), "{begun:?}");
    begun.header("location").to_owned()
}

/// Adds bytes at an offset.
pub async fn append(site: &Site, at: &str, offset: usize, bytes: impl Into<Body>, more: &[(&str, &str)]) -> Reply {
    let offset = offset.to_string();
    let headers = [&[VERSION, OCTETS, ("upload-offset", offset.as_str())], more].concat();
    site.ask(Method::PATCH, at, &headers, bytes).await
}

/// Where an upload goes on, if it does.
pub async fn offset(site: &Site, at: &str) -> usize {
    let head = site.ask(Method::HEAD, at, &[VERSION], Body::empty()).await;
    assert_eq!((head.status, head.header("cache-control")), (StatusCode::OK, "no-store"), "{head:?}");
    head.header("upload-offset").parse().unwrap()
}

/// What became of an upload of which all bytes came: the last request waits for that, but no longer than 10 s.
pub async fn ended(site: &Site, at: &str) -> Value {
    let start = std::time::Instant::now();
    loop {
        let upload = site.get(at).await.json();
        if upload["state"] != "finishing" {
            return upload;
        }
        assert!(start.elapsed() < support::site::PATIENCE, "still {upload}");
        tokio::time::sleep(std::time::Duration::from_millis(10)).await;
    }
}

/// Sends a whole file in pieces; its address, when it is known what became of it.
pub async fn send(site: &Site, file: &[u8], size: usize, more: &[(&str, &str)]) -> String {
    let at = begin(site, file.len(), more).await;
    let mut sent = 0;
    for piece in file.chunks(size) {
        let reply = append(site, &at, sent, piece.to_vec(), &[]).await;
        sent += piece.len();
        assert_eq!((reply.status, reply.header("upload-offset")), (StatusCode::NO_CONTENT, &*sent.to_string()));
    }
    ended(site, &at).await;
    at
}

/// A body that breaks off after these bytes.
fn broken(bytes: &[u8]) -> Body {
    let chunks = [Ok(Bytes::copy_from_slice(bytes)), Err(io::Error::other("connection reset"))];
    Body::from_stream(stream::iter(chunks))
}

async fn part_lengths(site: &Site) -> Vec<u64> {
    let rows = site.rows(sql("SELECT byte_count FROM upload_parts ORDER BY number")).await;
    rows.iter().map(|row| row.count("byte_count").unwrap()).collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_file_in_pieces_is_the_ray_set_that_it_is_in_one() {
    let site = Site::start(prompt()).await;
    let file = rays::zemax(400_000);
    let said = metadata(&[("filename", "in pieces.dat"), ("length_unit", "mm"), ("quantity", "radiant")]);
    let length = file.len();
    for size in [length, 9 << 20, (8 << 20) + 1, 3_000_001] {
        let at = send(&site, &file, size, &[("upload-metadata", &said)]).await;
        let upload = site.get(&at).await.json();
        assert_eq!(
            (&upload["state"], &upload["offset"], &upload["length"]),
            (&json!("taken"), &json!(length), &json!(length))
        );
        let id = at.rsplit('/').next().unwrap();
        assert_eq!((&upload["ray_sets"], &upload["problem"]), (&json!([id]), &Value::Null), "{upload}");
        let ray_set = site.get(upload["links"]["ray_sets"][0].as_str().unwrap()).await.json();
        assert_eq!((&ray_set["sha256"], &ray_set["byte_count"]), (&json!(sha256(&file)), &json!(length)));
        assert_eq!((&ray_set["name"], &ray_set["packed"]), (&json!("in pieces.dat"), &Value::Null));
        assert_eq!(ray_set["declared"], json!({"length_unit": "mm", "quantity": "radiant"}));
        // Its parts are the upload's: nothing was copied, nothing is left.
        assert_eq!(part_lengths(&site).await, [0; 0]);
        let job = site.job(id).await;
        site.until_state(&job, "succeeded").await;
        let read = site.get(&format!("/v1/jobs/{job}/artifacts/read.txt")).await;
        let digest = sha256(&file);
        assert_eq!(String::from_utf8(read.body).unwrap(), format!("in pieces.dat {digest} {digest}\n"));
        site.delete(&format!("/v1/jobs/{job}")).await;
        site.delete(&format!("/v1/ray-sets/{id}")).await;
        assert_eq!(site.blobs(), [""; 0], "{size}");
        // What became of it is told until its time is over.
        assert_eq!(offset(&site, &at).await, length);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn small_pieces_do_not_leave_small_parts() {
    let site = Site::start(prompt()).await;
    let file = rays::zemax(100_000);
    let at = begin(&site, file.len(), &[]).await;
    let mut sent = 0;
    for piece in file.chunks(150_000).take(18) {
        append(&site, &at, sent, piece.to_vec(), &[]).await;
        sent += piece.len();
    }
    // Seven pieces make a megabyte, and then the next part begins.
    assert_eq!(part_lengths(&site).await, [1_050_000, 1_050_000, 600_000]);
    assert_eq!(site.blobs().len(), 3);
    assert_eq!(append(&site, &at, sent, file[sent..].to_vec(), &[]).await.status, StatusCode::NO_CONTENT);
    ended(&site, &at).await;
    let id = at.rsplit('/').next().unwrap();
    assert_eq!(site.get(&format!("/v1/ray-sets/{id}")).await.json()["sha256"], sha256(&file));
    assert_eq!(site.blobs().len(), 3);
}

#[tokio::test(flavor = "multi_thread")]
async fn what_came_of_a_body_that_broke_off_is_kept() {
    let site = Site::start(prompt()).await;
    let file = rays::zemax(400_000);
    let at = begin(&site, file.len(), &[]).await;
    append(&site, &at, 0, broken(&file[..9_000_000]), &[]).await.is_problem(400, "upload.truncated");
    assert_eq!(offset(&site, &at).await, 9_000_000);
    // Nothing at all, too.
    append(&site, &at, 9_000_000, broken(&[]), &[]).await.is_problem(400, "upload.truncated");
    // And of one that falls silent.
    let silent = stream::iter([Ok::<_, io::Error>(Bytes::copy_from_slice(&file[9_000_000..9_000_001]))]);
    let silent = Body::from_stream(futures::StreamExt::chain(silent, stream::pending()));
    append(&site, &at, 9_000_000, silent, &[]).await.is_problem(408, "upload.idle");
    assert_eq!(offset(&site, &at).await, 9_000_001);
    let reply = append(&site, &at, 9_000_001, file[9_000_001..].to_vec(), &[]).await;
    assert_eq!(reply.status, StatusCode::NO_CONTENT, "{reply:?}");
    let upload = site.get(&at).await.json();
    let ray_set = site.get(upload["links"]["ray_sets"][0].as_str().unwrap()).await.json();
    assert_eq!(ray_set["sha256"], sha256(&file));
}

#[tokio::test(flavor = "multi_thread")]
async fn bytes_go_where_the_upload_ends_and_once() {
    let site = Site::start(prompt()).await;
    let file = rays::zemax(50_000);
    let at = begin(&site, file.len(), &[]).await;
    append(&site, &at, 0, file[..70_000].to_vec(), &[]).await;
    for wrong in [0, 69_999, 70_001, file.len()] {
        append(&site, &at, wrong, file[..10].to_vec(), &[]).await.is_problem(409, "upload.offset_conflict");
    }
    assert_eq!(offset(&site, &at).await, 70_000);
    let many =
        futures::future::join_all((0..6).map(|_| append(&site, &at, 70_000, file[70_000..].to_vec(), &[]))).await;
    let done = many.iter().filter(|reply| reply.status == StatusCode::NO_CONTENT).count();
    let refused = many.iter().filter(|reply| reply.status == StatusCode::CONFLICT).count();
    assert_eq!((done, refused), (1, 5), "{many:?}");
    append(&site, &at, file.len(), file[..9].to_vec(), &[]).await.is_problem(409, "upload.complete");
    // Who lost the last answer adds nothing, and is told that all is there.
    let nothing = append(&site, &at, file.len(), Vec::new(), &[("content-length", "0")]).await;
    assert_eq!((nothing.status, nothing.header("upload-offset")), (StatusCode::NO_CONTENT, &*file.len().to_string()));
    let id = at.rsplit('/').next().unwrap();
    let ray_set = site.get(&format!("/v1/ray-sets/{id}")).await.json();
    assert_eq!((&ray_set["sha256"], &ray_set["byte_count"]), (&json!(sha256(&file)), &json!(file.len())));
    let parts = site.rows(sql("SELECT blob FROM parts")).await.len();
    site.until_blobs(|blobs| blobs.len() == parts).await;
    // More than was announced is not read, where its length is said, and not kept, where it is not.
    let at = begin(&site, 100_000, &[]).await;
    let length = [("content-length", "100001")];
    append(&site, &at, 0, Body::from_stream(stream::pending::<io::Result<Bytes>>()), &length)
        .await
        .is_problem(413, "upload.beyond_length");
    append(&site, &at, 0, file[..100_001].to_vec(), &[]).await.is_problem(413, "upload.beyond_length");
    assert_eq!(offset(&site, &at).await, 0);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_method_may_be_said_in_a_header() {
    let site = Site::start(prompt()).await;
    let file = rays::zemax(1000);
    let at = begin(&site, file.len(), &[]).await;
    let ask = async |method: Method, meant: &str, body: &[u8]| {
        let headers = [VERSION, OCTETS, ("upload-offset", "0"), ("x-http-method-override", meant)];
        site.ask(method, &at, &headers, body.to_vec()).await
    };
    let added = ask(Method::POST, "PATCH", &file[..1000]).await;
    assert_eq!((added.status, added.header("upload-offset")), (StatusCode::NO_CONTENT, "1000"));
    // "The actual method of the request MUST be ignored."
    let head = ask(Method::DELETE, "HEAD", &[]).await;
    assert_eq!((head.status, head.header("upload-offset")), (StatusCode::OK, "1000"));
    ask(Method::PATCH, "SING", &[]).await.is_problem(405, "request.method_not_allowed");
    ask(Method::POST, "two words", &[]).await.is_problem(400, "request.malformed_header");
    assert_eq!(ask(Method::POST, "DELETE", &[]).await.status, StatusCode::NO_CONTENT);
    site.get(&at).await.is_problem(404, "upload.not_found");
    // It is tus' and nobody else's.
    let elsewhere = site.ask(Method::POST, "/v1/ray-sets", &[("x-http-method-override", "GET")], file).await;
    elsewhere.is_problem(400, "request.header_not_honoured");
}

#[tokio::test(flavor = "multi_thread")]
async fn bytes_that_are_not_what_their_checksum_says_are_not_kept() {
    let site = Site::start(prompt()).await;
    let file = rays::zemax(400_000);
    let at = begin(&site, file.len(), &[]).await;
    // FIPS 180-2: SHA-1 and SHA-256 of "abc".
    let abc = ["sha1 qZk+NkcGgWq6PiVxeFDCbJzQ2J0=", "sha256 ungWv48Bz+pBQUDeXa4iI7ADYaOWF3qctBD/YfIAFa0="];
    for wrong in abc {
        append(&site, &at, 0, file[..9_000_000].to_vec(), &[("upload-checksum", wrong)])
            .await
            .is_problem(460, "upload.checksum_mismatch");
        site.until_blobs(<[String]>::is_empty).await;
        assert_eq!(offset(&site, &at).await, 0);
    }
    for unknown in ["md5 kAFQmDzST7DWlj99KOF/cg==", "sha1", "sha1 ?"] {
        append(&site, &at, 0, file[..9].to_vec(), &[("upload-checksum", unknown)])
            .await
            .is_problem(400, "request.malformed_header");
    }
    let right = |bytes: &[u8]| format!("sha256 {}", BASE64.encode(Sha256::digest(bytes)));
    let checked = right(&file[..9_000_000]);
    // Of what breaks off nobody knows whether it came as sent.
    append(&site, &at, 0, broken(&file[..8_500_000]), &[("upload-checksum", &checked)])
        .await
        .is_problem(400, "upload.truncated");
    site.until_blobs(<[String]>::is_empty).await;
    assert_eq!(offset(&site, &at).await, 0);
    // A wrong beginning may have become so on its way.
    let noise = append(&site, &at, 0, vec![0x55; 100_000], &[("upload-checksum", &checked)]).await;
    noise.is_problem(400, "detect.not_rays");
    assert_eq!((offset(&site, &at).await, &site.get(&at).await.json()["state"]), (0, &json!("receiving")));
    let reply = append(&site, &at, 0, file[..9_000_000].to_vec(), &[("upload-checksum", &checked)]).await;
    assert_eq!(reply.header("upload-offset"), "9000000");
    let rest = right(&file[9_000_000..]);
    append(&site, &at, 9_000_000, file[9_000_000..].to_vec(), &[("upload-checksum", &rest)]).await;
    assert_eq!(ended(&site, &at).await["state"], "taken");
}

#[tokio::test(flavor = "multi_thread")]
async fn the_first_bytes_may_come_along_and_the_length_later() {
    let site = Site::start(prompt()).await;
    let file = rays::zemax(20);
    let length = file.len().to_string();
    let whole = [VERSION, OCTETS, ("upload-length", length.as_str())];
    let begun = site.ask(Method::POST, "/v1/uploads", &whole, file.clone()).await;
    assert_eq!((begun.status, begun.header("upload-offset")), (StatusCode::CREATED, &*length));
    assert_eq!(ended(&site, begun.header("location")).await["state"], "taken");
    // Part of it is not the whole: only what is said of the whole is held against it.
    let part = format!("sha-256=:{}:", BASE64.encode(Sha256::digest(&file[..99])));
    let first = [&whole[..], &[("content-digest", &part)]].concat();
    let begun = site.ask(Method::POST, "/v1/uploads", &first, file[..99].to_vec()).await;
    append(&site, begun.header("location"), 99, file[99..].to_vec(), &[]).await;
    assert_eq!(ended(&site, begun.header("location")).await["state"], "taken");
    site.delete(begun.header("location")).await;
    // What fails was never begun: its sender could not know of it.
    let wrong = [("upload-checksum", "sha1 qZk+NkcGgWq6PiVxeFDCbJzQ2J0=")];
    let refused = site.ask(Method::POST, "/v1/uploads", &[&whole[..], &wrong].concat(), file.clone()).await;
    refused.is_problem(460, "upload.checksum_mismatch");
    let noise = site.ask(Method::POST, "/v1/uploads", &whole, vec![0x55; file.len()]).await;
    assert!(noise.status == 400 || noise.status == 422, "{noise:?}");
    assert_eq!(site.get("/v1/uploads").await.json()["uploads"].as_array().unwrap().len(), 1);

    let defer = [VERSION, ("upload-defer-length", "1")];
    for last in [file.len() - 7, file.len()] {
        let begun = site.ask(Method::POST, "/v1/uploads", &defer, Body::empty()).await;
        let at = begun.header("location").to_owned();
        append(&site, &at, 0, file[..last].to_vec(), &[]).await;
        let head = site.ask(Method::HEAD, &at, &[VERSION], Body::empty()).await;
        assert_eq!((head.header("upload-defer-length"), head.headers.get("upload-length")), ("1", None));
        let short = (last - 1).to_string();
        append(&site, &at, last, Vec::new(), &[("upload-length", &short)]).await.is_problem(400, "upload.length");
        let rest = file[last..].to_vec();
        let size = rest.len().to_string();
        let said = [("upload-length", length.as_str()), ("content-length", size.as_str())];
        let reply = append(&site, &at, last, rest, &said).await;
        assert_eq!((reply.status, reply.header("upload-offset")), (StatusCode::NO_CONTENT, &*length), "{reply:?}");
        let head = site.ask(Method::HEAD, &at, &[VERSION], Body::empty()).await;
        assert_eq!((head.header("upload-length"), head.headers.get("upload-defer-length")), (&*length, None));
        assert_eq!(ended(&site, &at).await["state"], "taken");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn the_protocol_is_told_and_asked_for() {
    let site = Site::start_as(|config| Config { max_upload_bytes: 1000, ..config }, prompt()).await;
    for path in ["/v1/uploads", "/v1/uploads/x"] {
        let told = site.ask(Method::OPTIONS, path, &[], Body::empty()).await;
        assert_eq!((told.status, told.header("tus-version")), (StatusCode::NO_CONTENT, "1.0.0"));
        assert_eq!((told.header("tus-resumable"), told.header("tus-max-size")), ("1.0.0", "1000"));
        assert_eq!(told.header("tus-checksum-algorithm"), "sha1,sha256");
        let extensions =
            "creation,creation-with-upload,creation-defer-length,termination,checksum,expiration,concatenation";
        assert_eq!(told.header("tus-extension"), extensions);
    }
    for version in [&[][..], &[("tus-resumable", "0.2.2")]] {
        let headers = [version, &[("upload-length", "9")]].concat();
        let reply = site.ask(Method::POST, "/v1/uploads", &headers, Body::empty()).await;
        reply.is_problem(412, "tus.version");
        assert_eq!((reply.header("tus-version"), reply.header("tus-resumable")), ("1.0.0", "1.0.0"));
    }
    let create = async |headers: &[(&str, &str)]| {
        site.ask(Method::POST, "/v1/uploads", &[&[VERSION], headers].concat(), Body::empty()).await
    };
    create(&[]).await.is_problem(400, "request.malformed_header");
    create(&[("upload-length", "x")]).await.is_problem(400, "request.malformed_header");
    create(&[("upload-length", "0")]).await.is_problem(400, "upload.empty");
    create(&[("upload-length", "1001")]).await.is_problem(413, "upload.too_large");
    create(&[("upload-length", "9"), ("upload-metadata", "filename ?")])
        .await
        .is_problem(400, "request.malformed_header");
    let unknown = metadata(&[("length_unit", "furlong")]);
    create(&[("upload-length", "9"), ("upload-metadata", &unknown)]).await.is_problem(422, "request.wrong_type");
    let unknown = metadata(&[("columns", "x,y,shoe")]);
    create(&[("upload-length", "9"), ("upload-metadata", &unknown)]).await.is_problem(422, "rays.column_unknown");
    assert_eq!(site.get("/v1/uploads").await.json(), json!({"uploads": [], "next": null}));

    let said = metadata(&[("filename", "a.dat"), ("mine", "kept")]);
    let at = begin(&site, 1000, &[("upload-metadata", &said)]).await;
    let head = site.ask(Method::HEAD, &at, &[VERSION], Body::empty()).await;
    assert_eq!((head.header("upload-metadata"), head.header("upload-length")), (&*said, "1000"));
    assert!(head.header("upload-expires").ends_with(" GMT"));
    let patch = async |headers: &[(&str, &str)]| {
        site.ask(Method::PATCH, &at, &[&[VERSION], headers].concat(), vec![0; 10]).await
    };
    patch(&[("upload-offset", "0")]).await.is_problem(415, "request.media_type");
    patch(&[("upload-offset", "0"), ("content-type", "text/plain")]).await.is_problem(415, "request.media_type");
    patch(&[OCTETS]).await.is_problem(400, "request.malformed_header");
    patch(&[OCTETS, ("upload-offset", "-1")]).await.is_problem(400, "request.malformed_header");
    append(&site, "/v1/uploads/x", 0, vec![0; 10], &[]).await.is_problem(404, "upload.not_found");
    site.get("/v1/uploads/x").await.is_problem(404, "upload.not_found");
    let head = site.ask(Method::HEAD, "/v1/uploads/x", &[VERSION], Body::empty()).await;
    assert_eq!((head.status, head.headers.get("upload-offset")), (StatusCode::NOT_FOUND, None));
    site.delete("/v1/uploads/x").await.is_problem(404, "upload.not_found");
    assert_eq!(offset(&site, &at).await, 0);
}

#[tokio::test(flavor = "multi_thread")]
async fn pages_of_other_origins_may_speak_it() {
    let origin = ("origin", "https://portal.example");
    let known = |config| Config { cors_origins: vec![origin.1.into()], ..config };
    let site = Site::start_as(known, prompt()).await;
    let asked = "tus-resumable,upload-offset,content-type";
    let first = [origin, ("access-control-request-method", "PATCH"), ("access-control-request-headers", asked)];
    let allowed = site.ask(Method::OPTIONS, "/v1/uploads/x", &first, Body::empty()).await;
    assert!(allowed.header("access-control-allow-methods").contains("PATCH"));
    assert_eq!(allowed.header("access-control-allow-headers"), asked);
    let at = begin(&site, 1000, &[origin]).await;
    let head = site.ask(Method::HEAD, &at, &[VERSION, origin], Body::empty()).await;
    let seen = head.header("access-control-expose-headers").to_owned();
    for name in ["location", "upload-offset", "upload-length", "tus-resumable", "upload-expires"] {
        assert!(seen.contains(name), "{name}: {seen}");
    }
    // Whoever asks without a page is told what there is, all the same.
    let told = site.ask(Method::OPTIONS, "/v1/uploads", &[], Body::empty()).await;
    assert_eq!(told.header("tus-version"), "1.0.0");
}

#[tokio::test(flavor = "multi_thread")]
async fn an_upload_has_its_room_from_its_beginning() {
    let file = rays::zemax(100);
    let size = file.len() as u64;
    let quota = Quota { stored_bytes: 2 * size + size / 2, ..Quota::default() };
    let site = Site::start_as(|config| Config { quota, ..config }, prompt()).await;
    let at = [begin(&site, file.len(), &[]).await, begin(&site, file.len(), &[]).await];
    let length = size.to_string();
    let announced = [VERSION, ("upload-length", length.as_str())];
    let third = site.ask(Method::POST, "/v1/uploads", &announced, Body::empty()).await;
    third.is_problem(413, "quota.stored_bytes");
    site.upload(file.clone()).await.is_problem(413, "quota.stored_bytes");
    // Once taken, it counts once.
    append(&site, &at[0], 0, file.clone(), &[]).await;
    assert_eq!(ended(&site, &at[0]).await["state"], "taken");
    site.upload(file.clone()).await.is_problem(413, "quota.stored_bytes");
    // Where the length is left open, what is there counts.
    assert_eq!(site.delete(&at[1]).await.status, StatusCode::NO_CONTENT);
    let begun = site.ask(Method::POST, "/v1/uploads", &[VERSION, ("upload-defer-length", "1")], Body::empty()).await;
    let open = begun.header("location").to_owned();
    append(&site, &open, 0, file.clone(), &[]).await;
    append(&site, &open, file.len(), file.clone(), &[]).await.is_problem(413, "quota.stored_bytes");
    assert_eq!((offset(&site, &open).await, site.blobs().len()), (file.len(), 2));
    let more = (3 * size).to_string();
    append(&site, &open, file.len(), Vec::new(), &[("upload-length", &more)])
        .await
        .is_problem(413, "quota.stored_bytes");
    site.delete(&open).await;
    assert_eq!(site.upload(file).await.status, StatusCode::CREATED);
}

#[tokio::test(flavor = "multi_thread")]
async fn with_little_room_left_no_upload_is_begun_or_gone_on_with() {
    let mut site = Site::start(prompt()).await;
    if site.config.local_folders().is_empty() {
        println!("LEFT OUT: no local disk");
        return;
    }
    let at = begin(&site, 1000, &[]).await;
    site.kill().await;
    (site.config.keep_free, site.config.max_upload_bytes) = (1, u64::MAX >> 1);
    site.restart(prompt()).await;
    let exabyte = [VERSION, ("upload-length", "1000000000000000000")];
    site.ask(Method::POST, "/v1/uploads", &exabyte, Body::empty()).await.is_problem(507, "storage.low_space");
    site.kill().await;
    site.config.keep_free = u64::MAX;
    site.restart(prompt()).await;
    let reply = site.ask(Method::POST, "/v1/uploads", &[VERSION, ("upload-length", "9")], Body::empty()).await;
    reply.is_problem(507, "storage.low_space");
    append(&site, &at, 0, vec![0; 10], &[]).await.is_problem(507, "storage.low_space");
    assert_eq!(site.delete(&at).await.status, StatusCode::NO_CONTENT);
    nothing_left(&site).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_tenant_cannot_begin_uploads_without_end() {
    let site = Site::start(prompt()).await;
    let at = begin(&site, 1000, &[]).await;
    let copy = "INSERT INTO uploads (id, tenant, state, name, metadata, declared, announced, byte_count, offset_bytes, \
                sha256_state, fence, attempt, created_ms, expires_ms) \
                SELECT $1, tenant, state, name, metadata, declared, announced, byte_count, offset_bytes, \
                sha256_state, fence, attempt, created_ms, expires_ms FROM uploads WHERE id = $2";
    let records = service::storage::records::Records::open(&site.config.database_url()).await.unwrap();
    for number in 1..1000 {
        let copy = sql(copy).bind(format!("0190b5a0-0000-7000-8000-{number:012}")).bind(at.rsplit('/').next().unwrap());
        records.write(copy).await.unwrap();
    }
    let reply = site.ask(Method::POST, "/v1/uploads", &[VERSION, ("upload-length", "9")], Body::empty()).await;
    reply.is_problem(429, "quota.unfinished_uploads");
    assert_eq!(site.delete(&at).await.status, StatusCode::NO_CONTENT);
    begin(&site, 9, &[]).await;
    let page = site.get("/v1/uploads?limit=3").await.json();
    assert_eq!(page["uploads"].as_array().unwrap().len(), 3);
    let next = format!("/v1/uploads?limit=100&after={}", page["next"].as_str().unwrap());
    assert_eq!(site.get(&next).await.json()["uploads"].as_array().unwrap().len(), 100);
}
