//! Work on several threads whose results come back in order.
//!
//! In: a count of items, what to do with one, what to do with its result. The caller's thread takes the results in
//! the order of the items, so that what it makes of them does not depend on the number of threads. No worker runs
//! further ahead of it than there are threads, so that memory is bounded by two results a thread.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, PoisonError};

use crate::error::Result;

struct Progress<T> {
    /// The next item to work on.
    next: usize,
    /// Items whose results were taken.
    taken: usize,
    /// Results of items from `taken` on, as far as they are there.
    results: VecDeque<Option<Result<T>>>,
    /// Set on the first error, or when a worker panicked.
    stop: bool,
}

/// Calls `work` on 0, 1 .. `count` on `threads` threads and `take` on each result in that order.
///
/// Each worker has a scratch of its own, from `scratch`. With one thread nothing is spawned.
///
/// # Errors
/// The first error of `work`, by order of items, or of `take`; nothing is taken after it.
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
    let progress = Mutex::new(Progress { next: 0, taken: 0, results: VecDeque::new(), stop: false });
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
        // Whatever happens to the caller's thread, the workers must not wait for it for ever.
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
                    // A worker panicked: the scope hands its panic on.
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
    progress: &'a Mutex<Progress<T>>,
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Error;

    #[test]
    fn results_come_in_order_for_any_number_of_threads() {
        for threads in [1, 2, 3, 8] {
            let mut taken = Vec::new();
            let work = |calls: &mut usize, item: usize| {
                *calls += 1;
                std::thread::sleep(std::time::Duration::from_micros((item * 7 % 5) as u64 * 50));
                Ok(item * item)
            };
            in_order(
                100,
                threads,
                || 0,
                work,
                |item, square| {
                    taken.push((item, square));
                    Ok(())
                },
            )
            .unwrap();
            assert_eq!(taken, (0..100).map(|item| (item, item * item)).collect::<Vec<_>>());
        }
    }

    #[test]
    fn the_first_error_ends_it() {
        for threads in [1, 4] {
            let mut taken = 0;
            let work = |(): &mut (), item: usize| {
                if item >= 10 { Err(Error::input("item", item.to_string())) } else { Ok(()) }
            };
            let error = in_order(
                1_000,
                threads,
                || (),
                work,
                |_, ()| {
                    taken += 1;
                    Ok(())
                },
            );
            assert_eq!(error.unwrap_err().to_string(), "item: 10");
            assert_eq!(taken, 10);
        }
    }

    #[test]
    fn what_takes_may_stop_it() {
        let error = in_order(
            1_000,
            4,
            || (),
            |(), item| Ok(item),
            |item, _| {
                if item == 3 { Err(Error::Interrupted) } else { Ok(()) }
            },
        );
        assert!(matches!(error, Err(Error::Interrupted)));
    }

    #[test]
    #[should_panic(expected = "a scoped thread panicked")]
    fn a_panic_is_not_waited_for() {
        let _ = in_order(
            100,
            2,
            || (),
            |(), item| {
                assert!(item < 5);
                Ok(())
            },
            |_, ()| Ok(()),
        );
    }
}
