//! Levels of detail: the same voxels on a grid with fewer points.
//!
//! In: rows of voxels. Out: rows of a coarser level, whose voxels stand for blocks of up to 2 x 2 x 2 points. A voxel's
//! coverage says how much of its block is visible and where. Its codes are means, in which voxels count by their share, by
//! how much of them is seen, and by their optical depth. They are then moved to where the voxel is as opaque as its block.
//! A level is computed from the level below it as that is stored, so all levels follow from the stored voxels and the file's
//! transfer function: `formats/adj-1.md`, section 13.
//!
//! Memory: the visible voxels of a few rows for each thread that reads.

use std::collections::BTreeMap;
use std::ops::Range;

use serde::{Deserialize, Serialize};
use serde_json::value::RawValue;

use super::coverage::MOST_SHARE;
use super::exposure::{Exposure, NeighbourDepths};
use super::layout::{Channels, Facts, Scales, TILE_EDGE};
use super::pack::Record;
use super::rows::{Region, Rows, Voxel};
use super::visible::stored_depth;
use crate::classify::normal::Coherence;
use crate::classify::{MagnitudeCodec, TransferFunction, normal};
use crate::error::Result;
use crate::volume::Grid;
use crate::volume::grid::coordinate16;

/// Largest number of levels that a file holds beside its own voxels, level 0.
pub const MOST_LEVELS: u8 = 15;
/// [`Levels::Auto`] makes no level of one whose longest axis has fewer than twice as many points, less one.
const AUTO_POINTS: u32 = 32;
/// [`Levels::Auto`] makes no level of a level that has fewer voxels.
const AUTO_VOXELS: u64 = 4_096;
/// Number of grid points of a slice that are read at once.
const POINTS_AT_ONCE: u32 = 1 << 15;

/// How many coarser levels of detail are made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Levels {
    /// This number, at most [`MOST_LEVELS`], or fewer if the grid allows no more; 0 for none.
    Count(u8),
    /// As many as are of use: each is made of a level with at least 63 points along its longest axis and at least 4,096
    /// voxels, and has at most nine tenths of these voxels.
    Auto,
}

impl Default for Levels {
    fn default() -> Levels {
        Levels::Count(0)
    }
}

impl From<u8> for Levels {
    fn from(count: u8) -> Levels {
        Levels::Count(count)
    }
}

impl Levels {
    /// Returns whether no levels are made.
    pub fn is_none(&self) -> bool {
        *self == Levels::Count(0)
    }

    /// Returns whether level `level` is wanted, of a level of `voxels` voxels on `below`.
    pub(crate) fn want(self, level: u8, below: &Grid, voxels: u64) -> bool {
        level <= MOST_LEVELS
            && match self {
                Levels::Count(count) => level <= count,
                Levels::Auto => {
                    below.dims.iter().any(|&points| points.div_ceil(2) >= AUTO_POINTS) && voxels >= AUTO_VOXELS
                }
            }
    }

    /// Returns whether a level of `voxels` voxels, made of `below` voxels, is kept.
    pub(crate) fn keep(self, voxels: u64, below: u64) -> bool {
        self != Levels::Auto || 10 * voxels <= 9 * below
    }
}

/// Returns the grid of the level above one on `grid`, and how many points along each axis become one; `None` if there is no
/// coarser grid.
///
/// Axes are halved whose spacing is below sqrt(2) times the smallest. An axis with one point does not count.
pub fn coarser(grid: &Grid) -> Option<(Grid, [u32; 3])> {
    let long = (0..3).filter(|&a| grid.dims[a] > 1);
    let smallest = long.clone().map(|a| grid.spacing[a]).reduce(f64::min)?;
    let mut factors = [1; 3];
    let mut coarse = grid.clone();
    for a in long.filter(|&a| grid.spacing[a] < std::f64::consts::SQRT_2 * smallest) {
        factors[a] = 2;
        coarse.dims[a] = grid.dims[a].div_ceil(2);
        coarse.spacing[a] = 2.0 * grid.spacing[a];
        for w in 0..3 {
            coarse.origin[w] += 0.5 * grid.spacing[a] * grid.direction[a][w];
        }
    }
    coarse.check().is_ok().then_some((coarse, factors))
}

