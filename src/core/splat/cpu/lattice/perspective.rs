//! The lattice of a perspective: its pixels are rays from the eye.
//!
//! In: what is to be shown. Out: the plane, or none if the eye is among or near the slices, if they are seen too obliquely, or if a voxel's
//! depth changes too much within a tile.

use glam::{DMat3, DVec3};

use super::choose::LatticeView;
use super::low_pass::LowPass;
use super::resolution::EdgeRays;
use super::tile_rays::stretch;
use super::{Lattice, PlaneRays};
use crate::splat::kernel::LOW_PASS;
use crate::splat::near::NEAR;
use crate::splat::view::PixelMap;
use crate::traverse::Viewpoint;

/// How many times as long a pixel may be one way as the other. In a perspective, which may run along an axis in its middle, 1.5 lost
/// 1.6 dB (azimuth 90, elevation 0).
const LONGEST: f64 = 1.25;
/// Tangent of half of 75 degrees, and some rounding: above it an angle of view along the picture's height is wide, and [`WIDEST`]
/// also holds of voxels that are wide in the middle.
const WIDE_ANGLE: f64 = 0.768;
/// Width of a footprint, in pixels, up to which a voxel is tiny, and this does not hold: that of the low-pass on sixteen samples
/// a pixel's side.
const TINY_FOOTPRINT: f64 = 0.0375;
/// Least distance of the picture's plane from the eye, in its pixels. Where the angle between pixels is larger, what a pixel takes of the
/// plane is no ellipse: light was up to two pixels beside its place.
const LEAST_FOCAL: f64 = 2.5;
/// Least density of the plane's pixels anywhere as a share of that in the middle of the picture, in pixels of the picture.
const AT_ENDS: f64 = 0.8;
/// Largest standard deviation of the filter where the picture shows the box of the voxels, for
/// [`Sampling::Enough`](crate::splat::Sampling::Enough) and [`Sampling::Fewest`](crate::splat::Sampling::Fewest): the warp takes four
/// pixels on each side. Drafts had 28 dB where it was above 100, and 33 dB at 8.
const WIDEST: [f64; 2] = [4.0, 8.0];
/// The most by which a voxel's depth may change from a tile's middle, whose ray all its pixels take, to its corners, for
/// [`Sampling::Enough`](crate::splat::Sampling::Enough) and [`Sampling::Fewest`](crate::splat::Sampling::Fewest). It changes where
/// spacings are unlike and the eye is near. Measured: docs/studies/sampling.md.
const MOST_CHANGE: [f64; 2] = [0.02, 0.08];

