//! Rows of ray sets and their parts.

use super::Error;
use super::parts::Part;
use super::records::{Records, Row, sql};

/// A ray file as it was taken in.
#[derive(Clone, Debug)]
pub struct RaySet {
    /// UUIDv7.
    pub id: String,
    /// What the user calls it.
    pub name: String,
    /// Length, bytes.
    pub byte_count: u64,
    /// SHA-256 of the bytes, lower-case hex.
    pub sha256: String,
    /// What the file says of itself: the pipeline's header, as JSON.
    pub header: String,
    /// When it was complete, epoch ms.
    pub created_ms: i64,
}

/// What came of asking to delete a ray set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Deletion {
    /// Its row is gone; its blobs may go.
    Deleted,
    /// An unfinished job needs it.
    Needed,
    /// There is none.
    Missing,
}

fn ray_set(row: &Row) -> Result<RaySet, Error> {
    Ok(RaySet {
        id: row.text("id")?,
        name: row.text("name")?,
        byte_count: row.count("byte_count")?,
        sha256: row.text("sha256")?,
        header: row.text("header")?,
        created_ms: row.number("created_ms")?,
    })
}

/// Makes a ray set known, whose parts are all stored. Answers it with its time.
///
/// # Errors
/// The database did not answer.
pub async fn insert(records: &Records, new: RaySet, parts: &[Part]) -> Result<RaySet, Error> {
    let mut transaction = records.begin().await?;
    let insert = "INSERT INTO ray_sets (id, name, byte_count, sha256, header, created_ms) \
                  VALUES ($1, $2, $3, $4, $5, {now}) RETURNING created_ms";
    let insert = sql(insert).bind(new.id.as_str()).bind(new.name.as_str()).bind(new.byte_count.cast_signed());
    let rows = transaction.read(insert.bind(new.sha256.as_str()).bind(new.header.as_str())).await?;
    for (number, part) in parts.iter().enumerate() {
        let insert = sql("INSERT INTO parts (ray_set_id, number, byte_count, blob) VALUES ($1, $2, $3, $4)");
        let insert = insert.bind(new.id.as_str()).bind(number as i64);
        transaction.write(insert.bind(part.byte_count.cast_signed()).bind(part.blob.as_str())).await?;
    }
    transaction.commit().await?;
    let created_ms = rows.first().map_or(Ok(0), |row| row.number("created_ms"))?;
    Ok(RaySet { created_ms, ..new })
}

/// The ray set `id`, if there is one.
///
/// # Errors
/// The database did not answer.
pub async fn get(records: &Records, id: &str) -> Result<Option<RaySet>, Error> {
    let row = records.read_one(sql("SELECT * FROM ray_sets WHERE id = $1").bind(id)).await?;
    row.as_ref().map(ray_set).transpose()
}

/// At most `limit` ray sets older than the one called `before`, newest first.
///
/// # Errors
/// The database did not answer.
pub async fn list(records: &Records, before: Option<&str>, limit: i64) -> Result<Vec<RaySet>, Error> {
    let select = sql("SELECT * FROM ray_sets WHERE ($1 IS NULL OR id < $1) ORDER BY id DESC LIMIT $2");
    records.read(select.bind(before).bind(limit)).await?.iter().map(ray_set).collect()
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

/// Deletes the rows of a ray set that no unfinished job needs.
///
/// # Errors
/// The database did not answer.
pub async fn delete(records: &Records, id: &str) -> Result<Deletion, Error> {
    let mut transaction = records.begin().await?;
    // Waits for whoever is queuing a job for it, and makes those that come later wait: only then can the jobs be looked at.
    transaction.write(sql("UPDATE ray_sets SET name = name WHERE id = $1").bind(id)).await?;
    let delete = "DELETE FROM ray_sets WHERE id = $1 AND NOT EXISTS (SELECT 1 FROM job_inputs \
                  JOIN jobs ON jobs.id = job_inputs.job_id \
                  WHERE job_inputs.ray_set_id = $1 AND jobs.state IN ('queued', 'running'))";
    let deleted = transaction.write(sql(delete).bind(id)).await?;
    transaction.commit().await?;
    if deleted > 0 {
        return Ok(Deletion::Deleted);
    }
    Ok(if get(records, id).await?.is_some() { Deletion::Needed } else { Deletion::Missing })
}
