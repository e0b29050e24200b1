//! Chooses the lattice of a view, or none: how many pixels it has, and how its picture is filtered.
//!
//! In: a view of the voxels in a box, the order of its walk, and settings. Out: a [`Lattice`].

use glam::{DMat3, DVec3};

use super::warp::MOST_ASIDE;
use super::{Lattice, LowPass, Rays};
use crate::splat::block_kernel::SHAPES;
use crate::splat::kernel::{KernelShape, LOW_PASS};
use crate::splat::near::NEAR;
use crate::splat::supersample::sigma_at_centre;
use crate::splat::view::{MAX_SIZE, PixelMap, View};
use crate::splat::{Blending, Mode, Sampling, Settings};
use crate::traverse::{Order, Sense, Viewpoint, VoxelBox};

/// Width of the plane's margin around the voxels, in its pixels after halving, so that the voxels' edge is interpolated
/// correctly.
const MARGIN: f64 = 6.0;
/// A plane is worthwhile if it has at most so many pixels for each pixel of the picture.
const MAX_PIXELS: f64 = 6.5;
/// If pixels are averaged, it is also worthwhile if at most so many are kept for the warp. They take 36 to 68 MiB.
const FEW_PIXELS: f64 = 2_097_152.0;
/// Standard deviation of the low-pass in the picture's middle, along columns and along rows of the plane, above which the
/// plane is halved first; in the plane's pixels.
const WIDE: f64 = 1.4;
/// Smallest one at which the pixels lie so near to each other that none is missed.
const NARROW: f64 = 0.62;
/// The same, at most, in the picture's middle, after halving: a plane that is seen obliquely is halved less.
const WIDE_SLANTED: f64 = 2.0;
/// Least width of a pixel of the picture on the halved plane, where a line along an axis crosses it, as a standard deviation in pixels of
/// the plane; and the least of the filter that is left to do.
const THIN: f64 = 0.6;
const THINNEST: f64 = 0.45;
/// Largest standard deviation where the picture shows the box of the voxels, for [`Sampling::Enough`] and [`Sampling::Fewest`]: the
/// warp takes four pixels on each side. Drafts had 28 dB where it was above 100, and 33 dB at 8.
const WIDEST: [f64; 2] = [3.0, 8.0];
/// Tangent of half of 75 degrees, and some rounding: above it an angle of view is wide, and the limits below hold.
const WIDE_ANGLE: f64 = 0.768;
/// Least width of a footprint, in pixels, for which they hold: that of the low-pass on sixteen samples a pixel's side.
const LEAST_WIDE: f64 = 0.0375;
/// The most that [`unevenness`] may be at any corner of the box, in kernels, for [`Sampling::Enough`] and [`Sampling::Fewest`].
/// Measured: docs/studies/sampling.md.
const MOST_UNEVEN: [f64; 2] = [0.015, 0.036];
/// Least standard deviation where the picture shows the box, along an axis that takes the plane's pixels as they are, for
/// [`Sampling::Enough`] and [`Sampling::Fewest`]: below, weights are those of one pixel, or alike for eight.
const NARROWEST: [f64; 2] = [0.5, 0.3];
/// Least distance from the eye to the nearest slice, in voxels: nearer slices are seen under too many angles.
const NEAREST: f64 = 8.0;

