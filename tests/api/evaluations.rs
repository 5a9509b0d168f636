//! Evaluations of the model of a job: numbers, forms, limits, walls, and clients that leave.

use axum::http::StatusCode;
use serde_json::{Value, json};
use service::accounts::access::Scope;
use std::f64::consts::PI;
use std::time::Duration;
use support::runners::prompt;
use support::site::Site;

/// A site with a job that has succeeded; the address of its evaluations. Its model is of a Lambertian chip of 1 W and 1 mm², from few rays.
async fn with_model() -> (Site, String) {
    let (site, job) = Site::with_a_model().await;
    (site, format!("/v1/jobs/{job}/evaluations"))
}

fn plane(columns: usize, rows: usize) -> Value {
    json!({"center_mm": [0, 0, 1], "width_mm": 2.0, "height_mm": 2.0, "columns": columns, "rows": rows})
}

fn numbers(channel: &Value, name: &str) -> Vec<f64> {
    let rows = channel[name].as_array().unwrap();
    rows.iter().flat_map(|row| row.as_array().unwrap()).map(|value| value.as_f64().unwrap()).collect()
}

/// I = 1/π W/sr on the axis, E = 0.2394 W/mm² 1 mm above the chip, L = 1/π W/(mm² sr): within the noise of 5000 rays.
#[tokio::test(flavor = "multi_thread")]
async fn a_model_is_evaluated_as_its_closed_forms() {
    let (site, address) = with_model().await;
    let one = async |view: Value| {
        let reply = site.post(&address, &json!({"view": view, "light": "radiant"})).await;
        assert_eq!(reply.status, StatusCode::OK, "{reply:?}");
        assert_eq!(reply.header("content-type"), "application/json");
        let json = reply.json();
        assert_eq!(json["schema"], "urn:lampwright:evaluation:1");
        let channel = &json["channels"][0];
        (numbers(channel, "values"), numbers(channel, "bounds"), channel["unit"].as_str().unwrap().to_owned())
    };
    let (intensity, bounds, unit) = one(json!({"directions": [[0, 0, 2], [0, 0, -1]]})).await;
    assert!((intensity[0] * PI - 1.0).abs() < 0.1 && intensity[1] < 0.01 && unit == "W/sr", "{intensity:?}");
    assert_eq!(bounds, [0.0, 0.0]);
    let (irradiance, bounds, unit) = one(json!({"plane": plane(3, 3)})).await;
    assert!((irradiance[4] / 0.2394e6 - 1.0).abs() < 0.05 && unit == "W/m²", "{irradiance:?}");
    assert!(bounds.iter().zip(&irradiance).all(|(bound, value)| *bound > 0.0 && *bound < 1.1e-3 * value));
    let camera = json!({"eye_mm": [0, 0, 9], "width_mm": 2, "columns": 8, "rows": 8, "samples": 4});
    let (luminance, _, unit) = one(json!({ "camera": camera })).await;
    let lit: f64 = [27, 28, 35, 36].map(|cell: usize| luminance[cell]).iter().sum::<f64>() / 4.0;
    assert!((lit * 1e-6 * PI - 1.0).abs() < 0.15 && luminance[0] == 0.0 && unit == "W/(m² sr)", "{luminance:?}");
}

