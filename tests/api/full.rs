//! A database without room: what is refused changes nothing, what is answered stays, nothing is stuck when there is room again.
//! `tests/crash` does the same with a disk that is really full.

use crate::ingest::{files, near};
use crate::resume::{OCTETS, VERSION, append, begin};
use axum::http::{Method, StatusCode};
use pipeline::MODEL_FILES;
use serde_json::{Value, json};
use service::http::openapi;
use service::storage::records::Records;
use service::storage::records::statement::{Statement, sql};
use service::{Config, Role};
use std::time::{Duration, Instant};
use support::engines;
use support::engines::are_shared;
use support::rays::zemax;
use support::runners::{Gate, held, prompt, sha256};
use support::site::{Reply, Site};

/// Operations that make room; they are let in however little there is.
const RELIEF: [&str; 6] =
    ["cancel_job", "delete_job", "delete_ray_set", "delete_spectrum", "delete_upload", "delete_webhook"];
/// What clients can see of the database, without what changes by itself.
const SEEN: &str = "SELECT 'ray set ' || id AS line FROM ray_sets UNION ALL SELECT 'part ' || blob FROM parts \
    UNION ALL SELECT 'spectrum ' || id FROM spectra \
    UNION ALL SELECT 'upload ' || id || ' ' || CAST(offset_bytes AS TEXT) FROM uploads \
    UNION ALL SELECT 'job ' || id || ' ' || state FROM jobs \
    UNION ALL SELECT 'webhook ' || id || ' ' || description || ' ' || secret FROM webhooks \
    UNION ALL SELECT 'ping ' || id FROM deliveries WHERE event = 'ping' \
    UNION ALL SELECT 'key ' || key FROM idempotency_keys ORDER BY line";

/// The service's database, which triggers make full: from then on every change of a row fails. SQLite rolls the transaction back by
/// itself, as it does when a disk is full; PostgreSQL fails the statement with `disk_full`.
struct Database {
    url: String,
    /// Connections that the service does not have.
    records: Records,
}

impl Database {
    async fn of(site: &Site) -> Database {
        let url = site.config.database_url();
        let records = Records::open(&url).await.unwrap();
        let tables = match are_shared() {
            true => sql("SELECT CAST(table_name AS TEXT) AS name FROM information_schema.tables \
                         WHERE table_schema = current_schema()"),
            false => sql("SELECT name FROM sqlite_master WHERE type = 'table' AND name NOT LIKE 'sqlite%'"),
        };
        let mut text = match are_shared() {
            true => "CREATE SEQUENCE test_changes; CREATE TABLE test_room (most BIGINT); \
                     INSERT INTO test_room VALUES (9223372036854775807); \
                     CREATE FUNCTION test_change() RETURNS trigger LANGUAGE plpgsql AS $$ BEGIN \
                     IF nextval('test_changes') > (SELECT most FROM test_room) THEN \
                     RAISE EXCEPTION 'no room' USING ERRCODE = 'disk_full'; END IF; \
                     IF TG_OP = 'DELETE' THEN RETURN OLD; END IF; RETURN NEW; END $$;"
                .to_owned(),
            false => {
                "CREATE TABLE test_room (most BIGINT); INSERT INTO test_room VALUES (9223372036854775807);".to_owned()
            }
        };
        for row in records.read(tables).await.unwrap() {
            let table = row.text("name").unwrap();
            for change in ["INSERT", "UPDATE", "DELETE"].into_iter().filter(|_| !table.starts_with('_')) {
                text += &format!("CREATE TRIGGER test_{table}_{change} BEFORE {change} ON {table} ");
                text += match are_shared() {
                    true => "FOR EACH ROW EXECUTE FUNCTION test_change();",
                    false => {
                        "BEGIN UPDATE test_room SET most = most - 1; \
                              SELECT RAISE(ROLLBACK, 'no room') FROM test_room WHERE most < 0; END;"
                    }
                };
            }
        }
        engines::execute(&url, text).await;
        Database { url, records }
    }

    /// Leaves room for so many changes of rows, and no more.
    async fn fill_after(&self, changes: i64) {
        let text = match are_shared() {
            true => format!("SELECT setval('test_changes', 1); UPDATE test_room SET most = {}", changes + 1),
            false => format!("UPDATE test_room SET most = {changes}"),
        };
        engines::execute(&self.url, text).await;
    }

    async fn make_room(&self) {
        self.fill_after(i64::MAX - 1).await;
    }

    async fn lines(&self, statement: Statement) -> Vec<String> {
        let rows = self.records.read(statement).await.unwrap();
        rows.iter().map(|row| row.text("line").unwrap()).collect()
    }

