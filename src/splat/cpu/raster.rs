//! Stage 2: splats to pixels.
//!
//! In: a block of projected splats in visit order, the planes of a band. Out: the band's pixels. Per pixel:
//!
//! ```text
//! u     = (x - centre.x) - shear * (y - centre.y)
//! q     = across * u^2 + along * (y - centre.y)^2        in units of ln 2; beyond `cut` the weight is 0
//! depth = peak * 2^-q
//! ```
//!
//! Departures for speed (ns per splat of 5x5 pixels on one core of an EPYC with AVX-512, before and after):
//! 1. A footprint's pixels are packed, row after row, into vectors that compute what each absorbs; only then are the
//!    rows of the picture touched, eight pixels at a time. Row by row in one go, half of each vector lies outside the
//!    footprint and two exponentials are one long chain of dependent steps (76 to 30).
//! 2. Footprints wider than eight pixels are narrowed to the ellipse's chord in each row.
//!
//! A step may run over pixels outside the ellipse or the band: they get weight 0 or are guard pixels. A pixel's bits
//! depend on absolute coordinates only.

use super::arith::{at_least, at_most, exp2_neg, keep_if};
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
    let mut amounts: Amounts = [0.0; PACK + STEP];
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
        let centre =
            Centre { x: splats.x[j], y: splats.y[j], rest_x: splats.rest_x[j], rest_y: splats.rest_y[j] };
        let ellipse = ellipses.at(j);
        let columns = high_x - low_x + 1;
        if columns <= WIDE as i32 {
            let most_rows = PACK as i32 / columns;
            let mut row = low_y;
            while row <= high_y {
                let rows = most_rows.min(high_y - row + 1);
                let patch = Patch { x: low_x, y: row, columns, rows };
                patch.absorb::<B>(&mut amounts, centre, &ellipse, limits.cut, peak);
                patch.deposit::<B>(planes, &amounts, &ink);
                row += rows;
            }
        } else {
            let (left, right) = (low_x.max(rect.x0), high_x.min(rect.x1 - 1));
            let widen = 1.0 / ellipse.across;
            for row in low_y..=high_y {
                let dy = (row - centre.y) as f32 - centre.rest_y;
                let ridge = centre.rest_x + ellipse.shear * dy;
                // The chord, with half a pixel to spare for rounding.
                let half = (at_least(limits.cut - ellipse.along * (dy * dy), 0.0) * widen).sqrt() + 0.5;
                let from = left.max(centre.x.saturating_add((ridge - half) as i32).saturating_sub(1));
                let to = right.min(centre.x.saturating_add((ridge + half) as i32).saturating_add(1));
                let mut x = from;
                while x <= to {
                    let columns = (to - x + 1).min(PACK as i32);
                    let patch = Patch { x, y: row, columns, rows: 1 };
                    patch.absorb::<B>(&mut amounts, centre, &ellipse, limits.cut, peak);
                    patch.deposit_row::<B>(planes, &amounts, &ink);
                    x += columns;
                }
            }
        }
    }
    drawn
}

/// Optical depth of a footprint at a pixel, in units of ln 2; `column` and `row` count from its centre's nearest pixel.
#[inline(always)]
pub(crate) fn depth_at(column: f32, row: f32, centre: Centre, ellipse: &Ellipse, cut: f32, peak: f32) -> f32 {
    let dy = row - centre.rest_y;
    let u = (column - centre.rest_x) - ellipse.shear * dy;
    let q = ellipse.across * (u * u) + ellipse.along * (dy * dy);
    keep_if(q <= cut, peak * exp2_neg(at_most(q, 125.0)))
}

/// Where a footprint's centre lies.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Centre {
    pub(crate) x: i32,
    pub(crate) y: i32,
    pub(crate) rest_x: f32,
    pub(crate) rest_y: f32,
}

/// Pixels whose amounts are computed together.
const PACK: usize = 128;
/// Pixels of a vector step.
const STEP: usize = 16;

/// What the pixels of a patch absorb, row after row, and room for the last step and the last row's overhang.
type Amounts = [f32; PACK + STEP];

/// Column and row of the k-th pixel of a patch that is 1, 2, ... 8 columns wide, and of a single row.
struct Places {
    column: [[f32; PACK + STEP]; WIDE + 1],
    row: [[f32; PACK + STEP]; WIDE + 1],
    /// All ones in the columns of a patch that wide.
    inside: [[u32; WIDE]; WIDE + 1],
}

