//! The plain twin: one voxel after the other, one pixel after the other.
//!
//! In and out as for a band. It shares the arithmetic of a single voxel and a single pixel with the fast code and
//! nothing else: no blocks, no tiles, no chords, nothing frozen, no bands. Tests hold the two to equal bits.

#![expect(clippy::cast_possible_truncation, reason = "as the fast code, whose bits it must give")]

use std::time::{Duration, Instant};

use super::arith::{LOG2_E, at_least, at_most};
use super::band::{Drawn, Work};
use super::blend::Blend;
use super::planes::{Planes, Rect};
use super::project::{Kind, Projector, jacobian, slant, span, split};
use super::raster::{Centre, Ellipse, Kernel, Limits};
use crate::classify::normal;
use crate::error::Result;
use crate::splat::composite::MAX_DEPTH;
use crate::splat::kernel::footprint;
use crate::traverse::{Batch, Order, walk};

/// Draws the whole picture.
///
/// # Errors
/// If the memory cannot be had.
pub(crate) fn draw<B: Blend>(
    projector: &Projector,
    order: &Order,
    rect: Rect,
    limits: Limits,
) -> Result<Drawn<Planes>> {
    let mut planes = Planes::new(rect, B::FOURTH)?;
    let (mut visited, mut drawn) = (0, 0);
    let start = Instant::now();
    walk(&projector.lane, order, &mut |batch: &Batch| {
        for j in 0..batch.len() {
            visited += 1;
            let mut voxel = [0u16; 3];
            let [s, m, f] = projector.nesting;
            (voxel[s], voxel[m], voxel[f]) = (batch.slow, batch.medium[j], batch.fast[j]);
            drawn += u64::from(splat::<B>(projector, &mut planes, limits, voxel, batch.record_index(j)));
        }
    });
    Ok(Drawn { pixels: planes, work: Work { visited, drawn, walking: start.elapsed(), drawing: Duration::ZERO } })
}

fn splat<B: Blend>(projector: &Projector, planes: &mut Planes, limits: Limits, voxel: [u16; 3], record: usize) -> bool {
    if projector.crop.is_some_and(|crop| (0..3).any(|a| voxel[a] < crop.low[a] || voxel[a] > crop.high[a])) {
        return false;
    }
    let Some((x, y, ellipse, strength)) = place(projector, voxel) else { return false };
    let [red, green, blue, depth] = projector.look(record);
    let peak = if projector.maximum { depth } else { at_most(depth * strength, MAX_DEPTH as f32 * LOG2_E) };
    let [red, green, blue] = light(projector, voxel, record, [red, green, blue]);
    let (ink, stop) = ([red, green, blue, B::INK], if B::STOPS { limits.stop } else { 0.0 });
    let (low_x, high_x) = span(x, ellipse.half_x);
    let (low_y, high_y) = span(y, ellipse.half_y);
    if !(strength > 0.0 && peak > 0.0) {
        return false;
    }
    let kernel = Kernel { centre: Centre { x: x.0, y: y.0, rest_x: x.1, rest_y: y.1 }, ellipse, cut: limits.cut, peak };
    let rect = planes.rect;
    let mut touched = false;
    for row in low_y.max(rect.y0)..=high_y.min(rect.y1 - 1) {
        for column in low_x.max(rect.x0)..=high_x.min(rect.x1 - 1) {
            touched = true;
            let amount = B::amount(kernel.depth(column, row));
            let old = planes.pixel(column, row);
            let new = std::array::from_fn(|c| B::blend(old[c], old[3], amount, ink[c], stop));
            planes.set_pixel(column, row, new);
        }
    }
    touched
}

type Place = ((i32, f32), (i32, f32), Ellipse, f32);

fn place(projector: &Projector, voxel: [u16; 3]) -> Option<Place> {
    let [s, m, f] = projector.nesting;
    let [slow, medium, fast] = [s, m, f].map(|a| f64::from(voxel[a]));
    let at = |map: &[f64; 4]| (map[3] + map[s] * slow) + map[m] * medium + map[f] * fast;
    match &projector.kind {
        Kind::Parallel { pixel_from_voxel: [column, row], ellipse, strength, .. } => {
            Some((split(at(column)), split(at(row)), *ellipse, *strength))
        }
        Kind::Perspective { camera_from_voxel, focal, centre, near, strength } => {
            let [t0, t1, t2] = camera_from_voxel.map(|map| at(&map));
            if t2 < *near {
                return None;
            }
            let closeness = 1.0 / t2;
            let (across, above) = (t0 * closeness, t1 * closeness);
            let steps = camera_from_voxel.map(|map| [map[0] as f32, map[1] as f32, map[2] as f32]);
            let (tx, ty) = (across as f32, above as f32);
            let scale = *focal as f32 * closeness as f32;
            let print = footprint(jacobian(&steps, tx, ty, scale), projector.sigma, projector.cut_off);
            let closeness = closeness as f32;
            let strength = *strength * print.density * slant(tx, ty) * (closeness * closeness);
            Some((split(centre[0] + focal * across), split(centre[1] - focal * above), print.ellipse, strength))
        }
    }
}

fn light(projector: &Projector, voxel: [u16; 3], record: usize, colour: [f32; 3]) -> [f32; 3] {
    let Some(lights) = &projector.lights else { return colour };
    let code = projector.lane.normal_code(record);
    let normal =
        if projector.lane.channels.normal_bits == 8 { normal::decode8(code as u16) } else { normal::decode16(code) };
    let eye = match projector.kind {
        Kind::Parallel { .. } => lights.eye,
        Kind::Perspective { .. } => {
            let toward: [f32; 3] = std::array::from_fn(|a| projector.eye[a] - projector.steps[a] * f32::from(voxel[a]));
            let [x, y, z] = toward;
            let length = at_least(x * x + y * y + z * z, f32::MIN_POSITIVE).sqrt();
            toward.map(|c| c / length)
        }
    };
    let [factor, highlight] = lights.shade(normal, eye);
    colour.map(|c| c * factor + highlight)
}
