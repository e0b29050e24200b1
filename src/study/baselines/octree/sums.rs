//! Sums over the voxels of a cube, and the look of the cube as one splat.

use super::CubeLook;

/// Sums over the cells of a cube, in double precision.
#[derive(Debug, Clone, Copy)]
pub(super) struct CubeSums {
    /// Sums of red, green and blue times optical depth, and of optical depth.
    weighted: [f64; 4],
    /// Sum of normals times optical depth.
    normal: [f64; 3],
    /// Sums of red, green and blue times opacity, and of opacity; the next field holds the sums of their squares.
    seen: [f64; 4],
    squares: f64,
}

impl CubeSums {
    pub(super) fn of([red, green, blue, depth]: [f32; 4], normal: [f32; 3]) -> CubeSums {
        let [red, green, blue, depth] = [red, green, blue, depth].map(f64::from);
        let opacity = 1.0 - (-depth).exp2();
        let seen = [red * opacity, green * opacity, blue * opacity, opacity];
        CubeSums {
            weighted: [red * depth, green * depth, blue * depth, depth],
            normal: normal.map(|c| f64::from(c) * depth),
            seen,
            squares: seen.iter().map(|c| c * c).sum(),
        }
    }

    pub(super) fn add(&mut self, other: &CubeSums) {
        let add = |sum: &mut [f64], more: &[f64]| sum.iter_mut().zip(more).for_each(|(sum, more)| *sum += more);
        add(&mut self.weighted, &other.weighted);
        add(&mut self.normal, &other.normal);
        add(&mut self.seen, &other.seen);
        self.squares += other.squares;
    }

    /// Returns the look of a cube whose edge is 2^`level` voxels.
    pub(super) fn look(&self, level: u8) -> CubeLook {
        let cells = (3.0 * f64::from(level)).exp2();
        let [red, green, blue, depth] = self.weighted;
        let by_depth = if depth > 0.0 { 1.0 / depth } else { 0.0 };
        let length = self.normal.iter().map(|c| c * c).sum::<f64>().sqrt();
        let unit = if length > 0.0 { 1.0 / length } else { 0.0 };
        let variance = self.squares / cells - self.seen.iter().map(|sum| (sum / cells) * (sum / cells)).sum::<f64>();
        CubeLook {
            look: [red * by_depth, green * by_depth, blue * by_depth, depth / cells].map(narrow),
            normal: self.normal.map(|c| narrow(c * unit)),
            error: narrow(variance.max(0.0).sqrt()),
        }
    }
}

#[expect(clippy::cast_possible_truncation, reason = "rounding is meant")]
fn narrow(number: f64) -> f32 {
    number as f32
}
