//! A cache of the jobs that clients asked for lately: polling is answered from memory. A change of this process removes the job
//! from the cache. Changes of other processes: where this process has the stores alone, it looks for them once per poll; on shared
//! engines every answer is compared with the database first, with one statement for all requests at the same time.

use super::query;
use super::query::{Job, Stamp};
use crate::storage::error::Error;
use crate::storage::records::Records;
use crate::storage::together::Together;
use bytes::Bytes;
use futures::FutureExt;
use hashlink::LruCache;
use std::collections::{HashMap, HashSet};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::Duration;
use tokio::sync::Mutex as Turn;
use tokio::time::{Instant, timeout};

/// Most jobs kept: about 10 MB of ordinary ones.
const JOBS: usize = 2048;
/// Most channels and notices of a job that is kept; a job with more is read from the database for every request.
const LINES: usize = 24;
/// Length of an identifier of ours, characters; nothing else is remembered.
const ID_CHARS: usize = 36;
/// Largest number of simultaneous reads of different jobs; reads of one job take turns.
const TURNS: usize = 64;
/// Longest wait for another's read of the same job.
const LONGEST_TURN: Duration = Duration::from_millis(100);
/// Number of polls without a request after which a job is removed from the cache.
const IDLE_POLLS: u32 = 30;
/// So many polls without a comparison, and a job is not believed any more: the database did not answer.
const BELIEVED_POLLS: u32 = 3;

/// A job that was read from the database, with the HTTP answer that was made of it.
#[derive(Debug)]
pub struct KnownJob {
    /// The job.
    pub job: Job,
    /// Made once, with the path that its links begin with.
    answer: OnceLock<(String, Bytes)>,
}

impl KnownJob {
    /// A job that was just read.
    pub fn new(job: Job) -> KnownJob {
        KnownJob { job, answer: OnceLock::new() }
    }

    /// The answer that `write` makes of the job. The first is kept, for those whose links begin with the same path, `prefix`: they
    /// ask through the same proxy, or through none.
    ///
    /// # Errors
    /// That of `write`.
    pub fn answer<E>(&self, prefix: &str, write: impl FnOnce(&Job) -> Result<Bytes, E>) -> Result<Bytes, E> {
        match self.answer.get() {
            Some((known, answer)) if known == prefix => Ok(answer.clone()),
            Some(_) => write(&self.job),
            None => {
                let answer = write(&self.job)?;
                // Another may have been faster; this one is as right.
                let _ = self.answer.set((prefix.to_owned(), answer.clone()));
                Ok(answer)
            }
        }
    }
}

/// What a client's question found in memory.
enum Found {
    /// To be answered with.
    True(Arc<KnownJob>),
    /// True when it was read; the database is to be asked whether it still is.
    Perhaps(Arc<KnownJob>),
    Nothing,
}

/// The cache of jobs that clients asked for lately. Cheap to clone.
#[derive(Clone)]
pub struct Recent(Arc<Shared>);

struct Shared {
    entries: Mutex<Entries>,
    turns: Vec<Turn<()>>,
    records: Records,
    /// Compares with the database before every answer, where other processes may change jobs.
    stamps: Option<Together<Stamp>>,
    poll: Duration,
}

/// By tenant and identifier: one tenant never finds another's.
struct Entries {
    jobs: LruCache<String, Entry>,
    /// Reads that were begun.
    reads: u64,
}

struct Entry {
    tenant: String,
    id: String,
    /// `None` while it is read for the first time, by the read of this number.
    known: Option<Arc<KnownJob>>,
    read: u64,
    /// When it was last true.
    seen: Instant,
    asked: Instant,
}

impl Recent {
    /// Nothing is remembered yet. `is_alone`: only this process changes jobs in `records`. `poll`: how often it is looked whether
    /// that holds.
    pub fn new(records: Records, is_alone: bool, poll: Duration) -> Recent {
        let asked = records.clone();
        let read = move |ids: Vec<String>| {
            let records = asked.clone();
            async move { query::stamps(&records, &ids).await }.boxed()
        };
        let entries = Entries { jobs: LruCache::new(JOBS), reads: 0 };
        Recent(Arc::new(Shared {
            entries: Mutex::new(entries),
            turns: (0..TURNS).map(|_| Turn::new(())).collect(),
            records,
            stamps: (!is_alone).then(|| Together::new(read)),
            poll,
        }))
    }

