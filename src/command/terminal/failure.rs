//! What goes wrong, told to a person at a terminal: code, what, where, what to do.

use super::argument;
use pipeline::{Error, Fault, MODEL_GIVEN};
use service::telemetry::visible;
use std::io::ErrorKind;
use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::process::ExitCode;

/// What a model is for, to whoever takes it, or a part of it, for a ray file.
const OF_MODELS: &str = "Make rays of the model with lampwright rays; lampwright evaluate, combine and adapter take it too. Its report.json \
                         says what was found in the rays it was made of.";

/// Why a command failed, as it is printed on the terminal.
#[derive(Debug, PartialEq, Eq)]
pub struct Failure {
    /// Stable code, `stage.what`.
    code: String,
    /// What is wrong in this case.
    found: String,
    /// Where the problem is.
    place: Option<String>,
    /// What the client or the operator can do about it.
    remedy: Option<String>,
    /// 1: input refused or failed; 2: wrong usage.
    exit: u8,
}

impl Failure {
    /// A failure of wrong usage: exit code 2.
    pub fn usage(code: &str, found: impl Into<String>, remedy: impl Into<String>) -> Failure {
        Failure { exit: 2, ..Failure::failed(code, found, remedy) }
    }

    /// A failure of the command itself: exit code 1.
    pub fn failed(code: &str, found: impl Into<String>, remedy: impl Into<String>) -> Failure {
        Failure { code: code.to_owned(), found: found.into(), place: None, remedy: Some(remedy.into()), exit: 1 }
    }

    /// The failure of an operation on the file or folder `path`.
    pub fn disk(path: &Path, error: &std::io::Error) -> Failure {
        let remedy = match error.kind() {
            ErrorKind::NotFound => "See to the name: no such file or folder is there.",
            ErrorKind::PermissionDenied => "See to the permissions of the file and of its folder.",
            ErrorKind::StorageFull | ErrorKind::QuotaExceeded => "Free space, or name a place on another disk.",
            ErrorKind::IsADirectory => "Name a file; this is a folder.",
            ErrorKind::NotADirectory => "Name a folder where a file is named on the way.",
            ErrorKind::ReadOnlyFilesystem => "Name a place on a disk that can be written to.",
            _ => "Check that the file exists and that its permissions allow this.",
        };
        Failure::failed("file.disk", error.to_string(), remedy).at(path.display().to_string())
    }

    /// The service's folder cannot be written: mostly because it is another user's, as a folder of the host is that is mounted
    /// into a container.
    pub fn folder(code: &str, folder: &Path, error: &std::io::Error) -> Failure {
        let owner = |path: &Path| std::fs::metadata(path).ok().map(|found| found.uid());
        // The kernel shows a process to itself as what it is.
        let user = owner(Path::new("/proc/self")).map_or("its user".to_owned(), |uid| format!("user {uid}"));
        let belongs = folder.ancestors().find_map(owner).map_or(String::new(), |uid| {
            format!(" The folder, or the one that it would be made in, belongs to user {uid}.")
        });
        let found = format!("The folder cannot be written: {error}. This process runs as {user}.{belongs}");
        let remedy = format!(
            "Give the folder to {user} (chown -R, on the host where it is mounted from there), or run this as the folder's owner \
             (docker run --user UID:GID), or name another folder with --data."
        );
        Failure::failed(code, found, remedy).at(folder.display().to_string())
    }

    /// The same failure, in a place: a file, an option.
    pub fn at(self, place: impl Into<String>) -> Failure {
        let place = match self.place {
            Some(inner) => format!("{}, {inner}", place.into()),
            None => place.into(),
        };
        Failure { place: Some(place), ..self }
    }

    /// Prints it on stderr; the exit code.
    pub fn report(self) -> ExitCode {
        eprintln!("{self}");
        ExitCode::from(self.exit)
    }
}

