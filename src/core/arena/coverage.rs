//! Coverage codes: how much of a level's block is visible, and where.
//!
//! In: the share of a block's points that are visible and the mean of their positions. Out: a code of 8 or 16 bits, and
//! back.
//!
//! ```text
//! 8 bits    bit i: the point (i & 1, i >> 1 & 1, i >> 2) of the block's 2 x 2 x 2 points is visible
//! 16 bits   0..7: s, share (s / 127)^2; 7..10, 10..13, 13..16: i along x, y, z, offset (i - 3) / 8
//! ```
//!
//! Offsets are from the block's centre, in the level's own spacing. The mean position matters more than the share: a level
//! without it is 9 to 11 dB farther from the truth (docs/studies/levels.md).

use super::layout::Channels;

/// How much of a block is visible, and where.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coverage {
    /// Share of the block's points that are visible, 0 to 1.
    pub share: f32,
    /// Mean position of the visible points along x, y and z, from the block's centre, in the level's spacing; -0.375 to
    /// 0.375.
    pub offset: [f32; 3],
}

/// Number of points of a block that an 8-bit code tells apart.
const POINTS: f32 = 8.0;
/// Largest code of a share in a 16-bit code.
pub(super) const MOST_SHARE: u8 = 127;
const LARGEST: f32 = MOST_SHARE as f32;
/// Largest code of an offset, and the number of codes per spacing.
const LAST: u32 = 6;
const PER_SPACING: f32 = 8.0;
/// Largest offset along an axis, in the level's spacing.
pub(crate) const MOST_OFFSET: f64 = 0.375;

/// What each 8-bit code stands for: looked up, as a walk asks for every voxel.
static MASKS: [Coverage; 256] = {
    let mut masks = [Coverage { share: 0.0, offset: [0.0; 3] }; 256];
    let mut mask = 1u32;
    while mask < 256 {
        masks[mask as usize] = Coverage::of_mask(mask);
        mask += 1;
    }
    masks
};

impl Coverage {
    /// A voxel that is wholly visible.
    pub const WHOLE: Coverage = Coverage { share: 1.0, offset: [0.0; 3] };

    /// Returns the share and the mean place of the points of a mask, which is not 0.
    const fn of_mask(mask: u32) -> Coverage {
        let points = mask.count_ones() as f32;
        // Of the points that are visible, those at the high end of each axis.
        let high = [mask & 0xaa, mask & 0xcc, mask & 0xf0];
        let mut offset = [0.0; 3];
        let mut axis = 0;
        while axis < 3 {
            offset[axis] = 0.5 * high[axis].count_ones() as f32 / points - 0.25;
            axis += 1;
        }
        Coverage { share: points / POINTS, offset }
    }

    /// Returns what `code` stands for in a lane with these channels. Any code is safe; those that no writer writes stand for
    /// some coverage.
    #[inline(always)]
    #[expect(clippy::cast_precision_loss, reason = "codes have few bits")]
    pub fn of_code(code: u16, channels: Channels) -> Coverage {
        match channels.coverage_bits {
            0 => Coverage::WHOLE,
            8 => MASKS[usize::from(code & 0xff)],
            _ => {
                let code = u32::from(code);
                let share = (code & 0x7f) as f32 / LARGEST;
                let offset = [7, 10, 13].map(|at| ((code >> at & 7).min(LAST) as f32 - 3.0) / PER_SPACING);
                Coverage { share: share * share, offset }
            }
        }
    }

    /// Returns whether voxels may have this code in a lane with these channels.
    pub(crate) fn is_code(code: u16, channels: Channels) -> bool {
        match channels.coverage_bits {
            0 => true,
            bits => Coverage::is_code_of(code.into(), bits == 8),
        }
    }

    /// Returns whether voxels may have this code: some of the block is visible, and no offset is beyond the last.
    #[inline(always)]
    pub(crate) fn is_code_of(code: u64, is_mask: bool) -> bool {
        if is_mask {
            return code != 0;
        }
        // A code of an offset is 7 if its three bits are set.
        let offsets = code >> 7;
        code & 0x7f != 0 && offsets & offsets >> 1 & offsets >> 2 & 0o111 == 0
    }

    /// Returns the code of a voxel that is wholly visible.
    pub(crate) fn whole_code(channels: Channels) -> u16 {
        match channels.coverage_bits {
            0 => 0,
            8 => 0xff,
            _ => Coverage::WHOLE.code(),
        }
    }

    /// Returns the 16-bit code nearest to this coverage.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped before")]
    pub fn code(self) -> u16 {
        let share = (self.share.sqrt() * LARGEST).round().clamp(1.0, LARGEST) as u16;
        let places = self.offset.map(|offset| ((PER_SPACING * offset).round() + 3.0).clamp(0.0, LAST as f32) as u16);
        share | places[0] << 7 | places[1] << 10 | places[2] << 13
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn channels(coverage_bits: u8) -> Channels {
        Channels { value_bits: 8, normal_bits: 0, magnitude_bits: 0, coverage_bits, coherence: false }
    }

    #[test]
    fn masks_are_the_share_and_the_mean_of_their_points() {
        for mask in 1..=255u16 {
            let points: Vec<[f32; 3]> = (0..8u16)
                .filter(|i| mask >> i & 1 == 1)
                .map(|i| [i & 1, i >> 1 & 1, i >> 2].map(|d| f32::from(d) / 2.0 - 0.25))
                .collect();
            let Coverage { share, offset } = Coverage::of_code(mask, channels(8));
            assert!((share - points.len() as f32 / 8.0).abs() < 1e-6, "{mask}");
            for a in 0..3 {
                let mean = points.iter().map(|point| point[a]).sum::<f32>() / points.len() as f32;
                assert!((offset[a] - mean).abs() < 1e-6, "{mask}, axis {a}");
            }
        }
    }

    #[test]
    fn words_come_back() {
        for share in 1..=127u16 {
            for place in 0..343u16 {
                let code = share | (place % 7) << 7 | (place / 7 % 7) << 10 | (place / 49) << 13;
                assert_eq!(Coverage::of_code(code, channels(16)).code(), code);
            }
        }
        assert_eq!(Coverage::of_code(Coverage::WHOLE.code(), channels(16)), Coverage::WHOLE);
    }
}
