//! The sweep: once through a volume, slice by slice, on several threads.
//!
//! In: a [`SlabSource`], what to do with some rows of a slice, and what to do with each result, in order. A batch of
//! slices is in memory with the slices that its gradients reach; workers take pieces of it while the next batch is
//! read. Memory: two batches and the reach, whatever the depth.

use std::collections::VecDeque;
use std::ops::Range;

use super::spill::GROUP_ROWS;
use crate::classify::smooth::Smoother;
use crate::classify::{Neighbourhood, TransferFunction};
use crate::error::{Error, Result};
use crate::parallel::in_order;
use crate::volume::{Header, Sample, Samples, SlabSource};
use crate::with_samples;

/// Samples of a piece of work, where a row does not have more.
const PIECE_SAMPLES: u32 = 1 << 16;

/// What gradients are taken of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Field {
    /// None are taken.
    None,
    /// The samples' values.
    Values,
    /// Whether a voxel is visible, smoothed: label maps.
    Visibility,
}

/// How much of a volume is in memory, and how many work on it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pace {
    /// Slices to work on at once.
    pub(super) batch: u32,
    /// Whether the next batch is read meanwhile, by a thread of its own.
    pub(super) read_ahead: bool,
    /// Threads that work.
    pub(super) threads: usize,
}

/// Some rows of a slice.
#[derive(Debug, Clone)]
pub(super) struct Piece {
    pub(super) z: u32,
    /// Whole groups of rows, but for the slice's last.
    pub(super) rows: Range<u32>,
}

/// Rows of a piece, for grids of `width` points along x.
pub(super) fn piece_rows(width: u32) -> u32 {
    (PIECE_SAMPLES / width).max(1).next_multiple_of(GROUP_ROWS)
}

/// The slices in memory.
pub(super) struct Resident<'a> {
    header: &'a Header,
    samples: VecDeque<Samples>,
    /// The slice of the first of `samples`.
    first: u32,
    fields: VecDeque<Vec<f32>>,
    /// The slice of the first of `fields`.
    first_field: u32,
}

impl Resident<'_> {
    /// Slice `z`.
    fn samples(&self, z: u32) -> &Samples {
        &self.samples[(z - self.first) as usize]
    }

    /// The samples of slice `z`.
    ///
    /// # Panics
    /// If they are of another type.
    pub(super) fn typed<T: Sample>(&self, z: u32) -> &[T] {
        T::slice_of(self.samples(z)).expect("all slices are of the header's type")
    }

    /// Slice `z` of samples among its neighbours.
    pub(super) fn values<T: Sample>(&self, z: u32) -> Neighbourhood<'_, T> {
        let slice = |z: Option<u32>| z.filter(|&z| z < self.header.grid.dims[2]).map(|z| self.typed(z));
        let [width, height, _] = self.header.grid.dims.map(|d| d as usize);
        let (below, above) = (slice(z.checked_sub(1)), slice(Some(z + 1)));
        Neighbourhood::new(below, self.typed(z), above, [width, height], self.header.grid.spacing)
            .scaled(self.header.slope, self.header.intercept)
    }

    /// Slice `z` of the smoothed visibility among its neighbours.
    pub(super) fn visibility(&self, z: u32) -> Neighbourhood<'_> {
        let field = |z: u32| &self.fields[(z - self.first_field) as usize][..];
        let slice = |z: Option<u32>| z.filter(|&z| z < self.header.grid.dims[2]).map(field);
        let [width, height, _] = self.header.grid.dims.map(|d| d as usize);
        let (below, above) = (slice(z.checked_sub(1)), slice(Some(z + 1)));
        Neighbourhood::new(below, field(z), above, [width, height], self.header.grid.spacing)
    }

    fn samples_end(&self) -> u32 {
        self.first + u32::try_from(self.samples.len()).expect("a grid has at most 65,535 slices")
    }

    fn fields_end(&self) -> u32 {
        self.first_field + u32::try_from(self.fields.len()).expect("a grid has at most 65,535 slices")
    }
}

