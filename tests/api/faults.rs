use pipeline::Error;
use serde_json::json;
use service::jobs::worker::Runner;
use service::storage::Storage;
use service::storage::records::statement::sql;
use service::upkeep::garbage;
use service::upkeep::lock::LockError;
use service::{Config, Service, StartError};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};
use support::runners::{Gate, failing, held, panicking, prompt, uncancellable};
use support::site::Site;

#[tokio::test(flavor = "multi_thread")]
async fn a_job_accepted_is_done_after_a_kill() {
    let gate = Gate::new();
    let mut site = Site::start(held(&gate)).await;
    let ray_set = site.ray_set().await;
    let (running, queued) = (site.job(&ray_set).await, site.job(&ray_set).await);
    site.until(&running, |job| job["stage"] == "flux").await;
    site.kill().await;
    site.restart(prompt()).await;
    let done = site.until_state(&running, "succeeded").await;
    assert_eq!(done["attempt"], 2);
    assert_eq!(site.until_state(&queued, "succeeded").await["attempt"], 1);
    // The killed attempt was told, and nothing of it came through.
    assert_eq!((gate.begun(), gate.stopped()), (1, 1));
    let blobs = site.blobs();
    assert_eq!(
        blobs.iter().filter(|blob| blob.starts_with(&format!("artifacts/{running}/2/"))).count(),
        4,
        "{blobs:?}"
    );
    assert_eq!(blobs.len(), 1 + 4 + 4);
    assert_eq!(site.rows(sql("SELECT name FROM artifacts")).await.len(), 8);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_job_that_kills_its_worker_stops_after_its_attempts() {
    let gate = Gate::new();
    let mut site = Site::start(held(&gate)).await;
    let ray_set = site.ray_set().await;
    let poison = site.job(&ray_set).await;
    for attempt in 1..=3 {
        site.until(&poison, |job| job["state"] == "running" && job["attempt"] == attempt).await;
        while gate.begun() < attempt {
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
        site.kill().await;
        site.restart(held(&gate)).await;
    }
    let failed = site.until_state(&poison, "failed").await;
    assert_eq!((&failed["problem"]["code"], &failed["attempt"]), (&json!("job.worker_lost"), &json!(3)));
    assert!(failed["finished_ms"].is_i64());
    // The queue is not blocked by it.
    gate.open();
    let next = site.job(&ray_set).await;
    site.until_state(&next, "succeeded").await;
    assert_eq!(gate.begun(), 4);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_job_cancelled_before_the_kill_stays_cancelled() {
    let gate = Gate::new();
    let mut site = Site::start(uncancellable(&gate)).await;
    let ray_set = site.ray_set().await;
    let job = site.job(&ray_set).await;
    site.until_state(&job, "running").await;
    site.post(&format!("/v1/jobs/{job}/cancel"), &json!({})).await;
    site.kill().await;
    site.restart(prompt()).await;
    assert_eq!(site.until_state(&job, "cancelled").await["attempt"], 1);
    gate.open();
}

#[tokio::test(flavor = "multi_thread")]
async fn what_a_kill_left_in_the_store_is_swept_and_nothing_else() {
    // Elsewhere only age can tell: `garbage.rs`.
    if support::engines::are_shared() {
        return;
    }
    let mut site = Site::start(prompt()).await;
    let ray_set = site.ray_set().await;
    let job = site.job(&ray_set).await;
    site.until_state(&job, "succeeded").await;
    let before = site.blobs();
    site.kill().await;
    let blobs = site.config.data.join("blobs");
    for orphan in [format!("ray-sets/{GONE}/000000"), format!("artifacts/{job}/9/0000"), format!("probes/{GONE}")] {
        let path = blobs.join(orphan);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, b"orphan").unwrap();
    }
    // What the store itself leaves when it is killed while it writes.
    std::fs::write(blobs.join(format!("ray-sets/{ray_set}/000001#1")), b"half").unwrap();
    site.restart(prompt()).await;
    assert_eq!(site.blobs(), before);
}

#[tokio::test(flavor = "multi_thread")]
async fn garbage_is_what_no_row_names_nobody_writes_and_no_attempt_may_publish() {
    let gate = Gate::new();
    let site = Site::start(held(&gate)).await;
    let ray_set = site.ray_set().await;
    let job = site.job(&ray_set).await;
    site.until_state(&job, "running").await;
    let storage = Storage::open(&site.config.database_url(), &site.config.storage_url()).await.unwrap();
    let at_hand = format!("artifacts/{job}/1/0000");
    for blob in [format!("ray-sets/{GONE}/000000"), format!("artifacts/{job}/0/0000"), at_hand.clone()] {
        storage.blobs.put(&blob, "bytes".into()).await.unwrap();
    }
    let collect = async |age| garbage::collect(&storage, age).await.unwrap().deleted.len();
    assert_eq!(collect(Duration::from_secs(3600)).await, 0, "too young to tell");
    assert_eq!(collect(Duration::ZERO).await, 2);
    assert_eq!(site.blobs(), [at_hand, format!("ray-sets/{ray_set}/000000")]);
    gate.open();
    site.until_state(&job, "succeeded").await;
    assert_eq!(collect(Duration::ZERO).await, 0);
    assert_eq!(site.blobs().len(), 1 + 4);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_worker_that_lost_its_lease_publishes_nothing() {
    let gate = Gate::new();
    let site = Site::start(uncancellable(&gate)).await;
    let ray_set = site.ray_set().await;
    let job = site.job(&ray_set).await;
    site.until_state(&job, "running").await;
    // Another node took it over: same row, next fence.
    let take =
        "UPDATE jobs SET fence = fence + 1, attempt = 2, lease_owner = 'another', lease_until_ms = {now} + 60000";
    assert_eq!(site.write(sql(take)).await, 1);
    gate.open();
    // This worker's end is seen by its taking the next job.
    let next = site.job(&ray_set).await;
    site.until_state(&next, "succeeded").await;
    let lost = site.get(&format!("/v1/jobs/{job}")).await.json();
    assert_eq!((&lost["state"], &lost["attempt"]), (&json!("running"), &json!(2)));
    assert!(site.rows(sql("SELECT name FROM artifacts WHERE job_id = $1").bind(job.as_str())).await.is_empty());
    let theirs = format!("artifacts/{job}");
    site.until_blobs(|blobs| !blobs.iter().any(|blob| blob.starts_with(&theirs))).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_job_whose_other_worker_fell_silent_is_taken_over() {
    let gate = Gate::new();
    let site = Site::start(prompt()).await;
    let ray_set = site.ray_set().await;
    let job = site.job(&ray_set).await;
    site.until_state(&job, "succeeded").await;
    // As if a node had begun it and its lease ran out just now.
    site.write(sql("DELETE FROM artifacts")).await;
    let silent =
        "UPDATE jobs SET state = 'running', lease_owner = 'another', lease_until_ms = {now} - 1, finished_ms = NULL";
    site.write(sql(silent)).await;
    // What was done behind the service's back is told within a poll.
    site.until(&job, |job| job["state"] == "succeeded" && job["attempt"] == 2).await;
    gate.open();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_panic_fails_its_job_only() {
    let site = Site::start(panicking("index 7 of 3")).await;
    let ray_set = site.ray_set().await;
    for _ in 0..2 {
        let job = site.job(&ray_set).await;
        let failed = site.until_state(&job, "failed").await;
        assert_eq!(failed["problem"]["code"], "job.panicked");
        assert!(
            !failed["problem"].to_string().contains("index 7 of 3"),
            "what a fault of ours was is for the log: {failed}"
        );
        assert_eq!(failed["attempt"], 1);
    }
}

/// The id of a ray set that nobody knows.
const GONE: &str = "01890000-0000-7000-8000-000000000000";

fn unreadable() -> Error {
    Error::Unreadable(std::io::Error::other("connection reset"))
}

/// Cannot read its inputs when it is begun for the first `times`.
fn unreadable_at_first(times: u32) -> Runner {
    let (begun, good) = (AtomicU32::new(0), prompt());
    Arc::new(move |inputs, options, limits, watch| match begun.fetch_add(1, Ordering::SeqCst) < times {
        true => Err(unreadable()),
        false => good(inputs, options, limits, watch),
    })
}

#[tokio::test(flavor = "multi_thread")]
async fn a_job_whose_bytes_cannot_be_read_is_begun_again_later() {
    let site = Site::start(unreadable_at_first(2)).await;
    let ray_set = site.ray_set().await;
    let start = Instant::now();
    let job = site.job(&ray_set).await;
    let waiting = site.until(&job, |job| job["state"] == "queued" && job["attempt"] == 1).await;
    assert_eq!((&waiting["problem"], &waiting["finished_ms"]), (&json!(null), &json!(null)));
    let done = site.until_state(&job, "succeeded").await;
    assert_eq!((&done["attempt"], &done["problem"]), (&json!(3), &json!(null)));
    // A third of a lease, then two thirds.
    assert!(start.elapsed() >= site.config.lease, "{:?}", start.elapsed());
    assert_eq!(site.blobs().len(), 1 + 4);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_job_whose_bytes_can_never_be_read_says_so_after_its_attempts() {
    let site = Site::start(failing(unreadable)).await;
    let ray_set = site.ray_set().await;
    let job = site.job(&ray_set).await;
    let failed = site.until_state(&job, "failed").await;
    assert_eq!((&failed["problem"]["code"], &failed["attempt"]), (&json!("bytes.unreadable"), &json!(3)));
    assert!(failed["finished_ms"].is_i64());
    assert_eq!(site.blobs().len(), 1);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_job_that_waits_for_its_next_attempt_can_be_cancelled_and_holds_up_nobody() {
    let config = |config| Config { lease: Duration::from_secs(60), ..config };
    let site = Site::start_as(config, unreadable_at_first(1)).await;
    let ray_set = site.ray_set().await;
    let (waiting, next) = (site.job(&ray_set).await, site.job(&ray_set).await);
    site.until_state(&next, "succeeded").await;
    assert_eq!(site.get(&format!("/v1/jobs/{waiting}")).await.json()["state"], "queued");
    site.post(&format!("/v1/jobs/{waiting}/cancel"), &json!({})).await;
    assert_eq!(site.until_state(&waiting, "cancelled").await["attempt"], 1);
}

#[tokio::test(flavor = "multi_thread")]
async fn every_failure_of_the_pipeline_keeps_its_code_place_and_remedy() {
    type Make = fn() -> Error;
    let cases: [(Make, &str, Option<&str>); 5] = [
        (|| Error::malformed("tm25.magic", "No.", "Look.").at_byte(20), "tm25.magic", Some("byte 20")),
        (|| Error::refused("rays.too_bad", "Too bad.", "Repair.").at_ray(7), "rays.too_bad", Some("ray 7")),
        (
            || Error::unusable("hull.wrong", "hull.resolution", "Too fine.", "Less."),
            "hull.wrong",
            Some("options.hull.resolution"),
        ),
        (|| Error::Unreadable(std::io::Error::other("disk")), "bytes.unreadable", None),
        (|| Error::Cancelled, "run.cancelled", None),
    ];
    for (make, code, at) in cases {
        let site = Site::start(failing(make)).await;
        let ray_set = site.ray_set().await;
        let job = site.job(&ray_set).await;
        let failed = site.until_state(&job, "failed").await;
        assert_eq!(failed["problem"]["code"], code);
        assert_eq!(failed["problem"]["at"].as_str(), at);
        assert!(failed["problem"]["remedy"].is_string());
        assert_eq!(failed["links"]["zip"], json!(null));
        assert_eq!(site.blobs().len(), 1);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_data_folder_has_one_service() {
    if support::engines::are_shared() {
        return;
    }
    let site = Site::start(prompt()).await;
    let second = Service::start(site.config.clone()).await;
    assert!(matches!(second, Err(StartError::DataFolder(LockError::Locked(_)))), "{:?}", second.err());
    let mut other = site.config.clone();
    other.data = site.folder.path().join("other");
    assert!(Service::start(other.clone()).await.is_ok());
    other.data = site.folder.path().join("third");
    for unsupported in [
        Config { database_url: Some("mysql://x".into()), ..other.clone() },
        Config { storage_url: Some("ftp://x".into()), ..other },
    ] {
        assert!(matches!(Service::start(unsupported).await, Err(StartError::Storage(_))));
    }
}
