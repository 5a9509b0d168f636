//! What a verb has begun and not ended goes again when it is interrupted, by Ctrl-C or SIGTERM: nobody knows what a part of a file is.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::exit;
use std::sync::mpsc::{Sender, channel};
use std::sync::{Mutex, Once, PoisonError};
use std::thread;
use tokio::runtime::Builder;
use tokio::signal::unix::{SignalKind, signal};

/// Files and folders that go again; a folder only where nothing is in it.
static BEGUN: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());
/// The signals are listened to once.
static LISTENED: Once = Once::new();
/// Exit codes of a process that a signal ended, as shells tell them: 128 and its number.
const INTERRUPTED: i32 = 130;
const TERMINATED: i32 = 143;

/// A file or a folder that is not whole as long as this lives.
pub struct Begun(PathBuf);

/// Call it before the file or the folder is made.
pub fn begin(path: &Path) -> Begun {
    LISTENED.call_once(|| {
        let (ready, listening) = channel();
        let listens = thread::Builder::new().name("signals".to_owned()).spawn(move || listen(&ready));
        // Where no thread or no listener can be had, a signal ends the process as it always does.
        if listens.is_ok() {
            let _ = listening.recv();
        }
    });
    BEGUN.lock().unwrap_or_else(PoisonError::into_inner).push(path.to_owned());
    Begun(path.to_owned())
}

impl Drop for Begun {
    fn drop(&mut self) {
        let mut begun = BEGUN.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(at) = begun.iter().rposition(|path| *path == self.0) {
            begun.remove(at);
        }
    }
}

/// Removes a file, or a folder in which nothing is.
pub fn take_away(path: &Path) {
    // What went wrong is told already; what stays behind is only untidy.
    let _ = fs::remove_file(path).or_else(|_| fs::remove_dir(path));
}

/// Waits for a signal, takes away what was begun, and ends the process. `ready` hears when it listens, or that it cannot.
fn listen(ready: &Sender<()>) {
    let Ok(runtime) = Builder::new_current_thread().enable_io().build() else { return };
    let code = runtime.block_on(async {
        let mut interrupt = signal(SignalKind::interrupt()).ok()?;
        let mut terminate = signal(SignalKind::terminate()).ok()?;
        let _ = ready.send(());
        Some(tokio::select! {
            _ = interrupt.recv() => INTERRUPTED,
            _ = terminate.recv() => TERMINATED,
        })
    });
    if let Some(code) = code {
        // Held to the end: the verb cannot begin another file meanwhile.
        let begun = BEGUN.lock().unwrap_or_else(PoisonError::into_inner);
        begun.iter().rev().for_each(|path| take_away(path));
        exit(code);
    }
}
