//! Closed forms of the emission-absorption integral, to test the reference renderers. All are exact up to rounding.

/// Returns the transmittance of a medium of optical depth `depth` (the Beer-Lambert law).
pub fn transmittance(depth: f64) -> f64 {
    (-depth).exp()
}

/// Returns the premultiplied colour of a medium of optical depth `depth` that has one colour.
pub fn constant(depth: f64, colour: f64) -> f64 {
    colour * absorbed(depth)
}

/// Returns the premultiplied colour of a medium whose colour goes linearly from `near` to `far`; `depth` is above 0.
///
/// It is the integral of `(near + (far - near) s / depth) e^-s` for s from 0 to `depth`.
pub fn linear_ramp(depth: f64, near: f64, far: f64) -> f64 {
    near * absorbed(depth) + (far - near) * (absorbed(depth) / depth - transmittance(depth))
}

/// Returns the premultiplied colour of one layer in front of another; each is a pair of optical depth and colour.
pub fn layers(near: (f64, f64), far: (f64, f64)) -> f64 {
    constant(near.0, near.1) + transmittance(near.0) * constant(far.0, far.1)
}

/// Returns the premultiplied colour of two evenly mixed media, each a pair of optical depth and colour. The colours are
/// averaged by optical depth.
pub fn mixed(one: (f64, f64), other: (f64, f64)) -> f64 {
    let depth = one.0 + other.0;
    constant(depth, (one.0 * one.1 + other.0 * other.1) / depth)
}

/// Returns the optical depth of a ray that passes the Gaussian kernel of one voxel, whose cell is a cube.
///
/// `depth` is the optical depth along an edge of the voxel. `sigma` and the ray's `distance` from it are in voxel
/// spacings.
pub fn voxel_depth(depth: f64, sigma: f64, distance: f64) -> f64 {
    let square = sigma * sigma;
    depth / (std::f64::consts::TAU * square) * (-0.5 * distance * distance / square).exp()
}

/// Returns the normal distribution function: the part of a Gaussian of standard deviation 1 that is below `z`.
pub fn normal_distribution(z: f64) -> f64 {
    let z = z.clamp(-9.0, 9.0);
    // The terms of z + z^3 / 3 + z^5 / 15 + ... have one sign, so that no digits cancel.
    let (mut sum, mut term) = (z, z);
    let mut odd = 1.0;
    while term.abs() > f64::EPSILON * sum.abs() {
        odd += 2.0;
        term *= z * z / odd;
        sum += term;
    }
    0.5 + sum * (-0.5 * z * z).exp() / std::f64::consts::TAU.sqrt()
}

/// Returns the opacity `1 - e^-depth`, exact for small depths too.
fn absorbed(depth: f64) -> f64 {
    -(-depth).exp_m1()
}
