//! Draws splats of voxels that arrive one by one, from any walk.
//!
//! In: positions, looks (colour and optical depth) and normals in visit order, front to back, from structures other
//! than lanes. Out: a frame; the same voxels in the same order give the same bits as `cpu::render`. It uses one thread
//! and no crop. A cube of voxels (a node of an octree) is one splat, whose kernel is wider by the cube's edge in
//! voxels.

use multiversion::multiversion;

use adjsplat::classify::normal;
use adjsplat::error::{Error, Result};
use adjsplat::internals::FrameSetup;
use adjsplat::internals::scatter::{
    BLOCK, BandResult, BandStats, Blend, Coordinates, FrontToBack, GROUP, Look, Projector, Rect, Splats, Table,
    TileBuffer, VoxelBlock, assemble, draw_block, project_block,
};
use adjsplat::splat::{Camera, Code, Frame, Mode, Scene, Settings};
use adjsplat::traverse::{Batch, Sense};

/// Number of cube levels: the edge of a cube is below 2 to this power, in voxels.
const LEVELS: usize = 17;

/// Draws the voxels and cubes that it receives.
pub(crate) struct Splatter<'a> {
    /// For each level (base-2 logarithm of a cube's edge), what projects its cubes; voxels are level 0.
    projectors: Vec<Projector<'a>>,
    /// For each value code (stored number of a value), its colour and optical depth.
    looks: [Look; 256],
    slow_medium_fast: [usize; 3],
    drawing: bool,
    splats: Box<Splats>,
    tiles: TileBuffer,
    level: usize,
    /// Voxels of a lane's batch that wait to be drawn.
    voxels: Box<VoxelBlock>,
    block: Block,
}

/// Voxels that are collected until the block is full, and then drawn together.
struct Block {
    count: usize,
    /// Coordinates of the voxels along the slow, medium and fast axis.
    at: [[f64; BLOCK]; 3],
    looks: [Look; BLOCK],
    codes: [u16; BLOCK],
    normals: [[f32; BLOCK]; 3],
    /// Whether normals are codes (`codes`), not vectors (`normals`).
    coded: bool,
}

impl Coordinates for Block {
    #[inline(always)]
    fn at(&self, j: usize) -> [f64; 3] {
        [self.at[0][j], self.at[1][j], self.at[2][j]]
    }
}

impl Splatter<'_> {
    /// Adds a voxel by the codes (stored numbers) of its value and normal.
    #[inline(always)]
    pub(crate) fn coded(&mut self, position: [u16; 3], value: u8, normal: u16) {
        let place = self.room(0, true);
        self.block.codes[place] = normal;
        self.put(place, position.map(f64::from), self.look(value));
    }

    /// Returns the look (colour and optical depth) of a value code.
    #[inline(always)]
    pub(crate) fn look(&self, value: u8) -> Look {
        self.looks[usize::from(value)]
    }

    /// Adds a cube of voxels of edge `1 << level` with its lowest voxel at `low`; `level` 0 is a voxel. Its normal is a
    /// unit vector, or 0 if it has none.
    #[inline(always)]
    pub(crate) fn cube(&mut self, low: [u16; 3], level: u8, look: Look, normal: [f32; 3]) {
        let place = self.room(usize::from(level), false);
        for (array, part) in self.block.normals.iter_mut().zip(normal) {
            array[place] = part;
        }
        let half = f64::from((1u32 << level) - 1) / 2.0;
        self.put(place, low.map(|c| f64::from(c) + half), look);
    }

    #[inline(always)]
    fn put(&mut self, place: usize, position: [f64; 3], look: Look) {
        for (array, axis) in self.block.at.iter_mut().zip(self.slow_medium_fast) {
            array[place] = position[axis];
        }
        self.block.looks[place] = look;
        self.block.count = place + 1;
    }

    /// Returns the index in the block for the next voxel, and first draws the block if the voxel cannot join it.
    #[inline(always)]
    fn room(&mut self, level: usize, coded: bool) -> usize {
        if self.block.count == BLOCK || level != self.level || coded != self.block.coded {
            self.flush();
            (self.level, self.block.coded) = (level.min(LEVELS - 1), coded);
        }
        self.block.count % BLOCK
    }

    /// Adds a batch of voxels from the lane that the order needs.
    pub(crate) fn batch(&mut self, batch: &Batch) {
        self.flush();
        for from in (0..batch.len()).step_by(GROUP) {
            if !self.voxels.have_room(GROUP) {
                self.flush_voxels();
            }
            self.voxels.add(batch, from, GROUP);
        }
        self.flush_voxels();
    }

    fn flush_voxels(&mut self) {
        let Splatter { projectors, voxels, splats, tiles, .. } = self;
        project_block(Code::Best, &projectors[0], voxels, splats, tiles);
        if self.drawing {
            draw_block::<FrontToBack>(Code::Best, &projectors[0], splats, tiles);
        }
        self.voxels.count = 0;
    }

    fn flush(&mut self) {
        while self.projectors.len() <= self.level {
            let edge = 1 << self.projectors.len();
            self.projectors.push(self.projectors[0].of_cubes(edge));
        }
        let Splatter { splats, tiles, .. } = self;
        let projector = &self.projectors[self.level];
        place_and_shade(projector, &mut self.block, splats, tiles);
        if self.drawing {
            draw_block::<FrontToBack>(Code::Best, projector, splats, tiles);
        }
    }
}

