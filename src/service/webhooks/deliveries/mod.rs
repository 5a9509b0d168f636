//! Rows of webhook deliveries: which event goes to which endpoint, and the result of its attempts. A process claims a delivery as
//! a worker claims a job, and only the holder of the newest claim may end it.

#[cfg(test)]
mod tests;

use super::{PING, Policy, message};
use crate::storage::error::Error;
use crate::storage::keys::new_id;
use crate::storage::records::statement::{Row, ms, sql};
use crate::storage::records::{Records, Transaction};
use std::time::Duration;

/// Attempts at one endpoint at once, in all processes together; at one whose last attempt failed, one.
const OF_AN_ENDPOINT: i64 = 4;
/// Attempts at all endpoints of one tenant at once: fewer than one process makes, so that its slow ones keep no other's waiting.
const OF_A_TENANT: i64 = 16;
/// Over the longest attempt, until a claim is another's.
const SLACK: Duration = Duration::from_secs(15);
/// Rows forgotten in one go.
const BATCH: i64 = 1000;

/// Longest rest that an endpoint may ask for.
const LONGEST_REST: Duration = Duration::from_hours(24);

/// State of a delivery.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
#[schema(as = DeliveryState)]
pub enum State {
    /// An attempt is due, now or later.
    Waiting,
    /// The endpoint accepted the event.
    Delivered,
    /// The endpoint did not accept the event; there are no more attempts.
    Failed,
}

impl State {
    const ALL: [State; 3] = [State::Waiting, State::Delivered, State::Failed];

    /// The word in rows and answers.
    fn name(self) -> &'static str {
        match self {
            State::Waiting => "waiting",
            State::Delivered => "delivered",
            State::Failed => "failed",
        }
    }
}

/// The delivery of one event to one endpoint.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Delivery {
    /// Identifier of the delivery, a UUIDv7: the `webhook-id` of every attempt.
    pub id: String,
    /// Name of the event.
    pub event: String,
    /// Identifier of the job; `None` for a ping.
    pub job: Option<String>,
    /// State of the delivery.
    pub state: State,
    /// Number of attempts made.
    pub attempt: i64,
    /// When the next attempt is due, epoch ms, if there is one.
    pub due_ms: Option<i64>,
    /// When the last attempt was made, epoch ms.
    pub attempted_ms: Option<i64>,
    /// HTTP status of the answer to the last attempt.
    pub status: Option<i64>,
    /// Beginning of the body of the answer.
    pub answer: Option<String>,
    /// Why there was no answer.
    pub error: Option<String>,
    /// When the event was announced, epoch ms.
    pub created_ms: i64,
}

/// A claimed delivery whose attempt is due now.
#[derive(Clone, Debug)]
pub struct DueDelivery {
    /// Identifier of the delivery.
    pub id: String,
    /// Identifier of the endpoint.
    pub webhook: String,
    /// Number of this claim, unique among all claims of the delivery.
    pub fence: i64,
    /// Number of this attempt, from 1.
    pub attempt: i64,
    /// Name of the event.
    pub event: String,
    /// Body of the request, JSON.
    pub body: String,
    /// URL to post to.
    pub url: String,
    /// Secrets that sign the request.
    pub secrets: Vec<String>,
    /// Now, by the database's clock, epoch s.
    pub timestamp_s: i64,
}

/// Result of an attempt.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Attempted {
    /// HTTP status of the answer, if there was one.
    pub status: Option<u16>,
    /// Beginning of the body of the answer.
    pub answer: Option<String>,
    /// Why there was no answer.
    pub error: Option<String>,
    /// Time that the endpoint asks to wait before the next attempt.
    pub retry_after: Option<Duration>,
}

impl Attempted {
    /// Whether the endpoint accepted the event.
    pub fn is_taken(&self) -> bool {
        self.status.is_some_and(|status| (200..300).contains(&status))
    }

    /// Whether the endpoint answered 410 Gone.
    fn is_gone(&self) -> bool {
        self.status == Some(410)
    }
}

