//! Tables on the device with the look (colour and optical depth) of each code (the stored number of a value).
//!
//! In: the processor's table, and the codes that a lane shows. Out: colour and optical depth by value code. If the
//! depth depends on the gradient, also the depth by value code and magnitude code: with 16-bit values, a table of up to
//! 64 MiB. The processor's renderer has no such table; it computes the depth for each voxel.

use wgpu::Buffer;

use super::context::{Context, STORAGE};
use crate::arena::Lane;
use crate::classify::TransferFunction;
use crate::error::Result;
use crate::splat::composite::Table;
use crate::splat::{Mode, Scene, Settings};

/// The tables of a frame.
#[derive(Debug)]
pub(crate) struct DeviceLooks<'a> {
    pub(crate) table: Table<'a>, // The processor's table.
    pub(crate) mean_voxel: f64,  // The mean spacing that its depths are for.
    pub(crate) on_device: LookBuffers,
}

/// The tables on the device, and what they were made for.
#[derive(Debug)]
pub(crate) struct LookBuffers {
    pub(crate) mode: Mode,
    pub(crate) exposure: Option<f32>,
    transfer: TransferFunction,
    level: usize,                // The level of detail whose voxels they were made for.
    pub(crate) by_value: Buffer, // By value code: colour and optical depth.
    pub(crate) by_pair: Buffer,  // By value code and magnitude code: optical depth.
    pub(crate) uses_magnitude: bool,
}

impl LookBuffers {
    /// Returns whether the tables hold for a frame of this level, transfer function and settings.
    pub(crate) fn hold_for(&self, level: usize, transfer: &TransferFunction, settings: &Settings) -> bool {
        let made_for = (self.level, self.mode, self.exposure);
        made_for == (level, settings.mode, settings.exposure) && self.transfer == *transfer
    }
}

impl<'a> DeviceLooks<'a> {
    /// Returns the most bytes that the tables of `lane` take.
    pub(crate) fn max_bytes(lane: &Lane, uses_gradient: bool) -> u64 {
        let codes = 1u64 << lane.channels.value_bits;
        let pairs = if uses_gradient && lane.channels.magnitude_bits > 0 { 256 * codes } else { 0 };
        16 * codes + 4 * pairs
    }

    /// Computes the tables and copies them to the device, unless those that are there hold. `scene` is of the level `level`, as
    /// is `lane`, unless the mode is [`Mode::Composite`], where looks do not depend on the voxels; `mean_voxel` is the mean
    /// spacing of level 0.
    pub(crate) fn new(
        context: &Context,
        (level, scene): (usize, &Scene<'a>),
        lane: &Lane,
        mean_voxel: f64,
        settings: &Settings,
        there: Option<LookBuffers>,
    ) -> Result<Self> {
        let table = Table::new(scene, lane, settings, mean_voxel)?;
        if let Some(on_device) = there {
            return Ok(DeviceLooks { table, mean_voxel, on_device });
        }
        let last = lane.channels.last_value_code();
        let uses_magnitude = table.needs_magnitude()
            || lane.shown.is_some_and(|shown| shown.by_magnitude() && lane.channels.magnitude_bits > 0);
        let look = |value: u16, magnitude: u8| {
            let [red, green, blue, depth] = table.look(value, magnitude);
            let is_shown = lane.shown.is_none_or(|shown| shown.has(value, magnitude));
            [red, green, blue, if is_shown { depth } else { 0.0 }]
        };
        let values: Vec<[f32; 4]> = (0..=last).map(|value| look(value, 0)).collect();
        let mut pairs: Vec<f32> = Vec::new();
        if uses_magnitude {
            pairs.extend((0..=last).flat_map(|value| (0..=u8::MAX).map(move |code| look(value, code)[3])));
        }
        let store = |label: &str, bytes: &[u8]| -> Result<Buffer> {
            let buffer = context.buffer(label, bytes.len() as u64, STORAGE)?;
            context.fill(&buffer, bytes)?;
            Ok(buffer)
        };
        let by_value = store("looks", bytemuck::cast_slice(&values))?;
        let by_pair = store("depths", bytemuck::cast_slice(&pairs))?;
        let Settings { mode, exposure, .. } = *settings;
        let transfer = scene.transfer.clone();
        let on_device = LookBuffers { mode, exposure, transfer, level, by_value, by_pair, uses_magnitude };
        Ok(DeviceLooks { table, mean_voxel, on_device })
    }

    /// Returns the factor from the tables' depths to those of a level whose mean spacing is `mean_voxel`.
    #[expect(clippy::cast_possible_truncation, reason = "single precision is the renderer's")]
    pub(crate) fn depth_factor(&self, mean_voxel: f64) -> f32 {
        // Without an exposure of the settings, that of the table makes up for any factor.
        let is_levelled = (self.on_device.mode, self.on_device.exposure) == (Mode::Additive, None);
        if is_levelled { 1.0 } else { (mean_voxel / self.mean_voxel) as f32 }
    }

    pub(crate) fn bytes(&self) -> u64 {
        self.on_device.by_value.size() + self.on_device.by_pair.size()
    }
}
