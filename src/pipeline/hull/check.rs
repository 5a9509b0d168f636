//! What every hull must satisfy: product code, called by users, tests, debug builds and fuzzers alike.

use super::mesh::Hull;

/// A broken rule, with its evidence.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Broken {
    /// A triangle names a vertex that does not exist.
    #[error("triangle {triangle} names vertex {vertex}, but there are {vertices}")]
    IndexOutOfRange {
        /// The triangle.
        triangle: usize,
        /// What it names.
        vertex: u32,
        /// How many there are.
        vertices: usize,
    },
}

impl Hull {
    /// All broken rules; empty for a sound hull.
    pub fn check(&self) -> Vec<Broken> {
        todo!()
    }
}
