//! The renderer on the processor, judged by closed forms, by its plain twin, and by itself with other threads.

use adjsplat::arena::{Channels, Detail, Lane, Record, VisibleCodes};
use adjsplat::build::Built;
use adjsplat::classify::{Point, TransferFunction, normal};
use adjsplat::internals::RecordSet;
use adjsplat::splat::{
    Blending, Camera, ClipPlane, Code, Frame, KernelShape, Lanes, Mode, Orbit, Projection, Quality, Scene, Settings,
    Stats, StopRequest, cpu,
};
use adjsplat::traverse::{Sense, VoxelBox};
use adjsplat::volume::{Axis, Grid};
use adjsplat_tests::pictures::{apart, bits};
use adjsplat_tests::scenes::{CODES, Draw as _, LIT, PLAIN, at_least, packed, transfer};

/// Opacity per world length of 1, one colour.
fn constant(opacity: f64, colour: &str) -> TransferFunction {
    let text = format!(
        r#"{{"kind": "points", "points": [{{"value": 0, "colour": "{colour}", "opacity": {opacity}}}], "reference_length": 1, "shaded": false}}"#
    );
    transfer(&text)
}

fn ramp() -> TransferFunction {
    let colour = |text: &str| serde_json::from_str(&format!("\"{text}\"")).unwrap();
    let points = vec![
        Point { value: 0.0, colour: colour("#c03020"), opacity: 0.02 },
        Point { value: 120.0, colour: colour("#30a040"), opacity: 0.3 },
        Point { value: 255.0, colour: colour("#e0e8ff"), opacity: 1.0 },
    ];
    TransferFunction::points(points, vec![]).unwrap()
}

/// A lumpy shell with normals: about 12,000 voxels.
fn shell() -> Built {
    packed(Grid::new([48, 40, 44], [1.0, 1.2, 0.8]).unwrap(), LIT, ramp(), |[x, y, z]| {
        let d = [f64::from(x) - 23.5, f64::from(y) - 19.5, f64::from(z) - 21.5];
        let r = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
        let bumps = (f64::from(x) * 0.7).sin() + (f64::from(y) * 0.9).cos();
        ((12.0 + bumps)..18.0).contains(&r).then(|| Record {
            value: (x % 256 * 5 + y * 3 + z * 7) % 256,
            normal: u32::from(normal::encode8(d)),
            magnitude: 0,
            coverage: 0,
        })
    })
}

#[test]
fn a_slab_lets_through_what_beer_and_lambert_say() {
    // Quality, largest deviation of optical depth, deviation of its mean.
    for (quality, peak, mean) in [(Quality::Standard, 2.3e-4, 2e-5), (Quality::High, 2.3e-4, 2e-5)] {
        let mut found = [0.0f64; 2];
        for spacing in [[1.0, 1.0, 1.0], [1.0, 1.0, 8.0], [1.0, 1.0, 1000.0]] {
            for direction in [
                [0.0, 0.0, 1.0f64],
                [5.0f64.to_radians().tan(), 0.0, 1.0],
                [15.0f64.to_radians().tan(), 0.1, 1.0],
                [30.0f64.to_radians().tan(), 0.0, 1.0],
                [1.0, 0.0, 1.0],
                [1.0, 1.0, 1.0],
            ] {
                // Face on, whole numbers of pixels a voxel meet the lattice in the same few places all over: 64 meet the
                // spikes where cut-off edges cross, and of 7 or 10 the mean is of few places.
                for pixels in [64, 25, 10, 7] {
                    let apart = slab(quality, spacing, direction, pixels);
                    let is_within = apart[0] <= peak && apart[1] <= mean;
                    assert!(is_within, "{quality:?} {spacing:?} {direction:?} {pixels}: {apart:?}");
                    (0..2).for_each(|n| found[n] = found[n].max(apart[n]));
                }
            }
        }
        println!("{quality:?}: depths within {:.1e}, their means within {:.1e}", found[0], found[1]);
    }
}

