//! A copy of everything, taken while the service runs: first the rows, as they are at one moment, then every blob that they
//! name. A blob is written before its row and never changed, so all of them are there, but for those that somebody deletes
//! meanwhile; what they belong to is deleted from the copy too. The copy is a data folder: to restore is to serve it.

use super::Config;
use super::storage::Storage;
use super::storage::records::{Records, sql};
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

/// Why there is no backup.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// Other engines have their own ways.
    #[error("this backup is for SQLite and local files only")]
    Elsewhere,
    /// A row names a blob that is not there.
    #[error("the blob {0} is missing from the store")]
    Missing(String),
    /// The disk said no.
    #[error("{}: {error}", path.display())]
    Disk {
        /// Where.
        path: PathBuf,
        /// Why.
        error: io::Error,
    },
    /// A store did not answer.
    #[error(transparent)]
    Storage(#[from] super::storage::Error),
}

/// What a backup did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Copied {
    /// Blobs that the copy has.
    pub blobs: u64,
    /// Of them, those that it did not have before.
    pub fresh: u64,
    /// Their length, bytes.
    pub fresh_bytes: u64,
    /// Ray sets, jobs and unfinished uploads that were deleted meanwhile.
    pub deleted: u64,
}

/// Copies the stores of `config` into the folder `to`. A folder that holds an earlier backup gets what is new; that backup
/// stays whole until this one is.
///
/// # Errors
/// [`Error`].
pub async fn backup(config: &Config, to: &Path) -> Result<Copied, Error> {
    let Some(blobs) = config.storage_url().strip_prefix("file:").map(PathBuf::from) else {
        return Err(Error::Elsewhere);
    };
    if !config.database_url().starts_with("sqlite:") {
        return Err(Error::Elsewhere);
    }
    let storage = Storage::open(&config.database_url(), &config.storage_url()).await?;
    let copy = snapshot(&storage.records, to).await?;
    let copied = fill(&storage, &blobs, &copy, &to.join("blobs")).await;
    copy.close().await;
    storage.records.close().await;
    let copied = copied?;
    let (new, whole) = (new_file(to), to.join("service.db"));
    // What the earlier one had not yet written into its file is not this one's.
    for rest in ["-wal", "-shm"] {
        let _ = fs::remove_file(to.join(format!("service.db{rest}")));
    }
    fs::rename(&new, &whole)
        .and_then(|()| File::open(to)?.sync_all())
        .map_err(|error| Error::Disk { path: whole, error })?;
    Ok(copied)
}

fn new_file(to: &Path) -> PathBuf {
    to.join("service.db.new")
}

/// The rows of one moment, as a database of their own.
async fn snapshot(records: &Records, to: &Path) -> Result<Records, Error> {
    fs::create_dir_all(to).map_err(|error| Error::Disk { path: to.to_owned(), error })?;
    let file = new_file(to);
    for rest in ["", "-wal", "-shm"] {
        let _ = fs::remove_file(to.join(format!("service.db.new{rest}")));
    }
    records.write(sql("VACUUM INTO $1").bind(file.display().to_string())).await?;
    Ok(Records::open(&format!("sqlite:{}", file.display())).await?)
}

/// Copies every blob that `copy` names from the folder `from` to the folder `to`.
async fn fill(live: &Storage, from: &Path, copy: &Records, to: &Path) -> Result<Copied, Error> {
    let mut copied = Copied::default();
    let named = "SELECT blob FROM parts UNION ALL SELECT blob FROM artifacts UNION ALL SELECT blob FROM upload_parts";
    for row in copy.read(sql(named)).await? {
        let blob = row.text("blob")?;
        let (from, to) = (from.join(&blob), to.join(&blob));
        let written = tokio::task::spawn_blocking(move || copy_file(&from, &to)).await;
        match written.map_err(io::Error::other).and_then(|written| written) {
            Ok(fresh) => {
                copied.blobs += 1;
                copied.fresh += u64::from(fresh.is_some());
                copied.fresh_bytes += fresh.unwrap_or(0);
            }
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                if is_named(&live.records, &blob).await? {
                    return Err(Error::Missing(blob));
                }
                copied.deleted += forget(copy, &blob).await?;
            }
            Err(error) => return Err(Error::Disk { path: blob.into(), error }),
        }
    }
    Ok(copied)
}

async fn is_named(records: &Records, blob: &str) -> Result<bool, Error> {
    let select = "SELECT blob FROM parts WHERE blob = $1 UNION ALL SELECT blob FROM artifacts WHERE blob = $1 \
                  UNION ALL SELECT blob FROM upload_parts WHERE blob = $1";
    Ok(records.read_one(sql(select).bind(blob)).await?.is_some())
}

/// Deletes what `blob` belonged to.
async fn forget(copy: &Records, blob: &str) -> Result<u64, Error> {
    let ray_sets = sql("DELETE FROM ray_sets WHERE id IN (SELECT ray_set_id FROM parts WHERE blob = $1)");
    let jobs = sql("DELETE FROM jobs WHERE id IN (SELECT job_id FROM artifacts WHERE blob = $1)");
    let uploads = sql("DELETE FROM uploads WHERE id IN (SELECT upload_id FROM upload_parts WHERE blob = $1)");
    let kept = copy.write(ray_sets.bind(blob)).await? + copy.write(jobs.bind(blob)).await?;
    Ok(kept + copy.write(uploads.bind(blob)).await?)
}

/// Copies a file durably, unless it is there already: blobs never change. How many bytes were written, if any file was.
fn copy_file(from: &Path, to: &Path) -> io::Result<Option<u64>> {
    let byte_count = fs::metadata(from)?.len();
    if fs::metadata(to).is_ok_and(|there| there.len() == byte_count) {
        return Ok(None);
    }
    let folder = to.parent().ok_or(io::ErrorKind::InvalidInput)?;
    fs::create_dir_all(folder)?;
    let part = to.with_extension("part");
    fs::copy(from, &part)?;
    File::open(&part)?.sync_all()?;
    fs::rename(&part, to)?;
    File::open(folder)?.sync_all()?;
    Ok(Some(byte_count))
}
