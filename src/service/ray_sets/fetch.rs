//! Fetches a ray file from a URL, or from a bucket that the operator has named. From its first byte on it is an upload like any
//! other.

use super::Taken;
use super::announcement::Announcement;
use super::intake::Intake;
use super::pace::TooSlow;
use crate::outbound::{Download, Outbound};
use crate::storage::blobs::Blobs;
use crate::{outbound, ray_sets, storage};
use bytes::Bytes;
use futures::stream::BoxStream;
use futures::{Stream, StreamExt, stream};
use tokio_util::sync::CancellationToken;

/// Why a download was stopped: its client closed the connection.
const GONE: &str = "the client went away";

/// Why a file is not fetched.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// Fetching from URLs is disabled.
    #[error("this service does not fetch files from URLs")]
    Off,
    /// The object is not in a bucket that the operator allows.
    #[error("{0} is not in a bucket that this service may read")]
    Bucket(String),
    /// The bucket does not have the object.
    #[error("there is no object {0}")]
    Missing(String),
    /// The server answered with this status instead of a file.
    #[error("the server answered with status {0}")]
    Status(u16),
    /// The download was interrupted.
    #[error("{0}")]
    Broken(String),
    /// The download was too slow.
    #[error("{0}")]
    Slow(TooSlow),
    /// The request was not sent, or got no answer.
    #[error(transparent)]
    Outbound(#[from] outbound::Error),
    /// The downloaded file was refused.
    #[error(transparent)]
    Upload(ray_sets::Error),
    /// The database or the object store did not answer.
    #[error(transparent)]
    Storage(#[from] storage::Error),
}

impl From<ray_sets::Error> for Error {
    fn from(error: ray_sets::Error) -> Error {
        match error {
            ray_sets::Error::Truncated(found) | ray_sets::Error::Broken(found) => Error::Broken(found),
            ray_sets::Error::Slow(slow) => Error::Slow(slow),
            ray_sets::Error::Storage(error) => Error::Storage(error),
            other => Error::Upload(other),
        }
    }
}

/// A bucket, or a folder of one, that may be read.
#[derive(Clone)]
struct Bucket {
    /// `s3://bucket/prefix/`: what the addresses in it begin with.
    begin: String,
    blobs: Blobs,
}

/// Fetches files. Cheap to clone.
#[derive(Clone)]
pub struct Ingest {
    outbound: Option<Outbound>,
    buckets: Vec<Bucket>,
}

/// A file that is being downloaded.
pub struct Coming {
    /// Its length, bytes, where known.
    pub byte_count: Option<u64>,
    body: BoxStream<'static, Result<Bytes, String>>,
}

impl Ingest {
    /// Fetches by `outbound`, if at all, and from `buckets`: `s3://bucket/prefix`, with the credentials of the usual `AWS_*`
    /// variables.
    ///
    /// # Errors
    /// A bucket that cannot be had as it is written.
    pub fn new(outbound: Option<Outbound>, buckets: &[String]) -> Result<Ingest, storage::Error> {
        let open = |url: &String| {
            let blobs = Blobs::open(url)?;
            Ok(Bucket { begin: format!("{}/", url.trim_end_matches('/')), blobs })
        };
        Ok(Ingest { outbound, buckets: buckets.iter().map(open).collect::<Result<_, storage::Error>>()? })
    }

    /// The file at `url`, whose bytes are still to come.
    ///
    /// # Errors
    /// [`Error`]; none of [`Error::Upload`].
    pub async fn open(&self, url: &str) -> Result<Coming, Error> {
        if url.starts_with("s3://") {
            return self.object(url).await;
        }
        let outbound = self.outbound.as_ref().ok_or(Error::Off)?;
        match outbound.get(url).await? {
            Download { status: 200, byte_count, body } => Ok(Coming { byte_count, body }),
            Download { status, .. } => Err(Error::Status(status)),
        }
    }

    async fn object(&self, url: &str) -> Result<Coming, Error> {
        let found = self.buckets.iter().find_map(|bucket| Some((bucket, url.strip_prefix(&bucket.begin)?)));
        let (bucket, key) = found.ok_or_else(|| Error::Bucket(url.to_owned()))?;
        let object = bucket.blobs.whole(key).await?.ok_or_else(|| Error::Missing(url.to_owned()))?;
        let body = object.1.map(|piece| piece.map_err(|error| broke_off(&error))).boxed();
        Ok(Coming { byte_count: Some(object.0), body })
    }
}

impl Coming {
    /// Takes the file in for `tenant`, as long as its client waits; `heard` is called with the length of every piece.
    ///
    /// # Errors
    /// [`Error`]; nothing is left behind, as [`Intake::take`] says.
    pub async fn take(
        self,
        intake: &Intake,
        tenant: &str,
        announcement: Announcement,
        heard: impl Fn(u64) + Send + 'static,
    ) -> Result<Taken, Error> {
        let gone = announcement.gone.clone();
        let announcement = Announcement { byte_count: self.byte_count, ..announcement };
        if self.byte_count.is_some_and(|bytes| bytes > intake.max_bytes) {
            return Err(ray_sets::Error::TooLarge(intake.max_bytes).into());
        }
        let body =
            until(self.body, gone).inspect(move |piece| heard(piece.as_ref().map_or(0, |piece| piece.len() as u64)));
        Ok(intake.take(tenant, announcement, body).await?)
    }
}

/// What a client sees when a bucket stops in the middle of an object; how the bucket is reached concerns the operator only.
fn broke_off(error: &storage::Error) -> String {
    tracing::warn!(%error, "the transfer of an object from a bucket was interrupted");
    "the bucket sent only a part of the object".to_owned()
}

/// `body` until `gone`, which is no end of it.
fn until(
    body: BoxStream<'static, Result<Bytes, String>>,
    gone: CancellationToken,
) -> impl Stream<Item = Result<Bytes, String>> {
    stream::unfold((body, gone), async |(mut body, gone)| {
        let piece = tokio::select! {
            biased;
            () = gone.cancelled() => Some(Err(GONE.to_owned())),
            piece = body.next() => piece,
        };
        Some((piece?, (body, gone)))
    })
}
