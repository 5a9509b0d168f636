//! Files that come in several uploads at once: expected statuses and headers are those of the chapter "Concatenation" of tus 1.0.0.

use crate::resume::{OCTETS, VERSION, append, begin, metadata, offset};
use crate::uploads::nothing_left;
use axum::body::Body;
use axum::http::{Method, StatusCode};
use futures::future::join_all;
use serde_json::{Value, json};
use service::Config;
use service::accounts::access::Scope;
use service::accounts::quota::Quota;
use service::storage::records::statement::sql;
use std::time::{Duration, Instant};
use support::packing::zip;
use support::rays;
use support::runners::{prompt, sha256};
use support::site::{Reply, Site};

const PARTIAL: (&str, &str) = ("upload-concat", "partial");

/// Sends a piece of a file, all of it; where it is.
async fn piece(site: &Site, bytes: &[u8]) -> String {
    let at = begin(site, bytes.len(), &[PARTIAL]).await;
    // tus-js-client says so with every request.
    let sent = append(site, &at, 0, bytes.to_vec(), &[PARTIAL]).await;
    assert_eq!((sent.status, sent.header("upload-concat")), (StatusCode::NO_CONTENT, "partial"), "{sent:?}");
    at
}

/// Asks for the upload that these pieces are.
async fn join(site: &Site, pieces: &[&str], more: &[(&str, &str)]) -> Reply {
    let concat = format!("final;{}", pieces.join(" "));
    let headers = [&[VERSION, ("upload-concat", concat.as_str())], more].concat();
    site.ask(Method::POST, "/v1/uploads", &headers, Body::empty()).await
}

async fn head(site: &Site, at: &str) -> Reply {
    site.ask(Method::HEAD, at, &[VERSION], Body::empty()).await
}

fn id(at: &str) -> &str {
    at.rsplit('/').next().unwrap()
}

/// The one ray set there is.
async fn only_ray_set(site: &Site) -> Value {
    let list = site.get("/v1/ray-sets").await.json();
    let [only] = list["ray_sets"].as_array().unwrap().as_slice() else { panic!("{list}") };
    only.clone()
}

