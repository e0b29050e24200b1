//! Reading back: from pixels on the device to a frame.
//!
//! In: a window's accumulated pixels, in a buffer (tiles) or in a target (quads). Out: finished pixels.

use half::f16;
use web_time::Instant;
use wgpu::{Extent3d, TexelCopyBufferInfo, TexelCopyBufferLayout};

use super::buffers::{BufferName, FrameBuffers};
use super::context::Context;
use super::{Compositor, GpuRenderer, GpuStats, QuadFormat};
use crate::error::Result;
use crate::parallel::in_parts;

const PIXELS_OF_THREAD: usize = 1 << 15; // Fewest pixels that are worth another thread: some tenths of a millisecond.
pub(super) const COUNTERS: u64 = 4_096; // Number of counters of drawn splats; later chunks use them again.

/// Copies the pixels of a window of `size` (columns and rows) from the device into `out`, the window's part of a frame, and
/// finishes them on up to `threads` threads.
pub(super) async fn window(
    renderer: &mut GpuRenderer<'_>,
    size: [u32; 2],
    out: &mut [f32],
    threads: usize,
    stats: &mut GpuStats,
) -> Result<()> {
    let start = Instant::now();
    let (context, compositor) = (renderer.resident.context.clone(), renderer.resident.current);
    let [width, height] = size;
    let (target, pitch) = match compositor {
        Compositor::Tiles => (QuadFormat::Float32, 16 * width),
        // In a copy of a texture, each row starts at a multiple of 256 bytes.
        Compositor::Quads(target) => (target, (target.pixel_bytes() * width).next_multiple_of(256)),
    };
    let bytes = u64::from(pitch) * u64::from(height);
    let buffers = &mut renderer.resident.buffers;
    let back = buffers.make(&context, BufferName::ReadBack, bytes)?;
    let mut encoder = context.encoder("read back");
    match compositor {
        Compositor::Tiles => {
            encoder.copy_buffer_to_buffer(buffers.get(BufferName::Pixels), 0, &back, 0, Some(bytes));
        }
        Compositor::Quads(_) => {
            let layout = TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(pitch), rows_per_image: Some(height) };
            let size = Extent3d { width, height, depth_or_array_layers: 1 };
            let to = TexelCopyBufferInfo { buffer: &back, layout };
            encoder.copy_texture_to_buffer(buffers.target().as_image_copy(), to, size);
        }
    }
    if let Some(timer) = &renderer.resident.timer {
        timer.resolve(&mut encoder);
    }
    context.submit([encoder.finish()])?;
    let table = &renderer.looks().table;
    let pixels = out.as_chunks_mut::<4>().0;
    let threads = threads.min(pixels.len() / PIXELS_OF_THREAD).max(1);
    let finish = |bytes: &[u8]| {
        let (width, pitch, pixel_bytes) = (width as usize, pitch as usize, target.pixel_bytes() as usize);
        in_parts(pixels, width, threads, |first, rows| {
            for (row, read) in rows.chunks_exact_mut(width).zip(bytes[first * pitch..].chunks_exact(pitch)) {
                for (pixel, read) in row.iter_mut().zip(read.chunks_exact(pixel_bytes)) {
                    *pixel = table.finish(target.decode(read));
                }
            }
        });
    };
    context.read(&back, bytes, finish).await?;
    if let Some(timer) = &mut renderer.resident.timer {
        let [walk, project, bin, composite] = timer.read(&context).await?;
        stats.walk_ms += walk;
        stats.project_ms += project;
        stats.bin_ms += bin;
        stats.composite_ms += composite;
    }
    stats.read_back_ms += start.elapsed().as_secs_f64() * 1e3;
    Ok(())
}

/// Returns the number of splats that were drawn since the counters were cleared.
pub(super) async fn drawn(buffers: &mut FrameBuffers, context: &Context) -> Result<u64> {
    let back = buffers.make(context, BufferName::DrawnBack, 4 * COUNTERS)?;
    let mut encoder = context.encoder("count");
    encoder.copy_buffer_to_buffer(buffers.get(BufferName::Drawn), 0, &back, 0, Some(4 * COUNTERS));
    context.submit([encoder.finish()])?;
    let sum = |bytes: &[u8]| bytes.as_chunks().0.iter().map(|count| u64::from(u32::from_le_bytes(*count))).sum();
    context.read(&back, 4 * COUNTERS, sum).await
}

impl QuadFormat {
    /// Returns the four values of a pixel that is stored as `bytes`.
    fn decode(self, bytes: &[u8]) -> [f32; 4] {
        match self {
            QuadFormat::Float32 => bytemuck::pod_read_unaligned(bytes),
            QuadFormat::Float16 => {
                bytemuck::pod_read_unaligned::<[u16; 4]>(bytes).map(|bits| f16::from_bits(bits).to_f32())
            }
            QuadFormat::Unorm8 => std::array::from_fn(|at| f32::from(bytes[at]) / 255.0),
        }
    }
}
