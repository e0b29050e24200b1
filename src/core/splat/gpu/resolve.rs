//! Resolves accumulated pixels into a texture of the caller's, without leaving the device.
//!
//! In: a window's accumulated pixels. Out: linear premultiplied colours in the texture, over a background if there is
//! one. The values are those of [`Table::finish`](crate::splat::composite::Table::finish), except that the colours of
//! [`Mode::Maximum`] are interpolated in a table of [`RAMP`] entries.

use bytemuck::{Pod, Zeroable};
use wgpu::util::{BufferInitDescriptor, DeviceExt as _};
use wgpu::{
    BindingResource, BufferUsages, Color, ColorTargetState, ColorWrites, LoadOp, RenderPipeline, TextureFormat,
    TextureView,
};

use super::buffers::BufferName;
use super::stages::{RESOLVE, bind, render_pass, render_pipeline, shader_module};
use super::{Compositor, GpuRenderer};
use crate::error::Result;
use crate::splat::Mode;

const RAMP: u16 = 1_024; // Entries of the table of colours for `Mode::Maximum`.

/// A texture of the caller's, into which a picture is drawn.
#[derive(Debug, Clone, Copy)]
pub struct RenderTarget<'t> {
    /// View of the texture, which has the picture's size and the usage `RENDER_ATTACHMENT`.
    pub view: &'t TextureView,
    /// Format of the texture: any that can be rendered to. Values are linear; an sRGB format encodes them.
    pub format: TextureFormat,
    /// Linear colour of the background; `None` leaves the picture transparent.
    pub background: Option<[f32; 3]>,
}

/// The uniform of `resolve.wgsl`, where the fields are documented.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct ResolveUniform {
    window: [i32; 4],
    background: [f32; 4],
    mode: u32,
    last: u32,
    unused: [u32; 2],
}

/// The pipeline that resolves, after its key: the format of the texture, and whether pixels come from a buffer (tiles)
/// or from a target (quads).
pub(super) type ResolvePipeline = ((TextureFormat, bool), RenderPipeline);

/// Draws the pixels of `window` (first column and row, one past the last column and row) into `target`.
pub(super) fn window(renderer: &mut GpuRenderer, window: [i32; 4], target: &RenderTarget) -> Result<()> {
    let context = renderer.resident.context.clone();
    let device = &context.device;
    let is_buffer = renderer.resident.current == Compositor::Tiles;
    let key = (target.format, is_buffer);
    if renderer.resident.resolve.as_ref().is_none_or(|(made_for, _)| *made_for != key) {
        let module = shader_module(device, "resolve", RESOLVE);
        let entries = ["corner", if is_buffer { "from_buffer" } else { "from_target" }];
        let colour = ColorTargetState { format: target.format, blend: None, write_mask: ColorWrites::ALL };
        let pipeline = render_pipeline(device, "resolve", &module, entries, colour, &[]);
        renderer.resident.resolve = Some((key, pipeline));
    }
    let (_, pipeline) = renderer.resident.resolve.as_ref().expect("it was just made");
    let table = &renderer.looks().table;
    let mode = renderer.looks().on_device.mode;
    let [red, green, blue] = target.background.unwrap_or_default();
    let background = [red, green, blue, if target.background.is_some() { 1.0 } else { 0.0 }];
    let uniform = ResolveUniform { window, background, mode: mode as u32, last: (RAMP - 1).into(), unused: [0; 2] };
    let ramp: Vec<[f32; 4]> = (0..if mode == Mode::Maximum { RAMP } else { 2 })
        .map(|entry| table.colour_of(f32::from(entry) / f32::from(RAMP - 1)))
        .map(|[red, green, blue]| [red, green, blue, 1.0])
        .collect();
    let buffer = |label, contents: &[u8], usage| {
        device.create_buffer_init(&BufferInitDescriptor { label: Some(label), contents, usage })
    };
    let uniform = buffer("resolve", bytemuck::bytes_of(&uniform), BufferUsages::UNIFORM);
    let ramp = buffer("ramp", bytemuck::cast_slice(&ramp), BufferUsages::STORAGE);
    let quads = (!is_buffer).then(|| renderer.resident.buffers.target().create_view(&Default::default()));
    let pixels = match &quads {
        Some(quads) => BindingResource::TextureView(quads),
        None => renderer.resident.buffers.get(BufferName::Pixels).as_entire_binding(),
    };
    let resources = [uniform.as_entire_binding(), ramp.as_entire_binding(), pixels];
    let group = bind(device, &pipeline.get_bind_group_layout(0), resources);
    let mut encoder = context.encoder("resolve");
    let load = if window[1] == 0 { LoadOp::Clear(Color::TRANSPARENT) } else { LoadOp::Load };
    let mut pass = render_pass(&mut encoder, target.view, load, None);
    let [x0, y0, x1, y1] = window.map(i32::cast_unsigned);
    pass.set_pipeline(pipeline);
    pass.set_bind_group(0, &group, &[]);
    pass.set_scissor_rect(x0, y0, x1 - x0, y1 - y0);
    pass.draw(0..3, 0..1);
    drop(pass);
    context.submit([encoder.finish()])
}
