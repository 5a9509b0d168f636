//! Uploads that can be resumed, by any process: what came is stored part by part, and the transaction that names parts
//! moves the offset, which never goes back. The last request that began at the offset is the one that goes on; what another had not yet
//! stored by then is not kept. When all is there, `finish.rs` makes ray sets of it.

use super::checksum::Checksum;
use super::refused;
use super::rows::{Added, Addition, Beginning, Concat, State, Upload};
use super::state;
use super::{Error, Reason, Uploads, outcome, rows};
use crate::crash;
use crate::ray_sets::error::Error as FileError;
use crate::ray_sets::extent::Extent;
use crate::ray_sets::intake::Intake;
use crate::ray_sets::pace::Pace;
use crate::ray_sets::spool::Spool;
use crate::storage;
use crate::storage::keys::new_id;
use crate::storage::parts::Part;
use bytes::Bytes;
use futures::Stream;
use std::fmt::Display;
use std::pin::pin;

/// A last part that is shorter than this is stored again with what follows, so that small requests do not leave small parts.
const SHORT_BYTES: u64 = 1 << 20;

/// The bytes that a request appends to an upload.
#[derive(Clone, Debug, Default)]
pub struct Piece {
    /// Offset of the request, bytes.
    pub offset: u64,
    /// Length of the body, bytes, where known.
    pub byte_count: Option<u64>,
    /// Length of the whole file, if this request gives it, bytes.
    pub whole: Option<u64>,
    /// Checksum of the body. With it, all of the body is kept or nothing.
    pub checksum: Option<Checksum>,
}

impl Uploads {
    /// Appends a body to an upload of `tenant` and returns the upload; if it is complete, waits a while for it to be finished. If
    /// the body is interrupted, the bytes that arrived are kept, unless the request has a checksum.
    ///
    /// # Errors
    /// [`Error`].
    pub async fn append<E: Display>(
        &self,
        tenant: &str,
        id: &str,
        mut piece: Piece,
        body: impl Stream<Item = Result<Bytes, E>>,
    ) -> Result<Upload, Error> {
        let records = &self.intake.storage.records;
        if let Some(whole) = piece.whole {
            self.fits(whole)?;
        }
        let (session, offset, whole) = (new_id(), piece.offset, piece.whole);
        let beginning = Beginning { tenant, id, session: &session, offset, whole, expiry: self.expiry };
        match rows::begin(records, self.intake.quota, &beginning).await?? {
            // Whoever lost the answer to the last byte adds nothing, at the end.
            None if piece.byte_count == Some(0) && self.ends_at(tenant, id, offset).await? => {}
            None => return Err(self.why_not(tenant, id, Some(&piece)).await?),
            // It ends where it is.
            Some(upload) if upload.state != State::Receiving => match piece.byte_count {
                Some(0) => {}
                _ => return Err(Error::Complete),
            },
            Some(upload) => {
                let checked = piece.checksum.is_some();
                let mut writing = match self.writing(tenant, &upload, &session).await {
                    // The part that was to be continued goes with the request that made it another.
                    Err(_) if !rows::goes_on(records, id, &session).await? => {
                        return Err(self.why_not(tenant, id, None).await?);
                    }
                    writing => writing?,
                };
                let came = writing.receive(&mut piece, body).await;
                writing.end(came, checked).await?;
            }
        }
        let upload = rows::get(records, tenant, id).await?;
        let upload = upload.ok_or_else(|| Error::Missing(id.to_owned()))?;
        match upload.state {
            State::Receiving | State::Complete | State::Joined => Ok(upload),
            State::Finishing | State::Taken | State::Refused => self.ended(tenant, id).await,
        }
    }

    /// Whether all of an upload is there, up to `offset`.
    async fn ends_at(&self, tenant: &str, id: &str, offset: u64) -> Result<bool, Error> {
        let upload = rows::get(&self.intake.storage.records, tenant, id).await?;
        let complete = |upload: &Upload| {
            let is_there = matches!(upload.state, State::Finishing | State::Taken | State::Complete | State::Joined);
            is_there && upload.concat.partials().is_empty()
        };
        Ok(upload.is_some_and(|upload| complete(&upload) && upload.offset == offset))
    }

