//! Few voxels in large grids, and damaged lanes: the work follows the voxels, and can be stopped.

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicU64, Ordering};

use adjsplat::arena::layout::{Facts, Scales};
use adjsplat::arena::{Channels, CoarserRows, LaneRows, LevelLook, Levels, Record, Region, Rows, TileOrder, Voxel};
use adjsplat::build::{Observer, Phase};
use adjsplat::error::{Error, Result};
use adjsplat::file::{RowsOutput, write_rows};
use adjsplat::volume::{Axis, Grid};
use adjsplat_tests::files::Folder;
use adjsplat_tests::random::Random;
use adjsplat_tests::scenes::lane;

const CHANNELS: Channels =
    Channels { value_bits: 8, normal_bits: 0, magnitude_bits: 0, coverage_bits: 0, coherence: false };

/// Voxels by ascending z, y, x in a cube of `side` points, which counts how often it is read.
struct Sparse {
    side: u32,
    voxels: Vec<[u16; 3]>,
    reads: AtomicU64,
}

impl Sparse {
    /// 50 voxels, one in each slice of a part of the slices.
    fn new(side: u32) -> Sparse {
        let step = u16::try_from(side / 50).expect("16 bits");
        let voxels = (0..50u16).map(|i| [i * step, i * 37 % 50 * step, i * step]).collect();
        Sparse { side, voxels, reads: AtomicU64::new(0) }
    }

    fn inside(&self, region: &Region) -> impl Iterator<Item = [u16; 3]> {
        let is_inside = |voxel: &[u16; 3]| (0..3).all(|a| region.sides()[a].contains(&voxel[a].into()));
        self.voxels.iter().copied().filter(is_inside)
    }
}

impl Rows for Sparse {
    fn dims(&self) -> [u32; 3] {
        [self.side; 3]
    }

    fn channels(&self) -> Channels {
        CHANNELS
    }

    fn is_void(&self, region: &Region) -> bool {
        self.inside(region).next().is_none()
    }

    fn read(&self, region: Region, row: &mut dyn FnMut(u16, u16, &[Voxel])) -> Result<()> {
        self.reads.fetch_add(1, Ordering::Relaxed);
        for [x, y, z] in self.inside(&region) {
            row(y, z, &[Voxel { x, record: Record { value: 200, ..Record::default() } }]);
        }
        Ok(())
    }
}

fn facts(side: u32) -> Facts {
    Facts {
        grid: Grid::new([side.into(); 3], [1.0; 3]).expect("a grid"),
        channels: CHANNELS,
        tile_order: TileOrder::Rows,
        scales: Scales { value_low: 0.0, value_step: 1.0, magnitude_scale: 0.0 },
        visible_voxels: 50,
    }
}

#[test]
fn a_level_of_few_voxels_in_a_large_grid_reads_no_empty_parts() {
    let (rows, look) = (Sparse::new(60_000), LevelLook::default());
    let coarser = CoarserRows::new(&rows, [1.0; 3], [2; 3], &look, 1);
    assert_eq!(coarser.count().unwrap(), 50);
    assert!(rows.reads.load(Ordering::Relaxed) <= 50, "{} reads of 50 voxels", rows.reads.into_inner());
}

#[test]
fn rows_of_a_lane_know_which_parts_are_void() {
    let side = 60;
    let mut random = Random(5);
    let record = |[x, y, z]: [u16; 3]| {
        let is_there = (x / 3 * 7 + y / 9 * 5 + z / 11 * 3) % 23 == 0;
        is_there.then(|| Record { value: 1, ..Record::default() })
    };
    let lane = lane(Axis::X, [side; 3], CHANNELS, TileOrder::Hilbert, record);
    let window = Region::at([7, 3, 5], [50, 49, 47]);
    let mut void = 0;
    for rows in [LaneRows::new(lane.view(), keep), LaneRows::new(lane.view(), keep).cropped(&window)] {
        for _ in 0..500 {
            let mut three = |most: u64| [0; 3].map(|_: u32| u32::try_from(random.below(most)).unwrap());
            let region = Region::at(three(70), three(40));
            let mut voxels = 0;
            rows.read(region.clone(), &mut |_, _, row| voxels += row.len()).unwrap();
            assert!(voxels == 0 || !rows.is_void(&region), "{region:?} has {voxels} voxels");
            void += u32::from(rows.is_void(&region));
        }
    }
    assert!(void > 100, "{void} parts are void");
}

fn keep(_: [u16; 3], _: usize, record: Record) -> Option<Record> {
    Some(record)
}

/// Stops at the second report.
struct Stop(u32);

impl Observer for Stop {
    fn progress(&mut self, _: Phase, _: u64, _: u64) -> ControlFlow<()> {
        self.0 += 1;
        if self.0 >= 2 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }
}

#[test]
fn a_stop_is_heard_while_the_voxels_of_a_lane_are_counted() {
    let (folder, rows) = (Folder::new(), Sparse::new(4_000));
    let output = RowsOutput {
        facts: facts(4_000),
        description: "{}",
        lane_count: 1,
        memory: None,
        threads: 1,
        levels: Levels::default(),
    };
    let stopped = write_rows(&folder.file("a.adj"), &rows, &output, &mut Stop(0));
    assert!(matches!(stopped, Err(Error::Interrupted)), "{stopped:?}");
    assert!(rows.reads.load(Ordering::Relaxed) <= 1, "{} reads", rows.reads.into_inner());
}

#[test]
fn lines_that_share_records_have_no_more_in_all_than_the_lane() {
    let lane = lane(Axis::X, [40, 8, 8], CHANNELS, TileOrder::Morton, |_| Some(Record::default()));
    let tiles = vec![lane.tiles[0]; 1_000];
    let forged = adjsplat::arena::Lane { tiles: &tiles, ..lane.view() };
    let records: usize = forged.lines().map(|line| line.records.len()).sum();
    assert_eq!(records, lane.steps.len());
}