/// Returns the channels of the level above one with these: level 1 has masks of the points below, coarser levels have words.
fn channels_above(below: Channels) -> Channels {
    Channels { coverage_bits: if below.coverage_bits == 0 { 8 } else { 16 }, coherence: below.normal_bits > 0, ..below }
}

/// Returns the facts of the level above one with the facts `below`, still without voxels, and how many points along each
/// axis become one.
pub(crate) fn level_facts(below: &Facts) -> Option<(Facts, [u32; 3])> {
    let (grid, factors) = coarser(&below.grid)?;
    let channels = channels_above(below.channels);
    Some((Facts { grid, channels, visible_voxels: 0, ..below.clone() }, factors))
}

/// Returns whether a file with this description holds a label map, whose codes cannot be averaged.
pub(crate) fn holds_labels(description: &[u8]) -> bool {
    // Of two members of one name the last one counts. Values are not parsed: a long function would take many times its bytes.
    let members = |text: &str| serde_json::from_str::<BTreeMap<String, Box<RawValue>>>(text).ok();
    let kind = std::str::from_utf8(description)
        .ok()
        .and_then(|text| members(text)?.remove("transfer_function"))
        .and_then(|function| members(function.get())?.remove("kind"));
    kind.is_some_and(|kind| serde_json::from_str::<String>(kind.get()).is_ok_and(|kind| kind == "labels"))
}

/// What a file's transfer function says of how a level is made.
#[derive(Debug, Clone, Default)]
pub struct LevelLook {
    /// Whether values are labels, of which the one that shows the largest area stays.
    is_labels: bool,
    /// `None` if all voxels are seen alike.
    depths: Option<CodeDepths>,
    /// The length for which depths are.
    length: f64,
}

/// The optical depths of codes, per reference length, in parts of 65,536.
#[derive(Debug, Clone)]
struct CodeDepths {
    function: TransferFunction,
    scales: Scales,
    /// The gradient magnitudes of codes, if depths depend on these.
    magnitudes: Option<MagnitudeCodec>,
    /// For each value code, or for each pair of codes of an 8-bit value and a magnitude: the index is then the value's code times
    /// 256 plus the magnitude's. Empty for 16-bit values with magnitudes: all their pairs would take 64 MiB.
    table: Vec<u32>,
}

impl CodeDepths {
    /// `None` if depths depend on magnitudes whose scale is out of range.
    fn new(function: TransferFunction, facts: &Facts) -> Option<CodeDepths> {
        let magnitudes = if function.uses_gradient() && facts.channels.magnitude_bits > 0 {
            Some(MagnitudeCodec::new(facts.scales.magnitude_scale).ok()?)
        } else {
            None
        };
        let mut depths = CodeDepths { function, scales: facts.scales, magnitudes, table: Vec::new() };
        let last = facts.channels.last_value_code();
        depths.table = match (&depths.magnitudes, last) {
            (None, _) => (0..=last).map(|value| depths.computed([value, 0])).collect(),
            (Some(_), 0xff) => {
                let pairs = (0..=last).flat_map(|value| (0..=0xff).map(move |magnitude| [value, magnitude]));
                pairs.map(|codes| depths.computed(codes)).collect()
            }
            (Some(_), _) => Vec::new(),
        };
        Some(depths)
    }

    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most 2^20")]
    fn computed(&self, [value, magnitude]: [u16; 2]) -> u32 {
        let decode = |codec: &MagnitudeCodec| codec.decode(u8::try_from(magnitude).unwrap_or(u8::MAX));
        let magnitude = self.magnitudes.as_ref().map_or(f64::MAX, decode);
        (65_536.0 * stored_depth(&self.function, &self.scales, value, magnitude)).round() as u32
    }

