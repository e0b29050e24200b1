//! The rays of a perspective's pixels, and voxels near the eye, whose kernels are integrated along them from the eye on.
//!
//! In: a perspective view, a kernel, a voxel. Out: the voxel's optical depth at each pixel. In voxel coordinates, where the kernel is a
//! round Gaussian:
//!
//! ```text
//! r = voxel - eye, u = unit direction of the ray     distance^2 = |r x u|^2     t = r . u
//! depth = voxel's depth * strength(ray) * exp(-distance^2 / 2 sigma^2) * Phi(t / sigma)       for distance <= radius
//! ```
//!
//! Let D be the direction of a pixel's ray one unit forward, and D0 that of the ray through the voxel, parallel to `r`.
//! D changes evenly from pixel to pixel, so `|r x D|^2` is a quadratic form of the distance between the pixels. Divided by `|D0|^2`, it is
//! the affine footprint of EWA; divided by `|D|^2`, the square of the distance. So a voxel farther away is drawn by its footprint and by
//! the lengths of the pixels' directions ([`Footprint::in_perspective`](super::kernel::Footprint::in_perspective)), and that is exact.
//!
//! Phi, the normal distribution, is the part of the kernel in front of the eye; where the eye is outside the kernel's
//! radius, it is 0 or 1. With `Q(z) = exp(z^2 / 2) Phi(-z)`, which a polynomial gives, one exponential a pixel is
//! enough: `exp(-distance^2 / 2 sigma^2) Phi(-|t| / sigma) = exp(-|r|^2 / 2 sigma^2) Q(|t| / sigma)`.
//!
//! All is single precision without fused multiply-adds or calls, so that every processor gives the same bits. Loops are
//! over arrays of pixels, which a compiler may compute sixteen at once.

#![expect(
    clippy::cast_possible_truncation,
    clippy::needless_range_loop,
    reason = "rays are single precision, pixels are clipped to the picture, and index loops over arrays run side by side"
)]

use bytemuck::Zeroable;
use glam::{DMat3, DVec3};

use super::arith::{LOG2_E, at_least, at_most, exp2_neg, keep_if};
use super::kernel::KernelShape;
use super::view::{PixelMap, View};
use crate::arena::visible::MAX_DEPTH;
use crate::traverse::Viewpoint;

/// Distance from the eye's plane below which a voxel has no footprint: twice the radius of the widest kernel of all qualities, so that they
/// draw the same voxels by footprints. Its unit is the largest change of that distance in a step of length 1 in voxel coordinates.
pub(crate) const NEAR: f64 = 8.4;
/// The same in radii of the kernel, for wider kernels. Farther away no kernel reaches the eye's plane, and the box around a footprint is at
/// most twice as large as an affine one's.
pub(crate) const NEAR_RADII: f64 = 2.0;

/// The rays of a perspective's pixels, and what voxels near the eye need.
#[derive(Debug, Clone)]
pub(crate) struct EyeRays {
    /// The eye in voxel coordinates.
    pub(crate) eye: DVec3,
    /// Movement in voxel coordinates along a ray, by tangent to the right, by tangent upward, and forward; scaled.
    pub(crate) right: [f32; 3],
    pub(crate) up: [f32; 3],
    pub(crate) forward: [f32; 3],
    /// Tangent of the angle from the view axis to a pixel one column or row away from the centre.
    per_pixel: f32,
    /// Column and row that the view axis meets.
    centre: [f64; 2],
    focal: f64,
    size: [u32; 2],
    /// Gradients of the distances to the right, up and forward of the eye, per voxel step on each axis.
    gradients: [DVec3; 3],
    /// Depths of centres below this are not drawn: they are clipped, or kernels end behind the eye. In mean spacings.
    pub(crate) least_depth: f64,
    radius: f64,
    /// By how much the distance from the eye's plane changes in a step of one voxel along its gradient, in mean spacings.
    pub(crate) steepness: f32,
    /// No ray has a stretch above this.
    pub(crate) most_stretch: f32,
    /// Exponent in units of ln 2 at a distance of one voxel.
    factor: f32,
    cut: f32,
    per_sigma: f32,
    /// The peak of a kernel of optical depth 1 per unit of the ray's stretch.
    pub(crate) strength: f32,
}

