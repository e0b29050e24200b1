//! Trimming: a smaller arena from an arena, without the volume.
//!
//! In: an open arena, and options that say which voxels and channels to keep. Out: the kept voxels as [`Rows`], read in
//! place, and the header of the new file. Codes and their meaning stay the same. Narrowing to 8-bit values is the
//! exception: the new codes are spread over the kept values, without loss if their range has at most 256 codes. Normals
//! are not computed again.

use std::ops::{Range, RangeInclusive};

use super::lane::Lane;
use super::lane_rows::LaneRows;
use super::layout::{Channels, Facts, Scales};
use super::open::Arena;
use super::pack::Record;
use super::rows::{Region, Rows};
use super::visible::{NOTICEABLE_OPACITY, VisibleCodes};
use crate::classify::normal::{self, Coherence};
use crate::classify::{Quantiser, TransferFunction};
use crate::error::{Error, Result};
use crate::volume::{Grid, SampleType};

/// Selects the voxels and channels of an arena to keep; the default keeps everything.
#[derive(Debug, Clone, Default)]
#[non_exhaustive]
pub struct TrimOptions {
    /// Keeps only voxels in this box of grid points.
    pub crop: Option<Region>,
    /// Keeps the size and origin of the grid when cropping, instead of shrinking the grid to the box.
    pub keep_grid: bool,
    /// Keeps only voxels whose codes are visible with this transfer function.
    pub transfer: Option<TransferFunction>,
    /// Narrows 16-bit values to 8 bits.
    pub narrow_values: bool,
    /// Narrows normals from 16 to 8 bits per component.
    pub narrow_normals: bool,
    /// Drops normals; the voxels are then drawn unlit.
    pub drop_normals: bool,
    /// Drops gradient magnitudes.
    pub drop_magnitudes: bool,
}

impl TrimOptions {
    /// Keeps only voxels in this box of grid points.
    pub fn with_crop(self, crop: impl Into<Option<Region>>) -> TrimOptions {
        TrimOptions { crop: crop.into(), ..self }
    }

    /// Sets whether cropping keeps the size and origin of the grid.
    pub fn with_keep_grid(self, keep_grid: bool) -> TrimOptions {
        TrimOptions { keep_grid, ..self }
    }

    /// Keeps only voxels whose codes are visible with this transfer function.
    pub fn with_transfer(self, transfer: impl Into<Option<TransferFunction>>) -> TrimOptions {
        TrimOptions { transfer: transfer.into(), ..self }
    }

    /// Sets whether 16-bit values are narrowed to 8 bits.
    pub fn with_narrow_values(self, narrow_values: bool) -> TrimOptions {
        TrimOptions { narrow_values, ..self }
    }

    /// Sets whether normals are narrowed from 16 to 8 bits per component.
    pub fn with_narrow_normals(self, narrow_normals: bool) -> TrimOptions {
        TrimOptions { narrow_normals, ..self }
    }

    /// Sets whether normals are dropped.
    pub fn with_drop_normals(self, drop_normals: bool) -> TrimOptions {
        TrimOptions { drop_normals, ..self }
    }

    /// Sets whether gradient magnitudes are dropped.
    pub fn with_drop_magnitudes(self, drop_magnitudes: bool) -> TrimOptions {
        TrimOptions { drop_magnitudes, ..self }
    }
}

/// The result of [`trim`].
#[non_exhaustive]
pub struct Trim<'a> {
    /// The voxels that are kept.
    pub rows: Box<dyn Rows + 'a>,
    /// Contents of the new file's header.
    pub facts: Facts,
    /// The new transfer function, if one was given, completed with everything that depends on the arena.
    pub transfer: Option<TransferFunction>,
    /// Number of noticeable voxels (opacity at least 0.02) that become transparent because their value is narrowed.
    pub blurred_away: u64,
    /// The most by which narrowing changes a kept voxel's value.
    pub rounding: f64,
}

