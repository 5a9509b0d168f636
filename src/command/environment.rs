//! Environment variables that stand for arguments: an empty one counts as absent, and an unknown one gives a warning with the most
//! similar name.

use clap::Command;
use service::telemetry::visible;
use std::ffi::{OsStr, OsString};

/// Prefix of the variables of this program, except for the few that other programs use too.
const PREFIX: &str = "LAMPWRIGHT_";
/// Least likeness (Jaro-Winkler, 0 to 1) at which a name is offered for another.
const ALIKE: f64 = 0.8;

/// `command`, whose arguments no longer look at variables that are empty. Compose files and unit files set them so for "not
/// given": `LAMPWRIGHT_MEMORY=${MEMORY:-}`.
pub fn without_empty(command: Command) -> Command {
    without(command, &|name| std::env::var_os(name).is_some_and(|value| value.is_empty()))
}

fn without(command: Command, ignored: &impl Fn(&OsStr) -> bool) -> Command {
    let command = command.mut_args(|argument| match argument.get_env() {
        Some(name) if ignored(name) => argument.env(None::<&'static str>),
        _ => argument,
    });
    command.mut_subcommands(|verb| without(verb, ignored))
}

/// One warning for each variable of the process that has the prefix of this program and that no argument of `command` reads.
pub fn unread(command: &Command) -> Vec<String> {
    unread_of(command, std::env::vars_os().map(|(name, _)| name))
}

fn unread_of(command: &Command, set: impl Iterator<Item = OsString>) -> Vec<String> {
    let mut known = vec![service::crash::VARIABLE.to_owned()];
    collect(command, &mut known);
    let mut names: Vec<String> = set.filter_map(|name| name.into_string().ok()).collect();
    names.sort();
    let ours = |name: &String| {
        name.to_ascii_uppercase().starts_with(PREFIX) && !known.contains(name) && !is_of_kubernetes(name)
    };
    names.into_iter().filter(ours).map(|name| warning(&name, &known)).collect()
}

/// What Kubernetes sets in every container beside a Service called `lampwright`.
fn is_of_kubernetes(name: &str) -> bool {
    let rest = name.strip_prefix(PREFIX).unwrap_or_default();
    rest == "PORT" || ["PORT_", "SERVICE_HOST", "SERVICE_PORT"].iter().any(|known| rest.starts_with(known))
}

fn warning(name: &str, known: &[String]) -> String {
    let written = name.to_ascii_uppercase();
    // ROLE, DATABASE_URL and STORAGE_URL have no prefix; who gives them one means them.
    let bare = written.strip_prefix(PREFIX).unwrap_or_default();
    let likeness = |known: &str| strsim::jaro_winkler(bare, known.strip_prefix(PREFIX).unwrap_or(known));
    let nearest = known.iter().map(|known| (known, likeness(known)));
    let nearest = nearest.max_by(|(_, one), (_, other)| one.total_cmp(other));
    match nearest.filter(|(_, likeness)| *likeness >= ALIKE) {
        Some((similar, _)) => {
            format!("The variable {name} is not known and has no effect. Did you mean {similar}?", name = visible(name))
        }
        None => format!(
            "The variable {name} is not known and has no effect. `lampwright serve --help` lists all variables.",
            name = visible(name)
        ),
    }
}

/// Adds the variables that `command` and its verbs read.
fn collect(command: &Command, known: &mut Vec<String>) {
    let read = command.get_arguments().filter_map(|argument| argument.get_env()?.to_str());
    known.extend(read.map(str::to_owned));
    command.get_subcommands().for_each(|verb| collect(verb, known));
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::{Arg, ArgMatches};

    fn command() -> Command {
        let memory = Arg::new("memory").long("memory").env("LAMPWRIGHT_MEMORY");
        let serve = Command::new("serve").arg(Arg::new("role").long("role").env("ROLE"));
        // A variable that is set wherever tests run, and never empty.
        let path = Arg::new("path").long("path").env("PATH");
        Command::new("lampwright").args([memory, path]).subcommand(serve)
    }

    fn unread(names: &[&str]) -> Vec<String> {
        unread_of(&command(), names.iter().map(OsString::from))
    }

    #[test]
    fn a_variable_that_is_ignored_is_as_if_absent() {
        let value = |matches: ArgMatches| matches.get_one::<String>("path").cloned();
        let read = command().try_get_matches_from(["lampwright"]).unwrap();
        assert_eq!(value(read), std::env::var("PATH").ok());
        let ignoring = without(command(), &|name| name == "PATH");
        assert_eq!(value(ignoring.try_get_matches_from(["lampwright"]).unwrap()), None);
    }

    #[test]
    fn a_misspelt_variable_is_told_with_the_nearest_name() {
        for (written, meant) in [
            ("LAMPWRIGHT_MEMROY", "LAMPWRIGHT_MEMORY"),
            ("LAMPWRIGHT_MEM", "LAMPWRIGHT_MEMORY"),
            ("lampwright_memory", "LAMPWRIGHT_MEMORY"),
            ("LAMPWRIGHT_ROLE", "Did you mean ROLE"),
        ] {
            let warnings = unread(&[written]);
            assert!(
                warnings.len() == 1 && warnings[0].contains(written) && warnings[0].contains(meant),
                "{warnings:?}"
            );
        }
        assert!(unread(&["LAMPWRIGHT_QUX"])[0].contains("--help"));
    }

    #[test]
    fn what_is_read_and_what_is_not_ours_is_not_told() {
        assert_eq!(unread(&["LAMPWRIGHT_MEMORY", "ROLE", "ROLL", "PATH", "LAMPWRIGHT"]), [""; 0]);
    }
}
