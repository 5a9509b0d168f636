//! How clients hear of their jobs: the long poll and the stream of events.

use crate::connections::{Listening, PATIENCE, ended};
use axum::body::Body;
use axum::http::{Method, Request, StatusCode};
use futures::future::join_all;
use futures::{StreamExt, TryStreamExt};
use serde_json::{Value, json};
use service::connections::Bounds;
use service::storage::records::statement::sql;
use service::{Config, Role};
use std::time::{Duration, Instant};
use support::runners::{Gate, held, prompt};
use support::site::Site;

/// An event as the HTML standard says to read one: fields by line, an empty line at its end.
#[derive(Debug, Default)]
struct Event {
    name: String,
    id: String,
    data: Value,
}

fn events(text: &str) -> Vec<Event> {
    let blocks = text.split("\n\n").filter(|block| block.lines().any(|line| line.starts_with("data:")));
    let read = |block: &str| {
        let mut event = Event::default();
        for (field, value) in block.lines().filter_map(|line| line.split_once(':')) {
            match field {
                "event" => event.name = value.trim_start().into(),
                "id" => event.id = value.trim_start().into(),
                "data" => event.data = serde_json::from_str(value).unwrap(),
                "retry" => assert!(value.trim().parse::<u64>().unwrap() >= 1000),
                other => panic!("{other}: {block}"),
            }
        }
        event
    };
    blocks.map(read).collect()
}

fn watched(job: &str) -> String {
    format!("/v1/jobs/{job}/events")
}

#[tokio::test(flavor = "multi_thread")]
async fn a_long_poll_is_answered_when_the_state_changes_or_the_time_is_over() {
    let gate = Gate::new();
    let site = Site::start(held(&gate)).await;
    let ray_set = site.ray_set().await;
    let (job, waits) = (site.job(&ray_set).await, site.job(&ray_set).await);
    site.until_state(&job, "running").await;

    let asked = Instant::now();
    let still = site.get(&format!("/v1/jobs/{job}?wait=1")).await.json();
    assert!(asked.elapsed() >= Duration::from_secs(1) && still["state"] == "running", "{still}");
    for wrong in ["61", "-1", "1.5", "x", ""] {
        assert_eq!(site.get(&format!("/v1/jobs/{job}?wait={wrong}")).await.status, 422, "{wrong}");
    }
    site.get("/v1/jobs/nothing?wait=60").await.is_problem(404, "job.not_found");

    let asked = Instant::now();
    let (addresses, open) = ([&job, &waits].map(|job| format!("/v1/jobs/{job}?wait=60")), async { gate.open() });
    let (done, begun, ()) = tokio::join!(site.get(&addresses[0]), site.get(&addresses[1]), open);
    assert_eq!(done.json()["state"], "succeeded");
    assert_ne!(begun.json()["state"], "queued");
    site.until_state(&waits, "succeeded").await;
    assert_eq!(site.get(&addresses[0]).await.json()["state"], "succeeded", "an ended job is told at once");
    assert!(asked.elapsed() < Duration::from_secs(50), "nobody waited for the time to be over");
}

