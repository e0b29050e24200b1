//! The pixels of a band, in tiles. Also tracks the tiles whose pixels can no longer change.
//!
//! In: a rectangle of the picture, in absolute pixel coordinates. Out: tiles of 4 x 4 pixels, aligned to multiples of 4
//! in the picture, each with sixteen reds, greens, blues and alphas. A footprint covers a few whole tiles, and every
//! vector instruction treats a full vector. Tiles are read and written whole: a processor forwards a store to a load
//! only if the load asks for no more than was stored.
//!
//! A tile is *fresh* until something is drawn on it; an empty part of the picture then costs no memory. It is *frozen*
//! when all its pixels are below the termination bound; a bit a tile tells that, so that rectangles are tested quickly.

use bytemuck::Zeroable;
use fearless_simd::f32x4;
use fearless_simd::prelude::*;

use super::bit_rows::BitRows;
use super::blend::Blend;
use crate::error::Result;
use crate::splat::composite::Look;
use crate::splat::frame::zeroed;
use crate::splat::near::{EyeRays, RayLengths};

/// Base-2 logarithm of the side of a tile in pixels.
pub(super) const TILE_SHIFT: i32 = 2;
/// Number of pixels of a tile.
pub(super) const TILE_PIXELS: usize = 1 << (2 * TILE_SHIFT);
/// For each pixel of a tile: its column in the tile.
pub(super) const COLUMN: [f32; TILE_PIXELS] = [0., 1., 2., 3., 0., 1., 2., 3., 0., 1., 2., 3., 0., 1., 2., 3.];
/// For each pixel of a tile: its row in the tile.
pub(super) const ROW: [f32; TILE_PIXELS] = [0., 0., 0., 0., 1., 1., 1., 1., 2., 2., 2., 2., 3., 3., 3., 3.];

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

/// The values of 4 x 4 pixels, row by row: reds, greens, blues, alphas.
#[derive(Debug, Clone, Copy, PartialEq, Zeroable)]
#[repr(C, align(64))]
pub(super) struct PixelTile(pub(super) [[f32; TILE_PIXELS]; 4]);

impl PixelTile {
    /// Blends a splat of this look with the pixels; `amounts`: factors on its colour at each pixel. Returns whether any pixel may
    /// still change.
    #[inline(always)]
    pub(super) fn blend<B: Blend>(&mut self, amounts: &[f32; TILE_PIXELS], look: &Look, stop: f32) -> bool {
        let [red, green, blue, alpha] = &mut self.0;
        // In a loop over the colours a compiler would gather them.
        *red = blended::<B>(red, alpha, amounts, look[0], stop);
        *green = blended::<B>(green, alpha, amounts, look[1], stop);
        *blue = blended::<B>(blue, alpha, amounts, look[2], stop);
        let mut faded = [0.0; TILE_PIXELS];
        for i in 0..TILE_PIXELS {
            faded[i] = B::fade(alpha[i], amounts[i], stop);
        }
        *alpha = faded;
        let mut is_open = !B::STOPS;
        if B::STOPS {
            for i in 0..TILE_PIXELS {
                is_open |= alpha[i] >= stop;
            }
        }
        is_open
    }

    /// Returns the reds, greens, blues and opacities of row `y`, where alpha may be a transmittance.
    #[inline(always)]
    fn row<S: Simd>(&self, simd: S, y: usize, transmits: bool) -> [f32x4<S>; 4] {
        let [red, green, blue, alpha] =
            self.0.each_ref().map(|plane| f32x4::from_slice(simd, &plane[y << TILE_SHIFT..(y + 1) << TILE_SHIFT]));
        [red, green, blue, if transmits { 1.0 - alpha } else { alpha }]
    }
}

/// Returns one colour of a tile's pixels after a splat.
#[inline(always)]
fn blended<B: Blend>(
    values: &[f32; TILE_PIXELS],
    alpha: &[f32; TILE_PIXELS],
    amounts: &[f32; TILE_PIXELS],
    ink: f32,
    stop: f32,
) -> [f32; TILE_PIXELS] {
    let mut new = [0.0; TILE_PIXELS];
    for i in 0..TILE_PIXELS {
        new[i] = B::blend(values[i], alpha[i], amounts[i], ink, stop);
    }
    new
}

/// State of a tile on which nothing was drawn yet.
const FRESH: u8 = 0;
/// State of a tile of which some pixel may still change.
const OPEN: u8 = 1;
/// State of a tile of which no pixel changes any more.
const FROZEN: u8 = 2;

