//! The database: the only folder that names sqlx. Callers write one SQL text for both engines: `$1` for values, and the words
//! of [`Dialect`] in braces where the engines differ. What else to know of PostgreSQL: `SUM` of a BIGINT is no BIGINT (cast
//! it), and a type that is not TEXT, BIGINT, DOUBLE PRECISION or BYTEA cannot be read.

/// Connections on loan, and transactions on them.
mod connection;
/// SQL statements, their values, and the rows they answer.
pub mod statement;

pub use connection::Transaction;
use statement::{Dialect, Row, Statement, sql};

use super::error::{Error, Unusable};
use super::{database_file, database_url};
use sqlx::any::AnyPoolOptions;
use sqlx::error::ErrorKind;
use sqlx::migrate::{MigrateError, Migration, MigrationType, Migrator};
use sqlx::{AnyConnection, AnyPool, Connection, Executor, SqlSafeStr};
use std::io;
use std::time::Duration;

/// The schema, step by step: number, what it brought, its text. By hand, for `sqlx::migrate!` compiles all of sqlx a second time.
const MIGRATIONS: [(i64, &str, &str); 14] = [
    (1, "first", include_str!("../migrations/0001_first.sql")),
    (2, "packed", include_str!("../migrations/0002_packed.sql")),
    (3, "channels", include_str!("../migrations/0003_channels.sql")),
    (4, "inspection", include_str!("../migrations/0004_inspection.sql")),
    (5, "access", include_str!("../migrations/0005_access.sql")),
    (7, "declared", include_str!("../migrations/0007_declared.sql")),
    (8, "uploads", include_str!("../migrations/0008_uploads.sql")),
    (9, "lines", include_str!("../migrations/0009_lines.sql")),
    (10, "push", include_str!("../migrations/0010_push.sql")),
    (11, "concatenation", include_str!("../migrations/0011_concatenation.sql")),
    (12, "metadata", include_str!("../migrations/0012_metadata.sql")),
    (13, "probe", include_str!("../migrations/0013_probe.sql")),
    (14, "owner", include_str!("../migrations/0014_owner.sql")),
    (15, "evaluations", include_str!("../migrations/0015_evaluations.sql")),
];

/// The dialect of SQLite. Its PRAGMAs are set per connection, because they do not belong to the file.
static SQLITE: Dialect = Dialect {
    now: "CAST(unixepoch('subsec') * 1000 AS BIGINT)",
    skip_locked: "",
    for_share: "",
    texts: ("SELECT value FROM json_each(", ")"),
    connection: "PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL; PRAGMA foreign_keys = ON; \
                 PRAGMA busy_timeout = 10000;",
    // Waits for the write lock of another process at the beginning; a transaction that reads first would fail instead of waiting.
    begin: "BEGIN IMMEDIATE",
    can_drop: false,
    acquire: Duration::from_secs(30),
};

/// A process that is stopped within a transaction must not hold its rows for ever: the server ends its session.
static POSTGRES: Dialect = Dialect {
    now: "CAST(EXTRACT(EPOCH FROM statement_timestamp()) * 1000 AS BIGINT)",
    skip_locked: "FOR UPDATE SKIP LOCKED",
    for_share: "FOR SHARE",
    texts: ("SELECT json_array_elements_text(CAST(", " AS JSON))"),
    connection: "SET statement_timeout = '30s'; SET idle_in_transaction_session_timeout = '10s';",
    begin: "BEGIN",
    can_drop: true,
    acquire: Duration::from_secs(5),
};

/// What the address of a database can be.
const KNOWN: &str = "Write sqlite:FILE or postgres://USER:PASSWORD@HOST/NAME, in DATABASE_URL or with --database-url.";

/// Connections that read a SQLite file, next to the one that writes.
const SQLITE_READERS: u32 = 4;
/// Connections of one process to PostgreSQL, which has 100 by default for all of them.
const POSTGRES_CONNECTIONS: u32 = 12;
/// Idle time after which the connection to PostgreSQL that only [`Records::prove`] uses is closed.
const WITNESS_IDLE: Duration = Duration::from_mins(2);
/// How long a starting process waits for PostgreSQL to start too, and for another's migration to end.
const POSTGRES_START: Duration = Duration::from_secs(60);

