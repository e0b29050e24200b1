//! Stage 2: splats to pixels.
//!
//! In: a block of projected splats in visit order, the pixels of a band. Out: the band's pixels.
//!
//! ```text
//! q     = across * u^2 + along * y^2, u = x - shear * y     from the centre; in units of ln 2; beyond `cut` it is none
//! depth = peak * 2^-q
//! ```
//!
//! Departures for speed:
//! 1. Footprints of a parallel view that are seven pixels wide or less have no exponential per pixel: [`Stamp`].
//! 2. Up to seven pixels wide: eight pixels of two rows go together, from an even column on; half of them are empty,
//!    but nothing is packed or masked. Sixteen footprints are queued between the arithmetic and the pixels, so that
//!    the processor overlaps their chains (one by one: 5 px 62 ns, queued 54).
//! 3. Wider ones: sixteen pixels of a row together, from sixteen columns on within the ellipse's chord in each row.
//!    Against rows packed without gaps and one plane per colour that is slower: 8 px 96 against 163 ns, 20 px 930
//!    against 1090.
//!
//! Two of the loops look clumsier than they could: the compiler takes four pixels at a time where arithmetic and
//! pixels share a loop, and gathers where it sees that pairs of pixels are independent (three times slower).
//!
//! A step may run over pixels outside the ellipse or the band: they get depth 0 or are guard pixels. A pixel's bits
//! depend on absolute coordinates only.

#![expect(
    clippy::cast_possible_truncation,
    clippy::needless_range_loop,
    reason = "index loops over arrays run side by side; pixel counts are below 2^15; casts of coordinates saturate and are clipped to the band"
)]

use super::arith::{LITTLE, at_least, exp2_neg, keep_if};
use super::blend::Blend;
use super::planes::{Pair, Planes};
use super::stamp::{COLUMNS, ROWS, Stamp};

/// Splats in a block: small enough that all its arrays stay in the first-level cache.
pub(crate) const BLOCK: usize = 128;

/// A footprint's ellipse, in pixels.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Ellipse {
    /// Exponent per squared pixel along a row, units of ln 2.
    pub(crate) across: f32,
    /// Exponent per squared pixel from row to row, units of ln 2.
    pub(crate) along: f32,
    /// Columns that the ridge moves per row.
    pub(crate) shear: f32,
    /// Half of the bounding box, columns; at most [`REACH`].
    pub(crate) half_x: f32,
    /// Half of the bounding box, rows; at most [`REACH`].
    pub(crate) half_y: f32,
}

/// Largest half-width of a footprint in pixels: 128 times the largest picture.
pub(crate) const REACH: f32 = 2_097_152.0;

/// A block of splats, structure of arrays: places by voxel, colours by splat.
pub(crate) struct Splats {
    /// How many are drawn; colours from there on are meaningless.
    pub(crate) count: usize,
    /// Index in the block of each drawn splat's place, in visit order.
    pub(crate) kept: [u8; BLOCK],
    /// Peak of a unit of optical depth.
    pub(crate) strength: [f32; BLOCK],
    /// Nearest pixel to the centre.
    pub(crate) x: [i32; BLOCK],
    pub(crate) y: [i32; BLOCK],
    /// Centre minus that pixel: -1/2 ..= 1/2.
    pub(crate) rest_x: [f32; BLOCK],
    pub(crate) rest_y: [f32; BLOCK],
    /// Bounding box in pixels, inclusive.
    pub(crate) low_x: [i32; BLOCK],
    pub(crate) high_x: [i32; BLOCK],
    pub(crate) low_y: [i32; BLOCK],
    pub(crate) high_y: [i32; BLOCK],
    /// What it adds to a pixel's four values.
    pub(crate) ink: [[f32; 4]; BLOCK],
    /// Optical depth at the centre, in units of ln 2, or normalised value; 0 for a splat that is not drawn.
    pub(crate) peak: [f32; BLOCK],
}

impl Splats {
    pub(crate) fn new() -> Box<Splats> {
        Box::new(Splats {
            count: 0,
            kept: [0; BLOCK],
            strength: [0.0; BLOCK],
            x: [0; BLOCK],
            y: [0; BLOCK],
            rest_x: [0.0; BLOCK],
            rest_y: [0.0; BLOCK],
            low_x: [0; BLOCK],
            high_x: [0; BLOCK],
            low_y: [0; BLOCK],
            high_y: [0; BLOCK],
            ink: [[0.0; 4]; BLOCK],
            peak: [0.0; BLOCK],
        })
    }
}

