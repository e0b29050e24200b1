//! Stage 2: splats to pixels.
//!
//! In: a block of projected splats in visit order, the tiles of a band. Out: the band's pixels.
//!
//! ```text
//! q     = across * u^2 + along * y^2, u = x - shear * y     from the centre; in units of ln 2; beyond `cut` it is none
//! depth = peak * 2^-q
//! ```
//!
//! A splat is put on every tile of 4 x 4 pixels that its box meets, sixteen pixels together; of a wide one, on those
//! that its ellipse meets. Tiles that are frozen are passed over. A tile may have pixels outside the ellipse or the
//! band: they get depth 0 or are of no consequence. A pixel's bits depend on absolute coordinates only.

#![expect(
    clippy::cast_possible_truncation,
    clippy::needless_range_loop,
    reason = "index loops over arrays run side by side; pixel counts are below 2^15; casts of coordinates saturate and are clipped to the band"
)]

use super::blend::Blend;
use super::planes::{PIXELS, Planes, TILE, Tile};
use crate::splat::arith::{LITTLE, at_least, at_most, exp2_neg, keep_if};
use crate::splat::kernel::Ellipse;

/// Splats in a block: small enough that all its arrays stay in the first-level cache.
pub const BLOCK: usize = 128;

/// A block of splats, structure of arrays: places by voxel, colours by splat.
pub struct Splats {
    /// How many are drawn; colours from there on are meaningless.
    pub count: usize,
    /// Index in the block of each drawn splat's place, in visit order.
    pub kept: [u8; BLOCK],
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
    pub ink: [[f32; 4]; BLOCK],
    /// Optical depth at the centre, in units of ln 2, or normalised value; 0 for a splat that is not drawn.
    pub peak: [f32; BLOCK],
}

