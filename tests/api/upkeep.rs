use axum::body::Body;
use axum::http::{Method, StatusCode};
use serde_json::{Value, json};
use service::accounts::access::Scope;
use service::config::Retention;
use service::storage::records::statement::sql;
use service::upkeep::backup;
use service::upkeep::backup::backup;
use service::{Config, Service};
use std::time::{Duration, Instant};
use support::runners::{Gate, failing, held, prompt};
use support::site::Site;

/// The value of a number in Prometheus' text format.
pub async fn number(site: &Site, name: &str) -> f64 {
    let reply = site.get("/metrics").await;
    assert_eq!(reply.status, StatusCode::OK);
    assert_eq!(reply.header("content-type"), "text/plain; version=0.0.4; charset=utf-8");
    let text = String::from_utf8(reply.body).unwrap();
    let line = text.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(' '));
    line.unwrap_or_else(|| panic!("no {name} in {text}")).parse().unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn who_asks_for_openmetrics_gets_it_and_all_others_the_text_format() {
    let site = Site::start(prompt()).await;
    let asked = async |accept: &str| site.ask(Method::GET, "/metrics", &[("accept", accept)], Body::empty()).await;
    // What Prometheus 2.53 sends.
    let prometheus = "application/openmetrics-text;version=1.0.0;q=0.5,application/openmetrics-text;version=0.0.1;q=0.4,\
                      text/plain;version=0.0.4;q=0.3,*/*;q=0.2";
    let reply = asked(prometheus).await;
    assert_eq!(reply.header("content-type"), "application/openmetrics-text; version=1.0.0; charset=utf-8");
    assert!(reply.body.ends_with(b"# EOF\n") && reply.header("vary").to_ascii_lowercase().contains("accept"));
    for accept in ["*/*", "text/plain", "application/openmetrics-text;q=0, text/plain", "text/html"] {
        let reply = asked(accept).await;
        assert_eq!(reply.header("content-type"), "text/plain; version=0.0.4; charset=utf-8", "{accept}");
        let text = String::from_utf8(reply.body).unwrap();
        assert!(text.contains("# TYPE lampwright_requests_total counter\n") && !text.contains("# EOF"), "{text}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn the_numbers_tell_whether_it_is_stuck() {
    let gate = Gate::new();
    let site = Site::start(held(&gate)).await;
    assert_eq!(number(&site, "lampwright_oldest_queued_seconds").await, 0.0);
    let bytes = support::rays::zemax(10).len() as f64;
    let ray_set = site.ray_set().await;
    let (running, queued) = (site.job(&ray_set).await, site.job(&ray_set).await);
    site.until(&running, |job| job["stage"] == "flux").await;
    site.write(sql("UPDATE jobs SET created_ms = created_ms - 7000 WHERE id = $1").bind(queued.as_str())).await;
    for (name, expected) in [
        ("lampwright_upload_bytes_total", bytes),
        ("lampwright_uploads", 0.0),
        ("lampwright_jobs{state=\"queued\"}", 1.0),
        ("lampwright_jobs{state=\"running\"}", 1.0),
        ("lampwright_running_jobs{stage=\"flux\"}", 1.0),
        ("lampwright_running_jobs{stage=\"none\"}", 0.0),
        ("lampwright_waiting_tenants", 1.0),
        ("lampwright_longest_tenant_queue", 1.0),
        ("lampwright_overdue_jobs", 0.0),
        ("lampwright_leases_lost_total", 0.0),
        ("lampwright_requests_total{method=\"POST\",route=\"/v1/jobs\",status=\"202\"}", 2.0),
        ("lampwright_request_seconds_count{method=\"POST\",route=\"/v1/ray-sets\"}", 1.0),
    ] {
        assert_eq!(number(&site, name).await, expected, "{name}");
    }
    assert!(number(&site, "lampwright_oldest_queued_seconds").await >= 7.0);
    // Only a local disk has an end that can be measured.
    let free = number(&site, "lampwright_free_bytes").await;
    assert!(if support::engines::are_shared() { free == -1.0 } else { free > 0.0 }, "{free}");
    gate.open();
    for job in [&running, &queued] {
        site.until_state(job, "succeeded").await;
    }
    site.until(&running, |_| true).await;
    let start = Instant::now();
    // Counted after the row that clients see.
    while number(&site, "lampwright_job_attempts_total{ending=\"succeeded\"}").await < 2.0 {
        assert!(start.elapsed() < support::site::PATIENCE);
    }
    assert_eq!(number(&site, "lampwright_job_attempt_seconds_count{ending=\"succeeded\"}").await, 2.0);
    assert_eq!(number(&site, "lampwright_jobs{state=\"queued\"}").await, 0.0);
    // Addresses are not labels: a stranger cannot fill the memory with them.
    for k in 0..50 {
        site.get(&format!("/nothing/{k}")).await;
        site.get(&format!("/v1/jobs/{k}")).await;
    }
    assert_eq!(number(&site, "lampwright_requests_total{method=\"GET\",route=\"none\",status=\"404\"}").await, 50.0);
    let odd = Method::from_bytes(b"BREW").unwrap();
    site.ask(odd, "/v1/jobs", &[], Body::empty()).await;
    assert_eq!(
        number(&site, "lampwright_requests_total{method=\"other\",route=\"/v1/jobs\",status=\"405\"}").await,
        1.0
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn a_worker_that_fell_silent_is_seen_in_the_numbers() {
    let gate = Gate::new();
    let site = Site::start(held(&gate)).await;
    let ray_set = site.ray_set().await;
    let (first, lost) = (site.job(&ray_set).await, site.job(&ray_set).await);
    site.until_state(&first, "running").await;
    // As another process leaves it that was killed.
    let take = "UPDATE jobs SET state = 'running', attempt = 1, fence = 1, lease_owner = 'gone', lease_until_ms = 1, \
                started_ms = {now} - 5000 WHERE id = $1";
    site.write(sql(take).bind(lost.as_str())).await;
    assert_eq!(number(&site, "lampwright_overdue_jobs").await, 1.0);
    assert!(number(&site, "lampwright_oldest_running_seconds").await >= 5.0);
    gate.open();
    site.until_state(&lost, "succeeded").await;
    assert_eq!(number(&site, "lampwright_leases_lost_total").await, 1.0);
}

#[tokio::test(flavor = "multi_thread")]
async fn with_little_room_left_nothing_is_taken_and_everything_can_be_deleted() {
    let mut site = Site::start(prompt()).await;
    let ray_set = site.ray_set().await;
    let job = site.job(&ray_set).await;
    site.until_state(&job, "succeeded").await;
    site.kill().await;
    site.config.keep_free = u64::MAX;
    // What is on other machines is theirs to watch.
    if site.config.local_folders().is_empty() {
        println!("LEFT OUT: no local disk");
        return;
    }
    site.restart(prompt()).await;
    site.upload(support::rays::zemax(3)).await.is_problem(507, "storage.low_space");
    site.get("/readyz").await.is_problem(503, "storage.low_space");
    assert_eq!(site.get("/healthz").await.status, StatusCode::OK);
    assert_eq!(site.get(&format!("/v1/jobs/{job}/model.zip")).await.status, StatusCode::OK);
    for address in [format!("/v1/jobs/{job}"), format!("/v1/ray-sets/{ray_set}")] {
        assert_eq!(site.delete(&address).await.status, StatusCode::NO_CONTENT);
    }
    assert!(site.blobs().is_empty());
}

/// Moves every ray set and one job into the past.
async fn age(site: &Site, job: &str, hours: i64) {
    let ms = hours * 3_600_000;
    site.write(sql("UPDATE ray_sets SET created_ms = created_ms - $1").bind(ms)).await;
    let old = "UPDATE jobs SET created_ms = created_ms - $1, finished_ms = finished_ms - $1 WHERE id = $2";
    site.write(sql(old).bind(ms).bind(job)).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn what_is_kept_no_longer_goes_with_its_blobs_and_what_is_used_stays() {
    let day = Duration::from_hours(24);
    let every = Duration::from_millis(100);
    let retention = Retention { jobs: Some(day), ray_sets: Some(2 * day), every };
    let gate = Gate::new();
    gate.open();
    let site = Site::start_as(|config| Config { retention, ..config }, held(&gate)).await;
    let (used, unused) = (site.ray_set().await, site.ray_set().await);
    let (old, young) = (site.job(&used).await, site.job(&used).await);
    for job in [&old, &young] {
        site.until_state(job, "succeeded").await;
    }
    // The young job's ray set is as old as the other, and was used lately.
    age(&site, &old, 49).await;
    let start = Instant::now();
    while site.get(&format!("/v1/ray-sets/{unused}")).await.status != StatusCode::NOT_FOUND
        || site.get(&format!("/v1/jobs/{old}")).await.status != StatusCode::NOT_FOUND
    {
        assert!(start.elapsed() < support::site::PATIENCE, "nothing is deleted");
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    for address in [format!("/v1/ray-sets/{used}"), format!("/v1/jobs/{young}/model.zip")] {
        assert_eq!(site.get(&address).await.status, StatusCode::OK, "{address}");
    }
    let mentions = |id: &str| site.blobs().iter().filter(|key| key.contains(id)).count();
    while mentions(&unused) + mentions(&old) > 0 {
        assert!(start.elapsed() < support::site::PATIENCE, "blobs stay: {:?}", site.blobs());
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    assert!(mentions(&used) > 0 && mentions(&young) > 0);
}

#[tokio::test(flavor = "multi_thread")]
async fn without_a_word_of_the_operator_everything_is_kept() {
    let every = Duration::from_millis(20);
    let silent = |config: Config| Config { retention: Retention { every, ..config.retention }, ..config };
    let site = Site::start_as(silent, failing(|| pipeline::Error::malformed("x.y", "found", "do"))).await;
    let ray_set = site.ray_set().await;
    let job = site.job(&ray_set).await;
    site.until_state(&job, "failed").await;
    age(&site, &job, 24 * 365 * 50).await;
    for _ in 0..10 {
        tokio::time::sleep(every).await;
        assert_eq!(site.get(&format!("/v1/jobs/{job}")).await.status, StatusCode::OK);
        assert_eq!(site.get(&format!("/v1/ray-sets/{ray_set}")).await.status, StatusCode::OK);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_backup_replaces_nothing_that_is_served_and_not_what_it_copies() {
    let mut site = Site::start(prompt()).await;
    if !site.config.is_alone() {
        return;
    }
    let ray_set = site.ray_set().await;
    let data = site.config.data.clone();
    assert!(matches!(backup(&site.config, &data).await, Err(backup::Error::Inside { .. })));
    let elsewhere = Config { data: site.folder.path().join("other"), ..site.config.clone() };
    let copied = backup(&site.config, &elsewhere.data).await.unwrap();
    let other = Service::start_with(elsewhere.clone(), prompt()).await.unwrap();
    assert!(matches!(backup(&site.config, &elsewhere.data).await, Err(backup::Error::Served(_))));
    drop(other);
    site.kill().await;
    assert!(matches!(backup(&site.config, &data).await, Err(backup::Error::Inside { .. })));
    site.restart(prompt()).await;
    assert_eq!((copied.blobs, site.get(&format!("/v1/ray-sets/{ray_set}")).await.status), (1, StatusCode::OK));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_backup_taken_while_it_works_has_everything() {
    let gate = Gate::new();
    let mut site = Site::start_as(|config| Config { auth: true, ..config }, held(&gate)).await;
    let to = site.folder.path().join("backup");
    if !site.config.is_alone() {
        assert!(matches!(backup(&site.config, &to).await, Err(backup::Error::NotLocal)));
        return;
    }
    site.key = Some(site.key_of("lab", &Scope::OF_A_TENANT).await);
    let ray_set = site.ray_set().await;
    gate.open();
    let done = site.job(&ray_set).await;
    site.until_state(&done, "succeeded").await;
    let before = backup(&site.config, &to).await.unwrap();
    assert_eq!((before.blobs, before.fresh), (site.blobs().len() as u64, site.blobs().len() as u64));
    // Others send and delete while the second one is taken, which copies only what is new.
    let late = site.ray_set().await;
    let busy = async {
        loop {
            let passing = site.ray_set().await;
            site.delete(&format!("/v1/ray-sets/{passing}")).await;
        }
    };
    let copied = tokio::select! {
        () = busy => unreachable!(),
        copied = backup(&site.config, &to) => copied.unwrap(),
    };
    assert!(copied.fresh >= 1 && copied.fresh < copied.blobs, "{copied:?}");
    let tell = async |site: &Site| -> Vec<Value> {
        let zip = site.get(&format!("/v1/jobs/{done}/model.zip")).await.body;
        let mut told = vec![json!(zip)];
        for id in [&ray_set, &late] {
            told.push(site.get(&format!("/v1/ray-sets/{id}")).await.json());
        }
        told.push(site.get(&format!("/v1/jobs/{done}")).await.json());
        told
    };
    let told = tell(&site).await;
    // To restore is to serve it: same ids, same bytes, same keys.
    site.kill().await;
    site.config.data = to;
    site.restart(prompt()).await;
    assert_eq!(tell(&site).await, told);
    let again = site.job(&late).await;
    site.until_state(&again, "succeeded").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_damaged_store_is_not_backed_up_as_if_it_were_whole() {
    let site = Site::start(prompt()).await;
    if !site.config.is_alone() {
        return;
    }
    site.ray_set().await;
    let to = site.folder.path().join("backup");
    backup(&site.config, &to).await.unwrap();
    let whole = std::fs::read(to.join("service.db")).unwrap();
    let lost = site.ray_set().await;
    std::fs::remove_dir_all(site.config.data.join("blobs/ray-sets").join(&lost)).unwrap();
    let error = backup(&site.config, &to).await.unwrap_err();
    assert!(matches!(&error, backup::Error::Missing(blob) if blob.contains(&lost)), "{error}");
    assert_eq!(std::fs::read(to.join("service.db")).unwrap(), whole, "the earlier backup is whole");
    let config = Config { data: to, ..site.config.clone() };
    Service::start_with(config, prompt()).await.unwrap();
}
