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
    /// The folder for the copy; one that holds an earlier backup gets what is new.
    #[arg(long, value_name = "DIR")]
    to: PathBuf,
    #[command(flatten)]
    stores: Stores,
}

/// Makes a backup.
///
/// # Errors
/// Stores that are elsewhere; a disk that says no; a blob that is missing.
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
            "{} ray sets, jobs and uploads were deleted meanwhile and are not in it\n",
            count(deleted)
        )),
    }
}

impl From<Error> for Failure {
    fn from(error: Error) -> Failure {
        let (code, remedy) = match &error {
            Error::Elsewhere => ("backup.elsewhere", "Use pg_dump, then copy the bucket: rows first, blobs second."),
            Error::Served(_) => (
                "backup.served",
                "Name a folder of its own with --to: what is served has changes that the copy has not.",
            ),
            Error::Inside { .. } => (
                "backup.inside",
                "Name a folder with --to that is outside of the data folder, the database's folder and the blobs.",
            ),
            Error::Around { .. } => ("backup.around", "Name a folder with --to that holds nothing else."),
            Error::Occupied { .. } => (
                "backup.occupied",
                "Name an empty folder with --to, or one that an earlier backup was made into and no service was started on.",
            ),
            Error::Missing(_) => ("backup.missing_blob", "The store is damaged: restore it from an earlier backup."),
            Error::Outrun => ("backup.outrun", "Run it again: what is copied stays, and there is less left."),
            Error::Disk { .. } => ("backup.disk", "Name another folder with --to, or see to its room and permissions."),
            Error::Storage(storage::Error::Unusable(error)) => (error.code(), error.remedy()),
            Error::Storage(_) => ("backup.stores", "See that --data names the service's data folder."),
        };
        Failure::failed(code, error.to_string(), remedy)
    }
}