    async fn seen(&self) -> Vec<String> {
        self.lines(sql(SEEN)).await
    }
}

/// How this engine's lack of room is told.
fn is_refused(reply: &Reply) {
    match are_shared() {
        true => reply.is_problem(507, "storage.full"),
        // The code of a trigger is not that of a full disk, for which see `storage/records`.
        false => reply.is_problem(503, "storage.unavailable"),
    }
}

/// Questions that are too long for an address: nothing is kept of them.
const ASKING: [&str; 2] = ["combine_models", "evaluate_model"];

/// Every operation of the contract that may change something.
fn writing() -> Vec<String> {
    let contract: Value = serde_json::from_str(&openapi()).unwrap();
    let mut writing = Vec::new();
    for methods in contract["paths"].as_object().unwrap().values() {
        for (method, operation) in methods.as_object().unwrap() {
            let id = operation["operationId"].as_str().unwrap();
            if ["post", "put", "patch", "delete"].contains(&method.as_str()) && !ASKING.contains(&id) {
                writing.push(id.to_owned());
            }
        }
    }
    writing
}

/// A request, ready to be sent as often as wanted.
struct Asked {
    method: Method,
    path: String,
    headers: Vec<(&'static str, String)>,
    body: Vec<u8>,
}

impl Asked {
    fn new(method: Method, path: impl Into<String>) -> Asked {
        Asked { method, path: path.into(), headers: Vec::new(), body: Vec::new() }
    }

    fn json(method: Method, path: impl Into<String>, body: &Value) -> Asked {
        Asked::new(method, path).with("content-type", "application/json").body(body.to_string())
    }

    fn with(mut self, name: &'static str, value: &str) -> Asked {
        self.headers.push((name, value.to_owned()));
        self
    }

    fn body(self, body: impl Into<Vec<u8>>) -> Asked {
        Asked { body: body.into(), ..self }
    }

    async fn of(&self, site: &Site) -> Reply {
        let headers: Vec<(&str, &str)> = self.headers.iter().map(|(name, value)| (*name, value.as_str())).collect();
        site.ask(self.method.clone(), &self.path, &headers, self.body.clone()).await
    }
}

/// A job of its own for a ray set.
fn job_of(ray_set: &str) -> Asked {
    Asked::json(Method::POST, "/v1/jobs", &json!({ "channels": [{ "ray_set": ray_set }], "reuse": false }))
}

fn spectrum() -> Asked {
    Asked::new(Method::POST, "/v1/spectra?name=led.txt").body("400 1\n500 2\n")
}

/// What exists before an operation is asked for.
struct Things {
    /// Where `led.dat` is to be fetched from.
    port: u16,
    ray_set: String,
    webhook: String,
}

impl Things {
    async fn new(site: &Site) -> Things {
        let webhook = site.post("/v1/webhooks", &json!({ "url": "https://receiver.invalid/" })).await;
        Things { port: files().await, ray_set: site.ray_set().await, webhook: format!("/v1/webhooks/{}", webhook.id()) }
    }

