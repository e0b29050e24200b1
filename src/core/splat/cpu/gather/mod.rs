//! Splats drawn onto a lattice: its tiles take the voxels in front of them.
//!
//! In: a drawing task and a [`Lattice`]. Out: the lattice's picture, which is then warped. A thread draws one band of rows of
//! tiles after another.

pub(super) mod band;
mod lists;
mod look_tables;
mod scan_line;
mod slab;
mod spans;
mod stamps;
mod take;
mod tile_composite;

use self::band::Band;
use self::look_tables::LookTables;
use super::blend::Blend;
use super::lattice::{Footprints, Lattice};
use super::task::{BandStats, DrawTask};
use super::tile_buffer::TILE_SHIFT;
use super::{dispatch, plain};
use crate::error::Result;
use crate::parallel::{MOST_THREADS, on_each};
use crate::splat::{Code, Frame};

/// Slack added to how far a kernel reaches, as bounds are rounded: in voxels, or in pixels of the plane.
const SLACK: f64 = 1e-3;

/// Draws all voxels on a lattice, band by band. Transmittances become opacities.
pub(super) fn draw<B: Blend>(task: &DrawTask, lattice: &Lattice) -> Result<(Frame, BandStats)> {
    let threads = task.settings.threads.min(MOST_THREADS);
    let shown = lattice.shown(task.front);
    let footprints = Footprints::new(lattice, &task.projector);
    if task.settings.code == Code::Plain {
        return plain::draw_on_lattice::<B>(task, lattice, footprints.as_ref(), &shown);
    }
    let rows = lattice.size[1] as usize >> TILE_SHIFT;
    // Bands of few rows of tiles stay near in the cache, and let threads end at about the same time. But what lies at
    // a band's border is read twice, and each band computes stamps.
    let each = if threads == 1 { 32 } else { rows.div_ceil(2 * threads).clamp(8, 32) };
    let looks = LookTables::new(&task.projector, lattice);
    let tables = (looks.as_ref(), footprints.as_ref());
    let (mut frame, mut stats) = (Frame::transparent(lattice.kept())?, BandStats::default());
    let instructions = dispatch::instruction_set(task.settings.code);
    let (transmits, halves) = (B::INITIAL_ALPHA > 0.0, lattice.halves());
    let [columns, kept_rows] = [frame.size()[0] as usize, (each << TILE_SHIFT) >> u32::from(halves[1])];
    let draw = |band: &mut Option<_>, (index, kept): (usize, &mut [[f32; 4]])| {
        let rows = [each * index, rows.min(each * (index + 1))].map(|row| row as i32);
        let band = match band {
            Some(band) => band,
            None => band.insert(Band::new(task, lattice, tables, each)?),
        };
        let stats = band::draw::<B>(task, band, &shown, rows)?;
        fearless_simd::dispatch!(instructions, simd => band.tiles.put(simd, transmits, halves, kept, columns));
        Ok(stats)
    };
    let bands = frame.pixels_mut().as_chunks_mut().0.chunks_mut(columns * kept_rows).enumerate();
    for band in on_each(bands, threads, || None, draw) {
        stats.add(&band?);
    }
    stats.bands = threads.min(rows.div_ceil(each));
    Ok((frame, stats))
}
