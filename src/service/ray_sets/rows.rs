//! Rows of ray sets and their parts.

use super::declaration::FileDeclaration;
use super::inspections;
use super::inspections::Inspection;
use crate::accounts::quota::{Exceeded, Quota};
use crate::crash;
use crate::metadata::rows::bind_wanted;
use crate::metadata::{Metadata, rows};
use crate::storage::error::Error;
use crate::storage::keys::ray_set_folder;
use crate::storage::parts::Part;
use crate::storage::records::statement::{Row, sql};
use crate::storage::records::{Records, Transaction};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// A ray set, read from its row.
#[derive(Clone, Debug)]
pub struct RaySet {
    /// Identifier of the ray set, a UUIDv7.
    pub id: String,
    /// Name of the file.
    pub name: String,
    /// Length, bytes.
    pub byte_count: u64,
    /// SHA-256 of the bytes, lower-case hex.
    pub sha256: String,
    /// What the file says of itself: the pipeline's header without its texts, as JSON. The inspection has it whole.
    pub header: String,
    /// What the client declared about the file.
    pub declared: FileDeclaration,
    /// The archive that the file was unpacked from, if it was in one.
    pub packed: Option<Packed>,
    /// The client's own metadata.
    pub metadata: Metadata,
    /// When the upload of the file was complete, epoch ms.
    pub created_ms: i64,
}

/// An archive that ray sets were unpacked from; the archive itself is not kept.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Packed {
    /// Name of the file.
    pub name: String,
    /// SHA-256 of the bytes as sent, lower-case hex.
    pub sha256: String,
    /// Other files in the archive, and why they were left out.
    pub left_out: Vec<LeftOut>,
}

/// Most files left out that are kept with each ray set of a packed file; the answer to the upload names all.
const MOST_LEFT_OUT: usize = 100;

/// A ray set whose parts are stored, but not its rows.
#[derive(Clone, Debug)]
pub struct Draft {
    /// Address of this object.
    pub ray_set: RaySet,
    /// The stored parts of the file, in order.
    pub parts: Vec<Part>,
    /// The inspection of the rays.
    pub inspection: Inspection,
}

/// Result of deleting a ray set.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Deletion {
    /// Its row is gone; its blobs may go: all that is in these folders.
    Deleted(Vec<String>),
    /// An unfinished job needs it.
    Needed,
    /// There is no such ray set.
    Missing,
}

/// The error of a row whose JSON cannot be read: it was written by this service.
pub fn unreadable(error: serde_json::Error) -> Error {
    Error::fault(error)
}

fn ray_set(row: &Row) -> Result<RaySet, Error> {
    Ok(RaySet {
        id: row.text("id")?,
        name: row.text("name")?,
        byte_count: row.count("byte_count")?,
        sha256: row.text("sha256")?,
        header: row.text("header")?,
        declared: serde_json::from_str(&row.text("declared")?).map_err(unreadable)?,
        packed: row
            .optional_text("packed_name")?
            .zip(row.optional_text("packed_sha256")?)
            .map(|(name, sha256)| {
                let left_out = serde_json::from_str(&row.text("packed_left_out")?).map_err(unreadable)?;
                Ok::<_, Error>(Packed { name, sha256, left_out })
            })
            .transpose()?,
        metadata: rows::read(&row.text("metadata")?)?,
        created_ms: row.number("created_ms")?,
    })
}

/// Makes the ray sets of one upload known, with their inspections, all or none; their parts are all stored. Answers them with
/// their times.
///
/// # Errors
/// The database did not answer. Within: the tenant has no room for them; none is known.
pub async fn insert(
    records: &Records,
    tenant: &str,
    quota: Quota,
    new: Vec<Draft>,
) -> Result<Result<Vec<RaySet>, Exceeded>, Error> {
    let mut transaction = records.begin().await?;
    let mut known = Vec::new();
    for draft in new {
        known.push(insert_one(&mut transaction, tenant, draft).await?);
    }
    if let Err(exceeded) = quota.check_bytes(&mut transaction, tenant).await? {
        transaction.rollback().await?;
        return Ok(Err(exceeded));
    }
    crash::point("upload.before_commit");
    transaction.commit().await?;
    crash::point("upload.committed");
    Ok(Ok(known))
}