/// The rays of N pixels.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PixelRays<const N: usize> {
    /// Unit directions in voxel coordinates: all x components, then y, then z.
    direction: [[f32; N]; 3],
    lengths: RayLengths<N>,
}

/// The lengths of the rays of N pixels. All zero: not known yet.
#[derive(Debug, Clone, Copy, Zeroable)]
#[repr(C)]
pub(crate) struct RayLengths<const N: usize> {
    /// One over the square of the direction's length, scaled like [`EyeRays::right`].
    pub(crate) per_square: [f32; N],
    /// The *stretch*: how long a ray is in mean spacings for the same length in voxel coordinates, scaled alike.
    pub(crate) stretch: [f32; N],
}

/// A voxel near the eye.
#[derive(Debug, Clone, Copy)]
pub(crate) struct NearKernel {
    /// The voxel's centre minus the eye, in voxel coordinates.
    offset: [f32; 3],
    /// `exp(-|offset|^2 / 2 sigma^2)`; 0 if the eye is outside the kernel's radius.
    at_eye: f32,
    /// First and last column of a box of all pixels that the kernel reaches; inside the picture.
    pub(crate) columns: [i32; 2],
    /// First and last row of that box.
    pub(crate) rows: [i32; 2],
}

impl EyeRays {
    /// Returns the rays of `view`, with this kernel for voxels near the eye; `None` for a parallel view.
    pub(crate) fn new(view: &View, kernel: KernelShape) -> Option<EyeRays> {
        let (PixelMap::Perspective { camera_from_voxel, focal, centre, .. }, Viewpoint::Perspective { eye, .. }) =
            (&view.map, view.viewpoint)
        else {
            return None;
        };
        let gradients = camera_from_voxel.map(|[x, y, z, _]| DVec3::new(x, y, z));
        let [right, up, forward] = gradients;
        let rays = DMat3::from_cols(right, up, forward).transpose().inverse();
        // Only directions matter, and lengths times strength. Spacings may differ by more than single precision holds.
        let scale = rays.to_cols_array().into_iter().fold(f64::MIN_POSITIVE, |most, c| most.max(c.abs()));
        let single = |axis: DVec3| (axis / scale).to_array().map(|c| c as f32);
        let sigma = f64::from(kernel.sigma);
        let strength = f64::from(kernel.normalisation()) / (sigma * sigma) / scale;
        Some(EyeRays {
            eye: DVec3::from_array(eye),
            right: single(rays.x_axis),
            up: single(rays.y_axis),
            forward: single(rays.z_axis),
            per_pixel: (1.0 / focal) as f32,
            centre: *centre,
            focal: *focal,
            size: view.size,
            gradients,
            least_depth: view.clip.max(-view.reach),
            radius: kernel.radius.into(),
            steepness: forward.length() as f32,
            most_stretch: (scale * gradients.map(DVec3::length_squared).iter().sum::<f64>().sqrt()) as f32,
            factor: (0.5 / (sigma * sigma)) as f32 * LOG2_E,
            cut: kernel.cut(),
            per_sigma: 1.0 / kernel.sigma,
            strength: strength as f32,
        })
    }

    /// For studies only: returns what cubes of `width` voxels a side need, each one kernel that is as much wider.
    pub(crate) fn wider(&self, width: f32) -> EyeRays {
        EyeRays {
            least_depth: self.least_depth.min(self.least_depth * f64::from(width)),
            radius: self.radius * f64::from(width),
            factor: self.factor / (width * width),
            per_sigma: self.per_sigma / width,
            strength: self.strength * width,
            ..self.clone()
        }
    }

