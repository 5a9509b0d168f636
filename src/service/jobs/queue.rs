//! Every change of a job's state, one statement each. At least once begun, exactly once published: a worker's write names
//! the fence its claim gave it, and zero rows changed means that the lease was lost and the result is nobody's.

use super::super::access::quota::{Exceeded, Quota};
use super::super::crash;
use super::super::metrics::Metrics;
use super::super::storage::records::sql;
use super::super::storage::{self, Storage, job_folder, new_id};
use super::super::webhooks::announcement;
use super::channels::{Channel, NewJob};
use super::query::{self, StoredArtifact};
use super::{Failure, State, StoredNotice};
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::{Notify, watch};

/// The back-off after a store did not answer grows no further than 2⁶ times the first.
const MAX_DOUBLINGS: u32 = 6;

/// Why a job cannot be changed so.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// There is no such job.
    #[error("there is no job {0}")]
    Missing(String),
    /// There is no such ray set.
    #[error("there is no ray set {0}")]
    MissingRaySet(String),
    /// There is no such spectrum.
    #[error("there is no spectrum {0}")]
    MissingSpectrum(String),
    /// The job is in a state from which this is not legal.
    #[error("the job is {}", .0.name())]
    State(State),
    /// The tenant has too many jobs waiting, or no room for what it would give.
    #[error(transparent)]
    Quota(#[from] Exceeded),
    /// A store did not answer.
    #[error(transparent)]
    Storage(#[from] storage::Error),
}

/// A job taken by this worker, until its lease ends.
#[derive(Clone, Debug)]
pub struct Claim {
    /// The job.
    pub id: String,
    /// Whose it is.
    pub tenant: String,
    /// Names this claim among all of the job's.
    pub fence: i64,
    /// How often it was begun, this time included.
    pub attempt: i64,
    /// The client's choice, as stored.
    pub options: String,
}

impl Claim {
    /// Where this attempt may write blobs.
    pub fn folder(&self) -> String {
        format!("{}/{}", job_folder(&self.id), self.fence)
    }
}

/// What a beat brings back.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Beat {
    /// Go on.
    Go,
    /// A client asked to cancel.
    Cancel,
    /// The lease is another's; stop, and keep nothing.
    Lost,
}

/// The queue as one process sees it. Cheap to clone.
#[derive(Clone)]
pub struct Queue {
    storage: Storage,
    /// This process, by a name fresh per start: one that comes back would make a dead worker look alive.
    process: String,
    /// Who claims here: a slot of this process, which has one job at a time.
    owner: String,
    lease_ms: i64,
    max_attempts: u32,
    quota: Quota,
    metrics: Metrics,
    wake: Arc<Notify>,
    changes: watch::Sender<()>,
}

impl Queue {
    /// The queue in `storage`, under a fresh name.
    pub fn new(storage: Storage, lease: Duration, max_attempts: u32) -> Queue {
        let lease_ms = i64::try_from(lease.as_millis()).unwrap_or(i64::MAX);
        let process = new_id();
        let owner = format!("{process}.0");
        Queue {
            storage,
            process,
            owner,
            lease_ms,
            max_attempts,
            quota: Quota::default(),
            metrics: Metrics::new(),
            wake: Arc::new(Notify::new()),
            changes: watch::Sender::default(),
        }
    }

