//! The plain twin: one voxel after the other, one pixel after the other.
//!
//! In and out as for a band. It shares the arithmetic of a single voxel and a single pixel with the fast code and
//! nothing else: no blocks, no tiles, no chords, nothing frozen, no bands. Tests hold the two to equal bits.

#![expect(clippy::cast_possible_truncation, reason = "as the fast code, whose bits it must give")]

use std::time::{Duration, Instant};

use super::band::{Drawn, Work};
use super::blend::{Blend, FrontToBack, sheet_parts};
use super::planes::{Planes, Rect};
use super::project::{Kind, Projector, jacobian, slant, span, split};
use super::raster::{Centre, Kernel, Limits};
use crate::classify::normal;
use crate::error::Result;
use crate::splat::arith::{LOG2_E, at_least, at_most};
use crate::splat::composite::MAX_DEPTH;
use crate::splat::kernel::{Ellipse, footprint};
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
    let stop = if B::STOPS { limits.stop } else { 0.0 };
    let mut drawn = 0;
    let start = Instant::now();
    let visited = each(projector, order, |voxel, record, _| {
        let Some((kernel, [red, green, blue])) = splat(projector, limits, voxel, record) else { return };
        let ink = [red, green, blue, B::INK];
        let mut is_drawn = false;
        each_pixel(&kernel, rect, |column, row, depth| {
            is_drawn = true;
            let (amount, old) = (B::amount(depth), planes.pixel(column, row));
            planes.set_pixel(column, row, std::array::from_fn(|c| B::blend(old[c], old[3], amount, ink[c], stop)));
        });
        drawn += u64::from(is_drawn);
    });
    Ok(Drawn { pixels: planes, work: Work { visited, drawn, walking: start.elapsed(), drawing: Duration::ZERO } })
}

/// Draws the whole picture front to back, slice by slice: the sum of one's splats, then that behind what is there.
///
/// # Errors
/// If the memory cannot be had.
pub(crate) fn draw_sheets(projector: &Projector, order: &Order, rect: Rect, limits: Limits) -> Result<Drawn<Planes>> {
    let mut planes = Planes::new(rect, FrontToBack::FOURTH)?;
    let mut sheet = Planes::new(rect, 0.0)?;
    let (mut drawn, mut last) = (0, None);
    let pixels = || (rect.y0..rect.y1).flat_map(move |row| (rect.x0..rect.x1).map(move |column| (column, row)));
    let composite = |planes: &mut Planes, sheet: &mut Planes| {
        for (column, row) in pixels() {
            let (old, added) = (planes.pixel(column, row), sheet.pixel(column, row));
            let [part, share] = sheet_parts(old[3], added[3], limits.stop);
            let [red, green, blue] = [0, 1, 2].map(|c| old[c] + share * added[c]);
            planes.set_pixel(column, row, [red, green, blue, old[3] - part]);
            sheet.set_pixel(column, row, [0.0; 4]);
        }
    };
    let start = Instant::now();
    let visited = each(projector, order, |voxel, record, slow| {
        if last.replace(slow).is_some_and(|last| last != slow) {
            composite(&mut planes, &mut sheet);
        }
        let Some((kernel, [red, green, blue])) = splat(projector, limits, voxel, record) else { return };
        let mut is_drawn = false;
        each_pixel(&kernel, rect, |column, row, depth| {
            is_drawn = true;
            let old = sheet.pixel(column, row);
            let [red, green, blue] = [old[0] + depth * red, old[1] + depth * green, old[2] + depth * blue];
            sheet.set_pixel(column, row, [red, green, blue, old[3] + depth]);
        });
        drawn += u64::from(is_drawn);
    });
    composite(&mut planes, &mut sheet);
    Ok(Drawn { pixels: planes, work: Work { visited, drawn, walking: start.elapsed(), drawing: Duration::ZERO } })
}

/// Visits each voxel, with its record and its slice; gives how many there were.
fn each(projector: &Projector, order: &Order, mut visit: impl FnMut([u16; 3], usize, u16)) -> u64 {
    let mut visited = 0;
    walk(&projector.lane, order, &mut |batch: &Batch| {
        for j in 0..batch.len() {
            visited += 1;
            let mut voxel = [0u16; 3];
            let [s, m, f] = projector.nesting;
            (voxel[s], voxel[m], voxel[f]) = (batch.slow, batch.medium[j], batch.fast[j]);
            visit(voxel, batch.record_index(j), batch.slow);
        }
    });
    visited
}

/// Optical depth (in units of ln 2) at each pixel of a splat's box.
fn each_pixel(kernel: &Kernel, rect: Rect, mut put: impl FnMut(i32, i32, f32)) {
    let Kernel { centre, ellipse, .. } = kernel;
    let (low_x, high_x) = span((centre.x, centre.rest_x), ellipse.half_x);
    let (low_y, high_y) = span((centre.y, centre.rest_y), ellipse.half_y);
    for row in low_y.max(rect.y0)..=high_y.min(rect.y1 - 1) {
        for column in low_x.max(rect.x0)..=high_x.min(rect.x1 - 1) {
            put(column, row, kernel.depth(column, row));
        }
    }
}

/// A voxel's kernel and colour; `None` if it is not drawn.
fn splat(projector: &Projector, limits: Limits, voxel: [u16; 3], record: usize) -> Option<(Kernel, [f32; 3])> {
    if projector.crop.is_some_and(|crop| (0..3).any(|a| voxel[a] < crop.low[a] || voxel[a] > crop.high[a])) {
        return None;
    }
    let (x, y, ellipse, strength) = place(projector, voxel)?;
    let [red, green, blue, depth] = projector.look(record);
    let peak = if projector.maximum { depth } else { at_most(depth * strength, MAX_DEPTH as f32 * LOG2_E) };
    if !(strength > 0.0 && peak > 0.0) {
        return None;
    }
    let colour = light(projector, voxel, record, [red, green, blue]);
    let centre = Centre { x: x.0, y: y.0, rest_x: x.1, rest_y: y.1 };
    Some((Kernel { centre, ellipse, cut: limits.cut, peak }, colour))
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
