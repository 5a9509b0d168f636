//! Tells endpoints what is due. Every process does, and which of them does not matter: a delivery is leased to one of them.

use super::deliveries::{Attempted, DueDelivery};
use super::{Policy, deliveries, signature};
use crate::crash;
use crate::metrics::Metrics;
use crate::outbound::Outbound;
use crate::storage::error::Error;
use crate::storage::records::Records;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::Notify;
use tokio::task::JoinSet;
use tokio::time::{Instant, sleep};
use tokio_util::sync::CancellationToken;

/// Attempts of this process at once: sockets that mostly wait.
const AT_ONCE: usize = 64;
/// Least time between two looks.
const GAP: Duration = Duration::from_millis(50);
/// How often old deliveries are deleted.
const DELETE_OLD_EVERY: Duration = Duration::from_hours(1);

/// Sends due deliveries and deletes old ones. Cheap to clone.
#[derive(Clone)]
pub struct Dispatcher {
    records: Records,
    outbound: Outbound,
    policy: Arc<Policy>,
    metrics: Metrics,
    wake: Arc<Notify>,
}

impl Dispatcher {
    /// Tells what `records` say, by `outbound`.
    pub fn new(records: Records, outbound: Outbound, policy: Policy, metrics: Metrics) -> Dispatcher {
        Dispatcher { records, outbound, policy: Arc::new(policy), metrics, wake: Arc::default() }
    }

    /// How deliveries are made.
    pub fn policy(&self) -> &Policy {
        &self.policy
    }

    /// Sends the requests.
    pub fn outbound(&self) -> &Outbound {
        &self.outbound
    }

    /// There may be a delivery that is due.
    pub fn wake(&self) {
        self.wake.notify_one();
    }

    /// Sends what is due until the service is `stopping`: when it is woken, and every `poll` for what others announced and what is
    /// due again. Attempts that were begun are ended.
    pub async fn keep_up(self, poll: Duration, stopping: CancellationToken) {
        let mut sending = JoinSet::new();
        let mut delete_at = Instant::now();
        while !stopping.is_cancelled() {
            if let Err(error) = self.look(&mut sending).await {
                tracing::warn!(%error, "cannot search for deliveries that are due; trying again later");
            }
            if Instant::now() >= delete_at {
                delete_at = Instant::now() + DELETE_OLD_EVERY;
                if let Err(error) = deliveries::delete_old(&self.records, self.policy.keep).await {
                    tracing::warn!(%error, "cannot delete old deliveries; trying again later");
                }
            }
            sleep(GAP).await;
            tokio::select! {
                () = self.wake.notified() => {}
                _ = sending.join_next(), if !sending.is_empty() => {}
                () = sleep(poll) => {}
                () = stopping.cancelled() => {}
            }
        }
        while sending.join_next().await.is_some() {}
    }

    /// Begins what is due.
    async fn look(&self, sending: &mut JoinSet<()>) -> Result<(), Error> {
        while sending.try_join_next().is_some() {}
        while sending.len() < AT_ONCE
            && let Some(next) = deliveries::claim(&self.records, self.policy.longest).await?
        {
            sending.spawn(self.clone().send(next));
        }
        Ok(())
    }

    /// One attempt.
    async fn send(self, due: DueDelivery) {
        let how = self.attempt(&due).await;
        crash::point("deliver.answered");
        self.metrics.webhook_attempted(how.is_taken());
        let Attempted { status, error, .. } = &how;
        tracing::info!(
            delivery = due.id,
            webhook = due.webhook,
            attempt = due.attempt,
            status,
            error,
            "delivery attempted"
        );
        // A delivery whose end is not stored is claimed by another process when its lease is over, and sent again.
        match deliveries::end(&self.records, &due, &how, &self.policy).await {
            Ok(true) => {}
            Ok(false) => {
                tracing::warn!(delivery = due.id, "another process took over a delivery during an attempt")
            }
            Err(error) => {
                tracing::warn!(delivery = due.id, %error, "cannot store the result of a delivery attempt")
            }
        }
    }

    async fn attempt(&self, due: &DueDelivery) -> Attempted {
        let failed = |error: String| Attempted { error: Some(error), ..Attempted::default() };
        let DueDelivery { id, timestamp_s, body, secrets, .. } = due;
        let body = self.policy.addressed(body);
        let signature = match signature::sign(secrets, id, *timestamp_s, &body) {
            Ok(signature) => signature,
            Err(error) => {
                tracing::error!(delivery = id, %error, "cannot sign a delivery");
                return failed("the service could not sign it".to_owned());
            }
        };
        let headers = [
            ("webhook-id", id.clone()),
            ("webhook-timestamp", timestamp_s.to_string()),
            ("webhook-signature", signature),
        ];
        match self.outbound.post(&due.url, &headers, body, self.policy.longest).await {
            Ok(answer) => Attempted {
                status: Some(answer.status),
                answer: Some(answer.beginning),
                error: None,
                retry_after: answer.retry_after,
            },
            Err(error) => failed(error.to_string()),
        }
    }
}
