//! What is said of a ray file as it is sent: it makes files readable that do not say themselves what they hold, is kept, and
//! holds for every job that says nothing else.

use axum::http::{Method, StatusCode};
use serde_json::{Value, json};
use service::jobs::worker::pipeline_runner;
use std::fmt::Write;
use support::packing::zip;
use support::rays;
use support::runners::prompt;
use support::site::{Reply, Site};

/// Position, direction, flux: from a square of 2 x 2, straight up and 45 degrees to four sides, 0.5 each. No unit, no W or lm.
fn rows(rays: u32) -> String {
    const SLANTED: [(f64, f64); 5] = [(0.0, 0.0), (0.5, 0.5), (-0.5, 0.5), (-0.5, -0.5), (0.5, -0.5)];
    let mut text = String::new();
    for ray in 0..rays {
        let (l, m) = SLANTED[ray as usize % 5];
        let n = f64::sqrt(1.0 - l * l - m * m);
        let (x, y) = (f64::from(ray % 40) / 20.0 - 1.0, f64::from(ray / 40 % 40) / 20.0 - 1.0);
        writeln!(text, "{x} {y} 0 {l} {m} {n:.9} 0.5").unwrap();
    }
    text
}

async fn send(site: &Site, query: &str, bytes: impl Into<Vec<u8>>) -> Reply {
    site.ask(Method::POST, &format!("/v1/ray-sets?name=led.csv{query}"), &[], bytes.into()).await
}

/// Verdict and remedy of one check of an inspection.
fn verdict<'a>(ray_set: &'a Value, check: &str) -> (&'a str, &'a str) {
    let checks = ray_set["inspection"]["checks"].as_array().unwrap();
    let found = checks.iter().find(|found| found["check"] == check).unwrap();
    (found["verdict"].as_str().unwrap(), found["remedy"].as_str().unwrap_or_default())
}

#[tokio::test(flavor = "multi_thread")]
async fn what_a_file_does_not_say_is_asked_for_before_a_job_and_can_be_said_with_it() {
    let site = Site::start(pipeline_runner()).await;
    let taken = send(&site, "", rows(1600)).await;
    assert_eq!(taken.status, StatusCode::CREATED, "{taken:?}");
    let ray_set = taken.ray_set();
    assert_eq!((&ray_set["declared"], &ray_set["inspection"]["verdict"]), (&json!({}), &json!("wrong")));
    for (check, field) in [("rays.length_unit", "length_unit"), ("rays.quantity", "quantity")] {
        let (verdict, remedy) = verdict(&ray_set, check);
        assert!(verdict == "wrong" && remedy.contains(field), "{check}: {verdict} {remedy}");
    }
    let job = async |channel: Value| {
        let mut channel = channel;
        channel["ray_set"] = json!(taken.id());
        site.post("/v1/jobs", &json!({ "channels": [channel] })).await
    };
    let refused = job(json!({})).await;
    refused.is_problem(422, "rays.unit_unknown");
    assert_eq!(refused.json()["at"], "channels[0].length_unit");
    let refused = job(json!({"length_unit": "in"})).await;
    refused.is_problem(422, "rays.quantity_unknown");
    assert_eq!(refused.json()["at"], "channels[0].quantity");
    let accepted = job(json!({"length_unit": "in", "quantity": "luminous"})).await;
    assert_eq!(accepted.status, StatusCode::ACCEPTED, "{accepted:?}");
    site.until_state(&accepted.id(), "succeeded").await;
    let report = site.get(&format!("/v1/jobs/{}/artifacts/report.json", accepted.id())).await.json();
    assert_eq!((&report["flux"]["luminous_lm"], &report["flux"]["radiant_w"]), (&json!(800.0), &Value::Null));
}

#[tokio::test(flavor = "multi_thread")]
async fn what_is_said_as_a_file_is_sent_holds_for_its_inspection_and_its_jobs() {
    let site = Site::start(pipeline_runner()).await;
    let sent = send(&site, "&length_unit=cm&quantity=luminous", rows(1600)).await;
    let ray_set = sent.ray_set();
    let declared = json!({"length_unit": "cm", "quantity": "luminous"});
    assert_eq!((&ray_set["declared"], &ray_set["header"]["length_unit"]), (&declared, &json!("cm")));
    assert_eq!(ray_set["inspection"]["flux"]["luminous_lm"], 800.0);
    assert_eq!(ray_set["inspection"]["origins_mm"]["min"], json!([-10.0, -10.0, 0.0]));
    assert_eq!(verdict(&ray_set, "rays.length_unit").0, "ok");
    assert_eq!(site.get(sent.header("location")).await.json(), ray_set);
    assert_eq!(site.get("/v1/ray-sets").await.json()["ray_sets"][0]["declared"], declared);
    let origins = async |channel: Value| {
        let job = site.post("/v1/jobs", &json!({ "channels": [channel] })).await;
        assert_eq!(job.status, StatusCode::ACCEPTED, "{job:?}");
        let ended = site.until_state(&job.id(), "succeeded").await;
        assert_eq!(ended["channels"], json!([channel]), "a job tells what was sent");
        let report = site.get(&format!("/v1/jobs/{}/artifacts/report.json", job.id())).await.json();
        assert_eq!(report["flux"]["luminous_lm"], 800.0);
        report["inputs"][0]["length_unit"].as_str().unwrap().to_owned()
    };
    assert_eq!(origins(json!({"ray_set": sent.id()})).await, "cm");
    // The channel's own word goes before, field by field.
    assert_eq!(origins(json!({"ray_set": sent.id(), "length_unit": "mm"})).await, "mm");
}

