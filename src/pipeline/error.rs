//! What can go wrong. Malformed, refused by policy, and asked for wrongly are different answers, each with a stable code
//! (`stage.what`); what is merely repaired or dropped is a [`crate::vocabulary::notice::Notice`] instead.

use std::fmt;

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
        Fault { code, found: found.into(), at: None, remedy: remedy.into() }
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
