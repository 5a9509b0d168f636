//! How resumable uploads end: as ray sets, refused, deleted or expired. The process that finishes an upload holds a lease by the
//! clock of the database, and its fence is named by the transaction that ends it: an upload ends once.

use super::rows::{Concat, State, Upload, changed, upload};
use crate::accounts::quota::{Exceeded, Quota};
use crate::crash;
use crate::ray_sets::rows;
use crate::ray_sets::rows::Draft;
use crate::storage::error::Error;
use crate::storage::records::statement::{Row, Statement, ms, sql};
use crate::storage::records::{Records, Transaction};
use std::time::Duration;

/// Uploads looked at in one go.
const BATCH: i64 = 100;

/// A complete upload that this process has claimed to finish, until its lease ends.
#[derive(Clone, Debug)]
pub struct Claim {
    /// Tenant of the upload.
    pub tenant: String,
    /// The claimed upload.
    pub upload: Upload,
    /// Number of this claim, unique among all claims of the upload.
    pub fence: i64,
    /// Number of attempts to finish the upload, this one included.
    pub attempt: i64,
    /// Whether the upload had expired before this claim.
    pub is_overdue: bool,
}

/// An upload whose row is gone.
#[derive(Clone, Debug)]
pub struct Gone {
    /// Identifier of the upload.
    pub id: String,
    /// State that the upload had.
    pub was: State,
    /// Whether the upload was whole, partial or final.
    pub concat: Concat,
}

fn gone(row: &Row) -> Result<Gone, Error> {
    Ok(Gone { id: row.text("id")?, was: State::parse(&row.text("state")?)?, concat: Concat::of(row)? })
}

/// Complete uploads that no process has claimed, the oldest first.
///
/// # Errors
/// The database did not answer.
pub async fn waiting(records: &Records) -> Result<Vec<String>, Error> {
    let select = "SELECT id FROM uploads WHERE state = 'finishing' AND COALESCE(lease_until_ms, 0) <= {now} \
                  ORDER BY id LIMIT $1";
    records.read(sql(select).bind(BATCH)).await?.iter().map(|row| row.text("id")).collect()
}

/// Claims the upload `id`, if it is complete and no other process has it.
///
/// # Errors
/// The database did not answer.
pub async fn claim(records: &Records, id: &str, lease: Duration) -> Result<Option<Claim>, Error> {
    let claim = "UPDATE uploads SET fence = fence + 1, attempt = attempt + 1, lease_until_ms = {now} + $1 \
                 WHERE id = $2 AND state = 'finishing' AND COALESCE(lease_until_ms, 0) <= {now} \
                 RETURNING *, CAST(CASE WHEN expires_ms <= {now} THEN 1 ELSE 0 END AS BIGINT) AS is_overdue";
    let row = changed(records, sql(claim).bind(ms(lease)).bind(id)).await?;
    row.as_ref().map(claimed).transpose()
}

fn claimed(row: &Row) -> Result<Claim, Error> {
    Ok(Claim {
        tenant: row.text("tenant")?,
        upload: upload(row)?,
        fence: row.number("fence")?,
        attempt: row.number("attempt")?,
        is_overdue: row.number("is_overdue")? != 0,
    })
}

/// Renews the lease; false when it is another's, or the upload is gone.
///
/// # Errors
/// The database did not answer.
pub async fn renew(records: &Records, claim: &Claim, lease: Duration) -> Result<bool, Error> {
    let renew = "UPDATE uploads SET lease_until_ms = {now} + $1 WHERE id = $2 AND fence = $3 AND state = 'finishing'";
    Ok(records.write(at(sql(renew).bind(ms(lease)), claim)).await? > 0)
}

/// Gives a claimed upload back, to be claimed again after `wait`; an attempt that was not the fault of the upload is not
/// `counted`.
///
/// # Errors
/// The database did not answer.
pub async fn put_back(records: &Records, claim: &Claim, wait: Duration, counted: bool) -> Result<(), Error> {
    let put_back = "UPDATE uploads SET lease_until_ms = {now} + $1, attempt = attempt - $2 \
                    WHERE id = $3 AND fence = $4 AND state = 'finishing'";
    records.write(at(sql(put_back).bind(ms(wait)).bind(i64::from(!counted)), claim)).await?;
    Ok(())
}

/// Makes the ray sets known that an upload has become, all or none, and ends it. False when it is no longer this claim's.
///
/// # Errors
/// The database did not answer: it may or may not be so. Within: the tenant has no room for them.
pub async fn take(
    records: &Records,
    quota: Quota,
    claim: &Claim,
    drafts: Vec<Draft>,
    result: &str,
    expiry: Duration,
) -> Result<Result<bool, Exceeded>, Error> {
    let mut transaction = records.begin().await?;
    let take = "UPDATE uploads SET state = 'taken', result = $1, lease_until_ms = NULL, expires_ms = {now} + $2 \
                WHERE id = $3 AND fence = $4 AND state = 'finishing'";
    if transaction.write(at(sql(take).bind(result).bind(ms(expiry)), claim)).await? == 0 {
        transaction.rollback().await?;
        return Ok(Ok(false));
    }
    delete_part_rows(&mut transaction, &claim.upload.id).await?;
    let becomes: u64 = drafts.iter().map(|draft| draft.ray_set.byte_count).sum();
    for draft in drafts {
        rows::insert_one(&mut transaction, &claim.tenant, draft).await?;
    }
    // What came has had its room since then; only what was packed needs more.
    if becomes > claim.upload.offset
        && let Err(exceeded) = quota.check_bytes(&mut transaction, &claim.tenant).await?
    {
        transaction.rollback().await?;
        return Ok(Err(exceeded));
    }
    crash::point("take.before_commit");
    transaction.commit().await?;
    crash::point("take.committed");
    Ok(Ok(true))
}

