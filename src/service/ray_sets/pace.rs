//! How fast a body must come: so many bytes in each interval of waiting. A long upload over a slow link is welcome; one that
//! only holds its place is not. What this process takes to store the bytes is not the sender's fault and does not count.

use bytes::Bytes;
use futures::{Stream, StreamExt};
use std::time::Duration;
use tokio::time::{Instant, timeout};

/// The slowest that is waited for.
#[derive(Clone, Copy, Debug)]
pub struct Slowest {
    /// Length of each interval.
    pub interval: Duration,
    /// Least number of bytes in each interval.
    pub bytes: u64,
}

/// A body that came slower than the slowest.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("only {bytes} bytes arrived within {} s", .interval.as_secs_f64())]
pub struct TooSlow {
    /// Bytes that came,
    pub bytes: u64,
    /// in this time.
    pub interval: Duration,
}

/// Watches one body.
#[derive(Debug)]
pub struct Pace {
    slowest: Slowest,
    waited: Duration,
    came: u64,
}

impl Pace {
    /// Watches a body that has not begun.
    pub fn new(slowest: Slowest) -> Pace {
        Pace { slowest, waited: Duration::ZERO, came: 0 }
    }

    /// The next piece of `body`; `None` at its end.
    ///
    /// # Errors
    /// [`TooSlow`].
    pub async fn next<E>(
        &mut self,
        body: &mut (impl Stream<Item = Result<Bytes, E>> + Unpin),
    ) -> Result<Option<Result<Bytes, E>>, TooSlow> {
        loop {
            let asked = Instant::now();
            match timeout(self.left(), body.next()).await {
                Ok(piece) => {
                    let bytes = piece.as_ref().and_then(|piece| piece.as_ref().ok()).map_or(0, Bytes::len);
                    self.took(asked.elapsed(), bytes as u64);
                    return Ok(piece);
                }
                Err(_) => self.judge()?,
            }
        }
    }

    /// How much of the interval is left.
    fn left(&self) -> Duration {
        self.slowest.interval.saturating_sub(self.waited)
    }

    /// A piece came after a wait within the interval.
    fn took(&mut self, waited: Duration, bytes: u64) {
        self.waited += waited;
        self.came += bytes;
    }

    /// The interval is over: was it enough?
    fn judge(&mut self) -> Result<(), TooSlow> {
        let Slowest { interval, bytes: least } = self.slowest;
        if self.came < least {
            return Err(TooSlow { bytes: self.came, interval });
        }
        (self.waited, self.came) = (Duration::ZERO, 0);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use futures::stream;
    use std::convert::Infallible;

    const SLOWEST: Slowest = Slowest { interval: Duration::from_secs(10), bytes: 100 };

    /// Ten pieces of `bytes` each, one every `every_s`, without a clock: the total, or when it was given up.
    fn taken(bytes: u64, every_s: u64) -> Result<u64, TooSlow> {
        let mut pace = Pace::new(SLOWEST);
        for _ in 0..10 {
            let mut wait = Duration::from_secs(every_s);
            while wait > pace.left() {
                wait -= pace.left();
                pace.judge()?;
            }
            pace.took(wait, bytes);
        }
        Ok(10 * bytes)
    }

    #[test]
    fn slow_is_taken_and_slower_is_not() {
        let too_slow = |bytes| Err(TooSlow { bytes, interval: SLOWEST.interval });
        assert_eq!(taken(20, 1), Ok(200));
        assert_eq!(taken(100, 10), Ok(1000));
        // One byte a second is no silence, and yet not enough.
        assert_eq!(taken(1, 2), too_slow(5));
        assert_eq!(taken(40, 5), too_slow(80));
        assert_eq!(taken(1_000_000, 11), too_slow(0));
    }

    #[tokio::test]
    async fn a_silent_body_is_given_up_and_one_that_comes_at_once_is_not_judged() {
        let slowest = Slowest { interval: Duration::from_millis(20), bytes: u64::MAX };
        let mut silent = stream::pending::<Result<Bytes, Infallible>>();
        let given_up = Pace::new(slowest).next(&mut silent).await;
        assert_eq!(given_up, Err(TooSlow { bytes: 0, interval: slowest.interval }));
        let mut prompt = stream::iter([Ok::<_, Infallible>(Bytes::from_static(b"rays"))]);
        let mut pace = Pace::new(Slowest { interval: Duration::from_secs(600), ..slowest });
        assert_eq!(pace.next(&mut prompt).await, Ok(Some(Ok(Bytes::from_static(b"rays")))));
        assert_eq!(pace.next(&mut prompt).await, Ok(None));
    }
}
