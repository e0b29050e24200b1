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
//! Departures for speed:
//! 1. A footprint's pixels are packed, row after row, into vectors that compute what each absorbs; only then are the
//!    rows of the picture touched, eight pixels at a time. Row by row in one go, half of each vector lies outside the
//!    footprint and two exponentials are one long chain of dependent steps (5x5 pixels, one core of an EPYC with
//!    AVX-512, mean: 81 ns a splat, packed 66).
//! 2. Footprints wider than sixteen pixels are narrowed to the ellipse's chord in each row.
//!
//! A step may run over pixels outside the ellipse or the band: they get weight 0 or are guard pixels. A pixel's bits
//! depend on absolute coordinates only.

#![expect(
    clippy::cast_possible_truncation,
    reason = "pixel counts are below 2^15; casts of coordinates saturate and are clipped to the band"
)]

use super::arith::{at_least, exp2_neg, keep_if};
use super::blend::{Blend, Ink};
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
    /// As [`Ink::stop`].
    pub(crate) stop: f32,
}

/// Draws a block; gives how many splats touched the band.
#[inline(always)]
pub(crate) fn draw<B: Blend, E: Ellipses>(planes: &mut Planes, splats: &Splats, ellipses: &E, limits: Limits) -> u64 {
    let rect = planes.rect;
    let mut drawn = 0;
    let mut amounts: Amounts = [0.0; PACK + STEP];
    for k in 0..splats.count.min(BLOCK) {
        let j = usize::from(splats.kept[k]) % BLOCK;
        let peak = splats.peak[k];
        let (low_x, high_x) = (splats.low_x[j], splats.high_x[j]);
        let (low_y, high_y) = (splats.low_y[j].max(rect.y0), splats.high_y[j].min(rect.y1 - 1));
        // Stage 1 lists only splats that reach the band; the test keeps a mistake there from leaving the planes.
        if peak <= 0.0 || low_y > high_y || high_x < rect.x0 || low_x >= rect.x1 {
            continue;
        }
        drawn += 1;
        let ink = Ink { red: splats.red[k], green: splats.green[k], blue: splats.blue[k], stop: limits.stop };
        let ellipse = ellipses.at(j);
        let corner = Corner {
            dx: (low_x - splats.x[j]) as f32 - splats.rest_x[j],
            dy: (splats.low_y[j] - splats.y[j]) as f32 - splats.rest_y[j],
        };
        let kernel = Kernel { corner, ellipse, cut: limits.cut, peak };
        let columns = high_x.wrapping_sub(low_x).wrapping_add(1);
        if (1..=NARROW as i32).contains(&columns) {
            let columns = columns as usize;
            let (places, most_rows) = (&PLACES.of_width[columns], (PACK / columns) as i32);
            let mut first_row = low_y - splats.low_y[j];
            let mut y = low_y;
            while y <= high_y {
                let rows = most_rows.min(high_y - y + 1);
                kernel.absorb::<B>(&mut amounts, places, rows as usize * columns, 0.0, first_row as f32);
                let mut at = 0;
                for row_y in y..y + rows {
                    let mut row = planes.row(row_y);
                    let amount = inside(&amounts, at, &places.inside[0]);
                    if low_x >= rect.x0 - WIDE as i32 {
                        step::<B>(row.eight(low_x), &amount, &ink);
                    }
                    if columns > WIDE {
                        let x = low_x.wrapping_add(WIDE as i32);
                        if x < rect.x1 && x >= rect.x0 - WIDE as i32 {
                            step::<B>(row.eight(x), &inside(&amounts, at + WIDE, &places.inside[1]), &ink);
                        }
                    }
                    at += columns;
                }
                first_row += rows;
                y += rows;
            }
        } else {
            let (left, right) = (low_x.max(rect.x0), high_x.min(rect.x1 - 1));
            let widen = 1.0 / ellipse.across;
            let places = &PLACES.of_width[0];
            for row_y in low_y..=high_y {
                let first_row = (row_y - splats.low_y[j]) as f32;
                let dy = corner.dy + first_row;
                let ridge = splats.rest_x[j] + ellipse.shear * dy;
                // The chord, with half a pixel and more to spare for rounding.
                let half = (at_least(limits.cut - ellipse.along * (dy * dy), 0.0) * widen).sqrt() + 0.5;
                let from = left.max(splats.x[j].saturating_add((ridge - half) as i32).saturating_sub(1));
                let to = right.min(splats.x[j].saturating_add((ridge + half) as i32).saturating_add(1));
                let mut row = planes.row(row_y);
                let mut x = from;
                while x <= to {
                    let pixels = ((to - x + 1) as usize).min(PACK);
                    kernel.absorb::<B>(&mut amounts, places, pixels, (x - low_x) as f32, first_row);
                    for (amount, x) in amounts.as_chunks::<WIDE>().0.iter().zip((x..x + pixels as i32).step_by(WIDE)) {
                        // Pixels past the end belong to the next run, or lie outside the chord or the band.
                        let mut amount = *amount;
                        for (i, amount) in amount.iter_mut().enumerate() {
                            *amount = keep_if(x + i as i32 <= to, *amount);
                        }
                        step::<B>(row.eight(x), &amount, &ink);
                    }
                    x += pixels as i32;
                }
            }
        }
    }
    drawn
}

