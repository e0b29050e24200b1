//! A traced walk through one lane: from a [`LaneStore`] and an order to blocks of voxels with their codes (stored
//! numbers).

use std::ops::Range;

use super::CodesRead;
use super::decode::{LineDecoder, SliceLine, TracedBatch, group};
use super::scratch_sizes::{
    BATCH, BATCH_ARRAYS, LINE_ARRAYS, LINES, LINES_AT_ONCE, MEDIUMS, SLICES, ScratchSizes, TWO_SIDED,
};
use super::sort::sorted_tiles;
use super::store::{CHUNK, LaneStore, Mask, has_bit, rank};
use super::traced_vec::TracedVec;
use crate::baselines::{Normal, Receiver, nesting};
use crate::trace::Trace;
use adjsplat::internals::scatter::BLOCK;
use adjsplat::traverse::{AxisOrder, Batch, Order, Sense, SplitForm};
use adjsplat::volume::Axis;

/// Up to [`BLOCK`] voxels of a batch, as the renderer's first stage takes them, with their codes.
pub(crate) struct VisitedBlock<'a> {
    pub(crate) batch: &'a Batch<'a>,
    /// Indices of the block's voxels in the batch.
    pub(crate) block: Range<usize>,
    /// Value codes of the block's voxels; zeros if the walk does not read them. Normal codes follow.
    pub(crate) values: &'a [u8],
    pub(crate) normals: &'a [u16],
}

impl VisitedBlock<'_> {
    /// Delivers the block's voxels to `receiver`.
    #[inline]
    pub(crate) fn deliver<R: Receiver>(&self, order: &Order, receiver: &mut R) {
        let axes = nesting(order);
        for (index, voxel) in self.block.clone().enumerate() {
            let position = position(axes, self.batch, voxel);
            receiver.voxel(position, self.values[index], Normal::Code(self.normals[index]));
        }
    }
}

#[inline(always)]
fn position([slow, medium, fast]: [usize; 3], batch: &Batch, voxel: usize) -> [u16; 3] {
    let mut position = [0; 3];
    (position[slow], position[medium], position[fast]) = (batch.slow, batch.medium[voxel], batch.fast[voxel]);
    position
}

/// Walks through the voxels of `store` in `order`, reads `codes` of each, and calls `visit` with every block.
///
/// # Panics
/// If the lane does not run along the order's fast axis, or breaks a rule of the format.
pub(crate) fn traced_walk<S: LaneStore, T: Trace>(
    store: &S,
    order: &Order,
    codes: CodesRead,
    sizes: ScratchSizes,
    trace: &mut T,
    visit: &mut dyn FnMut(&VisitedBlock),
) {
    assert_eq!(store.axis(), order.fast, "a walk needs the lane along its fast axis");
    TracedWalk::new(store, *order, codes, sizes, trace).slices(visit);
}

struct TracedWalk<'s, 't, S, T> {
    store: &'s S,
    order: Order,
    codes: CodesRead,
    slow_is_v: bool,
    trace: &'t mut T,
    /// Numbers of the tiles, by row of tiles and in each row by column; `starts` says where rows begin.
    sorted: TracedVec<u32>,
    starts: TracedVec<u32>,
    slices: TracedVec<u16>,
    /// Lines of the current slice, ascending. `two_sided` holds them in the order of an axis with voxels on both sides
    /// of the eye; `mediums` are their coordinates.
    lines: TracedVec<SliceLine>,
    mediums: TracedVec<u16>,
    two_sided: TracedVec<SliceLine>,
    batch: TracedBatch,
    /// A few lines whose voxels are on both sides of the eye, ascending; each has room for `line_room` voxels.
    ascending: TracedBatch,
    line_room: usize,
    /// Number of voxels for which a batch has room.
    capacity: usize,
}

