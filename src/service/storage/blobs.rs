//! The object store: the only file that names it. Blobs are written once and never changed; a key says whose they are:
//! `ray-sets/<ray set>/<part>` and `artifacts/<job>/<fence>/<name>`.

use super::Error;
use bytes::Bytes;
use futures::stream::BoxStream;
use futures::{StreamExt, TryStreamExt};
use object_store::local::LocalFileSystem;
use object_store::path::Path;
use object_store::{GetOptions, GetRange, ObjectStore, ObjectStoreExt};
use std::io;
use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;
use tokio::task::spawn_blocking;

/// The store. Cheap to clone.
#[derive(Clone)]
pub struct Blobs {
    store: Arc<dyn ObjectStore>,
    /// Where the local store keeps its files.
    folder: PathBuf,
}

impl Blobs {
    /// Opens the store at `url`: `file:<folder>`.
    ///
    /// # Errors
    /// A kind of store we do not have; a folder that cannot be made.
    pub fn open(url: &str) -> Result<Blobs, Error> {
        let Some(folder) = url.strip_prefix("file:") else {
            return Err(Error::Unsupported(format!("store {}", url.split(':').next().unwrap_or_default())));
        };
        std::fs::create_dir_all(folder).map_err(|error| Error::Blobs(Box::new(error)))?;
        // A row that names a blob must not outlive it in a power cut: off by default in this library.
        let store = LocalFileSystem::new_with_prefix(folder)?.with_fsync(true).with_automatic_cleanup(true);
        Ok(Blobs { store: Arc::new(store), folder: folder.into() })
    }

    /// Writes a blob, durably.
    ///
    /// # Errors
    /// [`Error::Full`]; the store did not answer.
    pub async fn put(&self, key: &str, bytes: Bytes) -> Result<(), Error> {
        self.store.put(&Path::from(key), bytes.into()).await?;
        Ok(())
    }

    /// Bytes `range` of a blob.
    ///
    /// # Errors
    /// The store did not answer, or has no such blob or range.
    pub async fn read(&self, key: &str, range: Range<u64>) -> Result<Bytes, Error> {
        Ok(self.store.get_range(&Path::from(key), range).await?)
    }

    /// Bytes `range` of a blob, as they come.
    ///
    /// # Errors
    /// As [`Blobs::read`].
    pub async fn stream(
        &self,
        key: &str,
        range: Range<u64>,
    ) -> Result<BoxStream<'static, Result<Bytes, Error>>, Error> {
        // An empty range is an error to the store, and nothing to us.
        if range.is_empty() {
            return Ok(futures::stream::empty().boxed());
        }
        let options = GetOptions { range: Some(GetRange::Bounded(range)), ..GetOptions::default() };
        Ok(self.store.get_opts(&Path::from(key), options).await?.into_stream().map_err(Error::from).boxed())
    }

    /// Deletes a blob; one that is gone already is no error.
    ///
    /// # Errors
    /// The store did not answer.
    pub async fn delete(&self, key: &str) -> Result<(), Error> {
        match self.store.delete(&Path::from(key)).await {
            Err(object_store::Error::NotFound { .. }) => Ok(()),
            other => Ok(other?),
        }
    }

    /// Every key that starts with the folder `prefix`.
    ///
    /// # Errors
    /// The store did not answer.
    pub async fn list(&self, prefix: &str) -> Result<Vec<String>, Error> {
        let metas = self.store.list(Some(&Path::from(prefix)));
        Ok(metas.map_ok(|meta| meta.location.to_string()).try_collect().await?)
    }

    /// Deletes what the local store was writing when its process was killed: `<key>#<number>`, which it does not list. Only
    /// right while nobody writes. How many.
    ///
    /// # Errors
    /// The folder cannot be walked.
    pub async fn delete_unfinished(&self) -> Result<usize, Error> {
        let folder = self.folder.clone();
        let deleted = spawn_blocking(move || delete_unfinished_in(&folder)).await;
        deleted.map_err(|error| Error::Blobs(Box::new(error)))?.map_err(|error| Error::Blobs(Box::new(error)))
    }

    /// Deletes every blob in the folder `prefix`.
    ///
    /// # Errors
    /// The store did not answer.
    pub async fn delete_all(&self, prefix: &str) -> Result<(), Error> {
        for key in self.list(prefix).await? {
            self.delete(&key).await?;
        }
        Ok(())
    }
}

fn delete_unfinished_in(folder: &std::path::Path) -> io::Result<usize> {
    let mut deleted = 0;
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        if entry.file_type()?.is_dir() {
            deleted += delete_unfinished_in(&entry.path())?;
        } else if entry.file_name().to_string_lossy().contains('#') {
            std::fs::remove_file(entry.path())?;
            deleted += 1;
        }
    }
    Ok(deleted)
}

impl From<object_store::Error> for Error {
    fn from(error: object_store::Error) -> Error {
        let mut cause: Option<&(dyn std::error::Error + 'static)> = Some(&error);
        while let Some(inner) = cause {
            if inner.downcast_ref::<io::Error>().is_some_and(|error| error.kind() == io::ErrorKind::StorageFull) {
                return Error::Full;
            }
            cause = inner.source();
        }
        Error::Blobs(Box::new(error))
    }
}
