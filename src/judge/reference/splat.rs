//! The splat judge: what splatting gives when nothing is cut short.
//!
//! In: visible voxels, a camera, [`Settings`]. Out: a [`Picture`]. One splat after the other, near first, in double
//! precision: footprints by EWA out to six standard deviations, exact exponentials, no ray ended before its
//! transmittance leaves double precision, no code, no table.
//!
//! ```text
//! depth(x) = depth of a mean voxel * (pixels per mean area) / (2 pi sqrt |V|) * exp(-x^T V^-1 x / 2)
//! V        = sigma^2 M M^T + low-pass; M: 2 x 3, pixels per voxel
//! pixel   += transmittance * (1 - exp(-depth)) * colour
//! ```
//!
//! Threads own bands of rows and each goes through all splats, so the picture does not depend on their number.
//! What it shares with the renderers is the model: the affine footprint of EWA, the low-pass, the largest optical depth
//! of a splat, the lighting. The [ray judge](super::ray) shares none of them but the lighting.
//!
//! Source: Zwicker et al., "EWA Volume Splatting", 2001.

use super::light::Lights;
pub use super::order::Order;
use super::order::front_to_back;
use super::picture::Picture;
use super::voxels::{VisibleVoxels, Voxel};
use adjsplat::classify::TransferFunction;
use adjsplat::error::{Error, Result};
use adjsplat::splat::composite::MAX_DEPTH;
use adjsplat::splat::kernel::LOW_PASS;
use adjsplat::splat::view::{Affine, PixelMap};
use adjsplat::splat::{Camera, Lighting, Mode, Quality, View};
use adjsplat::volume::SlabSource;

/// Transmittance below which a pixel no longer changes in double precision.
const GONE: f64 = 1e-18;

/// How a splat covers a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Hash)]
pub enum Blending {
    /// `1 - exp(-depth)`: optical depths add up.
    #[default]
    Exponential,
    /// Opacity times weight, at most 1: the classic form, for what it costs.
    Linear,
}

/// How the judge draws.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Columns and rows, each 1 to 16,384.
    pub size: [u32; 2],
    /// Standard deviation of the kernel, in voxel spacings; above 0.
    pub sigma: f64,
    /// Where the kernel ends, in standard deviations; what that loses is put back in.
    pub cut_off: f64,
    /// In which order.
    pub order: Order,
    /// How a splat covers a pixel.
    pub blending: Blending,
    /// Composite or additive.
    pub mode: Mode,
    /// Lighting of voxels that have a normal; `None` for none.
    pub lighting: Option<Lighting>,
    /// Factor on the optical depths of [`Mode::Additive`]; `None` as for the renderers: a typical ray comes out at
    /// three quarters of full brightness.
    pub exposure: Option<f64>,
    /// World distance along the view axis below which voxels are not drawn; `None` for the reach of the kernel of
    /// [`Quality::Reference`].
    pub near: Option<f64>,
    /// Only voxels in this box are drawn: lowest and highest index, inclusive.
    pub crop: Option<([u16; 3], [u16; 3])>,
    /// Threads, at least 1. The picture does not depend on it.
    pub threads: usize,
}

impl Settings {
    /// The kernel of [`Quality::Reference`] out to six standard deviations, composited in nested order with lighting.
    pub fn new(size: [u32; 2]) -> Settings {
        Settings {
            size,
            sigma: f64::from(Quality::Reference.kernel().sigma),
            cut_off: 6.0,
            order: Order::default(),
            blending: Blending::default(),
            mode: Mode::Composite,
            lighting: Some(Lighting::default()),
            exposure: Some(1.0),
            near: None,
            crop: None,
            threads: 1,
        }
    }

    fn check(&self) -> Result<()> {
        let positive = |number: f64| number.is_finite() && number > 0.0;
        for (what, number) in [("kernel sigma", self.sigma), ("kernel cut-off", self.cut_off)] {
            if !positive(number) {
                return Err(Error::input(what, format!("is {number}, but must be finite and above 0")));
            }
        }
        if let Some(exposure) = self.exposure.filter(|&exposure| !positive(exposure)) {
            return Err(Error::input("exposure", format!("is {exposure}, but must be finite and above 0")));
        }
        if self.mode.is_maximum() {
            return Err(Error::input("mode", "is a maximum, which has no reference; take composite or xray"));
        }
        if self.threads == 0 {
            return Err(Error::input("threads", "are 0, but must be at least 1"));
        }
        self.lighting.map_or(Ok(()), |lighting| lighting.check())
    }
}

/// The splat judge of one volume.
#[derive(Debug, Clone)]
pub struct Judge {
    visible: VisibleVoxels,
}

