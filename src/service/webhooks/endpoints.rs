//! Rows of endpoints.

use super::{Event, signature};
use crate::accounts::tenants;
use crate::storage::error::Error;
use crate::storage::keys::new_id;
use crate::storage::records::Records;
use crate::storage::records::statement::{Row, ms, sql};
use std::time::Duration;

/// Largest number of endpoints of a tenant: each receives an event for every job.
pub const MOST: i64 = 20;

/// An endpoint: a URL of a tenant that receives events about its jobs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Endpoint {
    /// UUIDv7.
    pub id: String,
    /// URL that events are posted to.
    pub url: String,
    /// The events that the endpoint receives.
    pub events: Vec<Event>,
    /// A note for people.
    pub description: String,
    /// Since when the endpoint has accepted nothing, epoch ms; `None` while it accepts events.
    pub failing_since_ms: Option<i64>,
    /// Why the endpoint is disabled; `None` if it is enabled.
    pub disabled_why: Option<String>,
    /// Until when the previous secret signs too, epoch ms.
    pub old_secret_until_ms: Option<i64>,
    /// When the endpoint was created, epoch ms.
    pub created_ms: i64,
}

/// The settings of an endpoint that a client may choose.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EndpointSettings {
    /// URL that events are posted to.
    pub url: String,
    /// The events that the endpoint receives.
    pub events: Vec<Event>,
    /// A note for people.
    pub description: String,
}

fn endpoint(row: &Row) -> Result<Endpoint, Error> {
    Ok(Endpoint {
        id: row.text("id")?,
        url: row.text("url")?,
        events: events(&row.text("events")?),
        description: row.text("description")?,
        failing_since_ms: row.optional_number("failing_since_ms")?,
        disabled_why: row.optional_text("disabled_why")?,
        old_secret_until_ms: row.optional_number("old_secret_until_ms")?,
        created_ms: row.number("created_ms")?,
    })
}

/// Reads the events of a row; events of a newer version are left out.
pub fn events(text: &str) -> Vec<Event> {
    text.split(' ').filter_map(Event::parse).collect()
}

fn names(events: &[Event]) -> String {
    events.iter().map(|event| event.name()).collect::<Vec<_>>().join(" ")
}

/// Creates an endpoint of `tenant` with its secret; `None` if the tenant has [`MOST`] endpoints already.
///
/// # Errors
/// The database did not answer; the system has no randomness.
pub async fn create(
    records: &Records,
    tenant: &str,
    settings: EndpointSettings,
) -> Result<Option<(Endpoint, String)>, Error> {
    let secret = signature::secret()?;
    let insert = "INSERT INTO webhooks (id, tenant, url, events, description, secret, created_ms) \
                  SELECT $1, $2, $3, $4, $5, $6, {now} \
                  WHERE (SELECT COUNT(*) FROM webhooks WHERE tenant = $2) < $7 RETURNING *";
    let insert = sql(insert).bind(new_id()).bind(tenant).bind(settings.url).bind(names(&settings.events));
    let insert = insert.bind(settings.description).bind(secret.as_str()).bind(MOST);
    let mut transaction = records.begin().await?;
    // Two at once cannot both be the last.
    tenants::hold(&mut transaction, tenant).await?;
    let rows = transaction.read(insert).await?;
    transaction.commit().await?;
    rows.first().map(|row| Ok((endpoint(row)?, secret))).transpose()
}

/// The endpoint `id` of `tenant`, if there is one.
///
/// # Errors
/// The database did not answer.
pub async fn get(records: &Records, tenant: &str, id: &str) -> Result<Option<Endpoint>, Error> {
    let select = sql("SELECT * FROM webhooks WHERE tenant = $1 AND id = $2");
    records.read_one(select.bind(tenant).bind(id)).await?.as_ref().map(endpoint).transpose()
}

/// At most `limit` endpoints of `tenant`, older than the one called `before`, newest first.
///
/// # Errors
/// The database did not answer.
pub async fn list(records: &Records, tenant: &str, before: Option<&str>, limit: i64) -> Result<Vec<Endpoint>, Error> {
    let select = "SELECT * FROM webhooks WHERE tenant = $1 AND ($2 IS NULL OR id < $2) ORDER BY id DESC LIMIT $3";
    records.read(sql(select).bind(tenant).bind(before).bind(limit)).await?.iter().map(endpoint).collect()
}

/// Changes the settings of an endpoint, and enables it if it was disabled. False if there is no such endpoint.
///
/// # Errors
/// The database did not answer.
pub async fn change(records: &Records, tenant: &str, id: &str, settings: EndpointSettings) -> Result<bool, Error> {
    let change = "UPDATE webhooks SET url = $1, events = $2, description = $3, disabled_why = NULL, \
                  failing_since_ms = CASE WHEN disabled_why IS NULL AND url = $1 THEN failing_since_ms END \
                  WHERE tenant = $4 AND id = $5";
    let change = sql(change).bind(settings.url).bind(names(&settings.events)).bind(settings.description);
    Ok(records.write(change.bind(tenant).bind(id)).await? > 0)
}

/// Deletes an endpoint and its deliveries. False if there is no such endpoint.
///
/// # Errors
/// The database did not answer.
pub async fn delete(records: &Records, tenant: &str, id: &str) -> Result<bool, Error> {
    Ok(records.write(sql("DELETE FROM webhooks WHERE tenant = $1 AND id = $2").bind(tenant).bind(id)).await? > 0)
}

/// Makes a new secret; the one before signs too for `overlap`. Where one before still does, it goes on: an answer that was lost and
/// asked for again leaves the receiver the secret it has. `None` when there is no such endpoint.
///
/// # Errors
/// As [`create`].
pub async fn rotate(records: &Records, tenant: &str, id: &str, overlap: Duration) -> Result<Option<String>, Error> {
    let secret = signature::secret()?;
    let rotate = "UPDATE webhooks SET \
                  old_secret = CASE WHEN old_secret_until_ms > {now} THEN old_secret ELSE secret END, old_secret_until_ms = {now} + $1, secret = $2 \
                  WHERE tenant = $3 AND id = $4";
    let rotate = sql(rotate).bind(ms(overlap)).bind(secret.as_str()).bind(tenant).bind(id);
    Ok((records.write(rotate).await? > 0).then_some(secret))
}