/// Claims a delivery that is due.
///
/// # Errors
/// The database did not answer.
pub async fn claim(records: &Records, longest: Duration) -> Result<Option<DueDelivery>, Error> {
    let due = sql("SELECT id FROM deliveries WHERE state = 'waiting' AND due_ms <= {now} \
                   AND COALESCE(lease_until_ms, 0) <= {now} LIMIT 1");
    if records.read_one(due).await?.is_none() {
        return Ok(None);
    }
    let claim = "UPDATE deliveries SET fence = fence + 1, attempt = attempt + 1, attempted_ms = {now}, \
                 lease_until_ms = {now} + $1 WHERE id = (SELECT id FROM deliveries WHERE state = 'waiting' \
                 AND due_ms <= {now} AND COALESCE(lease_until_ms, 0) <= {now} AND webhook_id NOT IN \
                 (SELECT id FROM webhooks WHERE disabled_why IS NOT NULL UNION ALL \
                  SELECT sent.webhook_id FROM deliveries sent JOIN webhooks ON webhooks.id = sent.webhook_id \
                  WHERE sent.lease_until_ms > {now} GROUP BY sent.webhook_id \
                  HAVING COUNT(*) >= CASE WHEN MAX(webhooks.failing_since_ms) IS NULL THEN $2 ELSE 1 END UNION ALL \
                  SELECT id FROM webhooks WHERE tenant IN (SELECT webhooks.tenant FROM deliveries sent \
                  JOIN webhooks ON webhooks.id = sent.webhook_id WHERE sent.lease_until_ms > {now} \
                  GROUP BY webhooks.tenant HAVING COUNT(*) >= $3)) \
                 ORDER BY due_ms, id LIMIT 1 {skip_locked}) \
                 RETURNING id, webhook_id, event, fence, attempt, body, {now} AS now_ms";
    let mut transaction = records.begin().await?;
    let claim = sql(claim).bind(ms(longest + SLACK)).bind(OF_AN_ENDPOINT).bind(OF_A_TENANT);
    let claimed = transaction.read(claim).await?;
    let Some(row) = claimed.first() else {
        transaction.rollback().await?;
        return Ok(None);
    };
    let webhook = row.text("webhook_id")?;
    let select = "SELECT url, secret, CASE WHEN old_secret_until_ms > {now} THEN old_secret END AS other_secret \
                  FROM webhooks WHERE id = $1";
    let endpoint = transaction.read(sql(select).bind(webhook.as_str())).await?;
    let Some(endpoint) = endpoint.first() else {
        transaction.rollback().await?;
        return Ok(None);
    };
    transaction.commit().await?;
    Ok(Some(DueDelivery {
        id: row.text("id")?,
        webhook,
        fence: row.number("fence")?,
        attempt: row.number("attempt")?,
        event: row.text("event")?,
        body: row.text("body")?,
        url: endpoint.text("url")?,
        secrets: std::iter::once(endpoint.text("secret")?).chain(endpoint.optional_text("other_secret")?).collect(),
        timestamp_s: row.number("now_ms")?.div_euclid(1000),
    }))
}

/// Ends the lease of every attempt: only right when no other process can be making any.
///
/// # Errors
/// The database did not answer.
pub async fn recover(records: &Records) -> Result<(), Error> {
    records.write(sql("UPDATE deliveries SET lease_until_ms = NULL WHERE lease_until_ms IS NOT NULL")).await?;
    Ok(())
}

