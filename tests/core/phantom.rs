//! Phantoms: as much visible as they promise, the same on every run and machine, slices that do not depend on how
//! they are asked for.

use adjsplat::volume::phantom::Phantom;
use adjsplat::volume::{SampleType, Samples, SlabSource};

fn slices(source: &mut dyn SlabSource) -> Vec<Samples> {
    let grid = source.header().grid.clone();
    let mut all = Vec::new();
    for _ in 0..grid.dims[2] {
        let mut slice = Samples::zeros(source.header().sample_type, usize::try_from(grid.slice_len()).unwrap());
        source.read_slice(&mut slice).unwrap();
        all.push(slice);
    }
    all
}

fn open(phantom: &Phantom, dims: [u64; 3], ty: SampleType) -> Box<dyn SlabSource> {
    phantom.open(dims, ty, [1.0; 3]).unwrap()
}

/// Share of the samples whose value is in the phantom's visible range.
fn visible(phantom: &Phantom, dims: [u64; 3], ty: SampleType) -> f64 {
    let mut source = open(phantom, dims, ty);
    let slope = source.header().slope;
    let (low, high) = phantom.visible_range();
    let (mut count, mut of) = (0u64, 0u64);
    for slice in slices(&mut *source) {
        of += slice.len() as u64;
        count += (0..slice.len()).filter(|at| (low..=high).contains(&(slice.get(*at) * slope))).count() as u64;
    }
    count as f64 / of as f64
}

#[test]
fn phantoms_show_as_much_as_they_promise() {
    for (name, dims, low, high) in [
        ("constant", [7, 8, 9], 1.0, 1.0),
        ("shells", [128; 3], 0.02, 0.15),
        ("gyroid", [128; 3], 0.030, 0.035),
        ("gyroid", [96, 64, 32], 0.025, 0.040),
        ("marschner-lobb", [40; 3], 0.4, 0.6),
        ("hydrogen", [64; 3], 0.06, 0.12),
        ("vessels", [128; 3], 0.01, 0.04),
        ("noise", [100; 3], 0.0095, 0.0105),
        ("corners", [5, 6, 7], 9.0 / 210.0, 9.0 / 210.0),
    ] {
        let phantom = Phantom::from_name(name).unwrap();
        assert_eq!(phantom.name(), name);
        for ty in [SampleType::U8, SampleType::U16, SampleType::F32] {
            let share = visible(&phantom, dims, ty);
            assert!((low..=high).contains(&share), "{name} {ty:?}: {share}");
        }
    }
    let quiet = Phantom::Noise { visible: 0.0 };
    assert_eq!(visible(&quiet, [30; 3], SampleType::U8), 0.0);
    assert_eq!(visible(&Phantom::Noise { visible: 1.0 }, [30; 3], SampleType::U8), 1.0);
}

#[test]
fn phantoms_are_the_same_on_every_machine() {
    // FNV-1a of the bytes at 24 x 20 x 17; new numbers mean that every study's scenes changed.
    for (name, frozen) in [
        ("constant", 0x0b71_fdcf_dc0d_94a5),
        ("shells", 0x642e_1099_85b4_1d3d),
        ("gyroid", 0xe147_3093_ac62_094d),
        ("marschner-lobb", 0xdc75_c83d_1dd1_aaa9),
        ("hydrogen", 0xba63_2955_f31f_dc2d),
        ("vessels", 0x1154_9851_17e0_1cbf),
        ("noise", 0x2609_5cc0_4f4e_76e0),
        ("corners", 0xf087_44d1_69db_a24a),
    ] {
        let mut source = open(&Phantom::from_name(name).unwrap(), [24, 20, 17], SampleType::U8);
        let all = slices(&mut *source);
        let hash = all
            .iter()
            .flat_map(|slice| slice.bytes())
            .fold(0xcbf2_9ce4_8422_2325u64, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3));
        assert_eq!(hash, frozen, "{name} {hash:#x}");
        source.rewind().unwrap();
        assert_eq!(slices(&mut *source), all, "{name} after a rewind");
    }
    assert_eq!(Phantom::names().count(), 8);
}

