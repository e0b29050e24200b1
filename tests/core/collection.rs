//! Collections: bricks join to the bytes of one build, faults name their brick, pictures are near those of the whole.
//!
//! Cannot catch: codes that a single build chooses badly (tests/core/build).

use std::ops::ControlFlow;
use std::path::Path;

use adjsplat::arena::{Arena, LaneRows, Record, Region, Rows as _, TileOrder};
use adjsplat::build::{BuildOptions, Observer, Phase, Resources, Unobserved};
use adjsplat::classify::{Colour, Point};
use adjsplat::collection::{Collection, Findings, Manifest, Partition, Plan, split};
use adjsplat::limits::Limits;
use adjsplat::splat::{Camera, Orbit, Projection, Quality, Settings};
use adjsplat::traverse::Viewpoint;
use adjsplat::volume::{Axis, PartSource};
use adjsplat::{Build, Model, TransferFunction, Volume};
use adjsplat_tests::random::Random;

/// A volume of waves, with values from 0 to 1,000 and a place without any.
fn waves(dims: [u64; 3]) -> Vec<f64> {
    let [nx, ny, nz] = dims;
    let points = (0..nz).flat_map(|z| (0..ny).flat_map(move |y| (0..nx).map(move |x| [x, y, z].map(|c| c as f64))));
    points
        .map(|[x, y, z]| {
            let wave = (x * 0.7).sin() + (y * 0.45 + z * 0.2).cos() + (z * 0.6).sin();
            if x > 20.0 && z > 16.0 { 0.0 } else { (wave + 3.0) / 6.0 * 1000.0 }
        })
        .collect()
}

const DIMS: [u64; 3] = [29, 23, 26];

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from 0 to 1,000")]
pub(crate) fn volumes() -> Vec<Volume> {
    let values = waves(DIMS);
    let grid = |volume: Volume| {
        volume.with_spacing([0.7, 1.0, 1.3]).unwrap().with_origin([-3.3, 0.1, 77.7]).unwrap().with_unit("mm")
    };
    vec![
        grid(Volume::new(DIMS, values.iter().map(|v| (v / 4.0) as u8).collect()).unwrap()),
        grid(Volume::new(DIMS, values.iter().map(|v| *v as i16 - 300).collect()).unwrap()),
        grid(Volume::new(DIMS, values.iter().map(|v| (*v / 200.0) as u16 * 55).collect()).unwrap()),
        grid(
            Volume::new(DIMS, values.iter().map(|v| if *v > 990.0 { f32::NAN } else { *v as f32 / 3.0 }).collect())
                .unwrap(),
        ),
    ]
}

/// Functions that need each kind of agreement: given and open ranges, narrow features, gradients, labels.
pub(crate) fn functions() -> Vec<BuildOptions> {
    let point = |&(value, opacity): &(f64, f64)| Point { value, colour: Colour::from_bytes([200, 120, 40]), opacity };
    let points = [(100.0, 0.0), (101.0, 0.5), (102.0, 0.0), (180.0, 0.0), (250.0, 1.0)];
    let narrow = TransferFunction::points(points.iter().map(point).collect(), Vec::new()).unwrap();
    vec![
        TransferFunction::range(60.0, 240.0).unwrap().into(),
        TransferFunction::range(120.0, f64::INFINITY).unwrap().into(),
        BuildOptions::new(narrow).with_tile_order(TileOrder::Hilbert).with_lane_count(1),
        BuildOptions::new(TransferFunction::contour(150.0).unwrap()).with_normal_bits(16),
        BuildOptions::new(TransferFunction::range(80.0, 200.0).unwrap()).with_value_bits(16).with_normal_bits(0),
    ]
}

/// Builds a collection by a plan, in any order of bricks, with the plan as text between all steps.
pub(crate) fn planned(
    volume: &Volume,
    options: &BuildOptions,
    bricks: &[[u32; 3]],
    folder: &Path,
) -> adjsplat::Result<Collection> {
    let header = adjsplat::volume::SlabSource::header(&volume.slices()).clone();
    built(volume, Plan::new(&header, options.clone(), bricks)?, folder).map(|(_, collection)| collection)
}

