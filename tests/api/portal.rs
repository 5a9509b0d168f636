//! The portal's files as the service hands them out. What the pages do is driven in a browser: `tests/portal`.

use axum::body::Body;
use axum::http::{Method, StatusCode};
use pipeline::vocabulary::spectrum::color_matching;
use service::Config;
use service::forwarded::Prefix;
use std::collections::BTreeMap;
use std::path::Path;
use support::runners::{prompt, sha256};
use support::site::{Reply, Site};

/// The whole policy: files of the service, and no exception.
const POLICY: &str = "default-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'";
/// What all files together may have, bytes.
const MOST_BYTES: usize = 300_000;
/// Longest file, in lines, as of all sources.
const MOST_LINES: usize = 500;

fn source() -> BTreeMap<String, String> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/service/portal");
    let files = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let text = |path: &Path| std::fs::read_to_string(path).unwrap();
    files.map(|path| (path.file_name().unwrap().to_str().unwrap().to_owned(), text(&path))).collect()
}

async fn asked(site: &Site, method: Method, path: &str, headers: &[(&str, &str)]) -> Reply {
    site.ask(method, path, headers, Body::empty()).await
}

/// The folder of all files but the page, as the page names it.
async fn folder(site: &Site) -> String {
    let page = String::from_utf8(site.get("/").await.body).unwrap();
    let (_, rest) = page.split_once("src=\"").unwrap();
    rest.split_once("/app.js\"").unwrap().0.to_owned()
}

#[tokio::test(flavor = "multi_thread")]
async fn the_front_page_and_every_file_come_from_the_service_itself() {
    let site = Site::start(prompt()).await;
    let page = site.get("/").await;
    assert_eq!((page.status, page.header("content-type")), (StatusCode::OK, "text/html; charset=utf-8"));
    assert_eq!(page.header("cache-control"), "private, no-cache");
    let html = String::from_utf8(page.body.clone()).unwrap();
    assert!(!html.contains("{folder}"), "{html}");
    let folder = folder(&site).await;
    let mut files = source();
    let index = files.remove("index.html").unwrap();
    assert_eq!(html, index.replace("{folder}", &folder));
    // All scripts are asked for at once: one that imports others need not have come first.
    for name in files.keys().filter(|name| name.ends_with(".js")) {
        assert!(html.contains(&format!("\"{folder}/{name}\"")), "the page does not name {name}");
    }
    let mut bytes = html.len();
    for (name, text) in &files {
        let reply = site.get(&format!("{folder}/{name}")).await;
        assert_eq!(reply.status, StatusCode::OK, "{name}");
        let kind = match Path::new(name).extension().unwrap().to_str().unwrap() {
            "js" => "text/javascript; charset=utf-8",
            "css" => "text/css; charset=utf-8",
            "svg" => "image/svg+xml",
            other => panic!("{name}: no type is known for {other}"),
        };
        assert_eq!(reply.header("content-type"), kind, "{name}");
        assert_eq!(reply.header("cache-control"), "public, max-age=31536000, immutable", "{name}");
        assert_eq!(reply.header("etag"), format!("\"{}\"", sha256(text.as_bytes())), "{name}");
        assert_eq!(reply.header("content-security-policy"), POLICY, "{name}");
        assert_eq!(reply.header("x-content-type-options"), "nosniff", "{name}");
        assert_eq!(reply.body, text.as_bytes(), "{name}");
        bytes += reply.body.len();
    }
    assert!(bytes < MOST_BYTES, "the portal's files have {bytes} bytes");
}

#[test]
fn the_files_stay_short_and_ask_nothing_of_other_places() {
    let files = source();
    assert!(files.len() > 20, "{} files", files.len());
    for (name, text) in files {
        assert!(text.lines().count() <= MOST_LINES, "{name} has {} lines", text.lines().count());
        // The namespace of SVG is a name, not an address that is asked.
        let named = text.replace("http://www.w3.org/2000/svg", "");
        assert!(!named.contains("http://") && !named.contains("https://"), "{name} names another place");
        assert!(!text.contains("innerHTML"), "{name}: text becomes markup");
    }
}

