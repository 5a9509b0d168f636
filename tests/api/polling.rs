//! Clients that ask for a job again and again are answered from memory: never with less than what they could know, never with what
//! is another tenant's.

use crate::connections::PATIENCE;
use axum::body::Body;
use axum::http::{Method, StatusCode};
use serde_json::{Value, json};
use service::accounts::access::Scope;
use service::accounts::keys;
use service::storage::records::Records;
use service::storage::records::statement::sql;
use service::{Config, Role};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;
use support::runners::{Gate, held, prompt};
use support::site::Site;

fn address(job: &str) -> String {
    format!("/v1/jobs/{job}")
}

/// What a job answers now; asked twice, so that the second answer may come from memory.
async fn seen(site: &Site, job: &str) -> Value {
    let first = site.get(&address(job)).await;
    let second = site.get(&address(job)).await;
    assert_eq!((first.status, second.status), (StatusCode::OK, StatusCode::OK));
    assert_eq!(second.headers["content-type"], "application/json");
    second.json()
}

async fn job_of(site: &Site, ray_set: &str, priority: &str) -> String {
    let body = json!({"channels": [{"ray_set": ray_set}], "reuse": false, "priority": priority});
    let reply = site.post("/v1/jobs", &body).await;
    assert_eq!(reply.status, StatusCode::ACCEPTED, "{reply:?}");
    reply.id()
}

#[tokio::test(flavor = "multi_thread")]
async fn what_this_process_has_changed_is_told_by_the_next_answer() {
    let gate = Gate::new();
    let site = Site::start(held(&gate)).await;
    let ray_set = site.ray_set().await;
    let running = site.job(&ray_set).await;
    site.until_state(&running, "running").await;
    for round in 0..20 {
        let (first, second) = (job_of(&site, &ray_set, "normal").await, job_of(&site, &ray_set, "normal").await);
        assert_eq!(seen(&site, &first).await["queue_position"], 1, "round {round}");
        assert_eq!(seen(&site, &second).await["queue_position"], 2);
        let urgent = job_of(&site, &ray_set, "high").await;
        assert_eq!(seen(&site, &second).await["queue_position"], 3, "an urgent job came before it");
        site.post(&format!("{}/cancel", address(&first)), &json!({})).await;
        assert_eq!(seen(&site, &first).await["state"], "cancelled");
        assert_eq!(seen(&site, &second).await["queue_position"], 2, "a job that was before it is gone");
        assert_eq!(site.delete(&address(&first)).await.status, StatusCode::NO_CONTENT);
        site.get(&address(&first)).await.is_problem(404, "job.not_found");
        for job in [&urgent, &second] {
            site.post(&format!("{}/cancel", address(job)), &json!({})).await;
            assert_eq!(seen(&site, job).await["queue_position"], Value::Null);
        }
    }
    // Asked for again, an equal job is as urgent as the more urgent of the two requests.
    assert_eq!(seen(&site, &running).await["priority"], "normal");
    let options = json!({"channels": [{"ray_set": ray_set}], "priority": "high"});
    let reused = site.post("/v1/jobs", &options).await.json();
    assert_eq!((&reused["id"], &reused["reused"]), (&json!(running), &json!(true)));
    let told = seen(&site, &running).await;
    assert_eq!((&told["priority"], &told["reused"]), (&json!("high"), &Value::Null));
    site.post(&format!("{}/cancel", address(&running)), &json!({})).await;
    assert_eq!(seen(&site, &running).await["cancel_requested"], true);
    gate.open();
}

/// How far a job is, as a number that never falls while it is computed once.
fn rank(job: &Value) -> (u64, u64, f64) {
    let state = ["queued", "running", "succeeded", "failed", "cancelled"].iter().position(|name| job["state"] == *name);
    (job["attempt"].as_u64().unwrap(), state.unwrap() as u64, job["progress"].as_f64().unwrap())
}