    /// The same queue, in which a tenant without a quota of its own has this one, and what happens is counted here.
    #[must_use]
    pub fn bounded(self, quota: Quota, metrics: Metrics) -> Queue {
        Queue { quota, metrics, ..self }
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

    /// `changed` rows, told to whoever waits for them.
    fn told(&self, changed: u64) -> bool {
        if changed > 0 {
            self.changes.send_replace(());
        }
        changed > 0
    }

    /// Accepts a job of `tenant`: from here on it will be done, whatever happens to this process.
    ///
    /// # Errors
    /// [`Error::MissingRaySet`], [`Error::MissingSpectrum`], [`Error::Quota`], [`Error::Storage`].
    pub async fn enqueue(&self, tenant: &str, new: &NewJob) -> Result<String, Error> {
        let id = new_id();
        let mut transaction = self.storage.records.begin().await?;
        self.quota.admit_job(&mut transaction, tenant).await??;
        let insert = "INSERT INTO jobs (tenant, id, state, options, attempt, max_attempts, fence, cancel_requested, \
                      stage_progress, notices, created_ms, total) \
                      VALUES ($1, $2, 'queued', $3, 0, $4, 0, 0, 0, '[]', {now}, $5)";
        let insert = sql(insert).bind(tenant).bind(id.as_str()).bind(json(&new.options)?);
        let insert = insert.bind(i64::from(self.max_attempts));
        let total = new.total.as_ref().map(json).transpose()?;
        let insert = insert.bind(total.as_deref());
        transaction.write(insert).await?;
        for (position, channel) in new.channels.iter().enumerate() {
            let insert = "INSERT INTO job_inputs (job_id, position, ray_set_id, declared, spectrum_id) \
                          SELECT $1, $2, id, $3, $4 FROM ray_sets WHERE id = $5 AND tenant = $6 {for_share}";
            let insert = sql(insert).bind(id.as_str()).bind(position as i64).bind(declared(channel)?);
            let insert = insert.bind(channel.spectrum_id()).bind(channel.ray_set.as_str()).bind(tenant);
            if transaction.write(insert).await? == 0 {
                return Err(Error::MissingRaySet(channel.ray_set.clone()));
            }
            if let Some(spectrum) = channel.spectrum_id()
                && transaction
                    .read(
                        sql("SELECT id FROM spectra WHERE tenant = $1 AND id = $2 {for_share}")
                            .bind(tenant)
                            .bind(spectrum),
                    )
                    .await?
                    .is_empty()
            {
                return Err(Error::MissingSpectrum(spectrum.to_owned()));
            }
        }
        crash::point("submit.before_commit");
        transaction.commit().await?;
        crash::point("submit.committed");
        self.told(1);
        self.wake.notify_one();
        Ok(id)
    }

    /// Takes the oldest waiting job that need not wait longer and whose tenant may run one more, after giving back what lost workers held.
    ///
    /// # Errors
    /// The database did not answer.
    pub async fn claim(&self) -> Result<Option<Claim>, storage::Error> {
        self.sweep().await?;
        let claim = "UPDATE jobs SET state = 'running', attempt = attempt + 1, fence = fence + 1, lease_owner = $1, \
                     lease_until_ms = {now} + $2, stage = NULL, stage_progress = 0, started_ms = {now} \
                     WHERE id = (SELECT id FROM jobs WHERE state = 'queued' AND COALESCE(lease_until_ms, 0) <= {now} \
                     AND tenant NOT IN (SELECT id FROM tenants WHERE running_jobs = 0 UNION ALL \
                     SELECT run.tenant FROM jobs run LEFT JOIN tenants ON tenants.id = run.tenant \
                     WHERE run.state = 'running' GROUP BY run.tenant \
                     HAVING COUNT(*) >= MIN(COALESCE(tenants.running_jobs, $3))) \
                     ORDER BY id LIMIT 1 {skip_locked}) \
                     RETURNING id, tenant, fence, attempt, options";
        let claim = sql(claim).bind(self.owner.as_str()).bind(self.lease_ms);
        let claim = claim.bind(i64::try_from(self.quota.running_jobs).unwrap_or(i64::MAX));
        let mut transaction = self.storage.records.begin().await?;
        let rows = transaction.read(claim).await?;
        let Some(row) = rows.first() else { return Ok(None) };
        let tenant = row.text("tenant")?;
        // Another process may have begun a job of this tenant since that was looked at: then this one waits.
        if !self.quota.admits_run(&mut transaction, &tenant).await? {
            return Ok(None);
        }
        transaction.commit().await?;
        crash::point("claim.committed");
        self.told(1);
        Ok(Some(Claim {
            id: row.text("id")?,
            tenant,
            fence: row.number("fence")?,
            attempt: row.number("attempt")?,
            options: row.text("options")?,
        }))
    }

    /// Renews the lease, tells of progress, hears of a cancellation.
    ///
    /// # Errors
    /// The database did not answer.
    pub async fn beat(&self, claim: &Claim, stage: Option<&str>, progress: f64) -> Result<Beat, storage::Error> {
        let beat = "UPDATE jobs SET lease_until_ms = {now} + $1, stage = $2, stage_progress = $3 \
                    WHERE id = $4 AND fence = $5 AND state = 'running' RETURNING cancel_requested";
        let beat = sql(beat).bind(self.lease_ms).bind(stage).bind(progress);
        let mut transaction = self.storage.records.begin().await?;
        let rows = transaction.read(beat.bind(claim.id.as_str()).bind(claim.fence)).await?;
        transaction.commit().await?;
        self.told(rows.len() as u64);
        match rows.first() {
            None => Ok(Beat::Lost),
            Some(row) if row.number("cancel_requested")? != 0 => Ok(Beat::Cancel),
            Some(_) => Ok(Beat::Go),
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
        let mut transaction = self.storage.records.begin().await?;
        let finish = "UPDATE jobs SET state = 'succeeded', notices = $1, stage = 'artifacts', stage_progress = 1, \
                      lease_owner = NULL, lease_until_ms = NULL, finished_ms = {now} \
                      WHERE id = $2 AND fence = $3 AND state = 'running' AND cancel_requested = 0";
        let finish = sql(finish).bind(json(notices)?).bind(claim.id.as_str()).bind(claim.fence);
        if transaction.write(finish).await? == 0 {
            drop(transaction);
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
        Ok(self.told(1))
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
        Ok(self.told(self.storage.records.write(fail).await?))
    }

    /// Puts a running job back for a later attempt: a store did not answer, the job is not at fault. Nobody takes it before
    /// its back-off is over, a third of a lease after the first attempt and twice as long after each next. False when it
    /// had its last attempt, or the lease was lost.
    ///
    /// # Errors
    /// The database did not answer.
    pub async fn retry(&self, claim: &Claim) -> Result<bool, storage::Error> {
        let doublings = u32::try_from(claim.attempt - 1).unwrap_or(0).min(MAX_DOUBLINGS);
        let wait_ms = (self.lease_ms / 3).saturating_mul(1 << doublings);
        let retry = "UPDATE jobs SET state = CASE WHEN cancel_requested = 1 THEN 'cancelled' ELSE 'queued' END, \
                     finished_ms = CASE WHEN cancel_requested = 1 THEN {now} END, \
                     lease_until_ms = CASE WHEN cancel_requested = 0 THEN {now} + $1 END, \
                     lease_owner = NULL, stage = NULL, stage_progress = 0 \
                     WHERE id = $2 AND fence = $3 AND state = 'running' \
                     AND (attempt < max_attempts OR cancel_requested = 1)";
        let retry = sql(retry).bind(wait_ms).bind(claim.id.as_str()).bind(claim.fence);
        Ok(self.told(self.storage.records.write(retry).await?))
    }

    /// Ends a running job that a client asked to cancel.
    ///
    /// # Errors
    /// The database did not answer.
    pub async fn stop(&self, claim: &Claim) -> Result<bool, storage::Error> {
        let stop = "UPDATE jobs SET state = 'cancelled', lease_owner = NULL, lease_until_ms = NULL, \
                    finished_ms = {now} WHERE id = $1 AND fence = $2 AND state = 'running' AND cancel_requested = 1";
        Ok(self.told(self.storage.records.write(sql(stop).bind(claim.id.as_str()).bind(claim.fence)).await?))
    }

    /// Gives a running job back untried: this process stops, the job is not at fault.
    ///
    /// # Errors
    /// The database did not answer.
    pub async fn release(&self, claim: &Claim) -> Result<bool, storage::Error> {
        let release = "UPDATE jobs SET state = CASE WHEN cancel_requested = 1 THEN 'cancelled' ELSE 'queued' END, \
                       finished_ms = CASE WHEN cancel_requested = 1 THEN {now} END, attempt = attempt - 1, \
                       lease_owner = NULL, lease_until_ms = NULL, stage = NULL, stage_progress = 0 \
                       WHERE id = $1 AND fence = $2 AND state = 'running'";
        Ok(self.told(self.storage.records.write(sql(release).bind(claim.id.as_str()).bind(claim.fence)).await?))
    }

    /// Asks to cancel: a queued job ends at once, a running one at its worker's next beat.
    ///
    /// # Errors
    /// [`Error::Missing`]; [`Error::State`] when it has ended; [`Error::Storage`].
    pub async fn cancel(&self, tenant: &str, id: &str) -> Result<(), Error> {
        let cancel = "UPDATE jobs SET cancel_requested = 1, \
                      finished_ms = CASE state WHEN 'queued' THEN {now} ELSE finished_ms END, \
                      lease_until_ms = CASE state WHEN 'queued' THEN NULL ELSE lease_until_ms END, \
                      state = CASE state WHEN 'queued' THEN 'cancelled' ELSE state END \
                      WHERE tenant = $1 AND id = $2 AND state IN ('queued', 'running')";
        if self.told(self.storage.records.write(sql(cancel).bind(tenant).bind(id)).await?) {
            return Ok(());
        }
        Err(self.refusal(tenant, id).await?)
    }

    /// Forgets an ended job: announces it, if nobody has yet; then rows first, then blobs.
    ///
    /// # Errors
    /// [`Error::Missing`]; [`Error::State`] when it has not ended; [`Error::Storage`].
    pub async fn delete(&self, tenant: &str, id: &str) -> Result<(), Error> {
        let mut transaction = self.storage.records.begin().await?;
        announcement::announce_one(&mut transaction, tenant, id).await?;
        let delete = "DELETE FROM jobs WHERE tenant = $1 AND id = $2 AND state IN ('succeeded', 'failed', 'cancelled')";
        let deleted = transaction.write(sql(delete).bind(tenant).bind(id)).await?;
        transaction.commit().await?;
        if !self.told(deleted) {
            return Err(self.refusal(tenant, id).await?);
        }
        Ok(self.storage.blobs.delete_all(&job_folder(id)).await?)
    }

    async fn refusal(&self, tenant: &str, id: &str) -> Result<Error, storage::Error> {
        let job = query::get(&self.storage.records, tenant, id).await?;
        Ok(job.map_or_else(|| Error::Missing(id.to_owned()), |job| Error::State(job.state)))
    }

    /// Ends the lease of every running job: only right when no other process can be running any.
    ///
    /// # Errors
    /// The database did not answer.
    pub async fn recover(&self) -> Result<(), storage::Error> {
        self.storage.records.write(sql("UPDATE jobs SET lease_until_ms = 0 WHERE state = 'running'")).await?;
        self.sweep().await
    }

    /// Takes back jobs whose lease has ended; never those of this process, whose worker may only have been slow to beat. And
    /// those of this slot, which has none: their claim was made, and its answer lost with the connection.
    async fn sweep(&self) -> Result<(), storage::Error> {
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
        if self.told(swept) {
            self.metrics.leases_lost(swept);
            tracing::warn!(jobs = swept, "took back jobs of lost workers");
        }
        Ok(())
    }
}

/// What was declared of a channel, as its row has it: the ray set is a column of its own.
fn declared(channel: &Channel) -> Result<String, storage::Error> {
    let mut declared = serde_json::to_value(channel).map_err(|error| storage::Error::Records(Box::new(error)))?;
    if let Some(fields) = declared.as_object_mut() {
        fields.remove("ray_set");
    }
    json(&declared)
}

fn json<T: serde::Serialize + ?Sized>(value: &T) -> Result<String, storage::Error> {
    serde_json::to_string(value).map_err(|error| storage::Error::Records(Box::new(error)))
}
