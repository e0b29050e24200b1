//! Drawing on a base plane: one stamp a slice.
//!
//! In: a lane, an order, the view onto the [`base plane`](super::base_plane). Out: a band of the plane. All voxels of a
//! slice lie alike between the plane's pixels, so a footprint's weights are computed once for a slice; a voxel's
//! amounts on all its pixels are computed together, and go row by row onto the plane, eight pixels a step:
//!
//! ```text
//! slice -> stamp (weights) -> voxels, 128 at a time: those that are not behind what is opaque -> colours -> rows
//! ```
//!
//! Composites front to back. The plain twin is the renderer of any view, given the same view.

#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::needless_range_loop,
    reason = "coordinates lie on a plane of 16,384 pixels a side; index loops over arrays run side by side"
)]

use std::time::{Duration, Instant};

use super::arith::{absorbed, keep_if};
use super::band::{self, Drawn, Extra, Work};
use super::dispatch;
use super::planes::{Count, Rect};
use super::project::{Kind, Projector, Voxels, along, span, split};
use super::raster::{BLOCK, Centre, Kernel, Limits, Splats};
use super::without::Without;
use crate::error::{Error, Result};
use crate::splat::{Code, View};
use crate::traverse::{Batch, Order, Visitor, VoxelBox, walk};

/// Pixels of a stamp's row, and its rows, at most.
pub(super) const SIDE: usize = 8;
/// Footprints whose half-widths are below this fit a stamp: two of them and a pixel's width are at most [`SIDE`].
pub(super) const REACH: f32 = 4.0;

/// The weights of a slice's footprints.
struct Stamp {
    /// Its first column and row, of a voxel whose fast and medium coordinates are 0.
    left: i32,
    top: i32,
    /// Its rows.
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
        let rows = ((bottom - top + 1).max(0) as usize).min(SIDE);
        let centre = Centre { x: column.0, y: row.0, rest_x: column.1, rest_y: row.1 };
        let kernel = Kernel { centre, ellipse: *ellipse, cut: limits.cut, peak: 1.0 };
        let mut weights = [[0.0; SIDE]; SIDE];
        for (y, weights) in (top..=bottom).zip(&mut weights) {
            for (x, weight) in (left..=right).zip(weights) {
                *weight = kernel.depth(x, y);
            }
        }
        Stamp { left, top, rows, slow, weights }
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
        for (amounts, weights) in self.rows.iter_mut().zip(&stamp.weights).take(stamp.rows) {
            for i in 0..SIDE {
                amounts[i] = absorbed(peak * weights[i]);
            }
        }
    }
}

/// A band of the plane: rows of reds, greens, blues and transmittances.
pub(super) struct Rows {
    pub(super) rect: Rect,
    /// Columns of each of the four values' rows: with a stamp to spare.
    pitch: usize,
    values: Box<[f32]>,
    /// Pixels of each cell of 8 x 8 that may still change.
    cells: Count,
    /// Cells of each block of 8 x 8 cells that have such pixels.
    blocks: Count,
}

/// Side of a cell in pixels, as a shift; and of a block.
const CELL: i32 = 3;
const BLOCK_OF_CELLS: i32 = 6;

impl Rows {
    fn new(rect: Rect) -> Result<Rows> {
        let columns = (rect.x1 - rect.x0) as usize;
        let pitch = columns + SIDE;
        let rows = (rect.y1 - rect.y0) as usize;
        let len = 4 * pitch * rows;
        let mut values = Vec::new();
        let refused =
            |_| Error::Limit { what: "memory for the picture in bytes".into(), need: 4 * len as u64, have: 0 };
        values.try_reserve_exact(len).map_err(refused)?;
        values.resize(len, 0.0);
        for row in values.chunks_exact_mut(4 * pitch) {
            row[3 * pitch..][..columns].fill(1.0);
        }
        let (cells, blocks) = (Count::new(rect, CELL, 0), Count::new(rect, BLOCK_OF_CELLS, CELL));
        Ok(Rows { rect, pitch, values: values.into_boxed_slice(), cells, blocks })
    }

