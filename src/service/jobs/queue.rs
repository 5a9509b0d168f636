//! Every change of a job's state, one statement each; the first two are in `submit.rs` and `claim.rs`, the automatic ones in
//! `recovery.rs`. A job is started at least once and published exactly once: every statement of a worker names the fence of its
//! claim, and if it changes no row, the lease was lost and the result is dropped.

pub use super::error::Error;
use super::estimate::{JobPlan, plan};
use super::memory_budget::{Memory, MemoryReservation};
use super::query::StoredArtifact;
use super::recent::Recent;
use super::request::NewJob;
use super::{outbox, query};
use crate::accounts::quota::Quota;
use crate::failure::{Failure, StoredNotice};
use crate::metrics::Metrics;
use crate::storage::Storage;
use crate::storage::keys::{job_folder, new_id};
use crate::storage::records::statement::{ms, sql};
use crate::{crash, storage};
use sha2::{Digest, Sha256};
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::{Notify, watch};

/// The back-off after a store did not answer grows no further than 2⁶ times the first.
const MAX_DOUBLINGS: u32 = 6;

/// A job that this worker has claimed, until its lease ends.
#[derive(Clone, Debug, Default)]
pub struct Claim {
    /// Identifier of the job.
    pub id: String,
    /// Tenant of the job.
    pub tenant: String,
    /// Number of this claim, unique among all claims of the job: later statements name it, so that a lost lease is noticed.
    pub fence: i64,
    /// Number of attempts at the job, this one included.
    pub attempt: i64,
    /// Options of the job, as the JSON that is stored.
    pub options: String,
    /// What is evaluated, as the JSON that is stored, of an evaluation.
    pub evaluation: Option<String>,
    /// Time limit of this attempt.
    pub timeout: Duration,
    /// The memory that is reserved for the job in this process.
    pub memory: MemoryReservation,
}

impl Claim {
    /// Folder of the blobs that this attempt may write.
    pub fn folder(&self) -> String {
        format!("{}/{}", job_folder(&self.id), self.fence)
    }
}

/// What the worker of a job learns when it renews the lease.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lease {
    /// The lease is renewed: go on.
    Held,
    /// A client asked to cancel.
    CancelRequested,
    /// The lease belongs to another worker: stop, and keep nothing.
    Lost,
}

/// The queue as one process sees it. Cheap to clone.
#[derive(Clone)]
pub struct Queue {
    pub(super) storage: Storage,
    /// This process, by a name fresh per start: one that comes back would make a dead worker look alive.
    pub(super) process: String,
    /// Who claims here: a slot of this process, which has one job at a time.
    pub(super) owner: String,
    pub(super) lease_ms: i64,
    pub(super) max_attempts: u32,
    pub(super) quota: Quota,
    pub(super) memory: Memory,
    pub(super) longest: Duration,
    pub(super) threads: usize,
    pub(super) metrics: Metrics,
    pub(super) wake: Arc<Notify>,
    recent: Recent,
    changes: watch::Sender<()>,
}

/// A change of one job that this process is about to make. When this is dropped, whether the change was made or not, the job is
/// removed from the cache and the waiting clients are woken. It is made before the statement. Where a client goes away meanwhile,
/// the statement may still be carried out afterwards; the comparison at every poll finds that.
pub(super) struct Change<'a> {
    queue: &'a Queue,
    tenant: &'a str,
    id: &'a str,
    moves_line: bool,
}

impl Drop for Change<'_> {
    fn drop(&mut self) {
        self.queue.recent.invalidate(self.tenant, self.id);
        if self.moves_line {
            self.queue.recent.invalidate_waiting(self.tenant);
        }
        self.queue.changes.send_replace(());
    }
}

impl Queue {
    /// The queue in `storage`, for a process with a new name.
    pub fn new(storage: Storage, lease: Duration, max_attempts: u32) -> Queue {
        let process = new_id();
        let owner = format!("{process}.0");
        let metrics = Metrics::new();
        let recent = Recent::new(storage.records.clone(), false, Duration::ZERO);
        Queue {
            recent,
            storage,
            process,
            owner,
            lease_ms: ms(lease),
            max_attempts,
            quota: Quota::default(),
            memory: Memory::new(u64::MAX, metrics.clone()),
            longest: Duration::MAX,
            threads: 1,
            metrics,
            wake: Arc::new(Notify::new()),
            changes: watch::Sender::default(),
        }
    }

    /// The same queue, in which a tenant without a quota of its own has this one, and what happens is counted here.
    #[must_use]
    pub fn bounded(self, quota: Quota, metrics: Metrics) -> Queue {
        Queue { quota, metrics, ..self }
    }

