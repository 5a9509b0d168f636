//! Chunks in parallel, answers in order: the one place where work on rays is spread over threads.

use crate::error::Error;
use crate::vocabulary::watch::StageWatch;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};

/// Chunks of one wave: their results are held until all of them are done, and then merged in order. Constant, so that the memory,
/// like the result, does not depend on the number of threads.
const WAVE_CHUNKS: u64 = 64;

/// `work` on chunks `0..count` on the ambient pool; `merge` gets the answers strictly in chunk order, so the result is the
/// same bit for bit on any number of threads. Threads take up chunks in their order too, so that a file that is still coming is
/// read as it comes. Each thread's `scratch` is made once per wave and handed from chunk to chunk.
///
/// # Errors
/// [`Error::Cancelled`] at most one chunk after the caller cancels; otherwise the error of the first chunk, in order, that failed.
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
        let next = AtomicU64::new(first);
        let taken_up = |_| {
            let mut scratch = scratch();
            let mut done = Vec::new();
            loop {
                let chunk = next.fetch_add(1, Ordering::Relaxed);
                if chunk >= end {
                    break done;
                }
                let stepped = watch.step(started.fetch_add(1, Ordering::Relaxed) as f64 / count as f64);
                done.push((chunk, stepped.and_then(|()| work(&mut scratch, chunk))));
            }
        };
        let threads = (0..rayon::current_num_threads()).into_par_iter().with_max_len(1);
        let mut wave: Vec<(u64, Result<T, Error>)> = threads.flat_map_iter(taken_up).collect();
        wave.sort_unstable_by_key(|(chunk, _)| *chunk);
        for (_, part) in wave {
            merge(&mut answer, part?)?;
        }
        first = end;
    }
    watch.step(1.0)?;
    Ok(answer)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vocabulary::watch::{NoProgress, Stage};
    use rayon::ThreadPoolBuilder;
    use std::sync::Mutex;

    /// More than two waves, on one thread and on three: every chunk once, merged in order; none is taken up before all those of
    /// the waves before it.
    #[test]
    fn chunks_are_taken_up_and_merged_in_their_order() {
        for threads in [1, 3] {
            let pool = ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let begun = Mutex::new(Vec::new());
            let merged = pool.install(|| {
                let watch = StageWatch::enter(&NoProgress, Stage::Rays).unwrap();
                let work = |_: &mut (), chunk| {
                    begun.lock().unwrap().push(chunk);
                    Ok(chunk)
                };
                in_order(
                    150,
                    watch,
                    Vec::new(),
                    || (),
                    work,
                    |all: &mut Vec<u64>, chunk| {
                        all.push(chunk);
                        Ok(())
                    },
                )
            });
            assert_eq!(merged.unwrap(), (0..150).collect::<Vec<_>>());
            let begun = begun.into_inner().unwrap();
            assert!(threads > 1 || begun.is_sorted(), "{begun:?}");
            let waves = begun.chunks(WAVE_CHUNKS as usize).map(|wave| wave.iter().map(|chunk| chunk / WAVE_CHUNKS));
            for (number, mut wave) in waves.enumerate() {
                assert!(wave.all(|of| of == number as u64), "{begun:?}");
            }
        }
    }

    #[test]
    fn the_first_failure_in_order_is_told() {
        let watch = StageWatch::enter(&NoProgress, Stage::Rays).unwrap();
        let work = |_: &mut (), chunk: u64| match chunk {
            20 | 21 | 40 => Err(Error::refused("test.chunk", chunk.to_string(), "")),
            _ => Ok(()),
        };
        let error = in_order(64, watch, (), || (), work, |(), ()| Ok(())).unwrap_err();
        assert!(error.to_string().contains("20"), "{error}");
    }
}
