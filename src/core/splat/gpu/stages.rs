//! The stages: pipelines and what they bind.
//!
//! In: a device. Out: the compute stages walk, project, bin and tile, and the drawing stage splat for each way of
//! blending. Each shader is `shaders/common.wgsl` and its own file; each has a twin of the same name in `twin/`;
//! what resolve does is judged by frames that were read back.

use std::num::NonZeroU64;
use std::sync::OnceLock;

use wgpu::{
    BindGroup, BindGroupDescriptor, BindGroupEntry, BindGroupLayout, BindGroupLayoutDescriptor, BindGroupLayoutEntry,
    BindingResource, BindingType, BlendComponent, BlendFactor, BlendOperation, BlendState, BufferBinding,
    BufferBindingType, ColorTargetState, ColorWrites, ComputePipeline, ComputePipelineDescriptor, Device,
    FragmentState, MultisampleState, PipelineCompilationOptions, PipelineLayout, PipelineLayoutDescriptor,
    PrimitiveState, PrimitiveTopology, RenderPipeline, RenderPipelineDescriptor, ShaderModule, ShaderModuleDescriptor,
    ShaderSource, ShaderStages, TextureFormat, VertexState,
};

use super::Target;
use super::layout::Chunk;
use crate::splat::Mode;
use crate::traverse::Sense;

/// Text of the shaders, by stage: common.wgsl, then the stage's own.
pub const SHADERS: [(&str, &str); 5] = [
    ("walk", concat!(include_str!("shaders/common.wgsl"), include_str!("shaders/walk.wgsl"))),
    ("project", concat!(include_str!("shaders/common.wgsl"), include_str!("shaders/project.wgsl"))),
    ("bin", concat!(include_str!("shaders/common.wgsl"), include_str!("shaders/bin.wgsl"))),
    ("tile", concat!(include_str!("shaders/common.wgsl"), include_str!("shaders/tile.wgsl"))),
    ("splat", concat!(include_str!("shaders/common.wgsl"), include_str!("shaders/splat.wgsl"))),
];

/// Text of what puts pixels into a texture.
pub(crate) const RESOLVE: &str = concat!(include_str!("shaders/common.wgsl"), include_str!("shaders/resolve.wgsl"));

/// How a pixel takes splats; numbered as in the shaders.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Blend {
    /// Composited, near splats first; the fourth value is the transmittance.
    FrontToBack,
    /// Composited, far splats first.
    BackToFront,
    /// Sums.
    Additive,
    /// Largest values.
    Maximum,
}

impl Blend {
    /// Of settings.
    pub(crate) fn new(mode: Mode, sense: Sense) -> Blend {
        match (mode, sense) {
            (Mode::Composite, Sense::FrontToBack) => Blend::FrontToBack,
            (Mode::Composite, Sense::BackToFront) => Blend::BackToFront,
            (Mode::Additive, _) => Blend::Additive,
            (Mode::Maximum | Mode::MaximumGrey, _) => Blend::Maximum,
        }
    }

    /// What a pixel's fourth value starts as.
    pub(crate) fn fourth(self) -> f32 {
        match self {
            Blend::FrontToBack | Blend::BackToFront => 1.0,
            Blend::Additive | Blend::Maximum => 0.0,
        }
    }

    fn number(self) -> usize {
        self as usize
    }

    /// What a device does to a pixel: colours, fourth value.
    fn state(self) -> BlendState {
        use BlendFactor::{DstAlpha, One, OneMinusSrcAlpha, Zero};
        let add = |src_factor, dst_factor| BlendComponent { src_factor, dst_factor, operation: BlendOperation::Add };
        let max = BlendComponent { src_factor: One, dst_factor: One, operation: BlendOperation::Max };
        let (color, alpha) = match self {
            Blend::FrontToBack => (add(DstAlpha, One), add(Zero, OneMinusSrcAlpha)),
            Blend::BackToFront => (add(One, OneMinusSrcAlpha), add(Zero, OneMinusSrcAlpha)),
            Blend::Additive => (add(One, One), add(One, One)),
            Blend::Maximum => (max, max),
        };
        BlendState { color, alpha }
    }
}

impl Target {
    pub(super) fn format(self) -> TextureFormat {
        match self {
            Target::Float32 => TextureFormat::Rgba32Float,
            Target::Float16 => TextureFormat::Rgba16Float,
            Target::Unorm8 => TextureFormat::Rgba8Unorm,
        }
    }

    pub(super) fn pixel_bytes(self) -> u32 {
        match self {
            Target::Float32 => 16,
            Target::Float16 => 8,
            Target::Unorm8 => 4,
        }
    }

    fn number(self) -> usize {
        self as usize
    }
}

/// What a binding is.
#[derive(Clone, Copy)]
enum Kind {
    Uniform,
    /// A uniform at an offset that is given with each dispatch.
    Moving,
    Read,
    Write,
}

/// A compute stage.
#[derive(Debug)]
pub(crate) struct Stage {
    pub(crate) pipeline: ComputePipeline,
    layout: BindGroupLayout,
}

/// All stages.
#[derive(Debug)]
pub(crate) struct Stages {
    pub(crate) walk: Stage,
    pub(crate) project: Stage,
    pub(crate) bin: Stage,
    tile_module: ShaderModule,
    tiles: [OnceLock<Stage>; 4],
    splat_module: ShaderModule,
    splat_layout: (BindGroupLayout, PipelineLayout),
    splats: [[OnceLock<RenderPipeline>; 3]; 4],
}

