//! A field that is null counts as left out, in every JSON body of the contract: the schemas of the contract say which there are.

use axum::http::{Method, StatusCode};
use serde_json::{Value, json};
use service::http::openapi;
use support::runners::prompt;
use support::site::{Reply, Site};

const JSON: (&str, &str) = ("content-type", "application/json");

/// A schema without its reference and without the null that it may be.
fn meant<'a>(contract: &'a Value, schema: &'a Value) -> &'a Value {
    if let Some(reference) = schema["$ref"].as_str() {
        return meant(contract, contract.pointer(reference.trim_start_matches('#')).unwrap());
    }
    let choices = schema["oneOf"].as_array().map_or(&[][..], Vec::as_slice);
    let others: Vec<&Value> = choices.iter().filter(|choice| choice["type"] != "null").collect();
    match others.as_slice() {
        [only] if others.len() < choices.len() => meant(contract, only),
        _ => schema,
    }
}

/// Whether the contract lets a value be null.
fn may_be_null(schema: &Value) -> bool {
    let in_types = schema["type"].as_array().is_some_and(|types| types.contains(&json!("null")));
    in_types || schema["oneOf"].as_array().is_some_and(|kinds| kinds.iter().any(|kind| kind["type"] == "null"))
}

/// `body` with `value` as the field `name` of the object at `pointer`, and the objects on the way to it.
fn with(body: &Value, pointer: &str, name: &str, value: Value) -> Value {
    let mut body = body.clone();
    let mut place = &mut body;
    for step in pointer.split('/').skip(1) {
        place = match step.parse::<usize>() {
            Ok(index) => &mut place[index],
            Err(_) => &mut place[step],
        };
        if place.is_null() {
            *place = json!({});
        }
    }
    place[name] = value;
    body
}

/// Every field that may be left out in a body of `schema`, as a pointer to its object and its name. Lists are entered where
/// `body` has an entry, objects with fields that must be given where it has those.
fn optional(contract: &Value, schema: &Value, body: &Value, pointer: &str, found: &mut Vec<(String, String)>) {
    let schema = meant(contract, schema);
    let required = schema["required"].as_array().cloned().unwrap_or_default();
    for (name, property) in schema["properties"].as_object().into_iter().flatten() {
        if !required.contains(&json!(name)) {
            assert!(may_be_null(property), "the contract does not let {pointer}/{name} be null");
            found.push((pointer.to_owned(), name.clone()));
        }
        let (inner, at) = (meant(contract, property), format!("{pointer}/{name}"));
        let is_given = !body[name].is_null();
        if inner["properties"].is_object() && (is_given || inner["required"].is_null()) {
            optional(contract, inner, &body[name], &at, found);
        } else if body[name][0].is_object() {
            optional(contract, &inner["items"], &body[name][0], &format!("{at}/0"), found);
        }
    }
}

/// What came of a request, as far as it does not change with every request.
fn outcome(reply: &Reply) -> (StatusCode, Value) {
    (reply.status, if reply.status.is_success() { Value::Null } else { reply.json()["code"].clone() })
}

