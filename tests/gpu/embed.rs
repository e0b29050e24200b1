//! Pictures in a texture of the caller's against frames that were read back; a device that goes away.

use adjsplat::error::Error;
use adjsplat::splat::gpu::{Compositor, GpuOptions, GpuRenderer, QuadFormat, RenderTarget};
use adjsplat::splat::{Camera, Frame, Mode, Settings};
use adjsplat_tests::scenes::{Draw as _, LIT_LAYERS, transfer};
use wgpu::{
    DeviceDescriptor, Extent3d, Instance, InstanceDescriptor, Limits, Origin3d, RequestAdapterOptions,
    TexelCopyBufferInfo, TexelCopyBufferLayout, TexelCopyTextureInfo, Texture, TextureAspect, TextureDescriptor,
    TextureDimension, TextureFormat, TextureUsages,
};

use crate::device::{device, own_device, read};
use crate::levels::{draft, long};
use crate::scenes::phantom;

/// As wide as rows of copies ask for: 256 bytes in the narrower of the two formats.
const SIZE: [u32; 2] = [64, 50];

fn texture(device: &wgpu::Device, format: TextureFormat) -> Texture {
    device.create_texture(&TextureDescriptor {
        label: Some("the caller's"),
        size: Extent3d { width: SIZE[0], height: SIZE[1], depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: TextureDimension::D2,
        format,
        usage: TextureUsages::RENDER_ATTACHMENT | TextureUsages::COPY_SRC,
        view_formats: &[],
    })
}

/// Returns the largest difference of a texture in single precision from a frame.
fn worst(device: &wgpu::Device, queue: &wgpu::Queue, texture: &Texture, want: &Frame) -> f32 {
    let bytes = content(device, queue, texture, 16);
    let got = bytes.as_chunks().0.iter().map(|got| f32::from_le_bytes(*got));
    got.zip(want.pixels()).map(|(got, want)| (got - want).abs()).fold(0.0, f32::max)
}

/// The texture's bytes.
fn content(device: &wgpu::Device, queue: &wgpu::Queue, texture: &Texture, pixel_bytes: u32) -> Vec<u8> {
    let bytes = SIZE[0] * SIZE[1] * pixel_bytes;
    let buffer = device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: bytes.into(),
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC,
        mapped_at_creation: false,
    });
    let mut encoder = device.create_command_encoder(&Default::default());
    let source = TexelCopyTextureInfo { texture, mip_level: 0, origin: Origin3d::ZERO, aspect: TextureAspect::All };
    let layout = TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(SIZE[0] * pixel_bytes), rows_per_image: None };
    encoder.copy_texture_to_buffer(source, TexelCopyBufferInfo { buffer: &buffer, layout }, texture.size());
    queue.submit([encoder.finish()]);
    read(device, queue, &buffer)
}

fn over(frame: &Frame, background: Option<[f32; 3]>) -> Frame {
    let mut frame = frame.clone();
    if let Some(background) = background {
        frame.over(background);
    }
    frame
}

#[test]
fn a_texture_shows_what_a_frame_shows() {
    let Some(opened) = device() else { return };
    let built = phantom("gyroid", [24, 20, 28], [1.0; 3], transfer(LIT_LAYERS), 8);
    let camera: Camera = built.orbit(35.0, 20.0, Some(40.0), SIZE);
    let quads = Compositor::Quads(if opened.facts.blends_float32 { QuadFormat::Float32 } else { QuadFormat::Float16 });
    for compositor in [Compositor::Tiles, quads] {
        let options = GpuOptions::default().with_compositor(compositor);
        let (device, queue) = (&opened.device, &opened.queue);
        let mut renderer = GpuRenderer::new(device.clone(), queue.clone(), built.scene(), options).unwrap();
        for mode in [Mode::Composite, Mode::Additive, Mode::Maximum, Mode::MaximumGrey] {
            let settings = Settings::every_pixel(SIZE).with_mode(mode);
            let (frame, _) = renderer.render(&camera, &settings).unwrap();
            for background in [None, Some([0.2, 0.5, 0.9])] {
                let want = over(&frame, background);
                let format = TextureFormat::Rgba32Float;
                let target = texture(device, format);
                let view = target.create_view(&Default::default());
                renderer.render_to(&camera, &settings, &RenderTarget { view: &view, format, background }).unwrap();
                let worst = worst(device, queue, &target, &want);
                // Roundings; colours of a maximum are interpolated between 1,024 of them, bent at three points.
                let tolerance = if mode == Mode::Maximum { 2e-3 } else { 1e-5 };
                assert!(worst <= tolerance, "{compositor:?}, {mode:?}, {background:?}: {worst}");
            }
        }
        let settings = Settings::every_pixel(SIZE);
        let (frame, _) = renderer.render(&camera, &settings).unwrap();
        let format = TextureFormat::Rgba8UnormSrgb;
        let target = texture(device, format);
        let view = target.create_view(&Default::default());
        let background = Some([1.0; 3]);
        renderer.render_to(&camera, &settings, &RenderTarget { view: &view, format, background }).unwrap();
        let got = content(device, queue, &target, 4);
        let want = over(&frame, background).to_srgb8();
        let worst = got.iter().zip(&want).map(|(got, want)| got.abs_diff(*want)).max();
        // The device's own encoding of sRGB may be off by a step.
        assert!(worst <= Some(1), "{compositor:?}: {worst:?}");
    }
}