/// What is left out is as the command line has it: square cells, 64 of a plane in a row, 256 of a camera.
#[tokio::test(flavor = "multi_thread")]
async fn cells_are_square_where_nothing_is_said() {
    let (site, address) = with_model().await;
    for (view, size) in [
        (json!({"plane": {"center_mm": [0, 0, 1], "width_mm": 2}}), [64, 64]),
        (json!({"plane": {"center_mm": [0, 0, 1], "width_mm": 2, "height_mm": 0.5, "columns": 12}}), [12, 3]),
        (json!({"plane": {"center_mm": [0, 0, 1], "width_mm": 2, "height_mm": 1, "rows": 2}}), [64, 2]),
        (json!({"grid": {}}), [24, 37]),
        (json!({"grid": {"c_step_deg": 90}}), [4, 37]),
        (json!({"camera": {"eye_mm": [0, 0, 9], "width_mm": 2}}), [256, 256]),
        (json!({"camera": {"eye_mm": [0, 0, 9], "width_mm": 2, "columns": 7}}), [7, 7]),
    ] {
        let reply = site.post(&address, &json!({"view": view, "light": "radiant", "tolerance": 0.1})).await;
        assert_eq!(reply.status, StatusCode::OK, "{reply:?}");
        let rows = reply.json()["channels"][0]["values"].as_array().unwrap().clone();
        let [columns, count] = size;
        assert!(rows.len() == count && rows.iter().all(|row| row.as_array().unwrap().len() == columns), "{view}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn every_form_is_sent_and_the_same_again() {
    let (site, address) = with_model().await;
    for (format, media_type, begins) in [
        ("json", "application/json", "{"),
        ("csv", "text/csv", "column,row,x_mm"),
        ("tiff", "image/tiff", "II*\0"),
        ("svg", "image/svg+xml", "<svg"),
    ] {
        let asked = json!({"view": {"plane": plane(6, 5)}, "light": "color", "format": format});
        let reply = site.post(&address, &asked).await;
        assert_eq!((reply.status, reply.header("content-type")), (StatusCode::OK, media_type));
        assert!(reply.header("content-disposition").ends_with(&format!("filename=\"evaluation.{format}\"")));
        assert!(reply.body.starts_with(begins.as_bytes()), "{format}");
        assert!(site.post(&address, &asked).await.body == reply.body, "{format}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn what_cannot_be_answered_is_told() {
    let (site, address) = with_model().await;
    let with = |name: &str, value: Value| {
        let mut plane = plane(2, 2);
        plane[name] = value;
        json!({"view": {"plane": plane}})
    };
    let camera = |more: Value| {
        let mut camera = json!({"eye_mm": [0, 0, 9], "columns": 2, "rows": 2});
        camera.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        json!({"view": {"camera": camera}})
    };
    for (body, status, code, at) in [
        (json!({}), 422, "request.missing_field", "."),
        (json!({"view": {}}), 422, "request.wrong_type", "view"),
        (json!({"view": {"sphere": {}}}), 422, "request.wrong_type", "view"),
        (with("colour", json!(1)), 422, "request.unknown_field", "view.plane.colour"),
        (with("columns", json!(0)), 422, "evaluation.geometry", "view.plane.columns"),
        (with("columns", json!(-1)), 422, "request.wrong_type", "view.plane.columns"),
        (with("width_mm", json!(0)), 422, "evaluation.geometry", "view.plane.width_mm"),
        (with("up", json!([0, 0, 1])), 422, "evaluation.geometry", "view.plane.up"),
        (with("normal", json!([0, 0])), 422, "request.wrong_type", "view.plane.normal"),
        (camera(json!({})), 422, "evaluation.geometry", "view.camera.width_mm"),
        (camera(json!({"width_mm": 1, "field_deg": 1})), 422, "evaluation.geometry", "view.camera.width_mm"),
        (camera(json!({"field_deg": 200})), 422, "evaluation.geometry", "view.camera.field_deg"),
        (camera(json!({"width_mm": 1, "samples": 17})), 422, "evaluation.geometry", "view.camera.samples"),
        (json!({"view": {"directions": []}}), 422, "evaluation.directions", "view.directions"),
        (json!({"view": {"angles": [[0, 0]]}, "format": "svg"}), 422, "evaluation.no_picture", "format"),
        (json!({"view": {"angles": [[0, 0]]}, "tolerance": 1}), 422, "evaluation.tolerance", "tolerance"),
        (json!({"view": {"angles": [[0, 0]]}, "light": "infrared"}), 422, "request.wrong_type", "light"),
        (json!({"view": {"plane": plane(1024, 1024)}}), 422, "evaluation.too_large", ""),
        // As JSON has it; the numbers fit, the channels do not.
        (json!({"view": {"plane": plane(500, 500)}, "light": "spectrum"}), 422, "evaluation.too_large", ""),
    ] {
        let reply = site.post(&address, &body).await;
        reply.is_problem(status, code);
        assert_eq!(reply.json()["at"].as_str().unwrap_or_default(), at, "{body}");
    }
    let nobody = "/v1/jobs/0190b5a0-0000-7000-8000-000000000000/evaluations";
    site.post(nobody, &json!({"view": {"angles": [[0, 0]]}})).await.is_problem(404, "job.not_found");
    let other = Site::start(prompt()).await;
    let job = other.job(&other.ray_set().await).await;
    other.until_state(&job, "succeeded").await;
    let without = format!("/v1/jobs/{job}/evaluations");
    other.post(&without, &json!({"view": {"angles": [[0, 0]]}})).await.is_problem(404, "artifact.not_found");
}

/// Evaluations share their places with new rays: four of a tenant at once, and a place of one that has left is free again.
#[tokio::test(flavor = "multi_thread")]
async fn clients_that_leave_give_their_places_back() {
    let (site, address) = with_model().await;
    // Thousands of lines a cell: far more than 20 s of work.
    let camera = json!({"eye_mm": [0, 0, 9], "width_mm": 1, "columns": 512, "rows": 512, "samples": 16});
    let long = json!({"view": {"camera": camera}});
    let small = json!({"view": {"angles": [[0, 0]]}});
    // A short one may have the last place when a long one comes: that asks again.
    let held = async || {
        loop {
            let reply = site.post(&address, &long).await;
            if reply.status != StatusCode::SERVICE_UNAVAILABLE {
                return reply;
            }
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
    };
    let all = futures::future::join_all((0..4).map(|_| held()));
    let full = async {
        for _ in 0..600 {
            let reply = site.post(&address, &small).await;
            if reply.status == StatusCode::SERVICE_UNAVAILABLE {
                return reply;
            }
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
        panic!("four evaluations leave a place to the same tenant");
    };
    // The long ones are dropped as soon as they have taken their places.
    let refused = tokio::select! {
        refused = full => refused,
        _ = all => panic!("the long evaluations were too short"),
    };
    refused.is_problem(503, "service.busy");
    for _ in 0..600 {
        if site.post(&address, &small).await.status == StatusCode::OK {
            return;
        }
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    panic!("the places of clients that left are taken");
}

#[tokio::test(flavor = "multi_thread")]
async fn another_tenant_evaluates_nothing() {
    let (mut site, things) = crate::access::lab().await;
    let address = things.address("/v1/jobs/{id}/evaluations");
    let small = json!({"view": {"angles": [[0, 0]]}});
    site.key = Some(site.key_of("lab", &[Scope::JobsRead]).await);
    assert_eq!(site.post(&address, &small).await.status, StatusCode::OK);
    site.key = Some(site.key_of("shop", &Scope::OF_A_TENANT).await);
    site.post(&address, &small).await.is_problem(404, "job.not_found");
    site.key = Some(site.key_of("lab", &[Scope::UploadsRead]).await);
    site.post(&address, &small).await.is_problem(403, "access.scope_missing");
}
