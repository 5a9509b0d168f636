//! Several requests that add to one upload at once, and clients that are gone: which of them goes on, and what is kept.

use crate::endings::{Stuck, id};
use crate::resume::{OCTETS, VERSION, append, begin, offset};
use crate::uploads::nothing_left;
use axum::body::{Body, Bytes};
use axum::http::{Method, StatusCode};
use futures::stream;
use service::Config;
use service::ray_sets::pace::Slowest;
use service::storage::records::statement::sql;
use std::io;
use std::pin::pin;
use std::time::{Duration, Instant};
use support::rays;
use support::runners::prompt;
use support::site::{Reply, Site};

/// A body whose pieces are sent one by one.
fn held() -> (tokio::sync::mpsc::Sender<io::Result<Bytes>>, Body) {
    let (sender, receiver) = tokio::sync::mpsc::channel(1);
    let pieces = stream::unfold(receiver, |mut receiver: tokio::sync::mpsc::Receiver<_>| async {
        receiver.recv().await.map(|piece| (piece, receiver))
    });
    (sender, Body::from_stream(pieces))
}

/// Which request adds to the one upload there is.
async fn session(site: &Site) -> String {
    let rows = site.rows(sql("SELECT COALESCE(session, '') AS session FROM uploads")).await;
    rows.first().map(|row| row.text("session").unwrap()).unwrap_or_default()
}

/// Waits until it is no longer the one `before`, but the one that is asked here.
async fn until_begun(site: &Site, request: impl Future<Output = Reply>, before: &str) {
    let begun = async {
        while session(site).await == before {
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
    };
    tokio::select! {
        reply = request => panic!("{reply:?}"),
        () = begun => {}
    }
}

/// A site whose clients may be silent for long.
async fn patient_site() -> Site {
    let slowest = Slowest { interval: Duration::from_secs(60), bytes: 1 };
    Site::start_as(|config| Config { slowest, ..config }, prompt()).await
}

#[tokio::test(flavor = "multi_thread")]
async fn the_request_that_began_last_goes_on_and_an_earlier_one_keeps_nothing_more() {
    let site = patient_site().await;
    let file = rays::zemax(50_000);
    let at = begin(&site, file.len(), &[]).await;
    // The earlier one's connection is dead, and nobody has noticed.
    let ((one, earlier), (two, later)) = (held(), held());
    let earlier = append(&site, &at, 0, earlier, &[]);
    let later = append(&site, &at, 0, later, &[]);
    let (mut earlier, mut later) = (pin!(earlier), pin!(later));
    for (request, sender) in [(&mut earlier, &one), (&mut later, &two)] {
        let before = session(&site).await;
        sender.send(Ok(Bytes::copy_from_slice(&file[..5000]))).await.unwrap();
        until_begun(&site, request, &before).await;
    }
    one.send(Err(io::Error::other("connection reset"))).await.unwrap();
    let earlier = earlier.await;
    assert!(!earlier.status.is_success(), "{earlier:?}");
    site.until_blobs(<[String]>::is_empty).await;
    assert_eq!(offset(&site, &at).await, 0);
    drop(two);
    assert_eq!(later.await.header("upload-offset"), "5000");
    site.until_blobs(|blobs| blobs.len() == 1).await;
    assert_eq!(offset(&site, &at).await, 5000);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_length_is_said_where_the_upload_goes_on_and_ends_other_requests() {
    let site = patient_site().await;
    let file = rays::zemax(50_000);
    let defer = [VERSION, ("upload-defer-length", "1")];
    let at = site.ask(Method::POST, "/v1/uploads", &defer, Body::empty()).await.header("location").to_owned();
    let piece = |sent: usize| Ok(Bytes::copy_from_slice(&file[sent..sent + 5000]));
    let head = async || site.ask(Method::HEAD, &at, &[VERSION], Body::empty()).await;
    // Elsewhere: it is not said, and whoever sends goes on.
    let (sender, body) = held();
    let mut running = pin!(append(&site, &at, 0, body, &[]));
    sender.send(piece(0)).await.unwrap();
    until_begun(&site, &mut running, "").await;
    let said = append(&site, &at, 999, Vec::new(), &[("upload-length", "1")]).await;
    said.is_problem(409, "upload.offset_conflict");
    assert_eq!(head().await.header("upload-defer-length"), "1");
    drop(sender);
    assert_eq!(running.await.header("upload-offset"), "5000");
    // There: it is, and whoever sent before has been followed.
    let ((sender, body), before) = (held(), session(&site).await);
    let mut running = pin!(append(&site, &at, 5000, body, &[]));
    sender.send(piece(5000)).await.unwrap();
    until_begun(&site, &mut running, &before).await;
    let said = [("upload-length", "15000"), ("content-length", "0")];
    assert_eq!(append(&site, &at, 5000, Vec::new(), &said).await.header("upload-offset"), "5000");
    drop(sender);
    running.await.is_problem(409, "upload.offset_conflict");
    assert_eq!((head().await.header("upload-length"), head().await.header("upload-offset")), ("15000", "5000"));
    // Said again, the same and another.
    assert_eq!(append(&site, &at, 5000, Vec::new(), &said).await.status, StatusCode::NO_CONTENT);
    append(&site, &at, 5000, Vec::new(), &[("upload-length", "15001")]).await.is_problem(400, "upload.length");
    // However a length comes to be less than what came, no more is named than it says.
    let ((sender, body), before) = (held(), session(&site).await);
    let mut running = pin!(append(&site, &at, 5000, body, &[]));
    sender.send(piece(5000)).await.unwrap();
    until_begun(&site, &mut running, &before).await;
    site.write(sql("UPDATE uploads SET byte_count = 9999")).await;
    drop(sender);
    running.await.is_problem(409, "upload.offset_conflict");
    site.until_blobs(|blobs| blobs.len() == 1).await;
    assert_eq!(offset(&site, &at).await, 5000);
}

#[tokio::test(flavor = "multi_thread")]
async fn what_was_begun_with_its_first_bytes_goes_with_a_sender_that_never_knew() {
    let site = patient_site().await;
    let (sender, body) = held();
    {
        let headers = [VERSION, OCTETS, ("upload-length", "1000000")];
        let mut running = pin!(site.ask(Method::POST, "/v1/uploads", &headers, body));
        sender.send(Ok(Bytes::copy_from_slice(&rays::zemax(100)))).await.unwrap();
        until_begun(&site, &mut running, "").await;
        // A server forgets the request of a client that is gone.
    }
    let _ = sender.send(Err(io::Error::other("connection reset"))).await;
    let start = Instant::now();
    while !site.rows(sql("SELECT id FROM uploads")).await.is_empty() || !site.blobs().is_empty() {
        assert!(start.elapsed() < support::site::PATIENCE, "{:?}", site.blobs());
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    nothing_left(&site).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn whoever_was_followed_before_reading_the_last_part_is_told_so() {
    let site = Site::start(prompt()).await;
    let file = rays::zemax(1000);
    let at = begin(&site, file.len(), &[]).await;
    append(&site, &at, 0, file[..5000].to_vec(), &[]).await;
    let Some(stuck) = Stuck::new(&site, &at).await else { return };
    let before = session(&site).await;
    let mut late = pin!(append(&site, &at, 5000, file[5000..].to_vec(), &[]));
    until_begun(&site, &mut late, &before).await;
    site.write(sql("UPDATE uploads SET session = 'another' WHERE id = $1").bind(id(&at))).await;
    drop(stuck);
    late.await.is_problem(409, "upload.offset_conflict");
    assert_eq!(offset(&site, &at).await, 5000);
}