    /// The job `id` of `tenant`, if there is one: never older than what this process has changed before the call.
    ///
    /// # Errors
    /// The database did not answer.
    pub async fn get(&self, tenant: &str, id: &str) -> Result<Option<Arc<KnownJob>>, Error> {
        if id.len() != ID_CHARS {
            return Ok(self.read(tenant, id).await?.map(Arc::new));
        }
        let key = key(tenant, id);
        if let Some(known) = self.remembered(&key, id).await? {
            return Ok(Some(known));
        }
        // Many who ask for a job that has just changed need one read, not one each. A read that takes long, of a database that is away,
        // holds up nobody else: each of them is told so in its own time.
        let _turn = timeout(LONGEST_TURN, self.0.turn(&key).lock()).await;
        if let Some(known) = self.remembered(&key, id).await? {
            return Ok(Some(known));
        }
        let (number, begun) = (self.0.entries().begin(&key, tenant, id), Instant::now());
        let read = self.read(tenant, id).await.map(|known| known.map(Arc::new));
        self.0.entries().end(&key, number, begun, read.as_ref().ok().and_then(Option::as_ref));
        read
    }

    async fn read(&self, tenant: &str, id: &str) -> Result<Option<KnownJob>, Error> {
        Ok(query::get(&self.0.records, tenant, id).await?.map(KnownJob::new))
    }

    /// What is kept, if that is true now.
    async fn remembered(&self, key: &str, id: &str) -> Result<Option<Arc<KnownJob>>, Error> {
        let known = match self.0.find(key) {
            Found::True(known) => return Ok(Some(known)),
            Found::Nothing => return Ok(None),
            Found::Perhaps(known) => known,
        };
        let Some(stamps) = &self.0.stamps else { return Ok(None) };
        if stamps.ask(id).await?.is_some_and(|stamp| stamp == Stamp::from(&known.job)) {
            return Ok(Some(known));
        }
        self.0.entries().invalidate_same(key, &known);
        Ok(None)
    }

    /// Removes the job `id` of `tenant` from the cache, because this process has changed it, or may have.
    pub fn invalidate(&self, tenant: &str, id: &str) {
        self.0.entries().jobs.remove(&key(tenant, id));
    }

    /// Removes a job of `tenant` from the cache where that has something else than `job`, which was read from the database now, or
    /// where a read is under way, which may have begun earlier.
    pub fn correct(&self, tenant: &str, job: &Job) {
        let (key, stamp) = (key(tenant, &job.id), Stamp::from(job));
        let mut entries = self.0.entries();
        let is_same = |entry: &Entry| entry.known.as_ref().is_some_and(|known| Stamp::from(&known.job) == stamp);
        if entries.jobs.peek(&key).is_some_and(|entry| !is_same(entry)) {
            entries.jobs.remove(&key);
        }
    }

    /// Removes all queued jobs of `tenant` from the cache, because this process has changed which of them are queued, or their
    /// order, and so their positions.
    pub fn invalidate_waiting(&self, tenant: &str) {
        let waits = |entry: &Entry| entry.known.as_ref().is_none_or(|known| known.job.queue_position.is_some());
        self.0.entries().jobs.retain(|_, entry| entry.tenant != tenant || !waits(entry));
    }

    /// Removes all jobs from the cache, because this process has changed jobs whose identifiers it does not know.
    pub fn invalidate_all(&self) {
        self.0.entries().jobs.clear();
    }

    /// The jobs to compare with the database at a poll: those that clients ask for; the others are forgotten. None where every answer is
    /// compared.
    pub(super) fn asked_for(&self) -> Vec<String> {
        if self.0.stamps.is_some() {
            return Vec::new();
        }
        let mut entries = self.0.entries();
        let idle = self.0.poll.saturating_mul(IDLE_POLLS);
        entries.jobs.retain(|_, entry| entry.asked.elapsed() < idle);
        entries.jobs.iter().filter(|(_, entry)| entry.known.is_some()).map(|(_, entry)| entry.id.clone()).collect()
    }

    /// Removes from the cache what differs from the database, by `stamps` of the jobs called `ids` that were read at `begun` or
    /// later.
    pub(super) fn compare(&self, begun: Instant, ids: &[String], stamps: &HashMap<String, Stamp>) {
        let asked: HashSet<&str> = ids.iter().map(String::as_str).collect();
        self.0.entries().jobs.retain(|_, entry| {
            if !asked.contains(entry.id.as_str()) {
                return true;
            }
            // A read that is under way may have begun before the change that these stamps show: its result is not kept.
            let Some(known) = &entry.known else { return false };
            // What was read after this look began may be newer; it is read once more.
            let is_true = stamps.get(&entry.id).is_some_and(|stamp| *stamp == Stamp::from(&known.job));
            entry.seen = entry.seen.max(begun);
            is_true
        });
    }
}

