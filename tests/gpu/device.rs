//! The device that the tests run on.

use std::sync::OnceLock;

use adjsplat::splat::gpu::adapter::{OpenedDevice, open};
use adjsplat_tests::{say, skipped};
use bytemuck::Pod;
use wgpu::{Buffer, BufferDescriptor, BufferUsages, Device, MapMode, PollType, Queue};

/// The device that most tests share; `None`, said loudly, where there is none.
pub(crate) fn device() -> Option<&'static OpenedDevice> {
    static SHARED: OnceLock<Option<OpenedDevice>> = OnceLock::new();
    SHARED.get_or_init(own_device).as_ref()
}

/// A device of the test's own.
pub(crate) fn own_device() -> Option<OpenedDevice> {
    match open(None) {
        Ok(opened) => {
            let facts = &opened.facts;
            say(&format!("tests/gpu runs on {} ({}, {})", facts.name, facts.backend, facts.driver));
            Some(opened)
        }
        Err(fault) => {
            skipped("ADJ_GPU", &format!("a test of the graphics renderer: {fault}"));
            None
        }
    }
}

/// What a buffer holds.
pub(crate) fn read<T: Pod>(device: &Device, queue: &Queue, buffer: &Buffer) -> Vec<T> {
    let size = buffer.size();
    let usage = BufferUsages::MAP_READ | BufferUsages::COPY_DST;
    let back = device.create_buffer(&BufferDescriptor { label: None, size, usage, mapped_at_creation: false });
    let mut encoder = device.create_command_encoder(&Default::default());
    encoder.copy_buffer_to_buffer(buffer, 0, &back, 0, None);
    queue.submit([encoder.finish()]);
    let (sender, receiver) = std::sync::mpsc::channel();
    back.slice(..).map_async(MapMode::Read, move |result| sender.send(result).expect("it is waited for"));
    device.poll(PollType::wait_indefinitely()).expect("the device answers");
    // Tests share the device: another's waiting may be what is told.
    receiver.recv().expect("the device answers").expect("the device maps its buffers");
    let bytes = back.slice(..).get_mapped_range().expect("it is mapped").to_vec();
    let whole = bytes.len() - bytes.len() % size_of::<T>();
    bytemuck::pod_collect_to_vec(&bytes[..whole])
}
