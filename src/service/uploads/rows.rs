//! Rows of resumable uploads while their bytes arrive. Every change names the offset that it continues at and the request that
//! may make it. The ends of uploads are in `outcome.rs`.

use crate::accounts::quota::{Exceeded, Quota};
use crate::metadata::{Metadata, rows};
use crate::ray_sets::declaration::FileDeclaration;
use crate::ray_sets::rows::unreadable;
use crate::storage::error::Error;
use crate::storage::parts::Part;
use crate::storage::records::statement::{Row, Statement, ms, sql};
use crate::storage::records::{Records, Transaction};
use std::time::Duration;

/// Largest number of unfinished uploads of a tenant.
pub const MAX_UNFINISHED: u64 = 1000;
/// `Upload-Concat` of a partial upload.
pub const PARTIAL: &str = "partial";

/// State of an upload.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    /// Bytes are still missing.
    Receiving,
    /// All bytes are there and are being read.
    Finishing,
    /// Ray sets were made of the upload.
    Taken,
    /// The upload was refused; its bytes are deleted, unless no process managed to read them.
    Refused,
    /// All bytes of the partial upload are there; no final upload names it yet.
    Complete,
    /// The bytes of the partial upload belong to a final upload.
    Joined,
}

/// Kind of an upload in the extension Concatenation of tus.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Concat {
    /// The upload is a whole file.
    #[default]
    Whole,
    /// The upload is one piece of a file.
    Partial,
    /// It is made of pieces.
    Final {
        /// `Upload-Concat` as the client sent it.
        sent: String,
        /// Ids of the partial uploads, in order.
        partials: Vec<String>,
    },
}

impl Concat {
    /// `Upload-Concat` as the client sent it; `None` if it did not.
    pub fn sent(&self) -> Option<&str> {
        match self {
            Concat::Whole => None,
            Concat::Partial => Some(PARTIAL),
            Concat::Final { sent, .. } => Some(sent),
        }
    }

    /// The ids of the pieces that a final upload is made of; none of any other.
    pub fn partials(&self) -> &[String] {
        match self {
            Concat::Final { partials, .. } => partials,
            Concat::Whole | Concat::Partial => &[],
        }
    }

    /// Reads the kind from the row of an upload.
    pub(super) fn of(row: &Row) -> Result<Concat, Error> {
        let list = row.optional_text("partials")?.unwrap_or_else(|| "[]".to_owned());
        Ok(match row.optional_text("concat")? {
            None => Concat::Whole,
            Some(sent) if sent == PARTIAL => Concat::Partial,
            Some(sent) => Concat::Final { sent, partials: serde_json::from_str(&list).map_err(unreadable)? },
        })
    }
}

impl State {
    /// Name of the state in the database and in answers.
    pub fn name(self) -> &'static str {
        match self {
            State::Receiving => "receiving",
            State::Finishing => "finishing",
            State::Taken => "taken",
            State::Refused => "refused",
            State::Complete => "complete",
            State::Joined => "joined",
        }
    }

    pub(super) fn parse(name: &str) -> Result<State, Error> {
        let all = [State::Receiving, State::Finishing, State::Taken, State::Refused, State::Complete, State::Joined];
        let found = all.into_iter().find(|state| state.name() == name);
        found.ok_or_else(|| Error::fault(format!("an upload is {name:?}")))
    }
}

/// A resumable upload, read from its row.
#[derive(Clone, Debug)]
pub struct Upload {
    /// Identifier of the upload, a UUIDv7; also that of its ray set, unless the file is an archive.
    pub id: String,
    /// State of the upload.
    pub state: State,
    /// Name of the file.
    pub name: String,
    /// `Upload-Metadata` as the client sent it.
    pub metadata: String,
    /// Declarations for the file, or for every file in an archive.
    pub declared: FileDeclaration,
    /// The client's own metadata for the ray sets.
    pub client_metadata: Metadata,
    /// SHA-256 of the whole file, lower-case hex: every value that the client announced.
    pub announced: Vec<String>,
    /// Length of the whole file, bytes, if it is known.
    pub byte_count: Option<u64>,
    /// Number of bytes stored.
    pub offset: u64,
    /// State of the SHA-256 after the stored bytes.
    pub sha256_state: String,
    /// Result of the upload as JSON; `None` before its end.
    pub result: Option<String>,
    /// Whether the upload is whole, partial or final.
    pub concat: Concat,
    /// Identifier of the final upload that this partial upload belongs to.
    pub part_of: Option<String>,
    /// When the upload began, epoch ms.
    pub created_ms: i64,
    /// When the upload expires if no more bytes arrive, epoch ms.
    pub expires_ms: i64,
}

