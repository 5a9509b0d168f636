//! Deletes what is kept no longer: rows first, then blobs, the way a client would. Off unless the operator says how long, but
//! for the keys of requests, which are kept for a day.

use crate::config::Retention;
use crate::jobs;
use crate::jobs::queue::Queue;
use crate::ray_sets::rows;
use crate::ray_sets::rows::Deletion;
use crate::storage::Storage;
use crate::storage::error::Error;
use crate::storage::records::statement::{Row, Statement, ms, sql};
use std::time::Duration;
use tokio::time::{MissedTickBehavior, interval};

/// Rows looked at in one go.
const BATCH: i64 = 100;

/// What was deleted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Deleted {
    /// Ended jobs, with their artifacts.
    pub jobs: u64,
    /// Ray sets.
    pub ray_sets: u64,
}

/// Deletes ended jobs and unused ray sets that are older than `retention` keeps them. Right in any number of processes at once.
///
/// # Errors
/// A store did not answer. Blobs whose rows are gone are garbage, which is collected.
pub async fn enforce(storage: &Storage, queue: &Queue, retention: &Retention) -> Result<Deleted, Error> {
    let mut deleted = Deleted::default();
    while queue.delete_old_keys().await? > 0 {}
    if let Some(age) = retention.jobs {
        for (tenant, id) in every(storage, ended(age)).await? {
            match queue.delete_unused(&tenant, &id, age).await {
                Ok(()) => deleted.jobs += 1,
                // Somebody else was here, or asked for it again.
                Err(jobs::error::Error::Missing(_) | jobs::error::Error::State(_)) => {}
                Err(jobs::error::Error::Storage(error)) => return Err(error),
                Err(error) => return Err(Error::fault(error)),
            }
        }
    }
    if let Some(age) = retention.ray_sets {
        for (tenant, id) in every(storage, unused(age)).await? {
            if let Deletion::Deleted(folders) = rows::delete(&storage.records, &tenant, &id).await? {
                storage.blobs.delete_folders(&folders).await?;
                deleted.ray_sets += 1;
            }
        }
    }
    Ok(deleted)
}

/// Enforces `retention` again and again.
pub async fn keep_up(storage: Storage, queue: Queue, retention: Retention) {
    let mut ticker = interval(retention.every);
    ticker.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        ticker.tick().await;
        match enforce(&storage, &queue, &retention).await {
            Ok(deleted) if deleted == Deleted::default() => {}
            Ok(Deleted { jobs, ray_sets }) => {
                tracing::info!(jobs, ray_sets, "deleted jobs and ray sets whose retention time is over")
            }
            Err(error) => {
                tracing::warn!(%error, "cannot delete jobs and ray sets whose retention time is over; trying again later")
            }
        }
    }
}

/// Tenant and id of the oldest that may go.
async fn every(storage: &Storage, select: Statement) -> Result<Vec<(String, String)>, Error> {
    let named = |row: &Row| Ok((row.text("tenant")?, row.text("id")?));
    storage.records.read(select).await?.iter().map(named).collect()
}

fn ended(age: Duration) -> Statement {
    let select = "SELECT tenant, id FROM jobs WHERE state IN ('succeeded', 'failed', 'cancelled') \
                  AND finished_ms <= {now} - $1 AND COALESCE(used_ms, 0) <= {now} - $1 ORDER BY finished_ms LIMIT $2";
    sql(select).bind(ms(age)).bind(BATCH)
}

/// A ray set is used when it comes and when a job is queued for it, or asked for again.
fn unused(age: Duration) -> Statement {
    let select = "SELECT tenant, id FROM ray_sets WHERE created_ms <= {now} - $1 AND NOT EXISTS \
                  (SELECT 1 FROM job_inputs JOIN jobs ON jobs.id = job_inputs.job_id \
                   WHERE job_inputs.ray_set_id = ray_sets.id \
                   AND (jobs.state IN ('queued', 'running') OR jobs.created_ms > {now} - $1 OR COALESCE(jobs.used_ms, 0) > {now} - $1)) ORDER BY id LIMIT $2";
    sql(select).bind(ms(age)).bind(BATCH)
}