    /// Returns the depth of the codes of a value and a magnitude.
    #[inline]
    fn of(&self, [value, magnitude]: [u16; 2]) -> u32 {
        let index = match self.magnitudes {
            None => usize::from(value),
            Some(_) => 256 * usize::from(value) + usize::from(magnitude),
        };
        self.table.get(index).copied().unwrap_or_else(|| self.computed([value, magnitude]))
    }
}

impl LevelLook {
    /// Returns the look of a file with this description and these facts.
    pub fn new(description: &[u8], facts: &Facts) -> LevelLook {
        let (is_labels, spacing) = (holds_labels(description), facts.grid.mean_spacing());
        let transfer_function = TransferFunction::of_description(description, spacing);
        let length = transfer_function.as_ref().and_then(TransferFunction::reference_length).unwrap_or(spacing);
        let depths = transfer_function.and_then(|function| CodeDepths::new(function, facts));
        LevelLook { is_labels, depths, length }
    }

    /// Returns the optical depth of a voxel that is wholly visible, per reference length; 0 without a function.
    #[inline]
    fn depth(&self, record: &Record) -> u32 {
        self.depths.as_ref().map_or(0, |depths| depths.of([record.value, record.magnitude.into()]))
    }

    /// Returns the optical depth of what is visible of a voxel.
    #[inline]
    fn visible_depth(&self, record: &Record, channels: Channels) -> u32 {
        let depth = u64::from(self.depth(record)) * weight(record, channels) / whole(channels);
        u32::try_from(depth).unwrap_or(u32::MAX)
    }
}

/// Returns how much of a voxel is visible, of [`whole`] for all of it.
#[inline]
fn weight(record: &Record, channels: Channels) -> u64 {
    let code = u64::from(record.coverage);
    // A damaged file may have coverages of nothing.
    match channels.coverage_bits {
        0 => 1,
        8 => code.count_ones().max(1).into(),
        _ => (code & 0x7f).max(1).pow(2),
    }
}

/// Returns the [`weight`] of a voxel that is wholly visible.
#[inline]
fn whole(channels: Channels) -> u64 {
    match channels.coverage_bits {
        0 => 1,
        8 => 8,
        _ => u64::from(MOST_SHARE).pow(2),
    }
}

/// The voxels of the level above some rows.
pub struct CoarserRows<'a> {
    rows: &'a dyn Rows,
    factors: [u32; 3],
    dims: [u32; 3],
    look: &'a LevelLook,
    /// The spacings of `rows`, in parts of the length for which the look's depths are.
    lengths: [f64; 3],
    threads: usize,
}

impl<'a> CoarserRows<'a> {
    /// Creates the level above `rows`, whose spacings are `spacing` and of which `factors` points along each axis, 1 or 2,
    /// become one. `threads`: the number of threads that will read.
    pub fn new(
        rows: &'a dyn Rows,
        spacing: [f64; 3],
        factors: [u32; 3],
        look: &'a LevelLook,
        threads: usize,
    ) -> CoarserRows<'a> {
        let dims = rows.dims();
        let dims = std::array::from_fn(|a| dims[a].div_ceil(factors[a]));
        // Larger lengths are as opaque; infinite ones times no depth would be no numbers.
        let lengths = spacing.map(|spacing| (spacing / look.length).min(1e6));
        CoarserRows { rows, factors, dims, look, lengths, threads }
    }

    /// Returns how many of the coarser rows are made at once: few, and in whole tiles.
    fn rows_at_once(&self) -> u32 {
        let edge = u32::from(TILE_EDGE);
        (POINTS_AT_ONCE / self.rows.dims()[0]).next_multiple_of(edge).max(edge)
    }

    /// Returns the points along axis `a` of the level below that become `range`.
    fn fine(&self, a: usize, range: &Range<u32>) -> Range<u32> {
        let [start, end] = [range.start, range.end].map(|end| (end * self.factors[a]).min(self.rows.dims()[a]));
        start..end
    }

    /// Returns the box of the level below that becomes `region`, which lies inside the grid.
    fn below(&self, region: &Region) -> Region {
        let [xs, ys, zs] = region.sides();
        Region { xs: self.fine(0, xs), ys: self.fine(1, ys), zs: self.fine(2, zs) }
    }
}

