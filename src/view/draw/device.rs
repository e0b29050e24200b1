//! Pictures by a graphics device, which keeps the lanes of the model from picture to picture.

use std::sync::Arc;

use adjsplat::Model;
use adjsplat::arena::{Lane, OwnedLane};
use adjsplat::error::{Error, Result};
use adjsplat::splat::gpu::adapter::{self, OpenedDevice};
use adjsplat::splat::gpu::{GpuOptions, Resident};
use adjsplat::splat::{Camera, Frame, Lanes as _, Quality, Settings};
use adjsplat::traverse::VoxelBox;
use adjsplat::volume::Axis;
use async_lock::Mutex;
use egui::ColorImage;

use super::{Work, image, settings};
use crate::look::Look;
use crate::remote::Remote;

/// What a device keeps of one model, and where it gets the rest. Clones share it.
#[derive(Clone, Default)]
pub struct Canvas {
    device: Arc<Mutex<OnDevice>>,
    /// The file, if its voxels are not in memory.
    remote: Option<Arc<Remote>>,
}

/// The device.
#[derive(Default)]
pub(crate) struct OnDevice {
    /// The device's name, and what it keeps.
    resident: Option<(String, Resident)>,
}

/// Opens the best device. While a browser starts its process for graphics, it may first say that there is none.
async fn open() -> Result<OpenedDevice> {
    match adapter::open_async(None).await {
        Err(_) if cfg!(target_arch = "wasm32") => adapter::open_async(None).await,
        opened => opened,
    }
}

impl OnDevice {
    /// Returns the device's name and what it keeps; it stays with the caller.
    async fn take(&mut self) -> Result<(String, Resident)> {
        if let Some(resident) = self.resident.take() {
            return Ok(resident);
        }
        let opened = open().await?;
        let resident = Resident::new(opened.device, opened.queue, GpuOptions::default()).await?;
        Ok((opened.facts.name, resident))
    }

    /// Returns whether all of the lane along `axis` is on the device.
    pub(crate) fn has_lane(&self, axis: Axis) -> bool {
        self.resident.as_ref().is_some_and(|(_, resident)| resident.has_lane(axis))
    }

    /// Drops the lane along `axis`.
    pub(crate) fn forget(&mut self, axis: Axis) {
        if let Some((_, resident)) = &mut self.resident {
            resident.forget_lane(axis);
        }
    }

    /// Takes records of a lane: see [`Resident::receive`].
    pub(crate) async fn receive(&mut self, lane: &Lane<'_>, first: u64, channels: [&[u8]; 5]) -> Result<()> {
        let (name, mut resident) = self.take().await?;
        resident.receive(lane, first, channels).await?;
        self.resident = Some((name, resident));
        Ok(())
    }

    /// Draws a frame. After a fault of the device it is opened anew for the next one.
    async fn frame(&mut self, model: &Model, camera: &Camera, settings: &Settings) -> Result<(Frame, Work)> {
        let (name, resident) = self.take().await?;
        let mut renderer = resident.renderer(model.scene());
        let drawn = renderer.render_async(camera, settings).await;
        if !matches!(drawn, Err(Error::Device { .. })) {
            self.resident = Some((name.clone(), renderer.into_resident()));
        }
        let (frame, stats) = drawn?;
        let walked = stats.splats_drawn + stats.splats_skipped;
        Ok((frame, Work { splats: stats.splats_drawn, walked, device: Some((name, stats.vram_bytes)) }))
    }
}

impl Canvas {
    /// Creates a canvas for a model whose voxels are in `remote`, if they are not in memory.
    pub fn new(remote: Option<Arc<Remote>>) -> Canvas {
        Canvas { device: Arc::default(), remote }
    }

    /// Returns the file, if its voxels are not in memory.
    pub fn remote(&self) -> Option<&Arc<Remote>> {
        self.remote.as_ref()
    }

    /// Begins to fetch the lane that a first picture needs.
    ///
    /// # Errors
    /// The errors of the camera and the settings.
    pub fn begin(&self, model: &Model, look: &Look, size: [u32; 2]) -> Result<()> {
        if let Some(remote) = &self.remote {
            let order = model.order(&look.eye.camera()?, &settings(model, look, size, Quality::Draft)?)?;
            remote.begin(order.fast, &self.device);
        }
        Ok(())
    }

    /// Returns the picture of a look, over its background. All models must have the same voxels.
    ///
    /// While the lane that it needs is being fetched, another one stands in; splats that overlap are then composited in
    /// another order, which is right but for neighbours.
    ///
    /// # Errors
    /// The errors of the camera, the settings and [`Canvas::frame`].
    pub async fn picture(
        &self,
        model: &Model,
        look: &Look,
        size: [u32; 2],
        quality: Quality,
    ) -> Result<(ColorImage, Work)> {
        let (camera, mut settings) = (look.eye.camera()?, settings(model, look, size, quality)?);
        let mut device = self.device.lock().await;
        if let Some(remote) = &self.remote {
            let order = model.order(&camera, &settings)?;
            if !device.has_lane(order.fast) {
                remote.begin(order.fast, &self.device);
                let whole = Axis::ALL.into_iter().find(|axis| device.has_lane(*axis));
                let there = whole.or(remote.fetching().map(|(axis, _)| axis)).unwrap_or(order.fast);
                if settings.mode.is_maximum() && there != order.fast {
                    // A maximum is of slices in the view's order.
                    drop(device);
                    remote.fetch(order.fast, &self.device).await?;
                    device = self.device.lock().await;
                } else {
                    settings = settings.with_order(order.with_fast(there));
                }
            }
        }
        let (frame, work) = device.frame(model, &camera, &settings).await?;
        Ok((image(frame, look, size), work))
    }

    /// Draws a frame; waits for the lane that it needs. All models must have the same voxels.
    ///
    /// # Errors
    /// The errors of [`adapter::open_async`] and [`adjsplat::splat::gpu::GpuRenderer::render`], and of fetching.
    pub async fn frame(&self, model: &Model, camera: &Camera, settings: &Settings) -> Result<(Frame, Work)> {
        if let Some(remote) = &self.remote {
            remote.fetch(model.order(camera, settings)?.fast, &self.device).await?;
        }
        self.device.lock().await.frame(model, camera, settings).await
    }

    /// Reads tiles of a lane that has arrived back into memory: see [`Resident::tiles_back`]; without voxels if none has.
    ///
    /// # Errors
    /// The errors of [`Resident::tiles_back`].
    pub async fn tiles_back(&self, model: &Model, wants: impl Fn(&VoxelBox) -> bool) -> Result<OwnedLane> {
        let mut device = self.device.lock().await;
        let whole = Axis::ALL.into_iter().find(|axis| device.has_lane(*axis));
        let there = whole.or(self.remote.as_ref().and_then(|remote| remote.fetching()).map(|(axis, _)| axis));
        let lane = model.lane(there.unwrap_or(Axis::X))?;
        match &mut device.resident {
            Some((_, resident)) => resident.tiles_back(&lane, wants).await,
            None => Ok(OwnedLane::new(lane.axis, lane.dims, lane.channels)),
        }
    }
}
