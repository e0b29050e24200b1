//! Splats from a millionth of a pixel to a thousand million, pictures from one pixel to 16,384 a side.

use adjsplat::build::Built;
use adjsplat::splat::{Camera, Mode, Projection, Quality, Settings};
use adjsplat::volume::Grid;
use adjsplat_tests::pictures::{alphas, apart};
use adjsplat_tests::scenes::Draw as _;

use crate::extremes::model::{Judge as _, coded, constant, parallel, peak_weight, solid, worst};

const ALONG: [f64; 3] = [0.0, 0.0, 1.0];
const UP: [f64; 3] = [0.0, 1.0, 0.0];

fn voxel(opacity: f64) -> Built {
    solid([1; 3], [1.0; 3], constant(opacity, 1.0))
}

/// One voxel as wide as `pixels`, `shift` of a pixel from the picture's middle to the right and down.
fn at(pixels: f64, shift: [f64; 2], size: [u32; 2]) -> Camera {
    // Looking along z with y up, x runs to the left.
    let target = [shift[0] / pixels, shift[1] / pixels, 0.0];
    parallel(target, ALONG, UP, f64::from(size[1]) / pixels)
}

/// Sum of the depths of an x-ray's pixels.
fn light(model: &Built, camera: &Camera, settings: &Settings) -> f64 {
    let (frame, _) = model.draw(camera, &settings.clone().with_mode(Mode::Additive));
    alphas(&frame).map(|alpha| -(-alpha).ln_1p()).sum()
}

/// Widened to 0.6 pixels: sampling such a Gaussian ripples by 0.33 %, and its cut-off (3/0.7) by less.
#[test]
fn splats_far_below_a_pixel_keep_their_light() {
    let settings = Settings::every_pixel([41, 41]).with_quality(Quality::High);
    for pixels in [0.1, 1e-3, 1e-6, 1e-9] {
        for shift in [[0.0, 0.0], [0.5, 0.0], [0.5, 0.5], [0.31, -0.17]] {
            let got = light(&voxel(0.5), &at(pixels, shift, [41, 41]), &settings);
            let want = -(0.5f64).ln() * pixels * pixels;
            assert!((got / want - 1.0).abs() <= 4e-3, "{pixels:e} {shift:?}: {}", got / want);
        }
    }
    // In perspective, from a million voxels away and more.
    for distance in [1e4, 1e7] {
        let camera = Camera::new([0.0, 0.0, distance], [0.0; 3], UP, Projection::Perspective { fov: 90.0 }).unwrap();
        let pixels = 41.0 / 2.0 / distance;
        let got = light(&voxel(0.5), &camera, &settings);
        let want = -(0.5f64).ln() * pixels * pixels;
        assert!((got / want - 1.0).abs() <= 4e-3, "{distance:e}: {}", got / want);
    }
}

/// The picture is one flat spot, up to a voxel that is four thousand million pixels wide (beyond, its area is more than
/// single precision holds, and it is not drawn), and takes no longer than its pixels.
#[test]
fn splats_far_beyond_the_picture_are_flat() {
    for opacity in [0.01f64, 0.5, 1.0] {
        let depth = (-(-opacity).ln_1p()).min(16.0) * peak_weight(&Settings::every_pixel([9, 9]));
        for pixels in [1e5, 5e5, 1e6, 1e9, 4e9] {
            let settings = Settings::every_pixel([64, 48]);
            let (frame, stats) = voxel(opacity).draw(&at(pixels, [3.0, 5.0], [64, 48]), &settings);
            assert_eq!(stats.splats_drawn, 1);
            for alpha in alphas(&frame) {
                // Forty pixels off the middle of one 60,000 wide: 2e-7 of the depth; and some roundings.
                assert!((alpha + (-depth).exp_m1()).abs() <= 1e-6, "{pixels:e} {opacity}: {alpha}");
            }
            // The bound is generous: this takes a millisecond.
            assert!(stats.frame_ms < 2_000.0, "{stats:?}");
        }
        let (frame, stats) = voxel(opacity).draw(&at(1e12, [0.0; 2], [64, 48]), &Settings::every_pixel([64, 48]));
        assert!(stats.splats_drawn == 0 && alphas(&frame).all(|alpha| alpha == 0.0));
    }
}

