//! Evaluations as jobs: the file that one at once would be, larger ones, cancellation, restarts, a model that is deleted, walls.

use axum::body::Body;
use axum::http::{Method, StatusCode};
use futures::StreamExt;
use pipeline::{EvaluationForm, EvaluationRequest, Limits, NoProgress, View, evaluate, read_model};
use serde_json::{Value, json};
use service::Config;
use service::accounts::access::Scope;
use support::runners::{Gate, held, model_files, prompt};
use support::site::Site;

const ADDRESS: &str = "/v1/evaluations";

/// A site with a job that has succeeded, and the job. Its model is of a Lambertian chip of 1 W, from few rays.
async fn with_model() -> (Site, String) {
    Site::with_a_model_as(one_at_a_time).await
}

fn one_at_a_time(config: Config) -> Config {
    Config { concurrency: 1, ..config }
}

/// 1440 x 361 numbers: more than are answered at once.
fn large() -> Value {
    json!({"view": {"grid": {"c_step_deg": 0.25, "gamma_step_deg": 0.5}}, "format": "tiff"})
}

/// Thousands of lines a cell: longer than any test waits.
fn endless() -> Value {
    let camera = json!({"eye_mm": [0, 0, 9], "width_mm": 1, "columns": 4096, "rows": 4096, "samples": 16});
    json!({"view": {"camera": camera}})
}