impl Rows for CoarserRows<'_> {
    fn dims(&self) -> [u32; 3] {
        self.dims
    }

    fn channels(&self) -> Channels {
        channels_above(self.rows.channels())
    }

    fn memory(&self) -> u64 {
        let [width, height, _] = self.rows.dims().map(u64::from);
        let rows = (u64::from(self.rows_at_once()) * 2).min(height);
        let around = (width + 2) * (rows + 2) * 4 * size_of::<u32>() as u64;
        // A growing array may hold twice its bytes.
        self.rows.memory() + (2 * width * rows * 2 * size_of::<Voxel>() as u64 + around) * self.threads as u64
    }

    fn is_void(&self, region: &Region) -> bool {
        self.rows.is_void(&self.below(&region.and(&Region::of_grid(self.dims))))
    }

    fn read(&self, region: Region, row: &mut dyn FnMut(u16, u16, &[Voxel])) -> Result<()> {
        let region = region.and(&Region::of_grid(self.dims));
        if region.is_empty() {
            return Ok(());
        }
        let step = self.rows_at_once();
        let channels = self.rows.channels();
        let mut parts: Vec<Vec<Voxel>> = Vec::new();
        let mut depths = NeighbourDepths::default();
        let mut voxels = Vec::new();
        // What is left to do, the last first. It is halved down to some rows of one slice; halves without voxels are left out.
        let mut left = vec![region];
        while let Some(region) = left.pop() {
            let below = self.below(&region);
            if self.rows.is_void(&below) {
                continue;
            }
            let [z, first] = [region.zs.start, region.ys.start];
            let ([_, row_count, slice_count], [_, height, depth]) = (region.size(), below.size());
            if slice_count > 1 {
                let middle = z + slice_count / 2;
                left.push(Region { zs: middle..region.zs.end, ..region.clone() });
                left.push(Region { zs: z..middle, ..region });
                continue;
            }
            if row_count > step {
                let middle = first + (row_count / 2).next_multiple_of(step);
                left.push(Region { ys: middle..region.ys.end, ..region.clone() });
                left.push(Region { ys: first..middle, ..region });
                continue;
            }
            let [_, low_y, low_z] = below.low();
            parts.resize_with((height * depth) as usize, Vec::new);
            parts.iter_mut().for_each(Vec::clear);
            depths.begin(&below);
            self.rows.read(below.and_neighbours(), &mut |y, z, part| {
                let (y, z) = (u32::from(y), u32::from(z));
                for voxel in part {
                    let depth = self.look.visible_depth(&voxel.record, channels);
                    depths.set([voxel.x.into(), y, z], depth);
                }
                if below.ys.contains(&y) && below.zs.contains(&z) {
                    let inside = part.iter().filter(|voxel| below.xs.contains(&voxel.x.into()));
                    parts[((z - low_z) * height + y - low_y) as usize].extend(inside);
                }
            })?;
            for y in region.ys {
                // Of the block's rows, those at the low and the high end of y, first at the low end of z.
                let mut block: [&[Voxel]; 4] = [&[]; 4];
                let ys = self.fine(1, &(y..y + 1));
                for (z, y_below) in (0..depth).flat_map(|z| ys.clone().map(move |y_below| (z, y_below))) {
                    let high = (y_below - y * self.factors[1]) as usize;
                    block[2 * z as usize + high] = &parts[(z * height + y_below - low_y) as usize];
                }
                voxels.clear();
                let low = [0, y * self.factors[1], z * self.factors[2]];
                self.merge(block, low, &depths, &mut voxels);
                if !voxels.is_empty() {
                    row(coordinate16(y), coordinate16(z), &voxels);
                }
            }
        }
        Ok(())
    }
}

