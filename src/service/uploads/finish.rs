//! Finishes complete uploads: makes ray sets of them, or refuses them. Every process that answers clients does this; a lease gives
//! an upload to one of them at a time, and if that process ends, another one goes on. The parts of a file that is not packed
//! become the ray set's as they are: nothing is copied.

use super::outcome::Claim;
use super::rows::{Concat, State, Upload};
use super::signals::UploadResult;
use super::{Error, Reason, Uploads, outcome, refused, rows};
use crate::cause::Cause;
use crate::ray_sets::error::Error as FileError;
use crate::ray_sets::extent::Extent;
use crate::ray_sets::rows::{Draft, LeftOut};
use crate::ray_sets::spool::{PREFIX_BYTES, Stored};
use crate::storage::Storage;
use crate::{priority, storage};
use pipeline::Bytes as _;
use std::collections::HashMap;
use std::pin::pin;
use std::time::Duration;
use tokio::task::{Id, JoinError, JoinSet};
use tokio::time::{Instant, MissedTickBehavior, interval, timeout};
use tokio_util::sync::CancellationToken;

/// Uploads finished at once: each is read to its end.
const AT_ONCE: usize = 4;
/// Read at once for a digest, bytes.
const BLOCK_BYTES: usize = 1 << 20;
/// How long the request with the last byte waits for the end of its upload.
const WAIT: Duration = Duration::from_secs(10);
/// How often it looks: another process may be the one that finishes.
const LOOK: Duration = Duration::from_millis(50);
/// Longest time between two attempts where a store has no answer or no room, leases.
const MAX_BACK_OFF: u32 = 32;
/// Longest time between two looks for uploads whose time is over.
const EXPIRY_LOOK: Duration = Duration::from_mins(1);

/// What happens to an upload after a failed attempt to finish it.
enum AfterFailure {
    /// Refuse the upload and delete its bytes.
    Refuse,
    /// Refuse the upload but keep its bytes, because it is not known what is wrong with them.
    GiveUp,
    /// Try again later; the attempt is counted if the upload may be at fault.
    Retry { counted: bool },
    /// Do nothing: another process has the upload, or it is deleted.
    Leave,
}

/// What an upload is to become.
type Made = Result<(Vec<Draft>, Vec<LeftOut>), FileError>;

