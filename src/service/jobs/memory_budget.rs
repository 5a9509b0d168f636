//! Memory for the jobs that one process computes at once: a job is begun when what it is expected to need is left.

use crate::metrics::Metrics;
use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use tokio::sync::{Mutex, MutexGuard};

/// What a job needs on so many threads (a `$n`), bytes, in SQL.
macro_rules! needed {
    ($threads:literal) => {
        concat!(
            "(jobs.memory_bytes + jobs.thread_bytes * (CASE WHEN ",
            $threads,
            " > jobs.memory_threads THEN ",
            $threads,
            " - jobs.memory_threads ELSE 0 END))"
        )
    };
}
pub(super) use needed;

/// The memory budget for all jobs of this process. Cheap to clone.
#[derive(Clone)]
pub struct Memory {
    limit_bytes: u64,
    used_bytes: Arc<AtomicU64>,
    turn: Arc<Mutex<()>>,
    metrics: Metrics,
}

/// A job that needs more memory than the budget of this process.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the job needs {needed_bytes} bytes of memory, and there are {limit_bytes}")]
pub struct TooLarge {
    /// Expected memory of the job, bytes.
    pub needed_bytes: u64,
    /// Memory budget for all jobs of one process, bytes.
    pub limit_bytes: u64,
}

/// Memory that is reserved for a job; returned to the budget when the last clone is dropped.
#[derive(Clone, Debug, Default)]
pub struct MemoryReservation {
    _share: Option<Arc<Share>>,
}

struct Share {
    bytes: u64,
    memory: Memory,
}

impl fmt::Debug for Share {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{} bytes", self.bytes)
    }
}

impl Memory {
    /// `limit_bytes` for all jobs together; what is used is counted in `metrics`.
    pub fn new(limit_bytes: u64, metrics: Metrics) -> Memory {
        Memory { limit_bytes, used_bytes: Arc::default(), turn: Arc::default(), metrics }
    }

    /// The largest job that can ever be begun here, bytes.
    pub fn limit_bytes(&self) -> u64 {
        self.limit_bytes
    }

    /// Checks whether a job that needs so much memory can ever start in this process.
    ///
    /// # Errors
    /// It cannot.
    pub fn check_fits(&self, needed_bytes: u64) -> Result<(), TooLarge> {
        let limit_bytes = self.limit_bytes;
        if needed_bytes > limit_bytes { Err(TooLarge { needed_bytes, limit_bytes }) } else { Ok(()) }
    }

    /// Slots of a process look for jobs in turn: what one has seen to be left, another does not take.
    pub async fn turn(&self) -> MutexGuard<'_, ()> {
        self.turn.lock().await
    }

    /// Reserves `bytes` of the rest of the budget; `None` if the rest is smaller. The caller must hold [`Memory::turn`].
    pub fn reserve(&self, bytes: u64) -> Option<MemoryReservation> {
        let used = self.used_bytes.load(Ordering::Relaxed);
        let fits = used.saturating_add(bytes) <= self.limit_bytes;
        self.metrics.waits_for_memory(!fits);
        fits.then(|| {
            self.used_bytes.fetch_add(bytes, Ordering::Relaxed);
            self.metrics.job_memory(bytes.cast_signed());
            MemoryReservation { _share: Some(Arc::new(Share { bytes, memory: self.clone() })) }
        })
    }

    /// Notes that no job waits for memory.
    pub fn nobody_waits(&self) {
        self.metrics.waits_for_memory(false);
    }

    /// Memory that is reserved at present, bytes.
    pub fn used_bytes(&self) -> u64 {
        self.used_bytes.load(Ordering::Relaxed)
    }
}

impl Drop for Share {
    fn drop(&mut self) {
        self.memory.used_bytes.fetch_sub(self.bytes, Ordering::Relaxed);
        self.memory.metrics.job_memory(-self.bytes.cast_signed());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reserved_memory_is_not_given_twice_and_comes_back() {
        let memory = Memory::new(100, Metrics::new());
        let first = memory.reserve(60).unwrap();
        assert!(memory.reserve(41).is_none() && memory.reserve(u64::MAX).is_none());
        let second = memory.reserve(40).unwrap();
        assert_eq!(memory.used_bytes(), 100);
        let also_first = first.clone();
        drop(first);
        assert!(memory.reserve(1).is_none(), "somebody still works with it");
        drop((also_first, second));
        assert_eq!(memory.used_bytes(), 0);
    }
}
