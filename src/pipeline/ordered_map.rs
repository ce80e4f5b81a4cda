//! The only place with threads: items in, work on all cores, results out in the order of the items.
//!
//! A batch is worked on while the next one is read and the last one is taken by the sink. So memory holds three
//! batches, and what the sink sees does not depend on the number of threads.

use std::sync::mpsc::sync_channel;

use rayon::prelude::*;

/// The cores to work on.
pub struct Threads(rayon::ThreadPool);

impl Threads {
    /// So many; 0 means all there are.
    pub fn new(count: usize) -> Self {
        // A pool fails only where the system gives no thread at all; one thread is asked for then.
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(count)
            .build()
            .or_else(|_no_threads| rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread().build());
        Self(pool.unwrap_or_else(|e| panic!("the system gives no threads: {e}")))
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.0.current_num_threads()
    }
}

/// Runs `work` over `items` in batches of at most `batch` weight (each item weighs `weigh` of it) and hands the
/// results to `sink` in order. The first error of the sink ends the run.
pub fn ordered_map<T: Send, R: Send, E: Send>(
    items: impl Iterator<Item = T> + Send,
    batch: usize,
    weigh: impl Fn(&T) -> usize + Send,
    threads: &Threads,
    work: impl Fn(T) -> R + Sync + Send,
    mut sink: impl FnMut(R) -> Result<(), E>,
) -> Result<(), E> {
    let (to_work, batches) = sync_channel::<Vec<T>>(1);
    let (to_sink, results) = sync_channel::<Vec<R>>(1);
    std::thread::scope(|scope| {
        scope.spawn(move || {
            let (mut next, mut weight) = (Vec::new(), 0);
            for item in items {
                weight += weigh(&item);
                next.push(item);
                if weight >= batch {
                    weight = 0;
                    if to_work.send(std::mem::take(&mut next)).is_err() {
                        return; // the sink has given up
                    }
                }
            }
            let _the_last_batch = to_work.send(next);
        });
        scope.spawn(|| {
            for batch in batches {
                let done: Vec<R> = threads.0.install(|| batch.into_par_iter().map(&work).collect());
                if to_sink.send(done).is_err() {
                    return;
                }
            }
            drop(to_sink);
        });
        results.into_iter().flatten().try_for_each(&mut sink)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn order_is_kept_and_an_error_ends_the_run() {
        let pool = Threads::new(3);
        let mut seen = Vec::new();
        let all = ordered_map(
            0..100u32,
            7,
            |_| 1,
            &pool,
            |i| i * 2,
            |r| -> Result<(), ()> {
                seen.push(r);
                Ok(())
            },
        );
        assert!(all.is_ok() && seen == (0..100).map(|i| i * 2).collect::<Vec<_>>());
        let mut count = 0;
        let ended = ordered_map(
            0..1_000_000u32,
            7,
            |_| 1,
            &pool,
            |i| i,
            |r| {
                count += 1;
                if r == 50 { Err(r) } else { Ok(()) }
            },
        );
        assert_eq!((ended, count), (Err(50), 51));
    }
}
