//! SQL statements, their values, and the rows they answer.

use crate::storage::error::Error;
use sqlx::Row as _;
use sqlx::any::{AnyArguments, AnyRow};
use sqlx::query::Query;
use sqlx::{Any, AssertSqlSafe};
use std::borrow::Cow;
use std::time::Duration;

/// The words of SQL in which the engines differ.
pub struct Dialect {
    /// `{now}`: the database's clock, epoch ms. One clock for all nodes, so leases need no synchronised machines.
    pub now: &'static str,
    /// `{skip_locked}`: of the rows found, lock those that no other transaction has. Empty where there is one writer.
    pub skip_locked: &'static str,
    /// `{for_share}`: the row that was found cannot be deleted before this transaction ends. Empty where there is one writer.
    pub for_share: &'static str,
    /// `{texts of $1 texts}`: the texts in the JSON list `$1`, as rows: a statement's text is fixed, its number of values is not. What
    /// stands before the list, and behind it.
    pub texts: (&'static str, &'static str),
    /// Statements for every new connection.
    pub connection: &'static str,
    /// How a transaction that will write begins.
    pub begin: &'static str,
    /// Whether a connection may be gone when it is next asked for, and is to be tried before.
    pub can_drop: bool,
    /// Longest wait for a connection; while the database is away, how long a request takes to say so.
    pub acquire: Duration,
}

/// A value for a `$n`.
#[derive(Clone, Debug)]
pub enum Value {
    /// TEXT or its absence.
    Text(Option<String>),
    /// BIGINT.
    Number(i64),
    /// A BIGINT that is absent.
    NoNumber,
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
impl From<Option<i64>> for Value {
    fn from(number: Option<i64>) -> Value {
        number.map_or(Value::NoNumber, Value::Number)
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

/// A time as rows have it, ms; one without end leaves room to be added to now.
pub fn ms(time: Duration) -> i64 {
    i64::try_from(time.as_millis()).unwrap_or(i64::MAX).min(i64::MAX / 2)
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

    /// The statement in the words of one engine.
    pub fn query(self, dialect: &Dialect) -> Query<'static, Any, AnyArguments> {
        let words = [
            ("{now}", dialect.now),
            ("{skip_locked}", dialect.skip_locked),
            ("{for_share}", dialect.for_share),
            ("{texts of ", dialect.texts.0),
            (" texts}", dialect.texts.1),
        ];
        let say = |text: Cow<'static, str>, (word, said): (&str, &str)| match text.contains(word) {
            true => Cow::Owned(text.replace(word, said)),
            false => text,
        };
        let text = words.into_iter().fold(Cow::Borrowed(self.text), say);
        // Safe: made of literals only; every value is bound.
        let query = sqlx::query(AssertSqlSafe(text));
        // An absent text is bound as a TEXT that is NULL, never as a NULL of no type: PostgreSQL could not tell what it is.
        self.values.into_iter().fold(query, |query, value| match value {
            Value::Text(text) => query.bind(text),
            Value::Number(number) => query.bind(number),
            Value::NoNumber => query.bind(None::<i64>),
            Value::Real(real) => query.bind(real),
        })
    }
}

/// One row of an answer.
pub struct Row(pub AnyRow);

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
