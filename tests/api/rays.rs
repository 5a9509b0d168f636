//! New rays from the model of a job: any part of the file at any time, limits, walls, and clients that leave.

use axum::body::Body;
use axum::http::{Method, StatusCode};
use futures::StreamExt;
use pipeline::convert::Target;
use pipeline::{Limits, NewRays, NoProgress, RayRequest, read_model, write_new_rays};
use service::accounts::access::Scope;
use std::time::Duration;
use support::runners::model_files;
use support::site::Site;

/// A site with a job that has succeeded; the address of its rays.
async fn with_model() -> (Site, String) {
    let (site, job) = Site::with_a_model().await;
    (site, format!("/v1/jobs/{job}/rays"))
}

/// What the pipeline makes of the same files.
fn expected(count: u64, seed: u64, target: Target) -> Vec<u8> {
    made(RayRequest { count, seed, low_discrepancy: false, target })
}

fn made(request: RayRequest) -> Vec<u8> {
    let [emitter, goniograms] = model_files();
    let model = read_model(emitter, goniograms, &Limits::default()).unwrap();
    let rays = NewRays::new(&model, &model.name, request).unwrap();
    let mut bytes = Vec::new();
    write_new_rays(&rays, 0..rays.byte_count(), &mut bytes, &NoProgress).unwrap();
    bytes
}

#[tokio::test(flavor = "multi_thread")]
async fn rays_are_those_of_the_model_and_any_range_is_a_part_of_them() {
    let (site, rays) = with_model().await;
    let whole = expected(100_000, 7, Target::Tm25);
    let asked = format!("{rays}?count=100000&seed=7");
    let reply = site.get(&asked).await;
    assert_eq!(reply.status, StatusCode::OK);
    assert!(reply.body == whole, "the service gives other bytes than the pipeline");
    assert_eq!(reply.header("content-length"), whole.len().to_string());
    assert_eq!(reply.header("content-disposition"), "attachment; filename=\"rays-100000-seed-7.tm25ray\"");
    let etag = reply.header("etag").to_owned();
    let mut parts = Vec::new();
    for part in 0..10 {
        let [from, to] = [part, part + 1].map(|part| whole.len() * part / 10);
        let range = format!("bytes={from}-{}", to - 1);
        let headers = [("range", range.as_str()), ("if-range", etag.as_str())];
        let reply = site.ask(Method::GET, &asked, &headers, Body::empty()).await;
        assert_eq!(reply.status, StatusCode::PARTIAL_CONTENT);
        assert_eq!(reply.header("content-range"), format!("bytes {from}-{}/{}", to - 1, whole.len()));
        parts.extend(reply.body);
    }
    assert!(parts == whole, "ten ranges are not the file");
    let head = site.ask(Method::HEAD, &asked, &[], Body::empty()).await;
    assert_eq!((head.header("content-length"), head.header("etag")), (reply.header("content-length"), etag.as_str()));
    let known = site.ask(Method::GET, &asked, &[("if-none-match", &etag)], Body::empty()).await;
    assert_eq!((known.status, known.body.len()), (StatusCode::NOT_MODIFIED, 0));
    let beyond = format!("bytes={}-", whole.len());
    let beyond = site.ask(Method::GET, &asked, &[("range", &beyond)], Body::empty()).await;
    beyond.is_problem(416, "artifact.range_not_satisfiable");
    assert!(site.get(&format!("{rays}?count=1e5&seed=7")).await.body == whole, "as people write it");
    // Another seed, count or format is another file.
    for other in ["count=100000&seed=8", "count=100001&seed=7", "count=100000&seed=7&format=zemax"] {
        let reply = site.get(&format!("{rays}?{other}")).await;
        assert_eq!(reply.status, StatusCode::OK);
        assert!(reply.header("etag") != etag && reply.body != whole, "{other}");
    }
    let zemax = site.get(&format!("{rays}?count=1000&format=zemax")).await;
    assert!(zemax.body == expected(1000, 1, Target::ZemaxBinary), "the seed is 1 where none is given");
    // So are rays of low discrepancy, and any part of them.
    let spread = format!("{asked}&low_discrepancy=true");
    let evenly = made(RayRequest { count: 100_000, seed: 7, low_discrepancy: true, target: Target::Tm25 });
    let reply = site.get(&spread).await;
    assert!(reply.header("etag") != etag && reply.body == evenly && evenly != whole);
    assert!(reply.header("content-disposition").ends_with("seed-7-low-discrepancy.tm25ray\""));
    let part = site.ask(Method::GET, &spread, &[("range", "bytes=123457-")], Body::empty()).await;
    assert!(part.body == evenly[123_457..]);
}

