//! Work beside the interface: on a thread, or, in a browser, as a task that gives way whenever it waits.

/// Runs a task until its end.
#[cfg(not(target_arch = "wasm32"))]
pub(crate) fn run<F: Future<Output = ()>>(task: impl FnOnce() -> F + Send + 'static) {
    std::thread::spawn(move || pollster::block_on(task()));
}

/// Runs a task until its end.
#[cfg(target_arch = "wasm32")]
pub(crate) fn run<F: Future<Output = ()> + 'static>(task: impl FnOnce() -> F + 'static) {
    wasm_bindgen_futures::spawn_local(task());
}
