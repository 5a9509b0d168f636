//! What clients were promised, and whether it was kept.

use crate::node::{Node, World, get, until};
use pipeline::known_sources;
use serde_json::{Value, json};
use service::ray_sets::rows;
use service::storage::Storage;
use service::storage::keys::OWNER_KEY;
use service::storage::records::statement::sql;
use sha2::{Digest, Sha256};
use std::collections::{BTreeMap, BTreeSet};
use support::http::{Answer, ask};
use support::receiver::Receiver;

/// Rays of a file: a job of a fraction of a second.
const RAYS: u64 = 2000;

/// Two lobes, and no two seeds the same bytes.
pub fn ray_file(seed: u64) -> Vec<u8> {
    ray_file_of(RAYS, seed)
}

pub fn ray_file_of(rays: u64, seed: u64) -> Vec<u8> {
    let mut bytes = Vec::new();
    known_sources::write_tm25(&known_sources::by_name("two-lobes").unwrap(), rays, seed, &mut bytes).unwrap();
    bytes
}

pub fn sha256(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Everything that was answered with 201 or 202.
#[derive(Default)]
pub struct Ledger {
    /// Ray sets, and the digest of what was sent.
    pub ray_sets: BTreeMap<String, String>,
    pub jobs: BTreeSet<String>,
}

impl Ledger {
    /// Sends a file; its id, when it was taken.
    pub fn upload(&mut self, address: &str, bytes: &[u8]) -> Option<String> {
        let path = "/v1/ray-sets?name=two-lobes.tm25ray";
        let answer = ask(address, "POST", path, &[("Content-Type", "application/octet-stream")], bytes).ok()?;
        assert!(answer.status == 201 || told_to_come_back(&answer), "{answer:?}");
        let id = (answer.status == 201).then(|| answer.json()["ray_sets"][0]["id"].as_str().unwrap().to_owned())?;
        self.ray_sets.insert(id.clone(), sha256(bytes));
        Some(id)
    }

    /// Queues a job; its id, when it was taken.
    pub fn submit(&mut self, address: &str, ray_set: &str) -> Option<String> {
        let body = json!({ "channels": [{ "ray_set": ray_set }] }).to_string();
        let headers = [("Content-Type", "application/json")];
        let answer = ask(address, "POST", "/v1/jobs", &headers, body.as_bytes()).ok()?;
        // 200: it was taken before, and the answer was lost.
        assert!(matches!(answer.status, 200 | 202) || told_to_come_back(&answer), "{answer:?}");
        let id = matches!(answer.status, 200 | 202).then(|| answer.json()["id"].as_str().unwrap().to_owned())?;
        self.jobs.insert(id.clone());
        Some(id)
    }

    /// An upload in pieces has become this ray set.
    pub fn resumed(&mut self, id: &str, bytes: &[u8]) {
        self.ray_sets.insert(id.to_owned(), sha256(bytes));
    }

    /// Asks for a job of its own under a key; its id, when it was answered.
    pub fn submit_under(&mut self, address: &str, ray_set: &str, key: &str) -> Option<String> {
        let body = json!({ "channels": [{ "ray_set": ray_set }], "reuse": false }).to_string();
        let headers = [("Content-Type", "application/json"), ("Idempotency-Key", key)];
        let answer = ask(address, "POST", "/v1/jobs", &headers, body.as_bytes()).ok()?;
        assert!(answer.status == 202 || told_to_come_back(&answer), "{answer:?}");
        let id = (answer.status == 202).then(|| answer.json()["id"].as_str().unwrap().to_owned())?;
        self.jobs.insert(id.clone());
        Some(id)
    }

    /// Sends a file and queues a job, to a node that does not die.
    pub fn job(&mut self, node: &Node, bytes: &[u8]) -> String {
        let ray_set = self.upload(&node.address, bytes).unwrap();
        self.submit(&node.address, &ray_set).unwrap()
    }

    /// Waits until every job has ended, and holds the stores to every promise. `node` collects garbage soon.
    pub fn audit(&self, world: &World, node: &Node) {
        assert!(!self.jobs.is_empty());
        for job in &self.jobs {
            let done = ended(&node.address, job);
            assert_eq!(done["state"], "succeeded", "{done}");
            let zip = node.get(&format!("/v1/jobs/{job}/model.zip")).unwrap();
            let listed = node.get(&format!("/v1/jobs/{job}/artifacts")).unwrap().json();
            assert_eq!((zip.status, json!(sha256(&zip.body))), (200, listed["zip"]["sha256"].clone()), "{listed}");
        }
        let storage = world.storage();
        // One that was begun for a client that never heard of it stays empty until it expires.
        let whole =
            "SELECT id FROM uploads WHERE state = 'finishing' OR state = 'receiving' AND offset_bytes = byte_count";
        let whole = || world.runtime.block_on(storage.records.read(sql(whole))).unwrap();
        until("every whole upload to be finished", || whole().is_empty().then_some(()));
        world.runtime.block_on(self.bytes_are_there(&storage));
        world.runtime.block_on(self.published_once(&storage));
        until("garbage to go", || world.runtime.block_on(differences(&storage)).is_empty().then_some(()));
        world.runtime.block_on(storage.records.close());
    }

    /// Waits until nothing is left to be told, and holds what came to the promise: of every job once, or as the same again.
    pub fn heard(&self, world: &World, receiver: &Receiver) {
        let storage = world.storage();
        let left =
            "SELECT id FROM jobs WHERE announced = 0 UNION ALL SELECT id FROM deliveries WHERE state <> 'delivered'";
        let left = || world.runtime.block_on(storage.records.read(sql(left))).unwrap();
        until("everything to be told", || left().is_empty().then_some(()));
        world.runtime.block_on(storage.records.close());
        let mut ids: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
        for message in receiver.heard() {
            let job = message.json()["data"]["id"].as_str().unwrap().to_owned();
            ids.entry(job).or_default().insert(message.id());
        }
        // And those whose 202 was lost with the process.
        let unheard: Vec<&String> = self.jobs.iter().filter(|job| !ids.contains_key(*job)).collect();
        assert!(unheard.is_empty(), "these ended and were not told: {unheard:?}");
        assert!(ids.values().all(|ids| ids.len() == 1), "what is told again has its id: {ids:?}");
    }

    async fn bytes_are_there(&self, storage: &Storage) {
        for (id, digest) in &self.ray_sets {
            let known = rows::get(&storage.records, "default", id).await.unwrap();
            assert_eq!(known.map(|ray_set| ray_set.sha256).as_ref(), Some(digest), "{id}");
            let mut hasher = Sha256::new();
            for part in rows::parts(&storage.records, id).await.unwrap() {
                hasher.update(storage.blobs.read(&part.blob, 0..part.byte_count).await.unwrap());
            }
            let found: String = hasher.finalize().iter().map(|byte| format!("{byte:02x}")).collect();
            assert_eq!(&found, digest, "{id}");
        }
    }

    /// Every job's files are those of one attempt, and of the last.
    async fn published_once(&self, storage: &Storage) {
        for job in &self.jobs {
            let select = "SELECT jobs.fence, artifacts.blob, artifacts.name FROM jobs \
                          JOIN artifacts ON artifacts.job_id = jobs.id WHERE jobs.id = $1";
            let rows = storage.records.read(sql(select).bind(job.as_str())).await.unwrap();
            let names: BTreeSet<String> = rows.iter().map(|row| row.text("name").unwrap()).collect();
            assert!(names.contains("model.zip") && names.len() == rows.len(), "{names:?}");
            for row in rows {
                let folder = format!("artifacts/{job}/{}/", row.number("fence").unwrap());
                assert!(
                    row.text("blob").unwrap().starts_with(&folder),
                    "{} is not in {folder}",
                    row.text("blob").unwrap()
                );
            }
        }
    }
}

/// Blobs without a row; a row without its blob is a loss, at once.
async fn differences(storage: &Storage) -> Vec<String> {
    let rows = "SELECT blob FROM parts UNION ALL SELECT blob FROM artifacts UNION ALL SELECT blob FROM upload_parts";
    let rows = storage.records.read(sql(rows)).await.unwrap();
    let named: BTreeSet<String> = rows.iter().map(|row| row.text("blob").unwrap()).collect();
    assert_eq!(named.len(), rows.len(), "a blob is named twice");
    let listed = storage.blobs.list("").await.unwrap();
    let stored: BTreeSet<String> = listed.into_iter().map(|blob| blob.key).collect();
    let lost: Vec<&String> = named.difference(&stored).collect();
    assert!(lost.is_empty(), "rows without blobs: {lost:?}");
    stored.difference(&named).filter(|key| !key.starts_with("probes/") && *key != OWNER_KEY).cloned().collect()
}

/// No promise, and no refusal for ever either: a store does not answer, or has no room now.
pub fn told_to_come_back(answer: &Answer) -> bool {
    match answer.status {
        503 => answer.header("retry-after").is_some(),
        507 => matches!(answer.json()["code"].as_str(), Some("storage.full" | "storage.low_space")),
        _ => false,
    }
}

/// Waits for the end of a job.
pub fn ended(address: &str, job: &str) -> Value {
    until("a job's end", || {
        let found = get(address, &format!("/v1/jobs/{job}")).filter(|answer| answer.status == 200)?.json();
        matches!(found["state"].as_str(), Some("succeeded" | "failed" | "cancelled")).then_some(found)
    })
}
