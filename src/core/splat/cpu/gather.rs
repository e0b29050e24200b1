//! Drawing a band of the lattice: tiles take the voxels in front of them, on one thread.
//!
//! In: a drawing task, a [`Lattice`], and rows of its tiles. Out: the band's pixels, composited front to back. Only
//! voxels that an open tile may still show are shaded and put on the list of every tile that their kernels reach. A tile
//! with a full list takes all splats on it at once, while its pixels are in registers:
//!
//! ```text
//! walk -> voxels before open tiles -> colours -> lists of tiles -> for each tile: load, splat after splat, store
//! ```
//!
//! Each tile takes its splats in visit order, so its bits do not depend on when it takes them. In a parallel view all
//! tiles of a slice see the same lattice of voxels. So the weights of kernels at a tile's pixels, the *stamps*, are
//! computed once for a slice.

use std::ops::Range;
use std::time::Instant;

use super::bit_rows::BitRows;
use super::blend::{Blend, FrontToBack};
use super::dispatch;
use super::lattice::{Footprints, Lattice, Place, Slice};
use super::look_tables::LookTables;
use super::project::{Projector, VoxelBlock, limited};
use super::raster::{BLOCK, Splats};
use super::stamps::{EACH, RUN, Reached, Stamps, mask};
use super::task::{BandResult, BandStats, DrawTask};
use super::tile_buffer::{PixelTile, Rect, TILE, TILE_PIXELS, TileBuffer};
use crate::error::Result;
use crate::splat::Code;
use crate::splat::arith::near_absorbed;
use crate::splat::frame::zeroed;
use crate::traverse::{Batch, Visitor, VoxelBox};

/// Longest list of a tile.
const LIST: usize = 128;
/// Number of splats on a tile's list at which the tile takes them: a bit of all greater numbers up to `LIST`.
const FULL: u8 = 64;
/// How many splats are put on lists before tiles with full lists take theirs.
const TOGETHER: usize = LIST - FULL as usize;
/// How many voxels of a line are tested together first.
const GROUP: usize = 16;
/// Number of splats on lists at which all tiles take theirs: what lists refer to stays in the second-level cache.
const WAITING: usize = 8192;
/// Slack of rounded bounds, in voxels or pixels of the plane.
const SLACK: f64 = 1e-3;

/// Draws the rows of tiles from `first` to before `end`; `shown` tells which tiles of the plane the picture may show.
pub(super) fn draw(task: &DrawTask, band: &mut Band, shown: &[bool], [first, end]: [i32; 2]) -> Result<BandResult> {
    band.begin(shown, [first, end])?;
    let mut painter = LatticePainter { task, band };
    let mut stats = task.walk(&mut painter);
    let start = Instant::now();
    dispatch::flush_lattice(band.code, &task.projector, band);
    dispatch::take_all(band.code, &task.projector, band);
    stats.drawing += start.elapsed();
    // Nothing is drawn before the next band begins, which has its own pixels.
    let pixels = std::mem::replace(&mut band.pixels, TileBuffer::new(NO_PIXELS, 0.0)?);
    Ok(BandResult { pixels, stats: BandStats { drawn: band.drawn, ..stats } })
}

/// The smallest rectangle.
const NO_PIXELS: Rect = Rect { x0: 0, y0: 0, x1: 1, y1: 1 };

/// Receives the voxels of a walk and draws them on a band of the lattice.
struct LatticePainter<'a, 'b> {
    task: &'a DrawTask<'a>,
    band: &'a mut Band<'b>,
}

impl LatticePainter<'_, '_> {
    fn is_cropped(&self, bounds: &VoxelBox) -> bool {
        self.task.projector.crop.is_some_and(|crop| !bounds.meets(&crop))
    }
}

