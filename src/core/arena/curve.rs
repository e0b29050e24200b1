//! The orders in which tiles may lie in memory.
//!
//! A walk visits a lane's face row by row or column by column. Along a space-filling curve both neighbours of a
//! tile lie near it in memory, so both nestings stay coherent in the cache.

use crate::error::{Error, Result};

/// Order of a lane's tiles in memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum TileOrder {
    /// Along a Z-order curve (Morton 1966): the bits of u and v in turn, u lowest.
    #[default]
    Morton,
    /// Along a Hilbert curve of 2^13 x 2^13 tiles.
    Hilbert,
    /// Row by row: v slow, u fast.
    Rows,
}

/// A tile's row and column are below 2^13: 65,535 lines in tiles of 8.
const CURVE_BITS: u32 = 13;

impl TileOrder {
    /// Its number in the header.
    pub const fn code(self) -> u8 {
        match self {
            TileOrder::Morton => 0,
            TileOrder::Hilbert => 1,
            TileOrder::Rows => 2,
        }
    }

    /// The order of a header's number.
    pub const fn from_code(code: u8) -> Option<TileOrder> {
        match code {
            0 => Some(TileOrder::Morton),
            1 => Some(TileOrder::Hilbert),
            2 => Some(TileOrder::Rows),
            _ => None,
        }
    }

    /// Its name on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            TileOrder::Morton => "morton",
            TileOrder::Hilbert => "hilbert",
            TileOrder::Rows => "rows",
        }
    }

    /// The order of that name.
    ///
    /// # Errors
    /// [`Error::Input`] for any other name.
    pub fn from_name(name: &str) -> Result<TileOrder> {
        [TileOrder::Morton, TileOrder::Hilbert, TileOrder::Rows]
            .into_iter()
            .find(|order| order.name() == name)
            .ok_or_else(|| Error::input("tile order", format!("is '{name}', but must be morton, hilbert or rows")))
    }

    /// Where tile (u, v) stands on the curve; distinct tiles have distinct keys.
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

/// Distance along the Hilbert curve: quadrant by quadrant from the largest, turning the rest to match.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn morton_interleaves_bits() {
        assert_eq!(TileOrder::Morton.key(0b11, 0b01), 0b0111);
        assert_eq!(TileOrder::Morton.key(0x1fff, 0), 0x0155_5555);
    }

    #[test]
    fn hilbert_visits_neighbours() {
        let mut tiles: Vec<(u16, u16)> = (0..64).flat_map(|v| (0..64).map(move |u| (u, v))).collect();
        tiles.sort_by_key(|&(u, v)| TileOrder::Hilbert.key(u, v));
        for pair in tiles.windows(2) {
            let apart = pair[0].0.abs_diff(pair[1].0) + pair[0].1.abs_diff(pair[1].1);
            assert_eq!(apart, 1, "{pair:?} follow each other but do not touch");
        }
    }

    #[test]
    fn names_and_codes_return() {
        for order in [TileOrder::Morton, TileOrder::Hilbert, TileOrder::Rows] {
            assert_eq!(TileOrder::from_code(order.code()), Some(order));
            assert_eq!(TileOrder::from_name(order.name()).unwrap(), order);
        }
        assert_eq!(TileOrder::from_code(3), None);
        assert!(TileOrder::from_name("zigzag").is_err());
    }
}
