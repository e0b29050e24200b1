//! Sizes and numbers of the scratch arrays that a walk needs.

use super::decode::SliceLine;
use super::store::{CHUNK, LaneStore};
use crate::trace::WalkerArray;

/// Number of voxels for which a batch has room, unless a single line has more.
pub(super) const BATCH: usize = 2_048;

/// Numbers by which a trace names the scratch arrays, relative to the first one.
pub(super) const WANTED: usize = 0;
pub(super) const BY_COLUMN: usize = 1;
pub(super) const SORTED: usize = 2;
pub(super) const COLUMN_STARTS: usize = 3;
pub(super) const COLUMN_NEXT: usize = 4;
pub(super) const ROW_STARTS: usize = 5;
pub(super) const ROW_NEXT: usize = 6;
pub(super) const SLICES: usize = 7;
pub(super) const LINES: usize = 8;
pub(super) const MEDIUMS: usize = 9;
pub(super) const TWO_SIDED: usize = 10;
/// Number of lines that are decoded before their voxels are put in the order of an axis with voxels on both sides of
/// the eye.
pub(super) const LINES_AT_ONCE: usize = 4;

/// First of three arrays of a batch: coordinates on the medium axis, on the fast axis, and records. Those of a few lines
/// follow.
pub(super) const BATCH_ARRAYS: usize = 11;
pub(super) const LINE_ARRAYS: usize = 14;

/// Sizes of scratch arrays that suffice for all lanes of a walker, and the number of the first scratch array.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ScratchSizes {
    pub(super) first_array: usize,
    /// Largest number of tiles that a lane has.
    tiles: usize,
    /// Grid points of the longest axis.
    points: usize,
    edge: usize,
}

impl ScratchSizes {
    /// Returns the sizes that suffice for `lanes`; the first scratch array has number `first_array`.
    pub(crate) fn of<S: LaneStore>(lanes: &[S], first_array: usize) -> ScratchSizes {
        let most = |of: fn(&S) -> u32| lanes.iter().map(of).max().unwrap_or(0) as usize;
        ScratchSizes {
            first_array,
            tiles: most(LaneStore::tile_count),
            points: most(|lane| lane.dims().into_iter().max().unwrap_or(0)),
            edge: most(|lane| lane.edge().into()),
        }
    }

    /// Returns the most lines that a slice can have, rounded up to whole tiles.
    pub(super) fn lines(self) -> usize {
        self.points.next_multiple_of(self.edge.max(1))
    }

    /// Returns the scratch arrays, in the order of their numbers.
    pub(crate) fn arrays(self) -> [WalkerArray; 17] {
        let rows = self.lines() / self.edge.max(1) + 1;
        let (batch, line) = (self.points.max(BATCH) + 2 * CHUNK, LINES_AT_ONCE * (self.points + 3 * CHUNK));
        let sizes = [
            ("wanted tiles", 4 * self.tiles),
            ("tiles by column", 4 * self.tiles),
            ("tiles by row", 4 * self.tiles),
            ("starts of columns", 4 * rows),
            ("next of columns", 4 * rows),
            ("starts of rows", 4 * rows),
            ("next of rows", 4 * rows),
            ("slices", 2 * self.points),
            ("lines", size_of::<SliceLine>() * self.lines()),
            ("mediums", 2 * self.lines()),
            ("lines of two sides", size_of::<SliceLine>() * self.lines()),
            ("batch medium", 2 * batch),
            ("batch fast", 2 * batch),
            ("batch record", 4 * batch),
            ("line medium", 2 * line),
            ("line fast", 2 * line),
            ("line record", 4 * line),
        ];
        sizes.map(|(name, bytes)| WalkerArray { name, bytes: bytes as u64, scratch: true })
    }
}
