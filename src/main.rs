//! The command line: reads arguments and nothing else. `lampwright --help` is its documentation.

/// The verbs, one file each.
mod command;

use clap::{Arg, Command, CommandFactory, FromArgMatches, Parser, Subcommand};
use command::{
    Failure, adapter, backup, build, combine, convert, environment, evaluate, health, inspect, keys, number, openapi,
    rays, sample, serve, tenants,
};
use std::any::TypeId;
use std::process::ExitCode;

/// Turns a light source's ray file into a continuous source model: hull mesh with spectra, zonal goniograms, IES files.
///
/// Without a verb it serves. Exit codes: 0 done, 1 input refused or failed, 2 wrong usage, 3 inspected and found wrong.
#[derive(Parser)]
#[command(version, args_conflicts_with_subcommands = true)]
struct CommandLine {
    #[command(subcommand)]
    verb: Option<Verb>,
    #[command(flatten)]
    serve: serve::Arguments,
}

#[derive(Subcommand)]
enum Verb {
    /// Run the service (the default).
    Serve(Box<serve::Arguments>),
    /// Build a model from ray files, without a server.
    Build(build::Arguments),
    /// Show the header of a ray file, and inspect its rays. Exit code 3 where the verdict is wrong: a job would refuse the file, or its model would
    /// be wrong.
    Inspect(inspect::Arguments),
    /// Write ray files as one file of IES TM-25, Zemax or LightTools binary; shuffled or thinned out where asked for.
    ///
    /// For example: lampwright convert lamp.tm25ray -o lamp.dat --take 1e6 --shuffle 7
    Convert(convert::Arguments),
    /// Draw new rays from a model, as many as are wanted, and write them as a ray file.
    Rays(rays::Arguments),
    /// Evaluate a model: intensity, irradiance on a plane, luminance as a camera sees it; as numbers or as a picture.
    Evaluate(evaluate::Arguments),
    /// Change models and make several one, without their rays: scaled in flux, turned, moved.
    Combine(combine::Arguments),
    /// Write a model as Blender, Mitsuba 3 or Radiance opens it: a folder of files for scenes of your own.
    Adapter(adapter::Arguments),
    /// Write a known source as an IES TM-25 ray file.
    Sample(sample::Arguments),
    /// Create, list, rotate and revoke the keys of a service.
    Keys(keys::Arguments),
    /// Show and set the quotas of the tenants of a service.
    Tenants(tenants::Arguments),
    /// Copy everything that a service stores, while it runs.
    Backup(backup::Arguments),
    /// Print the OpenAPI contract of the service.
    Openapi,
    /// Ask a running service whether it is well; for container health checks.
    Health(health::Arguments),
}

/// The words of the command line; what is no UTF-8 in one is replaced, for the library tells of it.
fn words() -> impl Iterator<Item = String> {
    std::env::args_os().skip(1).map(|word| word.to_string_lossy().into_owned())
}

fn main() -> ExitCode {
    let unread = environment::unread(&CommandLine::command());
    let command = with_negative_numbers(environment::without_empty(CommandLine::command()));
    if let Some(missing) = missing_value(&command, words()) {
        return Failure::from(missing).report();
    }
    let read = command.try_get_matches().and_then(|found| CommandLine::from_arg_matches(&found));
    let arguments = match read {
        Ok(arguments) => arguments,
        // Of a verb that wants another, its help is all that there is to tell.
        Err(told) if told.kind() == clap::error::ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => told.exit(),
        Err(error) if error.use_stderr() => return Failure::from(error.format(&mut CommandLine::command())).report(),
        // Help and version, which were asked for.
        Err(told) => told.exit(),
    };
    let verb = arguments.verb.unwrap_or_else(|| Verb::Serve(Box::new(arguments.serve)));
    if !matches!(verb, Verb::Serve(_)) {
        unread.iter().for_each(|told| eprintln!("warning: {told}"));
    }
    let done = match verb {
        Verb::Serve(arguments) => serve::run(&arguments, &unread),
        Verb::Build(arguments) => build::run(&arguments),
        Verb::Inspect(arguments) => return inspect::run(&arguments).unwrap_or_else(Failure::report),
        Verb::Convert(arguments) => convert::run(&arguments),
        Verb::Rays(arguments) => rays::run(&arguments),
        Verb::Evaluate(arguments) => evaluate::run(&arguments),
        Verb::Combine(arguments) => combine::run(&arguments),
        Verb::Adapter(arguments) => adapter::run(&arguments),
        Verb::Sample(arguments) => sample::run(&arguments),
        Verb::Keys(arguments) => keys::run(arguments),
        Verb::Tenants(arguments) => tenants::run(arguments),
        Verb::Backup(arguments) => backup::run(&arguments),
        Verb::Openapi => openapi::run(),
        Verb::Health(arguments) => health::run(&arguments),
    };
    done.map_or_else(Failure::report, |()| ExitCode::SUCCESS)
}

