//! Models: what a library's user builds, walks and draws, judged by plain loops over the samples.

use std::ops::ControlFlow;

use adjsplat::build::{BuildOptions, Observer, Phase, SampleSummary};
use adjsplat::classify::TransferFunction;
use adjsplat::{Build, Error, Model, Viewpoint, Volume};

const DIMS: [u64; 3] = [9, 7, 5];

fn sample(position: [u16; 3]) -> i16 {
    let [x, y, z] = position.map(i32::from);
    i16::try_from((x * 37 + y * 101 + z * 59) % 400 - 200).expect("small")
}

fn volume() -> Volume {
    let mut samples = Vec::new();
    for z in 0..5 {
        for y in 0..7 {
            samples.extend((0..9).map(|x| sample([x, y, z])));
        }
    }
    Volume::new(DIMS, samples).unwrap().with_spacing([1.0, 2.0, 0.5]).unwrap()
}

fn model() -> Model {
    Build::new(BuildOptions::new(TransferFunction::range(50.0, f64::INFINITY).unwrap()).with_value_bits(16))
        .run(&volume())
        .unwrap()
}

/// The normals of a shaded model, with the positions of their voxels.
fn normals(volume: &Volume) -> Vec<([u16; 3], [f32; 3])> {
    let transfer = TransferFunction::range(50.0, f64::INFINITY).unwrap();
    let model = Build::new(BuildOptions::new(transfer)).run(volume).unwrap();
    let mut found = Vec::new();
    model
        .walk(&Viewpoint::parallel([0.0, 0.0, -1.0]).unwrap(), |voxels| {
            found.extend(voxels.iter().map(|voxel| (voxel.position, voxel.normal.expect("a shaded function"))));
        })
        .unwrap();
    found
}

#[test]
fn normals_are_in_the_world_whatever_the_grids_axes() {
    let turned = volume().with_direction([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]]).unwrap();
    let (plain, turned) = (normals(&volume()), normals(&turned));
    assert!(plain.len() > 50 && plain.len() == turned.len());
    for ((place, [x, y, z]), (same, world)) in plain.iter().zip(&turned) {
        assert_eq!(place, same);
        assert_eq!(*world, [-z, *x, -y], "{place:?}");
    }
}

/// A tilted gantry shears the grid of a CT scan.
#[test]
fn normals_of_a_sheared_grid_stand_on_surfaces_and_on_faces() {
    let (direction, spacing) = ([[1.0, 0.0, 0.0], [0.6, 0.8, 0.0], [0.0, 0.28, 0.96]], [1.0, 2.0, 0.5]);
    let gradient = [0.3, -0.5, 0.8];
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let mut samples = Vec::new();
    for (z, y, x) in (0..5).flat_map(|z| (0..7).flat_map(move |y| (0..9).map(move |x| (z, y, x)))) {
        let along: [f64; 3] = std::array::from_fn(|a| dot(gradient, direction[a]) * spacing[a]);
        samples.push(1000.0 + dot(along, [f64::from(x), f64::from(y), f64::from(z)]));
    }
    let volume = Volume::new(DIMS, samples).unwrap().with_spacing(spacing).unwrap().with_direction(direction).unwrap();
    let last = [8, 6, 4];
    let mut inside = 0;
    for (place, normal) in normals(&volume) {
        let normal = normal.map(f64::from);
        assert!((dot(normal, normal) - 1.0).abs() < 1e-6, "{place:?}");
        let faces: Vec<usize> = (0..3).filter(|&a| place[a] == 0 || place[a] == last[a]).collect();
        // A component of 8 bits is within 0.0112 along the axes, and those are up to 1.7 times as long in the world.
        if faces.is_empty() {
            inside += 1;
            let cosine = -dot(normal, gradient) / dot(gradient, gradient).sqrt();
            assert!(cosine > 0.9995, "{place:?}: {cosine}");
        }
        if let [face] = faces[..] {
            let out = dot(normal, direction[face]) * if place[face] == 0 { -1.0 } else { 1.0 };
            let flat = (0..3).filter(|&a| a != face).all(|a| dot(normal, direction[a]).abs() < 0.03);
            assert!(out > 0.5 && flat, "{place:?}: {normal:?}");
        }
    }
    assert_eq!(inside, 7 * 5 * 3);
}

