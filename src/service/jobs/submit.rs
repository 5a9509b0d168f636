//! How a job comes into the queue: once for each key, not at all where an equal one is there, else as a row and its channels.
//! All of it in one transaction, which holds the tenant's row: two requests at once come one after the other.

use super::error::Error;
use super::estimate::JobPlan;
use super::memory_budget::needed;
use super::queue::{Queue, json};
use super::request::{Channel, NewJob};
use crate::hex::hex;
use crate::metadata::rows;
use crate::storage::keys::new_id;
use crate::storage::records::Transaction;
use crate::storage::records::statement::{Row, Statement, ms, sql};
use crate::{crash, storage};
use sha2::{Digest, Sha256};
use std::time::Duration;

/// How long an Idempotency-Key is remembered.
pub const KEY_LIFE: Duration = Duration::from_hours(24);

/// A request with an Idempotency-Key: however often it arrives, it makes one job.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Keyed {
    /// The key that the client chose, unique within its tenant.
    pub key: String,
    /// SHA-256 of the request, lower-case hex.
    pub request_sha256: String,
}

impl Keyed {
    /// `new`, asked for under `key`.
    ///
    /// # Errors
    /// Never in practice: what was read can be written.
    pub fn new(key: String, new: &impl serde::Serialize) -> Result<Keyed, storage::Error> {
        Ok(Keyed { key, request_sha256: hex(&Sha256::digest(json(new)?)) })
    }
}

/// The job that a request is answered with.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Queued {
    /// Identifier of the job.
    pub id: String,
    /// Whether the job existed before the request.
    pub reused: bool,
}

/// Keys forgotten in one go.
const BATCH: i64 = 1000;

/// What gives, or gave, the same ($2) to the tenant ($1), and nobody wants it to end: it has succeeded, or runs and may take as
/// long as is asked ($5, ms; -1: as long as any), or waits and can be begun here (with $3 bytes on $4 threads). It has the
/// metadata that are sent ($6), unless none are: a client that searches for a job by its metadata must find it.
macro_rules! equal {
    ($before:literal, $after:literal) => {
        concat!(
            $before,
            "SELECT jobs.id FROM jobs WHERE jobs.tenant = $1 AND jobs.content_sha256 = $2 \
             AND jobs.cancel_requested = 0 AND ($6 = '{}' OR jobs.metadata = $6) AND (jobs.state = 'succeeded' OR (jobs.state = 'running' \
             AND (jobs.timeout_ms IS NULL OR ($5 <> -1 AND jobs.timeout_ms >= $5))) OR (jobs.state = 'queued' AND ",
            needed!("$4"),
            " <= $3)) ORDER BY CASE jobs.state WHEN 'succeeded' THEN 0 WHEN 'running' THEN 1 ELSE 2 END, jobs.id LIMIT 1",
            $after
        )
    };
}

const EQUAL: &str = equal!("", "");
/// It is used now, as urgent as the more urgent of the two ($7), and while it waits it may take the longer of both times. A
/// request that cancels or deletes the job does not lock the row of the tenant, so that the job may change at this moment.
const REUSE: &str = equal!(
    "UPDATE jobs SET used_ms = {now}, priority = CASE WHEN $7 < priority THEN $7 ELSE priority END, \
     timeout_ms = CASE WHEN state <> 'queued' THEN timeout_ms WHEN $5 = -1 THEN NULL \
     WHEN timeout_ms < $5 THEN $5 ELSE timeout_ms END WHERE id = (",
    ") AND state IN ('queued', 'running', 'succeeded') AND cancel_requested = 0 RETURNING id"
);

impl Queue {
    /// A job whose model is to be evaluated is used now: the time for which it is kept begins anew.
    ///
    /// # Errors
    /// [`Error::Storage`].
    pub async fn use_model(&self, tenant: &str, job: &str) -> Result<(), Error> {
        let used = sql("UPDATE jobs SET used_ms = {now} WHERE tenant = $1 AND id = $2").bind(tenant).bind(job);
        self.storage.records.write(used).await?;
        Ok(())
    }

    /// The job that an earlier request with this Idempotency-Key made, if there was one.
    ///
    /// # Errors
    /// [`Error::KeyReused`] for another request, [`Error::KeySpent`] when its job was deleted, [`Error::Storage`].
    pub async fn answered(&self, tenant: &str, keyed: &Keyed) -> Result<Option<Queued>, Error> {
        let row = self.storage.records.read_one(find(tenant, keyed)).await?;
        row.map(|row| remembered(&row, keyed)).transpose()
    }

