//! Asking for a job: once, again, and only to know what it would come to.

use axum::http::{Method, StatusCode};
use serde_json::{Value, json};
use service::Config;
use service::accounts::access::Scope;
use service::config::Retention;
use service::jobs::estimate::JobPlan;
use service::jobs::queue::Queue;
use service::jobs::request::NewJob;
use service::jobs::submit::Keyed;
use service::storage::records::statement::sql;
use std::time::{Duration, Instant};
use support::runners::{Gate, failing, held, prompt};
use support::site::{Reply, Site, known};

async fn under(site: &Site, key: &str, body: &Value) -> Reply {
    let headers = [("content-type", "application/json"), ("idempotency-key", key)];
    site.ask(Method::POST, "/v1/jobs", &headers, body.to_string()).await
}

async fn job_count(site: &Site) -> usize {
    site.rows(sql("SELECT id FROM jobs")).await.len()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_request_under_a_key_makes_one_job_however_often_it_comes() {
    let site = Site::start(prompt()).await;
    let ray_set = site.ray_set().await;
    let body = json!({ "channels": [{"ray_set": ray_set}], "reuse": false });
    let first = under(&site, "\"k 1\"", &body).await;
    assert_eq!((first.status, &first.json()["reused"]), (StatusCode::ACCEPTED, &json!(false)));
    site.until_state(&first.id(), "succeeded").await;
    // Without quotes, with other spaces and another order of the fields: the same request.
    let again = site
        .ask(
            Method::POST,
            "/v1/jobs",
            &[("content-type", "application/json"), ("idempotency-key", "k 1")],
            format!("{{ \"reuse\": false, \"channels\": [ {{ \"ray_set\": \"{ray_set}\" }} ], \"options\": {{}} }}"),
        )
        .await;
    assert_eq!((again.status, again.id()), (StatusCode::ACCEPTED, first.id()));
    assert_eq!(again.header("location"), first.header("location"));
    assert_eq!(again.json()["state"], "succeeded", "as it is by now");
    // A day later the key means nothing, whether or not somebody has swept it away.
    let old = under(&site, "old", &body).await;
    let age = sql("UPDATE idempotency_keys SET created_ms = created_ms - 86400000 WHERE key = 'old'");
    site.write(age).await;
    let anew = under(&site, "old", &body).await;
    assert!(anew.status == StatusCode::ACCEPTED && anew.id() != old.id());
    assert_eq!(under(&site, "old", &body).await.id(), anew.id());
    for job in [old.id(), anew.id()] {
        site.until_state(&job, "succeeded").await;
    }
    // Whatever became of what it names.
    assert_eq!(site.delete(&format!("/v1/ray-sets/{ray_set}")).await.status, StatusCode::NO_CONTENT);
    assert_eq!(under(&site, "k 1", &body).await.id(), first.id());
    let other = json!({ "channels": [{"ray_set": ray_set}], "reuse": false, "priority": "high" });
    let reused = under(&site, "k 1", &other).await;
    reused.is_problem(422, "idempotency.key_reused");
    assert_eq!(reused.json()["at"], "Idempotency-Key");
    under(&site, "k 2", &body).await.is_problem(404, "ray_set.not_found");
    for wrong in ["", "\"", &"x".repeat(256)] {
        let refused = under(&site, wrong, &body).await;
        refused.is_problem(400, "request.malformed_header");
        assert_eq!(refused.json()["at"], "Idempotency-Key");
    }
    assert_eq!(job_count(&site).await, 3);
    assert_eq!(site.delete(&format!("/v1/jobs/{}", first.id())).await.status, StatusCode::NO_CONTENT);
    under(&site, "k 1", &body).await.is_problem(410, "idempotency.job_deleted");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_key_is_its_tenants_own_and_means_something_for_a_day() {
    let every = Duration::from_millis(50);
    let with_keys =
        |config: Config| Config { auth: true, retention: Retention { every, ..config.retention }, ..config };
    let mut site = Site::start_as(with_keys, prompt()).await;
    let mut made = Vec::new();
    for tenant in ["lab", "shop"] {
        site.key = Some(site.key_of(tenant, &Scope::OF_A_TENANT).await);
        let body = json!({ "channels": [{"ray_set": site.ray_set().await}], "reuse": false });
        made.push((under(&site, "k", &body).await, body));
    }
    assert!(made[0].0.id() != made[1].0.id() && made[1].0.status == StatusCode::ACCEPTED);
    let age = sql("UPDATE idempotency_keys SET created_ms = created_ms - $1");
    site.write(age.clone().bind(23 * 3_600_000)).await;
    assert_eq!(under(&site, "k", &made[1].1).await.id(), made[1].0.id());
    site.write(age.bind(3_600_000)).await;
    let start = Instant::now();
    while !site.rows(sql("SELECT key FROM idempotency_keys")).await.is_empty() {
        assert!(start.elapsed() < support::site::PATIENCE, "keys stay");
        tokio::time::sleep(every).await;
    }
    let late = under(&site, "k", &made[1].1).await;
    assert!(late.status == StatusCode::ACCEPTED && late.id() != made[1].0.id());
}

/// Two processes on the same stores, eight requests at once.
#[tokio::test(flavor = "multi_thread")]
async fn equal_requests_that_race_on_two_nodes_make_one_job() {
    let folder = tempfile::tempdir().unwrap();
    let (storage, other) = support::site::two_stores(folder.path()).await;
    known(&storage, "r").await;
    let nodes = [storage.clone(), other].map(|storage| Queue::new(storage, Duration::from_secs(60), 3));
    let count = async || {
        let rows = storage.records.read(sql("SELECT id FROM jobs")).await.unwrap();
        rows.len()
    };
    for round in 0..5 {
        // Once held together by a key, once by what would come of them.
        let (new, content) = (NewJob { reuse: round % 2 == 0, ..NewJob::of("r") }, format!("content {round}"));
        let plan = JobPlan { content_sha256: Some(content), ..JobPlan::default() };
        let keyed = Keyed::new(format!("key {round}"), &new).unwrap();
        let keyed = Some(&keyed).filter(|_| !new.reuse);
        let racing = (0..8).map(|k| nodes[k % 2].enqueue("default", &new, &plan, keyed));
        let answers = futures::future::join_all(racing).await;
        let answers: Vec<_> = answers.into_iter().map(Result::unwrap).collect();
        assert!(answers.iter().all(|answer| answer.id == answers[0].id), "{answers:?}");
        let made = answers.iter().filter(|answer| !answer.reused).count();
        assert_eq!((made, count().await), (if new.reuse { 1 } else { 8 }, round + 1), "{answers:?}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn what_was_computed_is_not_computed_again() {
    let gate = Gate::new();
    let mut site = Site::start_as(|config| Config { auth: true, ..config }, held(&gate)).await;
    let lab = site.key_of("lab", &Scope::OF_A_TENANT).await;
    site.key = Some(lab.clone());
    let file = support::rays::zemax(10);
    let (ray_set, twin) = (site.upload(file.clone()).await.id(), site.upload(file.clone()).await.id());
    let body = |ray_set: &str| json!({ "channels": [{"ray_set": ray_set, "length_unit": "mm"}] });
    let first = site.post("/v1/jobs", &body(&ray_set)).await;
    assert_eq!((first.status, &first.json()["reused"]), (StatusCode::ACCEPTED, &json!(false)));
    // Running or succeeded, of the same bytes under the same name; what is chosen as the default is the default.
    site.until_state(&first.id(), "running").await;
    let smooth = json!({ "channels": body(&twin)["channels"], "options": {"flux": {"smoothing": true}} });
    for asked in [body(&ray_set), body(&twin), smooth] {
        let again = site.post("/v1/jobs", &asked).await;
        assert_eq!((again.status, again.id()), (StatusCode::OK, first.id()), "{asked}");
        assert_eq!(again.json()["reused"], true);
        assert_eq!(again.header("location"), first.header("location"));
    }
    assert_eq!(site.get(first.header("location")).await.json()["reused"], Value::Null, "a word of the answer only");
    // Anything that the artifacts tell of makes another job, and so does who asks for one.
    let named = site.ask(Method::POST, "/v1/ray-sets?name=other.dat", &[], file.clone()).await.id();
    let mut others = vec![body(&named), json!({ "channels": [{"ray_set": ray_set}] })];
    for (field, value) in [
        ("options", json!({"hull": {"resolution": 32}})),
        ("options", json!({"rays": {"band_edges_nm": [400.0, 700.0]}})),
        ("reuse", json!(false)),
    ] {
        let mut other = body(&ray_set);
        other[field] = value;
        others.push(other);
    }
    for (field, value) in [
        ("name", json!("blue")),
        ("length_unit", json!("cm")),
        ("flux", json!({"radiant_w": 1.0})),
        ("spectrum", json!({"nm_value": [[440.0, 0.0], [450.0, 1.0], [460.0, 0.0]]})),
        ("spectrum", json!({"nm_value": [[440.0, 0.0], [450.0, 1.0], [461.0, 0.0]]})),
    ] {
        let mut other = body(&ray_set);
        other["channels"][0][field] = value;
        others.push(other);
    }
    for total in [1.0, 2.0] {
        let mut other = body(&ray_set);
        other["channels"][0]["flux"] = json!({"radiant_share": 1.0});
        other["total"] = json!({"radiant_w": total});
        others.push(other);
    }
    let before = job_count(&site).await;
    for other in &others {
        assert_eq!(site.post("/v1/jobs", other).await.status, StatusCode::ACCEPTED, "{other}");
    }
    assert_eq!(job_count(&site).await, before + others.len());
    // Another tenant's is nobody's.
    site.key = Some(site.key_of("shop", &Scope::OF_A_TENANT).await);
    let theirs = site.upload(file).await.id();
    assert_eq!(site.post("/v1/jobs", &body(&theirs)).await.status, StatusCode::ACCEPTED);
    site.key = Some(lab);
    // One that is to end gives nothing to anybody.
    let last = site.post("/v1/jobs", &json!({ "channels": [{"ray_set": ray_set, "name": "last"}] })).await;
    site.post(&format!("/v1/jobs/{}/cancel", last.id()), &json!({})).await;
    let fresh = site.post("/v1/jobs", &json!({ "channels": [{"ray_set": ray_set, "name": "last"}] })).await;
    assert!(fresh.status == StatusCode::ACCEPTED && fresh.id() != last.id());
    gate.open();
    site.until_state(&fresh.id(), "succeeded").await;
    assert_eq!(site.post("/v1/jobs", &body(&ray_set)).await.id(), first.id());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_failure_is_no_result_and_the_more_urgent_wish_holds() {
    let site = Site::start(failing(|| pipeline::Error::malformed("x.y", "found", "do"))).await;
    let body = json!({ "channels": [{"ray_set": site.ray_set().await}] });
    let failed = site.post("/v1/jobs", &body).await.id();
    site.until_state(&failed, "failed").await;
    let next = site.post("/v1/jobs", &body).await;
    assert!(next.status == StatusCode::ACCEPTED && next.id() != failed);

    let gate = Gate::new();
    let site = Site::start(held(&gate)).await;
    let ray_set = site.ray_set().await;
    let running = site.job(&ray_set).await;
    site.until_state(&running, "running").await;
    site.job(&ray_set).await;
    let with = |priority: &str| json!({ "channels": [{"ray_set": ray_set, "name": "x"}], "priority": priority });
    let waiting = site.post("/v1/jobs", &with("low")).await;
    assert_eq!((&waiting.json()["priority"], &waiting.json()["queue_position"]), (&json!("low"), &json!(2)));
    let urgent = site.post("/v1/jobs", &with("high")).await;
    assert_eq!((urgent.status, urgent.id()), (StatusCode::OK, waiting.id()));
    assert_eq!((&urgent.json()["priority"], &urgent.json()["queue_position"]), (&json!("high"), &json!(1)));
    assert_eq!(site.post("/v1/jobs", &with("normal")).await.json()["priority"], "high");
    gate.open();
}

#[tokio::test(flavor = "multi_thread")]
async fn what_was_asked_for_again_is_kept_from_then_on() {
    let (day, every) = (Duration::from_hours(24), Duration::from_millis(50));
    let retention = Retention { jobs: Some(day), ray_sets: Some(day), every };
    let site = Site::start_as(|config| Config { retention, ..config }, prompt()).await;
    let sets = [site.upload(support::rays::zemax(10)).await.id(), site.upload(support::rays::zemax(11)).await.id()];
    let bodies = sets.each_ref().map(|ray_set| json!({ "channels": [{"ray_set": ray_set}] }));
    let mut jobs = Vec::new();
    for body in &bodies {
        jobs.push(site.post("/v1/jobs", body).await.id());
    }
    for job in &jobs {
        site.until_state(job, "succeeded").await;
    }
    assert_eq!(site.post("/v1/jobs", &bodies[0]).await.status, StatusCode::OK);
    site.write(sql("UPDATE jobs SET created_ms = 0, finished_ms = 1")).await;
    site.write(sql("UPDATE ray_sets SET created_ms = 0")).await;
    let start = Instant::now();
    while site.get(&format!("/v1/ray-sets/{}", sets[1])).await.status != StatusCode::NOT_FOUND
        || site.get(&format!("/v1/jobs/{}", jobs[1])).await.status != StatusCode::NOT_FOUND
    {
        assert!(start.elapsed() < support::site::PATIENCE, "nothing is deleted");
        tokio::time::sleep(every).await;
    }
    for address in [format!("/v1/ray-sets/{}", sets[0]), format!("/v1/jobs/{}/model.zip", jobs[0])] {
        assert_eq!(site.get(&address).await.status, StatusCode::OK, "{address}");
    }
    site.write(sql("UPDATE jobs SET used_ms = 1")).await;
    while job_count(&site).await > 0 {
        assert!(start.elapsed() < support::site::PATIENCE, "it is kept for ever");
        tokio::time::sleep(every).await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_dry_run_tells_what_it_would_come_to_and_does_nothing() {
    let gate = Gate::new();
    let site = Site::start(held(&gate)).await;
    let file = support::rays::zemax(10);
    let ray_set = site.upload(file.clone()).await.id();
    let dry = async |body: &Value| site.post("/v1/jobs?dry_run=true", body).await;
    let body = json!({ "channels": [{"ray_set": ray_set}] });
    let estimate = dry(&body).await;
    assert_eq!(estimate.status, StatusCode::OK);
    let told = estimate.json();
    assert_eq!((&told["ray_count"], &told["byte_count"]), (&json!(10), &json!(file.len())));
    assert_eq!((&told["reuses"], &told["seconds"], &told["jobs_ahead"]), (&json!(null), &json!(null), &json!(0)));
    assert_eq!((&told["fits"], told["memory_limit_bytes"].as_u64()), (&json!(true), Some(site.config.memory_bytes)));
    let finer = json!({ "channels": [{"ray_set": ray_set}], "options": {"hull": {"resolution": 256}} });
    assert!(dry(&finer).await.json()["memory_bytes"].as_u64() > told["memory_bytes"].as_u64(), "{told}");
    // Refused as the real one would be.
    dry(&json!({ "channels": [{"ray_set": "x"}] })).await.is_problem(404, "ray_set.not_found");
    let twice = json!({ "channels": [{"ray_set": ray_set}, {"ray_set": ray_set}] });
    dry(&twice).await.is_problem(422, "rays.twice");
    let coarse = json!({ "channels": [{"ray_set": ray_set}], "options": {"hull": {"resolution": 1}} });
    dry(&coarse).await.is_problem(422, "options.hull_resolution");
    assert_eq!(job_count(&site).await, 0);

    let running = site.post("/v1/jobs", &body).await;
    assert_eq!(running.json()["memory_bytes"], told["memory_bytes"]);
    site.until_state(&running.id(), "running").await;
    for priority in ["high", "normal", "normal", "low"] {
        let more = json!({ "channels": [{"ray_set": ray_set}], "priority": priority, "reuse": false });
        assert_eq!(site.post("/v1/jobs", &more).await.status, StatusCode::ACCEPTED);
    }
    for (priority, ahead) in [("high", 1), ("normal", 3), ("low", 4)] {
        let new = json!({ "channels": [{"ray_set": ray_set, "name": "n"}], "priority": priority });
        assert_eq!(dry(&new).await.json()["jobs_ahead"], ahead, "{priority}");
    }
    let equal = dry(&body).await.json();
    assert!(equal["reuses"].is_string(), "{equal}");
    let anew = json!({ "channels": [{"ray_set": ray_set}], "reuse": false });
    assert_eq!(dry(&anew).await.json()["reuses"], json!(null));
    gate.open();
    site.until_state(&running.id(), "succeeded").await;
    // What is told is the median: one job of ten rays that took a known time.
    site.until(&running.id(), |_| true).await;
    site.write(sql("UPDATE jobs SET ray_count = 0 WHERE id <> $1").bind(running.id())).await;
    site.write(sql("UPDATE jobs SET started_ms = finished_ms - 5000 WHERE id = $1").bind(running.id())).await;
    let two = site.upload(support::rays::zemax(20)).await.id();
    assert_eq!(dry(&json!({ "channels": [{"ray_set": two}] })).await.json()["seconds"], 10.0);
}

#[tokio::test(flavor = "multi_thread")]
async fn lists_hold_what_was_asked_for_and_pages_of_it() {
    let gate = Gate::new();
    let site = Site::start(held(&gate)).await;
    let (a, b) = (site.upload(support::rays::zemax(10)).await.id(), site.upload(support::rays::zemax(11)).await.id());
    let mut jobs = Vec::new();
    for (k, priority) in ["normal", "high", "low", "normal"].into_iter().enumerate() {
        let ray_set = if k % 2 == 0 { &a } else { &b };
        let new = json!({ "channels": [{"ray_set": ray_set}], "priority": priority, "reuse": false });
        jobs.push(site.post("/v1/jobs", &new).await.id());
        if k == 0 {
            site.until_state(&jobs[0], "running").await;
        }
    }
    site.post(&format!("/v1/jobs/{}/cancel", jobs[1]), &json!({})).await;
    for (k, job) in jobs.iter().enumerate() {
        let at = sql("UPDATE jobs SET created_ms = $1 WHERE id = $2").bind(1000 * (k as i64 + 1)).bind(job.as_str());
        site.write(at).await;
    }
    let found = async |query: &str| {
        let (mut found, mut after) = (Vec::new(), String::new());
        loop {
            let page = site.get(&format!("/v1/jobs?limit=1&{query}{after}")).await.json();
            for job in page["jobs"].as_array().unwrap() {
                found.push(jobs.iter().position(|id| job["id"] == **id).unwrap());
            }
            let Some(next) = page["next"].as_str() else { return found };
            after = format!("&after={next}");
        }
    };
    for (query, expected) in [
        ("state=queued".to_owned(), vec![3, 2]),
        ("state=queued,running".to_owned(), vec![3, 2, 0]),
        ("state=cancelled,running,succeeded".to_owned(), vec![1, 0]),
        (format!("ray_set={a}"), vec![2, 0]),
        (format!("ray_set={b}&state=queued,cancelled"), vec![3, 1]),
        ("ray_set=00000000-0000-7000-8000-000000000000".to_owned(), vec![]),
        ("priority=normal".to_owned(), vec![3, 0]),
        ("priority=normal&state=running".to_owned(), vec![0]),
        ("created_after_ms=1000&created_before_ms=4000".to_owned(), vec![2, 1]),
        (String::new(), vec![3, 2, 1, 0]),
    ] {
        assert_eq!(found(&query).await, expected, "{query}");
    }
    for wrong in
        ["state=queued,lost", "state=", "ray_set=", "priority=urgent", "created_after_ms=-1", "created_before_ms=x"]
    {
        let refused = site.get(&format!("/v1/jobs?{wrong}")).await;
        refused.is_problem(422, "request.wrong_type");
        assert_eq!(refused.json()["at"], wrong.split('=').next().unwrap());
    }
    gate.open();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_file_that_is_here_already_is_found_by_its_digest() {
    let site = Site::start(prompt()).await;
    let file = support::rays::zemax(10);
    let here = site.upload(file.clone()).await.id();
    let other = site.ask(Method::POST, "/v1/ray-sets?name=other.dat", &[], support::rays::zemax(11)).await.id();
    let twin = site.ask(Method::POST, "/v1/ray-sets?name=other.dat", &[], file.clone()).await.id();
    let digest = support::runners::sha256(&file);
    let found = async |query: &str| {
        let list = site.get(&format!("/v1/ray-sets?{query}")).await.json();
        let ids = list["ray_sets"].as_array().unwrap().iter().map(|entry| entry["id"].as_str().unwrap().to_owned());
        ids.collect::<Vec<_>>()
    };
    assert_eq!(found(&format!("sha256={digest}")).await, [twin.clone(), here.clone()]);
    assert_eq!(found(&format!("sha256={}&limit=1&after={twin}", digest.to_uppercase())).await, [here]);
    assert_eq!(found("name=other.dat").await, [twin.clone(), other]);
    assert_eq!(found(&format!("name=other.dat&sha256={digest}")).await, [twin]);
    assert!(found(&format!("sha256={}", "0".repeat(64))).await.is_empty());
    site.get("/v1/ray-sets?sha256=abc").await.is_problem(422, "request.out_of_range");
}

#[tokio::test(flavor = "multi_thread")]
async fn an_equal_job_may_take_as_long_as_each_who_wants_it_says() {
    let gate = Gate::new();
    let site = Site::start(held(&gate)).await;
    let ray_set = site.ray_set().await;
    let body = |name: &str, timeout_s: Option<u32>| match timeout_s {
        Some(timeout_s) => json!({ "channels": [{"ray_set": ray_set, "name": name}], "timeout_s": timeout_s }),
        None => json!({ "channels": [{"ray_set": ray_set, "name": name}] }),
    };
    let ask = async |name: &str, timeout_s| {
        let reply = site.post("/v1/jobs", &body(name, timeout_s)).await;
        (reply.id(), reply.status == StatusCode::OK, reply.json()["timeout_s"].clone())
    };
    let running = ask("running", Some(100)).await.0;
    site.until_state(&running, "running").await;
    for enough in [100, 99, 1] {
        assert_eq!(ask("running", Some(enough)).await, (running.clone(), true, json!(100)));
    }
    // It would be stopped before those who ask now have their result.
    let longer = ask("running", Some(101)).await;
    assert!(longer.0 != running && !longer.1);
    assert_eq!(ask("running", None).await, (longer.0.clone(), true, json!(null)));
    let waiting = ask("waiting", Some(50)).await.0;
    for (asked, holds) in [(Some(20), json!(50)), (Some(60), json!(60)), (None, json!(null)), (Some(70), json!(null))] {
        assert_eq!(ask("waiting", asked).await, (waiting.clone(), true, holds), "{asked:?}");
    }
    gate.open();
}

#[tokio::test(flavor = "multi_thread")]
async fn what_was_answered_is_answered_again_whatever_the_limits_are_now() {
    let mut site = Site::start_as(|config| Config { job_timeout: Duration::from_secs(600), ..config }, prompt()).await;
    let body = json!({ "channels": [{"ray_set": site.ray_set().await}], "timeout_s": 300 });
    let first = under(&site, "k", &body).await;
    assert_eq!(first.status, StatusCode::ACCEPTED);
    site.until_state(&first.id(), "succeeded").await;
    site.kill().await;
    site.config.job_timeout = Duration::from_secs(60);
    site.restart(prompt()).await;
    let again = under(&site, "k", &body).await;
    assert_eq!((again.status, again.id()), (StatusCode::ACCEPTED, first.id()));
    under(&site, "other", &body).await.is_problem(422, "request.out_of_range");
}

#[tokio::test]
async fn old_keys_are_forgotten_a_thousand_at_a_time() {
    let folder = tempfile::tempdir().unwrap();
    let storage = support::site::stores(folder.path()).await;
    let insert = "WITH RECURSIVE numbers (number) AS \
                  (SELECT CAST(1 AS BIGINT) UNION ALL SELECT number + 1 FROM numbers WHERE number < 2503) \
                  INSERT INTO idempotency_keys (tenant, key, request_sha256, job_id, reused, created_ms) \
                  SELECT 't', 'k' || number, '', '', 0, {now} - CASE WHEN number > 2500 THEN 0 ELSE 86400000 END \
                  FROM numbers";
    storage.records.write(sql(insert)).await.unwrap();
    let queue = Queue::new(storage.clone(), Duration::from_secs(60), 3);
    for forgotten in [1000, 1000, 500, 0] {
        assert_eq!(queue.delete_old_keys().await.unwrap(), forgotten);
    }
    assert_eq!(storage.records.read(sql("SELECT key FROM idempotency_keys")).await.unwrap().len(), 3);
}
