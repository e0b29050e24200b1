//! Smoothing of label maps, so that the surfaces of segmentations shade smoothly.
//!
//! In: slices that are 1 where a voxel is visible and 0 elsewhere. Out: the slices filtered by the binomial kernel
//! [1 4 6 4 1]/16 along x, y and z. Each result comes two slices later. Beyond an edge, the sample on the edge repeats.
//! The gradient of the result lights a surface. Memory: six slices.

const TAPS: [f32; 5] = [1.0 / 16.0, 4.0 / 16.0, 6.0 / 16.0, 4.0 / 16.0, 1.0 / 16.0];

/// Smooths a volume slice by slice with a 5 x 5 x 5 binomial filter.
#[derive(Debug, Clone)]
pub struct Smoother {
    dims: [usize; 2],
    ring: [Vec<f32>; 5],
    scratch: Vec<f32>,
    /// Number of slices received (`taken`) and returned (`given`) so far.
    taken: usize,
    given: usize,
}

impl Smoother {
    /// Creates a filter for slices of `dims` samples along x and y.
    ///
    /// # Panics
    /// If a dimension is 0.
    pub fn new(dims: [usize; 2]) -> Smoother {
        assert!(dims[0] > 0 && dims[1] > 0, "a slice has at least one sample");
        let len = dims[0] * dims[1];
        Smoother { dims, ring: std::array::from_fn(|_| vec![0.0; len]), scratch: vec![0.0; len], taken: 0, given: 0 }
    }

    /// Adds a slice. From the third on, writes the filtered slice two before it to `smoothed` and returns true.
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

    /// Writes the next filtered slice to `smoothed` and returns true; returns false when all have been returned.
    ///
    /// Call it after the last slice was added. The filter can then be used for another volume.
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

/// Filters one slice along x and y in place; `scratch` has the slice's length.
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
