//! Who is next: tenants in turn, each by priority and age, within the memory and the time there is.

use axum::http::StatusCode;
use serde_json::json;
use service::Config;
use service::accounts::access::Scope;
use service::accounts::tenants;
use service::accounts::tenants::Tenant;
use service::failure::Failure;
use service::jobs::memory_budget::Memory;
use service::jobs::queue::{Claim, Queue};
use service::metrics::Metrics;
use service::storage::Storage;
use service::storage::records::statement::sql;
use std::time::{Duration, Instant};
use support::runners::{Gate, held, prompt};
use support::site::{Site, stores};

/// Waiting jobs of `tenant`, `count` of them, called `<tenant>-<number>` in the order of their age.
async fn line(storage: &Storage, tenant: &str, count: i64, priority: i64, memory_bytes: i64) {
    let known = "INSERT INTO tenants (id) VALUES ($1) ON CONFLICT (id) DO NOTHING";
    storage.records.write(sql(known).bind(tenant)).await.unwrap();
    let insert = "WITH RECURSIVE numbers (number) AS \
                  (SELECT CAST(1 AS BIGINT) UNION ALL SELECT number + 1 FROM numbers WHERE number < $1) \
                  INSERT INTO jobs (tenant, id, state, options, attempt, max_attempts, fence, cancel_requested, \
                  stage_progress, notices, created_ms, priority, memory_bytes) \
                  SELECT $2, $2 || '-' || $3 || '-' || (100000 + number), 'queued', '{}', 0, 3, 0, 0, 0, '[]', {now}, \
                  $4, $5 FROM numbers";
    let insert = sql(insert).bind(count).bind(tenant).bind(priority.to_string()).bind(priority).bind(memory_bytes);
    assert_eq!(storage.records.write(insert).await.unwrap(), count.unsigned_abs());
}

fn queue(storage: &Storage) -> Queue {
    Queue::new(storage.clone(), Duration::from_secs(600), 3)
}

/// A claim by a slot that has none.
async fn claim(queue: &Queue, slot: usize) -> Option<Claim> {
    queue.of_slot(slot).claim().await.unwrap()
}

#[tokio::test]
async fn a_thousand_jobs_of_one_tenant_delay_another_by_those_that_run() {
    let folder = tempfile::tempdir().unwrap();
    let storage = stores(folder.path()).await;
    let queue = queue(&storage);
    line(&storage, "big", 1000, 1, 0).await;
    let running = [claim(&queue, 0).await.unwrap(), claim(&queue, 1).await.unwrap()];
    assert!(running.iter().all(|claim| claim.tenant == "big"), "nobody else is there");
    line(&storage, "small", 1, 1, 0).await;
    assert!(queue.fail(&running[0], &Failure::panicked()).await.unwrap());
    let next = claim(&queue, 0).await.unwrap();
    assert_eq!(next.tenant, "small", "the first slot that is free is its");
    assert!(queue.fail(&next, &Failure::panicked()).await.unwrap());
    assert_eq!(claim(&queue, 0).await.unwrap().id, "big-1-100003");
}

