//! The lock on a data folder: one process at a time.

use crate::storage::private;
use std::fs::{File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};

/// Why a data folder cannot be locked.
#[derive(Debug, thiserror::Error)]
pub enum LockError {
    /// It cannot be used.
    #[error("the data folder {} cannot be used: {error}", folder.display())]
    Folder {
        /// Which.
        folder: PathBuf,
        /// Why.
        error: io::Error,
    },
    /// Another process has it.
    #[error("the data folder {} is in use by another process", .0.display())]
    Locked(PathBuf),
}

/// Makes the data folder if need be and locks it for this process, until the file is dropped.
///
/// # Errors
/// [`LockError`].
pub fn lock(folder: &Path) -> Result<File, LockError> {
    let failed = |error| LockError::Folder { folder: folder.to_owned(), error };
    private::make_folder(folder).map_err(failed)?;
    let file = private::open_file(&folder.join("lock")).map_err(failed)?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => Err(LockError::Locked(folder.to_owned())),
        Err(TryLockError::Error(error)) => Err(failed(error)),
    }
}