/// Adds a ray set to the transaction that makes it known; with its time.
///
/// # Errors
/// The database did not answer.
pub async fn insert_one(transaction: &mut Transaction, tenant: &str, draft: Draft) -> Result<RaySet, Error> {
    let Draft { ray_set: new, parts, inspection } = draft;
    let insert = "INSERT INTO ray_sets (tenant, id, name, byte_count, sha256, header, packed_name, packed_sha256, \
                  declared, packed_left_out, metadata, created_ms) \
                  VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11, {now}) RETURNING created_ms";
    let insert =
        sql(insert).bind(tenant).bind(new.id.as_str()).bind(new.name.as_str()).bind(new.byte_count.cast_signed());
    let insert = insert.bind(new.sha256.as_str()).bind(new.header.as_str());
    let packed = new.packed.as_ref();
    let insert = insert.bind(packed.map(|packed| packed.name.as_str()));
    let insert = insert.bind(packed.map(|packed| packed.sha256.as_str()));
    let declared = serde_json::to_string(&new.declared).map_err(unreadable)?;
    let left_out = packed.map_or(&[][..], |packed| &packed.left_out);
    let left_out = serde_json::to_string(&left_out[..left_out.len().min(MOST_LEFT_OUT)]).map_err(unreadable)?;
    let insert = insert.bind(declared).bind(left_out).bind(rows::written(&new.metadata)?);
    let rows = transaction.read(insert).await?;
    rows::of_ray_set(transaction, tenant, &new.id, &new.metadata).await?;
    for (number, part) in parts.iter().enumerate() {
        let insert = sql("INSERT INTO parts (ray_set_id, number, byte_count, blob) VALUES ($1, $2, $3, $4)");
        let insert = insert.bind(new.id.as_str()).bind(number as i64);
        transaction.write(insert.bind(part.byte_count.cast_signed()).bind(part.blob.as_str())).await?;
    }
    inspections::insert(transaction, &new.id, &inspection).await?;
    let created_ms = rows.first().map_or(Ok(0), |row| row.number("created_ms"))?;
    Ok(RaySet { created_ms, ..new })
}

/// The ray set `id` of `tenant`, if there is one.
///
/// # Errors
/// The database did not answer.
pub async fn get(records: &Records, tenant: &str, id: &str) -> Result<Option<RaySet>, Error> {
    let select = sql("SELECT * FROM ray_sets WHERE tenant = $1 AND id = $2");
    let row = records.read_one(select.bind(tenant).bind(id)).await?;
    row.as_ref().map(ray_set).transpose()
}

/// Selects ray sets of a tenant; the default selects all.
#[derive(Clone, Debug, Default)]
pub struct Wanted<'a> {
    /// Ray sets with this name.
    pub name: Option<&'a str>,
    /// Ray sets whose file has this SHA-256, lower-case hex.
    pub sha256: Option<&'a str>,
    /// Ray sets whose metadata has all of these keys and values.
    pub metadata: Metadata,
}

/// One page; the index that finds it is chosen by what stands before.
macro_rules! page {
    (with metadata $($found:literal),*) => {
        page!(
            "AND id IN (SELECT ray_set_id FROM ray_set_metadata WHERE tenant = $1 AND pair IN ({texts of $4 texts}) \
             GROUP BY ray_set_id HAVING COUNT(*) = $5) ",
            $($found),*
        )
    };
    ($($found:literal),*) => {
        concat!(
            "SELECT * FROM ray_sets WHERE tenant = $1 AND ($2 IS NULL OR id < $2) ",
            $($found,)*
            "ORDER BY id DESC LIMIT $3"
        )
    };
}

