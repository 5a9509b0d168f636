//! `openapi`: the contract, as it is committed in `openapi/openapi.json`.

use super::{Failure, output};

/// Prints the contract.
///
/// # Errors
/// Standard output cannot be written.
pub fn run() -> Result<(), Failure> {
    output::print(crate::service::api::openapi())
}
