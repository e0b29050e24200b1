//! The views of the documents, and what lies over their pictures.

use egui::{Color32, Rect, Sense, Ui, pos2};

use super::Viewer;
use crate::draw::shape;
use crate::look::Eye;
use crate::navigate::{fly, navigate};
use crate::overlay::{self, ScreenMap};

impl Viewer {
    pub(super) fn views(&mut self, ui: &mut Ui) {
        if self.documents.is_empty() {
            let text = match self.openings.is_empty() {
                false => "Opening …",
                true => {
                    "Drop a file or a folder here, or choose Open: an .adj file, or a volume (DICOM, NIfTI, NRRD, TIFF, Zarr …)"
                }
            };
            let rect = ui.available_rect_before_wrap();
            overlay::message(ui.painter(), rect, text, ui.visuals().weak_text_color());
            return;
        }
        if !self.is_side_by_side {
            return self.view(ui, self.active);
        }
        let count = self.documents.len();
        let all = ui.available_rect_before_wrap();
        let columns = if count > 3 { count.div_ceil(2) } else { count };
        let rows = count.div_ceil(columns);
        let cell = egui::vec2(all.width() / columns as f32, all.height() / rows as f32);
        for index in 0..count {
            let corner = egui::vec2((index % columns) as f32 * cell.x, (index / columns) as f32 * cell.y);
            let rect = Rect::from_min_size(all.min + corner, cell).shrink(1.0);
            ui.scope_builder(egui::UiBuilder::new().max_rect(rect).id_salt(index), |ui| self.view(ui, index));
        }
    }

    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "pixels of a screen")]
    fn view(&mut self, ui: &mut Ui, index: usize) {
        let rect = ui.available_rect_before_wrap();
        let response = ui.interact(rect, ui.scope_id().with(("view", index)), Sense::click_and_drag());
        let label = format!("View of {}", self.documents[index].title);
        response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Image, true, &label));
        let scale = ui.ctx().pixels_per_point();
        // Larger pictures fit into no texture of the window; what is drawn is stretched.
        let most = u32::try_from(ui.input(|input| input.max_texture_side)).unwrap_or(u32::MAX).clamp(1, 16_384);
        let size = [rect.width(), rect.height()].map(|side| ((side * scale) as u32).clamp(1, most));
        self.view_size = size;
        if response.drag_started() || response.clicked() {
            self.active = index;
            self.messages.clear();
        }
        let document = &mut self.documents[index];
        let before = document.look.eye;
        if std::mem::take(&mut document.needs_fit) || document.was_fitted(size) {
            document.fit(size);
        }
        let screen_map = ScreenMap::new(&document.look.eye, rect);
        let holds = match &mut document.look.crop {
            Some(crop) => {
                // Drawn again over the picture below; this is for the pointer.
                overlay::crop_box(ui, &response, &screen_map, document.model.grid(), crop, &mut document.held_face)
            }
            None => false,
        };
        if !holds {
            navigate(ui, &response, &mut document.look.eye, &mut document.motion, self.manner);
        }
        if self.manner.flies && index == self.active {
            fly(ui, &mut document.look.eye);
        }
        let time = ui.input(|input| input.time);
        let (model, version) = (document.model.clone(), document.version());
        let [r, g, b] = document.look.background;
        let painter = ui.painter_at(rect);
        let device_model = document.painter.device_model().clone();
        let wait = |text| {
            painter.rect_filled(rect, 0.0, Color32::from_rgb(r, g, b));
            overlay::message(&painter, rect, text, contrast([r, g, b]));
        };
        if let Some(remote) = device_model.remote().filter(|remote| !remote.has_arrived()) {
            wait(if remote.has_failed() { "The voxels could not be fetched" } else { "Fetching the first voxels …" });
            if let Err(fault) = device_model.begin(&model, &document.look, size) {
                document.note = Some(fault.to_string());
            }
        } else if let Some(image) = document.painter.paint(&model, version, &document.look, size, time) {
            painter.add(shape(rect, image));
        } else {
            wait("Drawing the first picture …");
        }
        self.over_picture(ui, &response, rect, index);
        self.link_views(index, before);
    }

    /// Moves linked views to where this one is, if it has moved. `before`: where it was.
    pub(super) fn link_views(&mut self, index: usize, before: Eye) {
        let eye = self.documents[index].look.eye;
        if self.is_linked && eye != before {
            self.show_all_from(eye);
        }
    }

    pub(super) fn show_all_from(&mut self, eye: Eye) {
        self.documents.iter_mut().for_each(|other| (other.look.eye, other.needs_fit) = (eye, false));
    }

    /// Draws what lies over a picture, and picks the voxel that was clicked.
    fn over_picture(&mut self, ui: &Ui, response: &egui::Response, rect: Rect, index: usize) {
        let is_side_by_side = self.is_side_by_side;
        let document = &mut self.documents[index];
        let eye = document.look.eye;
        let screen_map = ScreenMap::new(&eye, rect);
        let painter = ui.painter_at(rect);
        let colour = contrast(document.look.background);
        if let Some(mut crop) = document.look.crop {
            overlay::crop_box(ui, response, &screen_map, document.model.grid(), &mut crop, &mut None);
        }
        overlay::axis_cross(&painter, &eye, rect);
        overlay::scale_bar(&painter, &eye, rect, document.unit.as_deref(), colour);
        if let Some(at) = response.interact_pointer_pos().filter(|_| response.clicked()) {
            let (origin, direction) = screen_map.ray(at);
            document.begin_pick(ui.ctx(), origin, direction);
        }
        if let Some(at) = document.picked.and_then(|picked| screen_map.place(picked.world)) {
            overlay::mark(&painter, at, colour);
        }
        if let Some(fault) = document.painter.fault() {
            overlay::message(&painter, rect, fault, ui.visuals().error_fg_color);
        }
        if is_side_by_side {
            let at = pos2(rect.left() + 10.0, rect.top() + 8.0);
            let font = egui::FontId::proportional(14.0);
            painter.text(at, egui::Align2::LEFT_TOP, &document.title, font, colour);
            if index == self.active {
                let stroke = ui.visuals().selection.stroke;
                painter.rect_stroke(rect, 0.0, stroke, egui::StrokeKind::Inside);
            }
        }
    }
}

/// Returns a colour that is seen on a background.
fn contrast([r, g, b]: [u8; 3]) -> Color32 {
    let brightness = 0.3 * f32::from(r) + 0.59 * f32::from(g) + 0.11 * f32::from(b);
    if brightness > 140.0 { Color32::from_gray(40) } else { Color32::from_gray(225) }
}
