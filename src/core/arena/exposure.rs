//! How much of a voxel is seen through its six neighbours, by which it counts in the means of a level of detail.
//!
//! In: the optical depths of the voxels of a box. Out: for each voxel two numbers, one for what a view sees of it from one side,
//! one for the area that it shows to all sides. `formats/adj-1.md`, section 13.3.

use std::sync::LazyLock;

use super::rows::Region;

/// How much of a voxel is seen.
#[derive(Clone, Copy)]
pub(super) struct Exposure {
    /// Along its normal, from the side that is clearer; without a normal, through the clearest neighbour. 1 to 256.
    pub front: u64,
    /// Through all of them together: the area that the voxel shows. 1 to 1,531.
    pub area: u64,
}

impl Exposure {
    /// The area of a voxel of which one face is open.
    pub(super) const ONE_FACE: u64 = 256;

    /// Returns how much the voxel counts for the light of its block, if it shows the area `shown`. Measured (docs/studies/levels.md).
    #[inline]
    #[expect(clippy::cast_precision_loss, reason = "small numbers")]
    pub(super) fn lit(self, shown: u64) -> f64 {
        let front = self.front as f64;
        (front * (front * shown as f64).sqrt()).sqrt()
    }
}

/// What the depth of neighbours is multiplied by, for each of the two: kernels are about two voxels wide, and a view is seldom along
/// the normal. Measured (docs/studies/levels.md).
const FRONT: f64 = 1.3;
const AREA: f64 = 4.0;

/// Returns how much is seen through an optical depth, 0 to 255.
#[inline]
fn clear(depth: f64) -> u64 {
    /// Depths are rounded down to parts of this.
    const PARTS: f64 = 256.0;
    /// From here on nothing is seen: 255 exp(-1,600 / 256) < 1/2.
    const LAST: usize = 1_600;
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 255")]
    static CLEAR: LazyLock<[u8; LAST]> =
        LazyLock::new(|| std::array::from_fn(|part| (255.0 * (-(part as f64) / PARTS).exp()).round() as u8));
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "not negative; large depths saturate")]
    let part = (PARTS * depth) as usize;
    CLEAR.get(part).copied().unwrap_or(0).into()
}

/// The optical depth of each point of a box, of what is visible there, per reference length, in parts of 65,536: 0 where no voxel is.
#[derive(Default)]
pub(super) struct NeighbourDepths {
    low: [u32; 3],
    size: [usize; 3],
    depths: Vec<u32>,
    /// Of each row along x, whether a depth was set: only such rows are cleared, as most of a large grid may be empty.
    is_set: Vec<bool>,
}

impl NeighbourDepths {
    /// Begins with the box of `region` and of one more point on each side, which may lie outside the grid.
    pub(super) fn begin(&mut self, region: &Region) {
        let width = self.size[0];
        for row in (0..self.is_set.len()).filter(|&row| self.is_set[row]) {
            self.depths[row * width..][..width].fill(0);
        }
        self.low = region.low();
        self.size = region.size().map(|points| points as usize + 2);
        let [width, height, depth] = self.size;
        self.depths.resize(self.depths.len().max(width * height * depth), 0);
        self.is_set.clear();
        self.is_set.resize(height * depth, false);
    }

    /// Sets the depth of a point of the box.
    #[inline]
    pub(super) fn set(&mut self, point: [u32; 3], depth: u32) {
        let (row, x) = self.row(point);
        self.is_set[row] = true;
        self.depths[row * self.size[0] + x] = depth;
    }

    /// Returns the row of a point of the box, and its place there. The lowest point has coordinates of -1 beside the region's.
    #[inline]
    fn row(&self, [x, y, z]: [u32; 3]) -> (usize, usize) {
        let at = |a: usize, coordinate: u32| (coordinate + 1 - self.low[a]) as usize;
        (at(2, z) * self.size[1] + at(1, y), at(0, x))
    }

    /// Returns how much of a voxel is seen. `normal` is its unit normal, 0 for none; `lengths` are the spacings along the axes, in parts
    /// of the length for which depths are.
    #[inline]
    pub(super) fn exposure(&self, place: [u32; 3], normal: [f64; 3], lengths: [f64; 3]) -> Exposure {
        let ((row, x), width) = (self.row(place), self.size[0]);
        let (at, strides) = (row * width + x, [1, width, width * self.size[1]]);
        // Of the neighbours at the low and at the high end of each axis.
        let depths = [0, 1, 2].map(|a| {
            let neighbours = [self.depths[at - strides[a]], self.depths[at + strides[a]]];
            neighbours.map(|depth| lengths[a] * (f64::from(depth) / 65_536.0))
        });
        let area = depths.iter().flatten().map(|depth| clear(AREA * depth)).sum::<u64>();
        let in_front = if normal == [0.0; 3] {
            depths.iter().flatten().copied().fold(f64::MAX, f64::min)
        } else {
            // A voxel at a distance d from a plane is d / |n| away from it along an axis, so |n| times the depth along an axis is that
            // along the normal. The mean of the three, weighted by n^2, which adds up to 1:
            let along = |end: usize| -> f64 {
                let weighted = normal.iter().zip(depths).map(|(n, depths)| {
                    let faced = if *n < 0.0 { 1 - end } else { end };
                    n.abs().powi(3) * depths[faced]
                });
                weighted.sum()
            };
            along(0).min(along(1))
        };
        Exposure { front: 1 + clear(FRONT * in_front), area: 1 + area }
    }
}
