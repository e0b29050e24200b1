//! Voxels as 3-D Gaussians: place, shape, opacity and colour, in the conventions of 3-D Gaussian splatting.
//!
//! *Shape.* The library's kernel: a Gaussian of 0.7 grid steps along each axis, one ellipsoid for all voxels.
//!
//! *Opacity.* The optical depth at the centre of a voxel's footprint is `tau P / (2 pi sqrt |V|)` (docs/OPTICS.md, section
//! 4, without a cut-off). Seen along grid axis c it is `tau m^2 / (2 pi sigma^2 s_a s_b)`, with the spacings s and
//! their geometric mean m; the geometric mean over the three axes is `tau / (2 pi sigma^2)`. A splat has one opacity,
//! so it gets that depth's: `1 - exp(-tau / (2 pi sigma^2))`. With equal spacings it is exact from everywhere.
//!
//! *Colour.* Viewers blend display values, so colours are sRGB. The light is at the eye: a voxel shows `srgb(colour
//! (ambient + diffuse t))` with the cosine t between its normal and the direction to the eye. Spherical harmonics of
//! degree 1 are linear in the direction, and so in t: they hold the line `p + q t` that is nearest for t from 0 to 1 (least
//! squares). Seen from behind, a voxel is darker than in our pictures; there is no highlight.
//!
//! Source: Kerbl et al., "3D Gaussian Splatting for Real-Time Radiance Field Rendering", 2023, and its PLY files.

use adjsplat::arena::{LaneSet, Record};
use adjsplat::classify::colour::srgb_from_linear;
use adjsplat::error::{Error, Result};
use adjsplat::internals::MAX_DEPTH;
use adjsplat::internals::scatter::Table;
use adjsplat::splat::{Lighting, Quality, Scene, Settings};
use glam::{DMat3, DQuat, DVec3};

use super::eigen::ellipsoid_axes;
use super::output::{Progress, Written};
use super::voxels::StoredVoxels;

/// Value of the constant spherical harmonic, `1 / (2 sqrt pi)`.
pub(crate) const SH_0: f64 = 0.282_094_791_773_878_14;
/// Factor of the three linear spherical harmonics, `sqrt(3 / (4 pi))`.
pub(crate) const SH_1: f64 = 0.488_602_511_902_919_9;
/// Number of cosines at which a line is fitted to the shading.
const COSINES: u8 = 17;

/// One Gaussian; shape and rotation are the same for all: [`Gaussians::half_axes`], [`Gaussians::rotation`].
pub(crate) struct Gaussian {
    pub(crate) position: [f64; 3],
    /// Alpha at the centre, above 0 and below 1.
    pub(crate) opacity: f64,
    /// Coefficients of the constant harmonic for red, green, blue.
    pub(crate) constant: [f64; 3],
    /// Coefficients of the linear harmonics, by harmonic (y, z, x), then by red, green, blue.
    pub(crate) linear: [[f64; 3]; 3],
}

/// The voxels of an arena as Gaussians.
pub(crate) struct Gaussians<'a> {
    pub(crate) voxels: &'a StoredVoxels<'a>,
    /// Number of Gaussians: voxels that are not transparent.
    pub(crate) count: u64,
    /// Standard deviations along the axes of [`Gaussians::rotation`], in world units.
    pub(crate) half_axes: DVec3,
    pub(crate) rotation: DQuat,
    lanes: LaneSet<'a>,
    /// The line `p + q t` of red, green and blue, by value code: `[p, q]`.
    shading: Vec<[[f64; 2]; 3]>,
}

