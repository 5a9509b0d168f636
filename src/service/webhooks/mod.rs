//! Webhooks (Standard Webhooks, <https://www.standardwebhooks.com>): the endpoints of a tenant receive an event when one of its
//! jobs ends. Every event is delivered at least once, and signed; a repeated event has the same `webhook-id`.

/// Endpoints: the URLs that receive events.
pub mod endpoints;
/// Deliveries: events on their way to endpoints, and their results.
pub mod deliveries;
/// The dispatcher, which sends due deliveries.
pub mod dispatcher;
/// Signatures and their secrets.
pub mod signature;

use crate::calendar::rfc_3339;
use crate::forwarded::Prefix;
use crate::storage::error::Error;
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// An event that a webhook can receive.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
pub enum Event {
    /// A job has succeeded.
    #[serde(rename = "job.succeeded")]
    Succeeded,
    /// A job has failed.
    #[serde(rename = "job.failed")]
    Failed,
    /// A job was cancelled.
    #[serde(rename = "job.cancelled")]
    Cancelled,
}

/// What [`crate::jobs::outbox::ping`] tells: nothing has happened.
pub const PING: &str = "ping";

impl Event {
    /// All events.
    pub const ALL: [Event; 3] = [Event::Succeeded, Event::Failed, Event::Cancelled];

    /// Name of the event in the database, in messages and in requests.
    pub fn name(self) -> &'static str {
        match self {
            Event::Succeeded => "job.succeeded",
            Event::Failed => "job.failed",
            Event::Cancelled => "job.cancelled",
        }
    }

    /// Reads what [`Event::name`] writes.
    pub fn parse(name: &str) -> Option<Event> {
        Event::ALL.into_iter().find(|event| event.name() == name)
    }
}

/// Timing of deliveries.
#[derive(Clone, Debug)]
pub struct Policy {
    /// Waits before each attempt after the first; after the last of them the delivery has failed.
    pub waits: Vec<Duration>,
    /// Time limit of an attempt.
    pub longest: Duration,
    /// Time without an accepted event after which an endpoint is disabled.
    pub give_up: Duration,
    /// How long ended deliveries are kept.
    pub keep: Duration,
    /// How long a secret that was replaced still signs.
    pub overlap: Duration,
    /// The path of the public URL of the service, which the links in messages begin with.
    pub prefix: Prefix,
}

impl Policy {
    /// A message as it is posted: its links below the path of the service's public URL.
    fn addressed(&self, message: &str) -> String {
        let links = |message: &str| {
            let mut message: serde_json::Value = serde_json::from_str(message).ok()?;
            for link in message.get_mut("data")?.get_mut("links")?.as_object_mut()?.values_mut() {
                if let serde_json::Value::String(path) = link {
                    path.insert_str(0, self.prefix.as_str());
                }
            }
            Some(message.to_string())
        };
        let changed = Some(message).filter(|_| !self.prefix.as_str().is_empty()).and_then(links);
        changed.unwrap_or_else(|| message.to_owned())
    }
}

impl Default for Policy {
    /// The waits that the standard gives as an example: three days in all, and up to a fifth more.
    fn default() -> Policy {
        let hours = [2, 5, 10, 14, 20, 24].map(Duration::from_hours);
        let first = [Duration::from_secs(5), Duration::from_mins(5), Duration::from_mins(30)];
        Policy {
            waits: first.into_iter().chain(hours).collect(),
            longest: Duration::from_secs(15),
            give_up: Duration::from_hours(72),
            keep: Duration::from_hours(30 * 24),
            overlap: Duration::from_hours(24),
            prefix: Prefix::default(),
        }
    }
}

/// The message that is posted to a webhook.
#[derive(Serialize, utoipa::ToSchema)]
#[schema(as = WebhookMessage)]
pub struct Message<T> {
    /// Name of the event.
    #[serde(rename = "type")]
    kind: &'static str,
    /// When it happened, RFC 3339.
    timestamp: String,
    /// What the event is about.
    data: T,
}

/// The message that is posted: the name of the event, its time (epoch ms) and its data.
///
/// # Errors
/// The data cannot be written as JSON.
pub fn message<T: Serialize>(kind: &'static str, at_ms: i64, data: T) -> Result<String, Error> {
    let message = Message { kind, timestamp: rfc_3339(at_ms), data };
    serde_json::to_string(&message).map_err(Error::fault)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_are_below_the_public_path_and_nothing_else_changes() {
        let message = r#"{"type":"ping","timestamp":"2026-01-01T00:00:00Z","data":{"id":"/v1/x","links":{"self":"/v1/jobs/x","zip":null}}}"#;
        let policy = Policy { prefix: Prefix::parse("/lamps").unwrap(), ..Policy::default() };
        let changed: serde_json::Value = serde_json::from_str(&policy.addressed(message)).unwrap();
        assert_eq!(
            changed["data"],
            serde_json::json!({"id": "/v1/x", "links": {"self": "/lamps/v1/jobs/x", "zip": null}})
        );
        assert_eq!(Policy::default().addressed(message), message);
        assert_eq!(policy.addressed(r#"{"type":"ping","data":{}}"#), r#"{"type":"ping","data":{}}"#);
    }

    #[test]
    fn the_waits_are_those_of_the_standard() {
        // Its table: time since start before each attempt.
        let since: Vec<u64> = Policy::default()
            .waits
            .iter()
            .scan(0, |since, wait| {
                *since += wait.as_secs();
                Some(*since)
            })
            .collect();
        let minutes = |hours: u64, minutes: u64| (hours * 60 + minutes) * 60 + 5;
        let table = [
            5,
            minutes(0, 5),
            minutes(0, 35),
            minutes(2, 35),
            minutes(7, 35),
            minutes(17, 35),
            minutes(31, 35),
            minutes(51, 35),
            minutes(75, 35),
        ];
        assert_eq!(since, table);
    }
}
