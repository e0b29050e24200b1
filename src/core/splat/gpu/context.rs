//! A device and its queue, whose faults are errors.
//!
//! In: a device that somebody else made. Out: buffers within its limits, copies to and from them, and whatever the
//! device complains of as [`Error::Device`]. Faults are caught in error scopes, so that the device's own handlers stay
//! the caller's.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use wgpu::{
    Buffer, BufferDescriptor, BufferUsages, CommandBuffer, Device, ErrorFilter, Limits, MapMode, PollType, Queue,
};

use crate::error::{Error, Result};

/// Largest binding in use, whatever a device allows: what every device allows.
pub(crate) const MOST_BINDING: u64 = 128 << 20;

/// A device that has not answered for so long is taken to hang; software draws large frames for minutes.
const HUNG: Duration = Duration::from_secs(600);

/// A device, its queue, and what is on its way.
#[derive(Debug)]
pub(crate) struct Context {
    pub(crate) device: Device,
    pub(crate) queue: Queue,
    pub(crate) limits: Limits,
    most_in_flight: u64,
    in_flight: AtomicU64,
}

impl Context {
    /// `most_in_flight`: bytes of copies to the device that may be on their way.
    pub(crate) fn new(device: Device, queue: Queue, most_in_flight: u64) -> Context {
        let limits = device.limits();
        Context { device, queue, limits, most_in_flight, in_flight: AtomicU64::new(0) }
    }

    /// Largest binding.
    pub(crate) fn most_binding(&self) -> u64 {
        MOST_BINDING.min(self.limits.max_storage_buffer_binding_size).min(self.limits.max_buffer_size)
    }

    /// Does `work`; what the device complains of meanwhile is an error.
    ///
    /// # Errors
    /// [`Error::Device`]; else those of `work`.
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

    /// A buffer of at least `bytes` bytes, a whole number of words and never empty.
    ///
    /// # Errors
    /// [`Error::Limit`] if the device allows no binding as large.
    pub(crate) fn buffer(&self, label: &str, bytes: u64, usage: BufferUsages) -> Result<Buffer> {
        // 16 bytes are the largest element.
        let size = bytes.max(16).next_multiple_of(16);
        let have =
            if usage.contains(BufferUsages::STORAGE) { self.most_binding() } else { self.limits.max_buffer_size };
        if size > have {
            return Err(Error::Limit {
                what: format!("a graphics device's buffer of {label} in bytes"),
                need: size,
                have,
            });
        }
        Ok(self.device.create_buffer(&BufferDescriptor { label: Some(label), size, usage, mapped_at_creation: false }))
    }

    /// Copies `bytes`, a whole number of words, to `buffer`.
    ///
    /// # Errors
    /// If the device fails.
    pub(crate) fn write(&self, buffer: &Buffer, offset: u64, bytes: &[u8]) -> Result<()> {
        self.queue.write_buffer(buffer, offset, bytes);
        let in_flight = self.in_flight.fetch_add(bytes.len() as u64, Ordering::Relaxed) + bytes.len() as u64;
        if in_flight > self.most_in_flight { self.submit([]).and_then(|()| self.wait()) } else { Ok(()) }
    }

    /// Hands work to the device.
    pub(crate) fn submit(&self, work: impl IntoIterator<Item = CommandBuffer>) -> Result<()> {
        self.queue.submit(work);
        // Lets go of what is done.
        self.poll(PollType::Poll)
    }

    /// Waits until all work is done.
    ///
    /// # Errors
    /// If the device is lost.
    pub(crate) fn wait(&self) -> Result<()> {
        self.poll(PollType::Wait { submission_index: None, timeout: Some(HUNG) })?;
        self.in_flight.store(0, Ordering::Relaxed);
        Ok(())
    }

    /// wgpu panics where a driver says that its device is lost: here it is an error.
    fn poll(&self, how: PollType) -> Result<()> {
        match catch_unwind(AssertUnwindSafe(|| self.device.poll(how))) {
            Ok(Ok(_)) => Ok(()),
            Ok(Err(fault)) => Err(Error::device(format!("does not answer: {}", one_line(&fault.to_string())))),
            Err(_) => Err(Error::device("was lost, or is out of memory")),
        }
    }

    /// Gives the first `bytes` bytes of `buffer`, which can be mapped, to `read`, once all work is done.
    ///
    /// # Errors
    /// If the device fails.
    pub(crate) fn read<T>(&self, buffer: &Buffer, bytes: u64, read: impl FnOnce(&[u8]) -> T) -> Result<T> {
        let slice = buffer.slice(0..bytes);
        let (sender, receiver) = std::sync::mpsc::channel();
        slice.map_async(MapMode::Read, move |result| {
            // Nobody listens only where waiting failed before.
            let _ = sender.send(result);
        });
        self.wait()?;
        let failed = || Error::device("did not give its results back; it was lost, or it is out of memory");
        // Another thread that waits for the device may be the one that is told, a moment later.
        receiver.recv_timeout(HUNG).map_err(|_| failed())?.map_err(|_| failed())?;
        let view = slice.get_mapped_range().map_err(|_| failed())?;
        let result = read(&view);
        drop(view);
        buffer.unmap();
        Ok(result)
    }
}

/// A message without its line ends.
pub(crate) fn one_line(message: &str) -> String {
    message.split_whitespace().collect::<Vec<_>>().join(" ")
}