/// Returns the plane, if there is one.
pub(super) fn plane(lattice_view: &LatticeView) -> Option<Lattice> {
    let LatticeView { view, slow_fast_medium, low, high, reach, kernel, .. } = *lattice_view;
    let (PixelMap::Perspective { camera_from_voxel, focal, centre, .. }, Viewpoint::Perspective { eye, .. }) =
        (&view.map, view.viewpoint)
    else {
        return None;
    };
    let eye = slow_fast_medium.map(|axis| eye[axis]);
    // Away from the eye, slices come in this direction.
    let away = if low[0] > eye[0] { 1.0 } else { -1.0 };
    let distances = [low[0], high[0]].map(|slow| away * (slow - eye[0]));
    let (nearest, farthest) = (distances[0].min(distances[1]), distances[0].max(distances[1]));
    let forward = &camera_from_voxel[2];
    let along = |n: usize| (forward[slow_fast_medium[n]] * low[n]).min(forward[slow_fast_medium[n]] * high[n]);
    let nearest_depth = forward[3] + along(0) + along(1) + along(2);
    // Slices nearer than so many slices are seen under too many angles. A clip cuts slices where the view does not run along the slow axis.
    if nearest < NEAR || view.clip > nearest_depth || *focal < LEAST_FOCAL {
        return None;
    }
    let column = |axis: usize| DVec3::from_array([0, 1, 2].map(|row: usize| camera_from_voxel[row][axis]));
    let to_end = [0, 1, 2].map(|n: usize| [low[n], high[n]].map(|end| column(slow_fast_medium[n]) * end));
    // From the eye to the corners of the box.
    let corners = [0, 1, 2, 3, 4, 5, 6, 7].map(|corner: usize| {
        let at = |n: usize| to_end[n][corner >> n & 1];
        at(0) + at(1) + at(2) + column(3)
    });
    // From a pixel's ray, in camera coordinates, to voxels along the slow (away from the eye), fast and medium axis.
    let steps = [column(slow_fast_medium[0]) * away, column(slow_fast_medium[1]), column(slow_fast_medium[2])];
    let camera_from_pixel = DMat3::from_cols(
        DVec3::new(1.0 / focal, 0.0, 0.0),
        DVec3::new(0.0, -1.0 / focal, 0.0),
        DVec3::new(-centre[0] / focal, centre[1] / focal, 1.0),
    );
    let voxel_from_pixel = DMat3::from_cols(steps[0], steps[1], steps[2]).inverse() * camera_from_pixel;
    let [columns, rows] = view.size.map(f64::from);
    // How far a place moves along the fast and the medium axis, in voxels on the slice at distance 1, per column and per row of the
    // picture.
    let moves = |[x, y]: [f64; 2]| {
        let at = voxel_from_pixel * DVec3::new(x, y, 1.0);
        let column = |k: usize| voxel_from_pixel.col(k);
        [1, 2].map(|side: usize| [0, 1].map(|k| (column(k)[side] - at[side] / at[0] * column(k)[0]) / at[0]))
    };
    let on_picture =
        |corner: &DVec3| [centre[0] + focal * corner.x / corner.z, centre[1] - focal * corner.y / corner.z];
    let at_middle = moves([0.5 * columns, 0.5 * rows]);
    let ends: Vec<_> = shown_ends(&corners, on_picture, [columns, rows]).into_iter().map(moves).collect();
    // The lattice is finer in near slices and coarser in far ones. Where these show all detail, it is fine enough in the middle of the
    // farther half (docs/studies/sampling.md).
    let middle = 0.5 * (nearest + farthest);
    let far = 0.5 * (middle + farthest);
    let to_centre: DVec3 = to_end.as_flattened().iter().sum::<DVec3>() * 0.5 + column(3);
    let distance = to_centre.length();
    // Those farthest away, beside the faces of the box.
    let slopes = [1, 2].map(|n: usize| {
        let to_faces = [low[n], high[n]].map(|end| (end - eye[n]).abs());
        to_faces[0].min(to_faces[1]) / farthest
    });
    let rays = EdgeRays { slopes, slice: distance / middle };
    let step = [1, 2].map(|n: usize| {
        // Of a voxel's steps in the picture, at that distance.
        let step = |[[a, b], [c, d]]: &[[f64; 2]; 2]| {
            let across = if n == 1 { c.hypot(*d) } else { a.hypot(*b) };
            across / ((a * d - b * c).abs() * middle)
        };
        let largest_step: f64 = ends.iter().map(step).fold(0.0, f64::max);
        let largest_step = step(&at_middle).max(AT_ENDS * largest_step);
        let per_voxel = |step: f64, is_far| lattice_view.resolution.per_voxel(n - 1, &rays, step, is_far);
        let finest = per_voxel(largest_step, false) * middle;
        1.0 / finest.max(per_voxel(largest_step * middle / far, true) * far)
    });
    let step = step.map(|side| side.min(LONGEST * step[0].min(step[1])));
    let on_plane = |moves: &[[f64; 2]; 2]| [0, 1].map(|side: usize| moves[side].map(|moves| moves / step[side]));
    let ends: Vec<_> = ends.iter().map(on_plane).collect();
    let low_pass = LowPass::new(on_plane(&at_middle), &ends, lattice_view.width);
    // If even the nearest voxels are tiny, no other way of sampling has enough samples.
    let nearest_corner = corners.iter().map(|corner| corner.z).fold(f64::INFINITY, f64::min);
    let longest_step = steps.map(DVec3::length).into_iter().fold(0.0, f64::max);
    let are_tiny = f64::from(kernel.sigma) * longest_step * focal <= TINY_FOOTPRINT * nearest_corner;
    let is_wide_angle = !are_tiny && 0.5 * f64::from(view.size[1]) / focal > WIDE_ANGLE;
    // Toward the edges of a wide angle, even voxels that are wide in the middle are as narrow as the low-pass.
    let deviation = if is_wide_angle { LOW_PASS.into() } else { low_pass.deviation };
    if deviation * low_pass.most_per_pixel > lattice_view.sampling.pick(WIDEST) {
        return None;
    }
    let shown = [[0.0, 0.0], [columns, 0.0], [0.0, rows], [columns, rows]]
        .map(|[across, down]: [f64; 2]| (voxel_from_pixel * DVec3::new(across - 0.5, down - 0.5, 1.0)).to_array());
    let all_meet = shown.iter().all(|[slow, fast, medium]| *slow > 0.05 * fast.hypot(*medium));
    let (mut size, mut first) = ([0; 2], [0.0; 2]);
    for side in 0..2 {
        let slope = |at: f64, distance: f64| (at - eye[1 + side]) / distance;
        let (box_low, box_high) = (low[1 + side] - 2.0 * reach, high[1 + side] + 2.0 * reach);
        let mut low = slope(box_low, nearest).min(slope(box_low, farthest));
        let mut high = slope(box_high, nearest).max(slope(box_high, farthest));
        if all_meet {
            let shown = shown.map(|corner| corner[1 + side] / corner[0]);
            low = low.max(shown.into_iter().fold(f64::INFINITY, f64::min) - 2.0 * step[side]);
            high = high.min(shown.into_iter().fold(-f64::INFINITY, f64::max) + 2.0 * step[side]);
        }
        let (pixel, count) = low_pass.pixels_between(side, low / step[side], high / step[side])?;
        (first[side], size[side]) = (pixel * step[side], count);
    }
    if change_in_tile(&steps, first, step, size) > lattice_view.sampling.pick(MOST_CHANGE) {
        return None;
    }
    let row = |index: usize| voxel_from_pixel.row(index);
    let plane = [0, 1].map(|side| ((row(1 + side) - row(0) * first[side]) / step[side]).to_array());
    let plane_from_pixel = [plane[0], plane[1], row(0).to_array()];
    let strength = f64::from(kernel.normalisation()) / f64::from(kernel.sigma).powi(2);
    let rays = PlaneRays::Perspective { eye, first, step, steps, strength };
    Some(lattice_view.lattice(size, plane_from_pixel, low_pass, rays))
}

