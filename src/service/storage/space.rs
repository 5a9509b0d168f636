//! How much room the local disks have. A remote store has no room that we could see.

use std::path::PathBuf;
use std::sync::Arc;

/// The folders we write to, and how much room is kept free in them. Cheap to clone.
#[derive(Clone, Debug)]
pub struct Space {
    folders: Arc<[PathBuf]>,
    keep_free: u64,
}

impl Space {
    /// Keeps `keep_free` bytes free on the disk of each folder.
    pub fn new(folders: Vec<PathBuf>, keep_free: u64) -> Space {
        Space { folders: folders.into(), keep_free }
    }

    /// Bytes free on the fullest disk; `None` when there is none or it does not say.
    pub fn free_bytes(&self) -> Option<u64> {
        let free = |folder: &PathBuf| {
            let stat = rustix::fs::statvfs(folder).ok()?;
            Some(stat.f_bavail.saturating_mul(stat.f_frsize))
        };
        self.folders.iter().filter_map(free).min()
    }

    /// Whether `more` bytes leave free what is to be kept free.
    pub fn has_room_for(&self, more: u64) -> bool {
        self.free_bytes().is_none_or(|free| free.saturating_sub(more) >= self.keep_free)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_is_room_until_there_would_not_be() {
        let folder = tempfile::tempdir().unwrap();
        let space = |keep_free| Space::new(vec![folder.path().to_owned(), PathBuf::from("/nowhere/at/all")], keep_free);
        // df(1) reads the same numbers; others write to this disk too, hence the margin.
        let df = std::process::Command::new("df").args(["--output=avail", "-B1"]).arg(folder.path()).output().unwrap();
        let df: u64 = String::from_utf8(df.stdout).unwrap().lines().nth(1).unwrap().trim().parse().unwrap();
        let free = space(0).free_bytes().unwrap();
        assert!(free.abs_diff(df) < df / 4 + (1 << 30), "{free} and {df}");
        assert!(space(0).has_room_for(0) && space(free / 2).has_room_for(free / 4));
        assert!(!space(free / 2).has_room_for(free - free / 4) && !space(u64::MAX).has_room_for(0));
        assert!(Space::new(Vec::new(), u64::MAX).has_room_for(u64::MAX), "a remote store is not judged");
    }
}