/// Does all steps of a plan; returns it, agreed, with the collection.
pub(crate) fn built(volume: &Volume, mut plan: Plan, folder: &Path) -> adjsplat::Result<(Plan, Collection)> {
    let counts: Vec<usize> = plan.partitions()?.iter().map(Partition::len).collect();
    let part = |plan: &Plan, index: usize| {
        let region = plan.samples_of(index).unwrap();
        PartSource::new(volume.slices(), region.low(), region.size()).unwrap()
    };
    let mut rounds = 0;
    while !plan.is_agreed()? {
        plan = Plan::from_json(&plan.to_json())?;
        let scan = |index| plan.scan(index, &mut part(&plan, index), &Resources::default(), &mut Unobserved);
        let found: Vec<_> = (0..counts[0]).rev().map(scan).collect::<adjsplat::Result<_>>()?;
        plan = plan.agree(&found)?;
        rounds += 1;
        assert!(rounds <= 3, "scans come to an end");
    }
    std::fs::create_dir(folder).unwrap();
    let build = |index| plan.build(index, &mut part(&plan, index), folder, &Resources::default(), &mut Unobserved);
    for index in (0..counts.iter().sum()).rev() {
        build(index)?;
    }
    let collection = plan.finish(folder, &mut Unobserved)?;
    Ok((plan, collection))
}

pub(crate) fn joined(collection: &Collection, path: &Path) -> Vec<u8> {
    collection.join(path, None, 2, &mut Unobserved).unwrap();
    std::fs::read(path).unwrap()
}

#[test]
fn planned_bricks_join_to_the_bytes_of_one_build() {
    let folder = tempfile::tempdir().unwrap();
    let mut built = 0;
    for (v, volume) in volumes().iter().enumerate() {
        for (f, options) in functions().iter().enumerate() {
            let whole = Build::new(options.clone()).run(volume).unwrap().arena().unwrap().bytes().to_vec();
            for brick in [[0, 0, 5], [0, 9, 0], [11, 8, 13]] {
                let path = folder.path().join(format!("{v}-{f}-{}.adjs", brick[0]));
                let collection = planned(volume, options, &[brick], &path).unwrap();
                assert!(collection.check().is_empty());
                let bytes = joined(&collection, &folder.path().join("joined.adj"));
                assert!(bytes == whole, "volume {v}, function {f}, bricks of {brick:?}");
                std::fs::remove_dir_all(path).unwrap();
                built += 1;
            }
        }
    }
    assert_eq!(built, 60);
}

#[test]
fn planned_bricks_of_label_maps_and_of_boundaries_join_to_the_bytes_of_one_build() {
    let folder = tempfile::tempdir().unwrap();
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from 0 to 5")]
    let labels = Volume::new(DIMS, waves(DIMS).iter().map(|v| (v / 200.0) as u16 * 400).collect()).unwrap();
    let palette = TransferFunction::preset("labels").unwrap();
    let region = TransferFunction::from_json(
        r##"{"kind": "region", "knots": [{"value": 60, "colour": "#80ffff", "opacity": 0.1},
            {"value": 120, "colour": "#ff4020", "opacity": 0.4}, {"value": 220, "colour": "#ffffff", "opacity": 0.9}]}"##,
    )
    .unwrap();
    assert!(BuildOptions::new(region.clone()).needs_survey());
    let ramp = TransferFunction::preset("mr").unwrap();
    let mut cases: Vec<(Volume, BuildOptions)> = vec![(labels, palette.into())];
    for function in [region, ramp] {
        cases.extend(volumes().into_iter().map(|volume| (volume, function.clone().into())));
    }
    for (c, (volume, options)) in cases.iter().enumerate() {
        let whole = Build::new(options.clone()).run(volume).unwrap().arena().unwrap().bytes().to_vec();
        for brick in [[0, 0, 4], [7, 7, 7]] {
            let path = folder.path().join(format!("{c}-{}.adjs", brick[0]));
            let collection = planned(volume, options, &[brick], &path).unwrap();
            let bytes = joined(&collection, &folder.path().join("joined.adj"));
            assert!(bytes == whole, "case {c}, bricks of {brick:?}");
        }
    }
}

