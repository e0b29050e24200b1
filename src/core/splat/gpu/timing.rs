//! Times the stages by the device's own clock, if it has one.
//!
//! In: the stage of each pass. Out: milliseconds per stage, once a window is done.

use wgpu::{
    Buffer, BufferUsages, CommandEncoder, ComputePassTimestampWrites, Features, QuerySet, QuerySetDescriptor,
    QueryType, RenderPassTimestampWrites,
};

use super::context::Context;
use crate::error::Result;

const QUERIES: u32 = 4_096; // Two for each pass of a window: passes of chunks after the 512th are not timed.
const QUERY_BYTES: u64 = 8;

/// The stages that are timed; `Composite` stands for tiles and for quads.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Pass {
    Walk,
    Project,
    Bin,
    Composite,
}

/// Timestamps of the passes since the last reading.
#[derive(Debug)]
pub(crate) struct Timer {
    set: QuerySet,
    resolved: Buffer,
    mappable: Buffer,
    pub(super) passes: Vec<Pass>,
}

impl Timer {
    /// Creates a timer; `None` where the device has no clock.
    pub(crate) fn new(context: &Context) -> Result<Option<Timer>> {
        if !context.device.features().contains(Features::TIMESTAMP_QUERY) {
            return Ok(None);
        }
        let descriptor = QuerySetDescriptor { label: Some("times"), ty: QueryType::Timestamp, count: QUERIES };
        let buffer = |label, usage| context.buffer(label, u64::from(QUERIES) * QUERY_BYTES, usage);
        Ok(Some(Timer {
            set: context.device.create_query_set(&descriptor),
            resolved: buffer("times", BufferUsages::QUERY_RESOLVE | BufferUsages::COPY_SRC)?,
            mappable: buffer("times read back", BufferUsages::MAP_READ | BufferUsages::COPY_DST)?,
            passes: Vec::new(),
        }))
    }

    /// Reserves where a compute pass writes its timestamps; `None` if no timestamps are left.
    pub(crate) fn compute(&mut self, pass: Pass) -> Option<ComputePassTimestampWrites<'_>> {
        let RenderPassTimestampWrites { query_set, beginning_of_pass_write_index, end_of_pass_write_index } =
            self.render(pass)?;
        Some(ComputePassTimestampWrites { query_set, beginning_of_pass_write_index, end_of_pass_write_index })
    }

    /// Reserves where a render pass writes its timestamps; `None` if no timestamps are left.
    pub(crate) fn render(&mut self, pass: Pass) -> Option<RenderPassTimestampWrites<'_>> {
        let begin = 2 * u32::try_from(self.passes.len()).unwrap_or(QUERIES);
        (begin < QUERIES).then(|| {
            self.passes.push(pass);
            RenderPassTimestampWrites {
                query_set: &self.set,
                beginning_of_pass_write_index: Some(begin),
                end_of_pass_write_index: Some(begin + 1),
            }
        })
    }

    /// Adds to a window's last commands a copy of the timestamps to the buffer that [`Timer::read`] reads.
    pub(crate) fn resolve(&self, encoder: &mut CommandEncoder) {
        let count = 2 * u32::try_from(self.passes.len()).unwrap_or(0);
        if count > 0 {
            encoder.resolve_query_set(&self.set, 0..count, &self.resolved, 0);
            encoder.copy_buffer_to_buffer(&self.resolved, 0, &self.mappable, 0, Some(u64::from(count) * QUERY_BYTES));
        }
    }

    /// Returns the milliseconds since the last reading, indexed by [`Pass`].
    pub(crate) async fn read(&mut self, context: &Context) -> Result<[f64; 4]> {
        let passes = std::mem::take(&mut self.passes);
        if passes.is_empty() {
            return Ok([0.0; 4]);
        }
        let bytes = 2 * passes.len() as u64 * QUERY_BYTES;
        let period = f64::from(context.queue.get_timestamp_period());
        let read = |bytes: &[u8]| {
            let mut times = [0.0; 4];
            let ticks = |at: usize| bytes[8 * at..].first_chunk().map_or(0, |bytes| u64::from_le_bytes(*bytes));
            for (index, pass) in passes.into_iter().enumerate() {
                // If the clock was reset during a pass, the pass counts as 0.
                let ticks = ticks(2 * index + 1).saturating_sub(ticks(2 * index));
                times[pass as usize] += ticks as f64 * period * 1e-6;
            }
            times
        };
        context.read(&self.mappable, bytes, read).await
    }
}
