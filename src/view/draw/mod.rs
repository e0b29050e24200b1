//! Drawing in the background: the interface never waits for a picture.
//!
//! In: a model, a look and the size of the view, every frame of the interface. Out: the best picture so far.
//! When the look changes, it is drawn in `draft`, with fewer pixels if that takes long. When it rests, it is drawn in
//! `standard`, then in `high`. Requests go to workers; the processor has one for drafts and one for finer pictures, a
//! graphics device one for both.

mod device;
mod draft_size;
mod stretch;
mod texture;
mod worker;

use std::sync::Arc;
use std::sync::mpsc::{Receiver, channel};

use adjsplat::Model;
use adjsplat::classify::Colour;
use adjsplat::error::Result;
use adjsplat::splat::{Frame, Quality, Settings, StopRequest};
use egui::{Color32, ColorImage, Context};

use crate::look::ViewLook;
pub use device::DeviceModel;
pub(crate) use device::OnDevice;
use draft_size::DraftSize;
pub use texture::install;
pub(crate) use texture::shape;
pub use worker::{Completeness, Renderer, Work};
use worker::{Drawn, Request, Worker};

/// How long a view rests before it is drawn in `standard`, and then in `high`, in seconds.
const RESTS: [f64; 2] = [0.08, 0.4];

/// What the view shows, in numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct Shown {
    /// The quality of the picture.
    pub quality: Quality,
    /// The columns and rows of the picture.
    pub size: [u32; 2],
    /// How long drawing took, in milliseconds.
    pub milliseconds: f64,
    /// What drawing it took.
    pub work: Work,
    look_index: u64,
}

/// Draws the pictures of one view.
pub struct Painter {
    context: Context,
    device_model: DeviceModel,
    draft: Worker,
    /// Draws finer pictures, if that is not the same worker.
    finer: Option<Worker>,
    results: Receiver<Drawn>,
    /// The look, the model's version and the size of the last request.
    asked: Option<(ViewLook, u64, [u32; 2])>,
    /// How often more of the file had arrived at the last request.
    arrivals: u64,
    look_index: u64,
    changed_at: f64,
    /// The best quality that was asked for since the look changed.
    asked_quality: Quality,
    /// Stops the pictures finer than drafts that were asked for since then.
    stop: StopRequest,
    draft_size: DraftSize,
    image: Option<Arc<ColorImage>>,
    shown: Option<Shown>,
    fault: Option<String>,
}

impl Painter {
    /// Creates a painter, which draws on `device_model` if a device draws; it wakes `context` when a picture is ready.
    pub fn new(context: &Context, renderer: Renderer, device_model: DeviceModel) -> Painter {
        let (sender, results) = channel();
        let worker = || Worker::new(renderer, device_model.clone(), sender.clone(), context.clone());
        let (draft, finer) = (worker(), (renderer == Renderer::Processor).then(worker));
        Painter {
            context: context.clone(),
            device_model,
            draft,
            finer,
            results,
            asked: None,
            arrivals: 0,
            look_index: 0,
            changed_at: 0.0,
            asked_quality: Quality::Draft,
            stop: StopRequest::default(),
            draft_size: DraftSize::default(),
            image: None,
            shown: None,
            fault: None,
        }
    }

    /// Returns what the device keeps.
    pub(crate) fn device_model(&self) -> &DeviceModel {
        &self.device_model
    }

    /// Returns the best picture so far; asks for better ones. `version` counts changes of the model, and how often more of it has
    /// arrived; `time` is in seconds.
    pub fn paint(
        &mut self,
        model: &Model,
        [version, arrivals]: [u64; 2],
        look: &ViewLook,
        size: [u32; 2],
        time: f64,
    ) -> Option<Arc<ColorImage>> {
        self.receive();
        let wanted = (look.clone(), version, size);
        if self.asked.as_ref() != Some(&wanted) {
            self.asked = Some(wanted);
            self.begin_look();
            self.changed_at = time;
            self.asked_quality = Quality::Draft;
            self.draft.ask(self.request(model, look, size, Quality::Draft));
        } else if self.arrivals != arrivals && !self.is_best() {
            // What is shown was drawn from less. A picture as fine as before takes its place.
            self.begin_look();
            if self.asked_quality != Quality::Draft {
                self.asked_quality = Quality::Standard;
            }
            let quality = self.asked_quality;
            let worker = self.finer.as_ref().filter(|_| quality != Quality::Draft).unwrap_or(&self.draft);
            worker.ask(self.request(model, look, size, quality));
        }
        self.arrivals = arrivals;
        // What arrives will be drawn anew.
        let is_part = self.shown.as_ref().is_none_or(|shown| shown.work.completeness == Completeness::Part);
        if is_part && self.device_model.remote().is_some_and(|remote| remote.fetching().is_some()) {
            return self.image();
        }
        // A draft of this look first, or there is nothing to see meanwhile.
        let has_draft =
            self.shown.as_ref().is_some_and(|shown| shown.look_index == self.look_index) || self.fault.is_some();
        let (next, rest) = match self.asked_quality {
            Quality::Draft => (Quality::Standard, RESTS[0]),
            Quality::Standard => (Quality::High, RESTS[1]),
            _ => return self.image(),
        };
        let rested = time - self.changed_at;
        if rested < rest {
            self.context.request_repaint_after(std::time::Duration::from_secs_f64(rest - rested));
        } else if has_draft {
            self.asked_quality = next;
            self.finer.as_ref().unwrap_or(&self.draft).ask(self.request(model, look, size, next));
        }
        self.image()
    }

    /// Returns numbers of the picture that is shown.
    pub fn shown(&self) -> Option<&Shown> {
        self.shown.as_ref()
    }

