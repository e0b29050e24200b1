//! Separable filters over planes of numbers. Beyond the border the border's value goes on.

/// Weights around a middle, an odd number of them.
pub(super) struct Kernel(Vec<f64>);

impl Kernel {
    /// Weights of the offsets from `-radius` to `radius`.
    pub(super) fn new(radius: usize, weight: impl Fn(f64) -> f64) -> Kernel {
        Kernel((0..=2 * radius).map(|at| weight(at as f64 - radius as f64)).collect())
    }

    /// The sum of its weights that `wanted` takes.
    pub(super) fn sum(&self, wanted: impl Fn(f64) -> bool) -> f64 {
        self.0.iter().filter(|weight| wanted(**weight)).sum()
    }

    /// The same with other weights.
    pub(super) fn map(self, change: impl Fn(f64) -> f64) -> Kernel {
        Kernel(self.0.into_iter().map(change).collect())
    }

    /// A Gaussian whose weights add up to 1.
    pub(super) fn gaussian(radius: usize, sigma: f64) -> Kernel {
        let kernel = Kernel::new(radius, |x| (-0.5 * (x / sigma).powi(2)).exp());
        let sum = kernel.sum(|_| true);
        kernel.map(|weight| weight / sum)
    }
}

/// `plane` of `columns` filtered by `across` along rows and by `down` along columns.
pub(super) fn filtered(plane: &[f64], columns: usize, across: &Kernel, down: &Kernel) -> Vec<f64> {
    let rows = plane.len() / columns;
    let mut along = vec![0.0; plane.len()];
    let middle = across.0.len() / 2;
    for (row, out) in plane.chunks_exact(columns).zip(along.chunks_exact_mut(columns)) {
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
            out.iter_mut().zip(&along[from..][..columns]).for_each(|(out, value)| *out += weight * value);
        }
    }
    result
}
