//! What a request is answered when a store, a file or the service itself is at fault: by [`Cause`], which alone tells them apart.

use super::Problem;
use crate::cause::{Cause, stored};
use crate::failure::Failure;
use crate::storage;
use axum::http::StatusCode;

impl From<storage::Error> for Problem {
    fn from(error: storage::Error) -> Problem {
        Problem::from(&error)
    }
}

impl From<&storage::Error> for Problem {
    fn from(error: &storage::Error) -> Problem {
        match Cause::from(error) {
            Cause::StoreDamaged => {
                tracing::error!(%error, "the object store has lost a blob that the database names");
                Problem::of(StatusCode::INTERNAL_SERVER_ERROR, Failure::from(error))
            }
            Cause::Ours => {
                tracing::error!(%error, "an internal error of the service");
                Problem::internal()
            }
            Cause::StoreAway | Cause::Input | Cause::Stopped => {
                tracing::error!(%error, "the database or the object store failed");
                if matches!(error, storage::Error::Full) { Problem::store_full() } else { Problem::store_away() }
            }
        }
    }
}

impl From<pipeline::Error> for Problem {
    fn from(error: pipeline::Error) -> Problem {
        match Cause::from(&error) {
            Cause::Input if matches!(error, pipeline::Error::Malformed(_)) => {
                Problem::of(StatusCode::BAD_REQUEST, Failure::from(&error))
            }
            Cause::Input => Problem::of(StatusCode::UNPROCESSABLE_ENTITY, Failure::from(&error)),
            Cause::Stopped => Problem::of(StatusCode::INTERNAL_SERVER_ERROR, Failure::from(&error)),
            Cause::StoreAway | Cause::StoreDamaged => stored(&error).map_or_else(
                || {
                    tracing::error!(%error, "the database or the object store failed");
                    Problem::store_away()
                },
                Problem::from,
            ),
            Cause::Ours => {
                tracing::error!(%error, "an internal error of the service");
                Problem::internal()
            }
        }
    }
}

impl Problem {
    fn store_full() -> Problem {
        let detail = "The storage of the service has no space left.";
        Problem::new(StatusCode::INSUFFICIENT_STORAGE, "storage.full", "The storage is full", detail)
            .remedy("Delete jobs and ray sets that you do not need, or ask the operator for more storage space.")
    }

    fn store_away() -> Problem {
        let detail = "The database or the object store of the service does not answer.";
        Problem::new(StatusCode::SERVICE_UNAVAILABLE, "storage.unavailable", "The store does not answer", detail)
            .remedy("Try again after the time in Retry-After.")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::jobs::queue;
    use crate::ray_sets;
    use crate::ray_sets::fetch;
    use crate::storage::error::Unusable;
    use std::io;
    use std::path::PathBuf;

    /// What no client may read: a path, SQL, and words of libraries and of the system.
    const INSIDE: [&str; 16] = [
        "/srv",
        "/tmp",
        "SELECT",
        "INSERT",
        "jobs.tenant",
        "sqlx",
        "SQLite",
        "sqlite",
        "object_store",
        "Object at",
        "S3",
        "http://",
        "os error",
        "panicked at",
        "thread",
        "rs:",
    ];

    fn dirty() -> String {
        "sqlx: SQLite code 11 in SELECT * FROM jobs.tenant; INSERT; object_store: Object at location /srv/data/x, /tmp/y: S3 \
         http://10.0.0.1/b (os error 13); thread 'pipeline-0' panicked at src/lib.rs:7"
            .to_owned()
    }

    /// One of every error of a store. A new one is a reason to extend this list.
    fn of_stores() -> Vec<storage::Error> {
        use storage::Error;
        let (key, path) =
            ("ray-sets/01890000-0000-7000-8000-000000000000/000000", PathBuf::from("/srv/data/service.db"));
        let all = vec![
            Error::Records(dirty().into()),
            Error::Blobs(dirty().into()),
            Error::Full,
            Error::MissingBlob(key.into()),
            Error::MissingBlob("/srv/data/other".into()),
            Error::DamagedBlob { blob: key.into(), found: 1, expected: 2 },
            Error::Fault(dirty().into()),
            Error::Unsupported(dirty(), "Write another."),
            Error::Unusable(Unusable::NotADatabase(path)),
        ];
        for error in &all {
            match error {
                Error::Records(_)
                | Error::Blobs(_)
                | Error::Full
                | Error::MissingBlob(_)
                | Error::DamagedBlob { .. } => {}
                Error::Fault(_) | Error::Unsupported(..) | Error::Unusable(_) => {}
            }
        }
        all
    }

    /// Every error of the pipeline that is not the input's.
    fn of_the_pipeline() -> Vec<pipeline::Error> {
        let stores = of_stores().into_iter().map(|error| pipeline::Error::Unreadable(io::Error::other(error)));
        let others = [
            pipeline::Error::Unreadable(io::Error::other(dirty())),
            pipeline::Error::Unreadable(io::Error::from_raw_os_error(13)),
            pipeline::Error::Unreadable(io::ErrorKind::UnexpectedEof.into()),
            pipeline::Error::Internal(dirty()),
            pipeline::Error::Cancelled,
        ];
        stores.chain(others).collect()
    }

    fn clean(told: &str) {
        for word in INSIDE {
            assert!(!told.contains(word), "{word} in {told}");
        }
    }

    #[test]
    fn no_answer_tells_of_our_insides() {
        let mut problems: Vec<Problem> = of_stores().into_iter().map(Problem::from).collect();
        problems.extend(of_the_pipeline().into_iter().map(Problem::from));
        problems.extend(of_the_pipeline().into_iter().map(|error| Problem::from(ray_sets::Error::Packed(error))));
        problems.extend(of_stores().into_iter().map(|error| Problem::from(ray_sets::Error::Storage(error))));
        problems.extend(of_stores().into_iter().map(|error| Problem::from(queue::Error::Storage(error))));
        problems.extend(of_stores().into_iter().map(|error| Problem::from(fetch::Error::Storage(error))));
        problems.push(Problem::from(ray_sets::Error::Truncated(dirty())));
        problems.push(Problem::from(ray_sets::Error::Broken(dirty())));
        assert!(problems.len() > 60);
        for problem in problems {
            clean(&serde_json::to_string(&problem).unwrap());
        }
    }

    #[test]
    fn no_failure_of_a_job_tells_of_our_insides() {
        let failures = of_the_pipeline().iter().map(Failure::from).collect::<Vec<_>>();
        let fixed = [Failure::panicked(), Failure::unreadable_job(), Failure::worker_lost(3), Failure::store_full()];
        for failure in failures.into_iter().chain(fixed) {
            clean(&serde_json::to_string(&failure).unwrap());
            assert!(failure.remedy.is_some() && failure.code.contains('.'), "{failure:?}");
        }
    }

    #[test]
    fn what_another_attempt_can_mend_is_told_from_what_it_cannot() {
        let causes = of_stores().iter().map(Cause::from).collect::<Vec<_>>();
        let (away, damaged, ours) = (Cause::StoreAway, Cause::StoreDamaged, Cause::Ours);
        assert_eq!(causes, [away, away, away, damaged, damaged, damaged, ours, ours, ours]);
        // What a store said is known again behind the pipeline's back.
        let read = of_the_pipeline().iter().map(Cause::from).collect::<Vec<_>>();
        assert_eq!(read[..9], causes);
        assert_eq!(read[9..], [away, away, away, ours, Cause::Stopped]);
    }
}
