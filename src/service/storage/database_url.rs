//! The file behind a `sqlite:` URL.

use percent_encoding::{AsciiSet, CONTROLS, percent_decode_str, utf8_percent_encode};
use std::path::{Path, PathBuf};

/// What stands for something else in a URL.
const SPECIAL: &AsciiSet = &CONTROLS.add(b'%').add(b'?').add(b'#');

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
}