impl CoarserRows<'_> {
    /// Makes one row of the rows of the level below at the low and the high end of y, first at the low end of z.
    ///
    /// `low` has the lowest y and z of these.
    fn merge(&self, mut rows: [&[Voxel]; 4], low: [u32; 3], depths: &NeighbourDepths, voxels: &mut Vec<Voxel>) {
        let shift = self.factors[0] - 1;
        let channels = self.rows.channels();
        while let Some(x) = rows.iter().filter_map(|row| row.first()).map(|voxel| voxel.x >> shift).min() {
            let mut block = Block { factors: self.factors, ..Block::default() };
            for (place, row) in rows.iter_mut().enumerate() {
                while let Some((voxel, rest)) = row.split_first().filter(|(voxel, _)| voxel.x >> shift == x) {
                    let high = usize::from(voxel.x & u16::from(self.factors[0] == 2));
                    let [up, back] = [place & 1, place >> 1].map(|end| u32::from(end == 1));
                    let at = [voxel.x.into(), low[1] + up, low[2] + back];
                    let normal = normal::decode(voxel.record.normal, channels.normal_bits).map(f64::from);
                    let exposure = depths.exposure(at, normal, self.lengths);
                    let depth = self.look.depth(&voxel.record);
                    block.add(high + 2 * place, &voxel.record, normal, channels, exposure, depth);
                    *row = rest;
                }
            }
            voxels.push(Voxel { x, record: block.record(channels, self.look) });
        }
    }
}

/// The voxels of a block, added up in the order x, y, z.
#[derive(Default)]
struct Block {
    factors: [u32; 3],
    voxels: [BlockVoxel; 8],
    count: usize,
    /// The sums of shares, of shares times depths, and of what voxels count in means.
    weight: u64,
    depth: u64,
    counts: u64,
    value: u64,
    magnitude: u64,
    /// A bit for each voxel: 1 << (x + 2 y + 4 z) for its place in the block, 0 or 1 along each axis.
    mask: u32,
    /// For each axis: the weights of voxels at its high end less those at its low end, and the sum of weights times offsets,
    /// in eighths.
    ends: [i64; 3],
    moments: [i64; 3],
}

/// A voxel of a block.
#[derive(Default, Clone, Copy)]
struct BlockVoxel {
    /// How much it counts for the label: in proportion to the area that it shows, the share that is visible, and its depth.
    area: u64,
    /// How much it counts for the normal.
    lit: f64,
    depth: u32,
    /// Its unit normal, 0 for none, and what it is lit as.
    normal: [f64; 3],
    coherence: Coherence,
    record: Record,
}