#[test]
fn voxels_far_off_the_picture_leave_it_as_it_is() {
    let settings = Settings::every_pixel([40, 30]).with_quality(Quality::High);
    let empty = |camera: &Camera, what: &str| {
        for mode in [Mode::Composite, Mode::Additive] {
            let (frame, stats) = voxel(0.9).draw(camera, &settings.clone().with_mode(mode));
            assert!(stats.splats_drawn == 0 && frame.pixels().iter().all(|value| value.to_bits() == 0), "{what}");
        }
    };
    for off in [1e3, 1e6, 2.2e9, 4.3e9, 1e12, 1e18, 1e30, 1e100] {
        for (x, y) in [(off, 0.0), (0.0, off), (-off, off), (0.0, -off)] {
            empty(&at(1.0, [x, y], [40, 30]), &format!("parallel, {x:e} {y:e}"));
        }
        // Perspective: two voxels in front of the eye's plane, and so far aside.
        let camera = Camera::new([off, 0.0, -10.0], [off, 0.0, 0.0], UP, Projection::Perspective { fov: 40.0 });
        empty(&camera.unwrap(), &format!("perspective, {off:e}"));
    }
}

/// Twins around the centre: pixels at the same distance differ by rounding, a few units in the last place of the peak.
#[test]
fn a_splat_on_a_pixels_middle_edge_or_corner_is_symmetric() {
    for pixels in [0.01, 1.0, 7.3] {
        for (shift, size) in
            [([0.0, 0.0], [31, 31]), ([0.0, 0.0], [30, 31]), ([0.0, 0.0], [31, 30]), ([0.0, 0.0], [30, 30])]
        {
            let settings = Settings::every_pixel(size).with_mode(Mode::Additive);
            let (frame, _) = voxel(0.9).draw(&at(pixels, shift, size), &settings);
            let peak = alphas(&frame).fold(0.0, f64::max);
            assert!(peak > 0.0);
            for (row, column) in (0..size[1]).flat_map(|row| (0..size[0]).map(move |column| (row, column))) {
                let here = f64::from(frame.pixel(column, row)[3]);
                for (c, r) in [(size[0] - 1 - column, row), (column, size[1] - 1 - row)] {
                    let there = f64::from(frame.pixel(c, r)[3]);
                    assert!((here - there).abs() <= 1e-6 * peak, "{pixels} {size:?}: {here} {there}");
                }
            }
        }
    }
}

/// A splat that the picture's border cuts is the part of it that is inside.
#[test]
fn a_splat_on_the_border_is_cut_there_and_nowhere_else() {
    for pixels in [0.3, 3.0, 12.0] {
        let whole = Settings::every_pixel([64, 64]);
        for shift in [[-16.0, 0.0], [0.0, -16.0], [16.0, 16.0], [-15.5, 3.25], [15.5, -16.5]] {
            // The middle 32 x 32 pixels of the one are the other.
            let (large, _) = voxel(0.9).draw(&at(pixels, shift, [64, 64]), &whole);
            let (small, stats) = voxel(0.9).draw(&at(pixels, shift, [32, 32]), &Settings::every_pixel([32, 32]));
            assert_eq!(stats.splats_drawn, 1, "{pixels} {shift:?}");
            for (row, column) in (0..32).flat_map(|row| (0..32).map(move |column| (row, column))) {
                let (a, b) = (small.pixel(column, row), large.pixel(column + 16, row + 16));
                assert!((0..4).all(|c| (a[c] - b[c]).abs() <= 1e-6), "{pixels} {shift:?} {column} {row}: {a:?} {b:?}");
            }
        }
    }
}

