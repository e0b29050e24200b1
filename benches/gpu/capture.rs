//! The splats of a frame, read from the renderer's buffers chunk by chunk, and the work of its stages.

use adjsplat::internals::gpu_stages::Probe;
use adjsplat::internals::gpu_stages::{BATCH, FrameUniform, SUMMARY_WORDS, Splat, TILE_SIDE, VisitedVoxel};
use adjsplat::splat::gpu::{Compositor, GpuOptions, GpuRenderer, GpuStats};
use adjsplat::splat::{Camera, Frame, Settings, View};

use super::device::Gpu;
use super::subject::BenchScene;

/// Video memory in bytes: enough for the largest scene; the renderer takes what it needs.
pub(crate) const VRAM: u64 = 6 << 30;

/// The work of the stages of a frame.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Work {
    /// Records that were walked.
    pub(crate) records: u64,
    pub(crate) lines: u64,
    /// Splats that were drawn.
    pub(crate) splats: u64,
    /// Pixels of all splats' boxes.
    pub(crate) pixels_touched: u64,
    /// Batches of splats that tiles read, over all tiles.
    pub(crate) tile_batches: u64,
    pub(crate) chunks: u64,
    /// Bytes of a record's value, normal and magnitude.
    pub(crate) channel_bytes: u64,
}

/// The splats of a frame.
pub(crate) struct Capture {
    pub(crate) uniform: FrameUniform,
    pub(crate) work: Work,
    pub(crate) frame: Frame,
    /// Drawn splats in visit order, at most as many as were asked for.
    pub(crate) splats: Vec<Splat>,
    /// Index of each splat's record in its lane.
    pub(crate) records: Vec<u32>,
    /// Distance of each splat from the eye, in world units.
    pub(crate) distances: Vec<f32>,
}

/// Draws a frame, in one window and one slab, and keeps at most `most` of its splats.
pub(crate) fn capture(gpu: &Gpu, subject: &BenchScene, camera: &Camera, settings: &Settings, most: usize) -> Capture {
    let options = GpuOptions::default().with_vram(VRAM).with_compositor(Compositor::Tiles);
    let renderer = GpuRenderer::new(gpu.device.clone(), gpu.queue.clone(), subject.scene, options);
    let mut renderer = renderer.expect("a renderer");
    let facts = subject.scene.facts;
    let view = View::new(camera, &facts.grid, settings.size, settings.kernel(), settings.near).expect("a view");
    let distance = |voxel: &VisitedVoxel| {
        let at = [voxel.xy & 0xffff, voxel.xy >> 16, voxel.z_coverage & 0xffff];
        let square = |a: usize| (view.eye_scaled[a] - f64::from(at[a]) * facts.grid.spacing[a]).powi(2);
        #[expect(clippy::cast_possible_truncation, reason = "keys are of single precision")]
        let distance = (0..3).map(square).sum::<f64>().sqrt() as f32;
        distance
    };
    let (mut splats, mut records, mut distances) = (Vec::new(), Vec::new(), Vec::new());
    let mut work = Work { channel_bytes: facts.channels.record_bytes() - 1, ..Work::default() };
    let mut uniform = None;
    let mut look = |probe: &Probe| {
        uniform = Some(*probe.uniform);
        let count = probe.chunk.slot_count as usize;
        work.records += count as u64;
        work.lines += probe.blocks.iter().map(|block| u64::from(block.line_count)).sum::<u64>();
        work.chunks += 1;
        let [left, top, right, bottom] = probe.uniform.window;
        let tiles = [right - left, bottom - top].map(|side| side.cast_unsigned().div_ceil(TILE_SIDE) as usize);
        let words = tiles[0] * tiles[1] * probe.uniform.mask_words as usize;
        let masks: Vec<u32> = gpu.read(probe.masks.expect("tiles have masks"), words);
        // The shader does not read words beyond the chunk's batches.
        let used = count.div_ceil(BATCH as usize).div_ceil(32);
        let rows = masks.chunks_exact(probe.uniform.mask_words as usize);
        let masks = rows.flat_map(|row| &row[SUMMARY_WORDS as usize..][..used]);
        work.tile_batches += masks.map(|word| u64::from(word.count_ones())).sum::<u64>();
        let voxels: Vec<VisitedVoxel> = gpu.read(probe.voxels, count);
        let drawn: Vec<Splat> = gpu.read(probe.splats, count);
        for (voxel, splat) in voxels.iter().zip(&drawn) {
            let side = |halves: u32| i64::from(halves >> 16) - i64::from(halves & 0xffff) + 1;
            if side(splat.columns) <= 0 || side(splat.rows) <= 0 {
                continue;
            }
            work.splats += 1;
            work.pixels_touched += (side(splat.columns) * side(splat.rows)).cast_unsigned();
            if splats.len() < most {
                splats.push(*splat);
                records.push(voxel.record);
                distances.push(distance(voxel));
            }
        }
    };
    let (frame, stats) = renderer.render_probed(camera, settings, Some(&mut look)).expect("a frame");
    let GpuStats { splats_drawn, slabs, windows, .. } = stats;
    assert_eq!((slabs, windows), (1, 1), "records and masks are read as those of one slab and one window");
    assert_eq!(work.splats, splats_drawn, "the device counted other splats than it left");
    Capture { uniform: uniform.expect("something is in view"), work, frame, splats, records, distances }
}
