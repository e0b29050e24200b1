//! Trimming: what is left is what a build of the smaller volume holds.

use adjsplat::Error;
use adjsplat::arena::{Arena, LaneSet, Region, TileOrder, TrimOptions, trim};
use adjsplat::arena::{Levels, Record};
use adjsplat::build::Unobserved;
use adjsplat::classify::{TransferFunction, normal};
use adjsplat::file::{RowsOutput, arena_bytes, write_rows};
use adjsplat::splat::{Camera, Scene, Settings, Surround, cpu};
use adjsplat::traverse::VoxelBox;
use adjsplat_tests::random::Random;
use adjsplat_tests::real_volume;
use adjsplat_tests::scenes::{LIT, PLAIN, WIDE, at_least, built, options, volume};

use crate::edits::{RandomVoxels as _, VoxelMap};

/// The bytes of what is left of an arena.
fn trimmed(bytes: &[u8], stored: Option<&TransferFunction>, options: &TrimOptions, lanes: u8) -> Vec<u8> {
    let arena = Arena::new(bytes).expect("sound");
    let left = trim(&arena, stored, options).unwrap_or_else(|error| panic!("{error}"));
    let folder = tempfile::tempdir().expect("there is a temporary folder");
    let path = folder.path().join("out.adj");
    let output = RowsOutput {
        facts: left.facts.clone(),
        description: "{}",
        lane_count: lanes,
        memory: None,
        threads: 1,
        levels: Levels::default(),
    };
    let (facts, _) = write_rows(&path, &*left.rows, &output, &mut Unobserved).expect("writes");
    assert_eq!(facts, left.facts, "the voxels were counted right");
    let bytes = std::fs::read(&path).expect("it was written");
    Arena::new(&bytes).expect("opens").check().expect("is sound");
    bytes
}

/// A random volume that is not empty.
fn some_model(random: &mut Random) -> VoxelMap {
    loop {
        let model = random.voxels();
        if !model.voxels.is_empty() {
            return model;
        }
    }
}

fn some_crop(random: &mut Random, dims: [u32; 3]) -> Region {
    let [xs, ys, zs] = dims.map(|points| {
        let ends = [(); 2].map(|()| random.below(points.into()) as u32);
        ends[0].min(ends[1])..ends[0].max(ends[1]) + 1
    });
    Region { xs, ys, zs }
}

#[test]
fn keeping_everything_gives_the_same_bytes() {
    let mut random = Random(1);
    for _ in 0..60 {
        let model = some_model(&mut random);
        for lanes in 1..=3 {
            let bytes = model.bytes(lanes);
            assert!(trimmed(&bytes, None, &TrimOptions::default(), lanes as u8) == bytes, "{:?}", model.dims());
        }
        assert!(trimmed(&model.bytes(1), None, &TrimOptions::default(), 3) == model.bytes(3), "lanes can be made");
    }
}

#[test]
fn a_crop_is_a_build_of_the_box() {
    let mut random = Random(2);
    let mut empty = 0;
    for _ in 0..150 {
        let model = some_model(&mut random);
        let bytes = model.bytes(3);
        let crop = some_crop(&mut random, model.dims());
        let options = TrimOptions::default().with_crop(crop.clone());
        let mut expected = model.cropped(&crop);
        if expected.voxels.is_empty() {
            let arena = Arena::new(&bytes).expect("sound");
            let refused = trim(&arena, None, &options).map(drop);
            assert!(matches!(&refused, Err(Error::Input { what, .. }) if what == "nothing is left"), "{refused:?}");
            empty += 1;
            continue;
        }
        // Spacing 1, 0.5, 2 along the world's axes.
        expected.facts.grid.origin = [crop.xs.start, crop.ys.start, crop.zs.start]
            .map(f64::from)
            .iter()
            .zip([1.0, 0.5, 2.0])
            .map(|(low, step)| low * step)
            .collect::<Vec<f64>>()
            .try_into()
            .expect("three");
        assert!(trimmed(&bytes, None, &options, 3) == expected.bytes(3), "{:?} {crop:?}", model.dims());
        let kept = model.filtered(|[x, y, z], _| crop.xs.contains(&x) && crop.ys.contains(&y) && crop.zs.contains(&z));
        assert!(trimmed(&bytes, None, &options.with_keep_grid(true), 2) == kept.bytes(2));
    }
    assert!((1..100).contains(&empty), "{empty} crops were empty");
}

