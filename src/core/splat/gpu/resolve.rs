//! Resolving: from pixels on the device to a texture of the caller's, without leaving the device.
//!
//! In: a window's pixels as they were accumulated. Out: linear premultiplied colours in the texture, over a background
//! if there is one. The values are those of [`Finish`](crate::splat::composite::Finish); the colours of a maximum are
//! interpolated between [`RAMP`] of them.

use bytemuck::{Pod, Zeroable};
use wgpu::util::{BufferInitDescriptor, DeviceExt as _};
use wgpu::{
    BindGroupDescriptor, BindGroupEntry, BufferUsages, ColorTargetState, ColorWrites, CommandEncoderDescriptor,
    FragmentState, LoadOp, MultisampleState, Operations, PrimitiveState, RenderPassColorAttachment,
    RenderPassDescriptor, RenderPipeline, RenderPipelineDescriptor, ShaderModuleDescriptor, ShaderSource, StoreOp,
    TextureFormat, TextureView, VertexState,
};

use super::context::Context;
use super::scratch::Name;
use super::stages::RESOLVE;
use super::{Compositor, Renderer};
use crate::error::Result;
use crate::splat::Mode;

/// Colours of normalised values.
const RAMP: u16 = 1_024;

/// A texture that a frame is drawn into.
#[derive(Debug, Clone, Copy)]
pub struct Canvas<'t> {
    /// The texture, as large as the picture, usable as `RENDER_ATTACHMENT`.
    pub view: &'t TextureView,
    /// Its format: any that can be rendered to. Values are linear; a format of sRGB encodes them.
    pub format: TextureFormat,
    /// Linear colour behind; `None` leaves the picture transparent.
    pub background: Option<[f32; 3]>,
}

/// `Finish` of resolve.wgsl.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Finish {
    window: [i32; 4],
    background: [f32; 4],
    mode: u32,
    last: u32,
    unused: [u32; 2],
}

/// A pipeline, and what it is for.
#[derive(Debug)]
pub(super) struct Resolver {
    format: TextureFormat,
    pipeline: RenderPipeline,
}

/// Puts the pixels of `window` into `canvas`.
///
/// # Errors
/// If the device fails.
pub(super) fn window(renderer: &mut Renderer, window: [i32; 4], canvas: &Canvas) -> Result<()> {
    let context = renderer.context.clone();
    let device = &context.device;
    let is_buffer = renderer.current == Compositor::Tiles;
    if renderer.resolver.as_ref().is_none_or(|resolver| resolver.format != canvas.format) {
        let pipeline = pipeline(&context, canvas.format, is_buffer);
        renderer.resolver = Some(Resolver { format: canvas.format, pipeline });
    }
    let pipeline = &renderer.resolver.as_ref().expect("it was just made").pipeline;
    let table = renderer.table();
    let mode = match table.mode() {
        Mode::Composite => 0,
        Mode::Additive => 1,
        Mode::Maximum => 2,
        Mode::MaximumGrey => 3,
    };
    let [red, green, blue] = canvas.background.unwrap_or_default();
    let background = [red, green, blue, if canvas.background.is_some() { 1.0 } else { 0.0 }];
    let finish = Finish { window, background, mode, last: (RAMP - 1).into(), unused: [0; 2] };
    let ramp: Vec<[f32; 4]> = (0..if mode == 2 { RAMP } else { 2 })
        .map(|entry| table.colour_of(f32::from(entry) / f32::from(RAMP - 1)))
        .map(|[red, green, blue]| [red, green, blue, 1.0])
        .collect();
    let buffer = |label, contents: &[u8], usage| {
        device.create_buffer_init(&BufferInitDescriptor { label: Some(label), contents, usage })
    };
    let finish = buffer("finish", bytemuck::bytes_of(&finish), BufferUsages::UNIFORM);
    let ramp = buffer("ramp", bytemuck::cast_slice(&ramp), BufferUsages::STORAGE);
    let target = (!is_buffer).then(|| renderer.scratch.target().create_view(&Default::default()));
    let (binding, resource) = match &target {
        Some(target) => (3, wgpu::BindingResource::TextureView(target)),
        None => (2, renderer.scratch.get(Name::Pixels).as_entire_binding()),
    };
    let group = device.create_bind_group(&BindGroupDescriptor {
        label: Some("resolve"),
        layout: &pipeline.get_bind_group_layout(0),
        entries: &[
            BindGroupEntry { binding: 0, resource: finish.as_entire_binding() },
            BindGroupEntry { binding: 1, resource: ramp.as_entire_binding() },
            BindGroupEntry { binding, resource },
        ],
    });
    let mut encoder = device.create_command_encoder(&CommandEncoderDescriptor { label: Some("resolve") });
    let load = if window[1] == 0 { LoadOp::Clear(wgpu::Color::TRANSPARENT) } else { LoadOp::Load };
    let mut pass = encoder.begin_render_pass(&RenderPassDescriptor {
        label: Some("resolve"),
        color_attachments: &[Some(RenderPassColorAttachment {
            view: canvas.view,
            depth_slice: None,
            resolve_target: None,
            ops: Operations { load, store: StoreOp::Store },
        })],
        depth_stencil_attachment: None,
        timestamp_writes: None,
        occlusion_query_set: None,
        multiview_mask: None,
    });
    let [x0, y0, x1, y1] = window.map(i32::cast_unsigned);
    pass.set_pipeline(pipeline);
    pass.set_bind_group(0, &group, &[]);
    pass.set_scissor_rect(x0, y0, x1 - x0, y1 - y0);
    pass.draw(0..3, 0..1);
    drop(pass);
    context.submit([encoder.finish()])
}

fn pipeline(context: &Context, format: TextureFormat, is_buffer: bool) -> RenderPipeline {
    let device = &context.device;
    let source = ShaderSource::Wgsl(RESOLVE.into());
    let module = &device.create_shader_module(ShaderModuleDescriptor { label: Some("resolve"), source });
    let target = ColorTargetState { format, blend: None, write_mask: ColorWrites::ALL };
    device.create_render_pipeline(&RenderPipelineDescriptor {
        label: Some("resolve"),
        layout: None,
        vertex: VertexState {
            module,
            entry_point: Some("corner"),
            compilation_options: Default::default(),
            buffers: &[],
        },
        primitive: PrimitiveState::default(),
        depth_stencil: None,
        multisample: MultisampleState::default(),
        fragment: Some(FragmentState {
            module,
            entry_point: Some(if is_buffer { "from_buffer" } else { "from_target" }),
            compilation_options: Default::default(),
            targets: &[Some(target)],
        }),
        multiview_mask: None,
        cache: None,
    })
}
