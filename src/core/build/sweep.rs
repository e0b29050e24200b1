//! The sweep: processes a volume once, slice by slice, on several threads.
//!
//! In: a [`SlabSource`], a function that processes a block of rows, and a consumer of its results. A batch of slices is
//! in memory, with the neighbouring slices that its gradients need; workers process it while the next batch is read.
//! Memory: two batches and the neighbouring slices, whatever the depth of the volume.

use std::ops::Range;

use super::options::GradientSource;
use super::spill::GROUP_ROWS;
use super::window::{SliceReader, SliceWindow};
use crate::classify::TransferFunction;
use crate::error::Result;
use crate::parallel::in_order;
use crate::volume::{Header, SlabSource};

/// Approximate number of samples in a block of rows; a block has at least one group of rows.
const BLOCK_SAMPLES: u32 = 1 << 16;

/// The number of slices that are in memory, and of threads that process them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct SweepSchedule {
    pub(super) batch: u32,
    /// Whether another thread reads the next batch while one is processed.
    pub(super) read_ahead: bool,
    pub(super) threads: usize,
}

/// Consecutive rows of one slice.
#[derive(Debug, Clone)]
pub(super) struct RowBlock {
    pub(super) z: u32,
    /// The block's range of y: complete groups of [`GROUP_ROWS`] rows, except at the end of the slice.
    pub(super) rows: Range<u32>,
}

/// Returns the number of rows in a block, for grids with `width` points along x.
pub(super) fn block_rows(width: u32) -> u32 {
    (BLOCK_SAMPLES / width).max(1).next_multiple_of(GROUP_ROWS)
}

/// Calls `work` for every block of rows of a volume, and `take` with each result, by ascending z, then y.
///
/// `source` must be at its first slice. `transfer` decides visibility, for [`GradientSource::Visibility`]. `scratch`
/// creates the buffer that each thread passes to `work`.
///
/// # Errors
/// Any error of reading the source, of `work` or of `take`; [`Error::Limit`](crate::Error::Limit) if there is no memory
/// for a slice.
#[expect(clippy::too_many_arguments, reason = "a loop with everything that varies")]
pub(super) fn sweep<S, T: Send>(
    source: &mut dyn SlabSource,
    header: &Header,
    gradients: GradientSource,
    transfer: &TransferFunction,
    schedule: SweepSchedule,
    scratch: impl Fn() -> S + Sync,
    work: impl Fn(&mut S, &SliceWindow, &RowBlock) -> Result<T> + Sync,
    mut take: impl FnMut(&RowBlock, T) -> Result<()>,
) -> Result<()> {
    let [width, height, depth] = header.grid.dims;
    let mut reader = SliceReader::new(source, header, gradients, transfer);
    let mut window = SliceWindow::new(header);
    let reach = u32::from(gradients != GradientSource::None);
    let step = block_rows(width);
    // Small slices are handed over together: each hand-over costs some microseconds.
    let together = (BLOCK_SAMPLES / (width * step.min(height))).max(1);
    let mut from = 0;
    while from < depth {
        let end_of = |from: u32| (from + schedule.batch).min(depth);
        let to = end_of(from);
        reader.read(to, (to + reach).min(depth))?.join(&mut window);
        let blocks: Vec<RowBlock> = (from..to)
            .flat_map(|z| (0..height).step_by(step as usize).map(move |y| (z, y)))
            .map(|(z, y)| RowBlock { z, rows: y..(y + step).min(height) })
            .collect();
        let result = std::thread::scope(|scope| {
            // Without a thread the slices are read when they are needed.
            let next = (schedule.read_ahead && to < depth).then(|| {
                let (reader, end) = (&mut reader, end_of(to));
                let read = move || reader.read(end, (end + reach).min(depth));
                std::thread::Builder::new().spawn_scoped(scope, read).ok()
            });
            let groups: Vec<&[RowBlock]> = blocks.chunks(together as usize).collect();
            let work = |scratch: &mut S, index: usize| -> Result<Vec<T>> {
                groups[index].iter().map(|block| work(scratch, &window, block)).collect()
            };
            let worked = in_order(groups.len(), schedule.threads, &scratch, work, |index, results| {
                groups[index].iter().zip(results).try_for_each(|(block, result)| take(block, result))
            });
            let next =
                next.flatten().map(|thread| thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)));
            worked.and(next.transpose())
        });
        if let Some(slices) = result? {
            slices.join(&mut window);
        }
        reader.recycle(&mut window, to, reach);
        from = to;
    }
    Ok(())
}
