//! What outlives the process: rows and blobs, each engine behind one file.

/// What other users of the machine may not read.
pub mod private;
/// The file of a SQLite database.
pub mod database_file;
/// The database.
pub mod records;
/// One statement for everybody who asks at the same time.
pub mod together;
/// The object store.
pub mod blobs;
/// A ray set's parts as one file.
pub mod parts;
/// Rows that things are found by, by their clients' metadata.
pub mod metadata;
/// Rows of ray sets.
pub mod ray_sets;
/// Rows of uploads that can be resumed.
pub mod uploads;
/// How those end.
pub mod endings;
/// How several become one.
pub mod joining;
/// Rows of what was found in their rays.
pub mod inspections;
/// Room on local disks.
pub mod space;
/// Which database a store's blobs belong to.
pub mod owner;
/// Blobs that no row names.
pub mod garbage;
/// Rows of spectra.
pub mod spectra;

use blobs::Blobs;
use bytes::Bytes;
use records::Records;
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
    #[error("a store is full")]
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
    /// A row that this version cannot read, a statement that cannot be meant: another attempt would fail the same way.
    #[error("a fault of the service: {0}")]
    Fault(Box<dyn std::error::Error + Send + Sync>),
    /// A database that is not opened.
    #[error(transparent)]
    Unusable(#[from] database_file::Unusable),
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

/// The folders of the object store that the service writes to; whatever else is there is somebody else's.
pub const FOLDERS: [&str; 3] = ["ray-sets", "artifacts", "probes"];

/// Whether the service could have written a blob under this key: `ray-sets/<ray set>/<number>`, with `.<session>` behind it where
/// the upload can be resumed, `artifacts/<job>/<fence>/<number>` or `probes/<id>`. A new shape of keys is added here, or its garbage
/// is never collected.
pub fn is_key(key: &str) -> bool {
    let is_number = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    let is_id = |text: &str| Uuid::parse_str(text).is_ok_and(|id| id.to_string() == text);
    let is_part = |text: &str| match text.split_once('.') {
        Some((number, session)) => is_number(number) && is_id(session),
        None => is_number(text),
    };
    match *key.split('/').collect::<Vec<_>>() {
        ["ray-sets", id, part] => is_id(id) && is_part(part),
        ["artifacts", id, fence, number] => is_id(id) && is_number(fence) && is_number(number),
        ["probes", id] => is_id(id),
        _ => false,
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_keys_that_the_service_writes_are_its_own() {
        let (id, session) = (new_id(), new_id());
        for ours in [
            format!("{}/000000", ray_set_folder(&id)),
            format!("{}/1234567", ray_set_folder(&id)),
            format!("{}/000001.{session}", ray_set_folder(&id)),
            format!("{}/12/0003", job_folder(&id)),
            format!("probes/{id}"),
        ] {
            assert!(is_key(&ours), "{ours}");
        }
        let (upper, short) = (id.to_uppercase(), id.replace('-', ""));
        for strange in [
            String::new(),
            "ray-sets".into(),
            format!("ray-sets/{id}"),
            format!("ray-sets/{id}/"),
            format!("ray-sets/{id}/a"),
            format!("ray-sets/{id}/1.bak"),
            format!("ray-sets/{id}/-1"),
            format!("ray-sets/{id}/1/1"),
            format!("ray-sets/{upper}/1"),
            format!("ray-sets/{short}/1"),
            format!("ray-sets/{{{id}}}/1"),
            format!("backup/ray-sets/{id}/1"),
            format!("artifacts/{id}/1"),
            format!("artifacts/{id}/x/1"),
            format!("artifacts/{id}/1/1.{session}"),
            format!("probes/{id}/1"),
            format!("/probes/{id}"),
            "service.db".into(),
        ] {
            assert!(!is_key(&strange), "{strange}");
        }
    }
}
