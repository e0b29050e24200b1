//! What is drawn over a picture: the world's axes, a scale bar, the crop box and its handles.

use adjsplat::splat::WorldFrame;
use adjsplat::traverse::VoxelBox;
use adjsplat::volume::Grid;
use egui::{Align2, Color32, CursorIcon, FontId, Painter, Pos2, Rect, Response, Stroke, Ui, Vec2, pos2, vec2};
use glam::DVec3;

use crate::look::Eye;

/// Colours of the world's axes x, y, z.
const AXES: [(&str, Color32); 3] = [
    ("x", Color32::from_rgb(224, 82, 82)),
    ("y", Color32::from_rgb(84, 176, 84)),
    ("z", Color32::from_rgb(86, 130, 232)),
];
/// How near the pointer must be to a handle to take it, in points.
const REACH: f32 = 12.0;

/// Where the world is on the screen.
pub struct ScreenMap {
    rect: Rect,
    eye: Eye,
    axes: [DVec3; 3],
    position: DVec3,
}

impl ScreenMap {
    /// Creates the map of a view in `rect`.
    pub fn new(eye: &Eye, rect: Rect) -> ScreenMap {
        ScreenMap { rect, eye: *eye, axes: eye.axes(), position: eye.position() }
    }

    /// Returns where a world point is seen; `None` if it is behind the eye.
    #[expect(clippy::cast_possible_truncation, reason = "points of the screen")]
    pub fn place(&self, world: DVec3) -> Option<Pos2> {
        let [right, up, forward] = self.axes;
        let from = world - self.eye.target;
        let nearness = match self.eye.fov {
            None => 1.0,
            Some(_) => {
                let depth = (world - self.position).dot(forward);
                if depth <= 1e-6 * self.eye.distance() {
                    return None;
                }
                self.eye.distance() / depth
            }
        };
        let scale = f64::from(self.rect.height()) / self.eye.height * nearness;
        let offset = vec2((from.dot(right) * scale) as f32, (-from.dot(up) * scale) as f32);
        Some(self.rect.center() + offset)
    }

    /// Returns origin and unit direction of the ray through a place of the screen.
    pub fn ray(&self, at: Pos2) -> (DVec3, DVec3) {
        let [right, up, forward] = self.axes;
        let from = at - self.rect.center();
        let scale = self.eye.height / f64::from(self.rect.height());
        let offset = right * (f64::from(from.x) * scale) - up * (f64::from(from.y) * scale);
        match self.eye.fov {
            None => (self.position + offset, forward),
            Some(_) => (self.position, (self.eye.target + offset - self.position).normalize()),
        }
    }
}

/// Draws the directions of the world's axes in the lower left corner.
#[expect(clippy::cast_possible_truncation, reason = "points of the screen")]
pub fn axis_cross(painter: &Painter, eye: &Eye, rect: Rect) {
    let centre = rect.left_bottom() + vec2(46.0, -46.0);
    let [right, up, forward] = eye.axes();
    let mut arms: Vec<_> = AXES.iter().zip([DVec3::X, DVec3::Y, DVec3::Z]).collect();
    // Those that point away first, so that nearer ones cover them.
    arms.sort_by(|(_, a), (_, b)| b.dot(forward).total_cmp(&a.dot(forward)));
    for ((name, colour), axis) in arms {
        let arm = vec2(axis.dot(right) as f32, -axis.dot(up) as f32) * 28.0;
        painter.line_segment([centre, centre + arm], Stroke::new(2.5, *colour));
        painter.text(centre + arm * 1.3, Align2::CENTER_CENTER, name, FontId::proportional(13.0), *colour);
    }
}

/// Draws a bar of a round length in the lower right corner; in perspective it holds at the target.
#[expect(clippy::cast_possible_truncation, reason = "points of the screen")]
pub fn scale_bar(painter: &Painter, eye: &Eye, rect: Rect, unit: Option<&str>, colour: Color32) {
    let point = eye.height / f64::from(rect.height());
    let length = round_length(120.0 * point);
    let width = (length / point) as f32;
    let end = rect.right_bottom() + vec2(-20.0, -22.0);
    let start = end - vec2(width, 0.0);
    let stroke = Stroke::new(2.0, colour);
    painter.line_segment([start, end], stroke);
    for tip in [start, end] {
        painter.line_segment([tip - vec2(0.0, 5.0), tip + vec2(0.0, 5.0)], stroke);
    }
    let text = format!("{} {}", crate::editor::ui::number(length), unit.unwrap_or("units"));
    let at = start + vec2(width / 2.0, -6.0);
    painter.text(at, Align2::CENTER_BOTTOM, text.trim_end(), FontId::proportional(13.0), colour);
}

/// Returns the largest of 1, 2, 5 times a power of ten that is at most `length`.
pub fn round_length(length: f64) -> f64 {
    let power = 10f64.powf(length.log10().floor());
    [5.0, 2.0].into_iter().map(|digit| digit * power).find(|round| *round <= length * (1.0 + 1e-9)).unwrap_or(power)
}