impl Splats {
    pub fn new() -> Box<Splats> {
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
pub struct EllipseEach {
    pub(crate) across: [f32; BLOCK],
    pub(crate) along: [f32; BLOCK],
    pub(crate) shear: [f32; BLOCK],
}

impl EllipseEach {
    pub fn new() -> Box<EllipseEach> {
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
pub struct Limits {
    /// Exponent at the cut-off, units of ln 2.
    pub cut: f32,
    /// Transmittance below which a pixel no longer changes; 0 for never.
    pub stop: f32,
}

/// Draws a block; gives how many splats touched the band.
#[inline(always)]
pub(crate) fn draw<B: Blend, E: Ellipses>(planes: &mut Planes, splats: &Splats, ellipses: &E, limits: Limits) -> u64 {
    let rect = planes.rect;
    let mut drawn = 0;
    for k in 0..splats.count.min(BLOCK) {
        let j = usize::from(splats.kept[k]) % BLOCK;
        let peak = splats.peak[k];
        let (low_x, high_x) = (splats.low_x[j].max(rect.x0), splats.high_x[j].min(rect.x1 - 1));
        let (low_y, high_y) = (splats.low_y[j].max(rect.y0), splats.high_y[j].min(rect.y1 - 1));
        // Stage 1 lists only splats that reach the band; the test keeps a mistake there from leaving the tiles.
        if peak <= 0.0 || low_x > high_x || low_y > high_y {
            continue;
        }
        drawn += 1;
        let centre = Centre { x: splats.x[j], y: splats.y[j], rest_x: splats.rest_x[j], rest_y: splats.rest_y[j] };
        let kernel = Kernel { centre, ellipse: ellipses.at(j), cut: limits.cut, peak };
        let columns = [low_x >> TILE, high_x >> TILE];
        let rows = [low_y >> TILE, high_y >> TILE];
        if peak <= LITTLE {
            footprint::<B, true>(planes, &kernel, columns, rows, &splats.ink[k], limits.stop);
        } else {
            footprint::<B, false>(planes, &kernel, columns, rows, &splats.ink[k], limits.stop);
        }
    }
    drawn
}

/// Puts a splat on the tiles from the first to the last of `columns` and `rows`; `LITTLE` if its peak is.
#[inline(always)]
fn footprint<B: Blend, const LITTLE: bool>(
    planes: &mut Planes,
    kernel: &Kernel,
    [left, right]: [i32; 2],
    [top, bottom]: [i32; 2],
    ink: &[f32; 4],
    stop: f32,
) {
    let root = kernel.ellipse.across.sqrt();
    for row in top..bottom + 1 {
        let line = kernel.line(root, row);
        let (mut from, mut to) = (left, right);
        if right - left >= WIDE {
            let [first, last] = kernel.chord(row);
            (from, to) = (from.max(first), to.min(last));
        }
        for column in from..to + 1 {
            let Some((index, Tile(values))) = planes.tile(column, row) else { continue };
            let mut amounts = kernel.depths(root, &line, column);
            for i in 0..PIXELS {
                amounts[i] = if LITTLE { B::little(amounts[i]) } else { B::amount(amounts[i]) };
            }
            let [red, green, blue, fourth] = values;
            let before = *fourth;
            put::<B>(red, &before, &amounts, ink[0], stop);
            put::<B>(green, &before, &amounts, ink[1], stop);
            put::<B>(blue, &before, &amounts, ink[2], stop);
            put::<B>(fourth, &before, &amounts, ink[3], stop);
            if B::STOPS {
                let mut is_open = false;
                for i in 0..PIXELS {
                    is_open |= fourth[i] >= stop;
                }
                if !is_open {
                    planes.freeze(index, column, row);
                }
            }
        }
    }
}

/// One of the four values of a tile's pixels after a splat. A function and no loop over the values: the compiler would
/// take four of them together, by gathers.
#[inline(always)]
fn put<B: Blend>(values: &mut [f32; PIXELS], fourth: &[f32; PIXELS], amounts: &[f32; PIXELS], ink: f32, stop: f32) {
    let mut new = [0.0; PIXELS];
    for i in 0..PIXELS {
        new[i] = B::blend(values[i], fourth[i], amounts[i], ink, stop);
    }
    *values = new;
}

/// Tiles from the first to the last from which on a row of them is worth the question which ones the ellipse meets.
const WIDE: i32 = 3;

/// Where a splat's centre is: the nearest pixel and the rest.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Centre {
    pub(crate) x: i32,
    pub(crate) y: i32,
    pub(crate) rest_x: f32,
    pub(crate) rest_y: f32,
}

/// What a footprint's pixels need to know of it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Kernel {
    pub(crate) centre: Centre,
    pub(crate) ellipse: Ellipse,
    pub cut: f32,
    pub(crate) peak: f32,
}

/// What the tiles of a row share, of each pixel.
struct Line {
    /// Where it lies from the ridge if the tile's first column is the centre's, times the root of `across`.
    place: [f32; PIXELS],
    /// The exponent on the ridge.
    exponent: [f32; PIXELS],
}

impl Kernel {
    /// Optical depth at a pixel, in units of ln 2.
    pub(crate) fn depth(&self, x: i32, y: i32) -> f32 {
        let root = self.ellipse.across.sqrt();
        let (place, exponent) = self.pixel(root, ((y & !3) - self.centre.y) as f32, (x & 3) as f32, (y & 3) as f32);
        self.depth_at(((x & !3) - self.centre.x) as f32 * root, place, exponent)
    }

    /// Of a pixel of a tile whose first row is `first` rows below the centre's.
    #[inline(always)]
    fn pixel(&self, root: f32, first: f32, across: f32, down: f32) -> (f32, f32) {
        let dy = (first + down) - self.centre.rest_y;
        let place = (across - self.centre.rest_x) - self.ellipse.shear * dy;
        (root * place, self.ellipse.along * (dy * dy))
    }

    #[inline(always)]
    fn depth_at(&self, first: f32, place: f32, exponent: f32) -> f32 {
        let u = first + place;
        let q = u * u + exponent;
        // Far outside the ellipse the exponential is meaningless; its bits are dropped.
        keep_if(q <= self.cut, self.peak * exp2_neg(q))
    }

    /// Of a row of tiles.
    #[inline(always)]
    fn line(&self, root: f32, row: i32) -> Line {
        let first = ((row << TILE) - self.centre.y) as f32;
        let mut line = Line { place: [0.0; PIXELS], exponent: [0.0; PIXELS] };
        for i in 0..PIXELS {
            (line.place[i], line.exponent[i]) = self.pixel(root, first, ACROSS[i], DOWN[i]);
        }
        line
    }

    /// Of the pixels of a tile.
    #[inline(always)]
    fn depths(&self, root: f32, line: &Line, column: i32) -> [f32; PIXELS] {
        let first = ((column << TILE) - self.centre.x) as f32 * root;
        let mut depths = [0.0; PIXELS];
        for i in 0..PIXELS {
            depths[i] = self.depth_at(first, line.place[i], line.exponent[i]);
        }
        depths
    }

    /// First and last tile of a row that the ellipse may meet, with half a pixel and more to spare for rounding.
    #[inline(always)]
    fn chord(&self, row: i32) -> [i32; 2] {
        let low = ((row << TILE) - self.centre.y) as f32 - self.centre.rest_y;
        let high = low + 3.0;
        let nearest = at_least(at_least(low, 0.0 - high), 0.0);
        let Ellipse { across, along, shear, .. } = self.ellipse;
        let half = (at_least(self.cut - along * (nearest * nearest), 0.0) / across).sqrt() + 1.0;
        let (one, other) = (shear * low, shear * high);
        let column = |x: f32| self.centre.x.saturating_add(x as i32) >> TILE;
        let (from, to) = (at_most(one, other) - half, at_least(one, other) + half);
        [column(self.centre.rest_x + from - 1.0), column(self.centre.rest_x + to + 1.0)]
    }
}

/// Which column of its tile a pixel is in.
const ACROSS: [f32; PIXELS] = [0., 1., 2., 3., 0., 1., 2., 3., 0., 1., 2., 3., 0., 1., 2., 3.];
/// Which row of its tile a pixel is in.
const DOWN: [f32; PIXELS] = [0., 0., 0., 0., 1., 1., 1., 1., 2., 2., 2., 2., 3., 3., 3., 3.];
