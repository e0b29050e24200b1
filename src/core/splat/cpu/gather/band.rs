//! Drawing a band of the lattice: tiles take the voxels in front of them, on one thread.
//!
//! In: a drawing task, a [`Lattice`], and rows of its tiles. Out: the band's pixels, composited front to back. Only
//! voxels that an open tile may still show are shaded. They wait in a [`Slab`]. After a few slices, row by row of tiles,
//! each run of neighbouring voxels is put on the lists of the open tiles that it reaches. A tile takes all splats on its list at
//! once, while its pixels are in registers:
//!
//! ```text
//! walk -> voxels before open tiles -> colours -> slab -> runs -> lists of a row's tiles
//!      -> for each tile: load, splat after splat, store
//! ```
//!
//! Each tile takes its voxels in visit order, so its bits do not depend on when it takes them. In a parallel view all
//! tiles of a slice see the same lattice of voxels. So the weights of kernels at a tile's pixels, the *stamps*, are
//! computed once for a slice. Voxels beside the points of the grid come one by one; their weights, the [`Footprints`], are computed
//! once for a frame.

use std::marker::PhantomData;
use std::ops::Range;
use std::time::Instant;

use super::SLACK;
use super::lists::Lists;
use super::look_tables::LookTables;
use super::scan_line::{OneWay, ends, same};
use super::slab::Slab;
use super::spans::Spans;
use super::stamps::Stamps;
use crate::error::Result;
use crate::splat::Code;
use crate::splat::cpu::bit_rows::BitRows;
use crate::splat::cpu::blend::Blend;
use crate::splat::cpu::dispatch;
use crate::splat::cpu::lattice::{Footprints, Lattice, Slice};
use crate::splat::cpu::project::{Projector, limited};
use crate::splat::cpu::task::{BandStats, DrawTask};
use crate::splat::cpu::tile_buffer::{Rect, TILE_SHIFT, TileBuffer};
use crate::splat::cpu::voxel_block::{GROUP, VoxelBlock};
use crate::traverse::{Batch, Visitor, VoxelBox};

/// Draws the rows of tiles from `first` to before `end`; `shown` tells which tiles of the plane the picture may show. The band then
/// has their pixels.
pub(super) fn draw<B: Blend>(
    task: &DrawTask,
    band: &mut Band<B>,
    shown: &[bool],
    [first, end]: [i32; 2],
) -> Result<BandStats> {
    band.begin(shown, [first, end])?;
    let mut painter = LatticePainter { task, band };
    let mut stats = task.walk(&mut painter);
    let start = Instant::now();
    dispatch::flush_lattice(band.code, &task.projector, band);
    dispatch::take_all(band.code, &task.projector, band);
    stats.drawing += start.elapsed();
    Ok(BandStats { drawn: band.drawn, ..stats })
}

/// The smallest rectangle.
const NO_PIXELS: Rect = Rect { x0: 0, y0: 0, x1: 1, y1: 1 };

/// Receives the voxels of a walk and draws them on a band of the lattice.
struct LatticePainter<'a, 'b, B> {
    task: &'a DrawTask<'a>,
    band: &'a mut Band<'b, B>,
}

impl<B: Blend> Visitor for LatticePainter<'_, '_, B> {
    fn wants_tile(&mut self, bounds: &VoxelBox) -> bool {
        let [slow, medium, _] = self.task.projector.slow_medium_fast;
        let rows = [bounds.low[slow], bounds.high[slow]]
            .map(|slow| self.band.rows_near(&self.band.lattice.slice(slow), [bounds.low[medium], bounds.high[medium]]));
        let (low, high) = (rows[0][0].min(rows[1][0]), rows[0][1].max(rows[1][1]));
        self.task.projector.clip.meets(bounds) && high >= 0 && low < self.band.rows as i32
    }

