//! The order of a lane's tiles in memory.
//!
//! A walk visits a lane's face (its lines as a 2-D array) row by row or column by column. On a space-filling curve, the
//! next tile in the row and the next one in the column are both near in memory, so both directions use the cache well.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

/// The order of a lane's tiles in memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum TileOrder {
    /// Along a Z-order curve (Morton 1966): the bits of the tile's u and v are interleaved; bit 0 is from u.
    #[default]
    Morton = 0,
    /// Along a Hilbert curve of 2^13 x 2^13 tiles.
    Hilbert = 1,
    /// Row by row: u changes fastest.
    Rows = 2,
}

/// Number of bits that a tile's row or column needs: an axis has at most 65,535 lines, in tiles of 8.
const CURVE_BITS: u32 = 13;

impl TileOrder {
    const ALL: [TileOrder; 3] = [TileOrder::Morton, TileOrder::Hilbert, TileOrder::Rows];

    /// Returns the number that stands for this order in a file's header.
    pub const fn code(self) -> u8 {
        self as u8
    }

    /// Returns the order with this number in a file's header; `None` if no order has it.
    pub fn from_code(code: u8) -> Option<TileOrder> {
        TileOrder::ALL.into_iter().find(|order| order.code() == code)
    }

    /// Returns the order's name: "morton", "hilbert" or "rows".
    pub const fn name(self) -> &'static str {
        ["morton", "hilbert", "rows"][self as usize]
    }

    /// Returns the order called `name`.
    ///
    /// # Errors
    /// [`Error::Input`] for any other name.
    pub fn from_name(name: &str) -> Result<TileOrder> {
        let order = TileOrder::ALL.into_iter().find(|order| order.name() == name);
        order.ok_or_else(|| Error::input("tile order", format!("is '{name}', but must be morton, hilbert or rows")))
    }

    /// Returns the position of tile (u, v) in the order; unique for each tile.
    pub fn key(self, u: u16, v: u16) -> u32 {
        match self {
            TileOrder::Morton => spread(u) | spread(v) << 1,
            TileOrder::Hilbert => hilbert(u.into(), v.into()),
            TileOrder::Rows => u32::from(v) << 16 | u32::from(u),
        }
    }
}

/// Moves bit i of `x` to bit 2i.
fn spread(x: u16) -> u32 {
    let mut x = u32::from(x);
    x = (x | x << 8) & 0x00ff_00ff;
    x = (x | x << 4) & 0x0f0f_0f0f;
    x = (x | x << 2) & 0x3333_3333;
    (x | x << 1) & 0x5555_5555
}

/// Returns how far along the Hilbert curve tile (u, v) lies. Each bit selects a quadrant; the lower bits are reflected
/// to match the quadrant's orientation.
fn hilbert(mut u: u32, mut v: u32) -> u32 {
    let mut distance = 0;
    for bit in (0..CURVE_BITS).rev() {
        let half = 1 << bit;
        let right = u & half != 0;
        let upper = v & half != 0;
        let quadrant = if right { 3 ^ u32::from(upper) } else { u32::from(upper) };
        distance = distance << 2 | quadrant;
        (u, v) = (u & (half - 1), v & (half - 1));
        if !upper {
            if right {
                (u, v) = (half - 1 - u, half - 1 - v);
            }
            (u, v) = (v, u);
        }
    }
    distance
}
