//! Named points at which the process can be made to die, as if killed: for `tests/crash`. Inert unless `LAMPWRIGHT_CRASH_AT`
//! names a point when the service starts: `publish.blob_stored:3` dies when that point is passed for the third time.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};

/// The variable that names a point and, after a colon, at which pass; without a number the first.
pub const VARIABLE: &str = "LAMPWRIGHT_CRASH_AT";

/// Every point, in the order of an upload, a job and what is told of it. A stage's is "stage." and its name.
pub const POINTS: [&str; 23] = [
    "upload.part_stored",
    "upload.before_commit",
    "upload.committed",
    "append.committed",
    "join.before_commit",
    "join.committed",
    "take.before_commit",
    "take.committed",
    "submit.before_commit",
    "submit.committed",
    "claim.committed",
    "stage.rays",
    "stage.hull",
    "stage.flux",
    "stage.goniogram",
    "stage.model",
    "stage.artifacts",
    "publish.blob_stored",
    "finish.before_commit",
    "finish.committed",
    "announce.before_commit",
    "announce.committed",
    "deliver.answered",
];

struct Armed {
    point: String,
    passes_left: AtomicU64,
}

/// `None` in every process that no test has started.
static ARMED: OnceLock<Option<Armed>> = OnceLock::new();

/// Dies here, if this is where it was told to: no destructor runs, nothing is flushed.
pub fn point(name: &str) {
    if let Some(armed) = ARMED.get_or_init(armed)
        && armed.point == name
        && armed.passes_left.fetch_sub(1, Ordering::Relaxed) == 1
    {
        std::process::abort();
    }
}

/// Dies in a stage of the computation, if it was told to.
pub fn stage(name: &str) {
    if let Some(armed) = ARMED.get_or_init(armed)
        && armed.point.strip_prefix("stage.") == Some(name)
    {
        point(&armed.point);
    }
}

fn armed() -> Option<Armed> {
    let wanted = std::env::var(VARIABLE).ok().filter(|wanted| !wanted.is_empty())?;
    let (point, pass) = wanted.split_once(':').unwrap_or((&wanted, "1"));
    let passes_left = AtomicU64::new(pass.parse().ok()?);
    tracing::warn!(point, pass, "crash point armed: this process will end on purpose");
    Some(Armed { point: point.to_owned(), passes_left })
}
