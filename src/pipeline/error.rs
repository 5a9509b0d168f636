//! What can go wrong. Malformed, refused by policy, and asked for wrongly are different answers, each with a stable code
//! (`stage.what`); what is merely repaired or dropped is a [`crate::vocabulary::notice::Notice`] instead.

use std::fmt;

/// Longest number that is told digit by digit, characters.
const LONGEST_NUMBER: usize = 24;

/// Why there is no result.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The bytes are wrong.
    #[error("{0}")]
    Malformed(Fault),
    /// The bytes may be right, but a limit or a rule of ours says no.
    #[error("{0}")]
    Refused(Fault),
    /// The options do not fit together or not this source.
    #[error("{0}")]
    Unusable(Fault),
    /// The watcher said that nobody waits any more.
    #[error("cancelled")]
    Cancelled,
    /// The bytes could not be had: what was asked for them failed.
    #[error("the bytes could not be read: {0}")]
    Unreadable(#[from] std::io::Error),
    /// A fault of this program, whatever the input: a result that cannot be written, a computation that panicked.
    #[error("a fault of this program: {0}")]
    Internal(String),
}

/// What was found, where, and what to do about it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    /// Stable: programs may depend on it.
    pub code: &'static str,
    /// What was found; a sentence.
    pub found: String,
    /// Byte offset in the file, the name of the option, or a field of a declaration.
    pub at: Option<Place>,
    /// What to do; a sentence.
    pub remedy: String,
}

