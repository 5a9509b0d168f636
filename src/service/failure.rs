//! Why a job failed or an upload was refused, as it is stored and shown.

use pipeline::{Fault, Notice, Stage};
use serde::{Deserialize, Serialize};
use std::time::Duration;

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

/// Why an upload was refused, as stored with it and told to whoever asks for it: the words and the status of the answer that a
/// single request would have got.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Refusal {
    /// `urn:lampwright:problem:<code>`.
    #[serde(rename = "type")]
    pub kind: String,
    /// The kind of problem, for a person.
    pub title: String,
    /// The HTTP status.
    pub status: u16,
    /// What was found.
    pub detail: String,
    /// Stable: programs may depend on it.
    pub code: String,
    /// Where: "byte 20", a path in the body.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub at: Option<String>,
    /// What to do.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub remedy: Option<String>,
}
