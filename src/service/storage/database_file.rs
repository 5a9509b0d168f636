//! The file of a SQLite database, before it is opened: where it is, that it can be one of ours, and that a new one is closed to
//! other users. The pool that opens it later would try again for half a minute, and say nothing of the file.

use super::private;
use percent_encoding::{AsciiSet, CONTROLS, percent_decode_str, utf8_percent_encode};
use std::fs::{self, File};
use std::io::{self, Read};
use std::path::{Path, PathBuf};

/// What stands for something else in a URL.
const SPECIAL: &AsciiSet = &CONTROLS.add(b'%').add(b'?').add(b'#');

/// What every database of SQLite begins with (its file format, 1.3).
const MAGIC: &[u8] = b"SQLite format 3\0";

/// Why a database is not opened. For whoever starts the service; clients never see it.
#[derive(Debug, thiserror::Error)]
pub enum Unusable {
    /// It is something else.
    #[error("{} is not a SQLite database", .0.display())]
    NotADatabase(PathBuf),
    /// It has tables, and none of ours.
    #[error("{} is a database of another program", .0.display())]
    Foreign(PathBuf),
    /// It is not there, and is not to be made.
    #[error("the database {} does not exist", .0.display())]
    Missing(PathBuf),
    /// A newer version of this program has changed its schema.
    #[error(
        "{database} was written by a newer version of lampwright: its schema has step {step}, this version ends at {known}"
    )]
    Newer {
        /// Which.
        database: String,
        /// A step that this version does not know.
        step: i64,
        /// The last one that it knows.
        known: i64,
    },
    /// The blobs in the object store are named by the rows of another one.
    #[error("the object store belongs to another database")]
    OtherBlobs,
    /// The file cannot be looked at or made.
    #[error("{}: {error}", path.display())]
    Disk {
        /// Which.
        path: PathBuf,
        /// Why.
        error: io::Error,
    },
}

impl Unusable {
    /// Stable: scripts may depend on it.
    pub fn code(&self) -> &'static str {
        match self {
            Unusable::NotADatabase(_) => "storage.not_a_database",
            Unusable::Foreign(_) => "storage.foreign_database",
            Unusable::Missing(_) => "storage.no_database",
            Unusable::Newer { .. } => "storage.newer_database",
            Unusable::OtherBlobs => "storage.other_database",
            Unusable::Disk { .. } => "storage.database_file",
        }
    }

    /// What to do.
    pub fn remedy(&self) -> &'static str {
        match self {
            Unusable::NotADatabase(_) => {
                "Name the service's data folder with --data, or move this file away; if it was the database, restore a backup."
            }
            Unusable::Foreign(_) => "Name another file with --database-url, or another folder with --data.",
            Unusable::Missing(_) => {
                "Name the right file with --database-url; with mode=rwc in place of mode=rw it is made."
            }
            Unusable::Newer { .. } => "Start the newer version, or restore a backup from before it was first started.",
            Unusable::OtherBlobs => {
                "Name the database that was used with this store before, with --database-url or --data; or an empty store, with \
                 --storage-url."
            }
            Unusable::Disk { .. } => "See to the permissions of the file and of the folders above it.",
        }
    }
}

/// The URL of the database in `file`, which is made if it is not there.
pub fn url(file: &Path) -> String {
    format!("sqlite:{}?mode=rwc", utf8_percent_encode(&file.display().to_string(), SPECIAL))
}

/// The file that a `sqlite:` URL names; `None` where the database is in no file.
pub fn path(url: &str) -> Option<PathBuf> {
    let rest = url.strip_prefix("sqlite:")?;
    let rest = rest.strip_prefix("//").unwrap_or(rest);
    let (file, options) = rest.split_once('?').unwrap_or((rest, ""));
    if matches!(file, "" | ":memory:") || options.split('&').any(|option| option == "mode=memory") {
        return None;
    }
    Some(PathBuf::from(percent_decode_str(file).decode_utf8().ok()?.into_owned()))
}

/// The database in `file` and what SQLite keeps beside it while it is open.
pub fn all(file: &Path) -> [PathBuf; 3] {
    ["", "-wal", "-shm"].map(|end| {
        let mut name = file.as_os_str().to_owned();
        name.push(end);
        name.into()
    })
}

/// Sees that the database at `url` can be opened; makes an empty file for a new one, and the folders above it, so that they are
/// closed to others from the beginning. SQLite gives its other files the same mode.
///
/// # Errors
/// [`Unusable`].
pub fn prepare(url: &str) -> Result<(), Unusable> {
    let Some(file) = path(url) else { return Ok(()) };
    match fs::metadata(&file) {
        Ok(found) if found.is_dir() => Err(Unusable::NotADatabase(file)),
        Ok(_) => match begins_as_one(&file) {
            Ok(true) => Ok(()),
            Ok(false) => Err(Unusable::NotADatabase(file)),
            Err(error) => Err(Unusable::Disk { path: file, error }),
        },
        Err(error) if error.kind() == io::ErrorKind::NotFound && !url.contains("mode=rwc") => {
            Err(Unusable::Missing(file))
        }
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            let folder = file.parent().map_or(Ok(()), private::make_folder);
            let made = folder.and_then(|()| private::open_file(&file));
            made.map(drop).map_err(|error| Unusable::Disk { path: file, error })
        }
        Err(error) => Err(Unusable::Disk { path: file, error }),
    }
}

/// Whether a file is empty or begins as SQLite's files do. SQLite itself takes a file of a few bytes for an empty one, and writes
/// over it.
fn begins_as_one(file: &Path) -> io::Result<bool> {
    let mut beginning = Vec::new();
    File::open(file)?.take(MAGIC.len() as u64).read_to_end(&mut beginning)?;
    Ok(beginning.is_empty() || beginning == MAGIC)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_url_names_the_file_that_it_was_made_of() {
        for file in ["/data/service.db", "service.db", "../a b/c.db", "/odd?/50%/#1/ü.db"] {
            assert_eq!(path(&url(Path::new(file))), Some(PathBuf::from(file)), "{file}");
        }
        for (url, file) in [
            ("sqlite:///srv/rows.db?mode=rwc&cache=private", Some("/srv/rows.db")),
            ("sqlite://rows.db", Some("rows.db")),
            ("sqlite:rows%20here.db", Some("rows here.db")),
            ("sqlite::memory:", None),
            ("sqlite:x?mode=memory", None),
            ("postgres://x/y", None),
        ] {
            assert_eq!(path(url), file.map(PathBuf::from), "{url}");
        }
    }

    /// As where the blobs are on S3, and nothing has made the data folder yet.
    #[test]
    fn a_new_database_is_made_with_the_folders_above_it_closed_to_others() {
        use std::os::unix::fs::PermissionsExt;
        let place = tempfile::tempdir().unwrap();
        let file = place.path().join("new/data/service.db");
        prepare(&url(&file)).unwrap();
        let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode() & 0o777;
        let folders = file.ancestors().skip(1).take(2).map(mode);
        assert_eq!((mode(&file), folders.collect::<Vec<_>>()), (0o600, vec![0o700; 2]));
        let missing = place.path().join("other/service.db");
        let found = prepare(&url(&missing).replace("rwc", "rw"));
        assert!(matches!(&found, Err(Unusable::Missing(path)) if *path == missing), "{found:?}");
        assert!(!place.path().join("other").exists());
    }
}
