//! Thread pool and ordered pipelines. The only module that uses threads.
//!
//! A stage pulls items, keeps a bounded window of them in progress, and yields results in the order
//! of the items. Results therefore do not depend on the number of threads, memory is bounded by the
//! window, and a slow item delays the others only once the window is full. Stages are chained: the
//! results of one are the items of the next. The thread that consumes the last stage drives the
//! pipeline; with one thread it also does the work.

use std::collections::VecDeque;
use std::sync::mpsc::{Receiver, sync_channel};

use rayon::prelude::*;

/// Applies `work` to every item, on the threads of [`Threads::install`]; results in the order of
/// the items.
pub fn par_map<T: Send, R: Send>(items: Vec<T>, work: impl Fn(T) -> R + Sync) -> Vec<R> {
    items.into_par_iter().map(&work).collect()
}

/// Runs both closures in parallel, on the threads of [`Threads::install`].
pub fn join<A: Send, B: Send>(
    a: impl FnOnce() -> A + Send,
    b: impl FnOnce() -> B + Send,
) -> (A, B) {
    rayon::join(a, b)
}

/// A thread pool; with one thread work runs on the caller's thread.
pub struct Threads(Option<rayon::ThreadPool>);

impl Threads {
    /// `count` threads; 0 for one per core.
    pub fn new(count: usize) -> Self {
        let all = || std::thread::available_parallelism().map_or(1, usize::from);
        let count = if count == 0 { all() } else { count };
        // A pool fails only where the system refuses threads; the caller's thread is used then.
        let pool =
            (count > 1).then(|| rayon::ThreadPoolBuilder::new().num_threads(count).build().ok());
        Self(pool.flatten())
    }

    /// Number of threads.
    pub fn count(&self) -> usize {
        self.0.as_ref().map_or(1, rayon::ThreadPool::current_num_threads)
    }

    /// Runs `act` so that its calls of [`par_map`] and [`join`] use these threads only.
    pub fn install<R: Send>(&self, act: impl FnOnce() -> R + Send) -> R {
        match &self.0 {
            Some(pool) => pool.install(act),
            // Outside a pool rayon would use all cores.
            None => match rayon::ThreadPoolBuilder::new().num_threads(1).build() {
                Ok(pool) => pool.install(act),
                Err(_) => act(),
            },
        }
    }

    /// Opens a scope for pipeline stages; what their work borrows must outlive the scope.
    pub fn scope<'scope, R>(&self, act: impl FnOnce(&PipelineScope<'_, 'scope>) -> R) -> R {
        match &self.0 {
            Some(pool) => pool.in_place_scope(|scope| act(&PipelineScope(Some(scope)))),
            None => act(&PipelineScope(None)),
        }
    }
}

/// The scope in which stages spawn their work.
pub struct PipelineScope<'l, 'scope>(Option<&'l rayon::Scope<'scope>>);

/// Item of a stage.
pub enum Job<T, R> {
    /// not processed yet
    Work(T),
    /// a finished result, kept in order
    Done(R),
}

impl<'l, 'scope> PipelineScope<'l, 'scope> {
    /// Results of `work`, in the order of the items, which come with their weights. Items are in
    /// progress up to a total weight of `window`, at least one.
    pub fn in_order<T, R, W>(
        &self,
        items: impl Iterator<Item = (usize, Job<T, R>)>,
        window: usize,
        work: &'scope W,
    ) -> impl Iterator<Item = R>
    where
        T: Send + 'scope,
        R: Send + 'scope,
        W: Fn(T) -> R + Sync,
    {
        let window = if self.0.is_some() { window } else { 0 };
        InOrder {
            scope: self.0,
            items: items.fuse(),
            window,
            in_progress: VecDeque::new(),
            weight: 0,
            work,
        }
    }
}

enum Slot<R> {
    Ready(R),
    Pending(Receiver<R>),
}

struct InOrder<'l, 'scope, I, R, W> {
    scope: Option<&'l rayon::Scope<'scope>>,
    items: I,
    window: usize,
    in_progress: VecDeque<(usize, Slot<R>)>,
    weight: usize,
    work: &'scope W,
}

