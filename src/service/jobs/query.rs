//! Reads jobs from the database; changes nothing.

use super::evaluation::JobEvaluation;
use super::request::{Channel, TotalFlux};
use super::{Priority, State};
use crate::failure::{Failure, StoredNotice};
use crate::metadata::{Metadata, rows};
use crate::metrics::Backlog;
use crate::storage::error::Error;
use crate::storage::records::Records;
use crate::storage::records::statement::{Row, sql};
use crate::webhooks::deliveries;
use pipeline::Options;
use pipeline::Stage;
use std::collections::HashMap;
use std::time::Duration;

/// Ended jobs that an estimate is made from.
const LATEST: i64 = 21;

/// A job, read from its rows.
#[derive(Clone, Debug)]
pub struct Job {
    /// Identifier of the job, a UUIDv7.
    pub id: String,
    /// State of the job.
    pub state: State,
    /// The channels of the source, in order.
    pub channels: Vec<Channel>,
    /// Total flux of the source, of which the channels have shares.
    pub total: Option<TotalFlux>,
    /// What is evaluated, of an evaluation, which has no channels.
    pub evaluation: Option<JobEvaluation>,
    /// Options of the job.
    pub options: Options,
    /// Number of attempts at the job.
    pub attempt: u32,
    /// Whether a client asked to cancel the job.
    pub cancel_requested: bool,
    /// Stage of the computation; `None` before the first.
    pub stage: Option<Stage>,
    /// Fraction of that stage that is done, 0..=1.
    pub stage_progress: f64,
    /// Priority of the job among the queued jobs of its tenant.
    pub priority: Priority,
    /// Time limit of an attempt that the client asked for, s.
    pub timeout_s: Option<u32>,
    /// The client's own metadata.
    pub metadata: Metadata,
    /// Expected peak memory of the computation, bytes.
    pub memory_bytes: u64,
    /// Position in the queue of the tenant, from 1, while the job is queued.
    pub queue_position: Option<u64>,
    /// Why the job failed, if it did.
    pub failure: Option<Failure>,
    /// Notices about data that was repaired, dropped or unusual, once the job has succeeded.
    pub notices: Vec<StoredNotice>,
    /// When the job was accepted, epoch ms.
    pub created_ms: i64,
    /// When the last attempt began, epoch ms.
    pub started_ms: Option<i64>,
    /// When the job ended, epoch ms.
    pub finished_ms: Option<i64>,
}

/// State and progress of a job: what changes while a client watches it.
#[derive(Clone, Debug, PartialEq)]
pub struct JobStatus {
    /// State of the job.
    pub state: State,
    /// Number of attempts at the job.
    pub attempt: u32,
    /// Stage of the computation; `None` before the first.
    pub stage: Option<Stage>,
    /// Fraction of that stage that is done, 0..=1.
    pub stage_progress: f64,
    /// Position in the queue of the tenant, from 1, while the job is queued.
    pub queue_position: Option<u64>,
    /// Whether the job is an evaluation, which has one stage.
    pub is_evaluation: bool,
}

/// All of a job that can change after it was queued: where two stamps are equal, the job is the same.
#[derive(Clone, Debug, PartialEq)]
pub struct Stamp {
    /// State and progress of the job.
    pub status: JobStatus,
    /// Whether a client asked to cancel the job.
    pub cancel_requested: bool,
    /// Priority of the job among the queued jobs of its tenant.
    pub priority: Priority,
    /// Time limit of an attempt that the client asked for, s.
    pub timeout_s: Option<u32>,
    /// When the last attempt began, epoch ms.
    pub started_ms: Option<i64>,
    /// When the job ended, epoch ms.
    pub finished_ms: Option<i64>,
}

impl From<&Job> for Stamp {
    fn from(job: &Job) -> Stamp {
        let Job { cancel_requested, priority, timeout_s, started_ms, finished_ms, .. } = *job;
        Stamp { status: JobStatus::from(job), cancel_requested, priority, timeout_s, started_ms, finished_ms }
    }
}

