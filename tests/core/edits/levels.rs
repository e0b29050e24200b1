//! Levels of detail, judged by a slow twin that goes from voxel to voxel.

use adjsplat::arena::{Arena, Channels, Coverage, LaneRows, Levels, MOST_LEVELS, Record, TileOrder};
use adjsplat::build::Unobserved;
use adjsplat::classify::normal;
use adjsplat::file::{AdjFile, RowsOutput, write_rows};
use adjsplat::limits::Limits;
use adjsplat::volume::Axis;
use adjsplat_tests::random::Random;

use crate::coarser::{Look, Voxels, coarser, coarser_channels, coarser_grid};
use crate::edits::{RandomVoxels as _, VoxelMap};

/// A label map; of two functions the last one counts.
const LABELS: &str = r#"{"transfer_function":{"kind":"range"},"transfer_function":{"labels":[],"kind":"labels"}}"#;

/// A description: without a function, with one that cannot be read, or with one of any kind and of opacities from 0.02 to 1.
fn random_description(random: &mut Random) -> String {
    let mut opacity = || [0.02, 0.05, 0.1, 0.3, 0.6, 0.9, 1.0][random.index(7)];
    let [a, b, c] = [opacity(), opacity(), opacity()];
    let function = match random.below(9) {
        0 => return "{}".to_owned(),
        1 => return LABELS.to_owned(),
        2 => r#"{"kind":"range","low":"all"}"#.to_owned(),
        // Codes 0, 1, 2 stand for 10, 12, 14; there are more of these than of others.
        3 | 4 => {
            let label =
                |label, opacity| format!(r##"{{"label":{label},"name":"","colour":"#ff0000","opacity":{opacity}}}"##);
            format!(r#"{{"kind":"labels","labels":[{},{},{}]}}"#, label(10, a), label(12, b), label(300, c))
        }
        5 => format!(r#"{{"kind":"range","low":11,"high":400,"opacity":{a}}}"#),
        6 => format!(
            r##"{{"kind":"contour","contours":[{{"value":12,"opacity":{a},"width":0}},{{"value":300,"opacity":{b}}}]}}"##
        ),
        _ => format!(
            r##"{{"kind":"points","points":[{{"value":10,"colour":"#ff0000","opacity":{a}}},
                {{"value":14,"colour":"#ff0000","opacity":{b}}},{{"value":9000,"colour":"#ff0000","opacity":{c}}}],
                "gradient":[{{"magnitude":1,"factor":0}},{{"magnitude":5,"factor":{c}}}]}}"##
        ),
    };
    format!(r#"{{"transfer_function":{function}}}"#)
}

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
        coverage_bits: [0, 0, 8, 16][random.index(4)],
        coherence: false,
    };
    let coherence = channels.coverage_bits > 0 && channels.normal_bits > 0 && random.below(2) == 1;
    let channels = Channels { coherence, ..channels };
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
    let (mut deepest, mut hidden) = (0, 0);
    for _ in 0..120 {
        let model = random_model(&mut random);
        let lanes = 1 + random.below(3) as u8;
        let (description, wanted) = (random_description(&mut random), random.below(16) as u8);
        let bytes = with_levels(&model, lanes, Levels::Count(wanted), &description, 1 + random.index(3));
        let look = Look::new(&description, &model.facts.scales, model.facts.grid.mean_spacing());
        let arena = Arena::new(&bytes).expect("opens");
        arena.check().unwrap_or_else(|fault| panic!("{fault}"));
        let (mut grid, mut channels, mut level) = (model.facts.grid.clone(), model.facts.channels, 0);
        let mut expected: Voxels =
            model.voxels.iter().map(|(&[z, y, x], &record)| ([x, y, z].map(u32::from), record)).collect();
        while let Some((coarse, factors)) = coarser_grid(&grid).filter(|_| level < wanted) {
            level += 1;
            let alike = coarser(&expected, channels, grid.spacing, factors, &Look::default());
            expected = coarser(&expected, channels, grid.spacing, factors, &look);
            hidden += u32::from(alike != expected);
            (grid, channels) = (coarse, coarser_channels(channels));
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
    assert!(hidden >= 40, "what lies behind others counts less in many levels: {hidden}");
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
    // The description and the limits.
    assert_eq!(numbers[..2], [None, None]);
    assert_eq!(numbers[2..2 + usize::from(count)], levels);
    assert!(numbers[2 + usize::from(count)..].iter().all(Option::is_none));
}

/// Cubes of `edge` points of which every `every`-th point is visible.
fn cube(edge: u32, every: u32) -> VoxelMap {
    let channels = Channels { value_bits: 8, normal_bits: 0, magnitude_bits: 0, coverage_bits: 0, coherence: false };
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

/// The coverage codes of level `number`, by z, y, x.
fn coverages(arena: &Arena, number: u8) -> Vec<u16> {
    let level = arena.level(number).expect("it is there");
    let mut voxels: Vec<_> = voxels_of(&level, Axis::X).into_iter().collect();
    voxels.sort_by_key(|&([x, y, z], _)| [z, y, x]);
    voxels.into_iter().map(|(_, record)| record.coverage).collect()
}

#[test]
fn a_solid_is_wholly_covered_but_for_its_end() {
    let bytes = with_levels(&cube(5, 1), 1, Levels::Count(MOST_LEVELS), "{}", 1);
    let arena = Arena::new(&bytes).expect("opens");
    assert_eq!(arena.level_count(), 3);
    // Beyond the end of an axis is nothing: the bits of its high points are not set.
    let low_ends = [0x55, 0x33, 0x0f];
    let expected: Vec<u16> = (0..27u32)
        .map(|at| {
            [at % 3, at / 3 % 3, at / 9].iter().zip(low_ends).filter(|(c, _)| **c == 2).fold(0xff, |m, e| m & e.1)
        })
        .collect();
    assert_eq!(coverages(&arena, 1), expected);
    // At the end of an axis lies a quarter of a block, three eighths before its middle. Roots of 1, 1/4, 1/16, 1/64 of 127.
    let expected: Vec<u16> = (0..8u16)
        .map(|at| {
            let ends = [at & 1, at >> 1 & 1, at >> 2];
            let places = (0..3).filter(|&a| ends[a] == 0).map(|a| 3 << (7 + 3 * a)).sum::<u16>();
            [127, 64, 32, 16][ends.iter().sum::<u16>() as usize] | places
        })
        .collect();
    assert_eq!(coverages(&arena, 2), expected);
    let plain = cube(5, 1).bytes(1);
    let lane = Arena::new(&plain).expect("opens").lane(Axis::X).expect("x");
    assert_eq!((lane.coverage_code(0), lane.coverage(0)), (0, Coverage::WHOLE));
}

/// Of an opaque wall the voxels on its faces are seen, and no other: a picture shows their values.
#[test]
fn values_behind_others_do_not_darken_a_level() {
    let channels = Channels { value_bits: 8, normal_bits: 0, magnitude_bits: 0, coverage_bits: 0, coherence: false };
    let mut model = VoxelMap::new([8, 8, 4], channels, TileOrder::Morton);
    model.facts.grid.spacing = [1.0; 3];
    for (x, y, z) in (0..4).flat_map(|z| (0..8).flat_map(move |y| (0..8).map(move |x| (x, y, z)))) {
        let value = if z == 0 || z == 3 { 200 } else { 100 };
        model.put([x, y, z], Some(Record { value, ..Record::default() }));
    }
    let middle = |description: &str| {
        let bytes = with_levels(&model, 1, Levels::Count(1), description, 1);
        let level = Arena::new(&bytes).expect("opens").level(1).expect("it is there");
        voxels_of(&level, Axis::X)[&[1, 1, 0]].value
    };
    assert_eq!(middle(r#"{"transfer_function":{"kind":"range","low":0,"opacity":1}}"#), 200);
    assert_eq!(middle("{}"), 150);
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
