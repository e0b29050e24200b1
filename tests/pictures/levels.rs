//! Pictures of levels of detail, beside those of the voxels themselves.

use adjsplat::arena::layout::LevelLimits;
use adjsplat::arena::{Detail, Lane};
use adjsplat::classify::TransferFunction;
use adjsplat::internals::{LevelPart, level_parts};
use adjsplat::splat::{Camera, Code, Frame, Lanes, Mode, Projection, Quality, Scene, Settings};
use adjsplat::volume::{Axis, SampleType};
use adjsplat::{Build, Model};
use adjsplat_tests::pictures::{alphas, decibels};
use adjsplat_tests::real_volume;
use adjsplat_tests::scenes::{at_least, options, phantom, red_to_blue, transfer, volume};

/// A phantom with this number of `levels`, whose voxels are all as opaque as `opacity`.
fn model(name: &str, dims: [u64; 3], spacing: [f64; 3], levels: u8, opacity: f64) -> Model {
    let options = options(red_to_blue(name, [opacity; 2]));
    let mut source = phantom(name, dims, SampleType::U8, spacing);
    Build::new(options).with_levels(levels).run(&mut *source).unwrap_or_else(|error| panic!("{error}"))
}

/// A camera that looks at the middle of the grid from a direction in degrees.
fn camera(model: &Model, [azimuth, elevation]: [f64; 2], distance: f64, projection: Projection) -> Camera {
    let grid = model.grid();
    let centre = [0, 1, 2].map(|a| grid.origin[a] + grid.spacing[a] * f64::from(grid.dims[a] - 1) / 2.0);
    let ((sin, cos), (rise, level)) = (azimuth.to_radians().sin_cos(), elevation.to_radians().sin_cos());
    let toward = [sin * level, -cos * level, rise];
    let eye = [0, 1, 2].map(|a| centre[a] + distance * toward[a]);
    let up = if elevation == 90.0 { [0.0, 1.0, 0.0] } else { [0.0, 0.0, 1.0] };
    Camera::new(eye, centre, up, projection).unwrap()
}

/// A parallel view with `pixels` a voxel of spacing 1.
fn parallel(model: &Model, view: [f64; 2], pixels: f64, size: [u32; 2]) -> Camera {
    camera(model, view, 1000.0, Projection::Parallel { height: f64::from(size[1]) / pixels })
}

const VIEWS: [[f64; 2]; 4] = [[0.0, 0.0], [35.0, 20.0], [90.0, 0.0], [0.0, 90.0]];

/// Pixels with no sample above this are empty.
const EMPTY: f64 = 1.0 / 255.0;

fn draw(model: &Model, camera: &Camera, settings: &Settings) -> Frame {
    model.render(camera, settings).unwrap_or_else(|error| panic!("{error}"))
}

/// The voxels themselves, with several samples a pixel, filtered by a Gaussian.
fn truth(model: &Model, camera: &Camera, settings: &Settings) -> Frame {
    let mut settings = settings.clone().with_level(0);
    settings.quality = Quality::High;
    draw(model, camera, &settings)
}

#[test]
fn the_plain_twin_and_all_machine_code_draw_the_same_bits_of_a_level() {
    let size = [46, 40];
    for (spacing, opacity) in [([1.0; 3], 0.6), ([1.0, 1.0, 2.2], 0.6), ([1.0; 3], 1.0)] {
        let model = model("gyroid", [48, 40, 44], spacing, 3, opacity);
        assert_eq!(model.detail().levels.len(), 3);
        for level in 1..=3 {
            for quality in [Quality::Draft, Quality::Standard, Quality::High] {
                // Along an axis a lattice has a whole number of pixels a voxel, elsewhere any number.
                let parallel = Projection::Parallel { height: 90.0 };
                let oblique = [35.0, 20.0];
                let views = [
                    (oblique, parallel),
                    ([90.0, 0.0], parallel),
                    // Opaque kernels are so wide here that their weights are not computed beforehand.
                    (oblique, Projection::Parallel { height: 12.0 }),
                    (oblique, Projection::Perspective { fov: 50.0 }),
                ];
                for (direction, projection) in views {
                    let camera = camera(&model, direction, 75.0, projection);
                    let mut settings = Settings::new(size).with_level(level).with_threads(1);
                    settings.quality = quality;
                    let frame = draw(&model, &camera, &settings);
                    let what = format!("{spacing:?} level {level} {quality:?} {direction:?} {projection:?}");
                    assert!(frame.pixels().iter().any(|sample| *sample > 0.1), "{what} shows nothing");
                    for code in [Code::Plain, Code::Portable, Code::Avx2] {
                        assert!(frame == draw(&model, &camera, &settings.clone().with_code(code)), "{what} {code:?}");
                    }
                    for threads in [2, 3, 7] {
                        let settings = settings.clone().with_threads(threads);
                        assert!(frame == draw(&model, &camera, &settings), "{what}, {threads} threads");
                    }
                }
            }
        }
    }
}

