use axum::body::Body;
use axum::http::{Method, StatusCode};
use serde_json::json;
use service::Config;
use service::ray_sets::pace::Slowest;
use service::storage::records::statement::sql;
use std::time::{Duration, Instant};
use support::runners::{Gate, burning, held, prompt, uncancellable};
use support::site::{PATIENCE, Site};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::sync::oneshot;

/// One request over a real connection, by hand; the head and body of its response.
async fn over_tcp(service: std::net::SocketAddr, request: &str) -> std::io::Result<String> {
    let mut stream = TcpStream::connect(service).await?;
    stream.write_all(request.as_bytes()).await?;
    let mut response = String::new();
    stream.read_to_string(&mut response).await?;
    Ok(response)
}

const HEALTH: &str = "GET /healthz HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n";

#[tokio::test(flavor = "multi_thread")]
async fn it_says_that_it_is_well() {
    let site = Site::start(prompt()).await;
    for path in ["/healthz", "/readyz"] {
        let reply = site.get(path).await;
        assert_eq!(reply.status, StatusCode::OK);
        assert_eq!(reply.json(), json!({"status": "ok", "version": env!("CARGO_PKG_VERSION")}));
        assert_eq!(site.ask(Method::HEAD, path, &[], Body::empty()).await.status, StatusCode::OK);
    }
    assert!(site.blobs().is_empty());
}

#[tokio::test(flavor = "multi_thread")]
async fn it_says_that_its_store_is_gone() {
    if support::engines::are_shared() {
        return;
    }
    let site = Site::start(prompt()).await;
    // A folder in the way of the blobs cannot be written as a file, nor a file as a folder.
    let blobs = site.config.data.join("blobs");
    std::fs::remove_dir_all(&blobs).unwrap();
    std::fs::write(&blobs, b"in the way").unwrap();
    site.get("/readyz").await.is_problem(503, "storage.unavailable");
    site.upload(support::rays::zemax(3)).await.is_problem(503, "storage.unavailable");
    assert_eq!(site.get("/healthz").await.status, StatusCode::OK);
    assert!(site.rows(sql("SELECT id FROM ray_sets")).await.is_empty());
}