impl<'s, 't, S: LaneStore, T: Trace> TracedWalk<'s, 't, S, T> {
    fn new(store: &'s S, order: Order, codes: CodesRead, sizes: ScratchSizes, trace: &'t mut T) -> Self {
        let points = |axis: Axis| store.dims()[axis.index()];
        let across = |axis: Axis| points(axis).div_ceil(store.edge().into()) as usize;
        let slow_is_v = order.slow == store.axis().others()[1];
        let sides = [across(order.slow), across(order.medium)];
        let (sorted, starts) = sorted_tiles(store, slow_is_v, sides, sizes.first_array, trace);
        // Each walk allocates a batch that is large enough for its own lane.
        let longest = points(store.axis()) as usize;
        let capacity = longest.max(BATCH);
        let line_room = longest + 3 * CHUNK;
        let ascending = TracedBatch::new(sizes.first_array + LINE_ARRAYS, LINES_AT_ONCE * line_room);
        if matches!(order.along[order.fast.index()], AxisOrder::TwoSided { .. }) {
            // Zeros come before each line.
            (0..LINES_AT_ONCE).for_each(|line| ascending.fast.write(line * line_room, CHUNK, trace));
        }
        TracedWalk {
            store,
            order,
            codes,
            slow_is_v,
            trace,
            sorted,
            starts,
            slices: TracedVec::new(sizes.first_array + SLICES, points(order.slow) as usize),
            lines: TracedVec::new(sizes.first_array + LINES, sizes.lines()),
            mediums: TracedVec::new(sizes.first_array + MEDIUMS, sizes.lines()),
            two_sided: TracedVec::new(sizes.first_array + TWO_SIDED, sizes.lines()),
            batch: TracedBatch::new(sizes.first_array + BATCH_ARRAYS, capacity + 2 * CHUNK),
            ascending,
            line_room,
            capacity,
        }
    }

    /// Returns the range of `sorted` with the tiles of row number `row`.
    fn row(&mut self, row: usize) -> Range<usize> {
        self.starts.get(row, self.trace) as usize..self.starts.get(row + 1, self.trace) as usize
    }

    /// Returns the bit in a tile's mask of the line at `medium`; `within` is the slice's place in the tile.
    #[inline(always)]
    fn bit(&self, within: u16, medium: u16) -> u32 {
        let edge = self.store.edge();
        u32::from(if self.slow_is_v { edge * within + medium } else { edge * medium + within })
    }

    #[inline(always)]
    fn has_lines(&self, mask: &Mask, within: u16) -> bool {
        (0..self.store.edge()).any(|medium| has_bit(mask, self.bit(within, medium)))
    }

    /// Lists the slices that have lines; returns their number.
    fn find_slices(&mut self) -> usize {
        let edge = self.store.edge();
        let mut count = 0;
        for row in 0..self.starts.len() - 1 {
            let mut union = Mask::default();
            for item in self.row(row) {
                let mask = self.store.mask(self.sorted.get(item, self.trace), self.trace);
                union.iter_mut().zip(mask).for_each(|(all, bits)| *all |= bits);
            }
            for within in 0..edge {
                if self.has_lines(&union, within) && count < self.slices.len() {
                    let slice = u16::try_from(row).unwrap_or(u16::MAX).saturating_mul(edge) + within;
                    self.slices.set(count, slice, self.trace);
                    count += 1;
                }
            }
        }
        count
    }

    /// Visits every slice that has lines, in the order of the slow axis.
    fn slices(&mut self, visit: &mut dyn FnMut(&VisitedBlock)) {
        let count = self.find_slices();
        let numbers = self.slices.items()[..count].to_vec();
        let along = |axis: Axis| self.order.along[axis.index()];
        let (slow_order, medium_order) = (along(self.order.slow), along(self.order.medium));
        let is_two_sided = matches!(medium_order, AxisOrder::TwoSided { .. });
        slow_order.for_each_index(&numbers, |index| {
            let slow = self.slices.get(index, self.trace);
            let count = self.gather(slow);
            match medium_order {
                AxisOrder::Ascending => {}
                AxisOrder::Descending => self.reverse_lines(count),
                AxisOrder::TwoSided { .. } => self.part_lines(medium_order, count),
            }
            let mut first = 0;
            while first < count {
                let lines = if is_two_sided { &self.two_sided } else { &self.lines };
                let (end, base) = group(lines, first, count, self.capacity, self.trace);
                self.decode(first..end, is_two_sided, base, slow, visit);
                first = end;
            }
        });
    }

    fn reverse_lines(&mut self, count: usize) {
        for low in 0..count / 2 {
            let high = count - 1 - low;
            let (a, b) = (self.lines.get(low, self.trace), self.lines.get(high, self.trace));
            self.lines.set(low, b, self.trace);
            self.lines.set(high, a, self.trace);
        }
    }