/// The pixels of one band, in tiles.
pub struct TileBuffer {
    /// The band's pixels.
    pub(super) rect: Rect,
    /// Alpha of a fresh pixel.
    initial_alpha: f32,
    /// Number of tiles from the start of one row of tiles to the next in `tiles`.
    pitch: usize,
    /// Fresh tiles may hold old values.
    tiles: Box<[PixelTile]>,
    /// The state of each tile.
    states: Vec<u8>,
    /// In a perspective: the lengths of the rays of each tile's pixels, once they were asked for.
    lengths: Box<[RayLengths<TILE_PIXELS>]>,
    /// For each tile: whether its pixels may still change.
    pub(super) open_tiles: BitRows,
}

impl TileBuffer {
    /// Creates the pixels of `rect`, which is not empty, with colours 0 and alphas `initial_alpha`.
    pub fn new(rect: Rect, initial_alpha: f32) -> Result<TileBuffer> {
        let (tiles, states, lengths, open_tiles) = (Box::default(), Vec::new(), Box::default(), BitRows::default());
        let mut buffer = TileBuffer { rect, initial_alpha, pitch: 0, tiles, states, lengths, open_tiles };
        buffer.restart(rect)?;
        Ok(buffer)
    }

    /// Adds room for the lengths of the pixels' rays, if the view is a perspective.
    pub fn with_rays(self, is_perspective: bool) -> Result<TileBuffer> {
        let count = if is_perspective { self.len() } else { 0 };
        Ok(TileBuffer { lengths: zeroed(count as u64)?, ..self })
    }

    /// Makes these the pixels of another rectangle, all fresh. Allocates memory only if there is too little.
    pub(super) fn restart(&mut self, rect: Rect) -> Result<()> {
        let tiles_along =
            |low: i32, high: i32| usize::try_from(((high - 1) >> TILE_SHIFT) - (low >> TILE_SHIFT) + 1).unwrap_or(0);
        let (columns, rows) = (tiles_along(rect.x0, rect.x1), tiles_along(rect.y0, rect.y1));
        (self.rect, self.pitch) = (rect, pitch_for(columns));
        let count = self.pitch * rows;
        if self.tiles.len() < count {
            self.tiles = zeroed(count as u64)?;
        }
        self.states.clear();
        self.states.resize(count, FRESH);
        self.open_tiles = BitRows::new(columns, rows);
        (0..rows).for_each(|row| self.open_tiles.set(row, [0, columns - 1]));
        Ok(())
    }

    /// Returns the row and the column, among the band's tiles, of the tile in `column` and `row` of the picture's grid, which meets the
    /// rectangle.
    #[inline(always)]
    fn row_and_column(&self, column: i32, row: i32) -> [usize; 2] {
        [(row - (self.rect.y0 >> TILE_SHIFT)) as usize, (column - (self.rect.x0 >> TILE_SHIFT)) as usize]
    }

    /// Returns the index of that tile.
    #[inline(always)]
    fn index(&self, column: i32, row: i32) -> usize {
        let [row, column] = self.row_and_column(column, row);
        row * self.pitch + column
    }

    /// Returns the index and values of the tile in `column` and `row` of the picture's grid; `None` if it is frozen.
    #[inline(always)]
    pub(super) fn tile(&mut self, column: i32, row: i32) -> Option<(usize, &mut PixelTile)> {
        let index = self.index(column, row);
        match self.states[index] {
            OPEN => {}
            FRESH => self.open(index, column, row),
            _ => return None,
        }
        Some((index, &mut self.tiles[index]))
    }

    /// Returns the same with the lengths of the rays of the tile's pixels in a perspective.
    #[inline(always)]
    pub(super) fn tile_and_rays(
        &mut self,
        column: i32,
        row: i32,
        rays: &EyeRays,
    ) -> Option<(usize, &mut PixelTile, &RayLengths<TILE_PIXELS>)> {
        let (index, _) = self.tile(column, row)?;
        let lengths = &mut self.lengths[index];
        if lengths.per_square[0] == 0.0 {
            *lengths = tile_lengths(rays, column, row);
        }
        Some((index, &mut self.tiles[index], lengths))
    }

