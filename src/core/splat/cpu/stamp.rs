//! Drawing a band of the base plane by stamps, on one thread.
//!
//! In: a drawing task whose view is that of a [`base plane`](super::base_plane), the band's rectangle. Out: the band's
//! pixels, composited front to back. All voxels of a slice have the same offset from the plane's pixels. So the weights
//! of a footprint, the *stamp*, are computed once for a slice. A voxel's amounts (the part of the light that it takes
//! from each pixel) are computed together, and composited row by row, eight pixels at once:
//!
//! ```text
//! slice -> stamp (weights) -> voxels that are not hidden -> 128 at a time: colours -> rows
//! ```
//!
//! The plain renderer draws the same view pixel by pixel; tests compare the two.

use std::ops::Range;

use super::dispatch;
use super::project::{Projector, VoxelBlock, affine_at, nearest_pixel, pixel_span};
use super::raster::{BLOCK, Centre, SplatKernel, Splats};
use super::row_buffer::{EIGHT, RowBuffer, WIDE};
use super::task::{BandResult, BandStats, DrawTask};
use super::tile_buffer::Rect;
use crate::error::Result;
use crate::splat::Code;
use crate::splat::arith::absorbed;
use crate::splat::view::PixelMap;
use crate::traverse::{Batch, Visitor, VoxelBox};

/// Largest number of columns, and of rows, of a stamp.
const SIDE: usize = EIGHT;
/// Footprints with a half-width below this, in pixels, fit a stamp: twice this is at most [`SIDE`] pixels.
pub(super) const MAX_HALF_WIDTH: f32 = 4.0;
/// The weights or the amounts at the pixels of a stamp, by row and column.
type StampRows = [[f32; SIDE]; SIDE];

/// The weights that all footprints of a slice share, and the pixels that they cover.
#[derive(Default)]
struct Stamp {
    /// First column and first row of the footprint of a voxel whose fast and medium coordinates are 0.
    left: i32,
    top: i32,
    /// Number of columns and rows.
    columns: usize,
    rows: usize,
    /// Coordinate of the slice on the slow axis.
    slow: u16,
    weights: StampRows,
}

impl Stamp {
    /// Returns the stamp of the slice `slow`. The view must be that of a base plane, where voxels are one pixel apart.
    fn new(projector: &Projector, slow: u16) -> Stamp {
        let PixelMap::Parallel { pixel_from_voxel, .. } = &projector.map else {
            unreachable!("a base plane is a parallel view's")
        };
        let ellipse = projector.ellipse;
        let [(x, offset_x), (y, offset_y)] =
            pixel_from_voxel.map(|map| nearest_pixel(affine_at(&projector.nested(&map), [slow.into(), 0.0, 0.0])));
        let (left, right) = pixel_span((x, offset_x), ellipse.half_x);
        let (top, bottom) = pixel_span((y, offset_y), ellipse.half_y);
        let [columns, rows] =
            [(left, right), (top, bottom)].map(|(low, high)| ((high - low + 1).max(0) as usize).min(SIDE));
        let centre = Centre { x, y, offset_x, offset_y };
        let kernel = SplatKernel { centre, ellipse, cut: projector.cut, peak: 1.0 };
        let mut weights = StampRows::default();
        for (y, weights) in (top..=bottom).zip(&mut weights) {
            for (x, weight) in (left..=right).zip(weights) {
                *weight = kernel.depth(x, y);
            }
        }
        Stamp { left, top, columns, rows, slow, weights }
    }

    /// Returns how many voxels of a batch, starting with voxel `first`, lie on one scan line and so near to each other
    /// that all their stamps together span at most [`WIDE`] columns.
    #[inline(always)]
    fn neighbours(&self, batch: &Batch, first: usize) -> usize {
        let (medium, fast) = (batch.medium[first], batch.fast[first]);
        let most = (WIDE - self.columns) as u16;
        let is_near =
            |other_medium: u16, other_fast: u16| (other_medium == medium) & (other_fast.abs_diff(fast) <= most);
        let (mediums, fasts) = (&batch.medium[first..], &batch.fast[first..]);
        let mut count = 0u16;
        if let (Some(mediums), Some(fasts)) = (mediums.first_chunk::<WIDE>(), fasts.first_chunk::<WIDE>()) {
            for i in 0..WIDE {
                count += u16::from(is_near(mediums[i], fasts[i]));
            }
        } else {
            for (medium, fast) in mediums.iter().zip(fasts).take(WIDE) {
                count += u16::from(is_near(*medium, *fast));
            }
        }
        usize::from(count)
    }
}