    /// The job that `new` would be answered with, if there is one.
    ///
    /// # Errors
    /// The database did not answer.
    pub async fn equal(&self, tenant: &str, new: &NewJob, plan: &JobPlan) -> Result<Option<String>, storage::Error> {
        let Some(content) = plan.content_sha256.as_deref().filter(|_| new.reuse) else { return Ok(None) };
        let row = self.storage.records.read_one(self.as_equal(EQUAL, tenant, content, new)?).await?;
        row.map(|row| row.text("id")).transpose()
    }

    /// Queues a job of `tenant`: once this returns, the job will be computed even if this process fails.
    ///
    /// # Errors
    /// [`Error::MissingRaySet`], [`Error::MissingSpectrum`], [`Error::TooLarge`], [`Error::Quota`]; as [`Queue::answered`].
    pub async fn enqueue(
        &self,
        tenant: &str,
        new: &NewJob,
        plan: &JobPlan,
        keyed: Option<&Keyed>,
    ) -> Result<Queued, Error> {
        let mut transaction = self.storage.records.begin().await?;
        let queued = match self.enqueue_in(&mut transaction, tenant, new, plan, keyed).await {
            Ok(queued) => queued,
            Err(failed @ Error::Storage(_)) => return Err(failed),
            Err(refused) => {
                transaction.rollback().await?;
                return Err(refused);
            }
        };
        crash::point("submit.before_commit");
        let change = self.change(tenant, &queued.id);
        transaction.commit().await?;
        drop(change);
        crash::point("submit.committed");
        self.wake.notify_one();
        Ok(queued)
    }

    /// The same, within a transaction that is committed only if it succeeds.
    async fn enqueue_in(
        &self,
        transaction: &mut Transaction,
        tenant: &str,
        new: &NewJob,
        plan: &JobPlan,
        keyed: Option<&Keyed>,
    ) -> Result<Queued, Error> {
        let usage = self.quota.lock(transaction, tenant).await?;
        if let Some(keyed) = keyed
            && let Some(row) = transaction.read(find(tenant, keyed)).await?.first()
        {
            return remembered(row, keyed);
        }
        let queued = match self.reused(transaction, tenant, new, plan).await? {
            Some(id) => Queued { id, reused: true },
            None => {
                usage.check_job()?;
                self.memory.check_fits(plan.memory_bytes)?;
                Queued { id: self.insert(transaction, tenant, new, plan).await?, reused: false }
            }
        };
        if let Some(keyed) = keyed {
            remember(transaction, tenant, keyed, &queued).await?;
        }
        Ok(queued)
    }

    fn as_equal(
        &self,
        text: &'static str,
        tenant: &str,
        content: &str,
        new: &NewJob,
    ) -> Result<Statement, storage::Error> {
        let equal = self.machine(sql(text).bind(tenant).bind(content)).bind(timeout_ms(new));
        Ok(equal.bind(rows::written(&new.metadata)?))
    }

    /// The job that gives, or gave, what `new` would.
    async fn reused(
        &self,
        transaction: &mut Transaction,
        tenant: &str,
        new: &NewJob,
        plan: &JobPlan,
    ) -> Result<Option<String>, storage::Error> {
        let Some(content) = plan.content_sha256.as_deref().filter(|_| new.reuse) else { return Ok(None) };
        let reuse = self.as_equal(REUSE, tenant, content, new)?.bind(new.priority.number());
        transaction.read(reuse).await?.first().map(|row| row.text("id")).transpose()
    }

    async fn insert(
        &self,
        transaction: &mut Transaction,
        tenant: &str,
        new: &NewJob,
        plan: &JobPlan,
    ) -> Result<String, Error> {
        let id = new_id();
        let insert = "INSERT INTO jobs (tenant, id, state, options, attempt, max_attempts, fence, cancel_requested, \
                      stage_progress, notices, created_ms, total, priority, timeout_ms, memory_bytes, memory_threads, \
                      thread_bytes, ray_count, content_sha256, metadata, evaluation) \
                      VALUES ($1, $2, 'queued', $3, 0, $4, 0, 0, 0, $14, {now}, $5, $6, NULLIF($7, -1), $8, $9, $10, \
                      $11, $12, $13, $15)";
        let insert = sql(insert).bind(tenant).bind(id.as_str()).bind(json(&new.options)?);
        let total = new.total.as_ref().map(json).transpose()?;
        let insert = insert.bind(i64::from(self.max_attempts)).bind(total.as_deref());
        let insert = insert.bind(new.priority.number()).bind(timeout_ms(new));
        let threads = i64::try_from(plan.memory_threads).unwrap_or(i64::MAX);
        let insert = insert.bind(plan.memory_bytes.cast_signed()).bind(threads);
        let insert = insert.bind(plan.thread_bytes.cast_signed()).bind(plan.ray_count.cast_signed());
        let insert = insert.bind(plan.content_sha256.as_deref()).bind(rows::written(&new.metadata)?);
        let evaluation = new.evaluation.as_ref().map(json).transpose()?;
        let insert = insert.bind(json(&plan.notices)?).bind(evaluation.as_deref());
        transaction.write(insert).await?;
        rows::of_job(transaction, tenant, &id, &new.metadata).await?;
        for (position, channel) in new.channels.iter().enumerate() {
            insert_channel(transaction, tenant, &id, position, channel).await?;
        }
        Ok(id)
    }

