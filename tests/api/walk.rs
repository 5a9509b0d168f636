use axum::http::StatusCode;
use serde_json::json;
use service::storage::parts::PART_BYTES;
use service::storage::records::statement::sql;
use support::rays;
use support::runners::{Gate, held, pattern, prompt, sha256};
use support::site::Site;

#[tokio::test(flavor = "multi_thread")]
async fn a_ray_file_becomes_artifacts() {
    let gate = Gate::new();
    let site = Site::start(held(&gate)).await;
    let file = rays::zemax(1000);

    let uploaded = site.upload(file.clone()).await;
    assert_eq!(uploaded.status, StatusCode::CREATED);
    let ray_set = uploaded.ray_set();
    let id = uploaded.id();
    assert_eq!(uploaded.header("location"), format!("/v1/ray-sets/{id}"));
    assert_eq!(ray_set["name"], "led.dat");
    assert_eq!(ray_set["byte_count"], file.len());
    assert_eq!(ray_set["sha256"], sha256(&file));
    assert_eq!(ray_set["header"]["ray_count"], 1000);
    assert_eq!(site.get(uploaded.header("location")).await.json(), ray_set);
    assert_eq!(site.blobs(), [format!("ray-sets/{id}/000000")]);

    let options =
        json!({"hull": {"resolution": 32}, "goniogram": {"zones": {"columns": 2, "rows": 3}, "c0_axis": "+X"}});
    let accepted = site.post("/v1/jobs", &json!({"channels": [{"ray_set": id}], "options": options})).await;
    assert_eq!(accepted.status, StatusCode::ACCEPTED);
    let job = accepted.id();
    assert_eq!(accepted.header("location"), format!("/v1/jobs/{job}"));
    assert_eq!(accepted.header("retry-after"), "1");

    let running = site.until(&job, |job| job["stage"] == "flux").await;
    assert_eq!(running["state"], "running");
    assert_eq!(running["attempt"], 1);
    assert_eq!(running["options"]["hull"]["resolution"], 32);
    assert_eq!(running["options"]["goniogram"]["zones"], json!({"columns": 2, "rows": 3}));
    assert_eq!(running["links"]["cancel"], format!("/v1/jobs/{job}/cancel"));
    assert_eq!(running["links"]["zip"], json!(null));
    let stages: Vec<f64> =
        running["stages"].as_array().unwrap().iter().map(|stage| stage["progress"].as_f64().unwrap()).collect();
    assert_eq!(stages.len(), 6);
    assert!(stages[0] == 1.0 && stages[1] == 1.0 && (stages[2] - 0.5).abs() < 1e-9 && stages[3] == 0.0, "{stages:?}");
    let progress = running["progress"].as_f64().unwrap();
    assert!(progress > 0.0 && progress < 1.0);
    assert!(site.get(&format!("/v1/jobs/{job}/artifacts")).await.json()["artifacts"].as_array().unwrap().is_empty());
    site.get(&format!("/v1/jobs/{job}/model.zip")).await.is_problem(404, "artifact.not_found");

    gate.open();
    let done = site.until_state(&job, "succeeded").await;
    assert_eq!(done["progress"], 1.0);
    assert_eq!(done["problem"], json!(null));
    assert_eq!(done["links"]["ray_sets"], json!([format!("/v1/ray-sets/{id}")]));
    let times: Vec<i64> = ["created_ms", "started_ms", "finished_ms"].map(|time| done[time].as_i64().unwrap()).into();
    assert!(times.is_sorted(), "{times:?}");

    let list = site.get(done["links"]["artifacts"].as_str().unwrap()).await.json();
    let names: Vec<&str> = list["artifacts"].as_array().unwrap().iter().map(|a| a["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["read.txt", "ies/total \"ü\".ies", "empty.csv"]);
    assert_eq!(list["zip"]["href"], done["links"]["zip"]);
    for artifact in list["artifacts"].as_array().unwrap().iter().chain([&list["zip"]]) {
        let got = site.get(artifact["href"].as_str().unwrap()).await;
        assert_eq!(got.status, StatusCode::OK);
        assert_eq!(got.body.len(), artifact["byte_count"].as_u64().unwrap() as usize);
        assert_eq!(sha256(&got.body), artifact["sha256"].as_str().unwrap());
        assert_eq!(got.header("content-type"), artifact["media_type"].as_str().unwrap());
        assert_eq!(got.header("etag"), format!("\"{}\"", artifact["sha256"].as_str().unwrap()));
    }
    // What the runner read through the stored parts is what was sent.
    let read = site.get(list["artifacts"][0]["href"].as_str().unwrap()).await;
    let digest = sha256(&file);
    assert_eq!(String::from_utf8(read.body).unwrap(), format!("led.dat {digest} {digest}\n"));
    assert_eq!(site.get(list["artifacts"][1]["href"].as_str().unwrap()).await.body, pattern());
    assert_eq!(gate.begun(), 1);
    // One attempt, one fence, nothing else stored.
    assert_eq!(site.blobs().len(), 5);
    assert!(site.blobs().iter().filter(|blob| blob.starts_with(&format!("artifacts/{job}/1/"))).count() == 4);

    assert_eq!(site.delete(&format!("/v1/jobs/{job}")).await.status, StatusCode::NO_CONTENT);
    site.get(&format!("/v1/jobs/{job}")).await.is_problem(404, "job.not_found");
    site.get(list["zip"]["href"].as_str().unwrap()).await.is_problem(404, "job.not_found");
    assert_eq!(site.delete(&format!("/v1/ray-sets/{id}")).await.status, StatusCode::NO_CONTENT);
    assert!(site.blobs().is_empty(), "{:?}", site.blobs());
    for table in ["SELECT 1 FROM jobs", "SELECT 1 FROM artifacts", "SELECT 1 FROM parts", "SELECT 1 FROM job_inputs"] {
        assert!(site.rows(sql(table)).await.is_empty(), "{table}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn many_parts_are_read_as_one_file() {
    let site = Site::start(prompt()).await;
    let file = rays::zemax(700_000);
    let id = site.upload(file.clone()).await.id();
    assert_eq!(site.blobs().len(), file.len().div_ceil(PART_BYTES));
    let job = site.job(&id).await;
    site.until_state(&job, "succeeded").await;
    let read = site.get(&format!("/v1/jobs/{job}/artifacts/read.txt")).await;
    let digest = sha256(&file);
    assert_eq!(String::from_utf8(read.body).unwrap(), format!("led.dat {digest} {digest}\n"));
}

#[tokio::test(flavor = "multi_thread")]
async fn what_is_submitted_from_within_goes_the_same_way() {
    let site = Site::start(prompt()).await;
    let service = site.service.as_ref().unwrap();
    assert!(service.is_empty().await.unwrap());
    let file = rays::zemax(50);
    let submitted = service.submit("built in.dat", file.as_slice()).await.unwrap().pop().unwrap();
    assert!(!service.is_empty().await.unwrap());
    let job = site.until_state(&submitted.job, "succeeded").await;
    assert_eq!(job["channels"], json!([{ "ray_set": submitted.ray_set }]));
    let ray_set = site.get(&format!("/v1/ray-sets/{}", submitted.ray_set)).await.json();
    assert_eq!((ray_set["name"].as_str(), ray_set["sha256"].as_str()), (Some("built in.dat"), Some(&*sha256(&file))));
}

#[tokio::test(flavor = "multi_thread")]
async fn two_ray_sets_make_one_source() {
    let site = Site::start(prompt()).await;
    let ids = [site.upload(rays::zemax(5)).await.id(), site.upload(rays::zemax(6)).await.id()];
    let channels = json!([{ "ray_set": ids[0] }, { "ray_set": ids[1] }]);
    let job = site.post("/v1/jobs", &json!({ "channels": channels })).await.id();
    assert_eq!(site.until_state(&job, "succeeded").await["channels"], channels);
    let read = String::from_utf8(site.get(&format!("/v1/jobs/{job}/artifacts/read.txt")).await.body).unwrap();
    let digests: Vec<&str> = read.lines().map(|line| line.split(' ').nth(1).unwrap()).collect();
    assert_eq!(digests, [sha256(&rays::zemax(5)), sha256(&rays::zemax(6))]);
}