    /// Where row `y`'s reds begin in column `x`.
    #[inline(always)]
    fn at(&self, x: i32, y: i32) -> usize {
        4 * self.pitch * (y - self.rect.y0) as usize + (x - self.rect.x0) as usize
    }

    /// Whether no pixel of `rect`, which lies in the band's, changes any more.
    fn is_closed(&self, rect: Rect) -> bool {
        let cells = |low: i32, high: i32| (low >> CELL..=(high - 1) >> CELL).map(|cell| cell << CELL);
        cells(rect.y0, rect.y1)
            .all(|y| cells(rect.x0, rect.x1).all(|x| self.blocks.is_zero(x, y) || self.cells.is_zero(x, y)))
    }

    /// Counts pixels of row `y` from column `x` on that changed for the last time.
    #[cold]
    #[inline(never)]
    fn close(&mut self, x: i32, y: i32, before: &[f32; SIDE], after: &[f32; SIDE], stop: f32) {
        for (x, (before, after)) in (x..).zip(before.iter().zip(after)) {
            if *before >= stop && *after < stop {
                let open = self.cells.at(x, y);
                *open -= 1;
                if *open == 0 {
                    *self.blocks.at(x, y) -= 1;
                }
            }
        }
    }

    /// Row `y`: its reds, greens, blues and transmittances.
    pub(super) fn row(&self, y: i32) -> [&[f32]; 4] {
        let columns = (self.rect.x1 - self.rect.x0) as usize;
        let at = self.at(self.rect.x0, y);
        [0, 1, 2, 3].map(|plane| &self.values[at + plane * self.pitch..][..columns])
    }
}

/// What a band's thread works with.
pub(super) struct Bench {
    pub(super) rows: Rows,
    /// Of the slice whose voxels wait.
    stamp: Stamp,
    splats: Box<Splats>,
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
        voxels: Voxels::new(),
        bench: Bench {
            rows: Rows::new(rect)?,
            stamp: Stamp { left: 0, top: 0, rows: 0, slow: 0, weights: [[0.0; SIDE]; SIDE] },
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
    voxels: Box<Voxels>,
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
        let Band { projector, voxels, bench, limits, code, .. } = self;
        if voxels.count > 0 {
            self.drawn += dispatch::stamped(*code, projector, voxels, bench, *limits);
            voxels.count = 0;
        }
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
        let mut from = 0;
        while from < batch.len() {
            if !self.voxels.have_room(1) {
                self.flush();
            }
            from += self.voxels.add(batch, from, BLOCK);
        }
        if self.projector.lane.pager.is_some() {
            self.flush();
        }
        self.visited += batch.len() as u64;
        self.drawing += start.elapsed();
    }
}

/// Draws a block of voxels of the stamp's slice; gives how many splats were drawn.
#[inline(always)]
pub(super) fn block(projector: &Projector, voxels: &Voxels, bench: &mut Bench, limits: Limits) -> u64 {
    let Bench { rows, stamp, splats, amounts } = bench;
    let Kind::Parallel { strength, .. } = &projector.kind else { return 0 };
    Projector::plane_places(voxels, [stamp.left, stamp.top], splats);
    splats.strength = [*strength; BLOCK];
    let wanted = projector.in_crop(voxels);
    let mut kept = 0;
    for j in 0..voxels.count.min(BLOCK) {
        splats.kept[kept] = j as u8;
        kept += usize::from(wanted[j] && is_open(rows, stamp, splats.x[j], splats.y[j], limits.stop));
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
        put(rows, stamp, [splats.x[j], splats.y[j]], &amounts.rows, &splats.ink[k], limits.stop);
    }
    kept as u64
}

