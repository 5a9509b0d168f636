//! A model that another was made of without its rays, and what was changed.

use crate::vocabulary::spectrum::Table;
use glam::{DMat3, DVec3};
use serde_json::Value;

/// One of the models that a combination was made of.
#[derive(Clone, Debug, PartialEq)]
pub struct Ancestor {
    /// What it is called.
    pub name: String,
    /// SHA-256 of its `emitter.glb`, lower-case hex.
    pub emitter_sha256: String,
    /// SHA-256 of its `goniograms.json`, lower-case hex.
    pub goniograms_sha256: String,
    /// The spectrum that all of its light was given.
    pub spectrum: Option<Table>,
    /// What its flux was multiplied by after that.
    pub factor: f64,
    /// How it was turned about the origin: takes its directions to those of the combination.
    pub turn: DMat3,
    /// How far it was moved after that, mm.
    pub move_mm: DVec3,
    /// Where it came from itself: `provenance` of its `goniograms.json`.
    pub provenance: Value,
}
