//! Chunks in parallel, answers in order: the one place where work on rays is spread over threads.

use super::super::Error;
use super::super::vocabulary::watch::StageWatch;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};

/// Chunks whose answers may wait for each other. Fixed, so that memory does not depend on the number of threads either.
const WAVE_CHUNKS: u64 = 64;

/// `work` on chunks `0..count` on the ambient pool; `merge` gets the answers strictly in chunk order, so the result is the
/// same bit for bit on any number of threads. Each thread's `scratch` is made once per wave and handed from chunk to chunk.
///
/// # Errors
/// [`Error::Cancelled`] within one chunk of the watcher's word; otherwise the error of the first chunk, in order, that failed.
pub fn in_order<S, T: Send, A>(
    count: u64,
    watch: StageWatch<'_>,
    mut answer: A,
    scratch: impl Fn() -> S + Sync + Send,
    work: impl Fn(&mut S, u64) -> Result<T, Error> + Sync + Send,
    mut merge: impl FnMut(&mut A, T) -> Result<(), Error>,
) -> Result<A, Error> {
    let started = AtomicU64::new(0);
    let mut first = 0;
    while first < count {
        let end = count.min(first + WAVE_CHUNKS);
        let wave: Vec<Result<T, Error>> = (first..end)
            .into_par_iter()
            .map_init(&scratch, |scratch, chunk| {
                watch.step(started.fetch_add(1, Ordering::Relaxed) as f64 / count as f64)?;
                work(scratch, chunk)
            })
            .collect();
        for part in wave {
            merge(&mut answer, part?)?;
        }
        first = end;
    }
    watch.step(1.0)?;
    Ok(answer)
}
