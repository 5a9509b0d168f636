//! Files that are inspected while they come. Whether one is depends on how fast it comes; what is found does not.

use crate::upkeep::number;
use crate::uploads::nothing_left;
use axum::body::{Body, Bytes};
use axum::http::{Method, StatusCode};
use base64::Engine;
use base64::engine::general_purpose::STANDARD as BASE64;
use futures::{StreamExt, stream};
use serde_json::Value;
use service::storage::parts::PART_BYTES;
use sha2::{Digest, Sha256};
use std::convert::Infallible;
use support::runners::prompt;
use support::site::{Reply, Site};
use support::{formats, rays};

/// Enough for two parts of any format: the smallest has 28 bytes per ray.
const RAYS: u32 = 100_000;

/// The pieces that a body comes in, as a connection brings them.
fn pieces(bytes: &[u8]) -> impl Iterator<Item = Result<Bytes, Infallible>> + use<> {
    let pieces: Vec<_> = bytes.chunks(99_991).map(Bytes::copy_from_slice).collect();
    pieces.into_iter().map(Ok)
}

async fn send(site: &Site, announced: Option<usize>, headers: &[(&str, &str)], body: Body) -> Reply {
    let announced = announced.map(|length| length.to_string());
    let length = announced.as_deref().map(|length| ("content-length", length));
    let headers: Vec<_> = headers.iter().copied().chain(length).collect();
    site.ask(Method::POST, "/v1/ray-sets?name=rays&length_unit=mm", &headers, body).await
}

/// What an upload answers, but for what is new in each; and its drawings.
async fn said(site: &Site, reply: &Reply) -> (Value, Vec<Vec<u8>>) {
    if reply.status != StatusCode::CREATED {
        return (reply.json(), Vec::new());
    }
    let (mut ray_set, mut drawings) = (reply.ray_set(), Vec::new());
    for link in ["origins", "far_field"] {
        drawings.push(site.get(ray_set["links"][link].as_str().unwrap()).await.body);
    }
    for new in ["id", "created_ms", "links"] {
        ray_set[new] = Value::Null;
    }
    (ray_set, drawings)
}

async fn inspected(site: &Site, when: &str) -> f64 {
    number(site, &format!("lampwright_inspections_total{{when=\"{when}\"}}")).await
}

/// A file without a length is inspected when all of it is there: it is the witness for the other.
#[tokio::test(flavor = "multi_thread")]
async fn what_a_file_says_is_the_same_while_it_comes_and_afterwards() {
    let site = Site::start(prompt()).await;
    let counted = formats::with_count_or_end(RAYS).into_iter().map(|(name, file, _)| (name, file));
    let uncounted = formats::without_count_or_end(RAYS).into_iter().map(|(name, file, _)| (name, file));
    // A row that is none, in the last part of a text.
    let mut wrong = formats::without_count_or_end(RAYS).remove(1).1;
    let at = wrong.len() - 30_000;
    wrong[at..at + 10].copy_from_slice(b"?? no row ");
    let mut count = 0.0;
    for (name, file) in counted.chain(uncounted).chain([("a wrong row", wrong)]) {
        assert!(file.len() > PART_BYTES, "{name} is one part");
        let arriving = send(&site, Some(file.len()), &[], Body::from_stream(stream::iter(pieces(&file)))).await;
        let stored = send(&site, None, &[], Body::from_stream(stream::iter(pieces(&file)))).await;
        assert_eq!(arriving.status == StatusCode::CREATED, name != "a wrong row", "{name}: {arriving:?}");
        assert!(said(&site, &arriving).await == said(&site, &stored).await, "{name}:\n{arriving:?}\n{stored:?}");
        count += 1.0;
    }
    // On a machine that is busy, none need be fast enough; that none of so many was is a fault.
    let (arriving, stored) = (inspected(&site, "arriving").await, inspected(&site, "stored").await);
    assert!(arriving > 0.0 && stored >= count && arriving + stored == 2.0 * count, "{arriving} {stored}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_file_that_is_not_taken_leaves_nothing_and_ends_its_inspection() {
    let site = Site::start(prompt()).await;
    let file = rays::zemax(RAYS);
    let digest = format!("sha-256=:{}:", BASE64.encode(Sha256::digest(b"something else")));
    for _ in 0..4 {
        let whole = Body::from_stream(stream::iter(pieces(&file)));
        let wrong = send(&site, Some(file.len()), &[("repr-digest", &digest)], whole).await;
        wrong.is_problem(400, "upload.digest_mismatch");
        let short = Body::from_stream(stream::iter(pieces(&file[..file.len() - 1])));
        send(&site, Some(file.len()), &[], short).await.is_problem(400, "upload.truncated");
        let silent = Body::from_stream(stream::iter(pieces(&file[..file.len() - 1])).chain(stream::pending()));
        send(&site, Some(file.len()), &[], silent).await.is_problem(408, "upload.idle");
        nothing_left(&site).await;
    }
    // Their places are free again: of the next, one finds one.
    for _ in 0..50 {
        let whole = Body::from_stream(stream::iter(pieces(&file)));
        assert_eq!(send(&site, Some(file.len()), &[], whole).await.status, StatusCode::CREATED);
        if inspected(&site, "arriving").await > 0.0 {
            return;
        }
    }
    panic!("no file found a place");
}
