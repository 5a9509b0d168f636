//! Nothing accepted is lost, nothing is published twice, nothing is stuck: the binary, killed at every named point and at random
//! moments, stopped, poisoned, without its database, without room. The engines are chosen as `README.md` says.

#![expect(clippy::unwrap_used, clippy::panic, reason = "what a test stumbles over is its finding")]

/// What clients were promised.
mod ledger;
/// The stores and the processes.
mod node;
/// A client that goes on where it was.
mod resume;
/// A disk that can be made full.
mod disk;
/// Faults at random moments, and the full disk.
mod faults;

use ledger::{Ledger, ended, ray_file, ray_file_of};
use node::{LEASE_S, Node, World, get, until};
use resume::{Joined, Resumed};
use service::crash;
use service::storage::records::statement::sql;
use std::process::Command;
use std::sync::RwLock;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::sleep;
use std::time::{Duration, Instant};
use support::{engines, http};

/// The database of all tests: whoever takes it away does so alone.
static DATABASE: RwLock<()> = RwLock::new(());
const SIGABRT: i32 = 6;
/// Kills of a soak are the tests' doing, not the job's; garbage is what nobody touched for two seconds.
const HARDY: [&str; 4] = ["--attempts", "1000", "--outbound-allow", "127.0.0.1"];
const TIDY: [&str; 6] = ["--attempts", "1000", "--outbound-allow", "127.0.0.1", "--garbage-age", "2"];

/// A number from the environment: how long a soak is chosen by whoever starts it.
fn chosen(name: &str, default: u64) -> u64 {
    std::env::var(name).map_or(default, |text| text.parse().unwrap_or_else(|_| panic!("{name}={text} is no number")))
}

/// A process that dies at a point, and after it one that does not.
struct Followed<'a> {
    world: &'a World,
    node: Node,
    deaths: u32,
}

impl Followed<'_> {
    fn address(&mut self) -> &str {
        if let Some(signal) = self.node.died() {
            assert_eq!(signal, SIGABRT, "{}", self.node.log());
            self.deaths += 1;
            self.node = self.world.node(&HARDY);
        }
        &self.node.address
    }

    /// Sends a file in pieces, as long as it takes; the ray set it becomes.
    fn resume(&mut self, ledger: &mut Ledger, bytes: Vec<u8>, size: usize) -> String {
        let mut upload = Resumed::new(bytes, size);
        let id = self.insist("an upload in pieces", |address| upload.step(address));
        ledger.resumed(&id, upload.bytes());
        id
    }

    /// Sends a file as partial uploads; the ray set it becomes.
    fn join(&mut self, ledger: &mut Ledger, bytes: &[u8]) -> String {
        let mut upload = Joined::new(bytes, 3);
        let id = self.insist("an upload of partial ones", |address| upload.step(address));
        ledger.resumed(&id, bytes);
        id
    }

    /// What a client does until it is told that it succeeded.
    fn insist<T>(&mut self, what: &str, mut ask: impl FnMut(&str) -> Option<T>) -> T {
        until(what, || ask(self.address()))
    }
}

#[test]
fn a_death_at_any_point_loses_nothing_and_publishes_once() {
    let _database = DATABASE.read().unwrap();
    let (world, mut ledger) = (World::new(), Ledger::default());
    let receiver = world.receiver();
    for (seed, point) in crash::POINTS.iter().enumerate() {
        let (start, bytes) = (Instant::now(), ray_file(seed as u64));
        let mut followed = Followed { world: &world, node: world.armed(&HARDY, Some(point)), deaths: 0 };
        // Some points are passed only by uploads in pieces.
        let ray_set = if point.starts_with("append.") || point.starts_with("take.") {
            followed.resume(&mut ledger, bytes, 20_000)
        } else if point.starts_with("join.") {
            followed.join(&mut ledger, &bytes)
        } else {
            followed.insist("an upload", |address| ledger.upload(address, &bytes))
        };
        let job = followed.insist("a job", |address| ledger.submit(address, &ray_set));
        until(point, || (!followed.address().is_empty() && followed.deaths == 1).then_some(()));
        assert_eq!(ended(followed.address(), &job)["state"], "succeeded");
        println!("{point}: {:?}", start.elapsed());
    }
    let node = world.node(&TIDY);
    ledger.audit(&world, &node);
    ledger.heard(&world, &receiver);
}