    /// Sorts the slice's `count` lines into the order of an axis with voxels on both sides of the eye.
    fn part_lines(&mut self, sides: AxisOrder, count: usize) {
        for item in 0..count {
            let line = self.lines.get(item, self.trace);
            self.mediums.set(item, line.medium, self.trace);
        }
        let mut to = 0;
        sides.for_each_index(&self.mediums.items()[..count], |from| {
            let line = self.lines.get(from, self.trace);
            self.two_sided.set(to, line, self.trace);
            to += 1;
        });
    }

    /// Lists the lines of slice `slow` in ascending order; returns their number.
    fn gather(&mut self, slow: u16) -> usize {
        let edge = self.store.edge();
        let within = slow % edge;
        let longest = u64::from(self.store.dims()[self.store.axis().index()]);
        let record_count = self.store.record_count();
        let mut count = 0;
        for item in self.row(usize::from(slow / edge)) {
            let tile = self.sorted.get(item, self.trace);
            let mask = self.store.mask(tile, self.trace);
            if !self.has_lines(&mask, within) {
                continue;
            }
            // This reads what a renderer culls by, and where the tile's lines and records lie.
            let start = self.store.start(tile, self.trace);
            let first_medium = edge.wrapping_mul(start.place[usize::from(!self.slow_is_v)]);
            for medium in 0..edge {
                let bit = self.bit(within, medium);
                if !has_bit(&mask, bit) {
                    continue;
                }
                let Some([first, end]) = self.store.line(tile, &start, rank(&mask, bit), self.trace) else { break };
                let records = end.wrapping_sub(first);
                #[allow(clippy::cast_possible_truncation, reason = "only kept if it is at most 65,535")]
                let line = SliceLine {
                    first_record: start.first_record + first,
                    count: records as u16,
                    medium: first_medium.wrapping_add(medium),
                };
                self.lines.set(count, line, self.trace);
                let is_sound = records.wrapping_sub(1) < longest && start.first_record + end <= record_count;
                count += usize::from(is_sound);
            }
        }
        count
    }

    /// Decodes the slice's lines in the range `lines` and delivers their voxels; record indices count from `base`.
    fn decode(
        &mut self,
        lines: Range<usize>,
        is_two_sided: bool,
        base: u64,
        slow: u16,
        visit: &mut dyn FnMut(&VisitedBlock),
    ) {
        let list = if is_two_sided { &self.two_sided } else { &self.lines };
        let (decoder, trace) = (LineDecoder { store: self.store, base }, &mut *self.trace);
        let range = match self.order.along[self.order.fast.index()] {
            AxisOrder::Ascending => {
                let mut end = CHUNK;
                for item in lines {
                    end = decoder.up(list.get(item, trace), &mut self.batch, end, trace);
                }
                CHUNK..end
            }
            AxisOrder::Descending => {
                let top = CHUNK + self.capacity;
                let mut start = top;
                for item in lines.rev() {
                    start = decoder.down(list.get(item, trace), &mut self.batch, start, trace);
                }
                start..top
            }
            AxisOrder::TwoSided { eye, form, sense } => {
                self.decode_sides(lines, is_two_sided, &decoder, (eye, form, sense))
            }
        };
        self.hand_over(range, base, slow, visit);
    }

