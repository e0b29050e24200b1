//! The plain renderer: one voxel after the other, one pixel after the other.
//!
//! In: a drawing task and the picture's rectangle. Out: the picture's pixels. It shares the arithmetic of a single
//! voxel and a single pixel with the fast code and nothing else: no blocks, tiles, chords, frozen pixels or bands.
//! Tests check that both give equal bits.

use super::blend::{Additive, Blend, FrontToBack, sheet_loss};
use super::lattice::{Footprints, Lattice, TileRays};
use super::project::{Projector, affine_at, limited, nearest_pixel, pixel_span, slant};
use super::scatter::maximum::{MaximumRays, advance};
use super::splats::{Centre, SplatKernel};
use super::task::{BandResult, BandStats, DrawTask, combine, full_rect};
use super::tile_buffer::{Rect, TILE_SHIFT, TileBuffer, index_in_tile};
use super::warp::halved;
use crate::arena::layout::Channels;
use crate::classify::normal::{self, Coherence};
use crate::error::Result;
use crate::splat::Frame;
use crate::splat::arith::at_least;
use crate::splat::kernel::{Ellipse, footprint, jacobian, widened};
use crate::splat::near::{EyeRays, NearKernel};
use crate::splat::view::{Affine, PixelMap, single};
use crate::traverse::Batch;

/// Draws the whole picture.
pub(super) fn draw<B: Blend>(task: &DrawTask, rect: Rect) -> Result<BandResult> {
    let mut tiles = TileBuffer::new(rect, B::INITIAL_ALPHA)?;
    let stop = task.projector.stop;
    let stats = each_splat(task, |splat, _| splat.is_some_and(|splat| draw_splat::<B>(&mut tiles, splat, stop)));
    if let Some(front) = task.front.filter(|_| stop > 0.0) {
        for (x, y) in (rect.y0..rect.y1).flat_map(|y| (rect.x0..rect.x1).map(move |x| (x, y))) {
            if front.hides_tile(x >> TILE_SHIFT, y >> TILE_SHIFT) {
                tiles.set_pixel(x, y, [0.0; 4]);
            }
        }
    }
    Ok(BandResult { tiles, stats })
}

/// Draws the whole picture front to back, slice by slice: sums a slice's splats, then composites the sum.
pub(super) fn draw_sheets(task: &DrawTask, rect: Rect) -> Result<BandResult> {
    let mut tiles = TileBuffer::new(rect, FrontToBack::INITIAL_ALPHA)?;
    let mut sheet = TileBuffer::new(rect, Additive::INITIAL_ALPHA)?;
    let composite = |tiles: &mut TileBuffer, sheet: &mut TileBuffer| {
        for (x, y) in (rect.y0..rect.y1).flat_map(|y| (rect.x0..rect.x1).map(move |x| (x, y))) {
            let (old, added) = (tiles.pixel(x, y), sheet.pixel(x, y));
            let [loss, per_depth] = sheet_loss(old[3], added[3], task.projector.stop);
            let [red, green, blue] = [0, 1, 2].map(|c| old[c] + per_depth * added[c]);
            tiles.set_pixel(x, y, [red, green, blue, old[3] - loss]);
            sheet.set_pixel(x, y, [0.0; 4]);
        }
    };
    let mut last = None;
    let stats = each_splat(task, |splat, slow| {
        if last.replace(slow).is_some_and(|last| last != slow) {
            composite(&mut tiles, &mut sheet);
        }
        splat.is_some_and(|splat| draw_splat::<Additive>(&mut sheet, splat, 0.0))
    });
    composite(&mut tiles, &mut sheet);
    Ok(BandResult { tiles, stats })
}