#[tokio::test(flavor = "multi_thread")]
async fn it_answers_while_jobs_use_every_core() {
    let gate = Gate::new();
    let cores = std::thread::available_parallelism().unwrap().get();
    let busy = |config: Config| Config { concurrency: 2, threads: cores, ..config };
    let mut site = Site::start_as(busy, burning(&gate)).await;
    let ray_set = site.ray_set().await;
    let jobs = [site.job(&ray_set).await, site.job(&ray_set).await];
    for job in &jobs {
        site.until_state(job, "running").await;
    }
    while gate.begun() < 2 {
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
    // Over real connections, each a new one.
    let service = site.service.take().unwrap();
    let address = service.address();
    let (stop, stopped) = oneshot::channel::<()>();
    let serving = tokio::spawn(service.run_until(async { drop(stopped.await) }));
    let mut times = Vec::new();
    for _ in 0..200 {
        let asked = Instant::now();
        // The jobs last until the gate opens: an answer that waits for one of them never comes.
        let answer = tokio::time::timeout(PATIENCE, over_tcp(address, HEALTH)).await;
        let response = answer.expect("an answer waited for a job").unwrap();
        times.push(asked.elapsed());
        assert!(response.starts_with("HTTP/1.1 200"), "{response}");
        tokio::time::sleep(Duration::from_millis(2)).await;
    }
    times.sort();
    println!(
        "/healthz, two jobs on {cores} cores: median {:?}, p99 {:?}, max {:?}",
        times[100], times[198], times[199]
    );
    gate.open();
    for job in &jobs {
        site.until_state(job, "succeeded").await;
    }
    drop(stop);
    serving.await.unwrap().unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn it_stops_in_order() {
    let gate = Gate::new();
    let mut site = Site::start(held(&gate)).await;
    let ray_set = site.ray_set().await;
    let (running, queued) = (site.job(&ray_set).await, site.job(&ray_set).await);
    site.until(&running, |job| job["stage"] == "flux").await;
    let service = site.service.take().unwrap();
    let address = service.address();
    let (stop, stopped) = oneshot::channel::<()>();
    let serving = tokio::spawn(service.run_until(async { drop(stopped.await) }));
    let health = over_tcp(address, HEALTH).await.unwrap();
    assert!(health.starts_with("HTTP/1.1 200"), "{health}");

    let asked = Instant::now();
    stop.send(()).unwrap();
    site.until(&running, |_| asked.elapsed() > Duration::from_millis(100)).await;
    site.get("/readyz").await.is_problem(503, "service.stopping");
    site.post("/v1/jobs", &json!({ "channels": [{"ray_set": ray_set}] })).await.is_problem(503, "service.stopping");
    site.upload(support::rays::zemax(3)).await.is_problem(503, "service.stopping");
    serving.await.unwrap().unwrap();
    // The job would hold it for ever.
    assert!(asked.elapsed() >= site.config.grace / 2 && asked.elapsed() < PATIENCE);
    assert!(over_tcp(address, HEALTH).await.is_err());

    // The job went back with its attempt: stopping is not its fault.
    let rows = site.rows(sql("SELECT state, attempt, lease_owner FROM jobs ORDER BY id")).await;
    for row in &rows {
        assert_eq!((row.text("state").unwrap(), row.number("attempt").unwrap()), ("queued".into(), 0));
        assert_eq!(row.optional_text("lease_owner").unwrap(), None);
    }
    assert_eq!((rows.len(), gate.stopped()), (2, 1));
    site.restart(prompt()).await;
    for job in [running, queued] {
        assert_eq!(site.until_state(&job, "succeeded").await["attempt"], 1);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_job_that_ends_within_the_grace_is_published() {
    let gate = Gate::new();
    let patient = |config: Config| Config { grace: Duration::from_secs(20), ..config };
    let mut site = Site::start_as(patient, held(&gate)).await;
    let ray_set = site.ray_set().await;
    let (running, queued) = (site.job(&ray_set).await, site.job(&ray_set).await);
    site.until_state(&running, "running").await;
    let serving = tokio::spawn(site.service.take().unwrap().run_until(async {}));
    // Long enough for a busy machine to begin to stop; a queued job would start otherwise.
    tokio::time::sleep(Duration::from_secs(2)).await;
    gate.open();
    serving.await.unwrap().unwrap();
    let rows = site.rows(sql("SELECT id, state FROM jobs ORDER BY id")).await;
    let states: Vec<_> = rows.iter().map(|row| (row.text("id").unwrap(), row.text("state").unwrap())).collect();
    assert_eq!(states, [(running, "succeeded".to_owned()), (queued, "queued".to_owned())]);
}

#[tokio::test(flavor = "multi_thread")]
async fn it_stops_even_if_a_job_does_not_listen() {
    let gate = Gate::new();
    let patient = |config: Config| Config { grace: Duration::from_secs(4), ..config };
    let mut site = Site::start_as(patient, uncancellable(&gate)).await;
    let ray_set = site.ray_set().await;
    let job = site.job(&ray_set).await;
    site.until_state(&job, "running").await;
    let asked = Instant::now();
    site.service.take().unwrap().run_until(async {}).await.unwrap();
    // All that is given to it is the grace: not another one for who does not listen.
    assert!(asked.elapsed() < 2 * site.config.grace, "{:?}", asked.elapsed());
    site.restart(prompt()).await;
    assert_eq!(site.until_state(&job, "succeeded").await["attempt"], 2);
    gate.open();
}

#[tokio::test(flavor = "multi_thread")]
async fn more_uploads_than_there_are_places_are_told_to_come_back_and_nobody_else() {
    let site =
        Site::start_as(|config| Config { slowest: Slowest { interval: PATIENCE, bytes: 1 }, ..config }, prompt()).await;
    let ray_set = site.ray_set().await;
    let job = site.job(&ray_set).await;
    let waiting = async {
        let held = (0..16).map(|_| {
            let silent = futures::stream::pending::<Result<axum::body::Bytes, std::io::Error>>();
            site.ask(Method::POST, "/v1/ray-sets", &[], Body::from_stream(silent))
        });
        futures::future::join_all(held).await
    };
    let others = async {
        let begun = Instant::now();
        while !String::from_utf8(site.get("/metrics").await.body).unwrap().contains("lampwright_uploads 16\n") {
            assert!(begun.elapsed() < PATIENCE, "not all of them began");
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
        site.upload(support::rays::zemax(3)).await.is_problem(503, "service.busy");
        for path in ["/healthz", "/readyz", "/v1/jobs", "/v1/ray-sets"] {
            assert_eq!(site.get(path).await.status, StatusCode::OK);
        }
        site.until_state(&job, "succeeded").await;
        assert_eq!(site.delete(&format!("/v1/jobs/{job}")).await.status, StatusCode::NO_CONTENT);
    };
    tokio::select! {
        _ = waiting => panic!("an upload without end ended"),
        () = others => {}
    }
    // Their places are free once they are gone.
    assert_eq!(site.upload(support::rays::zemax(3)).await.status, StatusCode::CREATED);
}
