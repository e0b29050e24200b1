//! The pipelines of the stages, and the binding of their buffers.
//!
//! In: a device. Out: the compute stages walk, project, bin and tile, and the drawing stage splat. Tile and splat are compiled
//! for each [`BlendMode`], splat also for each format of the target. Project is compiled for maxima and for footprints. All
//! three, but for maxima, are compiled twice: with and without voxels near the eye.
//!
//! A shader is `shaders/common.wgsl` followed by its own file, of tile and splat also by `shaders/near.wgsl`. Its twin (the
//! same stage in Rust, for tests) has the same name in tests/gpu/twin.

use std::sync::OnceLock;

use wgpu::{
    BindGroup, BindGroupDescriptor, BindGroupEntry, BindGroupLayout, BindingResource, BlendComponent, BlendFactor,
    BlendOperation, BlendState, ColorTargetState, ColorWrites, CommandEncoder, ComputePipeline,
    ComputePipelineDescriptor, Device, FragmentState, LoadOp, MultisampleState, Operations, PipelineCompilationOptions,
    PrimitiveState, RenderPass, RenderPassColorAttachment, RenderPassDescriptor, RenderPassTimestampWrites,
    RenderPipeline, RenderPipelineDescriptor, ShaderModule, ShaderModuleDescriptor, ShaderSource, StoreOp,
    TextureFormat, TextureView, VertexState,
};

use super::QuadFormat;
use crate::splat::Mode;
use crate::traverse::Sense;

macro_rules! shader {
    ($($file:literal),+) => {
        concat!(include_str!("shaders/common.wgsl"), $(include_str!(concat!("shaders/", $file))),+)
    };
}

/// The text of each stage's shader, by the stage's name.
pub const SHADERS: [(&str, &str); 5] = [
    ("walk", shader!("walk.wgsl")),
    ("project", shader!("project.wgsl")),
    ("bin", shader!("bin.wgsl")),
    ("tile", shader!("near.wgsl", "tile.wgsl")),
    ("splat", shader!("near.wgsl", "splat.wgsl")),
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
    /// Keeps the largest interpolated value; in tiles only.
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
        let (color, alpha) = match self {
            BlendMode::FrontToBack => (add(DstAlpha, One), add(Zero, OneMinusSrcAlpha)),
            BlendMode::BackToFront => (add(One, OneMinusSrcAlpha), add(Zero, OneMinusSrcAlpha)),
            BlendMode::Additive => (add(One, One), add(One, One)),
            BlendMode::Maximum => unreachable!("a maximum is drawn in tiles"),
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

/// Binds the resources to the bindings 0, 1, 2 and so on.
pub(crate) fn bind<'r>(
    device: &Device,
    layout: &BindGroupLayout,
    resources: impl IntoIterator<Item = BindingResource<'r>>,
) -> BindGroup {
    let entry = |(binding, resource)| BindGroupEntry { binding, resource };
    let entries: Vec<_> = (0..).zip(resources).map(entry).collect();
    device.create_bind_group(&BindGroupDescriptor { label: Some("stage"), layout, entries: &entries })
}

/// The pipelines of all stages; those that depend on what is drawn are compiled on first use.
#[derive(Debug)]
pub(crate) struct Pipelines {
    pub(crate) walk: ComputePipeline,
    pub(crate) bin: ComputePipeline,
    project_module: ShaderModule,
    projects: [OnceLock<ComputePipeline>; 3],
    tile_module: ShaderModule,
    tiles: [[OnceLock<ComputePipeline>; 2]; 4],
    splat_module: ShaderModule,
    splats: [[[OnceLock<RenderPipeline>; 2]; 3]; 4],
}

impl Pipelines {
    pub(crate) fn new(device: &Device) -> Pipelines {
        let [walk, project_module, bin, tile_module, splat_module] =
            SHADERS.map(|(label, text)| shader_module(device, label, text));
        Pipelines {
            walk: compute_pipeline(device, "walk", &walk, &[]),
            bin: compute_pipeline(device, "bin", &bin, &[]),
            project_module,
            projects: Default::default(),
            tile_module,
            tiles: Default::default(),
            splat_module,
            splats: Default::default(),
        }
    }

    /// Returns the stage that computes splats; `has_near`: whether voxels may be near the eye. Compiles it on first use.
    pub(crate) fn project(&self, device: &Device, blend: BlendMode, has_near: bool) -> &ComputePipeline {
        let (index, is_maximum, has_near) = match (blend, has_near) {
            (BlendMode::Maximum, _) => (0, 1.0, 0.0),
            (_, false) => (1, 0.0, 0.0),
            (_, true) => (2, 0.0, 1.0),
        };
        let constants = [("IS_MAXIMUM", is_maximum), ("HAS_NEAR", has_near)];
        self.projects[index].get_or_init(|| compute_pipeline(device, "project", &self.project_module, &constants))
    }

    /// Returns the stage that composites tiles; `has_near`: whether splats may be of voxels near the eye. Compiles it on first
    /// use.
    pub(crate) fn tile(&self, device: &Device, blend: BlendMode, has_near: bool) -> &ComputePipeline {
        // In a maximum no voxel is near the eye.
        let has_near = has_near && blend != BlendMode::Maximum;
        let constants = [("BLEND", f64::from(blend as u8)), ("HAS_NEAR", f64::from(u8::from(has_near)))];
        self.tiles[blend as usize][usize::from(has_near)]
            .get_or_init(|| compute_pipeline(device, "tile", &self.tile_module, &constants))
    }

    /// Returns the stage that draws quads into a target; `has_near`: whether splats may be of voxels near the eye. Compiles it
    /// on first use.
    pub(crate) fn splat(
        &self,
        device: &Device,
        blend: BlendMode,
        target: QuadFormat,
        has_near: bool,
    ) -> &RenderPipeline {
        self.splats[blend as usize][target as usize][usize::from(has_near)].get_or_init(|| {
            let (format, entries) = (target.format(), ["corner", "pixel"]);
            let target = ColorTargetState { format, blend: Some(blend.state()), write_mask: ColorWrites::ALL };
            let constants = [("BLEND", f64::from(blend as u8)), ("HAS_NEAR", f64::from(u8::from(has_near)))];
            render_pipeline(device, "splat", &self.splat_module, entries, target, &constants)
        })
    }
}

/// Compiles a shader.
pub(crate) fn shader_module(device: &Device, label: &str, text: &'static str) -> ShaderModule {
    device.create_shader_module(ShaderModuleDescriptor { label: Some(label), source: ShaderSource::Wgsl(text.into()) })
}

/// Compiles the pipeline of the compute stage `name`, which is also the name of its function in the shader.
fn compute_pipeline(device: &Device, name: &str, module: &ShaderModule, constants: &[(&str, f64)]) -> ComputePipeline {
    device.create_compute_pipeline(&ComputePipelineDescriptor {
        label: Some(name),
        layout: None,
        module,
        entry_point: Some(name),
        compilation_options: PipelineCompilationOptions { constants, ..Default::default() },
        cache: None,
    })
}

/// Compiles the pipeline of a drawing stage; `entries`: names of the vertex and the fragment function in the shader.
pub(crate) fn render_pipeline(
    device: &Device,
    label: &str,
    module: &ShaderModule,
    entries: [&str; 2],
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
        primitive: PrimitiveState::default(),
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
