//! FLIP: how strongly a viewer sees two pictures differ that alternate on a screen, at 67 pixels per degree.
//!
//! In: two pictures as a display shows them. Out: the mean of the FLIP values of all pixels, 0 to 1.
//!
//! ```text
//! colour  = HyAB distance in L*a*b* after filtering by contrast sensitivity and Hunt adjustment, 0..1
//! feature = larger difference of edges or of points in luminance, 0..1
//! flip    = colour ^ (1 - feature)
//! ```
//!
//! Source: Andersson, Nilsson, Akenine-Möller, Oskarsson, Åström and Fairchild, "FLIP: A Difference Evaluator for
//! Alternating Images", Proc. ACM Comput. Graph. Interact. Tech. 3(2), 2020. All filters are split into one along rows
//! and one along columns. tests/pictures/metrics.rs holds the results of the authors' tool.

use std::f64::consts::PI;

use super::display::{DisplayPicture, decoded};
use super::filter::{FilterKernel, filtered};

/// Pixels per degree of the authors' display: 3,840 pixels on 0.7 m, seen from 0.7 m away.
const PIXELS_PER_DEGREE: f64 = 67.020_645;
/// The exponent that is applied to colour distances.
const COLOUR_EXPONENT: f64 = 0.7;
/// Colour distances up to this fraction of the largest are mapped linearly to 0..[`KNEE_AT`], larger ones to
/// [`KNEE_AT`]..1.
const KNEE: f64 = 0.4;
const KNEE_AT: f64 = 0.95;
/// The width of the feature detector in degrees; then the exponent that is applied to feature differences.
const FEATURE_WIDTH: f64 = 0.082;
const FEATURE_EXPONENT: f64 = 0.5;

/// The matrix from linear sRGB to XYZ with white point D65.
const XYZ_FROM_RGB: [[f64; 3]; 3] = [
    [10_135_552.0 / 24_577_794.0, 8_788_810.0 / 24_577_794.0, 4_435_075.0 / 24_577_794.0],
    [2_613_072.0 / 12_288_897.0, 8_788_810.0 / 12_288_897.0, 887_015.0 / 12_288_897.0],
    [1_425_312.0 / 73_733_382.0, 8_788_810.0 / 73_733_382.0, 70_074_185.0 / 73_733_382.0],
];

/// The contrast sensitivity of each channel: a sum of Gaussians of frequency, each an amplitude and a width.
const ACHROMATIC: &[[f64; 2]] = &[[1.0, 0.0047]];
const RED_GREEN: &[[f64; 2]] = &[[1.0, 0.0053]];
const BLUE_YELLOW: &[[f64; 2]] = &[[34.1, 0.04], [13.5, 0.025]];
/// The largest width of these Gaussians, which sets the radius of the filters.
const WIDEST: f64 = 0.04;

/// Returns the mean FLIP of all pixels, 0 to 1.
pub(super) fn mean(reference: &DisplayPicture, test: &DisplayPicture) -> f64 {
    let pictures = [reference, test].map(opponent);
    let columns = reference.size[0];
    let [seen_reference, seen_test] = pictures.each_ref().map(|planes| perceived(planes, columns));
    let luminances = pictures.each_ref().map(|planes| planes[0].iter().map(|y| (y + 16.0) / 116.0).collect());
    // The first and the second derivative of a Gaussian: they detect edges and points.
    let kernels = [feature_kernel(|x, _| -x), feature_kernel(|x, sigma| (x / sigma).powi(2) - 1.0)];
    let [edges, points] =
        kernels.map(|kernel| luminances.each_ref().map(|plane: &Vec<f64>| strengths(plane, columns, &kernel)));
    let farthest = hyab(adjusted([0.0, 1.0, 0.0]), adjusted([0.0, 0.0, 1.0])).powf(COLOUR_EXPONENT);
    let knee = KNEE * farthest;
    let count = seen_test.len();
    let errors = (0..count).map(|at| {
        let distance = hyab(seen_reference[at], seen_test[at]).powf(COLOUR_EXPONENT);
        let colour = if distance < knee {
            distance * KNEE_AT / knee
        } else {
            KNEE_AT + (distance - knee) / (farthest - knee) * (1.0 - KNEE_AT)
        };
        let differs = |[a, b]: &[Vec<f64>; 2]| (a[at] - b[at]).abs();
        let feature = (differs(&edges).max(differs(&points)) / 2.0f64.sqrt()).powf(FEATURE_EXPONENT).clamp(0.0, 1.0);
        colour.powf(1.0 - feature)
    });
    errors.sum::<f64>() / count as f64
}

/// Returns the three planes of a picture in the opponent space Y, Cx, Cz, which is L*a*b* without its cube roots.
fn opponent(picture: &DisplayPicture) -> [Vec<f64>; 3] {
    let mut planes = [(); 3].map(|()| Vec::with_capacity(picture.colours.len()));
    for colour in &picture.colours {
        let [x, y, z] = relative_to_white(colour.map(decoded));
        let opponent = [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)];
        planes.iter_mut().zip(opponent).for_each(|(plane, value)| plane.push(value));
    }
    planes
}