#[tokio::test(flavor = "multi_thread")]
async fn a_null_is_as_if_left_out_in_every_json_body_of_the_contract() {
    let site = Site::start(prompt()).await;
    let ray_set = site.ray_set().await;
    let webhook = site.post("/v1/webhooks", &json!({"url": "https://a.example/"})).await.id();
    let contract: Value = serde_json::from_str(&openapi()).unwrap();
    let least = [
        ("create_job", json!({"channels": [{"ray_set": ray_set}]})),
        ("create_webhook", json!({"url": "https://a.example/"})),
        ("change_webhook", json!({})),
        ("combine_models", json!({"models": [{"job": ray_set}]})),
        ("queue_evaluation", json!({"job": ray_set, "evaluation": {"view": {"angles": [[0, 0]]}}})),
        ("evaluate_model", json!({"view": {"angles": [[0, 0]]}})),
        // Refused, but only after its fields were read.
        ("ingest_ray_set", json!({"url": "http://127.0.0.1:1/led.dat"})),
    ];
    let (mut bodies, mut fields) = (0, 0);
    for (path, item) in contract["paths"].as_object().unwrap() {
        for (method, operation) in item.as_object().unwrap() {
            let schema = &operation["requestBody"]["content"]["application/json"]["schema"];
            if schema.is_null() {
                continue;
            }
            let id = operation["operationId"].as_str().unwrap();
            let (_, body) = least.iter().find(|(name, _)| *name == id).unwrap_or_else(|| panic!("no body for {id}"));
            let (method, path) =
                (Method::from_bytes(method.to_uppercase().as_bytes()).unwrap(), path.replace("{id}", &webhook));
            let ask = async |body: &Value| site.ask(method.clone(), &path, &[JSON], body.to_string()).await;
            let without = ask(body).await;
            assert_ne!(outcome(&without).1, "request.wrong_type", "{without:?}");
            let mut found = Vec::new();
            optional(&contract, schema, body, "", &mut found);
            for (pointer, name) in &found {
                // All ask for another job: with an equal one there, 200 is the answer.
                let other = if id == "create_job" { with(body, "", "reuse", json!(false)) } else { body.clone() };
                let reply = ask(&with(&other, pointer, name, Value::Null)).await;
                let expected = if name == "reuse" && id == "create_job" { StatusCode::OK } else { without.status };
                assert_eq!(outcome(&reply), (expected, outcome(&without).1), "{id} {pointer}/{name}: {reply:?}");
                let misspelt = ask(&with(&other, pointer, "nobody_knows", Value::Null)).await;
                misspelt.is_problem(422, "request.unknown_field");
            }
            (bodies, fields) = (bodies + 1, fields + found.len());
            // What must be given is missing when it is null, and says so.
            for name in meant(&contract, schema)["required"].as_array().into_iter().flatten() {
                let reply = ask(&with(body, "", name.as_str().unwrap(), Value::Null)).await;
                reply.is_problem(422, "request.missing_field");
            }
        }
    }
    assert_eq!(bodies, least.len());
    assert!(fields >= 35, "only {fields} fields were tried");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_null_changes_nothing_that_is_kept() {
    let site = Site::start(prompt()).await;
    let id = site.ray_set().await;
    let plain =
        json!({"channels": [{"ray_set": id, "flux": {"radiant_w": 1}}], "options": {"hull": {"resolution": 32}}});
    // A client whose classes have a field for every kind writes those that are not meant as null.
    let full = json!({
        "channels": [{"ray_set": id, "name": null, "flux": {"radiant_w": 1, "luminous_lm": null}, "spectrum": null}],
        "options": {"hull": {"resolution": 32, "emission": null}, "flux": null, "goniogram": {"zones": null}},
        "total": null, "priority": null, "timeout_s": null, "reuse": null,
    });
    let under_key = async |body: &Value| {
        let headers = [JSON, ("idempotency-key", "the same request")];
        site.ask(Method::POST, "/v1/jobs", &headers, body.to_string()).await
    };
    let (first, again) = (under_key(&plain).await, under_key(&full).await);
    assert_eq!((first.status, again.status, again.id()), (StatusCode::ACCEPTED, StatusCode::ACCEPTED, first.id()));
    for name in ["channels", "options", "priority"] {
        assert_eq!(first.json()[name], again.json()[name], "{name}");
    }
    // In a list it is a value, and a wrong one.
    for (body, at) in [
        (json!({"channels": [null]}), "channels[0]"),
        (json!({"channels": [{"ray_set": id, "columns": ["x", null]}]}), "channels[0].columns[1]"),
    ] {
        let reply = site.post("/v1/jobs", &body).await;
        reply.is_problem(422, "request.wrong_type");
        assert_eq!(reply.json()["at"], at);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_byte_order_mark_before_json_is_skipped() {
    let site = Site::start(prompt()).await;
    let id = site.ray_set().await;
    let body = format!("\u{feff}{}", json!({"channels": [{"ray_set": id}]}));
    let reply = site.ask(Method::POST, "/v1/jobs", &[JSON], body).await;
    assert_eq!(reply.status, StatusCode::ACCEPTED, "{reply:?}");
    // One, and before it only.
    for wrong in ["\u{feff}\u{feff}{}", " \u{feff}{}"] {
        site.ask(Method::POST, "/v1/jobs", &[JSON], wrong.to_owned()).await.is_problem(400, "request.malformed_json");
    }
}