    /// The same queue, of which this process computes what fits its `memory`, each job on `threads` threads, and no attempt
    /// for longer than `longest`.
    #[must_use]
    pub fn within(self, memory: Memory, threads: usize, longest: Duration) -> Queue {
        Queue { memory, threads, longest, ..self }
    }

    /// The same queue, whose changes are known to `recent`.
    #[must_use]
    pub fn remembered(self, recent: Recent) -> Queue {
        Queue { recent, ..self }
    }

    /// Jobs that were asked for lately.
    pub fn recent(&self) -> &Recent {
        &self.recent
    }

    /// Checks and estimates a job that `tenant` requests.
    ///
    /// # Errors
    /// As [`plan`](super::estimate::plan).
    pub async fn plan(&self, tenant: &str, new: &NewJob) -> Result<JobPlan, Error> {
        plan(&self.storage.records, tenant, new, self.threads).await
    }

    /// The memory budget for all jobs of this process.
    pub fn memory(&self) -> &Memory {
        &self.memory
    }

    /// Time limit of every attempt.
    pub fn longest(&self) -> Duration {
        self.longest
    }

    /// Wakes a waiting slot of this process, which then looks for a job.
    pub fn nudge(&self) {
        self.wake.notify_one();
    }

    /// The queue as slot `slot` of this process sees it. A slot asks for a job only when it has none.
    #[must_use]
    pub fn of_slot(&self, slot: usize) -> Queue {
        Queue { owner: format!("{}.{slot}", self.process), ..self.clone() }
    }

    /// Resolves when a job may be ready in this process; another process's are found by polling.
    pub async fn woken(&self) {
        self.wake.notified().await;
    }

    /// Marked whenever this process may have changed a job; another process's changes are found by polling.
    pub fn changes(&self) -> watch::Receiver<()> {
        self.changes.subscribe()
    }

