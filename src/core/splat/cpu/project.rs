//! Stage 1: voxels to splats.
//!
//! In: up to a block of voxels, with their records. Out: their footprints, colours and peaks. Every loop
//! over a block is elementwise, so that any number of voxels may go side by side:
//!
//! ```text
//! place        centre, ellipse, bounding box                 all voxels of the block
//! keep         indices of those that reach the band          those not yet frozen, in the crop
//! colour       code -> look; normal -> light                 kept ones only
//! ```
//!
//! Centres are computed in double precision and split into the nearest pixel and the rest, so that a picture of
//! 16,384 pixels is as exact as a small one.

#![expect(
    clippy::cast_possible_truncation,
    clippy::needless_range_loop,
    reason = "stages compute in single precision from double, and index loops over several arrays run side by side"
)]

use super::planes::Planes;
use super::raster::{BLOCK, EllipseEach, Limits, Splats};
use crate::arena::Lane;
use crate::classify::normal;
use crate::splat::arith::{LOG2_E, at_least, at_most, keep_if};
use crate::splat::composite::{Look, MAX_DEPTH, Table};
use crate::splat::kernel::{Ellipse, footprint};
use crate::splat::shade::Lights;
use crate::splat::shot::Shot;
use crate::splat::view::PixelMap;
use crate::traverse::{Batch, VoxelBox};

/// What stage 1 needs of a frame.
#[derive(Debug)]
pub struct Projector<'a> {
    pub(crate) lane: Lane<'a>,
    pub(crate) table: &'a Table<'a>,
    pub lights: Option<Lights>,
    pub(crate) crop: Option<VoxelBox>,
    /// Whether peaks are normalised values.
    pub(crate) maximum: bool,
    /// Ink of the fourth value: the blend's.
    pub fourth_ink: f32,
    pub(super) sigma: f32,
    pub(super) cut_off: f32,
    /// Indices of the slow, medium and fast axis.
    pub nesting: [usize; 3],
    pub(crate) kind: Kind,
    /// The eye by axis, in mean voxels; the distance of voxels on each axis.
    pub(super) eye: [f32; 3],
    pub(super) steps: [f32; 3],
}

/// Where the voxels of a block are, along the slow, medium and fast axis; for every index below [`BLOCK`].
pub trait Coordinates {
    fn slow(&self, j: usize) -> f64;
    fn medium(&self, j: usize) -> f64;
    fn fast(&self, j: usize) -> f64;
    /// All three.
    fn single(&self, j: usize) -> [f32; 3];
}

/// Coordinates along the slow, medium and fast axis.
#[derive(Clone, Copy)]
struct Positions([[u16; BLOCK]; 3]);

/// Voxels of a lane that wait for a block to be full.
pub struct Voxels {
    pub count: usize,
    at: Positions,
    /// Their records in the lane's channels.
    pub(crate) records: [usize; BLOCK],
}

impl Voxels {
    pub fn new() -> Box<Voxels> {
        Box::new(Voxels { count: 0, at: Positions([[0; BLOCK]; 3]), records: [0; BLOCK] })
    }

    /// Whether there is room for `more`.
    #[inline(always)]
    pub fn have_room(&self, more: usize) -> bool {
        self.count + more <= BLOCK
    }

    /// Adds the voxels of `batch` from `from` on, `most` of them or as many as there is room for; gives how many.
    #[inline(always)]
    pub fn add(&mut self, batch: &Batch, from: usize, most: usize) -> usize {
        let count = (batch.len() - from).min(most).min(BLOCK - self.count);
        let (group, places) = (from..from + count, self.count..self.count + count);
        let Positions([slow, medium, fast]) = &mut self.at;
        slow[places.clone()].fill(batch.slow);
        medium[places.clone()].copy_from_slice(&batch.medium[group.clone()]);
        fast[places.clone()].copy_from_slice(&batch.fast[group.clone()]);
        for (out, index) in self.records[places].iter_mut().zip(group) {
            *out = batch.record_index(index);
        }
        self.count += count;
        count
    }
}

/// Voxels that are asked about and added at once.
pub const GROUP: usize = 16;

