//! The cache model: turns the accesses of a walk into misses.
//!
//! ```text
//! access -> its lines, one touch each: the first level is asked; on a miss, the next
//!        -> their pages: the first translation buffer is asked; on a miss, the next
//! ```
//!
//! Writes are treated as reads (write-allocate). Levels are neither inclusive nor exclusive. The hierarchy starts
//! empty, so each first touch misses at every level. There is no prefetching.

use super::geometry::{Geometry, LARGE_PAGE_BYTES, PAGE_BYTES};
use super::level::CacheLevel;
use super::reuse::{Reuse, ReuseFigures};
use crate::number_set::NumberSet;
use crate::trace::{Trace, WalkerArray};

/// A model of a memory hierarchy; as a trace, it receives the accesses of a walk.
#[derive(Debug, Clone)]
pub struct CacheModel {
    geometry: Geometry,
    places: Vec<ArrayExtent>,
    levels: Vec<CacheLevel>,
    translation: Vec<CacheLevel>,
    figures: CacheFigures,
    /// The bytes of the structure that were read or written, as model addresses.
    used: NumberSet,
    structure_lines: NumberSet,
    pages: NumberSet,
    large_pages: NumberSet,
    reuse: Option<Reuse>,
    /// The last line and page that were touched: they are in the first place of their set in the nearest level.
    line: u64,
    page: u64,
}

/// Where an array lies in the model's memory, in bytes.
#[derive(Debug, Clone, Copy)]
struct ArrayExtent {
    address: u64,
    bytes: u64,
    scratch: bool,
}

/// Returns the model address at which each array starts: a page's start, with an unused page before it.
pub(super) fn addresses(arrays: &[WalkerArray]) -> Vec<u64> {
    let mut next = PAGE_BYTES;
    let mut starts = Vec::new();
    for array in arrays {
        starts.push(next);
        next += array.bytes.next_multiple_of(PAGE_BYTES) + PAGE_BYTES;
    }
    starts
}

/// Counts of what a hierarchy did in a walk.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct CacheFigures {
    /// Bytes of a line.
    pub line_bytes: u64,
    /// Reads and writes, of any number of bytes.
    pub accesses: u64,
    /// Touches of lines: an access touches each line that it overlaps, once.
    pub touches: u64,
    /// Distinct bytes of the structure that were read or written.
    pub used_bytes: u64,
    /// Distinct lines of the structure that were touched.
    pub structure_lines: u64,
    /// Misses of each cache, from the nearest.
    pub levels: Vec<Misses>,
    /// Misses of each translation buffer, from the nearest.
    pub translation: Vec<u64>,
    /// Distinct pages of 4 KiB that were touched.
    pub pages: u64,
    /// Distinct pages of 2 MiB that were touched.
    pub large_pages: u64,
    /// Distances of reuse, if the model measured them.
    pub reuse: Option<ReuseFigures>,
}

/// Misses of one level of the hierarchy, by kind.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Misses {
    /// All misses.
    pub all: u64,
    /// Misses in arrays of the structure, not in scratch memory.
    pub structure: u64,
    /// Misses by the first touch of a line.
    pub cold: u64,
    /// Misses of later touches that a fully associative cache of this size would also have, if it saw every touch.
    /// It is 0 if distances were not measured.
    pub capacity: u64,
    /// All other misses: the line's set was full. It is 0 if distances were not measured.
    pub conflict: u64,
}

impl CacheFigures {
    /// Returns the fewest lines that can hold the used bytes of the structure.
    pub fn compulsory_lines(&self) -> u64 {
        self.used_bytes.div_ceil(self.line_bytes.max(1))
    }

    /// Returns the bytes fetched into level number `level` (0 is the nearest) for each used byte of the structure.
    ///
    /// # Panics
    /// If there is no such level.
    pub fn overfetch(&self, level: usize) -> f64 {
        (self.levels[level].all * self.line_bytes) as f64 / self.used_bytes.max(1) as f64
    }
}

