//! Quotas and usage of tenants. Usage is counted in the transaction that adds to it, while it locks the row of the tenant: two
//! simultaneous requests cannot both take the last place.

use super::tenants;
use crate::storage::error::Error;
use crate::storage::records::statement::{Row, sql};
use crate::storage::records::{Records, Transaction};

/// Limits for one tenant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Quota {
    /// Stored bytes of ray files, uploads, spectra and artifacts.
    pub stored_bytes: u64,
    /// Number of queued jobs.
    pub queued_jobs: u64,
    /// Number of jobs computed at the same time.
    pub running_jobs: u64,
}

impl Default for Quota {
    /// Bounded only by the disk and by the number of workers; ten thousand jobs may wait.
    fn default() -> Quota {
        let unbounded = i64::MAX.unsigned_abs();
        Quota { stored_bytes: unbounded, queued_jobs: 10_000, running_jobs: unbounded }
    }
}

/// Present usage of one tenant.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Usage {
    /// Stored bytes of ray files, uploads, spectra and artifacts.
    pub stored_bytes: u64,
    /// Number of queued jobs.
    pub queued_jobs: u64,
    /// Number of running jobs.
    pub running_jobs: u64,
}

/// The limit that a tenant has reached.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Exceeded {
    /// Its bytes.
    #[error("the tenant uses {used} of {limit} bytes")]
    StoredBytes {
        /// Bytes in use.
        used: u64,
        /// Limit, bytes.
        limit: u64,
    },
    /// Its waiting jobs.
    #[error("{limit} jobs of the tenant are queued")]
    QueuedJobs {
        /// Limit.
        limit: u64,
    },
}

/// The rest of the storage quota of a tenant.
#[derive(Clone, Copy, Debug)]
pub struct Room {
    used: u64,
    limit: u64,
}

impl Room {
    /// Checks whether the tenant may store `more` bytes.
    ///
    /// # Errors
    /// There is none.
    pub fn check(self, more: u64) -> Result<(), Exceeded> {
        let Room { used, limit } = self;
        match used.saturating_add(more) > limit {
            true => Err(Exceeded::StoredBytes { used, limit }),
            false => Ok(()),
        }
    }

    /// The room there is when `bytes` of what is kept will go.
    #[must_use]
    pub fn without(self, bytes: u64) -> Room {
        Room { used: self.used.saturating_sub(bytes), ..self }
    }
}

/// An upload that has not ended needs all that it has announced. A point of a spectrum is two numbers of about 16 characters.
const USAGE: &str = "SELECT \
    CAST(COALESCE((SELECT SUM(byte_count) FROM ray_sets WHERE tenant = $1), 0) AS BIGINT) AS ray_bytes, \
    CAST(COALESCE((SELECT SUM(point_count) * 32 FROM spectra WHERE tenant = $1), 0) AS BIGINT) AS spectrum_bytes, \
    CAST(COALESCE((SELECT SUM(artifacts.byte_count) FROM artifacts JOIN jobs ON jobs.id = artifacts.job_id \
                   WHERE jobs.tenant = $1), 0) AS BIGINT) AS artifact_bytes, \
    CAST(COALESCE((SELECT SUM(COALESCE(byte_count, offset_bytes)) FROM uploads \
                   WHERE tenant = $1 AND state IN ('receiving', 'finishing', 'complete')), 0) AS BIGINT) AS upload_bytes, \
    (SELECT COUNT(*) FROM jobs WHERE tenant = $1 AND state = 'queued') AS queued_jobs, \
    (SELECT COUNT(*) FROM jobs WHERE tenant = $1 AND state = 'running') AS running_jobs";

impl Quota {
    /// This, but for what differs for `tenant`.
    fn of(self, tenant: &tenants::Tenant) -> Quota {
        Quota {
            stored_bytes: tenant.stored_bytes.unwrap_or(self.stored_bytes),
            queued_jobs: tenant.queued_jobs.unwrap_or(self.queued_jobs),
            running_jobs: tenant.running_jobs.unwrap_or(self.running_jobs),
        }
    }

    /// The rest of the storage quota of `tenant`, to be checked before an upload.
    ///
    /// # Errors
    /// The database did not answer.
    pub async fn room(self, records: &Records, tenant: &str) -> Result<Room, Error> {
        let limit = self.of(&tenants::get(records, tenant).await?).stored_bytes;
        Ok(Room { used: usage(records, tenant).await?.stored_bytes, limit })
    }

    /// Whether `tenant` has room for what the transaction has just added to its bytes.
    ///
    /// # Errors
    /// The database did not answer. Within: it has not.
    pub async fn check_bytes(self, transaction: &mut Transaction, tenant: &str) -> Result<Result<(), Exceeded>, Error> {
        Ok(self.lock(transaction, tenant).await?.room().check(0))
    }

    /// The quota and usage of `tenant`, which no other transaction changes until this one ends. Must be its first statement.
    ///
    /// # Errors
    /// The database did not answer.
    pub async fn lock(self, transaction: &mut Transaction, tenant: &str) -> Result<LockedUsage, Error> {
        let quota = self.of(&tenants::hold(transaction, tenant).await?);
        let rows = transaction.read(sql(USAGE).bind(tenant)).await?;
        Ok(LockedUsage { quota, usage: rows.first().map(counted).transpose()?.unwrap_or_default() })
    }
}

/// Quota and usage of a tenant, which cannot change while the transaction holds the row of the tenant.
#[derive(Clone, Copy, Debug)]
pub struct LockedUsage {
    quota: Quota,
    usage: Usage,
}

impl LockedUsage {
    fn room(self) -> Room {
        Room { used: self.usage.stored_bytes, limit: self.quota.stored_bytes }
    }

    /// Whether the tenant may queue one more job than it has.
    ///
    /// # Errors
    /// It may not.
    pub fn check_job(self) -> Result<(), Exceeded> {
        if self.usage.queued_jobs >= self.quota.queued_jobs {
            return Err(Exceeded::QueuedJobs { limit: self.quota.queued_jobs });
        }
        // What it gives will need room: none left is told now, not after the computation.
        self.room().check(1)
    }
}

/// What `tenant` uses.
///
/// # Errors
/// The database did not answer.
pub async fn usage(records: &Records, tenant: &str) -> Result<Usage, Error> {
    let row = records.read_one(sql(USAGE).bind(tenant)).await?;
    Ok(row.as_ref().map(counted).transpose()?.unwrap_or_default())
}

fn counted(row: &Row) -> Result<Usage, Error> {
    Ok(Usage {
        stored_bytes: row.count("ray_bytes")?
            + row.count("upload_bytes")?
            + row.count("spectrum_bytes")?
            + row.count("artifact_bytes")?,
        queued_jobs: row.count("queued_jobs")?,
        running_jobs: row.count("running_jobs")?,
    })
}
