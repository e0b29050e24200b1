//! Drawing on a base plane: one stamp a slice.
//!
//! In: a lane, an order, the view onto the [`base plane`](super::base_plane). Out: a band of the plane. All voxels of a
//! slice lie alike between the plane's pixels, so a footprint's weights are computed once for a slice; a voxel's
//! amounts on all its pixels are computed together, and go row by row onto the plane, eight pixels a step:
//!
//! ```text
//! slice -> stamp (weights) -> voxels that are not behind what is opaque -> 128 at a time: colours -> rows
//! ```
//!
//! Composites front to back. The plain twin is the renderer of any view, given the same view.

#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::needless_range_loop,
    reason = "coordinates lie on a plane of 16,384 pixels a side; index loops over arrays run side by side"
)]

use std::ops::Range;
use std::time::{Duration, Instant};

use super::band;
use super::band::{Drawn, Extra, Work};
use super::dispatch;
use super::plane_rows::{EIGHT, Rows, WIDE};
use super::planes::Rect;
use super::project::{Kind, Projector, Voxels, along, span, split};
use super::raster::{BLOCK, Centre, Kernel, Limits, Splats};
use super::without::Without;
use crate::error::Result;
use crate::splat::arith::absorbed;
use crate::splat::{Code, View};
use crate::traverse::{Batch, Order, Visitor, VoxelBox, walk};

/// Pixels of a stamp's row, and its rows, at most.
const SIDE: usize = EIGHT;
/// Footprints whose half-widths are below this fit a stamp: two of them and a pixel's width are at most [`SIDE`].
pub(super) const REACH: f32 = 4.0;

/// The weights of a slice's footprints.
struct Stamp {
    /// Its first column and row, of a voxel whose fast and medium coordinates are 0.
    left: i32,
    top: i32,
    /// Its columns and rows.
    columns: usize,
    rows: usize,
    slow: u16,
    weights: [[f32; SIDE]; SIDE],
}

impl Stamp {
    /// Of the voxels whose slow coordinate is `slow`, in a view whose voxels' steps are the plane's pixels.
    fn of(projector: &Projector, slow: u16, limits: Limits) -> Stamp {
        let Kind::Parallel { pixel_from_voxel, ellipse, .. } = &projector.kind else {
            unreachable!("a base plane is a parallel view's")
        };
        let [s, m, f] = projector.nesting;
        let [column, row] =
            pixel_from_voxel.map(|map| split(along(&[map[s], map[m], map[f], map[3]], [slow.into(), 0.0, 0.0])));
        let (left, right) = span(column, ellipse.half_x);
        let (top, bottom) = span(row, ellipse.half_y);
        let [columns, rows] =
            [(left, right), (top, bottom)].map(|(low, high)| ((high - low + 1).max(0) as usize).min(SIDE));
        let centre = Centre { x: column.0, y: row.0, rest_x: column.1, rest_y: row.1 };
        let kernel = Kernel { centre, ellipse: *ellipse, cut: limits.cut, peak: 1.0 };
        let mut weights = [[0.0; SIDE]; SIDE];
        for (y, weights) in (top..=bottom).zip(&mut weights) {
            for (x, weight) in (left..=right).zip(weights) {
                *weight = kernel.depth(x, y);
            }
        }
        Stamp { left, top, columns, rows, slow, weights }
    }
}

/// Value codes of which the amounts on a slice's stamps are kept.
const CODES: usize = 256;

/// What a voxel takes of each pixel of its stamp.
#[derive(Debug, Clone, Copy)]
struct Amounts {
    /// The slice, and the peak of optical depth; NaN for none yet.
    slow: u16,
    peak: f32,
    rows: [[f32; SIDE]; SIDE],
}

