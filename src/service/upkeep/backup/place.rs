//! Where a backup may go: into a folder of its own that is outside of everything which is copied or served. A folder is known as
//! an earlier backup by a file that says so, which the first backup puts into an empty folder before anything else. A service
//! that is started on a backup takes that file away: from then on it is a data folder, and no backup is put over it.

use super::error::Error;
use crate::config::Config;
use crate::storage::{database_url, private};
use crate::upkeep::lock::{LockError, lock};
use std::fs::{File, TryLockError};
use std::io::{Read, Write};
use std::os::unix::fs::MetadataExt;
use std::path::{Component, Path, PathBuf};
use std::{fs, io};

/// The file by which an earlier backup is known.
const MARK: &str = "lampwright-backup.txt";
/// What that file begins with.
const MARKED: &str = "This folder is a backup made by `lampwright backup`.\n";
/// And how it goes on.
const EXPLAINED: &str = "The next backup to it adds what is new. To restore, start `lampwright serve --data` on it or on a copy: \
                         this file is deleted then, and the folder is no place for backups any more.\n";
/// What a backup may consist of. SQLite's own files beside a database are there after a backup that was stopped.
const PARTS: [&str; 10] = [
    MARK,
    "lock",
    "blobs",
    "service.db",
    "service.db-wal",
    "service.db-shm",
    "service.db.new",
    "service.db.new-wal",
    "service.db.new-shm",
    "service.db.new-journal",
];

/// Makes the folder `to` ready for a copy of the stores of `config` and keeps everybody else out of it, as long as what is
/// returned lives. Nothing is written to a folder that is refused.
///
/// # Errors
/// [`Error::Inside`], [`Error::Around`], [`Error::Served`], [`Error::Occupied`], [`Error::Disk`].
pub fn take(config: &Config, to: &Path) -> Result<File, Error> {
    let failed = |error| Error::Disk { path: to.to_owned(), error };
    let settled = settle(to).map_err(failed)?;
    for kept in kept(config) {
        let there = settle(&kept).map_err(failed)?;
        if is_within(&settled, &there) {
            return Err(Error::Inside { to: to.to_owned(), kept });
        }
        if is_within(&there, &settled) {
            return Err(Error::Around { to: to.to_owned(), kept });
        }
    }
    if let Some(served) = settled.ancestors().find(|folder| is_served(folder)) {
        return Err(Error::Served(served.to_owned()));
    }
    judge(&settled)?;
    // Held until all is written: what is served is not replaced, and what is being replaced is not served.
    let held = lock(&settled).map_err(|error| match error {
        LockError::Folder { folder: path, error } => Error::Disk { path, error },
        LockError::Locked(_) => Error::Served(to.to_owned()),
    })?;
    // Somebody may have been here before it was locked.
    judge(&settled)?;
    let mut closed = private::Closed::default();
    closed.close(&settled);
    mark(&settled).map_err(failed)?;
    Ok(held)
}

/// Says that a service is started on `folder`, which may have been a backup: it is one no longer.
///
/// # Errors
/// The disk said no.
pub fn serve(folder: &Path) -> io::Result<()> {
    match fs::remove_file(folder.join(MARK)) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
        removed => removed,
    }
}

/// The folders that are copied or served.
fn kept(config: &Config) -> Vec<PathBuf> {
    let rows = database_url::path(&config.database_url());
    let rows = rows.and_then(|file| file.parent().map(|folder| Path::new(".").join(folder)));
    let blobs = config.storage_url().strip_prefix("file:").map(PathBuf::from);
    [config.data.clone()].into_iter().chain(rows).chain(blobs).collect()
}

/// The absolute path that `path` will be once its missing folders are made: links are followed, and `..` is the folder above the
/// one that was reached.
fn settle(path: &Path) -> io::Result<PathBuf> {
    let mut settled = PathBuf::new();
    for part in std::path::absolute(path)?.components() {
        if part == Component::ParentDir {
            settled.pop();
            continue;
        }
        settled.push(part);
        match fs::canonicalize(&settled) {
            Ok(there) => settled = there,
            // Still to be made; a link that leads nowhere is an error.
            Err(error) if error.kind() == io::ErrorKind::NotFound && fs::symlink_metadata(&settled).is_err() => {}
            Err(error) => return Err(error),
        }
    }
    Ok(settled)
}

/// Whether `inner` is `outer` or below it, also where one of them is mounted in a second place.
fn is_within(inner: &Path, outer: &Path) -> bool {
    let number = |folder: &Path| fs::metadata(folder).ok().map(|found| (found.dev(), found.ino()));
    let there = number(outer);
    inner.ancestors().any(|folder| folder == outer || there.is_some() && number(folder) == there)
}

/// Whether a service runs on `folder`.
fn is_served(folder: &Path) -> bool {
    let lock = folder.join("lock");
    folder.join("service.db").is_file()
        && lock.is_file()
        && File::open(lock).is_ok_and(|file| matches!(file.try_lock(), Err(TryLockError::WouldBlock)))
}

/// Refuses a folder that holds anything else than an earlier backup.
fn judge(to: &Path) -> Result<(), Error> {
    let failed = |error| Error::Disk { path: to.to_owned(), error };
    let entries = match fs::read_dir(to) {
        Ok(entries) => entries.collect::<io::Result<Vec<_>>>().map_err(failed)?,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
        Err(error) => return Err(failed(error)),
    };
    let is_marked = is_marked(to);
    let belongs = |entry: &fs::DirEntry| match entry.file_name().to_str() {
        Some(name) if is_marked => PARTS.contains(&name),
        // Of a backup that was stopped before its mark.
        Some("lock") => entry.metadata().is_ok_and(|found| found.is_file() && found.len() == 0),
        _ => false,
    };
    match entries.iter().find(|entry| !belongs(entry)) {
        Some(other) => Err(Error::Occupied { to: to.to_owned(), found: other.file_name().display().to_string() }),
        None => Ok(()),
    }
}

fn is_marked(folder: &Path) -> bool {
    let mut beginning = Vec::new();
    let read = File::open(folder.join(MARK)).and_then(|file| file.take(1024).read_to_end(&mut beginning));
    read.is_ok() && beginning.starts_with(MARKED.as_bytes())
}

fn mark(folder: &Path) -> io::Result<()> {
    if is_marked(folder) {
        return Ok(());
    }
    let mut file = private::open_file(&folder.join(MARK))?;
    file.write_all(MARKED.as_bytes())?;
    file.write_all(EXPLAINED.as_bytes())?;
    file.sync_all()
}