impl From<&Job> for JobStatus {
    fn from(job: &Job) -> JobStatus {
        let Job { state, attempt, stage, stage_progress, queue_position, .. } = *job;
        let is_evaluation = job.evaluation.is_some();
        JobStatus { state, attempt, stage, stage_progress, queue_position, is_evaluation }
    }
}

/// An artifact of a job, as it is stored.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StoredArtifact {
    /// Name of the artifact: its path in the zip file.
    pub name: String,
    /// Media type.
    pub media_type: String,
    /// Length, bytes.
    pub byte_count: u64,
    /// SHA-256, lower-case hex.
    pub sha256: String,
    /// Key of the blob in the object store.
    pub blob: String,
}

/// Jobs with their places in their own tenant's line, which is by priority, then age.
macro_rules! jobs {
    ($($rest:literal),+) => {
        concat!(
            "SELECT jobs.*, CASE WHEN jobs.state = 'queued' THEN (SELECT COUNT(*) FROM jobs ahead \
             WHERE ahead.tenant = jobs.tenant AND ahead.state = 'queued' \
             AND (ahead.priority, ahead.id) <= (jobs.priority, jobs.id)) END AS position FROM jobs WHERE jobs.tenant = $1 ",
            $($rest),+
        )
    };
}

/// One page of those that satisfy $2 to $7; the index that finds them is chosen by what stands before.
macro_rules! page {
    (with metadata $($found:literal),*) => {
        page!(
            "AND jobs.id IN (SELECT job_id FROM job_metadata WHERE tenant = $1 AND pair IN ({texts of $8 texts}) \
             GROUP BY job_id HAVING COUNT(*) = $9) ",
            $($found),*
        )
    };
    ($($found:literal),*) => {
        jobs!(
            $($found,)*
            "AND ($2 IS NULL OR jobs.id < $2) AND ($3 = -1 OR jobs.priority = $3) AND ($4 = -1 OR jobs.created_ms > $4) \
             AND ($5 = -1 OR jobs.created_ms < $5) AND ($7 = -1 OR $7 = CASE WHEN jobs.evaluation IS NULL THEN 0 ELSE 1 END) \
             ORDER BY jobs.id DESC LIMIT $6"
        )
    };
}

const SELECT_ONE: &str = jobs!("AND jobs.id = $2");
const ALL: &str = page!("");
const IN_STATE: &str = page!("AND jobs.state = $8 ");
const OF_RAY_SET: &str = page!("AND jobs.id IN (SELECT job_id FROM job_inputs WHERE ray_set_id = $8) ");
const OF_RAY_SET_IN_STATE: &str =
    page!("AND jobs.id IN (SELECT job_id FROM job_inputs WHERE ray_set_id = $8) AND jobs.state = $9 ");
const WITH_METADATA: &str = page!(with metadata "");
const WITH_METADATA_IN_STATE: &str = page!(with metadata "AND jobs.state = $10 ");
const WITH_METADATA_OF_RAY_SET: &str =
    page!(with metadata "AND jobs.id IN (SELECT job_id FROM job_inputs WHERE ray_set_id = $10) ");
const WITH_METADATA_OF_RAY_SET_IN_STATE: &str = page!(
    with metadata "AND jobs.id IN (SELECT job_id FROM job_inputs WHERE ray_set_id = $10) AND jobs.state = $11 "
);

/// Selects jobs of a tenant; the default selects all.
#[derive(Clone, Debug, Default)]
pub struct Filter {
    /// Jobs in one of these states; empty means any state.
    pub states: Vec<State>,
    /// Jobs with this ray set among their channels.
    pub ray_set: Option<String>,
    /// Jobs of this priority.
    pub priority: Option<Priority>,
    /// Jobs accepted later than this, epoch ms.
    pub created_after_ms: Option<i64>,
    /// Jobs accepted earlier than this, epoch ms.
    pub created_before_ms: Option<i64>,
    /// Evaluations, or jobs that make models.
    pub evaluation: Option<bool>,
    /// Jobs whose metadata has all of these keys and values.
    pub metadata: Metadata,
}

