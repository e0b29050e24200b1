//! The memory's bandwidth, and whether the device's clock tells the truth: both by copies of a large buffer.

use wgpu::{
    BindGroup, BindGroupDescriptor, BindGroupEntry, ComputePipeline, ComputePipelineDescriptor,
    PipelineCompilationOptions, ShaderModuleDescriptor, ShaderSource,
};

use super::device::{Gpu, Taken};
use super::report::median;

/// Workgroups of the copy: enough to fill a large card, each with several turns.
const GROUPS: u32 = 16_384;
/// Rounds of the copy that judges the clock: milliseconds on the fastest card, so that handing over does not count.
const ROUNDS: u32 = 32;

/// Two buffers, and the pipelines that copy one to the other once and [`ROUNDS`] times.
pub(crate) struct Copier {
    pub(crate) bytes: u64,
    ways: [(ComputePipeline, BindGroup); 2],
}

impl Copier {
    /// Buffers of 512 MiB where the device binds as much, far beyond any cache; less on a processor.
    pub(crate) fn new(gpu: &Gpu) -> Copier {
        let most = if gpu.facts.is_software() { 64 << 20 } else { 512 << 20 };
        let bytes = gpu.most_binding().min(most) & !15;
        let [from, to] = ["from", "to"].map(|label| gpu.buffer(label, bytes));
        let source = ShaderSource::Wgsl(include_str!("copy.wgsl").into());
        let module = gpu.device.create_shader_module(ShaderModuleDescriptor { label: Some("copy"), source });
        let ways = [1, ROUNDS].map(|rounds| {
            let constants = &[("ROUNDS", f64::from(rounds))];
            let pipeline = gpu.device.create_compute_pipeline(&ComputePipelineDescriptor {
                label: Some("copy"),
                layout: None,
                module: &module,
                entry_point: Some("copy"),
                compilation_options: PipelineCompilationOptions { constants, ..Default::default() },
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
            (pipeline, group)
        });
        Copier { bytes, ways }
    }

    fn copy(&self, gpu: &Gpu, way: usize) -> Taken {
        gpu.compute(|pass| {
            pass.set_pipeline(&self.ways[way].0);
            pass.set_bind_group(0, &self.ways[way].1, &[]);
            pass.dispatch_workgroups(GROUPS, 1, 1);
        })
    }

    /// Gigabytes (10^9) read and written a second.
    pub(crate) fn bandwidth(&self, gpu: &Gpu) -> f64 {
        self.copy(gpu, 0);
        let ms = median((0..9).map(|_| gpu.best(self.copy(gpu, 0))).collect());
        2.0 * self.bytes as f64 / ms * 1e-6
    }

    /// Whether the device's clock says at least half of what has passed until one long dispatch was done. Some drivers
    /// stop it before the work is done.
    pub(crate) fn clock_is_honest(&self, gpu: &Gpu) -> bool {
        self.copy(gpu, 1);
        let taken = self.copy(gpu, 1);
        taken.by_clock.is_some_and(|ms| ms >= 0.5 * taken.passed)
    }
}
