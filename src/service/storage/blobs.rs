//! The object store: the only file that names it. Blobs are written once and never changed; a key says whose they are:
//! `ray-sets/<ray set>/<part>` and `artifacts/<job>/<fence>/<name>`.

use super::error::Error;
use super::private;
use crate::tls;
use bytes::Bytes;
use futures::stream::BoxStream;
use futures::{StreamExt, TryStreamExt};
use object_store::aws::{AmazonS3Builder, AmazonS3ConfigKey};
use object_store::local::LocalFileSystem;
use object_store::path::Path;
use object_store::prefix::PrefixStore;
use object_store::{BackoffConfig, ClientConfigKey, GetOptions, GetRange, ObjectStore, ObjectStoreExt, RetryConfig};
use std::ffi::OsString;
use std::io;
use std::net::IpAddr;
use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, SystemTime};
use tokio::task::spawn_blocking;
use tokio::time::timeout;

/// How long S3 is asked again for one request. A worker's own retries begin after it, and a client hears of it.
const S3_PATIENCE: Duration = Duration::from_secs(15);
/// Longest time for one request, the transfer of a part over a slow line included.
const S3_TIMEOUT: &str = "120 seconds";

/// How long it may take to see why a blob could not be read.
const LOOK: Duration = Duration::from_secs(3);

/// The object store. Cheap to clone.
#[derive(Clone)]
pub struct Blobs {
    store: Arc<dyn ObjectStore>,
    /// Where the local store keeps its files.
    folder: Option<PathBuf>,
}

/// A blob as the store lists it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Listed {
    /// Key of the blob.
    pub key: String,
    /// How long ago it was written, by the clocks of the store and of this machine.
    pub age: Duration,
}

impl Blobs {
    /// Opens the store at `url`: `file:<folder>` or `s3://<bucket>/<prefix>`. Region, endpoint and credentials of S3 are
    /// those of the usual `AWS_*` variables.
    ///
    /// # Errors
    /// A kind of store we do not have; a folder that cannot be made; a bucket that cannot be had as it is written.
    pub fn open(url: &str) -> Result<Blobs, Error> {
        if let Some(folder) = url.strip_prefix("file:") {
            return Blobs::open_folder(folder.into());
        }
        match url.strip_prefix("s3://") {
            Some(place) => Blobs::open_bucket(place),
            None => {
                let known = "Write file:FOLDER or s3://BUCKET/PREFIX, in STORAGE_URL or with --storage-url.";
                let kind = url.split(':').next().unwrap_or_default();
                Err(Error::Unsupported(format!("the object store {kind:?}"), known))
            }
        }
    }

    fn open_folder(folder: PathBuf) -> Result<Blobs, Error> {
        private::make_folder(&folder).map_err(|error| Error::Blobs(Box::new(error)))?;
        // A row that names a blob must not outlive it in a power cut: off by default in this library.
        let store = LocalFileSystem::new_with_prefix(&folder)?.with_fsync(true).with_automatic_cleanup(true);
        Ok(Blobs { store: Arc::new(store), folder: Some(folder) })
    }

    fn open_bucket(place: &str) -> Result<Blobs, Error> {
        tls::install();
        let (bucket, prefix) = place.split_once('/').unwrap_or((place, ""));
        let builder = told_by(std::env::vars_os()).with_bucket_name(bucket);
        // Without TLS only on this machine, where nobody listens in; AWS_ALLOW_HTTP says otherwise.
        let endpoint = builder.get_config_value(&AmazonS3ConfigKey::Endpoint);
        let builder = match endpoint.is_some_and(|endpoint| is_loopback(&endpoint)) {
            true => builder.with_allow_http(true),
            false => builder,
        };
        let builder = builder.with_config(AmazonS3ConfigKey::Client(ClientConfigKey::Timeout), S3_TIMEOUT);
        let backoff = BackoffConfig { max_backoff: Duration::from_secs(3), ..BackoffConfig::default() };
        let retry = RetryConfig { backoff, max_retries: 10, retry_timeout: S3_PATIENCE };
        let store = builder.with_retry(retry).build()?;
        let store: Arc<dyn ObjectStore> = match prefix.trim_matches('/') {
            "" => Arc::new(store),
            prefix => Arc::new(PrefixStore::new(store, prefix)),
        };
        Ok(Blobs { store, folder: None })
    }

    /// Writes a blob, durably.
    ///
    /// # Errors
    /// [`Error::Full`]; the store did not answer.
    pub async fn put(&self, key: &str, bytes: Bytes) -> Result<(), Error> {
        self.store.put(&Path::from(key), bytes.into()).await?;
        if let Some(folder) = self.folder.clone() {
            let file = folder.join(key);
            // The store knows no modes. A disk without any is no reason to lose what was written: the start has told of it.
            let _ = spawn_blocking(move || private::close_written(&folder, &file)).await;
        }
        Ok(())
    }

    /// Where a blob is a file of this machine; `None` for a remote store.
    pub fn local_file(&self, key: &str) -> Option<PathBuf> {
        self.folder.as_ref().map(|folder| folder.join(key))
    }