impl Block {
    /// Adds a voxel at `place`: x + 2 y + 4 z, each 0 or 1.
    #[inline]
    fn add(
        &mut self,
        place: usize,
        record: &Record,
        normal: [f64; 3],
        channels: Channels,
        exposure: Exposure,
        depth: u32,
    ) {
        let code = u64::from(record.coverage);
        let weight = weight(record, channels);
        let offsets = match channels.coverage_bits {
            0 => [0; 3],
            8 => [0xaau64, 0xcc, 0xf0].map(|end| 2 * (2 * i64::from((code & end).count_ones()) - weight.cast_signed())),
            _ => [7, 10, 13].map(|at| weight.cast_signed() * ((code >> at & 7).min(6).cast_signed() - 3)),
        };
        self.mask |= 1 << place;
        let sums = self.ends.iter_mut().zip(&mut self.moments).zip(offsets);
        for (a, ((ends, moment), offset)) in sums.enumerate() {
            let is_high = place >> a & 1 == 1;
            *ends += if is_high { weight.cast_signed() } else { -weight.cast_signed() };
            *moment += offset;
        }
        let [counts, area] = [exposure.front, exposure.area].map(|seen| weight * seen * u64::from(1 + depth / 1024));
        let has_normal = normal != [0.0; 3];
        let coherence = match channels.coherence {
            _ if !has_normal => Coherence { alike: 0.0, bare: 1.0 },
            true => Coherence::of_code(record.normal, channels.normal_bits),
            false => Coherence::ONE,
        };
        let shown = if has_normal { exposure.area } else { Exposure::ONE_FACE };
        let lit = exposure.lit(shown) * (weight * u64::from(1 + depth / 1024)) as f64;
        self.voxels[self.count] = BlockVoxel { area, lit, depth, normal, coherence, record: *record };
        self.count += 1;
        self.weight += weight;
        self.depth += weight * u64::from(depth);
        self.counts += counts;
        self.value += counts * u64::from(record.value);
        self.magnitude += counts * u64::from(record.magnitude);
    }

    #[inline]
    fn record(&self, channels: Channels, look: &LevelLook) -> Record {
        let means = [self.value, self.magnitude]
            .map(|sum| u16::try_from((2 * sum + self.counts) / (2 * self.counts)).unwrap_or(u16::MAX));
        let [value, magnitude] = match &look.depths {
            _ if look.is_labels => [self.label(), means[1]],
            Some(depths) => self.as_opaque(means, depths),
            None => means,
        };
        Record {
            value,
            normal: self.normal(channels.normal_bits),
            magnitude: u8::try_from(magnitude).unwrap_or(u8::MAX),
            coverage: if channels.coverage_bits == 0 { self.point_mask() } else { self.word(channels) },
        }
    }

    /// Returns the mask of the block's points; along an axis that is not halved both ends are alike.
    fn point_mask(&self) -> u16 {
        let mut mask = self.mask;
        for (a, _) in self.factors.iter().enumerate().filter(|(_, factor)| **factor == 1) {
            mask |= mask << (1 << a);
        }
        u16::try_from(mask & 0xff).expect("eight bits")
    }

    /// Returns the word for the block's share and offsets.
    fn word(&self, channels: Channels) -> u16 {
        let parts = u64::from(self.factors.iter().product::<u32>()) * whole(channels);
        // The largest code with `(2 code - 1)^2 <= 4 * 127^2 * share`: the root, rounded half up.
        let root = (4 * u64::from(MOST_SHARE).pow(2) * self.weight / parts).isqrt().div_ceil(2);
        let share = u16::try_from(root).unwrap_or(u16::MAX).clamp(1, MOST_SHARE.into());
        let weight = self.weight.cast_signed();
        let mut code = share;
        for (a, at) in [7, 10, 13].into_iter().enumerate() {
            // The offset in eighths: along a halved axis voxels lie a quarter from the middle, and are half as long.
            let (sum, unit) = match self.factors[a] {
                2 => (4 * self.ends[a] + self.moments[a], 2 * weight),
                _ => (self.moments[a], weight),
            };
            // Rounded, halves away from zero.
            let rounded = (2 * sum.abs() + unit) / (2 * unit) * sum.signum();
            let offset = u16::try_from(rounded.clamp(-3, 3) + 3).expect("0 to 6");
            code |= offset << at;
        }
        code
    }

