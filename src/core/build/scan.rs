//! The visibility scan: finds the visible voxels of a block of rows.
//!
//! In: raw samples of a slice and, if needed, gradients. Out: the visible voxels in the format of the temporary store
//! (`spill.rs`), and statistics of all samples.

use super::spill::{GROUP_ROWS, RowArrays, SpilledRows};
use super::summary::{RawRange, SampleSummary, UnnamedLabels};
use super::sweep::RowBlock;
use super::visibility::VisibilityTest;
use crate::arena::Region;
use crate::arena::layout::Channels;
use crate::classify::gradient::{GridAxes, outward};
use crate::classify::normal;
use crate::volume::{Header, Sample};

/// Number of samples whose range is compared with the visible range at once; most such blocks hold nothing visible.
const BLOCK: usize = 64;

/// Everything that decides which voxels of a slice are visible.
pub(super) struct VisibleScan<'a, T> {
    pub(super) samples: &'a [T],
    pub(super) header: &'a Header,
    pub(super) test: &'a VisibilityTest,
    pub(super) channels: Channels,
    /// The box of samples that are scanned; the others are there for gradients only.
    pub(super) kept: &'a Region,
}

impl<T: Sample> VisibleScan<'_, T> {
    /// Returns the visible voxels of a block, with statistics of its samples. `slopes` returns those at (x, y);
    /// `row` is a reused buffer.
    pub(super) fn rows(
        &self,
        block: &RowBlock,
        row: &mut RowArrays,
        slopes: &dyn Fn(usize, usize) -> [f64; 3],
    ) -> (SpilledRows, SampleSummary) {
        let VisibleScan { samples: slice, header, test, channels, kept } = *self;
        let (dims, axes) = (header.grid.dims.map(|points| points as usize), GridAxes::of(&header.grid));
        let width = dims[0];
        let mut visible = SpilledRows::default();
        let ends = test.ends::<T>();
        let mut range = RawRange::default();
        let mut unnamed = UnnamedLabels::default();
        let xs = kept.xs.start as usize..kept.xs.end as usize;
        for y in block.rows.clone() {
            let is_kept = kept.zs.contains(&block.z) && kept.ys.contains(&y);
            let line = if is_kept { &slice[y as usize * width..][xs.clone()] } else { &[] };
            for (samples, first) in line.chunks(BLOCK).zip((xs.start..).step_by(BLOCK)) {
                let ends_here = range.add(samples);
                test.add_unnamed(samples, &mut unnamed);
                let (Some([low, high]), Some([lowest, highest])) = (ends, ends_here) else { continue };
                if highest < low || lowest > high {
                    continue;
                }
                for (&sample, x) in samples.iter().zip(first..) {
                    if !test.passes(sample) {
                        continue;
                    }
                    if channels.magnitude_bits > 0 || channels.normal_bits > 0 {
                        let mut slopes = slopes(x, y as usize);
                        let outward = outward(dims, [x, y as usize, block.z as usize]);
                        let is_cut = outward.is_some() && test.shows_cut(test.value(sample));
                        if channels.magnitude_bits > 0 {
                            // Infinite on a cap: its magnitude follows when the range of the values is known (encoder.rs).
                            let magnitude =
                                if is_cut && test.is_capped() { f64::INFINITY } else { axes.magnitude(slopes) };
                            if !test.is_visible(test.value(sample), magnitude) {
                                continue;
                            }
                            row.magnitudes.push(magnitude);
                        }
                        // Around a cap, the outer half of the surface's transition is lit like the cap.
                        if let Some(outward) = outward.filter(|_| is_cut || test.is_capped()) {
                            slopes = outward.map(|component| -component);
                        }
                        match channels.normal_bits {
                            0 => {}
                            8 => row.normals.extend_from_slice(&normal::encode8(axes.along(slopes)).to_le_bytes()),
                            _ => row.normals.extend_from_slice(&normal::encode16(axes.along(slopes)).to_le_bytes()),
                        }
                    }
                    row.xs.push(u16::try_from(x).expect("a row has at most 65,535 samples"));
                    row.samples.extend_from_slice(bytemuck::bytes_of(&sample));
                }
            }
            visible.push(u16::try_from(y).expect("a slice has at most 65,535 rows"), row);
            if (y + 1) % GROUP_ROWS == 0 || y + 1 == block.rows.end {
                visible.end_group();
            }
        }
        (visible, SampleSummary { unnamed, ..range.summary(header) })
    }
}
