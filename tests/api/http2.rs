//! HTTP/2 without TLS, for clients that begin with it: the same answers and the same bounds.

use crate::connections::{HEALTH, Listening, PATIENCE, ROOMY, bounded};
use axum::http::{Request, Response};
use bytes::Bytes;
use h2::RecvStream;
use h2::client::{Builder, SendRequest};
use service::connections::Bounds;
use std::time::Duration;
use support::runners::prompt;
use support::site::Site;
use tokio::net::TcpStream;
use tokio::task::JoinHandle;
use tokio::time::timeout;

/// A connection that begins with HTTP/2, and what drives it: it ends with the connection.
async fn begin(service: &Listening, builder: &Builder) -> (SendRequest<Bytes>, JoinHandle<()>) {
    let stream = TcpStream::connect(service.address()).await.unwrap();
    let (send, connection) = builder.handshake::<_, Bytes>(stream).await.unwrap();
    let driving = tokio::spawn(async move { drop(connection.await) });
    (send.ready().await.unwrap(), driving)
}

async fn get(send: &mut SendRequest<Bytes>, path: &str) -> Response<RecvStream> {
    let request = Request::get(format!("http://localhost{path}")).body(()).unwrap();
    let (response, _) = send.send_request(request, true).unwrap();
    timeout(PATIENCE, response).await.unwrap().unwrap()
}

async fn read(response: Response<RecvStream>) -> Vec<u8> {
    let (mut body, mut bytes) = (response.into_body(), Vec::new());
    while let Some(piece) = timeout(PATIENCE, body.data()).await.unwrap() {
        let piece = piece.unwrap();
        body.flow_control().release_capacity(piece.len()).unwrap();
        bytes.extend_from_slice(&piece);
    }
    bytes
}

#[tokio::test(flavor = "multi_thread")]
async fn a_client_that_begins_with_it_is_answered_in_it() {
    let mut site = Site::start_as(bounded(ROOMY), prompt()).await;
    let expected = site.get("/openapi.json").await.body;
    let service = Listening::on(&mut site);
    let (mut send, _driving) = begin(&service, &Builder::new()).await;
    let page = get(&mut send, "/openapi.json").await;
    assert!(page.status() == 200 && read(page).await == expected);
    let many = futures::future::join_all((0..20).map(|_| {
        let mut send = send.clone();
        async move { get(&mut send, "/v1/jobs").await.status() }
    }));
    assert!(many.await.iter().all(|status| *status == 200));
    // The name that it asks for is judged as a Host is.
    let request = Request::get("http://evil.example/v1/jobs").body(()).unwrap();
    let (response, _) = send.send_request(request, true).unwrap();
    let refused = timeout(PATIENCE, response).await.unwrap().unwrap();
    assert_eq!(refused.status(), 403);
    // HTTP/1.1 goes on beside it.
    assert!(service.ask(HEALTH).await.starts_with("HTTP/1.1 200"));
    service.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn an_answer_that_nobody_takes_ends_the_connection() {
    let bounds = Bounds { unread: Duration::from_millis(400), ..ROOMY };
    let mut site = Site::start_as(bounded(bounds), prompt()).await;
    let service = Listening::on(&mut site);
    // Takes a thousand bytes of each answer, and reads the connection all the same.
    let (mut send, driving) = begin(&service, Builder::new().initial_window_size(1000)).await;
    let page = get(&mut send, "/openapi.json").await;
    assert_eq!(page.status(), 200);
    timeout(PATIENCE, driving).await.unwrap().unwrap();
    drop(page);
    service.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn requests_that_are_taken_back_at_once_do_not_wear_the_service_out() {
    let mut site = Site::start_as(bounded(ROOMY), prompt()).await;
    let service = Listening::on(&mut site);
    let (mut send, driving) = begin(&service, Builder::new().initial_max_send_streams(10_000)).await;
    // CVE-2023-44487: begun and reset again and again, more than may be open at once.
    let mut taken_back = 0;
    let resets = async {
        while taken_back < 10_000 {
            let request = Request::get("http://localhost/v1/jobs").body(()).unwrap();
            let Ok((response, mut stream)) = send.send_request(request, true) else { break };
            stream.send_reset(h2::Reason::CANCEL);
            drop(response);
            taken_back += 1;
            tokio::task::yield_now().await;
        }
    };
    timeout(PATIENCE, resets).await.unwrap();
    assert!(taken_back < 10_000, "the service took all of them");
    // It is the service that ends the connection.
    timeout(PATIENCE, driving).await.unwrap().unwrap();
    drop(send);
    assert!(service.ask(HEALTH).await.starts_with("HTTP/1.1 200"));
    service.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_head_that_is_too_large_is_refused_here_too_and_a_silent_connection_is_closed() {
    let bounds = Bounds { head: Duration::from_millis(500), ..ROOMY };
    let mut site = Site::start_as(bounded(bounds), prompt()).await;
    let service = Listening::on(&mut site);
    let (mut send, driving) = begin(&service, &Builder::new()).await;
    let large = "x".repeat(64 << 10);
    let request = Request::get("http://localhost/healthz").header("x-large", large).body(()).unwrap();
    let (response, _) = send.send_request(request, true).unwrap();
    let answer = timeout(PATIENCE, response).await.unwrap();
    assert!(answer.is_err() || answer.is_ok_and(|answer| answer.status() == 431));
    // Nothing more is asked.
    timeout(PATIENCE, driving).await.unwrap().unwrap();
    service.stop().await;
}