    /// The job `id` of `tenant` is about to change.
    pub(super) fn change<'a>(&'a self, tenant: &'a str, id: &'a str) -> Change<'a> {
        Change { queue: self, tenant, id, moves_line: true }
    }

    /// This process has changed so many jobs, whose names it does not know.
    pub(super) fn changed_some(&self, count: u64) -> bool {
        if count > 0 {
            self.recent.invalidate_all();
            self.changes.send_replace(());
        }
        count > 0
    }

    /// Renews the lease of a claimed job, stores its progress, and returns whether the job is to be cancelled.
    ///
    /// # Errors
    /// The database did not answer.
    pub async fn renew_lease(
        &self,
        claim: &Claim,
        stage: Option<&str>,
        progress: f64,
    ) -> Result<Lease, storage::Error> {
        let renew = "UPDATE jobs SET lease_until_ms = {now} + $1, stage = $2, stage_progress = $3 \
                    WHERE id = $4 AND fence = $5 AND state = 'running' RETURNING cancel_requested";
        let renew = sql(renew).bind(self.lease_ms).bind(stage).bind(progress);
        // Nobody's place in the line is another for it.
        let _change = Change { queue: self, tenant: &claim.tenant, id: &claim.id, moves_line: false };
        let mut transaction = self.storage.records.begin().await?;
        let rows = transaction.read(renew.bind(claim.id.as_str()).bind(claim.fence)).await?;
        transaction.commit().await?;
        match rows.first() {
            None => Ok(Lease::Lost),
            Some(row) if row.number("cancel_requested")? != 0 => Ok(Lease::CancelRequested),
            Some(_) => Ok(Lease::Held),
        }
    }

    /// Publishes a result: its artifacts become visible and the job succeeds, together. False when the lease was lost or a
    /// cancellation came first.
    ///
    /// # Errors
    /// The database did not answer: it may or may not be so, and asking again is right.
    pub async fn finish(
        &self,
        claim: &Claim,
        artifacts: &[StoredArtifact],
        notices: &[StoredNotice],
    ) -> Result<bool, storage::Error> {
        let _change = self.change(&claim.tenant, &claim.id);
        let mut transaction = self.storage.records.begin().await?;
        let finish = "UPDATE jobs SET state = 'succeeded', notices = $1, stage = 'artifacts', stage_progress = 1, \
                      lease_owner = NULL, lease_until_ms = NULL, finished_ms = {now} \
                      WHERE id = $2 AND fence = $3 AND state = 'running' AND cancel_requested = 0";
        let finish = sql(finish).bind(json(notices)?).bind(claim.id.as_str()).bind(claim.fence);
        if transaction.write(finish).await? == 0 {
            transaction.rollback().await?;
            return self.finished_before(claim).await;
        }
        for (position, artifact) in artifacts.iter().enumerate() {
            let insert = "INSERT INTO artifacts (job_id, position, name, media_type, byte_count, sha256, blob) \
                          VALUES ($1, $2, $3, $4, $5, $6, $7)";
            let insert = sql(insert).bind(claim.id.as_str()).bind(position as i64).bind(artifact.name.as_str());
            let insert = insert.bind(artifact.media_type.as_str()).bind(artifact.byte_count.cast_signed());
            transaction.write(insert.bind(artifact.sha256.as_str()).bind(artifact.blob.as_str())).await?;
        }
        crash::point("finish.before_commit");
        transaction.commit().await?;
        crash::point("finish.committed");
        Ok(true)
    }

    /// True when this very claim was finished by a call whose answer was lost.
    async fn finished_before(&self, claim: &Claim) -> Result<bool, storage::Error> {
        let select = sql("SELECT id FROM jobs WHERE id = $1 AND fence = $2 AND state = 'succeeded'");
        let row = self.storage.records.read_one(select.bind(claim.id.as_str()).bind(claim.fence)).await?;
        Ok(row.is_some())
    }

    /// Ends a job without a result.
    ///
    /// # Errors
    /// The database did not answer.
    pub async fn fail(&self, claim: &Claim, failure: &Failure) -> Result<bool, storage::Error> {
        let fail = "UPDATE jobs SET state = 'failed', failure = $1, lease_owner = NULL, lease_until_ms = NULL, \
                    finished_ms = {now} WHERE id = $2 AND fence = $3 AND state = 'running'";
        let fail = sql(fail).bind(json(failure)?).bind(claim.id.as_str()).bind(claim.fence);
        let _change = self.change(&claim.tenant, &claim.id);
        Ok(self.storage.records.write(fail).await? > 0)
    }

    /// Puts a running job back for a later attempt: a store did not answer, and the job is not at fault. No worker takes it before
    /// its [`back_off_ms`] is over. False when it had its last attempt, or the lease was lost.
    ///
    /// # Errors
    /// The database did not answer.
    pub async fn retry(&self, claim: &Claim) -> Result<bool, storage::Error> {
        let retry = "UPDATE jobs SET state = CASE WHEN cancel_requested = 1 THEN 'cancelled' ELSE 'queued' END, \
                     finished_ms = CASE WHEN cancel_requested = 1 THEN {now} END, \
                     lease_until_ms = CASE WHEN cancel_requested = 0 THEN {now} + $1 END, \
                     lease_owner = NULL, stage = NULL, stage_progress = 0 \
                     WHERE id = $2 AND fence = $3 AND state = 'running' \
                     AND (attempt < max_attempts OR cancel_requested = 1)";
        let retry = sql(retry).bind(back_off_ms(self.lease_ms, claim)).bind(claim.id.as_str()).bind(claim.fence);
        let _change = self.change(&claim.tenant, &claim.id);
        Ok(self.storage.records.write(retry).await? > 0)
    }

    /// Ends a running job that a client asked to cancel.
    ///
    /// # Errors
    /// The database did not answer.
    pub async fn stop(&self, claim: &Claim) -> Result<bool, storage::Error> {
        let stop = "UPDATE jobs SET state = 'cancelled', lease_owner = NULL, lease_until_ms = NULL, \
                    finished_ms = {now} WHERE id = $1 AND fence = $2 AND state = 'running' AND cancel_requested = 1";
        let _change = self.change(&claim.tenant, &claim.id);
        Ok(self.storage.records.write(sql(stop).bind(claim.id.as_str()).bind(claim.fence)).await? > 0)
    }

    /// Gives a running job back untried: this process stops, and the job is not at fault.
    ///
    /// # Errors
    /// The database did not answer.
    pub async fn release(&self, claim: &Claim) -> Result<bool, storage::Error> {
        let release = "UPDATE jobs SET state = CASE WHEN cancel_requested = 1 THEN 'cancelled' ELSE 'queued' END, \
                       finished_ms = CASE WHEN cancel_requested = 1 THEN {now} END, attempt = attempt - 1, \
                       lease_owner = NULL, lease_until_ms = NULL, stage = NULL, stage_progress = 0 \
                       WHERE id = $1 AND fence = $2 AND state = 'running'";
        let _change = self.change(&claim.tenant, &claim.id);
        Ok(self.storage.records.write(sql(release).bind(claim.id.as_str()).bind(claim.fence)).await? > 0)
    }

    /// Asks to cancel: a queued job ends at once, a running one at its worker's next renewal of its lease.
    ///
    /// # Errors
    /// [`Error::Missing`]; [`Error::State`] when it has ended; [`Error::Storage`].
    pub async fn cancel(&self, tenant: &str, id: &str) -> Result<(), Error> {
        let cancel = "UPDATE jobs SET cancel_requested = 1, \
                      finished_ms = CASE state WHEN 'queued' THEN {now} ELSE finished_ms END, \
                      lease_until_ms = CASE state WHEN 'queued' THEN NULL ELSE lease_until_ms END, \
                      state = CASE state WHEN 'queued' THEN 'cancelled' ELSE state END \
                      WHERE tenant = $1 AND id = $2 AND state IN ('queued', 'running')";
        let _change = self.change(tenant, id);
        if self.storage.records.write(sql(cancel).bind(tenant).bind(id)).await? > 0 {
            return Ok(());
        }
        Err(self.refusal(tenant, id).await?)
    }

    /// Deletes an ended job: announces its end if that is not done, then deletes its rows, then its blobs.
    ///
    /// # Errors
    /// [`Error::Missing`]; [`Error::State`] when it has not ended; [`Error::Storage`].
    pub async fn delete(&self, tenant: &str, id: &str) -> Result<(), Error> {
        self.delete_unused(tenant, id, Duration::ZERO).await
    }

    /// Deletes an ended job as [`Queue::delete`] does, unless a client asked for its result again within `age`.
    ///
    /// # Errors
    /// As [`Queue::delete`]; [`Error::State`] when it was used.
    pub async fn delete_unused(&self, tenant: &str, id: &str, age: Duration) -> Result<(), Error> {
        let delete = "DELETE FROM jobs WHERE tenant = $1 AND id = $2 AND state IN ('succeeded', 'failed', 'cancelled') \
                      AND ($3 = 0 OR COALESCE(used_ms, 0) <= {now} - $3)";
        let change = self.change(tenant, id);
        let mut transaction = self.storage.records.begin().await?;
        outbox::announce_one(&mut transaction, tenant, id).await?;
        let deleted = transaction.write(sql(delete).bind(tenant).bind(id).bind(ms(age))).await?;
        transaction.commit().await?;
        drop(change);
        if deleted == 0 {
            return Err(self.refusal(tenant, id).await?);
        }
        Ok(self.storage.blobs.delete_all(&job_folder(id)).await?)
    }

    async fn refusal(&self, tenant: &str, id: &str) -> Result<Error, storage::Error> {
        let job = query::get(&self.storage.records, tenant, id).await?;
        Ok(job.map_or_else(|| Error::Missing(id.to_owned()), |job| Error::State(job.state)))
    }
}

