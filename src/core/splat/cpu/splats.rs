//! Splats: what stage 1 makes of voxels, and stage 2 draws on pixels.
//!
//! ```text
//! q     = u_factor * u^2 + y_factor * y^2, u = x - shear * y     from the centre, in units of ln 2; cut off at `cut`
//! depth = peak * 2^-q
//! ```
//!
//! For a splat on rays (`Footprint::in_perspective`) these are the numbers of a ray of length and stretch 1: at a pixel, q is multiplied
//! by its ray's `per_square`, the peak by its `stretch`, and the cut-off is that of the product.

use super::project::{VECTOR_WIDTH, limited, nearest_pixel, pixel_span};
use super::tile_buffer::{COLUMN, ROW, Rect, TILE_PIXELS, TILE_SHIFT};
use super::voxel_block::BLOCK;
use crate::splat::arith::{at_least, at_most, exp2_neg, keep_if};
use crate::splat::composite::Look;
use crate::splat::kernel::Ellipse;
use crate::splat::near::{EyeRays, NearKernel, RayLengths, ray_depth};

/// The centres and bounding boxes of splats in one direction, x or y, in pixels.
pub(super) struct Extents<const N: usize> {
    /// The pixel nearest to the centre.
    pub(super) nearest: [i32; N],
    /// The centre minus the nearest pixel, -1/2 to 1/2.
    pub(super) offset: [f32; N],
    /// First pixel of the box.
    pub(super) low: [i32; N],
    /// Last pixel of the box.
    pub(super) high: [i32; N],
}

impl<const N: usize> Extents<N> {
    #[inline(always)]
    pub(super) fn new() -> Extents<N> {
        Extents { nearest: [0; N], offset: [0.0; N], low: [0; N], high: [0; N] }
    }

    /// Returns the first and last pixel of the box of splat `j`, clipped to `low..high`.
    #[inline(always)]
    fn clipped(&self, j: usize, low: i32, high: i32) -> [i32; 2] {
        [self.low[j].max(low), self.high[j].min(high - 1)]
    }

    /// Sets the centre and box of voxel `j` in x or y. The box reaches `half_width` pixels to both sides of the centre.
    #[inline(always)]
    fn set(&mut self, j: usize, centre: (i32, f32), half_width: f32) {
        (self.nearest[j], self.offset[j]) = centre;
        (self.low[j], self.high[j]) = pixel_span(centre, half_width);
    }
}

/// The places of splats: centres, boxes, ellipses and strengths.
pub(super) struct SplatPlaces<const N: usize> {
    pub(super) x: Extents<N>,
    pub(super) y: Extents<N>,
    /// The `u_factor`, `y_factor` and `shear` of each ellipse.
    pub(super) ellipses: [[f32; N]; 3],
    /// The peak of a splat of optical depth 1.
    pub(super) strength: [f32; N],
    /// Whether a splat is on rays (`Footprint::in_perspective`): its numbers are for rays of length and stretch 1.
    pub(super) on_rays: [bool; N],
}

impl<const N: usize> SplatPlaces<N> {
    #[inline(always)]
    pub(super) fn new() -> SplatPlaces<N> {
        SplatPlaces {
            x: Extents::new(),
            y: Extents::new(),
            ellipses: [[0.0; N]; 3],
            strength: [0.0; N],
            on_rays: [false; N],
        }
    }
}

impl SplatPlaces<VECTOR_WIDTH> {
    /// Sets splat `j`, whose centre is at a column and a row.
    #[inline(always)]
    pub(super) fn set(&mut self, j: usize, [column, row]: [f64; 2], ellipse: &Ellipse, strength: f32) {
        self.x.set(j, nearest_pixel(column), ellipse.half_x);
        self.y.set(j, nearest_pixel(row), ellipse.half_y);
        (self.ellipses[0][j], self.ellipses[1][j], self.ellipses[2][j]) =
            (ellipse.u_factor, ellipse.y_factor, ellipse.shear);
        self.strength[j] = strength;
    }

    /// Copies all values into a block's arrays, starting at index `from`.
    #[inline(always)]
    pub(super) fn copy_to(&self, from: usize, out: &mut SplatPlaces<BLOCK>) {
        for (out, part) in [(&mut out.x, &self.x), (&mut out.y, &self.y)] {
            out.nearest[from..from + VECTOR_WIDTH].copy_from_slice(&part.nearest);
            out.offset[from..from + VECTOR_WIDTH].copy_from_slice(&part.offset);
            out.low[from..from + VECTOR_WIDTH].copy_from_slice(&part.low);
            out.high[from..from + VECTOR_WIDTH].copy_from_slice(&part.high);
        }
        for (out, part) in out.ellipses.iter_mut().zip(&self.ellipses) {
            out[from..from + VECTOR_WIDTH].copy_from_slice(part);
        }
        out.strength[from..from + VECTOR_WIDTH].copy_from_slice(&self.strength);
        out.on_rays[from..from + VECTOR_WIDTH].copy_from_slice(&self.on_rays);
    }
}

