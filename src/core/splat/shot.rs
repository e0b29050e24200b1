//! A shot: what every renderer derives from a scene, a camera and settings before it draws.
//!
//! In: those three, checked here. Out: the view, the order of the walk and its lane, lights, kernel.

use super::kernel::KernelShape;
use super::shade::Lights;
use super::{Camera, Scene, Settings, View};
use crate::arena::Lane;
use crate::error::{Error, Result};
use crate::traverse::{Order, VoxelBox};

/// What a frame is made of, beside the looks of codes.
#[derive(Debug, Clone)]
pub struct Shot<'a> {
    pub view: View,
    pub(crate) order: Order,
    /// Along the order's fast axis.
    pub lane: Lane<'a>,
    pub(crate) lights: Option<Lights>,
    pub kernel: KernelShape,
    pub(crate) crop: Option<VoxelBox>,
    /// Whether the mode is one of the two maxima.
    pub(crate) maximum: bool,
}

impl<'a> Shot<'a> {
    /// # Errors
    /// [`Error::Input`] or [`Error::Limit`] if settings, camera or lane cannot be used; whatever
    /// [`Lanes::lane`](super::Lanes::lane) fails with.
    pub fn new(scene: &Scene<'a>, camera: &Camera, settings: &Settings) -> Result<Shot<'a>> {
        settings.check()?;
        let kernel = settings.kernel();
        let view = View::new(camera, &scene.facts.grid, settings.size, kernel, settings.near)?;
        let order = match settings.order {
            Some(order) => order,
            None => Order::new(view.viewpoint, scene.facts.grid.dims, settings.sense, settings.form)?,
        };
        let lane = scene.lanes.lane(order.fast)?;
        if lane.channels != scene.facts.channels || lane.dims != scene.facts.grid.dims || lane.axis != order.fast {
            return Err(Error::input("lane", "does not belong to the scene's grid or runs along another axis"));
        }
        let maximum = settings.mode.is_maximum();
        let lit = scene.transfer.shaded() && lane.channels.normal_bits > 0 && !maximum;
        let lights = settings.lighting.filter(|_| lit).map(|lighting| Lights::new(&lighting, &view));
        Ok(Shot { view, order, lane, lights, kernel, crop: settings.crop, maximum })
    }
}