/// Eight amounts from `at`, those that belong to another row zeroed.
#[inline(always)]
fn inside(amounts: &Amounts, at: usize, mask: &[u32; WIDE]) -> [f32; WIDE] {
    // The last row's overhang lies in the margin.
    let mut eight: [f32; WIDE] = *amounts[at.min(PACK)..].first_chunk().expect("a margin");
    for i in 0..WIDE {
        eight[i] = f32::from_bits(eight[i].to_bits() & mask[i]);
    }
    eight
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

    /// What `pixels` pixels absorb; `column`, `row`: of the first of them, from the low corner.
    #[inline(always)]
    fn absorb<B: Blend>(&self, amounts: &mut Amounts, places: &Places, pixels: usize, column: f32, row: f32) {
        let steps = pixels.div_ceil(STEP);
        let from = places.column.as_chunks::<STEP>().0.iter().zip(places.row.as_chunks::<STEP>().0);
        for (out, (columns, rows)) in amounts.as_chunks_mut::<STEP>().0.iter_mut().zip(from).take(steps) {
            let mut amount = [0.0; STEP];
            for i in 0..STEP {
                amount[i] = B::amount(self.depth(columns[i] + column, rows[i] + row));
            }
            *out = amount;
        }
    }
}

/// Pixels whose amounts are computed together.
const PACK: usize = 128;
/// Pixels of a vector step.
const STEP: usize = 16;
/// Widest footprint whose rows are packed, in columns.
const NARROW: usize = 16;

/// What packed pixels absorb, row after row, and room for the last step and the last row's overhang.
type Amounts = [f32; PACK + STEP];

/// Column and row of the k-th of a footprint's packed pixels.
struct Places {
    column: [f32; PACK + STEP],
    row: [f32; PACK + STEP],
    /// All ones where a row's first and second eight pixels belong to it.
    inside: [[u32; WIDE]; NARROW / WIDE],
}

/// By the footprint's columns; entry 0 is a single row.
struct PlacesByWidth {
    of_width: [Places; NARROW + 1],
}

static PLACES: PlacesByWidth = places_by_width();

const fn places_by_width() -> PlacesByWidth {
    const NONE: Places =
        Places { column: [0.0; PACK + STEP], row: [0.0; PACK + STEP], inside: [[0; WIDE]; NARROW / WIDE] };
    let mut places = PlacesByWidth { of_width: [NONE; NARROW + 1] };
    let mut width = 0;
    while width <= NARROW {
        let mut k = 0;
        while k < PACK + STEP {
            places.of_width[width].column[k] = (if width == 0 { k } else { k % width }) as f32;
            places.of_width[width].row[k] = match k.checked_div(width) {
                Some(row) => row as f32,
                None => 0.0,
            };
            if k < width {
                places.of_width[width].inside[k / WIDE][k % WIDE] = u32::MAX;
            }
            k += 1;
        }
        width += 1;
    }
    places
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