/// Draws all voxels on a lattice; `shown` tells which of its tiles are drawn at all. Transmittances become opacities.
pub(super) fn draw_on_lattice<B: Blend>(
    task: &DrawTask,
    lattice: &Lattice,
    footprints: Option<&Footprints>,
    shown: &[bool],
) -> Result<(Frame, BandStats)> {
    let rect = full_rect(lattice.size);
    let mut tiles = TileBuffer::new(rect, B::INITIAL_ALPHA)?;
    let projector = &task.projector;
    let columns = lattice.size[0] as usize >> TILE_SHIFT;
    let stats = each_voxel(task, |voxel, record| {
        if !projector.clip.contains(voxel) {
            return false;
        }
        let [slow, medium, fast] = projector.slow_medium_fast.map(|axis| voxel[axis]);
        let slice = lattice.slice(slow);
        let (offset, shape) = projector.offset(record);
        let place = if projector.is_on_grid() {
            lattice.place(&slice, [fast.into(), medium.into()])
        } else {
            let on_grid = [slow, medium, fast].map(f64::from);
            Lattice::place_displaced(&slice, [0, 1, 2].map(|axis| on_grid[axis] + f64::from(offset[axis])))
        };
        let [red, green, blue, depth] = projector.look(record);
        let colour = lit_colour(projector, voxel, record, [red, green, blue]);
        let code = projector.lane.coverage_code(record);
        let footprint = footprints.map(|footprints| {
            let at = footprints.place(&slice, [fast, medium], code);
            (footprints, at)
        });
        let spans = [0, 1].map(|side| {
            if let Some((footprints, at)) = footprint {
                let [first, last] = footprints.pixels(side, at[side], code);
                return [first.max(0), last.min(lattice.size[side] as i32 - 1)];
            }
            let at = f64::from(place.pixel[side]);
            let around = lattice.farthest(&slice, side);
            let reach = lattice.reach(side, [at - around, at + around]) / slice.step[side] + 1.0;
            [((at - reach) as i32).max(0), ((at + reach) as i32).min(lattice.size[side] as i32 - 1)]
        });
        let mut is_drawn = false;
        for y in spans[1][0]..=spans[1][1] {
            for x in spans[0][0]..=spans[0][1] {
                let tile = [x >> TILE_SHIFT, y >> TILE_SHIFT];
                if !shown[tile[1] as usize * columns + tile[0] as usize] {
                    continue;
                }
                let rays = match projector.is_on_grid() {
                    true => lattice.tile(tile),
                    false => TileRays::new(tile, lattice.kernels(tile)[shape]),
                };
                let weight = match footprint {
                    Some((footprints, at)) => footprints.weight(at, code, [x, y]),
                    None => rays.weights(&place, projector.cut)[index_in_tile(x, y)],
                };
                let peak = limited(depth, rays.strength());
                if peak <= 0.0 {
                    continue;
                }
                blend_pixel::<B>(&mut tiles, [x, y], B::near_amount(peak * weight), colour, projector.stop);
                is_drawn = true;
            }
        }
        is_drawn
    });
    let threads = task.settings.threads;
    let bands = [BandResult { tiles, stats }];
    let transmits = B::INITIAL_ALPHA > 0.0;
    let mut frame = Frame::transparent(lattice.size)?;
    combine(&bands, threads, &mut frame, |pixel, [red, green, blue, alpha]| {
        *pixel = [red, green, blue, if transmits { 1.0 - alpha } else { alpha }];
    });
    let halves = lattice.halves();
    let kept = if halves == [false; 2] { frame } else { halved(&frame, halves, threads)? };
    Ok((kept, BandStats::of(&bands)))
}

/// What a voxel adds to pixels: the kernel's footprint (with rays if it is on rays), or if it is near the eye, its depth along each ray.
enum Splat<'a> {
    Footprint { kernel: SplatKernel, rays: Option<&'a EyeRays> },
    Near { rays: &'a EyeRays, kernel: NearKernel, depth: f32 },
}

impl Splat<'_> {
    /// Returns the first and last column, then the first and last row, of a box of all pixels that the splat reaches.
    fn pixels(&self) -> [(i32, i32); 2] {
        match self {
            Splat::Footprint { kernel: SplatKernel { centre, ellipse, .. }, .. } => {
                let Centre { x, y, offset_x, offset_y } = *centre;
                [pixel_span((x, offset_x), ellipse.half_x), pixel_span((y, offset_y), ellipse.half_y)]
            }
            Splat::Near { kernel, .. } => [kernel.columns, kernel.rows].map(|[first, last]| (first, last)),
        }
    }

    /// Returns the optical depth at a pixel, in units of ln 2.
    fn depth(&self, column: i32, row: i32) -> f32 {
        match self {
            Splat::Footprint { kernel, rays } => kernel.depth(column, row, *rays),
            Splat::Near { rays, kernel, depth } => {
                let [depth] = rays.depths(kernel, &rays.rays([column], [row]), *depth);
                depth
            }
        }
    }
}

/// A voxel's splat and colour.
type ColouredSplat<'a> = (Splat<'a>, [f32; 3]);