impl Amounts {
    #[inline(always)]
    fn fill(&mut self, stamp: &Stamp, peak: f32) {
        (self.slow, self.peak) = (stamp.slow, peak);
        // One long loop: of the rows' short ones the compiler makes no vectors.
        let all = SIDE * stamp.rows.min(SIDE);
        let (amounts, weights) = (self.rows.as_flattened_mut(), stamp.weights.as_flattened());
        for (amount, weight) in amounts[..all].iter_mut().zip(&weights[..all]) {
            *amount = absorbed(peak * weight);
        }
    }
}

/// What a band's thread works with.
pub struct Bench {
    pub(super) rows: Rows,
    /// Of the slice whose voxels wait.
    stamp: Stamp,
    voxels: Box<Voxels>,
    pub splats: Box<Splats>,
    amounts: Box<[Amounts; CODES]>,
}

/// Draws the rows `rect` of the plane.
///
/// # Errors
/// If the memory cannot be had.
pub(super) fn draw(
    projector: &Projector,
    view: &View,
    order: &Order,
    rect: Rect,
    limits: Limits,
    code: Code,
    extra: Extra,
) -> Result<Drawn<Rows>> {
    let mut band = Band {
        projector,
        view,
        half: projector.half(),
        limits,
        code,
        slow: None,
        bench: Bench {
            rows: Rows::new(rect)?,
            stamp: Stamp { left: 0, top: 0, columns: 0, rows: 0, slow: 0, weights: [[0.0; SIDE]; SIDE] },
            voxels: Voxels::new(),
            splats: Splats::new(),
            amounts: Box::new([Amounts { slow: 0, peak: f32::NAN, rows: [[0.0; SIDE]; SIDE] }; CODES]),
        },
        visited: 0,
        drawn: 0,
        drawing: Duration::ZERO,
    };
    let start = Instant::now();
    match extra.left_out {
        None => walk(&projector.lane, order, &mut band),
        Some(left_out) => walk(&projector.lane, order, &mut Without::new(&mut band, left_out)),
    }
    band.flush();
    let walking = start.elapsed().saturating_sub(band.drawing);
    let Band { bench, visited, drawn, drawing, .. } = band;
    Ok(Drawn { pixels: bench.rows, work: Work { visited, drawn, walking, drawing } })
}

struct Band<'a> {
    projector: &'a Projector<'a>,
    view: &'a View,
    half: [f64; 2],
    limits: Limits,
    code: Code,
    /// The slice whose voxels wait.
    slow: Option<u16>,
    bench: Bench,
    visited: u64,
    drawn: u64,
    drawing: Duration,
}

impl Band<'_> {
    fn pixels(&self, bounds: &VoxelBox) -> Option<Rect> {
        band::pixels(self.view, self.half, self.bench.rows.rect, bounds)
    }

    fn in_crop(&self, bounds: &VoxelBox) -> bool {
        self.projector.crop.is_none_or(|crop| bounds.meets(&crop))
    }

    /// Draws the voxels that wait.
    fn flush(&mut self) {
        if self.bench.voxels.count == 0 {
            return;
        }
        self.drawn += dispatch::stamped(self.code, self.projector, &mut self.bench, self.limits);
    }
}

impl Visitor for Band<'_> {
    fn wants_tile(&mut self, bounds: &VoxelBox) -> bool {
        self.in_crop(bounds) && self.pixels(bounds).is_some()
    }

    fn wants_row(&mut self, bounds: &VoxelBox) -> bool {
        self.in_crop(bounds) && self.pixels(bounds).is_some_and(|rect| !self.bench.rows.is_closed(rect))
    }

    fn visit(&mut self, batch: &Batch) {
        let start = Instant::now();
        if self.slow != Some(batch.slow) {
            self.flush();
            self.slow = Some(batch.slow);
            self.bench.stamp = Stamp::of(self.projector, batch.slow, self.limits);
        }
        self.drawn += dispatch::sifted(self.code, self.projector, &mut self.bench, self.limits, batch);
        // What a pager let in may be gone when the next batch comes.
        if self.projector.lane.pager.is_some() {
            self.flush();
        }
        self.visited += batch.len() as u64;
        self.drawing += start.elapsed();
    }
}

