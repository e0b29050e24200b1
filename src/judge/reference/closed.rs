//! Closed forms of the emission-absorption integral, for judging the judges.
//!
//! In: optical depths and colours. Out: transmittance, premultiplied colour. All are exact up to rounding.

/// Transmittance of an optical depth: Beer and Lambert's law.
pub fn transmittance(depth: f64) -> f64 {
    (-depth).exp()
}

/// What an optical depth of one colour emits and absorbs: premultiplied colour.
pub fn constant(depth: f64, colour: f64) -> f64 {
    colour * absorbed(depth)
}

/// A constant extinction whose colour goes linearly from `near` to `far`, over an optical depth above 0.
///
/// The integral of `(near + (far - near) s / depth) e^-s` for s from 0 to `depth`.
pub fn linear_ramp(depth: f64, near: f64, far: f64) -> f64 {
    near * absorbed(depth) + (far - near) * (absorbed(depth) / depth - transmittance(depth))
}

/// One layer wholly in front of another: optical depth and colour of each.
pub fn layers(near: (f64, f64), far: (f64, f64)) -> f64 {
    constant(near.0, near.1) + transmittance(near.0) * constant(far.0, far.1)
}

/// Two that fill the same place in the same proportion everywhere: colours mix by optical depth.
pub fn mixed(one: (f64, f64), other: (f64, f64)) -> f64 {
    let depth = one.0 + other.0;
    constant(depth, (one.0 * one.1 + other.0 * other.1) / depth)
}

/// Optical depth of a ray through a single voxel's Gaussian kernel, of a cell as wide in every direction.
///
/// `depth`: of one voxel's length. `sigma`, `distance` (of the ray from the voxel's centre): in voxel spacings.
pub fn voxel_depth(depth: f64, sigma: f64, distance: f64) -> f64 {
    let square = sigma * sigma;
    depth / (std::f64::consts::TAU * square) * (-0.5 * distance * distance / square).exp()
}

/// `1 - e^-depth`, however small.
fn absorbed(depth: f64) -> f64 {
    -(-depth).exp_m1()
}
