//! A copy of everything, taken while the service runs: first the rows, as they are at one moment, then every blob that they name.
//! A blob is written before its row and never changed, so all of them are there, except those that a client deletes during the
//! backup; their ray sets and jobs are deleted from the copy too. The short last part of an upload goes with the request that goes
//! on with it: such an upload is copied as it is then. Where it has become ray sets by then, of which these rows know nothing,
//! those of a later moment are taken. The copy is a data folder: to restore is to serve it.

/// Where it may go.
mod place;
/// Why a backup is not made.
pub mod error;

use crate::config::Config;
use crate::storage::records::Records;
use crate::storage::records::statement::{Row, sql};
use crate::storage::{Storage, database_url, private};
pub use error::Error;
pub use place::serve as begin_to_serve;
use std::collections::HashSet;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::{fs, io};

/// Moments that are tried: a later one has little left to copy, and is hardly outrun.
const MOMENTS: u32 = 5;

/// Result of a backup.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Copied {
    /// Number of blobs in the backup.
    pub blobs: u64,
    /// Number of blobs that the backup did not have before.
    pub fresh: u64,
    /// Length of the new blobs, bytes.
    pub fresh_bytes: u64,
    /// Number of ray sets, jobs and unfinished uploads that were deleted during the backup.
    pub deleted: u64,
}

/// Copies the stores of `config` into the folder `to`. A folder that holds an earlier backup gets what is new; that backup
/// stays whole until this one is.
///
/// # Errors
/// [`Error`].
pub async fn backup(config: &Config, to: &Path) -> Result<Copied, Error> {
    let Some(blobs) = config.storage_url().strip_prefix("file:").map(PathBuf::from) else {
        return Err(Error::NotLocal);
    };
    if database_url::path(&config.database_url()).is_none() {
        return Err(Error::NotLocal);
    }
    let _held = place::take(config, to)?;
    let storage = Storage::open(&config.database_url(), &config.storage_url()).await?;
    let copied = copy_all(&storage, &blobs, to).await;
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

/// Copies the rows of a moment and every blob they name.
async fn copy_all(live: &Storage, from: &Path, to: &Path) -> Result<Copied, Error> {
    let mut earlier = Copied::default();
    for _ in 0..MOMENTS {
        let copy = snapshot(&live.records, to).await?;
        let mut copied = Copied { fresh: earlier.fresh, fresh_bytes: earlier.fresh_bytes, ..Copied::default() };
        let filled = fill(live, from, &copy, &to.join("blobs"), &mut copied).await;
        copy.close().await;
        match filled {
            Err(Error::Outrun) => earlier = copied,
            filled => return filled.map(|()| copied),
        }
    }
    Err(Error::Outrun)
}

/// The rows of one moment, as a database of their own.
async fn snapshot(records: &Records, to: &Path) -> Result<Records, Error> {
    let file = new_file(to);
    for rest in ["", "-wal", "-shm"] {
        let _ = fs::remove_file(to.join(format!("service.db.new{rest}")));
    }
    // Made before it is written, so that nobody else can read it: SQLite writes into an empty file.
    private::open_file(&file).map_err(|error| Error::Disk { path: file.clone(), error })?;
    records.write(sql("VACUUM INTO $1").bind(file.display().to_string())).await?;
    Ok(Records::open(&database_url::url(&file)).await?)
}

/// Copies every blob that `copy` names from the folder `from` to the folder `to`.
async fn fill(live: &Storage, from: &Path, copy: &Records, to: &Path, copied: &mut Copied) -> Result<(), Error> {
    let named = "SELECT blob FROM parts UNION ALL SELECT blob FROM artifacts UNION ALL SELECT blob FROM upload_parts";
    for row in copy.read(sql(named)).await? {
        let blob = row.text("blob")?;
        if copied.add(&blob, from, to).await? {
            continue;
        }
        if is_named(&live.records, &blob).await? {
            return Err(Error::Missing(blob));
        }
        if !follow(live, from, copy, to, &blob, copied).await? {
            copied.deleted += delete_blob_row(copy, &blob).await?;
        }
    }
    Ok(())
}

impl Copied {
    /// Copies a blob from one folder to another; false when it is not there.
    async fn add(&mut self, blob: &str, from: &Path, to: &Path) -> Result<bool, Error> {
        let (from, to) = (from.join(blob), to.join(blob));
        let written = tokio::task::spawn_blocking(move || copy_file(&from, &to)).await;
        match written.map_err(io::Error::other).and_then(|written| written) {
            Ok(fresh) => {
                self.blobs += 1;
                self.fresh += u64::from(fresh.is_some());
                self.fresh_bytes += fresh.unwrap_or(0);
                Ok(true)
            }
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(false),
            Err(error) => Err(Error::Disk { path: blob.into(), error }),
        }
    }
}

/// Copies the upload that `blob` belongs to anew, as it is now, until nothing of it is replaced meanwhile; false when it
/// belongs to none, or that is gone. [`Error::Outrun`] when it has become ray sets, or a piece of another upload.
async fn follow(
    live: &Storage,
    from: &Path,
    copy: &Records,
    to: &Path,
    blob: &str,
    copied: &mut Copied,
) -> Result<bool, Error> {
    let of = sql("SELECT upload_id FROM upload_parts WHERE blob = $1").bind(blob);
    let Some(upload) = copy.read_one(of).await? else { return Ok(false) };
    let upload = upload.text("upload_id")?;
    // One statement: the offset is that of these parts.
    let now = "SELECT state, uploads.byte_count AS whole, offset_bytes, sha256_state, number, \
               upload_parts.byte_count AS byte_count, blob FROM uploads JOIN upload_parts ON upload_id = id \
               WHERE id = $1 AND state IN ('receiving', 'finishing', 'complete') ORDER BY number";
    'again: loop {
        let parts = live.records.read(sql(now).bind(upload.as_str())).await?;
        let Some(first) = parts.first() else {
            let taken =
                sql("SELECT id FROM uploads WHERE id = $1 AND state IN ('taken', 'joined')").bind(upload.as_str());
            return match live.records.read_one(taken).await? {
                Some(_) => Err(Error::Outrun),
                None => Ok(false),
            };
        };
        let there = sql("SELECT blob FROM upload_parts WHERE upload_id = $1").bind(upload.as_str());
        let there = copy.read(there).await?.iter().map(|row| row.text("blob")).collect::<Result<HashSet<_>, _>>()?;
        for part in &parts {
            let blob = part.text("blob")?;
            // What the copy's rows name is copied in its turn.
            if !there.contains(&blob) && !copied.add(&blob, from, to).await? {
                if is_named(&live.records, &blob).await? {
                    return Err(Error::Missing(blob));
                }
                continue 'again;
            }
        }
        replace(copy, &upload, first, &parts).await?;
        return Ok(true);
    }
}