/// The job `id` of `tenant`, if there is one.
///
/// # Errors
/// The database did not answer.
pub async fn get(records: &Records, tenant: &str, id: &str) -> Result<Option<Job>, Error> {
    match records.read_one(sql(SELECT_ONE).bind(tenant).bind(id)).await? {
        Some(row) => Ok(Some(job(records, &row).await?)),
        None => Ok(None),
    }
}

/// At most `limit` jobs of `tenant`, older than the one called `before`, newest first, as far as `filter` means them.
///
/// # Errors
/// The database did not answer.
pub async fn list(
    records: &Records,
    tenant: &str,
    filter: &Filter,
    before: Option<&str>,
    limit: i64,
) -> Result<Vec<Job>, Error> {
    // -1 stands for nothing said: it is no priority, no time and no answer to a question.
    let select = |text: &'static str| {
        let select = sql(text).bind(tenant).bind(before).bind(filter.priority.map_or(-1, Priority::number));
        let select = select.bind(filter.created_after_ms.unwrap_or(-1)).bind(filter.created_before_ms.unwrap_or(-1));
        let mut select = select.bind(limit).bind(filter.evaluation.map_or(-1, i64::from));
        if !filter.metadata.is_empty() {
            select = rows::bind_wanted(select, &filter.metadata)?;
        }
        Ok::<_, Error>(filter.ray_set.as_deref().map_or(select.clone(), |ray_set| select.bind(ray_set)))
    };
    let (any, in_state) = match (filter.metadata.is_empty(), &filter.ray_set) {
        (true, None) => (ALL, IN_STATE),
        (true, Some(_)) => (OF_RAY_SET, OF_RAY_SET_IN_STATE),
        (false, None) => (WITH_METADATA, WITH_METADATA_IN_STATE),
        (false, Some(_)) => (WITH_METADATA_OF_RAY_SET, WITH_METADATA_OF_RAY_SET_IN_STATE),
    };
    let mut rows = Vec::new();
    if filter.states.is_empty() {
        rows = records.read(select(any)?).await?;
    }
    // One state's are found by an index, two states' are not.
    for state in State::ALL.into_iter().filter(|state| filter.states.contains(state)) {
        rows.extend(records.read(select(in_state)?.bind(state.name())).await?);
    }
    let mut named = rows.iter().map(|row| Ok((row.text("id")?, row))).collect::<Result<Vec<_>, Error>>()?;
    named.sort_by(|(a, _), (b, _)| b.cmp(a));
    // A job that changed its state meanwhile may be in two answers.
    named.dedup_by(|(a, _), (b, _)| a == b);
    let mut jobs = Vec::new();
    for (_, row) in named.into_iter().take(usize::try_from(limit).unwrap_or(0)) {
        jobs.push(job(records, row).await?);
    }
    Ok(jobs)
}

/// Waiting jobs of `tenant` that come before a new one of this priority.
///
/// # Errors
/// The database did not answer.
pub async fn ahead(records: &Records, tenant: &str, priority: Priority) -> Result<u64, Error> {
    let ahead = "SELECT COUNT(*) AS ahead FROM jobs WHERE tenant = $1 AND state = 'queued' AND priority <= $2";
    let row = records.read_one(sql(ahead).bind(tenant).bind(priority.number())).await?;
    row.map_or(Ok(0), |row| row.count("ahead"))
}

/// Seconds that a ray took in the service's latest jobs, their median; `None` while there are none.
///
/// # Errors
/// The database did not answer.
pub async fn seconds_per_ray(records: &Records) -> Result<Option<f64>, Error> {
    let latest = "SELECT finished_ms - started_ms AS took_ms, ray_count FROM jobs WHERE finished_ms IS NOT NULL \
                  AND state = 'succeeded' AND ray_count > 0 ORDER BY finished_ms DESC LIMIT $1";
    let mut each = Vec::new();
    for row in records.read(sql(latest).bind(LATEST)).await? {
        each.push(row.count("took_ms")? as f64 / 1000.0 / row.count("ray_count")? as f64);
    }
    each.sort_by(f64::total_cmp);
    Ok(each.get(each.len() / 2).copied())
}