/// Where a fault is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Place {
    /// Byte offset in the ray file.
    Byte(u64),
    /// Index of a ray in its file, from 0.
    Ray(u64),
    /// Path of an option, dots between names.
    Option(&'static str),
    /// What was declared of a channel: its place in the source, from 0, and the field.
    Channel(usize, &'static str),
    /// What was declared of a file by itself, before it is a channel: the field.
    Declared(&'static str),
    /// The declared total of the source.
    Total,
    /// A field of what was asked of a model.
    Asked(&'static str),
    /// A field of what was asked of one of several models: its place among them, from 0, and the field.
    Model(usize, &'static str),
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Place::Byte(offset) => write!(f, "byte {offset}"),
            Place::Ray(index) => write!(f, "ray {index}"),
            Place::Option(path) => write!(f, "options.{path}"),
            Place::Channel(index, field) => write!(f, "channels[{index}].{field}"),
            Place::Declared(field) => write!(f, "{field}"),
            Place::Total => write!(f, "total"),
            Place::Asked(field) => write!(f, "{field}"),
            Place::Model(index, field) => write!(f, "models[{index}].{field}"),
        }
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.found)?;
        if let Some(place) = &self.at {
            write!(f, " (at {place})")?;
        }
        write!(f, " {}", self.remedy)
    }
}

impl Fault {
    fn new(code: &'static str, found: impl Into<String>, remedy: impl Into<String>) -> Fault {
        Fault { code, found: shortened(found.into()), at: None, remedy: remedy.into() }
    }
}

impl Error {
    /// The bytes are wrong.
    pub fn malformed(code: &'static str, found: impl Into<String>, remedy: impl Into<String>) -> Error {
        Error::Malformed(Fault::new(code, found, remedy))
    }

    /// A limit or rule of ours says no.
    pub fn refused(code: &'static str, found: impl Into<String>, remedy: impl Into<String>) -> Error {
        Error::Refused(Fault::new(code, found, remedy))
    }

    /// The options cannot be used.
    pub fn unusable(
        code: &'static str,
        option: &'static str,
        found: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Error {
        Error::Unusable(Fault { at: Some(Place::Option(option)), ..Fault::new(code, found, remedy) })
    }

    /// What was declared of the source, or asked of a model, cannot be used.
    pub fn invalid_declaration(
        code: &'static str,
        place: Place,
        found: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Error {
        Error::Unusable(Fault { at: Some(place), ..Fault::new(code, found, remedy) })
    }

    /// The same error, at a byte offset.
    pub fn at_byte(self, offset: u64) -> Error {
        self.at(Place::Byte(offset))
    }

    /// The same error, at a ray.
    pub fn at_ray(self, index: u64) -> Error {
        self.at(Place::Ray(index))
    }

    /// The same error, at what was declared of a channel.
    pub fn at_channel(self, index: usize, field: &'static str) -> Error {
        self.at(Place::Channel(index, field))
    }

    /// The same error; where it names a field of a declaration, that of channel `index`.
    pub fn of_channel(self, index: usize) -> Error {
        match &self {
            Error::Malformed(fault) | Error::Refused(fault) | Error::Unusable(fault) => match fault.at {
                Some(Place::Channel(_, field)) => self.at_channel(index, field),
                _ => self,
            },
            _ => self,
        }
    }

    /// The same error; where it names a field of what was asked, that of model `index` of several.
    pub fn of_model(self, index: usize) -> Error {
        match &self {
            Error::Malformed(fault) | Error::Refused(fault) | Error::Unusable(fault) => match fault.at {
                Some(Place::Asked(field)) => self.at(Place::Model(index, field)),
                _ => self,
            },
            _ => self,
        }
    }

    /// The same, where it is of one of several things: `whose` goes before what was found.
    #[must_use]
    pub fn of_one(self, whose: &str) -> Error {
        let told = |fault: Fault| Fault { found: format!("{whose}: {}", fault.found), ..fault };
        match self {
            Error::Malformed(fault) => Error::Malformed(told(fault)),
            Error::Refused(fault) => Error::Refused(told(fault)),
            Error::Unusable(fault) => Error::Unusable(told(fault)),
            other => other,
        }
    }

    fn at(self, place: Place) -> Error {
        let put = |fault: Fault| Fault { at: Some(place), ..fault };
        match self {
            Error::Malformed(fault) => Error::Malformed(put(fault)),
            Error::Refused(fault) => Error::Refused(put(fault)),
            Error::Unusable(fault) => Error::Unusable(put(fault)),
            other => other,
        }
    }

    /// What was found, without its place and what to do.
    pub fn found(&self) -> &str {
        match self {
            Error::Malformed(fault) | Error::Refused(fault) | Error::Unusable(fault) => &fault.found,
            Error::Cancelled | Error::Unreadable(_) | Error::Internal(_) => self.code(),
        }
    }

    /// Stable code of any error.
    pub fn code(&self) -> &'static str {
        match self {
            Error::Malformed(fault) | Error::Refused(fault) | Error::Unusable(fault) => fault.code,
            Error::Cancelled => "run.cancelled",
            Error::Unreadable(_) => "bytes.unreadable",
            Error::Internal(_) => "run.internal",
        }
    }
}

/// The same text with its long numbers short: 1e300 is no row of 301 digits.
fn shortened(text: String) -> String {
    let is_part = |letter: char| letter.is_ascii_digit() || letter == '.';
    let mut short = String::with_capacity(text.len());
    let mut rest = text.as_str();
    while let Some(from) = rest.find(is_part) {
        let (before, after) = rest.split_at(from);
        let (number, next) = after.split_at(after.find(|letter| !is_part(letter)).unwrap_or(after.len()));
        short.push_str(before);
        let end = number.trim_end_matches('.');
        match end.parse::<f64>() {
            Ok(value) if end.len() > LONGEST_NUMBER => {
                short.push_str(&format!("{value:e}"));
                short.push_str(&number[end.len()..]);
            }
            _ => short.push_str(number),
        }
        rest = next;
    }
    short.push_str(rest);
    short
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_numbers_are_told_with_an_exponent() {
        for (value, told) in
            [(1e300, "1e300 mm is no size."), (-2.5e-200, "-2.5e-200 mm is no size."), (1.25, "1.25 mm is no size.")]
        {
            assert_eq!(shortened(format!("{value} mm is no size.")), told);
        }
        let text = "sha256 6773085f24015efeb990be022d993e6fa5ae882ec95d73070ff8fb349cd86fc2, 20000 rays. 3.5 W...";
        assert_eq!(shortened(text.to_owned()), text);
        assert_eq!(shortened(format!("It is {}.", 1e30)), "It is 1e30.");
    }
}
