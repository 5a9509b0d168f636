//! `openapi`: the contract, as it is committed in `openapi/openapi.json`.

use super::terminal::failure::Failure;
use super::terminal::output;

/// Prints the contract.
///
/// # Errors
/// Standard output cannot be written.
pub fn run() -> Result<(), Failure> {
    output::print(service::http::openapi())
}
