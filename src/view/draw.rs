//! Drawing in the background: the interface never waits for a picture.
//!
//! In: a model, a look and the size of the view, every frame of the interface. Out: a texture with the best picture so far.
//! When the look changes, a first thread draws it in `draft`, with fewer pixels if that takes long. When it rests, a second
//! thread draws `standard`, then `high`. A request replaces one that still waits.

use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::Instant;

use adjsplat::Model;
use adjsplat::classify::Colour;
use adjsplat::error::Result;
use adjsplat::splat::{Quality, Stats};
use egui::{ColorImage, Context, TextureHandle, TextureOptions};

use crate::draft_size::DraftSize;
use crate::look::Look;

/// How long a view rests before it is drawn in `standard`, and then in `high`, in seconds.
const RESTS: [f64; 2] = [0.08, 0.4];

/// A picture to draw.
#[derive(Clone)]
struct Request {
    model: Model,
    look: Look,
    size: [u32; 2],
    quality: Quality,
    /// Counts the looks that were asked for.
    look_index: u64,
}

/// A picture that was drawn.
pub struct Drawn {
    look_index: u64,
    quality: Quality,
    milliseconds: f64,
    picture: Result<(ColorImage, Stats)>,
}

/// What the view shows, in numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shown {
    /// The quality of the picture.
    pub quality: Quality,
    /// The columns and rows of the picture.
    pub size: [usize; 2],
    /// How long drawing took, in milliseconds.
    pub milliseconds: f64,
    /// Counts and times of the renderer.
    pub stats: Stats,
    look_index: u64,
}

/// Draws the pictures of one view.
pub struct Painter {
    context: Context,
    draft: Worker,
    finer: Worker,
    results: Receiver<Drawn>,
    /// The look, the model's version and the size of the last request.
    asked: Option<(Look, u64, [u32; 2])>,
    look_index: u64,
    changed_at: f64,
    /// The best quality that was asked for since the look changed.
    asked_quality: Quality,
    draft_size: DraftSize,
    texture: Option<TextureHandle>,
    shown: Option<Shown>,
    fault: Option<String>,
}

impl Painter {
    /// Creates a painter; it wakes `context` when a picture is ready.
    pub fn new(context: &Context) -> Painter {
        let (sender, results) = channel();
        Painter {
            context: context.clone(),
            draft: Worker::new(sender.clone(), context.clone()),
            finer: Worker::new(sender, context.clone()),
            results,
            asked: None,
            look_index: 0,
            changed_at: 0.0,
            asked_quality: Quality::Draft,
            draft_size: DraftSize::default(),
            texture: None,
            shown: None,
            fault: None,
        }
    }

    /// Returns the best picture so far; asks for better ones. `version` counts changes of the model; `time` is in seconds.
    pub fn paint(
        &mut self,
        model: &Model,
        version: u64,
        look: &Look,
        size: [u32; 2],
        time: f64,
    ) -> Option<&TextureHandle> {
        self.receive();
        let wanted = (look.clone(), version, size);
        if self.asked.as_ref() != Some(&wanted) {
            self.asked = Some(wanted);
            self.look_index += 1;
            self.changed_at = time;
            self.asked_quality = Quality::Draft;
            let coarse = self.draft_size.of(size);
            self.draft.ask(self.request(model, look, coarse, Quality::Draft));
        }
        // A draft of this look first, or there is nothing to see meanwhile.
        let has_draft = self.shown.is_some_and(|shown| shown.look_index == self.look_index) || self.fault.is_some();
        let (next, rest) = match self.asked_quality {
            Quality::Draft => (Quality::Standard, RESTS[0]),
            Quality::Standard => (Quality::High, RESTS[1]),
            _ => return self.texture.as_ref(),
        };
        let rested = time - self.changed_at;
        if rested < rest {
            self.context.request_repaint_after(std::time::Duration::from_secs_f64(rest - rested));
        } else if has_draft {
            self.asked_quality = next;
            self.finer.ask(self.request(model, look, size, next));
        }
        self.texture.as_ref()
    }

    /// Returns numbers of the picture that is shown.
    pub fn shown(&self) -> Option<Shown> {
        self.shown
    }

    /// Returns why the last picture could not be drawn.
    pub fn fault(&self) -> Option<&str> {
        self.fault.as_deref()
    }