/// At most `limit` ray sets of `tenant` that are `wanted`, older than the one called `before`, newest first.
///
/// # Errors
/// The database did not answer.
pub async fn list(
    records: &Records,
    tenant: &str,
    wanted: Wanted<'_>,
    before: Option<&str>,
    limit: i64,
) -> Result<Vec<RaySet>, Error> {
    let select = |text| sql(text).bind(tenant).bind(before).bind(limit);
    let found = |text| bind_wanted(select(text), &wanted.metadata);
    let select = match (wanted.metadata.is_empty(), wanted.sha256, wanted.name) {
        (true, None, None) => select(page!("")),
        (true, None, Some(name)) => select(page!("AND name = $4 ")).bind(name),
        (true, Some(sha256), None) => select(page!("AND sha256 = $4 ")).bind(sha256),
        (true, Some(sha256), Some(name)) => select(page!("AND sha256 = $4 AND name = $5 ")).bind(sha256).bind(name),
        (false, None, None) => found(page!(with metadata ""))?,
        (false, None, Some(name)) => found(page!(with metadata "AND name = $6 "))?.bind(name),
        (false, Some(sha256), None) => found(page!(with metadata "AND sha256 = $6 "))?.bind(sha256),
        (false, Some(sha256), Some(name)) => {
            found(page!(with metadata "AND sha256 = $6 AND name = $7 "))?.bind(sha256).bind(name)
        }
    };
    records.read(select).await?.iter().map(ray_set).collect()
}

/// The parts of a ray set, in order.
///
/// # Errors
/// The database did not answer.
pub async fn parts(records: &Records, id: &str) -> Result<Vec<Part>, Error> {
    let select = sql("SELECT byte_count, blob FROM parts WHERE ray_set_id = $1 ORDER BY number").bind(id);
    let rows = records.read(select).await?;
    rows.iter().map(|row| Ok(Part { byte_count: row.count("byte_count")?, blob: row.text("blob")? })).collect()
}

/// Deletes the rows of a ray set of `tenant` that no unfinished job needs.
///
/// # Errors
/// The database did not answer.
pub async fn delete(records: &Records, tenant: &str, id: &str) -> Result<Deletion, Error> {
    let mut transaction = records.begin().await?;
    // Waits for whoever is queuing a job for it, and makes those that come later wait: only then can the jobs be looked at.
    transaction
        .write(sql("UPDATE ray_sets SET name = name WHERE tenant = $1 AND id = $2").bind(tenant).bind(id))
        .await?;
    // A ray set that came in several uploads has its blobs in their folders, each of which is its own alone.
    let named = transaction.read(sql("SELECT blob FROM parts WHERE ray_set_id = $1").bind(id)).await?;
    let mut folders = BTreeSet::from([ray_set_folder(id)]);
    for row in named {
        folders.extend(row.text("blob")?.rsplit_once('/').map(|(folder, _)| folder.to_owned()));
    }
    let delete = "DELETE FROM ray_sets WHERE tenant = $1 AND id = $2 AND NOT EXISTS (SELECT 1 FROM job_inputs \
                  JOIN jobs ON jobs.id = job_inputs.job_id \
                  WHERE job_inputs.ray_set_id = $2 AND jobs.state IN ('queued', 'running'))";
    let deleted = transaction.write(sql(delete).bind(tenant).bind(id)).await?;
    transaction.commit().await?;
    if deleted > 0 {
        return Ok(Deletion::Deleted(folders.into_iter().collect()));
    }
    Ok(if get(records, tenant, id).await?.is_some() { Deletion::Needed } else { Deletion::Missing })
}

/// A file in an archive that was not made a ray set, and why.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct LeftOut {
    /// Name of the file in the archive.
    pub name: String,
    /// Stable code: programs may depend on it.
    pub code: String,
    /// Why it was left out, and what to do.
    pub detail: String,
}
