//! Models: what a library's user builds, walks and draws, judged by plain loops over the samples.

use std::ops::ControlFlow;

use adjsplat::build::{BuildOptions, Observer, Phase, SampleSummary};
use adjsplat::classify::{Quantiser, TransferFunction, WholeNumbers};
use adjsplat::splat::cpu::{Canvas, canvas, memory_need};
use adjsplat::splat::{Camera, Frame, Settings};
use adjsplat::traverse::VoxelBox;
use adjsplat::volume::{Header, PartSource, SampleType, Samples, SlabSource, StatedLabel};
use adjsplat::{Build, Error, Model, Result, Viewpoint, Volume};

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
            found.extend(voxels.iter().map(|voxel| (voxel.position, voxel.normal.expect("values differ everywhere"))));
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

/// Gradients were taken to be at most as steep as without shear: steeper ones had the magnitude of the steepest code, 62 % too little.
#[test]
fn magnitudes_of_a_sheared_grid_do_not_end_at_those_of_a_cubic_one() {
    let (sin, cos) = 75f64.to_radians().sin_cos();
    let samples: Vec<u8> = (0..512).map(|index| if index / 8 % 8 > index % 8 { 200 } else { 0 }).collect();
    let volume = Volume::new([8; 3], samples).unwrap();
    let volume = volume.with_direction([[1.0, 0.0, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]]).unwrap();
    let contour =
        TransferFunction::from_json(r#"{"kind": "contour", "contours": [{"value": 100, "width": 2, "opacity": 1}]}"#)
            .unwrap();
    let model = Build::new(contour).run(&volume).unwrap();
    // Along both axes samples rise by 100 a voxel, in opposite directions.
    let steepest = 100.0 * ((1.0 + sin) * 2.0f64).sqrt() / cos;
    let largest = model.scene().facts.scales.magnitude_scale;
    assert!(largest >= steepest, "{largest}, not {steepest} or more");
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

/// Its normal was [0, 0, 0].
#[test]
fn a_voxel_without_a_gradient_has_no_normal() {
    let build = Build::new(TransferFunction::range(50.0, f64::INFINITY).unwrap());
    let model = build.run(&Volume::new([5; 3], vec![80u8; 125]).unwrap()).unwrap();
    model
        .walk(&Viewpoint::parallel([0.0, 0.0, -1.0]).unwrap(), |voxels| {
            for voxel in voxels.iter() {
                // Faces have normals of their own.
                let is_inside = voxel.position.iter().all(|coordinate| (1..4).contains(coordinate));
                assert_eq!(voxel.normal.is_none(), is_inside, "{voxel:?}");
            }
        })
        .unwrap();
}

/// A coarser level was drawn as a transparent frame of any size.
#[test]
fn settings_that_level_0_refuses_are_refused_for_coarser_levels() {
    let volume = Volume::new([32; 3], (0..32 * 32 * 32).map(|index| (index % 251) as u8).collect()).unwrap();
    let model = Build::new(TransferFunction::range(50.0, f64::INFINITY).unwrap()).with_levels(1).run(&volume).unwrap();
    let good = Settings::new([8; 2]);
    let camera = model.camera(&Camera::orbit(10.0, 20.0), &good).unwrap();
    let reversed = VoxelBox { low: [9; 3], high: [3; 3] };
    for level in [None, Some(0), Some(1)] {
        let good = good.clone().with_level(level);
        assert!(model.render(&camera, &good).is_ok());
        for wrong in [
            good.clone().with_crop(reversed),
            good.clone().with_crop(reversed).with_threads(0),
            good.clone().with_crop(reversed).with_size([0, 8]),
            good.clone().with_crop(reversed).with_size([1 << 31; 2]),
        ] {
            let error = model.render(&camera, &wrong).unwrap_err();
            assert!(matches!(error, Error::Input { .. } | Error::Limit { .. }), "{level:?}: {error}");
        }
    }
    let error = canvas(model.grid(), &reversed, &camera, &good).unwrap_err();
    assert!(error.to_string().starts_with("bounds: "), "{error}");
}

/// Some divided by 0, others overflowed.
#[test]
fn any_number_of_threads_builds_and_draws_the_same() {
    let (volume, few) = (volume(), Build::new(TransferFunction::range(50.0, f64::INFINITY).unwrap()));
    let model = few.run(&volume).unwrap();
    let settings = Settings::new([40; 2]);
    let camera = model.camera(&Camera::orbit(10.0, 20.0), &settings).unwrap();
    let picture = model.render(&camera, &settings.clone().with_threads(1)).unwrap();
    let lattice = Canvas::Lattice { size: [u32::MAX; 2], kept: [u32::MAX; 2], copied: u64::MAX };
    for threads in [1 << 16, 1 << 63, usize::MAX] {
        let many = few.clone().with_threads(threads);
        let built = many.run(&volume).unwrap();
        assert!(built.arena().unwrap().bytes() == model.arena().unwrap().bytes(), "{threads}");
        assert!(many.clone().with_levels(1).run(&volume).is_ok(), "{threads}");
        let settings = settings.clone().with_threads(threads);
        assert!(model.render(&camera, &settings).unwrap() == picture, "{threads}");
        let need = |canvas, tiles| memory_need([9, 7, 5], tiles, canvas, true, &settings);
        assert!(need(Canvas::Picture, 1) >= 1 << 36);
        assert_eq!((need(lattice, 1), need(Canvas::Picture, u64::MAX)), (u64::MAX, u64::MAX));
    }
}

#[test]
fn numbers_too_large_for_memory_are_no_smaller_numbers() {
    // It had no pixels.
    assert!(matches!(Frame::transparent([1 << 31; 2]), Err(Error::OutOfMemory { .. })));
    let grid = adjsplat::volume::Grid { dims: [u32::MAX; 3], ..volume().grid().clone() };
    assert_eq!(grid.points(), u64::MAX);
    let all = WholeNumbers { lowest: i64::MIN, highest: i64::MAX, step: u64::MAX / 2 };
    assert_eq!(Quantiser::exact(all, 16, 1.0, 0.0), None);
}

/// A source of `header` whose slices are `slice`, and which has labels.
struct Given<'a>(&'a Header, Samples, Vec<StatedLabel>);

impl SlabSource for Given<'_> {
    fn header(&self) -> &Header {
        self.0
    }

    fn read_slice(&mut self, slice: &mut Samples) -> Result<()> {
        *slice = self.1.clone();
        Ok(())
    }

    fn rewind(&mut self) -> Result<()> {
        Ok(())
    }

    fn labels(&self) -> Option<&[StatedLabel]> {
        Some(&self.2)
    }
}

