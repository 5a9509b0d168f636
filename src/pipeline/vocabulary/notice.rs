//! What was repaired, dropped or refused while reading: counted per stable code, with the first offender.

use serde::Serialize;
use std::collections::BTreeMap;

/// One kind of thing that happened, and how often.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Notice {
    /// Stable code, `stage.what`: programs may depend on it.
    pub code: &'static str,
    /// How often.
    pub count: u64,
    /// Index of the first ray it happened to, counted from 0 in the file; `None` where it concerns no single ray.
    pub first_ray: Option<u64>,
    /// A sentence for a person: what was found, and what was done. May be reworded.
    pub message: String,
}

/// Notices by code. Merging is commutative, so the result does not depend on the number of threads.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Notices(BTreeMap<&'static str, Notice>);

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
        match self.0.get_mut(code) {
            Some(notice) => {
                notice.count += count;
                notice.first_ray = match (notice.first_ray, first_ray) {
                    (Some(a), Some(b)) => Some(a.min(b)),
                    (a, b) => a.or(b),
                };
            }
            None => {
                self.0.insert(code, Notice { code, count, first_ray, message: message.into() });
            }
        }
    }

    /// Adds all of `other`.
    pub fn merge(&mut self, other: &Notices) {
        for notice in other.0.values() {
            self.count(notice.code, notice.count, notice.first_ray, notice.message.clone());
        }
    }

    /// How often `code` was noticed.
    pub fn count_of(&self, code: &str) -> u64 {
        self.0.get(code).map_or(0, |notice| notice.count)
    }

    /// All, by code.
    pub fn iter(&self) -> impl Iterator<Item = &Notice> {
        self.0.values()
    }

    /// All, by code, as a list.
    pub fn to_vec(&self) -> Vec<Notice> {
        self.iter().cloned().collect()
    }
}
