//! Every route of the contract is walked with keys that open nothing, keys for other things and another tenant's keys: a route
//! that does not ask, or that asks no database whose things it tells of, fails here before anybody has thought of a test for it.

use axum::body::Body;
use axum::http::{Method, StatusCode};
use serde_json::{Value, json};
use service::accounts::access::Scope;
use service::accounts::quota::Quota;
use service::accounts::tenants::Tenant;
use service::accounts::{keys, tenants};
use service::http::openapi;
use service::storage::records::Records;
use service::storage::records::statement::sql;
use service::{Config, Service, StartError};
use support::runners::{Gate, held, prompt, prompt_with_a_model};
use support::site::{Reply, Site};

const NOBODY: &str = "0190b5a0-0000-7000-8000-000000000000";

fn with_keys(config: Config) -> Config {
    Config { auth: true, ..config }
}

/// An operation of the contract.
pub struct Operation {
    pub id: String,
    pub method: Method,
    pub path: String,
    /// What a key needs one of; none for what everybody may ask.
    scopes: Vec<Scope>,
}

pub fn operations() -> Vec<Operation> {
    let contract: Value = serde_json::from_str(&openapi()).unwrap();
    let mut operations = Vec::new();
    for (path, item) in contract["paths"].as_object().unwrap() {
        for (method, operation) in item.as_object().unwrap() {
            let ways = operation["security"].as_array().cloned().unwrap_or_default();
            let scopes = ways.iter().map(|way| Scope::parse(way["key"][0].as_str().unwrap()).unwrap()).collect();
            let method = method.to_uppercase().parse().unwrap();
            let id = operation["operationId"].as_str().unwrap().to_owned();
            operations.push(Operation { id, method, path: path.clone(), scopes });
        }
    }
    operations
}

/// What one tenant has: an id for every path parameter of the contract.
pub struct Things {
    ray_set: String,
    upload: String,
    spectrum: String,
    job: String,
    webhook: String,
    delivery: String,
}

impl Things {
    /// The address of an operation on these things.
    pub fn address(&self, path: &str) -> String {
        let kind = path.split('/').nth(2).unwrap_or_default();
        let id = match kind {
            "ray-sets" => &self.ray_set,
            "uploads" => &self.upload,
            "spectra" => &self.spectrum,
            "jobs" => &self.job,
            "webhooks" => &self.webhook,
            _ => "",
        };
        let query = if path.ends_with("/rays") { "?count=10" } else { "" };
        let address = path
            .replace("{id}", id)
            .replace("{name}", "read.txt")
            .replace("{renderer}", "mitsuba")
            .replace("{delivery}", &self.delivery)
            + query;
        assert!(!address.contains('{') && !address.contains("//"), "say here what the parameters of {path} are");
        address
    }

    /// A body that names these things, where an operation takes one.
    pub fn body(&self, operation: &str) -> Body {
        match operation {
            "create_job" => json!({ "channels": [{"ray_set": self.ray_set}] }).to_string().into(),
            "combine_models" => json!({ "models": [{"job": self.job}] }).to_string().into(),
            "queue_evaluation" => {
                json!({ "job": self.job, "evaluation": {"view": {"angles": [[0, 0]]}} }).to_string().into()
            }
            "evaluate_model" => json!({ "view": {"angles": [[0, 0]]} }).to_string().into(),
            "create_webhook" => json!({ "url": NOWHERE }).to_string().into(),
            "change_webhook" => json!({ "description": "mine" }).to_string().into(),
            "ingest_ray_set" => json!({ "url": NOWHERE }).to_string().into(),
            "upload_ray_set" => support::rays::zemax(3).into(),
            "upload_spectrum" => SPECTRUM.into(),
            "append_to_upload" => vec![0; 10].into(),
            _ => Body::empty(),
        }
    }

    pub async fn ask(&self, site: &Site, operation: &Operation, authorization: Option<&str>) -> Reply {
        let mut headers = match operation.path.starts_with(TUS) {
            true => TUS_HEADERS.to_vec(),
            false => vec![("content-type", "application/json")],
        };
        headers.extend(authorization.map(|value| ("authorization", value)));
        site.ask(operation.method.clone(), &self.address(&operation.path), &headers, self.body(&operation.id)).await
    }
}

/// Whoever asks there speaks it.
const TUS: &str = "/v1/uploads";
pub const TUS_HEADERS: [(&str, &str); 4] = [
    ("tus-resumable", "1.0.0"),
    ("upload-length", "488"),
    ("upload-offset", "0"),
    ("content-type", "application/offset+octet-stream"),
];

