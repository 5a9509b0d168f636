//! How often a key may ask: the only file that names governor. A bucket of tokens per key, refilled steadily; a burst empties
//! it. Buckets are in memory, so each process of several counts for itself.

use governor::clock::{Clock, DefaultClock};
use governor::middleware::StateInformationMiddleware;
use governor::state::keyed::HashMapStateStore;
use governor::{Quota, RateLimiter};
use std::num::NonZeroU32;
use std::time::Duration;

/// Requests per key. Only known keys have a bucket, so there are never more of them than rows.
pub struct RateLimit {
    buckets: RateLimiter<String, HashMapStateStore<String>, DefaultClock, StateInformationMiddleware>,
    clock: DefaultClock,
    policy: Policy,
}

/// How often a key may ask, as `RateLimit-Policy` says it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Policy {
    /// Requests at once after a rest.
    pub burst: u32,
    /// How long an empty bucket takes to be full, s.
    pub window_s: u32,
}

impl RateLimit {
    /// `per_second` requests on and on, `burst` at once after a rest; 0 counts as 1.
    pub fn new(per_second: u32, burst: u32) -> RateLimit {
        let at_least_one = |count: u32| NonZeroU32::new(count).unwrap_or(NonZeroU32::MIN);
        let (per_second, burst) = (at_least_one(per_second), at_least_one(burst));
        let buckets = RateLimiter::hashmap(Quota::per_second(per_second).allow_burst(burst)).with_middleware();
        let policy = Policy { burst: burst.get(), window_s: burst.get().div_ceil(per_second.get()) };
        RateLimit { buckets, clock: DefaultClock::default(), policy }
    }

    /// How often a key may ask.
    pub fn policy(&self) -> Policy {
        self.policy
    }

    /// Takes a token from the bucket of `key`; how many are left.
    ///
    /// # Errors
    /// There is none: how long until there is.
    pub fn count(&self, key: &str) -> Result<u32, Duration> {
        let counted = self.buckets.check_key(&key.to_owned());
        let left = counted.map_err(|until| until.wait_time_from(self.clock.now()))?;
        Ok(left.remaining_burst_capacity())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_that_asks_too_often_waits_and_the_others_do_not() {
        // One a minute would need more than this test's time to come back: per second 1 is the slowest there is.
        let limit = RateLimit::new(1, 3);
        assert_eq!(limit.policy(), Policy { burst: 3, window_s: 3 });
        for left in [2, 1, 0] {
            assert_eq!(limit.count("a"), Ok(left));
        }
        let wait = limit.count("a").unwrap_err();
        assert!(wait > Duration::ZERO && wait <= Duration::from_secs(1), "{wait:?}");
        assert_eq!(limit.count("b"), Ok(2));
    }
}
