//! Lengths of files that are made when they are asked for: whoever asks for the length alone (HEAD) has no model read.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Most lengths that are kept.
const MOST: usize = 256;

/// Lengths by entity tag, those asked for last at the end. Cheap to clone.
#[derive(Clone, Default)]
pub struct Lengths(Arc<Mutex<Vec<(String, u64)>>>);

impl Lengths {
    /// Keeps the length, bytes, of the file with this entity tag.
    pub fn keep(&self, etag: &str, byte_count: u64) {
        let mut kept = self.kept();
        kept.retain(|(known, _)| known != etag);
        if kept.len() >= MOST {
            kept.remove(0);
        }
        kept.push((etag.to_owned(), byte_count));
    }

    /// The length of a file that this process has made, bytes; `None` where it is not known.
    pub fn of(&self, etag: &str) -> Option<u64> {
        self.kept().iter().find(|(known, _)| known == etag).map(|(_, byte_count)| *byte_count)
    }

    fn kept(&self) -> MutexGuard<'_, Vec<(String, u64)>> {
        // Nothing is left half done in there.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_kept_last_is_known_and_there_is_an_end() {
        let lengths = Lengths::default();
        (0..MOST as u64 + 1).for_each(|number| lengths.keep(&number.to_string(), number));
        assert_eq!((lengths.of("0"), lengths.of("1"), lengths.of("256")), (None, Some(1), Some(256)));
        lengths.keep("1", 7);
        assert_eq!((lengths.of("1"), lengths.of("2")), (Some(7), Some(2)));
    }
}