/// Where a block's ellipses come from: one for all, or one each.
pub(crate) trait Ellipses {
    /// Ellipse of splat `j`, below [`BLOCK`].
    fn at(&self, j: usize) -> Ellipse;
}

impl Ellipses for Ellipse {
    #[inline(always)]
    fn at(&self, _: usize) -> Ellipse {
        *self
    }
}

/// One ellipse per splat.
pub(crate) struct EllipseEach {
    pub(crate) across: [f32; BLOCK],
    pub(crate) along: [f32; BLOCK],
    pub(crate) shear: [f32; BLOCK],
}

impl EllipseEach {
    pub(crate) fn new() -> Box<EllipseEach> {
        Box::new(EllipseEach { across: [0.0; BLOCK], along: [0.0; BLOCK], shear: [0.0; BLOCK] })
    }
}

impl Ellipses for EllipseEach {
    #[inline(always)]
    fn at(&self, j: usize) -> Ellipse {
        Ellipse { across: self.across[j], along: self.along[j], shear: self.shear[j], half_x: 0.0, half_y: 0.0 }
    }
}

/// What all splats of a frame share.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Limits {
    /// Exponent at the cut-off, units of ln 2.
    pub(crate) cut: f32,
    /// Transmittance below which a pixel no longer changes; 0 for never.
    pub(crate) stop: f32,
}

/// Narrow footprints between the computation of what their pixels absorb and the pixels. Each is one long chain of
/// dependent steps; sixteen after the other in each loop let the processor overlap them.
struct Queue {
    count: usize,
    slots: [Slot; QUEUE],
    /// Eight rows of eight pixels.
    amounts: [[f32; COLUMNS * ROWS]; QUEUE],
}

/// Footprints in a queue.
const QUEUE: usize = 16;

/// Where a narrow footprint's pixels lie.
#[derive(Debug, Clone, Copy, Default)]
struct Slot {
    /// Its ink.
    splat: usize,
    /// First pair.
    index: usize,
    /// Pairs across, four at most.
    across: usize,
    /// Rows, eight at most.
    rows: usize,
}

impl Queue {
    fn new() -> Queue {
        Queue { count: 0, slots: [Slot::default(); QUEUE], amounts: [[0.0; COLUMNS * ROWS]; QUEUE] }
    }

    /// Puts the queued footprints into the picture.
    #[inline(always)]
    fn flush<B: Blend>(&mut self, planes: &mut Planes, splats: &Splats, stop: f32) {
        let pitch = planes.pitch();
        let pairs = planes.pairs();
        for (slot, amounts) in self.slots.iter().zip(&self.amounts).take(self.count) {
            let ink = &splats.ink[slot.splat % BLOCK];
            let mut at = slot.index;
            for eight in &amounts.as_chunks::<COLUMNS>().0[..slot.rows.min(ROWS)] {
                deposit::<B>(pairs, at, slot.across, eight, ink, stop);
                at += pitch;
            }
        }
        self.count = 0;
    }
}

/// What the pixels of up to eight rows absorb, of the depths that `of_two` gives for two rows.
#[inline(always)]
fn absorb(
    amounts: &mut [f32; COLUMNS * ROWS],
    rows: usize,
    of_two: impl Fn(usize) -> [f32; STEP],
    amount: impl Fn(f32) -> f32,
) {
    for (two, out) in amounts.as_chunks_mut::<STEP>().0.iter_mut().enumerate().take(rows.div_ceil(2)) {
        let depths = of_two(two);
        let mut step = [0.0; STEP];
        for i in 0..STEP {
            step[i] = amount(depths[i]);
        }
        *out = step;
    }
}

