//! `/` and `/portal/`: the pages for people. They are plain files of ours (`src/service/portal/`), fetch nothing from elsewhere, and
//! do nothing that a client of the contract could not do.

use super::addresses::link;
use super::extract::Path;
use super::fixed::{file_or_not, tag};
use super::problem::Problem;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use bytes::Bytes;
use sha2::{Digest, Sha256};
use std::sync::{LazyLock, OnceLock};

/// Only files of this service, and nothing written into the page.
const POLICY: &str = "default-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'";
/// The page itself is asked for anew: it names the version of all other files. It also names the path that a proxy puts before the
/// service, so no shared cache hands it to others.
const PAGE_LIFETIME: &str = "private, no-cache";
/// Another version of these files has another address.
const FILE_LIFETIME: &str = "public, max-age=31536000, immutable";
/// The sample changes with the program.
const SAMPLE_LIFETIME: &str = "public, no-cache";
/// Where the page has the address of the folder of all other files.
const FOLDER: &str = "{folder}";

const PAGE: &str = include_str!("../portal/index.html");
/// Names, types and contents of all other files.
const FILES: [File; 45] = [
    script("api", include_str!("../portal/api.js")),
    script("app", include_str!("../portal/app.js")),
    script("axes", include_str!("../portal/axes.js")),
    script("camera", include_str!("../portal/camera.js")),
    script("channel", include_str!("../portal/channel.js")),
    script("charts", include_str!("../portal/charts.js")),
    script("choice", include_str!("../portal/choice.js")),
    script("cie", include_str!("../portal/cie.js")),
    script("colour", include_str!("../portal/colour.js")),
    script("columns", include_str!("../portal/columns.js")),
    script("command", include_str!("../portal/command.js")),
    script("compare", include_str!("../portal/compare.js")),
    script("cut", include_str!("../portal/cut.js")),
    script("difference", include_str!("../portal/difference.js")),
    script("dom", include_str!("../portal/dom.js")),
    script("downloads", include_str!("../portal/downloads.js")),
    script("evaluation", include_str!("../portal/evaluation.js")),
    script("facts", include_str!("../portal/facts.js")),
    script("glb", include_str!("../portal/glb.js")),
    script("goniogram", include_str!("../portal/goniogram.js")),
    script("graph", include_str!("../portal/graph.js")),
    script("home", include_str!("../portal/home.js")),
    script("hue", include_str!("../portal/hue.js")),
    drawing("icon", include_str!("../portal/icon.svg")),
    script("illuminance", include_str!("../portal/illuminance.js")),
    script("job", include_str!("../portal/job.js")),
    script("kept", include_str!("../portal/kept.js")),
    script("keys", include_str!("../portal/keys.js")),
    style("lamp", include_str!("../portal/lamp.css")),
    script("lamp", include_str!("../portal/lamp.js")),
    script("model", include_str!("../portal/model.js")),
    script("numbers", include_str!("../portal/numbers.js")),
    script("options", include_str!("../portal/options.js")),
    script("picture", include_str!("../portal/picture.js")),
    script("plane", include_str!("../portal/plane.js")),
    style("portal", include_str!("../portal/portal.css")),
    script("quality", include_str!("../portal/quality.js")),
    script("shaders", include_str!("../portal/shaders.js")),
    script("simpler", include_str!("../portal/simpler.js")),
    script("solid", include_str!("../portal/solid.js")),
    script("source", include_str!("../portal/source.js")),
    script("transfers", include_str!("../portal/transfers.js")),
    script("upload", include_str!("../portal/upload.js")),
    script("view", include_str!("../portal/view.js")),
    script("words", include_str!("../portal/words.js")),
];

static VERSION: LazyLock<String> = LazyLock::new(version);
/// The built-in sample, once somebody has asked for it.
static SAMPLE: OnceLock<(Bytes, String)> = OnceLock::new();

/// A file beside the page: `stem.kind`.
struct File {
    stem: &'static str,
    kind: &'static str,
    media_type: &'static str,
    text: &'static str,
}

const fn script(stem: &'static str, text: &'static str) -> File {
    File { stem, kind: "js", media_type: "text/javascript; charset=utf-8", text }
}

const fn style(stem: &'static str, text: &'static str) -> File {
    File { stem, kind: "css", media_type: "text/css; charset=utf-8", text }
}

const fn drawing(stem: &'static str, text: &'static str) -> File {
    File { stem, kind: "svg", media_type: "image/svg+xml", text }
}

/// What the address of the files says of all of them together.
fn version() -> String {
    let mut digest = Sha256::new();
    for file in &FILES {
        for part in [file.stem, file.kind, file.text] {
            digest.update(part);
            digest.update([0]);
        }
    }
    crate::hex::hex(&digest.finalize()).chars().take(16).collect()
}

/// `/`.
///
/// # Errors
/// [`Problem`]: the client wants another edition of it.
pub async fn page(headers: HeaderMap) -> Result<Response, Problem> {
    let text = PAGE.replace(FOLDER, &link(&format!("/portal/{}", *VERSION)));
    let etag = tag(text.as_bytes());
    answer(&headers, &etag, PAGE_LIFETIME, "text/html; charset=utf-8", || text)
}

/// Any other file of the portal, at the address of its version.
///
/// # Errors
/// [`Problem`]: no such file, or the client wants another edition of it.
pub async fn file(Path((version, name)): Path<(String, String)>, headers: HeaderMap) -> Result<Response, Problem> {
    let (stem, kind) = name.split_once('.').unwrap_or_default();
    let found = FILES.iter().find(|file| (file.stem, file.kind) == (stem, kind) && version == *VERSION);
    let file = found.ok_or_else(|| Problem::no_route(&format!("/portal/{version}/{name}")))?;
    answer(&headers, &tag(file.text.as_bytes()), FILE_LIFETIME, file.media_type, || file.text)
}

fn answer<B: IntoResponse>(
    headers: &HeaderMap,
    etag: &str,
    lifetime: &'static str,
    media_type: &'static str,
    body: impl FnOnce() -> B,
) -> Result<Response, Problem> {
    let mut response = file_or_not(headers, etag, lifetime, || body().into_response())?;
    let is_whole = response.status() == StatusCode::OK;
    let headers = response.headers_mut();
    if is_whole {
        headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(media_type));
    }
    headers.insert(header::CONTENT_SECURITY_POLICY, HeaderValue::from_static(POLICY));
    Ok(response)
}

/// The ray file of the built-in sample, for who has none at hand: the portal sends it like any other file.
///
/// # Errors
/// [`Problem`]: the client wants another edition of it, or it cannot be made.
pub async fn sample(headers: HeaderMap) -> Result<Response, Problem> {
    let made = tokio::task::spawn_blocking(|| {
        if let Some(made) = SAMPLE.get() {
            return Ok(made.clone());
        }
        let mut bytes = Vec::new();
        pipeline::write_sample(&mut bytes)?;
        let etag = tag(&bytes);
        Ok::<_, std::io::Error>(SAMPLE.get_or_init(|| (Bytes::from(bytes), etag)).clone())
    });
    let (bytes, etag) = match made.await {
        Ok(Ok(made)) => made,
        Ok(Err(error)) => return Err(unmade(&error)),
        Err(error) => return Err(unmade(&error)),
    };
    answer(&headers, &etag, SAMPLE_LIFETIME, "application/octet-stream", || bytes)
}

fn unmade(error: &impl std::fmt::Display) -> Problem {
    tracing::error!(%error, "cannot make the built-in sample");
    Problem::internal()
}
