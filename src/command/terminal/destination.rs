//! Where a verb writes: no file is replaced unasked, a file is whole or not there, and a folder for results stays only where something is in
//! it. Whether that can be is known before the work.

use super::failure::Failure;
use super::interruption;
use super::interruption::Begun;
use pipeline::convert::Failed;
use service::storage::space::Space;
use std::fs;
use std::fs::{File, OpenOptions};
use std::io;
use std::io::Write;
use std::path::{Path, PathBuf};

/// What stands before and behind the name of a file that is not whole yet.
const BEFORE: &str = ".";
const BEHIND: &str = ".part";

/// A file to be written.
pub struct NewFile {
    path: PathBuf,
    /// What has its name may be replaced.
    force: bool,
}

impl NewFile {
    /// A file that is not there, or may be replaced.
    ///
    /// # Errors
    /// It is there, and is not to be replaced (`force`); a folder, a device or a pipe has its name; its folder is not there.
    pub fn at(path: &Path, force: bool) -> Result<NewFile, Failure> {
        let place = || path.display().to_string();
        let parent = folder_of(path);
        refuse_standard_output(path)?;
        match fs::symlink_metadata(path).and_then(|link| fs::metadata(path).or(Ok(link))) {
            Ok(found) if found.is_dir() => {
                let found = "A folder has the name of the output file.";
                return Err(Failure::usage("output.folder", found, "Name a file in it, or another one.").at(place()));
            }
            Ok(found) if !found.is_file() => {
                let found = "This is a device or a pipe, which a whole file cannot take the place of.";
                return Err(Failure::usage("output.device", found, "Name a file.").at(place()));
            }
            Ok(_) if !force => {
                let found = "The output file exists already.";
                let remedy = "Name another output file, or give --force.";
                return Err(Failure::usage("output.exists", found, remedy).at(place()));
            }
            _ => {}
        }
        if path.file_name().is_none() || !parent.is_dir() {
            let found = format!("The output file's folder, {}, is not there.", parent.display());
            let remedy = "Make the folder first, or name a file in another one.";
            return Err(Failure::usage("output.no_folder", found, remedy).at(place()));
        }
        Ok(NewFile { path: path.to_owned(), force })
    }

    /// The same file, which will have so many bytes.
    ///
    /// # Errors
    /// Its disk has no room for them. An old file goes only when the new one is whole, so its bytes are not free.
    pub fn of_size(self, bytes: u64) -> Result<NewFile, Failure> {
        let free = Space::new(vec![folder_of(&self.path).to_owned()], 0).free_bytes();
        let Some(free) = free.filter(|free| *free < bytes) else { return Ok(self) };
        let found = format!("The file will have {}, and its disk has room for {}.", size(bytes), size(free));
        let remedy = "Ask for fewer rays, free space on the disk, or name a file on another one.";
        Err(Failure::failed("output.no_space", found, remedy).at(self.path.display().to_string()))
    }

    /// Writes under another name first, so that no program sees an incomplete file, and the old file stays until the new one is complete. What
    /// is left of an earlier attempt that was killed goes.
    ///
    /// # Errors
    /// Those of `fill`, or of the disk.
    pub fn write<T>(&self, fill: impl FnOnce(&mut File) -> Result<T, Failed>) -> Result<T, Failed> {
        let name = self.path.file_name().unwrap_or_default().to_string_lossy();
        sweep(folder_of(&self.path), &name);
        let part = self.path.with_file_name(format!("{BEFORE}{name}.{}.{}{BEHIND}", machine(), std::process::id()));
        let _begun = interruption::begin(&part);
        let mut file = OpenOptions::new().read(true).write(true).create_new(true).open(&part)?;
        // Whoever finds the part locked knows that it is being written. Not every disk has locks: the process's number tells it too.
        let _ = file.try_lock();
        let filled = || {
            let filled = fill(&mut file)?;
            file.sync_all()?;
            self.take_place(&part)?;
            Ok(filled)
        };
        let done = filled();
        if done.is_err() {
            // What went wrong is told already; a part that stays behind is only untidy.
            let _ = fs::remove_file(&part);
        }
        done
    }

    /// Gives the whole file its name. What came there meanwhile is not replaced unasked, where the disk knows links.
    fn take_place(&self, part: &Path) -> io::Result<()> {
        if !self.force {
            match fs::hard_link(part, &self.path) {
                Ok(()) => return fs::remove_file(part),
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => return Err(error),
                Err(_) => {}
            }
        }
        fs::rename(part, &self.path)
    }

    /// Writes these bytes, as [`NewFile::write`].
    ///
    /// # Errors
    /// Of the disk.
    pub fn write_all(&self, bytes: &[u8]) -> Result<(), Failure> {
        self.write(|file| Ok(file.write_all(bytes)?)).map_err(|failed| self.failure(failed))
    }

