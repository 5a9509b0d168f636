//! Endpoints hear that jobs have ended: signed, again until they have taken it, and nobody else's.

use crate::connections::PATIENCE;
use axum::body::Body;
use axum::http::{Method, StatusCode};
use serde_json::{Value, json};
use service::accounts::access::Scope;
use service::jobs::queue::Queue;
use service::jobs::worker::Runner;
use service::storage::Storage;
use service::storage::records::statement::sql;
use service::webhooks::Policy;
use service::{Config, Service};
use std::collections::BTreeSet;
use std::time::{Duration, Instant};
use support::receiver::{Answer, Heard, Receiver};
use support::runners::{Gate, failing, held, prompt};
use support::site::Site;

/// A name that nobody will ever have (RFC 2606).
const NOWHERE: &str = "https://receiver.invalid/";
const SOON: Duration = Duration::from_millis(20);

/// A service that may ask this machine, and is in a hurry.
fn near(config: Config) -> Config {
    let webhooks = Policy { waits: vec![SOON; 3], ..Policy::default() };
    Config { outbound_exceptions: vec!["127.0.0.0/8".parse().unwrap()], webhooks, ..config }
}

async fn start(runner: Runner) -> (Site, Receiver) {
    (Site::start_as(near, runner).await, Receiver::start().await)
}

/// Makes an endpoint; what was answered.
async fn endpoint(site: &Site, url: &str, events: &[&str]) -> Value {
    let body = match events {
        [] => json!({ "url": url }),
        events => json!({ "url": url, "events": events, "description": "the lab's" }),
    };
    let reply = site.post("/v1/webhooks", &body).await;
    assert_eq!(reply.status, StatusCode::CREATED, "{reply:?}");
    assert_eq!(reply.header("location"), reply.json()["links"]["self"]);
    reply.json()
}

