//! Blobs that no row names, and never will: what killed processes, lost attempts and broken uploads left behind. Only what the
//! service can have written itself is deleted; other objects in the store belong to other programs and are left alone.

use crate::storage::Storage;
use crate::storage::blobs::Listed;
use crate::storage::error::Error;
use crate::storage::keys::OWNER_KEY;
use crate::storage::keys::{FOLDERS, is_key, job_folder};
use crate::storage::records::statement::sql;
use std::collections::{BTreeMap, HashMap, HashSet};
use std::time::Duration;

/// Folders that the log names one by one when blobs in them are deleted, and things that are left alone.
const NAMED: usize = 100;

/// What [`collect`] did.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Collected {
    /// Keys of what it deleted.
    pub deleted: Vec<String>,
    /// What is in the store and is not the service's, as far as the store tells.
    pub left_alone: Vec<String>,
}

/// Deletes blobs that no row names, that no running attempt may yet name, and to whose folder nothing was written for `age`: a
/// client that still sends a file writes a part before that. An `age` of 0 is only right while no other process writes. Every
/// folder from which blobs are deleted is logged, and every blob at the level debug.
///
/// # Errors
/// A store did not answer. What was deleted before that is logged.
pub async fn collect(storage: &Storage, age: Duration) -> Result<Collected, Error> {
    // Listed before the rows are read: what is named later was listed later, too.
    let mut listed = Vec::new();
    for prefix in FOLDERS {
        listed.extend(storage.blobs.list(prefix).await?);
    }
    let (ours, strange): (Vec<Listed>, Vec<Listed>) = listed.into_iter().partition(|blob| is_key(&blob.key));
    let mut left_alone: Vec<String> = strange.into_iter().map(|blob| blob.key).collect();
    match storage.blobs.beside(&[&FOLDERS[..], &[OWNER_KEY]].concat()).await {
        Ok(beside) => left_alone.extend(beside),
        // Only to be told: a name that is no key is no reason to collect nothing.
        Err(error) => tracing::debug!(%error, "cannot list the other objects in the object store"),
    }
    let mut youngest: HashMap<&str, Duration> = HashMap::new();
    for blob in &ours {
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
    let mut deleted = storage.blobs.delete_unfinished(age, is_key).await?;
    let mut done = Ok(());
    for blob in ours.iter().filter(garbage) {
        done = storage.blobs.delete(&blob.key).await;
        if done.is_err() {
            break;
        }
        deleted.push(blob.key.clone());
    }
    log(&deleted);
    done.map(|()| Collected { deleted, left_alone })
}

/// Logs what was deleted, folder by folder.
fn log(deleted: &[String]) {
    let mut folders: BTreeMap<&str, usize> = BTreeMap::new();
    for key in deleted {
        tracing::debug!(key, "deleted a blob that the database does not name");
        *folders.entry(folder(key)).or_default() += 1;
    }
    for (folder, blobs) in folders.iter().take(NAMED) {
        tracing::info!(folder, blobs, "deleted blobs that the database does not name");
    }
    let rest: Vec<usize> = folders.values().skip(NAMED).copied().collect();
    if !rest.is_empty() {
        let (folders, blobs) = (rest.len(), rest.iter().sum::<usize>());
        tracing::info!(
            folders,
            blobs,
            "deleted blobs that the database does not name, in more folders; the log level debug names each"
        );
    }
}

impl Collected {
    /// Logs how much is left alone, unless it is as much as was `told` before; how much that is.
    pub fn log_left_alone(&self, told: usize) -> usize {
        let count = self.left_alone.len();
        if count != told && count > 0 {
            let named: Vec<&str> = self.left_alone.iter().take(NAMED / 10).map(String::as_str).collect();
            let first = named.join(", ");
            tracing::warn!(
                count,
                first,
                "the object store holds objects that this service did not write; they are left alone"
            );
        }
        count
    }
}

/// Everything before the last part of a key.
fn folder(key: &str) -> &str {
    key.rsplit_once('/').map_or("", |(folder, _)| folder)
}

/// Every key that a row names.
pub async fn named(storage: &Storage) -> Result<HashSet<String>, Error> {
    let select = "SELECT blob FROM parts UNION ALL SELECT blob FROM artifacts UNION ALL SELECT blob FROM upload_parts";
    let rows = storage.records.read(sql(select)).await?;
    rows.iter().map(|row| row.text("blob")).collect()
}

/// The folders of attempts that may still be published.
async fn running(storage: &Storage) -> Result<HashSet<String>, Error> {
    let rows = storage.records.read(sql("SELECT id, fence FROM jobs WHERE state = 'running'")).await?;
    rows.iter().map(|row| Ok(format!("{}/{}", job_folder(&row.text("id")?), row.number("fence")?))).collect()
}
