//! The setup of a frame: what every renderer derives from a scene, a camera and settings before it draws.
//!
//! In: a scene, a camera and settings, all unchecked. Out: transforms, order, lane, kernels, lights and clip, checked.

use super::block_kernel::Widths;
use super::clip::ClipRegion;
use super::kernel::KernelShape;
use super::shade::Lights;
use super::{Camera, Scene, Settings, View};
use crate::arena::Lane;
use crate::arena::coverage::MOST_OFFSET;
use crate::error::{Error, Result};
use crate::traverse::{AxisOrder, Order};
use crate::volume::Grid;

/// What a renderer needs to draw the voxels of a frame, except the looks (colours and optical depths) of their codes.
#[derive(Debug, Clone)]
pub struct FrameSetup<'a> {
    /// The camera's transforms.
    pub view: View,
    pub(crate) order: Order,
    /// The lane (all scan lines along one axis) along the order's fast axis.
    pub lane: Lane<'a>,
    pub(crate) lights: Option<Lights>,
    /// The reconstruction kernel to use.
    pub kernel: KernelShape,
    /// Its widths along each axis, where voxels stand for blocks.
    pub(crate) widths: Widths,
    /// The low-pass of its footprints, in pixels.
    pub(crate) low_pass: f32,
    /// The kernel of voxels near the eye.
    pub(crate) near_kernel: KernelShape,
    pub(crate) clip: ClipRegion,
}

impl<'a> FrameSetup<'a> {
    /// Checks the arguments and returns the setup.
    ///
    /// # Errors
    /// [`Error::Input`] or [`Error::Limit`] if settings, camera or lane cannot be used; the error of
    /// [`Lanes::lane`](super::Lanes::lane) if that fails.
    pub fn new(scene: &Scene<'a>, camera: &Camera, settings: &Settings) -> Result<FrameSetup<'a>> {
        settings.check()?;
        let grid = &scene.facts.grid;
        let (kernel, widths) = (settings.kernel(), settings.blocks.widths(settings.fine_kernel()));
        let near_kernel = settings.blocks.mean(settings.fine_kernel());
        let (is_maximum, low_pass) = (settings.mode.is_maximum(), settings.low_pass);
        let mut view = View::new(camera, grid, settings.size, kernel, settings.near)?;
        if is_maximum {
            view.margin = 1.0;
        }
        let order = walk_order(&view, grid, settings)?;
        let lane = scene.lanes.lane(order.fast)?;
        if lane.channels != scene.facts.channels || lane.dims != grid.dims || lane.axis != order.fast {
            return Err(Error::input("lane", "does not belong to the scene's grid or runs along another axis"));
        }
        if lane.channels.coverage_bits > 0 {
            view.margin = view.margin.max(MOST_OFFSET);
        }
        let lit = scene.transfer.shaded() && lane.channels.normal_bits > 0 && !is_maximum;
        let lights = settings.lighting.filter(|_| lit).map(|lighting| Lights::new(&lighting, &view));
        let clip = ClipRegion::new(settings, grid);
        Ok(FrameSetup { view, order, lane, lights, kernel, widths, low_pass, near_kernel, clip })
    }
}

/// Returns the order in which a view visits the voxels of a grid.
///
/// A maximum adds up what neighbouring slices have between them, so it takes them one after the other, also around the
/// eye: all axes run upward.
pub(crate) fn walk_order(view: &View, grid: &Grid, settings: &Settings) -> Result<Order> {
    if settings.mode.is_maximum() {
        let order = Order::new(view.viewpoint, grid.dims, settings.sense, settings.form)?;
        return Ok(Order { along: [AxisOrder::Ascending; 3], ..order });
    }
    settings.order.map_or_else(|| Order::new(view.viewpoint, grid.dims, settings.sense, settings.form), Ok)
}