/// Makes an upload of the copy what these rows are.
async fn replace(copy: &Records, upload: &str, now: &Row, parts: &[Row]) -> Result<(), Error> {
    let mut transaction = copy.begin().await?;
    let update = "UPDATE uploads SET state = $1, byte_count = $2, offset_bytes = $3, sha256_state = $4 WHERE id = $5";
    let update = sql(update).bind(now.text("state")?).bind(now.optional_number("whole")?);
    let update = update.bind(now.number("offset_bytes")?).bind(now.text("sha256_state")?).bind(upload);
    transaction.write(update).await?;
    transaction.write(sql("DELETE FROM upload_parts WHERE upload_id = $1").bind(upload)).await?;
    for part in parts {
        let insert = sql("INSERT INTO upload_parts (upload_id, number, byte_count, blob) VALUES ($1, $2, $3, $4)");
        let insert = insert.bind(upload).bind(part.number("number")?).bind(part.number("byte_count")?);
        transaction.write(insert.bind(part.text("blob")?)).await?;
    }
    transaction.commit().await?;
    Ok(())
}

async fn is_named(records: &Records, blob: &str) -> Result<bool, Error> {
    let select = "SELECT blob FROM parts WHERE blob = $1 UNION ALL SELECT blob FROM artifacts WHERE blob = $1 \
                  UNION ALL SELECT blob FROM upload_parts WHERE blob = $1";
    Ok(records.read_one(sql(select).bind(blob)).await?.is_some())
}

/// Deletes what `blob` belonged to.
async fn delete_blob_row(copy: &Records, blob: &str) -> Result<u64, Error> {
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
    private::make_folder(folder)?;
    // Named as the store names what it has not finished: should this be all that is left of a backup, a service that is started
    // on it deletes it.
    let name = to.file_name().ok_or(io::ErrorKind::InvalidInput)?;
    let part = folder.join(format!("{}#0", name.display()));
    let mut copy = private::open_file(&part)?;
    copy.set_len(0)?;
    io::copy(&mut File::open(from)?, &mut copy)?;
    copy.sync_all()?;
    fs::rename(&part, to)?;
    File::open(folder)?.sync_all()?;
    Ok(Some(byte_count))
}
