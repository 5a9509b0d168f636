//! Places that tenants share, so that none of them can take what all others need.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A number of places. A tenant gets another one as long as it has fewer than are free: alone it has half of them at most, of `n`
/// tenants that want as many as they can get each has one part in `n + 1`, and there is always one for who comes next. Cheap to
/// clone.
#[derive(Clone)]
pub struct Shares(Arc<Shared>);

struct Shared {
    places: usize,
    /// Whether a tenant has a share only; where everybody is one tenant, it has everything.
    is_divided: bool,
    taken: Mutex<HashMap<String, usize>>,
}

impl Shares {
    /// This many places, divided among tenants or not.
    pub fn new(places: usize, is_divided: bool) -> Shares {
        Shares(Arc::new(Shared { places, is_divided, taken: Mutex::default() }))
    }

    /// A place for `tenant`, if there is one for it.
    pub fn take(&self, tenant: &str) -> Option<Share> {
        let mut taken = self.0.taken();
        let free = self.0.places.saturating_sub(taken.values().sum());
        let own = taken.get(tenant).copied().unwrap_or(0);
        if free == 0 || (self.0.is_divided && own >= free) {
            return None;
        }
        taken.insert(tenant.to_owned(), own + 1);
        Some(Share { tenant: tenant.to_owned(), shares: Arc::clone(&self.0) })
    }
}

impl Shared {
    fn taken(&self) -> MutexGuard<'_, HashMap<String, usize>> {
        // Nothing is left half done in there.
        self.taken.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A tenant's place; dropped, it is free.
pub struct Share {
    tenant: String,
    shares: Arc<Shared>,
}

impl Drop for Share {
    fn drop(&mut self) {
        let mut taken = self.shares.taken();
        match taken.get(&self.tenant).copied().unwrap_or(0) {
            0 | 1 => drop(taken.remove(&self.tenant)),
            several => drop(taken.insert(self.tenant.clone(), several - 1)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn as_many_as_can(shares: &Shares, tenant: &str) -> Vec<Share> {
        std::iter::from_fn(|| shares.take(tenant)).collect()
    }

    #[test]
    fn each_tenant_has_a_part_and_there_is_always_one_for_the_next() {
        let shares = Shares::new(384, true);
        let first = as_many_as_can(&shares, "a");
        assert_eq!(first.len(), 192, "half, as long as nobody else is there");
        let (second, third) = (as_many_as_can(&shares, "b"), as_many_as_can(&shares, "c"));
        assert_eq!((second.len(), third.len()), (96, 48));
        assert!(shares.take("d").is_some());
        drop((first, second, third));
        assert!(shares.0.taken().is_empty(), "nobody is remembered");
        assert_eq!(as_many_as_can(&shares, "b").len(), 192);
    }

    #[test]
    fn where_everybody_is_one_tenant_it_has_all() {
        let shares = Shares::new(3, false);
        assert_eq!(as_many_as_can(&shares, "default").len(), 3);
    }
}
