//! Pictures by a graphics device, which keeps the lanes of the model from picture to picture.

use std::sync::Arc;

use adjsplat::Model;
use adjsplat::arena::{Lane, OwnedLane};
use adjsplat::error::{Error, Result};
use adjsplat::internals::{drawn_levels, level_order};
use adjsplat::splat::gpu::adapter::{self, OpenedDevice};
use adjsplat::splat::gpu::{GpuOptions, Resident};
use adjsplat::splat::{Camera, Frame, Lanes as _, Quality, Settings};
use adjsplat::traverse::{Order, VoxelBox};
use adjsplat::volume::Axis;
use async_lock::Mutex;
use egui::ColorImage;

use super::worker::Completeness;
use super::{Work, image, settings};
use crate::look::ViewLook;
use crate::remote::{LaneOf, Remote};

/// What a device keeps of one model, and where it gets the rest. Clones share it.
#[derive(Clone, Default)]
pub struct DeviceModel {
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

    /// Returns whether all of a lane is on the device.
    pub(crate) fn has_lane(&self, lane: LaneOf) -> bool {
        self.resident.as_ref().is_some_and(|(_, resident)| resident.has_lane(lane.level, lane.axis))
    }

    /// Drops a lane.
    pub(crate) fn forget(&mut self, lane: LaneOf) {
        if let Some((_, resident)) = &mut self.resident {
            resident.forget_lane(lane.level, lane.axis);
        }
    }

    /// Takes records of a lane of a level: see [`Resident::receive`].
    pub(crate) async fn receive(
        &mut self,
        level: usize,
        lane: &Lane<'_>,
        first: u64,
        channels: [&[u8]; 5],
    ) -> Result<()> {
        let (name, mut resident) = self.take().await?;
        resident.receive(level, lane, first, channels).await?;
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
        Ok((
            frame,
            Work {
                splats: stats.splats_drawn,
                walked,
                device: Some((name, stats.vram_bytes)),
                completeness: Completeness::Whole,
            },
        ))
    }
}

/// What is drawn where lanes that a picture needs have not arrived, and what is fetched.
///
/// Splats that overlap are composited in another order where a lane along another axis stands in, which is right but for
/// neighbours. Of a coarser level one lane is enough, for pictures of one level: such pictures are replaced by those of level 0
/// when the view rests.
struct StandIn {
    /// The lane that is drawn in place of those that are needed; `None` if there is none.
    lane: Option<LaneOf>,
    /// The first lane that has to be fetched; `None` if what is there is enough.
    fetch: Option<LaneOf>,
    /// The finest level of which a lane is there.
    finest: Option<usize>,
}

impl StandIn {
    /// Returns what stands in for what is needed: levels, coarsest first, with the orders in which they are visited. `None` if all of
    /// it is there.
    fn new(remote: &Remote, device: &OnDevice, needed: &[(usize, Order)], quality: Quality) -> Option<StandIn> {
        let there = |level: usize, axis: Axis| remote.is_there(LaneOf { level, axis }, device);
        let finest = (0..=remote.level_count()).find(|level| Axis::ALL.into_iter().any(|axis| there(*level, axis)));
        let (level, order) = needed.iter().find(|(level, order)| !there(*level, order.fast))?;
        let wanted = LaneOf { level: *level, axis: order.fast };
        // The voxels themselves, if they are there, are better than any level; only drafts must be fast.
        let own = LaneOf { level: 0, axis: order.fast };
        if quality != Quality::Draft && there(0, order.fast) {
            return Some(StandIn { lane: Some(own), fetch: None, finest });
        }
        // The nearest level to the finest one that is needed, finer ones first; lanes along the right axis first.
        let target = needed.iter().map(|(level, _)| *level).min().unwrap_or(0);
        let lanes = (0..=remote.level_count()).flat_map(|level| Axis::ALL.map(|axis| LaneOf { level, axis }));
        let lane = lanes
            .filter(|lane| there(lane.level, lane.axis))
            .min_by_key(|lane| (lane.level.abs_diff(target), lane.level, lane.axis != order.fast));
        let is_enough = needed.len() == 1 && *level > 0 && lane.is_some_and(|lane| lane.level == *level);
        Some(StandIn { lane, fetch: (!is_enough).then_some(wanted), finest })
    }
}

impl DeviceModel {
    /// Creates a device's part of a model. `remote`: its file, if the voxels are not in memory.
    pub fn new(remote: Option<Arc<Remote>>) -> DeviceModel {
        DeviceModel { device: Arc::default(), remote }
    }

    /// Returns the file, if its voxels are not in memory.
    pub fn remote(&self) -> Option<&Arc<Remote>> {
        self.remote.as_ref()
    }

