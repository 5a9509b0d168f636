//! JSON that people can read too: objects over lines, arrays of numbers on one.

use crate::error::Error;
use serde::Serialize;
use serde_json::ser::{CompactFormatter, Formatter, Serializer};
use std::io;

/// `value` as a JSON document with a line end.
///
/// # Errors
/// [`Error::Internal`] when a number of the model is not finite: JSON has no word for it.
pub fn document<T: Serialize>(value: &T) -> Result<Vec<u8>, Error> {
    let mut bytes = Vec::new();
    let mut serializer = Serializer::with_formatter(&mut bytes, Legible::default());
    value.serialize(&mut serializer).map_err(unwritten)?;
    bytes.push(b'\n');
    Ok(bytes)
}

/// A result that cannot be written.
pub fn unwritten(error: impl std::error::Error) -> Error {
    Error::Internal(format!("a result cannot be written: {error}"))
}

/// Breaks lines in objects only.
#[derive(Default)]
struct Legible {
    depth: usize,
    empty: bool,
}

impl Legible {
    fn new_line<W: ?Sized + io::Write>(&self, writer: &mut W) -> io::Result<()> {
        writer.write_all(b"\n")?;
        (0..self.depth).try_for_each(|_| writer.write_all(b"  "))
    }
}

impl Formatter for Legible {
    /// -0.0 is written as 0.0.
    fn write_f64<W: ?Sized + io::Write>(&mut self, writer: &mut W, value: f64) -> io::Result<()> {
        CompactFormatter.write_f64(writer, value + 0.0)
    }

    fn begin_object<W: ?Sized + io::Write>(&mut self, writer: &mut W) -> io::Result<()> {
        self.depth += 1;
        self.empty = true;
        writer.write_all(b"{")
    }

    fn begin_object_key<W: ?Sized + io::Write>(&mut self, writer: &mut W, first: bool) -> io::Result<()> {
        self.empty = false;
        if !first {
            writer.write_all(b",")?;
        }
        self.new_line(writer)
    }

    fn begin_object_value<W: ?Sized + io::Write>(&mut self, writer: &mut W) -> io::Result<()> {
        writer.write_all(b": ")
    }

    fn end_object<W: ?Sized + io::Write>(&mut self, writer: &mut W) -> io::Result<()> {
        self.depth = self.depth.saturating_sub(1);
        if !self.empty {
            self.new_line(writer)?;
        }
        self.empty = false;
        writer.write_all(b"}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn objects_break_lines_and_arrays_do_not() {
        let value = serde_json::json!({"a": [1, 2], "b": {"c": {}, "d": [{"e": null}]}});
        let text = String::from_utf8(document(&value).unwrap()).unwrap();
        let expected =
            "{\n  \"a\": [1,2],\n  \"b\": {\n    \"c\": {},\n    \"d\": [{\n      \"e\": null\n    }]\n  }\n}\n";
        assert_eq!(text, expected);
        assert_eq!(serde_json::from_str::<serde_json::Value>(&text).unwrap(), value);
        assert_eq!(document(&[-0.0, 0.0, -1.5, 1e-300]).unwrap(), b"[0.0,0.0,-1.5,1e-300]\n");
    }
}