/// Draws the edges of a crop box, with a handle on each face, and moves the faces that are dragged. Returns whether the
/// pointer is on a handle, so that the view does not turn.
pub fn crop_box(
    ui: &Ui,
    view: &Response,
    screen_map: &ScreenMap,
    grid: &Grid,
    crop: &mut VoxelBox,
    held: &mut Option<usize>,
) -> bool {
    let frame = WorldFrame::of(grid);
    let ends = |crop: &VoxelBox| [0, 1, 2].map(|a| [f64::from(crop.low[a]) - 0.5, f64::from(crop.high[a]) + 0.5]);
    let corner = |index: usize| {
        let ends = ends(crop);
        screen_map.place(frame.world_from_voxel([0, 1, 2].map(|a| ends[a][index >> a & 1])))
    };
    let painter = ui.painter_at(view.rect);
    let colour = ui.visuals().selection.stroke.color;
    for from in 0..8usize {
        for axis in 0..3 {
            let to = from | 1 << axis;
            if let (true, Some(a), Some(b)) = (to != from, corner(from), corner(to)) {
                painter.line_segment([a, b], Stroke::new(1.2, colour.gamma_multiply(0.8)));
            }
        }
    }
    // Face 2 a is the low end of axis a, face 2 a + 1 the high end.
    let middle = |face: usize, crop: &VoxelBox| {
        let ends = ends(crop);
        let mut at = [0, 1, 2].map(|a| (ends[a][0] + ends[a][1]) / 2.0);
        at[face / 2] = ends[face / 2][face % 2];
        frame.world_from_voxel(at)
    };
    let handles: Vec<Option<Pos2>> = (0..6).map(|face| screen_map.place(middle(face, crop))).collect();
    let pointer = view.hover_pos().or(view.interact_pointer_pos());
    let near = |at: Pos2| {
        let far = |face: &usize| handles[*face].map_or(f32::MAX, |handle| handle.distance(at));
        (0..6).min_by(|a, b| far(a).total_cmp(&far(b))).filter(|face| far(face) < REACH)
    };
    let hovered = pointer.and_then(near);
    if view.drag_started() {
        *held = ui.input(|input| input.pointer.press_origin()).and_then(near);
    }
    if !view.dragged() {
        *held = None;
    }
    if let Some(face) = *held {
        drag_face(view, screen_map, &frame, grid, crop, face, middle(face, crop));
    }
    for (face, handle) in handles.iter().enumerate() {
        if let Some(at) = handle {
            let is_active = *held == Some(face) || held.is_none() && hovered == Some(face);
            painter.circle(*at, if is_active { 7.0 } else { 5.0 }, colour, Stroke::new(1.5, Color32::WHITE));
        }
    }
    if held.is_some() || hovered.is_some() {
        ui.ctx().set_cursor_icon(CursorIcon::Grab);
    }
    held.is_some() || hovered.is_some() && !view.dragged()
}

/// Moves a face along its axis by what the pointer moved along the axis on the screen.
fn drag_face(
    view: &Response,
    screen_map: &ScreenMap,
    frame: &WorldFrame,
    grid: &Grid,
    crop: &mut VoxelBox,
    face: usize,
    middle: DVec3,
) {
    let (axis, is_high) = (face / 2, face % 2 == 1);
    let places = [middle, middle + frame.steps[axis]].map(|at| screen_map.place(at));
    let ([Some(from), Some(to)], Some(pointer)) = (places, view.interact_pointer_pos()) else { return };
    let step: Vec2 = to - from;
    if step.length_sq() < 1e-4 {
        return;
    }
    let points = f64::from((pointer - from).dot(step) / step.length_sq()).round();
    let last = f64::from(grid.dims[axis] - 1);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the grid")]
    if is_high {
        let least = f64::from(crop.low[axis]);
        crop.high[axis] = (f64::from(crop.high[axis]) + points).clamp(least, last) as u16;
    } else {
        let most = f64::from(crop.high[axis]);
        crop.low[axis] = (f64::from(crop.low[axis]) + points).clamp(0.0, most) as u16;
    }
}

/// Marks a picked voxel.
pub fn mark(painter: &Painter, at: Pos2, colour: Color32) {
    for way in [vec2(1.0, 0.0), vec2(-1.0, 0.0), vec2(0.0, 1.0), vec2(0.0, -1.0)] {
        painter.line_segment([at + way * 4.0, at + way * 11.0], Stroke::new(1.5, colour));
    }
}

/// Draws text in the middle of a view.
pub fn message(painter: &Painter, rect: Rect, text: &str, colour: Color32) {
    let width = rect.width() - 80.0;
    let galley = painter.layout(text.to_owned(), FontId::proportional(15.0), colour, width.max(60.0));
    let at = pos2(rect.center().x - galley.size().x / 2.0, rect.center().y - galley.size().y / 2.0);
    painter.galley(at, galley, colour);
}

#[cfg(test)]
mod tests {
    use super::*;
    use adjsplat::splat::Up;

    fn eye(fov: Option<f64>) -> Eye {
        let target = DVec3::new(3.0, -2.0, 7.0);
        Eye { target, azimuth: 33.0, elevation: 21.0, up: Up::default(), height: 40.0, fov, full_height: 40.0 }
    }

    #[test]
    fn a_ray_goes_through_what_is_seen_there() {
        let rect = Rect::from_min_size(pos2(10.0, 20.0), vec2(640.0, 480.0));
        for fov in [None, Some(30.0), Some(75.0)] {
            let screen_map = ScreenMap::new(&eye(fov), rect);
            for world in [DVec3::new(1.0, 2.0, 3.0), DVec3::new(9.0, -8.0, 12.0), screen_map.eye.target] {
                let at = screen_map.place(world).unwrap();
                let (origin, direction) = screen_map.ray(at);
                let along = (world - origin).dot(direction);
                assert!((world - origin - direction * along).length() < 1e-4, "{fov:?} {world}");
            }
        }
    }

    #[test]
    fn lengths_of_the_bar_are_round() {
        let pairs = [(1.0, 1.0), (1.99, 1.0), (2.0, 2.0), (73.0, 50.0), (0.0049, 0.002), (1e5, 1e5)];
        for (length, round) in pairs {
            assert!((round_length(length) / round - 1.0).abs() < 1e-9, "{length}: {}", round_length(length));
        }
    }
}
