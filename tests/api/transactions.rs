//! The rule of `storage/records/connection.rs`: a connection whose transaction ended otherwise than by its own COMMIT or ROLLBACK is
//! not used again.

use crate::connections::PATIENCE;
use service::storage::error::Error;
use service::storage::records::statement::{Statement, sql};
use service::storage::records::{Records, Transaction};
use std::time::{Duration, Instant};
use support::engines::are_shared;
use tempfile::TempDir;
use tokio::time::timeout;

/// Long before the end of [`SLOW`].
const SOON: Duration = Duration::from_millis(30);

/// Runs for seconds, on both engines.
const SLOW: &str = "WITH RECURSIVE count (n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM count WHERE n < 2000000) \
                    INSERT INTO probe SELECT 99, MAX(n) FROM count";
const WRONG: &str = "INSERT INTO nowhere VALUES (1)";
/// Breaks a promise that is checked at the COMMIT; on SQLite the transaction is still open after that fails.
const ORPHAN: &str = "INSERT INTO test_child VALUES (7)";

async fn open(folder: &TempDir) -> Records {
    let records = support::site::stores(folder.path()).await.records;
    for text in [
        "CREATE TABLE test_parent (id BIGINT PRIMARY KEY)",
        "CREATE TABLE test_child (id BIGINT REFERENCES test_parent (id) DEFERRABLE INITIALLY DEFERRED)",
    ] {
        records.write(sql(text)).await.unwrap();
    }
    records
}

fn kept(number: i64) -> Statement {
    sql("INSERT INTO test_parent VALUES ($1)").bind(number)
}

async fn is_kept(records: &Records, number: i64) -> bool {
    let select = sql("SELECT id FROM test_parent WHERE id = $1").bind(number);
    records.read_one(select).await.unwrap().is_some()
}

/// Which connection a transaction is on, where that can be told later: PostgreSQL numbers them. SQLite's only writer is marked with a
/// temporary table, which is that connection's own.
async fn mark(transaction: &mut Transaction) -> i64 {
    if are_shared() {
        let rows = transaction.read(sql("SELECT CAST(pg_backend_pid() AS BIGINT) AS pid")).await.unwrap();
        return rows[0].number("pid").unwrap();
    }
    transaction.write(sql("CREATE TEMPORARY TABLE test_mark (x BIGINT)")).await.unwrap();
    0
}

/// Whether the marked connection is still open.
async fn is_open(records: &Records, mark: i64) -> bool {
    if are_shared() {
        let select = sql("SELECT CAST(pid AS BIGINT) AS pid FROM pg_stat_activity WHERE pid = $1").bind(mark);
        return records.read_one(select).await.unwrap().is_some();
    }
    let mut transaction = records.begin().await.unwrap();
    let select = sql("SELECT name FROM temp.sqlite_master WHERE name = 'test_mark'");
    let found = transaction.read(select).await.unwrap();
    transaction.rollback().await.unwrap();
    !found.is_empty()
}

#[tokio::test(flavor = "multi_thread")]
async fn what_is_committed_or_rolled_back_keeps_its_connection() {
    let folder = tempfile::tempdir().unwrap();
    let records = open(&folder).await;
    let mut transaction = records.begin().await.unwrap();
    transaction.write(kept(1)).await.unwrap();
    let mark = mark(&mut transaction).await;
    transaction.commit().await.unwrap();
    let mut transaction = records.begin().await.unwrap();
    transaction.write(kept(2)).await.unwrap();
    transaction.rollback().await.unwrap();
    records.begin().await.unwrap().rollback().await.unwrap();
    assert!(is_open(&records, mark).await, "a planned refusal costs no connection");
    assert!(is_kept(&records, 1).await && !is_kept(&records, 2).await);
    records.prove().await.unwrap();
}