/// A number below 0 is a value, not a flag: what is wrong with it, if anything, is told in the words of its option.
fn with_negative_numbers(command: Command) -> Command {
    let lenient = |argument: Arg| {
        // Clap's own idea of negative numbers has no "-1e-3", and its words for what is none are a programmer's.
        let is_number = argument.get_value_parser().type_id() == TypeId::of::<f64>();
        if is_number { argument.allow_hyphen_values(true).value_parser(number) } else { argument }
    };
    command.allow_negative_numbers(true).mut_args(lenient).mut_subcommands(with_negative_numbers)
}

/// The error of a flag whose value is left out before another flag: what takes numbers below 0 would take that for its value.
fn missing_value(command: &Command, words: impl Iterator<Item = String>) -> Option<clap::Error> {
    let mut command = command.clone();
    // Before that, arguments do not know themselves how they are written.
    command.build();
    let (mut verb, mut before) = (&command, None::<&Arg>);
    for word in words.take_while(|word| word != "--") {
        let is_flag = |argument: &Arg| {
            let long = word.strip_prefix("--").map(|word| word.split('=').next().unwrap_or_default());
            let short = word.strip_prefix('-').filter(|word| word.len() == 1).and_then(|word| word.chars().next());
            long.is_some() && (argument.get_long() == long || long == Some("help"))
                || short.is_some() && argument.get_short() == short
        };
        let flag = verb.get_arguments().find(|argument| is_flag(argument));
        if let (Some(left), Some(_)) = (before, flag) {
            let told = format!("a value is required for '{left}' but none was supplied: '{word}' is a flag of its own");
            return Some(verb.clone().error(clap::error::ErrorKind::MissingRequiredArgument, told));
        }
        let takes = |argument: &&Arg| argument.get_action().takes_values() && argument.is_allow_hyphen_values_set();
        before = flag.filter(takes).filter(|_| !word.contains('='));
        verb = verb.find_subcommand(&word).filter(|_| flag.is_none()).unwrap_or(verb);
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_sound_and_serves_without_a_verb() {
        CommandLine::command().debug_assert();
        let verb = |line: &str| CommandLine::try_parse_from(line.split(' ')).map(|line| line.verb);
        assert!(matches!(verb("lampwright --listen 127.0.0.1:0"), Ok(None)));
        assert!(matches!(verb("lampwright serve --data x"), Ok(Some(Verb::Serve(_)))));
        assert_eq!(verb("lampwright build").err().map(|error| error.exit_code()), Some(2));
    }

    #[test]
    fn a_flag_is_no_value_of_the_flag_before_it() {
        let command = with_negative_numbers(CommandLine::command());
        let told = |line: &str| {
            missing_value(&command, line.split(' ').map(str::to_owned))
                .map(|error| (error.exit_code(), error.to_string()))
        };
        let plane = "evaluate out plane --center 0,0,1";
        for (line, flag) in [
            (format!("{plane} --width --height 2"), "'--width <MM>'"),
            (format!("{plane} --width -o x.svg"), "'--width <MM>'"),
            (format!("{plane} --normal --up=0,0,1"), "'--normal <X,Y,Z>'"),
            ("build a.ray --total --threads 2".to_owned(), "'--total <FLUX>'"),
            ("build a.ray --nadir -o out".to_owned(), "'--nadir"),
        ] {
            assert!(
                told(&line).is_some_and(|(code, told)| code == 2 && told.contains(flag)),
                "{line}: {:?}",
                told(&line)
            );
        }
        for line in [
            format!("{plane} --width 2 --height -2 --normal -1,0,0 -o x.svg"),
            "build -- --width --height".to_owned(),
            "serve --listen 127.0.0.1:0".to_owned(),
        ] {
            assert_eq!(told(&line), None, "{line}");
        }
    }
}