/// A slab of 12 layers across z, seen through its middle along `direction` (index space) with `pixels` a voxel: largest
/// deviation of its optical depth, and that of the mean, relative.
fn slab(quality: Quality, spacing: [f64; 3], direction: [f64; 3], pixels: u32) -> [f64; 2] {
    let layers = 12;
    // Wide enough that no border comes near the central ray.
    let side = 64;
    let opacity = 1.0 - (-0.5 / (12.0 * spacing[2])).exp();
    let model = packed(Grid::new([side, side, layers], spacing).unwrap(), PLAIN, constant(opacity, "#ffffff"), |_| {
        Some(Record::default())
    });
    let world: [f64; 3] = std::array::from_fn(|a| direction[a] * spacing[a]);
    let length = world.iter().map(|c| c * c).sum::<f64>().sqrt();
    let target = model.surround().centre;
    let position = std::array::from_fn(|a| target[a] - world[a] / length * 50_000.0);
    // 6 voxels of the finer axes. The lattice is commensurate with the pixels, so a coarser picture
    // would sample each kernel's cut-off edge in the same few places.
    let camera = Camera::new(position, target, [0.0, 1.0, 0.0], Projection::Parallel { height: 6.0 }).unwrap();
    let mut settings = Settings::every_pixel([6 * pixels; 2]);
    settings.quality = quality;
    settings.termination = Some(0.0);
    let (frame, _) = model.render(&camera, &settings);
    // Path through the slab: cosine in world space.
    let path = layers as f64 * spacing[2] * length / world[2];
    let want = -(1.0 - opacity).ln() * path;
    let depths: Vec<f64> = frame.pixels().chunks_exact(4).map(|p| -(1.0 - f64::from(p[3])).ln()).collect();
    let average = depths.iter().sum::<f64>() / depths.len() as f64 / want - 1.0;
    let worst = depths.iter().map(|d| (d / want - 1.0).abs()).fold(0.0, f64::max);
    [worst, average.abs()]
}

#[test]
fn one_splat_sums_to_its_optical_depth() {
    let model = packed(Grid::new([1, 1, 1], [1.0, 1.5, 0.5]).unwrap(), PLAIN, constant(0.3, "#ffffff"), |_| {
        Some(Record::default())
    });
    let extinction = -(0.7f64).ln();
    let volume = 0.75;
    // From a hundredth of a pixel per voxel to a splat as wide as the picture.
    for height in [1e4, 400.0, 40.0, 8.0] {
        for (azimuth, elevation, shift) in [(0.0, 0.0, 0.0), (33.0, 21.0, 0.37), (90.0, -65.0, 0.5)] {
            let (sin_a, cos_a) = f64::to_radians(azimuth).sin_cos();
            let (sin_e, cos_e) = f64::to_radians(elevation).sin_cos();
            let target = [shift * height / 100.0, 0.0, 0.0];
            let position = [target[0] - sin_a * cos_e, cos_a * cos_e, sin_e];
            let projection = Projection::Parallel { height };
            let camera = Camera::new(position, target, [0.0, 0.0, 1.0], projection).unwrap();
            let mut settings = Settings::every_pixel([101, 101]);
            settings.quality = Quality::Reference;
            let (frame, _) = model.render(&camera, &settings);
            // Alpha alone would round away the depth of tiny splats: X-ray mode shows 1 - exp(-sum).
            settings.mode = Mode::Additive;
            let (sum, _) = model.render(&camera, &settings);
            let pixel_area = (height / 101.0).powi(2);
            for (frame, tolerance) in [(&frame, 2e-2), (&sum, 4e-3)] {
                let total: f64 = frame.pixels().chunks_exact(4).map(|p| -(-f64::from(p[3])).ln_1p()).sum();
                let ratio = total * pixel_area / (extinction * volume);
                assert!((ratio - 1.0).abs() < tolerance, "height {height}, azimuth {azimuth}: {ratio}");
            }
        }
    }
}