    /// Returns the kernel of a voxel, whose centre is `depth` mean spacings in front of the eye's plane.
    ///
    /// `None` if it reaches no pixel of the picture.
    pub(crate) fn kernel(&self, voxel: [f64; 3], depth: f64) -> Option<NearKernel> {
        // The comparison is false for NaN.
        let is_in_front = depth >= self.least_depth;
        if !is_in_front {
            return None;
        }
        let offset = DVec3::from_array(voxel) - self.eye;
        let [mut columns, mut rows] = self.size.map(|side| [0, side.cast_signed() - 1]);
        let mut at_eye = 0.0;
        if offset.length() <= self.radius {
            at_eye = exp2_neg(self.factor * offset.length_squared() as f32);
        } else {
            let [right, up, forward] = self.gradients;
            let [left, right] = tangents(right, forward, offset, self.radius)?;
            let [bottom, top] = tangents(up, forward, offset, self.radius)?;
            let [x, y] = self.centre;
            columns = meeting(columns, [x + self.focal * left, x + self.focal * right])?;
            rows = meeting(rows, [y - self.focal * top, y - self.focal * bottom])?;
        }
        Some(NearKernel { offset: offset.to_array().map(|c| c as f32), at_eye, columns, rows })
    }

    /// Returns the first and last column of the pixels in these rows that the kernel reaches, with a margin for rounding.
    ///
    /// A long voxel crosses its box slantwise: without this, engine with spacings of 1 : 1 : 30 took seven times as long from inside.
    pub(crate) fn chord(&self, kernel: &NearKernel, rows: [i32; 4]) -> [i32; 2] {
        let [r, forward, right, up] =
            [kernel.offset, self.forward, self.right, self.up].map(|axis| DVec3::from_array(axis.map(f64::from)));
        // A ray D meets the ball if `(r . D)^2 >= power |D|^2`. Single precision moves rays by less than a millionth of |r|.
        let power = r.length_squared() - (self.radius + 1e-6 * r.length()).powi(2);
        let square = r.dot(right).powi(2) - power * right.length_squared();
        let [left, end] = kernel.columns;
        if power <= 0.0 || square >= 0.0 {
            return [left, end];
        }
        let per_pixel = f64::from(self.per_pixel);
        let chords = rows.map(|row| {
            let middle = forward + up * ((self.centre[1] - f64::from(row)) * per_pixel);
            // Where this quadratic function of a tangent to the right is at least 0.
            let half = r.dot(middle) * r.dot(right) - power * middle.dot(right);
            let constant = r.dot(middle).powi(2) - power * middle.length_squared();
            let root = (half * half - square * constant).sqrt();
            [half - root, half + root].map(|at| self.centre[0] - at / square / per_pixel)
        });
        // No ray of a row meets the ball if the root is NaN: it changes neither minimum nor maximum.
        let low = chords.iter().fold(f64::INFINITY, |low, chord| low.min(chord[0]).min(chord[1]));
        let high = chords.iter().fold(f64::NEG_INFINITY, |high, chord| high.max(chord[0]).max(chord[1]));
        meeting([left, end], [low, high]).unwrap_or([0, -1])
    }

    /// Returns the rays of the pixels in these columns and rows.
    #[inline(always)]
    pub(crate) fn rays<const N: usize>(&self, columns: [i32; N], rows: [i32; N]) -> PixelRays<N> {
        // Half a pixel at the most: exact in single precision.
        let [middle_x, middle_y] = self.centre.map(|at| at as f32);
        let (mut direction, mut slant) = ([[0.0; N]; 3], [1.0; N]);
        let mut per_length = [0.0; N];
        let mut lengths = RayLengths { per_square: [0.0; N], stretch: [0.0; N] };
        for i in 0..N {
            let tan_x = (columns[i] as f32 - middle_x) * self.per_pixel;
            let tan_y = (middle_y - rows[i] as f32) * self.per_pixel;
            for a in 0..3 {
                direction[a][i] = (self.forward[a] + self.right[a] * tan_x) + self.up[a] * tan_y;
            }
            let [x, y, z] = [direction[0][i], direction[1][i], direction[2][i]];
            lengths.per_square[i] = 1.0 / at_least((x * x + y * y) + z * z, f32::MIN_POSITIVE);
            per_length[i] = lengths.per_square[i].sqrt();
            // The ray's length in mean spacings, for the length of the direction.
            slant[i] = ((1.0 + tan_x * tan_x) + tan_y * tan_y).sqrt();
        }
        for i in 0..N {
            for a in 0..3 {
                direction[a][i] *= per_length[i];
            }
            lengths.stretch[i] = slant[i] * per_length[i];
        }
        PixelRays { direction, lengths }
    }

