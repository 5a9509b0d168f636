//! The pipeline's options as flags: one for each field of their schema, in its words. A field that is added there is a flag here.

use super::terminal::argument;
use clap::builder::{StringValueParser, TypedValueParser};
use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{Arg, ArgAction, ArgMatches, Args, Command, Error, FromArgMatches};
use pipeline::Options;
use serde_json::{Map, Value, json};

/// The flag that stands for every field of this name: results as they were counted.
const SMOOTHING: &str = "smoothing";

/// What the flags choose; what is not given is the pipeline's default.
#[derive(Clone, Debug, Default)]
pub struct Choices(pub Options);

/// One field of the options.
struct Field {
    /// Its group and its name, as in a request.
    group: String,
    name: String,
    /// The flag, without dashes.
    flag: String,
    /// What it means, as in the contract.
    help: String,
    kind: Kind,
}

/// How the value of a flag is written.
#[derive(Clone)]
enum Kind {
    /// As in JSON.
    Number,
    /// One of these words, or its end: 2019 for LM-63-2019.
    Word(Vec<String>),
    /// AxB: the values of these two fields.
    Pair(String, String),
    /// first:last:step, or values between commas.
    List,
}

impl Field {
    /// Every field but the switches.
    fn all() -> Vec<Field> {
        let schema = Options::schema().to_value();
        let at = |reference: &Value| reference.as_str().and_then(|path| schema.pointer(path.trim_start_matches('#')));
        let mut fields = Vec::new();
        for (group, part) in schema["properties"].as_object().into_iter().flatten() {
            let properties = at(&part["$ref"]).map(|part| &part["properties"]).and_then(Value::as_object);
            for (name, property) in properties.into_iter().flatten() {
                let inner = property["anyOf"].get(0).and_then(|choice| at(&choice["$ref"])).unwrap_or(property);
                let Some(kind) = Kind::of(inner) else { continue };
                let help = property["description"].as_str().unwrap_or_default().trim_end_matches('.').to_owned();
                let (group, name) = (group.clone(), name.clone());
                fields.push(Field { flag: flag(&name), group, name, help, kind });
            }
        }
        fields
    }

    fn argument(&self) -> Arg {
        let kind = self.kind.clone();
        let parser = StringValueParser::new().try_map(move |text| kind.parse(&text));
        let placeholder = match &self.kind {
            Kind::Number => self.name.rsplit('_').next().unwrap_or_default().to_uppercase(),
            Kind::Word(words) => words.join("|"),
            Kind::Pair(a, b) => format!("{}x{}", a.to_uppercase(), b.to_uppercase()),
            Kind::List => "FIRST:LAST:STEP".to_owned(),
        };
        Arg::new(format!("{}.{}", self.group, self.name))
            .long(self.flag.clone())
            .value_name(placeholder)
            .help(self.help.clone())
            .allow_hyphen_values(true)
            .value_parser(parser)
    }
}

impl Kind {
    /// `None`: a switch, which has no value.
    fn of(schema: &Value) -> Option<Kind> {
        let is = |kind: &str| {
            schema["type"] == kind || schema["type"].as_array().is_some_and(|all| all.contains(&json!(kind)))
        };
        let words = |values: &Value, word: fn(&Value) -> &Value| -> Vec<String> {
            values
                .as_array()
                .into_iter()
                .flatten()
                .filter_map(|value| word(value).as_str().map(str::to_owned))
                .collect()
        };
        let constants =
            [words(&schema["enum"], |value| value), words(&schema["oneOf"], |value| &value["const"])].concat();
        let pair = schema["required"].as_array().map(Vec::as_slice);
        match pair {
            _ if !constants.is_empty() => Some(Kind::Word(constants)),
            _ if is("boolean") => None,
            _ if is("array") => Some(Kind::List),
            Some([Value::String(a), Value::String(b)]) => Some(Kind::Pair(a.clone(), b.clone())),
            _ => Some(Kind::Number),
        }
    }

    fn parse(&self, text: &str) -> Result<Value, String> {
        let number = |text: &str| {
            let number: Value = serde_json::from_str(text).ok().filter(Value::is_number)?;
            Some(number)
        };
        match self {
            Kind::Number => number(text).ok_or_else(|| "write a number".to_owned()),
            Kind::Word(words) => {
                let text = text.to_ascii_lowercase();
                let is = |word: &&String| {
                    let word = word.to_ascii_lowercase();
                    word == text
                        || word.trim_start_matches('+') == text
                        || word.rsplit('-').next() == Some(&text) && !word.starts_with('-')
                };
                words.iter().find(is).map(|word| json!(word)).ok_or_else(|| format!("write one of {}", words.join(" ")))
            }
            Kind::Pair(a, b) => {
                let sides =
                    text.split_once(['x', 'X']).and_then(|(x, y)| Some(json!({ a: number(x)?, b: number(y)? })));
                sides.ok_or_else(|| format!("write {a} x {b}, as 4x4"))
            }
            Kind::List if text.contains(',') => text
                .split(',')
                .map(number)
                .collect::<Option<Vec<_>>>()
                .map(Value::from)
                .ok_or_else(|| "write numbers between commas".to_owned()),
            Kind::List => argument::bands(text).map(|bands| json!(bands.edges_nm())),
        }
    }
}

/// `max_edge_mm` is --max-edge, `nadir_axis` is --nadir, `band_edges_nm` is --bands.
fn flag(name: &str) -> String {
    let short =
        ["_mm", "_deg", "_nm", "_axis"].into_iter().fold(name, |name, end| name.strip_suffix(end).unwrap_or(name));
    match short {
        "band_edges" => "bands".to_owned(),
        short => short.replace('_', "-"),
    }
}

impl Args for Choices {
    fn augment_args(command: Command) -> Command {
        let command = command.args(Field::all().iter().map(Field::argument));
        command.arg(
            Arg::new(SMOOTHING)
                .long("no-smoothing")
                .help("Do not smooth the flux and the goniograms")
                .action(ArgAction::SetTrue),
        )
    }

    fn augment_args_for_update(command: Command) -> Command {
        Choices::augment_args(command)
    }
}

impl FromArgMatches for Choices {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Choices, Error> {
        let mut choices = Choices::default();
        choices.update_from_arg_matches(matches)?;
        Ok(choices)
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), Error> {
        let mut groups: Map<String, Value> = Map::new();
        let mut choose = |group: &str, name: &str, value: Value| {
            if let Value::Object(fields) = groups.entry(group).or_insert_with(|| json!({})) {
                fields.insert(name.to_owned(), value);
            }
        };
        for field in Field::all() {
            if let Some(value) = matches.get_one::<Value>(&format!("{}.{}", field.group, field.name)) {
                choose(&field.group, &field.name, value.clone());
            }
        }
        if matches.get_flag(SMOOTHING) {
            ["flux", "goniogram"].into_iter().for_each(|group| choose(group, SMOOTHING, json!(false)));
        }
        self.0 = serde_json::from_value(Value::Object(groups)).map_err(|error| {
            let mut wrong = Error::new(ErrorKind::InvalidValue);
            wrong.insert(ContextKind::InvalidArg, ContextValue::String("an option".to_owned()));
            wrong.insert(ContextKind::InvalidValue, ContextValue::String(error.to_string()));
            wrong
        })?;
        Ok(())
    }
}
