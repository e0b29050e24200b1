//! Projects voxels to footprints and composites them into pixels.
//!
//! ```text
//! depth(x) = depth of a mean voxel * (pixels per mean area) / (2 pi sqrt |V|) * exp(-x^T V^-1 x / 2)
//! V        = sigma^2 M M^T + low-pass; M: 2 x 3, pixels per voxel
//! pixel   += transmittance * (1 - exp(-depth)) * colour
//! ```
//!
//! In a perspective, let D be the direction of the ray through a pixel, in voxels, one unit forward ([`EyeRays`]). Where the low-pass adds
//! nothing, the depth is the kernel's integral along the ray:
//!
//! ```text
//! x^T V^-1 x is multiplied by |D at the centre|^2 / |D|^2
//! the depth at the centre, by stretch / (stretch at the centre), where the stretch is D's length in the world over |D|
//! ```
//!
//! Kernels near the eye are not projected, but integrated along rays.
//!
//! Source: Zwicker et al., "EWA Volume Splatting", 2001.

use adjsplat::internals::{Affine, MAX_DEPTH, PixelMap};
use adjsplat::splat::{Blending, Mode, View};
use adjsplat::traverse::Viewpoint;

use glam::{DMat3, DVec3};

use super::closed::normal_distribution;
use super::light::ReferenceLights;
use super::splat::JudgeSettings;
use super::voxels::ReferenceVoxel;

/// The transmittance below which a pixel no longer changes in double precision.
const GONE: f64 = 1e-18;

/// A band of rows of a picture, which one thread draws.
pub(super) struct PixelRows<'a> {
    pub(super) first_row: usize,
    pub(super) columns: usize,
    pub(super) pixels: &'a mut [[f64; 4]],
}

/// The covariance matrix of a footprint, in square pixels.
#[derive(Debug, Clone, Copy)]
struct SplatCovariance {
    xx: f64,
    xy: f64,
    yy: f64,
    determinant: f64,
    /// Whether the low-pass filter has widened it.
    is_widened: bool,
}

impl SplatCovariance {
    /// Creates the covariance of a kernel projected by a Jacobian (in pixels per voxel), and adds the low-pass filter.
    fn new([x, y]: [[f64; 3]; 2], settings: &JudgeSettings) -> SplatCovariance {
        let square = settings.sigma * settings.sigma;
        let [x, y] = [x, y].map(glam::DVec3::from_array);
        let (xx, xy, yy) = (square * x.dot(x), square * x.dot(y), square * y.dot(y));
        let determinant = square * square * x.cross(y).length_squared();
        // The larger eigenvalue is a sum, so it loses no digits to cancellation; the smaller follows from the
        // determinant.
        let widest = (xx + yy) / 2.0 + ((xx - yy) / 2.0).hypot(xy);
        let narrowest = if widest > 0.0 { determinant / widest } else { 0.0 };
        let added = (settings.low_pass.powi(2) - narrowest).max(0.0);
        let determinant = determinant + added * (xx + yy + added);
        SplatCovariance { xx: xx + added, xy, yy: yy + added, determinant, is_widened: added > 0.0 }
    }
}

/// Draws the voxels of one view as splats.
pub(super) struct SplatProjector<'a> {
    map: PixelMap,
    settings: &'a JudgeSettings,
    lights: Option<ReferenceLights>,
    /// Scales weights up by what the cut-off loses, times the factor 1 / (2 pi).
    strength: f64,
    exposure: f64,
    /// The covariance of every footprint in a parallel view; `None` in perspective.
    footprint: Option<SplatCovariance>,
    /// The rays of a perspective view; `None` in a parallel one.
    rays: Option<EyeRays>,
}