    fn wants_row(&mut self, bounds: &VoxelBox) -> bool {
        let [slow, medium, fast] = self.task.projector.slow_medium_fast;
        let band = &*self.band;
        let slice = band.lattice.slice(bounds.low[slow]);
        let [low, high] = band.rows_near(&slice, [bounds.low[medium], bounds.high[medium]]);
        let (low, high) = (low.max(0), high.min(band.rows as i32 - 1));
        if low > high || !self.task.projector.clip.meets(bounds) {
            return false;
        }
        let [left, right] = band.tiles_near(0, &slice, [bounds.low[fast], bounds.high[fast]]);
        (low..=high).any(|row| band.tiles.open_tiles.any(row as usize, [left, right]))
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

/// A band of the lattice's tiles, and the voxels that one thread is drawing on it.
pub(in super::super) struct Band<'a, B> {
    blend: PhantomData<B>,
    /// Selects the instruction set.
    code: Code,
    pub(super) lattice: &'a Lattice,
    pub(super) first_row: i32,
    /// Number of columns and rows of tiles.
    pub(super) columns: usize,
    pub(super) rows: usize,
    pub(super) tiles: TileBuffer,
    slow: Option<u16>,
    slice: Slice,
    /// Rows of pixels, from the band's first on, per voxel along the medium axis; the first and the last row that the
    /// kernel of voxel 0 may reach.
    rows_at: [f64; 3],
    /// For each row of tiles: which voxels of a line may be seen by an open tile of the row, and in which slice.
    shown: BitRows,
    shown_at: Vec<Option<u16>>,
    /// The same for several rows of tiles together; and which slice and rows.
    together: BitRows,
    together_of: Option<(u16, [usize; 2])>,
    voxels: Box<VoxelBlock>,
    /// Tables of looks and of light, in a parallel view with many voxels on points of the grid.
    tables: Option<&'a LookTables>,
    pub(super) slab: Slab,
    /// The stamps of a parallel view of voxels on points of the grid.
    pub(super) stamps: Option<Stamps>,
    /// What voxels beside the points of the grid weigh in a parallel view.
    pub(super) footprints: Option<&'a Footprints>,
    /// Which voxels reach the tiles in a perspective, if voxels lie on points of the grid.
    pub(super) spans: Option<Spans>,
    pub(super) lists: Lists,
    /// How many splats tiles took of the slab at hand, and in how many visits.
    pub(super) taken: u64,
    pub(super) visits: u64,
    /// Number of splats drawn.
    drawn: u64,
}

impl<'a, B: Blend> Band<'a, B> {
    /// Returns what a thread needs to draw bands of at most `rows` rows of tiles, one after another.
    pub(super) fn new(
        task: &DrawTask,
        lattice: &'a Lattice,
        (tables, footprints): (Option<&'a LookTables>, Option<&'a Footprints>),
        rows: usize,
    ) -> Result<Band<'a, B>> {
        let columns = lattice.size[0] as usize >> TILE_SHIFT;
        let stamps = lattice.periods().zip(lattice.strength()).map(|(periods, strength)| {
            let depth = task.projector.table.only_depth().map(|depth| limited(depth, strength));
            Stamps::new(lattice, periods, depth)
        });
        let line = task.setup.lane.dims[task.projector.slow_medium_fast[2]] as usize;
        let has_spans = task.projector.is_on_grid() && stamps.is_none();
        Ok(Band {
            blend: PhantomData,
            code: task.settings.code,
            lattice,
            first_row: 0,
            columns,
            rows,
            tiles: TileBuffer::new(NO_PIXELS, B::INITIAL_ALPHA)?,
            slow: None,
            slice: lattice.slice(0),
            rows_at: [0.0; 3],
            shown: BitRows::new(line, rows),
            shown_at: vec![None; rows],
            together: BitRows::new(line, 1),
            together_of: None,
            voxels: VoxelBlock::new(),
            tables,
            slab: Slab::new(rows, line)?,
            stamps,
            footprints,
            spans: has_spans.then(|| Spans::new([columns, rows])),
            lists: Lists::new(columns)?,
            taken: 0,
            visits: 0,
            drawn: 0,
        })
    }

    /// Begins with the rows of tiles from `first` to before `end`.
    fn begin(&mut self, shown: &[bool], [first, end]: [i32; 2]) -> Result<()> {
        let columns = self.columns;
        (self.first_row, self.rows) = (first, (end - first) as usize);
        let rect = Rect { x0: 0, y0: first << TILE_SHIFT, x1: (columns << TILE_SHIFT) as i32, y1: end << TILE_SHIFT };
        self.tiles.restart(rect)?;
        let shown = shown[columns * first as usize..columns * end as usize].iter();
        for (tile, _) in shown.enumerate().filter(|(_, is_shown)| !**is_shown) {
            self.tiles.open_tiles.clear(tile / columns, tile % columns);
        }
        (self.slow, self.together_of, self.drawn) = (None, None, 0);
        self.shown_at.fill(None);
        Ok(())
    }