#[test]
fn fast_code_equals_its_plain_twin_bit_for_bit() {
    let model = shell();
    let eye_inside =
        Camera::new([23.0, 19.0, 21.0], [40.0, 30.0, 25.0], [0.0, 0.0, 1.0], Projection::Perspective { fov: 80.0 });
    let views = [
        (model.orbit(20.0, 15.0, None, [97, 61]), [97, 61]),
        (model.orbit(200.0, -70.0, None, [400, 300]), [400, 300]),
        (model.orbit(75.0, 35.0, Some(40.0), [130, 170]), [130, 170]),
        (eye_inside.unwrap(), [90, 90]),
    ];
    let crop = Some(VoxelBox { low: [5, 9, 3], high: [40, 33, 21] });
    let clip = Some(ClipPlane { point: [20.0, 22.0, 17.0], normal: [2.0, -1.0, 3.0] });
    for (camera, size) in views {
        for mode in [Mode::Composite, Mode::Maximum, Mode::Additive] {
            for (quality, sense, blending, crop, clip) in [
                (Quality::Standard, Sense::FrontToBack, Blending::Exponential, None, clip),
                (Quality::Draft, Sense::FrontToBack, Blending::Exponential, crop, None),
                (Quality::High, Sense::BackToFront, Blending::Exponential, None, None),
                (Quality::Standard, Sense::FrontToBack, Blending::Linear, crop, clip),
                (Quality::Standard, Sense::FrontToBack, Blending::Sheets, crop, None),
                (Quality::Reference, Sense::FrontToBack, Blending::Sheets, None, None),
            ] {
                if mode != Mode::Composite && blending != Blending::Exponential {
                    continue;
                }
                let settings = Settings::every_pixel(size)
                    .with_quality(quality)
                    .with_sense(sense)
                    .with_blending(blending)
                    .with_crop(crop)
                    .with_clip(clip)
                    .with_mode(mode);
                let (want, plain) = model.render(&camera, &settings.clone().with_code(Code::Plain));
                assert!(plain.splats_drawn > 100, "{plain:?}");
                for (code, threads) in [
                    (Code::Best, 1),
                    (Code::Avx2, 1),
                    (Code::Portable, 1),
                    (Code::Best, 2),
                    (Code::Best, 3),
                    (Code::Portable, 7),
                ] {
                    let (got, stats) = model.render(&camera, &settings.clone().with_code(code).with_threads(threads));
                    let same = bits(&got) == bits(&want);
                    assert!(same, "{code:?} {threads} {mode:?} {quality:?} {sense:?} {blending:?}: {}", {
                        apart(&got, &want)
                    });
                    // Sheets are for studies: the plain twin draws them.
                    assert_eq!(stats.bands, if blending == Blending::Sheets { 1 } else { threads });
                }
            }
        }
    }
}

#[test]
fn both_senses_and_any_termination_give_one_picture() {
    let model = shell();
    let camera = model.orbit(20.0, 15.0, None, [160, 120]);
    let settings = Settings::every_pixel([160, 120]).with_quality(Quality::Reference);
    let (front, all) = model.render(&camera, &settings);
    let (back, _) = model.render(&camera, &settings.clone().with_sense(Sense::BackToFront));
    assert!(apart(&front, &back) < 2e-5, "{}", apart(&front, &back));
    for termination in [0.5f32, 0.1, 0.01, 1e-3] {
        let (early, stats) = model.render(&camera, &settings.clone().with_termination(termination));
        let difference = apart(&front, &early);
        // Highlights go a little above 1.
        println!("rays that end at {termination}: off by {difference:.1e}");
        assert!(difference <= f64::from(termination) * 1.2 + 1e-6, "{termination}: {difference}");
        assert!(stats.splats_drawn < all.splats_drawn || termination < 0.1, "{termination}: {stats:?}");
    }
}

/// Depths of a slice add up in any order: what a sheet changes is which colour is in front.
#[test]
fn sheets_are_as_opaque_as_their_splats() {
    let model = shell();
    let settings = Settings::every_pixel([160, 120]).with_termination(0.0);
    for camera in [model.orbit(20.0, 15.0, None, [160, 120]), model.orbit(140.0, -50.0, Some(50.0), [160, 120])] {
        let (splats, _) = model.render(&camera, &settings);
        let (sheets, _) = model.render(&camera, &settings.clone().with_blending(Blending::Sheets));
        let pairs = splats.pixels().chunks_exact(4).zip(sheets.pixels().chunks_exact(4));
        // Some hundred roundings of a transmittance.
        assert!(pairs.clone().all(|(a, b)| (a[3] - b[3]).abs() < 1e-5));
        let colours =
            pairs.flat_map(|(a, b)| a[..3].iter().zip(&b[..3])).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        // Neighbours in a slice differ by a fifth in colour at most, and share what a pixel shows.
        assert!((1e-3..0.2).contains(&colours), "{colours}");
    }
}

#[test]
fn one_colour_stays_one_colour() {
    let model = packed(Grid::new([20, 20, 20], [1.0; 3]).unwrap(), PLAIN, constant(0.2, "#8040c0"), |[x, y, z]| {
        ((x + y + z) % 3 != 0).then(Record::default)
    });
    let [red, green, blue] = model.transfer.colour(0.0);
    let camera = model.orbit(31.0, 17.0, None, [80, 80]);
    let draw = |blending: Blending| model.render(&camera, &Settings::every_pixel([80, 80]).with_blending(blending)).0;
    let frame = draw(Blending::Exponential);
    for frame in [&frame, &draw(Blending::Linear), &draw(Blending::Sheets)] {
        for pixel in frame.pixels().chunks_exact(4) {
            for (got, want) in pixel.iter().zip([red, green, blue]) {
                assert!((got - want * pixel[3]).abs() < 2e-6, "{pixel:?}");
            }
        }
    }
    // Over black and white the difference is the transmittance.
    let (mut black, mut white) = (frame.clone(), frame.clone());
    black.over([0.0; 3]);
    white.over([1.0; 3]);
    let pairs = black.pixels().chunks_exact(4).zip(white.pixels().chunks_exact(4)).zip(frame.pixels().chunks_exact(4));
    for ((black, white), pixel) in pairs {
        assert!((white[0] - black[0] - (1.0 - pixel[3])).abs() < 1e-6);
    }
}

