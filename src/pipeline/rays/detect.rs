//! To come.
use super::super::Error;
use super::{Bytes, Format};
/// The format of a file.
///
/// # Errors
/// Unknown formats.
pub fn detect(_bytes: &dyn Bytes) -> Result<Format, Error> {
    todo!()
}