impl Visitor for LatticePainter<'_, '_> {
    fn wants_tile(&mut self, bounds: &VoxelBox) -> bool {
        let [slow, medium, _] = self.task.projector.nesting;
        let rows = [bounds.low[slow], bounds.high[slow]]
            .map(|slow| self.band.rows_near(&self.band.lattice.slice(slow), [bounds.low[medium], bounds.high[medium]]));
        let (low, high) = (rows[0][0].min(rows[1][0]), rows[0][1].max(rows[1][1]));
        !self.is_cropped(bounds) && high >= 0 && low < self.band.rows as i32
    }

    fn wants_row(&mut self, bounds: &VoxelBox) -> bool {
        let [slow, medium, fast] = self.task.projector.nesting;
        let band = &*self.band;
        let slice = band.lattice.slice(bounds.low[slow]);
        let [low, high] = band.rows_near(&slice, [bounds.low[medium], bounds.high[medium]]);
        let (low, high) = (low.max(0), high.min(band.rows as i32 - 1));
        if low > high || self.is_cropped(bounds) {
            return false;
        }
        let [left, right] = band.tiles_near(0, &slice, [bounds.low[fast], bounds.high[fast]]);
        (low..=high).any(|row| band.open.any(row as usize, [left, right]))
    }

    fn visit(&mut self, batch: &Batch) {
        let code = self.task.settings.code;
        dispatch::visit_lattice(code, &self.task.projector, self.band, batch);
        // A pager (which loads parts of the file) may drop this batch's records before the next batch.
        if self.task.setup.lane.pager.is_some() {
            dispatch::flush_lattice(code, &self.task.projector, self.band);
        }
    }
}

/// Splats that wait on lists. All arrays have one element a splat.
struct WaitingSplats {
    count: usize,
    /// Red, green, blue, and the optical depth in units of ln 2, for a tile of strength 1.
    looks: Box<[[f32; 4]; WAITING]>,
    /// In a parallel view: the index of the splat's stamp for the first tile of the plane; that of another tile is lower.
    stamps: Box<[i32; WAITING]>,
    /// In a perspective view: the splat's place.
    places: Box<[Place; WAITING]>,
}

/// Returns an array of equal elements.
pub(super) fn boxed<T: Copy + std::fmt::Debug, const N: usize>(element: T) -> Box<[T; N]> {
    vec![element; N].into_boxed_slice().try_into().expect("as many as were asked for")
}

/// A band of the lattice's tiles, and the voxels that one thread is drawing on it.
pub(super) struct Band<'a> {
    /// Selects the instruction set.
    code: Code,
    lattice: &'a Lattice,
    first_row: i32,
    /// Number of columns and rows of tiles.
    columns: usize,
    rows: usize,
    pixels: TileBuffer,
    /// For each tile: whether it may still change.
    open: BitRows,
    /// How many closed tiles are around the band on each side, so that lists need not be clipped to it.
    around: usize,
    /// For each tile, with those around the band: the splats that wait for it, in visit order; how many they are; and 1
    /// if the tile is open, else 0.
    lists: Box<[[u16; LIST]]>,
    counts: Box<[[u8; 2]]>,
    splats: WaitingSplats,
    slow: Option<u16>,
    slice: Slice,
    /// Rows of pixels, from the band's first on, per voxel along the medium axis; the first and the last row that the
    /// kernel of voxel 0 may reach.
    rows_at: [f64; 3],
    /// The stamps of a parallel view.
    stamps: Option<Stamps>,
    /// For each row of tiles: which voxels of a line may be seen by an open tile of the row, and in which slice.
    shown: BitRows,
    shown_at: Vec<Option<u16>>,
    /// The same for several rows of tiles together; and which slice and rows.
    together: BitRows,
    together_of: Option<(u16, [usize; 2])>,
    voxels: Box<VoxelBlock>,
    /// Tables of looks and of light, in a parallel view with many voxels.
    looks: Option<&'a LookTables>,
    /// The colours of the block's voxels.
    block: Box<Splats>,
    /// The tiles that the block's voxels reach: in a parallel view, and in perspective.
    reached: Box<Reached>,
    footprints: Box<Footprints>,
    /// Number of splats drawn.
    drawn: u64,
}