#[tokio::test]
async fn one_slot_serves_tenants_in_turn_and_each_by_priority_then_age() {
    let folder = tempfile::tempdir().unwrap();
    let storage = stores(folder.path()).await;
    let queue = queue(&storage);
    for (tenant, priority) in [("a", 2), ("a", 1), ("a", 0), ("b", 1), ("c", 2)] {
        line(&storage, tenant, 2, priority, 0).await;
    }
    let mut order = Vec::new();
    while let Some(claim) = claim(&queue, 0).await {
        assert!(queue.fail(&claim, &Failure::panicked()).await.unwrap());
        order.push(claim.id);
        // Served in the same millisecond, nobody can tell who was first.
        tokio::time::sleep(Duration::from_millis(3)).await;
    }
    let expected = ["a-0-100001", "b-1-100001", "c-2-100001", "a-0-100002", "b-1-100002", "c-2-100002"];
    assert_eq!(order[..6], expected);
    assert_eq!(order[6..], ["a-1-100001", "a-1-100002", "a-2-100001", "a-2-100002"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn nodes_that_look_at_once_take_different_jobs_and_no_more_than_a_tenant_may_run() {
    let folder = tempfile::tempdir().unwrap();
    let storage = stores(folder.path()).await;
    line(&storage, "one", 40, 1, 0).await;
    tenants::set(&storage.records, &Tenant { id: "one".into(), running_jobs: Some(5), ..Tenant::default() })
        .await
        .unwrap();
    let nodes: Vec<Queue> = (0..4).map(|_| queue(&storage)).collect();
    let all = nodes.iter().flat_map(|node| (0..3).map(|slot| claim(node, slot)));
    let mut taken: Vec<String> = futures::future::join_all(all).await.into_iter().flatten().map(|c| c.id).collect();
    taken.sort();
    // All of the five places, also while others were at the same tenant: nobody goes away with nothing.
    assert_eq!(taken, (1..=5).map(|k| format!("one-1-{}", 100_000 + k)).collect::<Vec<_>>());
}

#[tokio::test]
async fn a_job_that_does_not_fit_now_is_waited_for_and_one_that_never_fits_is_left_to_others() {
    let folder = tempfile::tempdir().unwrap();
    let storage = stores(folder.path()).await;
    let within = |bytes| queue(&storage).within(Memory::new(bytes, Metrics::new()), 1, Duration::from_secs(60));
    let (large, small) = (within(100), within(50));
    for (priority, memory_bytes) in [(0, 60), (1, 60), (2, 10)] {
        line(&storage, "t", 1, priority, memory_bytes).await;
    }
    let first = claim(&large, 0).await.unwrap();
    assert_eq!((first.id.as_str(), large.memory().used_bytes()), ("t-0-100001", 60));
    // 40 are left, 10 would fit: what is next goes first all the same, or it might never.
    assert!(claim(&large, 1).await.is_none());
    // Another process has 50: the next can never be its.
    let third = claim(&small, 0).await.unwrap();
    assert_eq!(third.id, "t-2-100001");
    assert!(claim(&small, 1).await.is_none());
    drop(first);
    assert_eq!(claim(&large, 1).await.unwrap().id, "t-1-100001");
    // What was refused is as it was.
    let served = storage.records.read_one(sql("SELECT attempt FROM jobs WHERE id = 't-1-100001'")).await.unwrap();
    assert_eq!(served.unwrap().number("attempt").unwrap(), 1);
}

#[tokio::test(flavor = "multi_thread")]
async fn who_watches_sees_that_a_job_waits_for_memory() {
    let gate = Gate::new();
    let two = |config: Config| Config { concurrency: 2, ..config };
    let site = Site::start_as(two, held(&gate)).await;
    let ray_set = site.ray_set().await;
    let all = i64::try_from(site.config.memory_bytes).unwrap();
    let number = async |name: &str| {
        let text = String::from_utf8(site.get("/metrics").await.body).unwrap();
        let line = text.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(' ')).map(str::parse::<i64>);
        line.unwrap_or_else(|| panic!("no {name} in {text}")).unwrap()
    };
    let running = site.job(&ray_set).await;
    let job = site.until_state(&running, "running").await;
    assert_eq!(number("lampwright_job_memory_bytes").await, job["memory_bytes"].as_i64().unwrap());
    // It needs all there is: it fits alone.
    let storage = Storage::open(&site.config.database_url(), &site.config.storage_url()).await.unwrap();
    line(&storage, "default", 1, 1, all).await;
    let start = Instant::now();
    while number("lampwright_waits_for_memory").await == 0 {
        assert!(start.elapsed() < support::site::PATIENCE, "nobody waits");
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    gate.open();
    site.until_state(&running, "succeeded").await;
    // It has no channels; what counts is that it was begun.
    site.until("default-1-100001", |job| job["attempt"] == 1).await;
    while number("lampwright_waits_for_memory").await + number("lampwright_job_memory_bytes").await > 0 {
        assert!(start.elapsed() < support::site::PATIENCE, "it never ended");
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn the_place_in_the_line_tells_nothing_of_other_tenants() {
    let gate = Gate::new();
    let mut site = Site::start_as(|config| Config { auth: true, ..config }, held(&gate)).await;
    site.key = Some(site.key_of("lab", &Scope::OF_A_TENANT).await);
    let ray_set = site.ray_set().await;
    let jobs = [site.job(&ray_set).await, site.job(&ray_set).await, site.job(&ray_set).await];
    site.until_state(&jobs[0], "running").await;
    site.key = Some(site.key_of("shop", &Scope::OF_A_TENANT).await);
    let ray_set = site.ray_set().await;
    let place = async |job: &str| site.get(&format!("/v1/jobs/{job}")).await.json()["queue_position"].clone();
    let (first, second) = (site.job(&ray_set).await, site.job(&ray_set).await);
    assert_eq!((place(&first).await, place(&second).await), (json!(1), json!(2)));
    let urgent = json!({ "channels": [{"ray_set": ray_set}], "reuse": false, "priority": "high" });
    assert_eq!(site.post("/v1/jobs", &urgent).await.json()["queue_position"], 1);
    assert_eq!((place(&first).await, place(&second).await), (json!(2), json!(3)));
    gate.open();
}

/// Both are claimed from in turns, so that what else the machine does delays both.
#[tokio::test]
async fn a_claim_among_ten_thousand_jobs_costs_little_more_than_one_among_a_hundred() {
    let folders = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let [few, many] = [stores(folders[0].path()).await, stores(folders[1].path()).await];
    for tenant in 0..50 {
        line(&few, &format!("tenant-{tenant:02}"), 2, i64::from(tenant % 3), 0).await;
        line(&many, &format!("tenant-{tenant:02}"), 200, i64::from(tenant % 3), 0).await;
    }
    let (queues, mut times) = ([queue(&few), queue(&many)], [Vec::new(), Vec::new()]);
    for slot in 0..100 {
        for (queue, times) in queues.iter().zip(&mut times) {
            let start = Instant::now();
            assert!(claim(queue, slot).await.is_some());
            times.push(start.elapsed());
        }
    }
    times.iter_mut().for_each(|times| times.sort());
    let [few, many] = times.map(|times| times[50]);
    println!("a claim, median: among 100 jobs {few:?}, among 10 000 {many:?}");
    assert!(many < few * 10, "{many:?} among 10 000 jobs, {few:?} among 100");
}

#[tokio::test(flavor = "multi_thread")]
async fn an_attempt_that_takes_too_long_is_stopped_and_says_where() {
    let gate = Gate::new();
    let limited = |config: Config| Config { job_timeout: Duration::from_secs(3600), ..config };
    let site = Site::start_as(limited, held(&gate)).await;
    let ray_set = site.ray_set().await;
    let new = |timeout_s| json!({ "channels": [{"ray_set": ray_set}], "timeout_s": timeout_s, "reuse": false });
    for wrong in [0, 3601] {
        let refused = site.post("/v1/jobs", &new(wrong)).await;
        refused.is_problem(422, "request.out_of_range");
        assert_eq!(refused.json()["at"], "timeout_s");
        assert!(refused.json()["detail"].as_str().unwrap().contains("3600"));
    }
    let job = site.post("/v1/jobs", &new(1)).await;
    assert_eq!((job.status, &job.json()["timeout_s"]), (StatusCode::ACCEPTED, &json!(1)));
    let failed = site.until_state(&job.id(), "failed").await;
    assert_eq!(failed["problem"]["code"], "job.timeout");
    assert_eq!(failed["problem"]["detail"].as_str().unwrap().matches("\"flux\" after 1 s").count(), 1, "{failed}");
    assert!(failed["problem"]["remedy"].is_string());
    assert!(failed["finished_ms"].as_i64().unwrap() - failed["started_ms"].as_i64().unwrap() >= 1000);
    assert_eq!((&failed["attempt"], gate.stopped()), (&json!(1), 1), "it is not tried again");
    gate.open();
    let next = site.job(&ray_set).await;
    site.until_state(&next, "succeeded").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn the_services_own_limit_holds_where_a_job_says_nothing() {
    let gate = Gate::new();
    let brief = |config: Config| Config { job_timeout: Duration::from_millis(200), ..config };
    let site = Site::start_as(brief, held(&gate)).await;
    let ray_set = site.ray_set().await;
    let job = site.job(&ray_set).await;
    let failed = site.until_state(&job, "failed").await;
    assert_eq!(failed["problem"]["code"], "job.timeout");
    assert!(failed["problem"]["detail"].as_str().unwrap().contains("0.2 s"), "{failed}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_job_that_can_never_fit_is_refused_with_figures() {
    let site = Site::start_as(|config| Config { memory_bytes: 5 << 20, ..config }, prompt()).await;
    let ray_set = site.ray_set().await;
    let new = json!({ "channels": [{"ray_set": ray_set}], "options": {"hull": {"resolution": 256}} });
    let refused = site.post("/v1/jobs", &new).await;
    refused.is_problem(422, "job.too_large");
    let problem = refused.json();
    assert!(problem["detail"].as_str().unwrap().contains(" together may use 5 MiB"), "{problem}");
    assert!(problem["remedy"].as_str().unwrap().contains("hull.resolution"), "{problem}");
    assert!(site.rows(sql("SELECT id FROM jobs")).await.is_empty());
    let estimate = site.post("/v1/jobs?dry_run=true", &new).await.json();
    assert_eq!((&estimate["fits"], &estimate["memory_limit_bytes"]), (&json!(false), &json!(5 << 20)), "{estimate}");
}

/// The API told what the job needs on its own threads; who computes it has others.
#[tokio::test]
async fn a_worker_with_more_threads_counts_what_they_need() {
    let folder = tempfile::tempdir().unwrap();
    let storage = stores(folder.path()).await;
    line(&storage, "t", 1, 1, 60).await;
    storage.records.write(sql("UPDATE jobs SET memory_threads = 2, thread_bytes = 20")).await.unwrap();
    let on = |threads| queue(&storage).within(Memory::new(100, Metrics::new()), threads, Duration::from_secs(60));
    assert!(claim(&on(5), 0).await.is_none(), "it needs 120");
    assert_eq!((on(5).too_large().await.unwrap(), on(4).too_large().await.unwrap()), (1, 0));
    for (threads, held_bytes) in [(4, 100), (3, 80), (2, 60), (1, 60)] {
        let worker = on(threads);
        let claim = claim(&worker, 0).await.unwrap();
        assert_eq!(worker.memory().used_bytes(), held_bytes, "{threads} threads");
        assert!(worker.release(&claim).await.unwrap());
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn what_was_queued_before_there_was_less_memory_does_not_wait_in_silence() {
    let gate = Gate::new();
    let mut site = Site::start(prompt()).await;
    let ray_set = site.ray_set().await;
    let named = |name: &str| json!({ "channels": [{"ray_set": ray_set, "name": name}] });
    let done = site.post("/v1/jobs", &named("done")).await.id();
    site.until_state(&done, "succeeded").await;
    site.kill().await;
    site.restart(held(&gate)).await;
    let running = site.post("/v1/jobs", &named("running")).await.id();
    site.until_state(&running, "running").await;
    let waiting = site.post("/v1/jobs", &named("waiting")).await.id();
    assert_eq!(site.post("/v1/jobs", &named("waiting")).await.id(), waiting);
    site.kill().await;
    site.config.memory_bytes = 5 << 20;
    site.restart(prompt()).await;
    if site.config.is_alone() {
        for job in [&running, &waiting] {
            let failed = site.until_state(job, "failed").await;
            assert_eq!(failed["problem"]["code"], "job.too_large");
            assert!(failed["problem"]["detail"].as_str().unwrap().contains(" 5 MiB"), "{failed}");
        }
        assert_eq!(too_large(&site).await, 0);
    } else {
        // Another process may have more.
        let start = Instant::now();
        while too_large(&site).await != 2 {
            assert!(start.elapsed() < support::site::PATIENCE, "nobody tells");
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    }
    site.post("/v1/jobs", &named("waiting")).await.is_problem(422, "job.too_large");
    assert_eq!(site.post("/v1/jobs?dry_run=true", &named("waiting")).await.json()["reuses"], json!(null));
    let again = site.post("/v1/jobs", &named("done")).await;
    assert_eq!((again.status, again.id()), (StatusCode::OK, done), "a result needs no memory");
}

async fn too_large(site: &Site) -> i64 {
    let text = String::from_utf8(site.get("/metrics").await.body).unwrap();
    let number = text.lines().find_map(|line| line.strip_prefix("lampwright_jobs_too_large ")).map(str::parse);
    number.unwrap_or_else(|| panic!("not told in {text}")).unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_waiting_job_that_fits_nobody_here_is_told_of_and_not_handed_out() {
    let gate = Gate::new();
    let site = Site::start_as(|config| config, held(&gate)).await;
    let ray_set = site.ray_set().await;
    let running = site.job(&ray_set).await;
    site.until_state(&running, "running").await;
    let body = json!({ "channels": [{"ray_set": ray_set, "name": "x"}] });
    let stuck = site.post("/v1/jobs", &body).await.id();
    assert_eq!(too_large(&site).await, 0);
    let more = i64::try_from(site.config.memory_bytes).unwrap() + 1;
    site.write(sql("UPDATE jobs SET memory_bytes = $1 WHERE id = $2").bind(more).bind(stuck.as_str())).await;
    assert_eq!(too_large(&site).await, 1);
    let other = site.post("/v1/jobs", &body).await;
    assert!(other.status == StatusCode::ACCEPTED && other.id() != stuck, "{other:?}");
    gate.open();
    site.until_state(&other.id(), "succeeded").await;
    assert_eq!(too_large(&site).await, 1);
}
