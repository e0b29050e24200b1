//! Pictures judged from outside: by double-precision sums straight from the volume, by invariants that no order of
//! splats may break, and by each other on real volumes.

use adjsplat::arena::{Arena, LaneSet};
use adjsplat::classify::TransferFunction;
use adjsplat::file::arena_bytes;
use adjsplat::splat::{Camera, Lanes, Projection, Quality, Scene, Settings, cpu};
use adjsplat::volume::{SampleType, SlabSource};
use adjsplat_tests::pictures::{alphas, shows};
use adjsplat_tests::scenes::{Draw as _, LAYERS, built, fitting, phantom, real_volumes, transfer, volume};
use adjsplat_tests::walks::parallel_orders;

/// A parallel view.
struct Looking {
    /// Unit vectors to the right, up and along the view.
    axes: [[f64; 3]; 3],
    /// World position in the middle of the picture.
    centre: [f64; 3],
    /// Pixels per world length.
    scale: f64,
    /// Pixels on either side.
    size: u32,
}

/// What each pixel of a parallel view must hold: every voxel's kernel, projected and summed in double precision from
/// the volume itself, composited front to back in the exact nesting.
fn reference(
    source: &mut dyn SlabSource,
    transfer: &TransferFunction,
    quality: Quality,
    view: &Looking,
) -> Vec<[f64; 4]> {
    let &Looking { axes: [right, up, forward], centre, scale, size } = view;
    let (dims, spacing) = (source.header().grid.dims, source.header().grid.spacing);
    let kernel = quality.kernel();
    let (sigma, radius) = (f64::from(kernel.sigma), f64::from(kernel.radius));
    let cut = (radius / sigma).powi(2);
    let kept = 1.0 - (-cut / 2.0).exp();
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    // Covariance of the footprint in pixels, and the low-pass that the narrowest direction needs.
    let covariance =
        |a: [f64; 3], b: [f64; 3]| (0..3).map(|i| a[i] * b[i] * (sigma * spacing[i] * scale).powi(2)).sum::<f64>();
    let (mut xx, xy, mut yy) = (covariance(right, right), -covariance(right, up), covariance(up, up));
    let narrowest = (xx + yy) / 2.0 - (((xx - yy) / 2.0).powi(2) + xy * xy).sqrt();
    let low_pass = (0.6f64.powi(2) - narrowest).max(0.0);
    (xx, yy) = (xx + low_pass, yy + low_pass);
    let determinant = xx * yy - xy * xy;
    let reference_length = (spacing[0] * spacing[1] * spacing[2]).cbrt();
    let cell = spacing[0] * spacing[1] * spacing[2];

    let mut voxels = Vec::new();
    let mut slice = source.header().new_slice().unwrap();
    for z in 0..dims[2] {
        source.read_slice(&mut slice).unwrap();
        for index in 0..slice.len() {
            let value = slice.get(index);
            let opacity = transfer.opacity(value, 0.0);
            if opacity > 0.0 {
                let width = dims[0] as usize;
                let at = [(index % width) as f64, (index / width) as f64, f64::from(z)];
                voxels.push((at, opacity, transfer.colour(value)));
            }
        }
    }
    // Nested order, near first: by the axis most aligned with the view in voxel units, then the next.
    let toward: Vec<f64> = (0..3).map(|a| forward[a] / spacing[a]).collect();
    let mut axes = [0, 1, 2];
    axes.sort_by(|&a, &b| toward[b].abs().total_cmp(&toward[a].abs()));
    voxels.sort_by(|(a, ..), (b, ..)| {
        // A component of 0, of either sign, counts as above 0.
        let near = |axis: usize, at: &[f64; 3]| if toward[axis] < 0.0 { -at[axis] } else { at[axis] };
        let keys = axes.map(|axis| near(axis, a).total_cmp(&near(axis, b)));
        keys[0].then(keys[1]).then(keys[2])
    });

    let half = (f64::from(size) - 1.0) / 2.0;
    let mut pixels = vec![[0.0, 0.0, 0.0, 1.0]; (size * size) as usize];
    for (at, opacity, colour) in voxels {
        let world: [f64; 3] = std::array::from_fn(|a| at[a] * spacing[a] - centre[a]);
        let (x, y) = (half + scale * dot(world, right), half - scale * dot(world, up));
        let extinction = -(-opacity).ln_1p() / reference_length;
        for row in 0..size {
            for column in 0..size {
                let (dx, dy) = (f64::from(column) - x, f64::from(row) - y);
                let distance = (yy * dx * dx - 2.0 * xy * dx * dy + xx * dy * dy) / determinant;
                if distance <= cut {
                    let gaussian = (-distance / 2.0).exp() / (std::f64::consts::TAU * determinant.sqrt()) / kept;
                    let absorbed = -(-extinction * cell * gaussian * scale * scale).exp_m1();
                    let pixel = &mut pixels[(row * size + column) as usize];
                    let taken = pixel[3] * absorbed;
                    (0..3).for_each(|c| pixel[c] += taken * f64::from(colour[c]));
                    pixel[3] -= taken;
                }
            }
        }
    }
    pixels
}