async fn queue(site: &Site, job: &str, evaluation: &Value) -> String {
    let reply = site.post(ADDRESS, &json!({ "job": job, "evaluation": evaluation })).await;
    assert_eq!(reply.status, StatusCode::ACCEPTED, "{reply:?}");
    assert_eq!(reply.header("location"), format!("/v1/jobs/{}", reply.id()));
    reply.id()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_job_gives_the_file_that_an_answer_at_once_would_be_and_larger_ones() {
    let (site, job) = with_model().await;
    let small =
        json!({"view": {"plane": {"center_mm": [0.0, 0.0, 1.0], "width_mm": 2.0, "columns": 8}}, "format": "csv"});
    let at_once = site.post(&format!("/v1/jobs/{job}/evaluations"), &small).await;
    let id = queue(&site, &job, &small).await;
    let ended = site.until_state(&id, "succeeded").await;
    assert_eq!((&ended["evaluation"]["job"], &ended["evaluation"]["evaluation"]), (&json!(job), &small));
    assert_eq!(
        (&ended["channels"], &ended["progress"], &ended["links"]["zip"]),
        (&json!([]), &json!(1.0), &Value::Null)
    );
    assert_eq!(ended["stages"], json!([{"name": "model", "progress": 1.0}]));
    let files = site.get(&format!("/v1/jobs/{id}/artifacts")).await.json();
    assert_eq!((files["artifacts"].as_array().unwrap().len(), &files["zip"]), (1, &Value::Null));
    let file = site.get(&format!("/v1/jobs/{id}/artifacts/evaluation.csv")).await;
    assert_eq!((file.status, file.header("content-type")), (StatusCode::OK, "text/csv"));
    assert!(at_once.status == StatusCode::OK && file.body == at_once.body);

    let refused = site.post(&format!("/v1/jobs/{job}/evaluations"), &large()).await;
    refused.is_problem(422, "evaluation.too_large");
    assert!(refused.json()["remedy"].as_str().unwrap().contains("POST /v1/evaluations"), "{refused:?}");
    let id = queue(&site, &job, &large()).await;
    site.until_state(&id, "succeeded").await;
    let file = site.get(&format!("/v1/jobs/{id}/artifacts/evaluation.tiff")).await;
    let [emitter, goniograms] = model_files();
    let model = read_model(emitter, goniograms, &Limits::default()).unwrap();
    let request = EvaluationRequest::of(View::Grid { c_step_deg: 0.25, gamma_step_deg: 0.5 });
    assert!(file.body == evaluate(&model, &request, EvaluationForm::Tiff, &NoProgress).unwrap().bytes);
    assert_eq!(ended["options"], Value::Null, "it is built of nothing");
    // An evaluation is no model, and says whose it is of.
    let told = site.post(&format!("/v1/jobs/{id}/evaluations"), &small).await;
    told.is_problem(404, "evaluation.no_model");
    assert!(told.json()["remedy"].as_str().unwrap().contains(&job), "{told:?}");
    for asked in ["rays?count=9", "adapters/blender", "model.zip", "artifacts/emitter.glb"] {
        site.get(&format!("/v1/jobs/{id}/{asked}")).await.is_problem(404, "evaluation.no_model");
    }
    site.post(ADDRESS, &json!({ "job": id, "evaluation": small })).await.is_problem(404, "evaluation.no_model");
    site.get(&format!("/v1/jobs/{id}/artifacts/evaluation.svg")).await.is_problem(404, "artifact.not_found");
    // Lists tell them from models.
    let listed = async |query: &str| {
        let page = site.get(&format!("/v1/jobs?{query}")).await.json();
        page["jobs"].as_array().unwrap().iter().map(|job| job["id"].clone()).collect::<Vec<Value>>()
    };
    assert_eq!(listed("evaluation=false").await, [json!(job)]);
    assert_eq!(listed("evaluation=true&state=succeeded&limit=1").await, [json!(id)]);
    assert_eq!((listed("evaluation=true").await.len(), listed("").await.len()), (2, 3));
}

#[tokio::test(flavor = "multi_thread")]
async fn an_equal_evaluation_is_computed_once_and_a_key_makes_one_job() {
    let (site, job) = with_model().await;
    let body = json!({ "job": job, "evaluation": large() });
    let first = site.post(ADDRESS, &body).await;
    site.until_state(&first.id(), "succeeded").await;
    let again = site.post(ADDRESS, &body).await;
    assert_eq!((again.status, again.id(), &again.json()["reused"]), (StatusCode::OK, first.id(), &json!(true)));
    let anew = json!({ "job": job, "evaluation": large(), "reuse": false }).to_string();
    let headers = [("content-type", "application/json"), ("idempotency-key", "once")];
    let keyed = async |body: &str| site.ask(Method::POST, ADDRESS, &headers, body.to_owned()).await;
    let (made, repeated) = (keyed(&anew).await, keyed(&anew).await);
    assert!(made.id() != first.id() && repeated.id() == made.id());
    keyed(&json!({ "job": job, "evaluation": endless() }).to_string()).await.is_problem(422, "idempotency.key_reused");
    // What is left out is as if its default were said, the light that the model knows included; views and numbers are compared, not words.
    let grid = json!({"grid": {"c_step_deg": 15, "gamma_step_deg": 5.0}});
    let in_full = json!({"view": grid, "light": "luminous", "tolerance": 0.001, "format": "json"});
    let in_short = site.post(ADDRESS, &json!({ "job": job, "evaluation": {"view": {"grid": {}}} })).await;
    let again = site.post(ADDRESS, &json!({ "job": job, "evaluation": in_full })).await;
    assert_eq!((again.status, again.id()), (StatusCode::OK, in_short.id()));
    // So it is for who has taken all places with new rays of this model.
    let mut open = Vec::new();
    while site.get(&format!("/v1/jobs/{job}/rays?count=1")).await.status == StatusCode::OK {
        assert!(open.len() < 100, "no place is ever refused");
        let endless = site.begin(&format!("/v1/jobs/{job}/rays?count=1000000000000")).await;
        let mut body = endless.into_body().into_data_stream();
        assert!(!body.next().await.unwrap().unwrap().is_empty());
        open.push(body);
    }
    let again = site.post(ADDRESS, &json!({ "job": job, "evaluation": {"view": {"grid": {}}} })).await;
    assert_eq!((again.status, again.id()), (StatusCode::OK, in_short.id()));
    drop(open);
    // Another form is another evaluation.
    let mut other = body.clone();
    other["evaluation"]["format"] = json!("csv");
    assert_eq!(site.post(ADDRESS, &other).await.status, StatusCode::ACCEPTED);
}

#[tokio::test(flavor = "multi_thread")]
async fn what_cannot_be_computed_is_told_at_once_or_by_the_job() {
    let (site, job) = with_model().await;
    let plane = |rows: usize| json!({"center_mm": [0, 0, 1], "width_mm": 1, "columns": 4096, "rows": rows});
    let aslant = json!({"center_mm": [0, 0, 1], "width_mm": 1, "up": [0, 0, 1]});
    for (evaluation, code) in [
        (json!({"view": {"plane": plane(4097)}}), "evaluation.geometry"),
        (
            json!({"view": {"grid": {"c_step_deg": 360.0 / 4096.0, "gamma_step_deg": 180.0 / 4096.0}}}),
            "evaluation.too_large",
        ),
        (json!({"view": {"camera": {"eye_mm": [0, 0, 0], "width_mm": 1}}}), "evaluation.geometry"),
        (json!({"view": {"camera": {"eye_mm": [0, 0, 9], "width_mm": 1, "samples": 17}}}), "evaluation.geometry"),
        (json!({"view": {"directions": [[0, 0, 0]]}}), "evaluation.geometry"),
        (json!({"view": {"angles": [[0, 0]]}, "format": "svg"}), "evaluation.no_picture"),
        // What the model tells: its frame, and how many bands it has.
        (json!({"view": {"plane": aslant}}), "evaluation.geometry"),
        (json!({"view": {"plane": plane(4096)}, "light": "spectrum"}), "evaluation.too_large"),
        (json!({"view": {"angles": [[0, 0]]}, "tolerance": 1}), "evaluation.tolerance"),
        (json!({"view": {"directions": []}}), "evaluation.directions"),
        (json!({"view": {"camera": {"eye_mm": [0, 0, 9]}}}), "evaluation.geometry"),
        (json!({"view": {"angles": [[0, 0]]}, "colour": 1}), "request.unknown_field"),
    ] {
        site.post(ADDRESS, &json!({ "job": job, "evaluation": evaluation })).await.is_problem(422, code);
    }
    let timed = json!({ "job": job, "evaluation": large(), "timeout_s": 0 });
    site.post(ADDRESS, &timed).await.is_problem(422, "request.out_of_range");
    let nobody = json!({ "job": "0190b5a0-0000-7000-8000-000000000000", "evaluation": large() });
    site.post(ADDRESS, &nobody).await.is_problem(404, "job.not_found");
}

#[tokio::test(flavor = "multi_thread")]
async fn an_evaluation_goes_on_after_a_restart_and_ends_when_it_is_cancelled() {
    let (mut site, job) = with_model().await;
    let id = queue(&site, &job, &endless()).await;
    let begun = site.until(&id, |job| job["progress"].as_f64() > Some(0.0)).await;
    assert_eq!((&begun["state"], &begun["attempt"], &begun["stage"]), (&json!("running"), &json!(1), &json!("model")));
    site.kill().await;
    site.restart(prompt()).await;
    site.until(&id, |job| job["attempt"] == 2 && job["state"] == "running").await;
    assert_eq!(site.post(&format!("/v1/jobs/{id}/cancel"), &json!({})).await.status, StatusCode::ACCEPTED);
    site.until_state(&id, "cancelled").await;
    assert!(site.get(&format!("/v1/jobs/{id}/artifacts")).await.json()["artifacts"].as_array().unwrap().is_empty());
}

#[tokio::test(flavor = "multi_thread")]
async fn an_evaluation_whose_model_is_deleted_before_it_begins_says_so() {
    let (mut site, job) = with_model().await;
    let ray_set = site.ray_set().await;
    site.kill().await;
    let gate = Gate::new();
    site.restart(held(&gate)).await;
    // One job runs at a time, so that the evaluation waits.
    let other =
        site.post("/v1/jobs", &json!({"channels": [{"ray_set": ray_set, "name": "other"}], "reuse": false})).await;
    site.until_state(&other.id(), "running").await;
    let id = queue(&site, &job, &large()).await;
    assert!(site.delete(&format!("/v1/jobs/{job}")).await.status.is_success());
    gate.open();
    let problem = &site.until_state(&id, "failed").await["problem"];
    assert_eq!(problem["code"], "evaluation.model_gone");
    assert!(problem["detail"].as_str().unwrap().contains(&job), "{problem}");
}

#[tokio::test(flavor = "multi_thread")]
async fn another_tenant_evaluates_nothing_and_a_reader_queues_nothing() {
    let (mut site, things) = crate::access::lab().await;
    let body = json!({ "job": things.address("/v1/jobs/{id}").split('/').nth(3).unwrap(), "evaluation": large() });
    site.key = Some(site.key_of("shop", &Scope::OF_A_TENANT).await);
    site.post(ADDRESS, &body).await.is_problem(404, "job.not_found");
    site.key = Some(site.key_of("lab", &[Scope::JobsRead]).await);
    site.post(ADDRESS, &body).await.is_problem(403, "access.scope_missing");
    site.key = Some(site.key_of("lab", &[Scope::JobsWrite, Scope::JobsRead]).await);
    let queued = site.post(ADDRESS, &body).await;
    assert_eq!(queued.status, StatusCode::ACCEPTED, "{queued:?}");
    site.until_state(&queued.id(), "succeeded").await;
    let file = format!("/v1/jobs/{}/artifacts/evaluation.tiff", queued.id());
    site.key = Some(site.key_of("shop", &Scope::OF_A_TENANT).await);
    site.ask(Method::GET, &file, &[], Body::empty()).await.is_problem(404, "job.not_found");
}