/// The endpoint's deliveries, newest first, once `done`.
async fn deliveries(site: &Site, endpoint: &Value, done: impl Fn(&[Value]) -> bool) -> Vec<Value> {
    let start = Instant::now();
    loop {
        let list = site.get(endpoint["links"]["deliveries"].as_str().unwrap()).await.json();
        let list = list["deliveries"].as_array().unwrap().clone();
        if done(&list) {
            return list;
        }
        assert!(start.elapsed() < PATIENCE, "still {list:?}");
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
}

async fn ended(site: &Site, endpoint: &Value, count: usize) -> Vec<Value> {
    deliveries(site, endpoint, |list| list.len() >= count && list.iter().all(|one| one["state"] != "waiting")).await
}

/// The library of the standard's own authors.
fn verified(heard: &Heard, endpoint: &Value) -> bool {
    let foreign = standardwebhooks::Webhook::new(endpoint["secret"].as_str().unwrap()).unwrap();
    foreign.verify(&heard.body, &heard.headers).is_ok()
}

fn status(status: u16) -> Answer {
    (status, None, String::new())
}

#[tokio::test(flavor = "multi_thread")]
async fn whoever_wants_to_hears_how_a_job_has_ended() {
    let gate = Gate::new();
    let (site, receiver) = start(held(&gate)).await;
    let other = Receiver::start().await;
    let ray_set = site.ray_set().await;
    let (running, goes) = (site.job(&ray_set).await, site.job(&ray_set).await);
    site.until_state(&running, "running").await;
    let before = site.job(&ray_set).await;
    site.post(&format!("/v1/jobs/{before}/cancel"), &json!({})).await;
    let all = endpoint(&site, &receiver.url, &[]).await;
    endpoint(&site, &other.url, &["job.failed"]).await;
    assert!(all["secret"].as_str().unwrap().starts_with("whsec_"));
    assert_eq!(
        (&all["enabled"], &all["events"]),
        (&json!(true), &json!(["job.succeeded", "job.failed", "job.cancelled"]))
    );
    let told = site.get(all["links"]["self"].as_str().unwrap()).await;
    assert!(!String::from_utf8(told.body).unwrap().contains("whsec_"), "a secret is told once");

    let cancelled = site.post(&format!("/v1/jobs/{goes}/cancel"), &json!({})).await.json();
    receiver.until(1).await;
    gate.open();
    let succeeded = site.until_state(&running, "succeeded").await;
    let heard = receiver.until(2).await;
    let of = |job: &Value| heard.iter().find(|heard| heard.json()["data"]["id"] == job["id"]).unwrap();
    for (job, event) in [(&cancelled, "job.cancelled"), (&succeeded, "job.succeeded")] {
        let heard = of(job);
        assert!(verified(heard, &all), "{heard:?}");
        assert_eq!(
            (heard.header("content-type"), heard.header("user-agent")),
            ("application/json", concat!("lampwright/", env!("CARGO_PKG_VERSION")))
        );
        let message = heard.json();
        assert_eq!((&message["type"], message["timestamp"].as_str().unwrap().len()), (&json!(event), 24));
        for field in ["id", "state", "problem", "attempt", "created_ms", "started_ms", "finished_ms"] {
            assert_eq!(message["data"][field], job[field], "{field}");
        }
        for link in ["self", "artifacts", "zip"] {
            assert_eq!(message["data"]["links"][link], job["links"][link], "{link}");
        }
    }
    let mut tampered = heard[1].clone();
    tampered.body[20] ^= 1;
    assert!(!verified(&tampered, &all) && !verified(&heard[1], &json!({"secret": "whsec_bm90IHRoaXMgb25l"})));

    let list = ended(&site, &all, 2).await;
    let told = list.iter().find(|delivery| delivery["job"] == json!(running)).unwrap();
    assert_eq!((&told["event"], &told["id"]), (&json!("job.succeeded"), &json!(of(&succeeded).id())));
    assert_eq!((&told["status"], &told["attempt"], &told["error"]), (&json!(204), &json!(1), &Value::Null));
    assert!(other.heard().is_empty(), "it did not want to hear of these");
    assert_eq!(site.rows(sql("SELECT id FROM jobs WHERE announced = 0")).await.len(), 0);
    assert_eq!(receiver.heard().len(), 2, "what ended before is not told, and nothing twice");
}

#[tokio::test(flavor = "multi_thread")]
async fn what_is_not_taken_is_told_again_with_the_same_id() {
    let (site, receiver) = start(failing(|| pipeline::Error::malformed("x.y", "found", "do"))).await;
    let hook = endpoint(&site, &receiver.url, &["job.failed"]).await;
    let long = "x".repeat(100_000);
    receiver.answer([
        (500, None, long),
        (503, Some(("retry-after", "1".into())), "later".into()),
        status(302),
        status(200),
    ]);
    let asked = Instant::now();
    let job = site.job(&site.ray_set().await).await;
    let heard = receiver.until(4).await;
    assert!(asked.elapsed() >= Duration::from_secs(1), "it said when to ask again");
    let ids: BTreeSet<String> = heard.iter().map(Heard::id).collect();
    assert_eq!(ids.len(), 1);
    assert!(heard.iter().all(|heard| verified(heard, &hook)));
    assert_eq!(heard[0].json()["data"]["problem"]["code"], "x.y");
    let list = ended(&site, &hook, 1).await;
    assert_eq!(
        (&list[0]["state"], &list[0]["attempt"], &list[0]["job"]),
        (&json!("delivered"), &json!(4), &json!(job))
    );

    // Every attempt is used up: it has failed, and its answer is known, cut.
    receiver.answer([status(500), status(500), status(404), (400, None, "ü".repeat(9000))]);
    site.job(&site.ray_set().await).await;
    let list = ended(&site, &hook, 2).await;
    assert_eq!(
        (&list[0]["state"], &list[0]["status"], &list[0]["attempt"]),
        (&json!("failed"), &json!(400), &json!(4))
    );
    assert!((1000..=2048).contains(&list[0]["answer"].as_str().unwrap().chars().count()));
    assert!(site.get(hook["links"]["self"].as_str().unwrap()).await.json()["failing_since_ms"].as_i64() > Some(0));

    // Asked for, it is told once more, as the same.
    let again =
        format!("{}/{}/redeliver", hook["links"]["deliveries"].as_str().unwrap(), list[0]["id"].as_str().unwrap());
    assert_eq!(site.post(&again, &json!({})).await.status, StatusCode::ACCEPTED);
    let heard = receiver.until(9).await;
    assert_eq!((heard.len(), heard[8].id()), (9, heard[7].id()));
    let list = deliveries(&site, &hook, |list| list[0]["state"] == "delivered").await;
    assert_eq!((list.len(), &list[0]["attempt"]), (2, &json!(1)));
    assert_eq!(site.get(hook["links"]["self"].as_str().unwrap()).await.json()["failing_since_ms"], Value::Null);
    site.post(&again.replace("/redeliver", "x/redeliver"), &json!({})).await.is_problem(404, "delivery.not_found");
}

#[tokio::test(flavor = "multi_thread")]
async fn an_endpoint_that_is_gone_or_takes_nothing_is_told_no_more_until_somebody_says_so() {
    let tired = |config| {
        let config = near(config);
        Config { webhooks: Policy { give_up: Duration::from_millis(1), ..config.webhooks }, ..config }
    };
    let (site, receiver) = (Site::start_as(tired, prompt()).await, Receiver::start().await);
    let hook = endpoint(&site, &receiver.url, &[]).await;
    let this = hook["links"]["self"].as_str().unwrap();
    let ping = format!("{this}/ping");
    for (answers, why) in
        [(vec![status(410)], "410"), (vec![status(500), status(500), status(500), status(500)], "nothing")]
    {
        let count = answers.len();
        receiver.answer(answers);
        let before = receiver.heard().len();
        let job = site.job(&site.ray_set().await).await;
        site.until_state(&job, "succeeded").await;
        receiver.until(before + count).await;
        let list = ended(&site, &hook, 1).await;
        assert_eq!(list[0]["state"], "failed");
        let now = site.get(this).await.json();
        assert_eq!(now["enabled"], json!(false));
        assert!(now["disabled_why"].as_str().unwrap().contains(why), "{now}");
        site.post(&ping, &json!({})).await.is_problem(409, "webhook.disabled");
        let again = format!("{this}/deliveries/{}/redeliver", list[0]["id"].as_str().unwrap());
        site.post(&again, &json!({})).await.is_problem(409, "webhook.disabled");
        // What ends meanwhile is not told, not even later.
        let unheard = site.job(&site.ray_set().await).await;
        site.until_state(&unheard, "succeeded").await;
        let announced = async { while !site.rows(sql("SELECT id FROM jobs WHERE announced = 0")).await.is_empty() {} };
        tokio::time::timeout(Duration::from_secs(60), announced).await.unwrap();
        let patch =
            site.ask(Method::PATCH, this, &[("content-type", "application/json")], r#"{"enabled": true}"#).await;
        assert_eq!((patch.status, &patch.json()["enabled"]), (StatusCode::OK, &json!(true)));
        assert_eq!(receiver.heard().len(), before + count);
    }
    let told = site.post(&ping, &json!({})).await;
    assert_eq!((told.status, &told.json()["event"]), (StatusCode::ACCEPTED, &json!("ping")));
    let heard = receiver.until(6).await.pop().unwrap();
    assert!(verified(&heard, &hook));
    assert_eq!((&heard.json()["type"], &heard.json()["data"]), (&json!("ping"), &json!({})));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_new_secret_takes_over_without_a_gap() {
    let (site, receiver) = start(prompt()).await;
    let old = endpoint(&site, &receiver.url, &[]).await;
    let this = old["links"]["self"].as_str().unwrap();
    let new = site.post(&format!("{this}/secret"), &json!({})).await.json();
    assert_ne!(old["secret"], new["secret"]);
    let job = site.job(&site.ray_set().await).await;
    site.until_state(&job, "succeeded").await;
    let heard = receiver.until(1).await.pop().unwrap();
    assert!(verified(&heard, &old) && verified(&heard, &new), "for a day either is good");
    assert!(new["old_secret_until_ms"].as_i64().unwrap() - new["created_ms"].as_i64().unwrap() >= 86_400_000);
    site.write(sql("UPDATE webhooks SET old_secret_until_ms = {now} - 1")).await;
    site.post(&format!("{this}/ping"), &json!({})).await;
    let heard = receiver.until(2).await.pop().unwrap();
    assert!(!verified(&heard, &old) && verified(&heard, &new), "and then only the new one");
}

#[tokio::test(flavor = "multi_thread")]
async fn nobody_is_told_where_the_service_may_not_ask() {
    let (site, receiver) = start(prompt()).await;
    let elsewhere = Receiver::start().await;
    for (url, code) in [
        ("https://10.0.0.1/", "webhook.address_refused"),
        ("https://169.254.169.254/latest", "webhook.address_refused"),
        ("https://[fd00::1]/", "webhook.address_refused"),
        ("http://example.org/", "webhook.url"),
        ("https://user:secret@example.org/", "webhook.url"),
        ("not an address", "webhook.url"),
        ("https://example.org/\u{1}", "webhook.url"),
    ] {
        site.post("/v1/webhooks", &json!({ "url": url })).await.is_problem(422, code);
    }
    for (body, code) in [
        (json!({"url": "https://example.org/", "events": []}), "request.out_of_range"),
        (json!({"url": "https://example.org/", "events": ["job.begun"]}), "request.wrong_type"),
        (json!({"url": "https://example.org/", "description": "x".repeat(256)}), "request.out_of_range"),
        (json!({"url": "https://example.org/", "secret": "mine"}), "request.unknown_field"),
        (json!({}), "request.missing_field"),
    ] {
        site.post("/v1/webhooks", &body).await.is_problem(422, code);
    }
    // What was allowed once is judged again each time; a redirect leads nobody anywhere.
    let named = endpoint(&site, NOWHERE, &[]).await;
    let hook = endpoint(&site, &receiver.url, &[]).await;
    site.write(sql("UPDATE webhooks SET url = 'https://10.0.0.1/' WHERE id = $1").bind(named["id"].as_str().unwrap()))
        .await;
    let away = (307, Some(("location", elsewhere.url.clone())), String::new());
    receiver.answer(vec![away; 4]);
    let job = site.job(&site.ray_set().await).await;
    site.until_state(&job, "succeeded").await;
    let list = ended(&site, &named, 1).await;
    assert!(list[0]["error"].as_str().unwrap().contains("has no public internet address"), "{list:?}");
    let list = ended(&site, &hook, 1).await;
    assert_eq!((&list[0]["state"], &list[0]["status"]), (&json!("failed"), &json!(307)));
    assert!(elsewhere.heard().is_empty());
    // As many as may be.
    for _ in 2..20 {
        endpoint(&site, NOWHERE, &[]).await;
    }
    site.post("/v1/webhooks", &json!({ "url": NOWHERE })).await.is_problem(409, "webhook.too_many");
    let page = site.get("/v1/webhooks?limit=15").await.json();
    let rest = site.get(&format!("/v1/webhooks?limit=15&after={}", page["next"].as_str().unwrap())).await.json();
    assert_eq!((page["webhooks"].as_array().unwrap().len(), rest["webhooks"].as_array().unwrap().len()), (15, 5));
    for hook in [&named, &hook] {
        let this = hook["links"]["self"].as_str().unwrap();
        assert_eq!(site.delete(this).await.status, StatusCode::NO_CONTENT);
        site.get(this).await.is_problem(404, "webhook.not_found");
    }
    assert!(site.rows(sql("SELECT id FROM deliveries")).await.is_empty());
}

#[tokio::test(flavor = "multi_thread")]
async fn tenants_hear_of_their_own_jobs_only() {
    let with_keys = |config| near(Config { auth: true, ..config });
    let mut site = Site::start_as(with_keys, prompt()).await;
    let (lab, shop) = (Receiver::start().await, Receiver::start().await);
    for (tenant, receiver) in [("shop", &shop), ("lab", &lab)] {
        site.key = Some(site.key_of(tenant, &Scope::OF_A_TENANT).await);
        endpoint(&site, &receiver.url, &[]).await;
    }
    let job = site.job(&site.ray_set().await).await;
    site.until_state(&job, "succeeded").await;
    assert_eq!(lab.until(1).await[0].json()["data"]["id"], json!(job));
    assert_eq!(site.rows(sql("SELECT id FROM deliveries")).await.len(), 1);
    assert!(shop.heard().is_empty());
    // A key for jobs alone says nothing of who is told of them.
    let jobs = format!("Bearer {}", site.key_of("lab", &[Scope::JobsRead, Scope::JobsWrite]).await);
    let refused = site.ask(Method::GET, "/v1/webhooks", &[("authorization", &jobs)], Body::empty()).await;
    refused.is_problem(403, "access.scope_missing");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_job_that_is_deleted_before_it_is_announced_is_announced() {
    let (mut site, receiver) = start(prompt()).await;
    let hook = endpoint(&site, &receiver.url, &[]).await;
    let job = site.job(&site.ray_set().await).await;
    site.until_state(&job, "succeeded").await;
    ended(&site, &hook, 1).await;
    site.kill().await;
    // As it is when the process dies between the end of the job and its announcement.
    let storage = Storage::open(&site.config.database_url(), &site.config.storage_url()).await.unwrap();
    storage.records.write(sql("DELETE FROM deliveries")).await.unwrap();
    storage.records.write(sql("UPDATE jobs SET announced = 0")).await.unwrap();
    let queue = Queue::new(storage.clone(), site.config.lease, 3);
    assert!(queue.delete("shop", &job).await.is_err());
    assert!(storage.records.read(sql("SELECT id FROM deliveries")).await.unwrap().is_empty());
    queue.delete("default", &job).await.unwrap();
    let rows = storage.records.read(sql("SELECT job_id, state FROM deliveries")).await.unwrap();
    assert_eq!(
        (rows.len(), rows[0].text("job_id").unwrap(), rows[0].text("state").unwrap()),
        (1, job.clone(), "waiting".into())
    );
    storage.records.close().await;
    site.restart(prompt()).await;
    assert_eq!(receiver.until(2).await[1].json()["data"]["id"], json!(job));
}

#[tokio::test(flavor = "multi_thread")]
async fn many_processes_tell_everything_once() {
    let (site, receiver) = start(prompt()).await;
    let hook = endpoint(&site, &receiver.url, &[]).await;
    // A data folder belongs to one process; servers are there for several.
    let mut others = Vec::new();
    if support::engines::are_shared() {
        for _ in 0..2 {
            others.push(Service::start_with(site.config.clone(), prompt()).await.unwrap());
        }
    }
    let ray_set = site.ray_set().await;
    for _ in 0..30 {
        site.job(&ray_set).await;
    }
    let all = |list: &[Value]| list.len() == 30 && list.iter().all(|one| one["state"] == "delivered");
    let start = Instant::now();
    loop {
        let list = site.get(&format!("{}?limit=100", hook["links"]["deliveries"].as_str().unwrap())).await.json();
        if all(list["deliveries"].as_array().unwrap()) {
            break;
        }
        assert!(start.elapsed() < PATIENCE, "{list}");
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    let heard = receiver.heard();
    let jobs: BTreeSet<String> = heard.iter().map(|heard| heard.json()["data"]["id"].to_string()).collect();
    assert_eq!((heard.len(), jobs.len()), (30, 30));
    let text = String::from_utf8(site.get("/metrics").await.body).unwrap();
    assert!(text.contains("lampwright_webhook_backlog 0\n"), "{text}");
    assert!(
        !others.is_empty() || text.contains("lampwright_webhook_attempts_total{ending=\"delivered\"} 30\n"),
        "{text}"
    );
}