    /// Why nothing can be added; `piece` is what did not even begin.
    async fn why_not(&self, tenant: &str, id: &str, piece: Option<&Piece>) -> Result<Error, Error> {
        let upload = rows::get(&self.intake.storage.records, tenant, id).await?;
        let upload = upload.ok_or_else(|| Error::Missing(id.to_owned()))?;
        let is_its_length = |whole| upload.offset <= whole && upload.byte_count.is_none_or(|known| known == whole);
        let is_here = piece.filter(|piece| piece.offset == upload.offset);
        Ok(match upload.state {
            _ if !upload.concat.partials().is_empty() => Error::Final,
            State::Receiving if is_here.and_then(|piece| piece.whole).is_some_and(|it| !is_its_length(it)) => {
                Error::Length
            }
            State::Receiving => Error::Offset { at: upload.offset },
            State::Finishing | State::Taken | State::Complete | State::Joined => Error::Complete,
            State::Refused => refused(&upload),
        })
    }

    /// What a request needs that goes on with `upload`.
    async fn writing<'a>(
        &'a self,
        tenant: &'a str,
        upload: &'a Upload,
        session: &'a str,
    ) -> Result<Writing<'a>, Error> {
        let Intake { storage, .. } = &self.intake;
        let came = Extent::resumed(upload.offset, &upload.sha256_state);
        let came = came.ok_or_else(|| storage::Error::fault("the stored state of a digest cannot be read"))?;
        let (number, continued) = match rows::last_part(&storage.records, &upload.id).await? {
            Some((number, part)) if part.byte_count < SHORT_BYTES => (number, Some(part)),
            Some((number, _)) => (number + 1, None),
            None => (0, None),
        };
        let bytes = match &continued {
            Some(part) => storage.blobs.read(&part.blob, 0..part.byte_count).await?,
            None => Bytes::new(),
        };
        let spool = Spool::new(&self.intake, &upload.id, upload.byte_count);
        let spool = spool.resumed(session, came, number, &bytes);
        let spool = if upload.concat == Concat::Partial { spool.unjudged() } else { spool };
        Ok(Writing { uploads: self, tenant, upload, session, spool, number, named: upload.offset, continued })
    }
}

/// One request that appends to an upload.
struct Writing<'a> {
    uploads: &'a Uploads,
    tenant: &'a str,
    upload: &'a Upload,
    session: &'a str,
    spool: Spool<'a>,
    /// Number of the next part that gets a row.
    number: usize,
    /// How much of the upload rows name, bytes.
    named: u64,
    /// The short part that the next one replaces.
    continued: Option<Part>,
}

