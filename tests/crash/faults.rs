//! Faults at random moments, while clients work: kills, stops, a full disk, I/O errors, cut connections, an outage.

use crate::disk::Disk;
use crate::ledger::{Ledger, ended, ray_file, ray_file_of};
use crate::node::{LEASE_S, Node, World, until};
use crate::resume::Resumed;
use crate::{DATABASE, HARDY, TIDY, chosen, postgres};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use serde_json::json;
use std::collections::BTreeMap;
use std::io::Write;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::{scope, sleep};
use std::time::{Duration, Instant, SystemTime};
use support::engines;
use support::http::{Answer, ask};

/// Bytes of a disk, and what each fault may add to it.
const DISK: u64 = 256 << 20;
const DISK_PER_FAULT: u64 = 8 << 20;
/// Bytes that a file may have while the system refuses to write: SQLite and the store meet an error of input and output.
const LITTLE: &str = "--fsize=4096:";

/// Files that a robot sends for each fault that has begun: enough to work through it, and no more while a fault waits for the other
/// tests, for whatever was taken is audited in the end.
const FILES_PER_FAULT: u64 = 12;

/// What happens to the service.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Fault {
    /// SIGKILL, and another process.
    Kill,
    /// SIGSTOP, up to longer than a lease, and SIGCONT.
    Stop,
    /// No byte of the disk is free, for rows and blobs, for a while.
    Full,
    /// SIGKILL while it is full.
    KillWhenFull,
    /// What is written fails with an error of input and output, for a while.
    Errors,
    /// Every connection to the database is cut.
    Cut,
    /// The database is away for a while.
    Outage,
}

impl Fault {
    /// Those that can happen here, each as often as it is to come up in a deck.
    fn deck(has_disk: bool) -> Vec<Fault> {
        use Fault::{Cut, Errors, Full, Kill, KillWhenFull, Outage, Stop};
        match (engines::are_shared(), has_disk) {
            (true, _) => vec![Kill, Kill, Kill, Stop, Cut, Cut, Outage],
            (false, true) => vec![Kill, Kill, Stop, Full, Full, KillWhenFull, Errors],
            (false, false) => vec![Kill, Kill, Stop, Errors],
        }
    }
}

/// Said past the test harness, which keeps what tests print to itself: a seed must be seen whatever came of it.
fn say(text: &str) {
    let _ = writeln!(std::io::stderr(), "{text}");
}

/// A number below `most`.
fn below(random: &mut ChaCha8Rng, most: u64) -> u64 {
    random.next_u64() % most
}

/// The faults of a run in the order of their coming: each kind comes up in every deck, so that a short run has all of them.
fn dealt(random: &mut ChaCha8Rng, has_disk: bool, count: u64) -> Vec<Fault> {
    let mut dealt = Vec::new();
    while (dealt.len() as u64) < count {
        let mut deck = Fault::deck(has_disk);
        while !deck.is_empty() {
            let at = below(random, deck.len() as u64) as usize;
            dealt.push(deck.swap_remove(at));
        }
    }
    dealt.truncate(count as usize);
    dealt
}

/// What a lab's robot does until it is told to stop: sends a file, every other one in pieces, queues a job, and so on, to
/// whichever node answers.
fn robot(addresses: &Mutex<Vec<String>>, number: u64, begun: &AtomicU64, stop: &AtomicBool) -> Ledger {
    let mut ledger = Ledger::default();
    let address = |turn: u64| {
        let addresses = addresses.lock().unwrap();
        addresses[turn as usize % addresses.len()].clone()
    };
    for round in 0.. {
        while round >= FILES_PER_FAULT * (1 + begun.load(Ordering::Relaxed)) && !stop.load(Ordering::Relaxed) {
            sleep(Duration::from_millis(10));
        }
        if stop.load(Ordering::Relaxed) {
            break;
        }
        let bytes = ray_file(number * 1_000_000 + round);
        let sent = match round % 2 {
            0 => ledger.upload(&address(round), &bytes),
            _ => {
                let size = 1 + (7919 * (round + number)) as usize % bytes.len();
                let (mut upload, mut turn) = (Resumed::new(bytes, size), round);
                let id = until("an upload in pieces", || {
                    turn += 1;
                    upload.step(&address(turn))
                });
                ledger.resumed(&id, upload.bytes());
                Some(id)
            }
        };
        sent.and_then(|ray_set| ledger.submit(&address(round), &ray_set));
        sleep(Duration::from_millis(50));
    }
    ledger
}

/// Processes under robots, and what happens to them.
struct Soak<'a> {
    world: &'a World,
    nodes: Vec<Node>,
    addresses: &'a Mutex<Vec<String>>,
    /// How many faults have begun.
    begun: &'a AtomicU64,
    random: ChaCha8Rng,
}

