//! Levels of detail, judged by a slow twin that goes from voxel to voxel.

use adjsplat::arena::{Arena, Channels, LaneRows, Levels, MOST_LEVELS, Record, Region, Rows as _, TileOrder};
use adjsplat::build::Unobserved;
use adjsplat::classify::normal;
use adjsplat::file::{AdjFile, RowsOutput, write_rows};
use adjsplat::limits::Limits;
use adjsplat::volume::Axis;
use adjsplat_tests::random::Random;

use crate::coarser::{Voxels, coarser, coarser_grid};
use crate::edits::{RandomVoxels as _, VoxelMap};

const LABELS: &str = r#"{"transfer_function":{"kind":"range"},"transfer_function":{"labels":[],"kind":"labels"}}"#;

/// The voxels of a lane by place.
fn voxels_of(arena: &Arena, axis: Axis) -> Voxels {
    let lane = arena.lane(axis).expect("it is stored");
    let mut voxels = Voxels::new();
    for line in lane.lines() {
        for (t, index) in lane.line_voxels(line.records) {
            let at = match axis {
                Axis::X => [t, line.u, line.v],
                Axis::Y => [line.u, t, line.v],
                Axis::Z => [line.u, line.v, t],
            };
            voxels.insert(at, lane.record(index));
        }
    }
    voxels
}

fn with_levels(model: &VoxelMap, lanes: u8, levels: Levels, description: &str, threads: usize) -> Vec<u8> {
    let plain = model.bytes(1);
    let lane = Arena::new(&plain).expect("sound").lane(Axis::X).expect("it is there");
    let rows = LaneRows::new(lane, |_, _, record| Some(record));
    let folder = tempfile::tempdir().expect("there is a temporary folder");
    let path = folder.path().join("out.adj");
    let facts = model.facts();
    let output = RowsOutput { facts, description, lane_count: lanes, memory: None, threads, levels };
    write_rows(&path, &rows, &output, &mut Unobserved).expect("writes");
    assert_eq!(std::fs::read_dir(folder.path()).expect("it is there").count(), 1, "nothing else stays");
    std::fs::read(&path).expect("it was written")
}

/// Random voxels: noise or a solid, on a grid of any spacing, with any channels.
fn random_model(random: &mut Random) -> VoxelMap {
    let dims = match random.below(3) {
        0 => [(); 3].map(|()| 1 + random.below(40) as u32),
        1 => [1 + random.below(3) as u32, 1 + random.below(90) as u32, 1],
        _ => [700 + random.below(300) as u32, 1 + random.below(9) as u32, 1 + random.below(9) as u32],
    };
    let channels = Channels {
        value_bits: [8, 16][random.index(2)],
        normal_bits: [0, 8, 16][random.index(3)],
        magnitude_bits: [0, 8][random.index(2)],
        coverage_bits: [0, 0, 8][random.index(3)],
    };
    let order = TileOrder::from_code(random.below(3) as u8).expect("there are three");
    let mut model = VoxelMap::new(dims, channels, order);
    let spacings = [[1.0; 3], [0.7, 0.7, 2.0], [1.0, 1.5, 1.3], [3.0, 1.0, 1.0], [1.0, 2f64.sqrt(), 5.0]];
    model.facts.grid.spacing = spacings[random.index(spacings.len())];
    model.facts.grid.origin = [-3.0, 0.1, 1e3];
    model.facts.grid.direction = [[0.6, 0.8, 0.0], [-0.8, 0.6, 0.0], [0.0, 0.0, -1.0]];
    let share = [4, 30, 256][random.index(3)];
    // Few values, so that labels occur more than once in a block.
    let values = [3, 1 << channels.value_bits][random.index(2)];
    for (z, y, x) in (0..dims[2]).flat_map(|z| (0..dims[1]).flat_map(move |y| (0..dims[0]).map(move |x| (z, y, x)))) {
        if random.below(256) < share || (x, y, z) == (0, 0, 0) {
            let mut record = random.record(channels);
            record.value = random.below(values) as u16;
            if random.below(4) == 0 {
                // Opposite normals, which have no mean, and none at all.
                let [up, down] = [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]];
                record.normal = match (channels.normal_bits, random.below(3)) {
                    (0, _) => 0,
                    (8, 0) => normal::encode8(up).into(),
                    (8, 1) => normal::encode8(down).into(),
                    (8, _) => normal::NONE8.into(),
                    (_, 0) => normal::encode16(up),
                    (_, 1) => normal::encode16(down),
                    (_, _) => normal::NONE16,
                };
            }
            model.put([x, y, z], Some(record));
        }
    }
    model
}