/// The database. Cheap to clone. SQLite has one writer; giving it one connection to write with queues writers in order
/// instead of letting them fail with SQLITE_BUSY. PostgreSQL needs no such rule: there, both pools are one.
#[derive(Clone)]
pub struct Records {
    dialect: &'static Dialect,
    writer: AnyPool,
    readers: AnyPool,
    /// Connections that never write, for [`Records::prove`].
    witness: AnyPool,
}

impl Records {
    /// Opens the database at `url`, `sqlite:<file>` or `postgres:<where>`, and brings its schema up to date; of several that
    /// do so at once, one does it and the others wait.
    ///
    /// # Errors
    /// [`Error::Unusable`]; an engine we do not have; a database that does not answer.
    pub async fn open(url: &str) -> Result<Records, Error> {
        sqlx::any::install_default_drivers();
        match url.split(':').next().unwrap_or_default() {
            "sqlite" => {
                database_file::prepare(url)?;
                examine(url).await?;
                let writer = pool(&SQLITE, 1).connect(url).await?;
                migrate(&writer, url).await?;
                let readers = pool(&SQLITE, SQLITE_READERS).connect(url).await?;
                Ok(Records { dialect: &SQLITE, writer, witness: readers.clone(), readers })
            }
            "postgres" | "postgresql" => {
                // A connection without a time limit: the lock of a migration may be long another's.
                let migrator = AnyPoolOptions::new().max_connections(1).acquire_timeout(POSTGRES_START);
                let migrator = migrator.connect(url).await?;
                migrate(&migrator, url).await?;
                migrator.close().await;
                let pool = pool(&POSTGRES, POSTGRES_CONNECTIONS).connect(url).await?;
                let witness = self::pool(&POSTGRES, 1).idle_timeout(WITNESS_IDLE).connect_lazy(url)?;
                Ok(Records { dialect: &POSTGRES, writer: pool.clone(), readers: pool, witness })
            }
            other => Err(Error::Unsupported(format!("the database {other:?}"), KNOWN)),
        }
    }

    /// The rows that a SELECT finds.
    ///
    /// # Errors
    /// The database did not answer.
    pub async fn read(&self, statement: Statement) -> Result<Vec<Row>, Error> {
        connection::read(&self.readers, self.dialect, statement).await
    }

    /// The one row that a SELECT finds, if any.
    ///
    /// # Errors
    /// The database did not answer.
    pub async fn read_one(&self, statement: Statement) -> Result<Option<Row>, Error> {
        connection::read_one(&self.readers, self.dialect, statement).await
    }

    /// Changes rows in a transaction of its own, and returns their number.
    ///
    /// # Errors
    /// The database did not answer.
    pub async fn write(&self, statement: Statement) -> Result<u64, Error> {
        connection::write(&self.writer, self.dialect, statement).await
    }

    /// Checks that written rows are visible to others: increments a counter in a row, and reads it through a connection that never
    /// writes.
    ///
    /// # Errors
    /// The database did not answer, or what was written is not there for others.
    pub async fn prove(&self) -> Result<(), Error> {
        let mut transaction = self.begin().await?;
        let count = "INSERT INTO probe (id, number) VALUES (1, 1) \
                     ON CONFLICT (id) DO UPDATE SET number = probe.number + 1 RETURNING number";
        let written = transaction.read(sql(count)).await?.first().map_or(Ok(0), |row| row.number("number"))?;
        transaction.commit().await?;
        let read = sql("SELECT number FROM probe WHERE id = 1");
        let read = connection::read_one(&self.witness, self.dialect, read).await?;
        // Another process may have counted on meanwhile.
        match read.map_or(Ok(0), |row| row.number("number"))? >= written.max(1) {
            true => Ok(()),
            false => Err(Error::Records("rows that were written are not visible to other connections".into())),
        }
    }

    /// Begins a transaction; if it is dropped without [`Transaction::commit`], nothing is changed. Its first statement should
    /// write.
    ///
    /// # Errors
    /// The database did not answer.
    pub async fn begin(&self) -> Result<Transaction, Error> {
        Transaction::begin(&self.writer, self.dialect).await
    }

    /// Ends every connection, and with them the write-ahead log.
    pub async fn close(&self) {
        self.witness.close().await;
        self.readers.close().await;
        self.writer.close().await;
    }
}

