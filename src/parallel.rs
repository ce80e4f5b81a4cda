//! The only place with threads: items in, work on all cores, results out in the order of the items.
//!
//! A stage pulls its items, keeps so many of them under way, and gives out the oldest when it is
//! done. So what comes out does not depend on the number of threads, one slow item holds up the
//! others no longer than the window lasts, and memory holds one window. Stages stand one behind the
//! other: the items of one are the results of another. All of it is driven by the thread that takes
//! the last results; on one core it also does the work.

use std::collections::VecDeque;
use std::sync::mpsc::{Receiver, sync_channel};

use rayon::prelude::*;

/// Work on each item, on the cores of [`Threads::install`]; results in the order of the items.
pub fn par_map<T: Send, R: Send>(items: Vec<T>, work: impl Fn(T) -> R + Sync) -> Vec<R> {
    items.into_par_iter().map(&work).collect()
}

/// Two things side by side, on the same cores.
pub fn join<A: Send, B: Send>(
    a: impl FnOnce() -> A + Send,
    b: impl FnOnce() -> B + Send,
) -> (A, B) {
    rayon::join(a, b)
}

/// The cores to work on; one core is the caller's own.
pub struct Threads(Option<rayon::ThreadPool>);

impl Threads {
    /// So many; 0 means all there are.
    pub fn new(count: usize) -> Self {
        let all = || std::thread::available_parallelism().map_or(1, usize::from);
        let count = if count == 0 { all() } else { count };
        // A pool fails only where the system gives no more threads: the caller's own is left.
        let pool =
            (count > 1).then(|| rayon::ThreadPoolBuilder::new().num_threads(count).build().ok());
        Self(pool.flatten())
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.0.as_ref().map_or(1, rayon::ThreadPool::current_num_threads)
    }

    /// Runs what parts its own work by [`par_map`] and [`join`], as the joint solve does, on these
    /// cores and no others.
    pub fn install<R: Send>(&self, act: impl FnOnce() -> R + Send) -> R {
        match &self.0 {
            Some(pool) => pool.install(act),
            // Outside of a pool it would take all cores there are.
            None => match rayon::ThreadPoolBuilder::new().num_threads(1).build() {
                Ok(pool) => pool.install(act),
                Err(_) => act(),
            },
        }
    }

    /// A place for stages. What their work borrows must be older than the place.
    pub fn scope<'scope, R>(&self, act: impl FnOnce(&PipelineScope<'_, 'scope>) -> R) -> R {
        match &self.0 {
            Some(pool) => pool.in_place_scope(|scope| act(&PipelineScope(Some(scope)))),
            None => act(&PipelineScope(None)),
        }
    }

    /// Does one thing beside another, where there is a core for it.
    pub fn overlap<A: Send, B>(
        &self,
        aside: impl FnOnce() -> A + Send,
        act: impl FnOnce() -> B,
    ) -> (A, B) {
        let Some(pool) = &self.0 else {
            let done = act();
            return (aside(), done);
        };
        let mut result = None;
        let done = pool.in_place_scope(|scope| {
            scope.spawn(|_| result = Some(aside()));
            act()
        });
        match result {
            Some(result) => (result, done),
            None => unreachable!("the scope has waited for it"),
        }
    }
}

/// Where stages put their work.
pub struct PipelineScope<'l, 'scope>(Option<&'l rayon::Scope<'scope>>);

/// What comes into a stage.
pub enum Job<T, R> {
    /// to be worked on
    Work(T),
    /// done already; it keeps its place
    Done(R),
}

impl<'l, 'scope> PipelineScope<'l, 'scope> {
    /// Results of `work`, in the order of the items. Items are under way together as long as they
    /// weigh less than `window`, one at least.
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
            under_way: VecDeque::new(),
            weight: 0,
            work,
        }
    }
}

enum Slot<R> {
    Here(R),
    Awaited(Receiver<R>),
}

struct InOrder<'l, 'scope, I, R, W> {
    scope: Option<&'l rayon::Scope<'scope>>,
    items: I,
    window: usize,
    under_way: VecDeque<(usize, Slot<R>)>,
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
        while self.under_way.is_empty() || self.weight < self.window {
            let Some((weight, job)) = self.items.next() else { break };
            let work = self.work;
            let slot = match (job, self.scope) {
                (Job::Done(result), _) => Slot::Here(result),
                (Job::Work(item), None) => Slot::Here(work(item)),
                (Job::Work(item), Some(scope)) => {
                    let (give, take) = sync_channel(1);
                    scope.spawn(move |_| {
                        // Nobody takes it where the run has ended early.
                        let _taken = give.send(work(item));
                    });
                    Slot::Awaited(take)
                }
            };
            self.weight = self.weight.saturating_add(weight);
            self.under_way.push_back((weight, slot));
        }
        let (weight, slot) = self.under_way.pop_front()?;
        self.weight = self.weight.saturating_sub(weight);
        match slot {
            Slot::Here(result) => Some(result),
            // Nothing comes of work that panicked; the scope passes the panic on.
            Slot::Awaited(result) => result.recv().ok(),
        }
    }
}

/// Runs `work` over `items`, of which as many are under way as weigh `window` (each weighs
/// `weigh`), and hands the results to `sink` in order. The first error of the sink ends the run.
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
    fn order_is_kept_and_an_error_ends_the_run() {
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
    fn a_slow_item_holds_up_no_more_than_the_window_and_no_more_is_under_way() {
        use std::sync::atomic::{AtomicUsize, Ordering};
        let (begun, done, seen) = (AtomicUsize::new(0), AtomicUsize::new(0), AtomicUsize::new(0));
        let most = AtomicUsize::new(0);
        let threads = Threads::new(2);
        let work = |i: usize| {
            most.fetch_max(
                begun.fetch_add(1, Ordering::SeqCst) + 1 - seen.load(Ordering::SeqCst),
                Ordering::SeqCst,
            );
            if i == 10 {
                // The first of its window waits for all that may overtake it.
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
        assert!(most.load(Ordering::SeqCst) <= 7, "{most:?} under way");
    }

    #[test]
    fn stages_stand_one_behind_the_other() {
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