impl<'a> Band<'a> {
    /// Returns what a thread needs to draw bands of at most `rows` rows of tiles, one after another; creates it first if
    /// there is none.
    pub(super) fn of<'b>(
        made: &'b mut Option<Band<'a>>,
        task: &DrawTask,
        lattice: &'a Lattice,
        looks: Option<&'a LookTables>,
        rows: usize,
    ) -> Result<&'b mut Band<'a>> {
        let band = match made.take() {
            Some(band) => band,
            None => Band::new(task, lattice, looks, rows)?,
        };
        Ok(made.insert(band))
    }

    fn new(task: &DrawTask, lattice: &'a Lattice, looks: Option<&'a LookTables>, rows: usize) -> Result<Band<'a>> {
        let columns = lattice.size[0] as usize >> TILE;
        let stamps = lattice.voxels_per_tile().map(|voxels| {
            let depth = task.projector.table.only_depth().map(|depth| limited(depth, lattice.tile([0, 0]).strength));
            Stamps::new(lattice, voxels, depth)
        });
        let around = stamps.as_ref().map_or(RUN, Stamps::reach);
        let tiles = ((columns + 2 * around) * (rows + 2 * around) + RUN) as u64;
        let line = task.setup.lane.dims[task.projector.nesting[2]] as usize;
        let mut block = Splats::new();
        (0..BLOCK).for_each(|j| block.kept[j] = j as u8);
        Ok(Band {
            code: task.settings.code,
            lattice,
            first_row: 0,
            columns,
            rows,
            pixels: TileBuffer::new(NO_PIXELS, 0.0)?,
            open: BitRows::new(columns, rows),
            around,
            lists: zeroed(tiles)?,
            counts: zeroed(tiles)?,
            splats: WaitingSplats {
                count: 0,
                looks: boxed([0.0; 4]),
                stamps: boxed(0),
                places: boxed(Place::default()),
            },
            slow: None,
            slice: Slice { origin: [0.0; 2], step: 1.0 },
            rows_at: [0.0; 3],
            stamps,
            shown: BitRows::new(line, rows),
            shown_at: vec![None; rows],
            together: BitRows::new(line, 1),
            together_of: None,
            voxels: VoxelBlock::new(),
            looks,
            block,
            reached: bytemuck::zeroed_box(),
            footprints: bytemuck::zeroed_box(),
            drawn: 0,
        })
    }

    /// Begins with the rows of tiles from `first` to before `end`.
    fn begin(&mut self, shown: &[bool], [first, end]: [i32; 2]) -> Result<()> {
        let Band { columns, around, .. } = *self;
        (self.first_row, self.rows) = (first, (end - first) as usize);
        let rect = Rect { x0: 0, y0: first << TILE, x1: (columns << TILE) as i32, y1: end << TILE };
        self.pixels = TileBuffer::new(rect, FrontToBack::INITIAL_ALPHA)?;
        self.open.clear_all();
        self.counts.fill([0, 0]);
        for (tile, _) in shown[columns * first as usize..columns * end as usize].iter().enumerate().filter(|(_, s)| **s)
        {
            let (row, column) = (tile / columns, tile % columns);
            self.open.set(row, [column; 2]);
            self.counts[(row + around) * (columns + 2 * around) + around + column] = [0, 1];
        }
        (self.slow, self.together_of, self.drawn) = (None, None, 0);
        self.shown_at.fill(None);
        Ok(())
    }

    /// Returns the first and last tile of the plane, along columns (`side` 0) or rows (1), that kernels of voxels between
    /// `low` and `high` may reach.
    #[inline(always)]
    fn tiles_near(&self, side: usize, slice: &Slice, [low, high]: [u16; 2]) -> [i32; 2] {
        let pixel = |voxel: u16| (f64::from(voxel) - slice.origin[side]) / slice.step;
        let (low, high) = (pixel(low), pixel(high));
        // A kernel reaches pixels whose rays are steeper or flatter than the voxel's own.
        let around = self.lattice.farthest(slice);
        let reach = self.lattice.reach(side, [low - around, high + around]) / slice.step + SLACK;
        [((low - reach).ceil() as i32) >> TILE, ((high + reach).floor() as i32) >> TILE]
    }

    /// Returns the first and last row of tiles, counted from the band's first, that kernels of these voxels may reach.
    #[inline(always)]
    fn rows_near(&self, slice: &Slice, medium: [u16; 2]) -> [i32; 2] {
        self.tiles_near(1, slice, medium).map(|row| row - self.first_row)
    }

    /// Finds the map from the medium axis to rows of tiles of the slice at hand.
    fn set_rows(&mut self) {
        let (slice, first) = (&self.slice, f64::from(self.first_row << TILE));
        let around = self.lattice.farthest(slice);
        let band = [first - around, first + f64::from((self.rows as i32) << TILE) + around];
        let reach = self.lattice.reach(1, band) / slice.step + SLACK;
        let zero = -slice.origin[1] / slice.step - first;
        self.rows_at = [1.0 / slice.step, zero - reach, zero + reach];
    }

    /// Returns the first and last row of tiles of the band, counted from its first, that kernels of a line may reach.
    #[inline(always)]
    fn rows_of(&self, medium: u16) -> [i32; 2] {
        let [per_voxel, low, high] = self.rows_at;
        let at = f64::from(medium) * per_voxel;
        // Positive numbers round down when they become integers; what is before the band does not matter.
        let (low, high) = ((at + low + 1.0).max(0.0) as i32, (at + high).max(-1.0).floor() as i32);
        [low >> TILE, (high >> TILE).min(self.rows as i32 - 1)]
    }

    /// Adds those of a batch's voxels that open tiles may show; draws whenever a block is full.
    #[inline(always)]
    pub(super) fn visit(&mut self, projector: &Projector, batch: &Batch) {
        if self.slow != Some(batch.slow) {
            dispatch::flush_lattice(self.code, projector, self);
            self.slow = Some(batch.slow);
            self.slice = self.lattice.slice(batch.slow);
            self.set_rows();
            self.together_of = None;
            if self.stamps.as_ref().is_some_and(Stamps::is_full) {
                dispatch::take_all(self.code, projector, self);
            }
            if let Some(stamps) = &mut self.stamps {
                stamps.add(self.lattice, &self.slice, self.columns + 2 * self.around, projector.cut);
            }
        }
        let mut from = 0;
        while from < batch.len() {
            let medium = batch.medium[from];
            let to = from + same(&batch.medium[from..]);
            let [low, high] = self.rows_of(medium);
            let axis = projector.nesting[1];
            let is_cropped = projector.crop.is_some_and(|crop| medium < crop.low[axis] || medium > crop.high[axis]);
            if low <= high && !is_cropped {
                self.show(batch.slow, [low as usize, high as usize], projector);
                self.add(projector, batch, from..to);
            }
            from = to;
        }
    }

    /// Makes `together` hold for these rows of tiles.
    #[inline(always)]
    fn show(&mut self, slow: u16, [low, high]: [usize; 2], projector: &Projector) {
        if self.together_of == Some((slow, [low, high])) {
            return;
        }
        self.together_of = Some((slow, [low, high]));
        for row in low..=high {
            if self.shown_at[row] != Some(slow) {
                self.shown_at[row] = Some(slow);
                self.show_row(row, projector);
            }
        }
        self.together.set_to_any(&self.shown, [low, high]);
    }

    /// Computes `shown` of a row of tiles.
    #[inline(always)]
    fn show_row(&mut self, row: usize, projector: &Projector) {
        let Band { lattice, slice, open, shown, .. } = self;
        shown.clear_row(row);
        let fast = projector.nesting[2];
        let [low, high] = projector.crop.map_or([0, u16::MAX], |crop| [crop.low[fast], crop.high[fast]]);
        let last = projector.lane.dims[fast] as i32 - 1;
        open.each_run(row, |[left, right]| {
            let pixels = [4.0 * left as f64, 4.0 * right as f64 + 3.0];
            let reach = lattice.reach(0, pixels) + SLACK;
            let from = (slice.origin[0] + slice.step * pixels[0] - reach).ceil() as i32;
            let to = (slice.origin[0] + slice.step * pixels[1] + reach).floor() as i32;
            let (from, to) = (from.max(low.into()), to.min(high.into()).min(last));
            if from <= to {
                shown.set(row, [from as usize, to as usize]);
            }
        });
    }

    /// Adds those voxels of a line that `together` shows to the block.
    #[inline(always)]
    fn add(&mut self, projector: &Projector, batch: &Batch, range: Range<usize>) {
        for from in range.clone().step_by(GROUP) {
            let group = from..range.end.min(from + GROUP);
            let ends = |ends: [u16; 2], &fast: &u16| [ends[0].min(fast), ends[1].max(fast)];
            let ends = || batch.fast[group.clone()].iter().fold([u16::MAX, 0], ends).map(i32::from);
            if group.len() < GROUP || self.together.any(0, ends()) {
                if !self.voxels.have_room(GROUP) {
                    dispatch::flush_lattice(self.code, projector, self);
                }
                self.voxels.add_marked(batch, group, |fast| self.together.get(0, fast));
            }
        }
    }

    /// Shades the voxels of the block and puts them on lists.
    #[inline(always)]
    pub(super) fn flush(&mut self, projector: &Projector) {
        let count = self.voxels.count.min(BLOCK);
        if count == 0 {
            return;
        }
        if self.splats.count + BLOCK > WAITING {
            dispatch::take_all(self.code, projector, self);
        }
        let block = &mut *self.block;
        block.count = count;
        match self.looks {
            Some(looks) => looks.colour(projector, &self.voxels, block),
            None => {
                block.strength = [if self.stamps.is_some() { self.lattice.tile([0, 0]).strength } else { 1.0 }; BLOCK];
                dispatch::colour(self.code, projector, &self.voxels, block);
            }
        }
        self.wait();
        for from in (0..count).step_by(TOGETHER) {
            let range = from..count.min(from + TOGETHER);
            let filled = match &self.stamps {
                Some(_) => self.list_stamps(range),
                None => self.list_footprints(range),
            };
            for tile in filled {
                if self.counts[tile][0] >= FULL {
                    dispatch::take(self.code, projector, self, tile);
                }
            }
        }
        self.splats.count += count;
        self.voxels.count = 0;
    }

    /// Lets the splats of the block wait.
    #[inline(always)]
    fn wait(&mut self) {
        let Band { voxels, block, splats, lattice, slice, footprints, reached, .. } = self;
        let [_, mediums, fasts] = voxels.positions();
        let first = splats.count.min(WAITING - BLOCK);
        for ((look, ink), peak) in splats.looks[first..first + BLOCK].iter_mut().zip(&block.ink).zip(&block.peak) {
            *look = [ink[0], ink[1], ink[2], *peak];
        }
        match &self.stamps {
            Some(stamps) => {
                let waiting: &mut [i32; BLOCK] = splats.stamps[first..].first_chunk_mut().expect("there is room");
                stamps.place([fasts, mediums], waiting, reached);
            }
            None => {
                footprints.set(lattice, slice, [fasts, mediums]);
                for (j, place) in splats.places[first..first + BLOCK].iter_mut().enumerate() {
                    *place = footprints.place(j);
                }
            }
        }
    }

    /// Puts splats of the block on the lists of tiles, in a parallel view; returns a range of all tiles with full lists.
    #[inline(always)]
    fn list_stamps(&mut self, range: Range<usize>) -> Range<usize> {
        let Band { block, splats, stamps: Some(stamps), reached, lists, counts, drawn, .. } = self else { return 0..0 };
        let pitch = self.columns + 2 * self.around;
        let [left, top] = [0, self.first_row].map(|first| first - self.around as i32);
        let mut filled = [usize::MAX, 0];
        for j in range {
            let j = j % BLOCK;
            if block.peak[j] <= 0.0 {
                continue;
            }
            *drawn += 1;
            let splat = (splats.count + j) as u16;
            let last = (reached.last[1][j] - top) as usize * pitch + (reached.last[0][j] - left) as usize;
            for run in stamps.runs(reached.place[j]) {
                put(lists, counts, last - run.lower as usize, run.mask, splat, &mut filled);
            }
        }
        filled[0]..filled[1]
    }

    /// Does the same in a perspective view.
    #[inline(always)]
    fn list_footprints(&mut self, range: Range<usize>) -> Range<usize> {
        let Band { block, splats, footprints, lists, counts, drawn, columns, rows, first_row, around, .. } = self;
        let pitch = *columns + 2 * *around;
        let mut filled = [usize::MAX, 0];
        for j in range {
            let j = j % BLOCK;
            if block.peak[j] <= 0.0 {
                continue;
            }
            *drawn += 1;
            let splat = (splats.count + j) as u16;
            let [[left, right], [top, bottom]] = footprints.tiles(j);
            let (left, right) = (left.max(0), right.min(*columns as i32 - 1));
            for row in top.max(*first_row)..=bottom.min(*first_row + *rows as i32 - 1) {
                let start = (row - *first_row) as usize + *around;
                let start = start * pitch + *around;
                for column in (left..=right).step_by(RUN) {
                    put(lists, counts, start + column as usize, mask(right - column + 1), splat, &mut filled);
                }
            }
        }
        filled[0]..filled[1]
    }

    /// Lets all tiles take the splats on their lists.
    #[inline(always)]
    pub(super) fn take_all(&mut self, projector: &Projector) {
        for tile in 0..self.counts.len() {
            if self.counts[tile][0] != 0 {
                self.take(projector, tile);
            }
        }
        self.splats.count = 0;
        if let Some(stamps) = &mut self.stamps {
            stamps.keep_last();
        }
    }

    /// Lets a tile take the splats on its list.
    #[inline(always)]
    pub(super) fn take(&mut self, projector: &Projector, tile: usize) {
        let pitch = self.columns + 2 * self.around;
        let (column, row) = (tile % pitch - self.around, tile / pitch - self.around);
        let place = [column as i32, self.first_row + row as i32];
        let Some((_, PixelTile(values))) = self.pixels.tile(place[0], place[1]) else { return };
        let count = usize::from(std::mem::take(&mut self.counts[tile][0])).min(LIST);
        let list = &self.lists[tile][..count];
        let splats = &self.splats;
        let stop = projector.stop;
        let mut pixels = Pixels { values: *values, is_open: true };
        match &self.stamps {
            Some(stamps) => {
                let lower = stamps.voxels.voxels * (place[1] * stamps.size[0] + place[0]);
                for &index in list {
                    let [red, green, blue, depth] = splats.looks[usize::from(index) % WAITING];
                    let stamp = &stamps.stamps[(splats.stamps[usize::from(index) % WAITING] - lower) as usize];
                    if stamps.depth.is_some() {
                        pixels.composite(stamp, [red, green, blue], stop);
                    } else {
                        pixels.composite(&amounts(stamp, depth), [red, green, blue], stop);
                    }
                    if !pixels.is_open {
                        break;
                    }
                }
            }
            None => {
                let rays = self.lattice.tile(place);
                for &index in list {
                    let [red, green, blue, depth] = splats.looks[usize::from(index) % WAITING];
                    let weights = rays.weights(&splats.places[usize::from(index) % WAITING], projector.cut);
                    pixels.composite(&amounts(&weights, limited(depth, rays.strength)), [red, green, blue], stop);
                    if !pixels.is_open {
                        break;
                    }
                }
            }
        }
        *values = pixels.values;
        let is_open = pixels.is_open;
        if !is_open {
            self.open.clear(row, column);
            self.counts[tile][1] = 0;
        }
    }
}

