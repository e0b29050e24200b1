//! Levels of detail of bricks: side by side they are those of the whole, and pictures choose them as for the whole.
//!
//! Cannot catch: levels of a whole file that are wrong (tests/core/edits/levels.rs judges those).

use std::path::Path;

use adjsplat::arena::layout::SectionKind;
use adjsplat::arena::{Arena, Levels};
use adjsplat::build::{BuildOptions, Unobserved};
use adjsplat::collection::{Collection, Partition, Plan, split};
use adjsplat::splat::{Camera, Orbit, Projection, Quality, Settings};
use adjsplat::volume::{Header, SlabSource as _};
use adjsplat::{Build, Model, TransferFunction, Volume};

use crate::collection::{built, decibels, functions, joined, planned, volumes, voxels};

fn header(volume: &Volume) -> Header {
    volume.slices().header().clone()
}

/// Plans that divide no block of three levels: of 29 x 23 x 26 points, whose blocks are 8 x 4 x 4.
const ALIGNED: [&[[u32; 3]]; 4] = [&[[0, 0, 16]], &[[16, 8, 16]], &[[0, 0, 20], [0, 8, 0], [8, 0, 0]], &[[8, 0, 0]]];

/// The sections of a file, with what they hold, without the limits of its levels.
fn but_for_limits<'a>(arena: &Arena<'a>) -> Vec<(u16, u8, &'a [u8])> {
    let sections = arena.sections().iter().filter(|section| section.known_kind() != Some(SectionKind::LevelLimits));
    sections.map(|section| (section.kind.get(), section.axis, arena.section_bytes(section))).collect()
}

#[test]
fn planned_bricks_with_levels_join_to_the_bytes_of_one_build() {
    let folder = tempfile::tempdir().unwrap();
    for (v, volume) in volumes().iter().enumerate() {
        for (f, options) in functions().into_iter().enumerate() {
            let options = options.with_levels(3);
            let model = Build::new(options.clone()).run(volume).unwrap();
            let arena = model.arena().unwrap();
            assert_eq!(arena.level_count(), 3);
            let bricks = ALIGNED[(v + f) % ALIGNED.len()];
            let path = folder.path().join(format!("{v}-{f}.adjs"));
            let collection = planned(volume, &options, bricks, &path).unwrap();
            assert_eq!(collection.manifest().levels, 3);
            let whole = joined(&collection, &folder.path().join("joined.adj"));
            assert!(whole == arena.bytes(), "volume {v}, function {f}, bricks of {bricks:?}");
            let in_memory = collection.joined_bytes(usize::MAX, u64::MAX, 2, &mut Unobserved).unwrap();
            assert!(but_for_limits(&Arena::new(&in_memory).unwrap()) == but_for_limits(&arena));
            assert!(collection.check().is_empty(), "{:?}", collection.check());
        }
    }
}

#[test]
fn a_check_names_levels_and_their_preview_that_the_manifest_gets_wrong() {
    let folder = tempfile::tempdir().unwrap();
    let options = functions()[0].clone().with_levels(3);
    let plan = Plan::new(&header(&volumes()[0]), options, ALIGNED[0]).unwrap().with_preview(2);
    let (_, collection) = built(&volumes()[0], plan, &folder.path().join("a.adjs")).unwrap();
    assert!(collection.check().is_empty());
    assert!(collection.manifest().preview.as_ref().is_some_and(|preview| preview.level.is_some()));
    let path = collection.path().join("collection.json");
    let sound: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(&path).unwrap()).unwrap();
    let faults_of = |changed: &serde_json::Value| {
        std::fs::write(&path, changed.to_string()).unwrap();
        Collection::open(collection.path()).unwrap().check()
    };
    let mut changed = sound.clone();
    let members = changed.as_object_mut().unwrap();
    members.remove("levels");
    members.remove("preview");
    let faults = faults_of(&changed);
    assert_eq!(faults.len(), collection.bricks().iter().filter(|brick| brick.file.is_some()).count());
    assert!(faults[0].to_string().contains("has 3 levels of detail, but the manifest says 0"), "{faults:?}");
    let mut changed = sound.clone();
    *changed.pointer_mut("/preview/every").expect("a preview") = 7.into();
    let faults = faults_of(&changed);
    assert!(faults.len() == 1 && faults[0].to_string().contains("\"every\""), "{faults:?}");
}