#[tokio::test(flavor = "multi_thread")]
async fn what_another_process_changes_is_heard_too() {
    // Nothing happens in this process that would make it look.
    let site = Site::start_as(|config| Config { role: Role::Api, ..config }, prompt()).await;
    let ray_set = site.ray_set().await;
    let (waits, goes) = (site.job(&ray_set).await, site.job(&ray_set).await);
    let asked = Instant::now();
    let elsewhere = async {
        let mut told = site.begin(&watched(&waits)).await.into_body().into_data_stream();
        // The first look is this client's doing; what changes later is only found by looking again.
        for attempt in 7..10_i64 {
            site.write(sql("UPDATE jobs SET attempt = $1 WHERE id = $2").bind(attempt).bind(waits.as_str())).await;
            while !text(&told.next().await.unwrap().unwrap()).contains(&format!("\"attempt\":{attempt}")) {}
        }
        let cancel = "UPDATE jobs SET state = 'cancelled', finished_ms = {now} WHERE id = $1";
        site.write(sql(cancel).bind(waits.as_str())).await;
        let last = events(&text(&told.try_collect::<Vec<_>>().await.unwrap().concat())).pop().unwrap();
        assert_eq!((last.name.as_str(), &last.data["state"]), ("ended", &json!("cancelled")));
    };
    let address = job_and_wait(&waits);
    let both = async { tokio::join!(site.get(&address), elsewhere) };
    let (poll, ()) = tokio::time::timeout(PATIENCE, both).await.unwrap();
    assert_eq!(poll.json()["state"], "cancelled");
    let mut told = site.begin(&watched(&goes)).await.into_body().into_data_stream();
    assert!(text(&told.next().await.unwrap().unwrap()).contains("queued"));
    site.write(sql("DELETE FROM jobs WHERE id = $1").bind(goes.as_str())).await;
    let last = events(&text(&told.try_collect::<Vec<_>>().await.unwrap().concat())).pop().unwrap();
    assert_eq!((last.name.as_str(), &last.data["code"]), ("gone", &json!("job.not_found")));
    assert!(asked.elapsed() < Duration::from_secs(50), "nobody waited for the time to be over");
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_stream_tells_every_change_and_ends_with_the_job() {
    let gate = Gate::new();
    let site = Site::start(held(&gate)).await;
    let ray_set = site.ray_set().await;
    let job = site.job(&ray_set).await;
    let running = site.until(&job, |job| job["stage"] == "flux").await;
    let waits = site.job(&ray_set).await;

    let response = site.begin(&watched(&job)).await;
    assert_eq!(response.status(), StatusCode::OK);
    for (name, value) in
        [("content-type", "text/event-stream"), ("cache-control", "no-store"), ("x-accel-buffering", "no")]
    {
        assert_eq!(response.headers()[name], value);
    }
    assert!(!response.headers().contains_key("content-encoding") && !response.headers().contains_key("content-length"));
    let mut pieces = response.into_body().into_data_stream();
    let first = events(&text(&pieces.next().await.unwrap().unwrap()));
    assert_eq!((first.len(), first[0].name.as_str()), (1, "progress"));
    let expected = json!({"state": "running", "attempt": 1, "stage": "flux", "fraction": running["stages"][2]["progress"],
                          "progress": running["progress"], "queue_position": null});
    assert_eq!(first[0].data, expected);

    let mut queued = site.begin(&watched(&waits)).await.into_body().into_data_stream();
    let told = events(&text(&queued.next().await.unwrap().unwrap()));
    assert_eq!((&told[0].data["state"], &told[0].data["queue_position"]), (&json!("queued"), &json!(1)));

    site.post(&format!("/v1/jobs/{job}/cancel"), &json!({})).await;
    let rest: Vec<bytes::Bytes> = pieces.try_collect().await.unwrap();
    let rest = events(&text(&rest.concat()));
    let last = rest.last().unwrap();
    assert_eq!((last.name.as_str(), last.id.as_str()), ("ended", "ended"));
    assert_eq!(last.data, site.get(&format!("/v1/jobs/{job}")).await.json());
    assert!(rest.iter().rev().skip(1).all(|event| event.name == "progress" && event.data["state"] == "running"));

    // The other one was queued, then runs until the gate opens, then ends.
    while !text(&queued.next().await.unwrap().unwrap()).contains("\"stage\":\"flux\"") {}
    gate.open();
    let last = events(&text(&queued.try_collect::<Vec<_>>().await.unwrap().concat())).pop().unwrap();
    assert_eq!((last.name.as_str(), &last.data["state"]), ("ended", &json!("succeeded")));
    // Who saw the end is told not to ask again; who did not gets it at once.
    let seen = [("last-event-id", "ended")];
    assert_eq!(site.ask(Method::GET, &watched(&job), &seen, Body::empty()).await.status, StatusCode::NO_CONTENT);
    let again = [("last-event-id", first[0].id.as_str())];
    let again = site.ask(Method::GET, &watched(&job), &again, Body::empty()).await;
    assert_eq!(events(&text(&again.body)).iter().map(|event| event.name.as_str()).collect::<Vec<_>>(), ["ended"]);
    site.get(&watched("nothing")).await.is_problem(404, "job.not_found");
}

#[tokio::test(flavor = "multi_thread")]
async fn those_who_wait_leave_room_for_those_who_do_not() {
    let gate = Gate::new();
    let site = Site::start(held(&gate)).await;
    let job = site.job(&site.ray_set().await).await;
    site.until_state(&job, "running").await;
    // More than may read at once; each of them is asked before the one who only looks.
    let waiting = join_all((0..300).map(|_| async { site.get(&job_and_wait(&job)).await }));
    let mut waiting = std::pin::pin!(waiting);
    let looks = async {
        for _ in 0..50 {
            assert_eq!(site.get(&format!("/v1/jobs/{job}")).await.status, StatusCode::OK);
            assert_eq!(site.get("/v1/jobs").await.status, StatusCode::OK);
        }
    };
    tokio::select! {
        biased;
        _ = &mut waiting => panic!("nobody opened the gate"),
        () = looks => gate.open(),
    }
    let opened = Instant::now();
    let told = waiting.await;
    println!("300 clients that waited were answered within {:?}", opened.elapsed());
    for reply in told {
        assert_eq!((reply.status, &reply.json()["state"]), (StatusCode::OK, &json!("succeeded")));
    }

    // A quarter of the connections is for others.
    let bounds = Bounds { connections: 4, head: PATIENCE, unread: PATIENCE, ..Bounds::default() };
    let gate = Gate::new();
    let site = Site::start_as(|config| Config { bounds, ..config }, held(&gate)).await;
    let job = site.job(&site.ray_set().await).await;
    let streams =
        [site.begin(&watched(&job)).await, site.begin(&watched(&job)).await, site.begin(&watched(&job)).await];
    site.get(&job_and_wait(&job)).await.is_problem(503, "service.busy");
    site.get(&watched(&job)).await.is_problem(503, "service.busy");
    drop(streams);
    gate.open();
    assert_eq!(site.get(&job_and_wait(&job)).await.status, StatusCode::OK, "their places are free again");
}

fn job_and_wait(job: &str) -> String {
    format!("/v1/jobs/{job}?wait=60")
}

#[tokio::test(flavor = "multi_thread")]
async fn a_stream_outlives_the_bounds_of_connections_and_ends_when_the_service_does() {
    let gate = Gate::new();
    let short = Duration::from_millis(300);
    let bounds = Bounds { connections: 8, head: short, unread: short, ..Bounds::default() };
    // So long a grace that a connection which waits for its end is seen.
    let grace = PATIENCE;
    let mut site = Site::start_as(|config| Config { bounds, grace, ..config }, held(&gate)).await;
    let job = site.job(&site.ray_set().await).await;
    site.until(&job, |job| job["stage"] == "flux").await;
    let service = Listening::on(&mut site);
    let ask = |path: String| format!("GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n");
    let mut stream = service.open(ask(watched(&job)).as_bytes()).await;
    let mut poll = service.open(ask(job_and_wait(&job)).as_bytes()).await;
    // What is shown here is that time alone does not end them.
    tokio::time::sleep(3 * short).await;
    site.write(sql("UPDATE jobs SET attempt = 7 WHERE id = $1").bind(job.as_str())).await;
    let told = async {
        let mut told = String::new();
        while !told.contains("\"attempt\":7") {
            use tokio::io::AsyncReadExt;
            let mut bytes = [0; 4096];
            let count = tokio::time::timeout(PATIENCE, stream.read(&mut bytes)).await.unwrap().unwrap();
            assert!(count > 0, "the stream was cut: {told}");
            told += &text(&bytes[..count]);
        }
    };
    told.await;
    let stopping = Instant::now();
    let stop = tokio::spawn(service.stop());
    let (rest, answer) = tokio::join!(ended(&mut stream), ended(&mut poll));
    assert!(rest.ends_with("0\r\n\r\n"), "a stream ends whole: {rest:?}");
    assert!(answer.starts_with("HTTP/1.1 200") && answer.contains("\"running\""), "{answer}");
    assert!(stopping.elapsed() < grace / 2, "nobody waited for the grace to be over");
    gate.open();
    stop.await.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_service_that_stops_begins_no_stream() {
    let gate = Gate::new();
    let mut site = Site::start(held(&gate)).await;
    let job = site.job(&site.ray_set().await).await;
    site.until_state(&job, "running").await;
    let router = site.service.as_ref().unwrap().router();
    let service = Listening::on(&mut site);
    let stop = tokio::spawn(service.stop());
    let begun = Instant::now();
    loop {
        let request = Request::get(watched(&job)).body(Body::empty()).unwrap();
        let response = tower::ServiceExt::oneshot(router.clone(), request).await.unwrap();
        if response.status() == StatusCode::SERVICE_UNAVAILABLE {
            break;
        }
        assert!(begun.elapsed() < PATIENCE, "{response:?}");
    }
    gate.open();
    stop.await.unwrap();
}