#[test]
fn levels_are_what_the_twin_gives_voxel_by_voxel() {
    let mut random = Random(77);
    let mut deepest = 0;
    for _ in 0..120 {
        let model = random_model(&mut random);
        let lanes = 1 + random.below(3) as u8;
        let (is_labels, wanted) = (random.below(3) == 0, random.below(16) as u8);
        let description = if is_labels { LABELS } else { "{}" };
        let bytes = with_levels(&model, lanes, Levels::Count(wanted), description, 1 + random.index(3));
        let arena = Arena::new(&bytes).expect("opens");
        arena.check().unwrap_or_else(|fault| panic!("{fault}"));
        let (mut grid, mut channels, mut level) = (model.facts.grid.clone(), model.facts.channels, 0);
        let mut expected: Voxels =
            model.voxels.iter().map(|(&[z, y, x], &record)| ([x, y, z].map(u32::from), record)).collect();
        while let Some((coarse, factors)) = coarser_grid(&grid).filter(|_| level < wanted) {
            level += 1;
            expected = coarser(&expected, channels, factors, is_labels);
            (grid, channels.coverage_bits) = (coarse, 8);
            let found = arena.level(level).expect("it is there");
            let facts = found.facts();
            assert_eq!((&facts.grid, facts.channels), (&grid, channels), "level {level}");
            assert_eq!((facts.tile_order, facts.scales), (model.facts.tile_order, model.facts.scales));
            assert_eq!(
                (found.lanes().count(), found.level_count(), found.description()),
                (lanes.into(), 0, &b"{}"[..])
            );
            for axis in Axis::ALL.into_iter().take(lanes.into()) {
                let voxels = voxels_of(&found, axis);
                if let Some((a, b)) = voxels.iter().zip(&expected).find(|(a, b)| a != b) {
                    panic!("level {level}, lane {}: {a:?}, not {b:?}, of {:?}", axis.name(), grid.dims);
                }
                assert_eq!(voxels.len(), expected.len());
            }
        }
        assert_eq!(arena.level_count(), level);
        deepest = deepest.max(level);
        // All else of the file is what it is without levels.
        let plain = model.bytes(lanes.into());
        let without = Arena::new(&plain).expect("sound");
        for (a, b) in arena.lanes().zip(without.lanes()) {
            assert!((a.tiles, a.steps, a.values, a.normals) == (b.tiles, b.steps, b.values, b.normals));
        }
    }
    assert!(deepest >= 9, "some grids have many levels: {deepest}");
}

#[test]
fn a_file_without_levels_keeps_its_version_and_its_bytes() {
    let mut random = Random(3);
    let model = random_model(&mut random);
    let coverage = u8::from(model.facts.channels.coverage_bits > 0);
    let plain = with_levels(&model, 3, Levels::Count(0), "{}", 1);
    assert!(plain == model.bytes(3));
    assert_eq!(plain[10], coverage);
    assert_eq!(with_levels(&model, 3, Levels::Count(1), "{}", 1)[10], 1);
}

#[test]
fn the_first_bytes_of_a_file_are_its_coarsest_level() {
    let mut random = Random(5);
    let model = random_model(&mut random);
    let bytes = with_levels(&model, 2, Levels::Count(15), "{}", 1);
    let arena = Arena::new(&bytes).expect("opens");
    let numbers: Vec<_> = arena.sections().iter().map(|section| section.level()).collect();
    let count = arena.level_count();
    let levels: Vec<_> = (1..=count).rev().map(Some).collect();
    assert!(count > 2);
    assert_eq!(numbers[0], None);
    assert_eq!(numbers[1..=count.into()], levels);
    assert!(numbers[1 + usize::from(count)..].iter().all(Option::is_none));
}

/// Cubes of `edge` points of which every `every`-th point is visible.
fn cube(edge: u32, every: u32) -> VoxelMap {
    let channels = Channels { value_bits: 8, normal_bits: 0, magnitude_bits: 0, coverage_bits: 0 };
    let mut model = VoxelMap::new([edge; 3], channels, TileOrder::Morton);
    model.facts.grid.spacing = [1.0; 3];
    for (x, y, z) in (0..edge).flat_map(|z| (0..edge).flat_map(move |y| (0..edge).map(move |x| (x, y, z)))) {
        if x % every == 0 && y % every == 0 && z % every == 0 {
            model.put([x, y, z], Some(Record { value: 7, ..Record::default() }));
        }
    }
    model
}