    /// Number of bytes of a blob to request at once: a request to S3 costs as much time as a megabyte, one to a disk little.
    pub fn block_bytes(&self) -> u64 {
        if self.folder.is_some() { 256 << 10 } else { 1 << 20 }
    }

    /// Bytes `range` of a blob.
    ///
    /// # Errors
    /// [`Error::MissingBlob`], [`Error::DamagedBlob`]; the store did not answer.
    pub async fn read(&self, key: &str, range: Range<u64>) -> Result<Bytes, Error> {
        let expected = range.end;
        match self.store.get_range(&Path::from(key), range.clone()).await {
            Ok(bytes) if bytes.len() as u64 == range.end - range.start => Ok(bytes),
            Ok(_) => Err(self.why(key, expected, None).await),
            Err(error) => Err(self.why(key, expected, Some(error)).await),
        }
    }

    /// Whether a local store holds nothing at all, as where its disk is not mounted.
    fn is_away(&self) -> bool {
        let holds_nothing = |folder: &PathBuf| std::fs::read_dir(folder).map_or(true, |mut all| all.next().is_none());
        self.folder.as_ref().is_some_and(holds_nothing)
    }

    /// Why the bytes up to `expected` of a blob could not be had: what the blob lacks, or else what the store said.
    async fn why(&self, key: &str, expected: u64, said: Option<object_store::Error>) -> Error {
        let path = Path::from(key);
        // A store that does not answer has said so for long enough.
        match (timeout(LOOK, self.store.head(&path)).await, said) {
            (Ok(Err(object_store::Error::NotFound { .. })), _) if self.is_away() => {
                Error::Blobs("the folder of the object store is empty; is its disk mounted?".into())
            }
            (Ok(Err(object_store::Error::NotFound { .. })), _) => Error::MissingBlob(key.to_owned()),
            (Ok(Ok(found)), _) if found.size < expected => {
                Error::DamagedBlob { blob: key.to_owned(), found: found.size, expected }
            }
            (_, Some(said)) => said.into(),
            (_, None) => Error::Blobs("the object store returned fewer bytes than were requested".into()),
        }
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
        let expected = range.end;
        let options = GetOptions { range: Some(GetRange::Bounded(range.clone())), ..GetOptions::default() };
        match self.store.get_opts(&Path::from(key), options).await {
            Ok(found) if found.range == range => Ok(found.into_stream().map_err(Error::from).boxed()),
            Ok(_) => Err(self.why(key, expected, None).await),
            Err(error) => Err(self.why(key, expected, Some(error)).await),
        }
    }

    /// A whole object that another program has written: its length and a stream of its bytes; `None` if there is none.
    ///
    /// # Errors
    /// The store did not answer.
    pub async fn whole(&self, key: &str) -> Result<Option<(u64, BoxStream<'static, Result<Bytes, Error>>)>, Error> {
        // As it is written: another's keys are not made of our words.
        let Ok(path) = Path::parse(key) else { return Ok(None) };
        match self.store.get(&path).await {
            Ok(object) => Ok(Some((object.meta.size, object.into_stream().map_err(Error::from).boxed()))),
            Err(object_store::Error::NotFound { .. }) => Ok(None),
            Err(error) => Err(error.into()),
        }
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

    /// What lies beside `folders` at the top of the store: names, as far as the store can tell them.
    ///
    /// # Errors
    /// The store did not answer, or holds a name that is no key.
    pub async fn beside(&self, folders: &[&str]) -> Result<Vec<String>, Error> {
        let top = self.store.list_with_delimiter(None).await?;
        let objects = top.objects.into_iter().map(|object| object.location);
        let names = top.common_prefixes.into_iter().chain(objects).map(|path| path.to_string());
        Ok(names.filter(|name| !folders.contains(&name.as_str())).collect())
    }

    /// Every key that starts with the folder `prefix`.
    ///
    /// # Errors
    /// The store did not answer.
    pub async fn list(&self, prefix: &str) -> Result<Vec<Listed>, Error> {
        let now = SystemTime::now();
        let metas = self.store.list(Some(&Path::from(prefix)));
        let listed = metas.map_ok(|meta| Listed {
            key: meta.location.to_string(),
            age: now.duration_since(meta.last_modified.into()).unwrap_or_default(),
        });
        Ok(listed.try_collect().await?)
    }

    /// Deletes the unfinished files of the local store, which a killed process left behind: `<key>#<number>`, which it does not
    /// list. Deletes only files older than `age` (0 only while no process writes) and only keys that `is_ours` accepts. Returns
    /// their names.
    ///
    /// # Errors
    /// The folder cannot be walked.
    pub async fn delete_unfinished(&self, age: Duration, is_ours: fn(&str) -> bool) -> Result<Vec<String>, Error> {
        let Some(folder) = self.folder.clone() else { return Ok(Vec::new()) };
        let deleted = spawn_blocking(move || {
            let mut deleted = Vec::new();
            delete_unfinished_in(&folder, "", age, is_ours, &mut deleted).map(|()| deleted)
        });
        deleted.await.map_err(|error| Error::Blobs(Box::new(error)))?.map_err(|error| Error::Blobs(Box::new(error)))
    }

    /// Deletes every blob in the folder `prefix`.
    ///
    /// # Errors
    /// The store did not answer.
    pub async fn delete_all(&self, prefix: &str) -> Result<(), Error> {
        for blob in self.list(prefix).await? {
            self.delete(&blob.key).await?;
        }
        Ok(())
    }

    /// Deletes every blob in these folders.
    ///
    /// # Errors
    /// The store did not answer.
    pub async fn delete_folders(&self, folders: &[String]) -> Result<(), Error> {
        for folder in folders {
            self.delete_all(folder).await?;
        }
        Ok(())
    }
}

/// True for `http://` to this very machine.
fn is_loopback(endpoint: &str) -> bool {
    let Some(authority) = endpoint.strip_prefix("http://").and_then(|rest| rest.split('/').next()) else {
        return false;
    };
    let host = match authority.strip_prefix('[') {
        Some(rest) => rest.split(']').next().unwrap_or_default(),
        None => authority.split(':').next().unwrap_or_default(),
    };
    host == "localhost" || host.parse::<IpAddr>().is_ok_and(|ip| ip.is_loopback())
}

/// `place` is the folder's own key, with a `/` behind it unless it is the top.
fn delete_unfinished_in(
    folder: &std::path::Path,
    place: &str,
    age: Duration,
    is_ours: fn(&str) -> bool,
    deleted: &mut Vec<String>,
) -> io::Result<()> {
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        // A name that is no text is not ours.
        let Ok(name) = entry.file_name().into_string() else { continue };
        let key = format!("{place}{name}");
        if entry.file_type()?.is_dir() {
            delete_unfinished_in(&entry.path(), &format!("{key}/"), age, is_ours, deleted)?;
        } else if is_unfinished(&key, is_ours) && entry.metadata()?.modified()?.elapsed().unwrap_or_default() >= age {
            std::fs::remove_file(entry.path())?;
            deleted.push(key);
        }
    }
    Ok(())
}

