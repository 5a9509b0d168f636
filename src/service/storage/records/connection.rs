//! Connections on loan from a pool, and transactions on them. One rule holds on both engines: a connection goes back to its pool
//! only after the last thing that it was asked was answered with success; otherwise it is closed, and the pool opens another when
//! it is next asked. A future that is dropped in the middle of a statement, a statement that fails and a COMMIT that fails all
//! leave a connection whose transaction may still be open, or may have been ended by the database (SQLite does so when a disk is
//! full). The next user of the connection would write into a transaction that is never committed.

use super::statement::{Dialect, Row, Statement};
use crate::storage::error::Error;
use sqlx::pool::PoolConnection;
use sqlx::{Any, AnyPool, Executor};

/// A connection on loan. Dropped without [`Loan::give_back`], it is closed.
struct Loan {
    connection: PoolConnection<Any>,
    /// Nothing is open on it, as far as the database has answered.
    is_idle: bool,
}

impl Loan {
    async fn from(pool: &AnyPool) -> Result<Loan, Error> {
        Ok(Loan { connection: pool.acquire().await?, is_idle: false })
    }

    fn give_back(mut self) {
        self.is_idle = true;
    }
}

impl Drop for Loan {
    fn drop(&mut self) {
        if !self.is_idle {
            tracing::debug!("a database connection is closed: its last statement failed or was abandoned");
            self.connection.close_on_drop();
        }
    }
}

/// The rows that one statement outside a transaction finds.
pub(super) async fn read(pool: &AnyPool, dialect: &Dialect, statement: Statement) -> Result<Vec<Row>, Error> {
    let mut loan = Loan::from(pool).await?;
    let rows = statement.query(dialect).fetch_all(&mut *loan.connection).await?;
    loan.give_back();
    Ok(rows.into_iter().map(Row).collect())
}

/// The first row that one statement outside a transaction finds.
pub(super) async fn read_one(pool: &AnyPool, dialect: &Dialect, statement: Statement) -> Result<Option<Row>, Error> {
    let mut loan = Loan::from(pool).await?;
    let row = statement.query(dialect).fetch_optional(&mut *loan.connection).await?;
    loan.give_back();
    Ok(row.map(Row))
}

/// How many rows one statement outside a transaction changes.
pub(super) async fn write(pool: &AnyPool, dialect: &Dialect, statement: Statement) -> Result<u64, Error> {
    let mut loan = Loan::from(pool).await?;
    let result = statement.query(dialect).execute(&mut *loan.connection).await?;
    loan.give_back();
    Ok(result.rows_affected())
}

/// Several statements, all or none. Dropped without [`Transaction::commit`] or [`Transaction::rollback`], it never was, and its
/// connection is closed.
pub struct Transaction {
    dialect: &'static Dialect,
    loan: Loan,
    /// Every statement so far was answered with success.
    is_sound: bool,
}

impl Transaction {
    /// Said as a statement, not by the library's own transactions: those count their depth, and count on after the database has
    /// ended one by itself.
    pub(super) async fn begin(pool: &AnyPool, dialect: &'static Dialect) -> Result<Transaction, Error> {
        let mut loan = Loan::from(pool).await?;
        loan.connection.execute(dialect.begin).await?;
        Ok(Transaction { dialect, loan, is_sound: true })
    }

    /// Changes rows; how many.
    ///
    /// # Errors
    /// The database did not answer: the transaction cannot be committed any more.
    pub async fn write(&mut self, statement: Statement) -> Result<u64, Error> {
        self.is_sound = false;
        let result = statement.query(self.dialect).execute(&mut *self.loan.connection).await?;
        self.is_sound = true;
        Ok(result.rows_affected())
    }

    /// The rows that a SELECT finds or a RETURNING gives.
    ///
    /// # Errors
    /// The database did not answer: the transaction cannot be committed any more.
    pub async fn read(&mut self, statement: Statement) -> Result<Vec<Row>, Error> {
        self.is_sound = false;
        let rows = statement.query(self.dialect).fetch_all(&mut *self.loan.connection).await?;
        self.is_sound = true;
        Ok(rows.into_iter().map(Row).collect())
    }

    /// Makes it so.
    ///
    /// # Errors
    /// A statement of it had failed: it is not so. The database did not answer: it may or may not be so.
    pub async fn commit(mut self) -> Result<(), Error> {
        // PostgreSQL answers the COMMIT of a failed transaction with success, and rolls it back.
        if !self.is_sound {
            return Err(Error::Records("a statement of this transaction failed, so it cannot be committed".into()));
        }
        self.loan.connection.execute("COMMIT").await?;
        self.loan.give_back();
        Ok(())
    }

    /// Undoes it, because what was found makes it needless or forbids it. Dropping it does the same and costs a connection.
    ///
    /// # Errors
    /// The database did not answer: it is undone all the same.
    pub async fn rollback(mut self) -> Result<(), Error> {
        self.loan.connection.execute("ROLLBACK").await?;
        self.loan.give_back();
        Ok(())
    }
}