impl<'a> SplatProjector<'a> {
    pub(super) fn new(view: &View, settings: &'a JudgeSettings, exposure: f64) -> SplatProjector<'a> {
        let lost = (-0.5 * settings.cut_off * settings.cut_off).exp();
        let footprint = match &view.map {
            PixelMap::Parallel { pixel_from_voxel, .. } => {
                Some(SplatCovariance::new(pixel_from_voxel.map(|m| [m[0], m[1], m[2]]), settings))
            }
            PixelMap::Perspective { .. } => None,
        };
        SplatProjector {
            map: view.map,
            settings,
            lights: settings.lighting.map(|lighting| ReferenceLights::new(lighting, view)),
            strength: 1.0 / (std::f64::consts::TAU * (1.0 - lost)),
            exposure,
            footprint,
            rays: EyeRays::new(view),
        }
    }

    /// Returns a footprint's centre and covariance, and the pixels per mean area across the ray; `None` if the voxel is
    /// too near the eye for a footprint.
    fn project(&self, voxel: &ReferenceVoxel) -> Option<([f64; 2], SplatCovariance, f64)> {
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
                // A pixel's solid angle is cos^3 / focal^2; the voxel is at the distance t2 / cos.
                let slant = (1.0 + across * across + above * above).sqrt();
                let centre = [centre[0] + focal * across, centre[1] - focal * above];
                Some((centre, SplatCovariance::new(jacobian, self.settings), scale * scale * slant))
            }
            (PixelMap::Parallel { .. }, None) => None,
        }
    }

    pub(super) fn splat(&self, voxel: &ReferenceVoxel, band: &mut PixelRows) {
        let Some(([x, y], footprint, density)) = self.project(voxel) else { return self.splat_near(voxel, band) };
        let SplatCovariance { xx, xy, yy, determinant, is_widened } = footprint;
        // The weight at the centre of a footprint, scaled so that the weights of a layer of voxels add up to 1.
        let weight = self.strength * density / determinant.sqrt();
        let rays = self.rays.as_ref().filter(|_| !is_widened).map(|rays| (rays, rays.lengths([x, y])));
        // For a pixel: by what the exponent and the depth at the centre are multiplied.
        let on_ray = |column: usize, row: usize| {
            let Some((rays, [at_centre, stretch_at_centre])) = rays else { return [1.0; 2] };
            let [length, stretch] = rays.lengths([column as f64, row as f64]);
            [(at_centre / length).powi(2), stretch / stretch_at_centre]
        };
        let cut = self.settings.cut_off * self.settings.cut_off;
        // The square of a direction's length is convex: it is largest in a corner.
        let widest = match rays {
            None => 1.0,
            Some(_) => {
                let last = [band.columns - 1, band.first_row + band.rows() - 1];
                let corners = [[0, band.first_row], [last[0], band.first_row], [0, last[1]], last];
                corners.map(|[column, row]| 1.0 / on_ray(column, row)[0]).into_iter().fold(1.0, f64::max)
            }
        };
        let reach = (cut * widest * yy).sqrt();
        let Some((first_row, last_row)) = whole(y - reach, y + reach, band.first_row, band.rows()) else { return };
        let reach_x = (cut * widest * xx).sqrt();
        let is_visible = self.peak(voxel, weight) > 0.0 && whole(x - reach_x, x + reach_x, 0, band.columns).is_some();
        if !is_visible {
            return;
        }
        let colour = self.colour(voxel);
        for row in first_row..=last_row {
            let dy = row as f64 - y;
            let room = cut * widest - dy * dy / yy;
            if room < 0.0 {
                continue;
            }
            // Along a row of pixels, the exponent is that of a Gaussian around the point where the footprint is
            // strongest.
            let (middle, half_width) = (x + xy / yy * dy, (room * determinant / yy).sqrt());
            let Some((first, last)) = whole(middle - half_width, middle + half_width, 0, band.columns) else {
                continue;
            };
            let row_pixels = &mut band.pixels[(row - band.first_row) * band.columns..][..band.columns];
            for (column, pixel) in (first..=last).zip(&mut row_pixels[first..=last]) {
                let dx = column as f64 - middle;
                let [factor, stretch] = on_ray(column, row);
                let square = (dx * dx * yy / determinant + dy * dy / yy) * factor;
                if square <= cut {
                    self.blend(pixel, self.peak(voxel, weight * stretch) * (-0.5 * square).exp(), colour);
                }
            }
        }
    }

    /// Draws a voxel near the eye: integrates its kernel along each ray that passes it, from the eye on.
    fn splat_near(&self, voxel: &ReferenceVoxel, band: &mut PixelRows) {
        let Some(rays) = &self.rays else { return };
        let sigma = self.settings.sigma;
        let radius = self.settings.cut_off * sigma;
        let offset = DVec3::from_array(voxel.position.map(f64::from)) - rays.eye;
        if rays.gradients[2].dot(offset) < rays.clip {
            return;
        }
        let is_inside = offset.length() <= radius;
        // Rays of one row lie in a plane, and so do those of one column.
        let meets = |normal: DVec3| normal.dot(offset).abs() <= radius * normal.length();
        let [right, up, forward] = rays.gradients;
        let columns: Vec<(usize, f64)> = (0..band.columns)
            .map(|column| (column, (column as f64 - rays.centre[0]) / rays.focal))
            .filter(|(_, tangent)| meets(right - forward * *tangent))
            .collect();
        let colour = self.colour(voxel);
        for row in 0..band.rows() {
            let above = (rays.centre[1] - (band.first_row + row) as f64) / rays.focal;
            if !meets(up - forward * above) {
                continue;
            }
            for &(column, across) in &columns {
                let direction = rays.voxel_from_camera * DVec3::new(across, above, 1.0);
                let length = direction.length();
                let (along, aside) = (offset.dot(direction) / length, offset.cross(direction).length() / length);
                if aside > radius || (!is_inside && along <= 0.0) {
                    continue;
                }
                let stretch = (1.0 + across * across + above * above).sqrt() / length;
                let peak = self.peak(voxel, self.strength / (sigma * sigma) * stretch);
                let part = if is_inside { normal_distribution(along / sigma) } else { 1.0 };
                let amount = peak * (-0.5 * (aside / sigma).powi(2)).exp() * part;
                self.blend(&mut band.pixels[row * band.columns + column], amount, colour);
            }
        }
    }

    /// Returns the largest amount that a voxel adds to a pixel: an optical depth, or an opacity with linear blending.
    ///
    /// `weight` is the integral of its kernel along a line through its centre.
    fn peak(&self, voxel: &ReferenceVoxel, weight: f64) -> f64 {
        match self.settings.blending {
            Blending::Linear => -(-voxel.depth * self.exposure).exp_m1() * weight,
            _ => (voxel.depth * self.exposure * weight).min(MAX_DEPTH),
        }
    }

    fn colour(&self, voxel: &ReferenceVoxel) -> [f64; 3] {
        self.lights.map_or_else(|| voxel.colour.map(f64::from), |lights| lights.lit(voxel))
    }

    /// Composites `colour` behind what the pixel shows. `amount` is an optical depth (an opacity with linear blending).
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
            Blending::Linear => amount.min(1.0),
            _ => -(-amount).exp_m1(),
        };
        let taken = pixel[3] * opacity;
        (0..3).for_each(|c| pixel[c] += taken * colour[c]);
        pixel[3] -= taken;
    }
}

