//! Files and folders that no other user of the machine may read: what lies on local disks is what tenants have sent, and what
//! was computed from it. New ones are made so, whatever the umask says; older ones that are open to others are closed.

use super::database_url;
use super::keys::OWNER_KEY;
use std::fs::{DirBuilder, File, OpenOptions, Permissions};
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::{fs, io};

/// The mode of a folder.
const FOLDER: u32 = 0o700;
/// The mode of a file.
const FILE: u32 = 0o600;
/// What the group and everybody else may do.
const OTHERS: u32 = 0o077;
/// Paths that one log line names.
const NAMED: usize = 5;

/// Makes a folder, and the missing folders above it, that only this process's user may enter. One that is there stays as it is.
///
/// # Errors
/// It cannot be made.
pub fn make_folder(folder: &Path) -> io::Result<()> {
    DirBuilder::new().recursive(true).mode(FOLDER).create(folder)
}

/// Opens a file for writing and leaves in it what is there; a new one can be read by this process's user only.
///
/// # Errors
/// It cannot be opened.
pub fn open_file(path: &Path) -> io::Result<File> {
    OpenOptions::new().create(true).truncate(false).write(true).mode(FILE).open(path)
}

/// Closes a file that was just written by code that knows no modes, and the folders between it and `root`.
///
/// # Errors
/// A mode cannot be changed.
pub fn close_written(root: &Path, file: &Path) -> io::Result<()> {
    fs::set_permissions(file, Permissions::from_mode(FILE))?;
    for folder in file.ancestors().skip(1).take_while(|folder| *folder != root) {
        if fs::metadata(folder)?.mode() & OTHERS != 0 {
            fs::set_permissions(folder, Permissions::from_mode(FOLDER))?;
        }
    }
    Ok(())
}

/// A path that is open to others although it should not be.
#[derive(Debug)]
struct Open {
    path: PathBuf,
    /// Who owns it: a user id.
    owner: u32,
    error: io::Error,
}

/// What was open to other users, and what became of it.
#[derive(Debug, Default)]
pub struct Closed {
    folders: usize,
    files: usize,
    named: Vec<PathBuf>,
    /// What could not be closed.
    open: Vec<Open>,
}

impl Closed {
    /// Closes what a service with the folder `data` keeps on local disks: that folder, what the service itself writes into it,
    /// the files of the database at `database_url` and the blobs at `storage_url`. Other files are left as they are.
    pub fn of_service(data: &Path, database_url: &str, storage_url: &str) -> Closed {
        let mut closed = Closed::default();
        closed.close(data);
        closed.close(&data.join("lock"));
        if let Some(file) = database_url::path(database_url) {
            for file in database_url::all(&file) {
                closed.close(&file);
            }
        }
        if let Some(blobs) = storage_url.strip_prefix("file:").map(Path::new) {
            closed.close(blobs);
            closed.close(&blobs.join(OWNER_KEY));
            for folder in super::keys::FOLDERS {
                closed.close_tree(&blobs.join(folder));
            }
        }
        closed
    }

    /// Closes one file or folder, if it is there.
    pub fn close(&mut self, path: &Path) {
        let Ok(found) = fs::metadata(path) else { return };
        if found.mode() & OTHERS == 0 {
            return;
        }
        if let Err(error) = fs::set_permissions(path, Permissions::from_mode(found.mode() & 0o7777 & !OTHERS)) {
            self.open.push(Open { path: path.to_owned(), owner: found.uid(), error });
            return;
        }
        *(if found.is_dir() { &mut self.folders } else { &mut self.files }) += 1;
        if self.named.len() < NAMED {
            self.named.push(path.to_owned());
        }
    }

