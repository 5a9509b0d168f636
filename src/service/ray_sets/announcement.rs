//! What a sender says of a file before its bytes.

use super::declaration::FileDeclaration;
use crate::metadata::Metadata;
use tokio_util::sync::CancellationToken;

/// What a sender says of a file before its bytes.
#[derive(Clone, Debug, Default)]
pub struct Announcement {
    /// What it is called.
    pub name: String,
    /// Its length, bytes, where known.
    pub byte_count: Option<u64>,
    /// SHA-256 of the file, hex: every value that the client announced.
    pub sha256: Vec<String>,
    /// How to read it, or every file in it.
    pub declared: FileDeclaration,
    /// What its client says of the ray sets that it is to be.
    pub metadata: Metadata,
    /// Cancelled when the sender no longer waits for the answer: its rays need not be read to their end.
    pub gone: CancellationToken,
}