/// Filters opponent planes by contrast sensitivity; returns the Hunt-adjusted L*a*b* colour of each pixel.
fn perceived(planes: &[Vec<f64>; 3], columns: usize) -> Vec<[f64; 3]> {
    let sensitivities = [ACHROMATIC, RED_GREEN, BLUE_YELLOW];
    let [y, cx, cz] = [0, 1, 2].map(|c| contrast_filtered(&planes[c], columns, sensitivities[c]));
    let rgb_from_xyz = inverse(XYZ_FROM_RGB);
    let white = product(XYZ_FROM_RGB, [1.0; 3]);
    let adjusted_pixel = |((y, cx), cz): ((f64, f64), f64)| {
        let y = (y + 16.0) / 116.0;
        let relative = [cx / 500.0 + y, y, y - cz / 200.0];
        let xyz = std::array::from_fn(|c| relative[c] * white[c]);
        adjusted(product(rgb_from_xyz, xyz).map(|c| c.clamp(0.0, 1.0)))
    };
    y.into_iter().zip(cx).zip(cz).map(adjusted_pixel).collect()
}

fn contrast_filtered(plane: &[f64], columns: usize, sensitivity: &[[f64; 2]]) -> Vec<f64> {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "10 pixels")]
    let radius = (3.0 * (WIDEST / (2.0 * PI * PI)).sqrt() * PIXELS_PER_DEGREE).ceil() as usize;
    let mut sum = vec![0.0; plane.len()];
    let mut weights = 0.0;
    for &[amplitude, width] in sensitivity {
        let kernel = FilterKernel::new(radius, |x| (-(PI * x / PIXELS_PER_DEGREE).powi(2) / width).exp());
        let factor = amplitude * (PI / width).sqrt();
        weights += factor * kernel.sum(|_| true).powi(2);
        let smoothed = filtered(plane, columns, &kernel, &kernel);
        sum.iter_mut().zip(smoothed).for_each(|(sum, value)| *sum += factor * value);
    }
    sum.iter_mut().for_each(|value| *value /= weights);
    sum
}

/// A feature detector along one direction, and the Gaussian at right angles to it.
struct FeatureKernel {
    along: FilterKernel,
    across: FilterKernel,
}

fn feature_kernel(weight: impl Fn(f64, f64) -> f64) -> FeatureKernel {
    let sigma = 0.5 * FEATURE_WIDTH * PIXELS_PER_DEGREE;
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "9 pixels")]
    let radius = (3.0 * sigma).ceil() as usize;
    let along = FilterKernel::new(radius, |x| weight(x, sigma) * (-0.5 * (x / sigma).powi(2)).exp());
    // Scales the positive weights to a sum of 1, and the negative ones to -1.
    let (above, below) = (along.sum(|w| w > 0.0), -along.sum(|w| w < 0.0));
    let along = along.map(|w| if w > 0.0 { w / above } else { w / below });
    FeatureKernel { along, across: FilterKernel::gaussian(radius, sigma) }
}

/// Returns the strength of the detected feature at each pixel.
fn strengths(plane: &[f64], columns: usize, FeatureKernel { along, across }: &FeatureKernel) -> Vec<f64> {
    let x = filtered(plane, columns, along, across);
    let y = filtered(plane, columns, across, along);
    x.into_iter().zip(y).map(|(x, y)| x.hypot(y)).collect()
}

/// Returns the L*a*b* colour of a linear colour, made less colourful where it is dark (the Hunt effect).
fn adjusted(linear: [f64; 3]) -> [f64; 3] {
    let edge = 6.0 / 29.0f64;
    let root = |t: f64| if t > edge.powi(3) { t.cbrt() } else { t / (3.0 * edge * edge) + 4.0 / 29.0 };
    let [x, y, z] = relative_to_white(linear).map(root);
    let lightness = 116.0 * y - 16.0;
    let [a, b] = [500.0 * (x - y), 200.0 * (y - z)];
    [lightness, 0.01 * lightness * a, 0.01 * lightness * b]
}

/// Returns the HyAB distance of two L*a*b* colours: city-block in lightness, Euclidean in a* and b*.
fn hyab(one: [f64; 3], other: [f64; 3]) -> f64 {
    (one[0] - other[0]).abs() + (one[1] - other[1]).hypot(one[2] - other[2])
}

/// Returns the XYZ of a linear sRGB colour, divided by the XYZ of white.
fn relative_to_white(linear: [f64; 3]) -> [f64; 3] {
    let (xyz, white) = (product(XYZ_FROM_RGB, linear), product(XYZ_FROM_RGB, [1.0; 3]));
    std::array::from_fn(|c| xyz[c] / white[c])
}

fn product(matrix: [[f64; 3]; 3], vector: [f64; 3]) -> [f64; 3] {
    matrix.map(|row| row[0] * vector[0] + row[1] * vector[1] + row[2] * vector[2])
}

fn inverse(matrix: [[f64; 3]; 3]) -> [[f64; 3]; 3] {
    // The matrix is given by rows but read as columns: the inverse of the transpose is the transpose of the inverse.
    glam::DMat3::from_cols_array_2d(&matrix).inverse().to_cols_array_2d()
}
