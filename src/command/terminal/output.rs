//! What a verb answers, on standard output.

use super::failure::Failure;
pub use service::telemetry::visible;
use std::fmt::Display;
use std::io;
use std::io::{ErrorKind, Write};

/// Prints `text` as it is. A reader that has stopped reading, as `| head` does, is no failure.
///
/// # Errors
/// There is no room for it, or nowhere to write.
pub fn print(text: impl Display) -> Result<(), Failure> {
    let mut output = io::stdout().lock();
    match write!(output, "{text}").and_then(|()| output.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(Failure::failed(
            "output.unwritable",
            error.to_string(),
            "See to the room and the permissions of where standard output goes.",
        )),
        _ => Ok(()),
    }
}