#[tokio::test(flavor = "multi_thread")]
async fn columns_that_cannot_be_told_are_asked_for() {
    let site = Site::start(prompt()).await;
    let numbered: String = rows(200).lines().map(|row| format!("7 {row} 1 1\n")).collect();
    let refused = send(&site, "", numbered.clone()).await;
    refused.is_problem(422, "columns.unnamed");
    let problem = refused.json();
    assert_eq!(problem["at"], "columns");
    assert!(problem["remedy"].as_str().unwrap().contains("columns=x,y,z,l,m,n,flux"), "{problem}");
    let columns = "ignored,x,y,z,l,m,n,luminous_flux,ignored,ignored";
    let sent = send(&site, &format!("&length_unit=mm&columns={columns}"), numbered.clone()).await;
    assert_eq!(sent.status, StatusCode::CREATED, "{sent:?}");
    assert_eq!(sent.ray_set()["inspection"]["flux"]["luminous_lm"], 100.0);
    assert_eq!(sent.ray_set()["declared"]["columns"], json!(columns.split(',').collect::<Vec<_>>()));
    let job = site.job(&sent.id()).await;
    site.until_state(&job, "succeeded").await;
    // Other columns in the channel: what was said with the file of its unit still holds.
    let other = json!(["ignored", "y", "x", "z", "m", "l", "n", "flux", "ignored", "ignored"]);
    let unclear = json!({"channels": [{"ray_set": sent.id(), "columns": other}]});
    let refused = site.post("/v1/jobs", &unclear).await;
    refused.is_problem(422, "rays.quantity_unknown");
    // Declared columns are read in place of a header line: the unit in its names is then unsaid.
    let named = format!("x_mm,y_mm,z_mm,l,m,n,lm\n{}", rows(200).replace(' ', ","));
    let sent = send(&site, "", named).await.id();
    let columns = json!(["x", "y", "z", "l", "m", "n", "luminous_flux"]);
    let refused = site.post("/v1/jobs", &json!({"channels": [{"ray_set": sent, "columns": columns}]})).await;
    refused.is_problem(422, "rays.unit_unknown");
    // What is no line of light is none in a job either, before anything is queued.
    let refused = site.post("/v1/jobs", &json!({"channels": [{"ray_set": sent, "columns": ["x", "y"]}]})).await;
    refused.is_problem(422, "columns.missing");
}

#[tokio::test(flavor = "multi_thread")]
async fn what_cannot_be_said_of_a_file_is_refused_at_the_parameter() {
    let site = Site::start(prompt()).await;
    let text = rows(9);
    for (query, code, at) in [
        ("&columns=x,y,z,u", "rays.column_unknown", "columns"),
        ("&columns=x,y,z", "columns.count", "columns"),
        ("&columns=x,y,z,l,m,flux,ignored", "columns.missing", "columns"),
        ("&columns=l,m,n,x,y,z,flux", "columns.directions", "columns"),
        ("&length_unit=yd", "request.wrong_type", "length_unit"),
        ("&quantity=cd", "request.wrong_type", "quantity"),
        ("&unit=mm", "request.unknown_field", "unit"),
    ] {
        let refused = send(&site, query, text.clone()).await;
        refused.is_problem(422, code);
        assert_eq!(refused.json()["at"], at, "{query}: {}", refused.json());
    }
    let binary = send(&site, "&columns=x,y,z,l,m,n,flux", rays::zemax(5)).await;
    binary.is_problem(422, "rays.columns_not_text");
    assert_eq!(binary.json()["at"], "columns");
    assert_eq!(site.get("/v1/ray-sets").await.json()["ray_sets"], json!([]));
    assert!(site.blobs().is_empty());
}

#[tokio::test(flavor = "multi_thread")]
async fn what_is_said_of_a_packed_file_holds_for_all_in_it() {
    let site = Site::start(prompt()).await;
    let ten = |first: &str| -> String { rows(50).lines().map(|row| format!("{first} {row} 1 1\n")).collect() };
    let (blue, red) = (ten("1"), ten("2"));
    let lamp = zip(&[("blue.csv", blue.as_bytes()), ("red.csv", red.as_bytes()), ("a.dat", &rays::zemax(5))]);
    let query = "&length_unit=mm&quantity=radiant&columns=ignored,x,y,z,l,m,n,flux,ignored,ignored";
    let taken = send(&site, query, lamp.clone()).await.json();
    let sets = taken["ray_sets"].as_array().unwrap();
    let told =
        |set: &Value| (set["name"].clone(), set["declared"]["quantity"].clone(), set["header"]["length_unit"].clone());
    let told: Vec<_> = sets.iter().map(told).collect();
    let of = |name: &str| (json!(name), json!("radiant"), json!("mm"));
    assert_eq!(told, [of("blue.csv"), of("red.csv")]);
    // A file with columns of its own is left out and says why; without a declaration it is those in columns.
    assert_eq!(taken["left_out"][0]["code"], "rays.columns_not_text");
    let taken = send(&site, "", lamp).await.json();
    assert_eq!(taken["ray_sets"][0]["name"], "a.dat");
    let codes: Vec<_> = taken["left_out"].as_array().unwrap().iter().map(|file| &file["code"]).collect();
    assert_eq!(codes, ["columns.unnamed"; 2]);
    let detail = taken["left_out"][0]["detail"].as_str().unwrap();
    assert!(detail.contains("columns=x,y,z,l,m,n,flux"), "{detail}");
}