#[test]
fn a_file_that_is_split_joins_to_its_bytes() {
    let folder = tempfile::tempdir().unwrap();
    for (v, volume) in volumes().iter().enumerate() {
        for (f, options) in functions().into_iter().enumerate() {
            let model = Build::new(options).run(volume).unwrap();
            let arena = model.arena().unwrap();
            for size in [[0, 0, 7], [6, 0, 0], [10, 12, 9], [29, 23, 26]] {
                let partition = Partition::into_boxes(model.grid().dims, size).unwrap();
                let path = folder.path().join(format!("{v}-{f}-{size:?}.adjs"));
                let collection = split(&arena, &[partition], None, &path, None, 2, &mut Unobserved).unwrap();
                collection.require_all().unwrap();
                let bytes = joined(&collection, &folder.path().join("joined.adj"));
                assert!(bytes == arena.bytes(), "volume {v}, function {f}, bricks of {size:?}");
            }
        }
    }
}

/// Returns the positions and codes of all voxels of a file.
pub(crate) fn voxels(arena: &Arena) -> Vec<([u32; 3], Record)> {
    let rows = LaneRows::new(arena.lane(Axis::X).unwrap(), |_, _, record| Some(record));
    let mut found = Vec::new();
    let all = Region::at([0; 3], arena.facts().grid.dims);
    rows.read(all, &mut |y, z, row| {
        found.extend(row.iter().map(|voxel| ([voxel.x, y, z].map(u32::from), voxel.record)));
    })
    .unwrap();
    // Rows come in the order of tiles.
    found.sort_by_key(|(at, _)| *at);
    found
}

#[test]
fn a_preview_has_every_nth_voxel_whatever_the_bricks() {
    let folder = tempfile::tempdir().unwrap();
    for (v, options) in [(0, &functions()[0]), (1, &functions()[3]), (2, &functions()[2])] {
        let volume = &volumes()[v];
        let header = adjsplat::volume::SlabSource::header(&volume.slices()).clone();
        let model = Build::new(options.clone()).run(volume).unwrap();
        let arena = model.arena().unwrap();
        for every in [2, 5] {
            let mut previews = Vec::new();
            for (b, sizes) in
                [vec![[0, 0, 4]], vec![[3, 8, 13]], vec![[0, 0, 6], [0, 6, 0], [6, 0, 0]]].iter().enumerate()
            {
                let path = folder.path().join(format!("{v}-{every}-{b}.adjs"));
                let plan = Plan::new(&header, options.clone(), sizes).unwrap().with_preview(every);
                let (plan, collection) = built(volume, plan, &path).unwrap();
                previews.push(collection.preview().unwrap().arena().unwrap().bytes().to_vec());
                assert!(joined(&collection, &folder.path().join("joined.adj")) == arena.bytes());
                // Nothing but the manifest, the preview and the bricks is left; to finish again changes nothing.
                let files = 2 + collection.bricks().iter().filter(|brick| brick.file.is_some()).count();
                assert_eq!(std::fs::read_dir(&path).unwrap().count(), files);
                let manifest = std::fs::read(path.join("collection.json")).unwrap();
                plan.finish(&path, &mut Unobserved).unwrap();
                assert!(std::fs::read(path.join("collection.json")).unwrap() == manifest);

                let parts = Partition::into_boxes(model.grid().dims, sizes[0]).unwrap();
                let path = path.with_extension("split.adjs");
                let collection = split(&arena, &[parts], Some(every), &path, None, 2, &mut Unobserved).unwrap();
                previews.push(collection.preview().unwrap().arena().unwrap().bytes().to_vec());
            }
            for (p, preview) in previews.iter().enumerate() {
                assert!(*preview == previews[0], "volume {v}, every {every}, preview {p}");
            }
            let preview = Model::from_bytes(previews[0].clone()).unwrap();
            let kept = voxels(&arena).into_iter().filter(|(at, _)| at.iter().all(|c| c.is_multiple_of(every)));
            let kept: Vec<_> = kept.map(|(at, record)| (at.map(|c| c / every), record)).collect();
            assert!(voxels(&preview.arena().unwrap()) == kept, "volume {v}, every {every}");
            let (whole, coarse) = (model.grid(), preview.grid());
            assert_eq!(coarse.dims, whole.dims.map(|points| points.div_ceil(every)));
            assert_eq!(coarse.spacing, whole.spacing.map(|spacing| spacing * f64::from(every)));
            assert_eq!(coarse.origin, whole.origin);
            // A voxel is n times as thick, of the same matter.
            assert_eq!(preview.transfer().reference_length(), Some(whole.mean_spacing()));
        }
    }
}

