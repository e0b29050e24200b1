//! Splats: what stage 1 makes of voxels, and stage 2 draws on pixels.
//!
//! ```text
//! q     = u_factor * u^2 + y_factor * y^2, u = x - shear * y     from the centre, in units of ln 2; cut off at `cut_exponent`
//! depth = peak * 2^-q
//! ```
//!
//! For a splat on rays (`Footprint::in_perspective`) these are the numbers of a ray of length and stretch 1: at a pixel, q is multiplied
//! by its ray's `per_square`, the peak by its `stretch`, and the cut-off is that of the product.

use super::project::{NearestPixel, VECTOR_WIDTH, limited, nearest_pixel, pixel_span};
use super::tile_buffer::{COLUMN, ROW, Rect, TILE_PIXELS, TILE_SHIFT};
use super::voxel_block::BLOCK;
use crate::splat::arith::{at_least, at_most, exp2_neg, keep_if};
use crate::splat::composite::Look;
use crate::splat::kernel::Ellipse;
use crate::splat::near::{EyeRays, NearKernel, RayLengths, ray_depth};

/// The centres and bounding boxes of some splats in one direction, x or y, in pixels.
#[derive(Default)]
pub(super) struct Extents {
    /// The pixel nearest to the centre.
    nearest: [i32; VECTOR_WIDTH],
    /// The centre minus the nearest pixel, -1/2 to 1/2.
    offset: [f32; VECTOR_WIDTH],
    /// First pixel of the box.
    pub(super) low: [i32; VECTOR_WIDTH],
    /// Last pixel of the box.
    pub(super) high: [i32; VECTOR_WIDTH],
}

impl Extents {
    /// Returns the first and last pixel of the box of splat `k`, clipped to `low..high`.
    #[inline(always)]
    fn clipped(&self, k: usize, low: i32, high: i32) -> [i32; 2] {
        [self.low[k].max(low), self.high[k].min(high - 1)]
    }

    /// Sets the centre and box of splat `k`. The box reaches `half_width` pixels to both sides of the centre.
    #[inline(always)]
    fn set(&mut self, k: usize, centre: NearestPixel, half_width: f32) {
        (self.nearest[k], self.offset[k]) = centre;
        (self.low[k], self.high[k]) = pixel_span(centre, half_width);
    }

    /// Sets the box of splat `k`, whose kernel is near the eye.
    #[inline(always)]
    pub(super) fn set_near(&mut self, k: usize, [low, high]: [i32; 2]) {
        (self.nearest[k], self.low[k], self.high[k]) = (low, low, high);
    }
}

/// The places of some splats: centres, boxes, ellipses and strengths.
#[derive(Default)]
pub(super) struct SplatPlaces {
    pub(super) x: Extents,
    pub(super) y: Extents,
    /// The `u_factor`, `y_factor` and `shear` of each ellipse.
    ellipses: [[f32; VECTOR_WIDTH]; 3],
    /// The peak of a splat of optical depth 1.
    pub(super) strength: [f32; VECTOR_WIDTH],
    /// Whether a splat is on rays (`Footprint::in_perspective`): its numbers are for rays of length and stretch 1.
    pub(super) on_rays: [bool; VECTOR_WIDTH],
}

impl SplatPlaces {
    /// Sets splat `k`, whose centre is at a column and a row.
    #[inline(always)]
    pub(super) fn set(&mut self, k: usize, [column, row]: [f64; 2], ellipse: &Ellipse, strength: f32) {
        self.x.set(k, nearest_pixel(column), ellipse.half_x);
        self.y.set(k, nearest_pixel(row), ellipse.half_y);
        (self.ellipses[0][k], self.ellipses[1][k], self.ellipses[2][k]) =
            (ellipse.u_factor, ellipse.y_factor, ellipse.shear);
        self.strength[k] = strength;
    }
}

/// A block of splats. Places are indexed by voxel of the block; looks like `kept`.
pub struct Splats {
    /// Number of splats to draw; `kept` and `looks` are meaningless from this index on.
    pub count: usize,
    /// For each splat to draw, in visit order: the index of its voxel in the block.
    pub kept: [u8; BLOCK],
    pub(super) places: [SplatPlaces; BLOCK / VECTOR_WIDTH],
    /// The voxels of the block that are near the eye, by their indices, which ascend.
    pub(super) near: Vec<(u8, NearKernel)>,
    /// Red, green, blue, and the optical depth at the centre (the *peak*), in units of ln 2, if on rays for a stretch of 1; 0 if the splat
    /// is not drawn.
    pub looks: [Look; BLOCK],
}

