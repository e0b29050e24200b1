//! Grids of every shape, samples of every type, every option.

use adjsplat::arena::TileOrder;
use adjsplat::classify::TransferFunction;
use adjsplat::file::arena_bytes;
use adjsplat::volume::SampleType;
use adjsplat::volume::phantom::Phantom;
use adjsplat_tests::scenes::options;

use super::dense::{SampleVolume, random_at};
use super::twin::{build_and_compare, compare};

fn range(low: f64, high: f64) -> TransferFunction {
    TransferFunction::range(low, high).expect("a sound range")
}

fn phantom(phantom: &Phantom, dims: [u64; 3], sample_type: SampleType, spacing: [f64; 3]) -> SampleVolume {
    SampleVolume::read(&mut *phantom.open(dims, sample_type, spacing).expect("a sound phantom"))
}

#[test]
fn phantoms_of_every_kind_and_type_come_out_voxel_by_voxel() {
    let sizes = [[41, 29, 23], [17, 40, 9], [8, 8, 8], [64, 7, 33]];
    for (index, name) in Phantom::names().enumerate() {
        let kind = Phantom::from_name(name).expect("its own name");
        let (low, high) = kind.visible_range();
        for (at, sample_type) in [SampleType::U8, SampleType::U16, SampleType::F32].into_iter().enumerate() {
            let dims = sizes[(index + at) % sizes.len()];
            let spacing = [[1.0; 3], [0.7, 1.3, 2.5], [1e-3, 1.0, 1e3]][(index + at) % 3];
            let volume = phantom(&kind, dims, sample_type, spacing);
            // On some of these grids a phantom misses its own range.
            let values = (0..volume.samples.len()).map(|i| volume.samples.get(i) * volume.header.slope);
            let (low, high) =
                if values.into_iter().any(|v| low <= v && v <= high) { (low, high) } else { (1.0, 255.0) };
            for (value_bits, normal_bits) in [(8, 8), (16, 16), (8, 0), (16, 8)] {
                let options = options(range(low, high)).with_value_bits(value_bits).with_normal_bits(normal_bits);
                let built = build_and_compare(&volume, &options);
                assert!(!built.samples.surveyed, "a closed range needs no second reading");
            }
        }
    }
}

#[test]
fn tile_orders_and_lane_counts_change_the_place_and_nothing_else() {
    let volume = phantom(&Phantom::Gyroid, [37, 50, 21], SampleType::U8, [1.0, 1.0, 1.5]);
    let (low, high) = Phantom::Gyroid.visible_range();
    let mut sizes = Vec::new();
    for tile_order in [TileOrder::Morton, TileOrder::Hilbert, TileOrder::Rows] {
        for lane_count in 1..=3 {
            let built = build_and_compare(
                &volume,
                &options(range(low, high)).with_tile_order(tile_order).with_lane_count(lane_count),
            );
            sizes.push(built.lanes.iter().map(|lane| lane.view().bytes()).sum::<u64>());
        }
    }
    assert_eq!(sizes[..3], sizes[3..6]);
    assert_eq!(sizes[..3], sizes[6..]);
}

#[test]
fn the_smallest_and_thinnest_grids() {
    let ramp = |[x, y, z]: [u32; 3]| f64::from((7 * x + 5 * y + 3 * z) % 200 + 1);
    for dims in [[1, 1, 1], [1, 1, 300], [1, 300, 1], [300, 1, 1], [2, 1, 1], [1, 9, 17], [2, 2, 2], [700, 1, 2]] {
        for sample_type in SampleType::ALL {
            let wrapped = |place| ramp(place) % 127.0;
            let volume = SampleVolume::new(dims, sample_type, [1.0, 2.0, 0.5], wrapped);
            for normal_bits in [0, 8, 16] {
                build_and_compare(&volume, &options(range(0.0, 126.0)).with_normal_bits(normal_bits));
            }
        }
    }
}

#[test]
fn gaps_of_every_length_around_255_are_bridged() {
    for gap in [1, 2, 254, 255, 256, 257, 509, 510, 511, 765, 766] {
        for first in [0, 1, 253, 254, 255, 256, 509, 510] {
            let volume = |turn: usize| {
                let mut dims = [2, 3, 2];
                dims[turn] = first + gap + 2;
                SampleVolume::new(dims, SampleType::U8, [1.0; 3], move |place| {
                    let at = place[turn];
                    f64::from(at == first || at == first + gap) * 9.0
                })
            };
            for turn in 0..3 {
                let built = build_and_compare(&volume(turn), &options(range(1.0, 255.0)));
                let lines = built.lanes[turn].view().line_ends.len() as u64;
                // From the low cap a first voxel is first + 1 away; a gap g takes ceil(g / 255) - 1.
                let want = u64::from((first + 1).div_ceil(255) - 1 + gap.div_ceil(255) - 1);
                assert_eq!(built.lanes[turn].view().stepping_voxels(), lines * want, "gap {gap} from {first}");
            }
        }
    }
}