#[test]
fn levels_leave_the_bits_of_pictures_whose_voxels_are_pixels_alone() {
    let with = model("shells", [40, 36, 38], [1.0; 3], 2, 0.8);
    let without = model("shells", [40, 36, 38], [1.0; 3], 0, 0.8);
    let size = [60, 52];
    for quality in Quality::ALL {
        for pixels in [1.0, 1.7] {
            for view in VIEWS {
                let mut settings = Settings::new(size);
                settings.quality = quality;
                let camera = parallel(&with, view, pixels, size);
                assert!(draw(&with, &camera, &settings) == draw(&without, &camera, &settings), "{quality:?} {view:?}");
            }
        }
    }
}

/// A ball whose surface is that of stairs, as masks have; it has one colour.
fn mask_of_a_ball() -> Model {
    let at = |index: u32| [index % 96, index / 96 % 96, index / 9_216].map(|c| f64::from(c) - 47.3);
    let samples = (0..96u32.pow(3)).map(|index| u8::from(at(index).iter().map(|c| c * c).sum::<f64>() < 1_800.0));
    let ball = adjsplat::Volume::new([96; 3], samples.collect::<Vec<u8>>()).unwrap();
    Build::new(TransferFunction::range(1.0, 1.0).unwrap()).with_levels(3).run(&ball).unwrap()
}

/// A level is drawn only where it was measured to be good; these views are others than those that were measured. Some of these volumes
/// are hard: thin sheets, waves as fine as the grid, a mask.
#[test]
fn pictures_of_small_voxels_keep_the_accuracy_of_their_quality_on_any_volume() {
    let model_of = |name, low| {
        let mut source = phantom(name, [128; 3], SampleType::U8, [1.0; 3]);
        Build::new(TransferFunction::range(low, 255.0).unwrap()).with_levels(3).run(&mut *source).unwrap()
    };
    let size = [72, 68];
    for (name, model, fewest) in [
        ("waves", model_of("marschner-lobb", 128.0), 20),
        ("shells", model_of("shells", 191.0), 20),
        ("vessels", model_of("vessels", 92.0), 40),
        ("mask", mask_of_a_ball(), 20),
    ] {
        let mut of_levels = 0;
        for (quality, least) in [(Quality::Standard, 38.0), (Quality::Draft, 30.0)] {
            for pixels in [0.5, 0.35, 0.25, 0.18, 0.125, 0.0625] {
                for view in [[0.0, 0.0], [20.0, 35.0], [160.0, -50.0], [90.0, 10.0], [280.0, 80.0]] {
                    let settings = Settings::new(size).with_quality(quality);
                    let camera = parallel(&model, view, pixels, size);
                    let parts = level_parts(&model.scene(), &camera, &settings).unwrap();
                    if parts[0].level == 0 {
                        continue;
                    }
                    of_levels += 1;
                    let db = decibels(&draw(&model, &camera, &settings), &truth(&model, &camera, &settings), EMPTY);
                    println!("{name} {pixels} {quality:?} {view:?} level {}: {db:.1} dB", parts[0].level);
                    // Between the directions that were measured.
                    assert!(db > least - 1.0, "{name} {pixels} {quality:?} {view:?}: {db:.1} dB");
                }
            }
        }
        println!("{name}: {of_levels} pictures of levels");
        assert!(of_levels >= fewest, "{name}: {of_levels} pictures of levels");
    }
}

