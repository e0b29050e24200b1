//! Work beside the interface: on a thread, or, in a browser, as a task that gives way whenever it waits.

#[cfg(not(target_arch = "wasm32"))]
use std::{
    sync::{Condvar, Mutex, PoisonError},
    time::Duration,
};

/// Runs a task until its end.
#[cfg(not(target_arch = "wasm32"))]
pub(crate) fn run<F: Future<Output = ()>>(task: impl FnOnce() -> F + Send + 'static) {
    let running = Running::begin();
    std::thread::spawn(move || {
        let _running = running;
        give_way();
        pollster::block_on(task());
    });
}

/// Number of tasks that run, and who waits for their end.
#[cfg(not(target_arch = "wasm32"))]
static RUNNING: (Mutex<usize>, Condvar) = (Mutex::new(0), Condvar::new());

/// A task that runs until this is dropped.
#[cfg(not(target_arch = "wasm32"))]
struct Running;

#[cfg(not(target_arch = "wasm32"))]
impl Running {
    fn begin() -> Running {
        *RUNNING.0.lock().unwrap_or_else(PoisonError::into_inner) += 1;
        Running
    }
}

#[cfg(not(target_arch = "wasm32"))]
impl Drop for Running {
    fn drop(&mut self) {
        *RUNNING.0.lock().unwrap_or_else(PoisonError::into_inner) -= 1;
        RUNNING.1.notify_all();
    }
}

/// Waits until no task runs, but at most this long. Returns whether none runs.
///
/// A program that ends while a task uses a graphics device may crash in the device's driver, which cleans up on another thread.
#[cfg(not(target_arch = "wasm32"))]
pub fn wait(limit: Duration) -> bool {
    let running = RUNNING.0.lock().unwrap_or_else(PoisonError::into_inner);
    let waited = RUNNING.1.wait_timeout_while(running, limit, |running| *running > 0);
    *waited.unwrap_or_else(PoisonError::into_inner).0 == 0
}

/// Lowers the priority of this thread and of those that it starts: where the processor draws pictures and paints the window
/// too, the window answers first. On other systems a process has one priority, which stays.
#[cfg(not(target_arch = "wasm32"))]
fn give_way() {
    #[cfg(target_os = "linux")]
    // A system that refuses this draws all the same.
    let _ = rustix::process::nice(10);
}

/// Runs a task until its end.
#[cfg(target_arch = "wasm32")]
pub(crate) fn run<F: Future<Output = ()> + 'static>(task: impl FnOnce() -> F + 'static) {
    wasm_bindgen_futures::spawn_local(task());
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    #[test]
    fn drawing_gives_way_to_the_interface() {
        let (sender, receiver) = std::sync::mpsc::channel();
        let priority = || rustix::process::getpriority_process(None).expect("a thread may ask for its own");
        let before = priority();
        super::run(move || async move { sender.send(priority()).expect("the test waits") });
        let lowered = receiver.recv().expect("the task runs");
        assert!(lowered == (before + 10).min(19) && priority() == before, "{before} became {lowered}");
    }
}
