//! The window: a slice of a volume and its neighbours, moving up.
//!
//! In: a [`SlabSource`]. Out: slices of samples, each with the field that gradients are taken of and that field's
//! slices below and above. Memory: two or three slices of samples and up to five of the field, whatever the depth.

use std::collections::VecDeque;

use crate::classify::smooth::Smoother;
use crate::classify::{Neighbourhood, TransferFunction};
use crate::error::{Error, Result};
use crate::volume::{Header, Sample, Samples, SlabSource};
use crate::with_samples;

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

/// A slice and its neighbours, moving up the volume.
pub(super) struct Window<'a> {
    source: &'a mut dyn SlabSource,
    header: &'a Header,
    field: Field,
    transfer: Option<&'a TransferFunction>,
    smoother: Option<Smoother>,
    /// Slices read so far, and the index of the current one.
    read: u32,
    current: Option<u32>,
    /// Samples from the current slice on.
    samples: VecDeque<Samples>,
    /// Fields from the slice before the current one on; `first_field` is the first one's slice.
    fields: VecDeque<Vec<f32>>,
    first_field: u32,
    spare_samples: Vec<Samples>,
    spare_fields: Vec<Vec<f32>>,
    slice_len: usize,
}

impl<'a> Window<'a> {
    pub(super) fn new(
        source: &'a mut dyn SlabSource,
        header: &'a Header,
        field: Field,
        transfer: Option<&'a TransferFunction>,
    ) -> Result<Window<'a>> {
        // The first slice shows whether there is memory for one at all.
        let spare_samples = vec![header.new_slice()?];
        let slice_len = spare_samples[0].len();
        let [width, height, _] = header.grid.dims.map(|d| d as usize);
        Ok(Window {
            source,
            header,
            field,
            transfer,
            smoother: (field == Field::Visibility).then(|| Smoother::new([width, height])),
            read: 0,
            current: None,
            samples: VecDeque::new(),
            fields: VecDeque::new(),
            first_field: 0,
            spare_samples,
            spare_fields: Vec::new(),
            slice_len,
        })
    }

    /// Moves to the next slice.
    pub(super) fn advance(&mut self) -> Result<()> {
        let next = self.current.map_or(0, |z| z + 1);
        if self.current.is_some() {
            self.spare_samples.extend(self.samples.pop_front());
        }
        if next >= 2 && self.field != Field::None {
            self.spare_fields.extend(self.fields.pop_front());
            self.first_field += 1;
        }
        self.current = Some(next);
        let depth = self.header.grid.dims[2];
        let fields_end = |this: &Self| this.first_field + u32::try_from(this.fields.len()).unwrap_or(u32::MAX);
        while self.samples.is_empty() || (self.field != Field::None && fields_end(self) < (next + 2).min(depth)) {
            if self.read < depth {
                self.read_slice()?;
            } else {
                self.drain_smoother()?;
            }
        }
        Ok(())
    }

    fn read_slice(&mut self) -> Result<()> {
        let mut samples = match self.spare_samples.pop() {
            Some(samples) => samples,
            None => self.header.new_slice()?,
        };
        self.source.read_slice(&mut samples)?;
        self.read += 1;
        if self.field != Field::None {
            let mut field = self.field()?;
            let (slope, intercept) = (self.header.slope, self.header.intercept);
            match (self.field, self.transfer) {
                (Field::Visibility, Some(transfer)) => {
                    let visible = |raw: f64| transfer.opacity(raw * slope + intercept, 0.0) > 0.0;
                    with_samples!(&samples, samples => fill_visibility(samples, &mut field, visible));
                }
                _ => with_samples!(&samples, samples => fill_values(samples, &mut field, slope, intercept)),
            }
            let spare = self.spare_fields.pop();
            match &mut self.smoother {
                Some(smoother) => {
                    let mut smoothed = spare.map_or_else(|| new_field(self.slice_len), Ok)?;
                    if smoother.push(&field, &mut smoothed) {
                        self.fields.push_back(smoothed);
                    } else {
                        self.spare_fields.push(smoothed);
                    }
                    self.spare_fields.push(field);
                }
                None => {
                    self.spare_fields.extend(spare);
                    self.fields.push_back(field);
                }
            }
        }
        self.samples.push_back(samples);
        Ok(())
    }

    /// A field to fill.
    fn field(&mut self) -> Result<Vec<f32>> {
        self.spare_fields.pop().map_or_else(|| new_field(self.slice_len), Ok)
    }

    fn drain_smoother(&mut self) -> Result<()> {
        let mut smoothed = self.field()?;
        let given = self.smoother.as_mut().is_some_and(|smoother| smoother.finish(&mut smoothed));
        assert!(given, "a smoother gives as many slices as it takes");
        self.fields.push_back(smoothed);
        Ok(())
    }

    /// The current slice.
    pub(super) fn samples(&self) -> &Samples {
        self.samples.front().expect("advance was called")
    }

    /// The current slice's field among its neighbours'; `None` without a field.
    pub(super) fn neighbourhood(&self) -> Option<Neighbourhood<'_>> {
        let z = self.current?;
        let slice = |z: u32| self.fields.get(z.checked_sub(self.first_field)? as usize).map(Vec::as_slice);
        let [width, height, _] = self.header.grid.dims.map(|d| d as usize);
        let below = z.checked_sub(1).and_then(slice);
        Some(Neighbourhood::new(below, slice(z)?, slice(z + 1), [width, height], self.header.grid.spacing))
    }
}

fn new_field(len: usize) -> Result<Vec<f32>> {
    let mut field = Vec::new();
    let refused = |_| Error::Limit { what: "a slice for gradients".into(), need: 4 * len as u64, have: 0 };
    field.try_reserve_exact(len).map_err(refused)?;
    field.resize(len, 0.0);
    Ok(field)
}

fn fill_values<T: Sample>(samples: &[T], field: &mut [f32], slope: f64, intercept: f64) {
    if slope == 1.0 && intercept == 0.0 {
        field.iter_mut().zip(samples).for_each(|(f, s)| *f = s.to_f32());
    } else {
        #[allow(clippy::cast_possible_truncation, reason = "gradients are taken of single-precision fields")]
        field.iter_mut().zip(samples).for_each(|(f, s)| *f = (s.to_f64() * slope + intercept) as f32);
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