#[test]
fn a_crop_outside_the_grid_is_refused() {
    let mut model = VoxelMap::new([5, 6, 7], PLAIN, TileOrder::Morton);
    model.put([0; 3], Some(Record::default()));
    let bytes = model.bytes(1);
    let arena = Arena::new(&bytes).expect("sound");
    for crop in [
        Region { xs: 5..9, ys: 0..6, zs: 0..7 },
        Region { xs: 0..5, ys: 3..3, zs: 0..7 },
        Region { xs: 0..5, ys: 0..6, zs: u32::MAX - 1..u32::MAX },
    ] {
        let refused = trim(&arena, None, &TrimOptions::default().with_crop(crop)).map(drop);
        let told = refused.expect_err("outside").to_string();
        assert!(told.contains("5 x 6 x 7 grid"), "{told}");
    }
}

#[test]
fn a_threshold_is_a_build_of_what_it_shows() {
    let mut random = Random(3);
    for _ in 0..80 {
        let model = some_model(&mut random);
        let scales = model.facts.scales;
        let value = |record: Record| scales.value_low + f64::from(record.value) * scales.value_step;
        let first = model.voxels.values().next().copied().expect("there is one");
        let low = value(first);
        let options = TrimOptions::default().with_transfer(TransferFunction::range(low, f64::INFINITY).expect("sound"));
        let expected = model.filtered(|_, record| value(record) >= low);
        assert!(trimmed(&model.bytes(2), None, &options, 2) == expected.bytes(2));
    }
}

#[test]
fn channels_that_go_leave_the_others_as_they_were() {
    let mut random = Random(4);
    for _ in 0..20 {
        let mut model = some_model(&mut random);
        let bytes = model.bytes(3);
        let options = TrimOptions::default().with_drop_normals(true).with_drop_magnitudes(true);
        model.facts.channels.normal_bits = 0;
        model.facts.channels.coherence = false;
        model.facts.channels.magnitude_bits = 0;
        model.facts.scales.magnitude_scale = 0.0;
        assert!(trimmed(&bytes, None, &options, 3) == model.bytes(3));
    }
}

#[test]
fn magnitudes_that_a_function_needs_stay() {
    let mut model = VoxelMap::new([5, 6, 7], WIDE, TileOrder::Morton);
    model.put([1, 2, 3], Some(Record { value: 25, normal: 1, magnitude: 255, coverage: 0 }));
    let bytes = model.bytes(1);
    let arena = Arena::new(&bytes).expect("sound");
    let contour = TransferFunction::contour(60.0).expect("sound");
    let drop_magnitudes = TrimOptions::default().with_drop_magnitudes(true);
    let told = trim(&arena, Some(&contour), &drop_magnitudes).map(drop).expect_err("needed").to_string();
    assert!(told.contains("magnitudes") && told.contains("cannot be dropped"), "{told}");
    // Another function makes them superfluous.
    let range = TransferFunction::range(0.0, 100.0).expect("sound");
    let both = drop_magnitudes.with_transfer(range);
    assert_eq!(trim(&arena, Some(&contour), &both).expect("fine").facts.channels.magnitude_bits, 0);
    // And a file without any cannot be thresholded by them.
    let bytes = trimmed(&bytes, None, &TrimOptions::default().with_drop_magnitudes(true), 1);
    let options = TrimOptions::default().with_transfer(contour);
    let told = trim(&Arena::new(&bytes).expect("sound"), None, &options).map(drop).expect_err("none").to_string();
    assert!(told.contains("needs gradient magnitudes"), "{told}");
}

/// The voxels of an arena by place, in the order of places.
fn voxels(bytes: &[u8]) -> Vec<([u32; 3], Record)> {
    let arena = Arena::new(bytes).expect("sound");
    let left = trim(&arena, None, &TrimOptions::default()).expect("something");
    let [nx, ny, nz] = left.rows.dims();
    let mut voxels = Vec::new();
    for z in 0..nz {
        let region = Region { xs: 0..nx, ys: 0..ny, zs: z..z + 1 };
        let mut add = |y: u16, z: u16, row: &[adjsplat::arena::Voxel]| {
            voxels.extend(row.iter().map(|voxel| ([voxel.x, y, z].map(u32::from), voxel.record)));
        };
        left.rows.read(region, &mut add).expect("reads");
    }
    voxels
}