impl Stages {
    pub(crate) fn new(device: &Device) -> Stages {
        use Kind::{Moving, Read, Uniform, Write};
        let [walk, project, bin, tile_module, splat_module] = SHADERS.map(|(label, text)| {
            let source = ShaderSource::Wgsl(text.into());
            device.create_shader_module(ShaderModuleDescriptor { label: Some(label), source })
        });
        let splat_bindings = layout(device, "splat", ShaderStages::VERTEX_FRAGMENT, &[Uniform, Read]);
        let splat_pipeline = pipeline_layout(device, "splat", &splat_bindings);
        Stages {
            walk: stage(device, "walk", &walk, &[Uniform, Moving, Read, Read, Read, Read, Read, Write], &[]),
            project: stage(
                device,
                "project",
                &project,
                &[Uniform, Moving, Read, Read, Read, Read, Read, Read, Write, Write],
                &[],
            ),
            bin: stage(device, "bin", &bin, &[Uniform, Moving, Read, Write], &[]),
            tile_module,
            tiles: Default::default(),
            splat_module,
            splat_layout: (splat_bindings, splat_pipeline),
            splats: Default::default(),
        }
    }

    /// The tile compositor for a way of blending; compiled on first use.
    pub(crate) fn tile(&self, device: &Device, blend: Blend) -> &Stage {
        use Kind::{Moving, Read, Uniform, Write};
        self.tiles[blend.number()].get_or_init(|| {
            let constants = [("BLEND", blend.number() as f64)];
            stage(device, "tile", &self.tile_module, &[Uniform, Moving, Read, Read, Write], &constants)
        })
    }

    /// The quads for a way of blending into a target; compiled on first use.
    pub(crate) fn splat(&self, device: &Device, blend: Blend, target: Target) -> &RenderPipeline {
        self.splats[blend.number()][target.number()].get_or_init(|| {
            let format = target.format();
            let constants = [("BLEND", blend.number() as f64)];
            let options = || PipelineCompilationOptions { constants: &constants, ..Default::default() };
            let target = ColorTargetState { format, blend: Some(blend.state()), write_mask: ColorWrites::ALL };
            device.create_render_pipeline(&RenderPipelineDescriptor {
                label: Some("splat"),
                layout: Some(&self.splat_layout.1),
                vertex: VertexState {
                    module: &self.splat_module,
                    entry_point: Some("corner"),
                    compilation_options: options(),
                    buffers: &[],
                },
                primitive: PrimitiveState { topology: PrimitiveTopology::TriangleStrip, ..Default::default() },
                depth_stencil: None,
                multisample: MultisampleState::default(),
                fragment: Some(FragmentState {
                    module: &self.splat_module,
                    entry_point: Some("pixel"),
                    compilation_options: options(),
                    targets: &[Some(target)],
                }),
                multiview_mask: None,
                cache: None,
            })
        })
    }

    /// What the quads bind.
    pub(crate) fn bind_splat(&self, device: &Device, resources: &[BindingResource]) -> BindGroup {
        bind(device, "splat", &self.splat_layout.0, resources)
    }
}

impl Stage {
    /// What the stage binds, in the order of its shader; the second is the chunk's uniform.
    pub(crate) fn bind(&self, device: &Device, resources: &[BindingResource]) -> BindGroup {
        bind(device, "stage", &self.layout, resources)
    }
}

fn bind(device: &Device, label: &str, layout: &BindGroupLayout, resources: &[BindingResource]) -> BindGroup {
    let entries: Vec<_> = (0u32..)
        .zip(resources)
        .map(|(binding, resource)| BindGroupEntry { binding, resource: resource.clone() })
        .collect();
    device.create_bind_group(&BindGroupDescriptor { label: Some(label), layout, entries: &entries })
}

/// One chunk of a buffer of chunks.
pub(crate) fn one_chunk(buffer: &wgpu::Buffer) -> BindingResource<'_> {
    BindingResource::Buffer(BufferBinding { buffer, offset: 0, size: NonZeroU64::new(size_of::<Chunk>() as u64) })
}

fn stage(device: &Device, name: &str, module: &ShaderModule, kinds: &[Kind], constants: &[(&str, f64)]) -> Stage {
    let layout = layout(device, name, ShaderStages::COMPUTE, kinds);
    let pipeline = device.create_compute_pipeline(&ComputePipelineDescriptor {
        label: Some(name),
        layout: Some(&pipeline_layout(device, name, &layout)),
        module,
        entry_point: Some(name),
        compilation_options: PipelineCompilationOptions { constants, ..Default::default() },
        cache: None,
    });
    Stage { pipeline, layout }
}

fn pipeline_layout(device: &Device, name: &str, layout: &BindGroupLayout) -> PipelineLayout {
    let bind_group_layouts = &[Some(layout)];
    device.create_pipeline_layout(&PipelineLayoutDescriptor {
        label: Some(name),
        bind_group_layouts,
        immediate_size: 0,
    })
}

fn layout(device: &Device, name: &str, visibility: ShaderStages, kinds: &[Kind]) -> BindGroupLayout {
    let entry = |(binding, &kind): (u32, &Kind)| {
        let ty = match kind {
            Kind::Uniform | Kind::Moving => BufferBindingType::Uniform,
            Kind::Read => BufferBindingType::Storage { read_only: true },
            Kind::Write => BufferBindingType::Storage { read_only: false },
        };
        let has_dynamic_offset = matches!(kind, Kind::Moving);
        let ty = BindingType::Buffer { ty, has_dynamic_offset, min_binding_size: None };
        BindGroupLayoutEntry { binding, visibility, ty, count: None }
    };
    let entries: Vec<_> = (0..).zip(kinds).map(entry).collect();
    device.create_bind_group_layout(&BindGroupLayoutDescriptor { label: Some(name), entries: &entries })
}
