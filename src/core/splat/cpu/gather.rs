//! Drawing a band of the lattice: tiles take the voxels in front of them, on one thread.
//!
//! In: a drawing task, a [`Lattice`], and rows of its tiles. Out: the band's pixels, composited front to back. A voxel
//! that an open tile may still show is shaded and put on the list of every open tile that its kernel reaches. A tile
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

use super::blend::{Blend, FrontToBack};
use super::dispatch;
use super::lattice::{Footprints, Lattice, Place, Slice};
use super::look_tables::LookTables;
use super::open_tiles::OpenTiles;
use super::project::{Projector, VoxelBlock, limited};
use super::raster::{BLOCK, Splats};
use super::stamps::Stamps;
use super::task::{BandResult, BandStats, DrawTask};
use super::tile_buffer::{PixelTile, Rect, TILE, TILE_PIXELS, TileBuffer};
use crate::error::{Error, Result};
use crate::splat::Code;
use crate::splat::arith::near_absorbed;
use crate::traverse::{Batch, Visitor, VoxelBox};

/// Longest list of a tile.
const LIST: usize = 128;
/// Number of splats on a tile's list at which the tile takes them.
const FULL: usize = 96;
/// The count of a tile that does not change any more.
const CLOSED: u8 = u8::MAX;
/// Number of splats on lists at which all tiles take theirs: what lists refer to stays in the second-level cache.
const WAITING: usize = 8192;
/// How many voxels are tested together before there must be room for all of them in a block.
const GROUP: usize = 32;
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

/// A splat that waits on the lists of tiles.
#[derive(Debug, Clone, Copy)]
struct WaitingSplat {
    /// Index of its stamp for the first tile of the plane, in a parallel view; that of another tile is lower.
    stamp: i32,
    /// Optical depth in units of ln 2, for a tile of strength 1.
    depth: f32,
    colour: [f32; 3],
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
    open: OpenTiles,
    /// How many closed tiles are around the band on each side, so that lists need not be clipped to it.
    around: usize,
    /// For each tile, with those around the band: indices into `splats`, in visit order, and how many there are.
    lists: Vec<[u16; LIST]>,
    counts: Vec<u8>,
    /// The tiles with full lists.
    full: Vec<u32>,
    splats: Vec<WaitingSplat>,
    /// The places of `splats`, in a perspective view.
    places: Vec<Place>,
    slow: Option<u16>,
    slice: Slice,
    /// The stamps of a parallel view.
    stamps: Option<Stamps>,
    /// For each row of tiles and each place on the fast axis: 1 if a voxel there may be seen by an open tile of the row.
    shown_by_row: Vec<u8>,
    /// Length of the fast axis.
    line: usize,
    /// The slice for which a row of `shown_by_row` holds.
    shown_at: Vec<Option<u16>>,
    /// The same for several rows of tiles together, and which rows and slice these are.
    shown_together: Box<[u8; 1 << 16]>,
    together: Option<(u16, [usize; 2])>,
    /// Tables of looks and of light, in a parallel view with many voxels.
    looks: Option<&'a LookTables>,
    voxels: Box<VoxelBlock>,
    block: Box<Splats>,
    /// The footprints of the block's voxels, in a perspective view.
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
        let around = stamps.as_ref().map_or(0, Stamps::reach);
        let tiles = (columns + 2 * around) * (rows + 2 * around);
        let refused = |_| Error::out_of_memory("the picture", (tiles * size_of::<[u16; LIST]>()) as u64);
        let mut lists = Vec::new();
        lists.try_reserve_exact(tiles).map_err(refused)?;
        lists.resize(tiles, [0; LIST]);
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
            open: OpenTiles::new(columns, rows),
            lists,
            counts: vec![CLOSED; tiles],
            around,
            full: Vec::new(),
            splats: Vec::with_capacity(WAITING),
            places: Vec::new(),
            slow: None,
            slice: Slice { origin: [0.0; 2], step: 1.0 },
            stamps,
            shown_by_row: vec![0; line * rows],
            line,
            shown_at: vec![None; rows],
            shown_together: vec![0; 1 << 16].into_boxed_slice().try_into().expect("as many as were asked for"),
            together: None,
            voxels: VoxelBlock::new(),
            looks,
            block,
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
        self.counts.fill(CLOSED);
        for (tile, _) in shown[columns * first as usize..columns * end as usize].iter().enumerate().filter(|(_, s)| **s)
        {
            let (row, column) = (tile / columns, tile % columns);
            self.open.set(row, column);
            self.counts[(row + around) * (columns + 2 * around) + around + column] = 0;
        }
        (self.slow, self.together, self.drawn) = (None, None, 0);
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