    /// Returns the first and last tile of the plane, along columns (`side` 0) or rows (1), that kernels of voxels between
    /// `low` and `high` may reach.
    #[inline(always)]
    fn tiles_near(&self, side: usize, slice: &Slice, [low, high]: [u16; 2]) -> [i32; 2] {
        let pixel = |voxel: u16| (f64::from(voxel) - slice.origin[side]) / slice.step[side];
        let (low, high) = (pixel(low), pixel(high));
        // A kernel reaches pixels whose rays are steeper or flatter than the voxel's own.
        let around = self.lattice.farthest(slice, side);
        let reach = self.lattice.reach(side, [low - around, high + around]) / slice.step[side] + SLACK;
        [((low - reach).ceil() as i32) >> TILE_SHIFT, ((high + reach).floor() as i32) >> TILE_SHIFT]
    }

    /// Returns the first and last row of tiles, counted from the band's first, that kernels of these voxels may reach.
    #[inline(always)]
    fn rows_near(&self, slice: &Slice, medium: [u16; 2]) -> [i32; 2] {
        self.tiles_near(1, slice, medium).map(|row| row - self.first_row)
    }

    /// Finds the map from the medium axis to rows of tiles of the slice at hand.
    fn set_rows(&mut self) {
        let (slice, first) = (&self.slice, f64::from(self.first_row << TILE_SHIFT));
        let around = self.lattice.farthest(slice, 1);
        let band = [first - around, first + f64::from((self.rows as i32) << TILE_SHIFT) + around];
        let reach = self.lattice.reach(1, band) / slice.step[1] + SLACK;
        let zero = -slice.origin[1] / slice.step[1] - first;
        self.rows_at = [1.0 / slice.step[1], zero - reach, zero + reach];
    }

    /// Returns the first and last row of tiles of the band, counted from its first, that kernels of a line may reach.
    #[inline(always)]
    fn rows_of(&self, medium: u16) -> [i32; 2] {
        let [per_voxel, low, high] = self.rows_at;
        let at = f64::from(medium) * per_voxel;
        // Positive numbers round down when they become integers; what is before the band does not matter.
        let (low, high) = ((at + low + 1.0).max(0.0) as i32, (at + high).max(-1.0).floor() as i32);
        [low >> TILE_SHIFT, (high >> TILE_SHIFT).min(self.rows as i32 - 1)]
    }

    /// Adds those of a batch's voxels that open tiles may show.
    #[inline(always)]
    pub(in super::super) fn visit(&mut self, projector: &Projector, batch: &Batch) {
        if self.slow != Some(batch.slow) {
            self.flush(projector);
            if self.slab.is_full() {
                dispatch::take_all(self.code, projector, self);
            }
            self.slow = Some(batch.slow);
            self.slice = self.lattice.slice(batch.slow);
            self.set_rows();
            self.together_of = None;
            self.begin_slice(projector);
        }
        let mut from = 0;
        while from < batch.len() {
            let medium = batch.medium[from];
            let to = from + same(&batch.medium[from..]);
            let [low, high] = self.rows_of(medium);
            let ends =
                projector.clip.on_line(projector.slow_medium_fast[2], projector.unnested([batch.slow, medium, 0]));
            if low <= high && ends[0] <= ends[1] {
                self.show(batch.slow, [low as usize, high as usize], projector);
                self.add(projector, batch, from..to, ends, [low as usize, high as usize]);
            }
            from = to;
        }
    }