/// The renderer and the sums differ by single-precision rounding of some hundred steps a pixel (2e-5), and where a
/// pixel lies on a footprint's very edge and only one of the two counts it: at the cut-off the weight is 0.4 % of the
/// peak at `standard`, 0.01 % at `high`.
#[test]
fn a_picture_is_what_summing_kernels_in_double_precision_gives() {
    let transfer = transfer(LAYERS);
    for (dims, spacing, quality, tolerance) in [
        ([20, 22, 24], [1.0, 1.0, 1.0], Quality::High, 3e-5),
        ([20, 22, 24], [1.0, 1.0, 1.0], Quality::Reference, 3e-5),
        ([24, 20, 8], [0.8, 1.0, 2.5], Quality::Reference, 3e-5),
        ([20, 22, 24], [1.0, 1.0, 1.0], Quality::Standard, 2e-3),
    ] {
        let mut source = phantom("gyroid", dims, SampleType::U8, spacing);
        let built = built(&mut *source, &fitting(transfer.clone(), 8));
        for (azimuth, elevation) in [(0.0f64, 0.0f64), (33.0, 21.0), (-140.0, 62.0)] {
            let (a, e) = (azimuth.to_radians(), elevation.to_radians());
            let outward = [-a.sin() * e.cos(), a.cos() * e.cos(), e.sin()];
            let up = [a.sin() * e.sin(), -a.cos() * e.sin(), e.cos()];
            let forward = outward.map(|c| -c);
            let right = [
                forward[1] * up[2] - forward[2] * up[1],
                forward[2] * up[0] - forward[0] * up[2],
                forward[0] * up[1] - forward[1] * up[0],
            ];
            let centre: [f64; 3] = std::array::from_fn(|a| (dims[a] as f64 - 1.0) / 2.0 * spacing[a]);
            let (size, height) = (48, 40.0);
            let position = std::array::from_fn(|a| centre[a] + 100.0 * outward[a]);
            let camera = Camera::new(position, centre, up, Projection::Parallel { height }).unwrap();
            let settings = Settings::every_pixel([size, size]).with_quality(quality);
            let frame = built.frame(&camera, &settings);
            let scale = f64::from(size) / height;
            let view = Looking { axes: [right, up, forward], centre, scale, size };
            let want =
                reference(&mut *phantom("gyroid", dims, SampleType::U8, spacing), &built.transfer, quality, &view);
            let mut worst = 0.0f64;
            for (got, want) in frame.pixels().as_chunks::<4>().0.iter().zip(&want) {
                let want = [want[0], want[1], want[2], 1.0 - want[3]];
                worst = (0..4).map(|c| (f64::from(got[c]) - want[c]).abs()).fold(worst, f64::max);
            }
            assert!(worst <= tolerance, "{dims:?} {spacing:?} {quality:?} at {azimuth}, {elevation}: {worst:e}");
        }
    }
}

/// Transmittance is a product: any order of factors gives the same, but for rounding of some hundred factors.
#[test]
fn the_alpha_picture_is_equal_in_all_48_orders() {
    let tolerance = 2e-5;
    for (name, dims) in [("gyroid", [40, 36, 32]), ("vessels", [48, 48, 48])] {
        let mut source = phantom(name, dims, SampleType::U8, [1.0, 1.0, 1.5]);
        let transfer = match name {
            "gyroid" => transfer(LAYERS),
            _ => TransferFunction::range(100.0, 255.0).unwrap().with_shaded(false),
        };
        let built = built(&mut *source, &fitting(transfer, 8));
        for fov in [None, Some(40.0)] {
            let camera = built.orbit(31.0, 24.0, fov, [96, 96]);
            let of = |order| {
                let settings = Settings::every_pixel([96, 96]).with_quality(Quality::Reference).with_order(order);
                built.frame(&camera, &settings)
            };
            let own = of(None);
            for order in parallel_orders() {
                let frame = of(Some(order));
                let worst = alphas(&own).zip(alphas(&frame)).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                assert!(worst <= tolerance, "{name} {fov:?} {order:?}: {worst:e}");
            }
        }
    }
}

#[test]
fn pictures_have_the_same_bits_for_any_threads_and_from_lanes_stored_or_derived() {
    for (path, transfer) in real_volumes().into_iter().take(4) {
        let (mut source, options) = (volume(&path), fitting(transfer, 8));
        let three = built(&mut *source, &options);
        source.rewind().unwrap();
        let one = built(&mut *source, &options.with_lane_count(1));
        let bytes = arena_bytes(&one.facts, &one.lanes, "{}");
        let derived = LaneSet::new(Arena::new(&bytes).unwrap(), None);
        for (azimuth, elevation, fov) in [(0.0, 0.0, None), (75.0, 10.0, None), (10.0, 80.0, Some(50.0))] {
            let camera = three.orbit(azimuth, elevation, fov, [160, 120]);
            let of = |lanes: &dyn Lanes, threads| {
                let settings = Settings::every_pixel([160, 120]).with_threads(threads);
                cpu::render(&Scene { lanes, ..three.scene() }, &camera, &settings).unwrap().0
            };
            let first = of(&three.lanes, 1);
            assert!(shows(&first), "{} shows nothing", path.display());
            for threads in [2, 3, 7] {
                assert!(of(&three.lanes, threads) == first, "{} with {threads} threads", path.display());
            }
            assert!(of(&derived, 2) == first, "{} from derived lanes", path.display());
        }
    }
}
