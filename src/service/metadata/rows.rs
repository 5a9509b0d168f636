//! Rows that ray sets and jobs are found by: one for each key and value of a client's metadata. The rows go with their owner.

use super::Metadata;
use crate::storage::error::Error;
use crate::storage::records::Transaction;
use crate::storage::records::statement::{Statement, sql};

/// Adds the rows of a ray set of `tenant`.
///
/// # Errors
/// The database did not answer.
pub async fn of_ray_set(
    transaction: &mut Transaction,
    tenant: &str,
    id: &str,
    metadata: &Metadata,
) -> Result<(), Error> {
    const INSERT: &str = "INSERT INTO ray_set_metadata (tenant, pair, ray_set_id) VALUES ($1, $2, $3)";
    insert(transaction, INSERT, tenant, id, metadata).await
}

/// Adds the rows of a job of `tenant`.
///
/// # Errors
/// The database did not answer.
pub async fn of_job(transaction: &mut Transaction, tenant: &str, id: &str, metadata: &Metadata) -> Result<(), Error> {
    const INSERT: &str = "INSERT INTO job_metadata (tenant, pair, job_id) VALUES ($1, $2, $3)";
    insert(transaction, INSERT, tenant, id, metadata).await
}

async fn insert(
    transaction: &mut Transaction,
    text: &'static str,
    tenant: &str,
    id: &str,
    metadata: &Metadata,
) -> Result<(), Error> {
    for pair in metadata.pairs() {
        transaction.write(sql(text).bind(tenant).bind(pair).bind(id)).await?;
    }
    Ok(())
}

/// Metadata as a column has it.
///
/// # Errors
/// Never in practice: texts can be written.
pub fn written(metadata: &Metadata) -> Result<String, Error> {
    metadata.json().map_err(Error::fault)
}

/// Metadata from a column.
///
/// # Errors
/// A row that holds something else.
pub fn read(text: &str) -> Result<Metadata, Error> {
    serde_json::from_str(text).map_err(Error::fault)
}

/// The two values by which a statement finds what has all these keys and values: the pairs as a JSON list, and their number.
///
/// # Errors
/// Never in practice: texts can be written.
pub fn bind_wanted(statement: Statement, wanted: &Metadata) -> Result<Statement, Error> {
    let pairs: Vec<String> = wanted.pairs().collect();
    let list = serde_json::to_string(&pairs).map_err(Error::fault)?;
    Ok(statement.bind(list).bind(pairs.len() as i64))
}