    /// The request of an operation, with what it needs. A new route needs a line here.
    async fn asked(&self, site: &Site, operation: &str) -> Asked {
        let Things { port, ray_set, webhook } = self;
        let (post, delete) = (Method::POST, Method::DELETE);
        let job = async || format!("/v1/jobs/{}", site.job(ray_set).await);
        match operation {
            "upload_ray_set" => Asked::new(post, "/v1/ray-sets?name=led.dat").body(zemax(10)),
            "ingest_ray_set" => {
                let url = format!("http://localhost:{port}/files/led%201.dat");
                Asked::json(post, "/v1/ray-sets/ingest", &json!({ "url": url }))
            }
            "delete_ray_set" => Asked::new(delete, format!("/v1/ray-sets/{}", site.ray_set().await)),
            "create_upload" => Asked::new(post, "/v1/uploads").with(VERSION.0, VERSION.1).with("upload-length", "9000"),
            "append_to_upload" => {
                let file = zemax(1000);
                let asked = Asked::new(Method::PATCH, begin(site, file.len(), &[]).await).body(&file[..5000]);
                asked.with(VERSION.0, VERSION.1).with(OCTETS.0, OCTETS.1).with("upload-offset", "0")
            }
            "delete_upload" => Asked::new(delete, begin(site, 1000, &[]).await).with(VERSION.0, VERSION.1),
            "upload_spectrum" => spectrum(),
            "delete_spectrum" => Asked::new(delete, format!("/v1/spectra/{}", spectrum().of(site).await.id())),
            "create_job" => job_of(ray_set),
            "queue_evaluation" => {
                let job = site.job(ray_set).await;
                // As after a computation, which there is none of here.
                site.write(sql("UPDATE jobs SET state = 'succeeded' WHERE id = $1").bind(job.as_str())).await;
                for (position, name) in MODEL_FILES.into_iter().enumerate() {
                    let insert = "INSERT INTO artifacts (job_id, position, name, media_type, byte_count, sha256, blob) \
                                  VALUES ($1, $2, $3, 'application/octet-stream', 10, $3, $3)";
                    site.write(sql(insert).bind(job.as_str()).bind(position as i64).bind(name)).await;
                }
                let evaluation = json!({ "view": {"angles": [[0, 0]]} });
                Asked::json(post, "/v1/evaluations", &json!({ "job": job, "evaluation": evaluation, "reuse": false }))
            }
            "cancel_job" => Asked::new(post, format!("{}/cancel", job().await)),
            "delete_job" => {
                let job = job().await;
                site.post(&format!("{job}/cancel"), &json!({})).await;
                Asked::new(delete, job)
            }
            "create_webhook" => Asked::json(post, "/v1/webhooks", &json!({ "url": "https://other.invalid/" })),
            "change_webhook" => {
                // No two are the same.
                let description = site.ray_set().await;
                Asked::json(Method::PATCH, webhook, &json!({ "description": description }))
            }
            "rotate_webhook_secret" => Asked::new(post, format!("{webhook}/secret")),
            "delete_webhook" => {
                let other = site.post("/v1/webhooks", &json!({ "url": "https://gone.invalid/" })).await;
                Asked::new(delete, format!("/v1/webhooks/{}", other.id()))
            }
            "ping_webhook" => Asked::new(post, format!("{}/ping", self.fresh_webhook(site).await)),
            "redeliver" => {
                let webhook = self.fresh_webhook(site).await;
                let ping = site.post(&format!("{webhook}/ping"), &json!({})).await;
                assert_eq!(ping.status, StatusCode::ACCEPTED, "{ping:?}");
                Asked::new(post, format!("{webhook}/deliveries/{}/redeliver", ping.id()))
            }
            other => panic!("{other} is a route that writes, and this test does not know how to ask for it"),
        }
    }