impl Shared {
    fn entries(&self) -> MutexGuard<'_, Entries> {
        // Nothing is left half done in there.
        self.entries.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn turn(&self, key: &str) -> &Turn<()> {
        let mut hasher = DefaultHasher::new();
        key.hash(&mut hasher);
        // As many as are there; never none.
        &self.turns[hasher.finish() as usize % self.turns.len()]
    }

    fn find(&self, key: &str) -> Found {
        let mut entries = self.entries();
        let Some(entry) = entries.jobs.get_mut(key) else { return Found::Nothing };
        entry.asked = Instant::now();
        match &entry.known {
            None => Found::Nothing,
            Some(known) if self.stamps.is_some() => Found::Perhaps(Arc::clone(known)),
            Some(known) if entry.seen.elapsed() <= self.poll.saturating_mul(BELIEVED_POLLS) => {
                Found::True(Arc::clone(known))
            }
            Some(_) => Found::Nothing,
        }
    }
}

impl Entries {
    /// A read begins: a change from now on makes what it finds useless to others.
    fn begin(&mut self, key: &str, tenant: &str, id: &str) -> u64 {
        self.reads += 1;
        let (now, read) = (Instant::now(), self.reads);
        let entry = Entry { tenant: tenant.to_owned(), id: id.to_owned(), known: None, read, seen: now, asked: now };
        self.jobs.insert(key.to_owned(), entry);
        read
    }

    /// Keeps what the read of this number found, unless something has changed since it began.
    fn end(&mut self, key: &str, number: u64, begun: Instant, found: Option<&Arc<KnownJob>>) {
        let Some(entry) = self.jobs.peek_mut(key).filter(|entry| entry.read == number) else { return };
        match found {
            Some(known) if known.job.channels.len() + known.job.notices.len() <= LINES => {
                (entry.known, entry.seen) = (Some(Arc::clone(known)), begun);
            }
            _ => drop(self.jobs.remove(key)),
        }
    }

    /// Forgets `known`, not what may have been read since.
    fn invalidate_same(&mut self, key: &str, known: &Arc<KnownJob>) {
        let same = |entry: &Entry| entry.known.as_ref().is_some_and(|kept| Arc::ptr_eq(kept, known));
        if self.jobs.peek(key).is_some_and(same) {
            self.jobs.remove(key);
        }
    }
}