/// Stores the result of an attempt. Disables an endpoint that answered 410, or that has accepted nothing for too long and refused
/// the last attempt too; its waiting deliveries have then failed. False if another process has claimed the delivery by then.
///
/// # Errors
/// The database did not answer.
pub async fn end(records: &Records, due: &DueDelivery, how: &Attempted, policy: &Policy) -> Result<bool, Error> {
    let mut transaction = records.begin().await?;
    // The endpoint before its deliveries, everywhere: two that end at once wait for each other in this order only.
    transaction.write(sql(HOLD).bind(due.webhook.as_str())).await?;
    let ours = "UPDATE deliveries SET lease_until_ms = NULL WHERE id = $1 AND fence = $2 AND state = 'waiting'";
    if transaction.write(sql(ours).bind(due.id.as_str()).bind(due.fence)).await? == 0 {
        transaction.rollback().await?;
        return Ok(false);
    }
    let wait = wait(due, how, policy);
    let disabled = match how.is_taken() {
        true => {
            let well = "UPDATE webhooks SET failing_since_ms = NULL WHERE id = $1";
            transaction.write(sql(well).bind(due.webhook.as_str())).await?;
            false
        }
        false => failed(&mut transaction, due, how, wait.is_none(), policy).await?,
    };
    let (state, wait) = match (how.is_taken(), wait) {
        (true, _) => (State::Delivered, Duration::ZERO),
        (false, Some(wait)) if !disabled => (State::Waiting, wait),
        (false, _) => (State::Failed, Duration::ZERO),
    };
    let end = "UPDATE deliveries SET state = $1, due_ms = {now} + $2, status = NULLIF($3, -1), answer = $4, error = $5 \
               WHERE id = $6";
    let end =
        sql(end).bind(state.name()).bind(ms(wait)).bind(how.status.map_or(-1, i64::from)).bind(how.answer.as_deref());
    transaction.write(end.bind(how.error.as_deref()).bind(due.id.as_str())).await?;
    if disabled {
        let forgo = "UPDATE deliveries SET state = 'failed', error = 'the endpoint was disabled' \
                     WHERE webhook_id = $1 AND state = 'waiting'";
        transaction.write(sql(forgo).bind(due.webhook.as_str())).await?;
    }
    transaction.commit().await?;
    Ok(true)
}

/// Locks an endpoint, so that no other transaction changes it before this one ends.
const HOLD: &str = "UPDATE webhooks SET id = id WHERE id = $1";

/// Notes that an endpoint did not take something; whether it is disabled for it. A ping that fails says nothing of the endpoint's
/// work: a person is trying it out.
async fn failed(
    transaction: &mut Transaction,
    due: &DueDelivery,
    how: &Attempted,
    is_last: bool,
    policy: &Policy,
) -> Result<bool, Error> {
    if due.event == PING && !how.is_gone() {
        return Ok(false);
    }
    let failed = "UPDATE webhooks SET failing_since_ms = COALESCE(failing_since_ms, {now}), \
                  disabled_why = CASE WHEN $1 = 1 THEN 'it answered 410 Gone' \
                  WHEN $2 = 1 AND failing_since_ms <= {now} - $3 THEN 'it has taken nothing for too long' END \
                  WHERE id = $4 AND disabled_why IS NULL RETURNING disabled_why";
    let failed = sql(failed).bind(i64::from(how.is_gone())).bind(i64::from(is_last)).bind(ms(policy.give_up));
    let failed = failed.bind(due.webhook.as_str());
    let rows = transaction.read(failed).await?;
    let why = rows.first().map(|row| row.optional_text("disabled_why")).transpose()?.flatten();
    if let Some(why) = &why {
        tracing::warn!(webhook = due.webhook, why, "a webhook was disabled");
    }
    Ok(why.is_some())
}

/// How long to wait before the next attempt; `None` when this was the last.
fn wait(due: &DueDelivery, how: &Attempted, policy: &Policy) -> Option<Duration> {
    if due.event == PING {
        return None;
    }
    let done = usize::try_from(due.attempt).unwrap_or(usize::MAX).saturating_sub(1);
    let wait = policy.waits.get(done)?;
    // Up to a fifth more, so that what failed together is not tried together; by the random part of the id.
    let random = due.id.rsplit('-').next().and_then(|hex| u64::from_str_radix(hex, 16).ok()).unwrap_or(0);
    let jitter = wait.mul_f64((random % 1000) as f64 / 5000.0);
    let asked = how.retry_after.filter(|_| matches!(how.status, Some(429 | 503))).unwrap_or_default();
    Some((*wait + jitter).max(asked.min(LONGEST_REST)))
}

/// Starts a delivery again at once, from its first attempt, whatever its state. False if there is no such delivery to an enabled
/// endpoint of `tenant`.
///
/// # Errors
/// The database did not answer.
pub async fn redeliver(records: &Records, tenant: &str, webhook: &str, id: &str) -> Result<bool, Error> {
    let mut transaction = records.begin().await?;
    // Not disabled meanwhile: what waits for a disabled endpoint would wait for ever.
    let hold = sql("UPDATE webhooks SET id = id WHERE id = $1 AND tenant = $2 AND disabled_why IS NULL");
    if transaction.write(hold.bind(webhook).bind(tenant)).await? == 0 {
        transaction.rollback().await?;
        return Ok(false);
    }
    let again = "UPDATE deliveries SET state = 'waiting', attempt = 0, due_ms = {now}, fence = fence + 1, \
                 lease_until_ms = NULL WHERE webhook_id = $1 AND id = $2";
    let again = transaction.write(sql(again).bind(webhook).bind(id)).await? > 0;
    transaction.commit().await?;
    Ok(again)
}