impl Writing<'_> {
    /// Stores the bytes of the body; without a checksum, they become part of the upload while they arrive.
    pub async fn receive<E: Display>(
        &mut self,
        piece: &mut Piece,
        body: impl Stream<Item = Result<Bytes, E>>,
    ) -> Result<(), Error> {
        let whole = self.upload.byte_count.unwrap_or(u64::MAX);
        if piece.byte_count.is_some_and(|bytes| bytes > whole.saturating_sub(self.upload.offset)) {
            return Err(Error::Beyond(whole));
        }
        // What has neither a length nor rows until its end is judged as it comes.
        let room = match piece.checksum.is_some() && self.upload.byte_count.is_none() {
            true => Some(self.uploads.intake.quota.room(&self.uploads.intake.storage.records, self.tenant).await?),
            false => None,
        };
        let (mut body, mut pace) = (pin!(body), Pace::new(self.uploads.intake.slowest));
        loop {
            let next = tokio::select! {
                next = pace.next(&mut body) => next.map_err(FileError::from)?,
                // It is named as soon as it is stored, also when the sender is silent then.
                stored = self.spool.settle(), if self.spool.is_underway() => {
                    stored?;
                    if piece.checksum.is_none() {
                        self.name_stored().await?;
                    }
                    continue;
                }
                () = self.uploads.stopping.cancelled() => return Err(Error::Stopping),
            };
            let Some(chunk) = next else { break };
            let chunk = chunk.map_err(|error| FileError::Broken(error.to_string()))?;
            if self.spool.byte_count() + chunk.len() as u64 > whole {
                return Err(Error::Beyond(whole));
            }
            room.map_or(Ok(()), |room| room.check(self.spool.byte_count() + chunk.len() as u64 - self.upload.offset))?;
            self.spool.push(&chunk).await?;
            match &mut piece.checksum {
                Some(checksum) => checksum.update(&chunk),
                None => self.name_stored().await?,
            }
        }
        let came = self.spool.byte_count() - self.upload.offset;
        if piece.byte_count.is_some_and(|announced| announced != came) {
            return Err(FileError::Truncated(format!("{came} bytes arrived")).into());
        }
        match piece.checksum.take().is_none_or(Checksum::holds) {
            true => Ok(()),
            false => Err(Error::Checksum),
        }
    }

    /// Keeps the bytes that may be kept, and deletes the others.
    pub async fn end(mut self, came: Result<(), Error>, checked: bool) -> Result<(), Error> {
        use FileError::{Broken, Slow, Truncated};
        let broke_off = matches!(came, Err(Error::Stopping | Error::File(Truncated(_) | Broken(_) | Slow(_))));
        let kept = match came.is_ok() || (broke_off && !checked) {
            true => self.keep_rest().await,
            false => Ok(()),
        };
        let ended = came.and(kept);
        if ended.is_err() {
            self.discard().await;
        }
        match ended {
            // With a checksum they may not be the bytes that were meant: then they are only not kept.
            Err(Error::File(unfit @ FileError::Unfit(_))) if !checked => Err(self.refuse(unfit).await?),
            other => other,
        }
    }

    async fn keep_rest(&mut self) -> Result<(), Error> {
        self.spool.store_rest().await?;
        self.name_stored().await
    }

    /// Gives rows to what is stored, and moves the offset.
    async fn name_stored(&mut self) -> Result<(), Error> {
        if !self.spool.has_stored() {
            return Ok(());
        }
        let (parts, stored) = self.spool.stored();
        let Intake { storage, quota, .. } = &self.uploads.intake;
        let sha256_state = state(&stored)?;
        let addition = Addition {
            tenant: self.tenant,
            id: &self.upload.id,
            session: self.session,
            from: self.named,
            to: stored.byte_count,
            sha256_state: &sha256_state,
            number: self.number,
            parts: &parts,
            expiry: self.uploads.expiry,
        };
        // Should this fail, rows may or may not name them: only the sweep of garbage can tell.
        let added = rows::add(&storage.records, *quota, &addition).await?;
        if added == Added::Named {
            crash::point("append.committed");
            (self.number, self.named) = (self.number + parts.len(), stored.byte_count);
            let replaced = self.continued.take();
            self.delete(replaced.as_slice()).await;
            return Ok(());
        }
        self.delete(&parts).await;
        match added {
            Added::NoRoom(exceeded) => Err(exceeded.into()),
            _ => Err(self.uploads.why_not(self.tenant, &self.upload.id, None).await?),
        }
    }

    /// Deletes what is stored and has no row.
    async fn discard(&mut self) {
        // Its part is not stored then: there is nothing to delete.
        let _ = self.spool.settle().await;
        let (parts, _) = self.spool.stored();
        self.delete(&parts).await;
    }

    async fn delete(&self, parts: &[Part]) {
        for part in parts {
            if let Err(error) = self.uploads.intake.storage.blobs.delete(&part.blob).await {
                tracing::warn!(blob = part.blob, %error, "cannot delete a blob of an upload; the garbage collection will");
            }
        }
    }

    /// Ends an upload whose beginning is wrong.
    async fn refuse(&self, error: FileError) -> Result<Error, Error> {
        let (Uploads { intake, expiry, .. }, id) = (self.uploads, &self.upload.id);
        let refusal = (self.uploads.refusal_of)(Reason::File(error));
        let said = serde_json::to_string(&refusal).unwrap_or_default();
        if outcome::refuse_early(&intake.storage.records, id, self.session, &said, *expiry).await? {
            self.uploads.delete_upload_blobs(id, &self.upload.concat).await;
        }
        Ok(Error::Refused(Box::new(refusal)))
    }
}