impl<'scope, I, T, R, W> Iterator for InOrder<'_, 'scope, I, R, W>
where
    I: Iterator<Item = (usize, Job<T, R>)>,
    T: Send + 'scope,
    R: Send + 'scope,
    W: Fn(T) -> R + Sync,
{
    type Item = R;

    fn next(&mut self) -> Option<R> {
        while self.in_progress.is_empty() || self.weight < self.window {
            let Some((weight, job)) = self.items.next() else { break };
            let work = self.work;
            let slot = match (job, self.scope) {
                (Job::Done(result), _) => Slot::Ready(result),
                (Job::Work(item), None) => Slot::Ready(work(item)),
                (Job::Work(item), Some(scope)) => {
                    let (sender, receiver) = sync_channel(1);
                    scope.spawn(move |_| {
                        // The receiver is gone where the run has ended early.
                        let _sent = sender.send(work(item));
                    });
                    Slot::Pending(receiver)
                }
            };
            self.weight = self.weight.saturating_add(weight);
            self.in_progress.push_back((weight, slot));
        }
        let (weight, slot) = self.in_progress.pop_front()?;
        self.weight = self.weight.saturating_sub(weight);
        match slot {
            Slot::Ready(result) => Some(result),
            // Work that panicked sends nothing; the scope propagates the panic.
            Slot::Pending(receiver) => receiver.recv().ok(),
        }
    }
}

/// Applies `work` to `items`, given with their weights, with items up to a total weight of `window`
/// in progress, and passes the results to `sink` in order. The first error of the sink ends the
/// run.
pub fn ordered_map<T: Send, R: Send, E>(
    items: impl Iterator<Item = T>,
    window: usize,
    weigh: impl Fn(&T) -> usize,
    threads: &Threads,
    work: impl Fn(T) -> R + Sync,
    sink: impl FnMut(R) -> Result<(), E>,
) -> Result<(), E> {
    threads.scope(|scope| {
        scope
            .in_order(items.map(|item| (weigh(&item), Job::Work(item))), window, &work)
            .try_for_each(sink)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_are_ordered_and_an_error_ends_the_run() {
        for threads in [Threads::new(1), Threads::new(3)] {
            let mut seen = Vec::new();
            let all = ordered_map(
                0..100u32,
                7,
                |_| 1,
                &threads,
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
                &threads,
                |i| i,
                |r| {
                    count += 1;
                    if r == 50 { Err(r) } else { Ok(()) }
                },
            );
            assert_eq!((ended, count), (Err(50), 51));
        }
    }

    #[test]
    fn a_slow_item_delays_at_most_one_window() {
        use std::sync::atomic::{AtomicUsize, Ordering};
        let (begun, done, seen) = (AtomicUsize::new(0), AtomicUsize::new(0), AtomicUsize::new(0));
        let max = AtomicUsize::new(0);
        let threads = Threads::new(2);
        let work = |i: usize| {
            max.fetch_max(
                begun.fetch_add(1, Ordering::SeqCst) + 1 - seen.load(Ordering::SeqCst),
                Ordering::SeqCst,
            );
            if i == 10 {
                // Waits until all items that may overtake it are done.
                let started = std::time::Instant::now();
                while done.load(Ordering::SeqCst) < 10 + 5 && started.elapsed().as_secs() < 20 {
                    std::thread::yield_now();
                }
            }
            done.fetch_add(1, Ordering::SeqCst);
            (i, done.load(Ordering::SeqCst))
        };
        let mut results = Vec::new();
        let run = ordered_map(
            0..40usize,
            6,
            |_| 1,
            &threads,
            work,
            |r| -> Result<(), ()> {
                seen.fetch_add(1, Ordering::SeqCst);
                results.push(r);
                Ok(())
            },
        );
        assert!(run.is_ok() && results.iter().map(|r| r.0).eq(0..40));
        assert!(results[10].1 >= 16, "others overtook the slow one: {:?}", results[10]);
        assert!(max.load(Ordering::SeqCst) <= 7, "{max:?} in progress");
    }

    #[test]
    fn stages_are_chained() {
        let (double, add) = (|i: u32| i * 2, |i: u32| i + 1);
        for threads in [Threads::new(1), Threads::new(4)] {
            let out: Vec<u32> = threads.scope(|scope| {
                let first = scope.in_order((0..100).map(|i| (1, Job::Work(i))), 5, &double);
                let second =
                    first.map(|i| (1, if i % 4 == 0 { Job::Done(i) } else { Job::Work(i) }));
                scope.in_order(second, 3, &add).collect()
            });
            assert_eq!(out, (0..100).map(|i| i * 2 + i % 2).collect::<Vec<_>>());
        }
    }
}
