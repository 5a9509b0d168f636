//! The file of a SQLite database, before it is opened: where it is, that it can be one of ours, and that a new one is closed to
//! other users. The pool that opens it later would try again for half a minute, and say nothing of the file.

use super::database_url::path;
use super::error::Unusable;
use super::private;
use std::fs::{self, File};
use std::io::{self, Read};
use std::path::Path;

/// What every database of SQLite begins with (its file format, 1.3).
const MAGIC: &[u8] = b"SQLite format 3\0";

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
    use crate::storage::database_url::url;

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