impl CacheModel {
    /// Returns an empty hierarchy for a walker with `arrays`. If `reuse`, it measures reuse distances, which is slow.
    pub fn new(geometry: &Geometry, arrays: &[WalkerArray], reuse: bool) -> CacheModel {
        let place =
            |(array, address): (&WalkerArray, u64)| ArrayExtent { address, bytes: array.bytes, scratch: array.scratch };
        let places: Vec<ArrayExtent> = arrays.iter().zip(addresses(arrays)).map(place).collect();
        let end = places.last().map_or(0, |last| last.address + last.bytes).next_multiple_of(LARGE_PAGE_BYTES);
        let levels = |shapes: &[_]| shapes.iter().copied().map(CacheLevel::new).collect::<Vec<_>>();
        CacheModel {
            geometry: geometry.clone(),
            places,
            levels: levels(&geometry.levels),
            translation: levels(&geometry.translation),
            figures: CacheFigures {
                line_bytes: geometry.line_bytes,
                levels: vec![Misses::default(); geometry.levels.len()],
                translation: vec![0; geometry.translation.len()],
                ..CacheFigures::default()
            },
            used: NumberSet::new(end),
            structure_lines: NumberSet::new(end / geometry.line_bytes),
            pages: NumberSet::new(end / PAGE_BYTES),
            large_pages: NumberSet::new(end / LARGE_PAGE_BYTES),
            reuse: reuse.then(|| Reuse::new(end / geometry.line_bytes)),
            line: u64::MAX,
            page: u64::MAX,
        }
    }

    /// Returns the counts of everything since the model was made.
    pub fn figures(&self) -> CacheFigures {
        CacheFigures {
            used_bytes: self.used.count(),
            structure_lines: self.structure_lines.count(),
            pages: self.pages.count(),
            large_pages: self.large_pages.count(),
            reuse: self.reuse.as_ref().map(Reuse::figures),
            ..self.figures.clone()
        }
    }

    #[inline]
    fn access(&mut self, array: usize, offset: usize, bytes: usize) {
        let place = self.places[array];
        let (offset, bytes) = (offset as u64, bytes as u64);
        assert!(
            bytes > 0 && offset + bytes <= place.bytes,
            "array {array} has {} bytes, not {offset} + {bytes}",
            place.bytes
        );
        let first = place.address + offset;
        self.figures.accesses += 1;
        if !place.scratch {
            self.used.add(first, first + bytes);
        }
        let line_bytes = self.geometry.line_bytes;
        for line in first / line_bytes..=(first + bytes - 1) / line_bytes {
            self.touch(line, place.scratch);
        }
    }

    #[inline]
    fn touch(&mut self, line: u64, scratch: bool) {
        self.figures.touches += 1;
        let distance = self.reuse.as_mut().map(|reuse| reuse.touch(line));
        if line == self.line {
            return;
        }
        self.line = line;
        let page = line * self.geometry.line_bytes / PAGE_BYTES;
        if page != self.page {
            self.page = page;
            self.pages.add(page, page + 1);
            let large = page * PAGE_BYTES / LARGE_PAGE_BYTES;
            self.large_pages.add(large, large + 1);
            for (buffer, misses) in self.translation.iter_mut().zip(&mut self.figures.translation) {
                if buffer.touch(page) {
                    break;
                }
                *misses += 1;
            }
        }
        if !scratch {
            self.structure_lines.add(line, line + 1);
        }
        for (index, level) in self.levels.iter_mut().enumerate() {
            if level.touch(line) {
                break;
            }
            let misses = &mut self.figures.levels[index];
            misses.all += 1;
            misses.structure += u64::from(!scratch);
            match distance {
                None => {}
                Some(None) => misses.cold += 1,
                Some(Some(distance)) if distance >= self.geometry.levels[index].places => misses.capacity += 1,
                Some(Some(_)) => misses.conflict += 1,
            }
        }
    }
}

impl Trace for CacheModel {
    #[inline]
    fn read(&mut self, array: usize, offset: usize, bytes: usize) {
        self.access(array, offset, bytes);
    }

    #[inline]
    fn write(&mut self, array: usize, offset: usize, bytes: usize) {
        self.access(array, offset, bytes);
    }
}
