//! What was repaired, dropped or refused while reading: counted per stable code, with the first offender.

use schemars::JsonSchema;
use serde::Serialize;
use std::borrow::Cow;
use std::collections::BTreeMap;

/// One kind of thing that happened, and how often.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct Notice {
    /// Stable code, `stage.what`: programs may depend on it.
    #[schemars(regex(pattern = r"^[a-z]+\.[a-z0-9_]+$"))]
    pub code: Cow<'static, str>,
    /// The channel it concerns, by its name; `null` where it concerns the whole source, or a file that is no channel yet.
    pub channel: Option<String>,
    /// How often.
    #[schemars(range(min = 1))]
    pub count: u64,
    /// Index of the first ray it happened to, counted from 0 in the file; `null` where it concerns no single ray.
    pub first_ray: Option<u64>,
    /// A sentence for a person: what was found, and what was done. May be reworded.
    pub message: String,
}

/// What makes two notices one: the code, and the index of the channel; names of channels may be the same.
type Key = (Cow<'static, str>, Option<usize>);

/// Notices by code, then by channel. Merging is commutative, so the result does not depend on the number of threads.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Notices(BTreeMap<Key, Notice>);

impl Notices {
    /// Something about the whole file or model.
    pub fn add(&mut self, code: &'static str, message: impl Into<String>) {
        self.count(code, 1, None, message);
    }

    /// Something about one ray.
    pub fn add_ray(&mut self, code: &'static str, ray: u64, message: &'static str) {
        self.count(code, 1, Some(ray), message);
    }

    /// Something that happened `count` times, first to `first_ray`.
    pub fn count(&mut self, code: &'static str, count: u64, first_ray: Option<u64>, message: impl Into<String>) {
        let code = Cow::Borrowed(code);
        self.take(None, Notice { code, channel: None, count, first_ray, message: message.into() });
    }

    /// Takes every notice of this code out; the first, where there was one.
    pub fn take_out(&mut self, code: &str) -> Option<Notice> {
        let first = self.iter().find(|notice| notice.code == code).cloned();
        self.0.retain(|(other, _), _| other != code);
        first
    }

    /// Adds all of `other`.
    pub fn merge(&mut self, other: &Notices) {
        for ((_, channel), notice) in &other.0 {
            self.take(*channel, notice.clone());
        }
    }

    /// Adds `notices`, all of which concern the channel `index`, called `name`.
    pub fn merge_of_channel<'n>(&mut self, index: usize, name: &str, notices: impl IntoIterator<Item = &'n Notice>) {
        for notice in notices {
            self.take(Some(index), Notice { channel: Some(name.to_owned()), ..notice.clone() });
        }
    }

    /// Adds one. Of two with the same key the first keeps its message.
    fn take(&mut self, channel: Option<usize>, new: Notice) {
        match self.0.get_mut(&(new.code.clone(), channel)) {
            Some(notice) => {
                notice.count += new.count;
                notice.first_ray = match (notice.first_ray, new.first_ray) {
                    (Some(a), Some(b)) => Some(a.min(b)),
                    (a, b) => a.or(b),
                };
            }
            None => {
                self.0.insert((new.code.clone(), channel), new);
            }
        }
    }

    /// How often `code` was noticed, of all channels together.
    pub fn count_of(&self, code: &str) -> u64 {
        self.iter().filter(|notice| notice.code == code).map(|notice| notice.count).sum()
    }

    /// All, by code and channel.
    pub fn iter(&self) -> impl Iterator<Item = &Notice> {
        self.0.values()
    }

    /// All, by code and channel, as a list.
    pub fn to_vec(&self) -> Vec<Notice> {
        self.iter().cloned().collect()
    }
}