impl Bench {
    /// Lets those voxels of a batch of the stamp's slice wait that are not behind what is opaque, and draws them as they
    /// fill a block; gives how many splats were drawn.
    #[inline(always)]
    pub(super) fn sift(&mut self, code: Code, projector: &Projector, limits: Limits, batch: &Batch) -> u64 {
        let (mut drawn, mut from, mut at) = (0, 0, 0);
        while at < batch.len() {
            let count = self.stamp.neighbours(batch, at);
            if count >= FEW && !self.is_open(batch, at, count, limits.stop) {
                drawn += self.wait(code, projector, limits, batch, from..at);
                from = at + count;
            }
            at += count;
        }
        drawn + self.wait(code, projector, limits, batch, from..at)
    }

    /// Whether some pixel of the stamps of `count` neighbours from `at` on may still change.
    #[inline(always)]
    fn is_open(&self, batch: &Batch, at: usize, count: usize, stop: f32) -> bool {
        let Bench { rows, stamp, .. } = self;
        let ends = [batch.fast[at], batch.fast[at + count - 1]].map(|fast| stamp.left + i32::from(fast));
        let (x, y) = (ends[0].min(ends[1]), stamp.top + i32::from(batch.medium[at]));
        // Left of the band nothing can be read: what reaches in from there is drawn.
        let is_beside = ends[0].max(ends[1]) < rows.rect.x0 || x >= rows.rect.x1;
        !is_beside && (x < rows.rect.x0 || rows.are_open::<WIDE>(x, y, stamp.rows, stop))
    }

    /// Lets a range of a batch's voxels wait for a block to be full.
    #[inline(always)]
    fn wait(
        &mut self,
        code: Code,
        projector: &Projector,
        limits: Limits,
        batch: &Batch,
        mut range: Range<usize>,
    ) -> u64 {
        let mut drawn = 0;
        while !range.is_empty() {
            if !self.voxels.have_room(1) {
                drawn += dispatch::stamped(code, projector, self, limits);
            }
            range.start += self.voxels.add(batch, range.start, range.len());
        }
        drawn
    }

    /// Draws the voxels that wait; gives how many splats were drawn.
    #[inline(always)]
    pub(super) fn flush(&mut self, projector: &Projector, limits: Limits) -> u64 {
        let Bench { rows, stamp, voxels, splats, amounts } = self;
        let Kind::Parallel { strength, .. } = &projector.kind else { return 0 };
        Projector::plane_places(voxels, [stamp.left, stamp.top], splats);
        splats.strength = [*strength; BLOCK];
        let wanted = projector.in_crop(voxels);
        let mut kept = 0;
        for j in 0..voxels.count.min(BLOCK) {
            splats.kept[kept] = j as u8;
            // All columns of a stamp that begins in the band are on the plane or on what is to spare.
            let is_inside = (splats.x[j] >= rows.rect.x0) & (splats.x[j] < rows.rect.x1);
            let is_open = || rows.are_open::<SIDE>(splats.x[j], splats.y[j], stamp.rows, limits.stop);
            kept += usize::from(wanted[j] && is_inside && is_open());
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
            rows.put([splats.x[j], splats.y[j]], &amounts.rows, stamp.rows, &splats.ink[k], limits.stop);
        }
        voxels.count = 0;
        kept as u64
    }
}

/// Of fewer neighbours each is asked for itself, later.
const FEW: usize = 5;

impl Stamp {
    /// How many voxels of a batch from `at` on lie on one line and have all their pixels among [`WIDE`]: they are fewer.
    #[inline(always)]
    fn neighbours(&self, batch: &Batch, at: usize) -> usize {
        let (medium, fast) = (batch.medium[at], batch.fast[at]);
        let most = (WIDE - self.columns) as u16;
        let is_near =
            |other_medium: u16, other_fast: u16| (other_medium == medium) & (other_fast.abs_diff(fast) <= most);
        let (mediums, fasts) = (&batch.medium[at..], &batch.fast[at..]);
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
