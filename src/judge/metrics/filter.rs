//! Separable filters of planes of numbers. Outside a plane, the value at its border is used.

/// A one-dimensional filter: an odd number of weights around a centre.
pub(super) struct FilterKernel(Vec<f64>);

impl FilterKernel {
    /// Creates a kernel whose weights are `weight(-radius)` to `weight(radius)`.
    pub(super) fn new(radius: usize, weight: impl Fn(f64) -> f64) -> FilterKernel {
        FilterKernel((0..=2 * radius).map(|at| weight(at as f64 - radius as f64)).collect())
    }

    /// Returns the sum of the weights for which `wanted` returns true.
    pub(super) fn sum(&self, wanted: impl Fn(f64) -> bool) -> f64 {
        self.0.iter().filter(|weight| wanted(**weight)).sum()
    }

    /// Returns the kernel with `change` applied to every weight.
    pub(super) fn map(self, change: impl Fn(f64) -> f64) -> FilterKernel {
        FilterKernel(self.0.into_iter().map(change).collect())
    }

    /// Returns a Gaussian whose weights sum to 1.
    pub(super) fn gaussian(radius: usize, sigma: f64) -> FilterKernel {
        let kernel = FilterKernel::new(radius, |x| (-0.5 * (x / sigma).powi(2)).exp());
        let sum = kernel.sum(|_| true);
        kernel.map(|weight| weight / sum)
    }
}

/// Filters `plane` with `across` along rows and with `down` along columns.
pub(super) fn filtered(plane: &[f64], columns: usize, across: &FilterKernel, down: &FilterKernel) -> Vec<f64> {
    let rows = plane.len() / columns;
    let mut filtered_rows = vec![0.0; plane.len()];
    let middle = across.0.len() / 2;
    for (row, out) in plane.chunks_exact(columns).zip(filtered_rows.chunks_exact_mut(columns)) {
        for (x, out) in out.iter_mut().enumerate() {
            let taps = across.0.iter().enumerate();
            *out = taps.map(|(tap, weight)| weight * row[(x + tap).saturating_sub(middle).min(columns - 1)]).sum();
        }
    }
    let mut result = vec![0.0; plane.len()];
    let middle = down.0.len() / 2;
    for (y, out) in result.chunks_exact_mut(columns).enumerate() {
        for (tap, weight) in down.0.iter().enumerate() {
            let from = (y + tap).saturating_sub(middle).min(rows - 1) * columns;
            out.iter_mut().zip(&filtered_rows[from..][..columns]).for_each(|(out, value)| *out += weight * value);
        }
    }
    result
}
