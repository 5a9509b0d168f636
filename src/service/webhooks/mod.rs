//! Webhooks (Standard Webhooks, <https://www.standardwebhooks.com>): a tenant's endpoints hear that its jobs have ended. At least
//! once, and signed; what is told twice has the same `webhook-id`.

/// Where to tell it.
pub mod endpoints;
/// What is to be told, and how that went.
pub mod deliveries;
/// Tells it.
pub mod dispatcher;
/// Who told it.
pub mod signature;

use super::jobs::worker::ZIP;
use super::jobs::{Failure, State};
use super::storage::Error;
use super::storage::records::Row;
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// What an endpoint can hear of.
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

/// What [`deliveries::ping`] tells: nothing has happened.
pub const PING: &str = "ping";

impl Event {
    /// All.
    pub const ALL: [Event; 3] = [Event::Succeeded, Event::Failed, Event::Cancelled];

    /// The word in rows, messages and requests.
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

    fn of(state: State) -> Option<Event> {
        match state {
            State::Succeeded => Some(Event::Succeeded),
            State::Failed => Some(Event::Failed),
            State::Cancelled => Some(Event::Cancelled),
            State::Queued | State::Running => None,
        }
    }
}

/// How deliveries are made.
#[derive(Clone, Debug)]
pub struct Policy {
    /// How long to wait before each attempt after the first; without one more, it has failed.
    pub waits: Vec<Duration>,
    /// Longest time of an attempt.
    pub longest: Duration,
    /// An endpoint that took nothing for so long is disabled.
    pub give_up: Duration,
    /// How long it is known what was told.
    pub keep: Duration,
    /// How long a secret that was replaced still signs.
    pub overlap: Duration,
}

impl Default for Policy {
    /// The waits that the standard gives as an example: three days in all.
    fn default() -> Policy {
        let hours = [2, 5, 10, 14, 20, 24].map(Duration::from_hours);
        let first = [Duration::from_secs(5), Duration::from_mins(5), Duration::from_mins(30)];
        Policy {
            waits: first.into_iter().chain(hours).collect(),
            longest: Duration::from_secs(15),
            give_up: Duration::from_hours(72),
            keep: Duration::from_hours(30 * 24),
            overlap: Duration::from_hours(24),
        }
    }
}

/// What is posted.
#[derive(Serialize, utoipa::ToSchema)]
#[schema(as = WebhookMessage)]
pub struct Message<T> {
    /// What has happened: an event's name.
    #[serde(rename = "type")]
    kind: &'static str,
    /// When, RFC 3339.
    timestamp: String,
    /// To what.
    data: T,
}

/// A job that has ended, as endpoints hear of it; the links lead to the rest.
#[derive(Serialize, utoipa::ToSchema)]
pub struct EndedJob {
    /// Its identifier.
    id: String,
    /// How it has ended.
    state: State,
    /// How often it was begun.
    attempt: i64,
    /// Why it failed, if it did: as the job tells.
    #[schema(value_type = Option<Object>)]
    problem: Option<Failure>,
    /// When it was accepted, epoch ms.
    created_ms: i64,
    /// When it was last begun, epoch ms.
    started_ms: Option<i64>,
    /// When it ended, epoch ms.
    finished_ms: i64,
    /// Where things are.
    links: EndedLinks,
}

/// Where an ended job's things are, on the service that tells of it.
#[derive(Serialize, utoipa::ToSchema)]
pub struct EndedLinks {
    /// Itself.
    #[serde(rename = "self")]
    this: String,
    /// The list of its artifacts; null unless it has succeeded.
    artifacts: Option<String>,
    /// All of them in one zip; null unless it has succeeded.
    zip: Option<String>,
}

/// The message of a job that has ended, as its row has it.
fn ended(row: &Row) -> Result<(Event, EndedJob), Error> {
    let state = row.text("state")?;
    let state = State::parse(&state);
    let unknown = || Error::Records("a job that has not ended is announced".into());
    let (state, event) = state.and_then(|state| Some((state, Event::of(state)?))).ok_or_else(unknown)?;
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
        problem: problem.map_err(|error| Error::Records(Box::new(error)))?,
        created_ms: row.number("created_ms")?,
        started_ms: row.optional_number("started_ms")?,
        finished_ms: row.number("finished_ms")?,
        links,
    };
    Ok((event, job))
}

fn message<T: Serialize>(kind: &'static str, at_ms: i64, data: T) -> Result<String, Error> {
    let message = Message { kind, timestamp: rfc_3339(at_ms), data };
    serde_json::to_string(&message).map_err(|error| Error::Records(Box::new(error)))
}

/// Epoch ms as RFC 3339 writes it, in UTC. The days are counted as Howard Hinnant's `civil_from_days` does: years begin in March,
/// so that the day that may be missing is the last.
fn rfc_3339(at_ms: i64) -> String {
    let (days, in_day_ms) = (at_ms.div_euclid(86_400_000), at_ms.rem_euclid(86_400_000));
    let from_march_0000 = days + 719_468;
    let (era, in_era) = (from_march_0000.div_euclid(146_097), from_march_0000.rem_euclid(146_097));
    let year_in_era = (in_era - in_era / 1460 + in_era / 36_524 - in_era / 146_096) / 365;
    let in_year = in_era - (365 * year_in_era + year_in_era / 4 - year_in_era / 100);
    let month_from_march = (5 * in_year + 2) / 153;
    let day = in_year - (153 * month_from_march + 2) / 5 + 1;
    let month = if month_from_march < 10 { month_from_march + 3 } else { month_from_march - 9 };
    let year = year_in_era + 400 * era + i64::from(month <= 2);
    let (hour, minute) = (in_day_ms / 3_600_000, in_day_ms / 60_000 % 60);
    let (second, ms) = (in_day_ms / 1000 % 60, in_day_ms % 1000);
    format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}.{ms:03}Z")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_time_is_written_as_the_rfc_does() {
        // date --utc --iso-8601=ns, GNU coreutils 9.1.
        for (at_ms, written) in [
            (0, "1970-01-01T00:00:00.000Z"),
            (951_782_400_000, "2000-02-29T00:00:00.000Z"),
            (1_667_507_170_344, "2022-11-03T20:26:10.344Z"),
            (1_735_689_599_999, "2024-12-31T23:59:59.999Z"),
            (4_107_542_400_000, "2100-03-01T00:00:00.000Z"),
            (-1, "1969-12-31T23:59:59.999Z"),
        ] {
            assert_eq!(rfc_3339(at_ms), written);
        }
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
