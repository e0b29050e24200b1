//! Scenes for studies: dense volumes of codes, and arenas made of them.

use adjsplat::arena::Channels;
use adjsplat::arena::Record;
use adjsplat::arena::layout::Facts;
use adjsplat::arena::{Arena, LaneSet, TileOrder};
use adjsplat::classify::{Colour, Point, TransferFunction};
use adjsplat::file::arena_bytes;
use adjsplat::internals::LanePacker;
use adjsplat::volume::{Axis, Grid};
use adjsplat_study::Subject;
use adjsplat_study::subject::VisibleVoxel;
use adjsplat_tests::random::Random;
use adjsplat_tests::scenes::CODES;

/// A dense volume, x fastest; `None` is not visible.
#[derive(Debug, Clone)]
pub(crate) struct VoxelVolume {
    pub(crate) dims: [u32; 3],
    pub(crate) voxels: Vec<Option<VisibleVoxel>>,
}

impl VoxelVolume {
    /// A volume in which about `per_mille` of 1000 voxels are visible, with random codes.
    pub(crate) fn random(dims: [u32; 3], per_mille: u64, seed: u64) -> VoxelVolume {
        let mut random = Random(seed);
        VoxelVolume::new(dims, |_| {
            let visible = random.below(1000) < per_mille;
            let (value, normal) = (random.below(256) as u8, random.below(65_536) as u16);
            visible.then_some((value, normal))
        })
    }

    /// A volume of these value codes and normals' codes.
    pub(crate) fn new(dims: [u32; 3], mut codes: impl FnMut([u16; 3]) -> Option<(u8, u16)>) -> VoxelVolume {
        let [nx, ny, nz] = dims.map(|d| u16::try_from(d).unwrap());
        let mut voxels = Vec::new();
        for z in 0..nz {
            for y in 0..ny {
                for x in 0..nx {
                    let position = [x, y, z];
                    voxels.push(codes(position).map(|(value, normal)| VisibleVoxel { position, value, normal }));
                }
            }
        }
        VoxelVolume { dims, voxels }
    }

    pub(crate) fn at(&self, [x, y, z]: [u16; 3]) -> Option<VisibleVoxel> {
        let [nx, ny, _] = self.dims.map(|d| d as usize);
        self.voxels[(usize::from(z) * ny + usize::from(y)) * nx + usize::from(x)]
    }

    pub(crate) fn visible(&self) -> impl Iterator<Item = VisibleVoxel> {
        self.voxels.iter().flatten().copied()
    }

    /// Calls `see` with the subject of this volume; `normal_bits` are 0 or 8.
    pub(crate) fn with_subject<T>(&self, normal_bits: u8, see: impl FnOnce(&Subject) -> T) -> T {
        with_subject(self.dims, self.visible(), normal_bits, see)
    }
}

/// Opacity grows with the value, 0.02 to 0.9; colours differ.
fn transfer() -> TransferFunction {
    let colour = |red, green, blue| Colour::from_srgb([red, green, blue]).unwrap();
    let points = vec![
        Point { value: 0.0, colour: colour(0.9, 0.1, 0.2), opacity: 0.02 },
        Point { value: 128.0, colour: colour(0.1, 0.8, 0.3), opacity: 0.1 },
        Point { value: 255.0, colour: colour(0.3, 0.2, 1.0), opacity: 0.9 },
    ];
    TransferFunction::points(points, vec![]).unwrap()
}

/// Calls `see` with the subject of these voxels, which are in scan order.
pub(crate) fn with_subject<T>(
    dims: [u32; 3],
    voxels: impl Iterator<Item = VisibleVoxel>,
    normal_bits: u8,
    see: impl FnOnce(&Subject) -> T,
) -> T {
    let channels = Channels { value_bits: 8, normal_bits, magnitude_bits: 0, coverage_bits: 0, coherence: false };
    let mut packer = LanePacker::new(Axis::X, dims, channels, TileOrder::Morton);
    let mut line: Vec<VisibleVoxel> = Vec::new();
    let mut pack = |line: &mut Vec<VisibleVoxel>| {
        if let Some(&VisibleVoxel { position: [_, y, z], .. }) = line.first() {
            let record = |voxel: &VisibleVoxel| {
                let record = Record { value: voxel.value.into(), normal: voxel.normal.into(), ..Record::default() };
                (voxel.position[0], record)
            };
            packer.line(y, z, line.iter().map(record));
            line.clear();
        }
    };
    for voxel in voxels {
        if line.first().is_some_and(|first| first.position[1..] != voxel.position[1..]) {
            pack(&mut line);
        }
        line.push(voxel);
    }
    pack(&mut line);
    let lane = packer.finish();
    let visible_voxels = lane.view().record_count() - lane.view().stepping_voxels();
    let grid = Grid::new(dims.map(u64::from), [1.0; 3]).unwrap();
    let facts = Facts { grid, channels, tile_order: TileOrder::Morton, scales: CODES, visible_voxels };
    let bytes = arena_bytes(&facts, &[lane], "{}");
    let lanes = LaneSet::new(Arena::new(&bytes).unwrap(), None);
    see(&Subject::new("random", &lanes, transfer()).unwrap())
}