impl Coordinates for Positions {
    #[inline(always)]
    fn slow(&self, j: usize) -> f64 {
        self.0[0][j].into()
    }

    #[inline(always)]
    fn medium(&self, j: usize) -> f64 {
        self.0[1][j].into()
    }

    #[inline(always)]
    fn fast(&self, j: usize) -> f64 {
        self.0[2][j].into()
    }

    #[inline(always)]
    fn single(&self, j: usize) -> [f32; 3] {
        self.0.map(|along| along[j].into())
    }
}

/// What differs between the projections.
#[derive(Debug)]
pub(crate) enum Kind {
    Parallel {
        pixel_from_voxel: [[f64; 4]; 2],
        ellipse: Ellipse,
        /// Peak of a unit of optical depth.
        strength: f32,
    },
    Perspective {
        camera_from_voxel: [[f64; 4]; 3],
        focal: f64,
        centre: [f64; 2],
        near: f64,
        /// Kernel normalisation times focal length squared.
        strength: f32,
    },
}

impl<'a> Projector<'a> {
    pub fn new(shot: &Shot<'a>, table: &'a Table<'a>, fourth_ink: f32) -> Projector<'a> {
        let Shot { view, order, lane, lights, kernel, crop, maximum } = shot;
        let (sigma, cut_off) = (kernel.sigma, kernel.cut_off());
        let normalisation = kernel.normalisation();
        let kind = match view.map {
            PixelMap::Parallel { pixel_from_voxel, scale } => {
                let rows = pixel_from_voxel.map(|m| [m[0] as f32, m[1] as f32, m[2] as f32]);
                let print = footprint(rows, sigma, cut_off);
                let strength = normalisation * print.density * (scale * scale) as f32;
                Kind::Parallel { pixel_from_voxel, ellipse: print.ellipse, strength }
            }
            PixelMap::Perspective { camera_from_voxel, focal, centre, near } => {
                let strength = normalisation * (focal * focal) as f32;
                Kind::Perspective { camera_from_voxel, focal, centre, near, strength }
            }
        };
        Projector {
            lane: *lane,
            table,
            lights: *lights,
            crop: *crop,
            maximum: *maximum,
            fourth_ink,
            sigma,
            cut_off,
            nesting: [order.slow.index(), order.medium.index(), order.fast.index()],
            kind,
            eye: view.eye_scaled.map(|c| c as f32),
            steps: view.steps.map(|c| c as f32),
        }
    }

    /// The same for cubes of `edge` voxels a side that are one splat each: a kernel as many times as wide, which holds
    /// as many voxels' volumes.
    pub fn of_cubes(&self, edge: u32) -> Projector<'a> {
        let width = edge as f32;
        let sigma = self.sigma * width;
        let kind = match &self.kind {
            Kind::Parallel { pixel_from_voxel, ellipse, strength, .. } => {
                let rows = pixel_from_voxel.map(|m| [m[0] as f32, m[1] as f32, m[2] as f32]);
                let (one, many) = (footprint(rows, self.sigma, self.cut_off), footprint(rows, sigma, self.cut_off));
                debug_assert_eq!(one.ellipse, *ellipse);
                let strength = strength * (many.density / one.density) * width.powi(3);
                Kind::Parallel { pixel_from_voxel: *pixel_from_voxel, ellipse: many.ellipse, strength }
            }
            Kind::Perspective { camera_from_voxel, focal, centre, near, strength } => Kind::Perspective {
                camera_from_voxel: *camera_from_voxel,
                focal: *focal,
                centre: *centre,
                near: *near,
                strength: strength * width.powi(3),
            },
        };
        Projector { lane: self.lane, table: self.table, lights: self.lights, crop: self.crop, sigma, kind, ..*self }
    }

    /// Half-widths of all footprints of a parallel view; 0 otherwise.
    pub(crate) fn half(&self) -> [f64; 2] {
        match &self.kind {
            Kind::Parallel { ellipse, .. } => [ellipse.half_x.into(), ellipse.half_y.into()],
            Kind::Perspective { .. } => [0.0; 2],
        }
    }

