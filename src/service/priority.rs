//! Which threads give way: those that compute run at a lower priority of the operating system than those that answer, so that a
//! busy service still answers at once. Only this file sets priorities.

use futures::channel::oneshot;
use std::any::Any;
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::thread;

/// How far a computing thread's `nice` value is raised. A thread at 10 has a ninth of the weight of one at 0: those that answer
/// are served first, and other programs of the same machine do not stop the computation.
#[cfg(target_os = "linux")]
const NICE: i32 = 10;

/// How far that of a thread is raised whose result a sender waits for: a third of the weight of one at 0, three times that of one
/// at 10.
#[cfg(target_os = "linux")]
const LITTLE: i32 = 5;

/// Why work on a thread of its own has no result.
#[derive(Debug, thiserror::Error)]
pub enum Lost {
    /// It panicked, with this message.
    #[error("a computing thread panicked: {0}")]
    Panicked(String),
    /// The system has no thread to give.
    #[error("the system has no thread for a computation: {0}")]
    NoThread(io::Error),
}

/// Lowers the priority of the calling thread, and of every thread that it starts, for the rest of their lives: an ordinary process
/// may not raise it again. So this is called on threads that only compute, never on one of tokio's, whose blocking threads serve
/// others afterwards. Where the system refuses, and on systems that know no priority of a single thread, nothing changes.
pub fn lower() {
    #[cfg(target_os = "linux")]
    lower_to(NICE);
}

/// As [`lower`], but only so far that those still lower give way to it.
pub fn lower_a_little() {
    #[cfg(target_os = "linux")]
    lower_to(LITTLE);
}

#[cfg(target_os = "linux")]
fn lower_to(nice: i32) {
    // On Linux, "this process" means the calling thread.
    if let Err(error) = rustix::process::setpriority_process(None, nice) {
        tracing::debug!(%error, "cannot lower the priority of a computing thread");
    }
}

/// Runs `work` on a new thread of lower priority, called `name` (at most 15 characters are shown), and resolves with its result.
/// Dropped before that, the work goes on and its result is lost: work that takes long has to look whether it is still wanted. It
/// must not poll futures of tokio itself (`Handle::block_on` of anything but the handle of a spawned task): what they start would
/// have the lower priority too.
///
/// # Errors
/// [`Lost`].
pub async fn compute<T: Send + 'static>(name: &str, work: impl FnOnce() -> T + Send + 'static) -> Result<T, Lost> {
    let (sender, receiver) = oneshot::channel();
    let run = move || {
        lower();
        // Nobody may be there to hear it.
        let _ = sender.send(catch_unwind(AssertUnwindSafe(work)));
    };
    thread::Builder::new().name(name.to_owned()).spawn(run).map_err(Lost::NoThread)?;
    match receiver.await {
        Ok(Ok(result)) => Ok(result),
        Ok(Err(payload)) => Err(Lost::Panicked(message(payload.as_ref()))),
        Err(oneshot::Canceled) => Err(Lost::Panicked("no message".to_owned())),
    }
}

/// Makes the pool of threads that rayon gives to whoever brings none one of lower priority. Once per process, before its first
/// use; a pool that is there already stays as it is.
pub fn lower_shared_pool() {
    let named = |thread: usize| format!("shared-{thread}");
    if let Err(error) = rayon::ThreadPoolBuilder::new().thread_name(named).start_handler(|_| lower()).build_global() {
        tracing::debug!(%error, "shared computing threads keep their priority");
    }
}

/// What a panic said.
fn message(payload: &(dyn Any + Send)) -> String {
    let text = payload.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| payload.downcast_ref::<&str>().copied()).unwrap_or("no message").to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The `nice` value of the calling thread: field 19 of proc(5), counted after the name, which may have spaces.
    #[cfg(target_os = "linux")]
    fn nice() -> i32 {
        let line = std::fs::read_to_string("/proc/thread-self/stat").unwrap();
        line.rsplit_once(')').unwrap().1.split_whitespace().nth(16).unwrap().parse().unwrap()
    }

    #[cfg(target_os = "linux")]
    #[tokio::test]
    async fn what_computes_gives_way_and_whoever_asked_for_it_does_not() {
        let before = nice();
        assert!(compute("computes", nice).await.unwrap() >= NICE);
        let started = || thread::spawn(nice).join().unwrap();
        assert!(compute("starts", started).await.unwrap() >= NICE, "what it starts gives way too");
        assert_eq!(nice(), before);
    }

    #[tokio::test]
    async fn a_panic_is_told_and_work_goes_on_without_a_listener() {
        let lost = compute::<()>("panics", || panic!("a fault of ours")).await.unwrap_err();
        assert!(matches!(&lost, Lost::Panicked(text) if text == "a fault of ours"), "{lost}");
        let (sender, receiver) = std::sync::mpsc::channel();
        drop(tokio::spawn(compute("goes on", move || sender.send(()))));
        tokio::task::spawn_blocking(move || receiver.recv_timeout(std::time::Duration::from_secs(20)))
            .await
            .unwrap()
            .unwrap();
    }
}
