//! A service on a folder of its own and a client that sees everything: each response is held to what all responses owe, and
//! rows and files can be looked at.

use crate::engines;
use crate::engines::Engines;
use crate::runners::{prompt, prompt_with_a_model};
use axum::Router;
use axum::body::Body;
use axum::http::{HeaderMap, Method, Request, Response, StatusCode};
use http_body_util::BodyExt;
use serde_json::{Value, json};
use service::accounts::access::Scope;
use service::accounts::keys;
use service::accounts::keys::NewKey;
use service::accounts::quota::Quota;
use service::jobs::worker::Runner;
use service::metadata::Metadata;
use service::ray_sets::declaration::FileDeclaration;
use service::ray_sets::inspections::Inspection;
use service::ray_sets::pace::Slowest;
use service::ray_sets::rows;
use service::ray_sets::rows::Draft;
use service::storage::Storage;
use service::storage::blobs::Blobs;
use service::storage::keys::OWNER_KEY;
use service::storage::records::Records;
use service::storage::records::statement::{Row, Statement};
use service::{Config, Service};
use std::path::Path;
use std::time::{Duration, Instant};
use tempfile::TempDir;
use tower::ServiceExt;

/// Longest wait for what must come, on a machine busy with others: a verdict never hangs on how fast it is.
pub const PATIENCE: Duration = Duration::from_secs(240);

/// Every header a response may have; a new one is a decision, not an accident.
const HEADERS: [&str; 40] = [
    "access-control-allow-headers",
    "access-control-allow-methods",
    "access-control-allow-origin",
    "access-control-expose-headers",
    "access-control-max-age",
    "accept-encoding",
    "accept-ranges",
    "allow",
    "cache-control",
    "content-disposition",
    "content-encoding",
    "content-length",
    "content-range",
    "content-security-policy",
    "content-type",
    "cross-origin-resource-policy",
    "etag",
    "location",
    "ratelimit",
    "ratelimit-policy",
    "referrer-policy",
    "retry-after",
    "x-content-type-options",
    "x-request-id",
    "date",
    "connection",
    "vary",
    "tus-checksum-algorithm",
    "tus-extension",
    "tus-max-size",
    "tus-resumable",
    "tus-version",
    "upload-concat",
    "upload-defer-length",
    "upload-expires",
    "upload-length",
    "upload-metadata",
    "upload-offset",
    "www-authenticate",
    "x-accel-buffering",
];

/// A response, read to its end.
#[derive(Debug)]
pub struct Reply {
    pub status: StatusCode,
    pub headers: HeaderMap,
    pub body: Vec<u8>,
}

impl Reply {
    pub fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap_or_else(|_| panic!("not JSON: {self:?}"))
    }

    pub fn header(&self, name: &str) -> &str {
        self.headers.get(name).unwrap_or_else(|| panic!("no {name}: {self:?}")).to_str().unwrap()
    }

    /// Of a job, or of the first ray set of an upload.
    pub fn id(&self) -> String {
        let json = self.json();
        json["id"]
            .as_str()
            .or(json["ray_sets"][0]["id"].as_str())
            .unwrap_or_else(|| panic!("no id: {self:?}"))
            .to_owned()
    }

    /// The one ray set of an upload.
    pub fn ray_set(&self) -> Value {
        let json = self.json();
        assert_eq!((json["ray_sets"].as_array().map(Vec::len), &json["left_out"]), (Some(1), &json!([])), "{json}");
        json["ray_sets"][0].clone()
    }

    /// Status and code of a problem.
    pub fn problem(&self) -> (u16, String) {
        (self.status.as_u16(), self.json()["code"].as_str().unwrap_or_default().to_owned())
    }

    #[track_caller]
    pub fn is_problem(&self, status: u16, code: &str) {
        assert_eq!(self.problem(), (status, code.to_owned()), "{}", String::from_utf8_lossy(&self.body));
    }

    /// What every response owes.
    fn check(&self, method: &Method) {
        for name in self.headers.keys() {
            assert!(HEADERS.contains(&name.as_str()), "unexpected header {name}: {self:?}");
        }
        assert!(!self.header("x-request-id").is_empty());
        assert_eq!(self.header("x-content-type-options"), "nosniff");
        assert!(self.header("content-security-policy").contains("frame-ancestors 'none'"));
        assert!(self.headers.contains_key("cache-control"));
        if *method == Method::HEAD {
            assert!(self.body.is_empty());
        } else if self.status.as_u16() >= 400 {
            let problem = self.json();
            assert_eq!(self.header("content-type"), "application/problem+json");
            assert_eq!(problem["status"], self.status.as_u16());
            assert_eq!(problem["type"], format!("urn:lampwright:problem:{}", problem["code"].as_str().unwrap()));
            for member in ["title", "detail"] {
                assert!(problem[member].as_str().is_some_and(|text| !text.is_empty()), "{member}: {problem}");
            }
        }
        match self.status.as_u16() {
            401 => assert!(self.header("www-authenticate").starts_with("Bearer")),
            429 => assert!(self.header("retry-after").parse::<u32>().unwrap() >= 1),
            503 => assert_eq!(self.header("retry-after"), "1"),
            _ => {}
        }
        if self.status == StatusCode::METHOD_NOT_ALLOWED {
            assert!(!self.header("allow").is_empty());
        }
    }
}