    /// Stage 1 for a block.
    #[inline(always)]
    pub fn block(&self, voxels: &Voxels, out: &mut Splats, each: &mut EllipseEach, planes: &Planes, limits: Limits) {
        // A copy of their own tells the compiler that they and the results are apart.
        let at = voxels.at;
        self.place(&at, out, each);
        self.keep(voxels.count, self.in_crop(voxels), out, planes, limits);
        self.colour(voxels, out);
    }

    /// Which voxels of a block lie in the crop.
    #[inline(always)]
    pub(super) fn in_crop(&self, voxels: &Voxels) -> [bool; BLOCK] {
        let crop = self.crop.unwrap_or(VoxelBox { low: [0; 3], high: [u16::MAX; 3] });
        let (low, high) = (self.nesting.map(|axis| crop.low[axis]), self.nesting.map(|axis| crop.high[axis]));
        let Positions([slow, medium, fast]) = &voxels.at;
        let mut in_crop = [false; BLOCK];
        for j in 0..BLOCK {
            in_crop[j] = (slow[j] >= low[0])
                & (slow[j] <= high[0])
                & (medium[j] >= low[1])
                & (medium[j] <= high[1])
                & (fast[j] >= low[2])
                & (fast[j] <= high[2]);
        }
        in_crop
    }

    /// First pixels of the stamps of a slice's voxels, where that of a voxel at 0 lies at column `left` and row `top`.
    #[inline(always)]
    pub(super) fn plane_places(voxels: &Voxels, [left, top]: [i32; 2], out: &mut Splats) {
        let Positions([_, medium, fast]) = &voxels.at;
        for j in 0..BLOCK {
            out.x[j] = left + i32::from(fast[j]);
            out.y[j] = top + i32::from(medium[j]);
        }
    }

    /// Centres, ellipses and bounding boxes of a whole block.
    #[inline(always)]
    pub fn place<C: Coordinates>(&self, at: &C, out: &mut Splats, each: &mut EllipseEach) {
        match &self.kind {
            Kind::Parallel { .. } => self.place_parallel(at, out),
            Kind::Perspective { .. } => self.place_perspective(at, out, each),
        }
    }

    #[inline(always)]
    fn place_parallel<C: Coordinates>(&self, at: &C, out: &mut Splats) {
        let Kind::Parallel { pixel_from_voxel, ellipse, strength, .. } = &self.kind else { return };
        let [column, row] = pixel_from_voxel.map(|map| self.nested(&map));
        let (half_x, half_y) = (ellipse.half_x, ellipse.half_y);
        for from in (0..BLOCK).step_by(LANES) {
            let (mut x, mut y) = (Side::default(), Side::default());
            for j in 0..LANES {
                let place = [at.slow(from + j), at.medium(from + j), at.fast(from + j)];
                x.put(j, split(along(&column, place)), half_x);
                y.put(j, split(along(&row, place)), half_y);
            }
            x.store(from, &mut out.x, &mut out.rest_x, &mut out.low_x, &mut out.high_x);
            y.store(from, &mut out.y, &mut out.rest_y, &mut out.low_y, &mut out.high_y);
        }
        out.strength = [*strength; BLOCK];
    }

    /// An affine map by slow, medium and fast coordinate.
    #[inline(always)]
    fn nested(&self, map: &[f64; 4]) -> [f64; 4] {
        let [s, m, f] = self.nesting;
        [map[s], map[m], map[f], map[3]]
    }

