//! What becomes of an upload when all its bytes are there: ray sets, or a refusal. Any process that answers clients does this,
//! one at a time, by lease; one that dies on the way leaves it to the next. The parts of a file that is not packed become
//! the ray set's as they are: nothing is copied.

use super::super::api::problem::Problem;
use super::super::storage::endings::{self, Claim};
use super::super::storage::ray_sets::Draft;
use super::super::storage::uploads::{self, State, Upload};
use super::super::storage::{self, Storage};
use super::extent::Extent;
use super::resume::{Error, Uploads, refusal};
use super::spool::PREFIX_BYTES;
use super::{Error as FileError, LeftOut, Stored};
use crate::pipeline;
use serde::{Deserialize, Serialize};
use std::collections::HashSet;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;
use tokio::sync::{Semaphore, SemaphorePermit};
use tokio::task::JoinError;
use tokio::time::{Instant, MissedTickBehavior, interval, sleep, timeout};
use tokio_util::sync::CancellationToken;

/// Uploads finished at once: each is read to its end.
const AT_ONCE: usize = 4;
/// How long the request with the last byte waits for the end of its upload.
const WAIT: Duration = Duration::from_secs(10);
/// How often it looks.
const LOOK: Duration = Duration::from_millis(50);
/// Longest time between two looks for uploads whose time is over.
const EXPIRY_LOOK: Duration = Duration::from_mins(1);

/// What an upload has become, as its row has it.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Became {
    /// Ids of its ray sets.
    pub ray_sets: Vec<String>,
    /// What else was in a packed file.
    pub left_out: Vec<LeftOut>,
}

/// What is to be done about an upload that could not be finished.
enum Fate {
    /// It is refused.
    Refused,
    /// Tried again; it counts as an attempt when it may be the upload's fault.
    Again { counted: bool },
    /// It is another's, or deleted.
    Lost,
}

/// Uploads that this process finishes now.
pub struct AtHand {
    places: Semaphore,
    ids: Mutex<HashSet<String>>,
}

impl Default for AtHand {
    fn default() -> AtHand {
        AtHand { places: Semaphore::new(AT_ONCE), ids: Mutex::default() }
    }
}

impl AtHand {
    /// Puts an upload in hand until the guard is dropped; `None` when it is there already: this process may only have been
    /// slow to renew its lease.
    async fn take(&self, id: &str) -> Option<Held<'_>> {
        let place = self.places.acquire().await.ok()?;
        let is_new = self.ids.lock().unwrap_or_else(PoisonError::into_inner).insert(id.to_owned());
        is_new.then(|| Held { ids: &self.ids, id: id.to_owned(), _place: place })
    }
}

/// An upload in hand.
struct Held<'a> {
    ids: &'a Mutex<HashSet<String>>,
    id: String,
    _place: SemaphorePermit<'a>,
}

impl Drop for Held<'_> {
    fn drop(&mut self) {
        self.ids.lock().unwrap_or_else(PoisonError::into_inner).remove(&self.id);
    }
}

impl Uploads {
    /// Finishes the upload `id`, if all its bytes are there and nobody else does.
    ///
    /// # Errors
    /// The database did not answer; the upload is finished later.
    pub async fn finish(&self, id: &str) -> Result<(), storage::Error> {
        let Some(_held) = self.at_hand.take(id).await else { return Ok(()) };
        let Some(claim) = endings::claim(&self.intake.storage.records, id, self.lease).await? else {
            return Ok(());
        };
        let gone = CancellationToken::new();
        let _gone = gone.clone().drop_guard();
        let made = match claim.attempt > i64::from(self.max_attempts) {
            true => Err(Problem::finishing_lost(self.max_attempts)),
            false => match self.mind(&claim, &gone, self.make(&claim, gone.clone())).await {
                Ok(made) => Ok(made),
                Err(error) => match self.fate(&claim, &error) {
                    Fate::Refused => Err(error.into()),
                    Fate::Again { counted } => return self.put_back(&claim, &error, counted).await,
                    Fate::Lost => return Ok(()),
                },
            },
        };
        match made {
            Ok((drafts, left_out)) => self.take(&claim, drafts, left_out).await,
            Err(problem) => self.refuse(&claim, &problem).await,
        }
    }

    /// The end of an upload whose bytes are all there, as far as it comes soon.
    pub(super) async fn ended(&self, tenant: &str, id: &str) -> Result<Upload, Error> {
        let begun = Instant::now();
        let mut finishing = Some({
            let (this, id) = (self.clone(), id.to_owned());
            // A task of its own: who waits for it may go away.
            tokio::spawn(async move { this.finish(&id).await })
        });
        loop {
            if let Some(task) = &mut finishing
                && timeout(WAIT.saturating_sub(begun.elapsed()), task).await.is_ok()
            {
                finishing = None;
            }
            let upload = uploads::get(&self.intake.storage.records, tenant, id).await?;
            let upload = upload.ok_or_else(|| Error::Missing(id.to_owned()))?;
            match upload.state {
                State::Refused => return Err(Error::Refused(Box::new(refusal(&upload)))),
                State::Finishing if begun.elapsed() < WAIT => sleep(LOOK).await,
                _ => return Ok(upload),
            }
        }
    }

    /// Waits for `making`, renewing the lease; tells it when that is lost.
    async fn mind<T>(&self, claim: &Claim, gone: &CancellationToken, making: impl Future<Output = T>) -> T {
        let mut ticker = interval(self.lease / 3);
        ticker.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut making = std::pin::pin!(making);
        loop {
            tokio::select! {
                made = &mut making => return made,
                _ = ticker.tick() => match endings::renew(&self.intake.storage.records, claim, self.lease).await {
                    Ok(true) => {}
                    Ok(false) => gone.cancel(),
                    Err(error) => tracing::warn!(upload = claim.upload.id, %error, "cannot renew a lease"),
                },
            }
        }
    }