/// Pixels of the plane per standard deviation of the kernel, where the picture shows all detail of matter that is not opaque:
/// for [`Sampling::Enough`] and [`Sampling::Fewest`]. Measured: docs/studies/sampling.md.
const WIDE_VOXELS: [f64; 2] = [0.93, 0.62];
/// The same where voxels are small.
const SMALL_VOXELS: f64 = 0.7;
/// The same where they are small and lie beside the points of the grid, as those of levels (docs/studies/levels.md).
const SMALL_VOXELS_BESIDE: f64 = 0.4;
/// The most pixels of the plane that are worthwhile per pixel of the picture, along a side, unless voxels are small.
const PER_PIXEL: f64 = 1.35;
/// The same where a filter follows and voxels are opaque, as their edges are finer than the filter; and the sharpness from
/// which on they are.
const PER_FILTERED_PIXEL: f64 = 1.6;
const SHARP: f64 = 1.3;
/// A face along the grid is seen edge-on if rays pass at least so many slices within one voxel beside it. Its outline is that of
/// the optical depths of all these voxels together, up to the most: it is hardly sharper where they are deeper.
const LEAST_BEHIND: f64 = 12.0;
const MOST_BEHIND: f64 = 48.0;
/// Sharpness of such an outline per standard deviation of the kernel that its depth reaches out. Measured: docs/studies/sampling.md.
const EDGE_ON: f64 = 0.7;
/// The most pixels of the plane per pixel of the picture across such an outline, unless voxels are small: for [`Sampling::Enough`] and
/// [`Sampling::Fewest`].
const PER_PIXEL_EDGE_ON: [f64; 2] = [2.1, 1.7];
/// Slices are in phase if a ray moves by a whole number of voxels per slice, up to this many voxels: along an axis, and along
/// diagonals. All slices then have pixels at the same places beside their voxels, and errors add up instead of averaging out,
/// unless voxels are small.
const IN_PHASE: f64 = 0.05;
/// How many times as many voxels a tile may have one way as the other, if they lie on points of the grid. With twice as many, opaque
/// labels of unlike spacings were 3 dB farther from `reference` (frog at 400 x 400, azimuth 50, elevation 20: 43.8 instead of 47.2).
const LONGEST: f64 = 1.5;
/// The same in a perspective, which may run along an axis in its middle: there 1.5 lost 1.6 dB (azimuth 90, elevation 0).
const LONGEST_FAR: f64 = 1.25;
/// Distance between voxels, in pixels of the picture, up to which the picture shows no such edges.
const SMALL_STEP: f64 = 0.76;
/// Least distance between voxels, in pixels of the picture, at which a perspective x-ray is drawn on a plane: nothing
/// hides a voxel there, and smaller footprints are drawn faster on the picture's own pixels.
const LEAST_SUMMED_STEP: f64 = 1.5;