    /// Closes a folder and everything in it; links are not followed.
    pub fn close_tree(&mut self, folder: &Path) {
        self.close(folder);
        // A folder that cannot be listed has been reported above, or fails where it is used.
        for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
            match entry.file_type() {
                Ok(kind) if kind.is_dir() => self.close_tree(&entry.path()),
                Ok(kind) if kind.is_file() => self.close(&entry.path()),
                _ => {}
            }
        }
    }

    /// Logs what was open, in one line, and what still is, in another. The service goes on in either case: where a folder belongs
    /// to another user (a volume that an administrator has prepared for a group) only its owner can close it, and a service that
    /// refused could not be run there at all.
    pub fn log(&self) {
        let which = |paths: &mut dyn Iterator<Item = &PathBuf>, all: usize| {
            let named: Vec<String> = paths.take(NAMED).map(|path| path.display().to_string()).collect();
            let more = all.saturating_sub(named.len());
            if more > 0 { format!("{} and {more} more", named.join(", ")) } else { named.join(", ") }
        };
        let (folders, files) = (self.folders, self.files);
        if folders + files > 0 {
            let which = which(&mut self.named.iter(), folders + files);
            tracing::warn!(
                folders,
                files,
                which,
                "other users of this machine could open these files; now only the user of the service can"
            );
        }
        if let Some(Open { owner, error, .. }) = self.open.first() {
            let which = which(&mut self.open.iter().map(|open| &open.path), self.open.len());
            let user = rustix::process::geteuid().as_raw();
            tracing::warn!(
                which,
                owner,
                user,
                %error,
                "other users of this machine can open these files, and this process may not change that; the owner of the files can, with chmod go="
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closing_takes_from_others_only_and_follows_no_link_out_of_the_folder() {
        let base = tempfile::tempdir().unwrap();
        let (data, away) = (base.path().join("data"), base.path().join("away"));
        let blobs = data.join("blobs");
        for folder in [blobs.join("ray-sets/a"), blobs.join("strange"), away.clone()] {
            fs::create_dir_all(folder).unwrap();
        }
        let files = ["data/service.db", "data/service.db-wal", "data/letter", "data/blobs/ray-sets/a/0", "away/letter"];
        for file in files {
            fs::write(base.path().join(file), "x").unwrap();
            fs::set_permissions(base.path().join(file), Permissions::from_mode(0o644)).unwrap();
        }
        std::os::unix::fs::symlink(&away, blobs.join("ray-sets/link")).unwrap();
        std::os::unix::fs::symlink(away.join("letter"), blobs.join("ray-sets/a/link")).unwrap();
        let set = |path: &Path, mode| fs::set_permissions(path, Permissions::from_mode(mode)).unwrap();
        set(&data, 0o2770);
        set(&blobs, 0o555);
        set(&blobs.join("ray-sets/a"), 0o711);
        let mode = |path: &str| fs::metadata(base.path().join(path)).unwrap().mode() & 0o7777;
        let (url, store) = (database_url::url(&data.join("service.db")), format!("file:{}", blobs.display()));
        let closed = Closed::of_service(&data, &url, &store);
        assert!(closed.open.is_empty(), "{closed:?}");
        assert_eq!((mode("data"), mode("data/blobs"), mode("data/blobs/ray-sets/a")), (0o2700, 0o500, 0o700));
        assert_eq!(files.map(mode), [0o600, 0o600, 0o644, 0o600, 0o644]);
        assert_eq!(closed.files, 3);
        let again = Closed::of_service(&data, &url, &store);
        assert_eq!((again.folders, again.files), (0, 0), "{again:?}");
    }

    #[test]
    fn what_is_made_is_closed() {
        let base = tempfile::tempdir().unwrap();
        let folder = base.path().join("a/b");
        make_folder(&folder).unwrap();
        make_folder(&folder).unwrap();
        fs::write(folder.join("kept"), "kept").unwrap();
        drop(open_file(&folder.join("kept")).unwrap());
        drop(open_file(&folder.join("new")).unwrap());
        assert_eq!(fs::read_to_string(folder.join("kept")).unwrap(), "kept");
        let mode = |path: &str| fs::metadata(base.path().join(path)).unwrap().mode() & 0o777;
        assert_eq!((mode("a"), mode("a/b"), mode("a/b/new")), (0o700, 0o700, 0o600));
    }
}
