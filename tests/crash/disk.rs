//! A small disk of a test's own, which can be made full and empty again: a tmpfs on the data folder.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// A mounted tmpfs; unmounted when dropped.
pub struct Disk {
    folder: PathBuf,
    bytes: u64,
}

/// Runs a program of the system; whether it succeeded.
fn run(program: &str, arguments: &[&str]) -> bool {
    let status = Command::new(program).args(arguments).stdout(Stdio::null()).stderr(Stdio::null()).status();
    status.is_ok_and(|status| status.success())
}

impl Disk {
    /// Mounts one of so many bytes at `folder`; `None` where that is not permitted: only root may.
    pub fn mount(folder: &Path, bytes: u64) -> Option<Disk> {
        std::fs::create_dir_all(folder).unwrap();
        let disk = Disk { folder: folder.to_owned(), bytes };
        run("mount", &["-t", "tmpfs", "-o", &format!("size={bytes}"), "tmpfs", disk.path()]).then_some(disk)
    }

    fn path(&self) -> &str {
        self.folder.to_str().unwrap()
    }

    fn resize(&self, bytes: u64) -> bool {
        run("mount", &["-o", &format!("remount,size={bytes}"), self.path()])
    }

    /// Leaves no byte free, for rows and blobs alike.
    pub fn fill(&self) {
        // Whoever writes meanwhile makes the size too small, and it is measured again.
        while !self.resize(self.used_bytes()) {}
    }

    pub fn make_room(&self) {
        assert!(self.resize(self.bytes), "{} cannot be made larger again", self.path());
    }

    fn used_bytes(&self) -> u64 {
        let df = Command::new("df").args(["--output=used", "-B1", self.path()]).output().unwrap();
        let text = String::from_utf8(df.stdout).unwrap();
        text.lines().nth(1).unwrap().trim().parse::<u64>().unwrap().max(1)
    }
}

impl Drop for Disk {
    fn drop(&mut self) {
        // At once, also when a process that was killed just now has not let go of it.
        let _ = run("umount", &["-l", self.path()]);
    }
}