    /// Returns whether the picture that is shown is the best of this look.
    pub fn is_finished(&self) -> bool {
        self.shown.is_some_and(|shown| shown.look_index == self.look_index && shown.quality == Quality::High)
    }

    fn request(&self, model: &Model, look: &Look, size: [u32; 2], quality: Quality) -> Request {
        Request { model: model.clone(), look: look.clone(), size, quality, look_index: self.look_index }
    }

    /// Takes the pictures that are ready.
    fn receive(&mut self) {
        while let Ok(Drawn { look_index, quality, milliseconds, picture }) = self.results.try_recv() {
            if let (Quality::Draft, Ok((image, _)), Some((_, _, view))) = (quality, &picture, &self.asked) {
                let pixels = |[columns, rows]: [f64; 2]| columns * rows;
                let share = pixels(image.size.map(|side| side as f64)) / pixels(view.map(f64::from));
                self.draft_size.took(milliseconds, share.min(1.0));
            }
            // Drafts of older looks are shown while the view moves; a finer picture of an older look comes too late.
            let is_old = |shown: Shown| (look_index, rank(quality)) < (shown.look_index, rank(shown.quality));
            if self.shown.is_some_and(is_old) || quality != Quality::Draft && look_index != self.look_index {
                continue;
            }
            match picture {
                Ok((image, stats)) => {
                    self.fault = None;
                    self.shown = Some(Shown { quality, size: image.size, milliseconds, stats, look_index });
                    match &mut self.texture {
                        Some(texture) => texture.set(image, TextureOptions::LINEAR),
                        None => {
                            self.texture = Some(self.context.load_texture("view", image, TextureOptions::LINEAR));
                        }
                    }
                }
                Err(fault) => self.fault = Some(fault.to_string()),
            }
        }
    }
}

fn rank(quality: Quality) -> usize {
    Quality::ALL.iter().position(|known| *known == quality).unwrap_or(0)
}

/// Returns the picture of a look, over its background.
///
/// # Errors
/// The errors of the camera, the settings and the renderer.
pub fn picture(model: &Model, look: &Look, size: [u32; 2], quality: Quality) -> Result<(ColorImage, Stats)> {
    let settings = look.settings(model.grid(), size, quality)?;
    let (mut frame, stats) = model.render_with_stats(&look.eye.camera()?, &settings)?;
    frame.over(Colour::from_bytes(look.background).linear());
    Ok((ColorImage::from_rgba_unmultiplied(size.map(|side| side as usize), &frame.to_srgb8()), stats))
}

/// A thread that draws one picture after the other.
struct Worker {
    waiting: Arc<Waiting>,
}

#[derive(Default)]
struct Waiting {
    request: Mutex<Next>,
    changed: Condvar,
}

#[derive(Default)]
enum Next {
    #[default]
    Nothing,
    Draw(Box<Request>),
    End,
}

impl Worker {
    fn new(results: Sender<Drawn>, context: Context) -> Worker {
        let waiting = Arc::new(Waiting::default());
        let own = waiting.clone();
        std::thread::spawn(move || {
            while let Some(request) = own.next() {
                let start = Instant::now();
                let Request { model, look, size, quality, look_index } = *request;
                let picture = picture(&model, &look, size, quality);
                let milliseconds = start.elapsed().as_secs_f64() * 1e3;
                // Nobody receives once the view is closed.
                let _ = results.send(Drawn { look_index, quality, milliseconds, picture });
                context.request_repaint();
            }
        });
        Worker { waiting }
    }

    fn ask(&self, request: Request) {
        self.waiting.set(Next::Draw(Box::new(request)));
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        self.waiting.set(Next::End);
    }
}

impl Waiting {
    fn set(&self, next: Next) {
        *self.request.lock().unwrap_or_else(PoisonError::into_inner) = next;
        self.changed.notify_one();
    }

    /// Waits for a request; `None` at the end.
    fn next(&self) -> Option<Box<Request>> {
        let mut next = self.request.lock().unwrap_or_else(PoisonError::into_inner);
        loop {
            match std::mem::take(&mut *next) {
                Next::Nothing => next = self.changed.wait(next).unwrap_or_else(PoisonError::into_inner),
                Next::Draw(request) => return Some(request),
                Next::End => return None,
            }
        }
    }
}
