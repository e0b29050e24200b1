//! An open file: the model, what is looked at, and the edits of its transfer function.

use std::sync::mpsc::{Receiver, channel};

use adjsplat::error::Result;
use adjsplat::traverse::VoxelBox;
use adjsplat::{Model, TransferFunction};
use egui::{Context, Id};

use crate::draw::{DeviceModel, Painter, Renderer};
use crate::editor::ui::EditorState;
use crate::editor::{Edited, History, StoredValues};
use crate::look::{Eye, ViewLook};
use crate::navigate::Motion;
use crate::open::{FilePlace, Opened, Wish};
use crate::pick::{Picked, Ray};

/// An open file.
pub struct Document {
    /// The place of this file in the order in which files were to be opened.
    pub(crate) number: u64,
    /// The name on the tab.
    pub title: String,
    /// The file that the model lies in; of a volume, the volume's.
    pub place: FilePlace,
    /// Whether that is an .adj file.
    pub is_adj: bool,
    /// Of a file on a server: the bytes that were fetched when it was opened, and those of the whole file.
    fetched: Option<[u64; 2]>,
    /// The box of the file's visible voxels.
    pub(crate) extent: Option<VoxelBox>,
    /// The unit of lengths, if the file states it.
    pub unit: Option<String>,
    /// The model with the transfer function that is drawn.
    pub model: Model,
    /// How often each value is stored.
    pub stored: StoredValues,
    /// What is shown.
    pub look: ViewLook,
    /// The transfer function and its earlier states.
    pub edits: History<Edited>,
    /// The transfer function that the model was opened with, in the editor and as it was.
    opened: (Edited, TransferFunction),
    /// The transfer function as it was loaded or saved last.
    saved: Edited,
    /// What the editor remembers.
    pub editor: EditorState,
    /// Values that the function shows and the file does not store.
    pub missing: Vec<[f64; 2]>,
    /// Draws the view.
    pub painter: Painter,
    /// How the view moves.
    pub motion: Motion,
    /// The widget that had the keyboard when the panel was shown last.
    pub(crate) focus: Option<Id>,
    /// Whether the view shall show everything as soon as its size is known.
    pub needs_fit: bool,
    /// Target and height of the view that last showed everything, and its size in pixels.
    fitted: Option<(glam::DVec3, f64, [u32; 2])>,
    /// The face of the crop box that is dragged.
    pub held_face: Option<usize>,
    /// The voxel that was clicked.
    pub picked: Option<Picked>,
    /// A line about the last click or change that has no other place.
    pub note: Option<String>,
    picking: Option<Receiver<Result<Option<Picked>>>>,
    /// Counts changes of the model, and how often more of it has arrived.
    version: [u64; 2],
}

impl Document {
    /// Begins to show what was opened, over a background of this colour, drawn by `renderer`.
    ///
    /// # Errors
    /// The errors of [`ViewLook::first`].
    pub fn new(context: &Context, opened: Opened, background: [u8; 3], renderer: Renderer) -> Result<Document> {
        let Opened { place, is_adj, model, stored, fetched, extent, unit, remote } = opened;
        let look = ViewLook::first(&model, extent, background, [800, 800])?;
        let edited = Edited::of(model.transfer(), &stored);
        Ok(Document {
            number: 0,
            title: place.name(),
            place,
            is_adj,
            fetched,
            extent,
            unit,
            opened: (edited.clone(), model.transfer().clone()),
            model,
            stored,
            look,
            saved: edited.clone(),
            edits: History::new(edited),
            editor: EditorState::default(),
            missing: Vec::new(),
            painter: Painter::new(context, renderer, DeviceModel::new(remote)),
            motion: Motion::default(),
            focus: None,
            needs_fit: true,
            fitted: None,
            held_face: None,
            picked: None,
            note: None,
            picking: None,
            version: [0; 2],
        })
    }

    /// Goes on with what has arrived of a file elsewhere; what the user changed stays. Returns why no more arrives.
    pub(crate) fn take_news(&mut self) -> Option<String> {
        let remote = self.painter.device_model().remote()?.clone();
        if remote.has_news() {
            let arrived = remote.model().and_then(|model| {
                let stored = StoredValues::of(&model)?;
                Ok((model.with_transfer(self.model.transfer().clone())?, stored))
            });
            match arrived {
                Ok((model, stored)) => {
                    let is_changed = self.edits.can_undo() || self.edits.can_redo();
                    if stored != self.stored && !is_changed {
                        self.edits = History::new(Edited::of(model.transfer(), &stored));
                        self.opened.0 = self.edits.now.clone();
                        self.set_saved();
                    }
                    (self.model, self.stored) = (model, stored);
                    self.version[1] += 1;
                }
                Err(fault) => return Some(fault.to_string()),
            }
        }
        remote.fault()
    }

    /// Returns whether none of the voxels could be fetched.
    pub(crate) fn is_lost(&self) -> bool {
        self.painter.device_model().remote().is_some_and(|remote| remote.has_failed() && !remote.has_arrived())
    }