#[test]
fn a_texture_of_several_levels_shows_what_a_frame_shows() {
    let Some(opened) = device() else { return };
    let (levelled, camera) = long(8);
    let (device, queue) = (&opened.device, &opened.queue);
    let mut renderer =
        GpuRenderer::new(device.clone(), queue.clone(), levelled.scene(), GpuOptions::default()).unwrap();
    let (frame, stats) = renderer.render(&camera, &draft(SIZE)).unwrap();
    assert_eq!(stats.parts, 3, "{stats:?}");
    let format = TextureFormat::Rgba32Float;
    let target = texture(device, format);
    let view = target.create_view(&Default::default());
    let target_view = RenderTarget { view: &view, format, background: None };
    let stats = renderer.render_to(&camera, &draft(SIZE), &target_view).unwrap();
    assert_eq!((stats.parts, stats.upload_bytes), (3, 0), "{stats:?}");
    let worst = worst(device, queue, &target, &frame);
    assert!(worst <= 1e-6, "{worst}");
}

/// Both failed with many lines of the device's.
#[test]
fn devices_and_textures_that_are_too_small_are_refused_in_one_line() {
    let Some(opened) = device() else { return };
    let built = phantom("gyroid", [16, 16, 16], [1.0; 3], transfer(LIT_LAYERS), 8);
    let instance = Instance::new(InstanceDescriptor::new_without_display_handle_from_env());
    let required_limits = Limits::downlevel_defaults();
    let low = pollster::block_on(async {
        let adapter = instance.request_adapter(&RequestAdapterOptions::default()).await.unwrap();
        adapter.request_device(&DeviceDescriptor { required_limits, ..Default::default() }).await.unwrap()
    });
    let fault = GpuRenderer::new(low.0, low.1, built.scene(), GpuOptions::default()).unwrap_err().to_string();
    assert!(fault.contains("max_") && fault.contains("limits of WebGPU") && !fault.contains('\n'), "{fault}");

    let (device, queue) = (opened.device.clone(), opened.queue.clone());
    let mut renderer = GpuRenderer::new(device, queue, built.scene(), GpuOptions::default()).unwrap();
    let (format, size) = (TextureFormat::Rgba32Float, [SIZE[0], SIZE[1] + 1]);
    let view = texture(&opened.device, format).create_view(&Default::default());
    let target = RenderTarget { view: &view, format, background: None };
    let camera = built.orbit(0.0, 0.0, None, size);
    let fault = renderer.render_to(&camera, &Settings::every_pixel(size), &target).unwrap_err().to_string();
    assert!(fault.contains("64x51") && fault.contains("64x50"), "{fault}");
}

#[test]
fn a_device_that_was_lost_is_an_error() {
    let Some(opened) = own_device() else { return };
    let built = phantom("gyroid", [16, 16, 16], [1.0; 3], transfer(LIT_LAYERS), 8);
    let (device, queue) = (opened.device.clone(), opened.queue.clone());
    let mut renderer = GpuRenderer::new(device, queue, built.scene(), GpuOptions::default()).unwrap();
    let (camera, settings) = (built.orbit(0.0, 0.0, None, SIZE), Settings::every_pixel(SIZE));
    renderer.render(&camera, &settings).unwrap();
    opened.device.destroy();
    let fault = renderer.render(&camera, &settings).unwrap_err();
    assert!(matches!(fault, Error::Device { .. }), "{fault}");
    assert!(!fault.to_string().contains('\n'), "{fault}");
}