impl<'a> Soak<'a> {
    fn new(world: &'a World, addresses: &'a Mutex<Vec<String>>, begun: &'a AtomicU64, random: ChaCha8Rng) -> Soak<'a> {
        // A data folder has one process; servers have as many as there are.
        let count = if engines::are_shared() { 2 } else { 1 };
        let nodes = (0..count).map(|_| world.shielded(&HARDY)).collect();
        let soak = Soak { world, nodes, addresses, begun, random };
        soak.tell();
        soak
    }

    /// Tells the robots where the nodes are.
    fn tell(&self) {
        *self.addresses.lock().unwrap() = self.nodes.iter().map(|node| node.address.clone()).collect();
    }

    fn disk(&self) -> &'a Disk {
        self.world.disk.as_ref().unwrap()
    }

    fn meet(&mut self, fault: Fault) {
        if fault == Fault::Outage {
            return self.outage();
        }
        let _database = DATABASE.read().unwrap();
        self.begun.fetch_add(1, Ordering::Relaxed);
        let victim = below(&mut self.random, self.nodes.len() as u64) as usize;
        let awhile = Duration::from_millis(200 + below(&mut self.random, 1300));
        match fault {
            Fault::Kill => self.replace(victim, || ()),
            Fault::Stop => {
                self.nodes[victim].signal("STOP");
                sleep(Duration::from_millis(below(&mut self.random, 1500 * LEASE_S)));
                self.nodes[victim].signal("CONT");
            }
            Fault::Full => {
                self.disk().fill();
                sleep(awhile);
                self.disk().make_room();
            }
            Fault::KillWhenFull => {
                let disk = self.disk();
                disk.fill();
                sleep(awhile);
                self.replace(victim, || disk.make_room());
            }
            Fault::Errors => {
                self.nodes[victim].limit(LITTLE);
                sleep(awhile);
                self.nodes[victim].limit("--fsize=unlimited:");
            }
            Fault::Cut => self.world.cut(),
            Fault::Outage => {}
        }
        self.all_live(fault);
    }

    fn outage(&mut self) {
        // Alone with the database of all tests.
        let _alone = DATABASE.write().unwrap();
        self.begun.fetch_add(1, Ordering::Relaxed);
        postgres("stop");
        sleep(Duration::from_millis(500 + below(&mut self.random, 2500)));
        postgres("start");
        self.all_live(Fault::Outage);
    }

    fn all_live(&mut self, after: Fault) {
        for node in &mut self.nodes {
            assert_eq!(node.died(), None, "after {after:?}: {}", node.log());
        }
    }

    /// Kills a node, lets something happen, and starts another.
    fn replace(&mut self, victim: usize, meanwhile: impl FnOnce()) {
        self.nodes.remove(victim).kill();
        meanwhile();
        self.nodes.insert(victim, self.world.shielded(&HARDY));
        self.tell();
    }
}

/// The number that a run can be repeated with, as far as machines repeat themselves.
fn seed() -> u64 {
    let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap();
    chosen("CRASH_SEED", now.as_micros() as u64 % 1_000_000_007)
}

#[test]
fn faults_at_random_moments_lose_nothing_and_publish_once() {
    let (count, seed) = (chosen("CRASH_FAULTS", 14), seed());
    say(&format!("crash: {count} faults, CRASH_SEED={seed}"));
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let world = World::with_disk(DISK + DISK_PER_FAULT * count);
    if !engines::are_shared() && world.disk.is_none() {
        say("crash: LEFT OUT: a full disk, for a tmpfs cannot be mounted here (only root may)");
    }
    let faults = dealt(&mut random, world.disk.is_some(), count);
    let (start, stop, addresses) = (Instant::now(), &AtomicBool::new(false), &Mutex::new(Vec::new()));
    let begun = &AtomicU64::new(0);
    let (mut ledger, mut met) = (Ledger::default(), BTreeMap::new());
    let mut soak = Soak::new(&world, addresses, begun, random);
    scope(|scope| {
        let robots: Vec<_> = (1..=2).map(|number| scope.spawn(move || robot(addresses, number, begun, stop))).collect();
        for fault in faults {
            sleep(Duration::from_millis(below(&mut soak.random, 1000)));
            soak.meet(fault);
            *met.entry(fault).or_insert(0) += 1;
        }
        stop.store(true, Ordering::Relaxed);
        for robot in robots {
            let Ledger { ray_sets, jobs } = robot.join().unwrap();
            ledger.ray_sets.extend(ray_sets);
            ledger.jobs.extend(jobs);
        }
    });
    drop(soak);
    let soaked = start.elapsed();
    let _database = DATABASE.read().unwrap();
    ledger.audit(&world, &world.node(&TIDY));
    let (files, jobs, audited) = (ledger.ray_sets.len(), ledger.jobs.len(), start.elapsed());
    say(&format!(
        "crash: {met:?} in {soaked:?}, CRASH_SEED={seed}: {files} files and {jobs} jobs kept, audited by {audited:?}"
    ));
}

