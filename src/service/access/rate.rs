//! How often a key may ask: the only file that names governor. A bucket of tokens per key, refilled steadily; a burst empties
//! it. Buckets are in memory, so each process of several counts for itself.

use governor::clock::{Clock, DefaultClock};
use governor::state::keyed::HashMapStateStore;
use governor::{Quota, RateLimiter};
use std::num::NonZeroU32;
use std::time::Duration;

/// Requests per key. Only known keys have a bucket, so there are never more of them than rows.
pub struct RateLimit {
    buckets: RateLimiter<String, HashMapStateStore<String>, DefaultClock>,
    clock: DefaultClock,
}

impl RateLimit {
    /// `per_second` requests on and on, `burst` at once after a rest; 0 counts as 1.
    pub fn new(per_second: u32, burst: u32) -> RateLimit {
        let at_least_one = |count: u32| NonZeroU32::new(count).unwrap_or(NonZeroU32::MIN);
        let quota = Quota::per_second(at_least_one(per_second)).allow_burst(at_least_one(burst));
        RateLimit { buckets: RateLimiter::hashmap(quota), clock: DefaultClock::default() }
    }

    /// Takes a token from the bucket of `key`.
    ///
    /// # Errors
    /// There is none: how long until there is.
    pub fn count(&self, key: &str) -> Result<(), Duration> {
        self.buckets.check_key(&key.to_owned()).map_err(|until| until.wait_time_from(self.clock.now()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_that_asks_too_often_waits_and_the_others_do_not() {
        // One a minute would need more than this test's time to come back: per second 1 is the slowest there is.
        let limit = RateLimit::new(1, 3);
        for _ in 0..3 {
            assert_eq!(limit.count("a"), Ok(()));
        }
        let wait = limit.count("a").unwrap_err();
        assert!(wait > Duration::ZERO && wait <= Duration::from_secs(1), "{wait:?}");
        assert_eq!(limit.count("b"), Ok(()));
    }
}
