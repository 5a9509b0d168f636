use axum::body::Body;
use axum::http::Method;
use support::runners::{pattern, prompt, sha256};
use support::site::{Reply, Site};

struct Shelf {
    site: Site,
    job: String,
}

impl Shelf {
    async fn new() -> Shelf {
        let site = Site::start(prompt()).await;
        let ray_set = site.ray_set().await;
        let job = site.job(&ray_set).await;
        site.until_state(&job, "succeeded").await;
        Shelf { site, job }
    }

    async fn ask(&self, method: Method, name: &str, headers: &[(&str, &str)]) -> Reply {
        self.site.ask(method, &format!("/v1/jobs/{}/{name}", self.job), headers, Body::empty()).await
    }

    async fn get(&self, headers: &[(&str, &str)]) -> Reply {
        self.ask(Method::GET, PATTERN, headers).await
    }
}

/// The artifact of [`pattern`].
const PATTERN: &str = "artifacts/ies/total%20%22%C3%BC%22.ies";

#[tokio::test(flavor = "multi_thread")]
async fn a_range_is_that_part_of_the_file() {
    let shelf = Shelf::new().await;
    let whole = pattern();
    let ranges = [
        ("bytes=0-0", 0..1),
        ("bytes=0-99999", 0..100_000),
        ("bytes=99999-", 99_999..100_000),
        ("bytes=-1", 99_999..100_000),
        ("bytes=-100001", 0..100_000),
        ("bytes=5000-4000000000", 5000..100_000),
        ("bytes=65535-65536", 65_535..65_537),
    ];
    for (range, expected) in ranges {
        let reply = shelf.get(&[("range", range)]).await;
        assert_eq!(reply.status, 206, "{range}");
        let (start, end) = (expected.start, expected.end - 1);
        assert_eq!(reply.header("content-range"), format!("bytes {start}-{end}/100000"));
        assert_eq!(reply.header("content-length"), expected.len().to_string());
        assert!(reply.body == whole[expected], "{range}");
    }
    for range in ["bytes=100000-", "bytes=-0", "bytes=100000-100001"] {
        let reply = shelf.get(&[("range", range)]).await;
        reply.is_problem(416, "artifact.range_not_satisfiable");
        assert_eq!(reply.header("content-range"), "bytes */100000");
    }
    for range in ["bytes=0-1,5-6", "rays=0-1", "bytes=9-3", "bytes"] {
        let reply = shelf.get(&[("range", range)]).await;
        assert_eq!((reply.status.as_u16(), reply.body.len()), (200, 100_000), "{range}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_client_that_has_it_gets_nothing_again() {
    let shelf = Shelf::new().await;
    let etag = format!("\"{}\"", sha256(&pattern()));
    let weak = format!("W/{etag}");
    let listed = format!("\"x\", {etag}");
    for known in [&etag, &weak, &listed, "*"] {
        for method in [Method::GET, Method::HEAD] {
            let reply = shelf.ask(method, PATTERN, &[("if-none-match", known), ("range", "bytes=0-1")]).await;
            assert_eq!((reply.status.as_u16(), reply.body.len()), (304, 0), "{known}");
            // As it is known to the client: the weak tag is that of the same file in other bytes.
            assert_eq!(reply.header("etag"), if known == weak { &weak } else { &etag });
            assert!(!reply.headers.contains_key("content-type"));
        }
    }
    assert_eq!(shelf.get(&[("if-none-match", "\"x\"")]).await.status, 200);
    assert_eq!(shelf.get(&[("if-range", &etag), ("range", "bytes=0-1")]).await.status, 206);
    for other in [&weak, "\"x\"", "Sun, 22 Nov 2026 00:00:00 GMT"] {
        let reply = shelf.get(&[("if-range", other), ("range", "bytes=0-1")]).await;
        assert_eq!((reply.status.as_u16(), reply.body.len()), (200, 100_000), "{other}");
        // A range that could not be had does not matter either, when it is not of this file.
        assert_eq!(shelf.get(&[("if-range", other), ("range", "bytes=100000-")]).await.status, 200);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_head_tells_what_a_get_would() {
    let shelf = Shelf::new().await;
    for name in [PATTERN, "artifacts/empty.csv", "model.zip"] {
        for headers in [&[][..], &[("range", "bytes=0-3")], &[("range", "bytes=7-")]] {
            let get = shelf.ask(Method::GET, name, headers).await;
            let head = shelf.ask(Method::HEAD, name, headers).await;
            assert_eq!(head.status, get.status);
            for header in get.headers.keys().filter(|name| *name != "x-request-id") {
                assert_eq!(head.headers.get(header), get.headers.get(header), "{name} {header}");
            }
            assert_eq!(get.header("content-length"), get.body.len().to_string());
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_file_is_safe_to_open() {
    let shelf = Shelf::new().await;
    let file = shelf.get(&[]).await;
    assert_eq!(file.header("content-disposition"), "attachment; filename=\"total____.ies\"");
    assert_eq!(file.header("content-type"), "text/plain");
    assert!(file.header("content-security-policy").contains("sandbox"));
    let zip = shelf.ask(Method::GET, "model.zip", &[]).await;
    assert_eq!(zip.header("content-disposition"), "attachment; filename=\"model.zip\"");
    assert_eq!(zip.body, b"PK of everything");
    let empty = shelf.ask(Method::GET, "artifacts/empty.csv", &[]).await;
    assert_eq!((empty.status.as_u16(), empty.body.len(), empty.header("content-length")), (200, 0, "0"));
    for missing in ["artifacts/none", "artifacts/ies", "artifacts/../read.txt", "artifacts/..%2f..%2fservice.db"] {
        shelf.ask(Method::GET, missing, &[]).await.is_problem(404, "artifact.not_found");
    }
}