/// Colours of the pages are those of the service: the pages' observer is every fifth row of the table.
#[test]
fn the_observer_of_the_pages_is_every_fifth_row_of_the_table() {
    let text = &source()["cie.js"];
    assert!(text.contains("FIRST_NM = 360;") && text.contains("STEP_NM = 5;"));
    let (_, rows) = text.split_once("CMF = [").unwrap();
    let numbers: Vec<f64> = rows
        .split(['[', ']', ',', ';'])
        .map(str::trim)
        .filter(|word| !word.is_empty())
        .map(|word| word.parse().unwrap_or_else(|error| panic!("{word}: {error}")))
        .collect();
    let rows: Vec<&[f64]> = numbers.chunks(3).collect();
    // 360 to 830 nm.
    assert_eq!(rows.len(), 95);
    for (k, row) in rows.iter().enumerate() {
        let nm = 360.0 + 5.0 * k as f64;
        for (own, table) in row.iter().zip(color_matching(nm)) {
            assert!((own - table).abs() <= 1e-12 * table.abs(), "{nm} nm: {own}, the table has {table}");
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_file_that_the_client_has_is_not_sent_again() {
    let site = Site::start(prompt()).await;
    let folder = folder(&site).await;
    for path in ["/", &format!("{folder}/app.js"), "/portal/sample.tm25ray"] {
        let whole = site.get(path).await;
        assert_eq!(whole.header("content-security-policy"), POLICY, "{path}");
        let etag = whole.header("etag").to_owned();
        let known = asked(&site, Method::GET, path, &[("if-none-match", &etag)]).await;
        assert_eq!((known.status.as_u16(), known.body.len()), (304, 0), "{path}");
        let changed = asked(&site, Method::GET, path, &[("if-match", "\"other\"")]).await;
        changed.is_problem(412, "request.precondition_failed");
        let head = asked(&site, Method::HEAD, path, &[]).await;
        assert_eq!((head.status, head.body.len(), head.header("etag")), (StatusCode::OK, 0, etag.as_str()), "{path}");
        assert_eq!(head.header("content-length"), whole.body.len().to_string(), "{path}");
        asked(&site, Method::POST, path, &[]).await.is_problem(405, "request.method_not_allowed");
    }
    let packed = asked(&site, Method::GET, &format!("{folder}/app.js"), &[("accept-encoding", "gzip")]).await;
    assert_eq!(packed.header("content-encoding"), "gzip");
}

#[tokio::test(flavor = "multi_thread")]
async fn another_version_and_another_name_are_not_there() {
    let site = Site::start(prompt()).await;
    let folder = folder(&site).await;
    for path in [
        "/portal/0123456789abcdef/app.js",
        "/portal/app.js",
        "/portal",
        &format!("{folder}/index.html"),
        &format!("{folder}/..%2Fmod.rs"),
    ] {
        site.get(path).await.is_problem(404, "request.not_found");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn behind_a_path_the_page_names_its_files_below_it() {
    let public = Prefix::parse("/lamps");
    let change = |mut config: Config| {
        config.proxies.public.clone_from(&public);
        config
    };
    let site = Site::start_as(change, prompt()).await;
    let folder = folder(&site).await;
    let own = folder.strip_prefix("/lamps").unwrap();
    assert_eq!(site.get(&format!("{own}/app.js")).await.status, StatusCode::OK);
}

#[tokio::test(flavor = "multi_thread")]
async fn the_sample_is_a_ray_file_like_any_other() {
    let site = Site::start(prompt()).await;
    let sample = site.get("/portal/sample.tm25ray").await;
    assert_eq!(sample.header("etag"), format!("\"{}\"", sha256(&sample.body)));
    let taken = site.upload(sample.body).await;
    assert_eq!(taken.status, StatusCode::CREATED);
    assert_eq!(taken.json()["ray_sets"][0]["header"]["ray_count"], 200_000);
    assert_eq!(taken.json()["ray_sets"][0]["inspection"]["verdict"], "ok");
}
