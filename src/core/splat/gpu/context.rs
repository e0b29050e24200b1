//! Wraps a device and its queue, and turns their faults into errors.
//!
//! In: a device that the caller made. Out: buffers within its limits, copies to and from them, and its faults as
//! [`Error::Device`], which all functions of the renderer may return. Faults are caught in error scopes, so handlers
//! that the caller set on the device stay in force.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use futures_channel::oneshot;
use wgpu::{
    Buffer, BufferDescriptor, BufferUsages, CommandBuffer, CommandEncoder, CommandEncoderDescriptor, Device,
    ErrorFilter, Limits, MapMode, PollType, Queue,
};

use crate::error::{Error, Result};

pub(crate) const MAX_BINDING: u64 = 128 << 20; // Largest binding that is used, in bytes: every device allows it.

/// Usages of a buffer that stages read or write: tests may also read it.
pub(crate) const STORAGE: BufferUsages =
    BufferUsages::STORAGE.union(BufferUsages::COPY_DST).union(BufferUsages::COPY_SRC);

const HANG_TIMEOUT: Duration = Duration::from_secs(600); // Software takes minutes for a large frame.

/// A device, its queue, and how many bytes of copies to the device are not known to be finished.
#[derive(Debug)]
pub(crate) struct Context {
    pub(crate) device: Device,
    pub(crate) queue: Queue,
    pub(crate) limits: Limits,
    max_in_flight: u64,
    in_flight: AtomicU64,
}

impl Context {
    /// Wraps a device; at most `max_in_flight` bytes of copies to the device are unfinished at a time.
    pub(crate) fn new(device: Device, queue: Queue, max_in_flight: u64) -> Context {
        let limits = device.limits();
        Context { device, queue, limits, max_in_flight, in_flight: AtomicU64::new(0) }
    }

    /// Returns the size of the largest storage binding that may be used, in bytes.
    pub(crate) fn max_binding(&self) -> u64 {
        MAX_BINDING.min(self.limits.max_storage_buffer_binding_size).min(self.limits.max_buffer_size)
    }

    /// Runs `work`; turns any fault that the device reports meanwhile into [`Error::Device`].
    pub(crate) async fn watch<T>(&self, work: impl AsyncFnOnce() -> Result<T>) -> Result<T> {
        let filters = [ErrorFilter::Validation, ErrorFilter::Internal, ErrorFilter::OutOfMemory];
        let scopes = filters.map(|filter| self.device.push_error_scope(filter));
        let done = work().await;
        let mut fault = None;
        for scope in scopes.into_iter().rev() {
            fault = fault.or(scope.pop().await);
        }
        match fault {
            None => done,
            Some(wgpu::Error::OutOfMemory { .. }) => {
                Err(Error::device("is out of memory; give it less video memory, or close what else uses it"))
            }
            Some(fault) => Err(Error::device(one_line(&fault.to_string()))),
        }
    }

    /// Creates a buffer of at least `bytes` bytes. Its size is a multiple of 16 (the largest element) and not 0.
    pub(crate) fn buffer(&self, label: &str, bytes: u64, usage: BufferUsages) -> Result<Buffer> {
        let size = bytes.max(16).next_multiple_of(16);
        let is_storage = usage.contains(BufferUsages::STORAGE);
        let have = if is_storage { self.max_binding() } else { self.limits.max_buffer_size };
        if size > have {
            let what = format!("a graphics device's buffer of {label} in bytes");
            return Err(Error::Limit { what, need: size, have });
        }
        Ok(self.device.create_buffer(&BufferDescriptor { label: Some(label), size, usage, mapped_at_creation: false }))
    }

    /// Copies `bytes`, a whole number of 4-byte words, to `buffer` at `offset` bytes; waits if too much is unfinished.
    /// In a browser nothing can wait; there the browser holds what is unfinished.
    pub(crate) fn write(&self, buffer: &Buffer, offset: u64, bytes: &[u8]) -> Result<()> {
        self.queue.write_buffer(buffer, offset, bytes);
        let in_flight = self.in_flight.fetch_add(bytes.len() as u64, Ordering::Relaxed) + bytes.len() as u64;
        if in_flight > self.max_in_flight { self.submit([]).and_then(|()| self.wait()) } else { Ok(()) }
    }

    /// Copies `bytes`, a whole number of 4-byte words, to the start of `buffer`, at most 1 MiB at a time.
    pub(crate) fn fill(&self, buffer: &Buffer, bytes: &[u8]) -> Result<()> {
        (0u64..).zip(bytes.chunks(1 << 20)).try_for_each(|(part, bytes)| self.write(buffer, part << 20, bytes))
    }

    /// Creates an encoder for commands to the device.
    pub(crate) fn encoder(&self, label: &str) -> CommandEncoder {
        self.device.create_command_encoder(&CommandEncoderDescriptor { label: Some(label) })
    }

    /// Submits work to the device and frees what finished work held.
    pub(crate) fn submit(&self, work: impl IntoIterator<Item = CommandBuffer>) -> Result<()> {
        self.queue.submit(work);
        self.poll(PollType::Poll)
    }

    /// Waits until all work is done; in a browser, which does not let anything wait, returns at once.
    pub(crate) fn wait(&self) -> Result<()> {
        if !cfg!(target_arch = "wasm32") {
            self.poll(PollType::Wait { submission_index: None, timeout: Some(HANG_TIMEOUT) })?;
        }
        self.in_flight.store(0, Ordering::Relaxed);
        Ok(())
    }

    /// Polls the device. If a driver says that the device is lost, wgpu panics; this function returns an error instead.
    fn poll(&self, how: PollType) -> Result<()> {
        match catch_unwind(AssertUnwindSafe(|| self.device.poll(how))) {
            Ok(Ok(_)) => Ok(()),
            Ok(Err(fault)) => Err(Error::device(format!("does not answer: {}", one_line(&fault.to_string())))),
            Err(_) => Err(Error::device("was lost, or is out of memory")),
        }
    }

    /// Waits for all work, then calls `read` with the first `bytes` bytes of `buffer`, which must be mappable.
    pub(crate) async fn read<T>(&self, buffer: &Buffer, bytes: u64, read: impl FnOnce(&[u8]) -> T) -> Result<T> {
        let slice = buffer.slice(0..bytes);
        let (sender, receiver) = oneshot::channel();
        slice.map_async(MapMode::Read, move |result| {
            // Sending fails only if waiting for the device failed before, so that nobody receives.
            let _ = sender.send(result);
        });
        self.wait()?;
        let failed = || Error::device("did not give its results back; it was lost, or it is out of memory");
        // If another thread waits for the device too, it may be the one that runs the callback, a moment later.
        receiver.await.map_err(|_| failed())?.map_err(|_| failed())?;
        let view = slice.get_mapped_range().map_err(|_| failed())?;
        let result = read(&view);
        drop(view);
        buffer.unmap();
        Ok(result)
    }
}

/// Returns a message in one line: each run of white space becomes one space.
pub(crate) fn one_line(message: &str) -> String {
    message.split_whitespace().collect::<Vec<_>>().join(" ")
}
