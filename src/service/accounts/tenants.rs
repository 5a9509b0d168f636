//! Tenants and their own quotas. Every key belongs to a tenant; a tenant has a row only where a quota is not the default.

use crate::storage::error::Error;
use crate::storage::records::statement::{Row, sql};
use crate::storage::records::{Records, Transaction};

/// Longest name.
const MAX_CHARS: usize = 64;

/// What a tenant has that differs from the service's defaults.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Tenant {
    /// Its name.
    pub id: String,
    /// Most bytes kept.
    pub stored_bytes: Option<u64>,
    /// Most jobs waiting.
    pub queued_jobs: Option<u64>,
    /// Most jobs computed at once.
    pub running_jobs: Option<u64>,
}

/// Whether a tenant can be called so: 1 to 64 of a-z, 0-9 and `-`.
pub fn is_name(name: &str) -> bool {
    let allowed = |byte: u8| matches!(byte, b'a'..=b'z' | b'0'..=b'9' | b'-');
    (1..=MAX_CHARS).contains(&name.len()) && name.bytes().all(allowed)
}

/// Every tenant that has a row, a key, a ray set or a job, by name.
///
/// # Errors
/// The database did not answer.
pub async fn list(records: &Records) -> Result<Vec<Tenant>, Error> {
    let select = "SELECT known.id AS id, tenants.stored_bytes, tenants.queued_jobs, tenants.running_jobs FROM \
                  (SELECT id FROM tenants UNION SELECT tenant FROM api_keys \
                   UNION SELECT tenant FROM ray_sets UNION SELECT tenant FROM spectra UNION SELECT tenant FROM jobs) known \
                  LEFT JOIN tenants ON tenants.id = known.id ORDER BY known.id";
    records.read(sql(select)).await?.iter().map(tenant).collect()
}

/// Sets all that differs; what is `None` is the service's default again.
///
/// # Errors
/// The database did not answer.
pub async fn set(records: &Records, tenant: &Tenant) -> Result<(), Error> {
    // -1 stands for NULL: it is no quota.
    let number = |limit: Option<u64>| limit.map_or(-1, |limit| i64::try_from(limit).unwrap_or(i64::MAX));
    let set = "INSERT INTO tenants (id, stored_bytes, queued_jobs, running_jobs) \
               VALUES ($1, NULLIF($2, -1), NULLIF($3, -1), NULLIF($4, -1)) \
               ON CONFLICT (id) DO UPDATE SET stored_bytes = excluded.stored_bytes, \
               queued_jobs = excluded.queued_jobs, running_jobs = excluded.running_jobs";
    let set = sql(set).bind(tenant.id.as_str()).bind(number(tenant.stored_bytes));
    records.write(set.bind(number(tenant.queued_jobs)).bind(number(tenant.running_jobs))).await?;
    Ok(())
}

/// The row of the tenant `id`, which no other transaction changes until this one ends.
///
/// # Errors
/// The database did not answer.
pub async fn hold(transaction: &mut Transaction, id: &str) -> Result<Tenant, Error> {
    // Changes nothing and locks the row, which is made if need be.
    let hold = sql("INSERT INTO tenants (id) VALUES ($1) ON CONFLICT (id) DO UPDATE SET id = excluded.id \
                    RETURNING id, stored_bytes, queued_jobs, running_jobs");
    let rows = transaction.read(hold.bind(id)).await?;
    Ok(rows.first().map(tenant).transpose()?.unwrap_or_else(|| nothing(id)))
}

/// What differs for `id`.
///
/// # Errors
/// The database did not answer.
pub async fn get(records: &Records, id: &str) -> Result<Tenant, Error> {
    let row = records.read_one(sql("SELECT * FROM tenants WHERE id = $1").bind(id)).await?;
    Ok(row.as_ref().map(tenant).transpose()?.unwrap_or_else(|| nothing(id)))
}

fn nothing(id: &str) -> Tenant {
    Tenant { id: id.to_owned(), ..Tenant::default() }
}

fn tenant(row: &Row) -> Result<Tenant, Error> {
    let limit = |column: &str| Ok::<_, Error>(row.optional_number(column)?.map(|limit| limit.max(0).unsigned_abs()));
    Ok(Tenant {
        id: row.text("id")?,
        stored_bytes: limit("stored_bytes")?,
        queued_jobs: limit("queued_jobs")?,
        running_jobs: limit("running_jobs")?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_plain() {
        for right in ["a", "lab-7", &"x".repeat(64)] {
            assert!(is_name(right), "{right}");
        }
        for wrong in ["", "Lab", "a b", "a/b", "é", "a\n", &"x".repeat(65)] {
            assert!(!is_name(wrong), "{wrong:?}");
        }
    }
}
