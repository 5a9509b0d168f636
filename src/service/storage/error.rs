//! What can go wrong with a store, and why a database is not opened.

use std::io;
use std::path::PathBuf;

/// Why a database is not opened. Only the operator who starts the service sees this, never a client.
#[derive(Debug, thiserror::Error)]
pub enum Unusable {
    /// The file is not a SQLite database.
    #[error("{} is not a SQLite database", .0.display())]
    NotADatabase(PathBuf),
    /// The database has tables of another program only.
    #[error("{} is a database of another program", .0.display())]
    Foreign(PathBuf),
    /// The database does not exist, and its URL does not ask to create it.
    #[error("the database {} does not exist", .0.display())]
    Missing(PathBuf),
    /// A newer version of this program has changed its schema.
    #[error(
        "{database} was written by a newer version of lampwright: its schema has step {step}, this version ends at {known}"
    )]
    Newer {
        /// The database or file.
        database: String,
        /// A step that this version does not know.
        step: i64,
        /// The last one that it knows.
        known: i64,
    },
    /// The blobs in the object store are named by the rows of another one.
    #[error("the object store belongs to another database")]
    OtherBlobs,
    /// The file cannot be looked at or made.
    #[error("{}: {error}", path.display())]
    Disk {
        /// The database or file.
        path: PathBuf,
        /// The error of the system.
        error: io::Error,
    },
}

impl Unusable {
    /// Stable: scripts may depend on it.
    pub fn code(&self) -> &'static str {
        match self {
            Unusable::NotADatabase(_) => "storage.not_a_database",
            Unusable::Foreign(_) => "storage.foreign_database",
            Unusable::Missing(_) => "storage.no_database",
            Unusable::Newer { .. } => "storage.newer_database",
            Unusable::OtherBlobs => "storage.other_database",
            Unusable::Disk { .. } => "storage.database_file",
        }
    }

    /// What the operator can do about it.
    pub fn remedy(&self) -> &'static str {
        match self {
            Unusable::NotADatabase(_) => {
                "Name the service's data folder with --data, or move this file away; if it was the database, restore a backup."
            }
            Unusable::Foreign(_) => "Name another file with --database-url, or another folder with --data.",
            Unusable::Missing(_) => {
                "Name the right file with --database-url; with mode=rwc instead of mode=rw the service creates it."
            }
            Unusable::Newer { .. } => "Start the newer version, or restore a backup from before it was first started.",
            Unusable::OtherBlobs => {
                "Name the database that was used with this object store before, with --database-url or --data; or name an empty object store with --storage-url."
            }
            Unusable::Disk { .. } => "Check the permissions of the file and of the folders above it.",
        }
    }
}

/// Why the stores could not be used.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The database did not answer, or not as it should.
    #[error("the database failed: {0}")]
    Records(Box<dyn std::error::Error + Send + Sync>),
    /// The object store did not answer, or not as it should.
    #[error("the object store failed: {0}")]
    Blobs(Box<dyn std::error::Error + Send + Sync>),
    /// No room for more.
    #[error("the storage is full")]
    Full,
    /// The object store does not have a blob that a row names: its key.
    #[error("the blob {0} is missing from the object store")]
    MissingBlob(String),
    /// A blob has fewer bytes than its row says.
    #[error("the blob {blob} has {found} bytes; its row says {expected}")]
    DamagedBlob {
        /// Its key.
        blob: String,
        /// Its length in the store, bytes.
        found: u64,
        /// Its length in its row, bytes.
        expected: u64,
    },
    /// An internal error, as a row that this version cannot read or a statement that is not valid: another attempt would fail the
    /// same way.
    #[error("an internal error of the service: {0}")]
    Fault(Box<dyn std::error::Error + Send + Sync>),
    /// A database that is not opened.
    #[error(transparent)]
    Unusable(#[from] Unusable),
    /// An engine this build does not have, and what to write instead.
    #[error("{0} is not supported by this build")]
    Unsupported(String, &'static str),
}

impl Error {
    /// A fault of ours, in these words or for this reason.
    pub fn fault(why: impl Into<Box<dyn std::error::Error + Send + Sync>>) -> Error {
        Error::Fault(why.into())
    }
}
