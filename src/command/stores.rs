//! The stores of a service, opened next to it: by the verbs that look after keys, tenants and backups.

use super::terminal::failure::Failure;
use clap::Args;
use service::storage::private;
use service::storage::records::Records;
use service::{Config, storage};
use std::path::PathBuf;

/// Arguments that name the stores of a service, the same as those of `serve`.
#[derive(Args)]
pub struct Stores {
    /// The data folder of the service.
    #[arg(long, env = "LAMPWRIGHT_DATA", default_value = "data", value_name = "DIR")]
    pub data: PathBuf,
    /// The database of the service [default: sqlite:DIR/service.db].
    #[arg(long, env = "DATABASE_URL", value_name = "URL", hide_env_values = true)]
    database_url: Option<String>,
    /// The object store of the service [default: file:DIR/blobs].
    #[arg(long, env = "STORAGE_URL", value_name = "URL")]
    storage_url: Option<String>,
}

impl Stores {
    /// The settings that the service would be started with.
    pub fn config(&self) -> Config {
        let (database_url, storage_url) = (self.database_url.clone(), self.storage_url.clone());
        Config { database_url, storage_url, ..Config::new(&self.data) }
    }

    /// Does `work` with the database; makes it if there is none yet, as the service would.
    ///
    /// # Errors
    /// The database cannot be opened, and those of `work`.
    pub fn with_records<T>(&self, work: impl AsyncFnOnce(&Records) -> Result<T, storage::Error>) -> Result<T, Failure> {
        let config = self.config();
        run(async move {
            let unwritable = |error: std::io::Error| Failure::folder("stores.folder", &config.data, &error);
            private::make_folder(&config.data).map_err(unwritable)?;
            if config.database_url.is_none() {
                // SQLite says only that it cannot open its file.
                tempfile::tempfile_in(&config.data).map_err(unwritable)?;
            }
            let records = Records::open(&config.database_url()).await?;
            let done = work(&records).await;
            records.close().await;
            Ok(done?)
        })
    }
}

/// Waits for `work` on a runtime of its own.
///
/// # Errors
/// Those of `work`; no runtime to be had.
pub fn run<T>(work: impl Future<Output = Result<T, Failure>>) -> Result<T, Failure> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
    let failed = |error: std::io::Error| {
        Failure::failed("stores.runtime", error.to_string(), "Allow this process more open files.")
    };
    runtime.map_err(failed)?.block_on(work)
}

impl From<storage::Error> for Failure {
    fn from(error: storage::Error) -> Failure {
        if let storage::Error::Unusable(error) = &error {
            return Failure::failed(error.code(), error.to_string(), error.remedy());
        }
        let remedy = match &error {
            storage::Error::Unsupported(_, remedy) => remedy,
            _ => {
                "Check that this is the database of the service, that it can be reached, and that its disk has free space."
            }
        };
        Failure::failed("stores.failed", error.to_string(), remedy)
    }
}
