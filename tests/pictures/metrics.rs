//! Metrics, held to other people's programs on pictures that a formula makes.

use adjsplat::splat::Frame;
use adjsplat_judge::metrics::{HeatMap, Metrics, compare};

type Pixel = fn(i64, i64) -> [i64; 4];

fn triangle(t: i64, period: i64) -> i64 {
    ((t % (2 * period)) - period).abs() * 255 / period
}

fn waves(x: i64, y: i64) -> [i64; 4] {
    [triangle(3 * x + 2 * y, 50), triangle(x * x / 16 + y, 70), triangle(5 * y - x + 500, 90), 255]
}

fn ramp(x: i64, y: i64) -> [i64; 4] {
    [x * 255 / 95, y * 255 / 63, 128, 255]
}

fn noisy(x: i64, y: i64) -> [i64; 4] {
    let noise = |c: i64| ((((x * 73_856_093) ^ (y * 19_349_663) ^ (c * 83_492_791)) & 0xffff_ffff) >> 7) % 33 - 16;
    let [r, g, b, a] = ramp(x, y);
    [(r + noise(0)).clamp(0, 255), (g + noise(1)).clamp(0, 255), (b + noise(2)).clamp(0, 255), a]
}

fn disc(x: i64, y: i64, middle: i64, colour: [i64; 4]) -> [i64; 4] {
    if (x - middle).pow(2) + (y - 40).pow(2) < 900 { colour } else { [0; 4] }
}

/// A frame of sRGB bytes that are not premultiplied.
fn frame(size: [u32; 2], pixel: Pixel) -> Frame {
    let mut frame = Frame::transparent(size).unwrap();
    for y in 0..size[1] {
        for x in 0..size[0] {
            let [r, g, b, alpha] = pixel(x.into(), y.into()).map(|byte| byte as f64 / 255.0);
            let linear = |s: f64| if s <= 0.04045 { s / 12.92 } else { ((s + 0.055) / 1.055).powf(2.4) };
            let at = 4 * (y * size[0] + x) as usize;
            let premultiplied = [linear(r) * alpha, linear(g) * alpha, linear(b) * alpha, alpha];
            #[expect(clippy::cast_possible_truncation, reason = "single precision is a frame's")]
            frame.pixels_mut()[at..at + 4].copy_from_slice(&premultiplied.map(|sample| sample as f32));
        }
    }
    frame
}

/// What other programs say of a pair.
struct Figures {
    psnr: f64,
    rmse: f64,
    max_abs: f64,
    display_psnr: f64,
    ssim: f64,
    flip: f64,
}

/// Printed by scikit-image 0.26.0 (`peak_signal_noise_ratio` of linear premultiplied RGBA where a picture is not empty,
/// and of display RGB; `structural_similarity` of luma with `gaussian_weights=True, sigma=1.5,
/// use_sample_covariance=False, data_range=1`), and by the FLIP authors' flip-evaluator 1.7 (`evaluate(a, b, "LDR")`,
/// its own 67.0206 pixels a degree). The background is white.
const WAVES: Figures = Figures {
    psnr: 23.633802792484992,
    rmse: 0.06581272304230304,
    max_abs: 0.34859436258017584,
    display_psnr: 23.76924186947815,
    ssim: 0.8960017639686358,
    flip: 0.37097957730293274,
};
const NOISE: Figures = Figures {
    psnr: 29.087608378272304,
    rmse: 0.03512526270771738,
    max_abs: 0.13684278654589765,
    display_psnr: 28.669157325781608,
    ssim: 0.6799516818938591,
    flip: 0.08862058073282242,
};
const DISC: Figures = Figures {
    psnr: 15.624894752847084,
    rmse: 0.1654837151526935,
    max_abs: 1.0,
    display_psnr: 14.749298005203848,
    ssim: 0.76920816730079,
    flip: 0.17658035457134247,
};