/// Calls `work` on every piece of a volume, and `take` on the results by ascending z and row.
///
/// `source` must be at its first slice. `transfer` says what is visible, for [`Field::Visibility`].
///
/// # Errors
/// What reading the source, `work` or `take` give; [`Error::Limit`] if there is no memory for a slice.
#[expect(clippy::too_many_arguments, reason = "a loop with all that varies in it")]
pub(super) fn sweep<S, T: Send>(
    source: &mut dyn SlabSource,
    header: &Header,
    field: Field,
    transfer: &TransferFunction,
    pace: Pace,
    scratch: impl Fn() -> S + Sync,
    work: impl Fn(&mut S, &Resident, &Piece) -> Result<T> + Sync,
    mut take: impl FnMut(&Piece, T) -> Result<()>,
) -> Result<()> {
    let [width, height, depth] = header.grid.dims;
    let mut intake = Intake::new(source, header, field, transfer);
    let mut resident = Resident { header, samples: VecDeque::new(), first: 0, fields: VecDeque::new(), first_field: 0 };
    let reach = u32::from(field != Field::None);
    let step = piece_rows(width);
    // Small slices go several at once: handing work over costs some microseconds.
    let together = (PIECE_SAMPLES / (width * step.min(height))).max(1);
    let mut from = 0;
    while from < depth {
        let end_of = |from: u32| (from + pace.batch).min(depth);
        let to = end_of(from);
        let arrived = intake.read(&resident, to, (to + reach).min(depth))?;
        arrived.join(&mut resident);
        let pieces: Vec<Piece> = (from..to)
            .flat_map(|z| (0..height).step_by(step as usize).map(move |y| (z, y)))
            .map(|(z, y)| Piece { z, rows: y..(y + step).min(height) })
            .collect();
        let result = std::thread::scope(|scope| {
            let next = (pace.read_ahead && to < depth).then(|| {
                let (intake, resident, end) = (&mut intake, &resident, end_of(to));
                scope.spawn(move || intake.read(resident, end, (end + reach).min(depth)))
            });
            let groups: Vec<&[Piece]> = pieces.chunks(together as usize).collect();
            let worked = in_order(
                groups.len(),
                pace.threads,
                &scratch,
                |scratch, index| groups[index].iter().map(|piece| work(scratch, &resident, piece)).collect(),
                |index, results: Vec<T>| groups[index].iter().zip(results).try_for_each(|(piece, r)| take(piece, r)),
            );
            let next = next.map(|reader| reader.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)));
            worked.and(next.transpose())
        });
        if let Some(arrived) = result? {
            arrived.join(&mut resident);
        }
        intake.recycle(&mut resident, to, reach);
        from = to;
    }
    Ok(())
}

/// Slices that were read and are not among the resident ones yet.
#[derive(Default)]
struct Arrived {
    samples: Vec<Samples>,
    fields: Vec<Vec<f32>>,
}

impl Arrived {
    fn join(self, resident: &mut Resident) {
        resident.samples.extend(self.samples);
        resident.fields.extend(self.fields);
    }
}

/// What reads slices and prepares their fields.
struct Intake<'a> {
    source: &'a mut dyn SlabSource,
    header: &'a Header,
    field: Field,
    transfer: &'a TransferFunction,
    smoother: Option<Smoother>,
    spare_samples: Vec<Samples>,
    spare_fields: Vec<Vec<f32>>,
}

