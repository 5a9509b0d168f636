//! Announces ended jobs: makes webhook deliveries of them. A job is announced once, in the transaction that writes its
//! deliveries. A process that ends before that has announced nothing; the next one does.

use super::{State, ZIP};
use crate::crash;
use crate::failure::Failure;
use crate::metadata::{Metadata, rows};
use crate::storage::error::Error;
use crate::storage::records::statement::{Row, Statement, sql};
use crate::storage::records::{Records, Transaction};
use crate::webhooks::dispatcher::Dispatcher;
use crate::webhooks::{Event, deliveries, endpoints, message};
use serde::Serialize;
use std::time::Duration;
use tokio::sync::watch;
use tokio::time::sleep;

/// Least time between two looks: what ends together is announced together.
const GAP: Duration = Duration::from_millis(50);
/// Jobs announced in one transaction.
const BATCH: i64 = 100;

const ANNOUNCED: &str = "UPDATE jobs SET announced = 1 WHERE id IN (SELECT id FROM jobs WHERE announced = 0 \
    AND finished_ms IS NOT NULL ORDER BY finished_ms LIMIT $1 {skip_locked}) \
    RETURNING id, tenant, state, attempt, failure, metadata, created_ms, started_ms, finished_ms";
const ANNOUNCED_ONE: &str = "UPDATE jobs SET announced = 1 WHERE announced = 0 AND finished_ms IS NOT NULL \
    AND tenant = $1 AND id = $2 \
    RETURNING id, tenant, state, attempt, failure, metadata, created_ms, started_ms, finished_ms";

/// Announces jobs that have ended, when this process `changes` one and every `poll` for what others ended; the `dispatcher` then
/// sends the messages.
pub async fn keep_up(records: Records, dispatcher: Dispatcher, mut changes: watch::Receiver<()>, poll: Duration) {
    loop {
        if let Err(error) = announce_all(&records).await {
            tracing::warn!(%error, "cannot announce jobs that have ended; the service tries again later");
        }
        // Also when nothing was left to announce: a job that was deleted is announced by the transaction that deletes it.
        dispatcher.wake();
        sleep(GAP).await;
        tokio::select! {
            _ = changes.changed() => {}
            () = sleep(poll) => {}
        }
    }
}

async fn announce_all(records: &Records) -> Result<(), Error> {
    while announce(records).await? > 0 {}
    Ok(())
}

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

/// Announces a job that is about to be deleted, if it has ended and is not announced yet. Must be the first statement of its
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
                tracing::error!(%error, "cannot write the message about the end of a job");
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
                deliveries::insert(transaction, &endpoint.text("id")?, event.name(), Some(&id), &body).await?;
            }
        }
    }
    Ok(jobs.len())
}

/// A job that has ended, as webhooks receive it; the links lead to the rest.
#[derive(Serialize, utoipa::ToSchema)]
pub struct EndedJob {
    /// Identifier of the job.
    id: String,
    /// State in which the job ended.
    state: State,
    /// Number of attempts at the job.
    attempt: i64,
    /// Why the job failed, as in the job itself; null if it did not.
    #[schema(value_type = Option<Object>)]
    problem: Option<Failure>,
    /// The client's own metadata.
    metadata: Metadata,
    /// When the job was accepted, epoch ms.
    created_ms: i64,
    /// When the job was last started, epoch ms; null if it was not.
    started_ms: Option<i64>,
    /// When the job ended, epoch ms.
    finished_ms: i64,
    /// Addresses of related objects.
    links: EndedLinks,
}

/// Addresses that belong to an ended job.
#[derive(Serialize, utoipa::ToSchema)]
pub struct EndedLinks {
    /// Address of this object.
    #[serde(rename = "self")]
    this: String,
    /// List of the artifacts; null unless the job has succeeded.
    artifacts: Option<String>,
    /// Zip file of all artifacts; null unless the job has succeeded.
    zip: Option<String>,
}

/// The message of a job that has ended, as its row has it.
fn ended(row: &Row) -> Result<(Event, EndedJob), Error> {
    let state = row.text("state")?;
    let state = State::parse(&state);
    let unknown = || Error::fault("a job that has not ended is announced");
    let (state, event) = state.and_then(|state| Some((state, event_of(state)?))).ok_or_else(unknown)?;
    let (id, failure) = (row.text("id")?, row.optional_text("failure")?);
    let problem = failure.map(|failure| serde_json::from_str(&failure)).transpose();
    let this = format!("/v1/jobs/{id}");
    let succeeded = state == State::Succeeded;
    let links = EndedLinks {
        artifacts: succeeded.then(|| format!("{this}/artifacts")),
        zip: succeeded.then(|| format!("{this}/{ZIP}")),
        this,
    };
    let job = EndedJob {
        id,
        state,
        attempt: row.number("attempt")?,
        problem: problem.map_err(Error::fault)?,
        metadata: rows::read(&row.text("metadata")?)?,
        created_ms: row.number("created_ms")?,
        started_ms: row.optional_number("started_ms")?,
        finished_ms: row.number("finished_ms")?,
        links,
    };
    Ok((event, job))
}

/// The event for a job in this state; `None` before its end.
fn event_of(state: State) -> Option<Event> {
    match state {
        State::Succeeded => Some(Event::Succeeded),
        State::Failed => Some(Event::Failed),
        State::Cancelled => Some(Event::Cancelled),
        State::Queued | State::Running => None,
    }
}
