//! The pipelines of the stages, and the binding of their buffers.
//!
//! In: a device. Out: the compute stages walk, project, bin and tile, and the drawing stage splat, the last two for
//! each [`BlendMode`]. A shader is `shaders/common.wgsl` followed by its own file; its twin (the same stage in Rust,
//! for tests) has the same name in tests/gpu/twin.

use std::num::NonZeroU64;
use std::sync::OnceLock;

use wgpu::{
    BindGroup, BindGroupDescriptor, BindGroupEntry, BindGroupLayout, BindGroupLayoutDescriptor, BindGroupLayoutEntry,
    BindingResource, BindingType, BlendComponent, BlendFactor, BlendOperation, BlendState, Buffer, BufferBinding,
    BufferBindingType, ColorTargetState, ColorWrites, CommandEncoder, ComputePipeline, ComputePipelineDescriptor,
    Device, FragmentState, LoadOp, MultisampleState, Operations, PipelineCompilationOptions, PipelineLayoutDescriptor,
    PrimitiveState, PrimitiveTopology, RenderPass, RenderPassColorAttachment, RenderPassDescriptor,
    RenderPassTimestampWrites, RenderPipeline, RenderPipelineDescriptor, ShaderModule, ShaderModuleDescriptor,
    ShaderSource, ShaderStages, StoreOp, TextureFormat, TextureView, VertexState,
};

use super::QuadFormat;
use super::layout::Chunk;
use crate::splat::Mode;
use crate::traverse::Sense;

macro_rules! shader {
    ($file:literal) => {
        concat!(include_str!("shaders/common.wgsl"), include_str!(concat!("shaders/", $file)))
    };
}

/// The text of each stage's shader, by the stage's name.
pub const SHADERS: [(&str, &str); 5] = [
    ("walk", shader!("walk.wgsl")),
    ("project", shader!("project.wgsl")),
    ("bin", shader!("bin.wgsl")),
    ("tile", shader!("tile.wgsl")),
    ("splat", shader!("splat.wgsl")),
];

pub(crate) const RESOLVE: &str = shader!("resolve.wgsl"); // The text of the shader that writes pixels to a texture.

/// How a splat changes a pixel; numbered as in the shaders.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BlendMode {
    /// Composites near splats first; the fourth value of a pixel is its transmittance.
    FrontToBack,
    /// Composites far splats first.
    BackToFront,
    /// Sums splats, in any order.
    Additive,
    /// Keeps the largest values.
    Maximum,
}

impl BlendMode {
    pub(crate) fn new(mode: Mode, sense: Sense) -> BlendMode {
        match (mode, sense) {
            (Mode::Composite, Sense::FrontToBack) => BlendMode::FrontToBack,
            (Mode::Composite, Sense::BackToFront) => BlendMode::BackToFront,
            (Mode::Additive, _) => BlendMode::Additive,
            (Mode::Maximum | Mode::MaximumGrey, _) => BlendMode::Maximum,
        }
    }

    /// Returns the initial alpha (fourth value) of a pixel.
    pub(crate) fn initial_alpha(self) -> f32 {
        if matches!(self, BlendMode::FrontToBack | BlendMode::BackToFront) { 1.0 } else { 0.0 }
    }

    /// Returns the blend state of the device for quads in this mode.
    fn state(self) -> BlendState {
        use BlendFactor::{DstAlpha, One, OneMinusSrcAlpha, Zero};
        let add = |src_factor, dst_factor| BlendComponent { src_factor, dst_factor, operation: BlendOperation::Add };
        let max = BlendComponent { src_factor: One, dst_factor: One, operation: BlendOperation::Max };
        let (color, alpha) = match self {
            BlendMode::FrontToBack => (add(DstAlpha, One), add(Zero, OneMinusSrcAlpha)),
            BlendMode::BackToFront => (add(One, OneMinusSrcAlpha), add(Zero, OneMinusSrcAlpha)),
            BlendMode::Additive => (add(One, One), add(One, One)),
            BlendMode::Maximum => (max, max),
        };
        BlendState { color, alpha }
    }
}

