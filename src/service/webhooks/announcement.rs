//! What has ended becomes what is to be told. A job is announced once, in the transaction that writes its deliveries: whoever dies
//! before that has announced nothing, and whoever looks next does.

use super::super::crash;
use super::super::storage::records::{Records, Statement, Transaction, sql};
use super::super::storage::{Error, new_id};
use super::deliveries::{self, Delivery};
use super::{PING, ended, endpoints, message};

/// Jobs announced in one transaction.
const BATCH: i64 = 100;

const ANNOUNCED: &str = "UPDATE jobs SET announced = 1 WHERE id IN (SELECT id FROM jobs WHERE announced = 0 \
    AND finished_ms IS NOT NULL ORDER BY finished_ms LIMIT $1 {skip_locked}) \
    RETURNING id, tenant, state, attempt, failure, metadata, created_ms, started_ms, finished_ms";
const ANNOUNCED_ONE: &str = "UPDATE jobs SET announced = 1 WHERE announced = 0 AND finished_ms IS NOT NULL \
    AND tenant = $1 AND id = $2 \
    RETURNING id, tenant, state, attempt, failure, metadata, created_ms, started_ms, finished_ms";

/// Announces jobs that have ended; how many. Right in any number of processes at once.
///
/// # Errors
/// The database did not answer.
pub async fn announce(records: &Records) -> Result<usize, Error> {
    let any = sql("SELECT id FROM jobs WHERE announced = 0 AND finished_ms IS NOT NULL LIMIT 1");
    if records.read_one(any).await?.is_none() {
        return Ok(0);
    }
    let mut transaction = records.begin().await?;
    let jobs = announced(&mut transaction, sql(ANNOUNCED).bind(BATCH)).await?;
    crash::point("announce.before_commit");
    transaction.commit().await?;
    crash::point("announce.committed");
    Ok(jobs)
}

/// Announces a job that is about to be deleted, if it has ended and nobody has yet. Right as the first statement of a
/// transaction.
///
/// # Errors
/// The database did not answer.
pub async fn announce_one(transaction: &mut Transaction, tenant: &str, job: &str) -> Result<usize, Error> {
    announced(transaction, sql(ANNOUNCED_ONE).bind(tenant).bind(job)).await
}

async fn announced(transaction: &mut Transaction, jobs: Statement) -> Result<usize, Error> {
    let jobs = transaction.read(jobs).await?;
    for row in &jobs {
        let (event, job) = match ended(row) {
            Ok(ended) => ended,
            Err(error) => {
                // One row that cannot be read must not keep all others from being told.
                tracing::error!(%error, "the end of a job cannot be told");
                continue;
            }
        };
        let finished_ms = row.number("finished_ms")?;
        // Who began to listen later has seen the end, or can.
        let select = "SELECT id, events FROM webhooks WHERE tenant = $1 AND disabled_why IS NULL \
                      AND created_ms <= $2 {for_share}";
        let endpoints = transaction.read(sql(select).bind(row.text("tenant")?).bind(finished_ms)).await?;
        if endpoints.is_empty() {
            continue;
        }
        let (id, body) = (row.text("id")?, message(event.name(), finished_ms, job)?);
        for endpoint in &endpoints {
            if endpoints::events(&endpoint.text("events")?).contains(&event) {
                insert(transaction, &endpoint.text("id")?, event.name(), Some(&id), &body).await?;
            }
        }
    }
    Ok(jobs.len())
}

async fn insert(
    transaction: &mut Transaction,
    webhook: &str,
    event: &str,
    job: Option<&str>,
    body: &str,
) -> Result<String, Error> {
    let id = new_id();
    let insert = "INSERT INTO deliveries (id, webhook_id, event, job_id, body, state, attempt, fence, due_ms, created_ms) \
                  VALUES ($1, $2, $3, $4, $5, 'waiting', 0, 0, {now}, {now})";
    let insert = sql(insert).bind(id.as_str()).bind(webhook).bind(event).bind(job).bind(body);
    transaction.write(insert).await?;
    Ok(id)
}

/// Tells an endpoint that there is nothing to tell: once, whatever it answers. While one such waits, it is that. `None` when `tenant` has no such endpoint, or it is
/// disabled.
///
/// # Errors
/// The database did not answer.
pub async fn ping(records: &Records, tenant: &str, webhook: &str) -> Result<Option<Delivery>, Error> {
    let mut transaction = records.begin().await?;
    // Changes nothing, and keeps the endpoint.
    let hold = "UPDATE webhooks SET url = url WHERE tenant = $1 AND id = $2 AND disabled_why IS NULL \
                RETURNING {now} AS now_ms";
    let held = transaction.read(sql(hold).bind(tenant).bind(webhook)).await?;
    let Some(row) = held.first() else {
        transaction.rollback().await?;
        return Ok(None);
    };
    let waiting = sql("SELECT id FROM deliveries WHERE webhook_id = $1 AND event = $2 AND state = 'waiting' LIMIT 1");
    if let Some(waiting) = transaction.read(waiting.bind(webhook).bind(PING)).await?.first() {
        // Nobody waits for a connection while holding one: that may be what all the others wait for.
        transaction.rollback().await?;
        return deliveries::get(records, webhook, &waiting.text("id")?).await;
    }
    let body = message(PING, row.number("now_ms")?, serde_json::Map::new())?;
    let id = insert(&mut transaction, webhook, PING, None, &body).await?;
    transaction.commit().await?;
    deliveries::get(records, webhook, &id).await
}