#[tokio::test(flavor = "multi_thread")]
async fn what_cannot_be_drawn_is_told() {
    let (site, rays) = with_model().await;
    for (query, status, code) in [
        ("", 422, "request.missing_field"),
        ("?count=0", 422, "request.out_of_range"),
        ("?count=1000000000001", 422, "request.out_of_range"),
        ("?count=-1", 422, "request.wrong_type"),
        ("?count=ten", 422, "request.wrong_type"),
        ("?count=10&format=speos", 422, "request.wrong_type"),
        ("?count=10&low_discrepancy=yes", 422, "request.wrong_type"),
        ("?count=10&colour=red", 422, "request.unknown_field"),
        ("?count=5000000000&format=zemax", 422, "zemax.too_many_rays"),
    ] {
        site.get(&format!("{rays}{query}")).await.is_problem(status, code);
    }
    site.get("/v1/jobs/0190b5a0-0000-7000-8000-000000000000/rays?count=1").await.is_problem(404, "job.not_found");
    // A job without a model, as one that has not succeeded.
    Site::assert_is_no_model("rays?count=1").await;
}

/// Ten million million bytes begin at once and end when nobody reads them any more; half of the eight places are one tenant's, and no more.
#[tokio::test(flavor = "multi_thread")]
async fn endless_rays_take_a_place_until_their_client_leaves() {
    const AT_ONCE: usize = 4;
    let (site, rays) = with_model().await;
    let endless = format!("{rays}?count=1000000000000");
    let mut open = Vec::new();
    for _ in 0..AT_ONCE {
        let response = site.begin(&endless).await;
        assert_eq!(response.status(), StatusCode::OK);
        let mut body = response.into_body().into_data_stream();
        assert!(!body.next().await.unwrap().unwrap().is_empty());
        open.push(body);
    }
    // Lengths are known from the first of them on, without a model and so without a place; a range is that of a GET.
    for headers in [&[][..], &[("range", "bytes=0-9")]] {
        let head = site.ask(Method::HEAD, &format!("{rays}?count=1000&seed=3"), headers, Body::empty()).await;
        let length = expected(1000, 3, Target::Tm25).len().to_string();
        assert_eq!((head.status, head.header("content-length")), (StatusCode::OK, length.as_str()));
        assert_eq!((head.header("accept-ranges"), head.header("content-type")), ("bytes", "application/octet-stream"));
    }
    let zemax = format!("{rays}?count=5000000000&format=zemax");
    assert_eq!(site.ask(Method::HEAD, &zemax, &[], Body::empty()).await.status, StatusCode::UNPROCESSABLE_ENTITY);
    let full = site.get(&format!("{rays}?count=1")).await;
    full.is_problem(503, "service.busy");
    assert_eq!(full.header("retry-after"), "1");
    drop(open);
    // Their threads see it with the next piece that they send.
    for _ in 0..600 {
        if site.get(&format!("{rays}?count=1")).await.status == StatusCode::OK {
            return;
        }
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    panic!("the places of clients that left are taken");
}

#[tokio::test(flavor = "multi_thread")]
async fn another_tenant_draws_no_rays() {
    let (mut site, things) = crate::access::lab().await;
    let asked = things.address("/v1/jobs/{id}/rays");
    site.key = Some(site.key_of("lab", &[Scope::JobsRead]).await);
    assert_eq!(site.get(&asked).await.status, StatusCode::OK);
    site.key = Some(site.key_of("shop", &Scope::OF_A_TENANT).await);
    site.get(&asked).await.is_problem(404, "job.not_found");
    site.key = Some(site.key_of("lab", &[Scope::UploadsRead]).await);
    site.get(&asked).await.is_problem(403, "access.scope_missing");
}
