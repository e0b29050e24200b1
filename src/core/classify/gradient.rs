//! Gradients in world units from three neighbouring slices.
//!
//! Central differences `(f+ - f-) / 2h`; one-sided at borders and next to samples that are not finite; 0 without any
//! neighbour. Exact for linear fields, also at the volume's faces. Where a face cuts a body, `outward` lights it instead.
//! Values and their differences are computed in double precision, so that small differences of large values count, and no field and
//! no spacing overflows or loses its direction.

use glam::{DMat3, DVec3};

use crate::volume::{Grid, Sample};

/// Upper bound of 1 / spacing. Its product with a difference of single-precision samples (up to 2^129) stays finite; that of others
/// is limited.
const LARGEST_INVERSE: f64 = 1e250;

/// A z-slice with the slices below and above it, for computing gradients.
#[derive(Debug, Clone, Copy)]
pub struct Neighbourhood<'a, T = f32> {
    below: Option<&'a [T]>,
    here: &'a [T],
    above: Option<&'a [T]>,
    dims: [usize; 2],
    /// Slope and intercept of the samples; `None` if samples are values already.
    scale: Option<(f64, f64)>,
    /// 1 / spacing, bounded by [`LARGEST_INVERSE`].
    inverse: [f64; 3],
}

impl<'a, T: Sample> Neighbourhood<'a, T> {
    /// Combines slice `here` with `below` (z - 1) and `above` (z + 1), which are `None` outside the volume.
    ///
    /// `dims` are the samples along x and y. `spacing` is in world lengths, finite and above 0.
    ///
    /// # Panics
    /// If a slice's length is not the product of `dims`.
    pub fn new(
        below: Option<&'a [T]>,
        here: &'a [T],
        above: Option<&'a [T]>,
        dims: [usize; 2],
        spacing: [f64; 3],
    ) -> Neighbourhood<'a, T> {
        for slice in [below, Some(here), above].into_iter().flatten() {
            assert_eq!(slice.len(), dims[0] * dims[1], "a slice holds dims[0] * dims[1] samples");
        }
        let inverse = spacing.map(|h| (1.0 / h).min(LARGEST_INVERSE));
        Neighbourhood { below, here, above, dims, scale: None, inverse }
    }

    /// Sets slope and intercept: a sample's value is then `raw * slope + intercept`.
    pub fn scaled(self, slope: f64, intercept: f64) -> Neighbourhood<'a, T> {
        Neighbourhood { scale: (slope != 1.0 || intercept != 0.0).then_some((slope, intercept)), ..self }
    }

    #[inline(always)]
    fn value(&self, sample: T) -> f64 {
        match self.scale {
            None => sample.to_f64(),
            Some((slope, intercept)) => sample.to_f64() * slope + intercept,
        }
    }

    /// Returns the slopes at (`x`, `y`) along the grid's axes, in units per world length; always finite. [`GridAxes`] says what gradient
    /// has them.
    ///
    /// # Panics
    /// If `x` or `y` is not below its dimension.
    #[inline]
    pub fn slopes(&self, x: usize, y: usize) -> [f64; 3] {
        let [width, height] = self.dims;
        assert!(x < width && y < height, "a sample inside the slice");
        let at = y * width + x;
        let here = self.value(self.here[at]);
        let neighbour = |inside: bool, index: usize| if inside { self.value(self.here[index]) } else { f64::NAN };
        let slice = |slice: Option<&[T]>| slice.map_or(f64::NAN, |samples| self.value(samples[at]));
        let (left, right) = (neighbour(x > 0, at.wrapping_sub(1)), neighbour(x + 1 < width, at + 1));
        let (front, back) = (neighbour(y > 0, at.wrapping_sub(width)), neighbour(y + 1 < height, at + width));
        [
            slope(left, here, right, self.inverse[0]),
            slope(front, here, back, self.inverse[1]),
            slope(slice(self.below), here, slice(self.above), self.inverse[2]),
        ]
    }
}