impl QuadFormat {
    pub(super) fn format(self) -> TextureFormat {
        match self {
            QuadFormat::Float32 => TextureFormat::Rgba32Float,
            QuadFormat::Float16 => TextureFormat::Rgba16Float,
            QuadFormat::Unorm8 => TextureFormat::Rgba8Unorm,
        }
    }

    pub(super) fn pixel_bytes(self) -> u32 {
        self.format().block_copy_size(None).expect("a format of whole bytes")
    }
}

/// The pipeline of a compute stage.
///
/// Binding 0 is the uniform of the window. Binding 1 is a chunk, at an offset that each dispatch states. Then come the
/// buffers that the stage reads, then those that it writes.
#[derive(Debug)]
pub(crate) struct ComputeStage {
    pub(crate) pipeline: ComputePipeline,
    layout: BindGroupLayout,
}

impl ComputeStage {
    /// Compiles the stage `name`, which reads `reads` buffers and writes `writes`. `blend`: the number of a
    /// [`BlendMode`], or empty.
    fn new(device: &Device, name: &str, module: &ShaderModule, [reads, writes]: [usize; 2], blend: &[f64]) -> Self {
        let uniform = |moves| (BufferBindingType::Uniform, moves);
        let storage = |read_only, count| std::iter::repeat_n((BufferBindingType::Storage { read_only }, false), count);
        let kinds =
            [uniform(false), uniform(true)].into_iter().chain(storage(true, reads)).chain(storage(false, writes));
        let entries: Vec<_> = (0..)
            .zip(kinds)
            .map(|(binding, (ty, has_dynamic_offset))| BindGroupLayoutEntry {
                binding,
                visibility: ShaderStages::COMPUTE,
                ty: BindingType::Buffer { ty, has_dynamic_offset, min_binding_size: None },
                count: None,
            })
            .collect();
        let label = Some(name);
        let layout = device.create_bind_group_layout(&BindGroupLayoutDescriptor { label, entries: &entries });
        let bind_group_layouts = &[Some(&layout)];
        let descriptor = PipelineLayoutDescriptor { label, bind_group_layouts, immediate_size: 0 };
        let constants: Vec<_> = blend.iter().map(|&blend| ("BLEND", blend)).collect();
        let pipeline = device.create_compute_pipeline(&ComputePipelineDescriptor {
            label,
            layout: Some(&device.create_pipeline_layout(&descriptor)),
            module,
            entry_point: label,
            compilation_options: PipelineCompilationOptions { constants: &constants, ..Default::default() },
            cache: None,
        });
        ComputeStage { pipeline, layout }
    }

    /// Binds the uniform, the buffer of all chunks, and the stage's own buffers in the order of its shader.
    pub(crate) fn bind(&self, device: &Device, uniform: &Buffer, chunks: &Buffer, buffers: &[&Buffer]) -> BindGroup {
        let size = NonZeroU64::new(size_of::<Chunk>() as u64);
        let chunk = BindingResource::Buffer(BufferBinding { buffer: chunks, offset: 0, size });
        let mut resources = vec![uniform.as_entire_binding(), chunk];
        resources.extend(buffers.iter().map(|buffer| buffer.as_entire_binding()));
        bind(device, &self.layout, resources)
    }
}

/// Binds the resources to the bindings 0, 1, 2 and so on.
fn bind(device: &Device, layout: &BindGroupLayout, resources: Vec<BindingResource>) -> BindGroup {
    let entry = |(binding, resource)| BindGroupEntry { binding, resource };
    let entries: Vec<_> = (0..).zip(resources).map(entry).collect();
    device.create_bind_group(&BindGroupDescriptor { label: Some("stage"), layout, entries: &entries })
}

/// The pipelines of all stages; those of a blend mode are compiled on first use.
#[derive(Debug)]
pub(crate) struct Pipelines {
    pub(crate) walk: ComputeStage,
    pub(crate) project: ComputeStage,
    pub(crate) bin: ComputeStage,
    tile_module: ShaderModule,
    tiles: [OnceLock<ComputeStage>; 4],
    splat_module: ShaderModule,
    splats: [[OnceLock<RenderPipeline>; 3]; 4],
}

