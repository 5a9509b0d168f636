//! Many connections at once: which of them is closed for a new one, and who is told to come back.

use crate::connections::{HEALTH, Listening, PATIENCE, ROOMY, bounded, ended};
use axum::body::Body;
use axum::http::{Request, StatusCode};
use service::Config;
use service::accounts::access::Scope;
use service::connections::Bounds;
use service::ray_sets::pace::Slowest;
use service::storage::records::statement::sql;
use std::net::SocketAddr;
use support::runners::{Gate, held, prompt};
use support::site::Site;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpSocket, TcpStream};
use tower::ServiceExt;

/// A connection from 127.0.`from`, on which `bytes` were sent.
async fn open(service: &Listening, from: [u8; 2], bytes: &[u8]) -> TcpStream {
    let socket = TcpSocket::new_v4().unwrap();
    socket.bind(SocketAddr::from(([127, 0, from[0], from[1]], 0))).unwrap();
    let mut stream = socket.connect(service.address()).await.unwrap();
    stream.write_all(bytes).await.unwrap();
    stream
}

async fn first_bytes(stream: &mut TcpStream) -> String {
    let mut bytes = [0; 4096];
    let count = tokio::time::timeout(PATIENCE, stream.read(&mut bytes)).await.unwrap().unwrap();
    String::from_utf8_lossy(&bytes[..count]).into_owned()
}

/// An event stream that goes on until its job ends.
async fn watch(service: &Listening, from: [u8; 2], job: &str) -> TcpStream {
    let mut stream =
        open(service, from, format!("GET /v1/jobs/{job}/events HTTP/1.1\r\nHost: localhost\r\n\r\n").as_bytes()).await;
    let begun = first_bytes(&mut stream).await;
    assert!(begun.starts_with("HTTP/1.1 200"), "{begun}");
    stream
}

