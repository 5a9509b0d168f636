//! What was noticed before a job began reaches whoever looks at the job alone: its notices, its report, its page.

use axum::http::{Method, StatusCode};
use serde_json::{Value, json};
use service::jobs::worker::pipeline_runner;
use support::packing::zip;
use support::rays;
use support::site::Site;

#[tokio::test(flavor = "multi_thread")]
async fn what_upload_spectrum_and_inspection_warn_of_is_told_by_the_job() {
    let site = Site::start(pipeline_runner()).await;
    let lamp = zip(&[("lamp/led.dat", &rays::zemax(3000)), ("lamp/blue half.txt", b"Measured elsewhere.")]);
    let sent = site.ask(Method::POST, "/v1/ray-sets?name=lamp.zip", &[], lamp).await;
    let ray_set = sent.id();
    // In micrometres, which the answer to the upload tells and nothing else does.
    let spectrum = site.ask(Method::POST, "/v1/spectra?name=led.txt", &[], "0.54 0\n0.55 1\n0.56 0\n").await.id();
    // A day later nobody has the answer to the upload any more.
    let known = site.get(&format!("/v1/ray-sets/{ray_set}")).await.json();
    assert_eq!(known["packed"]["left_out"], sent.json()["left_out"]);
    assert_eq!(known["packed"]["left_out"][0]["code"], "detect.not_rays");

    let channel = json!({"ray_set": ray_set, "name": "main", "spectrum": {"id": spectrum}});
    let queued = site.post("/v1/jobs", &json!({ "channels": [channel] })).await;
    assert_eq!(queued.status, StatusCode::ACCEPTED, "{queued:?}");
    let job = site.until_state(&queued.id(), "succeeded").await;
    let notices = job["notices"].as_array().unwrap();
    let told = |code: &str| {
        let of_code: Vec<&Value> = notices.iter().filter(|notice| notice["code"] == code).collect();
        assert_eq!(of_code.len(), 1, "{code}: {notices:?}");
        assert_eq!(of_code[0]["channel"], "main", "{code}");
        of_code[0]["message"].as_str().unwrap().to_owned()
    };
    assert!(told("container.left_out").contains("blue half.txt"), "{notices:?}");
    told("spectrum.micrometres");
    // All rays go along +Z, and 3000 are few.
    assert!(told("rays.focus").contains("collimated"));
    told("rays.noise");
    let inspected = known["inspection"]["checks"].as_array().unwrap();
    let warned = |check: &str| inspected.iter().any(|one| one["check"] == check && one["verdict"] == "notice");
    assert!(warned("rays.focus") && warned("rays.noise"), "{inspected:?}");

    let artifact = async |name: &str| site.get(&format!("/v1/jobs/{}/artifacts/{name}", queued.id())).await;
    assert_eq!(artifact("report.json").await.json()["notices"], job["notices"]);
    let page = String::from_utf8(artifact("README.txt").await.body).unwrap();
    for notice in notices {
        assert!(page.contains(&format!("- {}", notice["code"].as_str().unwrap())), "{page}");
    }

    // The same rays, sent alone: another report, so no equal job.
    let alone = site.ask(Method::POST, "/v1/ray-sets?name=lamp/led.dat", &[], rays::zemax(3000)).await.id();
    let channel = json!({"ray_set": alone, "name": "main", "spectrum": {"id": spectrum}});
    let other = site.post("/v1/jobs", &json!({ "channels": [channel] })).await;
    assert_eq!(other.status, StatusCode::ACCEPTED, "{other:?}");
}
