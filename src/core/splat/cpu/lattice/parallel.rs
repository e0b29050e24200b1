//! The lattice of a parallel view: its pixels are whole parts of voxels, alike in all slices.
//!
//! In: what is to be shown. Out: the plane, or none if the slices are seen too obliquely or it would be too large.

use glam::DVec3;

use super::choose::LatticeView;
use super::low_pass::LowPass;
use super::resolution::{EdgeRays, SMALL_STEP};
use super::{Lattice, PlaneRays};
use crate::splat::view::PixelMap;

/// Slices are in phase if a ray moves by a whole number of voxels per slice, up to this many voxels: along an axis, and along
/// diagonals. All slices then have pixels at the same places beside their voxels, and errors add up instead of averaging out,
/// unless voxels are small.
const IN_PHASE: f64 = 0.05;
/// The most voxels to a tile if slices are in phase, for [`Sampling::Enough`](crate::splat::Sampling::Enough) and
/// [`Sampling::Fewest`](crate::splat::Sampling::Fewest); and if not.
const MOST_IN_PHASE: [f64; 2] = [2.0, 32.0];
const MOST_VOXELS: f64 = 32.0;
/// How many times as many voxels a tile may have one way as the other, if they lie on points of the grid. With twice as many, opaque
/// labels of unlike spacings were 3 dB farther from `reference` (frog at 400 x 400, azimuth 50, elevation 20: 43.8 instead of 47.2).
const LONGEST: f64 = 1.5;

/// Largest standard deviation of the low-pass: a plane that is seen obliquely is halved less.
const WIDEST: f64 = 2.0;

/// Returns the plane, if there is one.
pub(super) fn plane(lattice_view: &LatticeView) -> Option<Lattice> {
    let LatticeView { view, slow_fast_medium: [slow, fast, medium], low, high, reach, kernel, .. } = *lattice_view;
    let PixelMap::Parallel { pixel_from_voxel: [x, y], scale } = &view.map else { return None };
    let area = x[fast] * y[medium] - x[medium] * y[fast];
    // From pixels of the picture to voxels along the fast and the medium axis.
    let inverse = [[y[medium] / area, -x[medium] / area], [-y[fast] / area, x[fast] / area]];
    let transform = |[a, b]: [f64; 2], [p, q]: [f64; 2]| a * p + b * q;
    // A voxel's point on the plane moves by this per slice, and a ray by the opposite.
    let shift = inverse.map(|row| transform(row, [x[slow], y[slow]]));
    // A shift above 1 means that the view runs along another axis than the slow one.
    if !shift.iter().all(|shift| shift.abs() < 1.001) {
        return None;
    }
    let steps = [fast, medium].map(|axis| x[axis].hypot(y[axis]));
    let rays = EdgeRays { slopes: shift, slice: scale * scale / area.abs() };
    let voxels = voxels_per_tile(lattice_view, &rays, steps);
    let per_voxel = voxels.map(|voxels| 4.0 / voxels);
    let moves = [0, 1].map(|side: usize| inverse[side].map(|moves| per_voxel[side] * moves));
    let low_pass = LowPass::new(moves, &[], lattice_view.width);
    if low_pass.deviation * low_pass.most_per_pixel > WIDEST {
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
        let ends = [low[0], high[0]].map(|at| shift[side] * at);
        let box_low = low[1 + side] + ends[0].min(ends[1]) - reach;
        let box_high = high[1 + side] + ends[0].max(ends[1]) + reach;
        let (low, high) = (box_low.max(shown_low - 2.0), box_high.min(shown_high + 2.0));
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
    let rays = PlaneRays::Parallel {
        voxels,
        slope: shift.map(|shift| -shift),
        origin: [0, 1].map(|side: usize| first[side] / per_voxel[side]),
        strength: (f64::from(kernel.normalisation()) * scale * scale / cross) as f32,
    };
    Some(lattice_view.lattice(size, plane_from_pixel, low_pass, rays))
}

/// Returns how many voxels a tile has along the fast and the medium axis: as many as [`stamped`] says if they lie on points of the grid.
///
/// `steps`: the distances between voxels along these axes, in pixels of the picture.
fn voxels_per_tile(lattice_view: &LatticeView, rays: &EdgeRays, steps: [f64; 2]) -> [f64; 2] {
    let is_whole = |slope: &f64| (slope - slope.round()).abs() < IN_PHASE;
    let is_displaced = lattice_view.view.margin > 0.0;
    let is_in_phase = match is_displaced {
        true => rays.slopes.iter().any(is_whole),
        false => rays.slopes.iter().all(is_whole) && steps[0].max(steps[1]) > SMALL_STEP,
    };
    let most = if is_in_phase { lattice_view.sampling.pick(MOST_IN_PHASE) } else { MOST_VOXELS };
    let voxels = [0, 1].map(|side: usize| {
        let voxels = 4.0 / lattice_view.resolution.per_voxel(side, rays, steps[side], false);
        let voxels = match (is_displaced, is_in_phase) {
            (true, false) => voxels,
            // Each pixel has the same place in the blocks of all slices, and divisors of a tile are better than 3. Between 2 and
            // 2.5, engine has 0.5 dB less with 2 than with 1.
            (true, true) if voxels < 2.5 => 1.0,
            (true, true) if voxels < 3.9 => 2.0,
            (true, true) => 4.0,
            (false, _) => stamped(voxels + 0.1),
        };
        voxels.clamp(1.0, most)
    });
    let longest = stamped(LONGEST * voxels[0].min(voxels[1]));
    if is_displaced { voxels } else { voxels.map(|voxels| voxels.min(longest)) }
}

/// Returns the most voxels that a tile may have for its stamps, up to a number: whole, or one and a half. Halves of more voxels save
/// fewer pixels than the stamps of two kinds of tiles take. Measured: docs/studies/sampling.md.
fn stamped(voxels: f64) -> f64 {
    if (1.5..2.0).contains(&voxels) { 1.5 } else { voxels.floor() }
}