    /// Returns the lengths of the rays of the pixels in these columns and rows.
    #[inline(always)]
    pub(crate) fn lengths<const N: usize>(&self, columns: [i32; N], rows: [i32; N]) -> RayLengths<N> {
        self.rays(columns, rows).lengths
    }

    /// Returns the largest square of the length of a direction in these tiles, each pair the first and one past the last, with a margin
    /// for rounding.
    #[inline(always)]
    pub(crate) fn largest_square(&self, columns: [i32; 2], rows: [i32; 2]) -> f32 {
        let mut most = 0.0;
        for [column, row] in [[0, 0], [1, 0], [0, 1], [1, 1]].map(|[c, r]| [columns[c] << 2, rows[r] << 2]) {
            let tan_right = ((column as f64 - self.centre[0]) as f32) * self.per_pixel;
            let tan_up = ((self.centre[1] - row as f64) as f32) * self.per_pixel;
            most = at_least(most, self.square(tan_right, tan_up));
        }
        most * 1.000_1
    }

    /// Returns the square of the length of the direction at these tangents to the right and upward.
    #[inline(always)]
    pub(crate) fn square(&self, tan_right: f32, tan_up: f32) -> f32 {
        let mut squares = [0.0; 3];
        for a in 0..3 {
            let along = (self.forward[a] + self.right[a] * tan_right) + self.up[a] * tan_up;
            squares[a] = along * along;
        }
        (squares[0] + squares[1]) + squares[2]
    }

    /// Returns the optical depth of a kernel on each ray, in units of ln 2 like `peak`, the depth of its voxel.
    #[inline(always)]
    pub(crate) fn depths<const N: usize>(&self, kernel: &NearKernel, rays: &PixelRays<N>, peak: f32) -> [f32; N] {
        let [x, y, z] = kernel.offset;
        let mut depths = [0.0; N];
        for i in 0..N {
            let [u, v, w] = [rays.direction[0][i], rays.direction[1][i], rays.direction[2][i]];
            let cross = [y * w - z * v, z * u - x * w, x * v - y * u];
            let exponent = self.factor * ((cross[0] * cross[0] + cross[1] * cross[1]) + cross[2] * cross[2]);
            let t = (x * u + y * v) + z * w;
            let is_in_front = t > 0.0;
            // Beyond the cut-off the exponential may be meaningless, and `keep_if` replaces it by 0.
            let whole = keep_if(is_in_front & (exponent <= self.cut), exp2_neg(exponent));
            let tail = kernel.at_eye * tail_ratio(t.abs() * self.per_sigma);
            let weight = at_least(whole + if is_in_front { -tail } else { tail }, 0.0);
            depths[i] = ray_depth(peak, self.strength * rays.lengths.stretch[i]) * weight;
        }
        depths
    }
}

/// Returns the largest optical depth of a kernel of this peak on rays of this stretch.
#[inline(always)]
pub(crate) fn ray_depth(peak: f32, stretch: f32) -> f32 {
    at_most(peak * stretch, MAX_DEPTH as f32 * LOG2_E)
}

/// Returns `exp(z^2 / 2) Phi(-z)` for `z` in 0..=6, Phi the normal distribution; relative error at most 5e-7.
///
/// Source: a Remez polynomial in `1 / (1 + 0.28 z)`, computed for this file.
#[inline(always)]
fn tail_ratio(z: f32) -> f32 {
    let q = 1.0 / (1.0 + 0.28 * z);
    let square = q * q;
    let low = -0.001_111_21 + 0.125_905_96 * q;
    let middle = 0.035_174_4 + 0.327_135_5 * q;
    let high = (-0.294_952_74 + 0.420_143_79 * q) + -0.112_295_58 * square;
    low + square * (middle + square * high)
}