#[test]
fn a_preview_that_is_missing_or_damaged_is_named_and_the_bricks_are_used() {
    let folder = tempfile::tempdir().unwrap();
    let model = Build::new(TransferFunction::range(60.0, 240.0).unwrap()).run(&volumes()[0]).unwrap();
    let arena = model.arena().unwrap();
    let parts = Partition::into_boxes(model.grid().dims, [0, 0, 9]).unwrap();
    let path = folder.path().join("a.adjs");
    split(&arena, &[parts], Some(3), &path, None, 1, &mut Unobserved).unwrap();
    let file = path.join("preview.adj");
    let bytes = std::fs::read(&file).unwrap();
    let mut flipped = bytes.clone();
    flipped[bytes.len() - 200] ^= 1;
    std::fs::write(&file, flipped).unwrap();
    let faults = Collection::open(&path).unwrap().check();
    assert!(faults.len() == 1 && faults[0].to_string().contains("preview.adj"), "{faults:?}");
    std::fs::write(&file, &bytes[..100]).unwrap();
    let cut = Collection::open(&path).unwrap();
    assert!(cut.preview().is_none() && cut.preview_fault().unwrap().to_string().contains("preview.adj"));
    std::fs::remove_file(&file).unwrap();
    let collection = Collection::open(&path).unwrap();
    assert!(collection.preview_fault().unwrap().to_string().contains("preview.adj: is missing"));
    collection.require_all().unwrap();
    assert!(joined(&collection, &folder.path().join("joined.adj")) == arena.bytes());
}

#[test]
fn findings_of_other_plans_other_bricks_or_twice_are_refused() {
    let volume = &volumes()[3];
    let header = adjsplat::volume::SlabSource::header(&volume.slices()).clone();
    let plan = Plan::new(&header, functions()[2].clone(), &[[0, 0, 10]]).unwrap();
    let scan = |plan: &Plan| -> Vec<Findings> {
        let scanned = |index| {
            let region = plan.samples_of(index).unwrap();
            let mut part = PartSource::new(volume.slices(), region.low(), region.size()).unwrap();
            plan.scan(index, &mut part, &Resources::default(), &mut Unobserved).unwrap()
        };
        (0..3).map(scanned).collect()
    };
    let found = scan(&plan);
    let refused = |plan: &Plan, findings: &[Findings]| plan.clone().agree(findings).unwrap_err().to_string();
    assert!(refused(&plan, &found[..2]).contains("scan brick 2 too"));
    let twice = [found.clone(), vec![found[1].clone()]].concat();
    assert!(refused(&plan, &twice).contains("of brick 1 are there twice"));
    let mut beyond = found.clone();
    beyond[2].brick = 7;
    assert!(refused(&plan, &beyond).contains("of brick 7, but there are 3"));
    let once = plan.clone().agree(&found).unwrap();
    assert!(!once.is_agreed().unwrap() && refused(&once, &found).contains("another plan, or of an earlier scan"));
    let other = Plan::new(&header, functions()[0].clone(), &[[0, 0, 10]]).unwrap();
    assert!(refused(&other, &found).contains("another plan"));
    assert!(once.clone().agree(&scan(&once)).unwrap().is_agreed().unwrap());
    // Numbers that no scan finds do not overflow.
    let text = serde_json::to_string(&found).unwrap();
    let number = text.split("\"visible_voxels\":").nth(1).unwrap().split(',').next().unwrap();
    let text = text.replace(&format!("\"visible_voxels\":{number}"), &format!("\"visible_voxels\":{}", u64::MAX));
    let large: Vec<Findings> = serde_json::from_str(&text).unwrap();
    assert!(plan.agree(&large).is_ok());
}