/// Tenants' names have no space.
fn key(tenant: &str, id: &str) -> String {
    format!("{tenant} {id}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::jobs::{Priority, State};
    use crate::metadata::Metadata;
    use pipeline::Options;

    fn known(state: State) -> Arc<KnownJob> {
        let queue_position = (state == State::Queued).then_some(1);
        Arc::new(KnownJob::new(Job {
            id: "j".into(),
            state,
            channels: Vec::new(),
            evaluation: None,
            total: None,
            options: Options::default(),
            attempt: 0,
            cancel_requested: false,
            stage: None,
            stage_progress: 0.0,
            priority: Priority::Normal,
            timeout_s: None,
            metadata: Metadata::default(),
            memory_bytes: 0,
            queue_position,
            failure: None,
            notices: Vec::new(),
            created_ms: 0,
            started_ms: None,
            finished_ms: None,
        }))
    }

    /// What is remembered in a database of our own, which is never asked here.
    async fn recent(folder: &tempfile::TempDir) -> Recent {
        let url = format!("sqlite:{}?mode=rwc", folder.path().join("service.db").display());
        Recent::new(Records::open(&url).await.unwrap(), true, Duration::from_secs(3600))
    }

    fn keep(recent: &Recent, tenant: &str, id: &str, state: State) {
        let number = recent.0.entries().begin(&key(tenant, id), tenant, id);
        recent.0.entries().end(&key(tenant, id), number, Instant::now(), Some(&known(state)));
    }

    fn is_kept(recent: &Recent, tenant: &str, id: &str) -> bool {
        matches!(recent.0.find(&key(tenant, id)), Found::True(_))
    }

    #[tokio::test]
    async fn a_change_forgets_what_it_changed_and_reads_that_began_before_it() {
        let folder = tempfile::tempdir().unwrap();
        let recent = recent(&folder).await;
        for (id, state) in [("ended", State::Succeeded), ("runs", State::Running), ("waits", State::Queued)] {
            keep(&recent, "a", id, state);
            keep(&recent, "b", id, state);
        }
        assert!(is_kept(&recent, "a", "runs") && !is_kept(&recent, "c", "runs"), "another tenant has no such job");
        recent.invalidate("a", "ended");
        assert!(!is_kept(&recent, "a", "ended") && is_kept(&recent, "b", "ended"));
        recent.invalidate_waiting("a");
        assert!(!is_kept(&recent, "a", "waits") && is_kept(&recent, "a", "runs") && is_kept(&recent, "b", "waits"));

        let changes: [fn(&Recent); 3] = [
            |recent| recent.invalidate("a", "j"),
            |recent| recent.invalidate_waiting("a"),
            |recent| recent.invalidate_all(),
        ];
        for change in changes {
            let number = recent.0.entries().begin("a j", "a", "j");
            change(&recent);
            recent.0.entries().end("a j", number, Instant::now(), Some(&known(State::Running)));
            assert!(!is_kept(&recent, "a", "j"), "it may have been read before the change");
        }
        assert!(!is_kept(&recent, "b", "runs"), "all are forgotten");
    }

    /// Whoever hears of the change by that look and asks at once must not be answered with what was before it.
    #[tokio::test]
    async fn a_look_forgets_a_read_that_may_have_begun_before_what_it_saw() {
        let folder = tempfile::tempdir().unwrap();
        let recent = recent(&folder).await;
        let number = recent.0.entries().begin("a j", "a", "j");
        let stamps = HashMap::from([("j".to_owned(), Stamp::from(&known(State::Succeeded).job))]);
        recent.compare(Instant::now(), &["j".to_owned()], &stamps);
        recent.0.entries().end("a j", number, Instant::now(), Some(&known(State::Running)));
        assert!(!is_kept(&recent, "a", "j"));

        let number = recent.0.entries().begin("a j", "a", "j");
        recent.correct("a", &known(State::Succeeded).job);
        recent.0.entries().end("a j", number, Instant::now(), Some(&known(State::Running)));
        assert!(!is_kept(&recent, "a", "j"));
        keep(&recent, "a", "j", State::Running);
        recent.correct("a", &known(State::Running).job);
        assert!(is_kept(&recent, "a", "j"), "the same");
        recent.correct("a", &known(State::Succeeded).job);
        assert!(!is_kept(&recent, "a", "j"));
    }

    #[tokio::test]
    async fn a_look_forgets_what_others_changed_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let recent = recent(&folder).await;
        let stamp = |state| Stamp::from(&known(state).job);
        for id in ["same", "other", "gone", "unasked"] {
            keep(&recent, "a", id, State::Running);
        }
        let ids = ["same", "other", "gone"].map(str::to_owned);
        let found = [("same".to_owned(), stamp(State::Running)), ("other".to_owned(), stamp(State::Succeeded))];
        recent.compare(Instant::now(), &ids, &found.into_iter().collect());
        let kept = ["same", "other", "gone", "unasked"].map(|id| is_kept(&recent, "a", id));
        assert_eq!(kept, [true, false, false, true]);
        let mut asked_for = recent.asked_for();
        asked_for.sort();
        assert_eq!(asked_for, ["same", "unasked"]);
    }

    #[tokio::test]
    async fn no_more_jobs_are_kept_than_there_are_places_nor_very_long_ones() {
        let folder = tempfile::tempdir().unwrap();
        let recent = recent(&folder).await;
        for job in 0..JOBS + 100 {
            keep(&recent, "a", &format!("{job}"), State::Succeeded);
            assert!(is_kept(&recent, "a", "0"), "what is asked for stays");
        }
        assert!(recent.0.entries().jobs.len() <= JOBS && !is_kept(&recent, "a", "1"));
        let notice = crate::failure::StoredNotice {
            code: "x".into(),
            count: 1,
            first_ray: None,
            message: "x".into(),
            channel: None,
        };
        let mut long = Arc::into_inner(known(State::Succeeded)).unwrap().job;
        long.notices = vec![notice; LINES + 1];
        let number = recent.0.entries().begin("a long", "a", "long");
        recent.0.entries().end("a long", number, Instant::now(), Some(&Arc::new(KnownJob::new(long))));
        assert!(!is_kept(&recent, "a", "long"));
    }
}