static PLACES: Places = places();

#[expect(clippy::cast_precision_loss, reason = "below 256")]
const fn places() -> Places {
    let mut places = Places {
        column: [[0.0; PACK + STEP]; WIDE + 1],
        row: [[0.0; PACK + STEP]; WIDE + 1],
        inside: [[0; WIDE]; WIDE + 1],
    };
    let mut width = 0;
    while width <= WIDE {
        let mut k = 0;
        while k < PACK + STEP {
            // Entry 0 is the single row.
            places.column[width][k] = (if width == 0 { k } else { k % width }) as f32;
            places.row[width][k] = (if width == 0 { 0 } else { k / width }) as f32;
            if k < width {
                places.inside[width][k] = u32::MAX;
            }
            k += 1;
        }
        width += 1;
    }
    places
}

/// A rectangle of a footprint's pixels: at most [`PACK`].
#[derive(Debug, Clone, Copy)]
struct Patch {
    x: i32,
    y: i32,
    columns: i32,
    rows: i32,
}

impl Patch {
    /// Fills `amounts` for the patch; a patch of more than eight columns has one row.
    #[inline(always)]
    fn absorb<B: Blend>(&self, amounts: &mut Amounts, centre: Centre, ellipse: &Ellipse, cut: f32, peak: f32) {
        let shape = if self.columns > WIDE as i32 { 0 } else { self.columns as usize };
        let (columns, rows) = (&PLACES.column[shape], &PLACES.row[shape]);
        let first_column = (self.x - centre.x) as f32;
        let first_row = (self.y - centre.y) as f32;
        let pixels = (self.columns * self.rows) as usize;
        let places = columns.as_chunks::<STEP>().0.iter().zip(rows.as_chunks::<STEP>().0);
        for (out, (column, row)) in amounts.as_chunks_mut::<STEP>().0.iter_mut().zip(places).take(pixels.div_ceil(STEP))
        {
            let mut amount = [0.0; STEP];
            for i in 0..STEP {
                let (column, row) = (first_column + column[i], first_row + row[i]);
                amount[i] = B::amount(depth_at(column, row, centre, ellipse, cut, peak));
            }
            *out = amount;
        }
    }

    /// Blends a patch of at most eight columns into the picture.
    #[inline(always)]
    fn deposit<B: Blend>(&self, planes: &mut Planes, amounts: &Amounts, ink: &Ink) {
        let columns = self.columns as usize;
        let inside = &PLACES.inside[columns];
        let mut at = 0;
        for row in self.y..self.y + self.rows {
            let Some(amounts) = amounts.get(at..at + WIDE) else { return };
            let mut amount = [0.0; WIDE];
            for i in 0..WIDE {
                amount[i] = f32::from_bits(amounts[i].to_bits() & inside[i]);
            }
            step::<B>(planes.row(row).eight(self.x), &amount, ink);
            at += columns;
        }
    }

    /// Blends a patch of one row into the picture.
    #[inline(always)]
    fn deposit_row<B: Blend>(&self, planes: &mut Planes, amounts: &Amounts, ink: &Ink) {
        let mut row = planes.row(self.y);
        let eights = amounts.as_chunks::<WIDE>().0;
        for (amount, x) in eights.iter().zip((self.x..self.x + self.columns).step_by(WIDE)) {
            // Pixels past the patch's end belong to the next patch or lie outside the chord.
            let mut amount = *amount;
            for (i, amount) in amount.iter_mut().enumerate() {
                *amount = keep_if(x + (i as i32) < self.x + self.columns, *amount);
            }
            step::<B>(row.eight(x), &amount, ink);
        }
    }
}

#[inline(always)]
fn step<B: Blend>(eight: Eight<'_>, amount: &[f32; WIDE], ink: &Ink) {
    // All are read before any is written: the compiler cannot know that the planes are apart.
    let (red, green, blue, fourth) = (*eight.red, *eight.green, *eight.blue, *eight.fourth);
    let (mut r, mut g, mut b, mut t) = ([0.0; WIDE], [0.0; WIDE], [0.0; WIDE], [0.0; WIDE]);
    for i in 0..WIDE {
        [r[i], g[i], b[i], t[i]] = B::blend([red[i], green[i], blue[i], fourth[i]], amount[i], ink);
    }
    (*eight.red, *eight.green, *eight.blue, *eight.fourth) = (r, g, b, t);
}
