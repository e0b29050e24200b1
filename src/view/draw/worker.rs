//! A worker: draws one picture after the other, beside the interface.
//!
//! In: requests, of which a newer one replaces those that still wait. Out: pictures. On a desktop a worker is a thread; in
//! a browser it is a task that gives way while the graphics device draws.

use std::sync::mpsc::Sender;

use adjsplat::Model;
use adjsplat::error::Result;
use adjsplat::splat::{Quality, StopRequest};
use egui::{ColorImage, Context};
use web_time::Instant;

use super::stretch::stretched;
use super::{DeviceModel, picture};
use crate::background;
use crate::look::ViewLook;

/// What draws the pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Renderer {
    /// The processor.
    #[default]
    Processor,
    /// The best graphics device.
    Device,
}

/// A picture to draw.
#[derive(Clone)]
pub(super) struct Request {
    pub(super) model: Model,
    pub(super) look: ViewLook,
    /// The columns and rows that are drawn.
    pub(super) size: [u32; 2],
    /// The columns and rows of the view, which drafts are stretched to.
    pub(super) view: [u32; 2],
    pub(super) quality: Quality,
    pub(super) stop: StopRequest,
    /// Counts the looks that were asked for.
    pub(super) look_index: u64,
}

/// How much of a file on a server a picture shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Completeness {
    /// All that it needs.
    Whole,
    /// All voxels, from a coarser level or from a lane along another axis, which stands in for what has not arrived.
    StandIn,
    /// The voxels that have arrived.
    Part,
}

/// What drawing a picture took.
#[derive(Debug, Clone, PartialEq)]
pub struct Work {
    /// Splats that were drawn.
    pub splats: u64,
    /// Voxels, with stepping voxels, that were walked over.
    pub walked: u64,
    /// The device's name and the bytes of its memory in use; `None` for the processor.
    pub device: Option<(String, u64)>,
    /// How much of what it needs it shows.
    pub completeness: Completeness,
}

/// A picture that was drawn.
pub(super) struct Drawn {
    pub(super) look_index: u64,
    pub(super) size: [u32; 2],
    pub(super) quality: Quality,
    pub(super) milliseconds: f64,
    pub(super) picture: Result<(ColorImage, Work)>,
}

/// Draws until it is dropped.
pub(super) struct Worker {
    requests: async_channel::Sender<Request>,
}

impl Worker {
    pub(super) fn new(
        renderer: Renderer,
        device_model: DeviceModel,
        results: Sender<Drawn>,
        context: Context,
    ) -> Worker {
        let (requests, receiver) = async_channel::unbounded();
        background::run(move || work(renderer, device_model, receiver, results, context));
        Worker { requests }
    }

    pub(super) fn ask(&self, request: Request) {
        // Fails only if the worker panicked: then the last picture stays.
        let _ = self.requests.try_send(request);
    }
}

async fn work(
    renderer: Renderer,
    device_model: DeviceModel,
    requests: async_channel::Receiver<Request>,
    results: Sender<Drawn>,
    context: Context,
) {
    while let Ok(mut request) = requests.recv().await {
        while let Ok(newer) = requests.try_recv() {
            request = newer;
        }
        let start = Instant::now();
        let Request { model, look, size, view, quality, stop, look_index } = request;
        let picture = match renderer {
            Renderer::Processor => picture(&model, &look, size, quality, stop)
                .map(|(image, work)| (stretched(image, view.map(|side| side as usize)), work)),
            // Nothing is drawn until what a finer picture needs has arrived; then it is asked for again.
            Renderer::Device => match device_model.picture(&model, &look, size, quality).await.transpose() {
                Some(picture) => picture,
                None => continue,
            },
        };
        let milliseconds = start.elapsed().as_secs_f64() * 1e3;
        // Nobody receives once the view is closed.
        let _ = results.send(Drawn { look_index, size, quality, milliseconds, picture });
        context.request_repaint();
    }
}