#[test]
fn a_death_at_any_point_of_an_upload_in_pieces_loses_no_byte() {
    let _database = DATABASE.read().unwrap();
    let (world, mut ledger) = (World::new(), Ledger::default());
    // Pieces of two parts and a half: parts that stay, and short ones that are continued.
    for (seed, point) in [
        "upload.part_stored",
        "upload.part_stored:3",
        "append.committed",
        "append.committed:2",
        "append.committed:4",
        "take.before_commit",
        "take.committed",
    ]
    .into_iter()
    .enumerate()
    {
        let bytes = ray_file_of(20 * (1 << 20) / 28, seed as u64);
        let mut followed = Followed { world: &world, node: world.armed(&HARDY, Some(point)), deaths: 0 };
        followed.resume(&mut ledger, bytes, 17_300_000);
        assert_eq!((followed.address().is_empty(), followed.deaths), (false, 1), "{point}");
    }
    let node = world.node(&TIDY);
    ledger.job(&node, &ray_file(99));
    ledger.audit(&world, &node);
}

#[test]
fn a_request_under_a_key_makes_one_job_though_its_answer_was_lost() {
    let _database = DATABASE.read().unwrap();
    let (world, mut ledger) = (World::new(), Ledger::default());
    let ray_set = ledger.upload(&world.node(&HARDY).address, &ray_file(1)).unwrap();
    for point in ["submit.before_commit", "submit.committed"] {
        let mut followed = Followed { world: &world, node: world.armed(&HARDY, Some(point)), deaths: 0 };
        let job = followed.insist("a job", |address| ledger.submit_under(address, &ray_set, point));
        assert_eq!(followed.deaths, 1, "{point}");
        let again = followed.insist("the same answer", |address| ledger.submit_under(address, &ray_set, point));
        assert_eq!(again, job, "{point}");
    }
    let storage = world.storage();
    let rows = world.runtime.block_on(storage.records.read(sql("SELECT id FROM jobs"))).unwrap();
    assert_eq!((rows.len(), ledger.jobs.len()), (2, 2), "a key made two jobs, or none");
    world.runtime.block_on(storage.records.close());
    ledger.audit(&world, &world.node(&TIDY));
}

#[test]
fn a_process_stopped_past_its_lease_publishes_nothing_twice() {
    let _database = DATABASE.read().unwrap();
    let (world, mut ledger) = (World::new(), Ledger::default());
    let zombie = world.node(&TIDY);
    // Long enough to be caught in its middle; caught too late, the next is tried.
    let caught = until("a job caught while it runs", || {
        let job = ledger.job(&zombie, &ray_file_of(200_000, ledger.jobs.len() as u64));
        let state = |job: &str| zombie.get(&format!("/v1/jobs/{job}")).unwrap().json()["state"].clone();
        until("its begin", || (state(&job) != "queued").then_some(()));
        zombie.signal("STOP");
        let storage = world.storage();
        let select = sql("SELECT state FROM jobs WHERE id = $1").bind(job.as_str());
        let row = world.runtime.block_on(storage.records.read_one(select)).unwrap().unwrap();
        if row.text("state").unwrap() == "running" {
            return Some(job);
        }
        zombie.signal("CONT");
        None
    });
    // What this waits for is that time passes: a lease, twice.
    sleep(Duration::from_secs(2 * LEASE_S));
    if engines::are_shared() {
        let heir = world.node(&TIDY);
        let done = ended(&heir.address, &caught);
        assert_eq!((&done["state"], &done["attempt"]), (&"succeeded".into(), &2.into()), "{done}");
        zombie.signal("CONT");
        until("the zombie to see it", || zombie.log().contains("ending=\"lost\"").then_some(()));
    } else {
        zombie.signal("CONT");
        assert_eq!(ended(&zombie.address, &caught)["attempt"], 1, "nobody else was there to take it");
    }
    ledger.audit(&world, &zombie);
}

#[test]
fn a_job_that_kills_its_process_stops_after_its_attempts() {
    let _database = DATABASE.read().unwrap();
    let (world, mut ledger) = (World::new(), Ledger::default());
    let node = world.node(&["--role", "api"]);
    let poison = ledger.job(&node, &ray_file(1));
    node.kill();
    for _ in 0..3 {
        assert_eq!(world.armed(&["--attempts", "3"], Some("stage.flux")).death(), SIGABRT);
    }
    let node = world.node(&TIDY);
    let failed = ended(&node.address, &poison);
    assert_eq!((&failed["state"], &failed["attempt"]), (&"failed".into(), &3.into()), "{failed}");
    assert_eq!(failed["problem"]["code"], "job.worker_lost", "{failed}");
    // The queue is not blocked by it.
    ledger.jobs.remove(&poison);
    ledger.job(&node, &ray_file(2));
    ledger.audit(&world, &node);
}

