//! LightTools binary ray files (`FORMATS.md` 3).

use super::super::Error;
use super::super::vocabulary::limits::Limits;
use super::{Bytes, RaySet};
use std::sync::Arc;

/// Opens a file of this format.
///
/// # Errors
/// As [`super::open`].
pub fn open(_bytes: Arc<dyn Bytes>, _limits: &Limits) -> Result<RaySet, Error> {
    Err(super::detect::not_read("detect.lighttools", "a LightTools binary ray file"))
}

/// Judges the header from the first bytes of a file that is `length` bytes long, if that is known.
///
/// # Errors
/// As [`open`]; [`Error::Unreadable`] (end of file) when `bytes` holds too little to tell.
pub fn peek(_bytes: &dyn Bytes, _length: Option<u64>) -> Result<(), Error> {
    Err(super::detect::not_read("detect.lighttools", "a LightTools binary ray file"))
}
