//! How much of a layer of voxels a line gains at least.
//!
//! In: a kernel, how far apart voxels are. Out: the least sum of weights of the voxels in a square of cells around the
//! one in which a line crosses their layer, over all places in the cell and all slopes up to one cell a layer on
//! either axis. A proof, not a sample: boxes of places and slopes are split until their lower bound is good enough.
//!
//! In index space the kernel is a ball, and a voxel's weight depends on its distance from the line alone:
//! `G(distance) * (length of the line per step of index space)`. A distance changes by no more than the crossing point
//! moves, plus the offset in the layer times the change of the slope.

use adjsplat::splat::KernelShape;
use adjsplat::volume::Axis;

/// Least sums of weights, for optical depth per mean voxel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct LayerWeights {
    /// Of the 3 x 3 cells around the one that is crossed.
    pub(super) three: f64,
    /// Of the 5 x 5 cells.
    pub(super) five: f64,
}

/// Proven bounds are this much below what is found on a grid of lines: closer ones cost millions of boxes, as sums of
/// weights hardly change from line to line, and buy little.
const CLOSE: f64 = 0.05;
/// Times that a box of lines is split at most.
const SPLITS: u32 = 16;

/// The weights of layers across `axis`; `lengths`: distance between voxels on each axis, in mean voxels.
pub(super) fn layer_weights(kernel: KernelShape, axis: Axis, lengths: [f64; 3]) -> LayerWeights {
    let [u, v] = axis.others();
    let squares = [axis, u, v].map(|axis| lengths[axis.index()].powi(2));
    let layer = Layer { kernel, squares };
    LayerWeights { three: layer.least(1), five: layer.least(2) }
}

struct Layer {
    kernel: KernelShape,
    /// Squared distances between voxels: across the layer, and on its two axes.
    squares: [f64; 3],
}

/// Places and slopes: the middle and half the width of each.
#[derive(Debug, Clone, Copy)]
struct Lines {
    place: [f64; 2],
    slope: [f64; 2],
    half_place: f64,
    half_slope: f64,
}

impl Layer {
    fn least(&self, cells: i32) -> f64 {
        let one = |n: i32| {
            // Places of a quarter of the cell, which is enough by symmetry, and slopes.
            let part = |power: u32, low: f64, high: f64| low + (high - low) * f64::from(n / 9i32.pow(power) % 9) / 8.0;
            let (place, slope) = ([part(0, 0.0, 0.5), part(1, 0.0, 0.5)], [part(2, -1.0, 1.0), part(3, -1.0, 1.0)]);
            self.bound(&Lines { place, slope, half_place: 0.0, half_slope: 0.0 }, cells)
        };
        let mut floor = (0..9i32.pow(4)).map(one).fold(f64::INFINITY, f64::min) * (1.0 - CLOSE);
        let all = Lines { place: [0.25; 2], slope: [0.0; 2], half_place: 0.25, half_slope: 1.0 };
        // Where the floor is not proven, the least lies between the lines that were looked at.
        while !self.stays_above(floor, &all, cells, SPLITS) {
            floor *= 1.0 - CLOSE;
        }
        floor
    }

    /// Whether no line of `lines` gains less than `floor`; undecided boxes are split `splits` times at most.
    fn stays_above(&self, floor: f64, lines: &Lines, cells: i32, splits: u32) -> bool {
        if self.bound(lines, cells) >= floor {
            return true;
        }
        // Slopes move a distance by up to the offset, about one and a half cells.
        let by_slope = 1.5 * lines.half_slope > lines.half_place;
        splits > 0
            && (0..4).all(|quarter| {
                let sign = |bit: usize| if quarter >> bit & 1 == 1 { 0.5 } else { -0.5 };
                let mut part = *lines;
                for a in 0..2 {
                    if by_slope {
                        part.slope[a] += sign(a) * lines.half_slope;
                    } else {
                        part.place[a] += sign(a) * lines.half_place;
                    }
                }
                if by_slope {
                    part.half_slope /= 2.0;
                } else {
                    part.half_place /= 2.0;
                }
                self.stays_above(floor, &part, cells, splits - 1)
            })
    }

    /// A lower bound for all of `lines`; their sum of weights if they are one line.
    fn bound(&self, lines: &Lines, cells: i32) -> f64 {
        let moved = lines.half_place * std::f64::consts::SQRT_2;
        let turned = lines.half_slope * std::f64::consts::SQRT_2;
        let [sx, sy] = lines.slope;
        let square = 1.0 + sx * sx + sy * sy;
        let mut sum = 0.0;
        for j in -cells..=cells {
            for i in -cells..=cells {
                let (dx, dy) = (f64::from(i) - lines.place[0], f64::from(j) - lines.place[1]);
                let offset = dx * dx + dy * dy;
                let along = dx * sx + dy * sy;
                let distance = (offset - along * along / square).max(0.0).sqrt();
                sum += self.weight(distance + moved + (offset.sqrt() + moved) * turned);
            }
        }
        sum * self.length(lines)
    }

    /// The kernel's integral along a line at this distance.
    fn weight(&self, distance: f64) -> f64 {
        if distance > f64::from(self.kernel.radius) {
            return 0.0;
        }
        let sigma = f64::from(self.kernel.sigma);
        f64::from(self.kernel.normalisation()) / (sigma * sigma) * (-0.5 * (distance / sigma).powi(2)).exp()
    }

    /// The least length of a line per step of index space, in mean voxels: monotonic in the square of each slope.
    fn length(&self, lines: &Lines) -> f64 {
        let ends = lines.slope.map(|slope| {
            let (low, high) = (slope - lines.half_slope, slope + lines.half_slope);
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
                let [u, v] = axis.others();
                let squares = [axis, u, v].map(|axis| lengths[axis.index()].powi(2));
                let layer = Layer { kernel: quality.kernel(), squares };
                for (cells, bound) in [(1, bounds.three), (2, bounds.five)] {
                    let mut least = f64::INFINITY;
                    for n in 0..13i32.pow(4) {
                        let part = |power: u32, low: f64, high: f64| {
                            low + (high - low) * f64::from(n / 13i32.pow(power) % 13) / 12.0
                        };
                        let place = [part(0, -0.5, 0.5), part(1, -0.5, 0.5)];
                        let slope = [part(2, -1.0, 1.0), part(3, -1.0, 1.0)];
                        let line = Lines { place, slope, half_place: 0.0, half_slope: 0.0 };
                        least = least.min(layer.bound(&line, cells));
                    }
                    assert!(bound <= least, "{quality:?} {axis:?} {cells}: {bound} is above {least}");
                    // The grid of lines has the corners, where the least usually is.
                    assert!(bound >= 0.94 * least, "{quality:?} {axis:?} {cells}: {bound} is far below {least}");
                }
            }
        }
        // The paper's constants, measured on a coarse grid, for sigma 0.6 and a cut-off of 2.
        let weights = layer_weights(KernelShape { sigma: 0.6, radius: 2.0 }, Axis::Z, [1.0; 3]);
        assert!(
            (weights.three / 0.9416 - 0.95).abs() < 0.02 && (weights.five / 0.9967 - 0.95).abs() < 0.01,
            "{weights:?}"
        );
    }
}