impl std::fmt::Display for Failure {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        // What was found may be told in the words of a file, and the place be its name.
        write!(f, "error {}\n  what   {}", self.code, visible(&self.found))?;
        if let Some(place) = &self.place {
            write!(f, "\n  where  {}", visible(place))?;
        }
        if let Some(remedy) = &self.remedy {
            write!(f, "\n  do     {}", visible(remedy))?;
        }
        Ok(())
    }
}

impl From<clap::Error> for Failure {
    /// A flag or a value is missing, is not known, or does not go with another.
    fn from(error: clap::Error) -> Failure {
        let text = error.to_string();
        let one_line = |paragraph: &str| paragraph.split_whitespace().collect::<Vec<_>>().join(" ");
        let (found, rest) = text.split_once("\n\n").unwrap_or((&text, ""));
        // A paragraph each: hints, how the verb is used (in one way a line), where there is more.
        let sentence = |paragraph: &str| {
            let lines: Vec<String> = paragraph.lines().map(one_line).filter(|line| !line.is_empty()).collect();
            let told = lines.join(if paragraph.trim_start().starts_with("Usage:") { ", or " } else { " " });
            if told.is_empty() || told.ends_with('.') { told } else { format!("{told}.") }
        };
        let remedy: Vec<String> = rest.split("\n\n").map(sentence).filter(|told| !told.is_empty()).collect();
        Failure::usage("command.line", one_line(found.trim_start_matches("error: ")), remedy.join(" "))
    }
}

impl From<Error> for Failure {
    fn from(error: Error) -> Failure {
        let code = error.code().to_owned();
        let told = |fault: Fault, exit: u8| Failure {
            code: code.clone(),
            remedy: Some(match code == MODEL_GIVEN {
                true => OF_MODELS.to_owned(),
                false => argument::in_flags(&argument::with_keys(&fault.remedy, fault.at.as_ref())),
            }),
            found: argument::in_flags(&fault.found),
            place: fault.at.as_ref().map(argument::place),
            exit,
        };
        match error {
            Error::Malformed(fault) | Error::Refused(fault) => told(fault, 1),
            Error::Unusable(fault) => told(fault, 2),
            other => Failure { code, found: other.to_string(), place: None, remedy: None, exit: 1 },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_refusal_says_code_what_where_and_what_to_do() {
        let error = Error::malformed("tm25.magic", "The first bytes are not TM25.", "Is it a ray file?").at_byte(0);
        let failure = Failure::from(error).at("lamp.ray");
        assert_eq!(failure.exit, 1);
        assert_eq!(
            failure.to_string(),
            "error tm25.magic\n  what   The first bytes are not TM25.\n  where  lamp.ray, byte 0\n  do     Is it a ray file?"
        );
    }

    #[test]
    fn a_wrong_line_has_a_code_and_stands_on_three_lines() {
        let command = clap::Command::new("lampwright").arg(clap::Arg::new("columns").long("columns"));
        let failure = Failure::from(command.try_get_matches_from(["lampwright", "--colums", "3"]).unwrap_err());
        let told = failure.to_string();
        assert!(
            failure.exit == 2
                && told.starts_with("error command.line\n  what   unexpected argument '--colums' found\n  do     ")
        );
        assert!(told.lines().count() == 3 && told.contains("'--columns'") && told.contains("--help"), "{told}");
        let command = clap::Command::new("lampwright")
            .arg(clap::Arg::new("data").long("data"))
            .subcommand(clap::Command::new("build"))
            .args_conflicts_with_subcommands(true);
        let told = Failure::from(command.try_get_matches_from(["lampwright", "biuld"]).unwrap_err()).to_string();
        let remedy = "tip: a similar subcommand exists: 'build'. Usage: lampwright [OPTIONS], or lampwright <COMMAND>. For more information, try '--help'.";
        assert!(told.ends_with(&format!("\n  do     {remedy}")), "{told}");
    }

    #[test]
    fn a_wrong_option_is_wrong_usage() {
        let error = Error::unusable("hull.resolution", "hull.resolution", "It is 3.", "Give 4 to 256.");
        let failure = Failure::from(error);
        assert_eq!(failure.exit, 2);
        assert!(failure.to_string().contains("where  --resolution\n"), "{failure}");
    }
}
