//! Which database the blobs of a store belong to. The store says so itself, in one blob: a service that was started with another
//! database (a misspelt path, a disk that is not mounted) has no row that names them, and would delete them all as garbage.

use super::garbage;
use crate::storage::Storage;
use crate::storage::error::{Error, Unusable};
use crate::storage::keys::OWNER_KEY;
use crate::storage::keys::{FOLDERS, is_key, new_id};
use crate::storage::records::statement::sql;
use bytes::Bytes;
use futures::TryStreamExt;

/// Sees that the blobs belong to the database. A store that does not say so yet is marked, if it holds nothing, or something that
/// a row names, or the database has marked one before.
///
/// # Errors
/// [`Unusable::OtherBlobs`]; a store did not answer.
pub async fn check(storage: &Storage) -> Result<(), Error> {
    let name = name(storage).await?;
    if let Some((_, mark)) = storage.blobs.whole(OWNER_KEY).await? {
        let mark: Vec<Bytes> = mark.try_collect().await?;
        let is_ours = name.is_some_and(|name| mark.concat() == name.as_bytes());
        return if is_ours { Ok(()) } else { Err(Unusable::OtherBlobs.into()) };
    }
    let named = garbage::named(storage).await?;
    let mut blobs = Vec::new();
    for folder in FOLDERS {
        blobs.extend(storage.blobs.list(folder).await?.into_iter().map(|blob| blob.key));
    }
    // Whose a probe was is of no interest.
    blobs.retain(|key| is_key(key) && !key.starts_with("probes/"));
    match (blobs.is_empty(), named.is_empty()) {
        // As where the disk is not mounted: what is written now would be on another one.
        (true, false) => Ok(()),
        (false, _) if name.is_none() && !blobs.iter().any(|key| named.contains(key)) => {
            Err(Unusable::OtherBlobs.into())
        }
        _ => mark(storage, name).await,
    }
}

/// Writes the name of the database to the store, and to the database before that, if it has none.
async fn mark(storage: &Storage, known: Option<String>) -> Result<(), Error> {
    if known.is_none() {
        let insert = "INSERT INTO owner (id, name) VALUES (1, $1) ON CONFLICT (id) DO NOTHING";
        storage.records.write(sql(insert).bind(new_id())).await?;
    }
    let name = name(storage).await?.ok_or_else(|| Error::fault("the database did not keep its name"))?;
    storage.blobs.put(OWNER_KEY, name.into()).await
}

/// The name of the database, which it has once it has marked a store.
async fn name(storage: &Storage) -> Result<Option<String>, Error> {
    let row = storage.records.read_one(sql("SELECT name FROM owner WHERE id = 1")).await?;
    row.map(|row| row.text("name")).transpose()
}