impl Lattice {
    /// Returns the lattice of a view of the voxels in `bounds`; `deepest` is the largest optical depth of any of them,
    /// along a ray as long as the mean spacing.
    ///
    /// `None` if `settings` ask for other samples, another mode or another direction, if `order` is not the view's own,
    /// if the eye is among or near the slices, if the plane is seen too obliquely, or if it would have to be too large.
    pub(in super::super) fn new(
        view: &View,
        order: &Order,
        bounds: &VoxelBox,
        deepest: f64,
        settings: &Settings,
    ) -> Option<Lattice> {
        let of_sampling = match settings.sampling() {
            Sampling::EveryPixel | Sampling::Finer => return None,
            Sampling::Enough => 0,
            Sampling::Fewest => 1,
        };
        let wide = WIDE_VOXELS[of_sampling];
        let is_drawn = match settings.mode {
            Mode::Composite => settings.sense == Sense::FrontToBack && settings.blending == Blending::Exponential,
            Mode::Additive => settings.blending == Blending::Exponential,
            Mode::Maximum | Mode::MaximumGrey => false,
        };
        if !is_drawn {
            return None;
        }
        let kernel = settings.kernel_of_depth(deepest, view);
        let nested = [order.slow.index(), order.fast.index(), order.medium.index()];
        let widths = settings.blocks.widths(settings.fine_kernel());
        let squares = nested.map(|axis| std::array::from_fn(|shape| widths.of(shape)[axis].powi(2)));
        // Standard deviations of the widest kernels along the fast and the medium axis.
        let sigmas = [1, 2].map(|n: usize| f64::from(kernel.sigma * widths.of(0)[nested[n]]));
        // The edge of what is opaque rises faster than its footprint; a picture of small voxels shows no such edges.
        let peak = deepest / (std::f64::consts::TAU * sigmas[0] * sigmas[1]);
        let sharpness = (2.0 * peak.max(1.0).ln()).sqrt().max(1.0);
        let width = f64::from(sigma_at_centre(view, bounds, settings));
        let is_fine = sharpness > SHARP && width < f64::from(LOW_PASS) && settings.sampling() == Sampling::Enough;
        let per_pixel = if is_fine { PER_FILTERED_PIXEL } else { PER_PIXEL };
        let slices = f64::from(bounds.high[nested[0]] - bounds.low[nested[0]]) + 1.0;
        // An overexposed x-ray shows where sums begin, far out on the kernels.
        if settings.mode == Mode::Additive && sharpness > 1.0 {
            return None;
        }
        // Sums have no outlines, and those of levels are only as exact as their blocks.
        let has_outlines = settings.mode == Mode::Composite && view.margin == 0.0;
        let small = if view.margin > 0.0 { SMALL_VOXELS_BESIDE } else { SMALL_VOXELS };
        let choose = |side: usize, rays: &RaysBeside, step: f64, is_far: bool| {
            let edge = if has_outlines { rays.edge_sharpness(side, deepest, slices) } else { 0.0 };
            let per_pixel = if edge > 1.0 && step > SMALL_STEP { PER_PIXEL_EDGE_ON[of_sampling] } else { per_pixel };
            let least = if is_far { 0.0 } else { small };
            (wide * sharpness.max(edge)).min(least.max(per_pixel * step * sigmas[side])) / sigmas[side]
        };
        let extent = BoxExtent::new(bounds, nested, kernel);
        let plane = match &view.map {
            PixelMap::Parallel { .. } => {
                let in_phase = if settings.sampling() == Sampling::Enough { 2.0 } else { 32.0 };
                parallel(view, nested, &extent, choose, in_phase, (kernel, squares), width)?
            }
            PixelMap::Perspective { .. } => {
                if settings.mode == Mode::Additive && width < LEAST_SUMMED_STEP * f64::from(kernel.sigma) {
                    return None;
                }
                // An x-ray is not steep at outlines, as opaque matter is.
                let most_uneven = MOST_UNEVEN[if settings.mode == Mode::Additive { 1 } else { of_sampling }];
                let limits = [WIDEST[of_sampling], NARROWEST[of_sampling], most_uneven];
                perspective(view, width, limits, nested, &extent, choose, (kernel, squares))?
            }
        };
        let pixels = |size: [u32; 2]| f64::from(size[0]) * f64::from(size[1]);
        let is_small = match plane.low_pass.is_averaged() {
            true => pixels(plane.kept()) <= FEW_PIXELS,
            false => pixels(plane.size) <= 65_536.0,
        };
        (is_small || pixels(plane.size) <= MAX_PIXELS * pixels(view.size)).then_some(plane)
    }
}

/// Rays beside faces of the box of the voxels.
struct RaysBeside {
    /// By how many voxels they move per slice, along the fast and the medium axis.
    slopes: [f64; 2],
    /// Their length from slice to slice, in mean spacings.
    slice: f64,
}

impl RaysBeside {
    /// Returns how much finer than the kernel's the outline of faces across the fast (`side` 0) or medium axis (1) is, if they are
    /// seen edge-on; else 0. `deepest`: the largest optical depth of a voxel; `slices`: of the box.
    fn edge_sharpness(&self, side: usize, deepest: f64, slices: f64) -> f64 {
        let behind = slices.min(1.0 / self.slopes[side].abs());
        if behind < LEAST_BEHIND {
            return 0.0;
        }
        // The depth beside a face is a half-space's, seen through the kernel: at x standard deviations from it about
        // exp(-x^2 / 2) / 4 of that within, where x is 1.5 to 3. So it is 1 at this x.
        let depth = (deepest * self.slice * behind).min(MOST_BEHIND);
        EDGE_ON * (2.0 * (depth / 4.0).max(1.0).ln()).sqrt()
    }
}

