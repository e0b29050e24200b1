//! Splats as quads, in storage order or through a list of indices: one render pass with the renderer's shader.
//!
//! In: splats of one frame. Out: milliseconds, and the picture in 16-bit floats for checks.

use adjsplat::internals::gpu_stages::FrameUniform;
use adjsplat::internals::gpu_stages::SHADERS;
use half::f16;
use wgpu::{
    BindGroupDescriptor, BindGroupEntry, BlendComponent, BlendFactor, BlendOperation, BlendState, Buffer,
    BufferDescriptor, BufferUsages, Color, ColorTargetState, ColorWrites, Extent3d, FragmentState, RenderPipeline,
    RenderPipelineDescriptor, ShaderModuleDescriptor, ShaderSource, TexelCopyBufferInfo, TexelCopyBufferLayout,
    Texture, TextureDescriptor, TextureDimension, TextureFormat, TextureUsages, VertexState,
};

use super::device::Gpu;

const FORMAT: TextureFormat = TextureFormat::Rgba16Float;
/// Bytes of a pixel of the target.
pub(crate) const PIXEL_BYTES: u64 = 8;

/// The pipelines and the target.
pub(crate) struct Quads {
    size: [u32; 2],
    uniform: Buffer,
    target: Texture,
    as_they_lie: RenderPipeline,
    ranked: RenderPipeline,
}

impl Quads {
    /// Compiles the pipelines for the pixels of a window.
    pub(crate) fn new(gpu: &Gpu, uniform: &FrameUniform) -> Quads {
        let [left, top, right, bottom] = uniform.window;
        let size = [right - left, bottom - top].map(i32::cast_unsigned);
        let splat = SHADERS.iter().find(|(stage, _)| *stage == "splat").expect("the stage is there").1;
        let source = ShaderSource::Wgsl(format!("{splat}{}", include_str!("ranked.wgsl")).into());
        let module = gpu.device.create_shader_module(ShaderModuleDescriptor { label: Some("quads"), source });
        // Front to back: the fourth value is the transmittance.
        let part = |src_factor, dst_factor| BlendComponent { src_factor, dst_factor, operation: BlendOperation::Add };
        let blend = BlendState {
            color: part(BlendFactor::DstAlpha, BlendFactor::One),
            alpha: part(BlendFactor::Zero, BlendFactor::OneMinusSrcAlpha),
        };
        let pipeline = |entry: &str| {
            gpu.device.create_render_pipeline(&RenderPipelineDescriptor {
                label: Some(entry),
                layout: None,
                vertex: VertexState {
                    module: &module,
                    entry_point: Some(entry),
                    compilation_options: Default::default(),
                    buffers: &[],
                },
                primitive: Default::default(),
                depth_stencil: None,
                multisample: Default::default(),
                fragment: Some(FragmentState {
                    module: &module,
                    entry_point: Some("pixel"),
                    compilation_options: Default::default(),
                    targets: &[Some(ColorTargetState {
                        format: FORMAT,
                        blend: Some(blend),
                        write_mask: ColorWrites::ALL,
                    })],
                }),
                multiview_mask: None,
                cache: None,
            })
        };
        let target = gpu.device.create_texture(&TextureDescriptor {
            label: Some("target"),
            size: Extent3d { width: size[0], height: size[1], depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: TextureDimension::D2,
            format: FORMAT,
            usage: TextureUsages::RENDER_ATTACHMENT | TextureUsages::COPY_SRC,
            view_formats: &[],
        });
        let (as_they_lie, ranked) = (pipeline("corner"), pipeline("ranked_corner"));
        Quads { size, uniform: gpu.uniform("uniform", uniform), target, as_they_lie, ranked }
    }

    /// Draws `count` splats, in the order of `places` if given; returns milliseconds.
    pub(crate) fn draw(&self, gpu: &Gpu, splats: &Buffer, places: Option<&Buffer>, count: u32) -> f64 {
        let pipeline = if places.is_some() { &self.ranked } else { &self.as_they_lie };
        let buffers = [Some(&self.uniform), Some(splats), places];
        let entries: Vec<_> = (0u32..)
            .zip(buffers.into_iter().flatten())
            .map(|(binding, buffer)| BindGroupEntry { binding, resource: buffer.as_entire_binding() })
            .collect();
        let layout = &pipeline.get_bind_group_layout(0);
        let group =
            gpu.device.create_bind_group(&BindGroupDescriptor { label: Some("quads"), layout, entries: &entries });
        let start = Color { r: 0.0, g: 0.0, b: 0.0, a: 1.0 };
        gpu.time_draw(&self.target.create_view(&Default::default()), start, |pass| {
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, &group, &[]);
            pass.draw(0..6 * count, 0..1);
        })
    }

    /// Returns red, green, blue and transmittance of each pixel.
    pub(crate) fn picture(&self, gpu: &Gpu) -> Vec<[f32; 4]> {
        let [width, height] = self.size;
        // Rows of copies from textures start at multiples of 256 bytes.
        let pitch = (8 * width).next_multiple_of(256);
        let back = gpu.device.create_buffer(&BufferDescriptor {
            label: Some("picture"),
            size: u64::from(pitch) * u64::from(height),
            usage: BufferUsages::COPY_SRC | BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let layout = TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(pitch), rows_per_image: Some(height) };
        let extent = self.target.size();
        encoder.copy_texture_to_buffer(
            self.target.as_image_copy(),
            TexelCopyBufferInfo { buffer: &back, layout },
            extent,
        );
        gpu.queue.submit([encoder.finish()]);
        let words: Vec<[u16; 4]> = gpu.read(&back, pitch as usize / 8 * height as usize);
        let rows = words.chunks_exact(pitch as usize / 8);
        let decode = |pixel: &[u16; 4]| pixel.map(|bits| f16::from_bits(bits).to_f32());
        rows.flat_map(|row| row[..width as usize].iter().map(decode)).collect()
    }
}