/// A block of splats. Places are indexed by voxel of the block; looks like `kept`.
pub struct Splats {
    /// Number of splats to draw; `kept` and `looks` are meaningless from this index on.
    pub count: usize,
    /// For each splat to draw, in visit order: the index of its voxel in the block.
    pub kept: [u8; BLOCK],
    pub(super) places: SplatPlaces<BLOCK>,
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
            places: SplatPlaces::new(),
            near: Vec::new(),
            looks: [[0.0; 4]; BLOCK],
        })
    }

    /// Returns the first and last column, and the first and last row, of the box of splat `j`, clipped to `rect`.
    #[inline(always)]
    pub(super) fn clipped(&self, j: usize, rect: Rect) -> ([i32; 2], [i32; 2]) {
        (self.places.x.clipped(j, rect.x0, rect.x1), self.places.y.clipped(j, rect.y0, rect.y1))
    }

    /// Returns the kernel of splat `j`, without its box, with this exponent at the cut-off and this peak.
    #[inline(always)]
    pub(super) fn kernel(&self, j: usize, cut: f32, peak: f32) -> SplatKernel {
        let SplatPlaces { x, y, ellipses, .. } = &self.places;
        let centre = Centre { x: x.nearest[j], y: y.nearest[j], offset_x: x.offset[j], offset_y: y.offset[j] };
        let [u_factor, y_factor, shear] = ellipses.each_ref().map(|factors| factors[j]);
        SplatKernel { centre, ellipse: Ellipse { u_factor, y_factor, shear, ..Ellipse::default() }, cut, peak }
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
        self.places.on_rays[j]
    }

    /// Turns each kept splat's optical depth per mean spacing into that at the splat's centre; on rays, that divided by the ray's
    /// stretch. That of a voxel near the eye stays.
    #[inline(always)]
    pub fn apply_strengths(&mut self) {
        for k in 0..self.count {
            let j = usize::from(self.kept[k]) % BLOCK;
            let strength = self.places.strength[j];
            if self.places.on_rays[j] {
                self.looks[k][3] *= strength;
            } else if self.near(j).is_none() {
                self.looks[k][3] = limited(self.looks[k][3], strength);
            }
        }
    }
}

/// A splat's centre: the nearest pixel, and the centre minus that pixel.
#[derive(Debug, Clone, Copy)]
pub(super) struct Centre {
    pub(super) x: i32,
    pub(super) y: i32,
    pub(super) offset_x: f32,
    pub(super) offset_y: f32,
}

/// A splat's optical depth as a function of the pixel.
#[derive(Debug, Clone, Copy)]
pub(super) struct SplatKernel {
    pub(super) centre: Centre,
    pub(super) ellipse: Ellipse,
    /// The exponent at the cut-off radius, in units of ln 2.
    pub(super) cut: f32,
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
        let first_row = ((y & !3) - self.centre.y) as f32;
        let (distance, exponent) = self.terms(root, first_row, (x & 3) as f32, (y & 3) as f32);
        let first_column = ((x & !3) - self.centre.x) as f32 * root;
        let lengths = rays.map(|rays| rays.lengths([x], [y]));
        let lengths = lengths.map_or(AFFINE, |RayLengths { per_square, stretch }| [per_square[0], stretch[0]]);
        self.depth_on_ray(first_column, distance, exponent, lengths)
    }

    /// Returns the two values of [`RowTerms`] for the pixel at `column` and `row` of a tile whose first row is
    /// `first_row` rows below the centre's. `root`: the square root of `u_factor`.
    #[inline(always)]
    fn terms(&self, root: f32, first_row: f32, column: f32, row: f32) -> (f32, f32) {
        let dy = (first_row + row) - self.centre.offset_y;
        let distance = (column - self.centre.offset_x) - self.ellipse.shear * dy;
        (root * distance, self.ellipse.y_factor * (dy * dy))
    }

    /// Returns the optical depth on a ray of this `per_square` and `stretch`.
    #[inline(always)]
    fn depth_on_ray(&self, first_column: f32, distance: f32, exponent: f32, [per_square, stretch]: [f32; 2]) -> f32 {
        let u = first_column + distance;
        let q = (u * u + exponent) * per_square;
        // Far outside the ellipse the exponential is meaningless, and `keep_if` replaces it by 0.
        keep_if(q <= self.cut, ray_depth(self.peak, stretch) * exp2_neg(q))
    }

    #[inline(always)]
    pub(super) fn tile_row(&self, root: f32, row: i32) -> RowTerms {
        let first_row = ((row << TILE_SHIFT) - self.centre.y) as f32;
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
        let first_column = ((column << TILE_SHIFT) - self.centre.x) as f32 * root;
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
        let low = ((row << TILE_SHIFT) - self.centre.y) as f32 - self.centre.offset_y;
        let high = low + 3.0;
        let nearest = at_least(at_least(low, 0.0 - high), 0.0);
        let Ellipse { u_factor, y_factor, shear, .. } = self.ellipse;
        let half_width = (at_least(self.cut * most - y_factor * (nearest * nearest), 0.0) / u_factor).sqrt() + 1.0;
        let (ridge_low, ridge_high) = (shear * low, shear * high);
        let column = |x: f32| self.centre.x.saturating_add(x as i32) >> TILE_SHIFT;
        let (from, to) = (at_most(ridge_low, ridge_high) - half_width, at_least(ridge_low, ridge_high) + half_width);
        [column(self.centre.offset_x + from - 1.0), column(self.centre.offset_x + to + 1.0)]
    }
}