/// Ends an upload of which nothing is kept; false when it is no longer this claim's. Its blobs may go then.
///
/// # Errors
/// The database did not answer: it may or may not be so.
pub async fn refuse(records: &Records, claim: &Claim, result: &str, expiry: Duration) -> Result<bool, Error> {
    refused(records, &claim.upload.id, refusing(claim, result, expiry)).await
}

/// The same, but for its bytes, which stay until its time is over: it was not their fault, as far as anybody knows.
///
/// # Errors
/// The database did not answer: it may or may not be so.
pub async fn give_up(records: &Records, claim: &Claim, result: &str, expiry: Duration) -> Result<bool, Error> {
    Ok(records.write(refusing(claim, result, expiry)).await? > 0)
}

fn refusing(claim: &Claim, result: &str, expiry: Duration) -> Statement {
    let refuse = "UPDATE uploads SET state = 'refused', result = $1, lease_until_ms = NULL, expires_ms = {now} + $2 \
                  WHERE id = $3 AND fence = $4 AND state = 'finishing'";
    at(sql(refuse).bind(result).bind(ms(expiry)), claim)
}

/// The same, for one that the request `session` adds to.
///
/// # Errors
/// The database did not answer: it may or may not be so.
pub async fn refuse_early(
    records: &Records,
    id: &str,
    session: &str,
    result: &str,
    expiry: Duration,
) -> Result<bool, Error> {
    let refuse = "UPDATE uploads SET state = 'refused', result = $1, expires_ms = {now} + $2 \
                  WHERE id = $3 AND session = $4 AND state = 'receiving'";
    refused(records, id, sql(refuse).bind(result).bind(ms(expiry)).bind(id).bind(session)).await
}

async fn refused(records: &Records, id: &str, refuse: Statement) -> Result<bool, Error> {
    let mut transaction = records.begin().await?;
    if transaction.write(refuse).await? == 0 {
        transaction.rollback().await?;
        return Ok(false);
    }
    delete_part_rows(&mut transaction, id).await?;
    transaction.commit().await?;
    Ok(true)
}

/// Deletes an upload of `tenant`: what it was, if there was one. Ray sets that it has become stay.
///
/// # Errors
/// The database did not answer.
pub async fn delete(records: &Records, tenant: &str, id: &str) -> Result<Option<Gone>, Error> {
    let delete = sql("DELETE FROM uploads WHERE tenant = $1 AND id = $2 RETURNING *").bind(tenant).bind(id);
    changed(records, delete).await?.as_ref().map(gone).transpose()
}

/// The same, unless it has become ray sets.
///
/// # Errors
/// The database did not answer.
pub async fn abandon(records: &Records, tenant: &str, id: &str) -> Result<Option<Gone>, Error> {
    let abandon = "DELETE FROM uploads WHERE tenant = $1 AND id = $2 AND state <> 'taken' RETURNING *";
    let abandon = sql(abandon).bind(tenant).bind(id);
    changed(records, abandon).await?.as_ref().map(gone).transpose()
}

/// Deletes expired uploads, but never one whose bytes are all there, and returns them.
///
/// # Errors
/// The database did not answer.
pub async fn expire(records: &Records) -> Result<Vec<Gone>, Error> {
    // Said twice: one that is added to meanwhile is looked at again, without what was selected before.
    let expire = "DELETE FROM uploads WHERE state <> 'finishing' AND expires_ms <= {now} AND id IN \
                  (SELECT id FROM uploads WHERE state <> 'finishing' AND expires_ms <= {now} ORDER BY expires_ms \
                  LIMIT $1) RETURNING *";
    let mut transaction = records.begin().await?;
    let rows = transaction.read(sql(expire).bind(BATCH)).await?;
    transaction.commit().await?;
    rows.iter().map(gone).collect()
}

/// Ends every lease: only right when no other process can be finishing any.
///
/// # Errors
/// The database did not answer.
pub async fn recover(records: &Records) -> Result<(), Error> {
    records.write(sql("UPDATE uploads SET lease_until_ms = NULL WHERE state = 'finishing'")).await?;
    Ok(())
}

fn at(statement: Statement, claim: &Claim) -> Statement {
    statement.bind(claim.upload.id.as_str()).bind(claim.fence)
}

async fn delete_part_rows(transaction: &mut Transaction, id: &str) -> Result<(), Error> {
    transaction.write(sql("DELETE FROM upload_parts WHERE upload_id = $1").bind(id)).await?;
    Ok(())
}