/// Returns the direction out of the grid at a voxel on its faces: the sum of the faces' outward axes; `None` inside.
///
/// On an axis of one point, both faces meet; the lower one counts.
#[inline]
pub(crate) fn outward(dims: [usize; 3], place: [usize; 3]) -> Option<[f64; 3]> {
    let axis = |a: usize| match place[a] {
        0 => -1.0,
        at if at + 1 == dims[a] => 1.0,
        _ => 0.0,
    };
    let direction = [axis(0), axis(1), axis(2)];
    (direction != [0.0; 3]).then_some(direction)
}

/// The directions of a grid's axes. Where they are at right angles, slopes along them are a gradient's components; in a sheared grid
/// they are its dot products with the directions.
#[derive(Debug, Clone, Copy)]
pub struct GridAxes {
    /// The inverse of the directions, if the grid is sheared: it takes world vectors to components along the axes.
    from_world: Option<DMat3>,
}

impl GridAxes {
    /// Returns the axes of a grid.
    pub fn of(grid: &Grid) -> GridAxes {
        let from_world = || DMat3::from_cols_array_2d(&grid.direction).inverse();
        GridAxes { from_world: grid.is_sheared().then(from_world) }
    }

    /// Returns the length of the gradient with these slopes along the axes, in units per world length.
    #[inline]
    pub fn magnitude(&self, slopes: [f64; 3]) -> f64 {
        let scale = length(slopes);
        self.sheared(slopes, scale).map_or(scale, |(_, gradient)| scale * gradient.length())
    }

    /// Returns the greatest length that a gradient can have whose slopes along the axes are at most these.
    pub fn largest_magnitude(&self, slopes: [f64; 3]) -> f64 {
        // The length is a convex function of the slopes, so it is greatest where each is as steep as it can be, upward or downward. Both
        // signs of all three give one length.
        let signs = [[1.0, 1.0, 1.0], [-1.0, 1.0, 1.0], [1.0, -1.0, 1.0], [1.0, 1.0, -1.0]];
        let magnitudes = signs.map(|signs: [f64; 3]| self.magnitude([0, 1, 2].map(|axis| signs[axis] * slopes[axis])));
        magnitudes.into_iter().fold(0.0, f64::max)
    }

    /// Returns a vector along the axes that has the direction of the gradient with these slopes.
    #[inline]
    pub fn along(&self, slopes: [f64; 3]) -> [f64; 3] {
        let sheared = self.sheared(slopes, length(slopes));
        sheared.map_or(slopes, |(from_world, gradient)| (from_world * gradient).to_array())
    }

    /// Returns the inverse of a sheared grid's directions, and the world's gradient divided by `scale`, the length of its slopes, so
    /// that nothing overflows on the way. `None` if slopes are components of the gradient, or 0.
    #[inline]
    fn sheared(&self, slopes: [f64; 3], scale: f64) -> Option<(DMat3, DVec3)> {
        let from_world = self.from_world.filter(|_| scale > 0.0)?;
        Some((from_world, from_world.transpose() * (DVec3::from_array(slopes) / scale)))
    }
}

/// Returns the length of a vector, without overflow or underflow on the way.
#[inline]
pub fn length([x, y, z]: [f64; 3]) -> f64 {
    let squared = x * x + y * y + z * z;
    if (1e-280..1e280).contains(&squared) {
        return squared.sqrt();
    }
    let largest = x.abs().max(y.abs()).max(z.abs());
    if largest == 0.0 || !largest.is_finite() {
        return largest;
    }
    let [x, y, z] = [x / largest, y / largest, z / largest];
    largest * (x * x + y * y + z * z).sqrt()
}

/// Returns the slope at the middle of three samples; samples that are missing or not finite are ignored.
#[inline(always)]
fn slope(before: f64, here: f64, after: f64, inverse: f64) -> f64 {
    let central = (after - before) * 0.5 * inverse;
    if central.is_finite() {
        return central;
    }
    one_sided(before, here, after, inverse)
}

/// The same for what is missing, and for a slope that is no finite number, which it limits.
#[cold]
fn one_sided(before: f64, here: f64, after: f64, inverse: f64) -> f64 {
    let differences = [after / 2.0 - before / 2.0, after - here, here - before];
    let difference = differences.into_iter().find(|difference| difference.is_finite()).unwrap_or(0.0);
    (difference * inverse).clamp(f64::MIN, f64::MAX)
}