/// Draws a block whose splats share a stamp; gives how many splats touched the band.
#[inline(always)]
pub(crate) fn draw_stamped<B: Blend>(planes: &mut Planes, splats: &Splats, stamp: &Stamp, limits: Limits) -> u64 {
    let rect = planes.rect;
    let mut drawn = 0;
    let mut queue = Queue::new();
    let mut sides = [[0.0; COLUMNS + ROWS]; QUEUE];
    let mut starts = [[0; 2]; QUEUE];
    let count = splats.count.min(BLOCK);
    let mut k = 0;
    while k < count {
        let mut queued = 0;
        while k < count && queued < QUEUE {
            let j = usize::from(splats.kept[k]) % BLOCK;
            let (low_x, low_y) = (splats.low_x[j], splats.low_y[j]);
            let rows = splats.high_y[j].wrapping_sub(low_y).wrapping_add(1).clamp(1, ROWS as i32) as usize;
            // Stage 1 lists only splats that reach the band; the test keeps a mistake there from leaving the planes.
            if splats.peak[k] > 0.0
                && low_x > rect.x0 - COLUMNS as i32
                && low_x < rect.x1
                && low_y > rect.y0 - ROWS as i32
                && low_y < rect.y1
            {
                let start_x = low_x & !1;
                let lean = stamp.quadratic.lean(splats.rest_x[j], splats.rest_y[j]);
                let (column, row) = (start_x - splats.x[j], low_y - splats.y[j]);
                sides[queued] = lean.sides(column as f32, row as f32);
                starts[queued] = [column, row];
                let across = ((splats.high_x[j] - start_x) as usize / 2 + 1).max(stamp.across).min(COLUMNS / 2);
                queue.slots[queued] = Slot { splat: k, index: planes.index(start_x, low_y), across, rows };
                queued += 1;
            }
            k += 1;
        }
        for n in 0..queued {
            let Slot { splat, rows, .. } = queue.slots[n];
            let (peak, sides, weights) =
                (splats.peak[splat % BLOCK], &sides[n], stamp.from(starts[n][0], starts[n][1]));
            let floor = peak * stamp.floor;
            let depths = |two: usize| {
                let weights: &[f32; STEP] = &weights.as_chunks().0[two];
                let of_rows = [0, 1].map(|row| sides[COLUMNS + 2 * two + row] * peak);
                let mut depths = [0.0; STEP];
                for i in 0..STEP {
                    let depth = (weights[i] * sides[i % COLUMNS]) * of_rows[i / COLUMNS];
                    depths[i] = keep_if(depth >= floor, depth);
                }
                depths
            };
            if peak <= LITTLE {
                absorb(&mut queue.amounts[n], rows, depths, B::little);
            } else {
                absorb(&mut queue.amounts[n], rows, depths, B::amount);
            }
        }
        queue.count = queued;
        queue.flush::<B>(planes, splats, limits.stop);
        drawn += queued as u64;
    }
    drawn
}

/// Pixels of a row, two by two.
#[inline(always)]
fn deposit<B: Blend>(pairs: &mut [Pair], at: usize, across: usize, amounts: &[f32], ink: &[f32; 4], stop: f32) {
    let (twos, _) = amounts.as_chunks::<2>();
    // Indices are checked one by one on purpose: else the compiler takes several pairs at once, by gathers.
    for k in 0..across {
        let two = twos[k];
        let old = pairs[at + k].0;
        let mut new = [0.0; 8];
        for i in 0..8 {
            new[i] = B::blend(old[i], old[i | 3], two[i / 4], ink[i % 4], stop);
        }
        pairs[at + k].0 = new;
    }
}