/// The box of the voxels, along the slow, fast and medium axis, and how far kernels reach out of it.
struct BoxExtent {
    low: [f64; 3],
    high: [f64; 3],
    reach: f64,
}

impl BoxExtent {
    fn new(bounds: &VoxelBox, nested: [usize; 3], kernel: KernelShape) -> BoxExtent {
        BoxExtent {
            low: nested.map(|axis| f64::from(bounds.low[axis])),
            high: nested.map(|axis| f64::from(bounds.high[axis])),
            reach: f64::from(kernel.radius) * 1.5 + 1.0,
        }
    }
}

impl LowPass {
    /// `moves`: how far a place on the plane moves, along columns and along rows, per column and per row of the picture; `width`: the
    /// standard deviation of the narrowest footprint in pixels of the picture.
    ///
    /// `None` if the plane is seen so obliquely that a pixel of the picture is a long, thin, slanted ellipse on it.
    fn new(moves: [[f64; 2]; 2], width: f64) -> Option<LowPass> {
        let variance = (f64::from(LOW_PASS * LOW_PASS) - width * width).max(0.0);
        let deviation = variance.sqrt();
        let deviations = moves.map(|[x, y]| deviation * x.hypot(y));
        // The ellipse's width, where a line along an axis crosses its middle, as a share of its whole extent along that axis.
        let across = deviation * deviation * (moves[0][0] * moves[1][1] - moves[0][1] * moves[1][0]).abs();
        let share = if deviation > 0.0 { across / (deviations[0] * deviations[1]) } else { 1.0 };
        // Voxels of unlike spacings may have a plane that is much finer one way than the other.
        let halvings = deviations.map(|deviation| {
            let wanted = (deviation / WIDE).log2().ceil();
            wanted.min((deviation * share / THIN).log2().floor()).clamp(0.0, 12.0) as u32
        });
        let kept = |side: usize| moves[side].map(|moves| moves / f64::from(1u32 << halvings[side]));
        let [[a, b], [c, d]] = [kept(0), kept(1)];
        // Covariance in pixels of what is kept. The mean of 2^n pixels is a filter, too.
        let of_mean = halvings.map(|halvings| (1.0 - 0.25f64.powi(halvings as i32)) / 12.0);
        let squares = [variance * (a * a + b * b) - of_mean[0], variance * (c * c + d * d) - of_mean[1]];
        let mixed = variance * (a * c + b * d);
        let (finer, coarser) = if squares[0] > squares[1] { (0, 1) } else { (1, 0) };
        let mut is_wide = squares.map(|square| square >= NARROW * NARROW);
        if is_wide[finer] {
            // The variance along the finer axis less that on a line along this axis.
            let slant = mixed * mixed / squares[coarser].max(f64::MIN_POSITIVE);
            let thinnest = if is_wide[coarser] {
                squares[coarser] - mixed * mixed / squares[finer]
            } else {
                squares[finer] - slant
            };
            let is_thin = thinnest < THINNEST * THINNEST;
            let is_slanted = if is_wide[coarser] { is_thin } else { slant > NARROW * NARROW };
            if squares[finer] > WIDE_SLANTED * WIDE_SLANTED || is_slanted {
                return None;
            }
            is_wide[finer] = !is_thin;
        }
        let ([xx, yy], area) = (squares, a * d - b * c);
        let covariance = [
            d * d * xx - 2.0 * b * d * mixed + b * b * yy,
            -c * d * xx + (a * d + b * c) * mixed - a * b * yy,
            c * c * xx - 2.0 * a * c * mixed + a * a * yy,
        ];
        let covariance = covariance.map(|part| part / (area * area));
        Some(LowPass { halvings, covariance, is_wide, deviation })
    }