/// A service and its folder.
pub struct Site {
    pub folder: TempDir,
    pub config: Config,
    pub service: Option<Service>,
    /// Goes with every request that brings no other.
    pub key: Option<String>,
    router: Router,
}

/// Short times, so that what takes seconds in life takes less here.
fn quick(folder: &Path) -> Config {
    Config {
        listen: ([127, 0, 0, 1], 0).into(),
        // A worker that the machine keeps waiting for so long is taken for dead.
        lease: Duration::from_millis(1200),
        poll: Duration::from_millis(100),
        grace: Duration::from_millis(1500),
        slowest: Slowest { interval: Duration::from_millis(400), bytes: 1 },
        concurrency: 1,
        threads: 1,
        ..Config::new(folder)
    }
}

/// `config` on the servers, when there are any.
pub async fn on_engines(config: Config) -> Config {
    match engines::shared().await {
        Some(Engines { database_url, storage_url }) => {
            Config { database_url: Some(database_url), storage_url: Some(storage_url), ..config }
        }
        None => config,
    }
}

/// Both stores, and no service.
pub async fn stores(folder: &Path) -> Storage {
    let config = on_engines(Config::new(folder)).await;
    Storage::open(&config.database_url(), &config.storage_url()).await.unwrap()
}

/// The same stores as two processes open them.
pub async fn two_stores(folder: &Path) -> (Storage, Storage) {
    let config = on_engines(Config::new(folder)).await;
    let open = async || Storage::open(&config.database_url(), &config.storage_url()).await.unwrap();
    (open().await, open().await)
}

/// Makes a ray set known that has no bytes.
pub async fn known(storage: &Storage, id: &str) {
    let row = rows::RaySet {
        id: id.into(),
        name: "r".into(),
        byte_count: 1,
        sha256: String::new(),
        header: "{}".into(),
        declared: FileDeclaration::default(),
        packed: None,
        metadata: Metadata::default(),
        created_ms: 0,
    };
    let draft = Draft { ray_set: row, parts: Vec::new(), inspection: Inspection::default() };
    rows::insert(&storage.records, "default", Quota::default(), vec![draft]).await.unwrap().unwrap();
}

impl Site {
    pub async fn start(runner: Runner) -> Site {
        Site::start_as(|config| config, runner).await
    }

    pub async fn start_as(change: impl Fn(Config) -> Config, runner: Runner) -> Site {
        let folder = tempfile::tempdir().unwrap();
        let config = change(on_engines(quick(&folder.path().join("data"))).await);
        let service = Service::start_with(config.clone(), runner).await.unwrap();
        Site { router: service.router(), folder, config, service: Some(service), key: None }
    }

    /// Kills the service, as far as that can be done within a process: nothing of it runs its last lines.
    pub async fn kill(&mut self) {
        self.service = None;
        self.router = Router::new();
        // Its tasks end at their next await; the file lock goes with the last of them.
        tokio::time::sleep(Duration::from_millis(50)).await;
    }

    /// Starts another service on the same folder.
    pub async fn restart(&mut self, runner: Runner) {
        let service = Service::start_with(self.config.clone(), runner).await.unwrap();
        self.router = service.router();
        self.service = Some(service);
    }

    pub async fn send(&self, request: Request<Body>) -> Reply {
        let method = request.method().clone();
        let response = self.router.clone().oneshot(request).await.unwrap();
        let (parts, body) = response.into_parts();
        let body = body.collect().await.unwrap().to_bytes().to_vec();
        let reply = Reply { status: parts.status, headers: parts.headers, body };
        reply.check(&method);
        reply
    }

    pub async fn ask(&self, method: Method, path: &str, headers: &[(&str, &str)], body: impl Into<Body>) -> Reply {
        let mut request = Request::builder().method(method).uri(path);
        for (name, value) in headers {
            request = request.header(*name, *value);
        }
        if let (Some(key), false) = (&self.key, headers.iter().any(|(name, _)| *name == "authorization")) {
            request = request.header("authorization", format!("Bearer {key}"));
        }
        self.send(request.body(body.into()).unwrap()).await
    }

    /// The response to a GET, its body still to come.
    pub async fn begin(&self, path: &str) -> Response<Body> {
        self.router.clone().oneshot(Request::get(path).body(Body::empty()).unwrap()).await.unwrap()
    }

