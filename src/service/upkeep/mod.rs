//! What keeps the stores in order: retention, backup, garbage.

/// The lock on a data folder.
pub mod lock;
/// A copy of everything.
pub mod backup;
/// Blobs that no row names.
pub mod garbage;
/// What is kept no longer.
pub mod retention;
/// Which database a store's blobs belong to.
pub mod owner;