/// They panicked, or gave other samples.
#[test]
fn slices_of_another_type_or_length_are_refused_in_one_line() {
    let volume = volume();
    let slices = volume.slices();
    let refused = |result: Result<()>| {
        let line = result.unwrap_err().to_string();
        assert!(line.starts_with("slice buffer: must hold 63 samples of i16, but holds "), "{line}");
    };
    let contour = TransferFunction::contour(60.0).unwrap();
    for wrong in [Samples::zeros(SampleType::I16, 62), Samples::zeros(SampleType::U16, 63)] {
        let given = || Given(slices.header(), wrong.clone(), Vec::new());
        refused(volume.slices().read_slice(&mut wrong.clone()));
        refused(PartSource::new(volume.slices(), [0; 3], [9, 7, 2]).unwrap().read_slice(&mut wrong.clone()));
        refused(Volume::read(&mut given()).map(|_| ()));
        for transfer in [TransferFunction::range(50.0, f64::INFINITY).unwrap(), contour.clone()] {
            refused(Build::new(transfer.clone()).run(given()).map(|_| ()));
            let part = PartSource::new(given(), [1; 3], [3; 3]).unwrap();
            refused(Build::new(transfer).run(part).map(|_| ()));
        }
    }
    let mut part = PartSource::new(volume.slices(), [1; 3], [3; 3]).unwrap();
    assert!(part.read_slice(&mut Samples::zeros(SampleType::I16, 63)).is_err());
}

#[test]
fn a_part_has_the_labels_of_its_volume() {
    let volume = volume();
    let labels = vec![StatedLabel { value: 3, name: "bone".into(), colour: [1, 2, 3] }];
    let slices = volume.slices();
    let given = Given(slices.header(), Samples::zeros(SampleType::I16, 63), labels.clone());
    assert_eq!(PartSource::new(given, [1; 3], [3; 3]).unwrap().labels(), Some(&labels[..]));
}
