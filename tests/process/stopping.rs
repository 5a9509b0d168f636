//! How the binary stops at SIGTERM: it says so, ends what is at hand, and waits for nobody who asks nothing.

use crate::LONG_JOB_RAYS;
use crate::server::{Server, lampwright};
use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};
use support::http::ask;

/// Longest wait for what should come at once, on a machine busy with others.
const PATIENCE: Duration = Duration::from_secs(60);

/// A connection on which `bytes` were sent.
fn open(server: &Server, bytes: &[u8]) -> TcpStream {
    let mut stream = TcpStream::connect(&server.address).unwrap();
    stream.write_all(bytes).unwrap();
    stream
}

#[test]
fn an_idle_service_ends_at_once_whatever_connections_there_are() {
    let folder = tempfile::tempdir().unwrap();
    // On a machine busy with others one of several is not held up.
    let stops = (0..5).map(|_| {
        let server = Server::start(folder.path(), &["--no-sample", "--grace", "60"]);
        let silent = open(&server, b"");
        let half = open(&server, b"GET /healthz HTTP/1.1\r\nHost: lo");
        let mut resting = open(&server, b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n");
        assert!(resting.read(&mut [0; 1024]).unwrap() > 0);
        let asked = Instant::now();
        assert!(server.terminate().success());
        drop((silent, half, resting));
        asked.elapsed()
    });
    let stops: Vec<Duration> = stops.collect();
    assert!(stops.iter().min() < Some(&Duration::from_millis(500)), "{stops:?}");
}

#[test]
fn a_service_that_stops_says_so_until_its_job_has_ended() {
    let folder = tempfile::tempdir().unwrap();
    let rays = folder.path().join("chips.tm25ray");
    let written = lampwright(&["sample", "four-chips", "--rays", LONG_JOB_RAYS, "-o", rays.to_str().unwrap()]);
    assert!(written.status.success(), "{written:?}");
    let data = folder.path().join("data");
    let server = Server::start(&data, &["--no-sample", "--grace", "600"]);
    let job = server.job_of("chips.tm25ray", &std::fs::read(&rays).unwrap());
    server.until(&job, |job| job["state"] == "running");
    server.tell_to_stop();
    let asked = Instant::now();
    loop {
        let ready = server.get("/readyz");
        if ready.status == 503 {
            assert_eq!(ready.json()["code"], "service.stopping");
            assert_eq!(ready.header("retry-after"), Some("1"));
            break;
        }
        assert!(asked.elapsed() < PATIENCE, "{ready:?}");
    }
    let refused = server.post("/v1/ray-sets", "application/octet-stream", b"rays");
    assert_eq!((refused.status, refused.json()["code"].as_str()), (503, Some("service.stopping")));
    assert_eq!(server.get("/healthz").status, 200);
    let address = server.address.clone();
    assert!(server.ended().success());
    assert!(ask(&address, "GET", "/healthz", &[], b"").is_err(), "the port is closed");
    let server = Server::start(&data, &["--no-sample"]);
    let done = server.until(&job, |job| job["state"] == "succeeded");
    assert_eq!(done["attempt"], 1, "it ended within the grace of the first process");
}