/// What can change of the jobs called `ids`, those that are there: one statement, however many are asked for. The order of waiting
/// jobs is that of [`get`].
///
/// # Errors
/// The database did not answer.
pub async fn stamps(records: &Records, ids: &[String]) -> Result<HashMap<String, Stamp>, Error> {
    let select = "SELECT jobs.id, state, attempt, stage, stage_progress, cancel_requested, priority, timeout_ms, started_ms, \
                  finished_ms, \
                  CASE WHEN evaluation IS NULL THEN NULL ELSE '' END AS evaluation, waiting.position FROM jobs LEFT JOIN \
                  (SELECT id, ROW_NUMBER() OVER (PARTITION BY tenant ORDER BY priority, id) AS position \
                   FROM jobs WHERE state = 'queued') waiting \
                  ON waiting.id = jobs.id WHERE jobs.id IN ({texts of $1 texts})";
    let list = serde_json::to_string(ids).map_err(Error::fault)?;
    let mut stamps = HashMap::new();
    for row in records.read(sql(select).bind(list)).await? {
        stamps.insert(row.text("id")?, stamp(&row)?);
    }
    Ok(stamps)
}

fn stamp(row: &Row) -> Result<Stamp, Error> {
    Ok(Stamp {
        status: status(row)?,
        cancel_requested: row.number("cancel_requested")? != 0,
        priority: Priority::from_number(row.number("priority")?).unwrap_or_default(),
        timeout_s: row.optional_number("timeout_ms")?.and_then(|ms| u32::try_from(ms / 1000).ok()),
        started_ms: row.optional_number("started_ms")?,
        finished_ms: row.optional_number("finished_ms")?,
    })
}

fn status(row: &Row) -> Result<JobStatus, Error> {
    let state = row.text("state")?;
    let state = State::parse(&state).ok_or_else(|| Error::fault(format!("job state {state:?}")))?;
    let stage = row.optional_text("stage")?;
    Ok(JobStatus {
        state,
        attempt: u32::try_from(row.number("attempt")?).unwrap_or(0),
        stage: stage.and_then(|name| Stage::ALL.into_iter().find(|stage| stage.name() == name)),
        stage_progress: row.real("stage_progress")?,
        queue_position: (state == State::Queued).then(|| row.count("position")).transpose()?,
        is_evaluation: row.optional_text("evaluation")?.is_some(),
    })
}

/// The channels of a job, in order.
///
/// # Errors
/// The database did not answer.
pub async fn channels(records: &Records, id: &str) -> Result<Vec<Channel>, Error> {
    let select = sql("SELECT ray_set_id, declared FROM job_inputs WHERE job_id = $1 ORDER BY position").bind(id);
    records.read(select).await?.iter().map(channel).collect()
}

fn channel(row: &Row) -> Result<Channel, Error> {
    let mut fields: serde_json::Map<String, serde_json::Value> = stored(&row.text("declared")?)?;
    fields.insert("ray_set".to_owned(), row.text("ray_set_id")?.into());
    serde_json::from_value(fields.into()).map_err(Error::fault)
}

/// The total flux of a job's source, of which its channels have shares.
///
/// # Errors
/// The database did not answer.
pub async fn total(records: &Records, id: &str) -> Result<Option<TotalFlux>, Error> {
    let row = records.read_one(sql("SELECT total FROM jobs WHERE id = $1").bind(id)).await?;
    row.map_or(Ok(None), |row| row.optional_text("total")?.as_deref().map(stored).transpose())
}

/// The files of a job, in the order of the zip.
///
/// # Errors
/// The database did not answer.
pub async fn artifacts(records: &Records, id: &str) -> Result<Vec<StoredArtifact>, Error> {
    let select = sql("SELECT * FROM artifacts WHERE job_id = $1 ORDER BY position").bind(id);
    records.read(select).await?.iter().map(artifact).collect()
}

