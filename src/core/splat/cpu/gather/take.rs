//! Taking: the open tiles of a band take the voxels of its slab.
//!
//! In: a slab. Out: the band's pixels, on which its voxels are composited in visit order.

use super::band::Band;
use super::lists::{FULL, TOGETHER};
use super::slab::Line;
use super::spans::Spans;
use super::tile_composite::Weights;
use crate::splat::cpu::blend::Blend;
use crate::splat::cpu::project::Projector;

impl<B: Blend> Band<'_, B> {
    /// Lets all open tiles take the voxels of the slab.
    #[inline(always)]
    pub(in super::super) fn take_all(&mut self, projector: &Projector) {
        self.find_runs();
        let spans = self.spans.take();
        for row in 0..self.rows {
            if self.slab.lines_of(row) == 0 {
                continue;
            }
            match &self.stamps {
                None => self.take_row::<false, false>(projector, row, spans.as_ref()),
                Some(stamps) if stamps.depth.is_none() => self.take_row::<true, false>(projector, row, None),
                Some(_) => self.take_row::<true, true>(projector, row, None),
            }
        }
        self.spans = spans;
        self.slab.clear(self.taken, self.visits);
        (self.taken, self.visits) = (0, 0);
    }

    /// Finds the runs of the slab's voxels and the tiles that they may reach, if they lie on points of the grid.
    #[inline(always)]
    fn find_runs(&mut self) {
        let Band { slab, stamps, spans, columns, .. } = self;
        if let Some(stamps) = stamps {
            slab.find_runs(|slice, fasts| stamps.columns(slice, fasts, *columns));
        } else if let Some(spans) = spans {
            slab.find_runs(|slice, fasts| spans.columns(slice, fasts));
        }
    }

    /// Lets the open tiles of a row take the voxels of the lines that reach it.
    #[inline(always)]
    fn take_row<const STAMPED: bool, const ONE_DEPTH: bool>(
        &mut self,
        projector: &Projector,
        row: usize,
        spans: Option<&Spans>,
    ) {
        self.lists.begin_row(self.columns, |column| self.tiles.open_tiles.get(row, column));
        let all = [0, self.columns];
        for index in 0..self.slab.lines_of(row) {
            let line = *self.slab.line(row, index);
            if let (true, Some(stamps)) = (STAMPED, &self.stamps) {
                if let Some(span) = stamps.span(line.slice, line.medium, self.first_row + row as i32) {
                    // Told apart before the loop, which is 1.03 times as fast.
                    match span.all_columns() {
                        Some(of_column) => self.take_line::<STAMPED, ONE_DEPTH>(projector, row, &line, of_column),
                        None => {
                            self.take_line::<STAMPED, ONE_DEPTH>(projector, row, &line, |column| {
                                span.of_column(column)
                            });
                        }
                    }
                }
                continue;
            }
            if let Some(spans) = spans {
                if spans.reach_row(line.slice, line.medium, row) {
                    let span = |column| spans.of_column(line.slice, column);
                    self.take_line::<STAMPED, ONE_DEPTH>(projector, row, &line, span);
                }
                continue;
            }
            for first in (line.splats[0]..line.splats[1]).step_by(TOGETHER) {
                let splats = [first, line.splats[1].min(first + TOGETHER as u32)];
                if self.put_each(row, &Line { splats, ..line }) & FULL != 0 {
                    self.take::<STAMPED, ONE_DEPTH>(projector, row, all, FULL);
                }
            }
        }
        self.take::<STAMPED, ONE_DEPTH>(projector, row, all, 1);
    }

    /// Puts the splats of a line, run by run, on the lists of the tiles that they reach, and lets tiles with full lists take theirs.
    /// `span` returns the first and the last voxel along the fast axis that reach a column of tiles.
    #[inline(always)]
    fn take_line<const STAMPED: bool, const ONE_DEPTH: bool>(
        &mut self,
        projector: &Projector,
        row: usize,
        line: &Line,
        span: impl Fn(usize) -> [i32; 2],
    ) {
        for run in line.runs[0]..line.runs[1] {
            let Some(run) = self.slab.run(run) else { break };
            if self.lists.put_run(&run, &span) & FULL != 0 {
                self.take::<STAMPED, ONE_DEPTH>(projector, row, run.columns.map(usize::from), FULL);
            }
        }
    }

    /// Puts the splats of a line on the lists of a row's tiles, one by one. Returns a number with the bits of these lists'
    /// lengths.
    #[inline(always)]
    fn put_each(&mut self, row: usize, line: &Line) -> u32 {
        let Band { slab, lists, first_row, .. } = self;
        let row = (*first_row + row as i32) as u16;
        let (columns, rows) = slab.tiles(line);
        let mut lengths = 0;
        for ((splat, columns), rows) in (line.splats[0]..).zip(columns).zip(rows) {
            if row.wrapping_sub(rows.first) < rows.count {
                lengths |= lists.put(columns.first.into(), columns.count.into(), splat);
            }
        }
        lengths
    }

    /// Lets those tiles of a row, from the first column to before the second, with at least this many splats on their lists take
    /// them.
    #[inline(always)]
    fn take<const STAMPED: bool, const ONE_DEPTH: bool>(
        &mut self,
        projector: &Projector,
        row: usize,
        [first, end]: [usize; 2],
        least: u32,
    ) {
        let weights = Weights { stamps: self.stamps.as_ref(), footprints: self.footprints, lattice: self.lattice };
        for column in first..end {
            let Some(splats) = self.lists.take(column, least) else { continue };
            self.taken += splats.len() as u64;
            self.visits += 1;
            let tile = [column as i32, self.first_row + row as i32];
            if !weights.blend::<B, STAMPED, ONE_DEPTH>(projector, &self.slab, splats, &mut self.tiles, tile) {
                self.tiles.open_tiles.clear(row, column);
                self.lists.close(column);
            }
        }
    }
}