pub(super) fn upload(row: &Row) -> Result<Upload, Error> {
    Ok(Upload {
        id: row.text("id")?,
        state: State::parse(&row.text("state")?)?,
        name: row.text("name")?,
        metadata: row.text("metadata")?,
        declared: serde_json::from_str(&row.text("declared")?).map_err(unreadable)?,
        client_metadata: rows::read(&row.text("client_metadata")?)?,
        announced: serde_json::from_str(&row.text("announced")?).map_err(unreadable)?,
        byte_count: row.optional_number("byte_count")?.map(|bytes| bytes.max(0).unsigned_abs()),
        offset: row.count("offset_bytes")?,
        sha256_state: row.text("sha256_state")?,
        result: row.optional_text("result")?,
        concat: Concat::of(row)?,
        part_of: row.optional_text("part_of")?,
        created_ms: row.number("created_ms")?,
        expires_ms: row.number("expires_ms")?,
    })
}

/// The properties of a new upload.
#[derive(Clone, Debug)]
pub struct New {
    /// Identifier of the upload, a UUIDv7.
    pub id: String,
    /// As in [`Upload`].
    pub name: String,
    /// As in [`Upload`].
    pub metadata: String,
    /// As in [`Upload`].
    pub declared: FileDeclaration,
    /// As in [`Upload`].
    pub client_metadata: Metadata,
    /// As in [`Upload`].
    pub announced: Vec<String>,
    /// As in [`Upload`].
    pub byte_count: Option<u64>,
    /// State of the SHA-256 of no bytes.
    pub sha256_state: String,
    /// Whether the upload is partial.
    pub is_partial: bool,
}

/// Why an upload is not begun.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoRoom {
    /// The announced length exceeds the storage quota of the tenant.
    Quota(Exceeded),
    /// The tenant has [`MAX_UNFINISHED`] already.
    TooMany,
}

/// A request that is about to append bytes to an upload.
#[derive(Clone, Debug)]
pub struct Beginning<'a> {
    /// Tenant of the upload.
    pub tenant: &'a str,
    /// Identifier of the upload.
    pub id: &'a str,
    /// A name for this request that no other request has.
    pub session: &'a str,
    /// Offset that the request continues at, bytes.
    pub offset: u64,
    /// Length of the whole file, bytes, if the request gives it.
    pub whole: Option<u64>,
    /// Time until the upload expires if no bytes arrive.
    pub expiry: Duration,
}

/// Parts that a request has stored and that become part of the upload.
#[derive(Clone, Debug)]
pub struct Addition<'a> {
    /// Tenant of the upload.
    pub tenant: &'a str,
    /// Identifier of the upload.
    pub id: &'a str,
    /// Name of the request.
    pub session: &'a str,
    /// Number of bytes of the upload before these parts.
    pub from: u64,
    /// Number of bytes of the upload with these parts.
    pub to: u64,
    /// State of the SHA-256 after these parts.
    pub sha256_state: &'a str,
    /// Number of the first part; a part of that number is replaced, if there is one.
    pub number: usize,
    /// The parts, in order.
    pub parts: &'a [Part],
    /// Time until the upload expires if no more bytes arrive.
    pub expiry: Duration,
}

/// Result of adding parts to an upload.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Added {
    /// The parts belong to the upload now.
    Named,
    /// Another request took over the upload, or the upload is deleted.
    Lost,
    /// The parts exceed the storage quota of the tenant.
    NoRoom(Exceeded),
}

/// Changes rows and answers the first that it RETURNs.
pub(super) async fn changed(records: &Records, statement: Statement) -> Result<Option<Row>, Error> {
    let mut transaction = records.begin().await?;
    let rows = transaction.read(statement).await?;
    transaction.commit().await?;
    Ok(rows.into_iter().next())
}