impl Splats {
    /// Returns a block of no splats.
    pub fn new() -> Box<Splats> {
        Box::new(Splats {
            count: 0,
            kept: [0; BLOCK],
            places: Default::default(),
            near: Vec::new(),
            looks: [[0.0; 4]; BLOCK],
        })
    }

    /// Returns the places among which that of splat `j` is, and its index.
    #[inline(always)]
    fn place(&self, j: usize) -> (&SplatPlaces, usize) {
        (&self.places[j / VECTOR_WIDTH], j % VECTOR_WIDTH)
    }

    /// Returns the first and last column, and the first and last row, of the box of splat `j`, clipped to `rect`.
    #[inline(always)]
    pub(super) fn clipped(&self, j: usize, rect: Rect) -> ([i32; 2], [i32; 2]) {
        let (places, k) = self.place(j);
        (places.x.clipped(k, rect.x0, rect.x1), places.y.clipped(k, rect.y0, rect.y1))
    }

    /// Returns the kernel of splat `j`, without its box, with this exponent at the cut-off and this peak.
    #[inline(always)]
    pub(super) fn kernel(&self, j: usize, cut_exponent: f32, peak: f32) -> SplatKernel {
        let (SplatPlaces { x, y, ellipses, .. }, k) = self.place(j);
        let centre = [(x.nearest[k], x.offset[k]), (y.nearest[k], y.offset[k])];
        let [u_factor, y_factor, shear] = ellipses.each_ref().map(|factors| factors[k]);
        SplatKernel { centre, ellipse: Ellipse { u_factor, y_factor, shear, ..Ellipse::default() }, cut_exponent, peak }
    }

    /// Returns the kernel of voxel `j` if it is near the eye.
    #[inline(always)]
    pub(super) fn near(&self, j: usize) -> Option<&NearKernel> {
        let index = self.near.binary_search_by_key(&j, |(j, _)| usize::from(*j)).ok()?;
        self.near.get(index).map(|(_, kernel)| kernel)
    }

    /// Returns whether splat `j` is on rays.
    #[inline(always)]
    pub(super) fn is_on_rays(&self, j: usize) -> bool {
        let (places, k) = self.place(j);
        places.on_rays[k]
    }

    /// Turns each kept splat's optical depth per mean spacing into that at the splat's centre; on rays, that divided by the ray's
    /// stretch. That of a voxel near the eye stays.
    #[inline(always)]
    pub fn apply_strengths(&mut self) {
        for k in 0..self.count {
            let j = usize::from(self.kept[k]) % BLOCK;
            let (places, index) = self.place(j);
            let strength = places.strength[index];
            if places.on_rays[index] {
                self.looks[k][3] *= strength;
            } else if self.near(j).is_none() {
                self.looks[k][3] = limited(self.looks[k][3], strength);
            }
        }
    }
}

/// A splat's optical depth as a function of the pixel.
#[derive(Debug, Clone, Copy)]
pub(super) struct SplatKernel {
    /// Its column and its row.
    pub(super) centre: [NearestPixel; 2],
    pub(super) ellipse: Ellipse,
    /// The exponent at the cut-off radius, in units of ln 2.
    pub(super) cut_exponent: f32,
    pub(super) peak: f32,
}

/// For each pixel of a tile: the parts of the exponent that are the same for all tiles of a row.
pub(super) struct RowTerms {
    /// The distance along x to the ellipse's ridge, if the tile's first column were that of the centre; times the
    /// square root of `u_factor`.
    distance: [f32; TILE_PIXELS],
    /// The exponent on the ridge, in units of ln 2.
    exponent: [f32; TILE_PIXELS],
}

/// The `per_square` and `stretch` of rays that change nothing.
pub(super) const AFFINE: [f32; 2] = [1.0, 1.0];