    /// One that waits for no ping; another goes, for there may be only so many.
    async fn fresh_webhook(&self, site: &Site) -> String {
        for old in site.get("/v1/webhooks?limit=100").await.json()["webhooks"].as_array().unwrap() {
            if old["url"] == "https://pinged.invalid/" {
                site.delete(old["links"]["self"].as_str().unwrap()).await;
            }
        }
        let made = site.post("/v1/webhooks", &json!({ "url": "https://pinged.invalid/" })).await;
        format!("/v1/webhooks/{}", made.id())
    }
}

/// A service that answers and computes nothing, so that jobs stay where they are.
fn answering(config: Config) -> Config {
    near(Config { role: Role::Api, poll: Duration::from_secs(60), ..config })
}

#[tokio::test(flavor = "multi_thread")]
async fn every_route_that_writes_keeps_its_word_when_the_database_is_full() {
    let mut site = Site::start_as(answering, prompt()).await;
    let (things, database) = (Things::new(&site).await, Database::of(&site).await);
    let keyed = |reuse: bool| {
        let body = json!({ "channels": [{ "ray_set": things.ray_set }], "reuse": reuse });
        Asked::json(Method::POST, "/v1/jobs", &body).with("idempotency-key", "the same")
    };
    assert_eq!(keyed(true).of(&site).await.status, StatusCode::ACCEPTED);
    for operation in writing() {
        for room in 0..3 {
            let asked = things.asked(&site, &operation).await;
            let before = database.seen().await;
            database.fill_after(room).await;
            let reply = asked.of(&site).await;
            database.fill_after(0).await;
            let after = database.seen().await;
            let case = format!("{operation} with room for {room}: {reply:?}");
            if reply.status.is_success() {
                assert!(room > 0, "{case}");
                assert!(after != before || operation == "redeliver", "answered and not there: {case}");
            } else {
                is_refused(&reply);
                assert_eq!(after, before, "refused and there: {case}");
            }
            // What comes while it is full, however often.
            for _ in 0..2 {
                is_refused(&job_of(&things.ray_set).of(&site).await);
            }
            let ready = site.get("/readyz").await;
            assert_eq!(ready.status, StatusCode::SERVICE_UNAVAILABLE, "{case}: {ready:?}");
            database.make_room().await;
            assert_eq!(database.seen().await, after, "{case}");
            // A refusal that is planned, and what comes after it.
            keyed(false).of(&site).await.is_problem(422, "idempotency.key_reused");
            assert_eq!(site.get("/readyz").await.status, StatusCode::OK, "{case}");
            let job = site.job(&things.ray_set).await;
            let told = site.get(&format!("/v1/jobs/{job}")).await;
            assert_eq!(told.status, StatusCode::OK, "after {case}");
            site.post(&format!("/v1/jobs/{job}/cancel"), &json!({})).await;
        }
    }
    let kept = database.seen().await;
    site.kill().await;
    site.restart(prompt()).await;
    assert_eq!(database.seen().await, kept, "a restart loses nothing");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_job_that_runs_while_the_database_is_full_goes_on_when_there_is_room() {
    let gate = Gate::new();
    let site = Site::start(held(&gate)).await;
    let ray_set = site.ray_set().await;
    let (running, waiting) = (site.job(&ray_set).await, site.job(&ray_set).await);
    site.until(&running, |job| job["stage"] == "flux").await;
    let database = Database::of(&site).await;
    for room in [0, 1, 2] {
        database.fill_after(room).await;
        // What this waits for is that time passes: several beats, which fail.
        tokio::time::sleep(site.config.lease).await;
        assert_eq!(site.get(&format!("/v1/jobs/{running}")).await.json()["state"], "running");
    }
    gate.open();
    tokio::time::sleep(site.config.lease).await;
    assert_eq!(site.get("/readyz").await.status, StatusCode::SERVICE_UNAVAILABLE);
    database.make_room().await;
    assert_eq!(site.until_state(&running, "succeeded").await["attempt"], 1);
    assert_eq!(site.until_state(&waiting, "succeeded").await["attempt"], 1);
    for job in [&running, &waiting] {
        assert_eq!(site.get(&format!("/v1/jobs/{job}/model.zip")).await.status, StatusCode::OK);
    }
    assert_eq!(site.get("/readyz").await.status, StatusCode::OK);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_job_whose_end_finds_no_room_ends_when_there_is_some() {
    let site = Site::start(prompt()).await;
    let ray_set = site.ray_set().await;
    let database = Database::of(&site).await;
    // A claim changes 2 rows, an end 5, beats and announcements some more: each of them is the first to fail once.
    for room in 0..10 {
        let job = site.job(&ray_set).await;
        database.fill_after(room).await;
        tokio::time::sleep(2 * site.config.poll).await;
        database.make_room().await;
        let done = site.until_state(&job, "succeeded").await;
        assert_eq!(done["problem"], Value::Null);
        assert_eq!(site.get(&format!("/v1/jobs/{job}/model.zip")).await.status, StatusCode::OK, "{room}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn an_upload_in_pieces_ends_though_the_database_was_full() {
    let site = Site::start(prompt()).await;
    let (file, database) = (zemax(1000), Database::of(&site).await);
    for room in 0..8 {
        let at = begin(&site, file.len(), &[]).await;
        database.fill_after(room).await;
        let later = async {
            tokio::time::sleep(site.config.poll).await;
            database.make_room().await;
        };
        let (reply, ()) = tokio::join!(append(&site, &at, 0, file.clone(), &[]), later);
        if reply.status != StatusCode::NO_CONTENT {
            is_refused(&reply);
            let again = append(&site, &at, 0, file.clone(), &[]).await;
            assert_eq!(again.status, StatusCode::NO_CONTENT, "{again:?}");
        }
        let start = Instant::now();
        let upload = loop {
            let upload = site.get(&at).await.json();
            if upload["state"] == "taken" {
                break upload;
            }
            assert!(upload["state"] == "finishing" && start.elapsed() < Duration::from_secs(20), "{upload}");
            tokio::time::sleep(Duration::from_millis(20)).await;
        };
        let ray_set = site.get(upload["links"]["ray_sets"][0].as_str().unwrap()).await.json();
        assert_eq!(ray_set["sha256"], sha256(&file), "{room}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn with_little_room_every_route_that_writes_says_so_unless_it_makes_room() {
    let mut site = Site::start_as(answering, prompt()).await;
    if site.config.local_folders().is_empty() {
        println!("LEFT OUT: no local disk");
        return;
    }
    let things = Things::new(&site).await;
    let mut asked = Vec::new();
    for operation in writing() {
        asked.push((things.asked(&site, &operation).await, operation));
    }
    site.kill().await;
    site.config.keep_free = u64::MAX;
    site.restart(prompt()).await;
    let ready = site.get("/readyz").await;
    ready.is_problem(503, "storage.low_space");
    for (asked, operation) in asked {
        let reply = asked.of(&site).await;
        match RELIEF.contains(&operation.as_str()) {
            true => assert!(reply.status.is_success(), "{operation}: {reply:?}"),
            false => assert_eq!(reply.problem(), (507, "storage.low_space".to_owned()), "{operation}"),
        }
    }
}
