//! Jobs: what states they have, which changes are legal, and who makes them.

/// What a client may choose, as sent and as stored.
pub mod options;
/// What a source is made of, as sent and as stored.
pub mod channels;
/// What is known of jobs; changes nothing.
pub mod query;
/// What is known of a job before it is queued.
pub mod prospect;
/// Memory for what one process computes.
pub mod memory;
/// Jobs that clients asked for lately, kept in memory.
pub mod recent;
/// Every change of a job's state.
pub mod queue;
/// How a job comes into the queue.
pub mod submit;
/// Who is next.
mod claim;
/// What becomes of jobs whose worker was lost, and of those that nobody can begin.
mod recovery;
/// Places that tenants share.
pub mod shares;
/// Tells clients that their jobs change.
pub mod watcher;
/// Takes jobs from the queue and computes them.
pub mod worker;

use crate::pipeline;
use pipeline::{Fault, Notice, Stage};
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// Where a job is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum State {
    /// Waits for a worker.
    Queued,
    /// A worker has it.
    Running,
    /// Its artifacts are there.
    Succeeded,
    /// It has a problem.
    Failed,
    /// Nobody wants it any more.
    Cancelled,
}

/// Before which of its tenant's other jobs a job comes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Priority {
    /// Before all others.
    High,
    /// By age.
    #[default]
    Normal,
    /// After all others.
    Low,
}

impl Priority {
    /// All, the most urgent first.
    pub const ALL: [Priority; 3] = [Priority::High, Priority::Normal, Priority::Low];

    /// As rows have it: the less, the sooner.
    pub fn number(self) -> i64 {
        match self {
            Priority::High => 0,
            Priority::Normal => 1,
            Priority::Low => 2,
        }
    }

    /// Reads what [`Priority::number`] writes.
    pub fn from_number(number: i64) -> Option<Priority> {
        Priority::ALL.into_iter().find(|priority| priority.number() == number)
    }
}

/// The only legal changes, and who makes them. `queue` has a statement for each.
pub const TRANSITIONS: [(State, State, &str); 8] = [
    (State::Queued, State::Running, "claim"),
    (State::Queued, State::Cancelled, "cancel"),
    (State::Queued, State::Failed, "give_up, when there is less memory than before"),
    (State::Running, State::Succeeded, "finish"),
    (State::Running, State::Failed, "fail; sweep, when attempts are used up"),
    (
        State::Running,
        State::Cancelled,
        "stop; release, when asked before; retry, when asked before; sweep, when asked before",
    ),
    (State::Running, State::Queued, "release; retry, when a store did not answer; sweep, when the worker was lost"),
    (State::Running, State::Running, "beat"),
];

impl State {
    /// All.
    pub const ALL: [State; 5] = [State::Queued, State::Running, State::Succeeded, State::Failed, State::Cancelled];

    /// The word in rows, requests and responses.
    pub fn name(self) -> &'static str {
        match self {
            State::Queued => "queued",
            State::Running => "running",
            State::Succeeded => "succeeded",
            State::Failed => "failed",
            State::Cancelled => "cancelled",
        }
    }

    /// Reads what [`State::name`] writes.
    pub fn parse(name: &str) -> Option<State> {
        State::ALL.into_iter().find(|state| state.name() == name)
    }

    /// Nothing changes it any more.
    pub fn ended(self) -> bool {
        !TRANSITIONS.iter().any(|(from, _, _)| *from == self)
    }
}

/// Why a job failed, as stored and told.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Failure {
    /// Stable: programs may depend on it.
    pub code: String,
    /// The kind of failure, for a person.
    pub title: String,
    /// What was found.
    pub detail: String,
    /// Where: "byte 20", "options.hull.resolution".
    pub at: Option<String>,
    /// What to do.
    pub remedy: Option<String>,
}

impl Failure {
    /// The worker disappeared more often than a job may be begun.
    pub fn worker_lost(attempts: u32) -> Failure {
        Failure {
            code: "job.worker_lost".into(),
            title: "The worker was lost".into(),
            detail: format!("The process that computed this job disappeared {attempts} times."),
            at: None,
            remedy: Some("See the service's log and memory; this input may need more than there is.".into()),
        }
    }

    /// The computation panicked.
    pub fn panicked() -> Failure {
        Failure { code: "job.panicked".into(), ..Failure::internal() }
    }

    /// A fault of ours: what it was is in the log, not here.
    pub fn internal() -> Failure {
        Failure {
            code: "run.internal".into(),
            title: "The computation hit a fault of ours".into(),
            detail: "The service met a fault of its own while it computed this job; its log says which.".into(),
            at: None,
            remedy: Some("Report it with the id of this job, and with its ray sets if they can be shared.".into()),
        }
    }