#[test]
fn nothing_visible_says_so_before_a_brick_is_built() {
    let folder = tempfile::tempdir().unwrap();
    let options = TransferFunction::range(5000.0, 6000.0).unwrap().into();
    let volume = &volumes()[1];
    let fault = planned(volume, &options, &[[0, 0, 5]], &folder.path().join("a.adjs")).unwrap_err().to_string();
    assert_eq!(fault, Build::new(options).run(volume).unwrap_err().to_string());
}

/// A collection of eight bricks of the waves, beside the model that it was split from.
fn eight(folder: &Path) -> (Model, Collection) {
    let model = Build::new(TransferFunction::range(60.0, 240.0).unwrap()).run(&volumes()[0]).unwrap();
    let partition = Partition::into_boxes(model.grid().dims, [15, 12, 13]).unwrap();
    let path = folder.join("eight.adjs");
    let collection = split(&model.arena().unwrap(), &[partition], Some(4), &path, None, 1, &mut Unobserved).unwrap();
    assert_eq!(collection.bricks().len(), 8);
    (model, collection)
}

#[test]
fn bricks_that_are_missing_cut_old_or_of_other_codes_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let (model, collection) = eight(folder.path());
    let file = |index: usize| collection.path().join(collection.bricks()[index].entry.file.as_deref().unwrap());
    std::fs::remove_file(file(0)).unwrap();
    let bytes = std::fs::read(file(2)).unwrap();
    std::fs::write(file(2), &bytes[..bytes.len() / 2]).unwrap();
    std::fs::copy(file(4), file(3)).unwrap();
    let other = Build::new(TransferFunction::range(60.5, 239.0).unwrap()).run(&volumes()[3]).unwrap();
    other.save(file(5)).unwrap();
    let damaged = Collection::open(collection.path()).unwrap();
    let faults: Vec<String> = damaged.faults().iter().map(ToString::to_string).collect();
    for (index, (fault, part)) in
        [0, 2, 3, 5].into_iter().zip(faults.iter().zip(["is missing", "R", "another grid", "other codes"]))
    {
        assert!(fault.contains(file(index).to_str().unwrap()) && fault.contains(part), "{fault}");
    }
    assert_eq!(faults.len(), 4);
    let refused = damaged.require_all().unwrap_err().to_string();
    assert!(refused.contains("4 of 8 bricks"), "{refused}");
    let rest = damaged.join(&folder.path().join("rest.adj"), None, 1, &mut Unobserved).unwrap().0;
    assert!(rest.visible_voxels < model.visible_voxels());

    // A byte of a channel: only a check of the whole brick finds it.
    let folder = tempfile::tempdir().unwrap();
    let (_, collection) = eight(folder.path());
    let path = collection.path().join(collection.bricks()[6].entry.file.as_deref().unwrap());
    let mut bytes = std::fs::read(&path).unwrap();
    let at = bytes.len() - 600;
    bytes[at] ^= 1;
    std::fs::write(&path, bytes).unwrap();
    let faults = Collection::open(collection.path()).unwrap().check();
    assert!(faults.len() == 1 && faults[0].to_string().contains(path.to_str().unwrap()), "{faults:?}");
}

