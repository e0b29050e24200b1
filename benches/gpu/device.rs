//! The device of the study, and its clock.
//!
//! In: passes to time. Out: milliseconds, by the device's own clock where it has one, else from submission to completion;
//! buffers that are filled and read back. The device is opened with its adapter's largest bindings, so that the splats
//! of a frame fit one where possible.

use std::time::Instant;

use adjsplat::splat::gpu::adapter;
use adjsplat::splat::gpu::adapter::AdapterFacts;
use bytemuck::Pod;
use wgpu::util::{BufferInitDescriptor, DeviceExt};
use wgpu::{
    Adapter, Backends, Buffer, BufferDescriptor, BufferUsages, Color, CommandEncoder, ComputePass,
    ComputePassDescriptor, ComputePassTimestampWrites, Device, DeviceDescriptor, Features, Instance,
    InstanceDescriptor, Limits, LoadOp, MapMode, Operations, PollType, QuerySet, QuerySetDescriptor, QueryType, Queue,
    RenderPass, RenderPassColorAttachment, RenderPassDescriptor, RenderPassTimestampWrites, StoreOp, TextureView,
};

/// How the study's buffers are used.
const STORAGE: BufferUsages = BufferUsages::STORAGE.union(BufferUsages::COPY_SRC).union(BufferUsages::COPY_DST);

pub(crate) struct Gpu {
    pub(crate) facts: AdapterFacts,
    pub(crate) device: Device,
    pub(crate) queue: Queue,
    clock: Option<Clock>,
}

struct Clock {
    set: QuerySet,
    resolved: Buffer,
}

impl Gpu {
    /// Opens the adapter that the renderer would take.
    pub(crate) fn open() -> Result<Gpu, String> {
        let facts = adapter::open(None).map_err(|fault| fault.to_string())?.facts;
        let instance = Instance::new(InstanceDescriptor::new_without_display_handle_from_env());
        let adapters = pollster::block_on(instance.enumerate_adapters(Backends::all()));
        let is_same = |adapter: &Adapter| {
            let found = adapter.get_info();
            found.name == facts.name && found.backend.to_string() == facts.backend
        };
        let adapter = adapters.into_iter().find(is_same).ok_or("the adapter is gone")?;
        let have = adapter.limits();
        let descriptor = DeviceDescriptor {
            label: Some("study"),
            required_features: adapter.features() & (Features::TIMESTAMP_QUERY | Features::FLOAT32_BLENDABLE),
            required_limits: Limits {
                max_storage_buffer_binding_size: have.max_storage_buffer_binding_size,
                max_buffer_size: have.max_buffer_size,
                max_texture_dimension_2d: have.max_texture_dimension_2d,
                ..Limits::defaults()
            },
            ..Default::default()
        };
        let (device, queue) =
            pollster::block_on(adapter.request_device(&descriptor)).map_err(|fault| fault.to_string())?;
        let clock = device.features().contains(Features::TIMESTAMP_QUERY).then(|| Clock {
            set: device.create_query_set(&QuerySetDescriptor { label: None, ty: QueryType::Timestamp, count: 2 }),
            resolved: device.create_buffer(&BufferDescriptor {
                label: Some("times"),
                size: 16,
                usage: BufferUsages::QUERY_RESOLVE | BufferUsages::COPY_SRC,
                mapped_at_creation: false,
            }),
        });
        Ok(Gpu { facts, device, queue, clock })
    }

    /// Returns whether times are by the device's clock.
    pub(crate) fn has_clock(&self) -> bool {
        self.clock.is_some()
    }

    /// Returns the bytes of the largest buffer that a shader can read.
    pub(crate) fn most_binding(&self) -> u64 {
        let limits = self.device.limits();
        limits.max_storage_buffer_binding_size.min(limits.max_buffer_size)
    }

    pub(crate) fn buffer(&self, label: &str, size: u64) -> Buffer {
        self.device.create_buffer(&BufferDescriptor {
            label: Some(label),
            size,
            usage: STORAGE,
            mapped_at_creation: false,
        })
    }

