//! What means harm, sent to a real process over real sockets: each is refused, and the service answers, works and has written
//! nothing but in its folder when all of it is over. The details of each kind are `tests/api`'s.

use crate::server::{Server, lampwright};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::io::{BufRead, BufReader, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use support::http::{Answer, ask};
use support::packing::{gzip, zip, zstd};
use support::rays::zemax;

/// Places for connections.
const PLACES: usize = 8;
/// Time for the head of a request.
const HEAD: Duration = Duration::from_secs(20);

/// A server that asks for keys, and one of them.
struct Target {
    server: Server,
    authorization: String,
}

impl Target {
    fn at(data: &Path) -> Target {
        let made = lampwright(&["keys", "create", "--tenant", "lab", "--data", data.to_str().unwrap()]);
        let key = String::from_utf8(made.stdout).unwrap();
        let server = Server::start(data, &["--auth", "on", "--max-connections", &PLACES.to_string()]);
        Target { server, authorization: format!("Bearer {}", key.trim()) }
    }

    fn ask(&self, method: &str, path: &str, body: &[u8]) -> Answer {
        let headers = [("Authorization", self.authorization.as_str()), ("Content-Type", "application/json")];
        ask(&self.server.address, method, path, &headers, body).unwrap()
    }

    /// The status of what is no request that a client of ours would send; 0 when the connection was only closed.
    fn raw(&self, request: &[u8]) -> u16 {
        let mut stream = TcpStream::connect(&self.server.address).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        // The other end may have closed before all is sent; closing ours would tell it that nobody waits for an answer.
        let _ = stream.write_all(request);
        let mut line = Vec::new();
        let _ = BufReader::new(stream).read_until(b'\n', &mut line);
        String::from_utf8_lossy(&line).split(' ').nth(1).map_or(0, |status| status.parse().unwrap())
    }

    /// It answers, and does what it is for.
    fn still_works(&self, after: &str) {
        assert_eq!(self.ask("GET", "/healthz", b"").status, 200, "after {after}");
        let sent = self.ask("POST", "/v1/spectra", b"440 0\n450 1\n460 0\n");
        assert_eq!(sent.status, 201, "after {after}: {sent:?}");
        let id = sent.json()["id"].as_str().unwrap().to_owned();
        assert_eq!(self.ask("DELETE", &format!("/v1/spectra/{id}"), b"").status, 204, "after {after}");
    }
}

fn code(answer: &Answer) -> (u16, Value) {
    (answer.status, answer.json()["code"].clone())
}

/// Every file under `folder` but those under `busy`, where the server makes and deletes files at any time.
fn names_beside(folder: &Path, busy: &Path) -> BTreeSet<PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let quiet = entries.filter(|path| path != busy);
    quiet.flat_map(|path| if path.is_dir() { names_beside(&path, busy) } else { BTreeSet::from([path]) }).collect()
}

fn bad_tokens(target: &Target) {
    let (right, address) = (&target.authorization, &target.server.address);
    let cut = &right[..right.len() - 1];
    let long = format!("Bearer lw_{}", "a".repeat(20_000));
    for token in ["", "Bearer", "Bearer ", "Bearer lw_", "Basic bGFiOmxhYg==", "Bearer ' OR 1=1 --", cut, &long] {
        let answer = ask(address, "GET", "/v1/jobs", &[("Authorization", token)], b"").unwrap();
        assert_eq!(answer.status, 401, "{token:.60}: {answer:?}");
    }
    let twice = [("Authorization", right.as_str()), ("Authorization", right.as_str())];
    assert_eq!(ask(address, "GET", "/v1/jobs", &twice, b"").unwrap().status, 401);
    assert_eq!(target.raw(b"GET /v1/jobs HTTP/1.1\r\nHost: a\r\nAuthorization: Bearer \xff\xfe\r\n\r\n"), 401);
}

fn traversal(target: &Target, data: &Path) {
    let beside = || names_beside(data.parent().unwrap(), data);
    let before = beside();
    let rays = zemax(200);
    let names = ["../../evil.dat", "/tmp/evil.dat", "..\\..\\evil.dat", "a/../../../evil.dat"];
    let packed: Vec<(&str, &[u8])> = names.iter().map(|name| (*name, rays.as_slice())).collect();
    let taken = target.ask("POST", "/v1/ray-sets?name=../../../../evil.zip", &zip(&packed));
    let sets = taken.json()["ray_sets"].as_array().cloned().unwrap_or_default();
    assert_eq!((taken.status, sets.len()), (201, names.len()), "{taken:?}");
    for set in sets {
        let name = set["name"].as_str().unwrap();
        assert!(!name.starts_with('/') && !name.contains("..") && !name.contains('\\'), "{name}");
        assert_eq!(set["packed"]["name"], "evil.zip");
    }
    let up = "..%2f..%2f..%2f..%2fetc%2fpasswd";
    for path in [
        "/../../etc/passwd".to_owned(),
        "/docs/../../etc/passwd".to_owned(),
        format!("/docs/{up}"),
        format!("/v1/jobs/{up}"),
        format!("/v1/jobs/x/artifacts/{up}"),
        "/v1/jobs/x/artifacts/../../../service.db".to_owned(),
        format!("/v1/ray-sets/{up}/origins.svg"),
    ] {
        let answer = target.ask("GET", &path, b"");
        assert_eq!(answer.status, 404, "{path}: {answer:?}");
        assert!(!String::from_utf8_lossy(&answer.body).contains("root:"), "{path}");
    }
    assert_eq!(beside(), before, "something was written beside the data folder");
}

