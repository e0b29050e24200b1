//! Looks on the device: what each code looks like, as tables.
//!
//! In: the host's table, the codes that a lane shows. Out: a colour and an optical depth by value code, and where the
//! depth depends on the gradient too, one by value code and magnitude code. The host computes that one voxel by voxel
//! for 16-bit values; here it is a table of up to 64 MiB.

use wgpu::{Buffer, BufferUsages};

use super::context::Context;
use crate::arena::Lane;
use crate::error::Result;
use crate::splat::composite::Table;
use crate::splat::setup::FrameSetup as Shot;
use crate::splat::{Mode, Scene, Settings};

/// The tables, the host's and what they depend on beside the scene.
#[derive(Debug)]
pub(crate) struct Looks<'a> {
    pub(crate) mode: Mode,
    pub(crate) exposure: Option<f32>,
    /// The host's.
    pub(crate) table: Table<'a>,
    pub(crate) by_value: Buffer,
    pub(crate) by_pair: Buffer,
    pub(crate) by_magnitude: bool,
}

impl<'a> Looks<'a> {
    /// Bytes that the tables of `lane` take at most.
    pub(crate) fn need(lane: &Lane, uses_gradient: bool) -> u64 {
        let codes = 1u64 << lane.channels.value_bits;
        let pairs = if uses_gradient && lane.channels.magnitude_bits > 0 { 256 * codes } else { 0 };
        16 * codes + 4 * pairs
    }

    /// # Errors
    /// If the device has no memory for the tables.
    pub(crate) fn new(context: &Context, scene: &Scene<'a>, shot: &Shot, settings: &Settings) -> Result<Looks<'a>> {
        let lane = &shot.lane;
        let table = Table::new(scene, lane, settings, shot.view.mean_voxel)?;
        let last = if lane.channels.value_bits == 8 { u16::from(u8::MAX) } else { u16::MAX };
        let by_magnitude = table.needs_magnitude()
            || lane.shown.is_some_and(|shown| shown.by_magnitude() && lane.channels.magnitude_bits > 0);
        let look = |value: u16, magnitude: u8| {
            let [red, green, blue, depth] = table.look(value, magnitude);
            let is_shown = lane.shown.is_none_or(|shown| shown.has(value, magnitude));
            [red, green, blue, if is_shown { depth } else { 0.0 }]
        };
        let values: Vec<[f32; 4]> = (0..=last).map(|value| look(value, 0)).collect();
        let pairs: Vec<f32> = match by_magnitude {
            false => Vec::new(),
            true => (0..=last)
                .flat_map(|value| (0..=u8::MAX).map(move |m| (value, m)))
                .map(|(v, m)| look(v, m)[3])
                .collect(),
        };
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
        let store = |label: &str, bytes: &[u8]| -> Result<Buffer> {
            let buffer = context.buffer(label, bytes.len() as u64, usage)?;
            for (piece, bytes) in (0u64..).zip(bytes.chunks(1 << 20)) {
                context.write(&buffer, piece << 20, bytes)?;
            }
            Ok(buffer)
        };
        let by_value = store("looks", bytemuck::cast_slice(&values))?;
        let by_pair = store("depths", bytemuck::cast_slice(&pairs))?;
        let Settings { mode, exposure, .. } = *settings;
        Ok(Looks { mode, exposure, table, by_value, by_pair, by_magnitude })
    }

    /// Bytes of the tables.
    pub(crate) fn bytes(&self) -> u64 {
        self.by_value.size() + self.by_pair.size()
    }
}
