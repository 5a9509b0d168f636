//! What every handler of a request can use.

use crate::accounts::Authenticator;
use crate::forwarded::Prefix;
use crate::jobs::queue::Queue;
use crate::jobs::watcher::Watcher;
use crate::metrics::Metrics;
use crate::models::Models;
use crate::ray_sets::fetch::Ingest;
use crate::ray_sets::intake::Intake;
use crate::storage::Storage;
use crate::storage::space::Space;
use crate::uploads::Uploads;
use crate::webhooks::dispatcher::Dispatcher;
use std::ops::Deref;
use std::sync::Arc;
use tokio_util::sync::CancellationToken;
use utoipa::ToSchema;

/// What handlers work with. Cheap to clone: every request has several of these.
#[derive(Clone)]
pub struct Api(Arc<Services>);

impl Api {
    /// The face of these.
    pub fn new(services: Services) -> Api {
        Api(Arc::new(services))
    }
}

impl Deref for Api {
    type Target = Services;

    fn deref(&self) -> &Services {
        &self.0
    }
}

/// All that handlers work with.
pub struct Services {
    /// Rows and blobs.
    pub storage: Storage,
    /// Jobs.
    pub queue: Queue,
    /// Models in memory, and new rays of them.
    pub models: Models,
    /// Tells of jobs that change.
    pub watcher: Watcher,
    /// Tells others that jobs have ended.
    pub dispatcher: Dispatcher,
    /// Fetches ray files.
    pub ingest: Ingest,
    /// Takes ray files in.
    pub intake: Intake,
    /// Takes those in that can be resumed.
    pub uploads: Uploads,
    /// Knows the keys.
    pub authenticator: Authenticator,
    /// Web pages of these origins may use the service.
    pub origins: Arc<[String]>,
    /// The path of the service's public URL: links begin with it.
    pub prefix: Prefix,
    /// What is counted.
    pub metrics: Metrics,
    /// Room on local disks.
    pub space: Space,
    /// Whether the stores work.
    pub readiness: super::readiness::Readiness,
    /// The service is stopping: what would not end by itself ends when this is cancelled.
    pub draining: CancellationToken,
}

/// The bytes of a file; `Content-Type` names its format.
#[derive(ToSchema)]
#[schema(value_type = Value)]
pub struct AnyFile(#[expect(dead_code, reason = "a schema, never a value")] Vec<u8>);

/// The bytes of a file.
#[derive(ToSchema)]
#[schema(value_type = String, format = Binary)]
pub struct Binary(#[expect(dead_code, reason = "a schema, never a value")] Vec<u8>);
