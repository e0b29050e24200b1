//! Smoothed slices of an indicator, so that segmentations shade smoothly.
//!
//! In: slices, 1 where a label map's voxel is visible and 0 elsewhere, one at a time. Out: the same slices, each two
//! later, filtered by the binomial [1 4 6 4 1]/16 along x, y and z; edges repeat. Its gradient is what shades a
//! surface of labels. Memory: six slices.
//!
//! The filter is applied along x and y to a slice as it comes, and along z over a ring of five.

/// Taps of the binomial filter, to be divided by 16.
const TAPS: [f32; 5] = [1.0 / 16.0, 4.0 / 16.0, 6.0 / 16.0, 4.0 / 16.0, 1.0 / 16.0];

/// A filter that slices pass through.
#[derive(Debug, Clone)]
pub struct Smoother {
    dims: [usize; 2],
    ring: [Vec<f32>; 5],
    scratch: Vec<f32>,
    /// Slices taken and given so far.
    taken: usize,
    given: usize,
}

impl Smoother {
    /// A filter for slices of `dims` samples along x and y.
    ///
    /// # Panics
    /// If a dimension is 0.
    pub fn new(dims: [usize; 2]) -> Smoother {
        assert!(dims[0] > 0 && dims[1] > 0, "a slice has at least one sample");
        let len = dims[0] * dims[1];
        Smoother { dims, ring: std::array::from_fn(|_| vec![0.0; len]), scratch: vec![0.0; len], taken: 0, given: 0 }
    }

    /// Takes the next slice; fills `smoothed` with the slice two before it and says true, if there is one.
    ///
    /// # Panics
    /// If a length is not the product of the dimensions.
    pub fn push(&mut self, indicator: &[f32], smoothed: &mut [f32]) -> bool {
        let slot = &mut self.ring[self.taken % 5];
        slot.copy_from_slice(indicator);
        smooth_slice(slot, &mut self.scratch, self.dims);
        self.taken += 1;
        self.taken >= 3 && self.give(smoothed)
    }

    /// Fills `smoothed` with the next slice that is still due and says true; call it until it says false, after
    /// the last slice went in. The smoother may then be used for another volume.
    ///
    /// # Panics
    /// If the length is not the product of the dimensions.
    pub fn finish(&mut self, smoothed: &mut [f32]) -> bool {
        if self.given == self.taken {
            (self.given, self.taken) = (0, 0);
            return false;
        }
        self.give(smoothed)
    }

    fn give(&mut self, smoothed: &mut [f32]) -> bool {
        let last = self.taken - 1;
        let taps: [&[f32]; 5] =
            std::array::from_fn(|tap| &self.ring[(self.given + tap).saturating_sub(2).min(last) % 5][..]);
        combine(taps, smoothed);
        self.given += 1;
        true
    }
}

/// Filters one slice along x and y, in place; `scratch` has the slice's length.
fn smooth_slice(slice: &mut [f32], scratch: &mut [f32], [width, height]: [usize; 2]) {
    for (row, out) in slice.chunks_exact(width).zip(scratch.chunks_exact_mut(width)) {
        smooth_row(row, out);
    }
    for (y, out) in slice.chunks_exact_mut(width).enumerate() {
        let rows: [&[f32]; 5] = std::array::from_fn(|tap| {
            let row = (y + tap).saturating_sub(2).min(height - 1);
            &scratch[row * width..][..width]
        });
        combine(rows, out);
    }
}

fn smooth_row(row: &[f32], out: &mut [f32]) {
    let width = row.len();
    let clamped =
        |x: usize| -> f32 { (0..5).map(|tap| TAPS[tap] * row[(x + tap).saturating_sub(2).min(width - 1)]).sum() };
    for x in (0..width.min(2)).chain(width.saturating_sub(2).max(2)..width) {
        out[x] = clamped(x);
    }
    for (window, out) in row.windows(5).zip(out.iter_mut().skip(2)) {
        *out = (window[0] + window[4]) * TAPS[0] + (window[1] + window[3]) * TAPS[1] + window[2] * TAPS[2];
    }
}

fn combine(taps: [&[f32]; 5], out: &mut [f32]) {
    let taps = taps.map(|tap| &tap[..out.len()]);
    for (at, out) in out.iter_mut().enumerate() {
        *out = (taps[0][at] + taps[4][at]) * TAPS[0] + (taps[1][at] + taps[3][at]) * TAPS[1] + taps[2][at] * TAPS[2];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn volume(dims: [usize; 3], sample: impl Fn([usize; 3]) -> f32) -> Vec<Vec<f32>> {
        let mut smoother = Smoother::new([dims[0], dims[1]]);
        let mut slice = vec![0.0; dims[0] * dims[1]];
        let mut out = slice.clone();
        let mut smoothed = Vec::new();
        for z in 0..dims[2] {
            for (at, value) in slice.iter_mut().enumerate() {
                *value = sample([at % dims[0], at / dims[0], z]);
            }
            if smoother.push(&slice, &mut out) {
                smoothed.push(out.clone());
            }
            assert_eq!(smoothed.len(), (z + 1).saturating_sub(2), "two later");
        }
        while smoother.finish(&mut out) {
            smoothed.push(out.clone());
        }
        smoothed
    }

    #[test]
    fn one_bright_voxel_spreads_by_the_binomial() {
        let smoothed = volume([9, 9, 9], |at| f32::from(at == [4, 4, 4]));
        let weight = |at: usize| TAPS.get((at + 2).wrapping_sub(4)).copied().unwrap_or(0.0);
        for (z, slice) in smoothed.iter().enumerate() {
            for (at, value) in slice.iter().enumerate() {
                assert_eq!(*value, weight(at % 9) * weight(at / 9) * weight(z));
            }
        }
    }

    #[test]
    fn a_constant_stays_at_every_size() {
        for dims in [[1, 1, 1], [1, 7, 2], [2, 3, 1], [3, 1, 3], [4, 4, 4], [5, 2, 6], [6, 5, 5]] {
            let smoothed = volume(dims, |_| 1.0);
            assert_eq!(smoothed.len(), dims[2]);
            assert!(smoothed.iter().flatten().all(|value| *value == 1.0), "{dims:?}");
        }
    }

    #[test]
    fn edges_repeat_along_every_axis() {
        for axis in 0..3 {
            let smoothed = volume([6, 6, 6], |at| f32::from(at[axis] == 0));
            let at = |place: usize| [smoothed[0][place], smoothed[0][6 * place], smoothed[place][0]][axis];
            assert_eq!([at(0), at(1), at(2), at(3)], [11.0 / 16.0, 5.0 / 16.0, 1.0 / 16.0, 0.0]);
        }
    }
}
