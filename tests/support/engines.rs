//! The engines a test runs on: files in its folder, or, when `tests/engines/with` runs the tests, PostgreSQL and S3: a schema and a
//! prefix of its own, so that tests share servers and nothing else.

use sqlx::{Connection, Executor, PgConnection};
use std::env;

/// Where a service keeps its rows and blobs.
#[derive(Clone, Debug)]
pub struct Engines {
    pub database_url: String,
    pub storage_url: String,
}

/// True when `tests/engines/with` runs this test.
pub fn are_shared() -> bool {
    env::var_os("TEST_DATABASE_URL").is_some()
}

/// Fresh ones on the servers; `None` without servers.
pub async fn shared() -> Option<Engines> {
    let (database, store) = (env::var("TEST_DATABASE_URL").ok()?, env::var("TEST_STORAGE_URL").ok()?);
    let name = format!("test_{}", uuid::Uuid::now_v7().simple());
    let mut connection = PgConnection::connect(&database).await.unwrap();
    connection.execute(sqlx::AssertSqlSafe(format!("CREATE SCHEMA {name}"))).await.unwrap();
    connection.close().await.unwrap();
    Some(Engines {
        database_url: format!("{database}?application_name={name}&options[search_path]={name}"),
        storage_url: format!("{store}/{name}"),
    })
}

/// Says `text`, one or more statements, to the database at `url`, behind the back of whoever works with it.
pub async fn execute(url: &str, text: String) {
    sqlx::any::install_default_drivers();
    let mut connection = sqlx::AnyConnection::connect(url).await.unwrap();
    connection.execute(sqlx::AssertSqlSafe(text)).await.unwrap();
    connection.close().await.unwrap();
}