#[test]
fn a_walk_hands_over_every_visible_voxel_once_near_ones_first() {
    let mut want: Vec<[u16; 3]> = Vec::new();
    for z in 0..5 {
        for y in 0..7 {
            want.extend((0..9).map(|x| [x, y, z]).filter(|&position| sample(position) >= 50));
        }
    }
    let mut walked = Vec::new();
    let mut distance = f64::NEG_INFINITY;
    model()
        .walk(&Viewpoint::parallel([0.0, 0.0, -1.0]).unwrap(), |voxels| {
            for voxel in voxels.iter() {
                assert_eq!(voxel.value, f64::from(sample(voxel.position)), "{:?}", voxel.position);
                let length: f32 = voxel.normal.expect("a shaded function").iter().map(|part| part * part).sum();
                assert!((length - 1.0).abs() < 0.02 || length == 0.0, "{length}");
                let along = -f64::from(voxel.position[2]);
                assert!(along >= distance, "a far voxel comes before a near one");
                distance = along;
                walked.push(voxel.position);
            }
        })
        .unwrap();
    walked.sort_unstable_by_key(|&[x, y, z]| [z, y, x]);
    assert_eq!(walked, want);
    assert_eq!(model().visible_voxels(), want.len() as u64);
}

#[test]
fn a_model_states_the_unit_of_its_volume() {
    let built = |volume: &Volume| Build::new(TransferFunction::range(50.0, 60.0).unwrap()).run(volume).unwrap();
    assert_eq!(built(&volume().with_unit("mm")).unit().as_deref(), Some("mm"));
    assert_eq!(built(&volume()).unit(), None);
}

#[test]
fn samples_that_do_not_fill_the_grid_are_refused() {
    let error = Volume::new(DIMS, vec![0u8; 314]).unwrap_err().to_string();
    assert_eq!(error, "samples: are 314, but 9 x 7 x 5 points need 315");
    assert!(matches!(Volume::new([0, 1, 1], Vec::<f32>::new()), Err(Error::Input { .. })));
    assert!(matches!(Volume::new([70_000, 1, 1], vec![0u8; 70_000]), Err(Error::Limit { .. })));
    assert!(volume().with_spacing([1.0, f64::NAN, 1.0]).is_err());
    assert!(volume().with_direction([[1.0, 0.0, 0.0]; 3]).is_err());
}

#[test]
fn a_volume_is_what_reading_its_slices_gives() {
    let volume = volume();
    assert_eq!(Volume::read(&mut volume.slices()).unwrap(), volume);
}

#[test]
fn an_observer_receives_the_statistics_of_the_samples() {
    #[derive(Default)]
    struct Kept(Vec<SampleSummary>);

    impl Observer for Kept {
        fn progress(&mut self, _: Phase, _: u64, _: u64) -> ControlFlow<()> {
            ControlFlow::Continue(())
        }

        fn samples(&mut self, samples: &SampleSummary) {
            self.0.push(*samples);
        }
    }

    let (volume, mut kept) = (volume(), Kept::default());
    // The source stays the caller's.
    let mut slices = volume.slices();
    let build = Build::new(TransferFunction::range(50.0, f64::INFINITY).unwrap());
    build.run_observed(&mut slices, &mut kept).unwrap();
    let path = std::env::temp_dir().join(format!("adj-observed-{}.adj", std::process::id()));
    build.write_observed(&volume, &path, &mut kept).unwrap();
    std::fs::remove_file(&path).unwrap();
    let values: Vec<f64> = (0..volume.samples().len()).map(|index| volume.samples().get(index)).collect();
    let (lowest, highest) =
        (values.iter().copied().fold(f64::MAX, f64::min), values.iter().copied().fold(f64::MIN, f64::max));
    assert_eq!(kept.0.len(), 2);
    assert!(kept.0.iter().all(|samples| (samples.lowest, samples.highest, samples.not_finite) == (lowest, highest, 0)));
}

#[test]
fn another_transfer_function_says_what_is_missing() {
    let model = model();
    let wider = TransferFunction::range(0.0, f64::INFINITY).unwrap();
    let missing = model.missing_values(&wider).unwrap();
    assert_eq!(missing.len(), 1);
    assert!(missing[0][0] <= 0.0 && (49.0..=50.0).contains(&missing[0][1]), "{missing:?}");
    let narrower = TransferFunction::range(100.0, f64::INFINITY).unwrap();
    assert!(model.missing_values(&narrower).unwrap().is_empty());
    assert_eq!(
        model.with_transfer(narrower.clone()).unwrap().transfer().opacity(120.0, 0.0),
        narrower.opacity(120.0, 0.0)
    );
}

#[test]
fn a_file_without_a_transfer_function_is_refused_with_its_name() {
    let model = model();
    let mut bytes = model.arena().unwrap().bytes().to_vec();
    let text = b"\"transfer_function\"";
    let at = bytes.windows(text.len()).position(|window| window == text).unwrap();
    bytes[at + 1] = b'T';
    let error = Model::from_bytes(bytes).unwrap_err().to_string();
    assert!(error.contains("stores no transfer function"), "{error}");
}

#[test]
fn a_view_that_is_no_direction_is_refused() {
    assert!(Viewpoint::parallel([0.0; 3]).is_err());
    assert!(Viewpoint::perspective([f64::NAN, 0.0, 0.0], [1.0, 0.0, 0.0]).is_err());
}
