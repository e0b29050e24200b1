//! Sorted splatting: a list of the visible voxels, sorted by distance for every frame.
//!
//! Renderers of splats without a grid draw this way (Kerbl et al. 2023 and others). Distance is measured from the eye,
//! or along the direction of a parallel view.
//!
//! Distances become integers of 32 bits over the frame's range, computed in double precision: no two voxels on a ray
//! have the same integer, wherever the eye is. These keys and the voxels' indices go through a radix sort in four
//! passes of 8 bits, least significant first. A pass whose digit all keys share is skipped. Voxels are then read by
//! index.

use super::allocate::{filled, reserved};
use super::{Normal, Receiver, Viewing, Walker};
use crate::Subject;
use crate::subject::VisibleVoxel;
use crate::trace::{Trace, WalkerArray};
use adjsplat::error::Result;
use adjsplat::traverse::{Sense, Viewpoint};

const VOXELS: usize = 0;
const PAIRS: usize = 1;
const SPARE: usize = 2;
const COUNTS: usize = 3;

/// Bits of a digit of the radix sort.
const DIGIT: u32 = 8;
const DIGITS: usize = 1 << DIGIT;
const PASSES: usize = 4;

/// A voxel's distance as a sort key, and the voxel's index in the list.
#[derive(Debug, Clone, Copy, Default)]
struct KeyedIndex {
    key: u32,
    index: u32,
}

/// A list of visible voxels, 10 bytes each, and 16 more bytes for each to sort them.
#[derive(Debug)]
pub struct Sorted {
    voxels: Vec<VisibleVoxel>,
    pairs: Vec<KeyedIndex>,
    spare: Vec<KeyedIndex>,
    /// For each pass, the number of keys with each digit; then the index at which each digit's next pair goes.
    counts: Vec<[u32; DIGITS]>,
    /// Lowest and highest coordinates of the voxels along each axis.
    bounds: [[f64; 3]; 2],
}

impl Sorted {
    /// Copies the voxels of `subject`.
    ///
    /// # Errors
    /// [`Error::Limit`](adjsplat::Error::Limit) if memory cannot be had.
    pub fn new(subject: &Subject) -> Result<Sorted> {
        let count = subject.voxels.len() as u64;
        let mut voxels = reserved("the list of voxels", count)?;
        voxels.extend_from_slice(&subject.voxels);
        let mut bounds = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
        for voxel in &voxels {
            for (a, c) in voxel.position.map(f64::from).into_iter().enumerate() {
                bounds[0][a] = bounds[0][a].min(c);
                bounds[1][a] = bounds[1][a].max(c);
            }
        }
        Ok(Sorted {
            voxels,
            pairs: filled("the pairs to sort", count, KeyedIndex::default())?,
            spare: filled("the pairs to sort", count, KeyedIndex::default())?,
            counts: vec![[0; DIGITS]; PASSES],
            bounds,
        })
    }

    /// Computes the keys from `distance`, which lies between `near` and `far`, and counts their digits.
    /// The voxel drawn first has the lowest key.
    #[inline(always)]
    fn keys<T: Trace>(&mut self, sense: Sense, near: f64, far: f64, distance: impl Fn([f64; 3]) -> f64, trace: &mut T) {
        let scale = f64::from(u32::MAX) / (far - near).max(f64::MIN_POSITIVE);
        let (factor, offset) = match sense {
            Sense::FrontToBack => (scale, -near * scale),
            Sense::BackToFront => (-scale, far * scale),
        };
        self.counts.fill([0; DIGITS]);
        for (index, (voxel, pair)) in (0..).zip(self.voxels.iter().zip(&mut self.pairs)) {
            trace.read(VOXELS, 10 * index as usize, 6);
            let place = distance(voxel.position.map(f64::from)) * factor + offset;
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "casts saturate, as is meant")]
            let key = place as u32;
            *pair = KeyedIndex { key, index };
            trace.write(PAIRS, 8 * index as usize, 8);
            for (pass, counts) in self.counts.iter_mut().enumerate() {
                let digit = digit(key, pass);
                counts[digit] += 1;
                trace.write(COUNTS, 4 * (pass * DIGITS + digit), 4);
            }
        }
    }

    /// Sorts the pairs by key, stably. Returns which array a trace notes them in: `PAIRS`, or `SPARE` after an odd
    /// number of passes.
    #[inline(always)]
    fn sort<T: Trace>(&mut self, trace: &mut T) -> usize {
        let [mut from, mut to] = [PAIRS, SPARE];
        for (pass, counts) in self.counts.iter_mut().enumerate() {
            let count = self.pairs.len();
            if self.pairs.first().is_none_or(|pair| counts[digit(pair.key, pass)] as usize == count) {
                continue;
            }
            let mut place = 0;
            for (number, count) in counts.iter_mut().enumerate() {
                trace.write(COUNTS, 4 * (pass * DIGITS + number), 4);
                place += std::mem::replace(count, place);
            }
            for (index, &pair) in self.pairs.iter().enumerate() {
                trace.read(from, 8 * index, 8);
                let digit = digit(pair.key, pass);
                let place = counts[digit] as usize;
                counts[digit] += 1;
                trace.write(COUNTS, 4 * (pass * DIGITS + digit), 4);
                self.spare[place] = pair;
                trace.write(to, 8 * place, 8);
            }
            std::mem::swap(&mut self.pairs, &mut self.spare);
            std::mem::swap(&mut from, &mut to);
        }
        debug_assert!(self.pairs.is_sorted_by_key(|pair| pair.key));
        from
    }
}

#[inline(always)]
fn digit(key: u32, pass: usize) -> usize {
    (key >> (8 * pass)) as usize % DIGITS
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

impl Walker for Sorted {
    fn arrays(&self) -> Vec<WalkerArray> {
        vec![
            WalkerArray::of("voxels", &self.voxels),
            WalkerArray::scratch("pairs", &self.pairs),
            WalkerArray::scratch("spare pairs", &self.spare),
            WalkerArray::scratch("counts", &self.counts),
        ]
    }

    fn walk<R: Receiver, T: Trace>(&mut self, viewing: &Viewing, receiver: &mut R, trace: &mut T) {
        if self.voxels.is_empty() {
            return;
        }
        let sense = viewing.sense();
        let [low, high] = self.bounds;
        match viewing.viewpoint {
            Viewpoint::Parallel { direction } => {
                let length = dot(direction, direction).sqrt();
                let direction = direction.map(|c| c / length);
                let end = |far: bool| {
                    let corner = [0, 1, 2].map(|a| if (direction[a] >= 0.0) == far { high[a] } else { low[a] });
                    dot(corner, direction)
                };
                self.keys(sense, end(false), end(true), |position| dot(position, direction), trace);
            }
            Viewpoint::Perspective { eye, .. } => {
                let distance = |position: [f64; 3]| {
                    let offset = [0, 1, 2].map(|a| position[a] - eye[a]);
                    dot(offset, offset).sqrt()
                };
                let near = [0, 1, 2].map(|a| eye[a].clamp(low[a], high[a]));
                let far = [0, 1, 2].map(|a| if 2.0 * eye[a] < low[a] + high[a] { high[a] } else { low[a] });
                self.keys(sense, distance(near), distance(far), distance, trace);
            }
        }
        let pairs = self.sort(trace);
        for (place, pair) in self.pairs.iter().enumerate() {
            trace.read(pairs, 8 * place + 4, 4);
            trace.read(VOXELS, 10 * pair.index as usize, 10);
            let voxel = self.voxels[pair.index as usize];
            receiver.voxel(voxel.position, voxel.value, Normal::Code(voxel.normal));
        }
    }
}