    /// The ray sets that an upload is to be.
    async fn make(&self, claim: &Claim, gone: CancellationToken) -> Result<(Vec<Draft>, Vec<LeftOut>), FileError> {
        let Claim { tenant, upload, .. } = claim;
        let Storage { records, .. } = &self.intake.storage;
        let extent = Extent::resumed(upload.offset, &upload.sha256_state);
        let extent = extent.ok_or_else(|| storage::Error::Records("the state of a digest cannot be read".into()))?;
        let (sha256, byte_count) = (extent.sha256(), upload.offset);
        if let Some(announced) = upload.announced.iter().find(|announced| **announced != sha256) {
            return Err(FileError::Digest { announced: announced.clone(), found: sha256 });
        }
        let parts = uploads::parts(records, &upload.id).await?;
        let mut stored =
            Stored { id: upload.id.clone(), name: upload.name.clone(), sha256, is_packed: false, byte_count, parts };
        stored.is_packed = self.intake.judge(&self.prefix(&stored).await?, Some(byte_count))?;
        // The bytes of a packed upload go when what is in it is kept.
        let room = self.intake.quota.room(records, tenant).await?.without(byte_count);
        self.intake.drafts(stored, upload.declared.clone(), room, gone).await
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

    fn fate(&self, claim: &Claim, error: &FileError) -> Fate {
        use FileError::{LowSpace, Packed, Storage, Unfit};
        use pipeline::Error::{Cancelled, Unreadable};
        let last = claim.attempt >= i64::from(self.max_attempts);
        match error {
            Unfit(Cancelled) => Fate::Lost,
            LowSpace | Storage(storage::Error::Full) if last => Fate::Refused,
            LowSpace | Storage(storage::Error::Full) => Fate::Again { counted: true },
            Unfit(Unreadable(cause)) | Packed(Unreadable(cause))
                if cause.get_ref().is_some_and(|it| it.is::<JoinError>()) =>
            {
                // A panic of ours: another attempt will hardly do better.
                if last { Fate::Refused } else { Fate::Again { counted: true } }
            }
            // A store does not answer. One that never will must not keep the upload for ever.
            Storage(_) | Unfit(Unreadable(_)) | Packed(Unreadable(_)) if claim.is_overdue => Fate::Refused,
            Storage(_) | Unfit(Unreadable(_)) | Packed(Unreadable(_)) => Fate::Again { counted: false },
            _ => Fate::Refused,
        }
    }

    async fn put_back(&self, claim: &Claim, error: &FileError, counted: bool) -> Result<(), storage::Error> {
        tracing::warn!(upload = claim.upload.id, attempt = claim.attempt, %error, "an upload is finished later");
        endings::put_back(&self.intake.storage.records, claim, self.lease, counted).await
    }

    /// Makes it known what an upload has become.
    async fn take(&self, claim: &Claim, drafts: Vec<Draft>, left_out: Vec<LeftOut>) -> Result<(), storage::Error> {
        let (id, records) = (&claim.upload.id, &self.intake.storage.records);
        let ids: Vec<String> = drafts.iter().map(|draft| draft.ray_set.id.clone()).collect();
        let became = Became { ray_sets: ids.clone(), left_out };
        let result = serde_json::to_string(&became).map_err(|error| storage::Error::Records(error.into()))?;
        // Should this fail, rows may or may not name them: only the sweep of garbage can tell.
        let taken = endings::take(records, self.intake.quota, claim, drafts, &result, self.expiry).await?;
        let unpacked = ids.iter().filter(|other| *other != id);
        if taken != Ok(true) {
            for unpacked in unpacked {
                self.intake.forget(unpacked).await;
            }
        } else if !ids.contains(id) {
            self.intake.forget(id).await;
        }
        match taken {
            Err(exceeded) => self.refuse(claim, &FileError::from(exceeded).into()).await,
            Ok(_) => Ok(()),
        }
    }

    async fn refuse(&self, claim: &Claim, problem: &Problem) -> Result<(), storage::Error> {
        let (id, records) = (&claim.upload.id, &self.intake.storage.records);
        let said = serde_json::to_string(problem).map_err(|error| storage::Error::Records(error.into()))?;
        if endings::refuse(records, claim, &said, self.expiry).await? {
            self.forget(id, State::Refused).await;
        }
        Ok(())
    }

    /// Finishes what other processes have left, and forgets what nobody goes on with, again and again.
    pub async fn keep_up(self, poll: Duration) {
        let mut ticker = interval(poll);
        ticker.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let every = (self.expiry / 24).min(EXPIRY_LOOK);
        let mut looked: Option<Instant> = None;
        while !self.stopping.is_cancelled() {
            ticker.tick().await;
            if let Err(error) = self.finish_waiting().await {
                tracing::warn!(%error, "cannot finish uploads; trying again later");
            }
            if looked.is_none_or(|looked| looked.elapsed() >= every) {
                looked = Some(Instant::now());
                self.expire().await;
            }
        }
    }

    async fn finish_waiting(&self) -> Result<(), storage::Error> {
        for id in endings::waiting(&self.intake.storage.records).await? {
            self.finish(&id).await?;
        }
        Ok(())
    }

    async fn expire(&self) {
        match endings::expire(&self.intake.storage.records).await {
            Ok(expired) => {
                for (id, was) in expired {
                    tracing::info!(upload = id, state = was.name(), "an upload's time is over");
                    self.forget(&id, was).await;
                }
            }
            Err(error) => tracing::warn!(%error, "cannot look for uploads whose time is over; trying again later"),
        }
    }
}
