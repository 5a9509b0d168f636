//! The database: the only file that names sqlx. Callers write one SQL text for every engine, with `$1` for values and
//! `{now}` for the database's clock in epoch milliseconds; `{skip_locked}` is empty where one writer is the rule.

use super::Error;
use sqlx::any::{AnyArguments, AnyPoolOptions, AnyRow};
use sqlx::migrate::Migrator;
use sqlx::query::Query;
use sqlx::{Any, AnyPool, AssertSqlSafe, Executor, Row as _};
use std::borrow::Cow;

static MIGRATIONS: Migrator = sqlx::migrate!("src/service/storage/migrations");

/// SQLite's PRAGMAs belong to the connection, not to the file.
const SQLITE_CONNECTION: &str = "PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL; PRAGMA foreign_keys = ON; \
                                 PRAGMA busy_timeout = 10000;";
const SQLITE_NOW: &str = "CAST(unixepoch('subsec') * 1000 AS INTEGER)";
const READERS: u32 = 4;

/// A value for a `$n`.
#[derive(Clone, Debug)]
pub enum Value {
    /// TEXT or its absence.
    Text(Option<String>),
    /// BIGINT.
    Number(i64),
    /// DOUBLE PRECISION.
    Real(f64),
}

impl From<&str> for Value {
    fn from(text: &str) -> Value {
        Value::Text(Some(text.to_owned()))
    }
}
impl From<String> for Value {
    fn from(text: String) -> Value {
        Value::Text(Some(text))
    }
}
impl From<Option<&str>> for Value {
    fn from(text: Option<&str>) -> Value {
        Value::Text(text.map(str::to_owned))
    }
}
impl From<i64> for Value {
    fn from(number: i64) -> Value {
        Value::Number(number)
    }
}
impl From<f64> for Value {
    fn from(real: f64) -> Value {
        Value::Real(real)
    }
}

/// One statement and its values, in order.
#[derive(Clone, Debug)]
pub struct Statement {
    text: &'static str,
    values: Vec<Value>,
}

/// A statement without values yet.
pub fn sql(text: &'static str) -> Statement {
    Statement { text, values: Vec::new() }
}

impl Statement {
    /// The value of the next `$n`.
    #[must_use]
    pub fn bind(mut self, value: impl Into<Value>) -> Statement {
        self.values.push(value.into());
        self
    }

    fn query(self) -> Query<'static, Any, AnyArguments> {
        let text = match self.text.contains('{') {
            true => Cow::Owned(self.text.replace("{now}", SQLITE_NOW).replace("{skip_locked}", "")),
            false => Cow::Borrowed(self.text),
        };
        // Safe: made of literals only; every value is bound.
        let query = sqlx::query(AssertSqlSafe(text));
        self.values.into_iter().fold(query, |query, value| match value {
            Value::Text(text) => query.bind(text),
            Value::Number(number) => query.bind(number),
            Value::Real(real) => query.bind(real),
        })
    }
}

/// One row of an answer.
pub struct Row(AnyRow);

impl Row {
    /// A TEXT column.
    ///
    /// # Errors
    /// A column of another name or type.
    pub fn text(&self, column: &str) -> Result<String, Error> {
        Ok(self.0.try_get(column)?)
    }

    /// A TEXT column that may be NULL.
    ///
    /// # Errors
    /// As [`Row::text`].
    pub fn optional_text(&self, column: &str) -> Result<Option<String>, Error> {
        Ok(self.0.try_get(column)?)
    }

    /// A BIGINT column.
    ///
    /// # Errors
    /// As [`Row::text`].
    pub fn number(&self, column: &str) -> Result<i64, Error> {
        Ok(self.0.try_get(column)?)
    }

    /// A BIGINT column that may be NULL.
    ///
    /// # Errors
    /// As [`Row::text`].
    pub fn optional_number(&self, column: &str) -> Result<Option<i64>, Error> {
        Ok(self.0.try_get(column)?)
    }

