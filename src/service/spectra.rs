//! Rows of spectra.

use crate::accounts::quota::{Exceeded, Quota};
use crate::ray_sets::rows::Deletion;
use crate::storage::error::Error;
use crate::storage::records::Records;
use crate::storage::records::statement::{Row, sql};
use serde::de::DeserializeOwned;

/// A spectrum file as it was read.
#[derive(Clone, Debug)]
pub struct Spectrum {
    /// UUIDv7.
    pub id: String,
    /// What the user calls it.
    pub name: String,
    /// SHA-256 of the file, lower-case hex.
    pub sha256: String,
    /// What the file is, in words.
    pub format: String,
    /// Points of the table.
    pub point_count: u64,
    /// First and last wavelength, nm.
    pub range_nm: (f64, f64),
    /// Luminous efficacy of its radiation, lm/W.
    pub lm_per_w: f64,
    /// The table: `(nm, value)`, JSON.
    pub nm_value: String,
    /// What was repaired or odd, JSON.
    pub notices: String,
    /// When it was read, epoch ms.
    pub created_ms: i64,
}

impl Spectrum {
    /// The points of the table, `(nm, value)`.
    ///
    /// # Errors
    /// A row that holds something else.
    pub fn points(&self) -> Result<Vec<(f64, f64)>, Error> {
        serde_json::from_str(&self.nm_value).map_err(Error::fault)
    }

    /// What was repaired or odd, as its reader has it.
    ///
    /// # Errors
    /// A row that holds something else.
    pub fn noticed<T: DeserializeOwned>(&self) -> Result<T, Error> {
        serde_json::from_str(&self.notices).map_err(Error::fault)
    }
}

fn spectrum(row: &Row, nm_value: String) -> Result<Spectrum, Error> {
    Ok(Spectrum {
        id: row.text("id")?,
        name: row.text("name")?,
        sha256: row.text("sha256")?,
        format: row.text("format")?,
        point_count: row.count("point_count")?,
        range_nm: (row.real("from_nm")?, row.real("to_nm")?),
        lm_per_w: row.real("lm_per_w")?,
        nm_value,
        notices: row.text("notices")?,
        created_ms: row.number("created_ms")?,
    })
}

/// Makes a spectrum known. Answers it with its time.
///
/// # Errors
/// The database did not answer. Within: the tenant has no room for it.
pub async fn insert(
    records: &Records,
    tenant: &str,
    quota: Quota,
    new: Spectrum,
) -> Result<Result<Spectrum, Exceeded>, Error> {
    let mut transaction = records.begin().await?;
    let insert = "INSERT INTO spectra (id, name, sha256, format, point_count, from_nm, to_nm, lm_per_w, nm_value, notices, \
                  tenant, created_ms) VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11, {now}) RETURNING created_ms";
    let insert = sql(insert).bind(new.id.as_str()).bind(new.name.as_str()).bind(new.sha256.as_str());
    let insert = insert.bind(new.format.as_str()).bind(new.point_count.cast_signed()).bind(new.range_nm.0);
    let insert = insert.bind(new.range_nm.1).bind(new.lm_per_w).bind(new.nm_value.as_str());
    let rows = transaction.read(insert.bind(new.notices.as_str()).bind(tenant)).await?;
    if let Err(exceeded) = quota.check_bytes(&mut transaction, tenant).await? {
        transaction.rollback().await?;
        return Ok(Err(exceeded));
    }
    transaction.commit().await?;
    let created_ms = rows.first().map_or(Ok(0), |row| row.number("created_ms"))?;
    Ok(Ok(Spectrum { created_ms, ..new }))
}

/// The spectrum `id` of `tenant`, if there is one.
///
/// # Errors
/// The database did not answer.
pub async fn get(records: &Records, tenant: &str, id: &str) -> Result<Option<Spectrum>, Error> {
    let select = sql("SELECT * FROM spectra WHERE tenant = $1 AND id = $2");
    let row = records.read_one(select.bind(tenant).bind(id)).await?;
    row.as_ref().map(|row| spectrum(row, row.text("nm_value")?)).transpose()
}

/// At most `limit` spectra of `tenant`, older than the one called `before`, newest first, without their tables.
///
/// # Errors
/// The database did not answer.
pub async fn list(records: &Records, tenant: &str, before: Option<&str>, limit: i64) -> Result<Vec<Spectrum>, Error> {
    let select = "SELECT id, name, sha256, format, point_count, from_nm, to_nm, lm_per_w, notices, created_ms \
                  FROM spectra WHERE tenant = $1 AND ($2 IS NULL OR id < $2) ORDER BY id DESC LIMIT $3";
    let rows = records.read(sql(select).bind(tenant).bind(before).bind(limit)).await?;
    rows.iter().map(|row| spectrum(row, String::new())).collect()
}

/// Deletes a spectrum of `tenant` that no unfinished job needs.
///
/// # Errors
/// The database did not answer.
pub async fn delete(records: &Records, tenant: &str, id: &str) -> Result<Deletion, Error> {
    let mut transaction = records.begin().await?;
    // As with ray sets: waits for whoever is queuing a job for it, and makes those that come later wait.
    let wait = sql("UPDATE spectra SET name = name WHERE tenant = $1 AND id = $2");
    transaction.write(wait.bind(tenant).bind(id)).await?;
    let delete = "DELETE FROM spectra WHERE tenant = $1 AND id = $2 AND NOT EXISTS (SELECT 1 FROM job_inputs \
                  JOIN jobs ON jobs.id = job_inputs.job_id \
                  WHERE job_inputs.spectrum_id = $2 AND jobs.state IN ('queued', 'running'))";
    let deleted = transaction.write(sql(delete).bind(tenant).bind(id)).await?;
    transaction.commit().await?;
    if deleted > 0 {
        return Ok(Deletion::Deleted(Vec::new()));
    }
    Ok(if get(records, tenant, id).await?.is_some() { Deletion::Needed } else { Deletion::Missing })
}