    /// A store did not give the bytes that a job needs, at any attempt.
    pub fn store_away() -> Failure {
        Failure {
            code: "bytes.unreadable".into(),
            title: "The stored bytes could not be read".into(),
            detail: "The store of the service did not answer when this job needed it.".into(),
            at: None,
            remedy: Some("Submit it again later; the service's log says what the store answered.".into()),
        }
    }

    /// The store no longer has the bytes of `whose`.
    pub fn blob_missing(whose: &str) -> Failure {
        Failure {
            code: "storage.blob_missing".into(),
            title: "Stored bytes are missing".into(),
            detail: format!("The store of the service no longer has the bytes of {whose}."),
            at: None,
            remedy: Some(
                "Send the file again and submit a new job; tell the operator, whose log names what is missing.".into(),
            ),
        }
    }

    /// The store has fewer bytes of `whose` than it took in.
    pub fn blob_damaged(whose: &str) -> Failure {
        Failure {
            code: "storage.blob_damaged".into(),
            title: "Stored bytes are damaged".into(),
            detail: format!("The store of the service has fewer bytes of {whose} than it took in."),
            ..Failure::blob_missing(whose)
        }
    }

    /// It saw that nobody wants it.
    pub fn stopped() -> Failure {
        Failure {
            code: pipeline::Error::Cancelled.code().into(),
            title: "The job was stopped".into(),
            detail: "The computation was told to stop.".into(),
            at: None,
            remedy: Some("Submit it again.".into()),
        }
    }

    /// An attempt took longer than it may.
    pub fn timed_out(longest: Duration, stage: Option<Stage>) -> Failure {
        let stage =
            stage.map_or("before its first stage".to_owned(), |stage| format!("in the stage {:?}", stage.name()));
        Failure {
            code: "job.timeout".into(),
            title: "The job took too long".into(),
            detail: format!("It was stopped {stage} after {} s, the longest that it may take.", longest.as_secs_f64()),
            at: Some("timeout_s".into()),
            remedy: Some(
                "Give it a larger timeout_s, up to the service's own; send fewer rays, or choose a lower hull.resolution, \
                 fewer zones or fewer bands; or ask the operator for more: serve --job-timeout."
                    .into(),
            ),
        }
    }

    /// It was queued when there was more memory.
    pub fn too_large(limit_bytes: u64) -> Failure {
        Failure {
            code: "job.too_large".into(),
            title: "The job needs too much memory".into(),
            detail: format!("It needs more than the {} MiB that all jobs may need together by now.", limit_bytes >> 20),
            at: Some("options".into()),
            remedy: Some(
                "Choose a lower hull.resolution, fewer goniogram.zones, wider goniogram steps or fewer \
                 rays.band_edges_nm; or ask the operator for more: serve --memory."
                    .into(),
            ),
        }
    }

    /// The store had no room for what was computed.
    pub fn store_full() -> Failure {
        Failure {
            code: "storage.full".into(),
            title: "The store is full".into(),
            detail: "There was no room for the artifacts of this job.".into(),
            at: None,
            remedy: Some("Delete jobs and ray sets, or make room; then submit it again.".into()),
        }
    }

    /// A stored job that this version cannot read.
    pub fn unreadable_job() -> Failure {
        Failure {
            code: "job.unreadable".into(),
            title: "The stored job cannot be read".into(),
            detail: "This version of the service cannot read what an earlier one has stored of the job.".into(),
            at: None,
            remedy: Some("Submit it again.".into()),
        }
    }

    /// What is wrong with the file or the request, in full.
    pub(super) fn of(title: &str, fault: &Fault) -> Failure {
        Failure {
            code: fault.code.into(),
            title: title.into(),
            detail: fault.found.clone(),
            at: fault.at.as_ref().map(ToString::to_string),
            remedy: Some(fault.remedy.clone()),
        }
    }
}

/// Something that was repaired, dropped or odd.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[schema(as = Notice)]
pub struct StoredNotice {
    /// Stable: programs may depend on it.
    pub code: String,
    /// The channel it concerns, by its name; null where it concerns the whole source.
    #[serde(default)]
    #[schema(required)]
    pub channel: Option<String>,
    /// How often.
    pub count: u64,
    /// Index of the first ray it happened to, from 0; null where it concerns no single ray.
    #[schema(required)]
    pub first_ray: Option<u64>,
    /// What was found and what was done.
    pub message: String,
}

impl From<StoredNotice> for Notice {
    fn from(stored: StoredNotice) -> Notice {
        let StoredNotice { code, channel, count, first_ray, message } = stored;
        Notice { code: code.into(), channel, count, first_ray, message }
    }
}

impl From<&Notice> for StoredNotice {
    fn from(notice: &Notice) -> StoredNotice {
        StoredNotice {
            code: notice.code.clone().into_owned(),
            channel: notice.channel.clone(),
            count: notice.count,
            first_ray: notice.first_ray,
            message: notice.message.clone(),
        }
    }
}
