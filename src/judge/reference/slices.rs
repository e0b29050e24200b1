//! Reads the slices of a volume, each with the neighbouring slices that its gradients need.
//!
//! In: a slab source (which reads slice by slice along z). Out: one slice after the other as values in double
//! precision, with gradients by central differences in world units. At borders and beside missing samples differences
//! are one-sided. In label maps the gradients are those of the smoothed visibility.

use std::collections::VecDeque;

use adjsplat::classify::{Smoother, TransferFunction};
use adjsplat::error::Result;
use adjsplat::volume::{Header, Sample as _, Samples, SlabSource};
use adjsplat::with_samples;

/// Selects the field whose gradients are computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum GradientField {
    Nothing,
    Values,
    SmoothedVisibility,
}

/// Calls `work` with each slice's index, its values, and the slices of the gradient field around it.
pub(super) fn for_each_slice(
    source: &mut dyn SlabSource,
    header: &Header,
    transfer: &TransferFunction,
    field: GradientField,
    mut work: impl FnMut(usize, &[f64], &Neighbours) -> Result<()>,
) -> Result<()> {
    let [width, height, depth] = header.grid.dims.map(|points| points as usize);
    let mut samples = header.new_slice()?;
    let mut smoother = Smoother::new([width, height]);
    // `values` starts at slice z; `fields` starts one slice earlier, at z - 1.
    let (mut values, mut fields) = (VecDeque::new(), VecDeque::new());
    let (mut values_end, mut fields_end) = (0, 0);
    for z in 0..depth {
        let needed = if field == GradientField::Nothing { 0 } else { (z + 2).min(depth) };
        while values_end <= z || fields_end < needed {
            if values_end < depth {
                source.read_slice(&mut samples)?;
                let slice = decoded(&samples, header);
                values_end += 1;
                let given = match field {
                    GradientField::Nothing => None,
                    GradientField::Values => Some(slice.clone()),
                    GradientField::SmoothedVisibility => {
                        let indicator: Vec<f32> =
                            slice.iter().map(|&value| f32::from(transfer.opacity(value, 0.0) > 0.0)).collect();
                        smoothed(|out| smoother.push(&indicator, out), slice.len())
                    }
                };
                fields_end += usize::from(given.is_some());
                fields.extend(given);
                values.push_back(slice);
            } else {
                fields.extend(smoothed(|out| smoother.finish(out), width * height));
                fields_end += 1;
            }
        }
        let here = values.pop_front().expect("slice z was read above");
        let first = fields_end - fields.len();
        let slice = |z: Option<usize>| -> Option<&[f64]> {
            z.and_then(|z| z.checked_sub(first)).and_then(|at| fields.get(at)).map(Vec::as_slice)
        };
        let neighbours = Neighbours {
            slices: [slice(z.checked_sub(1)), slice(Some(z)), slice(Some(z + 1))],
            dims: [width, height],
            spacing: header.grid.spacing,
        };
        work(z, &here, &neighbours)?;
        if z > 0 && !fields.is_empty() {
            fields.pop_front();
        }
    }
    Ok(())
}

fn decoded(samples: &Samples, header: &Header) -> Vec<f64> {
    let (slope, intercept) = (header.slope, header.intercept);
    with_samples!(samples, samples => samples.iter().map(|raw| raw.to_f64() * slope + intercept).collect())
}

/// Returns the smoothed slice that `fill` writes; `None` if it writes none. Sums of 4,096ths are exact in single
/// precision.
fn smoothed(fill: impl FnOnce(&mut [f32]) -> bool, len: usize) -> Option<Vec<f64>> {
    let mut slice = vec![0.0; len];
    fill(&mut slice).then(|| slice.into_iter().map(f64::from).collect())
}

/// A slice of the gradient field with the slices before and after it.
pub(super) struct Neighbours<'a> {
    slices: [Option<&'a [f64]>; 3],
    dims: [usize; 2],
    spacing: [f64; 3],
}

impl Neighbours<'_> {
    /// Returns the slopes at (`x`, `y`) along the grid's axes, per world length; 0 where no neighbouring sample is
    /// known.
    pub(super) fn slopes(&self, x: usize, y: usize) -> [f64; 3] {
        let [width, height] = self.dims;
        let at = |slice: Option<&[f64]>, x: Option<usize>, y: Option<usize>| match (slice, x, y) {
            (Some(slice), Some(x), Some(y)) if x < width && y < height => slice[y * width + x],
            _ => f64::NAN,
        };
        let [below, here, above] = self.slices;
        let sample = at(here, Some(x), Some(y));
        let pairs = [
            [at(here, x.checked_sub(1), Some(y)), at(here, Some(x + 1), Some(y))],
            [at(here, Some(x), y.checked_sub(1)), at(here, Some(x), Some(y + 1))],
            [at(below, Some(x), Some(y)), at(above, Some(x), Some(y))],
        ];
        std::array::from_fn(|a| {
            let [before, after] = pairs[a];
            let slopes = [(after - before) / 2.0, after - sample, sample - before];
            slopes.into_iter().find(|slope| slope.is_finite()).unwrap_or(0.0) / self.spacing[a]
        })
    }

    /// Returns the sum of the outward axes of the volume's faces that (`x`, `y`) is on; zero inside of the volume. On an
    /// axis of one point only the lower face counts.
    pub(super) fn out_of_volume(&self, x: usize, y: usize) -> [f64; 3] {
        let [width, height] = self.dims;
        let [below, _, above] = self.slices;
        let ends = [(x == 0, x + 1 == width), (y == 0, y + 1 == height), (below.is_none(), above.is_none())];
        ends.map(|(lower, upper)| if lower { -1.0 } else { f64::from(u8::from(upper)) })
    }
}
