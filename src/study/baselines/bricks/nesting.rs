//! The nesting of an order (which axis is which loop), and slices cut out of a brick.

use super::EDGE;
use crate::baselines::nesting;
use crate::trace::Trace;
use adjsplat::traverse::Order;

pub(super) const MASKS: usize = 1;

/// The indices (0 for x, 1 for y, 2 for z) of an order's slow, medium and fast axis.
#[derive(Debug, Clone, Copy)]
pub(super) struct AxisNesting {
    pub(super) slow: usize,
    pub(super) medium: usize,
    pub(super) fast: usize,
}

impl AxisNesting {
    pub(super) fn of(order: &Order) -> AxisNesting {
        let [slow, medium, fast] = nesting(order);
        AxisNesting { slow, medium, fast }
    }

    /// Returns a brick's voxels in its slice number `within`: a byte for each medium coordinate, a bit for each fast
    /// one.
    #[inline(always)]
    pub(super) fn plane<T: Trace>(self, masks: &[u64; EDGE], within: usize, brick: usize, trace: &mut T) -> u64 {
        let plane = match self.slow {
            2 => {
                trace.read(MASKS, 64 * brick + 8 * within, 8);
                masks[within]
            }
            1 => {
                (0..EDGE).for_each(|z| trace.read(MASKS, 64 * brick + 8 * z + within, 1));
                u64::from_le_bytes(masks.map(|word| word.to_le_bytes()[within]))
            }
            _ => {
                trace.read(MASKS, 64 * brick, 64);
                u64::from_le_bytes(masks.map(|word| column(word, within)))
            }
        };
        // Here the bits of a byte run along the lower of the two axes.
        if self.fast < self.medium { plane } else { transposed(plane) }
    }

    /// Returns the word and the bit of the voxel at these coordinates in a brick.
    #[inline(always)]
    pub(super) fn place(self, slow: usize, medium: usize, fast: usize) -> (usize, usize) {
        let mut at = [0; 3];
        (at[self.slow], at[self.medium], at[self.fast]) = (slow, medium, fast);
        (at[2], EDGE * at[1] + at[0])
    }
}

/// Collects bit number `bit` of each of the 8 bytes of `word`; that of the lowest byte becomes bit 0.
#[inline(always)]
fn column(word: u64, bit: usize) -> u8 {
    // The product moves the bit of byte i to bit i of the top byte: each partial product lands on its own bit.
    let column = (word >> bit & 0x0101_0101_0101_0101).wrapping_mul(0x0102_0408_1020_4080);
    column.to_le_bytes()[7]
}

/// Transposes 8 x 8 bits (Warren, "Hacker's Delight", section 7-3).
#[inline(always)]
fn transposed(mut bits: u64) -> u64 {
    for (shift, mask) in [(7, 0x00aa_00aa_00aa_00aa), (14, 0x0000_cccc_0000_cccc), (28, 0x0000_0000_f0f0_f0f0)] {
        let exchanged = (bits ^ bits >> shift) & mask;
        bits ^= exchanged ^ exchanged << shift;
    }
    bits
}