impl Uploads {
    /// Finishes complete uploads, [`AT_ONCE`] at a time, until the service stops: the uploads of this process, and those that
    /// other processes have left.
    pub async fn finish_all(self, poll: Duration) {
        let (mut ticker, mut tasks, mut at_hand) = (interval(poll), JoinSet::new(), HashMap::new());
        ticker.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            tokio::select! {
                _ = ticker.tick() => {}
                () = self.ends.come.notified() => {}
                Some(done) = tasks.join_next_with_id() => {
                    let went_well = self.done(&mut at_hand, done);
                    self.ends.gone.notify_waiters();
                    if !went_well {
                        // Not at once again.
                        continue;
                    }
                }
                () = self.stopping.cancelled() => break,
            }
            if let Err(error) = self.finish_waiting(&mut tasks, &mut at_hand).await {
                tracing::warn!(%error, "cannot search for uploads to finish; trying again later");
            }
        }
        while tasks.join_next().await.is_some() {}
    }

    /// Takes an upload out of hand; whether the database answered.
    fn done(
        &self,
        at_hand: &mut HashMap<Id, String>,
        done: Result<(Id, Result<(), storage::Error>), JoinError>,
    ) -> bool {
        let (task, error) = match done {
            Ok((task, finished)) => (task, finished.err().map(|error| error.to_string())),
            Err(error) => (error.id(), Some(error.to_string())),
        };
        let upload = at_hand.remove(&task);
        if let Some(error) = &error {
            tracing::warn!(upload, error, "cannot finish an upload; trying again later");
        }
        error.is_none()
    }

    /// Puts in hand what waits and is not in hand already, which it may be when this process was slow to renew its lease.
    async fn finish_waiting(
        &self,
        tasks: &mut JoinSet<Result<(), storage::Error>>,
        at_hand: &mut HashMap<Id, String>,
    ) -> Result<(), storage::Error> {
        let places = AT_ONCE.saturating_sub(tasks.len());
        if places == 0 {
            return Ok(());
        }
        let mut waiting = outcome::waiting(&self.intake.storage.records).await?;
        waiting.retain(|id| !at_hand.values().any(|held| held == id));
        for id in waiting.into_iter().take(places) {
            let (this, finished) = (self.clone(), id.clone());
            let task = tasks.spawn(async move { this.finish(&finished).await });
            at_hand.insert(task.id(), id);
        }
        Ok(())
    }

    /// Finishes the upload `id`, if it is complete and no other process finishes it.
    async fn finish(&self, id: &str) -> Result<(), storage::Error> {
        let Some(claim) = outcome::claim(&self.intake.storage.records, id, self.lease).await? else {
            return Ok(());
        };
        if claim.attempt > i64::from(self.max_attempts) {
            return self.refuse(&claim, Reason::FinishingLost(self.max_attempts), true).await;
        }
        let gone = CancellationToken::new();
        let _gone = gone.clone().drop_guard();
        let mut making = pin!(self.make(&claim, gone.clone()));
        let made = tokio::select! {
            made = self.supervise(&claim, &gone, &mut making) => made,
            () = self.stopping.cancelled() => return self.let_go(&claim, &gone, making).await,
        };
        match made {
            Ok((drafts, left_out)) => self.take(&claim, drafts, left_out).await,
            Err(error) => match self.after_failure(&claim, &error) {
                AfterFailure::Refuse => self.refuse(&claim, Reason::File(error), false).await,
                AfterFailure::GiveUp => self.refuse(&claim, Reason::File(error), true).await,
                AfterFailure::Retry { counted } => self.put_back(&claim, &error, counted).await,
                AfterFailure::Leave => Ok(()),
            },
        }
    }

    /// Leaves an upload to others at once, its attempt not counted: this process stops, the upload is not at fault.
    async fn let_go(
        &self,
        claim: &Claim,
        gone: &CancellationToken,
        making: impl Future<Output = Made>,
    ) -> Result<(), storage::Error> {
        gone.cancel();
        outcome::put_back(&self.intake.storage.records, claim, Duration::ZERO, false).await?;
        // It may have come to its end all the same.
        if let Ok((drafts, _)) = making.await {
            self.delete_unpacked_blobs(claim, drafts.iter().map(|draft| draft.ray_set.id.as_str())).await;
        }
        Ok(())
    }

    /// Waits up to [`WAIT`] for a complete upload to be finished, and returns it.
    pub(super) async fn ended(&self, tenant: &str, id: &str) -> Result<Upload, Error> {
        let begun = Instant::now();
        self.ends.come.notify_one();
        loop {
            let gone = self.ends.gone.notified();
            let upload = rows::get(&self.intake.storage.records, tenant, id).await?;
            let upload = upload.ok_or_else(|| Error::Missing(id.to_owned()))?;
            let waits = begun.elapsed() < WAIT && !self.stopping.is_cancelled();
            match upload.state {
                State::Refused => return Err(refused(&upload)),
                State::Finishing if waits => {
                    let _ = timeout(LOOK, gone).await;
                }
                _ => return Ok(upload),
            }
        }
    }

    /// Runs `making` to its end while the lease is renewed; cancels `gone` when the lease is lost.
    async fn supervise<T>(&self, claim: &Claim, gone: &CancellationToken, making: impl Future<Output = T>) -> T {
        let mut ticker = interval(self.lease / 3);
        ticker.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut making = pin!(making);
        loop {
            tokio::select! {
                made = &mut making => return made,
                _ = ticker.tick() => match outcome::renew(&self.intake.storage.records, claim, self.lease).await {
                    Ok(true) => {}
                    Ok(false) => gone.cancel(),
                    Err(error) => tracing::warn!(upload = claim.upload.id, %error, "cannot renew the lease of an upload; trying again"),
                },
            }
        }
    }

    /// The ray sets that an upload is to be.
    async fn make(&self, claim: &Claim, gone: CancellationToken) -> Made {
        let Claim { tenant, upload, .. } = claim;
        let Storage { records, .. } = &self.intake.storage;
        let (byte_count, parts) = (upload.offset, rows::parts(records, &upload.id).await?);
        let (id, name) = (upload.id.clone(), upload.name.clone());
        let sha256 = String::new();
        let mut stored = Stored { id, name, sha256, is_packed: false, byte_count, parts, inspecting: None };
        let extent = match &upload.concat {
            Concat::Final { .. } => self.read_once(&stored, gone.clone()).await?,
            Concat::Whole | Concat::Partial => Extent::resumed(upload.offset, &upload.sha256_state)
                .ok_or_else(|| storage::Error::fault("the stored state of a digest cannot be read"))?,
        };
        stored.sha256 = extent.sha256();
        if let Some(announced) = upload.announced.iter().find(|announced| **announced != stored.sha256) {
            return Err(FileError::Digest { announced: announced.clone(), found: stored.sha256 });
        }
        stored.is_packed = self.intake.judge(&self.prefix(&stored).await?, Some(byte_count))?;
        // The bytes of a packed upload go when what is in it is kept.
        let room = self.intake.quota.room(records, tenant).await?.without(byte_count);
        let mut made = self.intake.drafts(stored, upload.declared.clone(), room, gone).await?;
        made.0.iter_mut().for_each(|draft| draft.ray_set.metadata = upload.client_metadata.clone());
        Ok(made)
    }

    /// Reads a stored file to its end for its SHA-256, which does not follow from those of its pieces. Runs on a thread that may
    /// block.
    async fn read_once(&self, stored: &Stored, gone: CancellationToken) -> Result<Extent, FileError> {
        let bytes = self.intake.read(stored);
        let reading = priority::compute("digest", move || {
            let (mut extent, mut block) = (Extent::of_one_request(), vec![0; BLOCK_BYTES]);
            while extent.byte_count < bytes.len() {
                if gone.is_cancelled() {
                    return Err(pipeline::Error::Cancelled);
                }
                let rest = usize::try_from(bytes.len() - extent.byte_count).unwrap_or(usize::MAX);
                let piece = block.get_mut(..rest.min(BLOCK_BYTES)).unwrap_or_default();
                bytes.read_at(extent.byte_count, piece).map_err(pipeline::Error::Unreadable)?;
                extent.extend(piece);
            }
            Ok(extent)
        });
        Ok(reading.await.map_err(pipeline::Error::from)??)
    }

    /// The beginning of a stored file.
    async fn prefix(&self, stored: &Stored) -> Result<Vec<u8>, storage::Error> {
        let mut prefix = Vec::new();
        for part in &stored.parts {
            let missing = (PREFIX_BYTES - prefix.len()) as u64;
            prefix.extend(self.intake.storage.blobs.read(&part.blob, 0..part.byte_count.min(missing)).await?);
            if prefix.len() == PREFIX_BYTES {
                break;
            }
        }
        Ok(prefix)
    }

    fn after_failure(&self, claim: &Claim, error: &FileError) -> AfterFailure {
        match Cause::from(error) {
            Cause::Input => AfterFailure::Refuse,
            Cause::Stopped => AfterFailure::Leave,
            Cause::Ours if claim.attempt >= i64::from(self.max_attempts) => AfterFailure::GiveUp,
            Cause::Ours => AfterFailure::Retry { counted: true },
            // A store that never answers must not keep the upload for ever: its bytes stay as long again. The same for one that
            // has lost bytes: nobody else has them, and they come back if it was a disk that is not mounted.
            Cause::StoreAway | Cause::StoreDamaged if claim.is_overdue => AfterFailure::GiveUp,
            Cause::StoreAway | Cause::StoreDamaged => AfterFailure::Retry { counted: false },
        }
    }

    async fn put_back(&self, claim: &Claim, error: &FileError, counted: bool) -> Result<(), storage::Error> {
        tracing::warn!(upload = claim.upload.id, attempt = claim.attempt, %error, "cannot finish an upload now; trying again later");
        let wait = if counted { self.lease } else { back_off(self.lease, claim.fence) };
        outcome::put_back(&self.intake.storage.records, claim, wait, counted).await
    }

    /// Makes it known what an upload has become.
    async fn take(&self, claim: &Claim, drafts: Vec<Draft>, left_out: Vec<LeftOut>) -> Result<(), storage::Error> {
        let (id, records) = (&claim.upload.id, &self.intake.storage.records);
        let ids: Vec<String> = drafts.iter().map(|draft| draft.ray_set.id.clone()).collect();
        let became = UploadResult { ray_sets: ids.clone(), left_out };
        let result = serde_json::to_string(&became).map_err(storage::Error::fault)?;
        // Should this fail, rows may or may not name them: only the sweep of garbage can tell.
        let taken = outcome::take(records, self.intake.quota, claim, drafts, &result, self.expiry).await?;
        if taken != Ok(true) {
            self.delete_unpacked_blobs(claim, ids.iter().map(String::as_str)).await;
        } else if !ids.contains(id) {
            self.delete_upload_blobs(id, &claim.upload.concat).await;
        }
        match taken {
            Err(exceeded) => self.refuse(claim, Reason::File(exceeded.into()), false).await,
            Ok(_) => Ok(()),
        }
    }

    /// Deletes the blobs of ray sets to be, but for those that are the upload's own.
    async fn delete_unpacked_blobs(&self, claim: &Claim, ray_sets: impl Iterator<Item = &str>) {
        for id in ray_sets.filter(|id| *id != claim.upload.id) {
            self.intake.delete_blobs(id).await;
        }
    }

    /// Ends an upload, and its bytes too unless they stay.
    async fn refuse(&self, claim: &Claim, reason: Reason, bytes_stay: bool) -> Result<(), storage::Error> {
        let (id, records) = (&claim.upload.id, &self.intake.storage.records);
        let said = serde_json::to_string(&(self.refusal_of)(reason)).map_err(storage::Error::fault)?;
        if bytes_stay {
            tracing::error!(
                upload = id,
                tenant = claim.tenant,
                problem = said,
                "an upload failed for good; its bytes are kept until it expires"
            );
            outcome::give_up(records, claim, &said, self.expiry).await?;
        } else if outcome::refuse(records, claim, &said, self.expiry).await? {
            self.delete_upload_blobs(id, &claim.upload.concat).await;
        }
        Ok(())
    }

    /// Deletes expired uploads, again and again.
    pub async fn keep_up(self) {
        let mut ticker = interval((self.expiry / 24).clamp(LOOK, EXPIRY_LOOK));
        ticker.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            ticker.tick().await;
            self.expire().await;
        }
    }

    async fn expire(&self) {
        match outcome::expire(&self.intake.storage.records).await {
            Ok(expired) => {
                for gone in expired {
                    tracing::info!(upload = gone.id, state = gone.was.name(), "an upload has expired");
                    self.delete_unless_taken(&gone).await;
                }
            }
            Err(error) => tracing::warn!(%error, "cannot search for expired uploads; trying again later"),
        }
    }
}

/// How long to wait after the claim `fence` of an upload: twice as long each time.
fn back_off(lease: Duration, fence: i64) -> Duration {
    let earlier = u32::try_from(fence.saturating_sub(1).max(0)).unwrap_or(u32::MAX);
    lease.saturating_mul(2_u32.saturating_pow(earlier).min(MAX_BACK_OFF))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_attempt_is_waited_for_twice_as_long_each_time_up_to_a_bound() {
        let leases = [1, 2, 3, 6, 7, 1000, i64::MAX].map(|fence| back_off(Duration::from_secs(1), fence).as_secs());
        assert_eq!(leases, [1, 2, 4, 32, 32, 32, 32]);
    }
}