/// A file may be drawn with a narrower function than it was built with. At `standard` and `draft` a parallel view drew all its
/// voxels if those shown have one opacity, and a maximum took the hidden ones into account.
#[test]
fn voxels_that_a_narrower_function_hides_are_not_drawn() {
    let dims = [24, 20, 22];
    let value = |[x, y, z]: [u16; 3]| {
        let is_corner = x % 23 == 0 && y % 19 == 0 && z % 21 == 0;
        if is_corner { 200 } else { 40 + (x * 5 + y * 7 + z * 3) % 160 }
    };
    // The same voxels with hidden ones among them, and alone.
    let [all, shown] = [0, 150].map(|least| {
        packed(Grid::new(dims, [1.0; 3]).unwrap(), PLAIN, at_least(150.0), |at| {
            (value(at) >= least).then_some(Record { value: value(at), ..Record::default() })
        })
    });
    assert!(all.facts.visible_voxels > 2 * shown.facts.visible_voxels);
    let size = [64, 60];
    for mode in [Mode::Composite, Mode::Additive, Mode::Maximum, Mode::MaximumGrey] {
        for fov in [None, Some(40.0)] {
            let camera = shown.orbit(35.0, 25.0, fov, size);
            for quality in Quality::ALL {
                let settings = Settings::new(size).with_mode(mode).with_exposure(0.5).with_quality(quality);
                let [all, shown] = [&all, &shown].map(|model| model.frame(&camera, &settings));
                assert!(bits(&all) == bits(&shown), "{mode:?} {fov:?} {quality:?}");
            }
        }
    }
}

/// Lanes that say what they were built with.
struct BuiltWith<'a>(&'a Built, TransferFunction);

impl Lanes for BuiltWith<'_> {
    fn lane(&self, axis: Axis) -> adjsplat::Result<Lane<'_>> {
        self.0.lanes.lane(axis)
    }

    fn detail(&self) -> Detail<'_> {
        Detail { build_function: Some(&self.1), ..Detail::default() }
    }
}

#[test]
fn voxels_that_a_narrower_function_hides_are_not_visited() {
    let steep = r##"{"kind": "points", "points": [{"value": 0, "colour": "#ffffff", "opacity": 0}, {"value": 200,
        "colour": "#ff8000", "opacity": 0.7}], "gradient": [{"magnitude": 0.3, "factor": 0}, {"magnitude": 0.6, "factor": 1}]}"##;
    let islands = r##"{"kind": "points", "points": [{"value": 60, "colour": "#ffffff", "opacity": 0}, {"value": 90,
        "colour": "#ff8000", "opacity": 0.7}, {"value": 120, "colour": "#ffffff", "opacity": 0}, {"value": 180,
        "colour": "#ffffff", "opacity": 0}, {"value": 199, "colour": "#0080ff", "opacity": 1}]}"##;
    for (value_bits, function) in [8, 16].into_iter().flat_map(|bits| [steep, islands].map(|function| (bits, function)))
    {
        let channels = Channels { value_bits, magnitude_bits: 8, ..LIT };
        let codes = VisibleCodes::new(&transfer(function), channels, &CODES, 0.0).unwrap();
        let record = |[x, y, z]: [u16; 3]| {
            // All see the same corners, and the same largest value.
            let is_corner = x % 23 == 0 && y % 19 == 0 && z % 21 == 0;
            let [value, magnitude] = [30 + (x * 5 + y * 7 + z * 3) % 170, (x * 31 + y * 17 + z * 41) % 256];
            let [value, magnitude] = if is_corner { [200, 255] } else { [value, magnitude] };
            Record { value, magnitude: magnitude.to_le_bytes()[0], ..Record::default() }
        };
        let is_shown = |record: &Record| codes.has(record.value, record.magnitude);
        let grid = || Grid::new([24, 20, 22], [1.0, 1.0, 1.5]).unwrap();
        let all = packed(grid(), channels, transfer(function), |at| Some(record(at)));
        let alone = packed(grid(), channels, transfer(function), |at| Some(record(at)).filter(is_shown));
        let lanes = BuiltWith(&all, at_least(0.0));
        let size = [64, 60];
        for mode in [Mode::Composite, Mode::Additive, Mode::Maximum, Mode::MaximumGrey] {
            for (fov, quality) in
                [(None, Quality::Standard), (Some(40.0), Quality::Standard), (Some(40.0), Quality::High)]
            {
                let camera = alone.orbit(35.0, 25.0, fov, size);
                let settings = Settings::new(size).with_mode(mode).with_exposure(0.5).with_quality(quality);
                let scene = Scene { lanes: &lanes, ..all.scene() };
                let (narrowed, work) = cpu::render(&scene, &camera, &settings).unwrap();
                let (wanted, least) = alone.render(&camera, &settings);
                let what = format!("{value_bits} bits, {mode:?}, {fov:?}, {quality:?}");
                assert!(bits(&narrowed) == bits(&wanted), "{what}");
                // Which voxels the walk reaches depends on boxes of tiles, which are larger with the hidden voxels.
                let visited = |stats: &Stats| stats.splats_drawn + stats.splats_skipped;
                let is_known = value_bits == 8 || function == islands;
                assert!(!is_known || visited(&work) <= visited(&least) * 11 / 10, "{what}: {work:?} {least:?}");
            }
        }
    }
}

