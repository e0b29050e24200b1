//! The accumulation buffer of a band, and which parts of it can no longer change.
//!
//! In: a rectangle of the picture, in absolute pixel coordinates. Out: tiles of 4 x 4 pixels on the picture's fixed
//! grid, each with sixteen reds, greens, blues and fourth values side by side: a footprint of any size and place is a
//! few whole tiles, and every vector step is full. A processor hands a store on to the next load only where that asks
//! for no more than was stored, so a tile's values are always read and written whole.
//!
//! A tile is *fresh* until something is drawn on it: then its memory was never touched, and an empty part of the
//! picture costs nothing. It is *frozen* when all its pixels are below the stopping threshold. Squares of 4 x 4 tiles
//! count their tiles that are not frozen, blocks of 8 x 8 squares their squares that have such tiles, so that large
//! rectangles are asked about quickly.

#![expect(clippy::cast_possible_truncation, reason = "a picture of 16,384 pixels a side has 2^24 tiles")]

use bytemuck::Zeroable;

use super::blend::{Additive, Blend as _, sheet_parts};
use crate::error::{Error, Result};

/// Side of a tile in pixels, as a shift.
pub(crate) const TILE: i32 = 2;
/// Pixels of a tile.
pub(crate) const PIXELS: usize = 1 << (2 * TILE);
/// Side of a square of tiles in pixels, as a shift.
const SQUARE: i32 = 4;
/// Side of a block of squares in pixels, as a shift.
const BLOCK: i32 = 7;

/// A half-open rectangle of pixels, in absolute picture coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rect {
    /// First column.
    pub x0: i32,
    /// First row; rows run downward.
    pub y0: i32,
    /// One past the last column.
    pub x1: i32,
    /// One past the last row.
    pub y1: i32,
}

/// The values of 4 x 4 pixels, row by row: reds, greens, blues, fourth values.
#[derive(Debug, Clone, Copy, PartialEq, Zeroable)]
#[repr(C, align(64))]
pub(crate) struct Tile(pub(crate) [[f32; PIXELS]; 4]);

/// Nothing was drawn on the tile yet.
const FRESH: u8 = 0;
/// Something was, and some pixel may still change.
const OPEN: u8 = 1;
/// No pixel changes any more.
const FROZEN: u8 = 2;

/// Pixels of one band. What the fourth value holds is the blend's business.
pub struct Planes {
    pub(crate) rect: Rect,
    /// What the fourth value of a fresh pixel is.
    fourth: f32,
    /// Tiles from row to row.
    pitch: usize,
    tiles: Box<[Tile]>,
    /// One of each tile.
    states: Vec<u8>,
    /// Tiles of each square that are not frozen.
    squares: Count,
    /// Squares of each block that have such tiles.
    blocks: Count,
    /// Index of each tile that is not fresh, of a sheet's.
    begun: Option<Vec<u32>>,
}

/// A number for each cell of a grid of squares.
pub(super) struct Count {
    left: i32,
    top: i32,
    columns: usize,
    shift: i32,
    counts: Vec<u8>,
}

impl Count {
    /// For each square of `1 << shift` pixels how many cells of `1 << cell` pixels it shares with the rectangle.
    pub(super) fn new(rect: Rect, shift: i32, cell: i32) -> Count {
        let cells = |low: i32, high: i32| {
            let (first, last) = (low >> cell, (high - 1) >> cell);
            let more = shift - cell;
            (first >> more..=last >> more)
                .map(|square| last.min(((square + 1) << more) - 1) - first.max(square << more) + 1)
                .map(|cells| u8::try_from(cells).expect("eight cells along a square at most"))
                .collect::<Vec<u8>>()
        };
        let (across, down) = (cells(rect.x0, rect.x1), cells(rect.y0, rect.y1));
        let counts = down.iter().flat_map(|rows| across.iter().map(move |columns| rows * columns)).collect();
        Count { left: rect.x0 >> shift, top: rect.y0 >> shift, columns: across.len(), shift, counts }
    }

    /// The number of the square that holds pixel (`x`, `y`).
    #[inline(always)]
    pub(super) fn at(&mut self, x: i32, y: i32) -> &mut u8 {
        let (column, row) = ((x >> self.shift) - self.left, (y >> self.shift) - self.top);
        &mut self.counts[row as usize * self.columns + column as usize]
    }

    #[inline(always)]
    pub(super) fn is_zero(&self, x: i32, y: i32) -> bool {
        let (column, row) = ((x >> self.shift) - self.left, (y >> self.shift) - self.top);
        self.counts[row as usize * self.columns + column as usize] == 0
    }
}

