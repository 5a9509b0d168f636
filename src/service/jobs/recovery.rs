//! Recovery of jobs whose worker was lost, and of jobs that no worker can start.

use super::memory_budget::needed;
use super::queue::{Queue, json};
use crate::failure::Failure;
use crate::storage;
use crate::storage::records::statement::sql;

impl Queue {
    /// Ends the lease of every running job: only right when no other process can be running any.
    ///
    /// # Errors
    /// The database did not answer.
    pub async fn recover(&self) -> Result<(), storage::Error> {
        self.storage.records.write(sql("UPDATE jobs SET lease_until_ms = 0 WHERE state = 'running'")).await?;
        self.sweep().await
    }

    /// Fails waiting jobs that need more memory than this process has: only right when no other process can begin them.
    ///
    /// # Errors
    /// The database did not answer.
    pub async fn give_up(&self) -> Result<(), storage::Error> {
        let give_up = concat!(
            "UPDATE jobs SET state = 'failed', failure = $1, finished_ms = {now}, lease_until_ms = NULL \
             WHERE jobs.state = 'queued' AND ",
            needed!("$3"),
            " > $2"
        );
        let failure = json(&Failure::too_large(self.memory.limit_bytes()))?;
        let failed = self.storage.records.write(self.machine(sql(give_up).bind(failure))).await?;
        if self.changed_some(failed) {
            tracing::warn!(jobs = failed, "jobs failed: they need more memory than this service has");
        }
        Ok(())
    }

    /// Puts jobs whose lease has ended back into the queue, except jobs of this process, whose worker may only have been slow to
    /// renew the lease. Also puts back jobs that this slot has claimed without knowing it, because the answer of the database was
    /// lost with the connection.
    pub(super) async fn sweep(&self) -> Result<(), storage::Error> {
        let sweep = "UPDATE jobs SET \
                     state = CASE WHEN cancel_requested = 1 THEN 'cancelled' WHEN attempt >= max_attempts \
                             THEN 'failed' ELSE 'queued' END, \
                     failure = CASE WHEN cancel_requested = 0 AND attempt >= max_attempts THEN $1 END, \
                     finished_ms = CASE WHEN cancel_requested = 1 OR attempt >= max_attempts THEN {now} END, \
                     lease_owner = NULL, lease_until_ms = NULL, stage = NULL, stage_progress = 0 \
                     WHERE id IN (SELECT id FROM jobs WHERE state = 'running' AND (lease_owner = $2 \
                     OR (lease_until_ms < {now} AND lease_owner NOT LIKE $3)) {skip_locked})";
        let sweep = sql(sweep).bind(json(&Failure::worker_lost(self.max_attempts))?).bind(self.owner.as_str());
        let swept = self.storage.records.write(sweep.bind(format!("{}.%", self.process))).await?;
        if self.changed_some(swept) {
            self.metrics.leases_lost(swept);
            tracing::warn!(jobs = swept, "jobs of lost workers were put back into the queue");
        }
        Ok(())
    }
}
