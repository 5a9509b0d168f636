//! `openapi`: the contract, as it is committed in `openapi/openapi.json`.

use super::Failure;
use std::io::Write;

/// Prints the contract.
///
/// # Errors
/// Standard output is closed.
pub fn run() -> Result<(), Failure> {
    let written = std::io::stdout().write_all(crate::service::api::openapi().as_bytes());
    written.map_err(|error| Failure::failed("openapi.output", error.to_string(), "Give it somewhere to write."))
}