/// A picture of all of such a volume takes too much memory while limits are measured, and the middle alone had a smooth bar: 33 dB at
/// standard, 25 dB at draft.
#[test]
fn a_long_volume_that_is_unlike_its_middle_keeps_the_accuracy_of_its_quality() {
    let [length, side] = [6_000u32, 32];
    let sample = |index: u32| {
        let [x, y, z] = [index % length, index / length % side, index / length / side].map(f64::from);
        let (middle, from_middle) = (f64::from(side) / 2.0, (x - f64::from(length) / 2.0).abs());
        let above = z - middle - 4.0 * (x / 9.0).sin() * (y / 11.0).cos();
        match from_middle < 100.0 {
            true if (z - middle).abs() < 6.0 => 200,
            false if above.abs() < 1.0 => 120 + 130 * u8::from(above > 0.0),
            _ => 0,
        }
    };
    let samples: Vec<u8> = (0..length * side * side).map(sample).collect();
    let volume = adjsplat::Volume::new([length, side, side].map(u64::from), samples).unwrap();
    let model = Build::new(TransferFunction::range(100.0, 255.0).unwrap()).with_levels(4).run(&volume).unwrap();
    for (quality, least) in [(Quality::Standard, 38.0), (Quality::Draft, 30.0)] {
        for voxels_a_pixel in [2, 3, 4, 8] {
            let pixels = 1.0 / f64::from(voxels_a_pixel);
            for view in [[0.0, 0.0], [10.0, 30.0], [-15.0, -50.0]] {
                let size = [length, 80].map(|voxels| voxels / voxels_a_pixel);
                let (settings, camera) =
                    (Settings::new(size).with_quality(quality), parallel(&model, view, pixels, size));
                let db = decibels(&draw(&model, &camera, &settings), &truth(&model, &camera, &settings), EMPTY);
                println!("{pixels} {quality:?} {view:?}: {db:.1} dB");
                assert!(db > least - 1.0, "{pixels} {quality:?} {view:?}: {db:.1} dB");
            }
        }
    }
}

/// With kernels as narrow along the axis that was not halved as along the others, slices came apart: 23, 27 and 35 dB.
#[test]
fn levels_whose_blocks_are_not_cubes_do_not_fall_apart_into_slices() {
    let size = [64, 60];
    for (name, dims, spacing, least) in [
        ("marschner-lobb", [64, 64, 32], [1.0, 1.0, 3.0], 29.5),
        ("shells", [96, 96, 48], [1.0, 1.0, 3.0], 39.0),
        ("hydrogen", [96, 96, 96], [1.0, 4.0, 1.0], 46.0),
    ] {
        let mut source = phantom(name, dims, SampleType::U8, spacing);
        let low = if name == "hydrogen" { 20.0 } else { 128.0 };
        let options = TransferFunction::range(low, 255.0).unwrap();
        let model = Build::new(options).with_levels(1).run(&mut *source).unwrap();
        for view in VIEWS {
            let camera = parallel(&model, view, 0.25, size);
            let settings = Settings::new(size).with_level(1);
            let db = decibels(&draw(&model, &camera, &settings), &truth(&model, &camera, &settings), EMPTY);
            println!("{name} {view:?}: {db:.1} dB");
            assert!(db > least, "{name} {view:?}: {db:.1} dB");
        }
    }
}

/// Both parts cover the same half of a pixel on an outline; as pixels they covered three quarters of it (29 dB, 8 % too much light).
#[test]
fn two_levels_in_a_small_picture_do_not_make_outlines_fatter() {
    let model = model("hydrogen", [96; 3], [1.0, 4.0, 1.0], 1, 0.5);
    let camera = camera(&model, [90.0, 90.0], 1233.0, Projection::Perspective { fov: 10.0 });
    let settings = Settings::new([66, 66]).with_quality(Quality::Draft);
    let parts = level_parts(&model.scene(), &camera, &settings).unwrap();
    assert_eq!(parts.iter().map(|part| part.level).collect::<Vec<_>>(), [0, 1]);
    let (frame, truth) = (draw(&model, &camera, &settings), truth(&model, &camera, &settings));
    let [shown, right] = [&frame, &truth].map(|frame| alphas(frame).sum::<f64>());
    let db = decibels(&frame, &truth, EMPTY);
    println!("{db:.1} dB, opacities {shown:.2} of {right:.2}");
    assert!(db > 44.0 && (shown / right - 1.0).abs() < 0.01, "{db:.1} dB, opacities {shown:.2} of {right:.2}");
}

#[test]
fn a_perspective_with_several_levels_has_no_seam() {
    let model = model("marschner-lobb", [64, 640, 64], [1.0; 3], 3, 0.05);
    let (grid, size) = (model.grid(), [72, 72]);
    let middle = [0, 1, 2].map(|a| f64::from(grid.dims[a] - 1) / 2.0);
    let eye = [middle[0] + 0.3, -1.0, middle[2] + 0.4];
    let camera = Camera::new(eye, middle, [0.0, 0.0, 1.0], Projection::Perspective { fov: 50.0 }).unwrap();
    let mut settings = Settings::new(size);
    settings.quality = Quality::Draft;
    let parts = level_parts(&model.scene(), &camera, &settings).unwrap();
    assert!(parts.len() >= 3, "{parts:?}");
    // Each slice of the voxels is in one part, and parts with finer levels are nearer.
    assert!(parts.is_sorted_by_key(|part| part.level), "{parts:?}");
    let frame = draw(&model, &camera, &settings);
    let db = decibels(&frame, &truth(&model, &camera, &settings), EMPTY);
    println!("{parts:?}: {db:.1} dB");
    assert!(db > 40.0, "{db:.1} dB");
    assert!(
        frame == draw(&model, &camera, &settings.clone().with_code(Code::Plain)),
        "the plain twin draws other bits"
    );
}

