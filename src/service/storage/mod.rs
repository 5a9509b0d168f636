//! What outlives the process: rows and blobs, each engine behind one file.

/// The database.
pub mod records;
/// One statement for everybody who asks at the same time.
pub mod together;
/// The object store.
pub mod blobs;
/// A ray set's parts as one file.
pub mod parts;
/// Rows of ray sets.
pub mod ray_sets;
/// Rows of uploads that can be resumed.
pub mod uploads;
/// How those end.
pub mod endings;
/// Rows of what was found in their rays.
pub mod inspections;
/// Room on local disks.
pub mod space;
/// Blobs that no row names.
pub mod garbage;
/// Rows of spectra.
pub mod spectra;

use blobs::Blobs;
use bytes::Bytes;
use records::{Records, sql};
use uuid::Uuid;

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
    #[error("the object store is full")]
    Full,
    /// An engine this build does not have.
    #[error("{0} is not supported by this build")]
    Unsupported(String),
}

/// Rows and blobs. Cheap to clone.
#[derive(Clone)]
pub struct Storage {
    /// The database.
    pub records: Records,
    /// The object store.
    pub blobs: Blobs,
}

/// A new sortable identifier.
pub fn new_id() -> String {
    Uuid::now_v7().to_string()
}

/// The folder of a ray set's blobs.
pub fn ray_set_folder(id: &str) -> String {
    format!("ray-sets/{id}")
}

/// The folder of a job's blobs; those of one attempt are in a folder named for its fence.
pub fn job_folder(id: &str) -> String {
    format!("artifacts/{id}")
}

impl Storage {
    /// Opens both stores.
    ///
    /// # Errors
    /// [`Error`]: one of them cannot be opened.
    pub async fn open(database_url: &str, storage_url: &str) -> Result<Storage, Error> {
        Ok(Storage { records: Records::open(database_url).await?, blobs: Blobs::open(storage_url)? })
    }

    /// Proves that rows can be read and blobs written.
    ///
    /// # Errors
    /// [`Error`]: they cannot.
    pub async fn check(&self) -> Result<(), Error> {
        self.records.read(sql("SELECT 1 AS one")).await?;
        let probe = format!("probes/{}", new_id());
        self.blobs.put(&probe, Bytes::from_static(b"ready")).await?;
        self.blobs.delete(&probe).await
    }
}
