//! How fine a lattice is: as many pixels as the finest details that the picture shows need.
//!
//! In: the kernels, how opaque voxels are, and rays beside the faces of their box. Out: pixels per voxel. The outline of opaque
//! matter is finer than its kernels, and so is that of a face seen edge-on, beside which many voxels add up.

use crate::splat::kernel::LOW_PASS;
use crate::splat::view::View;
use crate::splat::{Mode, Sampling, Settings};

/// Pixels of the plane per standard deviation of the kernel, where the picture shows all detail of matter that is not opaque:
/// for [`Sampling::Enough`] and [`Sampling::Fewest`]. Measured: docs/studies/sampling.md.
const WIDE_VOXELS: [f64; 2] = [0.93, 0.62];
/// The same where voxels are small.
const SMALL_VOXELS: f64 = 0.7;
/// The same where they are small and lie beside the points of the grid, as those of levels (docs/studies/levels.md).
const DISPLACED_SMALL_VOXELS: f64 = 0.4;
/// The most pixels of the plane that are worthwhile per pixel of the picture, along a side, unless voxels are small.
const PER_PIXEL: f64 = 1.35;
/// The same where a filter follows and voxels are opaque, as their edges are finer than the filter; and the sharpness from
/// which on they are.
const PER_FILTERED_PIXEL: f64 = 1.6;
const SHARP: f64 = 1.3;
/// Least number of slices that a ray must pass within one voxel of a face for the face to be seen edge-on.
const LEAST_BEHIND: f64 = 12.0;
/// The most optical depth for which the outline of such a face is computed. The outline is that of the depths of all these voxels
/// together, and is hardly sharper where they are deeper.
const MOST_BEHIND: f64 = 48.0;
/// Sharpness of such an outline per standard deviation of the kernel that its depth reaches out. Measured: docs/studies/sampling.md.
const EDGE_ON: f64 = 0.7;
/// The most pixels of the plane per pixel of the picture across such an outline, unless voxels are small: for [`Sampling::Enough`] and
/// [`Sampling::Fewest`].
const PER_PIXEL_EDGE_ON: [f64; 2] = [2.1, 1.7];
/// Distance between voxels, in pixels of the picture, up to which the picture shows no such edges.
pub(super) const SMALL_STEP: f64 = 0.76;

/// Rays beside the faces of the voxels' box. A face that is nearly parallel to them is seen edge-on.
pub(super) struct EdgeRays {
    /// By how many voxels they move per slice, along the fast and the medium axis.
    pub(super) slopes: [f64; 2],
    /// Their length from slice to slice, in mean spacings.
    pub(super) slice: f64,
}

/// How many pixels of a plane the details of a scene need. Pairs are along the fast and the medium axis.
pub(super) struct Resolution {
    /// Standard deviations of the widest kernels, in voxels.
    sigmas: [f64; 2],
    /// Pixels per standard deviation of a kernel, where the picture shows all detail; and the least.
    per_sigma: f64,
    least_per_sigma: f64,
    /// How much finer than a kernel the edges of single voxels are.
    pub(super) sharpness: f64,
    /// The most pixels of the plane per pixel of the picture; and across the outlines of faces seen edge-on.
    per_pixel: f64,
    per_pixel_edge_on: f64,
    /// The largest optical depth of a voxel, and the number of slices; `None` if outlines do not matter.
    outlines: Option<[f64; 2]>,
}

impl Resolution {
    /// `sigmas`: of the widest kernels, in voxels; `width`: the standard deviation of the narrowest footprint, in pixels of the picture;
    /// `outlines`: the largest optical depth of a voxel, and the number of slices.
    pub(super) fn new(
        view: &View,
        settings: &Settings,
        sigmas: [f64; 2],
        width: f64,
        outlines: [f64; 2],
    ) -> Resolution {
        let sampling = settings.sampling();
        // The edge of what is opaque rises faster than its footprint; a picture of small voxels shows no such edges.
        let peak = outlines[0] / (std::f64::consts::TAU * sigmas[0] * sigmas[1]);
        let sharpness = (2.0 * peak.max(1.0).ln()).sqrt().max(1.0);
        let is_fine = sharpness > SHARP && width < f64::from(LOW_PASS) && sampling == Sampling::Enough;
        let is_displaced = view.margin > 0.0;
        Resolution {
            sigmas,
            per_sigma: sampling.pick(WIDE_VOXELS),
            least_per_sigma: if is_displaced { DISPLACED_SMALL_VOXELS } else { SMALL_VOXELS },
            sharpness,
            per_pixel: if is_fine { PER_FILTERED_PIXEL } else { PER_PIXEL },
            per_pixel_edge_on: sampling.pick(PER_PIXEL_EDGE_ON),
            // Sums have no outlines, and those of levels are only as exact as their blocks.
            outlines: (settings.mode == Mode::Composite && !is_displaced).then_some(outlines),
        }
    }

    /// Returns how many pixels of the plane a voxel has along the fast (`side` 0) or the medium axis (1).
    ///
    /// `step`: the distance between voxels, in pixels of the picture; `is_far`: in slices that are so far away that voxels are
    /// small in any case.
    pub(super) fn per_voxel(&self, side: usize, rays: &EdgeRays, step: f64, is_far: bool) -> f64 {
        let edge = self.edge_sharpness(side, rays);
        let per_pixel = if edge > 1.0 && step > SMALL_STEP { self.per_pixel_edge_on } else { self.per_pixel };
        let least = if is_far { 0.0 } else { self.least_per_sigma };
        let wanted = self.per_sigma * self.sharpness.max(edge);
        wanted.min(least.max(per_pixel * step * self.sigmas[side])) / self.sigmas[side]
    }

    /// Returns how much finer than the kernel's the outline of faces across the fast (`side` 0) or medium axis (1) is, if they are
    /// seen edge-on; else 0.
    fn edge_sharpness(&self, side: usize, rays: &EdgeRays) -> f64 {
        let Some([deepest, slices]) = self.outlines else { return 0.0 };
        let behind = slices.min(1.0 / rays.slopes[side].abs());
        if behind < LEAST_BEHIND {
            return 0.0;
        }
        // The depth beside a face is a half-space's, seen through the kernel: at x standard deviations from it about
        // exp(-x^2 / 2) / 4 of that within, where x is 1.5 to 3. So it is 1 at this x.
        let depth = (deepest * rays.slice * behind).min(MOST_BEHIND);
        EDGE_ON * (2.0 * (depth / 4.0).max(1.0).ln()).sqrt()
    }
}