/// The rays of a perspective view in voxel coordinates, where a kernel is a round Gaussian.
#[derive(Debug, Clone, Copy)]
struct EyeRays {
    eye: DVec3,
    /// The direction of a ray from its tangents to the right and upward, and 1.
    voxel_from_camera: DMat3,
    /// The changes of the distances to the right, up and forward, in mean spacings per voxel.
    gradients: [DVec3; 3],
    focal: f64,
    centre: [f64; 2],
    /// The depth below which voxels are not drawn, in mean spacings.
    clip: f64,
}

impl EyeRays {
    fn new(view: &View) -> Option<EyeRays> {
        let (PixelMap::Perspective { camera_from_voxel, focal, centre, .. }, Viewpoint::Perspective { eye, .. }) =
            (&view.map, view.viewpoint)
        else {
            return None;
        };
        let gradients = camera_from_voxel.map(|[x, y, z, _]| DVec3::new(x, y, z));
        let [right, up, forward] = gradients;
        let voxel_from_camera = DMat3::from_cols(right, up, forward).transpose().inverse();
        let eye = DVec3::from_array(eye);
        Some(EyeRays { eye, voxel_from_camera, gradients, focal: *focal, centre: *centre, clip: view.clip })
    }

    /// Returns the length in voxels of the ray through a place in the picture, one unit forward, and the ray's stretch.
    fn lengths(&self, [column, row]: [f64; 2]) -> [f64; 2] {
        let (across, above) = ((column - self.centre[0]) / self.focal, (self.centre[1] - row) / self.focal);
        let length = (self.voxel_from_camera * DVec3::new(across, above, 1.0)).length();
        [length, (1.0 + across * across + above * above).sqrt() / length]
    }
}

impl PixelRows<'_> {
    fn rows(&self) -> usize {
        self.pixels.len() / self.columns
    }
}

/// Returns the first and last whole number from `low` to `high`, inclusive, among the `count` numbers from `first` on.
fn whole(low: f64, high: f64, first: usize, count: usize) -> Option<(usize, usize)> {
    let last = first + count - 1;
    let (from, to) = (low.ceil().max(first as f64), high.floor().min(last as f64));
    // With NaN the comparison is false.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between `first` and `last`")]
    (from <= to).then_some((from as usize, to as usize))
}
