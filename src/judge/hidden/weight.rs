//! Computes the least weight that a line of sight gains in a layer of voxels.
//!
//! In: a kernel and the distances between voxels. Out: the least sum of kernel weights of the voxels in a square of
//! cells around the cell in which a line crosses their layer. The minimum is over all crossing points in that cell and
//! all slopes up to one cell per layer on either axis. It is proven: ranges of points and slopes are split until their
//! lower bound suffices.
//!
//! In index space the kernel is a ball. A voxel's weight depends only on its distance from the line:
//! `G(distance) * (length of the line per step of index space)`. The distance changes by at most the shift of the
//! crossing point, plus the offset in the layer times the change of the slope.

use adjsplat::splat::KernelShape;
use adjsplat::volume::Axis;

/// How far a proven bound is below the least weight over a grid of lines, as a fraction of it. Closer bounds would need
/// millions of ranges and gain little, because sums of weights hardly change from line to line.
const CLOSE: f64 = 0.05;
/// The largest number of times that a range of lines is split.
const SPLITS: u32 = 16;

/// Returns the least weights of layers across `axis`: the sum over the 3 x 3 cells around the crossed one, and over 5 x
/// 5. Multiplied by an optical depth per mean spacing they give that of the line. `lengths` are the distances between
/// voxels on each axis, in mean spacings.
pub(super) fn layer_weights(kernel: KernelShape, axis: Axis, lengths: [f64; 3]) -> [f64; 2] {
    let layer = VoxelLayer::new(kernel, axis, lengths);
    [1, 2].map(|cells| layer.least(cells))
}

struct VoxelLayer {
    kernel: KernelShape,
    /// The squared distances between voxels: across the layer, then along its two axes.
    squares: [f64; 3],
}

/// A range of lines: the centre and half the width of the range of crossing points, in cells, and of slopes.
#[derive(Debug, Clone, Copy)]
struct LineRange {
    place: [f64; 2],
    slope: [f64; 2],
    place_radius: f64,
    slope_radius: f64,
}

impl LineRange {
    /// Returns line number `n` of a grid of `steps`^4 lines; their crossing points begin at `low` on both axes.
    fn of_grid(n: i32, steps: i32, low: f64) -> LineRange {
        let fraction = |power: u32, low: f64, high: f64| {
            low + (high - low) * f64::from(n / steps.pow(power) % steps) / f64::from(steps - 1)
        };
        let place = [fraction(0, low, 0.5), fraction(1, low, 0.5)];
        let slope = [fraction(2, -1.0, 1.0), fraction(3, -1.0, 1.0)];
        LineRange { place, slope, place_radius: 0.0, slope_radius: 0.0 }
    }
}

impl VoxelLayer {
    fn new(kernel: KernelShape, axis: Axis, lengths: [f64; 3]) -> VoxelLayer {
        let [u, v] = axis.others();
        VoxelLayer { kernel, squares: [axis, u, v].map(|axis| lengths[axis.index()].powi(2)) }
    }

    fn least(&self, cells: i32) -> f64 {
        // The crossing points are in a quarter of the cell, which suffices by symmetry.
        let one = |n: i32| self.bound(&LineRange::of_grid(n, 9, 0.0), cells);
        let mut floor = (0..9i32.pow(4)).map(one).fold(f64::INFINITY, f64::min) * (1.0 - CLOSE);
        let all = LineRange { place: [0.25; 2], slope: [0.0; 2], place_radius: 0.25, slope_radius: 1.0 };
        // If the floor cannot be proven, the minimum lies at a line between those that were tried.
        while !self.stays_above(floor, &all, cells, SPLITS) {
            floor *= 1.0 - CLOSE;
        }
        floor
    }

    /// Returns whether every line of `lines` gains at least `floor`; undecided ranges are split at most `splits` times.
    fn stays_above(&self, floor: f64, lines: &LineRange, cells: i32, splits: u32) -> bool {
        if self.bound(lines, cells) >= floor {
            return true;
        }
        // A slope changes a line's distance from a voxel by up to the voxel's offset, about one and a half cells.
        let by_slope = 1.5 * lines.slope_radius > lines.place_radius;
        splits > 0
            && (0..4).all(|quarter| {
                let sign = |bit: usize| if quarter >> bit & 1 == 1 { 0.5 } else { -0.5 };
                let mut part = *lines;
                for a in 0..2 {
                    if by_slope {
                        part.slope[a] += sign(a) * lines.slope_radius;
                    } else {
                        part.place[a] += sign(a) * lines.place_radius;
                    }
                }
                if by_slope {
                    part.slope_radius /= 2.0;
                } else {
                    part.place_radius /= 2.0;
                }
                self.stays_above(floor, &part, cells, splits - 1)
            })
    }

