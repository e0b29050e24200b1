//! Codes of gradient magnitudes, and the smoothing of label maps.

use adjsplat::classify::{MagnitudeCodec, Smoother};

/// Weights of the binomial filter.
const TAPS: [f32; 5] = [1.0 / 16.0, 4.0 / 16.0, 6.0 / 16.0, 4.0 / 16.0, 1.0 / 16.0];

#[test]
fn the_error_is_at_most_half_a_step() {
    for largest in [1e-300, 1e-30, 0.37, 1.0, 255.0, 4e9, 1e300] {
        let codec = MagnitudeCodec::new(largest).unwrap();
        let mut worst = 0.0f64;
        for step in 0..200_000 {
            let magnitude = largest * (-f64::from(step) * 15.89 / 200_000.0).exp2();
            let decoded = codec.decode(codec.encode(magnitude));
            worst = worst.max((decoded / magnitude - 1.0).abs());
        }
        assert!(worst < 0.0220, "{worst} at {largest}");
        assert!(worst > 0.0215, "the bound is sharp: {worst}");
    }
}

#[test]
fn every_code_comes_back_and_the_ends_hold() {
    let codec = MagnitudeCodec::new(93.5).unwrap();
    for code in 1..=255 {
        assert_eq!(codec.encode(codec.decode(code)), code);
    }
    let codes = [0.0, -1.0, f64::NAN, 5e-324, 93.5, 1e300, f64::INFINITY].map(|m| codec.encode(m));
    assert_eq!(codes, [0, 0, 0, 0, 255, 255, 255]);
    assert_eq!(codec.decode(255), 93.5);
    let flat = MagnitudeCodec::new(0.0).unwrap();
    assert_eq!((flat.encode(0.0), flat.decode(0), flat.decode(255)), (0, 0.0, 0.0));
    for wrong in [f64::NAN, f64::INFINITY, -1.0] {
        assert!(MagnitudeCodec::new(wrong).unwrap_err().to_string().contains("must be finite"));
    }
}

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