impl Judge {
    /// The judge of `source`, which must be at its first slice, seen through `transfer`.
    ///
    /// # Errors
    /// As [`VisibleVoxels::of_volume`].
    pub fn new(source: &mut dyn SlabSource, transfer: &TransferFunction) -> Result<Judge> {
        Ok(Judge { visible: VisibleVoxels::of_volume(source, transfer)? })
    }

    /// The judge of these voxels.
    pub fn of_voxels(visible: VisibleVoxels) -> Judge {
        Judge { visible }
    }

    /// What it draws.
    pub fn visible(&self) -> &VisibleVoxels {
        &self.visible
    }

    /// What `camera` sees. Time: about a microsecond a visible voxel and 25 ns a pixel of each footprint.
    ///
    /// # Errors
    /// [`Error::Input`] if a setting is out of its range; [`Error::OutOfMemory`].
    pub fn draw(&self, camera: &Camera, settings: &Settings) -> Result<Picture> {
        settings.check()?;
        let grid = self.visible.grid();
        let voxels = self.visible.voxels();
        let view = View::new(camera, grid, settings.size, Quality::Reference.kernel(), settings.near)?;
        let order = front_to_back(voxels, grid.dims, &view, settings.order);
        let projector = Projector::new(&view, settings, self.exposure(settings));
        let start = if settings.mode == Mode::Additive { [0.0; 4] } else { [0.0, 0.0, 0.0, 1.0] };
        let mut picture = Picture::filled(settings.size, start)?;
        let [columns, rows] = settings.size.map(|side| side as usize);
        let band_rows = rows.div_ceil(settings.threads.min(rows));
        std::thread::scope(|scope| {
            for (band, pixels) in picture.pixels_mut().chunks_mut(band_rows * columns).enumerate() {
                let (projector, order) = (&projector, &order);
                scope.spawn(move || {
                    let mut band = Band { first_row: band * band_rows, columns, pixels };
                    for &at in order {
                        projector.splat(&voxels[at as usize], &mut band);
                    }
                });
            }
        });
        for pixel in picture.pixels_mut() {
            *pixel = match settings.mode {
                Mode::Additive => pixel.map(|sum| -(-sum).exp_m1()),
                _ => [pixel[0], pixel[1], pixel[2], 1.0 - pixel[3]],
            };
        }
        Ok(picture)
    }

    /// Factor on optical depths.
    fn exposure(&self, settings: &Settings) -> f64 {
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

/// Rows of a picture that one thread draws.
struct Band<'a> {
    first_row: usize,
    columns: usize,
    pixels: &'a mut [[f64; 4]],
}

/// A footprint on the screen.
#[derive(Debug, Clone, Copy)]
struct Footprint {
    /// Covariance in square pixels.
    xx: f64,
    xy: f64,
    yy: f64,
    determinant: f64,
}

impl Footprint {
    /// Of a kernel under a Jacobian in pixels per voxel, with the low-pass.
    fn new([x, y]: [[f64; 3]; 2], sigma: f64) -> Footprint {
        let square = sigma * sigma;
        let [x, y] = [x, y].map(glam::DVec3::from_array);
        let (xx, xy, yy) = (square * x.dot(x), square * x.dot(y), square * y.dot(y));
        let determinant = square * square * x.cross(y).length_squared();
        // The larger eigenvalue has no difference in it that could cancel; the smaller follows from the product.
        let widest = (xx + yy) / 2.0 + ((xx - yy) / 2.0).hypot(xy);
        let narrowest = if widest > 0.0 { determinant / widest } else { 0.0 };
        let added = (f64::from(LOW_PASS).powi(2) - narrowest).max(0.0);
        Footprint { xx: xx + added, xy, yy: yy + added, determinant: determinant + added * (xx + yy + added) }
    }
}

/// From voxels to pixels.
struct Projector<'a> {
    map: PixelMap,
    settings: &'a Settings,
    lights: Option<Lights>,
    /// What puts back what the cut-off loses, over 2 pi; times exposure.
    strength: f64,
    exposure: f64,
    /// Of all voxels of a parallel view.
    footprint: Option<Footprint>,
}