#[test]
fn a_requested_stop_ends_drawing() {
    let model = shell();
    let (stop, camera) = (StopRequest::default(), model.orbit(10.0, 20.0, Some(30.0), [40, 40]));
    for mode in [Mode::Composite, Mode::Additive, Mode::Maximum] {
        for (quality, code) in
            [(Quality::Standard, Code::Best), (Quality::High, Code::Best), (Quality::Standard, Code::Plain)]
        {
            let settings = Settings::new([40, 40]).with_mode(mode).with_quality(quality).with_code(code);
            let stopping =
                |stop: &StopRequest| cpu::render(&model.scene(), &camera, &settings.clone().with_stop(stop.clone()));
            let (frame, _) = stopping(&stop).unwrap();
            assert!(bits(&frame) == bits(&model.render(&camera, &settings).0));
            let made = StopRequest::default();
            made.clone().make();
            assert!(matches!(stopping(&made), Err(adjsplat::Error::Interrupted)), "{mode:?} {quality:?} {code:?}");
        }
    }
    // Marks that are not complete would pass for those of hidden voxels.
    let made = StopRequest::default();
    made.make();
    let records = RecordSet::new(model.lanes[0].steps.len()).unwrap();
    let marking = cpu::VisibleRecords { records: &records, first: 0 };
    let marked = cpu::mark_visible(&model.scene(), &camera, &Settings::new([40, 40]).with_stop(made), marking);
    assert!(matches!(marked, Err(adjsplat::Error::Interrupted)));
}

#[test]
fn an_opaque_voxel_is_finite_and_hides_what_is_behind() {
    let model =
        packed(Grid::new([3, 9, 3], [1.0; 3]).unwrap(), PLAIN, constant(1.0, "#ffffff"), |_| Some(Record::default()));
    let camera = model.orbit(0.0, 0.0, None, [33, 33]);
    let (frame, _) = model.render(&camera, &Settings::every_pixel([33, 33]).with_quality(Quality::Reference));
    let centre = frame.pixel(16, 16);
    assert!(centre[3] > 0.999_999 && centre.iter().all(|c| c.is_finite()), "{centre:?}");
}

#[test]
fn the_picture_is_not_mirrored() {
    // Bright at +x, +z; seen from +y: +x is at the left, +z at the top.
    let model = packed(Grid::new([9, 9, 9], [1.0; 3]).unwrap(), PLAIN, constant(0.9, "#ffffff"), |[x, _, z]| {
        (x > 5 && z > 5).then(Record::default)
    });
    let camera = model.orbit(0.0, 0.0, None, [40, 40]);
    let (frame, _) = model.render(&camera, &Settings::every_pixel([40, 40]));
    let mass = |columns: std::ops::Range<u32>, rows: std::ops::Range<u32>| -> f32 {
        rows.flat_map(|row| columns.clone().map(move |column| (column, row))).map(|(c, r)| frame.pixel(c, r)[3]).sum()
    };
    let (left_top, all) = (mass(0..20, 0..20), mass(0..40, 0..40));
    assert!(left_top > 0.98 * all && all > 1.0, "{left_top} of {all}");
    // Azimuth turns counter-clockwise seen from above: at 90 degrees the eye is at -x and +y is at the left.
    let camera = model.orbit(90.0, 0.0, None, [40, 40]);
    assert!(camera.position()[0] < -1.0, "{:?}", camera.position());
}