    /// Adds those of a batch's voxels that open tiles may show; draws whenever a block is full.
    #[inline(always)]
    pub(super) fn visit(&mut self, projector: &Projector, batch: &Batch) {
        if self.slow != Some(batch.slow) {
            dispatch::flush_lattice(self.code, projector, self);
            self.slow = Some(batch.slow);
            self.slice = self.lattice.slice(batch.slow);
            self.together = None;
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
            let to = from + batch.medium[from..].iter().take_while(|other| **other == medium).count();
            let [low, high] = self.rows_near(&self.slice, [medium; 2]);
            let (low, high) = (low.max(0), high.min(self.rows as i32 - 1));
            let axis = projector.nesting[1];
            let is_cropped = projector.crop.is_some_and(|crop| medium < crop.low[axis] || medium > crop.high[axis]);
            if low <= high && !is_cropped {
                self.show(batch.slow, [low as usize, high as usize], projector);
                let ends = |ends: (u16, u16), &fast: &u16| (ends.0.min(fast), ends.1.max(fast));
                let (first, last) = batch.fast[from..to].iter().fold((u16::MAX, 0), ends);
                if self.shown_together[first.into()..=last.into()].iter().fold(0, |any, shown| any | shown) != 0 {
                    self.add(projector, batch, from..to);
                }
            }
            from = to;
        }
    }

    /// Makes `shown_together` hold for these rows of tiles.
    #[inline(always)]
    fn show(&mut self, slow: u16, [low, high]: [usize; 2], projector: &Projector) {
        if self.together == Some((slow, [low, high])) {
            return;
        }
        self.together = Some((slow, [low, high]));
        for row in low..=high {
            if self.shown_at[row] != Some(slow) {
                self.shown_at[row] = Some(slow);
                self.show_row(row, projector);
            }
        }
        let together = &mut self.shown_together[..self.line];
        together.copy_from_slice(&self.shown_by_row[self.line * low..][..self.line]);
        for row in low + 1..=high {
            for (shown, other) in together.iter_mut().zip(&self.shown_by_row[self.line * row..][..self.line]) {
                *shown |= other;
            }
        }
    }

    /// Computes `shown_by_row` of a row of tiles.
    #[inline(always)]
    fn show_row(&mut self, row: usize, projector: &Projector) {
        let Band { lattice, slice, open, shown_by_row, line, .. } = self;
        let shown = &mut shown_by_row[*line * row..][..*line];
        shown.fill(0);
        let fast = projector.nesting[2];
        let [low, high] = projector.crop.map_or([0, u16::MAX], |crop| [crop.low[fast], crop.high[fast]]);
        let last = shown.len() as i32 - 1;
        open.each_run(row, |left, right| {
            let pixels = [4.0 * left as f64, 4.0 * right as f64 + 3.0];
            let reach = lattice.reach(0, pixels) + SLACK;
            let from = (slice.origin[0] + slice.step * pixels[0] - reach).ceil() as i32;
            let to = (slice.origin[0] + slice.step * pixels[1] + reach).floor() as i32;
            let (from, to) = (from.max(low.into()), to.min(high.into()).min(last));
            if from <= to {
                shown[from as usize..=to as usize].fill(1);
            }
        });
    }

    /// Adds those voxels of a part of a batch that `shown_together` shows to the block.
    #[inline(always)]
    fn add(&mut self, projector: &Projector, batch: &Batch, range: Range<usize>) {
        for from in range.clone().step_by(GROUP) {
            if !self.voxels.have_room(GROUP) {
                dispatch::flush_lattice(self.code, projector, self);
            }
            let group = from..range.end.min(from + GROUP);
            self.voxels.add_marked(batch, group, &self.shown_together);
        }
    }

    /// Shades the voxels of the block and puts them on lists.
    #[inline(always)]
    pub(super) fn flush(&mut self, projector: &Projector) {
        let count = self.voxels.count.min(BLOCK);
        if count == 0 {
            return;
        }
        if self.splats.len() + BLOCK > WAITING {
            dispatch::take_all(self.code, projector, self);
        }
        if self.looks.is_none() {
            let block = &mut *self.block;
            block.count = count;
            block.strength = [if self.stamps.is_some() { self.lattice.tile([0, 0]).strength } else { 1.0 }; BLOCK];
            dispatch::colour(self.code, projector, &self.voxels, block);
        }
        if self.stamps.is_none() {
            let [_, mediums, fasts] = self.voxels.positions();
            self.footprints.set(self.lattice, &self.slice, [fasts, mediums]);
        }
        for from in (0..count).step_by(LIST - FULL) {
            self.list(from..count.min(from + LIST - FULL), projector);
            while let Some(tile) = self.full.pop() {
                dispatch::take(self.code, projector, self, tile as usize);
            }
        }
        self.voxels.count = 0;
    }