/// Strips at the largest side, and what is at their ends. A picture of 16,384 x 16,384 takes 8 GiB: the same numbers,
/// as columns and rows are computed apart.
#[test]
fn pictures_at_the_largest_side_are_as_exact_at_their_ends_as_small_ones() {
    let grid = || Grid::new([4, 4, 4], [1.0; 3]).unwrap();
    let model = coded(grid(), constant(0.6, 1.0), |[x, y, z]| ((x + y + z) % 2 == 0).then_some(1));
    let along = [0.3, 0.2, 1.0];
    for (size, shift) in
        [([16_384, 24], [8_176.0, 0.0]), ([24, 16_384], [0.0, 8_176.0]), ([16_384, 24], [-8_170.25, 0.0])]
    {
        let draw = |size: [u32; 2], shift: [f64; 2]| {
            // Four pixels a voxel; the model's middle is `shift` from the picture's.
            let (right, up) = axes(along);
            let target = [0, 1, 2].map(|a| 1.5 - right[a] * shift[0] / 4.0 + up[a] * shift[1] / 4.0);
            let camera = parallel(target, along, UP, f64::from(size[1]) / 4.0);
            let settings = Settings::every_pixel(size).with_quality(Quality::High);
            model.frame(&camera, &settings)
        };
        let large = draw(size, shift);
        // The same pixels in a picture of 24 x 24 whose middle is 16 pixels from the large one's end.
        let side = usize::from(size[1] > size[0]);
        let from = if shift[side] > 0.0 { size[side] - 24 } else { 0 };
        let mut rest = shift;
        rest[side] = shift[side] - (f64::from(from) + 11.5 - (f64::from(size[side]) - 1.0) / 2.0);
        let small = draw([24, 24], rest);
        assert!(alphas(&small).fold(0.0, f64::max) > 0.5);
        let mut most = 0.0f32;
        for (row, column) in (0..24).flat_map(|row| (0..24).map(move |column| (row, column))) {
            let there = if side == 0 { large.pixel(column + from, row) } else { large.pixel(column, row + from) };
            most = small.pixel(column, row).iter().zip(there).map(|(a, b)| (a - b).abs()).fold(most, f32::max);
        }
        // Places are in double precision: 16,384 of 2^-52. A pixel on a footprint's edge is 1e-4 of a peak.
        assert!(most <= 3e-5, "{size:?}: {most:e}");
    }
}

