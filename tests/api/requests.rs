use axum::body::Body;
use axum::http::{Method, StatusCode};
use serde_json::{Value, json};
use service::storage::records::statement::sql;
use support::runners::{Gate, held, prompt};
use support::site::Site;

/// No request in this file may queue anything.
async fn nothing_queued(site: &Site) {
    assert!(site.rows(sql("SELECT id FROM jobs")).await.is_empty());
    assert!(site.rows(sql("SELECT job_id FROM job_inputs")).await.is_empty());
}

#[tokio::test(flavor = "multi_thread")]
async fn an_unknown_field_is_named_by_its_path() {
    let site = Site::start(prompt()).await;
    let id = site.ray_set().await;
    let cases = [
        (json!({"channels": [{"ray_set": id}], "option": {}}), "option"),
        (json!({"ray_sets": [id]}), "ray_sets"),
        (json!({"channels": [{"ray_set": id, "weight": 1}]}), "channels[0].weight"),
        (json!({"channels": [{"ray_set": id}], "options": {"hul": {}}}), "options.hul"),
        (json!({"channels": [{"ray_set": id}], "options": {"hull": {"max_edge": 1}}}), "options.hull.max_edge"),
        (
            json!({"channels": [{"ray_set": id}], "options": {"goniogram": {"zones": {"columns": 1, "rows": 1, "x": 1}}}}),
            "options.goniogram.zones.x",
        ),
    ];
    for (body, path) in cases {
        let reply = site.post("/v1/jobs", &body).await;
        reply.is_problem(422, "request.unknown_field");
        assert_eq!(reply.json()["at"], path, "{}", reply.json());
    }
    nothing_queued(&site).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_wrong_type_is_named_by_its_path() {
    let site = Site::start(prompt()).await;
    let id = site.ray_set().await;
    let cases = [
        (json!({"channels": id}), "channels"),
        (json!({"channels": [id]}), "channels[0]"),
        (json!({"channels": [[id]]}), "channels[0]"),
        (json!({"channels": [{"ray_set": 1}]}), "channels[0].ray_set"),
        (json!({"channels": [{"ray_set": id, "length_unit": "yd"}]}), "channels[0].length_unit"),
        (json!({"channels": [{"ray_set": id, "flux": {"radiant_w": "1"}}]}), "channels[0].flux.radiant_w"),
        (json!({"channels": [{"ray_set": id, "spectrum": {"nm_value": [[1]]}}]}), "channels[0].spectrum.nm_value[0]"),
        (json!({"channels": [{"ray_set": id}], "total": 5}), "total"),
        (json!({"channels": [{"ray_set": id}], "options": 1}), "options"),
        (json!({"channels": [{"ray_set": id}], "options": []}), "options"),
        (json!([[{ "ray_set": id }]]), "body"),
        (
            json!({"channels": [{"ray_set": id}], "options": {"goniogram": {"zones": [4, 4]}}}),
            "options.goniogram.zones",
        ),
        (json!({"channels": [{"ray_set": id}], "options": {"hull": {"resolution": "64"}}}), "options.hull.resolution"),
        (json!({"channels": [{"ray_set": id}], "options": {"hull": {"resolution": -1}}}), "options.hull.resolution"),
        (json!({"channels": [{"ray_set": id}], "options": {"hull": {"resolution": 1e99}}}), "options.hull.resolution"),
        (json!({"channels": [{"ray_set": id}], "options": {"hull": {"emission": "magic"}}}), "options.hull.emission"),
        (
            json!({"channels": [{"ray_set": id}], "options": {"rays": {"band_edges_nm": [380, "x"]}}}),
            "options.rays.band_edges_nm[1]",
        ),
        (json!({"channels": [{"ray_set": id}], "options": {"flux": {"smoothing": 1}}}), "options.flux.smoothing"),
        (
            json!({"channels": [{"ray_set": id}], "options": {"goniogram": {"nadir_axis": "Z"}}}),
            "options.goniogram.nadir_axis",
        ),
        (
            json!({"channels": [{"ray_set": id}], "options": {"artifacts": {"ies_edition": "2002"}}}),
            "options.artifacts.ies_edition",
        ),
    ];
    for (body, path) in cases {
        let reply = site.post("/v1/jobs", &body).await;
        reply.is_problem(422, "request.wrong_type");
        assert_eq!(reply.json()["at"], path, "{}", reply.json());
    }
    site.post("/v1/jobs", &json!({})).await.is_problem(422, "request.missing_field");
    let zones = json!({"channels": [{"ray_set": id}], "options": {"goniogram": {"zones": {"columns": 1}}}});
    site.post("/v1/jobs", &zones).await.is_problem(422, "request.missing_field");
    nothing_queued(&site).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn what_no_ray_set_could_make_right_is_refused_at_once() {
    let site = Site::start(prompt()).await;
    let id = site.ray_set().await;
    let cases = [
        ("rays.band_edges_nm", json!([500.0]), json!([400.0, 500.0])),
        ("rays.band_edges_nm", json!([500.0, 400.0]), json!([0.1, 0.2, 9000.0])),
        ("rays.band_edges_nm", json!([0.0, 400.0]), json!(null)),
        ("hull.resolution", json!(3), json!(4)),
        ("hull.resolution", json!(257), json!(256)),
        ("hull.max_edge_mm", json!(0.0), json!(1e-9)),
        ("hull.max_edge_mm", json!(-1), json!(1)),
        ("goniogram.zones.columns", json!({"columns": 0, "rows": 1}), json!({"columns": 1, "rows": 1})),
        ("goniogram.zones.rows", json!({"columns": 1, "rows": 33}), json!({"columns": 32, "rows": 32})),
        ("goniogram.gamma_step_deg", json!(0.4), json!(0.5)),
        ("goniogram.gamma_step_deg", json!(7), json!(7.5)),
        ("goniogram.gamma_step_deg", json!(36), json!(30)),
        ("goniogram.c_step_deg", json!(0.5), json!(1)),
        ("goniogram.c_step_deg", json!(7), json!(22.5)),
        ("goniogram.c_step_deg", json!(120), json!(90)),
    ];
    let with = |path: &str, value: &Value| {
        let mut parts = path.split('.');
        let (stage, option) = (parts.next().unwrap(), parts.next().unwrap());
        json!({"channels": [{"ray_set": id}], "options": {stage: {option: value}}})
    };
    for (path, wrong, _) in &cases {
        let reply = site.post("/v1/jobs", &with(path, wrong)).await;
        assert!(reply.json()["code"].as_str().unwrap().starts_with("options."), "{wrong}");
        assert_eq!(reply.status, StatusCode::UNPROCESSABLE_ENTITY, "{wrong}");
        assert_eq!(reply.json()["at"], format!("options.{path}"), "{wrong}");
    }
    let axes = json!({"channels": [{"ray_set": id}], "options": {"goniogram": {"nadir_axis": "-Z", "c0_axis": "+Z"}}});
    assert_eq!(site.post("/v1/jobs", &axes).await.json()["at"], "options.goniogram.c0_axis");
    for channels in [json!([]), json!(vec![json!({"ray_set": id, "flux": {"radiant_w": 1}}); 9])] {
        let reply = site.post("/v1/jobs", &json!({ "channels": channels })).await;
        reply.is_problem(422, "request.out_of_range");
        assert_eq!(reply.json()["at"], "channels");
    }
    nothing_queued(&site).await;
    // The nearest right value is taken.
    for (path, _, right) in &cases {
        assert_eq!(site.post("/v1/jobs", &with(path, right)).await.status, StatusCode::ACCEPTED, "{path} {right}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_body_that_is_not_json_is_said_to_be_none() {
    let site = Site::start(prompt()).await;
    let post = async |headers: &[(&str, &str)], body: &str| {
        site.ask(Method::POST, "/v1/jobs", headers, body.to_owned()).await.problem()
    };
    let problem = |status: u16, code: &str| (status, code.to_owned());
    let json = [("content-type", "application/json")];
    for broken in ["", "{", "{]", "[1,", "nul", "{} {}", "{\"channels\": []} x", "{}\u{feff}"] {
        assert_eq!(post(&json, broken).await, problem(400, "request.malformed_json"), "{broken:?}");
    }
    assert_eq!(post(&[], "{}").await, problem(415, "request.media_type"));
    assert_eq!(post(&[("content-type", "text/plain")], "{}").await, problem(415, "request.media_type"));
    let with_charset = [("content-type", "Application/JSON; charset=utf-8")];
    assert_eq!(post(&with_charset, "{}").await, problem(422, "request.missing_field"));
    assert_eq!(post(&json, &" ".repeat(65_537)).await, problem(413, "request.body_too_large"));
    nothing_queued(&site).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn what_is_not_there_is_not_found() {
    let site = Site::start(prompt()).await;
    let nobody = "0190b5a0-0000-7000-8000-000000000000";
    for id in [nobody, "x", "%20", "..%2f..%2fservice.db", "'; DROP TABLE jobs; --".replace(' ', "%20").as_str()] {
        let job = format!("/v1/jobs/{id}");
        site.get(&job).await.is_problem(404, "job.not_found");
        site.delete(&job).await.is_problem(404, "job.not_found");
        site.post(&format!("{job}/cancel"), &json!({})).await.is_problem(404, "job.not_found");
        site.get(&format!("{job}/artifacts")).await.is_problem(404, "job.not_found");
        site.get(&format!("{job}/artifacts/a/b")).await.is_problem(404, "job.not_found");
        site.get(&format!("{job}/model.zip")).await.is_problem(404, "job.not_found");
        site.get(&format!("/v1/ray-sets/{id}")).await.is_problem(404, "ray_set.not_found");
        site.delete(&format!("/v1/ray-sets/{id}")).await.is_problem(404, "ray_set.not_found");
        site.get(&format!("/v1/spectra/{id}")).await.is_problem(404, "spectrum.not_found");
        site.delete(&format!("/v1/spectra/{id}")).await.is_problem(404, "spectrum.not_found");
    }
    site.post("/v1/jobs", &json!({ "channels": [{"ray_set": nobody}] })).await.is_problem(404, "ray_set.not_found");
    // One that is there does not help one that is not, and leaves no half of a job.
    let id = site.ray_set().await;
    site.post("/v1/jobs", &json!({ "channels": [{"ray_set": id}, {"ray_set": nobody}] }))
        .await
        .is_problem(404, "ray_set.not_found");
    nothing_queued(&site).await;
    for path in ["/v1", "/v1/job", "/v2/jobs", "/v1/job/", "/docs/no.js", "/docs/../Cargo.toml"] {
        site.get(path).await.is_problem(404, "request.not_found");
    }
    site.get("/v1/jobs/%ff").await.is_problem(400, "request.malformed_path");
}

/// PostgreSQL keeps no such text and looks for none: without a word of ours it would be a store that does not answer.
#[tokio::test(flavor = "multi_thread")]
async fn the_character_that_no_text_may_hold_is_refused_wherever_it_comes() {
    let site = Site::start(prompt()).await;
    site.get("/v1/jobs/%00").await.is_problem(400, "request.malformed_path");
    site.get("/v1/jobs?after=%00").await.is_problem(422, "request.null_character");
    site.post("/v1/webhooks", &json!({ "url": "https://a.example/", "description": "\0" }))
        .await
        .is_problem(422, "request.null_character");
    site.post("/v1/jobs", &json!({ "channels": [{ "ray_set": "x", "name": "a\0" }] }))
        .await
        .is_problem(422, "request.null_character");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_method_that_is_not_there_names_those_that_are() {
    let site = Site::start(prompt()).await;
    let cases = [
        (Method::PUT, "/v1/ray-sets", "GET,HEAD,POST"),
        (Method::PATCH, "/v1/jobs", "GET,HEAD,POST"),
        (Method::POST, "/v1/jobs/x", "DELETE,GET,HEAD"),
        (Method::GET, "/v1/jobs/x/cancel", "POST"),
        (Method::DELETE, "/v1/jobs/x/artifacts", "GET,HEAD"),
        (Method::POST, "/v1/jobs/x/model.zip", "GET,HEAD"),
        (Method::POST, "/healthz", "GET,HEAD"),
        (Method::POST, "/openapi.json", "GET,HEAD"),
    ];
    for (method, path, allow) in cases {
        let reply = site.ask(method, path, &[], Body::empty()).await;
        reply.is_problem(405, "request.method_not_allowed");
        let mut allowed: Vec<&str> = reply.header("allow").split(',').map(str::trim).collect();
        allowed.sort_unstable();
        assert_eq!(allowed.join(","), allow, "{path}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_query_is_held_to_its_fields() {
    let gate = Gate::new();
    let site = Site::start(held(&gate)).await;
    for list in ["/v1/jobs", "/v1/ray-sets", "/v1/spectra"] {
        for (query, code) in [
            ("limit=0", "request.out_of_range"),
            ("limit=101", "request.out_of_range"),
            ("limit=x", "request.wrong_type"),
            ("limit=-1", "request.wrong_type"),
            ("Limit=1", "request.unknown_field"),
        ] {
            site.get(&format!("{list}?{query}")).await.is_problem(422, code);
        }
        let last = "0190b5a0-0000-7000-8000-000000000000";
        assert_eq!(site.get(&format!("{list}?limit=100&after={last}")).await.status, StatusCode::OK);
    }
    site.get("/v1/jobs?state=done").await.is_problem(422, "request.wrong_type");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_request_keeps_the_name_it_came_with() {
    let site = Site::start(prompt()).await;
    let named = site.ask(Method::GET, "/healthz", &[("x-request-id", "from-a-proxy-7")], Body::empty()).await;
    assert_eq!(named.header("x-request-id"), "from-a-proxy-7");
    let (one, two) = (site.get("/healthz").await, site.get("/healthz").await);
    assert_ne!(one.header("x-request-id"), two.header("x-request-id"));
}
