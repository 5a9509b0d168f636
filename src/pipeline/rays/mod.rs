//! 1. Files to rays.

/// What a user says of a file, before the file's own word.
pub mod declared;
/// From stored numbers to W and lm.
pub mod conversion;
/// What a ray must satisfy.
pub mod check;
/// Chunks in parallel, answers in order.
pub mod chunks;
/// Flux by direction on the faces of a cube.
pub mod direction_cube;
/// One reading of everything: totals, box, directions, notices.
pub mod survey;
/// Whether totals can be meant.
pub mod totals;
/// Which spectral bands a source gets.
pub mod bands;

pub use crate::formats::bytes::digest;
use crate::formats::record::Bytes;
pub use crate::vocabulary::declaration::{Declared, Total};

use crate::vocabulary::notice::Notice;
use std::sync::Arc;

/// One ray file as handed in.
#[derive(Clone)]
pub struct Input {
    /// What the user calls it; goes into provenance, decides nothing.
    pub name: String,
    /// SHA-256 of the bytes, lower-case hex; goes into provenance.
    pub sha256: String,
    /// The bytes.
    pub bytes: Arc<dyn Bytes>,
    /// What the user says of them.
    pub declared: Declared,
    /// What was noticed of the file, or of what is declared of it, before it came here: repairs of its spectrum, files that
    /// were left out where it was unpacked.
    pub notices: Vec<Notice>,
}

impl Input {
    /// What its channel is called.
    pub fn channel_name(&self) -> &str {
        self.declared.name.as_deref().unwrap_or(&self.name)
    }
}