    pub(crate) fn filled<T: Pod>(&self, label: &str, contents: &[T]) -> Buffer {
        let contents = bytemuck::cast_slice(contents);
        self.device.create_buffer_init(&BufferInitDescriptor { label: Some(label), contents, usage: STORAGE })
    }

    pub(crate) fn uniform<T: Pod>(&self, label: &str, content: &T) -> Buffer {
        let (contents, usage) = (bytemuck::bytes_of(content), BufferUsages::UNIFORM);
        self.device.create_buffer_init(&BufferInitDescriptor { label: Some(label), contents, usage })
    }

    /// Returns the first `count` elements of `buffer`.
    pub(crate) fn read<T: Pod>(&self, buffer: &Buffer, count: usize) -> Vec<T> {
        let size = (count * size_of::<T>()) as u64;
        let back = self.device.create_buffer(&BufferDescriptor {
            label: Some("read back"),
            size,
            usage: BufferUsages::MAP_READ | BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let mut encoder = self.device.create_command_encoder(&Default::default());
        encoder.copy_buffer_to_buffer(buffer, 0, &back, 0, Some(size));
        self.queue.submit([encoder.finish()]);
        back.slice(..).map_async(MapMode::Read, |mapped| mapped.expect("it was made to be mapped"));
        self.wait();
        let view = back.slice(..).get_mapped_range().expect("it is mapped");
        bytemuck::pod_collect_to_vec(&view)
    }

    fn wait(&self) {
        self.device.poll(PollType::wait_indefinitely()).expect("the device is there");
    }

    /// Returns the milliseconds of a compute pass.
    pub(crate) fn time_compute(&self, record: impl FnOnce(&mut ComputePass)) -> f64 {
        self.time(|encoder, clock| {
            let timestamp_writes = clock.map(|clock| ComputePassTimestampWrites {
                query_set: &clock.set,
                beginning_of_pass_write_index: Some(0),
                end_of_pass_write_index: Some(1),
            });
            record(&mut encoder.begin_compute_pass(&ComputePassDescriptor { label: None, timestamp_writes }));
        })
    }

    /// Returns the milliseconds of a render pass into `target`, cleared to `start`.
    pub(crate) fn time_draw(&self, target: &TextureView, start: Color, record: impl FnOnce(&mut RenderPass)) -> f64 {
        self.time(|encoder, clock| {
            let timestamp_writes = clock.map(|clock| RenderPassTimestampWrites {
                query_set: &clock.set,
                beginning_of_pass_write_index: Some(0),
                end_of_pass_write_index: Some(1),
            });
            let attachment = RenderPassColorAttachment {
                view: target,
                depth_slice: None,
                resolve_target: None,
                ops: Operations { load: LoadOp::Clear(start), store: StoreOp::Store },
            };
            record(&mut encoder.begin_render_pass(&RenderPassDescriptor {
                label: None,
                color_attachments: &[Some(attachment)],
                timestamp_writes,
                ..Default::default()
            }));
        })
    }

    fn time(&self, record: impl FnOnce(&mut CommandEncoder, Option<&Clock>)) -> f64 {
        self.wait();
        let mut encoder = self.device.create_command_encoder(&Default::default());
        record(&mut encoder, self.clock.as_ref());
        if let Some(clock) = &self.clock {
            encoder.resolve_query_set(&clock.set, 0..2, &clock.resolved, 0);
        }
        let work = encoder.finish();
        let start = Instant::now();
        self.queue.submit([work]);
        self.wait();
        let passed = start.elapsed().as_secs_f64() * 1e3;
        let Some(clock) = &self.clock else { return passed };
        let ticks: Vec<u64> = self.read(&clock.resolved, 2);
        ticks[1].saturating_sub(ticks[0]) as f64 * f64::from(self.queue.get_timestamp_period()) * 1e-6
    }
}