/// Puts a splat on the lists of the tiles of a run, from `first` on, that are open and in `mask`. Extends `filled` by the
/// run if a list is full.
#[inline(always)]
fn put(
    lists: &mut [[u16; LIST]],
    counts: &mut [[u8; 2]],
    first: usize,
    mask: u64,
    splat: u16,
    filled: &mut [usize; 2],
) {
    let lists: Option<&mut [_; RUN]> = lists.get_mut(first..).and_then(|lists| lists.first_chunk_mut());
    let counts: Option<&mut [_; RUN]> = counts.get_mut(first..).and_then(|counts| counts.first_chunk_mut());
    let (Some(lists), Some(counts)) = (lists, counts) else { return };
    // All counts grow at once, in one word.
    let old = u64::from_le_bytes(bytemuck::cast(*counts));
    let new = old + (old >> 8 & mask);
    *counts = bytemuck::cast(new.to_le_bytes());
    for (tile, list) in lists.iter_mut().enumerate() {
        // On a list that does not grow, what is beyond its end does not matter.
        list[(old >> (16 * tile)) as usize % LIST] = splat;
    }
    if new & (EACH * u64::from(FULL)) != 0 {
        *filled = [filled[0].min(first), filled[1].max(first + RUN)];
    }
}

/// Returns how many of the first coordinates are equal.
#[inline(always)]
fn same(coordinates: &[u16]) -> usize {
    const TOGETHER: usize = 32;
    let Some(&first) = coordinates.first() else { return 0 };
    let differs = |part: &[u16]| part.iter().fold(0, |all, other| all | (other ^ first)) != 0;
    let whole = coordinates.chunks(TOGETHER).take_while(|part| !differs(part)).count() * TOGETHER;
    let rest = coordinates.get(whole..).unwrap_or_default();
    coordinates.len().min(whole + rest.iter().take_while(|other| **other == first).count())
}

