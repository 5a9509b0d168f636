//! Claims the next job of the queue. Tenants take turns: next is the tenant with the fewest running jobs, and among those the one
//! that was served longest ago; its jobs are ordered by priority, then by age. If that job does not fit into the free memory of
//! this process, the slot waits for it: smaller jobs do not overtake it, so that it starts at last. Jobs that never fit this
//! process are left to other processes.

use super::memory_budget::needed;
use super::queue::{Claim, Queue};
use crate::storage::records::statement::{Statement, sql};
use crate::{crash, storage};
use std::time::Duration;
use tokio::time::sleep;

/// How often, and after which pause, a slot looks again while others are at the tenant whose turn it is.
const LOOKS: u32 = 20;
const PAUSE: Duration = Duration::from_millis(5);

/// Tenants that have a job for this process and may run one more: $1 is its memory, $2 its threads, $3 how many jobs a tenant
/// without a quota of its own may run. Asked tenant by tenant: `EXISTS` would be, without statistics, a scan of all that waits.
macro_rules! servable {
    ($before:literal, $after:literal) => {
        concat!(
            $before,
            "SELECT fair.id FROM tenants fair WHERE (SELECT jobs.id FROM jobs WHERE jobs.tenant = fair.id \
             AND jobs.state = 'queued' AND COALESCE(jobs.lease_until_ms, 0) <= {now} AND ",
            needed!("$2"),
            " <= $1 ORDER BY jobs.priority, jobs.id LIMIT 1) IS NOT NULL \
             AND (SELECT COUNT(*) FROM jobs WHERE jobs.tenant = fair.id AND jobs.state = 'running') \
             < COALESCE(fair.running_jobs, $3) ",
            $after
        )
    };
}

const LOOK: &str = servable!("", "LIMIT 1");
/// The tenant whose turn it is. Locks the row of the tenant, so that no other process starts a job of it before this transaction
/// ends.
const SERVE: &str = servable!(
    "UPDATE tenants SET served_ms = {now} WHERE id = (",
    "ORDER BY (SELECT COUNT(*) FROM jobs WHERE jobs.tenant = fair.id AND jobs.state = 'running'), \
     fair.served_ms, fair.id LIMIT 1 {skip_locked}) RETURNING id, COALESCE(running_jobs, $3) AS running_jobs"
);

/// The first of $3's line that fits $4 bytes on $5 threads, while fewer than $6 of its jobs run. Another process may have begun
/// one since that was looked at: they are counted again, with the tenant's row at hand.
const TAKE: &str = concat!(
    "UPDATE jobs SET state = 'running', attempt = attempt + 1, fence = fence + 1, lease_owner = $1, \
     lease_until_ms = {now} + $2, stage = NULL, stage_progress = 0, started_ms = {now} \
     WHERE id = (SELECT jobs.id FROM jobs WHERE jobs.tenant = $3 AND jobs.state = 'queued' \
     AND COALESCE(jobs.lease_until_ms, 0) <= {now} AND ",
    needed!("$5"),
    " <= $4 AND (SELECT COUNT(*) FROM jobs run WHERE run.tenant = $3 AND run.state = 'running') < $6 \
     ORDER BY jobs.priority, jobs.id LIMIT 1 {skip_locked}) \
     RETURNING id, fence, attempt, options, evaluation, timeout_ms, ",
    needed!("$5"),
    " AS needed_bytes"
);
const TOO_LARGE: &str =
    concat!("SELECT COUNT(*) AS jobs FROM jobs WHERE jobs.state = 'queued' AND ", needed!("$2"), " > $1");

/// Result of one attempt to claim a job.
enum Tried {
    Taken(Claim),
    /// The next job does not fit into the free memory.
    Full,
    /// There is no job, or another process was faster.
    Busy,
}

impl Queue {
    /// Claims the next job, after putting back the jobs of lost workers; `None` if there is no job for this process now.
    ///
    /// # Errors
    /// The database did not answer.
    pub async fn claim(&self) -> Result<Option<Claim>, storage::Error> {
        self.sweep().await?;
        let _turn = self.memory.turn().await;
        for _ in 0..LOOKS {
            if self.storage.records.read_one(self.servable(LOOK)).await?.is_none() {
                self.memory.nobody_waits();
                return Ok(None);
            }
            match self.try_claim().await? {
                Tried::Taken(claim) => return Ok(Some(claim)),
                Tried::Full => return Ok(None),
                Tried::Busy => sleep(PAUSE).await,
            }
        }
        Ok(None)
    }

    /// Waiting jobs that need more memory than this process has: it can never begin them.
    ///
    /// # Errors
    /// The database did not answer.
    pub async fn too_large(&self) -> Result<u64, storage::Error> {
        let row = self.storage.records.read_one(self.machine(sql(TOO_LARGE))).await?;
        row.map_or(Ok(0), |row| row.count("jobs"))
    }

    /// The next two values are this process's: memory, bytes; threads of a job.
    pub(super) fn machine(&self, statement: Statement) -> Statement {
        let statement = statement.bind(i64::try_from(self.memory.limit_bytes()).unwrap_or(i64::MAX));
        statement.bind(i64::try_from(self.threads).unwrap_or(i64::MAX))
    }

    fn servable(&self, text: &'static str) -> Statement {
        self.machine(sql(text)).bind(i64::try_from(self.quota.running_jobs).unwrap_or(i64::MAX))
    }

    async fn try_claim(&self) -> Result<Tried, storage::Error> {
        let mut transaction = self.storage.records.begin().await?;
        let rows = transaction.read(self.servable(SERVE)).await?;
        let Some(served) = rows.first() else {
            transaction.rollback().await?;
            return Ok(Tried::Busy);
        };
        let (tenant, most) = (served.text("id")?, served.number("running_jobs")?);
        let take = sql(TAKE).bind(self.owner.as_str()).bind(self.lease_ms).bind(tenant.as_str());
        let take = self.machine(take).bind(most);
        let rows = transaction.read(take).await?;
        let Some(row) = rows.first() else {
            transaction.rollback().await?;
            return Ok(Tried::Busy);
        };
        let Some(memory) = self.memory.reserve(row.count("needed_bytes")?) else {
            transaction.rollback().await?;
            return Ok(Tried::Full);
        };
        let id = row.text("id")?;
        let change = self.change(&tenant, &id);
        transaction.commit().await?;
        drop(change);
        crash::point("claim.committed");
        let timeout_ms = row.optional_number("timeout_ms")?.map(|ms| Duration::from_millis(ms.max(0).unsigned_abs()));
        Ok(Tried::Taken(Claim {
            id,
            tenant,
            fence: row.number("fence")?,
            attempt: row.number("attempt")?,
            options: row.text("options")?,
            evaluation: row.optional_text("evaluation")?,
            timeout: timeout_ms.unwrap_or(self.longest).min(self.longest),
            memory,
        }))
    }
}