/// A delivery to the endpoint `webhook`, whose tenant is known.
///
/// # Errors
/// The database did not answer.
pub async fn get(records: &Records, webhook: &str, id: &str) -> Result<Option<Delivery>, Error> {
    let select = sql("SELECT * FROM deliveries WHERE webhook_id = $1 AND id = $2");
    records.read_one(select.bind(webhook).bind(id)).await?.as_ref().map(delivery).transpose()
}

/// At most `limit` deliveries to the endpoint `webhook`, whose tenant is known, older than the one called `before`, newest first.
///
/// # Errors
/// The database did not answer.
pub async fn list(records: &Records, webhook: &str, before: Option<&str>, limit: i64) -> Result<Vec<Delivery>, Error> {
    let select = "SELECT * FROM deliveries WHERE webhook_id = $1 AND ($2 IS NULL OR id < $2) ORDER BY id DESC LIMIT $3";
    records.read(sql(select).bind(webhook).bind(before).bind(limit)).await?.iter().map(delivery).collect()
}

fn delivery(row: &Row) -> Result<Delivery, Error> {
    let state = row.text("state")?;
    let known = State::ALL.into_iter().find(|known| known.name() == state);
    let state = known.ok_or_else(|| Error::fault(format!("delivery state {state:?}")))?;
    Ok(Delivery {
        id: row.text("id")?,
        event: row.text("event")?,
        job: row.optional_text("job_id")?,
        attempt: row.number("attempt")?,
        due_ms: if state == State::Waiting { Some(row.number("due_ms")?) } else { None },
        attempted_ms: row.optional_number("attempted_ms")?,
        status: row.optional_number("status")?,
        answer: row.optional_text("answer")?,
        error: row.optional_text("error")?,
        created_ms: row.number("created_ms")?,
        state,
    })
}

/// Deletes ended deliveries that are older than `keep`, and returns their number.
///
/// # Errors
/// The database did not answer.
pub async fn delete_old(records: &Records, keep: Duration) -> Result<u64, Error> {
    // Said twice: one that is to be told again while this statement waits for it stays.
    let old = "DELETE FROM deliveries WHERE state <> 'waiting' AND id IN \
               (SELECT id FROM deliveries WHERE created_ms <= {now} - $1 AND state <> 'waiting' LIMIT $2)";
    let mut forgotten = 0;
    // In pieces: one statement for all of them would hold up everybody, and may take longer than a statement may.
    loop {
        let rows = records.write(sql(old).bind(ms(keep)).bind(BATCH)).await?;
        forgotten += rows;
        if rows < BATCH.unsigned_abs() {
            return Ok(forgotten);
        }
    }
}

/// Number of deliveries that wait for an attempt, in all processes together.
///
/// # Errors
/// The database did not answer.
pub async fn backlog(records: &Records) -> Result<u64, Error> {
    let count = records.read_one(sql("SELECT COUNT(*) AS waiting FROM deliveries WHERE state = 'waiting'")).await?;
    count.map_or(Ok(0), |row| row.count("waiting"))
}

/// Adds a delivery to an endpoint, due at once, and returns its id.
///
/// # Errors
/// The database did not answer.
pub async fn insert(
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

/// Adds a test delivery (`ping`) to an endpoint, which has one attempt only. While such a delivery waits, it is returned instead.
/// `None` if `tenant` has no such endpoint, or it is disabled.
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
        return get(records, webhook, &waiting.text("id")?).await;
    }
    let body = message(PING, row.number("now_ms")?, serde_json::Map::new())?;
    let id = insert(&mut transaction, webhook, PING, None, &body).await?;
    transaction.commit().await?;
    get(records, webhook, &id).await
}
