//! Files of renderers: those that the pipeline makes, any part of them, limits, walls.

use axum::body::Body;
use axum::http::{Method, StatusCode};
use pipeline::{LightKind, Limits, Renderer, adapt, read_model};
use service::accounts::access::Scope;
use std::io::{Cursor, Read as _};
use support::runners::model_files;
use support::site::Site;

/// A site with a job that has succeeded; the address of its adapters.
async fn with_model() -> (Site, String) {
    let (site, job) = Site::with_a_model().await;
    (site, format!("/v1/jobs/{job}/adapters"))
}

/// Names and contents of a zip.
fn files_in(bytes: &[u8]) -> Vec<(String, Vec<u8>)> {
    let mut archive = zip::ZipArchive::new(Cursor::new(bytes)).unwrap();
    let mut files = Vec::new();
    for at in 0..archive.len() {
        let mut file = archive.by_index(at).unwrap();
        let mut content = Vec::new();
        file.read_to_end(&mut content).unwrap();
        files.push((file.name().unwrap().to_string(), content));
    }
    files
}

/// What the pipeline makes of the same files.
fn expected(renderer: Renderer, light: Option<LightKind>) -> Vec<(String, Vec<u8>)> {
    let [emitter, goniograms] = model_files();
    let model = read_model(emitter, goniograms, &Limits::default()).unwrap();
    adapt(&model, renderer, light).unwrap().files.into_iter().map(|file| (file.name, file.bytes)).collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn each_renderer_gets_its_files_and_any_range_is_a_part_of_them() {
    let (site, adapters) = with_model().await;
    let mut tags = Vec::new();
    for renderer in Renderer::ALL {
        let asked = format!("{adapters}/{}", renderer.name());
        // Before it is made, nobody knows its length.
        let head = site.ask(Method::HEAD, &asked, &[], Body::empty()).await;
        assert_eq!((head.status, head.headers.get("content-length")), (StatusCode::OK, None));
        let whole = site.get(&asked).await;
        assert_eq!((whole.status, whole.header("content-type")), (StatusCode::OK, "application/zip"));
        assert_eq!(files_in(&whole.body), expected(renderer, None));
        let disposition = format!("attachment; filename=\"{}.zip\"", renderer.name());
        assert_eq!(whole.header("content-disposition"), disposition);
        let etag = whole.header("etag").to_owned();
        assert_eq!(head.header("etag"), etag);
        let head = site.ask(Method::HEAD, &asked, &[], Body::empty()).await;
        assert_eq!(head.header("content-length"), whole.body.len().to_string());
        let range = [("range", "bytes=100-199"), ("if-range", etag.as_str())];
        let part = site.ask(Method::GET, &asked, &range, Body::empty()).await;
        assert_eq!(part.status, StatusCode::PARTIAL_CONTENT);
        assert!(part.body == whole.body[100..200]);
        let known = site.ask(Method::GET, &asked, &[("if-none-match", &etag)], Body::empty()).await;
        assert_eq!((known.status, known.body.len()), (StatusCode::NOT_MODIFIED, 0));
        let changed = site.ask(Method::GET, &asked, &[("if-match", "\"a\"")], Body::empty()).await;
        changed.is_problem(412, "request.precondition_failed");
        tags.push(etag);
    }
    // Another light is another file.
    let radiant = site.get(&format!("{adapters}/mitsuba?light=radiant")).await;
    assert_eq!(files_in(&radiant.body), expected(Renderer::Mitsuba, Some(LightKind::Radiant)));
    tags.push(radiant.header("etag").to_owned());
    tags.sort_unstable();
    tags.dedup();
    assert_eq!(tags.len(), 4);
}

#[tokio::test(flavor = "multi_thread")]
async fn what_cannot_be_made_is_told() {
    let (site, adapters) = with_model().await;
    for (asked, status, code) in [
        ("povray", 404, "adapter.not_found"),
        ("mitsuba?light=spectrum", 422, "request.wrong_type"),
        ("mitsuba?colour=red", 422, "request.unknown_field"),
    ] {
        site.get(&format!("{adapters}/{asked}")).await.is_problem(status, code);
    }
    let nobody = "/v1/jobs/0190b5a0-0000-7000-8000-000000000000/adapters/mitsuba";
    site.get(nobody).await.is_problem(404, "job.not_found");
    // A job without a model, as one that has not succeeded.
    Site::assert_is_no_model("adapters/mitsuba").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn another_tenant_gets_no_files() {
    let (mut site, things) = crate::access::lab().await;
    let asked = things.address("/v1/jobs/{id}/adapters/{renderer}");
    site.key = Some(site.key_of("lab", &[Scope::JobsRead]).await);
    assert_eq!(site.get(&asked).await.status, StatusCode::OK);
    site.key = Some(site.key_of("shop", &Scope::OF_A_TENANT).await);
    site.get(&asked).await.is_problem(404, "job.not_found");
    site.key = Some(site.key_of("lab", &[Scope::UploadsRead]).await);
    site.get(&asked).await.is_problem(403, "access.scope_missing");
}