/// Returns the smallest and largest tangent, `along . p / (forward . p)`, of points p in front of the eye's plane that
/// lie in the ball of `radius` around `centre`; `None` if no point lies in front.
///
/// All are in voxel coordinates with the eye at 0; the eye is outside the ball. An end is infinite where the ball reaches
/// the eye's plane.
fn tangents(along: DVec3, forward: DVec3, centre: DVec3, radius: f64) -> Option<[f64; 2]> {
    let (aside, depth) = (along.dot(centre), forward.dot(centre));
    let square = radius * radius;
    // The plane of all rays of tangent x touches the ball where a x^2 - 2 b x + c = 0; it cuts the ball where that is
    // below 0.
    let a = depth * depth - square * forward.length_squared();
    let b = aside * depth - square * along.dot(forward);
    let c = aside * aside - square * along.length_squared();
    let root = (b * b - a * c).max(0.0).sqrt();
    if a > 1e-9 * depth * depth {
        return (depth > 0.0).then(|| [(b - root) / a, (b + root) / a]);
    }
    if c <= 0.0 {
        return Some([f64::NEG_INFINITY, f64::INFINITY]);
    }
    // All of the ball is on one side, from the tangent of the plane that touches its front to infinity.
    let b = b.copysign(b * aside);
    let least = if b > 0.0 { c / (b + root) } else { (b - root) / a.min(-f64::MIN_POSITIVE) };
    Some(if aside > 0.0 { [least, f64::INFINITY] } else { [f64::NEG_INFINITY, -least] })
}