/// Selects the voxels of `arena` to keep. `stored` is the transfer function that the arena was built with, if known.
///
/// Reads the lane along x once to count, three times if values are narrowed and rounded.
///
/// # Errors
/// [`Error::Input`] if the crop lies outside the grid, if the transfer function needs magnitudes that are missing or
/// dropped, if narrowing would leave labels without a code of their own, or if no voxel remains.
pub fn trim<'a>(arena: &Arena<'a>, stored: Option<&TransferFunction>, options: &TrimOptions) -> Result<Trim<'a>> {
    let lane = arena.x_lane();
    let old = arena.facts();
    let transfer = options.transfer.clone().map(|new| filled_in(new, stored, &lane, old)).transpose()?;
    let in_force = transfer.as_ref().or(stored);
    if options.drop_magnitudes && in_force.is_some_and(TransferFunction::uses_gradient) {
        let why = "cannot be dropped: the opacity of the transfer function depends on them; give another function too";
        return Err(Error::input("gradient magnitudes", why));
    }
    let codes_of = |transfer| VisibleCodes::new(transfer, old.channels, &old.scales, 0.0);
    let visible = transfer.as_ref().map(codes_of).transpose()?;
    let stays = move |record: Record| visible.as_ref().is_none_or(|codes| codes.has(record.value, record.magnitude));
    let keep = move |record: Record| stays(record).then_some(record);
    let crop = crop_of(options, &old.grid)?;

    let left = LaneRows::new(lane, |_, _, record| keep(record)).within(&crop);
    let (mut visible_voxels, mut lowest_code, mut highest_code) = (0, u16::MAX, 0);
    each_record(&left, |record| {
        visible_voxels += 1;
        lowest_code = record.value.min(lowest_code);
        highest_code = record.value.max(highest_code);
    })?;
    if visible_voxels == 0 {
        let why = format!("none of the {} visible voxels is to stay; keep more of them", old.visible_voxels);
        return Err(Error::input("nothing is left", why));
    }
    let normal_bits = match old.channels.normal_bits {
        _ if options.drop_normals => 0,
        16 if options.narrow_normals => 8,
        bits => bits,
    };
    let channels = Channels {
        value_bits: if options.narrow_values { 8 } else { old.channels.value_bits },
        normal_bits,
        magnitude_bits: if options.drop_magnitudes { 0 } else { old.channels.magnitude_bits },
        coverage_bits: old.channels.coverage_bits,
        coherence: old.channels.coherence && normal_bits > 0,
    };
    let mut scales = old.scales;
    if channels.magnitude_bits == 0 {
        scales.magnitude_scale = 0.0;
    }
    let mut narrowing = None;
    let (mut blurred_away, mut rounding) = (0, 0.0);
    if channels.value_bits < old.channels.value_bits {
        let quantiser = quantiser(&old.scales, lowest_code..=highest_code, in_force)?;
        scales.value_low = quantiser.low();
        scales.value_step = quantiser.step();
        if !quantiser.is_lossless() {
            each_record(&left, |record| {
                let value = old.scales.value(record.value.into());
                rounding = (value - quantiser.decode(quantiser.encode(value))).abs().max(rounding);
            })?;
            blurred_away = in_force.map_or(Ok(0), |transfer| blurred(&left, transfer, old, &quantiser))?;
        }
        narrowing = Some((quantiser, old.scales));
    }
    drop(left);
    let narrow_normals = channels.normal_bits < old.channels.normal_bits && channels.normal_bits > 0;
    let change = move |record: Record| {
        let record = keep(record)?;
        let value = narrowing.map_or(record.value, |(quantiser, old)| quantiser.encode(old.value(record.value.into())));
        Some(Record {
            value,
            normal: if narrow_normals { narrowed_normal(record.normal, channels.coherence) } else { record.normal },
            ..record
        })
    };
    let rows = LaneRows::new(lane, move |_, _, record| change(record)).with_channels(channels);
    let (rows, grid) = if options.keep_grid {
        (rows.within(&crop), old.grid.clone())
    } else {
        (rows.cropped(&crop), crop.grid(&old.grid))
    };
    let facts = Facts { grid, channels, scales, visible_voxels, ..*old };
    Ok(Trim { rows: Box::new(rows), facts, transfer, blurred_away, rounding })
}