    /// Deletes the oldest expired Idempotency-Keys, up to 1000, and returns their number.
    ///
    /// # Errors
    /// The database did not answer.
    pub async fn delete_old_keys(&self) -> Result<u64, storage::Error> {
        // Said twice: a key that is used again while this statement waits for it is a new one.
        let delete = "DELETE FROM idempotency_keys WHERE created_ms <= {now} - $1 AND (tenant, key) IN \
                      (SELECT tenant, key FROM idempotency_keys WHERE created_ms <= {now} - $1 \
                       ORDER BY created_ms LIMIT $2)";
        self.storage.records.write(sql(delete).bind(ms(KEY_LIFE)).bind(BATCH)).await
    }
}

/// Locks the ray set and the spectrum, so that they cannot be deleted before the job that needs them is stored.
async fn insert_channel(
    transaction: &mut Transaction,
    tenant: &str,
    job: &str,
    position: usize,
    channel: &Channel,
) -> Result<(), Error> {
    let insert = "INSERT INTO job_inputs (job_id, position, ray_set_id, declared, spectrum_id) \
                  SELECT $1, $2, id, $3, $4 FROM ray_sets WHERE id = $5 AND tenant = $6 {for_share}";
    let insert = sql(insert).bind(job).bind(position as i64).bind(declared(channel)?);
    let insert = insert.bind(channel.spectrum_id()).bind(channel.ray_set.as_str()).bind(tenant);
    if transaction.write(insert).await? == 0 {
        return Err(Error::MissingRaySet(channel.ray_set.clone()));
    }
    let Some(spectrum) = channel.spectrum_id() else { return Ok(()) };
    let select = sql("SELECT id FROM spectra WHERE tenant = $1 AND id = $2 {for_share}").bind(tenant).bind(spectrum);
    match transaction.read(select).await?.is_empty() {
        true => Err(Error::MissingSpectrum(spectrum.to_owned())),
        false => Ok(()),
    }
}

/// What was declared of a channel, as its row has it: the ray set is a column of its own.
fn declared(channel: &Channel) -> Result<String, storage::Error> {
    let mut declared = serde_json::to_value(channel).map_err(storage::Error::fault)?;
    if let Some(fields) = declared.as_object_mut() {
        fields.remove("ray_set");
    }
    json(&declared)
}

/// Longest attempt that was asked for; -1 stands for NULL: no job may take so long.
fn timeout_ms(new: &NewJob) -> i64 {
    new.timeout_s.map_or(-1, |seconds| i64::from(seconds) * 1000)
}

fn find(tenant: &str, keyed: &Keyed) -> Statement {
    let find = "SELECT known.request_sha256, known.job_id, known.reused, jobs.id AS present FROM idempotency_keys known \
                LEFT JOIN jobs ON jobs.id = known.job_id \
                WHERE known.tenant = $1 AND known.key = $2 AND known.created_ms > {now} - $3";
    sql(find).bind(tenant).bind(keyed.key.as_str()).bind(ms(KEY_LIFE))
}

fn remembered(row: &Row, keyed: &Keyed) -> Result<Queued, Error> {
    if row.text("request_sha256")? != keyed.request_sha256 {
        return Err(Error::KeyReused(keyed.key.clone()));
    }
    if row.optional_text("present")?.is_none() {
        return Err(Error::KeySpent(keyed.key.clone()));
    }
    Ok(Queued { id: row.text("job_id")?, reused: row.number("reused")? != 0 })
}

/// An older key of the same name has had its time.
async fn remember(
    transaction: &mut Transaction,
    tenant: &str,
    keyed: &Keyed,
    queued: &Queued,
) -> Result<(), storage::Error> {
    let insert = "INSERT INTO idempotency_keys (tenant, key, request_sha256, job_id, reused, created_ms) \
                  VALUES ($1, $2, $3, $4, $5, {now}) ON CONFLICT (tenant, key) DO UPDATE SET \
                  request_sha256 = excluded.request_sha256, job_id = excluded.job_id, reused = excluded.reused, \
                  created_ms = excluded.created_ms";
    let insert = sql(insert).bind(tenant).bind(keyed.key.as_str()).bind(keyed.request_sha256.as_str());
    transaction.write(insert.bind(queued.id.as_str()).bind(i64::from(queued.reused))).await?;
    Ok(())
}
