use axum::http::StatusCode;
use serde_json::Value;
use service::http::openapi;
use std::collections::BTreeSet;
use support::runners::prompt;
use support::site::Site;

const COMMITTED: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/openapi/openapi.json");

#[test]
fn the_committed_contract_is_the_generated_one() {
    let generated = openapi();
    if std::env::var_os("LAMPWRIGHT_WRITE_OPENAPI").is_some() {
        std::fs::write(COMMITTED, &generated).unwrap();
    }
    let committed = std::fs::read_to_string(COMMITTED).unwrap_or_default();
    assert!(committed == generated, "openapi/openapi.json is stale: run this test with LAMPWRIGHT_WRITE_OPENAPI=1");
}

/// Every operation of the contract, by name.
const OPERATIONS: [&str; 43] = [
    "adapt_model",
    "append_to_upload",
    "cancel_job",
    "change_webhook",
    "combine_models",
    "create_job",
    "create_upload",
    "create_webhook",
    "delete_job",
    "delete_ray_set",
    "delete_spectrum",
    "delete_upload",
    "delete_webhook",
    "draw_rays",
    "evaluate_model",
    "get_artifact",
    "get_far_field_drawing",
    "get_job",
    "get_origins_drawing",
    "get_ray_set",
    "get_spectrum",
    "get_upload",
    "get_webhook",
    "get_zip",
    "health",
    "ingest_ray_set",
    "list_artifacts",
    "list_deliveries",
    "list_jobs",
    "list_ray_sets",
    "list_spectra",
    "list_uploads",
    "list_webhooks",
    "metrics",
    "ping_webhook",
    "queue_evaluation",
    "ready",
    "redeliver",
    "rotate_webhook_secret",
    "upload_offset",
    "upload_ray_set",
    "upload_spectrum",
    "watch_job",
];

#[test]
fn the_contract_says_how_everything_can_fail() {
    let contract: Value = serde_json::from_str(&openapi()).unwrap();
    let mut operations = BTreeSet::new();
    for (path, item) in contract["paths"].as_object().unwrap() {
        assert!(!path.contains('*'), "{path}");
        for (method, operation) in item.as_object().unwrap() {
            operations.insert(operation["operationId"].as_str().unwrap().to_owned());
            for (status, response) in operation["responses"].as_object().unwrap() {
                assert!(
                    response["description"].as_str().is_some_and(|text| !text.is_empty()),
                    "{method} {path} {status}"
                );
                if status.as_str() >= "400" {
                    let schema = &response["content"]["application/problem+json"]["schema"]["$ref"];
                    assert_eq!(schema, "#/components/schemas/Problem", "{method} {path} {status}");
                }
            }
            let templated: Vec<&str> = path.split('{').skip(1).map(|rest| rest.split('}').next().unwrap()).collect();
            let parameters = operation["parameters"].as_array().cloned().unwrap_or_default();
            let named: Vec<&str> =
                parameters.iter().filter(|p| p["in"] == "path").map(|p| p["name"].as_str().unwrap()).collect();
            assert_eq!(templated, named, "{method} {path}");
        }
    }
    assert_eq!(operations.iter().map(String::as_str).collect::<Vec<_>>(), OPERATIONS);
    // Every reference leads somewhere.
    let text = openapi();
    for reference in text.split("\"$ref\": \"#").skip(1).map(|rest| rest.split('"').next().unwrap()) {
        assert!(contract.pointer(reference).is_some(), "{reference}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn the_contract_and_its_pages_come_from_the_service_itself() {
    let site = Site::start(prompt()).await;
    let contract = site.get("/openapi.json").await;
    assert_eq!((contract.status, contract.header("content-type")), (StatusCode::OK, "application/json"));
    assert_eq!(contract.body, openapi().into_bytes());
    let index = site.get("/docs").await;
    assert_eq!((index.status, index.header("location")), (StatusCode::PERMANENT_REDIRECT, "/docs/"));
    let page = site.get("/docs/").await;
    let html = String::from_utf8(page.body.clone()).unwrap();
    assert!(page.header("content-type").starts_with("text/html") && html.contains("swagger-ui"), "{html}");
    assert!(
        !html.contains("http://") && !html.contains("https://"),
        "a page asks for something from elsewhere: {html}"
    );
    for (file, kind) in
        [("swagger-ui-bundle.js", "javascript"), ("swagger-ui.css", "css"), ("swagger-initializer.js", "javascript")]
    {
        let reply = site.get(&format!("/docs/{file}")).await;
        assert_eq!(reply.status, StatusCode::OK);
        assert!(reply.header("content-type").contains(kind), "{file}: {}", reply.header("content-type"));
    }
    let start = site.get("/docs/swagger-initializer.js").await;
    assert!(String::from_utf8(start.body).unwrap().contains("/openapi.json"));
}