/// One file of a job, if it has it.
///
/// # Errors
/// The database did not answer.
pub async fn artifact_named(records: &Records, id: &str, name: &str) -> Result<Option<StoredArtifact>, Error> {
    let select = sql("SELECT * FROM artifacts WHERE job_id = $1 AND name = $2").bind(id).bind(name);
    records.read_one(select).await?.as_ref().map(artifact).transpose()
}

async fn job(records: &Records, row: &Row) -> Result<Job, Error> {
    let id = row.text("id")?;
    let Stamp { status, cancel_requested, priority, timeout_s, started_ms, finished_ms } = stamp(row)?;
    let JobStatus { state, attempt, stage, stage_progress, queue_position, .. } = status;
    let failure = row.optional_text("failure")?;
    Ok(Job {
        channels: channels(records, &id).await?,
        total: row.optional_text("total")?.as_deref().map(stored).transpose()?,
        id,
        state,
        evaluation: row.optional_text("evaluation")?.as_deref().map(stored).transpose()?,
        options: stored(&row.text("options")?)?,
        attempt,
        cancel_requested,
        stage,
        stage_progress,
        priority,
        timeout_s,
        metadata: rows::read(&row.text("metadata")?)?,
        memory_bytes: row.count("memory_bytes")?,
        queue_position,
        failure: failure.as_deref().map(stored).transpose()?,
        notices: stored(&row.text("notices")?)?,
        created_ms: row.number("created_ms")?,
        started_ms,
        finished_ms,
    })
}

fn artifact(row: &Row) -> Result<StoredArtifact, Error> {
    Ok(StoredArtifact {
        name: row.text("name")?,
        media_type: row.text("media_type")?,
        byte_count: row.count("byte_count")?,
        sha256: row.text("sha256")?,
        blob: row.text("blob")?,
    })
}

fn stored<T: serde::de::DeserializeOwned>(text: &str) -> Result<T, Error> {
    serde_json::from_str(text).map_err(Error::fault)
}

/// Counts the queued and running jobs of all processes.
///
/// # Errors
/// The database did not answer.
pub async fn backlog(records: &Records) -> Result<Backlog, Error> {
    let age = |row: &Row, since: &str| {
        let ms = row.optional_number(since)?.map_or(0, |since_ms| row.number("now_ms").unwrap_or(0) - since_ms);
        Ok::<_, Error>(Duration::from_millis(ms.max(0).unsigned_abs()))
    };
    let mut backlog = Backlog { deliveries: deliveries::backlog(records).await?, ..Backlog::default() };
    let queued = "SELECT tenant, COUNT(*) AS jobs, MIN(created_ms) AS since_ms, {now} AS now_ms FROM jobs \
                  WHERE state = 'queued' GROUP BY tenant";
    for row in &records.read(sql(queued)).await? {
        let jobs = row.count("jobs")?;
        backlog.queued += jobs;
        backlog.tenants_waiting += 1;
        backlog.longest_tenant_queue = backlog.longest_tenant_queue.max(jobs);
        backlog.oldest_queued = backlog.oldest_queued.max(age(row, "since_ms")?);
    }
    let running = "SELECT COALESCE(stage, 'none') AS in_stage, COUNT(*) AS jobs, MIN(started_ms) AS since_ms, \
                   COUNT(CASE WHEN lease_until_ms < {now} THEN 1 END) AS overdue, {now} AS now_ms FROM jobs \
                   WHERE state = 'running' GROUP BY COALESCE(stage, 'none')";
    for row in &records.read(sql(running)).await? {
        backlog.running.insert(row.text("in_stage")?, row.count("jobs")?);
        backlog.overdue += row.count("overdue")?;
        backlog.oldest_running = backlog.oldest_running.max(age(row, "since_ms")?);
    }
    Ok(backlog)
}