    /// Sets the colours and the initial alpha of a fresh tile's pixels. Outside the rectangle alpha is 0, so that the tile can freeze.
    #[inline(never)]
    fn open(&mut self, index: usize, column: i32, row: i32) {
        let (x0, y0) = (column << TILE_SHIFT, row << TILE_SHIFT);
        self.tiles[index] = PixelTile::zeroed();
        for (i, alpha) in (0..).zip(&mut self.tiles[index].0[3]) {
            let (x, y) = (x0 + (i & 3), y0 + (i >> TILE_SHIFT));
            let inside = (self.rect.x0..self.rect.x1).contains(&x) && (self.rect.y0..self.rect.y1).contains(&y);
            *alpha = if inside { self.initial_alpha } else { 0.0 };
        }
        self.states[index] = OPEN;
    }

    /// Marks a tile as frozen: none of its pixels changes any more.
    #[inline(never)]
    pub(super) fn freeze(&mut self, index: usize, column: i32, row: i32) {
        self.states[index] = FROZEN;
        let [row, column] = self.row_and_column(column, row);
        self.open_tiles.clear(row, column);
    }

    /// Freezes those tiles, on which nothing was drawn yet, that are `chosen` by column and row of the picture's grid. Their
    /// colours and alphas are 0.
    pub(super) fn freeze_fresh(&mut self, chosen: impl Fn(i32, i32) -> bool) {
        let Rect { x0, y0, x1, y1 } = self.rect;
        for row in y0 >> TILE_SHIFT..=(y1 - 1) >> TILE_SHIFT {
            for column in (x0 >> TILE_SHIFT..=(x1 - 1) >> TILE_SHIFT).filter(|column| chosen(*column, row)) {
                let index = self.index(column, row);
                self.tiles[index] = PixelTile::zeroed();
                self.freeze(index, column, row);
            }
        }
    }

    /// Returns whether all tiles that meet `rect`, a part of the band, are frozen.
    #[inline(always)]
    pub(super) fn is_frozen(&self, rect: Rect) -> bool {
        let [top, left] = self.row_and_column(rect.x0 >> TILE_SHIFT, rect.y0 >> TILE_SHIFT);
        let [bottom, right] = self.row_and_column((rect.x1 - 1) >> TILE_SHIFT, (rect.y1 - 1) >> TILE_SHIFT);
        !self.open_tiles.any_in([top, bottom], [left, right])
    }

    /// Returns the number of tiles, with what pads their rows.
    pub(super) fn len(&self) -> usize {
        self.states.len()
    }

    /// Returns the values of pixel (`x`, `y`), which lies in the rectangle.
    pub(super) fn pixel(&self, x: i32, y: i32) -> [f32; 4] {
        let index = self.index(x >> TILE_SHIFT, y >> TILE_SHIFT);
        match self.states[index] {
            FRESH => [0.0, 0.0, 0.0, self.initial_alpha],
            _ => self.tiles[index].0.map(|plane| plane[index_in_tile(x, y)]),
        }
    }

    /// Sets the values of pixel (`x`, `y`), which lies in the rectangle.
    pub(super) fn set_pixel(&mut self, x: i32, y: i32, values: [f32; 4]) {
        let index = self.index(x >> TILE_SHIFT, y >> TILE_SHIFT);
        if self.states[index] == FRESH {
            self.open(index, x >> TILE_SHIFT, y >> TILE_SHIFT);
        }
        for (plane, value) in self.tiles[index].0.iter_mut().zip(values) {
            plane[index_in_tile(x, y)] = value;
        }
    }

    /// Calls `visit` with the column and the values of each pixel of row `y`; leaves out tiles on which nothing was drawn.
    pub(super) fn visit_row(&self, y: i32, mut visit: impl FnMut(i32, [f32; 4])) {
        let Rect { x0, x1, .. } = self.rect;
        for column in x0 >> TILE_SHIFT..=(x1 - 1) >> TILE_SHIFT {
            let index = self.index(column, y >> TILE_SHIFT);
            if self.states[index] != FRESH {
                let PixelTile(values) = &self.tiles[index];
                for x in x0.max(column << TILE_SHIFT)..x1.min((column + 1) << TILE_SHIFT) {
                    visit(x, values.map(|plane| plane[index_in_tile(x, y)]));
                }
            }
        }
    }