#[tokio::test(flavor = "multi_thread")]
async fn connections_that_send_nothing_whole_keep_nobody_from_being_answered() {
    // So long a time for a head that nobody is answered because theirs is over.
    let head = 10 * PATIENCE;
    for addresses in [1, 240] {
        let mut site = Site::start_as(bounded(Bounds { head, ..ROOMY }), prompt()).await;
        let service = Listening::on(&mut site);
        let mut slow = Vec::new();
        for k in 0..700_u16 {
            let from = [1, (k % addresses) as u8 + 1];
            slow.push(open(&service, from, b"GET /healthz HTTP/1.1\r\nHost: lo").await);
        }
        for _ in 0..5 {
            let answer = ended(&mut open(&service, [0, 1], HEALTH.as_bytes()).await).await;
            assert!(answer.starts_with("HTTP/1.1 200"), "{addresses}: {answer}");
        }
        drop(slow);
        service.stop().await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn who_has_a_key_goes_before_those_without_who_read_nothing() {
    let change =
        |config| Config { auth: true, ..bounded(Bounds { connections: 2, unread: 10 * PATIENCE, ..ROOMY })(config) };
    let mut site = Site::start_as(change, prompt()).await;
    let key = site.key_of("lab", &Scope::OF_A_TENANT).await;
    let service = Listening::on(&mut site);
    let page = b"GET /docs/swagger-ui-bundle.js HTTP/1.1\r\nHost: localhost\r\n\r\n".repeat(40);
    let mut silent = [open(&service, [0, 1], b"").await, open(&service, [0, 1], b"").await];
    let [first, second] = &mut silent;
    let asking = async {
        let _ = tokio::join!(first.write_all(&page), second.write_all(&page));
        std::future::pending::<()>().await;
    };
    let request =
        format!("GET /v1/jobs HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\nAuthorization: Bearer {key}\r\n\r\n");
    tokio::select! {
        () = asking => unreachable!(),
        answer = service.ask(&request) => assert!(answer.starts_with("HTTP/1.1 200"), "{answer}"),
    }
    service.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_full_service_says_so_and_that_it_lives() {
    let gate = Gate::new();
    let slowest = Slowest { interval: PATIENCE, bytes: 1 };
    let change = |config| Config { slowest, ..bounded(Bounds { connections: 3, ..ROOMY })(config) };
    let mut site = Site::start_as(change, held(&gate)).await;
    let job = site.job(&site.ray_set().await).await;
    site.until_state(&job, "running").await;
    let service = Listening::on(&mut site);
    let list = "GET /v1/jobs HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n";
    // Two wait for a job, and one is read by nobody: nothing rests.
    let streams = [watch(&service, [0, 1], &job).await, watch(&service, [0, 1], &job).await];
    let upload =
        open(&service, [0, 1], b"POST /v1/ray-sets HTTP/1.1\r\nHost: localhost\r\nContent-Length: 9999\r\n\r\n").await;
    let begun = async {
        while !String::from_utf8(site.get("/metrics").await.body).unwrap().contains("lampwright_uploads 1\n") {}
    };
    tokio::time::timeout(PATIENCE, begun).await.unwrap();
    let answer = service.ask(list).await;
    assert!(answer.contains("service.busy") && answer.to_lowercase().contains("\r\nretry-after: 1\r\n"), "{answer}");
    assert!(service.ask(HEALTH).await.starts_with("HTTP/1.1 200"));
    assert!(service.ask(&HEALTH.replace("healthz", "readyz")).await.starts_with("HTTP/1.1 200"));
    drop(streams);
    gate.open();
    let again = async { while !service.ask(list).await.starts_with("HTTP/1.1 200") {} };
    tokio::time::timeout(PATIENCE, again).await.unwrap();
    drop(upload);
    service.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn one_address_has_no_more_than_its_share() {
    let gate = Gate::new();
    let bounds = Bounds { per_address: 2, bounds_loopback: true, ..ROOMY };
    let mut site = Site::start_as(bounded(bounds), held(&gate)).await;
    let job = site.job(&site.ray_set().await).await;
    site.until_state(&job, "running").await;
    let service = Listening::on(&mut site);
    let list = b"GET /v1/jobs HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n";
    let streams = [watch(&service, [3, 1], &job).await, watch(&service, [3, 1], &job).await];
    let refused = ended(&mut open(&service, [3, 1], list).await).await;
    assert!(refused.starts_with("HTTP/1.1 503") && refused.contains("service.busy"), "{refused}");
    let other = ended(&mut open(&service, [3, 2], list).await).await;
    assert!(other.starts_with("HTTP/1.1 200"), "{other}");
    drop(streams);
    gate.open();
    service.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn one_tenant_cannot_take_every_place_to_wait() {
    let gate = Gate::new();
    // Six of eight connections may wait.
    let change = |config| Config { auth: true, ..bounded(Bounds { connections: 8, ..ROOMY })(config) };
    let mut site = Site::start_as(change, held(&gate)).await;
    let (lab, shop) = (site.key_of("lab", &Scope::OF_A_TENANT).await, site.key_of("shop", &Scope::OF_A_TENANT).await);
    let mut jobs = Vec::new();
    for key in [&lab, &shop] {
        site.key = Some(key.clone());
        jobs.push(site.job(&site.ray_set().await).await);
    }
    let router = site.service.as_ref().unwrap().router();
    let stream = async |key: &str, job: &str| {
        let request = Request::get(format!("/v1/jobs/{job}/events")).header("authorization", format!("Bearer {key}"));
        router.clone().oneshot(request.body(Body::empty()).unwrap()).await.unwrap()
    };
    let mut kept = Vec::new();
    for expected in [StatusCode::OK, StatusCode::OK, StatusCode::OK, StatusCode::SERVICE_UNAVAILABLE] {
        let response = stream(&lab, &jobs[0]).await;
        assert_eq!(response.status(), expected, "after {}", kept.len());
        kept.push(response);
    }
    let other = stream(&shop, &jobs[1]).await;
    assert_eq!(other.status(), StatusCode::OK, "another tenant has its share");
    kept.clear();
    assert_eq!(stream(&lab, &jobs[0]).await.status(), StatusCode::OK, "its places are free again");
    gate.open();
}

#[tokio::test(flavor = "multi_thread")]
async fn connections_that_rest_do_not_hold_up_a_stop() {
    let grace = 4 * PATIENCE;
    let mut site = Site::start_as(|config| Config { grace, bounds: ROOMY, ..config }, prompt()).await;
    let service = Listening::on(&mut site);
    let silent = open(&service, [0, 1], b"").await;
    let half = open(&service, [0, 1], b"GET /healthz HTTP/1.1\r\nHost: lo").await;
    let mut resting = open(&service, [0, 1], b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n").await;
    assert!(first_bytes(&mut resting).await.starts_with("HTTP/1.1 200"));
    // None of the three closes its end.
    tokio::time::timeout(PATIENCE, service.stop()).await.unwrap();
    drop((silent, half, resting));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_service_that_stops_tells_so_on_new_connections_until_all_has_ended() {
    let gate = Gate::new();
    let mut site = Site::start_as(|config| Config { grace: 4 * PATIENCE, bounds: ROOMY, ..config }, held(&gate)).await;
    let job = site.job(&site.ray_set().await).await;
    site.until_state(&job, "running").await;
    let service = Listening::on(&mut site);
    let address = service.address();
    let stop = tokio::spawn(service.stop());
    let ask = async |request: String| {
        let mut stream = TcpStream::connect(address).await.unwrap();
        stream.write_all(request.as_bytes()).await.unwrap();
        ended(&mut stream).await
    };
    let stopping = async {
        while !ask("GET /readyz HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n".to_owned())
            .await
            .contains("service.stopping")
        {}
    };
    tokio::time::timeout(PATIENCE, stopping).await.unwrap();
    let answer = ask("GET /readyz HTTP/1.1\r\nHost: localhost\r\n\r\n".to_owned()).await;
    assert!(answer.starts_with("HTTP/1.1 503") && answer.to_lowercase().contains("connection: close"), "{answer}");
    assert!(answer.to_lowercase().contains("retry-after: 1"), "{answer}");
    assert!(ask(HEALTH.to_owned()).await.starts_with("HTTP/1.1 200"));
    let new = "POST /v1/ray-sets HTTP/1.1\r\nHost: localhost\r\nContent-Length: 4\r\n\r\nrays".to_owned();
    let refused = ask(new).await;
    assert!(refused.starts_with("HTTP/1.1 503") && refused.contains("service.stopping"), "{refused}");
    let job_list = ask("GET /v1/jobs HTTP/1.1\r\nHost: localhost\r\n\r\n".to_owned()).await;
    assert!(job_list.starts_with("HTTP/1.1 200"), "{job_list}");
    gate.open();
    tokio::time::timeout(PATIENCE, stop).await.unwrap().unwrap();
    assert!(TcpStream::connect(address).await.is_err(), "it has closed");
    let rows = site.rows(sql("SELECT state FROM jobs")).await;
    assert_eq!(rows[0].text("state").unwrap(), "succeeded", "the job had its time");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_client_of_a_trusted_proxy_has_its_own_bound_and_its_own_name() {
    let gate = Gate::new();
    let trusted = vec!["127.0.4.0/24".parse().unwrap()];
    let change = |config: Config| {
        let mut config = bounded(Bounds { per_address: 1, ..ROOMY })(config);
        config.proxies.trusted.clone_from(&trusted);
        config
    };
    let mut site = Site::start_as(change, held(&gate)).await;
    let job = site.job(&site.ray_set().await).await;
    site.until_state(&job, "running").await;
    let service = Listening::on(&mut site);
    let stream = format!("GET /v1/jobs/{job}/events HTTP/1.1\r\nHost: localhost\r\nX-Forwarded-For: 192.0.2.1\r\n\r\n");
    let mut held = open(&service, [4, 1], stream.as_bytes()).await;
    assert!(first_bytes(&mut held).await.starts_with("HTTP/1.1 200"));
    let list = |client: &str| {
        format!("GET /v1/jobs HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\nX-Forwarded-For: {client}\r\n\r\n")
    };
    let ask = async |from, client: &str| ended(&mut open(&service, from, list(client).as_bytes()).await).await;
    assert!(ask([4, 2], "192.0.2.1").await.starts_with("HTTP/1.1 503"), "as many as it may have");
    assert!(ask([4, 1], "192.0.2.2").await.starts_with("HTTP/1.1 200"));
    assert!(ask([5, 1], "192.0.2.1").await.starts_with("HTTP/1.1 200"), "who is not trusted names nobody");
    drop(held);
    gate.open();
    service.stop().await;
}
