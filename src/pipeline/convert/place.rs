//! Where a file is written: shuffling reads back what was written and puts it elsewhere.

use std::io::{Read, Seek, Write};

/// A file, or bytes in memory with a cursor.
pub trait Place: Read + Write + Seek {}

impl<T: Read + Write + Seek> Place for T {}