    /// Writes the colours and alphas of all tiles on which something was drawn to a plane of zeroes. The plane has half as many columns
    /// as the band, if it `halves` them, and half as many rows, if it halves these: the means of pixels. `pixels` are its rows of
    /// `columns` each, in whole tiles of the band. If alpha `transmits` (is a transmittance), it is turned into an opacity.
    #[inline(always)]
    pub(super) fn put<S: Simd>(
        &self,
        simd: S,
        transmits: bool,
        halves: [bool; 2],
        pixels: &mut [[f32; 4]],
        columns: usize,
    ) {
        let [across, down] = halves.map(|halved| (1 << TILE_SHIFT) >> u32::from(halved));
        for (row, pixels) in pixels.chunks_exact_mut(columns * down).enumerate() {
            for (column, tile) in self.drawn_tiles(row) {
                if halves == [false; 2] {
                    for (y, row) in pixels.chunks_exact_mut(columns).enumerate() {
                        let row = &mut row[column << TILE_SHIFT..(column + 1) << TILE_SHIFT];
                        f32x4::store_four_interleaved(tile.row(simd, y, transmits), row.as_flattened_mut());
                    }
                    continue;
                }
                let mut lines = [[[0.0; 4]; 1 << TILE_SHIFT]; 1 << TILE_SHIFT];
                for (y, line) in lines.iter_mut().enumerate() {
                    f32x4::store_four_interleaved(tile.row(simd, y, transmits), line.as_flattened_mut());
                }
                let each = (1 << TILE_SHIFT) / down;
                for (lines, row) in lines.chunks_exact(each).zip(pixels.chunks_exact_mut(columns)) {
                    let row = &mut row[column * across..(column + 1) * across];
                    halve_rows(lines.as_flattened(), 1 << TILE_SHIFT, halves, row);
                }
            }
        }
    }

    /// Returns those tiles of a row on which something was drawn, each with its column.
    fn drawn_tiles(&self, row: usize) -> impl Iterator<Item = (usize, &PixelTile)> {
        let row = row * self.pitch..(row + 1) * self.pitch;
        let tiles = self.tiles[row.clone()].iter().zip(&self.states[row]).enumerate();
        tiles.filter(|(_, (_, state))| **state != FRESH).map(|(column, (tile, _))| (column, tile))
    }
}

/// Adds the means of pairs of pixels to a row of zeroes: of two columns, of two rows, or of both, as it `halves` them. `pixels` begin
/// with the rows in question, of `columns` each; at the edge a row or a column may be missing.
pub(super) fn halve_rows(pixels: &[[f32; 4]], columns: usize, halves: [bool; 2], row: &mut [[f32; 4]]) {
    let [across, down] = halves.map(|halved| 1 + usize::from(halved));
    let share = 1.0 / (across * down) as f32;
    for line in pixels.chunks_exact(columns).take(down) {
        for (pixel, parts) in row.iter_mut().zip(line.chunks(across)) {
            for part in parts {
                for c in 0..4 {
                    pixel[c] += share * part[c];
                }
            }
        }
    }
}

/// Returns the lengths of the rays of a tile's pixels.
#[inline(never)]
fn tile_lengths(rays: &EyeRays, column: i32, row: i32) -> RayLengths<TILE_PIXELS> {
    let (columns, rows) = tile_pixels(column, row);
    rays.lengths(columns, rows)
}

/// Returns the columns and the rows of a tile's pixels.
#[inline(always)]
pub(super) fn tile_pixels(column: i32, row: i32) -> ([i32; TILE_PIXELS], [i32; TILE_PIXELS]) {
    let (mut columns, mut rows) = ([0; TILE_PIXELS], [0; TILE_PIXELS]);
    for i in 0..TILE_PIXELS {
        (columns[i], rows[i]) = ((column << TILE_SHIFT) + COLUMN[i] as i32, (row << TILE_SHIFT) + ROW[i] as i32);
    }
    (columns, rows)
}

/// Returns a pixel's index in the values of its tile.
#[inline(always)]
pub(super) fn index_in_tile(x: i32, y: i32) -> usize {
    ((y & 3) << TILE_SHIFT | (x & 3)) as usize
}

/// Returns a row pitch, in tiles, of at least `tiles`. It avoids that tiles of up to three neighbouring rows have the
/// same offset in a page: at a pitch of 4,096 bytes all rows of a splat would fall into one cache set, and stores would
/// block the loads of the next row.
fn pitch_for(tiles: usize) -> usize {
    const PAGE_TILES: usize = 4096 / size_of::<PixelTile>();
    let are_apart = |pitch: usize| (1..=3).all(|rows| (3..=PAGE_TILES - 3).contains(&(rows * pitch % PAGE_TILES)));
    (tiles..).find(|&pitch| tiles <= PAGE_TILES / 2 || are_apart(pitch)).expect("some pitch of a page is apart")
}