    /// Returns, of a file on a server, the bytes that have been fetched, and those of the whole file.
    pub fn fetched(&self) -> Option<[u64; 2]> {
        let [fetched, whole] = self.fetched?;
        Some([self.painter.device_model().remote().map_or(fetched, |remote| remote.fetched()), whole])
    }

    /// Returns the number of changes of the model, and how often more of it has arrived.
    pub fn version(&self) -> [u64; 2] {
        self.version
    }

    /// Shows the file as `wish` says.
    ///
    /// # Errors
    /// [`adjsplat::Error::Input`] if that cannot be read; the rest is shown.
    pub fn fulfil(&mut self, wish: &Wish) -> Result<()> {
        let transfer = wish.transfer.as_deref().map(TransferFunction::from_json).transpose();
        let eye = wish.view.as_deref().map(|view| self.look.eye.moved_to(view)).transpose();
        if let Ok(Some(transfer)) = &transfer {
            self.set_transfer(transfer);
        }
        if let Ok(Some(eye)) = eye {
            (self.look.eye, self.needs_fit) = (eye, false);
        }
        transfer.and(eye.map(|_| ()))
    }

    /// Draws with another transfer function, which lies in a file or a link; that can be undone.
    pub fn set_transfer(&mut self, transfer: &TransferFunction) {
        self.edits.set(Edited::of(transfer, &self.stored));
        self.set_saved();
        self.apply();
    }

    /// Notes that the transfer function of the editor is saved.
    pub(crate) fn set_saved(&mut self) {
        self.saved = self.edits.now.clone();
    }

    /// Returns whether the transfer function was edited since it was opened, loaded or saved.
    pub fn is_unsaved(&self) -> bool {
        self.edits.now != self.saved && self.edits.now != self.opened.0
    }

    /// Draws with the transfer function that the editor holds.
    pub fn apply(&mut self) {
        let changed = self.transfer().and_then(|transfer| {
            let missing = self.model.missing_values(&transfer)?;
            Ok((self.model.with_transfer(transfer)?, missing))
        });
        match changed {
            Ok((model, missing)) => {
                (self.model, self.missing, self.note) = (model, missing, None);
                self.version[0] += 1;
            }
            Err(fault) => self.note = Some(fault.to_string()),
        }
    }

    /// Returns the transfer function that the editor holds, also where the file cannot be drawn with it.
    ///
    /// # Errors
    /// The errors of [`Edited::transfer`].
    pub fn transfer(&self) -> Result<TransferFunction> {
        // The editor turns some functions into points; what was not edited stays as it is.
        if self.edits.now == self.opened.0 { Ok(self.opened.1.clone()) } else { self.edits.now.transfer() }
    }

    /// Returns whether a volume was built with another transfer function than it is drawn with.
    pub(crate) fn is_built_otherwise(&self) -> bool {
        !self.is_adj && *self.model.transfer() != self.opened.1
    }

    /// Looks for the voxel on a ray, in the background.
    pub fn begin_pick(&mut self, context: &Context, origin: glam::DVec3, direction: glam::DVec3) {
        let (sender, receiver) = channel();
        let (model, look, context) = (self.model.clone(), self.look.clone(), context.clone());
        let device_model = self.painter.device_model().clone();
        crate::background::run(async move || {
            let ray = Ray::new(&model, &look, origin, direction);
            let found = match device_model.remote() {
                None => ray.pick(None),
                Some(_) => match device_model.tiles_back(&model, |bounds| ray.meets(bounds)).await {
                    Ok(tiles) => ray.pick(Some(&tiles.view())),
                    Err(fault) => Err(fault),
                },
            };
            // Nobody receives if the document was closed.
            let _ = sender.send(found);
            context.request_repaint();
        });
        self.picking = Some(receiver);
    }

    /// Takes the voxel that was found.
    pub fn finish_pick(&mut self) {
        let Some(found) = self.picking.as_ref().and_then(|picking| picking.try_recv().ok()) else { return };
        self.picking = None;
        match found {
            Ok(picked) => self.picked = picked,
            Err(fault) => self.note = Some(fault.to_string()),
        }
    }

    /// Shows everything again, from the side where the eye is.
    pub fn fit(&mut self, size: [u32; 2]) {
        let Eye { azimuth, elevation, up, fov, .. } = self.look.eye;
        let side = crate::look::Side { name: "", azimuth, elevation };
        match Eye::around(&self.model, self.extent, side, up, fov, size) {
            Ok(eye) => (self.look.eye, self.fitted) = (eye, Some((eye.target, eye.height, size))),
            Err(fault) => self.note = Some(fault.to_string()),
        }
    }

    /// Returns whether the view showed everything at another size, and was not moved since.
    pub(crate) fn was_fitted(&self, size: [u32; 2]) -> bool {
        let eye = self.look.eye;
        self.fitted.is_some_and(|(target, height, at)| (target, height) == (eye.target, eye.height) && at != size)
    }
}
