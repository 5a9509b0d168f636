//! Reports changes of jobs to the clients that wait for them: one reader of the database for all clients of this process.

use super::query;
use super::query::JobStatus;
use super::recent::Recent;
use super::shares::{Share, Shares};
use crate::storage::records::Records;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::sync::{Notify, watch};
use tokio::time::{Instant, sleep, sleep_until};

/// Least time between two looks, so that changes at the same time are reported together.
const GAP: Duration = Duration::from_millis(50);

/// The waiting clients and their jobs. Cheap to clone.
#[derive(Clone)]
pub struct Watcher(Arc<Shared>);

struct Shared {
    watched: Mutex<Watched>,
    /// A client began to wait.
    begun: Notify,
    places: Shares,
}

#[derive(Default)]
struct Watched {
    /// Looks that were begun.
    looks: u64,
    jobs: HashMap<String, watch::Sender<News>>,
}

/// What a look found of a job.
#[derive(Clone, Debug, Default)]
struct News {
    look: u64,
    /// `None` when the job is not there.
    status: Option<JobStatus>,
}

impl Watcher {
    /// A watcher for clients that have a place among `places`.
    pub fn new(places: Shares) -> Watcher {
        Watcher(Arc::new(Shared { watched: Mutex::default(), begun: Notify::new(), places }))
    }

    /// Watches a job of `tenant` that was `known` to be so a moment ago; `None` when too many clients wait already, all together
    /// or of this tenant.
    pub fn watch(&self, tenant: &str, id: &str, known: JobStatus) -> Option<Watching> {
        let place = self.0.places.take(tenant)?;
        let mut watched = self.0.watched();
        // A look that has begun may have read the job before this client did.
        let since = watched.looks + 1;
        let news = watched.jobs.entry(id.to_owned()).or_insert_with(|| watch::channel(News::default()).0).subscribe();
        drop(watched);
        self.0.begun.notify_one();
        Some(Watching { id: id.to_owned(), known, since, news, shared: Arc::clone(&self.0), _place: place })
    }

    /// Reads the jobs that clients wait for: when this process `changes` a job, and every `poll` for the changes of other
    /// processes; with the latter at the `recent` ones too. Without either the database is left alone.
    pub async fn keep_up(self, records: Records, recent: Recent, mut changes: watch::Receiver<()>, poll: Duration) {
        let mut next = Instant::now();
        loop {
            let polls = Instant::now() >= next;
            if polls {
                next = Instant::now() + poll;
            }
            self.look(&records, &recent, polls).await;
            sleep(GAP).await;
            tokio::select! {
                _ = changes.changed() => {}
                () = self.0.begun.notified() => {}
                () = sleep_until(next) => {}
            }
        }
    }

    /// One look; where it `polls`, at all that is kept.
    async fn look(&self, records: &Records, recent: &Recent, polls: bool) {
        let (look, mut ids) = {
            let mut watched = self.0.watched();
            watched.looks += 1;
            (watched.looks, watched.jobs.keys().cloned().collect::<Vec<_>>())
        };
        if polls {
            ids.extend(recent.asked_for());
        }
        ids.sort();
        ids.dedup();
        if ids.is_empty() {
            return;
        }
        let begun = Instant::now();
        let mut stamps = match query::stamps(records, &ids).await {
            Ok(stamps) => stamps,
            Err(error) => {
                tracing::warn!(%error, "cannot read the state of watched jobs; trying again");
                return;
            }
        };
        // Before anybody is told: who is told of a change and asks at once must not be answered with what was before it.
        recent.compare(begun, &ids, &stamps);
        let mut watched = self.0.watched();
        // Of two who leave together, each may have seen the other's receiver.
        watched.jobs.retain(|_, sender| sender.receiver_count() > 0);
        for id in ids {
            if let Some(sender) = watched.jobs.get(&id) {
                sender.send_replace(News { look, status: stamps.remove(&id).map(|stamp| stamp.status) });
            }
        }
    }
}

impl Shared {
    fn watched(&self) -> MutexGuard<'_, Watched> {
        // Nothing is left half done in there.
        self.watched.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// One client that waits for changes of a job, until this is dropped.
pub struct Watching {
    id: String,
    known: JobStatus,
    since: u64,
    news: watch::Receiver<News>,
    shared: Arc<Shared>,
    _place: Share,
}

impl Watching {
    /// The next status of the job that differs from the known one; `None` when the job is deleted.
    pub async fn next(&mut self) -> Option<JobStatus> {
        loop {
            self.news.changed().await.ok()?;
            let news = self.news.borrow_and_update().clone();
            if news.look < self.since {
                continue;
            }
            let status = news.status?;
            if status != self.known {
                self.known = status.clone();
                return Some(status);
            }
        }
    }
}

impl Drop for Watching {
    fn drop(&mut self) {
        let mut watched = self.shared.watched();
        // This one's receiver still counts.
        if watched.jobs.get(&self.id).is_some_and(|sender| sender.receiver_count() <= 1) {
            watched.jobs.remove(&self.id);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::jobs::State;

    fn status(state: State) -> JobStatus {
        JobStatus { state, attempt: 0, stage: None, stage_progress: 0.0, queue_position: None, is_evaluation: false }
    }

    #[test]
    fn places_are_bounded_and_given_back_and_jobs_nobody_waits_for_are_forgotten() {
        let watcher = Watcher::new(Shares::new(2, false));
        let known = || status(State::Queued);
        let (first, second) =
            (watcher.watch("lab", "a", known()).unwrap(), watcher.watch("lab", "a", known()).unwrap());
        assert!(watcher.watch("lab", "b", known()).is_none());
        drop(first);
        assert_eq!(watcher.0.watched().jobs.len(), 1, "another still waits for it");
        drop(second);
        assert!(watcher.0.watched().jobs.is_empty());
        assert!(watcher.watch("lab", "b", known()).is_some());
    }

    #[tokio::test]
    async fn what_was_read_before_a_client_came_is_not_news_to_it() {
        let watcher = Watcher::new(Shares::new(2, false));
        let send = |look, state| {
            let sender = watcher.0.watched().jobs.get("a").cloned().unwrap();
            sender.send_replace(News { look, status: Some(status(state)) });
        };
        let mut early = watcher.watch("lab", "a", status(State::Queued)).unwrap();
        // A look begins and reads `queued`; the job is begun, a client sees that and waits; the look ends.
        watcher.0.watched().looks += 1;
        let mut late = watcher.watch("lab", "a", status(State::Running)).unwrap();
        send(1, State::Queued);
        tokio::select! {
            biased;
            status = late.next() => panic!("{status:?}"),
            () = tokio::task::yield_now() => {}
        }
        send(2, State::Succeeded);
        assert_eq!(late.next().await, Some(status(State::Succeeded)));
        assert_eq!(early.next().await, Some(status(State::Succeeded)));
    }
}