/// Draws the largest value on the ray of each pixel.
pub(super) fn draw_largest(task: &DrawTask, rect: Rect) -> Result<BandResult> {
    let (mut tiles, rays) = (TileBuffer::new(rect, 0.0)?, MaximumRays::new(task.setup));
    let place = |x: i32, y: i32| (y * rect.x1 + x).unsigned_abs() as usize;
    // The slice of the last voxel that was drawn on each pixel.
    let mut slices = vec![0u16; place(0, rect.y1)];
    let stats = each_voxel(task, |voxel, record| {
        let [_, _, _, value] = task.projector.whole_look(record);
        let nested = task.projector.slow_medium_fast.map(|axis| voxel[axis]);
        let position = nested.map(f64::from);
        let [left, right, top, bottom] = rays.pixels(position);
        if !task.projector.clip.contains(voxel) || value <= 0.0 {
            return false;
        }
        let mut is_drawn = false;
        for y in top.max(rect.y0)..=bottom.min(rect.y1 - 1) {
            for x in left.max(rect.x0)..=right.min(rect.x1 - 1) {
                let mut values = tiles.pixel(x, y).map(|value| [value]);
                let last = &mut slices[place(x, y)];
                if *last != nested[0] {
                    advance(&mut values, nested[0].wrapping_sub(*last));
                    *last = nested[0];
                }
                let near = rays.near(position, [x & !3, y & !3]);
                let (column, row) = ([(x & 3) as f32], [(y & 3) as f32]);
                let weights = match rays {
                    MaximumRays::Parallel { .. } => near.weights::<false, 1>(&column, &row),
                    MaximumRays::Perspective { .. } => near.weights::<true, 1>(&column, &row),
                };
                for (sum, weight) in values[1..].iter_mut().zip(weights) {
                    sum[0] += value * weight[0];
                }
                tiles.set_pixel(x, y, values.map(|[value]| value));
                is_drawn = true;
            }
        }
        is_drawn
    });
    Ok(BandResult { tiles, stats })
}

/// Blends a splat with the pixels of its box that lie in the picture; returns whether there are any.
fn draw_splat<B: Blend>(tiles: &mut TileBuffer, (splat, colour): ColouredSplat, stop: f32) -> bool {
    let rect = tiles.rect;
    let [(low_x, high_x), (low_y, high_y)] = splat.pixels();
    let mut is_drawn = false;
    for row in low_y.max(rect.y0)..=high_y.min(rect.y1 - 1) {
        for column in low_x.max(rect.x0)..=high_x.min(rect.x1 - 1) {
            blend_pixel::<B>(tiles, [column, row], B::amount::<false>(splat.depth(column, row)), colour, stop);
            is_drawn = true;
        }
    }
    is_drawn
}

/// Blends a splat with a pixel; `amount` is the factor on its colour there.
fn blend_pixel<B: Blend>(tiles: &mut TileBuffer, [x, y]: [i32; 2], amount: f32, colour: [f32; 3], stop: f32) {
    let old = tiles.pixel(x, y);
    let [red, green, blue] = [0, 1, 2].map(|c| B::blend(old[c], old[3], amount, colour[c], stop));
    tiles.set_pixel(x, y, [red, green, blue, B::fade(old[3], amount, stop)]);
}

/// Calls `draw` for each voxel with its splat (`None` if the voxel has none) and slice; `draw` returns whether it drew.
fn each_splat(task: &DrawTask, mut draw: impl FnMut(Option<ColouredSplat>, u16) -> bool) -> BandStats {
    each_voxel(task, |voxel, record| draw(splat(task, voxel, record), voxel[task.projector.slow_medium_fast[0]]))
}

/// Calls `draw` for each voxel with its coordinates and the index of its record; `draw` returns whether it drew.
fn each_voxel(task: &DrawTask, mut draw: impl FnMut([u16; 3], usize) -> bool) -> BandStats {
    let mut drawn = 0;
    let stats = task.walk(&mut |batch: &Batch| {
        for j in 0..batch.len() {
            let voxel = task.projector.unnested([batch.slow, batch.medium[j], batch.fast[j]]);
            drawn += u64::from(draw(voxel, batch.record_index(j)));
        }
    });
    BandStats { drawn, ..stats }
}

/// Returns a voxel's splat and colour; `None` if it is not drawn.
fn splat<'a>(task: &'a DrawTask, voxel: [u16; 3], record: usize) -> Option<ColouredSplat<'a>> {
    let projector = &task.projector;
    if !projector.clip.contains(voxel) {
        return None;
    }
    let [red, green, blue, depth] = projector.look(record);
    let (offset, shape) = projector.offset(record);
    let nested = projector.slow_medium_fast.map(|axis| f64::from(voxel[axis]));
    let place = [0, 1, 2].map(|axis| nested[axis] + f64::from(offset[axis]));
    let splat = project_voxel(projector, place, shape, depth)?;
    Some((splat, lit_colour(projector, voxel, record, [red, green, blue])))
}