    pub async fn get(&self, path: &str) -> Reply {
        self.ask(Method::GET, path, &[], Body::empty()).await
    }

    pub async fn delete(&self, path: &str) -> Reply {
        self.ask(Method::DELETE, path, &[], Body::empty()).await
    }

    pub async fn post(&self, path: &str, body: &Value) -> Reply {
        self.ask(Method::POST, path, &[("content-type", "application/json")], body.to_string()).await
    }

    pub async fn upload(&self, bytes: Vec<u8>) -> Reply {
        self.ask(Method::POST, "/v1/ray-sets?name=led.dat", &[], bytes).await
    }

    /// Uploads a small good file; its id.
    pub async fn ray_set(&self) -> String {
        let reply = self.upload(crate::rays::zemax(10)).await;
        assert_eq!(reply.status, StatusCode::CREATED, "{reply:?}");
        reply.id()
    }

    /// A site with a job that has succeeded, and the job: its model is that of [`prompt_with_a_model`].
    pub async fn with_a_model() -> (Site, String) {
        Site::with_a_model_as(|config| config).await
    }

    /// The same with another configuration.
    pub async fn with_a_model_as(change: impl Fn(Config) -> Config) -> (Site, String) {
        let site = Site::start_as(change, prompt_with_a_model()).await;
        let job = site.job(&site.ray_set().await).await;
        site.until_state(&job, "succeeded").await;
        (site, job)
    }

    /// What only a model has is asked at `under` of a job that has none, as one that has not succeeded.
    pub async fn assert_is_no_model(under: &str) {
        let site = Site::start(prompt()).await;
        let job = site.job(&site.ray_set().await).await;
        site.until_state(&job, "succeeded").await;
        site.get(&format!("/v1/jobs/{job}/{under}")).await.is_problem(404, "artifact.not_found");
    }

    /// Queues a job of its own, whether or not there is an equal one; its id.
    pub async fn job(&self, ray_set: &str) -> String {
        let reply = self.post("/v1/jobs", &json!({ "channels": [{"ray_set": ray_set}], "reuse": false })).await;
        assert_eq!(reply.status, StatusCode::ACCEPTED, "{reply:?}");
        reply.id()
    }

    /// Polls a job until `done`, as a client would.
    pub async fn until(&self, job: &str, done: impl Fn(&Value) -> bool) -> Value {
        let start = Instant::now();
        loop {
            let reply = self.get(&format!("/v1/jobs/{job}")).await.json();
            if done(&reply) {
                return reply;
            }
            assert!(start.elapsed() < PATIENCE, "still {reply}");
            // Jobs that take long are asked for less often: requests are counted.
            let pause_ms = if start.elapsed() < Duration::from_secs(1) { 10 } else { 100 };
            tokio::time::sleep(Duration::from_millis(pause_ms)).await;
        }
    }

    pub async fn until_state(&self, job: &str, state: &str) -> Value {
        self.until(job, |job| job["state"] == state).await
    }

    /// Waits until the object store holds what it should. Rows tell of an end first, blobs go after them.
    pub async fn until_blobs(&self, right: impl Fn(&[String]) -> bool) {
        let start = Instant::now();
        loop {
            let blobs = self.blobs();
            if right(&blobs) {
                return;
            }
            assert!(start.elapsed() < PATIENCE, "still {blobs:?}");
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    }

    /// Every key in the object store, in order, but the one that names its database.
    pub fn blobs(&self) -> Vec<String> {
        let store = Blobs::open(&self.config.storage_url()).unwrap();
        let listed = tokio::task::block_in_place(|| tokio::runtime::Handle::current().block_on(store.list("")));
        let mut keys: Vec<String> = listed.unwrap().into_iter().map(|blob| blob.key).collect();
        keys.retain(|key| key != OWNER_KEY);
        keys.sort();
        keys
    }

    /// A new key of `tenant`.
    pub async fn key_of(&self, tenant: &str, scopes: &[Scope]) -> String {
        let (tenant, scopes) = (tenant.to_owned(), scopes.to_vec());
        let new = NewKey { tenant, name: String::new(), scopes, lifetime_ms: None };
        let records = Records::open(&self.config.database_url()).await.unwrap();
        keys::create(&records, &new).await.unwrap().token
    }

    /// Asks the database behind the service's back.
    pub async fn rows(&self, statement: Statement) -> Vec<Row> {
        Records::open(&self.config.database_url()).await.unwrap().read(statement).await.unwrap()
    }

    /// Changes the database behind the service's back.
    pub async fn write(&self, statement: Statement) -> u64 {
        Records::open(&self.config.database_url()).await.unwrap().write(statement).await.unwrap()
    }
}