/// Right and up of a parallel view with y up.
fn axes(along: [f64; 3]) -> ([f64; 3], [f64; 3]) {
    let cross =
        |a: [f64; 3], b: [f64; 3]| [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    let unit = |a: [f64; 3]| a.map(|c| c / a.iter().map(|c| c * c).sum::<f64>().sqrt());
    let forward = unit(along);
    let right = unit(cross(forward, UP));
    (right, cross(right, forward))
}

#[test]
fn pictures_that_cannot_be_are_refused_before_memory_is_taken() {
    let camera = at(1.0, [0.0; 2], [9, 9]);
    for size in
        [[0, 0], [0, 7], [7, 0], [1, 16_385], [65_535, 1], [1 << 31, 1 << 31], [u32::MAX, u32::MAX], [0, u32::MAX]]
    {
        let refusal = voxel(0.5).refusal(&camera, &Settings::every_pixel(size));
        assert!(refusal.contains("picture size"), "{size:?}: {refusal}");
    }
    for size in [[1, 1], [1, 16_384], [16_384, 1], [3, 2]] {
        let (frame, stats) = voxel(0.5).draw(&at(1.0, [0.0; 2], size), &Settings::every_pixel(size));
        assert!(frame.size() == size && stats.splats_drawn == 1, "{size:?}");
    }
}

/// Kernels seen edge on, up to ten thousand million times as long as wide: a covariance whose determinant is rounding.
#[test]
fn needles_are_finite_and_no_deeper_than_they_should_be() {
    let mut largest = 0.0f64;
    for (spacing, along) in [
        ([1.0, 1.0, 1e5], [1.0, 0.0, 0.0]),
        ([1.0, 1.0, 1e5], [0.0, 1.0, 1e-5]),
        ([1.0, 1e-5, 1e5], [1.0, 0.1, 0.0]),
        ([1e5, 1e-5, 1e5], [0.7, 0.0, 0.7]),
        ([1e5, 1e5, 1e-5], [0.70001, 0.7, 1e-9]),
    ] {
        let mut model = solid([3, 4, 5], spacing, constant(0.3, 1.0));
        let mean: f64 = spacing.iter().product::<f64>().cbrt();
        for reference in [mean, 1.0] {
            model.transfer = constant(0.3, reference);
            let depth = -(0.7f64).ln() * mean / reference;
            let target = [0, 1, 2].map(|a| spacing[a] * [1.0, 1.5, 2.0][a]);
            for height in [1e-4, 1.0, 6.0, 30.0, 1e6] {
                let camera = parallel(target, along, [0.3, 0.8, 0.2], height);
                let settings = Settings::every_pixel([32, 32]).with_quality(Quality::Reference);
                let (frame, _) = model.draw(&camera, &settings);
                // Splats that are longer than 2,097,152 pixels to either side end there.
                if 3.0 * spacing.iter().copied().fold(0.0, f64::max) * 32.0 / height > 2e6 {
                    continue;
                }
                let (want, splats) = model.depths(&camera, &settings, |_| depth);
                // Single precision places the ridge of an ellipse 1e10 pixels long to some 1e-7 of the width of the
                // picture, and its depth to as much: where it is steep that shows. Never more than a hundredth.
                let error = worst(&frame, &want);
                assert!(error <= splats as f64 * 2f64.powi(-24) + 1e-2, "{spacing:?} {along:?} {height:e}: {error:e}");
                let most = want.iter().copied().fold(0.0, f64::max);
                let (got, want) = (alphas(&frame).fold(0.0, f64::max), -(-most).exp_m1());
                assert!(got <= want + 1e-3, "{spacing:?} {along:?} {height:e}: {got}, not {want}");
                largest = largest.max(error);
            }
        }
    }
    println!("needles: within {largest:.1e}");
}

/// A camera that moves by a pixel moves the picture by a pixel; by half a pixel, it is between.
#[test]
fn a_camera_a_pixel_aside_gives_the_picture_a_pixel_aside() {
    let model = coded(Grid::new([7, 6, 5], [1.0; 3]).unwrap(), constant(0.4, 1.0), |[x, y, z]| {
        ((x * 3 + y * 5 + z) % 4 != 0).then_some(1)
    });
    let settings = Settings::every_pixel([60, 50]).with_quality(Quality::Reference);
    let (right, up) = axes([0.2, 0.3, 1.0]);
    let draw = |x: f64, y: f64| {
        let target = [0, 1, 2].map(|a| [3.0, 2.5, 2.0][a] + (right[a] * x - up[a] * y) / 5.0);
        model.draw(&parallel(target, [0.2, 0.3, 1.0], UP, 10.0), &settings).0
    };
    let first = draw(0.0, 0.0);
    let moved = draw(3.0, -2.0);
    for (row, column) in (4..46).flat_map(|row| (4..56).map(move |column| (row, column))) {
        let (a, b) = (first.pixel(column, row), moved.pixel(column - 3, row + 2));
        assert!((0..4).all(|c| (a[c] - b[c]).abs() <= 3e-5), "{column} {row}: {a:?} {b:?}");
    }
    // Depths are smooth: half-way pictures are between their neighbours, but for curvature.
    let half = draw(0.5, 0.0);
    let between = |column: u32, row: u32| (first.pixel(column, row)[3] + first.pixel(column + 1, row)[3]) / 2.0;
    let most = (4..46)
        .flat_map(|row| (4..56).map(move |column| (row, column)))
        .map(|(row, column)| (half.pixel(column, row)[3] - between(column, row)).abs())
        .fold(0.0, f32::max);
    assert!(most <= 0.03 && apart(&half, &first) > 0.01, "{most}");
}