/// Places and shades the voxels of a block (stage 1 of the renderer); the block is empty afterwards.
#[multiversion(targets("x86_64+avx+avx2+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx+avx2"), dispatcher = "direct")]
fn place_and_shade(projector: &Projector, block: &mut Block, splats: &mut Splats, tiles: &TileBuffer) {
    projector.place(block, splats);
    projector.place_near(block.count, block, splats);
    projector.cull(block.count, [true; BLOCK], splats, tiles);
    for k in 0..splats.count {
        let j = usize::from(splats.kept[k]) % BLOCK;
        splats.looks[k] = block.looks[j];
    }
    splats.apply_strengths();
    if let Some(lights) = &projector.lights {
        let mut normals = [[0.0f32; BLOCK]; 3];
        if block.coded {
            let mut codes = [0; BLOCK];
            for (code, &j) in codes.iter_mut().zip(&splats.kept[..splats.count]) {
                *code = block.codes[usize::from(j) % BLOCK];
            }
            for (k, &code) in codes.iter().enumerate() {
                [normals[0][k], normals[1][k], normals[2][k]] = normal::decode8(code);
            }
        } else {
            for (k, &j) in splats.kept[..splats.count].iter().enumerate() {
                (0..3).for_each(|a| normals[a][k] = block.normals[a][usize::from(j) % BLOCK]);
            }
        }
        projector.light(lights, (&normals, None), block, &splats.kept[..splats.count], &mut splats.looks);
    }
    block.count = 0;
}

/// Returns the picture of the voxels that `feed` gives to the splatter, in the order of the view.
///
/// `settings` must ask for front-to-back compositing. Without `drawing`, all work but the drawing itself is done.
///
/// # Errors
/// Any error of `cpu::render`, and any error that `feed` returns.
pub(crate) fn splat(
    scene: &Scene,
    camera: &Camera,
    settings: &Settings,
    drawing: bool,
    feed: impl FnOnce(&mut Splatter) -> Result<()>,
) -> Result<Frame> {
    let settings = settings.clone().with_sense(Sense::FrontToBack).with_mode(Mode::Composite).with_crop(None);
    let setup = FrameSetup::new(scene, camera, &settings)?;
    let table = Table::new(scene, &setup.lane, &settings, setup.view.mean_voxel)?;
    let looks =
        *table.of_bytes().ok_or_else(|| Error::input("values", "have 16 bits, or looks depend on gradients"))?;
    let projector = Projector::new(&setup, &table, settings.termination());
    let [columns, rows] = settings.size.map(u32::cast_signed);
    let rect = Rect { x0: 0, y0: 0, x1: columns, y1: rows };
    let tiles = TileBuffer::new(rect, FrontToBack::INITIAL_ALPHA)?.with_rays(projector.is_perspective())?;
    let mut splatter = Splatter {
        looks,
        slow_medium_fast: projector.slow_medium_fast,
        projectors: vec![projector],
        drawing,
        splats: Splats::new(),
        tiles,
        level: 0,
        voxels: VoxelBlock::new(),
        block: Block {
            count: 0,
            at: [[0.0; BLOCK]; 3],
            looks: [[0.0; 4]; BLOCK],
            codes: [0; BLOCK],
            normals: [[0.0; BLOCK]; 3],
            coded: true,
        },
    };
    feed(&mut splatter)?;
    splatter.flush();
    let band = BandResult { tiles: splatter.tiles, stats: BandStats::default() };
    Ok(assemble(&[band], settings.size, settings.threads, &table)?.0)
}