/// Returns the splat of a voxel of this depth at a place along the slow, medium and fast axis; `None` if it is behind the eye or clipped, or shows nothing.
fn project_voxel<'a>(projector: &'a Projector, position: [f64; 3], shape: usize, depth: f32) -> Option<Splat<'a>> {
    let affine = |map: &Affine| affine_at(&projector.nested(map), position);
    let centre = |column: f64, row: f64| {
        let ((x, offset_x), (y, offset_y)) = (nearest_pixel(column), nearest_pixel(row));
        Centre { x, y, offset_x, offset_y }
    };
    let footprint_at = |centre: Centre, ellipse: Ellipse, strength: f32, rays: Option<&'a EyeRays>| {
        let peak = if rays.is_some() { depth * strength } else { limited(depth, strength) };
        let splat = Splat::Footprint { kernel: SplatKernel { centre, ellipse, cut: projector.cut, peak }, rays };
        (strength > 0.0 && peak > 0.0).then_some(splat)
    };
    match &projector.map {
        PixelMap::Parallel { pixel_from_voxel: [column, row], .. } => {
            let alike = (projector.ellipse, projector.strength);
            let (ellipse, strength) = projector.shapes.as_ref().map_or(alike, |shapes| shapes[shape]);
            footprint_at(centre(affine(column), affine(row)), ellipse, strength, None)
        }
        PixelMap::Perspective { camera_from_voxel, focal, centre: [middle_x, middle_y], near: far } => {
            let [t0, t1, t2] = camera_from_voxel.map(|map| affine(&map));
            // The comparison is false for NaN.
            let is_far = t2 >= *far;
            if !is_far {
                let rays = projector.rays.as_ref()?;
                let kernel = rays.kernel(projector.unnested(position), t2)?;
                return (depth > 0.0).then_some(Splat::Near { rays, kernel, depth });
            }
            let inverse_depth = 1.0 / t2;
            let (right, up) = (t0 * inverse_depth, t1 * inverse_depth);
            let (tan_x, tan_y, nearness) = (right as f32, up as f32, inverse_depth as f32);
            let rows = jacobian(&camera_from_voxel.each_ref().map(single), tan_x, tan_y, *focal as f32 * nearness);
            let rows = if projector.is_on_grid() { rows } else { widened(rows, projector.widths.of(shape)) };
            let rays = projector.rays.as_ref()?;
            let (square, closeness) = (rays.square(tan_x, tan_y), projector.reach_forward(rays) * nearness);
            let footprint = footprint(rows, projector.sigma, projector.cut_off, projector.low_pass);
            let footprint = footprint.in_perspective(square, slant(tan_x, tan_y), closeness);
            let strength = projector.strength * footprint.density * (nearness * nearness);
            let rays = (!footprint.is_widened).then_some(rays);
            footprint_at(centre(middle_x + focal * right, middle_y - focal * up), footprint.ellipse, strength, rays)
        }
    }
}

/// Returns a voxel's colour with the light on it.
fn lit_colour(projector: &Projector, voxel: [u16; 3], record: usize, colour: [f32; 3]) -> [f32; 3] {
    let Some(lights) = &projector.lights else { return colour };
    let code = projector.lane.normal_code(record);
    let Channels { normal_bits, coherence: has_coherence, .. } = projector.lane.channels;
    let normal = normal::decode(code, normal_bits);
    let eye = if projector.is_perspective() {
        let toward: [f32; 3] = std::array::from_fn(|a| projector.eye[a] - projector.steps[a] * f32::from(voxel[a]));
        let [x, y, z] = toward;
        let length = at_least(x * x + y * y + z * z, f32::MIN_POSITIVE).sqrt();
        toward.map(|c| c / length)
    } else {
        lights.eye
    };
    let [[factor], [highlight]] =
        lights.shade([&[normal[0]], &[normal[1]], &[normal[2]]], &eye.map(|component| [component]));
    let shade = [factor, highlight];
    let [factor, highlight] =
        if has_coherence { lights.scatter(shade, Coherence::of_code(code, normal_bits)) } else { shade };
    colour.map(|c| c * factor + highlight)
}