impl Pipelines {
    pub(crate) fn new(device: &Device) -> Pipelines {
        let [walk, project, bin, tile_module, splat_module] =
            SHADERS.map(|(label, text)| shader_module(device, label, text));
        Pipelines {
            walk: ComputeStage::new(device, "walk", &walk, [5, 1], &[]),
            project: ComputeStage::new(device, "project", &project, [6, 2], &[]),
            bin: ComputeStage::new(device, "bin", &bin, [1, 1], &[]),
            tile_module,
            tiles: Default::default(),
            splat_module,
            splats: Default::default(),
        }
    }

    /// Returns the stage that composites tiles; compiles it on first use.
    pub(crate) fn tile(&self, device: &Device, blend: BlendMode) -> &ComputeStage {
        let compile = || ComputeStage::new(device, "tile", &self.tile_module, [2, 1], &[f64::from(blend as u8)]);
        self.tiles[blend as usize].get_or_init(compile)
    }

    /// Returns the stage that draws quads into a target; compiles it on first use.
    pub(crate) fn splat(&self, device: &Device, blend: BlendMode, target: QuadFormat) -> &RenderPipeline {
        self.splats[blend as usize][target as usize].get_or_init(|| {
            let (format, entries) = (target.format(), ["corner", "pixel"]);
            let target = ColorTargetState { format, blend: Some(blend.state()), write_mask: ColorWrites::ALL };
            let constants = [("BLEND", f64::from(blend as u8))];
            let topology = PrimitiveTopology::TriangleStrip;
            render_pipeline(device, "splat", &self.splat_module, entries, topology, target, &constants)
        })
    }

    /// Binds the uniform and the splats for drawing quads.
    pub(crate) fn bind_splat(device: &Device, pipeline: &RenderPipeline, buffers: [&Buffer; 2]) -> BindGroup {
        bind(device, &pipeline.get_bind_group_layout(0), buffers.map(Buffer::as_entire_binding).into())
    }
}

/// Compiles a shader.
pub(crate) fn shader_module(device: &Device, label: &str, text: &'static str) -> ShaderModule {
    device.create_shader_module(ShaderModuleDescriptor { label: Some(label), source: ShaderSource::Wgsl(text.into()) })
}

/// Compiles the pipeline of a drawing stage; `entries`: names of the vertex and the fragment function in the shader.
pub(crate) fn render_pipeline(
    device: &Device,
    label: &str,
    module: &ShaderModule,
    entries: [&str; 2],
    topology: PrimitiveTopology,
    target: ColorTargetState,
    constants: &[(&str, f64)],
) -> RenderPipeline {
    let compilation_options = PipelineCompilationOptions { constants, ..Default::default() };
    let [vertex, fragment] = entries.map(Some);
    let (vertex_options, targets) = (compilation_options.clone(), &[Some(target)]);
    device.create_render_pipeline(&RenderPipelineDescriptor {
        label: Some(label),
        layout: None,
        vertex: VertexState { module, entry_point: vertex, compilation_options: vertex_options, buffers: &[] },
        primitive: PrimitiveState { topology, ..Default::default() },
        depth_stencil: None,
        multisample: MultisampleState::default(),
        fragment: Some(FragmentState { module, entry_point: fragment, compilation_options, targets }),
        multiview_mask: None,
        cache: None,
    })
}

/// Begins a render pass into `view`.
pub(crate) fn render_pass<'e>(
    encoder: &'e mut CommandEncoder,
    view: &TextureView,
    load: LoadOp<wgpu::Color>,
    timestamp_writes: Option<RenderPassTimestampWrites>,
) -> RenderPass<'e> {
    let ops = Operations { load, store: StoreOp::Store };
    encoder.begin_render_pass(&RenderPassDescriptor {
        color_attachments: &[Some(RenderPassColorAttachment { view, depth_slice: None, resolve_target: None, ops })],
        timestamp_writes,
        ..Default::default()
    })
}