    /// Returns whether pixels of the plane are so fine that not all are kept, or that they are averaged as they are.
    fn is_averaged(&self) -> bool {
        self.is_wide != [false; 2] || self.halvings != [0; 2]
    }

    /// Returns the first pixel of a plane that covers what lies between `low` and `high` pixels along columns (`side` 0) or rows (1),
    /// and how many there are.
    fn pixels_between(self, side: usize, low: f64, high: f64) -> Option<(f64, u32)> {
        let margin = MARGIN * f64::from(1u32 << self.halvings[side]);
        let first = low.floor() - margin;
        let pixels = (high.ceil() - first + margin + 1.0).max(2.0 * margin);
        (pixels <= f64::from(MAX_SIZE) - 4.0).then_some((first, (pixels as u32).next_multiple_of(4)))
    }
}

fn parallel(
    view: &View,
    [slow, fast, medium]: [usize; 3],
    extent: &BoxExtent,
    choose: impl Fn(usize, &RaysBeside, f64, bool) -> f64,
    most_voxels_in_phase: f64,
    (kernel, squares): (KernelShape, [[f32; SHAPES]; 3]),
    width: f64,
) -> Option<Lattice> {
    let PixelMap::Parallel { pixel_from_voxel: [x, y], scale } = &view.map else { return None };
    let area = x[fast] * y[medium] - x[medium] * y[fast];
    // From pixels of the picture to voxels along the fast and the medium axis.
    let inverse = [[y[medium] / area, -x[medium] / area], [-y[fast] / area, x[fast] / area]];
    let transform = |[a, b]: [f64; 2], [p, q]: [f64; 2]| a * p + b * q;
    // A voxel's point on the plane moves by this per slice, and a ray by the opposite.
    let shift = inverse.map(|row| transform(row, [x[slow], y[slow]]));
    let steps = [fast, medium].map(|axis| x[axis].hypot(y[axis]));
    let step = steps[0].max(steps[1]);
    let is_whole = |shift: &f64| (shift - shift.round()).abs() < IN_PHASE;
    let is_beside = view.margin > 0.0;
    let is_in_phase = match is_beside {
        true => shift.iter().any(is_whole),
        false => shift.iter().all(is_whole) && step > SMALL_STEP,
    };
    let most_voxels = if is_in_phase { most_voxels_in_phase } else { 32.0 };
    let rays = RaysBeside { slopes: shift, slice: scale * scale / area.abs() };
    let voxels = [0, 1].map(|side: usize| {
        let voxels = 4.0 / choose(side, &rays, steps[side], false);
        let voxels = match (is_beside, is_in_phase) {
            (true, false) => voxels,
            // Each pixel has the same place in the blocks of all slices, and divisors of a tile are better than 3. Between 2 and
            // 2.5, engine has 0.5 dB less with 2 than with 1.
            (true, true) if voxels < 2.5 => 1.0,
            (true, true) if voxels < 3.9 => 2.0,
            (true, true) => 4.0,
            // Stamps need a whole number.
            (false, _) => (voxels + 0.1).floor(),
        };
        voxels.clamp(1.0, most_voxels)
    });
    let most = (LONGEST * voxels[0].min(voxels[1])).floor();
    let voxels = if is_beside { voxels } else { voxels.map(|voxels| voxels.min(most)) };
    let per_voxel = voxels.map(|voxels| 4.0 / voxels);
    // A shift above 1 means that the view runs along another axis than the slow one.
    if !shift.iter().all(|shift| shift.abs() < 1.001) {
        return None;
    }
    let low_pass = LowPass::new([0, 1].map(|side: usize| inverse[side].map(|moves| per_voxel[side] * moves)), width)?;
    if !low_pass.is_averaged() && per_voxel[0] * per_voxel[1] / area.abs() > MAX_PIXELS {
        return None;
    }
    let [columns, rows] = view.size.map(f64::from);
    let corners = [[0.0, 0.0], [columns, 0.0], [0.0, rows], [columns, rows]]
        .map(|[across, down]: [f64; 2]| [across - 0.5 - x[3], down - 0.5 - y[3]]);
    let (mut size, mut first) = ([0; 2], [0.0; 2]);
    for side in 0..2 {
        // The plane covers only what both the picture shows and the voxels occupy.
        let shown = corners.map(|corner| transform(inverse[side], corner));
        let shown_low = shown.into_iter().fold(f64::INFINITY, f64::min);
        let shown_high = shown.into_iter().fold(-f64::INFINITY, f64::max);
        let ends = [extent.low[0], extent.high[0]].map(|at| shift[side] * at);
        let low = extent.low[1 + side] + ends[0].min(ends[1]) - extent.reach;
        let high = extent.high[1 + side] + ends[0].max(ends[1]) + extent.reach;
        let (low, high) = (low.max(shown_low - 2.0), high.min(shown_high + 2.0));
        (first[side], size[side]) = low_pass.pixels_between(side, low * per_voxel[side], high * per_voxel[side])?;
        // If slices are in phase, pixels meet all of them at the same places. If there are two or more pixels a voxel, its
        // edges are right when they lie on both sides of its centre; else, when one lies on it. Measured:
        // docs/studies/sampling.md.
        first[side] += if voxels[side] < 3.0 { 0.5 } else { 0.0 };
    }
    let mut plane_from_pixel = [[0.0, 0.0, 1.0]; 3];
    for side in 0..2 {
        let [a, b]: [f64; 2] = inverse[side].map(|factor| factor * per_voxel[side]);
        plane_from_pixel[side] = [a, b, -first[side] - a * x[3] - b * y[3]];
    }
    let cross =
        DVec3::new(x[0], x[1], x[2]).cross(DVec3::new(y[0], y[1], y[2])).length() * f64::from(kernel.sigma).powi(2);
    let rays = Rays::Parallel {
        voxels,
        slope: shift.map(|shift| -shift),
        origin: [0, 1].map(|side: usize| first[side] / per_voxel[side]),
        strength: (f64::from(kernel.normalisation()) * scale * scale / cross) as f32,
    };
    Some(Lattice { size, picture: view.size, plane_from_pixel, low_pass, rays, kernel, spread: view.margin, squares })
}