#[test]
fn bricks_of_a_file_with_levels_keep_those_that_no_border_divides() {
    let folder = tempfile::tempdir().unwrap();
    let model = Build::new(functions()[0].clone().with_levels(4)).run(&volumes()[0]).unwrap();
    let arena = model.arena().unwrap();
    // Blocks are 2 x 1 x 1, 4 x 2 x 2, 8 x 4 x 4, 16 x 8 x 8. Of 26 slices in slabs of 8, the last has 2: too thin for level 3.
    let sizes = [
        ([0, 0, 7], 1),
        ([0, 0, 8], 2),
        ([8, 8, 8], 2),
        ([0, 0, 20], 3),
        ([0, 0, 16], 4),
        ([16, 0, 0], 4),
        ([7, 0, 0], 0),
        ([28, 0, 0], 0),
    ];
    for (number, (size, kept)) in sizes.into_iter().enumerate() {
        let partition = Partition::into_boxes(model.grid().dims, size).unwrap();
        let path = folder.path().join(format!("{number}.adjs"));
        let collection = split(&arena, &[partition], None, &path, None, 2, &mut Unobserved).unwrap();
        assert_eq!(collection.manifest().levels, kept, "{size:?}");
        assert!(collection.check().is_empty());
        let bytes = joined(&collection, &folder.path().join("joined.adj"));
        let again = Arena::new(&bytes).unwrap();
        again.check().unwrap();
        assert_eq!((again.level_count(), voxels(&again)), (kept, voxels(&arena)));
        for level in 1..=kept {
            assert!(
                again.level(level).unwrap().bytes() == arena.level(level).unwrap().bytes(),
                "{size:?}, level {level}"
            );
        }
    }
}

#[test]
fn a_plan_whose_bricks_divide_blocks_says_which_sizes_do_not() {
    let header = header(&volumes()[0]);
    let plan = |levels: Levels, bricks: [u32; 3]| {
        Plan::new(
            &header,
            BuildOptions::new(TransferFunction::range(60.0, 240.0).unwrap()).with_levels(levels),
            &[bricks],
        )
    };
    assert_eq!(plan(Levels::Count(3), [0, 0, 16]).unwrap().level_count(), 3);
    // Of 26 slices, 12 + 12 + 2: level 3 has blocks of 4, and the last brick has 1 slice of level 2.
    let told = plan(Levels::Count(4), [0, 0, 12]).unwrap_err().to_string();
    assert!(told.contains("are 4, but these bricks can hold 2") && told.contains("16x8x8"), "{told}");
    assert_eq!(told.lines().count(), 1);
    // Auto takes what the bricks allow; of 29 points, no level is of use.
    assert_eq!(plan(Levels::Auto, [0, 0, 8]).unwrap().level_count(), 0);
    let large = Volume::new([200, 8, 96], vec![100u8; 200 * 8 * 96]).unwrap();
    for (slab, levels) in [(8, 2), (16, 2), (2, 1), (3, 0), (95, 0)] {
        let options = BuildOptions::new(TransferFunction::range(60.0, 240.0).unwrap()).with_levels(Levels::Auto);
        let plan = Plan::new(&self::header(&large), options, &[[0, 0, slab]]).unwrap();
        assert_eq!(plan.level_count(), levels, "{slab}");
        assert_eq!(Plan::from_json(&plan.to_json()).unwrap().level_count(), levels);
    }
}

/// A body of 48 points a side with two levels, whole and in bricks.
fn body(folder: &Path) -> (Model, Collection) {
    let edge = 48u32;
    let at = |index: u32| [index % edge, index / edge % edge, index / (edge * edge)].map(|c| f64::from(c) - 23.5);
    let value = |[x, y, z]: [f64; 3]| (128.0 + 12.0 * (20.0 - (x * x + 1.4 * y * y + z * z).sqrt())).clamp(0.0, 255.0);
    let volume = Volume::new([edge.into(); 3], (0..edge.pow(3)).map(|index| value(at(index))).collect::<Vec<f64>>());
    let volume = volume.unwrap();
    let options = BuildOptions::new(TransferFunction::range(128.0, f64::INFINITY).unwrap()).with_levels(2);
    let model = Build::new(options.clone()).run(&volume).unwrap();
    let bricks = [[0, 0, 12], [0, 12, 0], [12, 0, 0]];
    (model, planned(&volume, &options, &bricks, &folder.join("body.adjs")).unwrap())
}