/// Ends a transaction that has written `number` otherwise than it should; which connection it was on.
async fn spoil(records: &Records, how: &str, number: i64) -> i64 {
    let mut transaction = records.begin().await.unwrap();
    let first = mark(&mut transaction).await;
    transaction.commit().await.unwrap();
    if how.starts_with("a statement alone") {
        match how {
            "a statement alone that fails" => records.write(sql(WRONG)).await.map(|_| ()).unwrap_err().to_string(),
            _ => timeout(SOON, records.write(sql(SLOW))).await.map(|_| ()).unwrap_err().to_string(),
        };
        return first;
    }
    let mut transaction = records.begin().await.unwrap();
    let mark = if are_shared() { mark(&mut transaction).await } else { first };
    transaction.write(kept(number)).await.unwrap();
    match how {
        "dropped" => drop(transaction),
        "dropped after a statement that failed" => {
            transaction.write(sql(WRONG)).await.unwrap_err();
        }
        "committed after a statement that failed" => {
            transaction.write(sql(WRONG)).await.unwrap_err();
            transaction.commit().await.unwrap_err();
        }
        "rolled back after the connection was lost" => {
            let lose = if are_shared() { "SELECT pg_terminate_backend(pg_backend_pid())" } else { "ROLLBACK" };
            let _ = transaction.read(sql(lose)).await;
            transaction.rollback().await.unwrap_err();
        }
        "dropped in the middle of a statement" => {
            timeout(SOON, transaction.write(sql(SLOW))).await.unwrap_err();
        }
        "committed, and the COMMIT fails" => {
            transaction.write(sql(ORPHAN)).await.unwrap();
            transaction.commit().await.unwrap_err();
        }
        other => panic!("{other}"),
    }
    mark
}

#[tokio::test(flavor = "multi_thread")]
async fn a_connection_whose_transaction_ended_otherwise_is_not_used_again() {
    let folder = tempfile::tempdir().unwrap();
    let records = open(&folder).await;
    for (number, how) in (10..).zip([
        "a statement alone that fails",
        "a statement alone that nobody waits for",
        "dropped",
        "dropped after a statement that failed",
        "committed after a statement that failed",
        "rolled back after the connection was lost",
        "dropped in the middle of a statement",
        "committed, and the COMMIT fails",
    ]) {
        let (mark, start) = (spoil(&records, how, number).await, Instant::now());
        // PostgreSQL may have used any connection for a statement alone.
        let is_known = !are_shared() || !how.starts_with("a statement alone");
        while is_known && is_open(&records, mark).await {
            // A server ends a session when the statement at hand has ended; a file has no such excuse.
            assert!(are_shared() && start.elapsed() < PATIENCE, "{how}: the connection is used again");
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
        assert!(!is_kept(&records, number).await, "{how}: what was not committed is there");
        let mut transaction = records.begin().await.unwrap();
        transaction.write(kept(100 + number)).await.unwrap();
        transaction.commit().await.unwrap();
        assert!(is_kept(&records, 100 + number).await, "{how}: what was committed later is not there for others");
        records.prove().await.unwrap();
    }
    if !are_shared() {
        // The PRAGMAs are the connection's, and this one is not the first.
        let mut transaction = records.begin().await.unwrap();
        for (pragma, value) in [
            ("SELECT synchronous AS value FROM pragma_synchronous", 2),
            ("SELECT foreign_keys AS value FROM pragma_foreign_keys", 1),
            ("SELECT timeout AS value FROM pragma_busy_timeout", 10_000),
        ] {
            let rows = transaction.read(sql(pragma)).await.unwrap();
            assert_eq!(rows[0].number("value").unwrap(), value, "{pragma}");
        }
        transaction.rollback().await.unwrap();
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_database_without_room_says_so_and_takes_more_when_there_is_room() {
    let folder = tempfile::tempdir().unwrap();
    let records = open(&folder).await;
    records.write(sql("CREATE TABLE test_filler (bytes TEXT)")).await.unwrap();
    let fill = match are_shared() {
        true => "DO $$ BEGIN RAISE EXCEPTION 'no room' USING ERRCODE = 'disk_full'; END $$",
        false => "INSERT INTO test_filler VALUES (hex(zeroblob(1000000)))",
    };
    for number in 0..3 {
        // SQLite's own bound on a file, of this connection only: as many pages as there are.
        let bound = async || if are_shared() { Ok(0) } else { records.write(sql("PRAGMA max_page_count = 1")).await };
        bound().await.unwrap();
        let mut transaction = records.begin().await.unwrap();
        transaction.write(kept(number)).await.unwrap();
        assert!(matches!(transaction.write(sql(fill)).await, Err(Error::Full)));
        transaction.commit().await.unwrap_err();
        assert!(!is_kept(&records, number).await);
        bound().await.unwrap();
        assert!(matches!(records.write(sql(fill)).await, Err(Error::Full)), "alone");
        let mut transaction = records.begin().await.unwrap();
        transaction.write(kept(10 + number)).await.unwrap();
        transaction.commit().await.unwrap();
        assert!(is_kept(&records, 10 + number).await);
    }
}