#[test]
fn narrowed_values_are_exact_where_eight_bits_do() {
    for (codes, exact) in [(1u64, true), (200, true), (256, true), (257, false), (60_000, false)] {
        let mut random = Random(codes);
        let mut model = VoxelMap::new([30, 20, 10], WIDE, TileOrder::Hilbert);
        for _ in 0..600 {
            let record = Record { value: 3_000 + random.below(codes) as u16, ..random.record(WIDE) };
            model.put(random.place([30, 20, 10]), Some(record));
        }
        model.put([0; 3], Some(Record { value: 3_000, normal: 0x8000_8000, magnitude: 3, coverage: 0 }));
        model.put([1, 0, 0], Some(Record { value: (2_999 + codes) as u16, normal: 5, magnitude: 3, coverage: 0 }));
        let options = TrimOptions::default().with_narrow_values(true).with_narrow_normals(true);
        let bytes = trimmed(&model.bytes(3), None, &options, 3);
        let new = Arena::new(&bytes).expect("sound").facts().clone();
        assert_eq!((new.channels.value_bits, new.channels.normal_bits), (8, 8));
        let (old, scales) = (model.facts.scales, new.scales);
        // Half a code and what rounding takes.
        let tolerance = if exact { 0.0 } else { scales.value_step / 2.0 * (1.0 + 1e-9) };
        assert_eq!(exact, scales.value_step == old.value_step || codes == 1, "{codes}");
        let mut largest_angle = 0.0f32;
        for ((at, narrow), (place, wide)) in voxels(&bytes).into_iter().zip(&model.voxels) {
            assert_eq!([at[2], at[1], at[0]], place.map(u32::from));
            let value = |scales: &adjsplat::arena::layout::Scales, code: u16| {
                scales.value_low + f64::from(code) * scales.value_step
            };
            let difference = (value(&scales, narrow.value) - value(&old, wide.value)).abs();
            assert!(difference <= tolerance, "{codes} {difference} {tolerance}");
            assert_eq!(narrow.magnitude, wide.magnitude);
            let (before, after) = (normal::decode16(wide.normal), normal::decode8(narrow.normal as u16));
            if wide.normal == normal::NONE16 {
                assert_eq!(narrow.normal, u32::from(normal::NONE8));
            } else {
                let dot: f32 = (0..3).map(|a| before[a] * after[a]).sum();
                largest_angle = largest_angle.max(dot.clamp(-1.0, 1.0).acos());
            }
        }
        // The codec's own bound, sqrt(2)/127 rad, and single precision's acos near 1.
        assert!(largest_angle < 0.0112 + 1e-3, "{largest_angle}");
    }
}

#[test]
fn labels_keep_their_codes_or_are_refused() {
    let labels = TransferFunction::preset("labels").expect("it is built in");
    let mut model = VoxelMap::new([30, 20, 10], WIDE, TileOrder::Morton);
    model.facts.scales.value_step = 1.0;
    for x in 0..30u16 {
        model.put([x.into(), 0, 0], Some(Record { value: 1 + 30 * x, ..Record::default() }));
    }
    let bytes = model.bytes(1);
    let arena = Arena::new(&bytes).expect("sound");
    let options = TrimOptions::default().with_narrow_values(true);
    let told = trim(&arena, Some(&labels), &options).map(drop).expect_err("too many").to_string();
    assert!(told.contains("label") && told.contains("8 bits"), "{told}");
    let crop = Some(Region { xs: 0..8, ys: 0..20, zs: 0..10 });
    let left = trim(&arena, Some(&labels), &options.with_crop(crop)).expect("few enough");
    assert_eq!((left.facts.scales.value_low, left.facts.scales.value_step), (11.0, 1.0));
}

#[test]
fn values_that_turn_transparent_are_counted() {
    let mut model = VoxelMap::new([30, 20, 10], WIDE, TileOrder::Morton);
    // Codes 0 and 60,000 give steps of 235 codes; a slit of 10 lies between two of them.
    for (x, value) in [(0, 0), (1, 60_000), (2, 1_000), (3, 1_000)] {
        model.put([x, 0, 0], Some(Record { value, ..Record::default() }));
    }
    let scales = model.facts.scales;
    let at = |code: f64| scales.value_low + code * scales.value_step;
    let points = format!(
        r##"{{"kind": "points", "points": [
        {{"value": {}, "colour": "#ffffff", "opacity": 0.5}}, {{"value": {}, "colour": "#ffffff", "opacity": 0}},
        {{"value": {}, "colour": "#ffffff", "opacity": 0}}, {{"value": {}, "colour": "#ffffff", "opacity": 0.5}},
        {{"value": {}, "colour": "#ffffff", "opacity": 0}}, {{"value": {}, "colour": "#ffffff", "opacity": 0}},
        {{"value": {}, "colour": "#ffffff", "opacity": 0.5}}]}}"##,
        at(0.0),
        at(10.0),
        at(990.0),
        at(1_000.0),
        at(1_010.0),
        at(59_990.0),
        at(60_000.0)
    );
    let transfer = TransferFunction::from_json(&points).expect("sound");
    let bytes = model.bytes(1);
    let arena = Arena::new(&bytes).expect("sound");
    let options = TrimOptions::default().with_narrow_values(true);
    assert_eq!(trim(&arena, Some(&transfer), &options).expect("left").blurred_away, 2);
    assert_eq!(trim(&arena, Some(&transfer), &TrimOptions::default()).expect("left").blurred_away, 0);
}