#[test]
fn joined_bricks_hold_no_level_that_their_picture_does_not_need() {
    let folder = tempfile::tempdir().unwrap();
    let (model, collection) = body(folder.path());
    let whole = model.arena().unwrap();
    for (pixels, quality, level) in [
        (100, Quality::Draft, None),
        (20, Quality::Draft, None),
        (8, Quality::High, None),
        (100, Quality::High, Some(1)),
    ] {
        let settings = Settings::new([pixels, pixels]).with_quality(quality).with_level(level);
        let camera = model.camera(&Orbit::default(), &settings).unwrap();
        let drawn = collection.levels_drawn(model.transfer(), &camera, &settings).unwrap();
        let needed = collection.levels_needed(model.transfer(), &[camera], &settings).unwrap();
        // In a parallel view one level is drawn.
        assert_eq!(Some(&needed), drawn.last(), "{pixels}, {quality:?}, {level:?}");
        let bytes = collection.joined_bytes(needed, u64::MAX, 2, &mut Unobserved).unwrap();
        let arena = Arena::new(&bytes).unwrap();
        assert_eq!(usize::from(arena.level_count()), needed);
        for level in 0..=arena.level_count() {
            assert!(voxels(&arena.level(level).unwrap()) == voxels(&whole.level(level).unwrap()), "level {level}");
        }
    }
    let beyond = Settings::new([8, 8]).with_level(3);
    let camera = model.camera(&Orbit::default(), &beyond).unwrap();
    assert!(collection.levels_needed(model.transfer(), &[camera], &beyond).is_err());
}

#[test]
fn bricks_are_drawn_from_the_levels_that_the_whole_is_drawn_from() {
    let folder = tempfile::tempdir().unwrap();
    let (model, collection) = body(folder.path());
    // (pixels, quality, levels): the body has 48 voxels along each axis.
    for (pixels, quality, level) in [
        (100, Quality::Draft, 0),
        (20, Quality::Draft, 1),
        (7, Quality::Draft, 2),
        (6, Quality::Standard, 1),
        (8, Quality::High, 0),
    ] {
        // A splat on the border between two threads' parts counts twice.
        let settings = Settings::new([pixels, pixels]).with_quality(quality).with_threads(1);
        let camera = model.camera(&Orbit { azimuth: 20.0, elevation: 15.0, ..Orbit::default() }, &settings).unwrap();
        let drawn = collection.levels_drawn(model.transfer(), &camera, &settings).unwrap();
        assert_eq!(drawn.into_iter().collect::<Vec<_>>(), [level], "{pixels}, {quality:?}");
        let (picture, stats) = collection.render(model.transfer(), &camera, &settings).unwrap();
        let (own, of_level) =
            collection.render(model.transfer(), &camera, &settings.clone().with_level(level)).unwrap();
        assert!(picture.pixels() == own.pixels(), "{pixels}, {quality:?}");
        assert_eq!(stats.splats_drawn, of_level.splats_drawn, "{pixels}, {quality:?}");
        let decibels_of = |settings: &Settings| {
            let (picture, _) = collection.render(model.transfer(), &camera, settings).unwrap();
            decibels(model.render(&camera, settings).unwrap().pixels(), picture.pixels())
        };
        let (found, voxels) = (decibels_of(&settings), decibels_of(&settings.clone().with_level(0)));
        println!("{pixels}, {quality:?}: {found:.1} dB, level 0 {voxels:.1} dB");
        // Where several voxels share a pixel, pictures of bricks are put together when pixels are means already.
        assert!(found > 20.0 && found > voxels - 3.0, "{pixels}, {quality:?}: {found:.1} dB, level 0 {voxels:.1} dB");
        if level > 0 {
            let (_, all) = collection.render(model.transfer(), &camera, &settings.clone().with_level(0)).unwrap();
            assert!(stats.splats_drawn * 3 < all.splats_drawn, "{} of {}", stats.splats_drawn, all.splats_drawn);
        }
    }
    // Of one level, slabs across the view are as exact as those of level 0 are.
    for level in 0..=2 {
        let settings = Settings::new([100, 100]).with_quality(Quality::Reference).with_level(level);
        let camera = model.camera(&Orbit { azimuth: 20.0, elevation: 15.0, ..Orbit::default() }, &settings).unwrap();
        let whole = model.render(&camera, &settings).unwrap();
        let (picture, _) = collection.render(model.transfer(), &camera, &settings).unwrap();
        let found = decibels(whole.pixels(), picture.pixels());
        println!("level {level}: {found:.1} dB");
        assert!(found > 110.0, "level {level}: {found:.1} dB");
    }
    let settings = Settings::new([8, 8]).with_level(3);
    let camera = model.camera(&Orbit::default(), &settings).unwrap();
    let told = collection.render(model.transfer(), &camera, &settings).unwrap_err().to_string();
    assert!(told.contains("level") && told.contains("0 to 2"), "{told}");
}

