//! A device and its queue, whose faults become errors.
//!
//! In: a device that the caller made. Out: buffers within its limits, copies to and from them, and its faults as
//! [`Error::Device`], which all of the renderer may return. Faults are caught in error scopes, so handlers that the caller
//! set on the device stay in force.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use wgpu::{
    Buffer, BufferDescriptor, BufferUsages, CommandBuffer, CommandEncoder, CommandEncoderDescriptor, Device,
    ErrorFilter, Limits, MapMode, PollType, Queue,
};

use crate::error::{Error, Result};

pub(crate) const MAX_BINDING: u64 = 128 << 20; // Largest binding in use, in bytes: what every device allows.

const HANG_TIMEOUT: Duration = Duration::from_secs(600); // Software draws large frames for minutes.

/// A device, its queue, and how many bytes are on their way to it.
#[derive(Debug)]
pub(crate) struct Context {
    pub(crate) device: Device,
    pub(crate) queue: Queue,
    pub(crate) limits: Limits,
    max_in_flight: u64,
    in_flight: AtomicU64,
}

impl Context {
    /// Wraps a device; at most `max_in_flight` bytes of copies to it are on their way at a time.
    pub(crate) fn new(device: Device, queue: Queue, max_in_flight: u64) -> Context {
        let limits = device.limits();
        Context { device, queue, limits, max_in_flight, in_flight: AtomicU64::new(0) }
    }

    /// Returns the bytes of the largest storage binding.
    pub(crate) fn max_binding(&self) -> u64 {
        MAX_BINDING.min(self.limits.max_storage_buffer_binding_size).min(self.limits.max_buffer_size)
    }

    /// Runs `work` and turns the device's complaints meanwhile into [`Error::Device`].
    pub(crate) fn watch<T>(&self, work: impl FnOnce() -> Result<T>) -> Result<T> {
        let filters = [ErrorFilter::Validation, ErrorFilter::Internal, ErrorFilter::OutOfMemory];
        let scopes = filters.map(|filter| self.device.push_error_scope(filter));
        let done = work();
        let mut fault = None;
        for scope in scopes.into_iter().rev() {
            fault = fault.or(pollster::block_on(scope.pop()));
        }
        match fault {
            None => done,
            Some(wgpu::Error::OutOfMemory { .. }) => {
                Err(Error::device("is out of memory; give it less video memory, or close what else uses it"))
            }
            Some(fault) => Err(Error::device(one_line(&fault.to_string()))),
        }
    }

    /// Creates a buffer of at least `bytes` bytes, a multiple of 16 (the largest element) and never empty.
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

    /// Copies `bytes`, a whole number of words, to `buffer`.
    pub(crate) fn write(&self, buffer: &Buffer, offset: u64, bytes: &[u8]) -> Result<()> {
        self.queue.write_buffer(buffer, offset, bytes);
        let in_flight = self.in_flight.fetch_add(bytes.len() as u64, Ordering::Relaxed) + bytes.len() as u64;
        if in_flight > self.max_in_flight { self.submit([]).and_then(|()| self.wait()) } else { Ok(()) }
    }

    /// Fills `buffer` from its start with `bytes`, a whole number of words, by copies of at most 1 MiB.
    pub(crate) fn fill(&self, buffer: &Buffer, bytes: &[u8]) -> Result<()> {
        (0u64..).zip(bytes.chunks(1 << 20)).try_for_each(|(part, bytes)| self.write(buffer, part << 20, bytes))
    }

    /// Creates an encoder of commands.
    pub(crate) fn encoder(&self, label: &str) -> CommandEncoder {
        self.device.create_command_encoder(&CommandEncoderDescriptor { label: Some(label) })
    }

    /// Hands work to the device and frees what finished work held.
    pub(crate) fn submit(&self, work: impl IntoIterator<Item = CommandBuffer>) -> Result<()> {
        self.queue.submit(work);
        self.poll(PollType::Poll)
    }

    /// Waits until all work is done.
    pub(crate) fn wait(&self) -> Result<()> {
        self.poll(PollType::Wait { submission_index: None, timeout: Some(HANG_TIMEOUT) })?;
        self.in_flight.store(0, Ordering::Relaxed);
        Ok(())
    }

    /// Polls; wgpu panics where a driver says that its device is lost, which is an error here.
    fn poll(&self, how: PollType) -> Result<()> {
        match catch_unwind(AssertUnwindSafe(|| self.device.poll(how))) {
            Ok(Ok(_)) => Ok(()),
            Ok(Err(fault)) => Err(Error::device(format!("does not answer: {}", one_line(&fault.to_string())))),
            Err(_) => Err(Error::device("was lost, or is out of memory")),
        }
    }

    /// Waits for all work, then calls `read` with the first `bytes` bytes of `buffer`, which must be mappable.
    pub(crate) fn read<T>(&self, buffer: &Buffer, bytes: u64, read: impl FnOnce(&[u8]) -> T) -> Result<T> {
        let slice = buffer.slice(0..bytes);
        let (sender, receiver) = std::sync::mpsc::channel();
        slice.map_async(MapMode::Read, move |result| {
            // Nobody listens only where waiting failed before.
            let _ = sender.send(result);
        });
        self.wait()?;
        let failed = || Error::device("did not give its results back; it was lost, or it is out of memory");
        // Another thread that waits for the device may run the callback, a moment later.
        receiver.recv_timeout(HANG_TIMEOUT).map_err(|_| failed())?.map_err(|_| failed())?;
        let view = slice.get_mapped_range().map_err(|_| failed())?;
        let result = read(&view);
        drop(view);
        buffer.unmap();
        Ok(result)
    }
}

/// Returns a message without its line ends.
pub(crate) fn one_line(message: &str) -> String {
    message.split_whitespace().collect::<Vec<_>>().join(" ")
}
