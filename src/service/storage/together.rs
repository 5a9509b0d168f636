//! One statement for all reads at the same time. A read that is requested while another one runs is answered by the next one, so
//! an answer is never older than its question, and the database is asked once however many clients wait.

use super::error::Error;
use futures::future::BoxFuture;
use std::collections::{BTreeSet, HashMap};
use std::mem;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::sync::oneshot;
use tokio::time::timeout;

/// Longest read. All readers wait for it, so a connection that was lost silently must not hold them up.
const LONGEST: Duration = Duration::from_secs(10);

/// Reads what is known of some keys; what is not there is left out.
type Read<V> = dyn Fn(Vec<String>) -> BoxFuture<'static, Result<HashMap<String, V>, Error>> + Send + Sync;
/// Where an answer goes.
type Asker<V> = oneshot::Sender<Result<Option<V>, Error>>;

/// Reads that are done together. Cheap to clone.
pub struct Together<V>(Arc<Shared<V>>);

struct Shared<V> {
    read: Box<Read<V>>,
    waiting: Mutex<Waiting<V>>,
}

struct Waiting<V> {
    /// Whether a task answers the waiting reads.
    answering: bool,
    askers: Vec<(String, Asker<V>)>,
}

impl<V> Clone for Together<V> {
    fn clone(&self) -> Together<V> {
        Together(Arc::clone(&self.0))
    }
}

impl<V: Clone + Send + 'static> Together<V> {
    /// Reads with `read`, which is called with several different keys at a time.
    pub fn new<R>(read: R) -> Together<V>
    where
        R: Fn(Vec<String>) -> BoxFuture<'static, Result<HashMap<String, V>, Error>> + Send + Sync + 'static,
    {
        let waiting = Mutex::new(Waiting { answering: false, askers: Vec::new() });
        Together(Arc::new(Shared { read: Box::new(read), waiting }))
    }

    /// The value of `key` as of this moment or later; `None` if there is none.
    ///
    /// # Errors
    /// The database did not answer.
    pub async fn ask(&self, key: &str) -> Result<Option<V>, Error> {
        let (sender, receiver) = oneshot::channel();
        if self.0.join(key.to_owned(), sender) {
            // A task of its own: this client may go away, the others wait on.
            tokio::spawn(answer(Answering { shared: Arc::clone(&self.0), is_done: false }));
        }
        receiver.await.unwrap_or_else(|_| Err(Error::Records("the database did not answer".into())))
    }
}

impl<V> Shared<V> {
    /// Adds a read to the waiting ones; true if no task answers them yet.
    fn join(&self, key: String, sender: Asker<V>) -> bool {
        let mut waiting = self.waiting();
        waiting.askers.push((key, sender));
        !mem::replace(&mut waiting.answering, true)
    }

    fn waiting(&self) -> MutexGuard<'_, Waiting<V>> {
        // The state is consistent even after a panic.
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The task that answers; when it is dropped, the waiting reads fail and the next one starts another task.
struct Answering<V> {
    shared: Arc<Shared<V>>,
    is_done: bool,
}

impl<V> Drop for Answering<V> {
    fn drop(&mut self) {
        if !self.is_done {
            let mut waiting = self.shared.waiting();
            waiting.answering = false;
            waiting.askers.clear();
        }
    }
}

async fn answer<V: Clone>(mut task: Answering<V>) {
    loop {
        let mut askers = {
            let mut waiting = task.shared.waiting();
            waiting.answering = !waiting.askers.is_empty();
            mem::take(&mut waiting.askers)
        };
        if askers.is_empty() {
            task.is_done = true;
            return;
        }
        let keys: BTreeSet<String> = askers.iter().map(|(key, _)| key.clone()).collect();
        let found = timeout(LONGEST, (task.shared.read)(keys.into_iter().collect())).await;
        let found = found.unwrap_or_else(|_| Err(Error::Records("the database did not answer in time".into())));
        if found.is_err() {
            // Reads that were requested meanwhile fail with it: the database is away for them too.
            askers.append(&mut task.shared.waiting().askers);
        }
        for (key, sender) in askers {
            // The reader may have gone.
            let _ = sender.send(match &found {
                Ok(found) => Ok(found.get(&key).cloned()),
                Err(error) => Err(Error::Records(error.to_string().into())),
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use futures::FutureExt;
    use std::sync::atomic::{AtomicU64, Ordering};
    use tokio::sync::Semaphore;

    /// Reads that tell how many there were, each let go by a permit of `gate`; without one, they fail.
    fn counted(gate: &Arc<Semaphore>) -> (Together<u64>, Arc<AtomicU64>) {
        let (gate, reads) = (Arc::clone(gate), Arc::new(AtomicU64::new(0)));
        let count = Arc::clone(&reads);
        let read = move |keys: Vec<String>| {
            let (gate, number) = (Arc::clone(&gate), count.fetch_add(1, Ordering::SeqCst) + 1);
            let read = async move {
                gate.acquire().await.map_err(|error| Error::Records(error.into()))?.forget();
                Ok(keys.into_iter().filter(|key| key != "nothing").map(|key| (key, number)).collect())
            };
            read.boxed()
        };
        (Together::new(read), reads)
    }

    #[tokio::test]
    async fn who_asks_during_a_read_is_answered_by_the_next_and_all_of_them_at_once() {
        let gate = Arc::new(Semaphore::new(0));
        let (together, reads) = counted(&gate);
        let ask = |key: &'static str| {
            let together = together.clone();
            tokio::spawn(async move { together.ask(key).await.unwrap() })
        };
        let first = ask("a");
        while reads.load(Ordering::SeqCst) == 0 {
            tokio::task::yield_now().await;
        }
        let later: Vec<_> = ["a", "b", "nothing"].into_iter().cycle().take(300).map(ask).collect();
        // One that goes away keeps nobody waiting.
        ask("a").abort();
        while together.0.waiting().askers.len() < 300 {
            tokio::task::yield_now().await;
        }
        gate.add_permits(2);
        assert_eq!(first.await.unwrap(), Some(1));
        for (index, asked) in later.into_iter().enumerate() {
            assert_eq!(asked.await.unwrap(), (index % 3 != 2).then_some(2), "{index}");
        }
        assert_eq!(reads.load(Ordering::SeqCst), 2);
        gate.add_permits(1);
        assert_eq!(together.ask("a").await.unwrap(), Some(3), "a read begins anew after a rest");
    }

    #[tokio::test]
    async fn a_failed_read_is_told_to_all_who_wait_and_the_next_is_tried() {
        let gate = Arc::new(Semaphore::new(0));
        let (together, reads) = counted(&gate);
        let asked: Vec<_> = (0..3)
            .map(|_| {
                tokio::spawn({
                    let together = together.clone();
                    async move { together.ask("a").await }
                })
            })
            .collect();
        while reads.load(Ordering::SeqCst) == 0 {
            tokio::task::yield_now().await;
        }
        gate.close();
        for asked in asked {
            assert!(asked.await.unwrap().is_err());
        }
        assert!(together.ask("a").await.is_err(), "and nobody waits for ever");
    }
}