/// How many value codes (stored numbers of values) have their amounts kept, for the stamp of one slice.
const CODES: usize = 256;

/// The part of the light that a voxel takes from each pixel of its stamp.
#[derive(Debug, Clone, Copy)]
struct Amounts {
    /// The slice for whose stamp they were computed.
    slow: u16,
    /// The peak of optical depth for which they were computed; NaN if they were not computed yet.
    peak: f32,
    rows: StampRows,
}

impl Amounts {
    /// Computes the amounts for `stamp` and a peak of optical depth in units of ln 2.
    #[inline(always)]
    fn fill(&mut self, stamp: &Stamp, peak: f32) {
        (self.slow, self.peak) = (stamp.slow, peak);
        // One long loop: the compiler does not vectorise short ones over the rows.
        let count = SIDE * stamp.rows.min(SIDE);
        let (amounts, weights) = (self.rows.as_flattened_mut(), stamp.weights.as_flattened());
        for (amount, weight) in amounts[..count].iter_mut().zip(&weights[..count]) {
            *amount = absorbed(peak * weight);
        }
    }
}

/// Draws the band `rect` of the plane.
pub(super) fn draw(task: &DrawTask, rect: Rect) -> Result<BandResult<RowBuffer>> {
    let unfilled = Amounts { slow: 0, peak: f32::NAN, rows: StampRows::default() };
    let mut painter = StampPainter {
        task,
        slow: None,
        buffers: StampBuffers {
            pixels: RowBuffer::new(rect)?,
            stamp: Stamp::default(),
            voxels: VoxelBlock::new(),
            splats: Splats::new(),
            amounts: Box::new([unfilled; CODES]),
        },
        drawn: 0,
    };
    let stats = task.walk(&mut painter);
    painter.flush();
    Ok(BandResult { pixels: painter.buffers.pixels, stats: BandStats { drawn: painter.drawn, ..stats } })
}

/// Receives the voxels of a walk and draws them by stamps.
struct StampPainter<'a> {
    task: &'a DrawTask<'a>,
    /// The slice of the voxels that wait to be drawn.
    slow: Option<u16>,
    buffers: StampBuffers,
    /// Number of splats drawn.
    drawn: u64,
}

impl StampPainter<'_> {
    /// Draws the voxels that wait in the buffers.
    fn flush(&mut self) {
        let DrawTask { projector, settings, .. } = self.task;
        if self.buffers.voxels.count > 0 {
            self.drawn += dispatch::flush_stamps(settings.code, projector, &mut self.buffers);
        }
    }
}

impl Visitor for StampPainter<'_> {
    fn wants_tile(&mut self, bounds: &VoxelBox) -> bool {
        self.task.pixels(self.buffers.pixels.rect, bounds).is_some()
    }

    fn wants_row(&mut self, bounds: &VoxelBox) -> bool {
        let pixels = &self.buffers.pixels;
        self.task.pixels(pixels.rect, bounds).is_some_and(|rect| !pixels.is_closed(rect))
    }

    fn visit(&mut self, batch: &Batch) {
        let DrawTask { projector, settings, .. } = self.task;
        if self.slow != Some(batch.slow) {
            self.flush();
            self.slow = Some(batch.slow);
            self.buffers.stamp = Stamp::new(projector, batch.slow);
        }
        let code = settings.code;
        self.drawn += dispatch::add_visible(code, code, projector, &mut self.buffers, batch);
        // A pager (which loads parts of the file) may drop this batch's records before the next batch.
        if projector.lane.pager.is_some() {
            self.flush();
        }
    }
}

/// The pixels of a band, and the voxels that one thread is drawing on them.
pub(super) struct StampBuffers {
    pixels: RowBuffer,
    /// The stamp of the slice of the voxels that are not drawn yet.
    stamp: Stamp,
    /// Voxels that are not drawn yet.
    voxels: Box<VoxelBlock>,
    splats: Box<Splats>,
    /// The amounts of each value code, for the current stamp.
    amounts: Box<[Amounts; CODES]>,
}