#[test]
fn sample_types_hold_the_same_values() {
    for name in Phantom::names() {
        let phantom = Phantom::from_name(name).unwrap();
        let [bytes, words, floats] = [SampleType::U8, SampleType::U16, SampleType::F32].map(|ty| {
            let mut source = open(&phantom, [19, 5, 6], ty);
            let slope = source.header().slope;
            let all = slices(&mut *source);
            all.iter().flat_map(|s| (0..s.len()).map(|at| s.get(at) * slope)).collect::<Vec<f64>>()
        });
        for ((byte, word), float) in bytes.iter().zip(&words).zip(&floats) {
            assert!((0.0..=255.0).contains(float), "{name}");
            assert!(
                (byte - float).abs() <= 0.501 && (word - float).abs() <= 0.501 / 257.0,
                "{name} {byte} {word} {float}"
            );
        }
    }
}

#[test]
fn phantoms_take_any_dimensions() {
    for name in Phantom::names() {
        let phantom = Phantom::from_name(name).unwrap();
        for dims in [[1, 1, 1], [65_535, 1, 1], [1, 65_535, 1], [1, 1, 300], [2, 2, 2], [3, 1, 2]] {
            for ty in [SampleType::U8, SampleType::F32] {
                let mut source = open(&phantom, dims, ty);
                for slice in slices(&mut *source) {
                    assert!((0..slice.len()).all(|at| (0.0..=255.0).contains(&slice.get(at))), "{name} {dims:?}");
                }
            }
        }
    }
}

#[test]
fn noise_is_spread_over_values_and_places() {
    let mut source = open(&Phantom::from_name("noise").unwrap(), [128; 3], SampleType::U8);
    let mut values = [0u32; 256];
    let mut octants = [0u32; 8];
    for (z, slice) in slices(&mut *source).iter().enumerate() {
        for (at, value) in slice.bytes().iter().enumerate() {
            values[usize::from(*value)] += 1;
            octants[z / 64 * 4 + at / 128 / 64 * 2 + at % 128 / 64] += u32::from(*value > 0);
        }
    }
    // 20,972 expected: 82 a value, 2,621 an octant; six standard deviations.
    assert!(values[1..].iter().all(|count| (28..=137).contains(count)), "{values:?}");
    assert!(octants.iter().all(|count| (2315..=2928).contains(count)), "{octants:?}");
}

#[test]
fn chosen_voxels_are_the_only_ones() {
    let places = vec![[3, 0, 2], [0, 0, 0], [3, 4, 2], [2, 4, 2], [3, 4, 2]];
    let mut source = open(&Phantom::Voxels(places.clone()), [4, 5, 3], SampleType::U8);
    for (z, slice) in slices(&mut *source).iter().enumerate() {
        for (at, value) in slice.bytes().iter().enumerate() {
            let here = [at % 4, at / 4, z].map(|index| u32::try_from(index).unwrap());
            assert_eq!(*value, if places.contains(&here) { 255 } else { 0 });
        }
    }
}

#[test]
fn wrong_wishes_are_refused() {
    let gyroid = Phantom::Gyroid;
    let refused = |result: adjsplat::Result<Box<dyn SlabSource>>| result.err().expect("refused").to_string();
    assert!(refused(gyroid.open([0, 1, 1], SampleType::U8, [1.0; 3])).contains("dimension x"));
    assert!(refused(gyroid.open([65_536, 1, 1], SampleType::U8, [1.0; 3])).contains("65535"));
    assert!(refused(gyroid.open([1; 3], SampleType::I16, [1.0; 3])).contains("u8, u16 or f32"));
    assert!(refused(gyroid.open([1; 3], SampleType::U8, [1.0, 0.0, 1.0])).contains("spacing y"));
    let outside = Phantom::Voxels(vec![[0, 3, 0]]);
    assert!(refused(outside.open([3; 3], SampleType::U8, [1.0; 3])).contains("outside the grid"));
    let noisy = Phantom::Noise { visible: f64::NAN };
    assert!(refused(noisy.open([3; 3], SampleType::U8, [1.0; 3])).contains("from 0 to 1"));
    let error = Phantom::from_name("teapot").unwrap_err().to_string();
    assert!(error.contains("is not one of constant, shells"), "{error}");

    let mut source = open(&gyroid, [2, 2, 1], SampleType::U8);
    assert!(source.read_slice(&mut Samples::zeros(SampleType::U8, 3)).is_err());
    assert!(source.read_slice(&mut Samples::zeros(SampleType::U16, 4)).is_err());
    let mut slice = Samples::zeros(SampleType::U8, 4);
    source.read_slice(&mut slice).unwrap();
    assert!(source.read_slice(&mut slice).unwrap_err().to_string().contains("rewind"));
}