impl<'a> Intake<'a> {
    fn new(
        source: &'a mut dyn SlabSource,
        header: &'a Header,
        field: Field,
        transfer: &'a TransferFunction,
    ) -> Intake<'a> {
        let smoother = None;
        Intake { source, header, field, transfer, smoother, spare_samples: Vec::new(), spare_fields: Vec::new() }
    }

    /// Reads until slices before `end` are there, and before `reach` those that gradients are taken of.
    fn read(&mut self, resident: &Resident, end: u32, reach: u32) -> Result<Arrived> {
        let mut arrived = Arrived::default();
        let depth = self.header.grid.dims[2];
        let (mut read, mut fields) = (resident.samples_end(), resident.fields_end());
        let (samples_end, fields_end) = match self.field {
            Field::None | Field::Values => (reach, 0),
            Field::Visibility => (end, reach),
        };
        while read < samples_end || fields < fields_end {
            if read < depth {
                let samples = self.next_slice()?;
                read += 1;
                if self.field == Field::Visibility {
                    fields += self.smooth(&samples, &mut arrived.fields)?;
                }
                arrived.samples.push(samples);
            } else {
                let mut smoothed = self.new_field()?;
                let given = self.smoother.as_mut().is_some_and(|smoother| smoother.finish(&mut smoothed));
                assert!(given, "a smoother gives as many slices as it takes");
                arrived.fields.push(smoothed);
                fields += 1;
            }
        }
        Ok(arrived)
    }

    fn next_slice(&mut self) -> Result<Samples> {
        let mut samples = self.spare_samples.pop().map_or_else(|| self.header.new_slice(), Ok)?;
        self.source.read_slice(&mut samples)?;
        Ok(samples)
    }

    /// Smooths the visibility of a slice; says how many slices came out.
    fn smooth(&mut self, samples: &Samples, fields: &mut Vec<Vec<f32>>) -> Result<u32> {
        let mut indicator = self.new_field()?;
        let mut smoothed = self.new_field()?;
        let (slope, intercept) = (self.header.slope, self.header.intercept);
        let visible = |raw: f64| self.transfer.opacity(raw * slope + intercept, 0.0) > 0.0;
        with_samples!(samples, samples => fill_visibility(samples, &mut indicator, visible));
        let [width, height, _] = self.header.grid.dims.map(|d| d as usize);
        let smoother = self.smoother.get_or_insert_with(|| Smoother::new([width, height]));
        let given = smoother.push(&indicator, &mut smoothed);
        self.spare_fields.push(indicator);
        if given {
            fields.push(smoothed)
        } else {
            self.spare_fields.push(smoothed)
        }
        Ok(given.into())
    }

    fn new_field(&mut self) -> Result<Vec<f32>> {
        if let Some(spare) = self.spare_fields.pop() {
            return Ok(spare);
        }
        let len = usize::try_from(self.header.grid.slice_len()).unwrap_or(usize::MAX);
        let mut field = Vec::new();
        let refused = |_| Error::out_of_memory("a slice for gradients", 4 * len as u64);
        field.try_reserve_exact(len).map_err(refused)?;
        field.resize(len, 0.0);
        Ok(field)
    }

    /// Takes back what the slices from `next` on do not need.
    fn recycle(&mut self, resident: &mut Resident, next: u32, reach: u32) {
        let below = next.saturating_sub(reach);
        let samples_below = if self.field == Field::Values { below } else { next };
        while resident.first < samples_below {
            self.spare_samples.extend(resident.samples.pop_front());
            resident.first += 1;
        }
        while self.field == Field::Visibility && resident.first_field < below {
            self.spare_fields.extend(resident.fields.pop_front());
            resident.first_field += 1;
        }
    }
}

fn fill_visibility<T: Sample>(samples: &[T], field: &mut [f32], visible: impl Fn(f64) -> bool) {
    // Labels come in runs: look each run's first one up.
    let mut last = None;
    for (f, &sample) in field.iter_mut().zip(samples) {
        if last.is_none_or(|(label, _)| label != sample) {
            last = Some((sample, if visible(sample.to_f64()) { 1.0 } else { 0.0 }));
        }
        *f = last.map_or(0.0, |(_, indicator)| indicator);
    }
}