impl<'a> Projector<'a> {
    fn new(view: &View, settings: &'a Settings, exposure: f64) -> Projector<'a> {
        let lost = (-0.5 * settings.cut_off * settings.cut_off).exp();
        let footprint = match &view.map {
            PixelMap::Parallel { pixel_from_voxel, .. } => {
                Some(Footprint::new(pixel_from_voxel.map(|m| [m[0], m[1], m[2]]), settings.sigma))
            }
            PixelMap::Perspective { .. } => None,
        };
        Projector {
            map: view.map,
            settings,
            lights: settings.lighting.map(|lighting| Lights::new(lighting, view)),
            strength: 1.0 / (std::f64::consts::TAU * (1.0 - lost)),
            exposure,
            footprint,
        }
    }

    /// Centre, footprint, and pixels per mean area across the ray; `None` if the voxel is too near.
    fn project(&self, voxel: &Voxel) -> Option<([f64; 2], Footprint, f64)> {
        let [x, y, z] = voxel.position.map(f64::from);
        let at = |m: &Affine| m[0] * x + m[1] * y + m[2] * z + m[3];
        match (&self.map, self.footprint) {
            (PixelMap::Parallel { pixel_from_voxel, scale }, Some(footprint)) => {
                Some((pixel_from_voxel.each_ref().map(at), footprint, scale * scale))
            }
            (PixelMap::Perspective { camera_from_voxel, focal, centre, near }, _) => {
                let [t0, t1, t2] = camera_from_voxel.each_ref().map(at);
                if t2 < *near {
                    return None;
                }
                let (across, above) = (t0 / t2, t1 / t2);
                let [right, up, along] = camera_from_voxel;
                let scale = focal / t2;
                let jacobian = [
                    std::array::from_fn(|a| scale * (right[a] - across * along[a])),
                    std::array::from_fn(|a| scale * (above * along[a] - up[a])),
                ];
                // A pixel's solid angle is cos^3 / focal^2, and it is t2 / cos away.
                let slant = (1.0 + across * across + above * above).sqrt();
                let centre = [centre[0] + focal * across, centre[1] - focal * above];
                Some((centre, Footprint::new(jacobian, self.settings.sigma), scale * scale * slant))
            }
            (PixelMap::Parallel { .. }, None) => None,
        }
    }

    fn splat(&self, voxel: &Voxel, band: &mut Band) {
        if let Some((low, high)) = self.settings.crop
            && (0..3).any(|a| voxel.position[a] < low[a] || voxel.position[a] > high[a])
        {
            return;
        }
        let Some(([x, y], footprint, density)) = self.project(voxel) else { return };
        let Footprint { xx, xy, yy, determinant } = footprint;
        let reach = self.settings.cut_off * yy.sqrt();
        let Some((first_row, last_row)) = whole(y - reach, y + reach, band.first_row, band.rows()) else { return };
        let wide = self.settings.cut_off * xx.sqrt();
        if whole(x - wide, x + wide, 0, band.columns).is_none() {
            return;
        }
        // The weight at the centre of a footprint; weights of a layer of voxels add up to 1.
        let weight = self.strength * density / determinant.sqrt();
        let peak = match self.settings.blending {
            Blending::Exponential => (voxel.depth * self.exposure * weight).min(MAX_DEPTH),
            Blending::Linear => -(-voxel.depth * self.exposure).exp_m1() * weight,
        };
        if peak <= 0.0 || peak.is_nan() {
            return;
        }
        let colour = self.lights.map_or_else(|| voxel.colour.map(f64::from), |lights| lights.lit(voxel));
        let cut = self.settings.cut_off * self.settings.cut_off;
        for row in first_row..=last_row {
            let dy = row as f64 - y;
            let rest = cut - dy * dy / yy;
            if rest < 0.0 {
                continue;
            }
            // On a row the exponent is that of a Gaussian around the ridge.
            let (middle, half) = (x + xy / yy * dy, (rest * determinant / yy).sqrt());
            let Some((first, last)) = whole(middle - half, middle + half, 0, band.columns) else { continue };
            let row_pixels = &mut band.pixels[(row - band.first_row) * band.columns..][..band.columns];
            for (column, pixel) in (first..=last).zip(&mut row_pixels[first..=last]) {
                let dx = column as f64 - middle;
                let exponent = -0.5 * (dx * dx * yy / determinant + dy * dy / yy);
                self.blend(pixel, peak * exponent.exp(), colour);
            }
        }
    }

    /// Puts an optical depth (or for linear blending an opacity) of a colour behind what a pixel shows.
    fn blend(&self, pixel: &mut [f64; 4], amount: f64, colour: [f64; 3]) {
        if self.settings.mode == Mode::Additive {
            (0..3).for_each(|c| pixel[c] += amount * colour[c]);
            pixel[3] += amount;
            return;
        }
        if pixel[3] < GONE {
            return;
        }
        let opacity = match self.settings.blending {
            Blending::Exponential => -(-amount).exp_m1(),
            Blending::Linear => amount.min(1.0),
        };
        let taken = pixel[3] * opacity;
        (0..3).for_each(|c| pixel[c] += taken * colour[c]);
        pixel[3] -= taken;
    }
}

impl Band<'_> {
    fn rows(&self) -> usize {
        self.pixels.len() / self.columns
    }
}

/// Whole numbers from `low` to `high`, both inclusive, of `count` from `first` on; `None` if there are none.
fn whole(low: f64, high: f64, first: usize, count: usize) -> Option<(usize, usize)> {
    let last = first + count - 1;
    let (from, to) = (low.ceil().max(first as f64), high.floor().min(last as f64));
    // NaN compares false.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between `first` and `last`")]
    (from <= to).then_some((from as usize, to as usize))
}
