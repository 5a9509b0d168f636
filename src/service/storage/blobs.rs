//! The object store: the only file that names it. Blobs are written once and never changed; a key says whose they are:
//! `ray-sets/<ray set>/<part>` and `artifacts/<job>/<fence>/<name>`.

use super::Error;
use bytes::Bytes;
use futures::stream::BoxStream;
use futures::{StreamExt, TryStreamExt};
use object_store::local::LocalFileSystem;
use object_store::path::Path;
use object_store::{GetOptions, GetRange, ObjectStore, ObjectStoreExt};
use std::ops::Range;
use std::sync::Arc;

/// The store. Cheap to clone.
#[derive(Clone)]
pub struct Blobs(Arc<dyn ObjectStore>);

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
        Ok(Blobs(Arc::new(store)))
    }

    /// Writes a blob, durably.
    ///
    /// # Errors
    /// [`Error::Full`]; the store did not answer.
    pub async fn put(&self, key: &str, bytes: Bytes) -> Result<(), Error> {
        self.0.put(&Path::from(key), bytes.into()).await?;
        Ok(())
    }

    /// Bytes `range` of a blob.
    ///
    /// # Errors
    /// The store did not answer, or has no such blob or range.
    pub async fn read(&self, key: &str, range: Range<u64>) -> Result<Bytes, Error> {
        Ok(self.0.get_range(&Path::from(key), range).await?)
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
        Ok(self.0.get_opts(&Path::from(key), options).await?.into_stream().map_err(Error::from).boxed())
    }

    /// Deletes a blob; one that is gone already is no error.
    ///
    /// # Errors
    /// The store did not answer.
    pub async fn delete(&self, key: &str) -> Result<(), Error> {
        match self.0.delete(&Path::from(key)).await {
            Err(object_store::Error::NotFound { .. }) => Ok(()),
            other => Ok(other?),
        }
    }

    /// Every key that starts with the folder `prefix`.
    ///
    /// # Errors
    /// The store did not answer.
    pub async fn list(&self, prefix: &str) -> Result<Vec<String>, Error> {
        let metas = self.0.list(Some(&Path::from(prefix)));
        Ok(metas.map_ok(|meta| meta.location.to_string()).try_collect().await?)
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

impl From<object_store::Error> for Error {
    fn from(error: object_store::Error) -> Error {
        let mut cause: Option<&(dyn std::error::Error + 'static)> = Some(&error);
        while let Some(inner) = cause {
            if inner.downcast_ref::<std::io::Error>().is_some_and(|io| io.kind() == std::io::ErrorKind::StorageFull) {
                return Error::Full;
            }
            cause = inner.source();
        }
        Error::Blobs(Box::new(error))
    }
}