#[test]
fn a_check_names_a_preview_of_another_form_than_the_manifest_says() {
    let folder = tempfile::tempdir().unwrap();
    let (_, collection) = eight(folder.path());
    assert!(collection.check().is_empty());
    let path = collection.path().join("collection.json");
    let sound: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(&path).unwrap()).unwrap();
    let cases = [
        ("tile_order", serde_json::json!("hilbert"), "tile order"),
        ("lanes", 1.into(), "number of lanes"),
        ("description", serde_json::json!({}), "transfer function"),
    ];
    for (member, value, part) in cases {
        let mut changed = sound.clone();
        changed[member] = value;
        std::fs::write(&path, changed.to_string()).unwrap();
        let faults = Collection::open(collection.path()).unwrap().check();
        assert!(faults.len() == 1 && faults[0].to_string().contains(part), "{member}: {faults:?}");
    }
}

#[test]
fn a_manifest_that_lies_is_refused_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let (_, collection) = eight(folder.path());
    let path = collection.path().join("collection.json");
    let text = std::fs::read_to_string(&path).unwrap();
    let sound: serde_json::Value = serde_json::from_str(&text).unwrap();
    let change = |pointer: &str, value: serde_json::Value| {
        let mut changed = sound.clone();
        *changed.pointer_mut(pointer).unwrap() = value;
        changed.to_string()
    };
    // Bricks of 15 points divide blocks of two; and 200 levels there never are.
    let with = |pointer: &str, member: &str, value: u8| {
        let mut changed = sound.clone();
        changed.pointer_mut(pointer).unwrap()[member] = value.into();
        changed.to_string()
    };
    let cases = [
        (text[..text.len() / 2].to_owned(), "EOF"),
        (change("/adjs", 2.into()), "version 2"),
        (change("/partitions/0/1/file", "../a.adj".into()), "outside the folder"),
        (change("/partitions/0/1/file", "/etc/passwd".into()), "outside the folder"),
        (change("/partitions/0/1/file", "a/b".into()), "outside the folder"),
        (change("/partitions/0/1/low", serde_json::json!([0, 0, 0])), "do not fill the grid"),
        (change("/partitions/0/1/size/0", u32::MAX.into()), "do not fill the grid"),
        (change("/partitions/0/1/size/0", 0.into()), "do not fill the grid"),
        (change("/partitions/0/1/visible_voxels", 0.into()), "if it has visible voxels"),
        (change("/partitions/0/1/visible_voxels", 1.into()), "sum"),
        (change("/partitions/0/1/visible_voxels", u64::MAX.into()), "sum"),
        (change("/visible_voxels", 7.into()), "sum"),
        (change("/partitions/0", serde_json::json!([])), "sum"),
        (change("/grid/dims/0", 0.into()), "dimension x"),
        (change("/grid/dims/0", 70_000.into()), "dimension x"),
        (change("/grid/spacing/2", 0.0.into()), "spacing z"),
        (change("/partitions", serde_json::json!([])), "0 partitions"),
        (change("/lanes", 4.into()), "lanes"),
        (change("/channels/value_bits", 12.into()), "channels"),
        (change("/preview/file", "../a.adj".into()), "outside the folder"),
        (change("/preview/every", 0.into()), "every 0-th point"),
        (change("/preview/every", 1.into()), "every 1-th point"),
        (with("/preview", "level", 1), "a level that is none of its 0"),
        (with("", "levels", 1), "levels of detail"),
        (with("", "levels", 200), "levels of detail"),
    ];
    for (text, part) in cases {
        std::fs::write(&path, &text).unwrap();
        let fault = Manifest::read(collection.path(), &Limits::default()).unwrap_err().to_string();
        assert!(fault.contains(part) && fault.contains("collection.json"), "{part}: {fault}");
        assert_eq!(fault.lines().count(), 1);
    }
}

