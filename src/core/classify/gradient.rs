//! Gradients in world units from three neighbouring slices.
//!
//! In: a slice of samples, taken in single precision, the slices below and above it, the spacing. Out: the gradient at a
//! sample, along the index axes, in units per world length; turn it by [`Grid::direction`](crate::volume::Grid) for
//! world axes. Central differences `(f+ - f-) / 2h`, one-sided at borders and next to samples that are not finite,
//! 0 where there is no neighbour. Exact for linear fields, at faces too. Differences are taken in double precision,
//! so that no single-precision field and no spacing overflows or loses its direction.

use crate::volume::Sample;

/// Largest factor that a difference of single-precision samples, at most 2^129, can take and stay finite.
const LARGEST_INVERSE: f64 = 1e250;

/// A slice and its neighbours along z.
#[derive(Debug, Clone, Copy)]
pub struct Neighbourhood<'a, T = f32> {
    below: Option<&'a [T]>,
    here: &'a [T],
    above: Option<&'a [T]>,
    dims: [usize; 2],
    /// A sample counts as `raw * slope + intercept`; `None` where that is the sample itself.
    scale: Option<(f64, f64)>,
    /// 1 / h, bounded.
    inverse: [f64; 3],
}

impl<'a, T: Sample> Neighbourhood<'a, T> {
    /// The slice `here` between `below` (z - 1) and `above` (z + 1), `None` beyond the volume.
    ///
    /// `dims`: samples along x and y; every slice has their product. `spacing`: world lengths, finite and above 0.
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

    /// The same slices, whose samples count as `raw * slope + intercept`.
    pub fn scaled(self, slope: f64, intercept: f64) -> Neighbourhood<'a, T> {
        Neighbourhood { scale: (slope != 1.0 || intercept != 0.0).then_some((slope, intercept)), ..self }
    }

    /// A sample's value in single precision.
    #[inline(always)]
    fn value(&self, sample: T) -> f64 {
        #[allow(clippy::cast_possible_truncation, reason = "gradients are taken of single-precision fields")]
        match self.scale {
            None => sample.to_f32().into(),
            Some((slope, intercept)) => f64::from((sample.to_f64() * slope + intercept) as f32),
        }
    }

    /// The gradient at (`x`, `y`), along the index axes, in units per world length; always finite.
    ///
    /// # Panics
    /// If `x` or `y` is not below its dimension.
    #[inline]
    pub fn gradient(&self, x: usize, y: usize) -> [f64; 3] {
        let [width, height] = self.dims;
        assert!(x < width && y < height, "a sample inside the slice");
        let at = y * width + x;
        let here = self.value(self.here[at]);
        let neighbour = |inside: bool, index: usize| if inside { self.value(self.here[index]) } else { f64::NAN };
        let slice = |slice: Option<&[T]>| slice.map_or(f64::NAN, |samples| self.value(samples[at]));
        [
            slope(neighbour(x > 0, at.wrapping_sub(1)), here, neighbour(x + 1 < width, at + 1), self.inverse[0]),
            slope(
                neighbour(y > 0, at.wrapping_sub(width)),
                here,
                neighbour(y + 1 < height, at + width),
                self.inverse[1],
            ),
            slope(slice(self.below), here, slice(self.above), self.inverse[2]),
        ]
    }
}

/// Length of a gradient; finite for every finite one whose length is.
#[inline]
pub fn magnitude([x, y, z]: [f64; 3]) -> f64 {
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

/// Slope at the middle of three samples, of which any may be missing (not finite).
#[inline(always)]
fn slope(before: f64, here: f64, after: f64, inverse: f64) -> f64 {
    let central = after - before;
    if central.is_finite() {
        return central * 0.5 * inverse;
    }
    one_sided(before, here, after, inverse)
}

#[cold]
fn one_sided(before: f64, here: f64, after: f64, inverse: f64) -> f64 {
    [after - here, here - before].into_iter().find(|difference| difference.is_finite()).unwrap_or(0.0) * inverse
}