fn head_bombs(target: &Target) {
    let many: String = (0..5000).map(|k| format!("X-{k}: {k}\r\n")).collect();
    let long = "x".repeat(1 << 20);
    for (name, head) in [
        ("many headers", format!("GET /healthz HTTP/1.1\r\nHost: a\r\n{many}\r\n")),
        ("a long header", format!("GET /healthz HTTP/1.1\r\nHost: a\r\nX: {long}\r\n\r\n")),
        ("a long address", format!("GET /{long} HTTP/1.1\r\nHost: a\r\n\r\n")),
        ("a head without end", format!("GET /healthz HTTP/1.1\r\nHost: a\r\nX: {}", long.repeat(4))),
    ] {
        let status = target.raw(head.as_bytes());
        assert!(matches!(status, 0 | 400..500), "{name}: {status}");
    }
    // Two lengths, or a length and chunks: what one program takes for a body is the next request to another.
    for framing in [
        "Content-Length: 5\r\nContent-Length: 6\r\n",
        "Content-Length: 5\r\nTransfer-Encoding: chunked\r\n",
        "Transfer-Encoding: gzip, chunked\r\nTransfer-Encoding: identity\r\n",
        "Content-Length: -1\r\n",
    ] {
        let smuggled = "0\r\n\r\nGET /healthz HTTP/1.1\r\nHost: a\r\n\r\n";
        let status = target.raw(format!("POST /v1/jobs HTTP/1.1\r\nHost: a\r\n{framing}\r\n{smuggled}").as_bytes());
        assert!(matches!(status, 0 | 400..500), "{framing}: {status}");
    }
}

fn bombs(target: &Target) {
    // Begins like a ray file, so that it is unpacked at all; a small part of its size when packed.
    let mut dark = zemax(1);
    dark.resize(100 << 20, 0);
    let once = gzip(&dark);
    assert!(100 * once.len() < dark.len(), "{}", once.len());
    let members: Vec<(String, Vec<u8>)> = (0..2000).map(|k| (k.to_string(), vec![b'x'; 10])).collect();
    let members: Vec<(&str, &[u8])> = members.iter().map(|(name, bytes)| (name.as_str(), bytes.as_slice())).collect();
    for (name, bomb, expected) in [
        ("a file that swells", once.clone(), "container.ratio"),
        ("the same by zstd", zstd(&dark), "container.ratio"),
        ("one in a zip", zip(&[("lamp.dat.gz", &once)]), "container.ratio"),
        ("more files than anybody sends", zip(&members), "container.members"),
    ] {
        assert_eq!(code(&target.ask("POST", "/v1/ray-sets", &bomb)), (422, json!(expected)), "{name}");
    }
    for (name, body) in [
        ("lists in lists", "[".repeat(60_000)),
        ("objects in objects", "{\"channels\":".repeat(5_000)),
        ("a number of many digits", format!("{{\"channels\":{}}}", "9".repeat(60_000))),
    ] {
        let answer = target.ask("POST", "/v1/jobs", body.as_bytes());
        assert!(matches!(answer.status, 400 | 422), "{name}: {answer:?}");
    }
    assert_eq!(target.ask("POST", "/v1/jobs", &vec![b' '; 70 << 10]).status, 413);
}

/// Far more than there are places, and their time for a head is not over before somebody else is answered.
fn slow_heads(target: &Target) -> Vec<TcpStream> {
    let slow = (0..40 * PLACES).map(|_| {
        let mut stream = TcpStream::connect(&target.server.address).unwrap();
        stream.write_all(b"GET /healthz HTTP/1.1\r\nHost: a\r\nX: ").unwrap();
        stream
    });
    slow.collect()
}

#[test]
fn what_means_harm_is_refused_and_the_service_stays() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    let target = Target::at(&data);
    bad_tokens(&target);
    target.still_works("bad tokens");
    traversal(&target, &data);
    target.still_works("names that lead elsewhere");
    head_bombs(&target);
    target.still_works("heads that do not end");
    bombs(&target);
    target.still_works("what swells");
    let slow = slow_heads(&target);
    let asked = Instant::now();
    target.still_works("heads that come slowly");
    assert!(asked.elapsed() < HEAD / 2, "{:?}", asked.elapsed());
    drop(slow);
    // The file that was good all along has stayed, and the process that took it ends in order.
    assert_eq!(target.ask("GET", "/v1/ray-sets", b"").json()["ray_sets"].as_array().map(Vec::len), Some(4));
    assert!(target.server.terminate().success());
}
