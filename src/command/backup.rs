//! `backup`: a copy of everything a service keeps, taken while it runs.

use super::stores;
use super::stores::Stores;
use super::terminal::failure::Failure;
use super::terminal::output;
use super::terminal::table::count;
use clap::Args;
use service::storage;
use service::upkeep::backup;
use service::upkeep::backup::error::Error;
use std::path::PathBuf;

/// Arguments of `backup`.
#[derive(Args)]
pub struct Arguments {
    /// Folder for the backup; a folder with an earlier backup is brought up to date.
    #[arg(long, value_name = "DIR")]
    to: PathBuf,
    #[command(flatten)]
    stores: Stores,
}

/// Makes a backup.
///
/// # Errors
/// The stores are not local, the disk refuses an operation, or a blob is missing.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let config = arguments.stores.config();
    let copied = stores::run(async { Ok(backup::backup(&config, &arguments.to).await?) })?;
    output::print(format_args!(
        "{}: {} blobs, {} of them new ({} bytes); restore with: lampwright serve --data {0}\n",
        output::visible(&arguments.to.display().to_string()),
        count(copied.blobs),
        count(copied.fresh),
        count(copied.fresh_bytes),
    ))?;
    match copied.deleted {
        0 => Ok(()),
        deleted => output::print(format_args!(
            "{} ray sets, jobs and uploads were deleted during the backup and are not in it\n",
            count(deleted)
        )),
    }
}

impl From<Error> for Failure {
    fn from(error: Error) -> Failure {
        let (code, remedy) = match &error {
            Error::NotLocal => {
                ("backup.elsewhere", "Use pg_dump, then copy the bucket: first the database, then the objects.")
            }
            Error::Served(_) => (
                "backup.served",
                "Name a different folder with --to: a service uses this one, and has changed it since.",
            ),
            Error::Inside { .. } => (
                "backup.inside",
                "Name a folder with --to that is outside of the data folder, the database folder and the folder of blobs.",
            ),
            Error::Around { .. } => ("backup.around", "Name a folder with --to that contains nothing else."),
            Error::Occupied { .. } => (
                "backup.occupied",
                "Name an empty folder with --to, or the folder of an earlier backup on which no service was started.",
            ),
            Error::Missing(_) => {
                ("backup.missing_blob", "The object store is damaged: restore it from an earlier backup.")
            }
            Error::Outrun => ("backup.outrun", "Run the command again: it keeps what is copied, and less remains."),
            Error::Disk { .. } => {
                ("backup.disk", "Name another folder with --to, or check its free space and permissions.")
            }
            Error::Storage(storage::Error::Unusable(error)) => (error.code(), error.remedy()),
            Error::Storage(_) => ("backup.stores", "Check that --data names the data folder of the service."),
        };
        Failure::failed(code, error.to_string(), remedy)
    }
}
