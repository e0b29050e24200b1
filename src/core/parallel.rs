//! Runs work on several threads and delivers the results in order.
//!
//! The caller's thread consumes the results in item order, so the outcome does not depend on the number of threads.
//! Workers are at most two items per thread ahead of the caller's thread, which bounds memory.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, PoisonError};

use crate::error::Result;

struct WorkQueue<T> {
    next: usize,
    /// Number of items whose results the caller's thread has consumed.
    taken: usize,
    /// Results of the items from index `taken` on; `None` while a worker still computes the result.
    results: VecDeque<Option<Result<T>>>,
    /// Whether workers must stop; set by the first error, by a panic and at the end.
    stop: bool,
}

/// Calls `work` for each item of `0..count` on `threads` threads, and passes the results in item order to `take`.
///
/// `take` runs on the caller's thread. Each worker creates its own buffer with `scratch` and passes it to every call of
/// `work`. If `threads` is 1 no thread is spawned: the caller's thread does everything.
///
/// # Errors
/// The first error of `work`, in item order, or of `take`; later results are dropped.
///
/// # Panics
/// If `work` panics.
pub fn in_order<S, T: Send>(
    count: usize,
    threads: usize,
    scratch: impl Fn() -> S + Sync,
    work: impl Fn(&mut S, usize) -> Result<T> + Sync,
    mut take: impl FnMut(usize, T) -> Result<()>,
) -> Result<()> {
    if threads <= 1 || count <= 1 {
        let mut scratch = scratch();
        return (0..count).try_for_each(|item| take(item, work(&mut scratch, item)?));
    }
    let progress = Mutex::new(WorkQueue { next: 0, taken: 0, results: VecDeque::new(), stop: false });
    let changed = Condvar::new();
    let lock = || progress.lock().unwrap_or_else(PoisonError::into_inner);
    let wait = |guard| changed.wait(guard).unwrap_or_else(PoisonError::into_inner);
    let worker = || {
        let _stop_on_panic = StopOnPanic { progress: &progress, changed: &changed };
        let mut scratch = scratch();
        loop {
            let mut now = lock();
            while !now.stop && now.next < count && now.next >= now.taken + 2 * threads {
                now = wait(now);
            }
            if now.stop || now.next >= count {
                return;
            }
            let item = now.next;
            now.next += 1;
            now.results.push_back(None);
            drop(now);
            let result = work(&mut scratch, item);
            let mut now = lock();
            let place = item - now.taken;
            now.results[place] = Some(result);
            drop(now);
            changed.notify_all();
        }
    };
    std::thread::scope(|scope| {
        // If the caller's thread panics, the workers must not wait for it for ever.
        let _stop_on_panic = StopOnPanic { progress: &progress, changed: &changed };
        for _ in 0..threads.min(count) {
            scope.spawn(worker);
        }
        let result = (0..count).try_for_each(|item| {
            let mut now = lock();
            let result = loop {
                if let Some(result) = now.results.front_mut().and_then(Option::take) {
                    break result;
                }
                if now.stop {
                    // A worker panicked: the scope passes its panic on.
                    return Ok(());
                }
                now = wait(now);
            };
            now.results.pop_front();
            now.taken += 1;
            drop(now);
            changed.notify_all();
            take(item, result?)
        });
        lock().stop = true;
        changed.notify_all();
        result
    })
}

struct StopOnPanic<'a, T> {
    progress: &'a Mutex<WorkQueue<T>>,
    changed: &'a Condvar,
}

impl<T> Drop for StopOnPanic<'_, T> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.progress.lock().unwrap_or_else(PoisonError::into_inner).stop = true;
            self.changed.notify_all();
        }
    }
}