/// Begins an upload of `tenant`; what it announces counts as kept from now on.
///
/// # Errors
/// The database did not answer. Within: it has no room for it.
pub async fn insert(
    records: &Records,
    tenant: &str,
    quota: Quota,
    new: &New,
    expiry: Duration,
) -> Result<Result<Upload, NoRoom>, Error> {
    let mut transaction = records.begin().await?;
    let insert = "INSERT INTO uploads (tenant, id, state, name, metadata, declared, announced, byte_count, offset_bytes, \
                  sha256_state, client_metadata, fence, attempt, created_ms, expires_ms, concat) \
                  VALUES ($1, $2, 'receiving', $3, $4, $5, $6, $7, 0, $8, $9, 0, 0, {now}, {now} + $10, $11) RETURNING *";
    let json = |text: serde_json::Result<String>| text.map_err(unreadable);
    let insert = sql(insert).bind(tenant).bind(new.id.as_str()).bind(new.name.as_str()).bind(new.metadata.as_str());
    let insert = insert.bind(json(serde_json::to_string(&new.declared))?);
    let insert = insert.bind(json(serde_json::to_string(&new.announced))?);
    let insert = insert.bind(new.byte_count.map(u64::cast_signed)).bind(new.sha256_state.as_str());
    let insert = insert.bind(rows::written(&new.client_metadata)?).bind(ms(expiry));
    let insert = insert.bind(new.is_partial.then_some(PARTIAL));
    let rows = transaction.read(insert).await?;
    if let Err(exceeded) = quota.check_bytes(&mut transaction, tenant).await? {
        transaction.rollback().await?;
        return Ok(Err(NoRoom::Quota(exceeded)));
    }
    if unfinished(&mut transaction, tenant).await? > MAX_UNFINISHED {
        transaction.rollback().await?;
        return Ok(Err(NoRoom::TooMany));
    }
    transaction.commit().await?;
    let row = rows.first().ok_or_else(|| Error::fault("the database did not return an inserted upload"))?;
    Ok(Ok(upload(row)?))
}

async fn unfinished(transaction: &mut Transaction, tenant: &str) -> Result<u64, Error> {
    let select = "SELECT COUNT(*) AS unfinished FROM uploads WHERE tenant = $1 \
                  AND state IN ('receiving', 'finishing', 'complete')";
    let rows = transaction.read(sql(select).bind(tenant)).await?;
    rows.first().map_or(Ok(0), |row| row.count("unfinished"))
}

/// The upload `id` of `tenant`, if there is one.
///
/// # Errors
/// The database did not answer.
pub async fn get(records: &Records, tenant: &str, id: &str) -> Result<Option<Upload>, Error> {
    let select = sql("SELECT * FROM uploads WHERE tenant = $1 AND id = $2").bind(tenant).bind(id);
    records.read_one(select).await?.as_ref().map(upload).transpose()
}

/// At most `limit` uploads of `tenant`, begun before the one called `before`, newest first.
///
/// # Errors
/// The database did not answer.
pub async fn list(records: &Records, tenant: &str, before: Option<&str>, limit: i64) -> Result<Vec<Upload>, Error> {
    let select = "SELECT * FROM uploads WHERE tenant = $1 AND ($2 IS NULL OR id < $2) ORDER BY id DESC LIMIT $3";
    records.read(sql(select).bind(tenant).bind(before).bind(limit)).await?.iter().map(upload).collect()
}

/// The stored parts of an upload, in order.
///
/// # Errors
/// The database did not answer.
pub async fn parts(records: &Records, id: &str) -> Result<Vec<Part>, Error> {
    let select = sql("SELECT byte_count, blob FROM upload_parts WHERE upload_id = $1 ORDER BY number").bind(id);
    records.read(select).await?.iter().map(part).collect()
}

/// Number of the last part that is stored of an upload, and that part.
///
/// # Errors
/// The database did not answer.
pub async fn last_part(records: &Records, id: &str) -> Result<Option<(usize, Part)>, Error> {
    let select = "SELECT number, byte_count, blob FROM upload_parts WHERE upload_id = $1 ORDER BY number DESC LIMIT 1";
    let numbered = |row: Row| Ok((row.count("number")? as usize, part(&row)?));
    records.read_one(sql(select).bind(id)).await?.map(numbered).transpose()
}

fn part(row: &Row) -> Result<Part, Error> {
    Ok(Part { byte_count: row.count("byte_count")?, blob: row.text("blob")? })
}