#[test]
fn a_cropped_arena_lies_where_it_lay() {
    let mut random = Random(8);
    let mut model = VoxelMap::new([40, 40, 40], LIT, TileOrder::Morton);
    let half = std::f64::consts::FRAC_1_SQRT_2;
    model.facts.grid.direction = [[half, half, 0.0], [-half, half, 0.0], [0.0, 0.0, 1.0]];
    model.facts.grid.origin = [5.0, -3.0, 7.5];
    for _ in 0..20_000 {
        let (at, record) = (random.place([40; 3]), random.record(LIT));
        model.put(at, Some(record));
    }
    let crop = Region { xs: 9..31, ys: 4..35, zs: 12..29 };
    let options = TrimOptions::default().with_crop(crop);
    let bytes = [model.bytes(3), trimmed(&model.bytes(3), None, &options, 3)];
    let transfer = TransferFunction::range(0.0, 600.0).and_then(|t| t.with_value_range(0.0, 600.0)).expect("sound");
    let around = Surround::of_grid(&model.facts.grid);
    let camera = Camera::orbiting(
        adjsplat::splat::Orbit { azimuth: 25.0, elevation: 35.0, fov: Some(30.0), ..Default::default() },
        around,
        [120, 100],
    )
    .expect("sound");
    let boxed = VoxelBox { low: [9, 4, 12], high: [30, 34, 28] };
    let [whole, part] = [(&bytes[0], Some(boxed)), (&bytes[1], None)].map(|(bytes, crop)| {
        let lanes = LaneSet::new(Arena::new(bytes).expect("sound"), None);
        let facts = lanes.arena().facts().clone();
        let settings = Settings::every_pixel([120, 100]).with_crop(crop).with_termination(0.0);
        cpu::render(&Scene { facts: &facts, lanes: &lanes, transfer: &transfer }, &camera, &settings).expect("draws").0
    });
    let differences = whole.pixels().iter().zip(part.pixels()).map(|(a, b)| (a - b).abs());
    // The same sums from another origin: rounding of single precision.
    assert!(differences.fold(0.0f32, f32::max) < 2e-4);
    assert!(whole.pixels().iter().any(|value| *value > 0.3 && *value < 1.0));
}

#[test]
fn real_volumes_trimmed_hold_what_a_build_holds() {
    for (path, low, high, value_bits, left) in [
        ("scivis-engine/engine.nii.gz", 60.0, 180.0, 8, 69_847),
        ("headsq-quarter/quarter.nhdr", 500.0, 1_150.0, 16, 34_295),
        ("ironProt/ironProt.vtk", 30.0, 128.0, 8, 9_338),
    ] {
        let Some(path) = real_volume(path) else { return };
        let [from, to] = [low, high].map(|low| {
            let options = options(at_least(low)).with_value_bits(value_bits);
            built(&mut *volume(&path), &options)
        });
        assert_eq!(to.facts.visible_voxels, left);
        let bytes = arena_bytes(&from.facts, &from.lanes, "{}");
        let transfer = TransferFunction::range(high, f64::INFINITY).expect("sound");
        let options = TrimOptions::default().with_transfer(transfer);
        let arena = Arena::new(&bytes).expect("sound");
        let rows = trim(&arena, Some(&from.transfer), &options).expect("some is left");
        assert_eq!(rows.transfer.as_ref(), Some(&to.transfer), "the function is the build's");
        let trimmed = voxels(&trimmed(&bytes, Some(&from.transfer), &options, 3));
        let expected = voxels(&arena_bytes(&to.facts, &to.lanes, "{}"));
        assert_eq!(trimmed.len(), expected.len());
        let (old, new) = (from.facts.scales, to.facts.scales);
        for ((place, kept), (at, anew)) in trimmed.into_iter().zip(expected) {
            assert_eq!((place, kept.normal), (at, anew.normal));
            let value = |low: f64, step: f64, code: u16| low + f64::from(code) * step;
            assert_eq!(
                value(old.value_low, old.value_step, kept.value),
                value(new.value_low, new.value_step, anew.value),
                "whole numbers have codes of their own"
            );
        }
    }
}
