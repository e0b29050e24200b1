//! Stage 2: splats to pixels.
//!
//! In: a block of projected splats in visit order, the planes of a band. Out: the band's pixels. A splat's rows are
//! walked in steps of eight pixels; per pixel the distance along the row is squared, one exponential gives the
//! kernel and a second what it absorbs:
//!
//! ```text
//! u     = (x - centre.x) - shear * (y - centre.y)
//! q     = across * u^2 + along * (y - centre.y)^2        in units of ln 2; beyond `cut` the weight is 0
//! depth = peak * 2^-q
//! ```
//!
//! Departures for speed: a footprint of at most eight columns takes one step per row from its own left edge, over
//! pixels that may lie outside its ellipse or the band (they get weight 0 or are guard pixels); wider ones are
//! narrowed to the ellipse's chord in each row. Neither changes a pixel's bits, because its value depends on absolute
//! coordinates only.

use super::arith::{at_most, exp2_neg, keep_if};
use super::blend::{Blend, Ink};
use super::freeze::Frozen;
use super::planes::{Eight, Planes, WIDE};

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

/// A block of splats, structure of arrays. Entries from `count` on are meaningless.
pub(crate) struct Splats {
    pub(crate) count: usize,
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
    pub(crate) red: [f32; BLOCK],
    pub(crate) green: [f32; BLOCK],
    pub(crate) blue: [f32; BLOCK],
    /// As [`Ink::peak`]; 0 for a splat that is not drawn.
    pub(crate) peak: [f32; BLOCK],
}

impl Splats {
    pub(crate) fn new() -> Box<Splats> {
        Box::new(Splats {
            count: 0,
            x: [0; BLOCK],
            y: [0; BLOCK],
            rest_x: [0.0; BLOCK],
            rest_y: [0.0; BLOCK],
            low_x: [0; BLOCK],
            high_x: [0; BLOCK],
            low_y: [0; BLOCK],
            high_y: [0; BLOCK],
            red: [0.0; BLOCK],
            green: [0.0; BLOCK],
            blue: [0.0; BLOCK],
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
    /// As [`Ink::stop`].
    pub(crate) stop: f32,
}

/// Draws a block; gives how many splats touched the band.
#[inline(always)]
pub(crate) fn draw<B: Blend, E: Ellipses>(
    planes: &mut Planes,
    frozen: &mut Frozen,
    splats: &Splats,
    ellipses: &E,
    limits: Limits,
) -> u64 {
    let rect = planes.rect;
    let mut drawn = 0;
    for j in 0..splats.count.min(BLOCK) {
        let peak = splats.peak[j];
        let (low_x, high_x) = (splats.low_x[j], splats.high_x[j]);
        let (low_y, high_y) = (splats.low_y[j].max(rect.y0), splats.high_y[j].min(rect.y1 - 1));
        if !(peak > 0.0) || low_y > high_y || high_x < rect.x0 || low_x >= rect.x1 {
            continue;
        }
        if B::STOPS && limits.stop > 0.0 {
            let (left, right) = (low_x.max(rect.x0), high_x.min(rect.x1 - 1));
            if frozen.covers(planes, limits.stop, left, low_y, right, high_y) {
                continue;
            }
        }
        drawn += 1;
        let ink = Ink {
            red: splats.red[j],
            green: splats.green[j],
            blue: splats.blue[j],
            peak,
            stop: limits.stop,
        };
        let ellipse = ellipses.at(j);
        let (x, rest_x, y, rest_y) = (splats.x[j], splats.rest_x[j], splats.y[j], splats.rest_y[j]);
        if high_x - low_x < WIDE as i32 {
            let first = (low_x - x) as f32;
            for row_y in low_y..=high_y {
                let dy = (row_y - y) as f32 - rest_y;
                let line = Line { first, centre: rest_x + ellipse.shear * dy, base: ellipse.along * (dy * dy) };
                step::<B>(planes.row(row_y).eight(low_x), line, ellipse.across, limits.cut, &ink);
            }
        } else {
            let (left, right) = (low_x.max(rect.x0), high_x.min(rect.x1 - 1));
            let widen = 1.0 / ellipse.across;
            for row_y in low_y..=high_y {
                let dy = (row_y - y) as f32 - rest_y;
                let centre = rest_x + ellipse.shear * dy;
                let base = ellipse.along * (dy * dy);
                // The chord, with half a pixel to spare for rounding.
                let half = ((limits.cut - base).max(0.0) * widen).sqrt() + 0.5;
                let from = left.max(x.saturating_add((centre - half) as i32).saturating_sub(1));
                let to = right.min(x.saturating_add((centre + half) as i32).saturating_add(1));
                let mut row = planes.row(row_y);
                let mut at = from;
                while at <= to {
                    let line = Line { first: (at - x) as f32, centre, base };
                    step::<B>(row.eight(at), line, ellipse.across, limits.cut, &ink);
                    at += WIDE as i32;
                }
            }
        }
    }
    drawn
}

/// Eight pixels of a splat's row.
#[derive(Debug, Clone, Copy)]
struct Line {
    /// Column of the first of them, from the splat's nearest pixel.
    first: f32,
    /// Ridge of the footprint on this row, from the splat's nearest pixel.
    centre: f32,
    /// Exponent on the ridge.
    base: f32,
}

/// Optical depth at one pixel: column `column` from the splat's nearest pixel.
#[inline(always)]
pub(crate) fn depth_at(column: f32, centre: f32, base: f32, across: f32, cut: f32, peak: f32) -> f32 {
    let u = column - centre;
    let q = across * (u * u) + base;
    keep_if(q <= cut, peak * exp2_neg(at_most(q, 125.0)))
}

#[inline(always)]
fn step<B: Blend>(eight: Eight<'_>, line: Line, across: f32, cut: f32, ink: &Ink) {
    const COLUMNS: [f32; WIDE] = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];
    // All eight are read before any is written: the compiler cannot know that the planes are apart.
    let (red, green, blue, fourth) = (*eight.red, *eight.green, *eight.blue, *eight.fourth);
    let (mut r, mut g, mut b, mut t) = ([0.0; WIDE], [0.0; WIDE], [0.0; WIDE], [0.0; WIDE]);
    for i in 0..WIDE {
        let depth = depth_at(line.first + COLUMNS[i], line.centre, line.base, across, cut, ink.peak);
        [r[i], g[i], b[i], t[i]] = B::blend([red[i], green[i], blue[i], fourth[i]], depth, ink);
    }
    (*eight.red, *eight.green, *eight.blue, *eight.fourth) = (r, g, b, t);
}
