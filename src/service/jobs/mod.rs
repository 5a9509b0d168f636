//! Jobs: what states they have, which changes are legal, and who makes them.

/// What a client may choose, as sent and as stored.
pub mod options;
/// Evaluations of models, as clients ask for them.
pub mod evaluation;
/// What a source is made of, as sent and as stored.
pub mod request;
/// What is known of jobs; changes nothing.
pub mod query;
/// What is known of a job before it is queued.
pub mod estimate;
/// Memory for what one process computes.
pub mod memory_budget;
/// Jobs that clients asked for lately, kept in memory.
pub mod recent;
/// Every change of a job's state.
pub mod queue;
/// How a job comes into the queue.
pub mod submit;
/// Who is next.
mod claim;
/// Recovery of jobs whose worker was lost, and of jobs that no worker can start.
mod recovery;
/// Places that tenants share.
pub mod shares;
/// Tells clients that their jobs change.
pub mod watcher;
/// Models that are evaluated.
pub mod evaluating;
/// Takes jobs from the queue and computes them.
pub mod worker;
/// What can go wrong with a job.
pub mod error;
/// Announcements of ended jobs.
pub mod outbox;

use crate::failure::StoredNotice;
use pipeline::Notice;
use serde::{Deserialize, Serialize};

/// State of a job.
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
    /// A client cancelled the job.
    Cancelled,
}

/// Priority of a job among the queued jobs of its tenant.
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
    (State::Running, State::Running, "renew_lease"),
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

impl From<StoredNotice> for Notice {
    fn from(stored: StoredNotice) -> Notice {
        let StoredNotice { code, channel, count, first_ray, message } = stored;
        Notice { code: code.into(), channel, count, first_ray, message }
    }
}

/// The artifact that holds all others.
pub const ZIP: &str = "model.zip";