fn perspective(
    view: &View,
    width: f64,
    [widest, narrowest, most_uneven]: [f64; 3],
    nested: [usize; 3],
    extent: &BoxExtent,
    choose: impl Fn(usize, &RaysBeside, f64, bool) -> f64,
    (kernel, squares): (KernelShape, [[f32; SHAPES]; 3]),
) -> Option<Lattice> {
    let (PixelMap::Perspective { camera_from_voxel, focal, centre, .. }, Viewpoint::Perspective { eye, .. }) =
        (&view.map, view.viewpoint)
    else {
        return None;
    };
    let eye = nested.map(|axis| eye[axis]);
    // Away from the eye, slices come in this direction.
    let away = if extent.low[0] > eye[0] { 1.0 } else { -1.0 };
    let distances = [extent.low[0], extent.high[0]].map(|slow| away * (slow - eye[0]));
    let (nearest, farthest) = (distances[0].min(distances[1]), distances[0].max(distances[1]));
    let is_apart = nearest >= NEAREST;
    let forward = &camera_from_voxel[2];
    let along = |n: usize| (forward[nested[n]] * extent.low[n]).min(forward[nested[n]] * extent.high[n]);
    let nearest_depth = forward[3] + along(0) + along(1) + along(2);
    // A clip cuts slices where the view does not run along the slow axis.
    if !is_apart || view.clip > nearest_depth {
        return None;
    }
    // The lattice is finer in near slices and coarser in far ones. Where these show all detail, it is fine enough there.
    // Toward the edges of a wide angle, the picture is stretched.
    let middle = 0.5 * (nearest + farthest);
    let tangent = 0.5 * f64::from(view.size[0].max(view.size[1])) / focal;
    let column = |axis: usize| DVec3::from_array([0, 1, 2].map(|row: usize| camera_from_voxel[row][axis]));
    let to_end = [0, 1, 2].map(|n: usize| [extent.low[n], extent.high[n]].map(|end| column(nested[n]) * end));
    let to_centre: DVec3 = to_end.as_flattened().iter().sum::<DVec3>() * 0.5 + column(3);
    let distance = to_centre.length();
    // Those farthest away, beside the faces of the box.
    let slopes = [1, 2].map(|n: usize| {
        let beside = [extent.low[n], extent.high[n]].map(|end| (end - eye[n]).abs());
        beside[0].min(beside[1]) / farthest
    });
    let rays = RaysBeside { slopes, slice: distance / middle };
    let step = [1, 2].map(|n: usize| {
        let largest_step = focal / distance * column(nested[n]).length() * (1.0 + tangent * tangent);
        let finest = choose(n - 1, &rays, largest_step, false) * middle;
        let finest = finest.max(choose(n - 1, &rays, largest_step * middle / farthest, true) * farthest);
        1.0 / finest
    });
    let step = step.map(|side| side.min(LONGEST_FAR * step[0].min(step[1])));
    // From a pixel's ray, in camera coordinates, to voxels along the slow (away from the eye), fast and medium axis.
    let steps = [column(nested[0]) * away, column(nested[1]), column(nested[2])];
    let voxel_from_camera = DMat3::from_cols(steps[0], steps[1], steps[2]).inverse();
    let camera_from_pixel = DMat3::from_cols(
        DVec3::new(1.0 / focal, 0.0, 0.0),
        DVec3::new(0.0, -1.0 / focal, 0.0),
        DVec3::new(-centre[0] / focal, centre[1] / focal, 1.0),
    );
    let voxel_from_pixel = voxel_from_camera * camera_from_pixel;
    let [columns, rows] = view.size.map(f64::from);
    // How far a place moves on the plane, along its columns and its rows, per column and per row of the picture.
    let moves = |x: f64, y: f64| {
        let at = voxel_from_pixel * DVec3::new(x, y, 1.0);
        let column = |k: usize| voxel_from_pixel.col(k);
        let along = |side: usize, k: usize| column(k)[side] - at[side] / at[0] * column(k)[0];
        [1, 2].map(|side: usize| [0, 1].map(|k| along(side, k) / (at[0] * step[side - 1])))
    };
    let low_pass = LowPass::new(moves(0.5 * columns, 0.5 * rows), width)?;
    // The part of the picture that shows the box; all of it if a corner is beside the eye or behind it.
    let seen = [0, 1, 2, 3, 4, 5, 6, 7].map(|corner: usize| {
        let at = |n: usize| to_end[n][corner >> n & 1];
        at(0) + at(1) + at(2) + column(3)
    });
    let is_ahead = seen.iter().all(|seen| seen.z > 0.0);
    // Of voxels that are smaller still, no other way of sampling has enough samples.
    let is_wide_angle = 0.5 * f64::from(view.size[1]) / focal > WIDE_ANGLE && width > LEAST_WIDE;
    let voxel_steps = DMat3::from_cols(column(0), column(1), column(2));
    let is_uneven = |toward: &DVec3| f64::from(kernel.sigma) * unevenness(*toward, voxel_steps) > most_uneven;
    if is_wide_angle && seen.iter().any(is_uneven) {
        return None;
    }
    let part = |end: f64, place: &dyn Fn(&DVec3) -> f64| {
        let places = seen.iter().filter(|_| is_ahead).map(place).map(|place| place.clamp(0.0, end));
        places.map(|place| [place; 2]).reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])]).unwrap_or([0.0, end])
    };
    let across = part(columns, &|seen| centre[0] + focal * seen.x / seen.z);
    let down = part(rows, &|seen| centre[1] - focal * seen.y / seen.z);
    let is_mixed = low_pass.is_wide[0] != low_pass.is_wide[1];
    let is_within = |[x, y]: [f64; 2]| {
        let moves = moves(x, y);
        [0, 1].into_iter().all(|side: usize| {
            let moved = moves[side][0].hypot(moves[side][1]) / f64::from(1u32 << low_pass.halvings[side]);
            let most = if is_mixed && !low_pass.is_wide[side] { MOST_ASIDE } else { widest };
            // Toward the edges of a wide angle, even voxels that are wide in the middle are as narrow as the low-pass.
            let deviation = if is_wide_angle { f64::from(LOW_PASS) } else { low_pass.deviation };
            let is_drawn = !is_wide_angle || !low_pass.is_wide[side] || low_pass.deviation * moved >= narrowest;
            deviation * moved <= most && is_drawn
        })
    };
    let ends = [[across[0], down[0]], [across[0], down[1]], [across[1], down[0]], [across[1], down[1]]];
    if !ends.into_iter().all(is_within) {
        return None;
    }
    let corners = [[0.0, 0.0], [columns, 0.0], [0.0, rows], [columns, rows]]
        .map(|[across, down]: [f64; 2]| (voxel_from_pixel * DVec3::new(across - 0.5, down - 0.5, 1.0)).to_array());
    let all_meet = corners.iter().all(|[slow, fast, medium]| *slow > 0.05 * fast.hypot(*medium));
    let (mut size, mut first) = ([0; 2], [0.0; 2]);
    for side in 0..2 {
        let slope = |at: f64, distance: f64| (at - eye[1 + side]) / distance;
        let (box_low, box_high) =
            (extent.low[1 + side] - 2.0 * extent.reach, extent.high[1 + side] + 2.0 * extent.reach);
        let mut low = slope(box_low, nearest).min(slope(box_low, farthest));
        let mut high = slope(box_high, nearest).max(slope(box_high, farthest));
        if all_meet {
            let shown = corners.map(|corner| corner[1 + side] / corner[0]);
            low = low.max(shown.into_iter().fold(f64::INFINITY, f64::min) - 2.0 * step[side]);
            high = high.min(shown.into_iter().fold(-f64::INFINITY, f64::max) + 2.0 * step[side]);
        }
        let (pixel, count) = low_pass.pixels_between(side, low / step[side], high / step[side])?;
        (first[side], size[side]) = (pixel * step[side], count);
    }
    let row = |index: usize| voxel_from_pixel.row(index);
    let plane = [0, 1].map(|side| ((row(1 + side) - row(0) * first[side]) / step[side]).to_array());
    let plane_from_pixel = [plane[0], plane[1], row(0).to_array()];
    let strength = f64::from(kernel.normalisation()) / f64::from(kernel.sigma).powi(2);
    let rays = Rays::Perspective { eye, first, step, steps, strength };
    Some(Lattice { size, picture: view.size, plane_from_pixel, low_pass, rays, kernel, spread: view.margin, squares })
}

/// Returns by what fraction the perspective shrinks the side of a kernel that is away from the eye, at one voxel from its centre along
/// the direction in which its footprint is slanted: 0 in the middle of the picture; of a kernel as round as its voxels, the sine of
/// the angle from there over the distance from the eye's plane, in voxels.
///
/// `toward`: from the eye to the kernel, to the right, upward and forward; `steps`: those of the voxels, in columns.
fn unevenness(toward: DVec3, steps: DMat3) -> f64 {
    let forward = steps.row(2);
    // Nearer voxels are integrated along rays in every picture.
    let depth = toward.z.max(NEAR * forward.length());
    let outward =
        steps.transpose() * DVec3::new(toward.x * depth, toward.y * depth, -toward.truncate().length_squared());
    outward.dot(forward).abs() / (outward.length() * depth).max(f64::MIN_POSITIVE)
}