#[tokio::test(flavor = "multi_thread")]
async fn many_who_ask_never_see_a_job_go_back() {
    let site = Arc::new(Site::start(prompt()).await);
    let ray_set = site.ray_set().await;
    let mut answers = 0;
    for _ in 0..10 {
        let (job, over) = (site.job(&ray_set).await, Arc::new(AtomicBool::new(false)));
        let polls: Vec<_> = (0..8)
            .map(|_| {
                let (site, job, over) = (Arc::clone(&site), job.clone(), Arc::clone(&over));
                tokio::spawn(async move {
                    let (mut last, mut answers) = ((0, 0, 0.0), 0);
                    while !over.load(Ordering::SeqCst) {
                        let now = rank(&site.get(&address(&job)).await.json());
                        assert!(now >= last, "{now:?} after {last:?}");
                        (last, answers) = (now, answers + 1);
                        // An answer from memory waits for nothing: without a socket between, this would never end.
                        tokio::task::yield_now().await;
                    }
                    // Whoever knows that it has succeeded sees nothing else.
                    assert_eq!(site.get(&address(&job)).await.json()["state"], "succeeded");
                    answers
                })
            })
            .collect();
        let done = site.get(&format!("{}?wait=60", address(&job))).await.json();
        let done = if done["state"] == "running" { site.until_state(&job, "succeeded").await } else { done };
        assert_eq!(done["state"], "succeeded");
        over.store(true, Ordering::SeqCst);
        for poll in polls {
            answers += poll.await.unwrap();
        }
    }
    println!("{answers} answers, none of them older than the one before");
}

#[tokio::test(flavor = "multi_thread")]
async fn what_another_process_changes_is_told_within_a_poll() {
    // Nothing happens in this process that would make it read anew.
    let site = Site::start_as(|config| Config { role: Role::Api, ..config }, prompt()).await;
    let ray_set = site.ray_set().await;
    let job = site.job(&ray_set).await;
    let begun = Instant::now();
    for attempt in 1..6_i64 {
        assert!(seen(&site, &job).await["attempt"].as_i64().unwrap() < attempt);
        site.write(sql("UPDATE jobs SET attempt = $1 WHERE id = $2").bind(attempt).bind(job.as_str())).await;
        let told = site.until(&job, |job| job["attempt"] == attempt).await;
        assert_eq!(told["state"], "queued");
    }
    let end = "UPDATE jobs SET state = 'cancelled', finished_ms = {now} WHERE id = $1";
    site.write(sql(end).bind(job.as_str())).await;
    site.until_state(&job, "cancelled").await;
    site.write(sql("DELETE FROM jobs WHERE id = $1").bind(job.as_str())).await;
    while site.get(&address(&job)).await.status != StatusCode::NOT_FOUND {
        assert!(begun.elapsed() < PATIENCE, "a deleted job is still told of");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn what_is_remembered_of_one_tenant_is_no_other_s_and_a_revoked_key_opens_nothing_more() {
    let mut site = Site::start_as(|config| Config { auth: true, ..config }, prompt()).await;
    let (ours, theirs) = (site.key_of("lab", &Scope::ALL).await, site.key_of("shop", &Scope::ALL).await);
    site.key = Some(ours.clone());
    let job = site.job(&site.ray_set().await).await;
    site.until_state(&job, "succeeded").await;
    let bearer = format!("Bearer {theirs}");
    for _ in 0..5 {
        assert_eq!(seen(&site, &job).await["state"], "succeeded");
        let asked = site.ask(Method::GET, &address(&job), &[("authorization", &bearer)], Body::empty()).await;
        asked.is_problem(404, "job.not_found");
    }
    // By another process, as `lampwright keys revoke` is.
    let records = Records::open(&site.config.database_url()).await.unwrap();
    assert!(keys::revoke(&records, ours.split('_').nth(1).unwrap()).await.unwrap());
    site.get(&address(&job)).await.is_problem(401, "access.key_revoked");
}
