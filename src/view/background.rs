//! Work beside the interface: on a thread, or, in a browser, as a task that gives way whenever it waits.

/// Runs a task until its end.
#[cfg(not(target_arch = "wasm32"))]
pub(crate) fn run<F: Future<Output = ()>>(task: impl FnOnce() -> F + Send + 'static) {
    std::thread::spawn(move || {
        give_way();
        pollster::block_on(task());
    });
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
