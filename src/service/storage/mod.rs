//! What outlives the process: rows and blobs, each engine behind one file.

/// What other users of the machine may not read.
pub mod private;
/// The file of a SQLite database.
pub mod database_file;
/// The database.
pub mod records;
/// One statement for all reads at the same time.
pub mod together;
/// The object store.
pub mod blobs;
/// A ray set's parts as one file.
pub mod parts;
/// Room on local disks.
pub mod space;
/// The file behind a `sqlite:` URL.
pub mod database_url;
/// What can go wrong with a store, and why a database is not opened.
pub mod error;
/// Identifiers, and the keys of blobs in the object store.
pub mod keys;

use blobs::Blobs;
use bytes::Bytes;
pub use error::Error;
use keys::new_id;
use records::Records;

/// Rows and blobs. Cheap to clone.
#[derive(Clone)]
pub struct Storage {
    /// The database.
    pub records: Records,
    /// The object store.
    pub blobs: Blobs,
}

impl Storage {
    /// Opens both stores.
    ///
    /// # Errors
    /// [`Error`]: one of them cannot be opened.
    pub async fn open(database_url: &str, storage_url: &str) -> Result<Storage, Error> {
        Ok(Storage { records: Records::open(database_url).await?, blobs: Blobs::open(storage_url)? })
    }

    /// Proves that rows can be written and are then there for others, and that blobs can be written.
    ///
    /// # Errors
    /// [`Error`]: they cannot.
    pub async fn check(&self) -> Result<(), Error> {
        self.records.prove().await?;
        let probe = format!("probes/{}", new_id());
        self.blobs.put(&probe, Bytes::from_static(b"ready")).await?;
        self.blobs.delete(&probe).await
    }
}