#[test]
fn constant_volumes_have_normals_on_their_faces_only_and_every_voxel() {
    for sample_type in SampleType::ALL {
        let volume = SampleVolume::new([9, 10, 11], sample_type, [1.0; 3], |_| 100.0);
        for value_bits in [8, 16] {
            let built = build_and_compare(&volume, &options(range(50.0, 120.0)).with_value_bits(value_bits));
            assert_eq!(built.facts.visible_voxels, 990);
            let lane = built.lanes[0].view();
            let is_unlit = |record| lane.normal_code(record) == u32::from(adjsplat::classify::normal::NONE8);
            assert_eq!((0..990).filter(|&record| is_unlit(record)).count(), 7 * 8 * 9);
            let built = build_and_compare(&volume, &options(range(100.0, 100.0)).with_value_bits(value_bits));
            assert_eq!((built.facts.scales.value_low, built.facts.scales.value_step), (100.0, 0.0));
            build_and_compare(&volume, &options(range(f64::NEG_INFINITY, 100.0)).with_value_bits(value_bits));
        }
    }
}

#[test]
fn samples_that_are_no_numbers_are_transparent_and_counted() {
    for sample_type in [SampleType::F32, SampleType::F64] {
        let bad = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e-310, -0.0, 3e38, -3e38];
        let sample = |place: [u32; 3]| {
            let dice = random_at(place);
            if dice < 0.3 { bad[(dice * 1e6) as usize % bad.len()] } else { dice * 100.0 }
        };
        let volume = SampleVolume::new([21, 13, 10], sample_type, [1.0, 0.5, 3.0], sample);
        let wrong = (0..volume.samples.len()).filter(|&i| !volume.samples.get(i).is_finite()).count() as u64;
        for (low, high) in
            [(40.0, 90.0), (40.0, f64::INFINITY), (f64::NEG_INFINITY, 0.0), (f64::NEG_INFINITY, f64::INFINITY)]
        {
            for value_bits in [8, 16] {
                let options = options(range(low, high)).with_value_bits(value_bits);
                let built = build_and_compare(&volume, &options);
                assert_eq!(built.samples.not_finite, wrong);
                assert!(wrong > 200, "{wrong}");
                assert!(!built.samples.surveyed, "an open range needs no second reading");
            }
        }
    }
}

#[test]
fn slope_and_intercept_give_values_in_their_own_unit() {
    for (slope, intercept) in [(2.007_843_255_996_704, 0.0), (0.1, -1024.0), (-3.0, 700.0), (1e-7, 1e3)] {
        for sample_type in [SampleType::U8, SampleType::I16, SampleType::I32] {
            let volume = SampleVolume::new([15, 14, 13], sample_type, [1.0; 3], |p| random_at(p) * 120.0)
                .scaled(slope, intercept);
            let middle = 60.0 * slope + intercept;
            for (low, high) in [(middle, f64::INFINITY), (f64::NEG_INFINITY, middle)] {
                for value_bits in [8, 16] {
                    let built = build_and_compare(&volume, &options(range(low, high)).with_value_bits(value_bits));
                    let share = built.facts.visible_voxels as f64 / volume.header.grid.points() as f64;
                    assert!((0.4..0.6).contains(&share), "{share}");
                }
            }
        }
    }
}

#[test]
fn wide_samples_share_codes_within_half_a_code() {
    for sample_type in [SampleType::U16, SampleType::I16, SampleType::U32, SampleType::I32, SampleType::F64] {
        let (low, high) = sample_type.integer_range().unwrap_or((-1e300, 1e300));
        let volume = SampleVolume::new([19, 8, 9], sample_type, [1.0; 3], |p| {
            low + (high / 2.0 - low / 2.0) * 2.0 * random_at(p)
        });
        for value_bits in [8, 16] {
            // Gradients of samples up to 1e300 leave single precision, in which they are taken; values do not.
            let normal_bits = if sample_type == SampleType::F64 { 0 } else { 8 };
            let shown = range(low / 2.0, f64::INFINITY);
            build_and_compare(&volume, &options(shown).with_value_bits(value_bits).with_normal_bits(normal_bits));
        }
    }
}

#[test]
fn building_twice_gives_the_same_bytes() {
    let (low, high) = Phantom::Vessels.visible_range();
    let volume = phantom(&Phantom::Vessels, [61, 47, 38], SampleType::F32, [0.5, 0.5, 1.0]);
    let options = options(range(low, high));
    let bytes = |built: &adjsplat::build::Built| arena_bytes(&built.facts, &built.lanes, "{\"a\":1}");
    let first = build_and_compare(&volume, &options);
    let second = build_and_compare(&volume, &options);
    assert!(bytes(&first) == bytes(&second));
    // The stream itself gives what the whole volume gives.
    let mut stream = Phantom::Vessels.open([61, 47, 38], SampleType::F32, [0.5, 0.5, 1.0]).expect("sound");
    let third = adjsplat::build::build(&mut *stream, &options, &mut adjsplat::build::Unobserved);
    let third = third.expect("it built before");
    compare(&volume, &options, &third);
    assert!(bytes(&first) == bytes(&third));
}