impl Planes {
    /// Pixels for `rect`, which is not empty: colours 0, the fourth value `fourth`.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`].
    pub fn new(rect: Rect, fourth: f32) -> Result<Planes> {
        let tiles_along = |low: i32, high: i32| usize::try_from(((high - 1) >> TILE) - (low >> TILE) + 1).unwrap_or(0);
        let pitch = pitch_for(tiles_along(rect.x0, rect.x1));
        let len = pitch * tiles_along(rect.y0, rect.y1);
        let tiles = bytemuck::allocation::try_zeroed_slice_box(len)
            .map_err(|()| Error::out_of_memory("the picture", (size_of::<Tile>() * len) as u64))?;
        let (squares, blocks) = (Count::new(rect, SQUARE, TILE), Count::new(rect, BLOCK, SQUARE));
        Ok(Planes { rect, fourth, pitch, tiles, states: vec![FRESH; len], squares, blocks, begun: None })
    }

    /// Pixels of a sheet: sums of colour times optical depth, and of optical depth.
    ///
    /// # Errors
    /// As [`Planes::new`].
    pub(crate) fn sheet(rect: Rect) -> Result<Planes> {
        let planes = Planes::new(rect, Additive::FOURTH)?;
        let mut begun = Vec::new();
        let len = planes.tiles.len();
        begun
            .try_reserve_exact(len)
            .map_err(|_| Error::out_of_memory("the picture", (size_of::<u32>() * len) as u64))?;
        Ok(Planes { begun: Some(begun), ..planes })
    }

    /// Composites a sheet of the same rectangle behind what is there, front to back, and empties it.
    #[inline(always)]
    pub(super) fn composite(&mut self, sheet: &mut Planes, stop: f32) {
        let mut begun = sheet.begun.take().unwrap_or_default();
        for from in begun.drain(..) {
            let from = from as usize;
            // Both have the same tiles.
            let column = (self.rect.x0 >> TILE) + (from % self.pitch) as i32;
            let row = (self.rect.y0 >> TILE) + (from / self.pitch) as i32;
            let Tile(added) = &mut sheet.tiles[from];
            if let Some((index, Tile([red, green, blue, clear]))) = self.tile(column, row) {
                let (mut parts, mut shares) = ([0.0; PIXELS], [0.0; PIXELS]);
                for i in 0..PIXELS {
                    [parts[i], shares[i]] = sheet_parts(clear[i], added[3][i], stop);
                }
                for (values, added) in [red, green, blue].into_iter().zip(&*added) {
                    for i in 0..PIXELS {
                        values[i] += shares[i] * added[i];
                    }
                }
                let mut is_open = false;
                for i in 0..PIXELS {
                    clear[i] -= parts[i];
                    is_open |= clear[i] >= stop;
                }
                if !is_open {
                    self.freeze(index, column, row);
                }
            }
            *added = [[0.0; PIXELS]; 4];
            sheet.states[from] = FRESH;
        }
        sheet.begun = Some(begun);
    }

    /// Index of the tile in `column` and `row` of the picture's grid, which meets the rectangle.
    #[inline(always)]
    fn index(&self, column: i32, row: i32) -> usize {
        (row - (self.rect.y0 >> TILE)) as usize * self.pitch + (column - (self.rect.x0 >> TILE)) as usize
    }

    /// The values of the tile in `column` and `row` of the picture's grid, which meets the rectangle, and its index;
    /// `None` if it is frozen.
    #[inline(always)]
    pub(crate) fn tile(&mut self, column: i32, row: i32) -> Option<(usize, &mut Tile)> {
        let index = self.index(column, row);
        match self.states[index] {
            OPEN => {}
            FRESH => self.begin(index, column, row),
            _ => return None,
        }
        Some((index, &mut self.tiles[index]))
    }

    /// Gives the pixels of a fresh tile their fourth value. Those outside the rectangle stay 0, which never stops a tile
    /// from being frozen.
    #[inline(never)]
    fn begin(&mut self, index: usize, column: i32, row: i32) {
        let (x0, y0) = (column << TILE, row << TILE);
        for (i, fourth) in (0..).zip(&mut self.tiles[index].0[3]) {
            let (x, y) = (x0 + (i & 3), y0 + (i >> TILE));
            let inside = (self.rect.x0..self.rect.x1).contains(&x) && (self.rect.y0..self.rect.y1).contains(&y);
            *fourth = if inside { self.fourth } else { 0.0 };
        }
        self.states[index] = OPEN;
        if let Some(begun) = &mut self.begun {
            begun.push(index as u32);
        }
    }

