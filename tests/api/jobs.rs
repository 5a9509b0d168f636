use axum::http::StatusCode;
use serde_json::json;
use service::Config;
use service::failure::Failure;
use service::jobs::estimate::JobPlan;
use service::jobs::memory_budget::Memory;
use service::jobs::queue::{Claim, Queue};
use service::jobs::request::NewJob;
use service::jobs::{State, TRANSITIONS, queue};
use service::metrics::Metrics;
use service::ray_sets::rows;
use service::storage::records::statement::sql;
use std::time::{Duration, Instant};
use support::runners::{Gate, held, prompt, uncancellable};
use support::site::{Site, known, stores};

#[tokio::test(flavor = "multi_thread")]
async fn the_queue_is_worked_in_order_and_tells_the_place() {
    let gate = Gate::new();
    let site = Site::start(held(&gate)).await;
    let ray_set = site.ray_set().await;
    let first = site.job(&ray_set).await;
    site.until_state(&first, "running").await;
    let mut waiting = Vec::new();
    for _ in 0..3 {
        waiting.push(site.job(&ray_set).await);
    }
    let place = async |job: &str| site.get(&format!("/v1/jobs/{job}")).await.json()["queue_position"].clone();
    assert_eq!(place(&first).await, json!(null));
    for (job, expected) in waiting.iter().zip(1..) {
        assert_eq!(place(job).await, expected);
    }
    // Who leaves makes room.
    site.post(&format!("/v1/jobs/{}/cancel", waiting[0]), &json!({})).await;
    assert_eq!(place(&waiting[0]).await, json!(null));
    assert_eq!(place(&waiting[2]).await, 2);
    gate.open();
    let second = site.until_state(&waiting[1], "succeeded").await;
    let third = site.until_state(&waiting[2], "succeeded").await;
    assert!(second["finished_ms"].as_i64() <= third["started_ms"].as_i64());
    assert_eq!(gate.begun(), 3);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_queued_job_is_cancelled_at_once() {
    let gate = Gate::new();
    let site = Site::start(held(&gate)).await;
    let ray_set = site.ray_set().await;
    let (first, second) = (site.job(&ray_set).await, site.job(&ray_set).await);
    site.until_state(&first, "running").await;
    let reply = site.post(&format!("/v1/jobs/{second}/cancel"), &json!({})).await;
    assert_eq!(reply.status, StatusCode::ACCEPTED);
    assert_eq!(reply.json()["state"], "cancelled");
    assert!(reply.json()["finished_ms"].is_i64());
    gate.open();
    site.until_state(&first, "succeeded").await;
    tokio::time::sleep(Duration::from_millis(300)).await;
    assert_eq!(gate.begun(), 1);
    site.post(&format!("/v1/jobs/{second}/cancel"), &json!({})).await.is_problem(409, "job.ended");
    site.post(&format!("/v1/jobs/{first}/cancel"), &json!({})).await.is_problem(409, "job.ended");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_running_job_is_cancelled_long_before_its_lease_ends() {
    let gate = Gate::new();
    // The lease that a real service has.
    let real = |config: Config| Config { lease: Config::new("").lease, ..config };
    let site = Site::start_as(real, held(&gate)).await;
    let ray_set = site.ray_set().await;
    let job = site.job(&ray_set).await;
    site.until(&job, |job| job["stage"] == "flux").await;
    let asked = Instant::now();
    let reply = site.post(&format!("/v1/jobs/{job}/cancel"), &json!({})).await;
    assert_eq!((reply.status, &reply.json()["cancel_requested"]), (StatusCode::ACCEPTED, &json!(true)));
    let cancelled = site.until_state(&job, "cancelled").await;
    println!("cancelled after {:?}; without other work on the machine that is below 2 s", asked.elapsed());
    assert!(asked.elapsed() < site.config.lease / 2, "{:?}", asked.elapsed());
    assert_eq!((gate.begun(), gate.stopped()), (1, 1));
    assert_eq!(cancelled["problem"], json!(null));
    // The slot is free again.
    gate.open();
    let next = site.job(&ray_set).await;
    site.until_state(&next, "succeeded").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_cancelled_job_gives_nothing_even_if_it_came_to_its_end() {
    let gate = Gate::new();
    let site = Site::start(uncancellable(&gate)).await;
    let ray_set = site.ray_set().await;
    let job = site.job(&ray_set).await;
    site.until_state(&job, "running").await;
    site.post(&format!("/v1/jobs/{job}/cancel"), &json!({})).await;
    gate.open();
    site.until_state(&job, "cancelled").await;
    site.until(&job, |_| site.blobs().len() == 1).await;
    let list = site.get(&format!("/v1/jobs/{job}/artifacts")).await.json();
    assert_eq!(list, json!({"artifacts": [], "zip": null}));
}

#[tokio::test(flavor = "multi_thread")]
async fn what_is_in_use_cannot_be_deleted() {
    let gate = Gate::new();
    let site = Site::start(held(&gate)).await;
    let ray_set = site.ray_set().await;
    let (running, queued) = (site.job(&ray_set).await, site.job(&ray_set).await);
    site.until_state(&running, "running").await;
    site.delete(&format!("/v1/jobs/{running}")).await.is_problem(409, "job.unfinished");
    site.delete(&format!("/v1/jobs/{queued}")).await.is_problem(409, "job.unfinished");
    site.delete(&format!("/v1/ray-sets/{ray_set}")).await.is_problem(409, "ray_set.in_use");
    site.post(&format!("/v1/jobs/{queued}/cancel"), &json!({})).await;
    site.delete(&format!("/v1/ray-sets/{ray_set}")).await.is_problem(409, "ray_set.in_use");
    gate.open();
    site.until_state(&running, "succeeded").await;
    assert_eq!(site.delete(&format!("/v1/ray-sets/{ray_set}")).await.status, StatusCode::NO_CONTENT);
    // An ended job outlives its ray set, with all it gave.
    assert_eq!(site.get(&format!("/v1/jobs/{running}/model.zip")).await.status, StatusCode::OK);
    assert_eq!(site.get(&format!("/v1/jobs/{running}")).await.json()["channels"], json!([{ "ray_set": ray_set }]));
    assert_eq!(site.delete(&format!("/v1/jobs/{queued}")).await.status, StatusCode::NO_CONTENT);
    assert_eq!(site.delete(&format!("/v1/jobs/{running}")).await.status, StatusCode::NO_CONTENT);
    assert!(site.blobs().is_empty());
}

#[tokio::test(flavor = "multi_thread")]
async fn pages_hold_every_entry_once_newest_first() {
    let gate = Gate::new();
    let site = Site::start(held(&gate)).await;
    let mut ray_sets = Vec::new();
    let mut jobs = Vec::new();
    for _ in 0..5 {
        ray_sets.push(site.ray_set().await);
        jobs.push(site.job(ray_sets.last().unwrap()).await);
    }
    ray_sets.reverse();
    jobs.reverse();
    for (path, key, expected) in [("/v1/jobs", "jobs", &jobs), ("/v1/ray-sets", "ray_sets", &ray_sets)] {
        for limit in [1, 2, 4, 5, 6] {
            let (mut found, mut after, mut pages) = (Vec::new(), String::new(), 0);
            loop {
                let page = site.get(&format!("{path}?limit={limit}{after}")).await.json();
                let entries = page[key].as_array().unwrap();
                assert!(entries.len() <= limit);
                found.extend(entries.iter().map(|entry| entry["id"].as_str().unwrap().to_owned()));
                pages += 1;
                let Some(next) = page["next"].as_str() else { break };
                after = format!("&after={next}");
            }
            assert_eq!(&found, expected, "{path} by {limit}");
            assert_eq!(pages, 5_usize.div_ceil(limit));
        }
    }
    // What names no entry would begin the list anew for ever.
    for path in ["/v1/jobs", "/v1/ray-sets", "/v1/spectra", "/v1/uploads", "/v1/webhooks"] {
        assert_eq!(site.get(&format!("{path}?after=")).await.status, StatusCode::OK, "{path}");
        let refused = site.get(&format!("{path}?after=zzz")).await;
        refused.is_problem(422, "request.wrong_type");
        assert_eq!(refused.json()["at"], "after", "{path}");
    }
    site.until_state(jobs.last().unwrap(), "running").await;
    let of =
        async |state: &str| site.get(&format!("/v1/jobs?state={state}")).await.json()["jobs"].as_array().unwrap().len();
    assert_eq!((of("running").await, of("queued").await, of("succeeded").await), (1, 4, 0));
    gate.open();
    site.until_state(&jobs[0], "succeeded").await;
    assert_eq!((of("running").await, of("queued").await, of("succeeded").await), (0, 0, 5));
}

/// Queues a job of which nothing is known before.
async fn enqueue(queue: &Queue, ray_set: &str) -> Result<String, queue::Error> {
    let queued = queue.enqueue("default", &NewJob::of(ray_set), &JobPlan::default(), None).await;
    queued.map(|queued| queued.id)
}

#[tokio::test]
async fn a_slot_that_did_not_hear_of_its_claim_takes_the_job_back() {
    let folder = tempfile::tempdir().unwrap();
    let storage = stores(folder.path()).await;
    known(&storage, "r").await;
    let queue = Queue::new(storage.clone(), Duration::from_secs(60), 3);
    let (first, second) = (queue.of_slot(0), queue.of_slot(1));
    let id = enqueue(&queue, "r").await.unwrap();
    // The database made this claim; that the connection broke before its answer is played by not looking at it.
    drop(first.claim().await.unwrap());
    assert!(second.claim().await.unwrap().is_none(), "another slot of this process may be at it");
    let again = first.claim().await.unwrap().unwrap();
    assert_eq!((again.id, again.attempt, again.fence), (id, 2, 2));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_ray_set_is_never_deleted_under_a_job_that_is_being_queued() {
    let folder = tempfile::tempdir().unwrap();
    let storage = stores(folder.path()).await;
    let queue = Queue::new(storage.clone(), Duration::from_secs(60), 3);
    let mut outcomes = [0, 0];
    for round in 0..60 {
        let id = format!("r{round}");
        known(&storage, &id).await;
        // Now the one begins first, now the other, by less than either takes.
        let head_start = Duration::from_micros(100 * (round / 2));
        let (first, second) = if round % 2 == 0 { (Duration::ZERO, head_start) } else { (head_start, Duration::ZERO) };
        let enqueue = tokio::spawn({
            let (queue, id) = (queue.clone(), id.clone());
            async move {
                tokio::time::sleep(first).await;
                enqueue(&queue, &id).await.is_ok()
            }
        });
        tokio::time::sleep(second).await;
        let deleted =
            matches!(rows::delete(&storage.records, "default", &id).await.unwrap(), rows::Deletion::Deleted(_));
        let queued = enqueue.await.unwrap();
        assert!(queued != deleted, "round {round}: queued {queued}, deleted {deleted}");
        outcomes[usize::from(queued)] += 1;
    }
    println!("deleted {}, queued {}", outcomes[0], outcomes[1]);
}

/// Every change that the queue can make, tried from every state: what happens is exactly the table.
#[tokio::test]
async fn only_the_transitions_of_the_table_happen() {
    let folder = tempfile::tempdir().unwrap();
    let storage = stores(folder.path()).await;
    known(&storage, "r").await;
    let lease = Duration::from_secs(60);
    let (ours, theirs) = (Queue::new(storage.clone(), lease, 3), Queue::new(storage.clone(), lease, 3));
    let mut seen = Vec::new();
    for from in State::ALL {
        for change in
            ["claim", "cancel", "renew_lease", "finish", "fail", "stop", "release", "retry", "give_up", "sweep"]
        {
            for (cancel, attempt, expired) in [(0, 1, 0), (1, 1, 0), (0, 3, 1), (1, 1, 1), (0, 1, 1)] {
                storage.records.write(sql("DELETE FROM jobs")).await.unwrap();
                let id = enqueue(&ours, "r").await.unwrap();
                let set = "UPDATE jobs SET state = $1, fence = 7, attempt = $2, cancel_requested = $3, lease_owner = 'gone', \
                           lease_until_ms = CASE WHEN $1 = 'queued' THEN NULL WHEN $4 = 1 THEN 0 ELSE {now} + 60000 END \
                           WHERE id = $5";
                let set = sql(set).bind(from.name()).bind(attempt).bind(cancel).bind(i64::from(expired));
                storage.records.write(set.bind(id.as_str())).await.unwrap();
                let (tenant, options) = ("default".into(), "{}".into());
                let claim = Claim { id: id.clone(), tenant, fence: 7, attempt, options, ..Claim::default() };
                // Any answer, also a refusal: what counts is the row.
                match change {
                    // Claiming sweeps first; that is tried by itself.
                    "claim" if expired == 0 => theirs.claim().await.map(|_| ()).unwrap(),
                    "claim" => continue,
                    "cancel" => ours.cancel("default", &id).await.unwrap_or_default(),
                    "renew_lease" => ours.renew_lease(&claim, Some("hull"), 0.5).await.map(|_| ()).unwrap(),
                    "finish" => ours.finish(&claim, &[], &[]).await.map(|_| ()).unwrap(),
                    "fail" => ours.fail(&claim, &Failure::panicked()).await.map(|_| ()).unwrap(),
                    "stop" => ours.stop(&claim).await.map(|_| ()).unwrap(),
                    "release" => ours.release(&claim).await.map(|_| ()).unwrap(),
                    "retry" => ours.retry(&claim).await.map(|_| ()).unwrap(),
                    "give_up" => {
                        storage.records.write(sql("UPDATE jobs SET memory_bytes = 2")).await.unwrap();
                        let small = ours.clone().within(Memory::new(1, Metrics::new()), 1, lease);
                        small.give_up().await.unwrap();
                    }
                    // Recovery is a sweep of everything that runs.
                    _ => ours.recover().await.unwrap(),
                }
                let rows = storage.records.read(sql("SELECT state FROM jobs")).await.unwrap();
                let to = State::parse(&rows[0].text("state").unwrap()).unwrap();
                if to != from {
                    let legal = TRANSITIONS.iter().any(|(a, b, who)| (*a, *b) == (from, to) && who.contains(change));
                    assert!(legal, "{change} made {from:?} into {to:?}");
                    seen.push((from, to, change));
                }
            }
        }
    }
    for (from, to, who) in TRANSITIONS.iter().filter(|(from, to, _)| from != to) {
        for change in who.split(';').map(|who| who.split(',').next().unwrap().trim()) {
            assert!(seen.contains(&(*from, *to, change)), "{change} never made {from:?} into {to:?}");
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn options_left_out_are_told_as_null_and_stored_as_sent() {
    let site = Site::start(prompt()).await;
    let id = site.ray_set().await;
    let bands = json!([400.1, 500.2, 600.300_000_000_000_1]);
    let sent = json!({"rays": {"band_edges_nm": bands}, "artifacts": {"ies_edition": "LM-63-2019", "spectra": "both"}});
    let job = site.post("/v1/jobs", &json!({"channels": [{"ray_set": id}], "options": sent})).await.json();
    assert_eq!(job["options"]["rays"]["band_edges_nm"], bands);
    assert_eq!(job["options"]["artifacts"], json!({"ies_edition": "LM-63-2019", "spectra": "both"}));
    assert_eq!(job["options"]["hull"], json!({"emission": null, "resolution": null, "max_edge_mm": null}));
}
