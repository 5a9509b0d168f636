use axum::body::Body;
use axum::http::{Method, StatusCode};
use serde_json::json;
use service::storage::records::statement::sql;
use support::rays;
use support::runners::{prompt, sha256};
use support::site::Site;

#[tokio::test(flavor = "multi_thread")]
async fn an_upload_answers_with_its_inspection_and_keeps_it() {
    let site = Site::start(prompt()).await;
    let uploaded = site.upload(rays::zemax(1000)).await;
    let ray_set = &uploaded.json()["ray_sets"][0];
    let found = &ray_set["inspection"];
    // A square of 1 mm that shines along +Z, 1 W each: collimated, so no focus; few, so noisy.
    assert_eq!((&found["rays_used"], &found["flux"]["radiant_w"]), (&json!(1000), &json!(1000.0)));
    assert_eq!((&found["verdict"], &found["focus"]), (&json!("notice"), &json!(null)));
    assert_eq!(found["main_direction"]["axis"], "+Z");
    assert_eq!(found["header"], json!(null), "the header is said once");
    assert!(found["checks"].as_array().unwrap().iter().all(|check| check["check"].as_str().is_some()));
    assert_eq!(site.get(uploaded.header("location")).await.json(), *ray_set);
    let listed = site.get("/v1/ray-sets").await.json();
    assert_eq!(listed["ray_sets"][0]["inspection"], json!(null));
    assert_eq!(listed["ray_sets"][0]["header"]["ray_count"], 1000);
    // What lists read has no texts; the answer for one ray set has.
    let header = site.rows(sql("SELECT header FROM ray_sets")).await[0].text("header").unwrap();
    assert!(header.contains("\"texts\":[]") && !ray_set["header"]["texts"].as_array().unwrap().is_empty(), "{header}");
}

#[tokio::test(flavor = "multi_thread")]
async fn drawings_are_served_with_their_digest_and_go_with_the_ray_set() {
    let site = Site::start(prompt()).await;
    let path = "/v1/ray-sets?name=%3Csvg%20onload%3Dx%3E%26.dat";
    let uploaded = site.ask(Method::POST, path, &[], rays::zemax(1000)).await;
    let id = uploaded.id();
    for link in ["origins", "far_field"] {
        let path = uploaded.json()["ray_sets"][0]["links"][link].as_str().unwrap().to_owned();
        let drawing = site.get(&path).await;
        assert_eq!((drawing.status, drawing.header("content-type")), (StatusCode::OK, "image/svg+xml"));
        assert_eq!(drawing.header("etag"), format!("\"{}\"", sha256(&drawing.body)));
        let text = String::from_utf8(drawing.body.clone()).unwrap();
        assert!(
            text.starts_with("<svg") && text.contains("&lt;svg onload=x&gt;&amp;.dat") && !text.contains("<svg on")
        );
        let etag = drawing.header("etag").to_owned();
        let again = site.ask(Method::GET, &path, &[("if-none-match", &etag)], Body::empty()).await;
        assert_eq!((again.status, again.body.len()), (StatusCode::NOT_MODIFIED, 0));
    }
    assert_eq!(site.delete(&format!("/v1/ray-sets/{id}")).await.status, StatusCode::NO_CONTENT);
    site.get(&format!("/v1/ray-sets/{id}/origins.svg")).await.is_problem(404, "ray_set.not_found");
    for table in ["SELECT 1 FROM inspections", "SELECT 1 FROM drawings"] {
        assert!(site.rows(sql(table)).await.is_empty(), "{table}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_readable_file_that_no_job_would_take_is_kept_and_told_of() {
    let site = Site::start(prompt()).await;
    let mut file = rays::zemax(100);
    // Directions twice as long as they may be: byte 20 of each record of 28 is n.
    (0..100).for_each(|ray| file[208 + 28 * ray + 20..][..4].copy_from_slice(&2.0_f32.to_le_bytes()));
    let uploaded = site.upload(file).await;
    assert_eq!(uploaded.status, StatusCode::CREATED, "{uploaded:?}");
    let ray_set = &uploaded.json()["ray_sets"][0];
    assert_eq!((&ray_set["inspection"]["verdict"], &ray_set["links"]["origins"]), (&json!("wrong"), &json!(null)));
    assert_eq!(ray_set["inspection"]["checks"][0]["check"], "rays.usable");
    let path = format!("/v1/ray-sets/{}/far-field.svg", uploaded.id());
    site.get(&path).await.is_problem(404, "drawing.not_found");
}