    #[inline(always)]
    fn place_perspective<C: Coordinates>(&self, at: &C, out: &mut Splats, each: &mut EllipseEach) {
        let Kind::Perspective { camera_from_voxel, focal, centre, near, strength } = &self.kind else { return };
        let single = |map: &[f64; 4]| [map[0] as f32, map[1] as f32, map[2] as f32];
        let steps = camera_from_voxel.each_ref().map(single);
        let [right, up, forward] = camera_from_voxel.map(|map| self.nested(&map));
        let (focal, near, strength, [centre_x, centre_y]) = (*focal, *near, *strength, *centre);
        let (focal_single, sigma, cut_off) = (focal as f32, self.sigma, self.cut_off);
        for from in (0..BLOCK).step_by(LANES) {
            let (mut x, mut y) = (Side::default(), Side::default());
            let mut strengths = [0.0; LANES];
            let mut ellipses = [[0.0; LANES]; 3];
            for j in 0..LANES {
                let place = [at.slow(from + j), at.medium(from + j), at.fast(from + j)];
                let [t0, t1, t2] = [along(&right, place), along(&up, place), along(&forward, place)];
                let in_front = t2 >= near;
                let closeness = 1.0 / if in_front { t2 } else { near };
                let (across, above) = (t0 * closeness, t1 * closeness);
                let (tx, ty, near_by) = (across as f32, above as f32, closeness as f32);
                let print = footprint(jacobian(&steps, tx, ty, focal_single * near_by), sigma, cut_off);
                strengths[j] = keep_if(in_front, strength * print.density * slant(tx, ty) * (near_by * near_by));
                ellipses[0][j] = print.ellipse.across;
                ellipses[1][j] = print.ellipse.along;
                ellipses[2][j] = print.ellipse.shear;
                x.put(j, split(centre_x + focal * across), print.ellipse.half_x);
                y.put(j, split(centre_y - focal * above), print.ellipse.half_y);
            }
            x.store(from, &mut out.x, &mut out.rest_x, &mut out.low_x, &mut out.high_x);
            y.store(from, &mut out.y, &mut out.rest_y, &mut out.low_y, &mut out.high_y);
            out.strength[from..from + LANES].copy_from_slice(&strengths);
            each.across[from..from + LANES].copy_from_slice(&ellipses[0]);
            each.along[from..from + LANES].copy_from_slice(&ellipses[1]);
            each.shear[from..from + LANES].copy_from_slice(&ellipses[2]);
        }
    }

    /// Lists those of the first `count` splats that can change the band's pixels, of those that `wanted` lets through.
    #[inline(always)]
    pub fn keep(&self, count: usize, wanted: [bool; BLOCK], out: &mut Splats, planes: &Planes, limits: Limits) {
        let rect = planes.rect;
        let mut reaching = [false; BLOCK];
        for j in 0..BLOCK {
            let reaches = (out.high_x[j] >= rect.x0)
                & (out.low_x[j] < rect.x1)
                & (out.high_y[j] >= rect.y0)
                & (out.low_y[j] < rect.y1)
                & (out.low_x[j] <= out.high_x[j])
                & (out.low_y[j] <= out.high_y[j]);
            reaching[j] = reaches & wanted[j] & (out.strength[j] > 0.0);
        }
        let mut kept = 0;
        for j in 0..count {
            out.kept[kept] = j as u8;
            kept += usize::from(reaching[j]);
        }
        if limits.stop > 0.0 {
            let mut open = 0;
            for k in 0..kept {
                let j = usize::from(out.kept[k]) % BLOCK;
                let (x0, x1) = (out.low_x[j].max(rect.x0), out.high_x[j].min(rect.x1 - 1));
                let (y0, y1) = (out.low_y[j].max(rect.y0), out.high_y[j].min(rect.y1 - 1));
                out.kept[open] = out.kept[k];
                // Most splats are settled by the tile at their centre.
                let (x, y) = (out.x[j].max(x0).min(x1), out.y[j].max(y0).min(y1));
                let is_open = !planes.is_frozen(x, y, x, y) || !planes.is_frozen(x0, y0, x1, y1);
                open += usize::from(is_open);
            }
            kept = open;
        }
        out.count = kept;
    }

    /// Colours and peaks of the kept splats.
    #[inline(always)]
    pub(super) fn colour(&self, voxels: &Voxels, out: &mut Splats) {
        let count = out.count;
        // The commonest kind has a loop of its own: no question is asked twice.
        let bytes = self.table.of_bytes().filter(|_| self.lane.channels.value_bits == 8);
        for k in 0..count {
            let j = usize::from(out.kept[k]) % BLOCK;
            let record = voxels.records[j];
            let [red, green, blue, peak] = match bytes {
                Some(looks) => {
                    let code = match self.lane.values.get(record) {
                        Some(&code) => code,
                        None => self.lane.value_code(record) as u8,
                    };
                    looks[usize::from(code)]
                }
                None => self.look(record),
            };
            (out.ink[k], out.peak[k]) = ([red, green, blue, self.fourth_ink], peak);
        }
        if !self.maximum {
            weigh(out);
        }
        if let Some(lights) = &self.lights {
            let normals = self.normals(voxels, out);
            self.light(lights, &normals, &voxels.at, out);
        }
    }