    /// A BIGINT column that counts: never negative.
    ///
    /// # Errors
    /// As [`Row::text`].
    pub fn count(&self, column: &str) -> Result<u64, Error> {
        Ok(self.number(column)?.max(0).unsigned_abs())
    }

    /// A DOUBLE PRECISION column.
    ///
    /// # Errors
    /// As [`Row::text`].
    pub fn real(&self, column: &str) -> Result<f64, Error> {
        Ok(self.0.try_get(column)?)
    }
}

/// The database. Cheap to clone. SQLite has one writer; giving it one connection to write with queues writers in order
/// instead of letting them fail with SQLITE_BUSY.
#[derive(Clone)]
pub struct Records {
    writer: AnyPool,
    readers: AnyPool,
}

impl Records {
    /// Opens the database at `url` and brings its schema up to date.
    ///
    /// # Errors
    /// An engine we do not have; a database that does not answer or was made by a newer version.
    pub async fn open(url: &str) -> Result<Records, Error> {
        if !url.starts_with("sqlite:") {
            return Err(Error::Unsupported(format!("database {}", url.split(':').next().unwrap_or_default())));
        }
        sqlx::any::install_default_drivers();
        let pool = |connections: u32| {
            AnyPoolOptions::new().max_connections(connections).after_connect(|connection, _| {
                Box::pin(async move { connection.execute(SQLITE_CONNECTION).await.map(|_| ()) })
            })
        };
        let writer = pool(1).connect(url).await?;
        MIGRATIONS.run(&writer).await.map_err(|error| Error::Records(Box::new(error)))?;
        Ok(Records { writer, readers: pool(READERS).connect(url).await? })
    }

    /// The rows that a SELECT finds.
    ///
    /// # Errors
    /// The database did not answer.
    pub async fn read(&self, statement: Statement) -> Result<Vec<Row>, Error> {
        Ok(statement.query().fetch_all(&self.readers).await?.into_iter().map(Row).collect())
    }

    /// The one row that a SELECT finds, if any.
    ///
    /// # Errors
    /// The database did not answer.
    pub async fn read_one(&self, statement: Statement) -> Result<Option<Row>, Error> {
        Ok(statement.query().fetch_optional(&self.readers).await?.map(Row))
    }

    /// Changes rows, in a transaction of its own; how many.
    ///
    /// # Errors
    /// The database did not answer.
    pub async fn write(&self, statement: Statement) -> Result<u64, Error> {
        Ok(statement.query().execute(&self.writer).await?.rows_affected())
    }

    /// Begins a transaction; dropped without [`Transaction::commit`], it never was. Its first statement should write.
    ///
    /// # Errors
    /// The database did not answer.
    pub async fn begin(&self) -> Result<Transaction, Error> {
        Ok(Transaction(self.writer.begin().await?))
    }

    /// Ends every connection, and with them the write-ahead log.
    pub async fn close(&self) {
        self.readers.close().await;
        self.writer.close().await;
    }
}

/// Several statements, all or none.
pub struct Transaction(sqlx::Transaction<'static, Any>);

impl Transaction {
    /// Changes rows; how many.
    ///
    /// # Errors
    /// The database did not answer.
    pub async fn write(&mut self, statement: Statement) -> Result<u64, Error> {
        Ok(statement.query().execute(&mut *self.0).await?.rows_affected())
    }

    /// The rows that a SELECT finds or a RETURNING gives.
    ///
    /// # Errors
    /// The database did not answer.
    pub async fn read(&mut self, statement: Statement) -> Result<Vec<Row>, Error> {
        Ok(statement.query().fetch_all(&mut *self.0).await?.into_iter().map(Row).collect())
    }

    /// Makes it so.
    ///
    /// # Errors
    /// The database did not answer: it may or may not be so.
    pub async fn commit(self) -> Result<(), Error> {
        Ok(self.0.commit().await?)
    }
}

impl From<sqlx::Error> for Error {
    fn from(error: sqlx::Error) -> Error {
        Error::Records(Box::new(error))
    }
}
