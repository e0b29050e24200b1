//! Pictures by a graphics device, which keeps the lanes of the model from picture to picture.

use adjsplat::Model;
use adjsplat::error::{Error, Result};
use adjsplat::splat::gpu::adapter::{self, OpenedDevice};
use adjsplat::splat::gpu::{GpuOptions, GpuRenderer, Resident};
use adjsplat::splat::{Camera, Frame, Quality, Settings};
use egui::ColorImage;

use super::{Work, image, settings};
use crate::look::Look;

/// What a device keeps of one model.
#[derive(Default)]
pub struct Canvas {
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

impl Canvas {
    /// Returns the picture of a look, over its background. All models must have the same voxels.
    ///
    /// # Errors
    /// The errors of the camera, the settings and [`Canvas::frame`].
    pub async fn picture(
        &mut self,
        model: &Model,
        look: &Look,
        size: [u32; 2],
        quality: Quality,
    ) -> Result<(ColorImage, Work)> {
        let settings = settings(model, look, size, quality)?;
        let (frame, work) = self.frame(model, &look.eye.camera()?, &settings).await?;
        Ok((image(frame, look, size), work))
    }

    /// Draws a frame. All models must have the same voxels.
    ///
    /// After a fault of the device it is opened anew for the next frame.
    ///
    /// # Errors
    /// The errors of [`adapter::open_async`] and [`GpuRenderer::render`].
    pub async fn frame(&mut self, model: &Model, camera: &Camera, settings: &Settings) -> Result<(Frame, Work)> {
        let (name, mut renderer) = match self.resident.take() {
            Some((name, resident)) => (name, resident.renderer(model.scene())),
            None => {
                let opened = open().await?;
                let options = GpuOptions::default();
                let renderer = GpuRenderer::new_async(opened.device, opened.queue, model.scene(), options).await?;
                (opened.facts.name, renderer)
            }
        };
        let drawn = renderer.render_async(camera, settings).await;
        if !matches!(drawn, Err(Error::Device { .. })) {
            self.resident = Some((name.clone(), renderer.into_resident()));
        }
        let (frame, stats) = drawn?;
        let walked = stats.splats_drawn + stats.splats_skipped;
        Ok((frame, Work { splats: stats.splats_drawn, walked, device: Some((name, stats.vram_bytes)) }))
    }
}
