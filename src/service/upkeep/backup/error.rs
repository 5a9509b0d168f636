//! Why a backup is not made.

use std::io;
use std::path::PathBuf;

/// Why there is no backup.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// Other engines have their own ways.
    #[error("this command backs up SQLite databases and local files only")]
    NotLocal,
    /// The folder for the copy is being served.
    #[error("a service is running on {}", .0.display())]
    Served(PathBuf),
    /// The folder for the copy is what is to be copied, or in it.
    #[error("the folder {} lies in {}, which belongs to the service", to.display(), kept.display())]
    Inside {
        /// The folder for the copy.
        to: PathBuf,
        /// What is copied.
        kept: PathBuf,
    },
    /// What is to be copied is in the folder for the copy.
    #[error("the folder {} contains {}, which belongs to the service", to.display(), kept.display())]
    Around {
        /// The folder for the copy.
        to: PathBuf,
        /// What is copied.
        kept: PathBuf,
    },
    /// The folder for the copy holds something else than an earlier backup.
    #[error("{} is neither empty nor an earlier backup: it holds {found:?}", to.display())]
    Occupied {
        /// The folder for the copy.
        to: PathBuf,
        /// A file or folder in it.
        found: String,
    },
    /// A row names a blob that is not there.
    #[error("the blob {0} is missing from the store")]
    Missing(String),
    /// Uploads became ray sets faster than they were copied.
    #[error("uploads became ray sets during each attempt to copy them")]
    Outrun,
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
    Storage(#[from] crate::storage::error::Error),
}
