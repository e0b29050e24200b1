//! The kernels of voxels that stand for blocks, as those of coarser levels of detail do.
//!
//! In: the kernel of level 0, how many points of level 0 a block has along each axis, and where the visible part of a block lies.
//! Out: the kernel's width along each axis. The visible part is n points long along an axis. Each point has a kernel of standard
//! deviation sigma, and n points at distances of 1 have the variance (n^2 - 1) / 12:
//!
//! ```text
//! width = sqrt(sigma^2 + (n^2 - 1) / 12) / points      in blocks
//! n     = max(1, points (1 - 2 |offset|))              offset: of the part's middle from the block's, in blocks
//! ```
//!
//! A part whose middle is beside the block's cannot be longer than that. Along an axis there are three widths, for offsets of 0, of 1,
//! and of 2 or 3 eighths; two are up to 7 dB worse (docs/studies/levels.md). So there are 27 *shapes*.

#![expect(clippy::cast_possible_truncation, reason = "single precision is the renderer's; offsets are below 1")]

use super::kernel::KernelShape;

/// Number of widths along an axis.
const WIDTHS: usize = 3;
/// Number of shapes.
pub(crate) const SHAPES: usize = WIDTHS * WIDTHS * WIDTHS;
/// The longest part of a block that may be visible, as a share of the block, for each width.
const VISIBLE: [f64; WIDTHS] = [1.0, 0.75, 0.45];
/// Largest radius of these kernels, in standard deviations. A wider cut-off is slower, and was no nearer to the truth.
const CUT_OFF: f32 = 3.2;

/// How many points of level 0 a voxel stands for along x, y and z.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) struct Blocks(pub(crate) [u32; 3]);

/// For x, y and z: the three widths of kernels, as shares of the widest of all.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Widths(pub(crate) [[f32; WIDTHS]; 3]);

impl Blocks {
    /// The voxels of level 0.
    pub(crate) const NONE: Blocks = Blocks([1; 3]);

    /// Returns a round kernel with the largest width that any block has along any axis, in blocks; `kernel` is that of level 0.
    pub(crate) fn widest(self, kernel: KernelShape) -> KernelShape {
        self.round_kernel(kernel, largest)
    }

    /// Returns a round kernel whose width is the geometric mean of the middle widths along x, y and z, in blocks.
    pub(crate) fn mean(self, kernel: KernelShape) -> KernelShape {
        self.round_kernel(kernel, |widths| widths.map(|[_, middle, _]| middle).iter().product::<f64>().cbrt())
    }

    fn round_kernel(self, kernel: KernelShape, width: impl Fn([[f64; WIDTHS]; 3]) -> f64) -> KernelShape {
        if self == Blocks::NONE {
            return kernel;
        }
        let sigma = width(self.widths_in_blocks(kernel)) as f32;
        KernelShape { sigma, radius: sigma * kernel.cut_off().min(CUT_OFF) }
    }

    /// Returns the widths of the kernels of these blocks, given the kernel of level 0.
    pub(crate) fn widths(self, kernel: KernelShape) -> Widths {
        let widths = self.widths_in_blocks(kernel);
        let largest = largest(widths);
        Widths(widths.map(|axis| axis.map(|width| (width / largest) as f32)))
    }

    fn widths_in_blocks(self, kernel: KernelShape) -> [[f64; WIDTHS]; 3] {
        let variance = f64::from(kernel.sigma).powi(2);
        self.0.map(f64::from).map(|points| {
            VISIBLE.map(|visible| {
                let long = (points * visible).max(1.0);
                (variance + (long * long - 1.0) / 12.0).sqrt() / points
            })
        })
    }
}

fn largest(widths: [[f64; WIDTHS]; 3]) -> f64 {
    widths.as_flattened().iter().copied().fold(0.0, f64::max)
}

/// Returns the shape of the kernel of a block whose visible part has its middle this far from the block's, in blocks.
#[inline(always)]
pub(crate) fn shape(offset: [f32; 3]) -> usize {
    let [x, y, z] = offset.map(|offset| ((8.0 * offset.abs() + 0.5) as usize).min(WIDTHS - 1));
    (z * WIDTHS + y) * WIDTHS + x
}

impl Widths {
    /// Returns the widths of a shape along x, y and z.
    #[inline(always)]
    pub(crate) fn of(&self, shape: usize) -> [f32; 3] {
        let Widths([x, y, z]) = self;
        [x[shape % WIDTHS], y[shape / WIDTHS % WIDTHS], z[shape / (WIDTHS * WIDTHS) % WIDTHS]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::splat::Quality;

    #[test]
    fn a_block_is_as_wide_as_its_visible_points_with_their_kernels() {
        let kernel = Quality::Standard.kernel();
        let sigma = f64::from(kernel.sigma);
        for points in [1u32, 2, 4, 8, 16] {
            let blocks = Blocks([points, 1, 1]);
            let widest = blocks.widest(kernel);
            for (offset, visible) in [(0.0, 1.0), (-0.125, 0.75), (0.25, 0.45)] {
                // The points that are visible, about their middle.
                let long = (f64::from(points) * visible).max(1.0);
                let spread = (long * long - 1.0) / 12.0;
                let [x, y, z] = blocks.widths(kernel).of(shape([offset, 0.0, 0.0])).map(|width| width * widest.sigma);
                let expected = (sigma * sigma + spread).sqrt() / f64::from(points);
                assert!((f64::from(x) - expected).abs() < 1e-6, "{points} {offset}: {x}, not {expected}");
                assert!((y - kernel.sigma).abs() < 1e-6 && (z - kernel.sigma).abs() < 1e-6, "{y} {z}");
            }
        }
        assert_eq!(Blocks::NONE.widest(kernel), kernel);
    }

    #[test]
    fn whole_numbers_of_visible_points_have_the_variance_of_such_points() {
        for count in 1..=16u32 {
            let middle = f64::from(count - 1) / 2.0;
            let variance: f64 = (0..count).map(|at| (f64::from(at) - middle).powi(2)).sum::<f64>() / f64::from(count);
            let [width, ..] = Blocks([count, 1, 1]).widths_in_blocks(KernelShape { sigma: 0.7, radius: 1.75 })[0];
            let expected = (0.49 + variance).sqrt();
            assert!((width * f64::from(count) - expected).abs() < 1e-6, "{count}");
        }
    }

    #[test]
    fn shapes_follow_the_offset_along_each_axis() {
        assert_eq!(shape([0.0; 3]), 0);
        assert_eq!(shape([0.125, 0.0, 0.0]), 1);
        assert_eq!(shape([-0.375, 0.0, 0.0]), 2);
        assert_eq!(shape([0.0, -0.125, 0.25]), 2 * 9 + 3);
        // Masks of eight points have such offsets: two of three points at one end.
        assert_eq!(shape([1.0 / 12.0, 0.0, 0.0]), 1);
    }
}