#[test]
fn whole_turns_come_back_bit_equal() {
    let model = shell();
    let settings = Settings::every_pixel([40, 40]);
    let pictures = [0.0, 360.0, -720.0]
        .map(|azimuth| bits(&model.render(&model.orbit(azimuth, 0.0, Some(30.0), [40, 40]), &settings).0));
    assert!(pictures[0] == pictures[1] && pictures[0] == pictures[2]);
}

#[test]
fn far_away_perspective_is_parallel() {
    let model = shell();
    let target = model.surround().centre;
    let distance = 1e9;
    let position = [target[0] + 0.317 * distance, target[1] + distance, target[2] + 0.229 * distance];
    let far = (0.317f64 * 0.317 + 1.0 + 0.229 * 0.229).sqrt() * distance;
    let height = 60.0;
    let fov = 2.0 * (height / 2.0 / far).atan().to_degrees();
    let up = [0.0, 0.0, 1.0];
    let settings = Settings::every_pixel([90, 90]).with_quality(Quality::Reference);
    let camera = Camera::new(position, target, up, Projection::Perspective { fov }).unwrap();
    let (far, _) = model.render(&camera, &settings);
    let camera = Camera::new(position, target, up, Projection::Parallel { height }).unwrap();
    let (parallel, _) = model.render(&camera, &settings);
    let difference = apart(&far, &parallel);
    assert!(difference < 2e-3, "{difference}");
}

#[test]
fn extremes_end_in_finite_pictures_or_errors() {
    let model = shell();
    let finite = |frame: &Frame| frame.pixels().iter().all(|value| value.is_finite() && *value >= -1e-3);
    let target = model.surround().centre;
    for zoom in [1e-9, 1e-3, 1e3, 1e6, 1e9, 1e12] {
        for fov in [None, Some(1e-6), Some(40.0), Some(179.9)] {
            let orbit = Orbit { azimuth: 33.0, elevation: 10.0, zoom, fov, ..Orbit::default() };
            let camera = model.camera(orbit, [33, 17]);
            let (frame, _) = model.render(&camera, &Settings::every_pixel([33, 17]));
            assert!(finite(&frame), "zoom {zoom}, fov {fov:?}");
        }
    }
    // Eyes on a voxel, on a grid plane, in the shell; looking away.
    for position in [[23.0, 19.2, 16.0], [0.0, 0.0, 0.0], [23.0, 3.6, 16.0], [1e9, 0.0, 0.0]] {
        for target in [target, [position[0] - 5.0, position[1] + 1.0, position[2] - 77.0]] {
            let projection = Projection::Perspective { fov: 60.0 };
            let camera = Camera::new(position, target, [0.0, 0.0, 1.0], projection).unwrap();
            assert!(finite(&model.render(&camera, &Settings::every_pixel([33, 17])).0), "{position:?}");
        }
    }
    // Up along the view falls back.
    let projection = Projection::Parallel { height: 50.0 };
    let camera = Camera::new([target[0], target[1], 99.0], target, [0.0, 0.0, 1.0], projection).unwrap();
    let (frame, stats) = model.render(&camera, &Settings::every_pixel([64, 1]));
    assert!(finite(&frame) && stats.splats_drawn > 0);
    // All voxels behind the eye: nothing.
    let projection = Projection::Perspective { fov: 30.0 };
    let camera = Camera::new([0.0, 0.0, 200.0], [0.0, 0.0, 300.0], [0.0, 1.0, 0.0], projection).unwrap();
    let (frame, stats) = model.render(&camera, &Settings::every_pixel([10, 10]));
    assert!(stats.splats_drawn == 0 && frame.pixels().iter().all(|value| *value == 0.0));
    let refused = |settings: Settings| cpu::render(&model.scene(), &camera, &settings).unwrap_err().to_string();
    assert!(refused(Settings::every_pixel([0, 5])).contains("picture size"));
    assert!(refused(Settings::every_pixel([16_385, 5])).contains("limit is 16384"));
    assert!(refused(Settings::every_pixel([5, 5]).with_threads(0)).contains("threads"));
    assert!(refused(Settings::every_pixel([5, 5]).with_termination(f32::NAN)).contains("termination"));
    assert!(refused(Settings::every_pixel([5, 5]).with_near(0.0)).contains("near"));
    let kernel = Some(KernelShape { sigma: f32::NAN, radius: 2.0 });
    assert!(refused(Settings::every_pixel([5, 5]).with_kernel(kernel)).contains("kernel"));
}

