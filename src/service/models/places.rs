//! How many models are worked with at once, and by whom: no tenant can take the last place as long as it has others.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Files of new rays, evaluations, combinations and files of renderers that are made at once.
pub const AT_ONCE: usize = 8;

/// The places of a process. Cheap to clone.
#[derive(Clone, Default)]
pub struct Places(Arc<Mutex<HashMap<String, usize>>>);

/// A place; dropped, it is free again.
pub struct Place {
    places: Places,
    tenant: String,
}

impl Places {
    /// A place for `tenant`, if more places are free than it has: half of all where it is alone, and one for a newcomer as long as any is free.
    pub fn take(&self, tenant: &str) -> Option<Place> {
        let mut taken = self.taken();
        let free = AT_ONCE.saturating_sub(taken.values().sum());
        let own = taken.get(tenant).copied().unwrap_or(0);
        (free > own).then(|| {
            taken.insert(tenant.to_owned(), own + 1);
            Place { places: self.clone(), tenant: tenant.to_owned() }
        })
    }

    fn taken(&self) -> MutexGuard<'_, HashMap<String, usize>> {
        // Nothing is left half done in there.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        let mut taken = self.places.taken();
        match taken.get_mut(&self.tenant) {
            Some(own) if *own > 1 => *own -= 1,
            _ => drop(taken.remove(&self.tenant)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nobody_takes_all_places_and_all_come_back() {
        let places = Places::default();
        let greedy: Vec<Place> = std::iter::from_fn(|| places.take("greedy")).collect();
        assert_eq!(greedy.len(), AT_ONCE / 2);
        let newcomers: Vec<Option<Place>> = ["a", "b", "c"].map(|tenant| places.take(tenant)).into();
        assert!(newcomers.iter().all(Option::is_some));
        assert!(places.take("a").is_none() && places.take("d").is_some(), "the last place is a newcomer's");
        drop((greedy, newcomers));
        assert!(places.taken().is_empty());
    }
}