impl<'a> Gaussians<'a> {
    /// Prepares colours, and counts the voxels that are not transparent.
    ///
    /// # Errors
    /// [`Error::Input`] if the transfer function is unknown, or if it makes all voxels transparent.
    pub(crate) fn new(voxels: &'a StoredVoxels<'a>) -> Result<Gaussians<'a>> {
        let Some(transfer) = &voxels.transfer else {
            let why = "is unknown: the file stores none that this library reads; give one";
            return Err(Error::input("transfer function", why));
        };
        let grid = &voxels.grid;
        let sigma = f64::from(Quality::Standard.kernel().sigma);
        let steps: [DVec3; 3] = std::array::from_fn(|a| DVec3::from_array(grid.direction[a]) * grid.spacing[a] * sigma);
        let steps = DMat3::from_cols_array_2d(&steps.map(|step| step.to_array()));
        let (rotation, half_axes) = ellipsoid_axes(steps * steps.transpose());
        let shaded = transfer.shaded() && voxels.facts().channels.normal_bits > 0;
        let codes = (0u16..=u16::MAX).zip(&voxels.occurring);
        let shading = codes.map(|(code, occurs)| match occurs {
            true => transfer.colour(voxels.value(code)).map(|component| line(component.into(), shaded)),
            false => [[0.0; 2]; 3],
        });
        let lanes = LaneSet::new(voxels.arena.clone(), None);
        let mut gaussians = Gaussians { voxels, count: 0, half_axes, rotation, lanes, shading: shading.collect() };
        let table = gaussians.table()?;
        let [nx, ny, nz] = grid.dims;
        let mut count = 0;
        voxels.read([0..nx, 0..ny, 0..nz], &mut |_, _, row| {
            count += row.iter().filter(|voxel| is_seen(&table, voxel.record)).count() as u64;
        })?;
        drop(table);
        if count == 0 {
            return Err(Error::input("nothing is visible", "all voxels are transparent with the transfer function"));
        }
        gaussians.count = count;
        Ok(gaussians)
    }

    /// Returns the largest coordinate of a position, without its sign.
    pub(crate) fn farthest(&self) -> f64 {
        let lane = self.voxels.arena.x_lane();
        let (low, high) = lane.bounds().unwrap_or_default();
        let corners = (0..8).map(|corner| {
            self.voxels.position(std::array::from_fn(|a| if corner >> a & 1 == 1 { high[a] } else { low[a] }))
        });
        corners.flatten().map(f64::abs).fold(0.0, f64::max)
    }

    /// Returns a warning if a format that rounds coordinates by up to `rounding` moves positions so much that it shows.
    pub(crate) fn rounding_note(&self, ending: &str, rounding: f64) -> Option<String> {
        let voxels = rounding / self.voxels.grid.finest_spacing();
        (voxels > 0.1).then(|| {
            format!("warning: {ending} rounds positions by up to {voxels:.2} voxels, as the grid is far from the origin; use .csv or .npz")
        })
    }

    /// Returns the table of optical depths by code.
    fn table(&self) -> Result<Table<'_>> {
        let transfer = self.voxels.transfer.as_ref().expect("was there when this was made");
        let scene = Scene { facts: self.voxels.facts(), lanes: &self.lanes, transfer };
        let lane = self.voxels.arena.x_lane();
        Table::new(&scene, &lane, &Settings::new([1, 1]), self.voxels.grid.mean_spacing())
    }

    /// Calls `write` with each Gaussian, slice by slice, and reports each slice to `progress`.
    pub(crate) fn each(&self, progress: &Progress, mut write: impl FnMut(&Gaussian) -> std::io::Result<()>) -> Written {
        let table = self.table()?;
        let sigma = f64::from(Quality::Standard.kernel().sigma);
        let at_centre = std::f64::consts::LN_2 / (std::f64::consts::TAU * sigma * sigma);
        self.voxels.each(progress, |index, record| {
            let [.., depth] = table.look(record.value, record.magnitude);
            if depth <= 0.0 {
                return Ok(());
            }
            let normal = self.voxels.normal(record);
            let lines = self.shading[usize::from(record.value)];
            // A voxel without a normal keeps its colour, which is that of full light.
            let is_lit = normal != [0.0; 3];
            let constant = lines.map(|[p, q]| if is_lit { p } else { p + q });
            let along = |axis: usize, sign: f64| lines.map(|[_, q]| sign * q * normal[axis] / SH_1);
            write(&Gaussian {
                position: self.voxels.position(index),
                // The bounds of the library's renderer; and a logit needs an opacity above 0 and below 1.
                opacity: -(-(f64::from(depth) * at_centre).clamp(1e-30, MAX_DEPTH)).exp_m1(),
                constant: constant.map(|component| (component - 0.5) / SH_0),
                // The harmonics' direction is from the eye to the Gaussian, the normal's to the eye.
                linear: [along(1, 1.0), along(2, -1.0), along(0, 1.0)],
            })
        })
    }
}

fn is_seen(table: &Table, record: Record) -> bool {
    table.look(record.value, record.magnitude)[3] > 0.0
}

/// Returns `[p, q]` of the line `p + q t` that is nearest to the sRGB value of a component in linear light under a light
/// at the eye, for cosines t from 0 to 1. Without shading it is constant.
fn line(component: f64, shaded: bool) -> [f64; 2] {
    let Lighting { ambient, diffuse, .. } = Lighting::default();
    let displayed = |light: f64| srgb_from_linear((component * light).clamp(0.0, 1.0));
    if !shaded {
        return [displayed(1.0), 0.0];
    }
    let samples = (0..COSINES).map(|i| {
        let t = f64::from(i) / f64::from(COSINES - 1);
        (t, displayed(f64::from(ambient) + f64::from(diffuse) * t))
    });
    let [n, st, sv, stt, stv] =
        samples.fold([0.0; 5], |[n, st, sv, stt, stv], (t, v)| [n + 1.0, st + t, sv + v, stt + t * t, stv + t * v]);
    let q = (n * stv - st * sv) / (n * stt - st * st);
    [(sv - q * st) / n, q]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_is_near_the_shading() {
        for component in [0.0, 0.2, 0.5, 1.0] {
            let [p, q] = line(component, true);
            for (t, light) in [(0.0, 0.25), (0.5, 0.625), (1.0, 1.0f64)] {
                let shown = srgb_from_linear(component * light);
                assert!((p + q * t - shown).abs() < 0.05, "{component} {t}: {} {shown}", p + q * t);
            }
        }
        let [constant, slope] = line(1.0, false);
        assert!((constant - 1.0).abs() < 1e-12 && slope == 0.0);
    }
}