/// Frames are in single precision, so samples differ by 6e-8: 1e-6 of a figure. FLIP's tool computes in single precision
/// too, through filters of 441 taps and roots: 2e-5.
fn agrees(name: &str, size: [u32; 2], a: Pixel, b: Pixel, want: &Figures) {
    let (a, b) = (frame(size, a), frame(size, b));
    for (got, pair) in [(compare(&a, &b, [1.0; 3]), "there"), (compare(&b, &a, [1.0; 3]), "back")] {
        let Metrics { psnr, ssim, flip, max_abs, rmse, display, .. } = got.unwrap();
        let figures = [
            ("psnr", psnr, want.psnr, 1e-4),
            ("rmse", rmse, want.rmse, 1e-6),
            ("max_abs", max_abs, want.max_abs, 1e-6),
            ("display psnr", display.psnr, want.display_psnr, 1e-4),
            ("ssim", ssim, want.ssim, 1e-6),
            ("flip", flip, want.flip, 2e-5),
        ];
        for (figure, got, want, tolerance) in figures {
            assert!((got - want).abs() <= tolerance, "{name}, {pair}: {figure} is {got}, but others say {want}");
        }
    }
}

#[test]
fn waves_that_moved_by_a_pixel() {
    agrees("waves", [96, 64], waves, |x, y| waves(x + 1, y), &WAVES);
}

#[test]
fn a_ramp_with_noise() {
    agrees("noise", [96, 64], ramp, noisy, &NOISE);
}

#[test]
fn a_disc_before_nothing() {
    let red: Pixel = |x, y| disc(x, y, 40, [200, 80, 40, 255]);
    let duller: Pixel = |x, y| disc(x, y, 42, [190, 90, 40, 255]);
    agrees("disc", [80, 80], red, duller, &DISC);
}

#[test]
fn equal_pictures_are_perfect_by_every_measure() {
    for (size, pixel) in [([96, 64], waves as Pixel), ([3, 2], ramp), ([1, 1], ramp), ([20, 4], |_, _| [0; 4])] {
        let picture = frame(size, pixel);
        let metrics = compare(&picture, &picture, [0.2, 0.5, 1.0]).unwrap();
        assert_eq!((metrics.psnr, metrics.rmse, metrics.max_abs), (f64::INFINITY, 0.0, 0.0));
        assert_eq!((metrics.display.psnr, metrics.energy, metrics.flip), (f64::INFINITY, 0.0, 0.0));
        // Sums of a window's weights are 1 up to rounding.
        assert!((metrics.ssim - 1.0).abs() < 1e-12, "{}", metrics.ssim);
        assert_eq!(HeatMap::new(&picture, &picture).unwrap().brightest, 0.0);
    }
}

#[test]
fn the_largest_error_is_found_where_it_is_and_empty_pixels_do_not_count() {
    let mut right = Frame::transparent([7, 5]).unwrap();
    let mut other = right.clone();
    right.pixels_mut()[4 * 10..][..4].copy_from_slice(&[0.5, 0.5, 0.5, 1.0]);
    other.pixels_mut()[4 * 10..][..4].copy_from_slice(&[0.5, 0.25, 0.5, 1.0]);
    let metrics = compare(&right, &other, [0.0; 3]).unwrap();
    assert_eq!((metrics.max_abs, metrics.max_at), (0.25, [3, 1]));
    // One pixel of four samples, of which one differs by a quarter.
    assert_eq!(metrics.rmse, 0.125);
    assert!((metrics.energy + 0.1).abs() < 1e-15, "2.25 over 2.5, less 1: {}", metrics.energy);
    let heat = HeatMap::new(&right, &other).unwrap();
    assert_eq!(heat.brightest, 0.25);
    let bright = heat.frame.pixel(3, 1);
    assert!(bright[0] > 0.8 && bright[1] > 0.8, "{bright:?}");
    assert_eq!(heat.frame.pixel(0, 0), [0.0, 0.0, 0.0, 1.0]);
}

#[test]
fn pictures_that_cannot_be_compared_are_refused() {
    let [small, large] = [[2, 2], [2, 3]].map(|size| Frame::transparent(size).unwrap());
    let told = compare(&small, &large, [0.0; 3]).unwrap_err().to_string();
    assert_eq!(told, "pictures: are 2x2 and 2x3; compare pictures of one size");
    let mut broken = small.clone();
    broken.pixels_mut()[5] = f32::NAN;
    let told = compare(&small, &broken, [0.0; 3]).unwrap_err().to_string();
    assert_eq!(told, "second picture: has samples that are no finite numbers");
}
