//! The pipeline's options as flags: one for each field of their schema, in its words; --no-NAME for all switches of that name. A
//! field that is added there is a flag here.

use super::terminal::argument;
use clap::builder::{StringValueParser, TypedValueParser};
use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{Arg, ArgAction, ArgMatches, Args, Command, Error, FromArgMatches};
use pipeline::Options;
use serde_json::{Map, Value, json};
use std::collections::HashSet;

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
    /// A whole number.
    Whole,
    /// A number.
    Number,
    /// One of these words, or its end: 2019 for LM-63-2019.
    Word(Vec<String>),
    /// AxB: the values of these two fields.
    Pair(String, String),
    /// first:last:step, or values between commas.
    List,
    /// Without a value: the flag turns off what is on by default.
    Switch,
}

impl Field {
    /// Every field.
    fn all() -> Vec<Field> {
        let schema = Options::schema().to_value();
        let at = |reference: &Value| reference.as_str().and_then(|path| schema.pointer(path.trim_start_matches('#')));
        let mut fields = Vec::new();
        for (group, part) in schema["properties"].as_object().into_iter().flatten() {
            let properties = at(&part["$ref"]).map(|part| &part["properties"]).and_then(Value::as_object);
            for (name, property) in properties.into_iter().flatten() {
                let inner = property["anyOf"].get(0).and_then(|choice| at(&choice["$ref"])).unwrap_or(property);
                let kind = Kind::of(inner);
                let help = property["description"].as_str().unwrap_or_default().trim_end_matches('.').to_owned();
                let (group, name) = (group.clone(), name.clone());
                let flag = match kind {
                    Kind::Switch => format!("no-{}", argument::flag(&name)),
                    _ => argument::flag(&name),
                };
                fields.push(Field { flag, group, name, help, kind });
            }
        }
        fields
    }

    fn argument(&self) -> Arg {
        let argument = Arg::new(self.flag.clone()).long(self.flag.clone());
        if let Kind::Switch = self.kind {
            return argument.help(format!("Turns {} off wherever it is applied", self.name)).action(ArgAction::SetTrue);
        }
        let kind = self.kind.clone();
        let parser = StringValueParser::new().try_map(move |text| kind.parse(&text));
        let value_name = match &self.kind {
            Kind::Whole | Kind::Number => self.name.rsplit('_').next().unwrap_or_default().to_uppercase(),
            Kind::Word(words) => words.join("|"),
            Kind::Pair(a, b) => format!("{}x{}", a.to_uppercase(), b.to_uppercase()),
            Kind::List | Kind::Switch => "FIRST:LAST:STEP".to_owned(),
        };
        argument.value_name(value_name).help(self.help.clone()).allow_hyphen_values(true).value_parser(parser)
    }
}

impl Kind {
    fn of(schema: &Value) -> Kind {
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
            _ if !constants.is_empty() => Kind::Word(constants),
            _ if is("boolean") => Kind::Switch,
            _ if is("array") => Kind::List,
            Some([Value::String(a), Value::String(b)]) => Kind::Pair(a.clone(), b.clone()),
            _ if is("integer") => Kind::Whole,
            _ => Kind::Number,
        }
    }

    fn parse(&self, text: &str) -> Result<Value, String> {
        let whole = |text: &str| text.parse::<u32>().ok().map(Value::from);
        let number = |text: &str| text.parse::<f64>().ok().filter(|number| number.is_finite()).map(Value::from);
        match self {
            Kind::Whole => whole(text).ok_or_else(|| "write a whole number".to_owned()),
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
                let sides = text.split_once(['x', 'X']).and_then(|(x, y)| Some(json!({ a: whole(x)?, b: whole(y)? })));
                sides.ok_or_else(|| format!("write {a} x {b}, as 4x4"))
            }
            Kind::List if text.contains(',') => text
                .split(',')
                .map(number)
                .collect::<Option<Vec<_>>>()
                .map(Value::from)
                .ok_or_else(|| "write numbers between commas".to_owned()),
            Kind::Switch => Ok(json!(false)),
            Kind::List => argument::bands(text).map(|bands| json!(bands.edges_nm())),
        }
    }
}

impl Args for Choices {
    fn augment_args(command: Command) -> Command {
        let mut flags = HashSet::new();
        let fields = Field::all().into_iter().filter(|field| flags.insert(field.flag.clone()));
        command.args(fields.map(|field| field.argument()))
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
            let value = match field.kind {
                Kind::Switch => matches.get_flag(&field.flag).then_some(json!(false)),
                _ => matches.get_one::<Value>(&field.flag).cloned(),
            };
            if let Some(value) = value {
                choose(&field.group, &field.name, value);
            }
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

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashMap;

    /// A flag stands for one field, or for the switches of one name.
    #[test]
    fn no_two_fields_share_a_flag() {
        let mut flags: HashMap<String, Vec<Field>> = HashMap::new();
        for field in Field::all() {
            flags.entry(field.flag.clone()).or_default().push(field);
        }
        for (flag, fields) in flags {
            let switches = fields.iter().all(|field| matches!(field.kind, Kind::Switch));
            assert!(fields.len() == 1 || switches, "--{flag} stands for {} fields", fields.len());
        }
    }
}
