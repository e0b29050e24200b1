//! The slices of a volume that are in memory, and the reader that provides the next slices.

use std::collections::VecDeque;

use super::options::GradientSource;
use crate::classify::{Neighbourhood, Smoother, TransferFunction};
use crate::error::{Error, Result};
use crate::volume::{Header, Sample, Samples, SlabSource};
use crate::with_samples;

/// The consecutive slices that are in memory: raw samples, and fields of smoothed visibility for gradients.
pub(super) struct SliceWindow<'a> {
    header: &'a Header,
    samples: VecDeque<Samples>,
    first: u32,
    fields: VecDeque<Vec<f32>>,
    first_field: u32,
}

impl<'a> SliceWindow<'a> {
    pub(super) fn new(header: &'a Header) -> SliceWindow<'a> {
        SliceWindow { header, samples: VecDeque::new(), first: 0, fields: VecDeque::new(), first_field: 0 }
    }

    /// Returns the samples of slice `z`.
    ///
    /// # Panics
    /// If the volume's samples are not of type `T`.
    pub(super) fn typed<T: Sample>(&self, z: u32) -> &[T] {
        T::slice_of(&self.samples[(z - self.first) as usize]).expect("all slices are of the header's type")
    }

    /// Returns slice `z` of the samples' values with the slices below and above, for gradients.
    pub(super) fn values<T: Sample>(&self, z: u32) -> Neighbourhood<'_, T> {
        self.neighbourhood(z, |z| self.typed(z)).scaled(self.header.slope, self.header.intercept)
    }

    /// Returns slice `z` of the smoothed visibility with the slices below and above, for gradients.
    pub(super) fn visibility(&self, z: u32) -> Neighbourhood<'_> {
        self.neighbourhood(z, |z| &self.fields[(z - self.first_field) as usize][..])
    }

    fn neighbourhood<'s, T: Sample>(&self, z: u32, slice: impl Fn(u32) -> &'s [T]) -> Neighbourhood<'s, T> {
        let [width, height, depth] = self.header.grid.dims;
        let (below, above) = (z.checked_sub(1).map(&slice), Some(z + 1).filter(|&z| z < depth).map(&slice));
        Neighbourhood::new(below, slice(z), above, [width as usize, height as usize], self.header.grid.spacing)
    }
}

/// Slices that were read but not yet added to the window.
#[derive(Default)]
pub(super) struct NewSlices {
    samples: Vec<Samples>,
    fields: Vec<Vec<f32>>,
}

impl NewSlices {
    pub(super) fn join(self, window: &mut SliceWindow) {
        window.samples.extend(self.samples);
        window.fields.extend(self.fields);
    }
}

/// Reads slices and computes the fields that gradients are taken from.
pub(super) struct SliceReader<'a> {
    source: &'a mut dyn SlabSource,
    header: &'a Header,
    gradients: GradientSource,
    transfer: &'a TransferFunction,
    smoother: Option<Smoother>,
    /// Number of slices that were read, and of fields that were computed.
    samples_end: u32,
    fields_end: u32,
    spare_samples: Vec<Samples>,
    spare_fields: Vec<Vec<f32>>,
}

impl<'a> SliceReader<'a> {
    pub(super) fn new(
        source: &'a mut dyn SlabSource,
        header: &'a Header,
        gradients: GradientSource,
        transfer: &'a TransferFunction,
    ) -> SliceReader<'a> {
        SliceReader {
            source,
            header,
            gradients,
            transfer,
            smoother: None,
            samples_end: 0,
            fields_end: 0,
            spare_samples: Vec::new(),
            spare_fields: Vec::new(),
        }
    }

    /// Reads the next slices: those with z below `end`, and those with z below `reach` that gradients need.
    pub(super) fn read(&mut self, end: u32, reach: u32) -> Result<NewSlices> {
        let mut slices = NewSlices::default();
        let depth = self.header.grid.dims[2];
        let (samples_end, fields_end) = match self.gradients {
            GradientSource::None | GradientSource::Values => (reach, 0),
            GradientSource::Visibility => (end, reach),
        };
        while self.samples_end < samples_end || self.fields_end < fields_end {
            if self.samples_end < depth {
                let mut samples = self.spare_samples.pop().map_or_else(|| self.header.new_slice(), Ok)?;
                self.source.read_slice(&mut samples)?;
                self.header.check_slice(&samples)?;
                self.samples_end += 1;
                if self.gradients == GradientSource::Visibility {
                    self.smooth(&samples, &mut slices.fields)?;
                }
                slices.samples.push(samples);
            } else {
                let mut smoothed = self.new_field()?;
                let given = self.smoother.as_mut().is_some_and(|smoother| smoother.finish(&mut smoothed));
                assert!(given, "a smoother gives as many slices as it takes");
                slices.fields.push(smoothed);
                self.fields_end += 1;
            }
        }
        Ok(slices)
    }

    /// Smooths the visibility of a slice; appends the smoothed slice to `fields` if one is complete.
    fn smooth(&mut self, samples: &Samples, fields: &mut Vec<Vec<f32>>) -> Result<()> {
        let mut indicator = self.new_field()?;
        let mut smoothed = self.new_field()?;
        let (slope, intercept) = (self.header.slope, self.header.intercept);
        let visible = |raw: f64| self.transfer.opacity(raw * slope + intercept, 0.0) > 0.0;
        with_samples!(samples, samples => fill_visibility(samples, &mut indicator, visible));
        let [width, height, _] = self.header.grid.dims.map(|d| d as usize);
        let smoother = self.smoother.get_or_insert_with(|| Smoother::new([width, height]));
        let given = smoother.push(&indicator, &mut smoothed);
        self.spare_fields.push(indicator);
        self.fields_end += u32::from(given);
        if given { fields } else { &mut self.spare_fields }.push(smoothed);
        Ok(())
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

    /// Takes back the memory of slices that are not needed any more when slice `next` is processed; `reach` is how many
    /// slices below it gradients need.
    pub(super) fn recycle(&mut self, window: &mut SliceWindow, next: u32, reach: u32) {
        let below = next.saturating_sub(reach);
        let samples_below = if self.gradients == GradientSource::Values { below } else { next };
        while window.first < samples_below {
            self.spare_samples.extend(window.samples.pop_front());
            window.first += 1;
        }
        while self.gradients == GradientSource::Visibility && window.first_field < below {
            self.spare_fields.extend(window.fields.pop_front());
            window.first_field += 1;
        }
    }
}

fn fill_visibility<T: Sample>(samples: &[T], field: &mut [f32], visible: impl Fn(f64) -> bool) {
    // Labels come in runs: evaluate the transfer function once per run.
    let mut last = None;
    for (f, &sample) in field.iter_mut().zip(samples) {
        if last.is_none_or(|(label, _)| label != sample) {
            last = Some((sample, if visible(sample.to_f64()) { 1.0 } else { 0.0 }));
        }
        *f = last.map_or(0.0, |(_, indicator)| indicator);
    }
}
