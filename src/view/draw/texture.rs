//! Pictures in the window: each is uploaded once, and painted by one triangle.
//!
//! Where the processor paints the window, this takes a ninth of the time of egui's own shader: 5 ms instead of 49 for
//! 1280 x 720 pixels (Mesa 22.3, two cores, processor time).

use std::sync::{Arc, Weak};

use eframe::egui_wgpu::{Callback, CallbackResources, CallbackTrait, RenderState, ScreenDescriptor, wgpu};
use egui::{ColorImage, PaintCallbackInfo, Rect, Shape};

/// Returns the shape that shows a picture, stretched to `rect`.
pub(crate) fn shape(rect: Rect, image: Arc<ColorImage>) -> Shape {
    Shape::Callback(Callback::new_paint_callback(rect, Shown(image)))
}

/// Prepares a window to show pictures.
pub fn install(window: &RenderState) {
    let pictures = Pictures::new(&window.device, window.target_format);
    window.renderer.write().callback_resources.insert(pictures);
}

struct Shown(Arc<ColorImage>);

impl CallbackTrait for Shown {
    fn prepare(
        &self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        _: &ScreenDescriptor,
        _: &mut wgpu::CommandEncoder,
        resources: &mut CallbackResources,
    ) -> Vec<wgpu::CommandBuffer> {
        resources.get_mut::<Pictures>().expect(INSTALLED).upload(device, queue, &self.0);
        Vec::new()
    }

    fn paint(&self, info: PaintCallbackInfo, pass: &mut wgpu::RenderPass<'static>, resources: &CallbackResources) {
        let pictures = resources.get::<Pictures>().expect(INSTALLED);
        if let Some(texture) = pictures.texture(&self.0) {
            let viewport = info.viewport_in_pixels();
            let size = [viewport.width_px, viewport.height_px].map(|side| usize::try_from(side).unwrap_or(0));
            let is_stretched = self.0.size != size;
            pass.set_pipeline(&pictures.pipeline);
            pass.set_bind_group(0, &texture[usize::from(is_stretched)], &[]);
            pass.draw(0..3, 0..1);
        }
    }
}

const INSTALLED: &str = "windows are prepared before they show pictures";

/// The pictures on a window's device.
struct Pictures {
    pipeline: wgpu::RenderPipeline,
    /// Of the nearest texel, and of a mean of four, which takes longer.
    samplers: [wgpu::Sampler; 2],
    format: wgpu::TextureFormat,
    /// Textures with each sampler; they live as long as their pictures.
    textures: Vec<(Weak<ColorImage>, [wgpu::BindGroup; 2])>,
}

impl Pictures {
    fn new(device: &wgpu::Device, target: wgpu::TextureFormat) -> Pictures {
        let shader = device.create_shader_module(wgpu::include_wgsl!("texture.wgsl"));
        let pipeline = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("picture"),
            layout: None,
            vertex: wgpu::VertexState {
                module: &shader,
                entry_point: None,
                compilation_options: Default::default(),
                buffers: &[],
            },
            fragment: Some(wgpu::FragmentState {
                module: &shader,
                entry_point: None,
                compilation_options: Default::default(),
                targets: &[Some(target.into())],
            }),
            primitive: Default::default(),
            depth_stencil: None,
            multisample: Default::default(),
            multiview_mask: None,
            cache: None,
        });
        let samplers = [wgpu::FilterMode::Nearest, wgpu::FilterMode::Linear].map(|filter| {
            device.create_sampler(&wgpu::SamplerDescriptor {
                mag_filter: filter,
                min_filter: filter,
                ..Default::default()
            })
        });
        // A target that encodes what is written gets what the picture's bytes decode to.
        let format = match target.is_srgb() {
            true => wgpu::TextureFormat::Rgba8UnormSrgb,
            false => wgpu::TextureFormat::Rgba8Unorm,
        };
        Pictures { pipeline, samplers, format, textures: Vec::new() }
    }

    fn texture(&self, image: &Arc<ColorImage>) -> Option<&[wgpu::BindGroup; 2]> {
        let is_it = |held: &Weak<ColorImage>| std::ptr::eq(held.as_ptr(), Arc::as_ptr(image));
        self.textures.iter().find(|(held, _)| is_it(held)).map(|(_, texture)| texture)
    }

    /// Uploads a picture that is not there, and drops those that nothing shows.
    #[expect(clippy::cast_possible_truncation, reason = "pictures fit into a texture")]
    fn upload(&mut self, device: &wgpu::Device, queue: &wgpu::Queue, image: &Arc<ColorImage>) {
        if self.texture(image).is_some() {
            return;
        }
        self.textures.retain(|(held, _)| held.strong_count() > 0);
        let [width, height] = image.size.map(|side| side as u32);
        let size = wgpu::Extent3d { width, height, depth_or_array_layers: 1 };
        let texture = device.create_texture(&wgpu::TextureDescriptor {
            label: Some("picture"),
            size,
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: self.format,
            usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
            view_formats: &[],
        });
        let rows = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(4 * width), rows_per_image: None };
        queue.write_texture(texture.as_image_copy(), image.as_raw(), rows, size);
        let view = texture.create_view(&Default::default());
        let layout = self.pipeline.get_bind_group_layout(0);
        let texture = self.samplers.each_ref().map(|sampler| {
            device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("picture"),
                layout: &layout,
                entries: &[
                    wgpu::BindGroupEntry { binding: 0, resource: wgpu::BindingResource::TextureView(&view) },
                    wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::Sampler(sampler) },
                ],
            })
        });
        self.textures.push((Arc::downgrade(image), texture));
    }
}
