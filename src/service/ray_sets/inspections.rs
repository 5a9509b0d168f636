//! Rows of inspections and their drawings.

use crate::storage::error::Error;
use crate::storage::records::statement::sql;
use crate::storage::records::{Records, Transaction};

/// What was found in the rays of a ray set.
#[derive(Clone, Debug, Default)]
pub struct Inspection {
    /// The pipeline's inspection, as JSON.
    pub json: String,
    /// Drawings of it.
    pub drawings: Vec<Drawing>,
}

/// A drawing.
#[derive(Clone, Debug)]
pub struct Drawing {
    /// "origins.svg", "far-field.svg".
    pub name: String,
    /// SHA-256 of its bytes, lower-case hex.
    pub sha256: String,
    /// Its bytes.
    pub svg: String,
}

/// Adds the inspection of a ray set to the transaction that makes the ray set known.
///
/// # Errors
/// The database did not answer.
pub async fn insert(transaction: &mut Transaction, ray_set_id: &str, new: &Inspection) -> Result<(), Error> {
    let insert = sql("INSERT INTO inspections (ray_set_id, inspection) VALUES ($1, $2)");
    transaction.write(insert.bind(ray_set_id).bind(new.json.as_str())).await?;
    for drawing in &new.drawings {
        let insert = sql("INSERT INTO drawings (ray_set_id, name, sha256, svg) VALUES ($1, $2, $3, $4)");
        let insert = insert.bind(ray_set_id).bind(drawing.name.as_str());
        transaction.write(insert.bind(drawing.sha256.as_str()).bind(drawing.svg.as_str())).await?;
    }
    Ok(())
}

/// The inspection of a ray set, as JSON; `None` for one taken in before there were inspections.
///
/// # Errors
/// The database did not answer.
pub async fn get(records: &Records, ray_set_id: &str) -> Result<Option<String>, Error> {
    let select = sql("SELECT inspection FROM inspections WHERE ray_set_id = $1").bind(ray_set_id);
    records.read_one(select).await?.map(|row| row.text("inspection")).transpose()
}

/// The drawing `name` of a ray set, if there is one.
///
/// # Errors
/// The database did not answer.
pub async fn drawing(records: &Records, ray_set_id: &str, name: &str) -> Result<Option<Drawing>, Error> {
    let select = sql("SELECT name, sha256, svg FROM drawings WHERE ray_set_id = $1 AND name = $2");
    let row = records.read_one(select.bind(ray_set_id).bind(name)).await?;
    let drawing =
        row.map(|row| Ok(Drawing { name: row.text("name")?, sha256: row.text("sha256")?, svg: row.text("svg")? }));
    drawing.transpose()
}
