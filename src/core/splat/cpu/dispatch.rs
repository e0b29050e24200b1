//! The inner loops, compiled for several instruction sets and chosen at run time.
//!
//! All versions give the same bits: they do the same arithmetic, and differ in how many values they compute at once.

use multiversion::multiversion;

use super::blend::{Additive, Blend, FrontToBack};
use super::project::{Projector, VoxelBlock};
use super::raster::{self, Splats};
use super::stamp::StampBuffers;
use super::tile_buffer::{Rect, TileBuffer};
use super::visible::VisibleRecords;
use crate::error::Result;
use crate::splat::Code;
use crate::splat::view::PixelMap;
use crate::traverse::Batch;

/// The pixels of a band, and the splats that one thread is drawing on them.
pub struct SplatBuffers {
    /// The band's pixels.
    pub tiles: TileBuffer,
    /// One block of splats.
    pub splats: Box<Splats>,
    /// For `Blending::Sheets`: the sum of a slice's splats, until the slice is composited.
    pub(super) sheet: Option<TileBuffer>,
}

impl SplatBuffers {
    /// Creates buffers for the pixels of `rect`. `has_sheet`: whether the splats of a slice are summed, then
    /// composited.
    pub fn new<B: Blend>(rect: Rect, has_sheet: bool) -> Result<SplatBuffers> {
        Ok(SplatBuffers {
            tiles: TileBuffer::new(rect, B::INITIAL_ALPHA)?,
            splats: Splats::new(),
            sheet: has_sheet.then(|| TileBuffer::sheet(rect)).transpose()?,
        })
    }
}

/// Defines a function that runs the version of its body for the instruction set `code`, its first argument.
macro_rules! for_each_instruction_set {
    ($(#[$doc:meta])* $vis:vis fn $name:ident$(<$blend:ident>)?($($arg:ident: $kind:ty),*) -> u64 $body:block) => {
        $(#[$doc])*
        $vis fn $name$(<$blend: Blend>)?(code: Code, $($arg: $kind),*) -> u64 {
            #[multiversion(
                targets("x86_64+avx+avx2+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx+avx2"),
                dispatcher = "direct"
            )]
            fn best$(<$blend: Blend>)?($($arg: $kind),*) -> u64 $body

            #[multiversion(targets("x86_64+avx+avx2"), dispatcher = "direct")]
            fn avx2$(<$blend: Blend>)?($($arg: $kind),*) -> u64 $body

            fn portable$(<$blend: Blend>)?($($arg: $kind),*) -> u64 $body

            match code {
                Code::Best => best$(::<$blend>)?($($arg),*),
                Code::Avx2 => avx2$(::<$blend>)?($($arg),*),
                Code::Portable | Code::Plain => portable$(::<$blend>)?($($arg),*),
            }
        }
    };
}

for_each_instruction_set! {
    /// Projects and draws a block of voxels; returns how many splats were drawn.
    pub fn project_and_draw<B>(projector: &Projector, voxels: &VoxelBlock, buffers: &mut SplatBuffers) -> u64 {
        let SplatBuffers { tiles, splats, sheet } = buffers;
        projector.project_block(voxels, splats, tiles);
        match sheet {
            None => draw_splats::<B>(projector, tiles, splats),
            Some(sheet) => draw_splats::<Additive>(projector, sheet, splats),
        }
    }
}

for_each_instruction_set! {
    /// Runs [`StampBuffers::flush`].
    pub(super) fn flush_stamps(projector: &Projector, buffers: &mut StampBuffers) -> u64 {
        buffers.flush(projector)
    }
}

for_each_instruction_set! {
    /// Runs [`StampBuffers::add_visible`]; `flush_code` selects the instruction set with which full blocks are drawn.
    pub(super) fn add_visible(
        flush_code: Code,
        projector: &Projector,
        buffers: &mut StampBuffers,
        batch: &Batch
    ) -> u64 {
        buffers.add_visible(flush_code, projector, batch)
    }
}

/// Projects a block of voxels, marks the visible ones, then draws the block front to back.
#[multiversion(targets("x86_64+avx+avx2+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx+avx2"), dispatcher = "direct")]
pub(super) fn mark_and_draw(
    projector: &Projector,
    voxels: &VoxelBlock,
    buffers: &mut SplatBuffers,
    visible: VisibleRecords,
) -> u64 {
    let SplatBuffers { tiles, splats, .. } = buffers;
    projector.project_block(voxels, splats, tiles);
    visible.mark(projector, voxels, splats, tiles);
    draw_splats::<FrontToBack>(projector, tiles, splats)
}

/// Composites the sheet (the sum of a slice's splats) behind the band's pixels, if there is a sheet.
#[multiversion(targets("x86_64+avx+avx2+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx+avx2"), dispatcher = "direct")]
pub(super) fn composite_sheet(buffers: &mut SplatBuffers, stop: f32) {
    if let SplatBuffers { tiles, sheet: Some(sheet), .. } = buffers {
        tiles.composite(sheet, stop);
    }
}

/// Draws a projected block on `tiles`; returns how many splats were drawn.
#[inline(always)]
pub fn draw_splats<B: Blend>(projector: &Projector, tiles: &mut TileBuffer, splats: &Splats) -> u64 {
    let thresholds = [projector.cut, projector.stop];
    match &projector.map {
        PixelMap::Parallel { .. } => raster::draw::<B>(tiles, splats, |_| projector.ellipse, thresholds),
        PixelMap::Perspective { .. } => raster::draw::<B>(tiles, splats, |j| splats.ellipse(j), thresholds),
    }
}