#[test]
fn cameras_that_cannot_be_are_refused() {
    let perspective = |fov| Projection::Perspective { fov };
    let parallel = |height| Projection::Parallel { height };
    let good = ([1.0, 2.0, 3.0], [0.0; 3], [0.0, 0.0, 1.0]);
    for (position, target, up, projection) in [
        ([f64::NAN, 0.0, 0.0], good.1, good.2, perspective(30.0)),
        (good.0, good.0, good.2, perspective(30.0)),
        (good.0, good.1, [0.0; 3], perspective(30.0)),
        (good.0, good.1, good.2, perspective(0.0)),
        (good.0, good.1, good.2, perspective(180.0)),
        (good.0, good.1, good.2, perspective(f64::NAN)),
        (good.0, good.1, good.2, parallel(0.0)),
        (good.0, good.1, good.2, parallel(f64::INFINITY)),
    ] {
        let error = Camera::new(position, target, up, projection).unwrap_err();
        assert!(error.to_string().starts_with("camera "), "{error}");
    }
    let text = r#"{"position": [1, 2, 3], "target": [0, 0, 0], "up": [0, 0, 1], "fov": 30}"#;
    let camera: Camera = serde_json::from_str(text).unwrap();
    assert_eq!(camera, serde_json::from_str(&serde_json::to_string(&camera).unwrap()).unwrap());
    assert!(serde_json::from_str::<Camera>(&text.replace(", \"fov\": 30", "")).is_err());
    assert!(serde_json::from_str::<Camera>(&text.replace("30", "30, \"height\": 2")).is_err());
}

#[test]
fn a_crop_shows_what_a_smaller_volume_would() {
    let model = shell();
    let crop = VoxelBox { low: [10, 0, 12], high: [37, 25, 30] };
    let whole = shell();
    let inside = |x: u16, y: u16, z: u16| {
        [x, y, z].iter().zip(crop.low.iter().zip(crop.high)).all(|(at, (low, high))| (*low..=high).contains(at))
    };
    let lane = whole.lanes[0].view();
    let mut records = std::collections::HashMap::new();
    for line in lane.lines() {
        for (x, record) in lane.line_voxels(line.records.clone()) {
            let codes =
                Record { value: lane.value_code(record), normal: lane.normal_code(record), magnitude: 0, coverage: 0 };
            records.insert([x, line.u, line.v].map(|c| u16::try_from(c).unwrap()), codes);
        }
    }
    let small = packed(Grid::new([48, 40, 44], [1.0, 1.2, 0.8]).unwrap(), LIT, ramp(), |[x, y, z]| {
        records.get(&[x, y, z]).copied().filter(|_| inside(x, y, z))
    });
    let camera = model.orbit(-40.0, 25.0, Some(50.0), [120, 90]);
    let settings = Settings::every_pixel([120, 90]);
    let (cropped, _) = model.render(&camera, &settings.clone().with_crop(crop));
    let (want, _) = small.render(&camera, &settings);
    assert!(bits(&cropped) == bits(&want), "{}", apart(&cropped, &want));
}

#[test]
fn a_clip_plane_shows_what_a_volume_without_the_voxels_behind_it_would() {
    let model = shell();
    let lane = model.lanes[0].view();
    let mut records = std::collections::HashMap::new();
    for line in lane.lines() {
        for (x, record) in lane.line_voxels(line.records.clone()) {
            let codes =
                Record { value: lane.value_code(record), normal: lane.normal_code(record), magnitude: 0, coverage: 0 };
            records.insert([x, line.u, line.v].map(|c| u16::try_from(c).unwrap()), codes);
        }
    }
    // Across an axis, through voxels; the other way; oblique; nothing in front; everything in front.
    let planes = [
        ([0.0, 24.0, 0.0], [0.0, 5.0, 0.0]),
        ([0.0, 24.0, 0.0], [0.0, -1e-9, 0.0]),
        ([20.0, 22.0, 17.0], [2.0, -1.0, 3.0]),
        ([1e9, 0.0, 0.0], [1.0, 0.0, 0.0]),
        ([-1e9, 0.0, 0.0], [1.0, 1.0, 0.0]),
    ];
    let mut drawn = Vec::new();
    for (point, normal) in planes {
        let in_front = |voxel: [u16; 3]| {
            let at = [0, 1, 2].map(|a| f64::from(voxel[a]) * [1.0, 1.2, 0.8][a] - point[a]);
            (0..3).map(|a| at[a] * normal[a]).sum::<f64>() >= -1e-6 * normal.map(f64::abs).iter().sum::<f64>()
        };
        let small = packed(Grid::new([48, 40, 44], [1.0, 1.2, 0.8]).unwrap(), LIT, ramp(), |voxel| {
            records.get(&voxel).copied().filter(|_| in_front(voxel))
        });
        for fov in [None, Some(50.0)] {
            let camera = model.orbit(-40.0, 25.0, fov, [120, 90]);
            let settings = Settings::every_pixel([120, 90]);
            let clipped = model.render(&camera, &settings.clone().with_clip(ClipPlane { point, normal }));
            let want = small.render(&camera, &settings);
            assert!(bits(&clipped.0) == bits(&want.0), "{point:?} {fov:?}: {}", apart(&clipped.0, &want.0));
            drawn.push(clipped.1.splats_drawn);
        }
    }
    assert!(drawn[..6].iter().all(|count| *count > 0) && drawn[6] == 0 && drawn[8] > drawn[4], "{drawn:?}");
}