#[test]
fn auto_ends_where_levels_are_of_no_use() {
    // Points along each axis, distance of voxels, levels: 130 -> 65 -> 33; 62 is too small.
    for (edge, every, count) in [(130, 1, 2), (126, 1, 2), (124, 1, 1), (62, 1, 0), (63, 1, 1), (64, 2, 0), (64, 5, 0)]
    {
        let bytes = with_levels(&cube(edge, every), 1, Levels::Auto, "{}", 2);
        assert_eq!(Arena::new(&bytes).expect("opens").level_count(), count, "{edge} {every}");
    }
    // Too few voxels.
    let mut few = cube(64, 4);
    assert_eq!(few.voxels.len(), 4_096);
    few.put([1, 0, 0], Some(Record::default()));
    for (voxels, count) in [(4_097, 0), (4_095, 0)] {
        few.put([1, 0, 0], None);
        assert!(few.voxels.len() <= voxels);
        let bytes = with_levels(&few, 1, Levels::Auto, "{}", 1);
        assert_eq!(Arena::new(&bytes).expect("opens").level_count(), count);
        few.put([0, 0, 0], None);
    }
}

#[test]
fn a_solid_is_wholly_covered_but_for_its_end() {
    let bytes = with_levels(&cube(5, 1), 1, Levels::Count(MOST_LEVELS), "{}", 1);
    let arena = Arena::new(&bytes).expect("opens");
    assert_eq!(arena.level_count(), 3);
    let level = arena.level(1).expect("it is there");
    let lane = level.lane(Axis::X).expect("it is there");
    let rows = LaneRows::new(lane, |_, _, record| Some(record));
    let mut codes = Vec::new();
    rows.read(Region::at([0; 3], [3; 3]), &mut |_, _, voxels| codes.extend(voxels.iter().map(|v| v.record.coverage)))
        .expect("reads");
    // 255, and the roots of a half, a quarter and an eighth of it.
    let expected: Vec<u8> = (0..27u32)
        .map(|at| [255, 180, 128, 90][[at % 3, at / 3 % 3, at / 9].iter().filter(|&&c| c == 2).count()])
        .collect();
    assert_eq!(codes, expected);
    assert_eq!(Arena::new(&cube(5, 1).bytes(1)).expect("opens").lane(Axis::X).expect("x").coverage_code(0), 255);
}

#[test]
fn limits_hold_for_levels_too() {
    let folder = tempfile::tempdir().expect("there is a temporary folder");
    let path = folder.path().join("a.adj");
    std::fs::write(&path, with_levels(&cube(8, 1), 3, Levels::Count(1), "{}", 1)).expect("writes");
    let file = AdjFile::open(&path).expect("opens");
    let count = |arena: &Arena| u32::try_from(arena.sections().len()).expect("few");
    let arena = file.arena().expect("opens");
    let (whole, level) = (count(&arena), count(&arena.level(1).expect("it is there")));
    assert!(level > whole, "a level has coverages besides");
    for (sections, opens) in [(level, true), (whole, false)] {
        let limits = Limits::default().with_sections(sections);
        let opened = AdjFile::open_with(&path, &limits);
        assert_eq!(opened.is_ok(), opens, "{:?}", opened.map(drop));
    }
}

#[test]
fn a_mapped_file_gives_its_levels_with_its_pager() {
    let folder = tempfile::tempdir().expect("there is a temporary folder");
    let path = folder.path().join("a.adj");
    std::fs::write(&path, with_levels(&cube(40, 1), 3, Levels::Count(2), "{}", 1)).expect("writes");
    let file = AdjFile::open(&path).expect("opens").keep_resident_below(1 << 16).expect("limits");
    let arena = file.arena().expect("opens");
    assert!(arena.level(2).is_some() && arena.level(3).is_none());
    assert!(arena.level(0).is_some_and(|level| level.fingerprint() == arena.fingerprint()));
    assert!(arena.level(1).and_then(|level| level.lane(Axis::Z)).is_some_and(|lane| lane.pager.is_some()));
    arena.check().expect("sound");
}
