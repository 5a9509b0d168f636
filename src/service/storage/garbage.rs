//! Blobs that no row names, and never will: what killed processes, lost attempts and broken uploads left behind.

use super::blobs::Listed;
use super::records::sql;
use super::{Error, Storage, job_folder};
use std::collections::{HashMap, HashSet};
use std::time::Duration;

/// Deletes them; how many. A blob goes when no row names it, no running attempt may yet name it, and nothing was written
/// to its folder for `age`: whoever still sends a file writes a part before it counts as silent. An `age` of 0 is only right
/// while nobody else writes.
///
/// # Errors
/// A store did not answer.
pub async fn collect(storage: &Storage, age: Duration) -> Result<usize, Error> {
    // Listed before the rows are read: what is named later was listed later, too.
    let listed = storage.blobs.list("").await?;
    let mut youngest: HashMap<&str, Duration> = HashMap::new();
    for blob in &listed {
        let youngest = youngest.entry(folder(&blob.key)).or_insert(blob.age);
        *youngest = blob.age.min(*youngest);
    }
    // And what runs before what is named: an attempt that is published in between is in both.
    let running = running(storage).await?;
    let named = named(storage).await?;
    let garbage = |blob: &&Listed| {
        let folder = folder(&blob.key);
        !named.contains(&blob.key) && !running.contains(folder) && youngest.get(folder).is_none_or(|it| *it >= age)
    };
    let mut deleted = storage.blobs.delete_unfinished(age).await?;
    for blob in listed.iter().filter(garbage) {
        storage.blobs.delete(&blob.key).await?;
        deleted += 1;
    }
    Ok(deleted)
}

/// Everything before the last part of a key.
fn folder(key: &str) -> &str {
    key.rsplit_once('/').map_or("", |(folder, _)| folder)
}

/// Every key that a row names.
async fn named(storage: &Storage) -> Result<HashSet<String>, Error> {
    let select = "SELECT blob FROM parts UNION ALL SELECT blob FROM artifacts UNION ALL SELECT blob FROM upload_parts";
    let rows = storage.records.read(sql(select)).await?;
    rows.iter().map(|row| row.text("blob")).collect()
}

/// The folders of attempts that may still be published.
async fn running(storage: &Storage) -> Result<HashSet<String>, Error> {
    let rows = storage.records.read(sql("SELECT id, fence FROM jobs WHERE state = 'running'")).await?;
    rows.iter().map(|row| Ok(format!("{}/{}", job_folder(&row.text("id")?), row.number("fence")?))).collect()
}
