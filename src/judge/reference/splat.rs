//! The splatting reference: draws what splatting gives without approximations for speed.
//!
//! In: visible voxels, a camera, [`JudgeSettings`]. Out: a [`ReferencePicture`]. Splats are composited one after the
//! other, nearest first, in double precision. Kernels reach out to six standard deviations and exponentials are exact.
//! A ray ends only where its transmittance no longer matters in double precision.
//!
//! Each thread draws all splats into its own band of rows, so the picture does not depend on the number of threads. The
//! reference shares its model with the renderers: integrals of kernels along rays, the low-pass
//! filter, the largest optical depth of a splat, the lighting. [`RayJudge`](super::RayJudge) shares only the lighting.

use std::sync::{Mutex, PoisonError};

use adjsplat::classify::TransferFunction;
use adjsplat::error::{Error, Result};
use adjsplat::internals::LOW_PASS;
use adjsplat::splat::{Blending, Camera, ClipPlane, Lighting, Mode, Quality, StopRequest, View, WorldFrame};
use adjsplat::volume::SlabSource;
use glam::DVec3;

use super::maximum;
use super::order::{SplatOrder, front_to_back};
use super::picture::{ReferencePicture, check_stop, is_made};
use super::project::{PixelRows, SplatProjector};
use super::voxels::VisibleVoxels;

/// The settings of a picture that [`Judge`] draws.
#[derive(Debug, Clone, PartialEq)]
pub struct JudgeSettings {
    /// The numbers of columns and rows of the picture, each 1 to 16,384.
    pub size: [u32; 2],
    /// The standard deviation of the Gaussian kernel, in voxel spacings; above 0.
    pub sigma: f64,
    /// The radius of the kernel in standard deviations. Weights are scaled up by what the cut-off loses.
    pub cut_off: f64,
    /// The smallest standard deviation of a footprint, in pixels: narrower ones are widened to it.
    pub low_pass: f64,
    /// The order in which splats are composited.
    pub order: SplatOrder,
    /// How a splat covers a pixel: [`Blending::Exponential`] or [`Blending::Linear`].
    pub blending: Blending,
    /// The mode of drawing. The maximum modes interpolate values and have neither kernel, light nor order.
    pub mode: Mode,
    /// The lighting of voxels that have a normal; `None` draws plain colours.
    pub lighting: Option<Lighting>,
    /// The factor on optical depths in [`Mode::Additive`]. With `None` it is chosen as in the renderers: a typical ray
    /// gets three quarters of full brightness.
    pub exposure: Option<f64>,
    /// The distance along the view axis below which voxels are not drawn, in world length. With `None` kernels are drawn
    /// from the eye on.
    pub near: Option<f64>,
    /// The lowest and the highest index, inclusive, of the box of voxels to draw; `None` draws all.
    pub crop: Option<([u16; 3], [u16; 3])>,
    /// A plane; voxels whose centres lie behind it are not drawn. `None` draws both sides.
    pub clip: Option<ClipPlane>,
    /// The number of threads, at least 1. The picture does not depend on it.
    pub threads: usize,
}

impl JudgeSettings {
    /// Returns the settings for judging the renderers: the kernel of [`Quality::Reference`] out to six standard
    /// deviations, nested order, and lighting.
    pub fn new(size: [u32; 2]) -> JudgeSettings {
        JudgeSettings {
            size,
            sigma: f64::from(Quality::Reference.kernel().sigma),
            cut_off: 6.0,
            low_pass: LOW_PASS.into(),
            order: SplatOrder::default(),
            blending: Blending::Exponential,
            mode: Mode::Composite,
            lighting: Some(Lighting::default()),
            exposure: Some(1.0),
            near: None,
            crop: None,
            clip: None,
            threads: 1,
        }
    }

    pub(super) fn check(&self) -> Result<()> {
        let numbers = [("kernel sigma", self.sigma), ("kernel cut-off", self.cut_off)];
        for (what, number) in numbers.into_iter().chain(self.exposure.map(|exposure| ("exposure", exposure))) {
            if !(number.is_finite() && number > 0.0) {
                return Err(Error::input(what, format!("is {number}, but must be finite and above 0")));
            }
        }
        if self.blending == Blending::Sheets {
            return Err(Error::input("blending", "is sheets, which has no reference; take exponential or linear"));
        }
        if self.threads == 0 {
            return Err(Error::input("threads", "are 0, but must be at least 1"));
        }
        self.lighting.map_or(Ok(()), |lighting| lighting.check())
    }