/// Scenes whose limits are other than those of their file.
struct WithLimits<'a>(&'a Model, Vec<LevelLimits>);

impl Lanes for WithLimits<'_> {
    fn lane(&self, axis: Axis) -> adjsplat::Result<Lane<'_>> {
        Lanes::lane(self.0, axis)
    }

    fn detail(&self) -> Detail<'_> {
        Detail { limits: &self.1, build_function: None, ..self.0.detail() }
    }
}

#[test]
fn a_level_is_drawn_up_to_its_limit_and_one_without_a_known_limit_in_small_drafts_only() {
    let model = model("shells", [64; 3], [1.0; 3], 2, 0.8);
    let size = [16, 16];
    let level = |limits: &[[f32; 2]], quality: Quality, pixels: f64| {
        let limits =
            limits.iter().map(|&[standard, draft]| LevelLimits { standard: standard.into(), draft: draft.into() });
        let lanes = WithLimits(&model, limits.collect());
        let scene = Scene { lanes: &lanes, ..model.scene() };
        let camera = parallel(&model, [35.0, 20.0], pixels, size);
        level_parts(&scene, &camera, &Settings::new(size).with_quality(quality)).unwrap()[0].level
    };
    // The longest edge of a voxel has 2 and 4 times as many pixels as one of level 0.
    let limits = [[0.8, 1.2], [0.4, 2.0]];
    for (quality, pixels, drawn) in [
        (Quality::Standard, 0.41, 0),
        (Quality::Standard, 0.39, 1),
        (Quality::Standard, 0.11, 1),
        (Quality::Standard, 0.09, 2),
        (Quality::Draft, 0.61, 0),
        (Quality::Draft, 0.59, 1),
        (Quality::Draft, 0.49, 2),
        (Quality::High, 0.09, 0),
    ] {
        assert_eq!(level(&limits, quality, pixels), drawn, "{quality:?} {pixels}");
    }
    for unknown in [&[][..], &[[0.0, 0.5]]] {
        assert_eq!(level(unknown, Quality::Standard, 0.05), 0);
        assert_eq!([0.26, 0.24, 0.13, 0.12].map(|pixels| level(unknown, Quality::Draft, pixels)), [0, 1, 1, 2]);
    }
    // What a damaged file may have.
    assert_eq!(level(&[[f32::NAN, -1.0], [-0.0, f32::NAN]], Quality::Standard, 0.05), 0);
    assert_eq!(level(&[[f32::NAN, -1.0], [-0.0, f32::NAN]], Quality::Draft, 0.05), 0);
}

#[test]
fn modes_whose_pictures_levels_would_change_draw_the_voxels() {
    let model = model("shells", [64; 3], [1.0; 3], 2, 0.8);
    let size = [16, 16];
    let camera = parallel(&model, [35.0, 20.0], 0.2, size);
    for mode in [Mode::Maximum, Mode::MaximumGrey, Mode::Additive] {
        let mut settings = Settings::new(size);
        settings.mode = mode;
        let parts = level_parts(&model.scene(), &camera, &settings).unwrap();
        assert!(matches!(parts[..], [LevelPart { level: 0, crop: None }]), "{mode:?}");
    }
    let error = model.render(&camera, &Settings::new(size).with_level(3)).unwrap_err().to_string();
    assert!(error.contains("level: is 3, but the file has levels 0 to 2"), "{error}");
}