    /// Begins to fetch what a first picture shows.
    ///
    /// # Errors
    /// The errors of the camera and the settings.
    pub fn begin(&self, model: &Model, look: &ViewLook, size: [u32; 2]) -> Result<()> {
        if let Some(remote) = &self.remote {
            let settings = settings(model, look, size, Quality::Draft)?;
            let needed = drawn_levels(&model.scene(), &look.eye.camera()?, &settings)?;
            // The coarsest level that is needed has the fewest bytes.
            if let Some((level, order)) = needed.first() {
                remote.begin(LaneOf { level: *level, axis: order.fast }, None, &self.device, look);
            }
        }
        Ok(())
    }

    /// Returns the picture of a look, over its background. All models must have the same voxels.
    ///
    /// While a lane that it needs is being fetched, another one or a coarser level stands in. There is no picture
    /// at [`Quality::High`] until all that it needs is there.
    ///
    /// # Errors
    /// The errors of the camera, the settings and [`DeviceModel::frame`].
    pub async fn picture(
        &self,
        model: &Model,
        look: &ViewLook,
        size: [u32; 2],
        quality: Quality,
    ) -> Result<Option<(ColorImage, Work)>> {
        let (camera, mut settings) = (look.eye.camera()?, settings(model, look, size, quality)?);
        let mut device = self.device.lock().await;
        let mut completeness = Completeness::Whole;
        if let Some(remote) = &self.remote {
            let needed = drawn_levels(&model.scene(), &camera, &settings)?;
            if let Some(StandIn { lane, fetch, finest }) = StandIn::new(remote, &device, &needed, quality) {
                // After a failure, a view that moves does not ask for every draft.
                let waits = quality == Quality::Draft && remote.has_failed();
                if let Some(wanted) = fetch.filter(|_| !waits) {
                    remote.begin(wanted, finest, &self.device, look);
                    if quality == Quality::High && remote.fetching().is_some() {
                        return Ok(None);
                    }
                }
                completeness = match (lane, fetch) {
                    (None, _) => Completeness::Part,
                    (_, None) => Completeness::Whole,
                    _ => Completeness::StandIn,
                };
                if let Some(mut lane) = lane.or_else(|| Some(remote.fetching()?.0)) {
                    let order = level_order(&model.scene(), lane.level, &camera, &settings)?;
                    if settings.mode.is_maximum() && lane.axis != order.fast {
                        // A maximum is of slices in the view's order.
                        drop(device);
                        lane.axis = order.fast;
                        remote.fetch(lane, &self.device, Some(look)).await?;
                        device = self.device.lock().await;
                    }
                    settings = settings.with_level(lane.level);
                    if lane.axis != order.fast {
                        settings = settings.with_order(order.with_fast(lane.axis));
                    }
                }
            }
        }
        let (frame, work) = device.frame(model, &camera, &settings).await?;
        Ok(Some((image(frame, look, size), Work { completeness, ..work })))
    }

    /// Draws a frame; waits for the lanes that it needs. All models must have the same voxels.
    ///
    /// # Errors
    /// The errors of [`adapter::open_async`] and [`adjsplat::splat::gpu::GpuRenderer::render`], and of fetching.
    pub async fn frame(&self, model: &Model, camera: &Camera, settings: &Settings) -> Result<(Frame, Work)> {
        if let Some(remote) = &self.remote {
            for (level, order) in drawn_levels(&model.scene(), camera, settings)? {
                remote.fetch(LaneOf { level, axis: order.fast }, &self.device, None).await?;
            }
        }
        self.device.lock().await.frame(model, camera, settings).await
    }

    /// Reads tiles of a lane that has arrived back into memory: see [`Resident::tiles_back`]; without voxels if none has.
    ///
    /// # Errors
    /// The errors of [`Resident::tiles_back`].
    pub async fn tiles_back(&self, model: &Model, wants: impl Fn(&VoxelBox) -> bool) -> Result<OwnedLane> {
        let mut device = self.device.lock().await;
        let whole = Axis::ALL.into_iter().find(|axis| device.has_lane(LaneOf { level: 0, axis: *axis }));
        let fetching = self.remote.as_ref().and_then(|remote| remote.fetching());
        let there = whole.or(fetching.filter(|(lane, _)| lane.level == 0).map(|(lane, _)| lane.axis));
        let lane = model.lane(there.unwrap_or(Axis::X))?;
        match &mut device.resident {
            Some((_, resident)) => resident.tiles_back(&lane, wants).await,
            None => Ok(OwnedLane::new(lane.axis, lane.dims, lane.channels)),
        }
    }
}