    /// Returns whether neither the crop nor the clip plane leaves a voxel out.
    pub(super) fn draws(&self, position: [u16; 3], world: &WorldFrame) -> bool {
        let in_crop = self.crop.is_none_or(|(low, high)| (0..3).all(|a| (low[a]..=high[a]).contains(&position[a])));
        in_crop
            && self.clip.is_none_or(|ClipPlane { point, normal }| {
                let normal = DVec3::from_array(normal).normalize();
                let in_front = |from: DVec3| normal.dot(from - DVec3::from_array(point));
                // A voxel on the plane is drawn, whichever way its position is rounded.
                let tolerance = 1e-6 * world.steps.map(|step| normal.dot(step).abs()).into_iter().sum::<f64>();
                in_front(world.world_from_voxel(position.map(f64::from))) >= -tolerance
            })
    }
}

/// The splatting reference: a slow renderer of one volume, without approximations for speed.
#[derive(Debug, Clone)]
pub struct Judge {
    visible: VisibleVoxels,
    stop: Option<StopRequest>,
}

impl Judge {
    /// Reads the visible voxels of `source`, which must be at its first slice, and classifies them by `transfer`.
    ///
    /// # Errors
    /// The errors of [`VisibleVoxels::of_volume`].
    pub fn new(source: &mut dyn SlabSource, transfer: &TransferFunction) -> Result<Judge> {
        Ok(Judge::of_voxels(VisibleVoxels::of_volume(source, transfer)?))
    }

    /// Creates the renderer of these voxels.
    pub fn of_voxels(visible: VisibleVoxels) -> Judge {
        Judge { visible, stop: None }
    }

    /// Sets the request that ends drawing with [`Error::Interrupted`]; `None` for never.
    #[must_use]
    pub fn with_stop(self, stop: impl Into<Option<StopRequest>>) -> Judge {
        Judge { stop: stop.into(), ..self }
    }

    /// Returns the request that ends drawing.
    pub fn stop(&self) -> Option<&StopRequest> {
        self.stop.as_ref()
    }

    /// Returns the voxels that this renderer draws.
    pub fn visible(&self) -> &VisibleVoxels {
        &self.visible
    }

    /// Draws what `camera` sees. Takes about a microsecond per visible voxel and 25 ns per pixel of each footprint; a
    /// maximum, 100 ns per pixel and slice and 8 bytes per grid point.
    ///
    /// # Errors
    /// [`Error::Input`] if a setting is out of its range; [`Error::Limit`] if the memory cannot be had; [`Error::Interrupted`] if
    /// the [stop](Judge::with_stop) is requested.
    pub fn draw(&self, camera: &Camera, settings: &JudgeSettings) -> Result<ReferencePicture> {
        settings.check()?;
        let grid = self.visible.grid();
        let voxels = self.visible.voxels();
        let view = View::new(camera, grid, settings.size, Quality::Reference.kernel(), settings.near)?;
        if settings.mode.is_maximum() {
            return maximum::draw(&self.visible, camera, &view, settings, self.stop());
        }
        let world = WorldFrame::of(grid);
        let mut order = front_to_back(voxels, grid.dims, &view, settings.order);
        order.retain(|&at| settings.draws(voxels[at as usize].position, &world));
        let projector = SplatProjector::new(&view, settings, self.exposure(settings));
        let start = if settings.mode == Mode::Additive { [0.0; 4] } else { [0.0, 0.0, 0.0, 1.0] };
        let mut picture = ReferencePicture::filled(settings.size, start)?;
        let [columns, rows] = settings.size.map(|side| side as usize);
        let band_rows = rows.div_ceil(settings.threads.min(rows));
        let bands = Mutex::new(picture.pixels_mut().chunks_mut(band_rows * columns).enumerate());
        let draw = || {
            loop {
                let taken = bands.lock().unwrap_or_else(PoisonError::into_inner).next();
                let Some((band, pixels)) = taken else { return };
                let mut band = PixelRows { first_row: band * band_rows, columns, pixels };
                for &at in &order {
                    if is_made(self.stop()) {
                        return;
                    }
                    projector.splat(&voxels[at as usize], &mut band);
                }
            }
        };
        std::thread::scope(|scope| {
            for _ in 1..settings.threads.min(rows) {
                // The threads that the system gives.
                let _ = std::thread::Builder::new().spawn_scoped(scope, draw);
            }
            draw();
        });
        check_stop(self.stop())?;
        for pixel in picture.pixels_mut() {
            *pixel = match settings.mode {
                Mode::Additive => pixel.map(|sum| -(-sum).exp_m1()),
                _ => [pixel[0], pixel[1], pixel[2], 1.0 - pixel[3]],
            };
        }
        Ok(picture)
    }

    /// Returns the factor on optical depths: the exposure in additive mode, otherwise 1.
    fn exposure(&self, settings: &JudgeSettings) -> f64 {
        if settings.mode != Mode::Additive {
            return 1.0;
        }
        settings.exposure.unwrap_or_else(|| {
            let voxels = self.visible.voxels();
            let count = voxels.len().max(1) as f64;
            let typical = voxels.iter().map(|voxel| voxel.depth).sum::<f64>() / count * count.cbrt();
            if typical > 0.0 { 1.4 / typical } else { 1.0 }
        })
    }
}