    /// Returns the picture that is shown.
    pub fn image(&self) -> Option<Arc<ColorImage>> {
        self.image.clone()
    }

    /// Returns why the last picture could not be drawn.
    pub fn fault(&self) -> Option<&str> {
        self.fault.as_deref()
    }

    /// Returns whether the picture that is shown is the best of this look.
    pub fn is_finished(&self) -> bool {
        let is_fetching = self.device_model.remote().is_some_and(|remote| remote.fetching().is_some());
        !is_fetching && self.is_best()
    }

    /// Returns whether no picture of this look can be better than the one that is shown.
    fn is_best(&self) -> bool {
        self.shown.as_ref().is_some_and(|Shown { look_index, quality, work, .. }| {
            let is_whole = work.completeness == Completeness::Whole;
            is_whole && (*look_index, *quality) == (self.look_index, Quality::High)
        })
    }

    /// Counts a new look. Finer pictures of the one before would come too late: they leave the processor to its draft.
    fn begin_look(&mut self) {
        self.look_index += 1;
        std::mem::take(&mut self.stop).make();
    }

    fn request(&self, model: &Model, look: &ViewLook, view: [u32; 2], quality: Quality) -> Request {
        let size = if quality == Quality::Draft { self.draft_size.of(view) } else { view };
        // Drafts are never stopped: those of older looks are shown while the view moves.
        let stop = if quality == Quality::Draft { StopRequest::default() } else { self.stop.clone() };
        let (model, look) = (model.clone(), look.clone());
        Request { model, look, size, view, quality, stop, look_index: self.look_index }
    }

    /// Takes the pictures that are ready.
    fn receive(&mut self) {
        while let Ok(Drawn { look_index, size, quality, milliseconds, picture }) = self.results.try_recv() {
            if let (Quality::Draft, Ok(_), Some((_, _, view))) = (quality, &picture, &self.asked) {
                let pixels = |[columns, rows]: [u32; 2]| f64::from(columns) * f64::from(rows);
                let share = pixels(size) / pixels(*view);
                self.draft_size.took(milliseconds, share.min(1.0));
            }
            // Drafts of older looks are shown while the view moves; a finer picture of an older look comes too late.
            let is_old = |shown: &Shown| (look_index, rank(quality)) < (shown.look_index, rank(shown.quality));
            if self.shown.as_ref().is_some_and(is_old) || quality != Quality::Draft && look_index != self.look_index {
                continue;
            }
            match picture {
                Ok((image, work)) => {
                    self.fault = None;
                    self.shown = Some(Shown { quality, size, milliseconds, work, look_index });
                    self.image = Some(Arc::new(image));
                }
                Err(fault) => self.fault = Some(fault.to_string()),
            }
        }
    }
}

impl Drop for Painter {
    fn drop(&mut self) {
        self.stop.make();
    }
}

fn rank(quality: Quality) -> usize {
    Quality::ALL.iter().position(|known| *known == quality).unwrap_or(0)
}

/// Returns the picture of a look, over its background, drawn by the processor until `stop` is requested.
///
/// # Errors
/// The errors of the camera, the settings and the renderer.
pub fn picture(
    model: &Model,
    look: &ViewLook,
    size: [u32; 2],
    quality: Quality,
    stop: impl Into<Option<StopRequest>>,
) -> Result<(ColorImage, Work)> {
    let mut settings = settings(model, look, size, quality)?.with_stop(stop);
    if quality == Quality::Draft {
        // The view moves. Where the processor paints the window too, it has a processor for that.
        settings.threads = settings.threads.saturating_sub(1).max(1);
    }
    let (frame, stats) = model.render_with_stats(&look.eye.camera()?, &settings)?;
    let work = Work {
        splats: stats.splats_drawn,
        walked: stats.splats_drawn + stats.splats_skipped,
        device: None,
        completeness: Completeness::Whole,
    };
    Ok((image(frame, look, size), work))
}

fn settings(model: &Model, look: &ViewLook, size: [u32; 2], quality: Quality) -> Result<Settings> {
    look.settings(model.grid(), size, quality)
}

/// Returns a frame over the background of a look.
fn image(mut frame: Frame, look: &ViewLook, size: [u32; 2]) -> ColorImage {
    frame.over(Colour::from_bytes(look.background).linear());
    // Opaque. Egui's own function is compiled with little optimisation.
    let pixels = frame.to_srgb8().as_chunks().0.iter().map(|[r, g, b, _]| Color32::from_rgb(*r, *g, *b)).collect();
    ColorImage::new(size.map(|side| side as usize), pixels)
}

#[cfg(test)]
mod tests {
    use super::*;
    use adjsplat::{Build, TransferFunction, Volume};

    #[test]
    fn a_new_look_stops_finer_pictures_of_the_one_before() {
        let volume = Volume::new([20, 10, 30], vec![9u8; 6000]).unwrap();
        let model = Build::new(TransferFunction::range(1.0, 10.0).unwrap()).run(&volume).unwrap();
        let look = ViewLook::first(&model, model.bounds().unwrap(), [0; 3], [200, 100]).unwrap();
        let mut painter = Painter::new(&Context::default(), Renderer::Processor, DeviceModel::new(None));
        let [draft, fine] =
            [Quality::Draft, Quality::High].map(|quality| painter.request(&model, &look, [9, 9], quality));
        assert!(!fine.stop.is_made());
        painter.begin_look();
        assert!(fine.stop.is_made() && !draft.stop.is_made());
        let next = painter.request(&model, &look, [9, 9], Quality::High);
        assert!(!next.stop.is_made());
        drop(painter);
        assert!(next.stop.is_made());
    }
}