    /// Notes that no pixel of an open tile changes any more.
    #[inline(never)]
    pub(crate) fn freeze(&mut self, index: usize, column: i32, row: i32) {
        self.states[index] = FROZEN;
        let (x, y) = (column << TILE, row << TILE);
        let tiles = self.squares.at(x, y);
        *tiles -= 1;
        if *tiles == 0 {
            *self.blocks.at(x, y) -= 1;
        }
    }

    /// Whether all tiles that meet the pixels `x0..=x1`, `y0..=y1` are frozen. The pixels lie in the rectangle.
    #[inline(always)]
    pub(crate) fn is_frozen(&self, x0: i32, y0: i32, x1: i32, y1: i32) -> bool {
        for row in y0 >> TILE..=y1 >> TILE {
            for column in x0 >> TILE..=x1 >> TILE {
                if self.states[self.index(column, row)] != FROZEN {
                    return false;
                }
            }
        }
        true
    }

    /// As [`Planes::is_frozen`] for large rectangles: looks at whole blocks and squares where it can.
    pub(crate) fn is_widely_frozen(&self, x0: i32, y0: i32, x1: i32, y1: i32) -> bool {
        for (x0, y0, x1, y1) in pieces(BLOCK, x0, y0, x1, y1) {
            if self.blocks.is_zero(x0, y0) {
                continue;
            }
            for (x0, y0, x1, y1) in pieces(SQUARE, x0, y0, x1, y1) {
                if !self.squares.is_zero(x0, y0) && !self.is_frozen(x0, y0, x1, y1) {
                    return false;
                }
            }
        }
        true
    }

    /// Pixel (`x`, `y`), which lies in the rectangle.
    pub(crate) fn pixel(&self, x: i32, y: i32) -> [f32; 4] {
        let index = self.index(x >> TILE, y >> TILE);
        match self.states[index] {
            FRESH => [0.0, 0.0, 0.0, self.fourth],
            _ => self.tiles[index].0.map(|plane| plane[place(x, y)]),
        }
    }

    /// Sets pixel (`x`, `y`), which lies in the rectangle.
    pub(crate) fn set_pixel(&mut self, x: i32, y: i32, values: [f32; 4]) {
        let index = self.index(x >> TILE, y >> TILE);
        if self.states[index] == FRESH {
            self.begin(index, x >> TILE, y >> TILE);
        }
        for (plane, value) in self.tiles[index].0.iter_mut().zip(values) {
            plane[place(x, y)] = value;
        }
    }

    /// Pixels of row `y` on which something was drawn, in pieces of at most four: the first one's column, and they.
    pub(crate) fn row(&self, y: i32) -> impl Iterator<Item = (i32, [[f32; 4]; 1 << TILE], usize)> {
        let Rect { x0, x1, .. } = self.rect;
        (x0 >> TILE..=(x1 - 1) >> TILE).filter_map(move |column| {
            let index = self.index(column, y >> TILE);
            if self.states[index] == FRESH {
                return None;
            }
            let (from, to) = (x0.max(column << TILE), x1.min((column + 1) << TILE));
            let first = place(from, y);
            let Tile(values) = &self.tiles[index];
            let pixels = std::array::from_fn(|i| values.map(|plane| plane[(first + i) % PIXELS]));
            Some((from, pixels, (to - from) as usize))
        })
    }
}

/// The parts of the pixels `x0..=x1`, `y0..=y1` that lie in each square of `1 << shift` pixels.
#[inline(always)]
fn pieces(shift: i32, x0: i32, y0: i32, x1: i32, y1: i32) -> impl Iterator<Item = (i32, i32, i32, i32)> {
    let part =
        move |low: i32, high: i32, square: i32| (low.max(square << shift), high.min(((square + 1) << shift) - 1));
    (y0 >> shift..=y1 >> shift).flat_map(move |row| {
        let (top, bottom) = part(y0, y1, row);
        (x0 >> shift..=x1 >> shift).map(move |column| {
            let (left, right) = part(x0, x1, column);
            (left, top, right, bottom)
        })
    })
}

/// Where a pixel's values lie in its tile.
#[inline(always)]
fn place(x: i32, y: i32) -> usize {
    ((y & 3) << TILE | (x & 3)) as usize
}

/// Tiles per row of at least so many: up to three rows keep off each other's places in a page. At a pitch of 4,096
/// bytes all rows of a splat fall into one cache set and stores block the loads of the next row.
fn pitch_for(tiles: usize) -> usize {
    /// Tiles in 4,096 bytes.
    const PAGE: usize = 4096 / size_of::<Tile>();
    let mut pitch = tiles;
    while !(1..=3).all(|rows| (3..=PAGE - 3).contains(&(rows * pitch % PAGE))) && tiles > PAGE / 2 {
        pitch += 1;
    }
    pitch
}