    /// Returns the codes of value and magnitude on the way from `means` to those of a voxel at which the depth is nearest to the mean
    /// depth of the block.
    ///
    /// The depth of means is not the mean of depths: where opacity varies with value, a level lost up to a fifth of the light.
    fn as_opaque(&self, means: [u16; 2], depths: &CodeDepths) -> [u16; 2] {
        /// Number of steps on the way; a power of two.
        const STEPS: u32 = 256;
        let wanted = u32::try_from(self.depth / self.weight).unwrap_or(u32::MAX);
        let mean_depth = depths.of(means);
        let is_other_side = |depth: u32| (depth < wanted) != (mean_depth < wanted);
        let other_side = self.stored().iter().filter(|voxel| is_other_side(voxel.depth));
        let nearest = other_side.min_by_key(|voxel| voxel.depth.abs_diff(wanted));
        let Some(BlockVoxel { record, .. }) = nearest.filter(|_| mean_depth != wanted) else { return means };
        let end = [record.value, record.magnitude.into()];
        let codes_at = |step: u32| {
            let code = |k: usize| ((STEPS - step) * u32::from(means[k]) + step * u32::from(end[k]) + STEPS / 2) / STEPS;
            [0, 1].map(|k| u16::try_from(code(k)).unwrap_or(u16::MAX))
        };
        let (mut low, mut high) = (0, STEPS);
        while high - low > 1 {
            let middle = u32::midpoint(low, high);
            *(if is_other_side(depths.of(codes_at(middle))) { &mut high } else { &mut low }) = middle;
        }
        let error = |step: u32| depths.of(codes_at(step)).abs_diff(wanted);
        codes_at(if error(low) <= error(high) { low } else { high })
    }

    fn stored(&self) -> &[BlockVoxel] {
        &self.voxels[..self.count]
    }

    /// Returns the value code with the largest weight in all; of equals the lowest.
    fn label(&self) -> u16 {
        let weight_of = |code: u16| -> u64 {
            self.stored().iter().filter(|voxel| voxel.record.value == code).map(|voxel| voxel.area).sum()
        };
        let codes = self.stored().iter().map(|voxel| voxel.record.value);
        codes.max_by_key(|&code| (weight_of(code), std::cmp::Reverse(code))).unwrap_or(0)
    }

    /// Returns the code of the mean normal, and of how alike the normals are.
    ///
    /// Lighting is two-sided, and the sides of a thin wall have opposite normals: each counts with the sign with which it
    /// is on the side of the voxel that counts most.
    fn normal(&self, bits: u8) -> u32 {
        if bits == 0 {
            return 0;
        }
        let with_normal = || self.stored().iter().filter(|voxel| voxel.normal != [0.0; 3]);
        let most = with_normal().map(|voxel| voxel.lit).fold(0.0, f64::max);
        let Some(first) = with_normal().find(|voxel| voxel.lit == most) else { return normal::none(bits) };
        let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let (mut mean, mut alike, mut bare, mut all) = ([0.0; 3], 0.0, 0.0, 0.0);
        for BlockVoxel { lit, normal, coherence, .. } in self.stored() {
            let side = if dot(first.normal, *normal) < 0.0 { -1.0 } else { 1.0 };
            let factor = side * lit * (1.0 - f64::from(coherence.bare)) * f64::from(coherence.alike);
            mean = [0, 1, 2].map(|axis| mean[axis] + factor * normal[axis]);
        }
        let length = dot(mean, mean).sqrt();
        for BlockVoxel { lit, normal, coherence, .. } in self.stored() {
            // Along the mean 1, of normals of all directions 0: their cosines are 1/2 on average.
            let along = 2.0 * (dot(mean, *normal) / length).abs() - 1.0;
            alike += lit * (1.0 - f64::from(coherence.bare)) * f64::from(coherence.alike) * along;
            bare += lit * f64::from(coherence.bare);
            all += lit;
        }
        #[expect(clippy::cast_possible_truncation, reason = "rounded to a few numbers")]
        let coherence = Coherence { alike: (alike / (all - bare)) as f32, bare: (bare / all) as f32 };
        // A code stands for the direction opposite to a gradient.
        normal::encode_coherent(mean.map(|component| -component), coherence, bits)
    }
}