/// Values of a level's voxels fit the opacities of the build. Drawn from level 1 with a narrower function, engine had 22 dB.
#[test]
fn with_other_opacities_than_those_of_the_build_the_voxels_are_drawn() {
    let build = |least: f64| {
        let mut source = phantom("shells", [64; 3], SampleType::U8, [1.0; 3]);
        Build::new(options(at_least(least))).with_levels(2).run(&mut *source).unwrap_or_else(|error| panic!("{error}"))
    };
    let model = build(20.0);
    let size = [16, 16];
    let camera = parallel(&model, [35.0, 20.0], 0.2, size);
    let level = |model: &Model| level_parts(&model.scene(), &camera, &Settings::new(size)).unwrap()[0].level;
    let with = |function: TransferFunction| level(&model.with_transfer(function).unwrap());
    assert_eq!(level(&model), 1);
    assert_eq!(with(model.transfer().clone()), 1);
    assert_eq!(with(at_least(20.0)), 1);
    assert_eq!(with(at_least(150.0)), 0);
    // Drafts, which show how a picture will be, go on with levels; so does a function that only scales the depths.
    let narrower = model.with_transfer(at_least(150.0)).unwrap();
    let draft = Settings::new(size).with_quality(Quality::Draft);
    assert_ne!(level_parts(&narrower.scene(), &camera, &draft).unwrap()[0].level, 0);
    let fainter = r#"{"kind": "range", "low": 20, "opacity": 0.3}"#;
    assert_eq!(with(transfer(fainter)), 1);
    let settings = Settings::new(size);
    assert!(draw(&narrower, &camera, &settings) == draw(&narrower, &camera, &settings.clone().with_level(0)));
}

/// The opacity of a mean value is not the mean opacity. Levels let more light through than their voxels do: 14 and 6 %.
#[test]
fn a_level_of_varying_opacity_is_as_opaque_as_its_voxels() {
    let Some(path) = real_volume("scivis-engine/engine.nii.gz") else { return };
    let by_value = r##"{"kind": "points", "points": [{"value": 60, "colour": "#ff0000", "opacity": 0},
        {"value": 120, "colour": "#00ff00", "opacity": 0.02}, {"value": 160, "colour": "#0000ff", "opacity": 0.05},
        {"value": 255, "colour": "#ffffff", "opacity": 0.9}]}"##;
    let by_gradient = r##"{"kind": "region", "knots": [{"value": 0, "colour": "#ffffff", "opacity": 0},
        {"value": 140, "colour": "#ffffff", "opacity": 0.1}, {"value": 200, "colour": "#ffffff", "opacity": 0.9}]}"##;
    let size = [80, 80];
    for function in [by_value, by_gradient] {
        let model = Build::new(options(transfer(function))).with_levels(1).run(&mut *volume(&path)).unwrap();
        let camera = parallel(&model, [35.0, 25.0], 0.25, size);
        let settings = Settings::new(size);
        let drawn = draw(&model, &camera, &settings.clone().with_level(1));
        let [light, kept] = [&truth(&model, &camera, &settings), &drawn].map(|frame| alphas(frame).sum::<f64>());
        println!("{:+.2} % of the light is kept", 100.0 * (kept / light - 1.0));
        // Measured: 0.8 and 0.4 % too opaque.
        assert!((kept / light - 1.0).abs() < 0.04, "{kept} of {light}");
    }
}

/// A level has whole blocks: a slice whose blocks have their centres outside of it vanished, others became a block thick. Two slices that
/// are one block were drawn from the level.
#[test]
fn a_crop_of_one_slice_neither_vanishes_nor_thickens() {
    let model = model("shells", [96; 3], [1.0; 3], 2, 0.8);
    let size = [24, 24];
    for view in [[0.0, 0.0], [90.0, 0.0]] {
        for projection in [Projection::Parallel { height: 24.0 / 0.25 }, Projection::Perspective { fov: 30.0 }] {
            let camera = camera(&model, view, 400.0, projection);
            for (slice, last) in [(44, 44), (45, 45), (46, 46), (47, 47), (48, 48), (49, 49), (44, 45), (44, 47)] {
                let crop = adjsplat::traverse::VoxelBox { low: [slice, 0, 0], high: [last, 95, 95] };
                let settings = Settings::new(size).with_quality(Quality::Draft).with_threads(1).with_crop(crop);
                let voxels = draw(&model, &camera, &settings.clone().with_level(0));
                assert!(voxels.pixels().iter().any(|sample| *sample > 0.05), "slice {slice} shows nothing");
                assert!(draw(&model, &camera, &settings) == voxels, "slice {slice}, {view:?}, {projection:?}");
            }
        }
    }
}

#[test]
fn a_crop_of_whole_blocks_cuts_a_level_where_it_cuts_the_voxels() {
    let model = model("shells", [96; 3], [1.0; 3], 2, 0.8);
    let size = [48, 48];
    let camera = parallel(&model, [35.0, 20.0], 0.25, size);
    let crop = adjsplat::traverse::VoxelBox { low: [8, 40, 0], high: [71, 95, 63] };
    let mut settings = Settings::new(size);
    settings.crop = Some(crop);
    let db = decibels(&draw(&model, &camera, &settings), &truth(&model, &camera, &settings), EMPTY);
    assert!(db > 34.0, "{db:.1} dB");
}