/// Returns the pixels from `first` to `last` in the range from `low` to `high`, and one more on either side for rounding;
/// `None` if there are none.
fn meeting([first, last]: [i32; 2], [low, high]: [f64; 2]) -> Option<[i32; 2]> {
    // A cast of infinity gives the integer nearest to it.
    let pixels = [first.max((low - 1.0).floor() as i32), last.min((high + 1.0).ceil() as i32)];
    (pixels[0] <= pixels[1]).then_some(pixels)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::splat::{Camera, Projection, Quality};
    use crate::volume::Grid;

    /// A view with the eye among voxels of unequal spacings.
    fn view(fov: f64, quality: Quality) -> View {
        view_of_slices(0.7, fov, quality)
    }

    /// The same, with slices that are so far apart.
    fn view_of_slices(apart: f64, fov: f64, quality: Quality) -> View {
        let grid = Grid::new([40, 40, 40], [1.0, 1.5, apart]).unwrap();
        let eye = [20.3, 30.0, 20.14 * apart];
        let target = [26.0, 22.0, eye[2] + 4.9];
        let camera = Camera::new(eye, target, [0.1, 0.2, 1.0], Projection::Perspective { fov });
        View::new(&camera.unwrap(), &grid, [48, 31], quality.kernel(), None).unwrap()
    }

    fn kernels(view: &View, near: &EyeRays) -> Vec<NearKernel> {
        let PixelMap::Perspective { camera_from_voxel: [_, _, forward], near: far, .. } = view.map else { panic!() };
        let mut kernels = Vec::new();
        for index in 0..40 * 40 * 40 {
            let voxel = [index % 40, index / 40 % 40, index / 1600].map(f64::from);
            let depth = crate::splat::view::apply(&forward, voxel);
            kernels.extend((depth < far).then(|| near.kernel(voxel, depth)).flatten());
        }
        kernels
    }

    #[test]
    fn a_near_voxel_has_the_integral_of_its_kernel_from_the_eye_on() {
        for quality in [Quality::Standard, Quality::Reference] {
            let (view, KernelShape { sigma, radius }) = (view(100.0, quality), quality.kernel());
            let near = EyeRays::new(&view, quality.kernel()).unwrap();
            let [sigma, radius] = [sigma, radius].map(f64::from);
            let most = f64::from(quality.kernel().normalisation()) / (sigma * sigma) * f64::from(LOG2_E);
            let mut worst = 0.0f64;
            for kernel in kernels(&view, &near) {
                let offset = DVec3::from_array(kernel.offset.map(f64::from));
                for pixel in (0..48 * 31).step_by(37) {
                    let [column, row] = [pixel % 48, pixel / 48];
                    let rays = near.rays([column], [row]);
                    let [depth] = near.depths(&kernel, &rays, LOG2_E);
                    let is_in_box = (kernel.columns[0]..=kernel.columns[1]).contains(&column)
                        && (kernel.rows[0]..=kernel.rows[1]).contains(&row);
                    assert!(is_in_box || depth == 0.0, "{offset} at {column}, {row}");
                    let tangents = [f64::from(column) - 23.5, 15.0 - f64::from(row)].map(|at| at / near.focal);
                    let [right, up, forward] =
                        [near.right, near.up, near.forward].map(|axis| DVec3::from_array(axis.map(f64::from)));
                    let direction = (right * tangents[0] + up * tangents[1] + forward).normalize();
                    let stretch = DVec3::from_array(near.gradients.map(|axis| axis.dot(direction))).length();
                    let (t, aside) = (offset.dot(direction), offset.cross(direction).length());
                    if (aside - radius).abs() < 1e-4 || (offset.length() - radius).abs() < 1e-4 {
                        continue;
                    }
                    // The midpoint rule; the eye is at most six standard deviations from a kernel that it cuts.
                    let integral = |step: f64| -> f64 {
                        let at = |index: u32| (f64::from(index) + 0.5) * step - t;
                        let steps = (14.0 * sigma / step) as u32;
                        let sum: f64 = (0..steps).map(|index| (-0.5 * (at(index) / sigma).powi(2)).exp()).sum();
                        sum * step / (sigma * std::f64::consts::TAU.sqrt())
                    };
                    let part = match offset.length() > radius {
                        true => f64::from(u8::from(t > 0.0)),
                        false => integral(sigma / 500.0),
                    };
                    let line = (-0.5 * (aside / sigma).powi(2)).exp();
                    let exact = if aside <= radius { most * stretch * line * part } else { 0.0 };
                    worst = worst.max((f64::from(depth) - exact).abs() / most);
                }
            }
            // Single precision rounds a place 8 voxels away by 5e-7, where a kernel may fall by 0.9 a voxel.
            assert!(worst < 4e-6, "{quality:?}: {worst:e}");
        }
    }

    #[test]
    fn boxes_and_chords_of_near_voxels_hold_all_their_pixels_in_wide_views() {
        for (fov, apart) in [(3.0, 0.7), (60.0, 0.7), (120.0, 0.7), (170.0, 0.7), (60.0, 30.0), (120.0, 30.0)] {
            let view = view_of_slices(apart, fov, Quality::Standard);
            let near = EyeRays::new(&view, Quality::Standard.kernel()).unwrap();
            let kernels = kernels(&view, &near);
            assert!(kernels.len() > 20, "{fov}");
            let (mut box_pixels, mut chord_pixels) = (0, 0);
            for kernel in kernels {
                let ([left, right], [top, bottom]) = (kernel.columns, kernel.rows);
                let drawn = |row: i32| {
                    let columns: [i32; 48] = std::array::from_fn(|column| column as i32);
                    near.depths(&kernel, &near.rays(columns, [row; 48]), 1.0).map(|depth| depth > 0.0)
                };
                for row in 0..31 {
                    let [from, to] = near.chord(&kernel, [row; 4]);
                    for (column, is_drawn) in (0..).zip(drawn(row)) {
                        let is_in_box = (left..=right).contains(&column) && (top..=bottom).contains(&row);
                        let is_on_chord = (from..=to).contains(&column);
                        assert!(is_in_box && is_on_chord || !is_drawn, "{fov}: {:?} at {column}, {row}", kernel.offset);
                        box_pixels += u32::from(is_in_box);
                        chord_pixels += u32::from(is_in_box && is_on_chord);
                    }
                }
            }
            // Long voxels fill little of their boxes.
            assert!(
                chord_pixels <= if apart > 1.0 { box_pixels / 2 } else { box_pixels },
                "{fov}, {apart}: {chord_pixels}"
            );
        }
    }

    #[test]
    fn an_eye_on_a_voxel_sees_half_of_it() {
        let view = view(60.0, Quality::High);
        let near = EyeRays::new(&view, Quality::High.kernel()).unwrap();
        let kernel = near.kernel(near.eye.to_array(), 0.0).unwrap();
        let rays = near.rays([3], [5]);
        let [depth] = near.depths(&kernel, &rays, 1.0);
        let most = near.strength * rays.lengths.stretch[0];
        assert!((depth / most - 0.5).abs() < 1e-6, "{depth}");
    }
}