    #[inline(always)]
    pub(super) fn look(&self, record: usize) -> Look {
        let magnitude = if self.table.needs_magnitude() { self.lane.magnitude_code(record) } else { 0 };
        self.table.look(self.lane.value_code(record), magnitude)
    }

    /// Normals of the kept splats.
    #[inline(always)]
    fn normals(&self, voxels: &Voxels, out: &Splats) -> [[f32; BLOCK]; 3] {
        let mut codes = [0u32; BLOCK];
        if self.lane.channels.normal_bits == 8 {
            let (normals, _) = self.lane.normals.as_chunks::<2>();
            for k in 0..out.count {
                let j = usize::from(out.kept[k]) % BLOCK;
                let record = voxels.records[j];
                codes[k] = match normals.get(record) {
                    Some(&code) => u16::from_le_bytes(code).into(),
                    None => self.lane.normal_code(record),
                };
            }
        } else {
            for k in 0..out.count {
                let j = usize::from(out.kept[k]) % BLOCK;
                codes[k] = self.lane.normal_code(voxels.records[j]);
            }
        }
        let mut normals = [[0.0f32; BLOCK]; 3];
        if self.lane.channels.normal_bits == 8 {
            for from in (0..out.count.min(BLOCK)).step_by(LANES) {
                let mut parts = [[0.0; LANES]; 3];
                for k in 0..LANES {
                    [parts[0][k], parts[1][k], parts[2][k]] = normal::decode8(codes[from + k] as u16);
                }
                for (normals, parts) in normals.iter_mut().zip(&parts) {
                    normals[from..from + LANES].copy_from_slice(parts);
                }
            }
        } else {
            for k in 0..BLOCK {
                [normals[0][k], normals[1][k], normals[2][k]] = normal::decode16(codes[k]);
            }
        }
        normals
    }

    /// Lights the kept splats by their normals.
    #[inline(always)]
    pub fn light<C: Coordinates>(&self, lights: &Lights, normals: &[[f32; BLOCK]; 3], at: &C, out: &mut Splats) {
        let mut shades = [[0.0f32; BLOCK]; 2];
        if let Kind::Parallel { .. } = self.kind {
            let lights = *lights;
            for from in (0..out.count.min(BLOCK)).step_by(LANES) {
                let mut parts = [[0.0; LANES]; 2];
                for k in 0..LANES {
                    let normal = [normals[0][from + k], normals[1][from + k], normals[2][from + k]];
                    [parts[0][k], parts[1][k]] = lights.shade(normal, lights.eye);
                }
                for (shades, parts) in shades.iter_mut().zip(&parts) {
                    shades[from..from + LANES].copy_from_slice(parts);
                }
            }
        } else {
            let [s, m, f] = self.nesting;
            let mut toward = [[0.0f32; BLOCK]; 3];
            for k in 0..out.count {
                let j = usize::from(out.kept[k]) % BLOCK;
                let [slow, medium, fast] = at.single(j);
                toward[s][k] = self.eye[s] - self.steps[s] * slow;
                toward[m][k] = self.eye[m] - self.steps[m] * medium;
                toward[f][k] = self.eye[f] - self.steps[f] * fast;
            }
            for k in 0..out.count.min(BLOCK).next_multiple_of(LANES) {
                let [x, y, z] = [toward[0][k], toward[1][k], toward[2][k]];
                let length = at_least(x * x + y * y + z * z, f32::MIN_POSITIVE).sqrt();
                let normal = [normals[0][k], normals[1][k], normals[2][k]];
                [shades[0][k], shades[1][k]] = lights.shade(normal, [x / length, y / length, z / length]);
            }
        }
        for k in 0..out.count.min(BLOCK) {
            let [red, green, blue, fourth] = out.ink[k];
            let [factor, highlight] = [shades[0][k], shades[1][k]];
            out.ink[k] = [red * factor + highlight, green * factor + highlight, blue * factor + highlight, fourth];
        }
    }
}