impl SplatKernel {
    /// Returns the optical depth at a pixel, in units of ln 2; `rays` if the splat is on rays.
    pub(super) fn depth(&self, x: i32, y: i32, rays: Option<&EyeRays>) -> f32 {
        let root = self.ellipse.u_factor.sqrt();
        let first_row = ((y & !3) - self.centre[1].0) as f32;
        let (distance, exponent) = self.terms(root, first_row, (x & 3) as f32, (y & 3) as f32);
        let first_column = ((x & !3) - self.centre[0].0) as f32 * root;
        let lengths = rays.map(|rays| rays.lengths([x], [y]));
        let lengths = lengths.map_or(AFFINE, |RayLengths { per_square, stretch }| [per_square[0], stretch[0]]);
        self.depth_on_ray(first_column, distance, exponent, lengths)
    }

    /// Returns the two values of [`RowTerms`] for the pixel at `column` and `row` of a tile whose first row is
    /// `first_row` rows below the centre's. `root`: the square root of `u_factor`.
    #[inline(always)]
    fn terms(&self, root: f32, first_row: f32, column: f32, row: f32) -> (f32, f32) {
        let [(_, offset_x), (_, offset_y)] = self.centre;
        let dy = (first_row + row) - offset_y;
        let distance = (column - offset_x) - self.ellipse.shear * dy;
        (root * distance, self.ellipse.y_factor * (dy * dy))
    }

    /// Returns the optical depth on a ray of this `per_square` and `stretch`.
    #[inline(always)]
    fn depth_on_ray(&self, first_column: f32, distance: f32, exponent: f32, [per_square, stretch]: [f32; 2]) -> f32 {
        let u = first_column + distance;
        let q = (u * u + exponent) * per_square;
        // Far outside the ellipse the exponential is meaningless, and `keep_if` replaces it by 0.
        keep_if(q <= self.cut_exponent, ray_depth(self.peak, stretch) * exp2_neg(q))
    }

    #[inline(always)]
    pub(super) fn tile_row(&self, root: f32, row: i32) -> RowTerms {
        let first_row = ((row << TILE_SHIFT) - self.centre[1].0) as f32;
        let mut terms = RowTerms { distance: [0.0; TILE_PIXELS], exponent: [0.0; TILE_PIXELS] };
        for i in 0..TILE_PIXELS {
            (terms.distance[i], terms.exponent[i]) = self.terms(root, first_row, COLUMN[i], ROW[i]);
        }
        terms
    }

    /// Returns the optical depths at the pixels of a tile; `lengths` returns the `per_square` and `stretch` of a pixel's ray,
    /// [`AFFINE`] if the splat is not on rays.
    #[inline(always)]
    pub(super) fn depths(
        &self,
        root: f32,
        tile_row: &RowTerms,
        column: i32,
        lengths: impl Fn(usize) -> [f32; 2],
    ) -> [f32; TILE_PIXELS] {
        let first_column = ((column << TILE_SHIFT) - self.centre[0].0) as f32 * root;
        let mut depths = [0.0; TILE_PIXELS];
        for i in 0..TILE_PIXELS {
            depths[i] = self.depth_on_ray(first_column, tile_row.distance[i], tile_row.exponent[i], lengths(i));
        }
        depths
    }

    /// Returns the columns of the first and last tile of a row that the ellipse may meet, with a margin for rounding. `most`: by what
    /// exponents are divided at most; 1 in a parallel view.
    #[inline(always)]
    pub(super) fn chord(&self, row: i32, most: f32) -> [i32; 2] {
        let [(x, offset_x), (y, offset_y)] = self.centre;
        let low = ((row << TILE_SHIFT) - y) as f32 - offset_y;
        let high = low + 3.0;
        let nearest = at_least(at_least(low, 0.0 - high), 0.0);
        let Ellipse { u_factor, y_factor, shear, .. } = self.ellipse;
        let half_width =
            (at_least(self.cut_exponent * most - y_factor * (nearest * nearest), 0.0) / u_factor).sqrt() + 1.0;
        let (ridge_low, ridge_high) = (shear * low, shear * high);
        let column = |right: f32| x.saturating_add(right as i32) >> TILE_SHIFT;
        let (from, to) = (at_most(ridge_low, ridge_high) - half_width, at_least(ridge_low, ridge_high) + half_width);
        [column(offset_x + from - 1.0), column(offset_x + to + 1.0)]
    }
}