#[test]
fn bricks_far_from_the_eye_are_drawn_coarser_than_near_ones() {
    let folder = tempfile::tempdir().unwrap();
    let (model, collection) = body(folder.path());
    let fov = Projection::Perspective { fov: 50.0 };
    let near = Camera::new([23.0, 60.0, 23.0], [23.5, 0.0, 23.5], [0.0, 0.0, 1.0], fov).unwrap();
    let settings = Settings::new([16, 16]).with_quality(Quality::Draft).with_threads(1);
    let drawn = collection.levels_drawn(model.transfer(), &near, &settings).unwrap();
    assert!(drawn.len() > 1, "{drawn:?}");
    let whole = model.render(&near, &settings).unwrap();
    let (picture, stats) = collection.render(model.transfer(), &near, &settings).unwrap();
    let found = decibels(whole.pixels(), picture.pixels());
    println!("{found:.1} dB");

    assert!(found > 30.0, "{found:.1} dB");
    let (_, all) = collection.render(model.transfer(), &near, &settings.clone().with_level(0)).unwrap();
    assert!(stats.splats_drawn < all.splats_drawn);
}

#[test]
fn a_preview_of_bricks_with_levels_is_a_level() {
    let folder = tempfile::tempdir().unwrap();
    let volume = &volumes()[0];
    let options = functions()[0].clone().with_levels(3);
    let model = Build::new(options.clone()).run(volume).unwrap();
    let arena = model.arena().unwrap();
    // Level 2 has blocks of 4 x 2 x 2; no level has blocks of 5.
    for (every, level) in [(4, Some(2)), (8, Some(3)), (5, None)] {
        let path = folder.path().join(format!("{every}.adjs"));
        let plan = Plan::new(&header(volume), options.clone(), &[[16, 8, 16]]).unwrap().with_preview(every);
        let (plan, collection) = built(volume, plan, &path).unwrap();
        let entry = collection.manifest().preview.clone().unwrap();
        assert_eq!((entry.every, entry.level), (every, level));
        let preview = collection.preview().unwrap().arena().unwrap();
        preview.check().unwrap();
        if let Some(level) = level {
            let of_whole = arena.level(level).unwrap();
            assert_eq!((voxels(&preview), preview.facts()), (voxels(&of_whole), of_whole.facts()));
            // Lengths are those of the whole's voxels.
            let transfer = Model::from_bytes(preview.bytes().to_vec()).unwrap().transfer().clone();
            assert_eq!(transfer.reference_length(), Some(model.grid().mean_spacing()));
        }
        let files = 2 + collection.bricks().iter().filter(|brick| brick.file.is_some()).count();
        assert_eq!(std::fs::read_dir(&path).unwrap().count(), files, "nothing else is left");
        let manifest = std::fs::read(path.join("collection.json")).unwrap();
        plan.finish(&path, &mut Unobserved).unwrap();
        assert!(std::fs::read(path.join("collection.json")).unwrap() == manifest);
        let parts = Partition::into_boxes(model.grid().dims, [16, 8, 16]).unwrap();
        let again = folder.path().join(format!("split-{every}.adjs"));
        let again = split(&arena, &[parts], Some(every), &again, None, 2, &mut Unobserved).unwrap();
        assert!(again.preview().unwrap().arena().unwrap().bytes() == preview.bytes());
    }
}