/// Every blob is named by a row, and every row's blob is there; soon: rows go before their blobs.
async fn nothing_lies_about(site: &Site) {
    let begun = Instant::now();
    while site.blobs() != named(site).await {
        assert!(begun.elapsed() < Duration::from_secs(20), "{:?}, not {:?}", site.blobs(), named(site).await);
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
}

/// Every blob that a row names, once, in order.
async fn named(site: &Site) -> Vec<String> {
    let named = site.rows(sql("SELECT blob FROM parts UNION SELECT blob FROM upload_parts")).await;
    let mut named: Vec<String> = named.iter().map(|row| row.text("blob").unwrap()).collect();
    named.sort();
    named
}

#[tokio::test(flavor = "multi_thread")]
async fn pieces_sent_side_by_side_are_one_ray_set() {
    let site = Site::start(prompt()).await;
    let file = rays::zemax(400_000);
    let cuts = [0, 3_700_000, 3_700_001, file.len()];
    let pieces: Vec<&[u8]> = cuts.windows(2).map(|cut| &file[cut[0]..cut[1]]).collect();
    let at = join_all(pieces.iter().map(|bytes| piece(&site, bytes))).await;
    // Nothing is made of a piece.
    assert_eq!(site.get("/v1/ray-sets").await.json()["ray_sets"], json!([]));
    let told = site.get(&at[1]).await.json();
    assert_eq!(
        (&told["state"], &told["concat"], &told["part_of"]),
        (&json!("complete"), &json!("partial"), &Value::Null)
    );
    let waiting = head(&site, &at[1]).await;
    let said = ["upload-offset", "upload-length", "upload-concat"].map(|name| waiting.header(name).to_owned());
    assert_eq!((waiting.status, said), (StatusCode::OK, ["1", "1", "partial"].map(str::to_owned)));

    let list = [at[0].as_str(), at[1].as_str(), at[2].as_str()];
    let said = metadata(&[("filename", "in pieces.dat"), ("length_unit", "mm")]);
    let made = join(&site, &list, &[("upload-metadata", &said)]).await;
    assert_eq!(
        (made.status, made.header("upload-offset")),
        (StatusCode::CREATED, &*file.len().to_string()),
        "{made:?}"
    );
    let concat = format!("final;{}", list.join(" "));
    assert_eq!(made.header("upload-concat"), concat);
    let whole = made.header("location").to_owned();
    let upload = site.get(&whole).await.json();
    assert_eq!(
        (&upload["state"], &upload["concat"], &upload["length"]),
        (&json!("taken"), &json!(concat), &json!(file.len()))
    );
    assert_eq!(upload["ray_sets"], json!([id(&whole)]));
    let ray_set = only_ray_set(&site).await;
    assert_eq!((&ray_set["sha256"], &ray_set["byte_count"]), (&json!(sha256(&file)), &json!(file.len())));
    assert_eq!((&ray_set["name"], &ray_set["declared"]), (&json!("in pieces.dat"), &json!({"length_unit": "mm"})));
    let done = head(&site, &whole).await;
    let length = file.len().to_string();
    let said =
        ["upload-offset", "upload-length", "upload-concat", "upload-metadata"].map(|name| done.header(name).to_owned());
    assert_eq!(said, [length.as_str(), length.as_str(), concat.as_str(), said[3].as_str()].map(str::to_owned));
    // The pieces are told of until their time is over, and lose nothing by being deleted.
    for at in &at {
        let told = site.get(at).await.json();
        assert_eq!((&told["state"], &told["part_of"]), (&json!("joined"), &json!(id(&whole))));
        assert_eq!(head(&site, at).await.header("upload-concat"), "partial");
    }
    assert_eq!(site.delete(&at[0]).await.status, StatusCode::NO_CONTENT);
    nothing_lies_about(&site).await;
    let job = site.job(id(&whole)).await;
    site.until_state(&job, "succeeded").await;
    let read = site.get(&format!("/v1/jobs/{job}/artifacts/read.txt")).await;
    let digest = sha256(&file);
    assert_eq!(String::from_utf8(read.body).unwrap(), format!("in pieces.dat {digest} {digest}\n"));
    // The bytes go with the ray set, wherever they lie.
    site.delete(&format!("/v1/jobs/{job}")).await;
    assert_eq!(site.delete(&format!("/v1/ray-sets/{}", id(&whole))).await.status, StatusCode::NO_CONTENT);
    assert_eq!(site.blobs(), [""; 0]);
}

#[tokio::test(flavor = "multi_thread")]
async fn pieces_come_in_the_order_that_is_said_and_as_often() {
    let site = Site::start(prompt()).await;
    // A header that tells of 40 rays, and twice the same 20.
    let (file, twenty) = (rays::zemax(40), rays::zemax(20));
    let half = &twenty[208..];
    let whole = [&file[..208], half, half].concat();
    let (start, rest) = (piece(&site, &file[..208]).await, piece(&site, half).await);
    let deferred = [VERSION, PARTIAL, ("upload-defer-length", "1")];
    let later = site.ask(Method::POST, "/v1/uploads", &deferred, Body::empty()).await.header("location").to_owned();
    append(&site, &later, 0, half.to_vec(), &[("upload-length", &half.len().to_string())]).await;
    assert_eq!(site.get(&later).await.json()["state"], "complete");
    // Absolute, with a path of a proxy, and relative.
    let absolute =
        [format!("https://rays.example.org/lab{start}"), rest.clone(), format!("http://127.0.0.1:8080{rest}")];
    let made = join(&site, &absolute.each_ref().map(String::as_str), &[]).await;
    assert_eq!(made.status, StatusCode::CREATED, "{made:?}");
    let ray_set = only_ray_set(&site).await;
    assert_eq!((&ray_set["sha256"], &ray_set["byte_count"]), (&json!(sha256(&whole)), &json!(whole.len())));
    assert_eq!(ray_set["header"]["ray_count"], 40);
    site.delete(&format!("/v1/ray-sets/{}", made.header("location").rsplit('/').next().unwrap())).await;
    // The same bytes in another order are no ray file.
    let (start, again) = (piece(&site, &file[..208]).await, piece(&site, half).await);
    let refused = join(&site, &[&again, &start, &later], &[]).await;
    assert!(refused.status == 400 || refused.status == 422, "{refused:?}");
    nothing_left(&site).await;
    // Whoever asks again is told the same; there is nothing left to try it with.
    assert_eq!(join(&site, &[&again, &start, &later], &[]).await.json(), refused.json());
    join(&site, &[&start, &again, &later], &[]).await.is_problem(409, "upload.partial_used");
    let whole = format!("/v1/uploads/{}", site.get(&later).await.json()["part_of"].as_str().unwrap());
    assert_eq!(site.get(&whole).await.json()["problem"], refused.json());
    let gone = head(&site, &whole).await;
    assert_eq!((gone.status, gone.headers.get("upload-offset")), (StatusCode::GONE, None));
    assert!(gone.header("upload-concat").starts_with("final;"));
}

#[tokio::test(flavor = "multi_thread")]
async fn what_cannot_be_a_piece_is_refused_and_the_others_can_be_used_after_it() {
    let mut site = Site::start_as(|config| Config { max_upload_bytes: 5000, auth: true, ..config }, prompt()).await;
    let ours = site.key_of("lab", &Scope::OF_A_TENANT).await;
    site.key = Some(ours.clone());
    let file = rays::zemax(40);
    let (start, rest) = (piece(&site, &file[..500]).await, piece(&site, &file[500..]).await);
    let whole = begin(&site, 900, &[]).await;
    let short = begin(&site, 900, &[PARTIAL]).await;
    append(&site, &short, 0, vec![1; 899], &[]).await;
    let large = piece(&site, &vec![1; 4900]).await;
    let nobody = "/v1/uploads/0190b5a0-0000-7000-8000-000000000000";
    for (other, status, code) in [
        (nobody, 404, "upload.not_found"),
        (whole.as_str(), 422, "upload.not_partial"),
        (short.as_str(), 409, "upload.partial_unfinished"),
        (large.as_str(), 413, "upload.too_large"),
        ("/v1/uploads", 400, "request.malformed_header"),
        ("/v1/ray-sets/x", 400, "request.malformed_header"),
    ] {
        for list in [[start.as_str(), other, rest.as_str()], [other, start.as_str(), rest.as_str()]] {
            join(&site, &list, &[]).await.is_problem(status, code);
        }
    }
    let too_many = vec![start.as_str(); 101];
    join(&site, &too_many, &[]).await.is_problem(422, "request.out_of_range");
    let good = [start.as_str(), rest.as_str()];
    // "The Client MUST NOT include the Upload-Length header in the final upload creation."
    for header in [("upload-length", "1328"), ("upload-defer-length", "1"), ("upload-checksum", "sha1 AAAA"), OCTETS] {
        join(&site, &good, &[header]).await.is_problem(400, "request.malformed_header");
    }
    let concat = format!("final;{}", good.join(" "));
    let headers = [VERSION, OCTETS, ("upload-concat", concat.as_str())];
    site.ask(Method::POST, "/v1/uploads", &headers, file.clone()).await.is_problem(400, "request.malformed_header");
    // Those of another tenant are not there.
    let other = site.key_of("shop", &Scope::OF_A_TENANT).await;
    site.key = Some(other);
    join(&site, &good, &[]).await.is_problem(404, "upload.not_found");
    site.key = Some(ours);
    let made = join(&site, &good, &[]).await;
    assert_eq!(made.status, StatusCode::CREATED, "{made:?}");
    assert_eq!(only_ray_set(&site).await["sha256"], sha256(&file));
}

#[tokio::test(flavor = "multi_thread")]
async fn nothing_is_added_to_an_upload_of_pieces() {
    let site = Site::start(prompt()).await;
    let file = rays::zemax(40);
    let (start, rest) = (piece(&site, &file[..500]).await, piece(&site, &file[500..]).await);
    // Nor more to a piece than it has.
    append(&site, &start, 500, vec![1; 9], &[]).await.is_problem(409, "upload.complete");
    let nothing = append(&site, &start, 500, Vec::new(), &[("content-length", "0")]).await;
    assert_eq!((nothing.status, nothing.header("upload-offset")), (StatusCode::NO_CONTENT, "500"));
    let made = join(&site, &[&start, &rest], &[]).await;
    let at = made.header("location");
    for place in [0, 500, file.len()] {
        append(&site, at, place, vec![1; 9], &[]).await.is_problem(403, "upload.final");
        append(&site, at, place, Vec::new(), &[("content-length", "0")]).await.is_problem(403, "upload.final");
    }
    // Before its end too.
    site.write(
        sql("UPDATE uploads SET state = 'finishing', lease_until_ms = {now} + 60000 WHERE id = $1").bind(id(at)),
    )
    .await;
    append(&site, at, file.len(), vec![1; 9], &[]).await.is_problem(403, "upload.final");
    let unread = head(&site, at).await;
    assert_eq!((unread.status, unread.headers.get("upload-offset")), (StatusCode::OK, None));
    assert_eq!(
        (unread.header("upload-length"), unread.header("upload-concat")),
        (&*file.len().to_string(), made.header("upload-concat"))
    );
    append(&site, &start, 500, vec![1; 9], &[]).await.is_problem(409, "upload.complete");
    assert_eq!(only_ray_set(&site).await["sha256"], sha256(&file));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_request_that_is_repeated_or_raced_makes_one_upload() {
    let site = Site::start(prompt()).await;
    let file = rays::zemax(4000);
    let (start, rest) = (piece(&site, &file[..5000]).await, piece(&site, &file[5000..]).await);
    let good = [start.as_str(), rest.as_str()];
    let turned = [rest.as_str(), start.as_str()];
    let all = join_all((0..8).map(|number| join(&site, if number % 2 == 0 { &good } else { &turned }, &[]))).await;
    let refused: Vec<&Reply> = all.iter().filter(|reply| reply.status == StatusCode::CONFLICT).collect();
    assert_eq!(refused.len(), 4, "{all:?}");
    let part_of = site.get(&start).await.json()["part_of"].as_str().unwrap().to_owned();
    let others: Vec<&Reply> = all.iter().filter(|reply| reply.status != StatusCode::CONFLICT).collect();
    let is_good = others.iter().all(|reply| reply.status == StatusCode::CREATED);
    // Whichever order came first: all of its kind were answered alike.
    if is_good {
        assert!(others.iter().all(|reply| reply.header("location").ends_with(&part_of)), "{others:?}");
        assert_eq!(only_ray_set(&site).await["sha256"], sha256(&file));
    } else {
        assert!(others.iter().all(|reply| reply.json() == others[0].json()), "{others:?}");
        nothing_left(&site).await;
    }
    let finals = site.rows(sql("SELECT id FROM uploads WHERE partials IS NOT NULL")).await;
    assert_eq!(finals.len(), 1);
    // Another name is another file, and its bytes are used.
    let named = metadata(&[("filename", "other.dat")]);
    join(&site, if is_good { &good } else { &turned }, &[("upload-metadata", &named)])
        .await
        .is_problem(409, "upload.partial_used");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_piece_that_is_deleted_meanwhile_is_in_the_file_or_is_not_there() {
    let site = Site::start(prompt()).await;
    let file = rays::zemax(40);
    for round in 0..12 {
        let (start, rest) = (piece(&site, &file[..500]).await, piece(&site, &file[500..]).await);
        let both = [start.as_str(), rest.as_str()];
        let (made, deleted) = tokio::join!(join(&site, &both, &[]), site.delete(&start));
        assert_eq!(deleted.status, StatusCode::NO_CONTENT, "{round}");
        match made.status {
            StatusCode::CREATED => {
                let ray_set = format!("/v1/ray-sets/{}", id(made.header("location")));
                assert_eq!(site.get(&ray_set).await.json()["sha256"], sha256(&file));
                nothing_lies_about(&site).await;
                site.delete(&ray_set).await;
            }
            _ => {
                made.is_problem(404, "upload.not_found");
                // The other one can still be used.
                let again = piece(&site, &file[..500]).await;
                let made = join(&site, &[&again, &rest], &[]).await;
                site.delete(&format!("/v1/ray-sets/{}", id(made.header("location")))).await;
            }
        }
        assert_eq!(site.blobs(), [""; 0], "{round}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn the_bytes_of_pieces_count_once() {
    let file = rays::zemax(40);
    let size = file.len() as u64;
    let quota = Quota { stored_bytes: size + 99, ..Quota::default() };
    let site = Site::start_as(|config| Config { quota, ..config }, prompt()).await;
    let (start, rest) = (piece(&site, &file[..500]).await, piece(&site, &file[500..]).await);
    // They count as long as they wait: there is room for 99 more.
    let headers = [VERSION, PARTIAL, ("upload-length", "100")];
    site.ask(Method::POST, "/v1/uploads", &headers, Body::empty()).await.is_problem(413, "quota.stored_bytes");
    // Named twice they would be kept twice.
    join(&site, &[&start, &rest, &start], &[]).await.is_problem(413, "quota.stored_bytes");
    assert_eq!(site.get(&start).await.json()["state"], "complete");
    assert_eq!(join(&site, &[&start, &rest], &[]).await.status, StatusCode::CREATED);
    site.ask(Method::POST, "/v1/uploads", &headers, Body::empty()).await.is_problem(413, "quota.stored_bytes");
    begin(&site, 99, &[PARTIAL]).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn pieces_expire_and_take_along_what_is_theirs() {
    let site = Site::start_as(|config| Config { upload_expiry: Duration::from_mins(1), ..config }, prompt()).await;
    let file = rays::zemax(40);
    let (start, rest) = (piece(&site, &file[..500]).await, piece(&site, &file[500..]).await);
    let made = join(&site, &[&start, &rest], &[]).await;
    assert_eq!(made.status, StatusCode::CREATED, "{made:?}");
    let unused = piece(&site, &file[..500]).await;
    // Their time is over.
    site.write(sql("UPDATE uploads SET expires_ms = 0")).await;
    let begun = Instant::now();
    // What has become a ray set stays; blobs go soon after their rows.
    while !site.rows(sql("SELECT id FROM uploads")).await.is_empty() || site.blobs().len() > 2 {
        assert!(begun.elapsed() < Duration::from_secs(60), "{unused} does not expire: {:?}", site.blobs());
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    nothing_lies_about(&site).await;
    assert_eq!(only_ray_set(&site).await["sha256"], sha256(&file));
    let job = site.job(id(made.header("location"))).await;
    site.until_state(&job, "succeeded").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn digests_of_pieces_and_of_the_whole_are_verified() {
    let site = Site::start(prompt()).await;
    let file = rays::zemax(40);
    let hex = |bytes: &[u8]| metadata(&[("sha256", &sha256(bytes))]);
    // A piece's own metadata is of the piece, and is not the file's.
    let said = begin(&site, 500, &[PARTIAL, ("upload-metadata", &hex(&file[..500]))]).await;
    append(&site, &said, 0, file[..500].to_vec(), &[]).await;
    let wrong = begin(&site, 500, &[PARTIAL, ("upload-metadata", &hex(&file))]).await;
    append(&site, &wrong, 0, file[..500].to_vec(), &[]).await;
    let rest = piece(&site, &file[500..]).await;
    join(&site, &[&wrong, &rest], &[]).await.is_problem(400, "upload.digest_mismatch");
    let made = join(&site, &[&said, &rest], &[("upload-metadata", &hex(&file))]).await;
    assert_eq!(made.status, StatusCode::CREATED, "{made:?}");
    let (start, rest) = (piece(&site, &file[..500]).await, piece(&site, &file[500..]).await);
    let refused = join(&site, &[&start, &rest], &[("upload-metadata", &hex(&file[..500]))]).await;
    refused.is_problem(400, "upload.digest_mismatch");
    site.delete(&wrong).await;
    nothing_lies_about(&site).await;
    assert_eq!(only_ray_set(&site).await["sha256"], sha256(&file));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_packed_file_in_pieces_is_the_ray_sets_in_it() {
    let site = Site::start(prompt()).await;
    let (blue, red) = (rays::zemax(50_000), rays::zemax(6));
    let lamp = zip(&[("blue.dat", &blue), ("red.dat", &red)]);
    let (start, rest) = (piece(&site, &lamp[..1000]).await, piece(&site, &lamp[1000..]).await);
    let made = join(&site, &[&start, &rest], &[("upload-metadata", &metadata(&[("filename", "lamp.zip")]))]).await;
    assert_eq!(made.status, StatusCode::CREATED, "{made:?}");
    let upload = site.get(made.header("location")).await.json();
    let mut found = Vec::new();
    for link in upload["links"]["ray_sets"].as_array().unwrap() {
        let ray_set = site.get(link.as_str().unwrap()).await.json();
        assert_eq!(ray_set["packed"], json!({"name": "lamp.zip", "sha256": sha256(&lamp), "left_out": []}));
        found.push(ray_set["sha256"].clone());
    }
    assert_eq!(found, [json!(sha256(&blue)), json!(sha256(&red))]);
    nothing_lies_about(&site).await;
    assert_eq!(site.blobs().len(), 2, "the packed bytes are gone: {:?}", site.blobs());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_final_upload_that_is_deleted_takes_its_bytes_along() {
    let site = Site::start(prompt()).await;
    let file = rays::zemax(40);
    let (start, rest) = (piece(&site, &file[..500]).await, piece(&site, &file[500..]).await);
    let made = join(&site, &[&start, &rest], &[]).await;
    let at = made.header("location");
    // As a process leaves it that was killed before it knew what the bytes are.
    let parts = "INSERT INTO upload_parts (upload_id, number, byte_count, blob) \
                 SELECT ray_set_id, number, byte_count, blob FROM parts WHERE ray_set_id = $1";
    site.write(sql(parts).bind(id(at))).await;
    site.write(sql("DELETE FROM ray_sets WHERE id = $1").bind(id(at))).await;
    site.write(
        sql("UPDATE uploads SET state = 'finishing', lease_until_ms = {now} + 60000 WHERE id = $1").bind(id(at)),
    )
    .await;
    assert_eq!(site.blobs().len(), 2);
    assert_eq!(site.delete(at).await.status, StatusCode::NO_CONTENT);
    assert_eq!(site.blobs(), [""; 0]);
    nothing_left(&site).await;
}

/// An `Upload-Expires`, as tus writes dates (RFC 9110, section 5.6.7), epoch s.
fn expires(reply: &Reply) -> i64 {
    let date = reply.header("upload-expires");
    let moment = httpdate::parse_http_date(date).unwrap();
    // The preferred of the three forms.
    assert!(date.len() == 29 && date.ends_with(" GMT") && date.as_bytes()[3] == b',', "{date}");
    moment.duration_since(std::time::UNIX_EPOCH).unwrap().as_secs() as i64
}

#[tokio::test(flavor = "multi_thread")]
async fn every_answer_of_an_upload_tells_when_it_expires() {
    let site = Site::start(prompt()).await;
    let headers = [VERSION, ("upload-length", "1000")];
    let begun = site.ask(Method::POST, "/v1/uploads", &headers, Body::empty()).await;
    let at = begun.header("location").to_owned();
    let told = async || site.get(&at).await.json()["expires_ms"].as_i64().unwrap() / 1000;
    assert_eq!(expires(&begun), told().await);
    assert_eq!(expires(&append(&site, &at, 0, vec![1; 9], &[]).await), told().await);
    assert_eq!(expires(&head(&site, &at).await), told().await);
    // "This header MUST be included in every PATCH response if the upload is going to expire."
    for (place, bytes, more) in [
        (7, vec![1; 9], ("x-test", "offset")),
        (9, vec![1; 9], ("upload-checksum", "sha1 qZk+NkcGgWq6PiVxeFDCbJzQ2J0=")),
        (9, vec![1; 1000], ("x-test", "beyond")),
        (9, vec![1; 9], ("upload-length", "1001")),
    ] {
        let refused = append(&site, &at, place, bytes, &[more]).await;
        assert!(refused.status.as_u16() >= 400, "{refused:?}");
        assert_eq!(expires(&refused), told().await, "{more:?}");
    }
    assert_eq!(offset(&site, &at).await, 9);
    let file = rays::zemax(40);
    let (start, rest) = (piece(&site, &file[..500]).await, piece(&site, &file[500..]).await);
    let made = join(&site, &[&start, &rest], &[]).await;
    expires(&made);
    expires(&append(&site, made.header("location"), 0, vec![1; 9], &[]).await);
}