/// A third of a lease after the first attempt, twice as long after each next, and up to half as much again: what fell together
/// does not come back together. How much is the job's and the attempt's own, so that nothing random is needed.
fn back_off_ms(lease_ms: i64, claim: &Claim) -> i64 {
    let doublings = u32::try_from(claim.attempt - 1).unwrap_or(0).min(MAX_DOUBLINGS);
    let least_ms = (lease_ms / 3).saturating_mul(1 << doublings);
    let digest = Sha256::digest(format!("{} {}", claim.id, claim.attempt));
    let share = digest.iter().take(2).fold(0, |share, byte| share << 8 | i64::from(*byte));
    least_ms.saturating_add(least_ms / 2 * share / (1 << 16))
}

/// A value as the JSON that its row has.
///
/// # Errors
/// Never in practice: keys are text.
pub(super) fn json<T: serde::Serialize + ?Sized>(value: &T) -> Result<String, storage::Error> {
    serde_json::to_string(value).map_err(storage::Error::fault)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn jobs_that_fell_together_come_back_one_by_one() {
        let wait =
            |id: u32, attempt| back_off_ms(30_000, &Claim { id: format!("job {id}"), attempt, ..Claim::default() });
        for (attempt, least) in [(1, 10_000), (2, 20_000), (3, 40_000), (100, 640_000)] {
            let waits: Vec<i64> = (0..400).map(|id| wait(id, attempt)).collect();
            assert!(waits.iter().all(|wait| (least..least + least / 2).contains(wait)), "{attempt}");
            // Spread evenly over its half: in each tenth of it 40, give or take four of their deviations (6).
            for tenth in 0..10 {
                let from = least + least / 20 * tenth;
                let within = waits.iter().filter(|wait| (from..from + least / 20).contains(wait)).count();
                assert!((16..=64).contains(&within), "{within} in tenth {tenth} after attempt {attempt}");
            }
        }
        assert_eq!(wait(1, 1), wait(1, 1));
    }
}
