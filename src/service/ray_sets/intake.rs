//! What taking in a ray file needs.

use super::buffers::Buffers;
use super::extent::Digests;
use super::inspecting::Places;
use super::pace::Slowest;
use crate::accounts::quota::Quota;
use crate::metrics::Metrics;
use crate::storage::Storage;
use crate::storage::space::Space;
use pipeline::Limits;

/// Takes files in. Cheap to clone.
#[derive(Clone)]
pub struct Intake {
    /// Where they go.
    pub storage: Storage,
    /// Largest file, bytes.
    pub max_bytes: u64,
    /// The slowest sender that is waited for.
    pub slowest: Slowest,
    /// What a tenant may keep that has no quota of its own.
    pub quota: Quota,
    /// Room on local disks.
    pub space: Space,
    /// What a ray file may ask of this machine.
    pub limits: Limits,
    /// Where parts are filled.
    pub buffers: Buffers,
    /// Threads for their digests.
    pub digests: Digests,
    /// Places for files that are read to their end.
    pub inspections: Places,
    /// Counts those files.
    pub metrics: Metrics,
}