/// Asks for a job of its own.
fn submit(node: &Node, ray_set: &str) -> Answer {
    let body = json!({ "channels": [{ "ray_set": ray_set }], "reuse": false }).to_string();
    ask(&node.address, "POST", "/v1/jobs", &[("Content-Type", "application/json")], body.as_bytes()).unwrap()
}

/// What was asked for while nothing could be written: refused with one of `codes`, or taken and kept.
fn asked_while_refused(ledger: &mut Ledger, node: &Node, ray_set: &str, codes: &[&str]) {
    let mut refused = 0;
    until("three refusals", || {
        let answer = submit(node, ray_set);
        if answer.status == 202 {
            ledger.jobs.insert(answer.json()["id"].as_str().unwrap().to_owned());
            return None;
        }
        let code = answer.json()["code"].as_str().unwrap().to_owned();
        assert!(codes.contains(&code.as_str()), "{answer:?}");
        refused += 1;
        (refused >= 3).then_some(())
    });
    assert_eq!(node.get("/readyz").unwrap().status, 503, "it says that it cannot work");
    assert_eq!(node.get("/healthz").unwrap().status, 200, "the process lives");
}

/// After it: at once ready, and what is answered is there, for this process and for the next.
fn nothing_is_lost(mut ledger: Ledger, world: &World, node: Node) {
    until("the node to be ready", || (node.get("/readyz")?.status == 200).then_some(()));
    let late = ledger.job(&node, &ray_file(3));
    assert_eq!(node.get(&format!("/v1/jobs/{late}")).unwrap().status, 200);
    for ray_set in ledger.ray_sets.keys() {
        assert_eq!(node.get(&format!("/v1/ray-sets/{ray_set}")).unwrap().status, 200);
    }
    for job in &ledger.jobs {
        assert_eq!(ended(&node.address, job)["state"], "succeeded");
    }
    node.kill();
    ledger.audit(world, &world.node(&TIDY));
}

#[test]
fn a_full_disk_refuses_and_loses_nothing() {
    if engines::are_shared() {
        return;
    }
    let (world, mut ledger) = (World::with_disk(64 << 20), Ledger::default());
    let Some(disk) = &world.disk else {
        return say("crash: LEFT OUT: a full disk, for a tmpfs cannot be mounted here (only root may)");
    };
    let node = world.shielded(&TIDY);
    let ray_set = ledger.upload(&node.address, &ray_file(1)).unwrap();
    // It runs when the disk becomes full, and ends after that.
    ledger.job(&node, &ray_file_of(200_000, 2));
    disk.fill();
    asked_while_refused(&mut ledger, &node, &ray_set, &["storage.full"]);
    assert_eq!(ledger.upload(&node.address, &ray_file(4)), None);
    disk.make_room();
    nothing_is_lost(ledger, &world, node);
}

#[test]
fn errors_of_input_and_output_refuse_and_lose_nothing() {
    if engines::are_shared() {
        return;
    }
    let (world, mut ledger) = (World::new(), Ledger::default());
    let node = world.shielded(&TIDY);
    let ray_set = ledger.upload(&node.address, &ray_file(1)).unwrap();
    ledger.job(&node, &ray_file_of(200_000, 2));
    node.limit(LITTLE);
    asked_while_refused(&mut ledger, &node, &ray_set, &["storage.unavailable", "storage.full"]);
    node.limit("--fsize=unlimited:");
    nothing_is_lost(ledger, &world, node);
}

#[test]
fn with_less_room_than_is_kept_free_nothing_is_taken_and_everything_can_be_deleted() {
    if engines::are_shared() {
        return;
    }
    let (world, mut ledger) = (World::with_disk(64 << 20), Ledger::default());
    if world.disk.is_none() {
        return say("crash: LEFT OUT: a disk that is almost full, for a tmpfs cannot be mounted here (only root may)");
    }
    let node = world.node(&TIDY);
    // The default keeps 512 MiB free, and this disk has 64.
    assert_eq!(ledger.upload(&node.address, &ray_file(1)), None);
    let ready = node.get("/readyz").unwrap();
    assert_eq!((ready.status, &ready.json()["code"]), (503, &"storage.low_space".into()));
    let headers = [("Content-Type", "application/json")];
    for path in ["/v1/jobs", "/v1/webhooks"] {
        let answer = ask(&node.address, "POST", path, &headers, b"{}").unwrap();
        assert_eq!((answer.status, &answer.json()["code"]), (507, &"storage.low_space".into()), "{path}");
    }
    for (method, path) in [("POST", "/v1/jobs/none/cancel"), ("DELETE", "/v1/jobs/none"), ("DELETE", "/v1/ray-sets/x")]
    {
        assert_eq!(ask(&node.address, method, path, &[], b"").unwrap().status, 404, "{path} is let in");
    }
}