#[test]
fn of_two_boxes_on_a_ray_the_nearer_comes_first() {
    let mut random = Random(7);
    let dims = [40, 30, 50];
    let mut compared = 0;
    for _ in 0..200 {
        let size = random.place(dims).map(|side| side + 1);
        let partition = Partition::into_boxes(dims, size).unwrap();
        if partition.len() > 400 {
            continue;
        }
        let boxes: Vec<_> = partition.boxes().collect();
        let mut point = |around: f64| -> [f64; 3] {
            std::array::from_fn(|a| (random.number() - 0.5) * around * f64::from(dims[a]) + f64::from(dims[a]) / 2.0)
        };
        let (eye, toward) = (point(3.0), point(2.0));
        let direction: [f64; 3] = std::array::from_fn(|a| toward[a] - eye[a]);
        let orders = [
            (partition.front_to_back(Viewpoint::parallel(direction).unwrap()).unwrap(), true),
            (partition.front_to_back(Viewpoint::perspective(eye, direction).unwrap()).unwrap(), false),
        ];
        for _ in 0..50 {
            let [start, end] = [point(3.0), point(2.0)];
            for (order, is_parallel) in &orders {
                let start = if *is_parallel { start } else { eye };
                let along: [f64; 3] = if *is_parallel { direction } else { std::array::from_fn(|a| end[a] - start[a]) };
                let mut last = f64::NEG_INFINITY;
                for &index in order {
                    let Some([from, to]) = crossed(&boxes[index], start, along) else { continue };
                    let (from, to) = if *is_parallel { (from, to) } else { (from.max(0.0), to) };
                    if to - from > 1e-9 {
                        assert!(from >= last - 1e-9, "{size:?} {eye:?} {along:?}: box {index}");
                        last = from;
                        compared += 1;
                    }
                }
            }
        }
    }
    assert!(compared > 10_000, "{compared}");
}

/// Returns the part of a ray that lies in a box of cells.
fn crossed(region: &adjsplat::arena::Region, start: [f64; 3], along: [f64; 3]) -> Option<[f64; 2]> {
    let (mut from, mut to) = (f64::NEG_INFINITY, f64::INFINITY);
    for (a, side) in region.sides().into_iter().enumerate() {
        let ends = [f64::from(side.start) - 0.5, f64::from(side.end) - 0.5].map(|end| (end - start[a]) / along[a]);
        from = from.max(ends[0].min(ends[1]));
        to = to.min(ends[0].max(ends[1]));
    }
    (from < to).then_some([from, to])
}

/// Peak signal-to-noise ratio of two pictures, over pixels that are not empty in either.
pub(crate) fn decibels(one: &[f32], other: &[f32]) -> f64 {
    let pixels = one.chunks(4).zip(other.chunks(4)).filter(|(one, other)| one[3] > 0.0 || other[3] > 0.0);
    let (mut sum, mut count) = (0.0, 0.0f64);
    for (one, other) in pixels {
        sum += one.iter().zip(other).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>();
        count += 4.0;
    }
    -10.0 * (sum / count.max(1.0)).max(1e-30).log10()
}

