//! Integrates emission and absorption along a ray.
//!
//! In: the Gaussians that a ray passes. Out: the pixel. The initial value problem is solved by the Runge-Kutta pair of
//! fourth and fifth order by Dormand and Prince. Steps are no longer than a standard deviation, and their local errors
//! add up to at most the tolerance.
//!
//! Source: Dormand and Prince, "A family of embedded Runge-Kutta formulae", J. Comp. Appl. Math. 6, 1980.

use super::ray::REACH;

/// The kernel of one voxel along a ray: a Gaussian of the parameter t.
#[derive(Debug, Clone, Copy)]
pub(super) struct RayGaussian {
    /// The parameter t of the kernel's maximum, in mean spacings along the ray.
    pub(super) centre: f64,
    /// The kernel's total optical depth along the ray.
    pub(super) amount: f64,
    /// The voxel's linear red, green and blue times its optical depth.
    pub(super) emission: [f64; 3],
}

/// The state that is integrated: optical depth, then red, green and blue.
type State = [f64; 4];

/// The weights of the stages of a Dormand-Prince step.
const STAGES: [&[f64]; 6] = [
    &[1.0 / 5.0],
    &[3.0 / 40.0, 9.0 / 40.0],
    &[44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0],
    &[19_372.0 / 6_561.0, -25_360.0 / 2_187.0, 64_448.0 / 6_561.0, -212.0 / 729.0],
    &[9_017.0 / 3_168.0, -355.0 / 33.0, 46_732.0 / 5_247.0, 49.0 / 176.0, -5_103.0 / 18_656.0],
    &[35.0 / 384.0, 0.0, 500.0 / 1_113.0, 125.0 / 192.0, -2_187.0 / 6_784.0, 11.0 / 84.0],
];
/// The position in a step at which each stage is evaluated, as a fraction of the step.
const STAGE_TIMES: [f64; 6] = [1.0 / 5.0, 3.0 / 10.0, 4.0 / 5.0, 8.0 / 9.0, 1.0, 1.0];
/// The weights of the fifth-order result minus those of the fourth-order one: they estimate the error of a step.
const DIFFERENCE: [f64; 7] =
    [71.0 / 57_600.0, 0.0, -71.0 / 16_695.0, 71.0 / 1_920.0, -17_253.0 / 339_200.0, 22.0 / 525.0, -1.0 / 40.0];

/// Returns the pixel of a ray through `gaussians` from t = `start` on. Their standard deviation is `width` mean voxels.
pub(super) fn integrate(gaussians: &[RayGaussian], width: f64, start: f64, tolerance: f64) -> [f64; 4] {
    let (Some(first), Some(last)) = (gaussians.first(), gaussians.last()) else { return [0.0; 4] };
    let reach = REACH * width;
    let (mut t, end) = (start.max(first.centre - reach), last.centre + reach);
    if t >= end {
        return [0.0; 4];
    }
    // If each step's error is in proportion to its length, the errors add up to the tolerance.
    let per_length = tolerance / (end - t);
    let field = RayField { gaussians, width, density: 1.0 / ((2.0 * std::f64::consts::PI).sqrt() * width) };
    let mut state: State = [0.0; 4];
    let mut slopes = [[0.0; 4]; 7];
    slopes[0] = field.slope(t, state);
    let mut step = width / 4.0;
    // Stops where the transmittance is below a tenth of the tolerance: what lies behind changes the pixel by no more
    // than that.
    while t < end && state[0] < -(tolerance * 0.1).ln() {
        step = step.min(end - t);
        let mut ahead = state;
        for (stage, weights) in STAGES.iter().enumerate() {
            ahead = state;
            for (weight, slope) in weights.iter().zip(&slopes) {
                (0..4).for_each(|c| ahead[c] += step * weight * slope[c]);
            }
            slopes[stage + 1] = field.slope(t + STAGE_TIMES[stage] * step, ahead);
        }
        let error_of = |c: usize| DIFFERENCE.iter().zip(&slopes).map(|(d, slope)| step * d * slope[c]).sum::<f64>();
        // An error of the optical depth counts by how much it changes the light from behind.
        let dimmed = (-state[0]).exp();
        let error = (0..4).map(|c| error_of(c).abs() * if c == 0 { dimmed } else { 1.0 }).fold(0.0, f64::max);
        let ratio = error / (per_length * step);
        if ratio <= 1.0 || step < 1e-9 * width {
            t += step;
            state = ahead;
            slopes[0] = slopes[6];
        }
        let factor = if ratio > 0.0 { 0.9 * ratio.powf(-0.25) } else { 5.0 };
        step = (step * factor.clamp(0.2, 5.0)).min(width);
    }
    [state[1], state[2], state[3], -(-state[0]).exp_m1()]
}

/// The extinction and emission along a ray, as functions of t.
struct RayField<'a> {
    gaussians: &'a [RayGaussian],
    width: f64,
    /// The value at its centre of a Gaussian whose integral is 1.
    density: f64,
}

impl RayField<'_> {
    fn slope(&self, t: f64, state: State) -> State {
        let reach = REACH * self.width;
        let from = self.gaussians.partition_point(|gaussian| gaussian.centre < t - reach);
        let mut sums = [0.0; 4];
        for gaussian in self.gaussians[from..].iter().take_while(|gaussian| gaussian.centre <= t + reach) {
            let distance = (t - gaussian.centre) / self.width;
            let weight = (-0.5 * distance * distance).exp();
            sums[0] += weight * gaussian.amount;
            (0..3).for_each(|c| sums[c + 1] += weight * gaussian.emission[c]);
        }
        let dimmed = (-state[0]).exp() * self.density;
        [sums[0] * self.density, sums[1] * dimmed, sums[2] * dimmed, sums[3] * dimmed]
    }
}
