//! Why a job failed or an upload was refused, as it is stored and shown.

use pipeline::{Fault, Notice, Stage};
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// Why a job failed, as it is stored and as clients see it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Failure {
    /// Stable code: programs may depend on it.
    pub code: String,
    /// Short title of the kind of failure.
    pub title: String,
    /// What is wrong in this case.
    pub detail: String,
    /// Where the problem is: "byte 20", "options.hull.resolution".
    pub at: Option<String>,
    /// What the client or the operator can do about it.
    pub remedy: Option<String>,
}

impl Failure {
    /// The worker disappeared more often than a job may be begun.
    pub fn worker_lost(attempts: u32) -> Failure {
        Failure {
            code: "job.worker_lost".into(),
            title: "The worker process was lost".into(),
            detail: format!("The process that computed this job ended unexpectedly {attempts} times."),
            at: None,
            remedy: Some("Ask the operator to look at the log and the memory of the service; this job may need more memory than there is.".into()),
        }
    }

    /// The computation panicked.
    pub fn panicked() -> Failure {
        Failure { code: "job.panicked".into(), ..Failure::internal() }
    }

    /// The failure of an error in the service itself; its details are in the log, not here.
    pub fn internal() -> Failure {
        Failure {
            code: "run.internal".into(),
            title: "The computation failed because of an internal error".into(),
            detail: "An error in the service itself stopped the computation of this job; the log of the service has the details.".into(),
            at: None,
            remedy: Some("Report this with the id of the job, and with its ray sets if you can share them.".into()),
        }
    }

    /// A store did not give the bytes that a job needs, at any attempt.
    pub fn store_away() -> Failure {
        Failure {
            code: "bytes.unreadable".into(),
            title: "The stored bytes could not be read".into(),
            detail: "The storage of the service did not answer while this job read its input.".into(),
            at: None,
            remedy: Some("Submit the job again later; the log of the service has the answer of the storage.".into()),
        }
    }

    /// The store no longer has the bytes of `whose`.
    pub fn blob_missing(whose: &str) -> Failure {
        Failure {
            code: "storage.blob_missing".into(),
            title: "Stored bytes are missing".into(),
            detail: format!("The storage of the service no longer has the bytes of {whose}."),
            at: None,
            remedy: Some(
                "Upload the file again and submit a new job. Tell the operator: the log of the service names the missing blob.".into(),
            ),
        }
    }

    /// The store has fewer bytes of `whose` than it took in.
    pub fn blob_damaged(whose: &str) -> Failure {
        Failure {
            code: "storage.blob_damaged".into(),
            title: "Stored bytes are damaged".into(),
            detail: format!("The storage of the service has fewer bytes of {whose} than were uploaded."),
            ..Failure::blob_missing(whose)
        }
    }

    /// The failure of a computation that was stopped before its end.
    pub fn stopped() -> Failure {
        Failure {
            code: pipeline::Error::Cancelled.code().into(),
            title: "The job was stopped".into(),
            detail: "The computation was stopped before its end.".into(),
            at: None,
            remedy: Some("Submit the job again.".into()),
        }
    }

    /// An attempt took longer than it may.
    pub fn timed_out(longest: Duration, stage: Option<Stage>) -> Failure {
        let stage =
            stage.map_or("before its first stage".to_owned(), |stage| format!("in the stage {:?}", stage.name()));
        Failure {
            code: "job.timeout".into(),
            title: "The job took too long".into(),
            detail: format!("The job was stopped {stage} after {} s, its time limit.", longest.as_secs_f64()),
            at: Some("timeout_s".into()),
            remedy: Some(
                "Submit the job with a larger timeout_s, up to the limit of the service; use fewer rays, a lower hull.resolution, fewer zones or fewer bands; or ask the operator to raise serve --job-timeout."
                    .into(),
            ),
        }
    }

    /// The failure of a job that was queued when the service had more memory.
    pub fn too_large(limit_bytes: u64) -> Failure {
        Failure {
            code: "job.too_large".into(),
            title: "The job needs too much memory".into(),
            detail: format!("The job needs more than {} MiB of memory, the present limit for all jobs of one process together.", limit_bytes >> 20),
            at: Some("options".into()),
            remedy: Some(
                "Choose a lower hull.resolution, fewer goniogram.zones, wider goniogram steps or fewer rays.band_edges_nm; or ask the operator to raise serve --memory."
                    .into(),
            ),
        }
    }

    /// The store had no room for what was computed.
    pub fn store_full() -> Failure {
        Failure {
            code: "storage.full".into(),
            title: "The storage is full".into(),
            detail: "The storage of the service had no space for the artifacts of this job.".into(),
            at: None,
            remedy: Some("Delete jobs and ray sets that you do not need, or ask the operator for more storage space; then submit the job again.".into()),
        }
    }

    /// A stored job that this version cannot read.
    pub fn unreadable_job() -> Failure {
        Failure {
            code: "job.unreadable".into(),
            title: "The stored job cannot be read".into(),
            detail: "An earlier version of the service stored this job in a form that this version cannot read.".into(),
            at: None,
            remedy: Some("Submit the job again.".into()),
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

/// A notice about data that was repaired, dropped or unusual.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[schema(as = Notice)]
pub struct StoredNotice {
    /// Stable code: programs may depend on it.
    pub code: String,
    /// Name of the channel that the notice is about; null if it is about the whole source.
    #[serde(default)]
    #[schema(required)]
    pub channel: Option<String>,
    /// How often it occurred.
    pub count: u64,
    /// Index of the first affected ray, from 0; null if no single ray is affected.
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

/// Why an upload was refused, as it is stored and as clients see it: the problem that a single request with the same file would
/// have been answered with.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Refusal {
    /// `urn:lampwright:problem:<code>`.
    #[serde(rename = "type")]
    pub kind: String,
    /// Short title of the kind of problem.
    pub title: String,
    /// The HTTP status.
    pub status: u16,
    /// What is wrong in this case.
    pub detail: String,
    /// Stable code: programs may depend on it.
    pub code: String,
    /// Where the problem is: "byte 20", a path in the body.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub at: Option<String>,
    /// What the client or the operator can do about it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub remedy: Option<String>,
}