    /// Puts some of the shaded splats on the lists of the tiles that they reach.
    #[inline(always)]
    fn list(&mut self, range: Range<usize>, projector: &Projector) {
        let Band { first_row, columns, rows, around, lists, counts, full, footprints, .. } = self;
        let Band { splats, places, stamps, looks, voxels, block, drawn, .. } = self;
        let [_, mediums, fasts] = voxels.positions();
        let pitch = *columns + 2 * *around;
        let mut put = |tile: usize, splat: u16| {
            let count = counts[tile];
            // A closed tile stays closed, and what is on its list does not matter.
            lists[tile][usize::from(count) % LIST] = splat;
            counts[tile] = count.saturating_add(1);
            if usize::from(count) + 1 == FULL {
                full.push(tile as u32);
            }
        };
        for j in range {
            let (depth, colour) = match looks {
                Some(looks) => looks.of(projector, voxels.records[j]),
                None => (block.peak[j], [block.ink[j][0], block.ink[j][1], block.ink[j][2]]),
            };
            if depth <= 0.0 {
                continue;
            }
            *drawn += 1;
            let index = splats.len() as u16;
            let (fast, medium) = (i32::from(fasts[j]), i32::from(mediums[j]));
            if let Some(stamps) = stamps {
                let (by, at) = (stamps.voxels, [fast - stamps.first[0], medium - stamps.first[1]]);
                splats.push(WaitingSplat { stamp: stamps.base() + at[1] * stamps.size[0] + at[0], depth, colour });
                let [column, row] = at.map(|at| by.divide(at));
                let rest = (at[1] - row * by.voxels) * by.voxels + (at[0] - column * by.voxels);
                let last = (row - *first_row + *around as i32) as usize * pitch + (column + *around as i32) as usize;
                let tiles = stamps.starts[rest as usize] as usize..stamps.starts[rest as usize + 1] as usize;
                for &lower in &stamps.reached[tiles] {
                    put(last - lower as usize, index);
                }
            } else {
                let place = footprints.place(j);
                splats.push(WaitingSplat { stamp: 0, depth, colour });
                places.push(place);
                let footprint = footprints.of(j);
                let [top, bottom] = footprint.rows();
                for row in top.max(*first_row)..=bottom.min(*first_row + *rows as i32 - 1) {
                    let [left, right] = footprint.columns(row);
                    let first = (row - *first_row) as usize * pitch;
                    for column in left.max(0)..=right.min(*columns as i32 - 1) {
                        put(first + column as usize, index);
                    }
                }
            }
        }
    }

    /// Lets all tiles take the splats on their lists.
    #[inline(always)]
    pub(super) fn take_all(&mut self, projector: &Projector) {
        for tile in 0..self.counts.len() {
            if self.counts[tile] != 0 && self.counts[tile] != CLOSED {
                self.take(projector, tile);
            }
        }
        self.splats.clear();
        self.places.clear();
        if let Some(stamps) = &mut self.stamps {
            stamps.keep_last();
        }
    }

    /// Lets a tile take the splats on its list.
    #[inline(always)]
    pub(super) fn take(&mut self, projector: &Projector, tile: usize) {
        let pitch = self.columns + 2 * self.around;
        let (column, row) = (tile % pitch - self.around, tile / pitch - self.around);
        let count = usize::from(std::mem::take(&mut self.counts[tile])).min(LIST);
        let place = [column as i32, self.first_row + row as i32];
        let Some((_, PixelTile(values))) = self.pixels.tile(place[0], place[1]) else { return };
        let list = &self.lists[tile][..count];
        let (splats, places) = (&self.splats[..], &self.places[..]);
        let stop = projector.stop;
        let mut pixels = Pixels { values: *values, is_open: true };
        match &self.stamps {
            Some(stamps) => {
                let lower = stamps.voxels.voxels * (place[1] * stamps.size[0] + place[0]);
                for &index in list {
                    let splat = &splats[usize::from(index)];
                    let stamp = &stamps.stamps[(splat.stamp - lower) as usize];
                    if stamps.depth.is_some() {
                        pixels.composite(stamp, splat.colour, stop);
                    } else {
                        pixels.composite(&amounts(stamp, splat.depth), splat.colour, stop);
                    }
                    if !pixels.is_open {
                        break;
                    }
                }
            }
            None => {
                let rays = self.lattice.tile(place);
                for &index in list {
                    let splat = &splats[usize::from(index)];
                    let weights = rays.weights(&places[usize::from(index)], projector.cut);
                    pixels.composite(&amounts(&weights, limited(splat.depth, rays.strength)), splat.colour, stop);
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
            self.counts[tile] = CLOSED;
        }
    }
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
