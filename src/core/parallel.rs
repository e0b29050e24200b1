//! Runs work on several threads. The outcome does not depend on their number: results come in item order.
//!
//! [`in_order`] lets the caller's thread consume results while others work. Workers are at most two items per thread ahead of
//! it, which bounds memory. [`on_each`] and [`in_parts`] work in place, and the caller's thread works too.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, channel, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::Builder;

use crate::error::Result;

/// The most threads that count, so that sums of what threads need stay small.
pub(crate) const MOST_THREADS: usize = 1 << 16;

/// Calls `work` for each item of `0..count` on `threads` threads, and passes the results in item order to `take`.
///
/// `take` runs on the caller's thread. Each worker creates its own buffer with `scratch` and passes it to every call of
/// `work`. If `threads` is 1 no thread is spawned: the caller's thread does everything. So it does if the system gives no thread;
/// if it gives fewer, these do.
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
    let threads = threads.min(count);
    if threads <= 1 {
        let mut scratch = scratch();
        return (0..count).try_for_each(|item| take(item, work(&mut scratch, item)?));
    }
    let (scratch, work, stopped) = (&scratch, &work, &AtomicBool::new(false));
    std::thread::scope(|scope| {
        let (queue, items) = channel::<(usize, SyncSender<Result<T>>)>();
        let items = Arc::new(Mutex::new(items));
        let mut spawned = 0;
        for items in std::iter::repeat_n(items, threads) {
            let worker = Builder::new().spawn_scoped(scope, move || {
                let mut scratch = scratch();
                let next = || items.lock().unwrap_or_else(PoisonError::into_inner).recv();
                while let Ok((item, result)) = next() {
                    if stopped.load(Ordering::Relaxed) {
                        break;
                    }
                    // Fails if the caller's thread has stopped and receives nothing more.
                    let _ = result.send(work(&mut scratch, item));
                }
            });
            spawned += usize::from(worker.is_ok());
        }
        if spawned == 0 {
            let mut scratch = scratch();
            return (0..count).try_for_each(|item| take(item, work(&mut scratch, item)?));
        }
        let mut unsent = 0..count;
        let mut results: VecDeque<Receiver<Result<T>>> = VecDeque::new();
        // Ends early with the first error, or if a worker has panicked: the scope passes the panic on.
        let mut take_all = || {
            for item in 0..count {
                for ahead in unsent.by_ref().take(2 * threads + 1 - results.len()) {
                    let (sender, receiver) = sync_channel(1);
                    let _ = queue.send((ahead, sender));
                    results.push_back(receiver);
                }
                let Some(Ok(result)) = results.pop_front().map(|result| result.recv()) else { break };
                take(item, result?)?;
            }
            Ok(())
        };
        let result = take_all();
        stopped.store(true, Ordering::Relaxed);
        result
    })
}

/// Passes parts of `rows`, whole rows of `len` items, to `fill` on up to `threads` threads, after the index of their first
/// row.
pub(crate) fn in_parts<T: Send>(rows: &mut [T], len: usize, threads: usize, fill: impl Fn(usize, &mut [T]) + Sync) {
    let each = (rows.len() / len).div_ceil(threads.max(1)).max(1);
    let parts = (0..).step_by(each).zip(rows.chunks_mut(each * len));
    on_each(parts, threads, || (), |(), (from, part)| fill(from, part));
}

/// Calls `work` with each of `items` on up to `threads` threads, the caller's thread among them. Returns the results in item order.
///
/// Each thread creates its own buffer with `scratch`, passes it to every call of `work`, and takes the next item when it is done
/// with one. All items are worked on, whatever the results.
///
/// # Panics
/// If `work` panics.
pub(crate) fn on_each<S, T: Send, R: Send>(
    items: impl Iterator<Item = T>,
    threads: usize,
    scratch: impl Fn() -> S + Sync,
    work: impl Fn(&mut S, T) -> R + Sync,
) -> Vec<R> {
    let items: Vec<T> = items.collect();
    let count = items.len();
    let items = Mutex::new(items.into_iter().enumerate());
    let next = || items.lock().unwrap_or_else(PoisonError::into_inner).next();
    let run = || {
        let (mut scratch, mut results) = (scratch(), Vec::new());
        while let Some((index, item)) = next() {
            results.push((index, work(&mut scratch, item)));
        }
        results
    };
    let mut results = std::thread::scope(|scope| {
        let others: Vec<_> =
            (1..threads.min(count)).map_while(|_| Builder::new().spawn_scoped(scope, run).ok()).collect();
        let mut results = run();
        for other in others {
            results.extend(other.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)));
        }
        results
    });
    results.sort_unstable_by_key(|(index, _)| *index);
    results.into_iter().map(|(_, result)| result).collect()
}