/// Voxels that are computed together, in arrays of their own: so the compiler knows them to be apart from all else.
const LANES: usize = 16;

/// Centres and boxes along a picture's rows or columns.
#[derive(Default)]
struct Side {
    nearest: [i32; LANES],
    rest: [f32; LANES],
    low: [i32; LANES],
    high: [i32; LANES],
}

impl Side {
    #[inline(always)]
    fn put(&mut self, j: usize, centre: (i32, f32), half: f32) {
        (self.nearest[j], self.rest[j]) = centre;
        (self.low[j], self.high[j]) = span(centre, half);
    }

    #[inline(always)]
    fn store(
        &self,
        from: usize,
        nearest: &mut [i32; BLOCK],
        rest: &mut [f32; BLOCK],
        low: &mut [i32; BLOCK],
        high: &mut [i32; BLOCK],
    ) {
        nearest[from..from + LANES].copy_from_slice(&self.nearest);
        rest[from..from + LANES].copy_from_slice(&self.rest);
        low[from..from + LANES].copy_from_slice(&self.low);
        high[from..from + LANES].copy_from_slice(&self.high);
    }
}

/// An affine map of a place, both by slow, medium and fast coordinate.
#[inline(always)]
pub(super) fn along(map: &[f64; 4], [slow, medium, fast]: [f64; 3]) -> f64 {
    (map[3] + map[0] * slow) + map[1] * medium + map[2] * fast
}

/// Peaks of the kept splats, from their optical depths per mean voxel.
#[inline(always)]
pub fn weigh(out: &mut Splats) {
    let most = MAX_DEPTH as f32 * LOG2_E;
    for k in 0..out.count {
        let strength = out.strength[usize::from(out.kept[k]) % BLOCK];
        out.peak[k] = at_most(out.peak[k] * strength, most);
    }
}

/// Pixels per voxel along each axis, for tangents `tx`, `ty` and `scale` pixels per mean voxel.
#[inline(always)]
pub(super) fn jacobian(steps: &[[f32; 3]; 3], tx: f32, ty: f32, scale: f32) -> [[f32; 3]; 2] {
    let [right, up, along] = steps;
    let mut rows = [[0.0; 3]; 2];
    for a in 0..3 {
        rows[0][a] = scale * (right[a] - tx * along[a]);
        rows[1][a] = scale * (ty * along[a] - up[a]);
    }
    rows
}

/// Length of a ray per length along the view axis. World area of a pixel across the ray: t2^3 / (|t| focal^2).
#[inline(always)]
pub(super) fn slant(tx: f32, ty: f32) -> f32 {
    (1.0 + tx * tx + ty * ty).sqrt()
}

/// The nearest pixel and the rest; beyond a thousand million pixels, and for NaN, that far.
#[inline(always)]
pub(super) fn split(at: f64) -> (i32, f32) {
    // Adding it leaves the nearest whole number in the low bits of the sum.
    const ROUND: f64 = 6_755_399_441_055_744.0;
    const FAR: f64 = 1e9;
    let at = if at < FAR { at } else { FAR };
    let at = if at > -FAR { at } else { -FAR };
    let rounded = at + ROUND;
    (rounded.to_bits() as u32 as i32, (at - (rounded - ROUND)) as f32)
}

/// First and last pixel within `half` of a centre; may take in a pixel that is a hair outside.
#[inline(always)]
pub(super) fn span((nearest, rest): (i32, f32), half: f32) -> (i32, i32) {
    const ROUND: f32 = 12_582_912.0;
    const NEARLY_HALF: f32 = 0.499_9;
    let whole = |value: f32| ((value + ROUND).to_bits() as i32).wrapping_sub(ROUND.to_bits() as i32);
    (nearest.wrapping_add(whole(rest - half + NEARLY_HALF)), nearest.wrapping_add(whole(rest + half - NEARLY_HALF)))
}