/// Draws a block; gives how many splats touched the band.
#[inline(always)]
pub(crate) fn draw<B: Blend, E: Ellipses>(planes: &mut Planes, splats: &Splats, ellipses: &E, limits: Limits) -> u64 {
    let rect = planes.rect;
    let mut drawn = 0;
    let mut queue = Queue::new();
    let mut run = [0.0; RUN];
    for k in 0..splats.count.min(BLOCK) {
        let j = usize::from(splats.kept[k]) % BLOCK;
        let peak = splats.peak[k];
        let (low_x, high_x) = (splats.low_x[j], splats.high_x[j]);
        let (low_y, high_y) = (splats.low_y[j], splats.high_y[j]);
        // As above.
        if peak <= 0.0 || low_y >= rect.y1 || high_y < rect.y0 || low_x >= rect.x1 || high_x < rect.x0 {
            continue;
        }
        drawn += 1;
        let ink = &splats.ink[k];
        let ellipse = ellipses.at(j);
        let corner = Corner {
            dx: (low_x - splats.x[j]) as f32 - splats.rest_x[j],
            dy: (low_y - splats.y[j]) as f32 - splats.rest_y[j],
        };
        let kernel = Kernel { corner, ellipse, cut: limits.cut, peak };
        let (columns, rows) = (high_x.wrapping_sub(low_x).wrapping_add(1), high_y.wrapping_sub(low_y).wrapping_add(1));
        if (1..COLUMNS as i32).contains(&columns) && (1..=ROWS as i32).contains(&rows) {
            if queue.count == QUEUE {
                queue.flush::<B>(planes, splats, limits.stop);
            }
            let (index, across) = (planes.index(low_x & !1, low_y), (high_x - (low_x & !1)) as usize / 2 + 1);
            let rows = rows as usize;
            queue.slots[queue.count] = Slot { splat: k, index, across, rows };
            let first = -((low_x & 1) as f32);
            let depths = |two: usize| {
                let row = [0.0, 2.0, 4.0, 6.0][two];
                let mut depths = [0.0; STEP];
                for i in 0..STEP {
                    depths[i] = kernel.depth(first + (i % COLUMNS) as f32, row + (i / COLUMNS) as f32);
                }
                depths
            };
            if peak <= LITTLE {
                absorb(&mut queue.amounts[queue.count], rows, depths, B::little);
            } else {
                absorb(&mut queue.amounts[queue.count], rows, depths, B::amount);
            }
            queue.count += 1;
        } else if (1..STEP as i32).contains(&columns) {
            queue.flush::<B>(planes, splats, limits.stop);
            let across = (high_x - (low_x & !1)) as usize / 2 + 1;
            let first = -((low_x & 1) as f32);
            let (mut y, end) = (low_y.max(rect.y0), high_y.min(rect.y1 - 1) + 1);
            while y < end {
                let rows = ((end - y) as usize).min(RUN / STEP);
                let row = (y - low_y) as f32;
                for (from, out) in LINES.iter().zip(run.as_chunks_mut::<STEP>().0).take(rows) {
                    let mut amounts = [0.0; STEP];
                    for i in 0..STEP {
                        amounts[i] = B::amount(kernel.depth(first + i as f32, row + from));
                    }
                    *out = amounts;
                }
                for amounts in &run.as_chunks::<STEP>().0[..rows] {
                    let index = planes.index(low_x & !1, y);
                    deposit::<B>(planes.pairs(), index, across, amounts, ink, limits.stop);
                    y += 1;
                }
            }
        } else {
            queue.flush::<B>(planes, splats, limits.stop);
            let (left, right) = (low_x.max(rect.x0), high_x.min(rect.x1 - 1));
            let widen = 1.0 / ellipse.across;
            let last = columns as f32;
            for row_y in low_y.max(rect.y0)..=high_y.min(rect.y1 - 1) {
                let row = (row_y - low_y) as f32;
                let dy = corner.dy + row;
                let ridge = splats.rest_x[j] + ellipse.shear * dy;
                // The chord, with half a pixel and more to spare for rounding.
                let half = (at_least(limits.cut - ellipse.along * (dy * dy), 0.0) * widen).sqrt() + 0.5;
                let from = left.max(splats.x[j].saturating_add((ridge - half) as i32).saturating_sub(1)) & !1;
                let to = right.min(splats.x[j].saturating_add((ridge + half) as i32).saturating_add(1));
                let mut x = from;
                while x <= to {
                    let pixels = ((to - x + 1) as usize).min(RUN);
                    let mut column = (x - low_x) as f32;
                    for out in &mut run.as_chunks_mut::<STEP>().0[..pixels.div_ceil(STEP)] {
                        let mut amounts = [0.0; STEP];
                        for i in 0..STEP {
                            // The first pixel may lie outside the box, and the last ones.
                            let column = column + i as f32;
                            let inside = (column >= 0.0) & (column < last);
                            amounts[i] = keep_if(inside, B::amount(kernel.depth(column, row)));
                        }
                        *out = amounts;
                        column += STEP as f32;
                    }
                    let index = planes.index(x, row_y);
                    deposit::<B>(planes.pairs(), index, pixels.div_ceil(2), &run, ink, limits.stop);
                    x += RUN as i32;
                }
            }
        }
    }
    queue.flush::<B>(planes, splats, limits.stop);
    drawn
}

/// Where the low corner of a footprint's box lies from its centre, in pixels.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Corner {
    pub(crate) dx: f32,
    pub(crate) dy: f32,
}

/// What a footprint's pixels need to know of it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Kernel {
    pub(crate) corner: Corner,
    pub(crate) ellipse: Ellipse,
    pub(crate) cut: f32,
    pub(crate) peak: f32,
}

impl Kernel {
    /// Optical depth at a pixel, in units of ln 2; `column` and `row` are whole and count from the low corner.
    #[inline(always)]
    pub(crate) fn depth(&self, column: f32, row: f32) -> f32 {
        let dy = self.corner.dy + row;
        let u = (self.corner.dx + column) - self.ellipse.shear * dy;
        let q = self.ellipse.across * (u * u) + self.ellipse.along * (dy * dy);
        // Far outside the ellipse the exponential is meaningless; its bits are dropped.
        keep_if(q <= self.cut, self.peak * exp2_neg(q))
    }
}

/// Pixels of a vector step.
const STEP: usize = 16;
/// Pixels of a wider footprint that are computed before they are put into the picture.
const RUN: usize = 256;

/// Numbers of rows, as the arithmetic needs them.
const LINES: [f32; RUN / STEP] = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0];