    /// What to tell of a failed [`NewFile::write`].
    pub fn failure(&self, failed: Failed) -> Failure {
        match failed {
            Failed::Read(error) => Failure::from(error),
            Failed::Write(error) => Failure::disk(&self.path, &error),
        }
    }
}

fn size(bytes: u64) -> String {
    let mb = bytes as f64 / 1e6;
    if mb < 1000.0 { format!("{mb:.1} MB") } else { format!("{:.1} GB", mb / 1000.0) }
}

fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Whether a process of this machine runs; one that has ended stays listed, as a zombie, until its parent hears of it.
fn runs(process: u32) -> bool {
    let Ok(stat) = fs::read_to_string(format!("/proc/{process}/stat")) else { return false };
    !stat.rsplit_once(") ").is_some_and(|(_, state)| state.starts_with(['Z', 'X']))
}

/// The name of this machine or container, within which numbers of processes mean something.
fn machine() -> String {
    let name = fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    name.trim().replace(|sign: char| !(sign.is_ascii_alphanumeric() || sign == '-'), "_")
}

/// Removes the parts of the file `name` that nobody writes any more: their processes were killed.
fn sweep(folder: &Path, name: &str) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let part = entry.file_name();
        let part = part.to_string_lossy();
        let inner = part.strip_prefix(BEFORE).and_then(|part| part.strip_suffix(BEHIND));
        let writer = inner.and_then(|inner| inner.strip_prefix(name)?.strip_prefix('.')?.rsplit_once('.'));
        // Another machine's processes cannot be seen here; what is no file was not made by a verb.
        let is_file = entry.file_type().is_ok_and(|kind| kind.is_file());
        let Some((_, process)) = writer.filter(|(from, _)| is_file && *from == machine()) else { continue };
        // A process of this machine that still runs may just have made it.
        let may_be_written = process.parse().map_or(true, |number| number != std::process::id() && runs(number));
        let is_free = || File::open(entry.path()).is_ok_and(|file| file.try_lock().is_ok());
        if !may_be_written && is_free() {
            let _ = fs::remove_file(entry.path());
        }
    }
}

/// Other programs take "-" for standard output. A file or a folder of this name is written by no one on purpose.
fn refuse_standard_output(path: &Path) -> Result<(), Failure> {
    match path.as_os_str() == "-" {
        false => Ok(()),
        true => {
            let found = "Results are whole files, which standard output cannot be.";
            Err(Failure::usage("output.device", found, "Name a file; ./- is one of this name.").at("-"))
        }
    }
}

/// Whether there can be a folder for results.
///
/// # Errors
/// A file has its name, or that of a folder round it.
pub fn can_be_folder(folder: &Path) -> Result<(), Failure> {
    refuse_standard_output(folder)?;
    let Some(file) = folder.ancestors().find(|part| part.exists() && !part.is_dir()) else { return Ok(()) };
    let found = format!("{} is a file, no folder.", file.display());
    let remedy = "Name another folder for the results; a folder that is not there is made.";
    Err(Failure::usage("output.file", found, remedy).at(folder.display().to_string()))
}

/// Makes a folder to which files are added: others may be in it.
///
/// # Errors
/// A file is in the way, or the disk refuses it.
pub fn make_folder(folder: &Path) -> Result<(), Failure> {
    can_be_folder(folder)?;
    fs::create_dir_all(folder).map_err(|error| Failure::disk(folder, &error))
}

/// The folder for results. Unless it is kept, what was written to it goes again, and the folders that were made for it.
pub struct NewFolder {
    folder: PathBuf,
    /// The folders that were not there, the outermost first, and what was written.
    made: Vec<PathBuf>,
    /// The same, for who interrupts the verb.
    begun: Vec<Begun>,
}

impl NewFolder {
    /// Makes the folder, before there is something to write: whether that can be is known before the work. An earlier model in the
    /// same folder would leave zones behind that the new one does not have.
    ///
    /// # Errors
    /// The folder is not empty, a file has its name or that of a folder round it, or the disk refuses an operation.
    pub fn make(folder: &Path) -> Result<NewFolder, Failure> {
        let place = || folder.display().to_string();
        can_be_folder(folder)?;
        let mut new = NewFolder { folder: folder.to_owned(), made: Vec::new(), begun: Vec::new() };
        new.make_folder(folder)?;
        let mut inside = fs::read_dir(folder).map_err(|error| Failure::disk(folder, &error))?;
        if inside.next().is_some() {
            let found = "The folder for the results is not empty.";
            return Err(Failure::usage("output.not_empty", found, "Empty the folder, or name another.").at(place()));
        }
        Ok(new)
    }

    /// Writes a file; folders may stand in its name.
    ///
    /// # Errors
    /// What the disk answers.
    pub fn put(&mut self, name: &str, bytes: &[u8]) -> Result<(), Failure> {
        let path = self.folder.join(name);
        self.make_folder(folder_of(&path))?;
        let disk = |error: io::Error| Failure::disk(&path, &error);
        // Only what was not there before is taken away again.
        let mut file = OpenOptions::new().write(true).create_new(true).open(&path).map_err(disk)?;
        self.begin(&path);
        file.write_all(bytes).map_err(disk)
    }