/// Tiles of 8 x 8 lines reach beyond such grids, where products of indices overflowed: pictures were empty.
#[test]
fn a_clip_plane_in_front_of_a_thin_volume_hides_nothing() {
    for dims in [[3, 20, 17], [20, 2, 17], [20, 17, 1], [3, 3, 3]] {
        let model = packed(Grid::new(dims, [1.0; 3]).unwrap(), LIT, ramp(), |[x, y, z]| {
            Some(Record { value: 100 + x + 3 * y + 5 * z, normal: 0, magnitude: 0, coverage: 0 })
        });
        for (azimuth, elevation) in [(20.0, 10.0), (70.0, -20.0), (200.0, 60.0), (-70.0, 75.0)] {
            let camera = model.orbit(azimuth, elevation, None, [24, 20]);
            let settings = Settings::every_pixel([24, 20]);
            let (whole, stats) = model.render(&camera, &settings);
            for normal in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.1, 2.0]] {
                let point = normal.map(|n| -0.6 * n);
                let (clipped, clipped_stats) =
                    model.render(&camera, &settings.clone().with_clip(ClipPlane { point, normal }));
                assert_eq!(stats.splats_drawn, clipped_stats.splats_drawn, "{dims:?} {azimuth} {elevation} {normal:?}");
                assert!(bits(&whole) == bits(&clipped), "{dims:?} {azimuth} {elevation} {normal:?}");
            }
        }
    }
}

#[test]
fn a_clip_plane_without_a_direction_is_refused() {
    let settings = |normal| Settings::new([8, 8]).with_clip(ClipPlane { point: [0.0; 3], normal });
    for normal in [[0.0; 3], [f64::NAN, 0.0, 1.0], [f64::INFINITY, 0.0, 0.0]] {
        let error = settings(normal).check().unwrap_err();
        assert_eq!(error.to_string(), "clip plane: must have a finite point and a finite normal that is not 0");
    }
}

#[test]
fn pictures_of_one_row_and_one_column_work() {
    let model = shell();
    for size in [[1, 1], [1, 65], [65, 1], [2048, 2], [3, 999]] {
        let camera = model.orbit(10.0, 10.0, None, size);
        for threads in [1, 4] {
            let (frame, stats) = model.render(&camera, &Settings::every_pixel(size).with_threads(threads));
            assert_eq!(frame.size(), size);
            assert!(stats.splats_drawn > 0 && frame.pixels().iter().all(|value| value.is_finite()));
        }
    }
}

#[test]
fn a_normal_and_its_opposite_look_the_same() {
    let lit = |sign: f64| {
        let transfer = ramp();
        packed(Grid::new([12, 12, 12], [1.0; 3]).unwrap(), LIT, transfer, move |[x, y, z]| {
            let gradient = [f64::from(x) - 5.2, f64::from(y) - 5.7, f64::from(z) - 4.1].map(|c| sign * c);
            Some(Record { value: 100, normal: u32::from(normal::encode8(gradient)), magnitude: 0, coverage: 0 })
        })
    };
    let (one, other) = (lit(1.0), lit(-1.0));
    for fov in [None, Some(50.0)] {
        let camera = one.orbit(30.0, 20.0, fov, [50, 50]);
        let pictures = [&one, &other].map(|model| model.render(&camera, &Settings::every_pixel([50, 50])).0);
        assert!(apart(&pictures[0], &pictures[1]) < 2e-2);
    }
}