/// The rows of a stamp at row `y` that lie in the band.
#[inline(always)]
fn clipped(rows: &Rows, stamp: &Stamp, y: i32) -> std::ops::Range<usize> {
    let from = (rows.rect.y0 - y).max(0) as usize;
    let to = (rows.rect.y1 - y).max(0) as usize;
    from..to.min(stamp.rows).min(SIDE)
}

/// Whether a stamp's first column lies where all its columns are on the plane or on what is to spare.
#[inline(always)]
fn is_inside(rows: &Rows, x: i32) -> bool {
    (x >= rows.rect.x0) & (x < rows.rect.x1)
}

/// Whether some pixel of a stamp may still change.
#[inline(always)]
fn is_open(rows: &Rows, stamp: &Stamp, x: i32, y: i32, stop: f32) -> bool {
    if !is_inside(rows, x) {
        return false;
    }
    let mut most = [-1.0f32; SIDE];
    let range = clipped(rows, stamp, y);
    let (mut at, stride) = (rows.at(x, y + range.start as i32) + 3 * rows.pitch, 4 * rows.pitch);
    for _ in range {
        let clear: &[f32; SIDE] = rows.values[at..].first_chunk().expect("rows have a stamp to spare");
        for i in 0..SIDE {
            most[i] = if clear[i] > most[i] { clear[i] } else { most[i] };
        }
        at += stride;
    }
    let mut is_open = false;
    for i in 0..SIDE {
        is_open |= most[i] >= stop;
    }
    is_open
}

/// Puts a splat on its pixels.
#[inline(always)]
fn put(rows: &mut Rows, stamp: &Stamp, [x, y]: [i32; 2], amounts: &[[f32; SIDE]; SIDE], ink: &[f32; 4], stop: f32) {
    let pitch = rows.pitch;
    let range = clipped(rows, stamp, y);
    let mut at = rows.at(x, y + range.start as i32);
    for row in range {
        let values = &mut rows.values;
        let clear = eight(values, at + 3 * pitch);
        let before = *clear;
        let (parts, after) = part(&before, &amounts[row], stop);
        *clear = after;
        add(eight(values, at), &parts, ink[0]);
        add(eight(values, at + pitch), &parts, ink[1]);
        add(eight(values, at + 2 * pitch), &parts, ink[2]);
        if has_closed(&before, &after, stop) {
            rows.close(x, y + row as i32, &before, &after, stop);
        }
        at += 4 * pitch;
    }
}

#[inline(always)]
fn eight(values: &mut [f32], at: usize) -> &mut [f32; SIDE] {
    values[at..].first_chunk_mut().expect("rows have a stamp to spare")
}

/// What a row's pixels take of a splat, and the transmittances that it leaves.
#[inline(always)]
fn part(before: &[f32; SIDE], amounts: &[f32; SIDE], stop: f32) -> ([f32; SIDE], [f32; SIDE]) {
    let (mut parts, mut after) = ([0.0f32; SIDE], [0.0f32; SIDE]);
    for i in 0..SIDE {
        parts[i] = keep_if(before[i] >= stop, before[i] * amounts[i]);
    }
    for i in 0..SIDE {
        after[i] = before[i] - parts[i];
    }
    (parts, after)
}

/// Adds them to one of the row's colours. A function and no loop over colours: see [`raster`](super::raster).
#[inline(always)]
fn add(values: &mut [f32; SIDE], parts: &[f32; SIDE], ink: f32) {
    let mut new = [0.0f32; SIDE];
    for i in 0..SIDE {
        new[i] = values[i] + parts[i] * ink;
    }
    *values = new;
}

/// Whether one of a row's pixels changed for the last time.
#[inline(always)]
fn has_closed(before: &[f32; SIDE], after: &[f32; SIDE], stop: f32) -> bool {
    let mut any = false;
    for i in 0..SIDE {
        any |= (before[i] >= stop) & (after[i] < stop);
    }
    any
}
