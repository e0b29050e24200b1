//! A radix sort on the device, which a renderer without the structure needs in each frame.
//!
//! In: distances. Out: their indices, far ones last, equal ones in their order before. Four passes of 8 bits; sort.wgsl.

use wgpu::{
    BindGroup, BindGroupDescriptor, BindGroupEntry, BindGroupLayoutDescriptor, BindGroupLayoutEntry, BindingType,
    Buffer, BufferBindingType, ComputePipeline, ComputePipelineDescriptor, PipelineCompilationOptions,
    PipelineLayoutDescriptor, ShaderModuleDescriptor, ShaderSource, ShaderStages,
};

use super::device::Gpu;

/// Elements of a workgroup.
const SHARE: usize = 4_096;
const DIGITS: u32 = 256;
/// Bytes that a sort reads and writes for each element: the key is made, then four times counted (key read) and scattered
/// (key and index, read and written).
pub(crate) const BYTES: u64 = 4 + 8 + 4 * (4 + 16);

/// The pipelines.
pub(crate) struct Sorter {
    layout: wgpu::BindGroupLayout,
    key: ComputePipeline,
    scan: ComputePipeline,
    /// Count and scatter, by byte of the key.
    passes: [[ComputePipeline; 2]; 4],
}

/// Distances on the device, and the buffers to sort them.
pub(crate) struct Sorting {
    groups: u32,
    /// Bindings from the second pair of buffers to the first, and back.
    ways: [BindGroup; 2],
    keys: Buffer,
    /// Indices in the order of their distances, once sorted.
    pub(crate) places: Buffer,
}

impl Sorter {
    pub(crate) fn new(gpu: &Gpu) -> Sorter {
        let device = &gpu.device;
        let source = ShaderSource::Wgsl(include_str!("sort.wgsl").into());
        let module = device.create_shader_module(ShaderModuleDescriptor { label: Some("sort"), source });
        let entry = |binding: u32| {
            let ty = BufferBindingType::Storage { read_only: binding < 3 };
            let ty = BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None };
            BindGroupLayoutEntry { binding, visibility: ShaderStages::COMPUTE, ty, count: None }
        };
        let entries: Vec<_> = (0..7).map(entry).collect();
        let layout =
            device.create_bind_group_layout(&BindGroupLayoutDescriptor { label: Some("sort"), entries: &entries });
        let bind_group_layouts = &[Some(&layout)];
        let descriptor = PipelineLayoutDescriptor { label: Some("sort"), bind_group_layouts, immediate_size: 0 };
        let pipeline_layout = device.create_pipeline_layout(&descriptor);
        let pipeline = |name: &str, shift: u32| {
            device.create_compute_pipeline(&ComputePipelineDescriptor {
                label: Some(name),
                layout: Some(&pipeline_layout),
                module: &module,
                entry_point: Some(name),
                compilation_options: PipelineCompilationOptions {
                    constants: &[("SHIFT", shift.into())],
                    ..Default::default()
                },
                cache: None,
            })
        };
        let passes = [0, 8, 16, 24].map(|shift| ["count", "scatter"].map(|name| pipeline(name, shift)));
        Sorter { key: pipeline("key", 0), scan: pipeline("scan", 0), passes, layout }
    }

    /// Copies `distances`, at least one, to the device.
    pub(crate) fn prepare(&self, gpu: &Gpu, distances: &[f32]) -> Sorting {
        let groups = u32::try_from(distances.len().div_ceil(SHARE)).expect("below 2^32");
        let bytes = 4 * distances.len() as u64;
        let distances = gpu.filled("distances", distances);
        let [keys, places, other_keys, other_places] =
            ["keys", "places", "other keys", "other places"].map(|label| gpu.buffer(label, bytes));
        let counts = gpu.buffer("counts", u64::from(4 * DIGITS * groups));
        let totals = gpu.buffer("totals", u64::from(4 * DIGITS));
        let way = |from: [&Buffer; 2], to: [&Buffer; 2]| {
            let buffers = [&distances, from[0], from[1], to[0], to[1], &counts, &totals];
            let entries: Vec<_> = (0u32..)
                .zip(buffers)
                .map(|(binding, buffer)| BindGroupEntry { binding, resource: buffer.as_entire_binding() })
                .collect();
            let descriptor = BindGroupDescriptor { label: Some("sort"), layout: &self.layout, entries: &entries };
            gpu.device.create_bind_group(&descriptor)
        };
        let (first, second) = ([&keys, &places], [&other_keys, &other_places]);
        let ways = [way(second, first), way(first, second)];
        Sorting { groups, ways, keys, places }
    }

    /// Sorts; returns milliseconds.
    pub(crate) fn sort(&self, gpu: &Gpu, sorting: &Sorting) -> f64 {
        let [to_first, to_second] = &sorting.ways;
        gpu.time_compute(|pass| {
            let mut run = |pipeline: &ComputePipeline, way: &BindGroup, groups: u32| {
                pass.set_pipeline(pipeline);
                pass.set_bind_group(0, way, &[]);
                pass.dispatch_workgroups(groups, 1, 1);
            };
            run(&self.key, to_first, sorting.groups);
            for ([count, scatter], way) in self.passes.iter().zip([to_second, to_first, to_second, to_first]) {
                run(count, way, sorting.groups);
                run(&self.scan, way, DIGITS);
                run(scatter, way, sorting.groups);
            }
        })
    }
}

/// Checks the sort against the processor's, for sizes around those of its parts and for many equal keys.
pub(crate) fn check(gpu: &Gpu) {
    let sorter = Sorter::new(gpu);
    for (count, kinds) in [(1, 1), (255, 7), (256, 3), (257, 1 << 20), (4_096, 2), (4_097, 300), (1_100_003, 5_000)] {
        let mut state = 1u32;
        let distances: Vec<f32> = (0..count)
            .map(|_| {
                // Numerical Recipes' generator; its low bits are poor.
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                ((state >> 8) % kinds) as f32 * 0.37 - 400.0
            })
            .collect();
        let sorting = sorter.prepare(gpu, &distances);
        // Twice, because buffers are reused.
        for _ in 0..2 {
            sorter.sort(gpu, &sorting);
        }
        let mut want: Vec<u32> = (0..).take(distances.len()).collect();
        want.sort_by(|&a, &b| distances[a as usize].total_cmp(&distances[b as usize]));
        let got: Vec<u32> = gpu.read(&sorting.places, distances.len());
        assert!(got == want, "{count} distances of {kinds} kinds are not in order");
        let keys: Vec<u32> = gpu.read(&sorting.keys, distances.len());
        assert!(keys.is_sorted(), "keys of {count} distances are not in order");
    }
}