/// Completes a transfer function as a build does: sets its value range, voxel length and largest magnitude.
fn filled_in(
    transfer: TransferFunction,
    stored: Option<&TransferFunction>,
    lane: &Lane,
    facts: &Facts,
) -> Result<TransferFunction> {
    let Scales { value_low, magnitude_scale, .. } = facts.scales;
    let [lowest, highest] = stored
        .and_then(TransferFunction::value_range)
        .unwrap_or_else(|| [value_low, facts.scales.value(lane.largest_value_code().into())]);
    let transfer = transfer.with_voxel_length(facts.grid.mean_spacing())?.with_value_range(lowest, highest)?;
    if magnitude_scale > 0.0 { transfer.with_largest_magnitude(magnitude_scale) } else { Ok(transfer) }
}

/// Returns the box to keep, inside the grid.
fn crop_of(options: &TrimOptions, grid: &Grid) -> Result<Region> {
    let [nx, ny, nz] = grid.dims;
    let Some(mut crop) = options.crop.clone() else { return Ok(Region::of_grid(grid.dims)) };
    for (part, points) in [&mut crop.xs, &mut crop.ys, &mut crop.zs].into_iter().zip(grid.dims) {
        part.end = part.end.min(points);
    }
    if crop.sides().into_iter().any(Range::is_empty) {
        return Err(Error::input("crop", format!("has no point of the {nx} x {ny} x {nz} grid")));
    }
    Ok(crop)
}

fn each_record(rows: &dyn Rows, mut see: impl FnMut(Record)) -> Result<()> {
    rows.read(Region::of_grid(rows.dims()), &mut |_, _, voxels| voxels.iter().for_each(|voxel| see(voxel.record)))
}

/// Returns a quantiser that maps the remaining values to 8-bit codes. It treats the old codes as samples.
fn quantiser(old: &Scales, codes: RangeInclusive<u16>, transfer: Option<&TransferFunction>) -> Result<Quantiser> {
    // A single code has a step of 0, which samples cannot have.
    let step = if old.value_step > 0.0 { old.value_step } else { 1.0 };
    let value = |code: u16| f64::from(code) * step + old.value_low;
    let range = [*codes.start(), *codes.end()].map(value);
    let of_labels = transfer.is_some_and(TransferFunction::is_labels);
    let make = if of_labels { Quantiser::for_labels } else { Quantiser::new };
    make(range, 8, SampleType::U16, step, old.value_low)
}

fn blurred(rows: &dyn Rows, transfer: &TransferFunction, old: &Facts, quantiser: &Quantiser) -> Result<u64> {
    let scales = Scales { value_low: quantiser.low(), value_step: quantiser.step(), ..old.scales };
    let channels = Channels { value_bits: 8, ..old.channels };
    let before = VisibleCodes::new(transfer, old.channels, &old.scales, NOTICEABLE_OPACITY)?;
    let after = VisibleCodes::new(transfer, channels, &scales, 0.0)?;
    let mut count = 0;
    each_record(rows, |record| {
        let value = quantiser.encode(old.scales.value(record.value.into()));
        let is_seen = before.has(record.value, record.magnitude);
        count += u64::from(is_seen && !after.has(value, record.magnitude));
    })?;
    Ok(count)
}

/// Converts a normal code of 2x16 bits to 2x8 bits.
fn narrowed_normal(code: u32, has_coherence: bool) -> u32 {
    // A normal's code stands for the direction opposite to the gradient.
    let gradient = normal::decode16(code).map(|component| -f64::from(component));
    if has_coherence {
        return normal::encode_coherent(gradient, Coherence::of_code(code, 16), 8);
    }
    normal::encode8(gradient).into()
}