    /// Decodes the slice's lines in the range `lines` to the batch, each in the order of an axis with voxels on both
    /// sides of the eye; returns the range of the batch that they fill.
    fn decode_sides(
        &mut self,
        lines: Range<usize>,
        is_two_sided: bool,
        decoder: &LineDecoder<S>,
        (eye, form, sense): (f64, SplitForm, Sense),
    ) -> Range<usize> {
        let list = if is_two_sided { &self.two_sided } else { &self.lines };
        let far_to_near = AxisOrder::TwoSided { eye, form, sense: Sense::BackToFront };
        let is_down = sense == Sense::FrontToBack;
        let top = CHUNK + self.capacity;
        let mut at = if is_down { top } else { CHUNK };
        let all: Vec<usize> = lines.collect();
        let groups: Vec<&[usize]> =
            if is_down { all.rchunks(LINES_AT_ONCE).collect() } else { all.chunks(LINES_AT_ONCE).collect() };
        for group in groups {
            let mut decoded = Vec::new();
            for (index, &item) in group.iter().enumerate() {
                let line = list.get(item, self.trace);
                let first = index * self.line_room + CHUNK;
                let (end, has_stepping) = decoder.ascending(line, &mut self.ascending, first, self.trace);
                decoded.push((line, first..end, has_stepping));
            }
            if is_down {
                decoded.reverse();
            }
            for (line, places, has_stepping) in decoded {
                let coordinates = &self.ascending.fast.items()[places.clone()];
                let mut sequence = Vec::new();
                far_to_near.for_each_index(coordinates, |index| sequence.push(index));
                // How many voxels come from either end before the other end or the next kind of chunk follows.
                let segments = match form {
                    SplitForm::Interleaved => vec![coordinates.len()],
                    SplitForm::Split => {
                        let meet = coordinates.partition_point(|&c| f64::from(c) < eye);
                        let on_plane = usize::from(coordinates.get(meet).is_some_and(|&c| f64::from(c) == eye));
                        vec![meet, coordinates.len() - meet - on_plane, on_plane]
                    }
                };
                let (mut low, mut high) = (0, coordinates.len());
                let mut sequence = sequence.as_slice();
                for segment in segments {
                    let (now, later) = sequence.split_at(segment);
                    sequence = later;
                    for chunk in now.chunks(CHUNK) {
                        let reads_low = form == SplitForm::Interleaved || chunk[0] == low;
                        if reads_low {
                            self.ascending.fast.read(places.start + low, CHUNK, self.trace);
                        }
                        if form == SplitForm::Interleaved || !reads_low {
                            self.ascending.fast.read(places.start + high - CHUNK, CHUNK, self.trace);
                        }
                        self.batch.write_chunk(if is_down { at - CHUNK } else { at }, self.trace);
                        for &index in chunk {
                            let voxel = self.ascending.voxel(places.start + index);
                            at -= usize::from(is_down);
                            self.batch.put(at, line.medium, voxel, true, self.trace);
                            at += usize::from(!is_down);
                            if index == low {
                                low += 1;
                            } else {
                                high -= 1;
                            }
                        }
                    }
                }
                if has_stepping {
                    // Their records are looked up once more.
                    let written = if is_down { at..at + coordinates.len() } else { at - coordinates.len()..at };
                    for place in written {
                        self.batch.record.read(place, 1, self.trace);
                        self.ascending.record.read(places.start, 1, self.trace);
                        self.batch.record.write(place, 1, self.trace);
                    }
                }
            }
        }
        if is_down { at..top } else { CHUNK..at }
    }

    /// Reads the batch's voxels in `range` as the renderer's first stage does, and calls `visit` block by block.
    fn hand_over(&mut self, range: Range<usize>, base: u64, slow: u16, visit: &mut dyn FnMut(&VisitedBlock)) {
        let TracedBatch { medium, fast, record } = &self.batch;
        let items = (&medium.items()[range.clone()], &fast.items()[range.clone()], &record.items()[range.clone()]);
        let batch = Batch { slow, medium: items.0, fast: items.1, record: items.2, base };
        let axes = nesting(&self.order);
        let (mut values, mut normals) = ([0; BLOCK], [0; BLOCK]);
        for from in (0..batch.len()).step_by(BLOCK) {
            let block = from..batch.len().min(from + BLOCK);
            medium.read(range.start + from, block.len(), self.trace);
            fast.read(range.start + from, block.len(), self.trace);
            if self.codes >= CodesRead::Values {
                for voxel in block.clone() {
                    record.read(range.start + voxel, 1, self.trace);
                    let place = position(axes, &batch, voxel);
                    values[voxel - from] = self.store.value(place, batch.record_index(voxel), self.trace);
                }
            }
            if self.codes >= CodesRead::ValuesAndNormals {
                for voxel in block.clone() {
                    record.read(range.start + voxel, 1, self.trace);
                    let place = position(axes, &batch, voxel);
                    normals[voxel - from] = self.store.normal(place, batch.record_index(voxel), self.trace);
                }
            }
            let count = block.len();
            visit(&VisitedBlock { batch: &batch, block, values: &values[..count], normals: &normals[..count] });
        }
    }
}
