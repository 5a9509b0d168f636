//! Uploads that are made of others (tus' Concatenation): a client sends the pieces of a file as partial uploads, side by side, and
//! then asks for the final upload that they are. A partial upload is used once: its bytes are the final upload's from then on.

use super::join_rows::Joining;
use super::rows::{Concat, New, State, Upload};
use super::{Error, Uploads, join_rows, rows};
use super::{Unusable, state};
use crate::ray_sets::announcement::Announcement;
use crate::ray_sets::error::Error as FileError;
use crate::ray_sets::extent::Extent;
use crate::storage;
use crate::storage::keys::new_id;

impl Uploads {
    /// Makes the final upload of these `partials` of `tenant`, in this order, and waits a while for its end. `sent` is
    /// `Upload-Concat`. The same request, sent again with the same pieces and metadata, gives the same upload, so that a client
    /// whose answer was lost gets it.
    ///
    /// # Errors
    /// [`Error::Missing`], [`Error::Piece`], [`Error::File`]: it was not begun. [`Error::Refused`]: it was, and its bytes are gone.
    pub async fn join(
        &self,
        tenant: &str,
        metadata: String,
        whole: Announcement,
        sent: &str,
        partials: &[String],
    ) -> Result<Upload, Error> {
        let records = &self.intake.storage.records;
        let Announcement { name, sha256: announced, declared, metadata: client_metadata, .. } = whole;
        let sha256_state = state(&Extent::default())?;
        let mut new = New {
            id: new_id(),
            name,
            metadata,
            declared,
            client_metadata,
            announced,
            byte_count: None,
            sha256_state,
            is_partial: false,
        };
        // Whenever another request was faster, the pieces tell what to say now: none goes back to being complete.
        loop {
            let pieces = self.pieces(tenant, partials).await?;
            if let Some(made) = self.made_before(tenant, &new.metadata, partials, &pieces).await? {
                return self.ended(tenant, &made).await;
            }
            new.byte_count = Some(self.length(&pieces)?);
            let joining = Joining { new: new.clone(), sent, partials };
            if let Some(made) = join_rows::join(records, tenant, self.intake.quota, &joining, self.expiry).await?? {
                tracing::info!(upload = made.id, pieces = partials.len(), "a final upload was made of partial uploads");
                return self.ended(tenant, &made.id).await;
            }
        }
    }

    /// The uploads that are to be pieces, each as often as it is named.
    async fn pieces(&self, tenant: &str, partials: &[String]) -> Result<Vec<Upload>, Error> {
        let mut pieces = Vec::new();
        for id in partials {
            let piece = rows::get(&self.intake.storage.records, tenant, id).await?;
            pieces.push(piece.ok_or_else(|| Error::Missing(id.clone()))?);
        }
        Ok(pieces)
    }

    /// The final upload that exactly these pieces have become under this metadata.
    async fn made_before(
        &self,
        tenant: &str,
        metadata: &str,
        partials: &[String],
        pieces: &[Upload],
    ) -> Result<Option<String>, Error> {
        // Any of them: a faster request may have come between the reads of two pieces.
        let Some(made) = pieces.iter().find_map(|piece| piece.part_of.as_ref()) else { return Ok(None) };
        let made = rows::get(&self.intake.storage.records, tenant, made).await?;
        Ok(made.filter(|made| made.concat.partials() == partials && made.metadata == metadata).map(|made| made.id))
    }

    /// The length of the file that these pieces are, bytes, where all can be used.
    fn length(&self, pieces: &[Upload]) -> Result<u64, Error> {
        let mut length = 0_u64;
        for piece in pieces {
            let unusable = match piece.state {
                _ if piece.concat != Concat::Partial => Some(Unusable::NotPartial),
                State::Complete => None,
                State::Joined => Some(Unusable::Used),
                _ => Some(Unusable::Unfinished),
            };
            if let Some(unusable) = unusable {
                return Err(Error::Piece { id: piece.id.clone(), unusable });
            }
            holds(piece)?;
            length = length.saturating_add(piece.offset);
        }
        self.fits(length)?;
        Ok(length)
    }
}

/// Whether a piece is what was announced of it.
fn holds(piece: &Upload) -> Result<(), FileError> {
    let extent = Extent::resumed(piece.offset, &piece.sha256_state);
    let extent = extent.ok_or_else(|| storage::Error::fault("the stored state of a digest cannot be read"))?;
    let found = extent.sha256();
    match piece.announced.iter().find(|announced| **announced != found) {
        Some(announced) => Err(FileError::Digest { announced: announced.clone(), found }),
        None => Ok(()),
    }
}