    /// All is written, and stays.
    pub fn keep(mut self) {
        self.made.clear();
    }

    fn make_folder(&mut self, folder: &Path) -> Result<(), Failure> {
        let missing = folder.ancestors().take_while(|part| !part.exists() && !part.as_os_str().is_empty());
        let missing: Vec<&Path> = missing.collect();
        missing.into_iter().rev().for_each(|folder| self.begin(folder));
        fs::create_dir_all(folder).map_err(|error| Failure::disk(folder, &error))
    }

    fn begin(&mut self, path: &Path) {
        self.begun.push(interruption::begin(path));
        self.made.push(path.to_owned());
    }
}

impl Drop for NewFolder {
    fn drop(&mut self) {
        self.made.iter().rev().for_each(|path| interruption::take_away(path));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_earlier_model_is_not_mixed_with_a_new_one() {
        let folder = tempfile::tempdir().unwrap();
        let new = NewFolder::make(&folder.path().join("new")).unwrap();
        assert!(NewFolder::make(folder.path()).is_err());
        drop(new);
        assert!(NewFolder::make(folder.path()).is_ok());
    }

    #[test]
    fn what_was_made_goes_again_unless_something_is_in_it() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir(at("mine")).unwrap();
        drop(NewFolder::make(&at("mine/a/b")).unwrap());
        assert!(at("mine").is_dir() && !at("mine/a").exists());
        drop(NewFolder::make(&at("mine")).unwrap());
        assert!(at("mine").is_dir(), "it was there before");
        let mut broken = NewFolder::make(&at("mine/b")).unwrap();
        broken.put("ies/total.ies", b"IESNA").unwrap();
        assert!(at("mine/b/ies/total.ies").is_file());
        drop(broken);
        assert!(!at("mine/b").exists(), "not all was written");
        let mut kept = NewFolder::make(&at("mine/c/d")).unwrap();
        kept.put("report.json", b"{}").unwrap();
        kept.keep();
        assert!(at("mine/c/d/report.json").is_file());
    }

    #[test]
    fn what_is_in_the_way_is_told_before_the_work() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir(at("folder")).unwrap();
        fs::write(at("file"), "precious").unwrap();
        let file = |name: &str, force: bool| NewFile::at(&at(name), force).err().map(|failure| failure.to_string());
        for (name, force, code) in [
            ("file", false, "output.exists"),
            ("folder", true, "output.folder"),
            ("nowhere/file", true, "output.no_folder"),
            ("file/inner", true, "output.no_folder"),
        ] {
            assert!(file(name, force).is_some_and(|told| told.contains(code)), "{name}: {:?}", file(name, force));
        }
        assert_eq!((file("file", true), file("new", false)), (None, None));
        assert!(NewFile::at(Path::new("/dev/null"), true).err().unwrap().to_string().contains("output.device"));
        assert!(NewFile::at(Path::new("./-"), false).is_ok());
        for failure in [NewFile::at(Path::new("-"), true).err(), NewFolder::make(Path::new("-")).err()] {
            assert!(failure.unwrap().to_string().contains("standard output"));
        }
        for name in ["file", "file/inner"] {
            let told = NewFolder::make(&at(name)).err().unwrap().to_string();
            assert!(told.contains("output.file") && told.contains("is a file"), "{told}");
        }
        let large = NewFile::at(&at("new"), false).unwrap().of_size(u64::MAX).err().unwrap().to_string();
        assert!(large.contains("output.no_space") && large.contains("has room for"), "{large}");
        assert!(NewFile::at(&at("new"), false).unwrap().of_size(1).is_ok());
    }

    /// Parts of another file, of a process that runs and of one that still holds its lock stay.
    #[test]
    fn what_killed_attempts_left_goes() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        // No process has the number, which is above the kernel's largest.
        let part = |process: u32| at(&format!(".new.{}.{process}.part", machine()));
        let [dead, held] = [4_194_305, 4_194_306].map(part);
        // In a container every process has the same number.
        let own = part(std::process::id());
        let kept = [
            part(std::os::unix::process::parent_id()),
            at(".other.4194305.part"),
            at(".new.x.part"),
            at(".new.elsewhere.4194305.part"),
        ];
        for path in kept.iter().chain([&dead, &held, &own]) {
            fs::write(path, "part").unwrap();
        }
        let lock = File::open(&held).unwrap();
        lock.try_lock().unwrap();
        NewFile::at(&at("new"), false).unwrap().write_all(b"whole").unwrap();
        assert!(!dead.exists() && !own.exists() && held.exists() && kept.iter().all(|path| path.exists()));
        assert_eq!(fs::read(at("new")).unwrap(), b"whole");
        drop(lock);
        NewFile::at(&at("new"), true).unwrap().write_all(b"again").unwrap();
        assert!(!held.exists());
    }
}
