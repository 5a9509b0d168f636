//! Where a verb writes: no file is replaced unasked, and a folder for results stays only where something is in it.

use super::failure::Failure;
use std::fs;
use std::path::{Path, PathBuf};

/// The folder for results. What was made of it goes again, where nothing was written to it.
pub struct NewFolder {
    /// The folders that were not there, the innermost first.
    made: Vec<PathBuf>,
}

impl NewFolder {
    /// Makes the folder, before there is something to write: whether that can be is known before the work. An earlier model in the
    /// same folder would leave zones behind that the new one does not have.
    ///
    /// # Errors
    /// The folder is not empty, or the disk refuses an operation.
    pub fn make(folder: &Path) -> Result<NewFolder, Failure> {
        let disk = |error: std::io::Error| Failure::disk(folder, &error);
        let missing = folder.ancestors().take_while(|part| !part.exists() && !part.as_os_str().is_empty());
        let new = NewFolder { made: missing.map(Path::to_owned).collect() };
        fs::create_dir_all(folder).map_err(disk)?;
        if fs::read_dir(folder).map_err(disk)?.next().is_some() {
            let found = "The folder for the results is not empty.";
            return Err(Failure::usage("build.output", found, "Empty the folder, or name another.")
                .at(folder.display().to_string()));
        }
        Ok(new)
    }
}

impl Drop for NewFolder {
    fn drop(&mut self) {
        // A folder in which something is cannot be removed, and those round it neither.
        for folder in &self.made {
            if fs::remove_dir(folder).is_err() {
                return;
            }
        }
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
        let kept = NewFolder::make(&at("mine/c/d")).unwrap();
        fs::write(at("mine/c/d/report.json"), "{}").unwrap();
        drop(kept);
        assert!(at("mine/c/d/report.json").is_file());
    }
}
