//! Chooses the lattice of a view, or none: whether it is worthwhile.
//!
//! In: a view of the voxels in a box, the order of its walk, and settings. Out: a [`Lattice`].

use super::resolution::Resolution;
use super::{Lattice, LowPass, PlaneRays, parallel, perspective};
use crate::splat::block_kernel::SHAPES;
use crate::splat::kernel::KernelShape;
use crate::splat::supersample::sigma_at_centre;
use crate::splat::view::{PixelMap, View};
use crate::splat::{Blending, Mode, Sampling, Settings};
use crate::traverse::{Order, Sense, VoxelBox};

/// The most pixels of a plane per sample of the other way at which the plane is faster. Measured: docs/studies/sampling.md.
const MOST_PER_SAMPLE: f64 = 4.0;
/// Pixels of a plane per pixel of the picture up to which the plane is faster however few voxels there are, and the most pixels per
/// voxel of a larger one.
const FEW_PER_SAMPLE: f64 = 2.2;
const MOST_PER_VOXEL: f64 = 0.8;
/// The most pixels of a plane per pixel of the picture, unless few are kept for the warp.
const MOST_PER_PIXEL: f64 = 6.5;
/// The most kept pixels that are few: they take 36 to 68 MiB.
const FEW_PIXELS: f64 = 2_097_152.0;
/// Least distance between voxels, in pixels of the picture, at which a perspective x-ray is drawn on a plane: nothing
/// hides a voxel there, and smaller footprints are drawn faster on the picture's own pixels.
const LEAST_SUMMED_STEP: f64 = 1.5;

/// What a lattice is to show.
pub(super) struct LatticeView<'a> {
    pub(super) view: &'a View,
    /// Indices of the slow, fast and medium axis.
    pub(super) slow_fast_medium: [usize; 3],
    /// The box of the voxels, along these axes, and how far kernels reach out of it.
    pub(super) low: [f64; 3],
    pub(super) high: [f64; 3],
    pub(super) reach: f64,
    pub(super) kernel: KernelShape,
    /// The squares of kernels' widths along these axes, by their shape.
    pub(super) squares: [[f32; SHAPES]; 3],
    /// Standard deviation of the narrowest footprint, in pixels of the picture.
    pub(super) width: f64,
    /// Whether a ray's sum is shown, not what is left of its light.
    pub(super) is_sum: bool,
    pub(super) sampling: Sampling,
    pub(super) resolution: Resolution,
}

impl LatticeView<'_> {
    /// Returns a lattice of this size, with the homography from the picture's pixels to the plane's.
    pub(super) fn lattice(
        &self,
        size: [u32; 2],
        plane_from_pixel: [[f64; 3]; 3],
        low_pass: LowPass,
        rays: PlaneRays,
    ) -> Lattice {
        let LatticeView { view, kernel, squares, .. } = *self;
        Lattice { size, picture: view.size, plane_from_pixel, low_pass, rays, kernel, spread: view.margin, squares }
    }
}

impl Lattice {
    /// Returns the lattice of a view of the voxels in `bounds`; `deepest` is the largest optical depth of any of them,
    /// along a ray as long as the mean spacing.
    ///
    /// `None` if `settings` ask for other samples, another mode or another direction, if `order` is not the view's own,
    /// if the eye is among or near the slices, or if the plane is seen too obliquely.
    pub(in super::super) fn new(
        view: &View,
        order: &Order,
        bounds: &VoxelBox,
        deepest: f64,
        settings: &Settings,
    ) -> Option<Lattice> {
        let sampling = settings.sampling();
        let is_drawn = match settings.mode {
            Mode::Composite => settings.sense == Sense::FrontToBack && settings.blending == Blending::Exponential,
            Mode::Additive => settings.blending == Blending::Exponential,
            Mode::Maximum | Mode::MaximumGrey => false,
        };
        if !is_drawn || matches!(sampling, Sampling::EveryPixel | Sampling::Finer) {
            return None;
        }
        let kernel = settings.kernel_of_depth(deepest, view);
        let slow_fast_medium = [order.slow.index(), order.fast.index(), order.medium.index()];
        let widths = settings.blocks.widths(settings.fine_kernel());
        let width = f64::from(sigma_at_centre(view, bounds, settings));
        // Standard deviations of the widest kernels along the fast and the medium axis.
        let sigmas = [1, 2].map(|n: usize| f64::from(kernel.sigma * widths.of(0)[slow_fast_medium[n]]));
        let slices = f64::from(bounds.high[slow_fast_medium[0]] - bounds.low[slow_fast_medium[0]]) + 1.0;
        let lattice_view = LatticeView {
            view,
            slow_fast_medium,
            low: slow_fast_medium.map(|axis| f64::from(bounds.low[axis])),
            high: slow_fast_medium.map(|axis| f64::from(bounds.high[axis])),
            reach: f64::from(kernel.radius) * 1.5 + 1.0,
            kernel,
            squares: slow_fast_medium.map(|axis| std::array::from_fn(|shape| widths.of(shape)[axis].powi(2))),
            width,
            is_sum: settings.mode == Mode::Additive,
            sampling,
            resolution: Resolution::new(view, settings, sigmas, width, [deepest, slices]),
        };
        // An overexposed x-ray shows where sums begin, far out on the kernels.
        if lattice_view.is_sum && lattice_view.resolution.sharpness > 1.0 {
            return None;
        }
        match &view.map {
            PixelMap::Parallel { .. } => parallel::plane(&lattice_view),
            PixelMap::Perspective { .. } => {
                if lattice_view.is_sum && width < LEAST_SUMMED_STEP * f64::from(kernel.sigma) {
                    return None;
                }
                perspective::plane(&lattice_view)
            }
        }
    }

    /// Returns whether this plane's pixels are drawn rather than so many `samples` of the part of the picture that shows the voxels,
    /// of which there are at most so many.
    pub(in super::super) fn is_worthwhile(&self, samples: f64, voxels: f64) -> bool {
        let pixels = |[columns, rows]: [u32; 2]| f64::from(columns) * f64::from(rows);
        let plane = pixels(self.size);
        let is_too_large = pixels(self.kept()) > FEW_PIXELS && plane > MOST_PER_PIXEL * pixels(self.picture);
        // Pixels are averaged where voxels are smaller than those of the picture: the other way has many samples there, or too few.
        let most = (MOST_PER_VOXEL * voxels).clamp(FEW_PER_SAMPLE * samples, MOST_PER_SAMPLE * samples);
        !is_too_large && (self.low_pass.halvings != [0; 2] || plane <= most)
    }
}