/// Whether the local store gives this name to a key of ours while it writes it.
fn is_unfinished(name: &str, is_ours: fn(&str) -> bool) -> bool {
    let is_number = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    name.rsplit_once('#').is_some_and(|(key, number)| is_number(number) && is_ours(key))
}

impl From<object_store::Error> for Error {
    fn from(error: object_store::Error) -> Error {
        use io::ErrorKind::{FileTooLarge, QuotaExceeded, StorageFull};
        let mut cause: Option<&(dyn std::error::Error + 'static)> = Some(&error);
        while let Some(inner) = cause {
            let kind = inner.downcast_ref::<io::Error>().map(io::Error::kind);
            if matches!(kind, Some(StorageFull | QuotaExceeded | FileTooLarge)) {
                return Error::Full;
            }
            cause = inner.source();
        }
        Error::Blobs(Box::new(error))
    }
}

/// What the variables `AWS_..` say of a bucket: `AmazonS3Builder::from_env`, but for those that are empty, which say nothing.
fn told_by(variables: impl Iterator<Item = (OsString, OsString)>) -> AmazonS3Builder {
    let texts = variables.filter_map(|(name, value)| Some((name.into_string().ok()?, value.into_string().ok()?)));
    let ours = texts.filter(|(name, value)| name.starts_with("AWS_") && !value.is_empty());
    let known =
        ours.filter_map(|(name, value)| Some((name.to_ascii_lowercase().parse::<AmazonS3ConfigKey>().ok()?, value)));
    known.fold(AmazonS3Builder::new(), |builder, (key, value)| builder.with_config(key, value))
}

#[cfg(test)]
mod tests {
    use super::{is_loopback, told_by};
    use object_store::aws::AmazonS3ConfigKey;

    #[test]
    fn only_this_machine_is_asked_without_tls() {
        for here in ["http://127.0.0.1:9000", "http://[::1]:9000/x", "http://localhost", "http://127.9.9.9/"] {
            assert!(is_loopback(here), "{here}");
        }
        for away in ["http://10.0.0.1:9000", "http://localhost.example.org", "http://127.0.0.1.nip.io", "https://x", ""]
        {
            assert!(!is_loopback(away), "{away}");
        }
    }

    #[test]
    fn an_empty_variable_says_nothing_of_a_bucket() {
        let variables = [("AWS_REGION", "eu-1"), ("AWS_ENDPOINT_URL", ""), ("AWS_QUX", "x"), ("REGION", "no")];
        let builder = told_by(variables.into_iter().map(|(name, value)| (name.into(), value.into())));
        assert_eq!(builder.get_config_value(&AmazonS3ConfigKey::Region).as_deref(), Some("eu-1"));
        assert_eq!(builder.get_config_value(&AmazonS3ConfigKey::Endpoint), None);
    }
}