/// Returns by which part of itself the depth of a voxel changes, at most, from a tile's middle to its corners. The plane is that of
/// [`PlaneRays::Perspective`].
fn change_in_tile(steps: &[DVec3; 3], first: [f64; 2], step: [f64; 2], size: [u32; 2]) -> f64 {
    /// Number of places along each side of the plane at which this is computed.
    const PLACES: u32 = 33;
    let stretch = |slopes: [f64; 2]| stretch(steps, slopes);
    let slope = |side: usize, place: u32| {
        first[side] + step[side] * f64::from(size[side]) * f64::from(place) / f64::from(PLACES - 1)
    };
    let mut most: f64 = 0.0;
    for (row, column) in (0..PLACES).flat_map(|row| (0..PLACES).map(move |column| (row, column))) {
        let middle = [slope(0, column), slope(1, row)];
        let of_middle = stretch(middle);
        for [right, down] in [[-1.5, -1.5], [1.5, -1.5], [-1.5, 1.5], [1.5, 1.5]] {
            let corner = [middle[0] + right * step[0], middle[1] + down * step[1]];
            most = most.max((stretch(corner) / of_middle - 1.0).abs());
        }
    }
    most
}

/// Returns the corners of the part of the picture that shows a box; of all of it if none does, or if a corner of the box is beside the
/// eye or behind it. `corners`: those of the box, from the eye; `size`: the picture's.
fn shown_ends(corners: &[DVec3; 8], on_picture: impl Fn(&DVec3) -> [f64; 2], size: [f64; 2]) -> Vec<[f64; 2]> {
    let mut ends = Vec::new();
    if corners.iter().all(|corner| corner.z > 0.0) {
        let corners = corners.each_ref().map(on_picture);
        for axis in 0..3 {
            let others = [1 << ((axis + 1) % 3), 1 << ((axis + 2) % 3)];
            for face in [0, 1 << axis] {
                let face = [0, others[0], others[0] | others[1], others[1]].map(|corner| corners[face | corner]);
                ends.extend(clipped(face.to_vec(), size));
            }
        }
    }
    if ends.is_empty() { vec![[0.0, 0.0], [size[0], 0.0], [0.0, size[1]], size] } else { ends }
}

/// Returns a convex polygon within a picture.
fn clipped(mut polygon: Vec<[f64; 2]>, size: [f64; 2]) -> Vec<[f64; 2]> {
    for (side, edge, sign) in [(0, 0.0, 1.0), (0, size[0], -1.0), (1, 0.0, 1.0), (1, size[1], -1.0)] {
        let inside = |place: &[f64; 2]| sign * (place[side] - edge);
        let next = polygon.iter().cycle().skip(1);
        polygon = (polygon.iter().zip(next))
            .flat_map(|(a, b)| {
                let (before, after) = (inside(a), inside(b));
                let crossing = before / (before - after);
                let crossed = (before < 0.0) != (after < 0.0);
                let crossing = crossed.then(|| [0, 1].map(|k: usize| a[k] + crossing * (b[k] - a[k])));
                [(before >= 0.0).then_some(*a), crossing].into_iter().flatten()
            })
            .collect();
    }
    polygon
}
