//! Which parts of the picture can no longer change.
//!
//! In: the transmittance plane of a band. Out: whether every pixel of a rectangle is frozen, that is below the
//! stopping threshold. Squares of 16x16 pixels on the picture's fixed grid each keep a *witness*, the first pixel not
//! yet seen frozen; squares of 8x8 squares keep one of their squares in the same way. Transmittance only falls, so a
//! witness only moves forward and all questions together cost one look at each pixel plus one look each.

use super::planes::{Planes, Rect};

/// Side of a square in pixels, as a shift.
const SQUARE: i32 = 4;
/// Side of a block of squares in squares, as a shift.
const BLOCK: i32 = 3;

/// Witnesses of one band.
#[derive(Debug)]
pub(crate) struct Frozen {
    rect: Rect,
    /// First square's column and row on the picture's grid.
    left: i32,
    top: i32,
    columns: usize,
    /// Next pixel to look at within each square; [`DONE`] when there is none.
    witness: Vec<u16>,
    block_left: i32,
    block_top: i32,
    block_columns: usize,
    /// Next square to look at within each block; [`DONE`] when there is none.
    square: Vec<u16>,
}

const DONE: u16 = u16::MAX;

impl Frozen {
    pub(crate) fn new(rect: Rect) -> Frozen {
        let span = |low: i32, high: i32, shift: i32| ((high - 1) >> shift) - (low >> shift) + 1;
        let count = |low: i32, high: i32, shift: i32| usize::try_from(span(low, high, shift)).unwrap_or(0);
        let (columns, rows) = (count(rect.x0, rect.x1, SQUARE), count(rect.y0, rect.y1, SQUARE));
        let both = SQUARE + BLOCK;
        let (block_columns, block_rows) = (count(rect.x0, rect.x1, both), count(rect.y0, rect.y1, both));
        Frozen {
            rect,
            left: rect.x0 >> SQUARE,
            top: rect.y0 >> SQUARE,
            columns,
            witness: vec![0; columns * rows],
            block_left: rect.x0 >> both,
            block_top: rect.y0 >> both,
            block_columns,
            square: vec![0; block_columns * block_rows],
        }
    }

    /// Whether all squares that meet the pixels `x0..=x1`, `y0..=y1` are frozen. The pixels lie in the band.
    #[inline(always)]
    pub(crate) fn covers(&mut self, planes: &Planes, stop: f32, x0: i32, y0: i32, x1: i32, y1: i32) -> bool {
        for row in y0 >> SQUARE..=y1 >> SQUARE {
            for column in x0 >> SQUARE..=x1 >> SQUARE {
                if !self.square_is_frozen(planes, stop, column, row) {
                    return false;
                }
            }
        }
        true
    }

    /// As [`Frozen::covers`] for large rectangles: looks at whole blocks of squares where it can.
    pub(crate) fn covers_widely(&mut self, planes: &Planes, stop: f32, x0: i32, y0: i32, x1: i32, y1: i32) -> bool {
        let both = SQUARE + BLOCK;
        for block_row in y0 >> both..=y1 >> both {
            for block_column in x0 >> both..=x1 >> both {
                if self.block_is_frozen(planes, stop, block_column, block_row) {
                    continue;
                }
                let (low_x, low_y) = (x0.max(block_column << both), y0.max(block_row << both));
                let (high_x, high_y) =
                    (x1.min(((block_column + 1) << both) - 1), y1.min(((block_row + 1) << both) - 1));
                if !self.covers(planes, stop, low_x, low_y, high_x, high_y) {
                    return false;
                }
            }
        }
        true
    }

    #[inline(always)]
    fn square_is_frozen(&mut self, planes: &Planes, stop: f32, column: i32, row: i32) -> bool {
        let index = (row - self.top) as usize * self.columns + (column - self.left) as usize;
        let at = self.witness[index];
        if at == DONE {
            return true;
        }
        let (x0, y0) = (self.rect.x0.max(column << SQUARE), self.rect.y0.max(row << SQUARE));
        let width = self.rect.x1.min((column + 1) << SQUARE) - x0;
        // Most questions end here: the witness is still open. A square cut by the band's border is scanned by its own
        // width, hence the division only when the witness moves.
        if width == 1 << SQUARE && planes.fourth(x0 + i32::from(at & 15), y0 + i32::from(at >> 4)) >= stop {
            return false;
        }
        self.advance(planes, stop, index, x0, y0, width, row)
    }

    #[expect(clippy::too_many_arguments, reason = "the cold half of the function above")]
    #[inline(never)]
    fn advance(&mut self, planes: &Planes, stop: f32, index: usize, x0: i32, y0: i32, width: i32, row: i32) -> bool {
        let height = self.rect.y1.min((row + 1) << SQUARE) - y0;
        let mut at = i32::from(self.witness[index]);
        while at < width * height {
            if planes.fourth(x0 + at % width, y0 + at / width) >= stop {
                self.witness[index] = u16::try_from(at).expect("at most 256 pixels");
                return false;
            }
            at += 1;
        }
        self.witness[index] = DONE;
        true
    }

    fn block_is_frozen(&mut self, planes: &Planes, stop: f32, column: i32, row: i32) -> bool {
        let index = (row - self.block_top) as usize * self.block_columns + (column - self.block_left) as usize;
        let mut at = self.square[index];
        if at == DONE {
            return true;
        }
        let right = (self.rect.x1 - 1) >> SQUARE;
        let bottom = (self.rect.y1 - 1) >> SQUARE;
        while at < 64 {
            let square_column = (column << BLOCK) + i32::from(at & 7);
            let square_row = (row << BLOCK) + i32::from(at >> 3);
            let inside = (self.left..=right).contains(&square_column) && (self.top..=bottom).contains(&square_row);
            if inside && !self.square_is_frozen(planes, stop, square_column, square_row) {
                self.square[index] = at;
                return false;
            }
            at += 1;
        }
        self.square[index] = DONE;
        true
    }
}