/// Fewest neighbouring voxels that are tested together. Fewer than this are tested one by one when they are drawn.
const TESTED_TOGETHER: usize = 5;

impl StampBuffers {
    /// Adds those voxels of a batch that are not hidden to the voxels that wait, and draws them whenever a block is
    /// full. Returns how many splats were drawn.
    #[inline(always)]
    pub(super) fn add_visible(&mut self, code: Code, projector: &Projector, batch: &Batch) -> u64 {
        let (mut drawn, mut from, mut to) = (0, 0, 0);
        while to < batch.len() {
            let count = self.stamp.neighbours(batch, to);
            if count >= TESTED_TOGETHER && !self.is_open(batch, to, count, projector.stop) {
                drawn += self.add(code, projector, batch, from..to);
                from = to + count;
            }
            to += count;
        }
        drawn + self.add(code, projector, batch, from..to)
    }

    /// Returns whether any pixel may still change under the stamps of `count` neighbouring voxels, from `first` on.
    #[inline(always)]
    fn is_open(&self, batch: &Batch, first: usize, count: usize, stop: f32) -> bool {
        let StampBuffers { pixels, stamp, .. } = self;
        let ends = [batch.fast[first], batch.fast[first + count - 1]].map(|fast| stamp.left + i32::from(fast));
        let (x, y) = (ends[0].min(ends[1]), stamp.top + i32::from(batch.medium[first]));
        // Pixels left of the band cannot be read, so voxels whose stamps reach in from there are drawn untested.
        let is_beside = ends[0].max(ends[1]) < pixels.rect.x0 || x >= pixels.rect.x1;
        !is_beside && (x < pixels.rect.x0 || pixels.are_open::<WIDE>(x, y, stamp.rows, stop))
    }

    /// Adds a range of a batch's voxels to those that wait; draws whenever a block is full. Returns how many were
    /// drawn.
    #[inline(always)]
    fn add(&mut self, code: Code, projector: &Projector, batch: &Batch, mut range: Range<usize>) -> u64 {
        let mut drawn = 0;
        while !range.is_empty() {
            if !self.voxels.have_room(1) {
                drawn += dispatch::flush_stamps(code, projector, self);
            }
            range.start += self.voxels.add(batch, range.start, range.len());
        }
        drawn
    }

    /// Draws the voxels that wait; returns how many splats were drawn.
    #[inline(always)]
    pub(super) fn flush(&mut self, projector: &Projector) -> u64 {
        let StampBuffers { pixels, stamp, voxels, splats, amounts } = self;
        Projector::place_stamps(voxels, [stamp.left, stamp.top], splats);
        splats.strength = [projector.strength; BLOCK];
        let in_crop = projector.in_crop(voxels);
        let mut kept = 0;
        for j in 0..voxels.count.min(BLOCK) {
            splats.kept[kept] = j as u8;
            let (x, y) = (splats.x.nearest[j], splats.y.nearest[j]);
            // If a stamp begins in the band, each of its columns is a column of the band or a spare one.
            let is_inside = (x >= pixels.rect.x0) & (x < pixels.rect.x1);
            let is_open = || pixels.are_open::<SIDE>(x, y, stamp.rows, projector.stop);
            kept += usize::from(in_crop[j] && is_inside && is_open());
        }
        splats.count = kept;
        projector.colour(voxels, splats);
        let by_code = projector.table.of_bytes().is_some() && projector.lane.channels.value_bits == 8;
        for k in 0..kept {
            let j = usize::from(splats.kept[k]) % BLOCK;
            let code = if by_code { projector.lane.value_code(voxels.records[j]) } else { 0 };
            let amounts = &mut amounts[usize::from(code) % CODES];
            let peak = splats.peak[k];
            if amounts.peak.to_bits() != peak.to_bits() || amounts.slow != stamp.slow {
                amounts.fill(stamp, peak);
            }
            let first = [splats.x.nearest[j], splats.y.nearest[j]];
            pixels.composite(first, &amounts.rows, stamp.rows, &splats.ink[k], projector.stop);
        }
        voxels.count = 0;
        kept as u64
    }
}