#[test]
fn two_nodes_share_a_hundred_jobs() {
    if !engines::are_shared() {
        return;
    }
    let _database = DATABASE.read().unwrap();
    let (world, mut ledger) = (World::new(), Ledger::default());
    let api = world.node(&["--role", "api", "--garbage-age", "2"]);
    for seed in 0..100 {
        ledger.job(&api, &ray_file(seed));
    }
    let start = Instant::now();
    let workers = [(); 2].map(|()| world.node(&["--role", "worker", "--log", "info"]));
    assert_eq!(workers[0].get("/v1/jobs").unwrap().status, 404, "a worker answers only whether it is well");
    for job in &ledger.jobs {
        let done = ended(&api.address, job);
        assert_eq!((&done["state"], &done["attempt"]), (&"succeeded".into(), &1.into()), "{done}");
    }
    let shares = workers.each_ref().map(|worker| worker.log().matches("job started").count());
    println!("100 jobs in {:?}, shared as {shares:?}", start.elapsed());
    assert_eq!(shares.iter().sum::<usize>(), 100, "a job was begun twice");
    assert!(shares.iter().all(|share| *share >= 20), "{shares:?}");
    ledger.audit(&world, &api);
}

/// `tests/engines/postgres` with one word.
fn postgres(word: &str) {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/engines/postgres");
    assert!(Command::new(script).arg(word).status().unwrap().success(), "{word}");
}

#[test]
fn a_database_that_is_away_for_a_while_loses_nothing() {
    if !engines::are_shared() {
        return;
    }
    let _database = DATABASE.write().unwrap();
    let (world, mut ledger) = (World::new(), Ledger::default());
    let nodes = [(); 2].map(|()| world.node(&TIDY));
    for seed in 0..20 {
        ledger.job(&nodes[0], &ray_file(seed));
    }
    let asked = AtomicU64::new(0);
    postgres("stop");
    let away = Instant::now();
    while away.elapsed() < Duration::from_secs(chosen("CRASH_OUTAGE_S", 40)) {
        for node in &nodes {
            assert_eq!(node.get("/healthz").map(|answer| answer.status), Some(200), "the process lives");
            assert_eq!(node.get("/readyz").map(|answer| answer.status), Some(503), "and says that it cannot work");
            assert_eq!(ledger.upload(&node.address, &ray_file(99)), None);
            asked.fetch_add(1, Ordering::Relaxed);
        }
    }
    postgres("start");
    let back = Instant::now();
    for node in &nodes {
        until("a node to be ready", || (get(&node.address, "/readyz")?.status == 200).then_some(()));
    }
    println!("away for {:?}, asked {asked:?} times; ready {:?} after its return", away.elapsed(), back.elapsed());
    ledger.job(&nodes[1], &ray_file(100));
    ledger.audit(&world, &nodes[0]);
}

#[test]
fn a_store_without_room_says_so_and_keeps_what_it_has() {
    if engines::are_shared() {
        return;
    }
    let (world, mut ledger) = (World::new(), Ledger::default());
    // A file of this process may have 2.25 MiB: no privilege is needed for that, and a part of 2.5 MiB has no room.
    let mut shell = Command::new("sh");
    shell.args(["-c", "trap '' XFSZ; ulimit -f $((9 * 512)); exec \"$0\" \"$@\"", env!("CARGO_BIN_EXE_lampwright")]);
    let node = world.spawn(&mut shell, &TIDY, None);
    let job = ledger.job(&node, &ray_file(1));
    let large = ray_file_of(7 * (1 << 20) / 28, 2);
    let path = "/v1/ray-sets?name=large.tm25ray";
    let headers = [("Content-Type", "application/octet-stream")];
    let refused = http::ask(&node.address, "POST", path, &headers, &large).unwrap();
    assert_eq!((refused.status, &refused.json()["code"]), (507, &"storage.full".into()), "{refused:?}");
    assert_eq!(ended(&node.address, &job)["state"], "succeeded");
    ledger.job(&node, &ray_file(3));
    // Less is always possible: a job that waits or runs is cancelled, and what it gave, and its rays, are deleted.
    let unwanted = ledger.upload(&node.address, &ray_file_of(80_000, 4)).unwrap();
    let long = ledger.submit(&node.address, &unwanted).unwrap();
    let asked = |method: &str, path: &str| http::ask(&node.address, method, path, &[], b"").unwrap().status;
    assert_eq!(asked("POST", &format!("/v1/jobs/{long}/cancel")), 202);
    assert_eq!(ended(&node.address, &long)["state"], "cancelled");
    for path in [format!("/v1/jobs/{long}"), format!("/v1/ray-sets/{unwanted}"), format!("/v1/jobs/{job}")] {
        assert_eq!(asked("DELETE", &path), 204, "{path}");
    }
    ledger.jobs.retain(|id| *id != long && *id != job);
    ledger.ray_sets.remove(&unwanted);
    ledger.audit(&world, &node);
}