/// Returns the part of the light that a splat of optical depth `peak` takes, for its weights.
#[inline(always)]
fn amounts(weights: &[f32; TILE_PIXELS], peak: f32) -> [f32; TILE_PIXELS] {
    let mut amounts = [0.0; TILE_PIXELS];
    for i in 0..TILE_PIXELS {
        amounts[i] = near_absorbed(peak * weights[i]);
    }
    amounts
}

/// The pixels of a tile while it takes splats.
struct Pixels {
    values: [[f32; TILE_PIXELS]; 4],
    is_open: bool,
}

impl Pixels {
    /// Composites a splat of which each pixel takes a part, `amounts`.
    #[inline(always)]
    fn composite(&mut self, amounts: &[f32; TILE_PIXELS], colour: [f32; 3], stop: f32) {
        let [red, green, blue, clear] = &self.values;
        self.values = [
            blended(red, clear, amounts, colour[0], stop),
            blended(green, clear, amounts, colour[1], stop),
            blended(blue, clear, amounts, colour[2], stop),
            blended(clear, clear, amounts, FrontToBack::ALPHA_INK, stop),
        ];
        self.is_open = false;
        for i in 0..TILE_PIXELS {
            self.is_open |= self.values[3][i] >= stop;
        }
    }
}

/// Returns one colour, or the transmittance, of a tile's pixels after a splat.
#[inline(always)]
fn blended(
    values: &[f32; TILE_PIXELS],
    clear: &[f32; TILE_PIXELS],
    amounts: &[f32; TILE_PIXELS],
    ink: f32,
    stop: f32,
) -> [f32; TILE_PIXELS] {
    let mut new = [0.0; TILE_PIXELS];
    for i in 0..TILE_PIXELS {
        new[i] = FrontToBack::blend(values[i], clear[i], amounts[i], ink, stop);
    }
    new
}