    /// Adds the slice at hand to the slab.
    #[inline(always)]
    fn begin_slice(&mut self, projector: &Projector) {
        let index = self.slab.begin_slice();
        if let Some(stamps) = &mut self.stamps {
            stamps.set::<B>(index, self.lattice, &self.slice, projector.cut);
        }
        if let Some(spans) = &mut self.spans {
            spans.set(index, self.lattice, &self.slice, self.first_row);
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
        let Band { lattice, slice, tiles, shown, .. } = self;
        shown.clear_row(row);
        let fast = projector.slow_medium_fast[2];
        let last = projector.lane.dims[fast] as i32 - 1;
        tiles.open_tiles.each_run(row, |[left, right]| {
            let ends = [4.0 * left as f64, 4.0 * right as f64 + 3.0];
            let reach = lattice.reach(0, ends) + SLACK;
            let from = (slice.origin[0] + slice.step[0] * ends[0] - reach).ceil() as i32;
            let to = (slice.origin[0] + slice.step[0] * ends[1] + reach).floor() as i32;
            let (from, to) = (from.max(0), to.min(last));
            if from <= to {
                shown.set(row, [from as usize, to as usize]);
            }
        });
    }

    /// Adds those voxels of a line from index `low` to `high` that `together` shows; the line reaches these rows of tiles.
    #[inline(always)]
    fn add(
        &mut self,
        projector: &Projector,
        batch: &Batch,
        range: Range<usize>,
        [low, high]: [u16; 2],
        rows: [usize; 2],
    ) {
        if !self.slab.has_room(self.voxels.count + range.len()) {
            self.flush(projector);
            dispatch::take_all(self.code, projector, self);
            self.begin_slice(projector);
        }
        let first = self.slab.count + self.voxels.count;
        match OneWay::of(&batch.fast[range.clone()]) {
            Some(line) => self.add_one_way(projector, batch, range.start, line, [low, high]),
            None => self.add_scattered(projector, batch, range.clone(), [low, high]),
        }
        let end = self.slab.count + self.voxels.count;
        if first < end {
            self.slab.add_line(batch.medium[range.start], [first, end], rows);
        }
    }

    /// Adds those voxels of a line from coordinate `low` to `high` that `together` shows; the line begins at index `start` of the
    /// batch. It does not look at the others.
    #[inline(always)]
    fn add_one_way(
        &mut self,
        projector: &Projector,
        batch: &Batch,
        start: usize,
        mut line: OneWay,
        [low, high]: [u16; 2],
    ) {
        let [least, greatest] = line.ends();
        let (left, right) = (least.max(low), greatest.min(high));
        if left > right {
            return;
        }
        let together = std::mem::take(&mut self.together);
        for columns in together.runs_on_way(0, [left, right], line.rises) {
            let voxels = line.take(columns);
            let (from, end) = (start + voxels.start, start + voxels.end);
            for from in (from..end).step_by(GROUP) {
                if !self.voxels.have_room(GROUP) {
                    self.flush(projector);
                }
                self.voxels.add_group(batch, from, GROUP.min(end - from));
            }
        }
        self.together = together;
    }

    /// Adds those of a line's voxels that `together` shows.
    #[inline(always)]
    fn add_scattered(&mut self, projector: &Projector, batch: &Batch, range: Range<usize>, [low, high]: [u16; 2]) {
        for from in range.clone().step_by(GROUP) {
            let group = from..range.end.min(from + GROUP);
            let ends = ends(&batch.fast[group.clone()]);
            let [first, last] = ends;
            if first > high || last < low || !self.together.any(0, ends.map(i32::from)) {
                continue;
            }
            if !self.voxels.have_room(GROUP) {
                self.flush(projector);
            }
            if first >= low && last <= high && self.together.all(0, ends) {
                self.voxels.add_group(batch, group.start, group.len());
            } else {
                let in_clip = |fast: usize| fast >= low.into() && fast <= high.into();
                self.voxels.add_marked(batch, group, |fast| in_clip(fast) && self.together.get(0, fast));
            }
        }
    }

    /// Shades the voxels of the block and adds them to the slab.
    #[inline(always)]
    pub(in super::super) fn flush(&mut self, projector: &Projector) {
        let Band { voxels, tables, slab, lattice, slice, stamps, footprints, .. } = self;
        if voxels.count == 0 {
            return;
        }
        let (range, [_, mediums, fasts]) = (slab.block(), &voxels.positions);
        if projector.is_on_grid() {
            slab.fasts[range.clone()].copy_from_slice(fasts);
            match stamps {
                Some(stamps) => stamps.number(slab.last_slice(), [fasts, mediums], &mut slab.weight_keys[range]),
                None => lattice.set_places(slice, [fasts, mediums], &mut slab.places[range]),
            }
        } else {
            let tiles = [&mut slab.columns[range.clone()], &mut slab.rows[range.clone()]];
            match footprints {
                Some(footprints) => {
                    footprints.place_block(voxels, &projector.lane, slice, &mut slab.weight_keys[range], tiles);
                }
                None => {
                    let places = (&mut slab.places[range.clone()], &mut slab.weight_keys[range]);
                    lattice.set_places_displaced(slice, &projector.displaced(voxels), places, tiles);
                }
            }
        }
        let looks = slab.add(voxels);
        match tables {
            Some(tables) => tables.colour(projector, voxels, looks),
            None => dispatch::colour(self.code, projector, voxels, looks),
        }
        if let Some(footprints) = footprints {
            for (look, &record) in looks.iter_mut().zip(&voxels.records) {
                look[3] = limited(look[3], footprints.strength(projector.lane.coverage_code(record)));
            }
        } else if tables.is_none()
            && projector.is_on_grid()
            && let Some(strength) = lattice.strength()
        {
            looks.iter_mut().for_each(|look| look[3] = limited(look[3], strength));
        }
        self.drawn += looks.iter().filter(|look| look[3] > 0.0).count() as u64;
        voxels.count = 0;
    }
}