/// A pool whose connections run the set-up statements of their dialect. A connection that the database dropped is replaced when it
/// is next asked for.
fn pool(dialect: &'static Dialect, connections: u32) -> AnyPoolOptions {
    let options = AnyPoolOptions::new().max_connections(connections).acquire_timeout(dialect.acquire);
    // SQLite never drops a connection, so they stay open: its -shm file exists then, and works on a full disk too.
    let options = if dialect.can_drop { options } else { options.idle_timeout(None).max_lifetime(None) };
    options.test_before_acquire(dialect.can_drop).after_connect(move |connection, _| {
        Box::pin(async move { connection.execute(dialect.connection).await.map(|_| ()) })
    })
}

/// Opens a file once, outside of the pool, which would try a file that is no database again until its time is over. A database of
/// another program is not touched.
async fn examine(url: &str) -> Result<(), Error> {
    let Some(file) = database_url::path(url) else { return Ok(()) };
    let tables =
        "SELECT COUNT(*) AS found, COUNT(CASE WHEN name = '_sqlx_migrations' THEN 1 END) AS ours FROM sqlite_master";
    let looked = async {
        let mut connection = AnyConnection::connect(url).await?;
        let row = connection.fetch_one(tables).await.map(Row);
        connection.close().await?;
        row
    };
    let code = |error: &sqlx::Error| error.as_database_error().and_then(|error| Some(error.code()?.into_owned()));
    match looked.await {
        Ok(row) if row.number("found")? > 0 && row.number("ours")? == 0 => Err(Unusable::Foreign(file).into()),
        Ok(_) => Ok(()),
        Err(error) => Err(match code(&error).as_deref() {
            // SQLITE_CORRUPT and SQLITE_NOTADB.
            Some("11" | "26") => Unusable::NotADatabase(file).into(),
            // SQLITE_CANTOPEN, which says no more; SQLITE_READONLY_DIRECTORY.
            Some("14" | "1544") => Unusable::Disk { path: file, error: io::ErrorKind::PermissionDenied.into() }.into(),
            _ => error.into(),
        }),
    }
}

async fn migrate(pool: &AnyPool, url: &str) -> Result<(), Error> {
    let step = |(number, name, text): (i64, &'static str, &'static str)| {
        Migration::new(number, name.into(), MigrationType::Simple, text.into_sql_str(), false)
    };
    let all = Migrator::with_migrations(MIGRATIONS.map(step).into());
    let known = MIGRATIONS.last().map_or(0, |(number, _, _)| *number);
    all.run(pool).await.map_err(|error| match error {
        MigrateError::VersionMissing(step) if step > known => {
            // The address of a server holds a password.
            let file = database_url::path(url).map(|file| file.display().to_string());
            Unusable::Newer { database: file.unwrap_or_else(|| "the database".to_owned()), step, known }.into()
        }
        other => Error::Records(Box::new(other)),
    })
}

/// Codes of a lack of room: `SQLITE_FULL`, `SQLITE_IOERR_SHMSIZE` (the file beside the database could not grow), and PostgreSQL's
/// `disk_full`.
const FULL: [&str; 3] = ["13", "4874", "53100"];

impl From<sqlx::Error> for Error {
    fn from(error: sqlx::Error) -> Error {
        let code = error.as_database_error().and_then(|error| error.code());
        if code.is_some_and(|code| FULL.contains(&&*code)) {
            return Error::Full;
        }
        use sqlx::Error as Sql;
        let is_ours = match &error {
            Sql::ColumnDecode { .. } | Sql::ColumnIndexOutOfBounds { .. } | Sql::ColumnNotFound(_) => true,
            Sql::Decode(_) | Sql::Encode(_) | Sql::InvalidArgument(_) | Sql::TypeNotFound { .. } => true,
            // A rule of the schema was broken.
            Sql::Database(error) => !matches!(error.kind(), ErrorKind::Other),
            _ => false,
        };
        if is_ours { Error::fault(error) } else { Error::Records(Box::new(error)) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn every_step_of_the_schema_is_listed() {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/storage/migrations");
        let mut files: Vec<(String, String)> = fs::read_dir(folder)
            .unwrap()
            .map(|entry| entry.unwrap())
            .map(|entry| (entry.file_name().into_string().unwrap(), fs::read_to_string(entry.path()).unwrap()))
            .collect();
        files.sort();
        assert_eq!(files, MIGRATIONS.map(|(number, name, text)| (format!("{number:04}_{name}.sql"), text.to_owned())));
    }
}
