//! The memory's bandwidth: bytes read and written a second by a copy of a large buffer.

use wgpu::{BindGroupDescriptor, BindGroupEntry, ComputePipelineDescriptor, ShaderModuleDescriptor, ShaderSource};

use super::device::Gpu;
use super::report::median;

/// Workgroups of the copy: enough to fill a large card, each with several turns.
const GROUPS: u32 = 16_384;

/// Returns gigabytes (10^9) a second, and the buffer's bytes: at most 512 MiB, far beyond any cache.
pub(crate) fn measure(gpu: &Gpu) -> (f64, u64) {
    let most = if gpu.facts.is_software() { 64 << 20 } else { 512 << 20 };
    let bytes = gpu.most_binding().min(most) & !15;
    let [from, to] = ["from", "to"].map(|label| gpu.buffer(label, bytes));
    let source = ShaderSource::Wgsl(include_str!("copy.wgsl").into());
    let module = gpu.device.create_shader_module(ShaderModuleDescriptor { label: Some("copy"), source });
    let pipeline = gpu.device.create_compute_pipeline(&ComputePipelineDescriptor {
        label: Some("copy"),
        layout: None,
        module: &module,
        entry_point: Some("copy"),
        compilation_options: Default::default(),
        cache: None,
    });
    let group = gpu.device.create_bind_group(&BindGroupDescriptor {
        label: Some("copy"),
        layout: &pipeline.get_bind_group_layout(0),
        entries: &[
            BindGroupEntry { binding: 0, resource: from.as_entire_binding() },
            BindGroupEntry { binding: 1, resource: to.as_entire_binding() },
        ],
    });
    let copy = || {
        gpu.time_compute(|pass| {
            pass.set_pipeline(&pipeline);
            pass.set_bind_group(0, &group, &[]);
            pass.dispatch_workgroups(GROUPS, 1, 1);
        })
    };
    copy();
    let ms = median((0..9).map(|_| copy()).collect());
    (2.0 * bytes as f64 / ms * 1e-6, bytes)
}
