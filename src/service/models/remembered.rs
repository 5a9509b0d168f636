//! What is remembered of files that are made when they are asked for: who asks for a length alone (HEAD) has no model read.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Most that is kept.
const MOST: usize = 256;

/// Values by name, those that were kept last at the end. Cheap to clone.
pub struct Remembered<T>(Arc<Mutex<Vec<(String, T)>>>);

impl<T> Clone for Remembered<T> {
    fn clone(&self) -> Remembered<T> {
        Remembered(Arc::clone(&self.0))
    }
}

impl<T> Default for Remembered<T> {
    fn default() -> Remembered<T> {
        Remembered(Arc::default())
    }
}

impl<T: Clone> Remembered<T> {
    /// Keeps what belongs to `name`.
    pub fn keep(&self, name: &str, value: T) {
        let mut kept = self.kept();
        kept.retain(|(known, _)| known != name);
        if kept.len() >= MOST {
            kept.remove(0);
        }
        kept.push((name.to_owned(), value));
    }

    /// What belongs to `name`; `None` where it is not known any more.
    pub fn of(&self, name: &str) -> Option<T> {
        self.kept().iter().find(|(known, _)| known == name).map(|(_, value)| value.clone())
    }

    fn kept(&self) -> MutexGuard<'_, Vec<(String, T)>> {
        // Nothing is left half done in there.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_kept_last_is_known_and_there_is_an_end() {
        let lengths = Remembered::default();
        (0..MOST as u64 + 1).for_each(|number| lengths.keep(&number.to_string(), number));
        assert_eq!((lengths.of("0"), lengths.of("1"), lengths.of("256")), (None, Some(1), Some(256)));
        lengths.keep("1", 7);
        assert_eq!((lengths.of("1"), lengths.of("2")), (Some(7), Some(2)));
    }
}
