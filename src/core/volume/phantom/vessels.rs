//! A branching tree of vessels.
//!
//! In: the dimensions. Out: tubes with 255 on their centre lines, [`EDGE`] at the wall, and 0 at 1.25 of the radius.
//! Each vessel branches in two, eight times over. The cubes of the branches' radii add up to the cube of their
//! parent's (C. D. Murray, 1926). The tree is drawn in the unit cube from fixed random numbers, then stretched to the
//! grid: every size shows the same tree.

use std::ops::Range;

use glam::DVec3;

use super::fields::{Field, hash};

pub(super) const EDGE: f64 = 92.0;

const GENERATIONS: u32 = 8;
/// Radius of the tree's first vessel, relative to the geometric mean of the dimensions.
const ROOT_RADIUS: f64 = 0.04;
/// Distance from the centre line at which a value is 0, in radii. The value at distance d is 255 (1 - (d / (1.25
/// radius))^2): 255 (1 - 0.64) at the wall.
const SOFT_EDGE: f64 = 1.25;

struct VesselSegment {
    from: DVec3,
    along: DVec3,
    inverse: f64,
    reach: f64,
}

/// Creates the tree on a grid of `dims` points.
pub(super) fn vessels(dims: [u32; 3]) -> Field {
    let mut tree = VesselTree { dims, segments: Vec::new(), rolled: 0 };
    tree.grow(DVec3::new(0.5, 0.5, 0.02), DVec3::Z, 0.3, ROOT_RADIUS, GENERATIONS);
    let (mut slice, mut filled) = (Vec::new(), None);
    Box::new(move |y, z, row| {
        if filled != Some(z) {
            tree.fill(z, &mut slice);
            filled = Some(z);
        }
        row.copy_from_slice(&slice[y as usize * row.len()..][..row.len()]);
    })
}

struct VesselTree {
    dims: [u32; 3],
    segments: Vec<VesselSegment>,
    rolled: u64,
}

impl VesselTree {
    /// Returns the next number of a fixed random sequence, from -1 to 1.
    fn roll(&mut self) -> f64 {
        self.rolled += 1;
        #[expect(clippy::cast_precision_loss, reason = "52 bits")]
        let share = (hash(self.rolled) >> 12) as f64 / (1u64 << 52) as f64;
        share * 2.0 - 1.0
    }

    /// Adds a vessel that starts at `from` in the direction `heading` (a unit vector), and its branches.
    fn grow(&mut self, from: DVec3, heading: DVec3, length: f64, radius: f64, generations: u32) {
        // Reflected at the cube's walls, so that the tree stays inside.
        let reflected = |ahead: f64| match ahead {
            ..0.04 => 0.08 - ahead,
            ..=0.96 => ahead,
            _ => 1.92 - ahead,
        };
        let to = (from + heading * length).map(|ahead| reflected(ahead).clamp(0.04, 0.96));
        self.add(from, to, radius);
        if generations == 0 {
            return;
        }
        let heading = unit(to - from);
        let random = DVec3::new(self.roll(), self.roll(), self.roll());
        let aside = unit(random - random.dot(heading) * heading);
        // Murray: r^3 = r1^3 + r2^3.
        let share = 0.5 + 0.2 * self.roll();
        for (sign, share) in [(1.0, share), (-1.0, 1.0 - share)] {
            let bend = sign * (0.75 + 0.25 * self.roll());
            let branch = unit(heading + bend * aside);
            let stretch = 0.80 + 0.08 * self.roll();
            self.grow(to, branch, length * stretch, radius * cube_root(share), generations - 1);
        }
    }

    fn add(&mut self, from: DVec3, to: DVec3, radius: f64) {
        let span = DVec3::from(self.dims.map(|points| f64::from(points - 1)));
        let size = cube_root(self.dims.map(f64::from).iter().product());
        let from = from * span;
        let along = to * span - from;
        let squared = along.length_squared();
        let inverse = if squared > 0.0 { 1.0 / squared } else { 0.0 };
        // At least half a voxel wide on either side: thinner vessels would break into dots.
        let reach = (radius * size).max(0.6) * SOFT_EDGE;
        self.segments.push(VesselSegment { from, along, inverse, reach });
    }

    /// Fills `slice` with the values at `z`, from 0 to 255.
    fn fill(&self, z: u32, slice: &mut Vec<f32>) {
        let [width, height, _] = self.dims;
        slice.clear();
        slice.resize(width as usize * height as usize, 0.0);
        let z = f64::from(z);
        for segment in &self.segments {
            let Some(in_slice) = segment.clip(2, z, z, (0.0, 1.0)) else { continue };
            for y in segment.extent(1, in_slice, height) {
                let row = &mut slice[y * width as usize..][..width as usize];
                let y = y as f64;
                let Some(in_row) = segment.clip(1, y, y, in_slice) else { continue };
                for x in segment.extent(0, in_row, width) {
                    let squared = segment.squared_distance(DVec3::new(x as f64, y, z));
                    #[expect(clippy::cast_possible_truncation, reason = "at most 255")]
                    let value = (255.0 * (1.0 - squared / (segment.reach * segment.reach))) as f32;
                    row[x] = row[x].max(value);
                }
            }
        }
    }
}

impl VesselSegment {
    /// Returns the squared distance of `place` from the segment, in voxels.
    #[inline(always)]
    fn squared_distance(&self, place: DVec3) -> f64 {
        let off = place - self.from;
        let along = (off.dot(self.along) * self.inverse).clamp(0.0, 1.0);
        (off - along * self.along).length_squared()
    }

    /// Returns which part of `part` (fractions of the segment) is within reach of the slab `low..=high` across `axis`.
    fn clip(&self, axis: usize, low: f64, high: f64, part: (f64, f64)) -> Option<(f64, f64)> {
        let (low, high) = (low - self.reach - self.from[axis], high + self.reach - self.from[axis]);
        let along = self.along[axis];
        if along == 0.0 {
            return (low <= 0.0 && 0.0 <= high).then_some(part);
        }
        let (a, b) = (low / along, high / along);
        let part = (part.0.max(a.min(b)), part.1.min(a.max(b)));
        (part.0 <= part.1).then_some(part)
    }

    /// Returns the grid indices along `axis` that are within reach of `part` of the segment (fractions of its length).
    fn extent(&self, axis: usize, part: (f64, f64), points: u32) -> Range<usize> {
        let [a, b] = [part.0, part.1].map(|at| self.from[axis] + at * self.along[axis]);
        let low = (a.min(b) - self.reach).ceil().max(0.0);
        let high = (a.max(b) + self.reach).floor().min(f64::from(points - 1));
        // Empty if nothing is in reach: `high` may be below `low`, and below 0.
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 65,536")]
        let indices = low as usize..(high + 1.0) as usize;
        indices
    }
}

/// Returns the cube root rounded to about 40 bits, which hides the last digit of a platform's root.
fn cube_root(number: f64) -> f64 {
    let root = number.cbrt();
    let unit = 2.0f64.powi(-36) * root.max(1.0);
    (root / unit).round() * unit
}

/// Returns the vector scaled to length 1; the z axis for a zero vector.
fn unit(vector: DVec3) -> DVec3 {
    let length = vector.length();
    if length > 0.0 { vector / length } else { DVec3::Z }
}
