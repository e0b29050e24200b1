//! Moving the eye: what mouse, trackpad, touch and keys of one frame do to it.
//!
//! | input | effect |
//! | --- | --- |
//! | drag, one finger | turn the volume; in flight, the head |
//! | drag with the middle or right button, or with Shift; two fingers | move the volume |
//! | wheel, pinch | magnify at the pointer |
//! | W A S D Q E in flight | forward, left, back, right, down, up; in a parallel view W and S magnify |

use egui::{Key, PointerButton, Pos2, Rect, Response, Ui, Vec2};

use crate::look::Eye;

/// Degrees that a drag across the height of the view turns.
const TURN: f64 = 200.0;
/// Share of its speed that a released volume keeps after a second.
const KEPT: f32 = 0.03;
/// Below this speed, in points a second, a released volume stops.
const SLOW: f32 = 8.0;
/// Heights of the view that a flight passes in a second.
const FLIGHT: f64 = 0.6;

/// The movement of one view from frame to frame.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Motion {
    /// Speed of the pointer while it turns the volume, and after it let go, in points a second.
    speed: Vec2,
}

/// How the user wants to move.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Manner {
    /// Whether the volume turns on after it was let go.
    pub has_inertia: bool,
    /// Whether the eye flies: it turns its head, and keys move it.
    pub flies: bool,
}

/// Applies the input of this frame to `eye`; `view` is the response of the view.
pub fn navigate(ui: &Ui, view: &Response, eye: &mut Eye, motion: &mut Motion, manner: Manner) {
    let height = f64::from(view.rect.height().max(1.0));
    let step = frame_time(ui);
    let (shift, touches) = ui.input(|input| (input.modifiers.shift, input.multi_touch()));
    let touches = touches.filter(|touches| view.rect.contains(touches.center_pos));
    let moves = shift || view.dragged_by(PointerButton::Middle) || view.dragged_by(PointerButton::Secondary);
    let delta = view.drag_delta();
    if let Some(touches) = touches {
        pan(eye, touches.translation_delta, height);
        magnify(eye, touches.zoom_delta, touches.center_pos, view.rect);
        motion.speed = Vec2::ZERO;
    } else if view.dragged() && moves {
        pan(eye, delta, height);
        motion.speed = Vec2::ZERO;
    } else if view.dragged() {
        turn(eye, delta, height, manner);
        // A pointer that rests before it lets go leaves nothing to coast with.
        motion.speed = 0.6 * motion.speed + 0.4 * delta / step.max(1e-3);
    } else if motion.speed != Vec2::ZERO {
        coast(ui, eye, motion, step, height, manner);
    }
    // The input's pinch is also that of two fingers.
    if let (true, None, Some(at)) = (view.hovered(), touches, view.hover_pos()) {
        let (scroll, pinch) = ui.input(|input| (input.smooth_scroll_delta().y, input.zoom_delta()));
        magnify(eye, pinch * (scroll / 250.0).exp(), at, view.rect);
    }
}

fn turn(eye: &mut Eye, delta: Vec2, height: f64, manner: Manner) {
    let [right, down] = [delta.x, delta.y].map(|points| f64::from(points) * TURN / height);
    // The volume follows the pointer, so the eye goes the other way; a head goes with it.
    if manner.flies { eye.turn([0.3 * right, 0.3 * down]) } else { eye.orbit([right, down]) }
}

fn pan(eye: &mut Eye, delta: Vec2, height: f64) {
    let scale = eye.height / height;
    eye.shift([-f64::from(delta.x) * scale, f64::from(delta.y) * scale, 0.0]);
}

/// Magnifies at a point of the view.
fn magnify(eye: &mut Eye, factor: f32, at: Pos2, view: Rect) {
    if factor != 1.0 {
        let from_middle = (at - view.center()) / view.height().max(1.0);
        eye.zoom(factor.into(), [from_middle.x.into(), f64::from(-from_middle.y)]);
    }
}

fn coast(ui: &Ui, eye: &mut Eye, motion: &mut Motion, step: f32, height: f64, manner: Manner) {
    if !manner.has_inertia || manner.flies || motion.speed.length() < SLOW {
        motion.speed = Vec2::ZERO;
        return;
    }
    turn(eye, motion.speed * step, height, manner);
    motion.speed *= KEPT.powf(step);
    ui.ctx().request_repaint();
}

/// Moves `eye` by the keys that are held in this frame.
pub fn fly(ui: &Ui, eye: &mut Eye) {
    if ui.ctx().text_edit_focused() {
        return;
    }
    let held = |plus: Key, minus: Key| {
        ui.input(|input| f64::from(i8::from(input.key_down(plus)) - i8::from(input.key_down(minus))))
    };
    let ways = [held(Key::D, Key::A), held(Key::E, Key::Q), held(Key::W, Key::S)];
    if ways != [0.0; 3] {
        let heights = FLIGHT * f64::from(frame_time(ui));
        let mut steps = ways.map(|way| way * heights * eye.height);
        if eye.fov.is_none() {
            // Parallel rays show no nearness.
            steps[2] = 0.0;
            eye.zoom((ways[2] * heights).exp(), [0.0; 2]);
        }
        eye.shift(steps);
        ui.ctx().request_repaint();
    }
}

/// Returns the time of a frame, in seconds; at most 0.1.
fn frame_time(ui: &Ui) -> f32 {
    ui.input(|input| input.stable_dt.min(0.1))
}
