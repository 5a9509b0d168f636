//! How several uploads become one (tus' Concatenation): the parts of the partial uploads become the final upload's, in the order
//! that its sender says, in one transaction. No byte is copied; the blobs stay where they are, in the partial uploads' folders.

use super::rows::{New, Upload, upload};
use crate::accounts::quota::{Exceeded, Quota};
use crate::crash;
use crate::metadata::rows;
use crate::ray_sets::rows::unreadable;
use crate::storage::error::Error;
use crate::storage::records::statement::{ms, sql};
use crate::storage::records::{Records, Transaction};
use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

/// A final upload to be.
#[derive(Clone, Debug)]
pub struct Joining<'a> {
    /// Itself; its `byte_count` is the sum of its pieces'.
    pub new: New,
    /// `Upload-Concat`, as it was sent.
    pub sent: &'a str,
    /// The ids of its pieces, in order; one may be named several times.
    pub partials: &'a [String],
}

/// Makes a final upload of `tenant`, whose bytes are all there: its pieces' parts become its own, and they are its pieces from now
/// on. `None` when one of them is no longer complete: it was deleted, has expired, or is another's piece.
///
/// # Errors
/// The database did not answer: it may or may not be so. Within: the tenant has no room for it, which can only be where a piece is
/// named several times.
pub async fn join(
    records: &Records,
    tenant: &str,
    quota: Quota,
    joining: &Joining<'_>,
    expiry: Duration,
) -> Result<Result<Option<Upload>, Exceeded>, Error> {
    let mut transaction = records.begin().await?;
    // In the order of their ids, whatever their order in the file: two that want the same pieces wait for each other then, and
    // never each for the other.
    for id in joining.partials.iter().collect::<BTreeSet<_>>() {
        let take = "UPDATE uploads SET state = 'joined', part_of = $1, expires_ms = {now} + $2 \
                    WHERE tenant = $3 AND id = $4 AND state = 'complete'";
        let take = sql(take).bind(joining.new.id.as_str()).bind(ms(expiry)).bind(tenant).bind(id.as_str());
        if transaction.write(take).await? == 0 {
            transaction.rollback().await?;
            return Ok(Ok(None));
        }
    }
    let made = insert(&mut transaction, tenant, joining, expiry).await?;
    move_parts(&mut transaction, joining).await?;
    if let Err(exceeded) = quota.check_bytes(&mut transaction, tenant).await? {
        transaction.rollback().await?;
        return Ok(Err(exceeded));
    }
    crash::point("join.before_commit");
    transaction.commit().await?;
    crash::point("join.committed");
    Ok(Ok(Some(made)))
}

async fn insert(
    transaction: &mut Transaction,
    tenant: &str,
    joining: &Joining<'_>,
    expiry: Duration,
) -> Result<Upload, Error> {
    let Joining { new, sent, partials } = joining;
    let insert = "INSERT INTO uploads (tenant, id, state, name, metadata, declared, announced, byte_count, offset_bytes, \
                  sha256_state, fence, attempt, created_ms, expires_ms, concat, partials, client_metadata) \
                  VALUES ($1, $2, 'finishing', $3, $4, $5, $6, $7, $7, $8, 0, 0, {now}, {now} + $9, $10, $11, $12) RETURNING *";
    let json = |text: serde_json::Result<String>| text.map_err(unreadable);
    let insert = sql(insert).bind(tenant).bind(new.id.as_str()).bind(new.name.as_str()).bind(new.metadata.as_str());
    let insert = insert.bind(json(serde_json::to_string(&new.declared))?);
    let insert = insert.bind(json(serde_json::to_string(&new.announced))?);
    let insert = insert.bind(new.byte_count.unwrap_or(0).cast_signed()).bind(new.sha256_state.as_str());
    let insert = insert.bind(ms(expiry)).bind(*sent).bind(json(serde_json::to_string(partials))?);
    let insert = insert.bind(rows::written(&new.client_metadata)?);
    let rows = transaction.read(insert).await?;
    upload(rows.first().ok_or_else(|| Error::fault("the database did not return an inserted final upload"))?)
}

/// Numbers the parts of the pieces one after the other.
async fn move_parts(transaction: &mut Transaction, joining: &Joining<'_>) -> Result<(), Error> {
    let (mut next, mut moved) = (0, BTreeMap::new());
    for id in joining.partials {
        let count = match moved.get(id) {
            None => {
                let one = "UPDATE upload_parts SET upload_id = $1, number = number + $2 WHERE upload_id = $3";
                let one = sql(one).bind(joining.new.id.as_str()).bind(next).bind(id.as_str());
                let count = transaction.write(one).await?.cast_signed();
                moved.insert(id, (next, count));
                count
            }
            // Named again: the same blobs, read again.
            Some((first, count)) => {
                let again = "INSERT INTO upload_parts (upload_id, number, byte_count, blob) \
                             SELECT upload_id, number + $1, byte_count, blob FROM upload_parts \
                             WHERE upload_id = $2 AND number >= $3 AND number < $4";
                let again = sql(again).bind(next - first).bind(joining.new.id.as_str());
                transaction.write(again.bind(*first).bind(first + count)).await?.cast_signed()
            }
        };
        next += count;
    }
    Ok(())
}
