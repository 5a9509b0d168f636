//! Clients' own keys and values: kept, told again, found by, and nobody else's.

use crate::resume;
use axum::http::{Method, StatusCode};
use serde_json::{Value, json};
use service::Config;
use service::accounts::access::Scope;
use service::storage::records::statement::sql;
use support::packing::zip;
use support::rays;
use support::receiver::Receiver;
use support::runners::prompt;
use support::site::{Reply, Site};

/// As a client's library writes a value of a query (RFC 3986: everything but what is unreserved).
fn encoded(text: &str) -> String {
    text.bytes()
        .map(|byte| match byte {
            b'A'..=b'Z' | b'a'..=b'z' | b'0'..=b'9' | b'-' | b'.' | b'_' | b'~' => char::from(byte).to_string(),
            _ => format!("%{byte:02X}"),
        })
        .collect()
}

fn query(metadata: &Value) -> String {
    format!("metadata={}", encoded(&metadata.to_string()))
}

async fn send(site: &Site, metadata: &Value, bytes: Vec<u8>) -> Reply {
    site.ask(Method::POST, &format!("/v1/ray-sets?name=led.dat&{}", query(metadata)), &[], bytes).await
}

fn ids(list: &Value, of: &str) -> Vec<String> {
    list[of]
        .as_array()
        .unwrap_or_else(|| panic!("{list}"))
        .iter()
        .map(|one| one["id"].as_str().unwrap().into())
        .collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn ray_sets_are_found_by_what_their_client_says_of_them() {
    let site = Site::start(prompt()).await;
    let order = json!({"order": "4711", "project": "Grün & \"Söhne\" 50 %"});
    let sent = send(&site, &order, rays::zemax(10)).await;
    assert_eq!((sent.status, &sent.ray_set()["metadata"]), (StatusCode::CREATED, &order));
    assert_eq!(site.get(sent.header("location")).await.json()["metadata"], order);
    let other = send(&site, &json!({"order": "4712"}), rays::zemax(11)).await.id();
    let bare = site.ray_set().await;
    assert_eq!(site.get(&format!("/v1/ray-sets/{bare}")).await.json()["metadata"], json!({}));
    // Every file of a packed one has it.
    let both = send(&site, &json!({"order": "4711"}), zip(&[("a", &rays::zemax(5)), ("b", &rays::zemax(6))])).await;
    let packed = ids(&both.json(), "ray_sets");

    let found = async |more: &str| ids(&site.get(&format!("/v1/ray-sets?{more}")).await.json(), "ray_sets");
    let of_order = [packed[1].clone(), packed[0].clone(), sent.id()];
    assert_eq!(found(&query(&json!({"order": "4711"}))).await, of_order);
    assert_eq!(found(&query(&order)).await, [sent.id()]);
    assert_eq!(found(&query(&json!({"order": "4712"}))).await, [other]);
    assert!(found(&query(&json!({"order": "4711", "project": "x"}))).await.is_empty());
    assert!(found(&query(&json!({"4711": "order"}))).await.is_empty());
    assert_eq!(found(&query(&json!({}))).await.len(), 5);
    // With the other filters, and page by page.
    let by = format!("{}&name=led.dat&sha256={}", query(&order), sent.ray_set()["sha256"].as_str().unwrap());
    assert_eq!(found(&by).await, [sent.id()]);
    assert_eq!(found(&format!("{}&name=b", query(&json!({"order": "4711"})))).await, [packed[1].clone()]);
    let page = site.get(&format!("/v1/ray-sets?limit=2&{}", query(&json!({"order": "4711"})))).await.json();
    let next = format!("limit=2&after={}&{}", page["next"].as_str().unwrap(), query(&json!({"order": "4711"})));
    assert_eq!((ids(&page, "ray_sets"), found(&next).await), (of_order[..2].to_vec(), of_order[2..].to_vec()));
    // What is deleted is not found, and leaves nothing.
    for id in found("limit=100").await {
        assert_eq!(site.delete(&format!("/v1/ray-sets/{id}")).await.status, StatusCode::NO_CONTENT);
    }
    assert!(site.rows(sql("SELECT 1 FROM ray_set_metadata")).await.is_empty());
}

#[tokio::test(flavor = "multi_thread")]
async fn an_upload_that_is_resumed_brings_its_metadata_along() {
    let site = Site::start(prompt()).await;
    let order = json!({"order": "4711"});
    let said = resume::metadata(&[("filename", "led.dat"), ("metadata", &order.to_string())]);
    let at = resume::send(&site, &rays::zemax(100), 2000, &[("upload-metadata", &said)]).await;
    let upload = site.get(&at).await.json();
    assert_eq!(upload["metadata"], order, "{upload}");
    let ray_set = site.get(upload["links"]["ray_sets"][0].as_str().unwrap()).await.json();
    assert_eq!((&ray_set["metadata"], &ray_set["name"]), (&order, &json!("led.dat")));
    let wrong = resume::metadata(&[("metadata", "4711")]);
    let headers = [resume::VERSION, ("upload-length", "5"), ("upload-metadata", wrong.as_str())];
    let refused = site.ask(Method::POST, "/v1/uploads", &headers, axum::body::Body::empty()).await;
    refused.is_problem(422, "request.wrong_type");
}

#[tokio::test(flavor = "multi_thread")]
async fn jobs_are_found_by_what_their_client_says_of_them() {
    let site = Site::start(prompt()).await;
    let (ray_set, another) = (site.ray_set().await, site.upload(rays::zemax(20)).await.id());
    let order = json!({"order": "4711", "line": "2"});
    let job = async |ray_set: &str, metadata: &Value| {
        site.post("/v1/jobs", &json!({ "channels": [{"ray_set": ray_set}], "metadata": metadata })).await
    };
    let first = job(&ray_set, &order).await;
    assert_eq!((first.status, &first.json()["metadata"]), (StatusCode::ACCEPTED, &order));
    let second = job(&another, &json!({"order": "4711"})).await.id();
    for id in [&first.id(), &second] {
        site.until_state(id, "succeeded").await;
    }
    let found = async |more: &str| ids(&site.get(&format!("/v1/jobs?{more}")).await.json(), "jobs");
    let by_order = query(&json!({"order": "4711"}));
    assert_eq!(found(&by_order).await, [second.clone(), first.id()]);
    assert_eq!(found(&query(&order)).await, [first.id()]);
    assert_eq!(found(&format!("{by_order}&ray_set={another}")).await, std::slice::from_ref(&second));
    assert_eq!(found(&format!("{by_order}&state=succeeded,failed")).await, [second.clone(), first.id()]);
    assert_eq!(found(&format!("{by_order}&state=succeeded&ray_set={ray_set}&priority=normal")).await, [first.id()]);
    assert!(found(&format!("{by_order}&state=failed")).await.is_empty());

    // An equal job is the answer only where it says the same of itself, or nothing was said.
    let again = job(&ray_set, &order).await;
    assert_eq!((again.status, again.id()), (StatusCode::OK, first.id()));
    let bare = job(&ray_set, &json!({})).await;
    assert_eq!((bare.status, bare.id(), &bare.json()["metadata"]), (StatusCode::OK, first.id(), &order));
    let other = job(&ray_set, &json!({"order": "4712"})).await;
    assert_eq!((other.status, &other.json()["metadata"]), (StatusCode::ACCEPTED, &json!({"order": "4712"})));
    assert_ne!(other.id(), first.id());
    site.until_state(&other.id(), "succeeded").await;

    // Other metadata are another request.
    let under = async |metadata: &Value| {
        let headers = [("content-type", "application/json"), ("idempotency-key", "k")];
        let body = json!({ "channels": [{"ray_set": ray_set}], "metadata": metadata }).to_string();
        site.ask(Method::POST, "/v1/jobs", &headers, body).await
    };
    assert_eq!(under(&order).await.id(), first.id());
    under(&json!({"order": "4711"})).await.is_problem(422, "idempotency.key_reused");
    assert_eq!(site.delete(&format!("/v1/jobs/{}", first.id())).await.status, StatusCode::NO_CONTENT);
    assert_eq!(found(&query(&json!({"line": "2"}))).await, Vec::<String>::new());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_webhook_message_says_what_the_client_said_of_the_job() {
    let near = |config| Config { outbound_exceptions: vec!["127.0.0.0/8".parse().unwrap()], ..config };
    let (site, receiver) = (Site::start_as(near, prompt()).await, Receiver::start().await);
    let made = site.post("/v1/webhooks", &json!({ "url": receiver.url })).await;
    assert_eq!(made.status, StatusCode::CREATED, "{made:?}");
    let order = json!({"order": "4711"});
    let ray_set = site.ray_set().await;
    site.post("/v1/jobs", &json!({ "channels": [{"ray_set": ray_set}], "metadata": order })).await;
    let heard = receiver.until(1).await.remove(0);
    let message: Value = serde_json::from_slice(&heard.body).unwrap();
    assert_eq!((&message["type"], &message["data"]["metadata"]), (&json!("job.succeeded"), &order));
}

#[tokio::test(flavor = "multi_thread")]
async fn metadata_out_of_bounds_are_refused_wherever_they_come() {
    let site = Site::start(prompt()).await;
    let ray_set = site.ray_set().await;
    let keys = |count: usize| Value::Object((0..count).map(|k| (format!("k{k}"), json!("v"))).collect());
    for wrong in [
        keys(17),
        json!({"": "v"}),
        json!({"a b": "v"}),
        json!({"k".repeat(65): "v"}),
        json!({"k": "v".repeat(513)}),
        json!({"k": "\u{1b}[31m"}),
        json!({"k": 1}),
        json!(["k", "v"]),
        json!("k"),
    ] {
        let refused = site.post("/v1/jobs", &json!({ "channels": [{"ray_set": ray_set}], "metadata": wrong })).await;
        refused.is_problem(422, "request.wrong_type");
        assert!(refused.json()["at"].as_str().unwrap().starts_with("metadata"), "{}", refused.json());
        send(&site, &wrong, rays::zemax(5)).await.is_problem(422, "request.wrong_type");
        site.get(&format!("/v1/jobs?{}", query(&wrong))).await.is_problem(422, "request.wrong_type");
        site.get(&format!("/v1/ray-sets?{}", query(&wrong))).await.is_problem(422, "request.wrong_type");
        let elsewhere = json!({"url": "https://receiver.invalid/a.ray", "metadata": wrong});
        site.post("/v1/ray-sets/ingest", &elsewhere).await.is_problem(422, "request.wrong_type");
    }
    assert_eq!(send(&site, &keys(16), rays::zemax(5)).await.status, StatusCode::CREATED);
}

#[tokio::test(flavor = "multi_thread")]
async fn nobody_is_found_by_another_tenants_metadata() {
    let mut site = Site::start_as(|config| Config { auth: true, ..config }, prompt()).await;
    let scopes = [Scope::UploadsRead, Scope::UploadsWrite, Scope::JobsRead, Scope::JobsWrite];
    let (ours, theirs) = (site.key_of("lab", &scopes).await, site.key_of("shop", &scopes).await);
    let order = json!({"order": "4711"});
    site.key = Some(ours.clone());
    let ray_set = send(&site, &order, rays::zemax(10)).await.id();
    let job = site.post("/v1/jobs", &json!({ "channels": [{"ray_set": ray_set}], "metadata": order })).await.id();
    for (key, ray_sets, jobs) in [(&ours, vec![ray_set], vec![job]), (&theirs, vec![], vec![])] {
        site.key = Some(key.clone());
        let found = site.get(&format!("/v1/ray-sets?{}", query(&order))).await.json();
        assert_eq!(ids(&found, "ray_sets"), ray_sets);
        assert_eq!(ids(&site.get(&format!("/v1/jobs?{}", query(&order))).await.json(), "jobs"), jobs);
    }
}