    /// Returns a lower bound of the weight of all `lines`; the exact sum of weights if the range is a single line.
    fn bound(&self, lines: &LineRange, cells: i32) -> f64 {
        let moved = lines.place_radius * std::f64::consts::SQRT_2;
        let turned = lines.slope_radius * std::f64::consts::SQRT_2;
        let [sx, sy] = lines.slope;
        let square = 1.0 + sx * sx + sy * sy;
        let mut sum = 0.0;
        for j in -cells..=cells {
            for i in -cells..=cells {
                let (dx, dy) = (f64::from(i) - lines.place[0], f64::from(j) - lines.place[1]);
                let offset = dx * dx + dy * dy;
                let product = dx * sx + dy * sy;
                let distance = (offset - product * product / square).max(0.0).sqrt();
                sum += self.weight(distance + moved + (offset.sqrt() + moved) * turned);
            }
        }
        sum * self.length(lines)
    }

    /// Returns the integral of the kernel along a line at this distance from its centre.
    fn weight(&self, distance: f64) -> f64 {
        if distance > f64::from(self.kernel.radius) {
            return 0.0;
        }
        let sigma = f64::from(self.kernel.sigma);
        f64::from(self.kernel.normalisation()) / (sigma * sigma) * (-0.5 * (distance / sigma).powi(2)).exp()
    }

    /// Returns how far the shortest of the lines runs from one layer of voxels to the next, in mean spacings. The length
    /// grows with the square of each slope, so the smallest slopes give it.
    fn length(&self, lines: &LineRange) -> f64 {
        let ends = lines.slope.map(|slope| {
            let (low, high) = (slope - lines.slope_radius, slope + lines.slope_radius);
            let least = if low <= 0.0 && high >= 0.0 { 0.0 } else { low.abs().min(high.abs()) };
            [least * least, (low * low).max(high * high)]
        });
        let [layer, u, v] = self.squares;
        let mut least = f64::INFINITY;
        for a in ends[0] {
            for b in ends[1] {
                least = least.min((layer + a * u + b * v) / (1.0 + a + b));
            }
        }
        least.sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use adjsplat::splat::Quality;

    #[test]
    fn no_line_gains_less_than_the_bound_and_some_line_gains_a_twentieth_more() {
        for (quality, lengths) in [
            (Quality::Draft, [1.0; 3]),
            (Quality::Standard, [1.0; 3]),
            (Quality::High, [1.0; 3]),
            (Quality::Standard, [0.5, 1.0, 2.0]),
        ] {
            for axis in Axis::ALL {
                let bounds = layer_weights(quality.kernel(), axis, lengths);
                let layer = VoxelLayer::new(quality.kernel(), axis, lengths);
                for (cells, bound) in [(1, bounds[0]), (2, bounds[1])] {
                    let mut least = f64::INFINITY;
                    for n in 0..13i32.pow(4) {
                        least = least.min(layer.bound(&LineRange::of_grid(n, 13, -0.5), cells));
                    }
                    assert!(bound <= least, "{quality:?} {axis:?} {cells}: {bound} is above {least}");
                    // The grid of lines includes the corners, where the least weight usually is.
                    assert!(bound >= 0.94 * least, "{quality:?} {axis:?} {cells}: {bound} is far below {least}");
                }
            }
        }
        // The constants of the paper, measured on a coarse grid, for sigma 0.6 and a cut-off of 2.
        let weights = layer_weights(KernelShape { sigma: 0.6, radius: 2.0 }, Axis::Z, [1.0; 3]);
        assert!((weights[0] / 0.9416 - 0.95).abs() < 0.02 && (weights[1] / 0.9967 - 0.95).abs() < 0.01, "{weights:?}");
    }
}