#[test]
fn pictures_by_brick_are_near_those_of_the_whole() {
    let folder = tempfile::tempdir().unwrap();
    let (model, collection) = eight(folder.path());
    let slabs = Partition::into_slabs_of_all_axes(model.grid().dims, 6).unwrap();
    let slabs =
        split(&model.arena().unwrap(), &slabs, None, &folder.path().join("slabs.adjs"), None, 1, &mut Unobserved)
            .unwrap();
    assert!(joined(&slabs, &folder.path().join("joined.adj")) == model.arena().unwrap().bytes());
    let inside =
        Camera::new([6.0, 9.0, 92.0], [9.0, 14.0, 95.0], [0.0, 0.0, 1.0], Projection::Perspective { fov: 70.0 })
            .unwrap();
    // (azimuth, elevation, angle, least decibels with slabs across all axes, and with boxes). Splats that reach across a cut
    // which the view does not look across are composited a brick at a time: in so small a volume a fifth of all.
    let views = [
        (0.0, 90.0, None, 110.0, 25.0),
        (30.0, 70.0, None, 110.0, 25.0),
        (20.0, 15.0, None, 110.0, 25.0),
        (80.0, 5.0, None, 110.0, 25.0),
        (50.0, 40.0, Some(40.0), 60.0, 25.0),
        (10.0, 20.0, Some(75.0), 60.0, 25.0),
    ];
    let settings = Settings::new([120, 90]).with_quality(Quality::Reference);
    let mut cameras: Vec<(Camera, f64, f64)> = views
        .iter()
        .map(|&(azimuth, elevation, fov, one, other)| {
            let orbit = Orbit { azimuth, elevation, fov, ..Orbit::default() };
            assert_eq!(collection.camera(&orbit, &settings).unwrap(), model.camera(&orbit, &settings).unwrap());
            (model.camera(&orbit, &settings).unwrap(), one, other)
        })
        .collect();
    cameras.push((inside, 60.0, 25.0));
    for (index, (camera, with_slabs, with_boxes)) in cameras.iter().enumerate() {
        let whole = model.render(camera, &settings).unwrap();
        for (part, least) in [(&slabs, with_slabs), (&collection, with_boxes)] {
            let (picture, _) = part.render(model.transfer(), camera, &settings).unwrap();
            let found = decibels(whole.pixels(), picture.pixels());
            println!("view {index}: {found:.1} dB");
            assert!(found >= *least, "view {index}: {found:.1} dB, not {least}");
        }
    }
}

/// All bricks were written first.
#[test]
fn a_split_into_boxes_of_another_grid_is_refused_before_a_brick_is_written() {
    struct Unwanted;

    impl Observer for Unwanted {
        fn progress(&mut self, phase: Phase, _: u64, _: u64) -> ControlFlow<()> {
            panic!("{phase:?} of a split that is refused")
        }
    }

    let model = Build::new(functions().remove(0)).run(&volumes()[0]).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let own = Partition::into_boxes(model.grid().dims, [16; 3]).unwrap();
    let other = Partition::into_boxes([29, 23, 27], [16; 3]).unwrap();
    for (partitions, named) in [
        (vec![other.clone()], "partition: is of [29, 23, 27] points, but the grid has [29, 23, 26]"),
        (vec![own.clone(), other], "partition: is of [29, 23, 27] points"),
        (Vec::new(), "split: has 0 partitions"),
        (vec![own; 4], "split: has 4 partitions"),
    ] {
        let path = folder.path().join("a.adjs");
        let made = split(&model.arena().unwrap(), &partitions, None, &path, None, 1, &mut Unwanted);
        let line = made.unwrap_err().to_string();
        assert!(line.starts_with(named) && !path.exists(), "{line}");
    }
    let mut bytes = model.arena().unwrap().bytes().to_vec();
    let at = bytes.windows(2).position(|pair| pair == b"{\"").unwrap();
    bytes[at] = b'?';
    let path = folder.path().join("b.adjs");
    let own = Partition::into_boxes(model.grid().dims, [16; 3]).unwrap();
    let line = split(&Arena::new(&bytes).unwrap(), &[own], None, &path, None, 1, &mut Unwanted).unwrap_err();
    assert!(line.to_string().starts_with("description: is no JSON"), "{line}");
}

#[test]
fn a_grid_without_points_or_with_too_many_boxes_is_refused() {
    let line = Partition::into_boxes([4, 0, 4], [2; 3]).unwrap_err().to_string();
    assert_eq!(line, "dimension y: is 0, but must be at least 1");
    // Their number wrapped around to 0.
    let many = Partition::into_boxes([1 << 31, 1 << 31, 4], [1; 3]);
    assert!(matches!(many, Err(adjsplat::Error::Limit { need: u64::MAX, .. })));
}
