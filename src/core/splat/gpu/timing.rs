//! Times by the device's own clock, where it has one.
//!
//! In: a name for each pass. Out: milliseconds by name, once a frame is done.

use wgpu::{
    Buffer, BufferDescriptor, BufferUsages, CommandEncoder, ComputePassTimestampWrites, Features, QuerySet,
    QuerySetDescriptor, QueryType, RenderPassTimestampWrites,
};

use super::context::Context;
use crate::error::Result;

/// Times of a window: two a pass. Passes beyond them are not timed: those of its chunks after the 512th.
const QUERIES: u32 = 4_096;
const QUERY_BYTES: u64 = 8;

/// The passes that are timed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Pass {
    Walk,
    Project,
    Bin,
    Composite,
}

/// Milliseconds by pass.
pub(crate) type Times = [f64; 4];

/// The device's stop watch.
#[derive(Debug)]
pub(crate) struct Timer {
    set: QuerySet,
    resolved: Buffer,
    read: Buffer,
    /// What was timed since the last reading.
    passes: Vec<Pass>,
}

impl Timer {
    /// `None` where the device has no clock.
    ///
    /// # Errors
    /// If there is no memory for it.
    pub(crate) fn new(context: &Context) -> Result<Option<Timer>> {
        if !context.device.features().contains(Features::TIMESTAMP_QUERY) {
            return Ok(None);
        }
        let descriptor = QuerySetDescriptor { label: Some("times"), ty: QueryType::Timestamp, count: QUERIES };
        let size = u64::from(QUERIES) * QUERY_BYTES;
        let buffer = |label, usage| {
            context.device.create_buffer(&BufferDescriptor {
                label: Some(label),
                size,
                usage,
                mapped_at_creation: false,
            })
        };
        Ok(Some(Timer {
            set: context.device.create_query_set(&descriptor),
            resolved: buffer("times", BufferUsages::QUERY_RESOLVE | BufferUsages::COPY_SRC),
            read: buffer("times read back", BufferUsages::MAP_READ | BufferUsages::COPY_DST),
            passes: Vec::new(),
        }))
    }

    /// Forgets what was timed.
    pub(crate) fn clear(&mut self) {
        self.passes.clear();
    }

    fn next(&mut self, pass: Pass) -> Option<[u32; 2]> {
        let begin = 2 * u32::try_from(self.passes.len()).unwrap_or(QUERIES);
        (begin < QUERIES).then(|| {
            self.passes.push(pass);
            [begin, begin + 1]
        })
    }

    /// What to time a compute pass with.
    pub(crate) fn compute(&mut self, pass: Pass) -> Option<ComputePassTimestampWrites<'_>> {
        let [begin, end] = self.next(pass)?;
        Some(ComputePassTimestampWrites {
            query_set: &self.set,
            beginning_of_pass_write_index: Some(begin),
            end_of_pass_write_index: Some(end),
        })
    }

    /// What to time a render pass with.
    pub(crate) fn render(&mut self, pass: Pass) -> Option<RenderPassTimestampWrites<'_>> {
        let [begin, end] = self.next(pass)?;
        Some(RenderPassTimestampWrites {
            query_set: &self.set,
            beginning_of_pass_write_index: Some(begin),
            end_of_pass_write_index: Some(end),
        })
    }

    /// Asks for the times, in the last work of a frame.
    pub(crate) fn resolve(&self, encoder: &mut CommandEncoder) {
        let count = 2 * u32::try_from(self.passes.len()).unwrap_or(0);
        if count > 0 {
            encoder.resolve_query_set(&self.set, 0..count, &self.resolved, 0);
            encoder.copy_buffer_to_buffer(&self.resolved, 0, &self.read, 0, Some(u64::from(count) * QUERY_BYTES));
        }
    }

    /// The times since the last reading.
    ///
    /// # Errors
    /// If the device fails.
    pub(crate) fn read(&mut self, context: &Context) -> Result<Times> {
        let mut times = [0.0; 4];
        let passes = std::mem::take(&mut self.passes);
        if passes.is_empty() {
            return Ok(times);
        }
        let period = f64::from(context.queue.get_timestamp_period());
        context.read(&self.read, 2 * passes.len() as u64 * QUERY_BYTES, |bytes| {
            let ticks = |at: usize| bytes[8 * at..].first_chunk().map_or(0, |bytes| u64::from_le_bytes(*bytes));
            for (index, pass) in passes.into_iter().enumerate() {
                // A clock that was reset meanwhile tells nothing.
                let ticks = ticks(2 * index + 1).saturating_sub(ticks(2 * index));
                times[pass as usize] += ticks as f64 * period * 1e-6;
            }
        })?;
        Ok(times)
    }
}