/// A name that nobody will ever have (RFC 2606).
const NOWHERE: &str = "https://receiver.invalid/";
const SPECTRUM: &str = "500 0\n550 1\n600 0\n";

/// A site where the tenant `lab` has a ray set, an upload that waits for its bytes, a spectrum and a job that has succeeded.
pub async fn lab() -> (Site, Things) {
    let mut site = Site::start_as(with_keys, prompt_with_a_model()).await;
    site.key = Some(site.key_of("lab", &Scope::OF_A_TENANT).await);
    let ray_set = site.ray_set().await;
    let begun = site.ask(Method::POST, TUS, &TUS_HEADERS[..2], Body::empty()).await;
    let upload = begun.header("location").rsplit('/').next().unwrap().to_owned();
    let spectrum = site.ask(Method::POST, "/v1/spectra", &[], SPECTRUM).await.id();
    let job = site.job(&ray_set).await;
    site.until_state(&job, "succeeded").await;
    let webhook = site.post("/v1/webhooks", &json!({ "url": NOWHERE })).await.id();
    let delivery = site.post(&format!("/v1/webhooks/{webhook}/ping"), &json!({})).await.id();
    site.key = None;
    (site, Things { ray_set, upload, spectrum, job, webhook, delivery })
}

/// An answer to HEAD has no body: its status must do.
fn assert_refused(operation: &Operation, reply: &Reply, (status, code): (u16, &str)) {
    match operation.method {
        Method::HEAD => assert_eq!(reply.status.as_u16(), status, "{}: {reply:?}", operation.id),
        _ => assert_eq!(reply.problem(), (status, code.to_owned()), "{}: {reply:?}", operation.id),
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn every_route_asks_for_a_key_that_is_good_and_for_this() {
    let (site, things) = lab().await;
    let records = Records::open(&site.config.database_url()).await.unwrap();
    let new = |lifetime_ms| keys::NewKey {
        tenant: "lab".into(),
        name: String::new(),
        scopes: Scope::ALL.to_vec(),
        lifetime_ms,
    };
    let good = keys::create(&records, &new(None)).await.unwrap();
    let revoked = keys::create(&records, &new(None)).await.unwrap();
    assert!(keys::revoke(&records, &revoked.id).await.unwrap());
    let expired = keys::create(&records, &new(Some(1))).await.unwrap();
    let unknown = format!("lw_{}_{}", good.id, "0".repeat(64));
    let rows = "SELECT id FROM jobs UNION ALL SELECT id FROM ray_sets UNION ALL SELECT id FROM uploads";
    let before = site.rows(sql(rows)).await.len();
    let mut open = Vec::new();
    for operation in operations() {
        if operation.scopes.is_empty() {
            open.push(operation.id);
            continue;
        }
        let all_but: Vec<Scope> = Scope::ALL.into_iter().filter(|other| !operation.scopes.contains(other)).collect();
        let other = format!("Bearer {}", site.key_of("lab", &all_but).await);
        let bearer = |token: &str| format!("Bearer {token}");
        for (authorization, status, code) in [
            (None, 401, "access.key_missing"),
            (Some("Basic bGFiOmxhYg==".to_owned()), 401, "access.key_malformed"),
            (Some(bearer("lw_x_y")), 401, "access.key_malformed"),
            (Some(bearer(&unknown)), 401, "access.key_unknown"),
            (Some(bearer(&expired.token)), 401, "access.key_expired"),
            (Some(bearer(&revoked.token)), 401, "access.key_revoked"),
            (Some(other), 403, "access.scope_missing"),
        ] {
            let reply = things.ask(&site, &operation, authorization.as_deref()).await;
            assert_refused(&operation, &reply, (status, code));
        }
        // A key in the address is no key.
        let address = things.address(&operation.path);
        let join = if address.contains('?') { '&' } else { '?' };
        let address = format!("{address}{join}access_token={}", good.token);
        let speaks = if operation.path.starts_with(TUS) { &TUS_HEADERS[..1] } else { &[] };
        let reply = site.ask(operation.method.clone(), &address, speaks, Body::empty()).await;
        assert_refused(&operation, &reply, (401, "access.key_missing"));
    }
    assert_eq!(open, ["health", "ready"], "these ask nobody who they are");
    let after = site.rows(sql(rows)).await.len();
    assert_eq!(before, after, "somebody without a right did something");
    // The good key opens what may be asked without changing anything.
    for operation in operations().iter().filter(|operation| operation.method == Method::GET) {
        let reply = things.ask(&site, operation, Some(&format!("Bearer {}", good.token))).await;
        assert!(reply.status.is_success(), "{}: {reply:?}", operation.id);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn another_tenant_finds_nothing_on_any_route() {
    let (site, things) = lab().await;
    let stranger = format!("Bearer {}", site.key_of("shop", &Scope::ALL).await);
    let [ray_set, upload, spectrum, job, webhook, delivery] = [(); 6].map(|()| NOBODY.to_owned());
    let nothing = Things { ray_set, upload, spectrum, job, webhook, delivery };
    let rows = "SELECT id, state, cancel_requested FROM jobs UNION ALL SELECT id, name, 0 FROM ray_sets \
                UNION ALL SELECT id, name, 0 FROM spectra UNION ALL SELECT id, state, 0 FROM uploads \
                UNION ALL SELECT id, description, 0 FROM webhooks UNION ALL SELECT id, event, 0 FROM deliveries ORDER BY 1";
    let told = async |site: &Site| {
        let rows = site.rows(sql(rows)).await;
        rows.iter().map(|row| (row.text("id").unwrap(), row.text("state").unwrap())).collect::<Vec<_>>()
    };
    let (before, blobs) = (told(&site).await, site.blobs());
    let mut without_id = Vec::new();
    for operation in operations().into_iter().filter(|operation| !operation.scopes.is_empty()) {
        if !operation.path.contains('{')
            && !["combine_models", "create_job", "queue_evaluation"].contains(&operation.id.as_str())
        {
            without_id.push(operation.id);
            continue;
        }
        let (theirs, nobodys) = (
            things.ask(&site, &operation, Some(&stranger)).await,
            nothing.ask(&site, &operation, Some(&stranger)).await,
        );
        assert_eq!(theirs.status, StatusCode::NOT_FOUND, "{}: {theirs:?}", operation.id);
        // Nothing tells a thing of another tenant from no thing.
        let text = String::from_utf8(theirs.body).unwrap();
        let known = [&things.ray_set, &things.upload, &things.spectrum, &things.job, &things.webhook, &things.delivery];
        let text = known.into_iter().fold(text, |text, id| text.replace(id, NOBODY));
        assert_eq!(text, String::from_utf8(nobodys.body).unwrap(), "{}", operation.id);
    }
    // What names no thing lists none of another's, or makes one's own, or counts the whole service.
    let known = [
        "metrics",
        "list_jobs",
        "list_ray_sets",
        "upload_ray_set",
        "ingest_ray_set",
        "list_spectra",
        "upload_spectrum",
        "list_uploads",
        "create_upload",
        "list_webhooks",
        "create_webhook",
    ];
    assert_eq!(without_id, known, "say here what these do");
    let digest = support::runners::sha256(&support::rays::zemax(10));
    let mine = [format!("/v1/jobs?ray_set={}", things.ray_set), format!("/v1/ray-sets?sha256={digest}")];
    let lists = ["/v1/jobs", "/v1/ray-sets", "/v1/spectra", "/v1/uploads", "/v1/jobs?state=succeeded", "/v1/webhooks"];
    for list in lists.into_iter().chain(mine.iter().map(String::as_str)) {
        let reply = site.ask(Method::GET, list, &[("authorization", &stranger)], Body::empty()).await;
        let text = String::from_utf8(reply.body).unwrap();
        let theirs = [&things.job, &things.ray_set, &things.spectrum, &things.upload, &things.webhook];
        assert!(theirs.iter().all(|id| !text.contains(*id)), "{list}: {text}");
    }
    assert_eq!((told(&site).await, site.blobs()), (before, blobs), "a stranger changed something");
}

#[tokio::test(flavor = "multi_thread")]
async fn tenants_work_side_by_side() {
    let (mut site, things) = lab().await;
    site.key = Some(site.key_of("shop", &Scope::OF_A_TENANT).await);
    let ray_set = site.ray_set().await;
    let borrowed = json!({ "channels": [{"ray_set": ray_set, "spectrum": {"id": things.spectrum}}] });
    site.post("/v1/jobs", &borrowed).await.is_problem(404, "spectrum.not_found");
    let job = site.job(&ray_set).await;
    site.until_state(&job, "succeeded").await;
    assert_eq!(site.get("/v1/jobs").await.json()["jobs"].as_array().unwrap().len(), 1);
    assert_eq!(site.get("/v1/ray-sets").await.json()["ray_sets"][0]["id"], ray_set);
    for address in [format!("/v1/jobs/{job}"), format!("/v1/ray-sets/{ray_set}")] {
        assert_eq!(site.delete(&address).await.status, StatusCode::NO_CONTENT);
    }
    site.key = Some(site.key_of("lab", &Scope::OF_A_TENANT).await);
    assert_eq!(site.get(&format!("/v1/jobs/{}/model.zip", things.job)).await.status, StatusCode::OK);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_key_that_asks_too_often_waits_but_may_still_ask_for_less() {
    let slow = |config| Config { rate_per_second: 1, rate_burst: 4, ..with_keys(config) };
    let gate = Gate::new();
    let mut site = Site::start_as(slow, held(&gate)).await;
    site.key = Some(site.key_of("lab", &Scope::OF_A_TENANT).await);
    let ray_set = site.ray_set().await;
    let job = site.job(&ray_set).await;
    // On a slow machine some come back to the bucket meanwhile: twenty at once are too many on any.
    let many = futures::future::join_all((0..20).map(|_| site.get("/v1/jobs"))).await;
    let refused: Vec<&Reply> = many.iter().filter(|reply| reply.status == StatusCode::TOO_MANY_REQUESTS).collect();
    assert!(!refused.is_empty());
    refused.iter().for_each(|reply| reply.is_problem(429, "access.rate"));
    assert_eq!(refused[0].header("retry-after"), "1");
    // Another key has a bucket of its own.
    let other = format!("Bearer {}", site.key_of("lab", &Scope::OF_A_TENANT).await);
    let reply = site.ask(Method::GET, "/v1/jobs", &[("authorization", &other)], Body::empty()).await;
    assert_eq!(reply.status, StatusCode::OK);
    for _ in 0..10 {
        assert_eq!(site.get("/healthz").await.status, StatusCode::OK);
        assert_ne!(
            site.post(&format!("/v1/jobs/{job}/cancel"), &json!({})).await.status,
            StatusCode::TOO_MANY_REQUESTS
        );
        assert_ne!(site.delete(&format!("/v1/ray-sets/{ray_set}")).await.status, StatusCode::TOO_MANY_REQUESTS);
    }
    gate.open();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_tenant_keeps_no_more_bytes_than_its_quota() {
    let bytes = support::rays::zemax(10);
    let size = bytes.len() as u64;
    let quota = Quota { stored_bytes: 2 * size + size / 2, ..Quota::default() };
    let mut site = Site::start_as(|config| Config { quota, ..with_keys(config) }, prompt()).await;
    site.key = Some(site.key_of("lab", &Scope::OF_A_TENANT).await);
    let ids = [site.ray_set().await, site.ray_set().await];
    // Said before the body where its length is, and while it comes where it is not.
    let silent = Body::from_stream(futures::stream::pending::<Result<axum::body::Bytes, std::io::Error>>());
    let length = size.to_string();
    let announced = [("content-length", length.as_str())];
    site.ask(Method::POST, "/v1/ray-sets", &announced, silent).await.is_problem(413, "quota.stored_bytes");
    let pieces = futures::stream::iter(
        bytes.chunks(64).map(|piece| Ok::<_, std::io::Error>(piece.to_vec())).collect::<Vec<_>>(),
    );
    site.ask(Method::POST, "/v1/ray-sets", &[], Body::from_stream(pieces)).await.is_problem(413, "quota.stored_bytes");
    // Twenty at once cannot share the last place.
    assert_eq!(site.delete(&format!("/v1/ray-sets/{}", ids[0])).await.status, StatusCode::NO_CONTENT);
    let many = futures::future::join_all((0..8).map(|_| site.upload(bytes.clone()))).await;
    assert_eq!(many.iter().filter(|reply| reply.status == StatusCode::CREATED).count(), 1);
    let kept = site.rows(sql("SELECT id FROM ray_sets")).await.len();
    assert_eq!((kept, site.blobs().len()), (2, 2), "what was refused is not kept");
    // Another tenant has its own, and the operator can give more.
    let records = Records::open(&site.config.database_url()).await.unwrap();
    let more = Tenant { id: "lab".into(), stored_bytes: Some(1 << 30), ..Tenant::default() };
    tenants::set(&records, &more).await.unwrap();
    site.ray_set().await;
    site.key = Some(site.key_of("shop", &Scope::OF_A_TENANT).await);
    site.ray_set().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_tenant_queues_and_runs_no_more_jobs_than_its_quota() {
    let gate = Gate::new();
    let quota = Quota { queued_jobs: 2, running_jobs: 1, ..Quota::default() };
    let wide = |config| Config { quota, concurrency: 3, ..with_keys(config) };
    let mut site = Site::start_as(wide, held(&gate)).await;
    let lab = site.key_of("lab", &Scope::OF_A_TENANT).await;
    site.key = Some(lab.clone());
    let ray_set = site.ray_set().await;
    let running = site.job(&ray_set).await;
    site.until_state(&running, "running").await;
    let waiting = [site.job(&ray_set).await, site.job(&ray_set).await];
    let one_more = json!({ "channels": [{"ray_set": ray_set}], "reuse": false });
    let refused = site.post("/v1/jobs", &one_more).await;
    refused.is_problem(429, "quota.queued_jobs");
    assert_eq!(refused.header("retry-after"), "10");
    // Two places are free, and not for this tenant: the job of another that came later runs.
    site.key = Some(site.key_of("shop", &Scope::OF_A_TENANT).await);
    let others = site.ray_set().await;
    let other = site.job(&others).await;
    site.until_state(&other, "running").await;
    site.key = Some(lab);
    assert_eq!(site.get(&format!("/v1/jobs/{}", waiting[0])).await.json()["state"], "queued");
    // Who has too many can always have fewer, and then one more.
    assert_eq!(site.post(&format!("/v1/jobs/{}/cancel", waiting[1]), &json!({})).await.status, StatusCode::ACCEPTED);
    assert_eq!(site.post("/v1/jobs", &one_more).await.status, StatusCode::ACCEPTED);
    // Room for a second one: it is found without waiting for the first to end.
    let records = Records::open(&site.config.database_url()).await.unwrap();
    let more = Tenant { id: "lab".into(), running_jobs: Some(2), ..Tenant::default() };
    tenants::set(&records, &more).await.unwrap();
    site.until_state(&waiting[0], "running").await;
    gate.open();
    site.until_state(&waiting[0], "succeeded").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_service_that_others_can_reach_does_not_start_without_a_key() {
    let site = Site::start(prompt()).await;
    let others = |config: &Config| Config { listen: ([0, 0, 0, 0], 0).into(), ..config.clone() };
    let config = Config { data: site.folder.path().join("others"), ..others(&site.config) };
    let refused = Service::start_with(config.clone(), prompt()).await.err().unwrap();
    assert!(matches!(refused, StartError::NoKeys(_)), "{refused}");
    // Who says so means it; and asks for keys.
    let said = Service::start_with(Config { auth: true, ..config.clone() }, prompt()).await.unwrap();
    assert!(said.address().ip().is_unspecified());
    drop(said);
    assert!(config.asks_for_keys() && !site.config.asks_for_keys());
}

#[tokio::test(flavor = "multi_thread")]
async fn pages_of_other_origins_are_let_in_only_by_name() {
    let preflight = [("origin", "https://portal.example"), ("access-control-request-method", "DELETE")];
    let origin = |reply: &Reply| reply.headers.get("access-control-allow-origin").cloned();
    let site = Site::start_as(with_keys, prompt()).await;
    let reply = site.ask(Method::OPTIONS, "/v1/jobs/x", &preflight, Body::empty()).await;
    assert_eq!(origin(&reply), None);
    let known = |config| Config { cors_origins: vec!["https://portal.example".into()], ..with_keys(config) };
    let site = Site::start_as(known, prompt()).await;
    let reply = site.ask(Method::OPTIONS, "/v1/jobs/x", &preflight, Body::empty()).await;
    assert_eq!((reply.status, origin(&reply).unwrap()), (StatusCode::OK, "https://portal.example".parse().unwrap()));
    assert!(reply.header("access-control-allow-methods").contains("DELETE"));
    // An error can be read by the page, too.
    let reply = site.ask(Method::GET, "/v1/jobs", &preflight[..1], Body::empty()).await;
    reply.is_problem(401, "access.key_missing");
    assert_eq!(origin(&reply).unwrap(), "https://portal.example");
    let stranger = [("origin", "https://evil.example"), preflight[1]];
    assert_eq!(origin(&site.ask(Method::OPTIONS, "/v1/jobs/x", &stranger, Body::empty()).await), None);
}

#[tokio::test(flavor = "multi_thread")]
async fn without_keys_a_page_from_elsewhere_can_do_nothing() {
    let site = Site::start(prompt()).await;
    for (name, value, code) in [
        ("host", "rebound.example:8080", "access.foreign_host"),
        ("origin", "https://evil.example", "access.foreign_origin"),
    ] {
        let upload = site.ask(Method::POST, "/v1/ray-sets", &[(name, value)], support::rays::zemax(3)).await;
        upload.is_problem(403, code);
        site.ask(Method::GET, "/v1/jobs", &[(name, value)], Body::empty()).await.is_problem(403, code);
    }
    assert!(site.rows(sql("SELECT id FROM ray_sets")).await.is_empty());
    let ours = [("host", "localhost:8080"), ("origin", "http://localhost:8080")];
    assert_eq!(site.ask(Method::GET, "/v1/jobs", &ours, Body::empty()).await.status, StatusCode::OK);
}