/// Lets a request go on from where it means to, and no other any more; `None` when the upload is not there, or the length
/// that it says cannot be the upload's. What it says counts as kept from now on.
///
/// # Errors
/// The database did not answer. Within: the tenant has no room for the length.
pub async fn begin(
    records: &Records,
    quota: Quota,
    beginning: &Beginning<'_>,
) -> Result<Result<Option<Upload>, Exceeded>, Error> {
    let Beginning { tenant, id, session, offset, whole, expiry } = *beginning;
    let mut transaction = records.begin().await?;
    // The length and the session in one: whoever adds without knowing the length adds no more.
    let begin = "UPDATE uploads SET session = $1, expires_ms = {now} + $2, byte_count = COALESCE(byte_count, $3), \
                 state = CASE WHEN byte_count IS NOT NULL OR offset_bytes <> $3 OR $3 IS NULL THEN state \
                 WHEN concat IS NULL THEN 'finishing' ELSE 'complete' END \
                 WHERE tenant = $4 AND id = $5 AND state = 'receiving' AND offset_bytes = $6 \
                 AND ($3 IS NULL OR (offset_bytes <= $3 AND COALESCE(byte_count, $3) = $3)) RETURNING *";
    let begin = sql(begin).bind(session).bind(ms(expiry)).bind(whole.map(u64::cast_signed)).bind(tenant).bind(id);
    let rows = transaction.read(begin.bind(offset.cast_signed())).await?;
    if whole.is_some()
        && let Err(exceeded) = quota.check_bytes(&mut transaction, tenant).await?
    {
        transaction.rollback().await?;
        return Ok(Err(exceeded));
    }
    transaction.commit().await?;
    Ok(Ok(rows.first().map(upload).transpose()?))
}

/// Whether the request `session` is still the one that may add to the upload `id`.
///
/// # Errors
/// The database did not answer.
pub async fn goes_on(records: &Records, id: &str, session: &str) -> Result<bool, Error> {
    let select = "SELECT id FROM uploads WHERE id = $1 AND session = $2 AND state = 'receiving'";
    Ok(records.read_one(sql(select).bind(id).bind(session)).await?.is_some())
}

/// Makes stored bytes part of an upload: its offset moves and their parts get rows, or neither.
///
/// # Errors
/// The database did not answer: it may or may not be so.
pub async fn add(records: &Records, quota: Quota, addition: &Addition<'_>) -> Result<Added, Error> {
    let mut transaction = records.begin().await?;
    let advance = "UPDATE uploads SET offset_bytes = $1, sha256_state = $2, expires_ms = {now} + $3, \
                   state = CASE WHEN byte_count IS NULL OR byte_count <> $1 THEN state \
                   WHEN concat IS NULL THEN 'finishing' ELSE 'complete' END \
                   WHERE id = $4 AND session = $5 AND state = 'receiving' AND offset_bytes = $6 \
                   AND (byte_count IS NULL OR byte_count >= $1) RETURNING byte_count";
    let advance = sql(advance).bind(addition.to.cast_signed()).bind(addition.sha256_state).bind(ms(addition.expiry));
    let advance = advance.bind(addition.id).bind(addition.session).bind(addition.from.cast_signed());
    let rows = transaction.read(advance).await?;
    let Some(row) = rows.first() else {
        transaction.rollback().await?;
        return Ok(Added::Lost);
    };
    // What was announced has had its room since then.
    if row.optional_number("byte_count")?.is_none()
        && let Err(exceeded) = quota.check_bytes(&mut transaction, addition.tenant).await?
    {
        transaction.rollback().await?;
        return Ok(Added::NoRoom(exceeded));
    }
    let replaced = sql("DELETE FROM upload_parts WHERE upload_id = $1 AND number = $2");
    transaction.write(replaced.bind(addition.id).bind(addition.number as i64)).await?;
    for (number, part) in (addition.number..).zip(addition.parts) {
        let insert = sql("INSERT INTO upload_parts (upload_id, number, byte_count, blob) VALUES ($1, $2, $3, $4)");
        let insert = insert.bind(addition.id).bind(number as i64);
        transaction.write(insert.bind(part.byte_count.cast_signed()).bind(part.blob.as_str())).await?;
    }
    transaction.commit().await?;
    Ok(Added::Named)
}
