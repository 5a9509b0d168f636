//! Combinations of the models of jobs: a zip with a whole model, limits, walls.

use axum::http::StatusCode;
use pipeline::artifacts::read::{read, unpack};
use pipeline::model::evaluation::{Evaluator, Quantity};
use pipeline::{Limits, StoredModel};
use serde_json::{Value, json};
use service::accounts::access::Scope;
use std::io::Cursor;
use support::runners::prompt;
use support::site::Site;

const ADDRESS: &str = "/v1/combinations";

fn model_in(zip: &[u8]) -> StoredModel {
    let [emitter, goniograms] = unpack(Cursor::new(zip)).unwrap();
    read(&emitter, &goniograms, &Limits::default()).unwrap()
}

/// Two chips back to back: 0.5 W up and 1 W down, so the intensity is F/π in both directions.
#[tokio::test(flavor = "multi_thread")]
async fn models_of_jobs_become_one() {
    let (site, job) = Site::with_a_model().await;
    let asked = json!({"models": [
        {"job": job, "scale": 0.5, "name": "up"},
        {"job": job, "flux": {"radiant_w": 1.0}, "turns": [{"axis": [2, 0, 0], "degrees": 180}], "move_mm": [0, 0, -1]},
    ]});
    let reply = site.post(ADDRESS, &asked).await;
    assert_eq!(reply.status, StatusCode::OK, "{reply:?}");
    assert_eq!(reply.header("content-type"), "application/zip");
    assert_eq!(reply.header("content-disposition"), "attachment; filename=\"model.zip\"");
    let model = model_in(&reply.body);
    assert_eq!(model.name, "up + chip.tm25ray");
    let radiant = Evaluator::new(&model, Quantity::Radiant).unwrap();
    assert!((radiant.flux() - 1.5).abs() < 1e-6, "{}", radiant.flux());
    let [up, down] = [1.0, -1.0].map(|z| radiant.intensity(z * pipeline::Vector::Z) * std::f64::consts::PI);
    assert!((up / 0.5 - 1.0).abs() < 0.1 && (down - 1.0).abs() < 0.1, "{up} {down}");
    assert!(site.post(ADDRESS, &asked).await.body == reply.body, "the same request gives the same bytes");
}

#[tokio::test(flavor = "multi_thread")]
async fn what_cannot_be_combined_is_told() {
    let (site, job) = Site::with_a_model().await;
    let with = |change: Value| {
        let mut model = json!({"job": job});
        model.as_object_mut().unwrap().extend(change.as_object().unwrap().clone());
        json!({"models": [model]})
    };
    for (body, code, at) in [
        (json!({}), "request.missing_field", "."),
        (json!({"models": []}), "request.out_of_range", "models"),
        (json!({"models": vec![json!({"job": job}); 9]}), "request.out_of_range", "models"),
        (json!({"models": [{}]}), "request.missing_field", "models[0]"),
        (with(json!({"rotate": 1})), "request.unknown_field", "models[0].rotate"),
        (with(json!({"scale": 0})), "combination.change", "models[0].scale"),
        (with(json!({"scale": 1, "flux": {"radiant_w": 1}})), "combination.change", "models[0].scale"),
        (with(json!({"spectrum": {"nm_value": [[500, 0]]}})), "combination.change", "models[0].spectrum"),
        (with(json!({"flux": {"radiant_w": -1}})), "combination.change", "models[0].flux"),
        (with(json!({"scale": 1e36})), "combination.change", "models[0].scale"),
        (with(json!({"name": ""})), "request.out_of_range", "models[0].name"),
        (
            with(json!({"turns": vec![json!({"axis": [0, 0, 1], "degrees": 1}); 17]})),
            "request.out_of_range",
            "models[0].turns",
        ),
        (with(json!({"turns": [{"axis": [0, 0, 0], "degrees": 1}]})), "combination.change", "models[0].turns"),
        (with(json!({"move_mm": [0, 0, 1e6]})), "combination.change", "models[0].move_mm"),
        (with(json!({"move_mm": [0, 0, 1e12]})), "combination.change", "models[0].move_mm"),
        (with(json!({"move_mm": [0, 0]})), "request.wrong_type", "models[0].move_mm"),
    ] {
        let reply = site.post(ADDRESS, &body).await;
        reply.is_problem(422, code);
        assert_eq!(reply.json()["at"].as_str().unwrap_or_default(), at, "{body}");
    }
    let second = json!({"models": [{"job": job}, {"job": job, "scale": -1}]});
    assert_eq!(site.post(ADDRESS, &second).await.json()["at"], "models[1].scale");
    let nobody = json!({"models": [{"job": "0190b5a0-0000-7000-8000-000000000000"}]});
    site.post(ADDRESS, &with(json!({"spectrum": {"id": "none"}}))).await.is_problem(404, "spectrum.not_found");
    site.post(ADDRESS, &nobody).await.is_problem(404, "job.not_found");
    let other = Site::start(prompt()).await;
    let job = other.job(&other.ray_set().await).await;
    other.until_state(&job, "succeeded").await;
    other.post(ADDRESS, &json!({"models": [{"job": job}]})).await.is_problem(404, "artifact.not_found");
}

#[tokio::test(flavor = "multi_thread")]
async fn another_tenant_combines_nothing() {
    let (mut site, things) = crate::access::lab().await;
    let address = things.address("/v1/jobs/{id}");
    let job = address.rsplit('/').next().unwrap();
    let alone = json!({"models": [{"job": job}]});
    site.key = Some(site.key_of("lab", &[Scope::JobsRead]).await);
    assert_eq!(site.post(ADDRESS, &alone).await.status, StatusCode::OK);
    site.key = Some(site.key_of("shop", &Scope::OF_A_TENANT).await);
    site.post(ADDRESS, &alone).await.is_problem(404, "job.not_found");
    site.key = Some(site.key_of("lab", &[Scope::UploadsRead]).await);
    site.post(ADDRESS, &alone).await.is_problem(403, "access.scope_missing");
}
