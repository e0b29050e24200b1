//! Reuse distances: how many other lines are touched before a line is touched again.
//!
//! In: numbers of touched lines, in order. Out: [`ReuseFigures`]. The distance of a touch is the number of distinct
//! other lines since the last touch of its line. A fully associative LRU cache of C lines hits if the distance is below
//! C. So the distances give the misses for every C at once (Mattson, Gecsei, Slutz and Traiger 1970, stack algorithms).
//!
//! ```text
//! each line keeps the slot (place in time) of its last touch; a slot is live if it holds some line's last touch
//! distance = live slots after the line's own  a Fenwick tree over slots (1994): O(log slots)
//! touch: the line's slot dies, it takes the next slot; when slots run out, the live ones are compacted
//! ```
//!
//! There are twice as many slots as lines, so compacting costs O(log) per touch. Distances and times are counted in
//! bins of powers of two, which makes the curves exact at powers of two.

/// The slot of a line that was never touched.
const NEVER: u32 = u32::MAX;
/// Number of bins, which count 0, 1, 2-3, 4-7 and so on.
const BINS: usize = 64;

/// Measures reuse distances: receives the touches of lines, one by one.
#[derive(Debug, Clone)]
pub struct Reuse {
    /// For each line, the slot of its last touch.
    slots: Vec<u32>,
    /// For each slot, live or not, the line that touched it.
    lines: Vec<u32>,
    /// Fenwick tree that counts live slots; its indices start at 1.
    live: Vec<u32>,
    next: u32,
    distinct: u64,
    /// Number of touches so far. The next field holds the time (1 for the first touch) of each line's last touch.
    time: u64,
    last: Vec<u64>,
    distances: [u64; BINS],
    /// For each bin, count and sum of the times between two touches of a line.
    /// `edges` counts the times from the start to first touches and from last touches to the end.
    times: [(u64, u64); BINS],
    edges: [(u64, u64); BINS],
}

/// Reuse distances of a trace, and the times between touches.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ReuseFigures {
    /// Number of touches of lines.
    pub touches: u64,
    /// Number of distinct lines; their first touches miss in every cache.
    pub distinct: u64,
    /// Number of touches by distance: entry 0 counts distance 0, entry k the distances 2^(k-1) to 2^k - 1.
    pub distances: Vec<u64>,
    times: [(u64, u64); BINS],
    edges: [(u64, u64); BINS],
}

/// Returns the bin of a number: 0 for 0, k for 2^(k-1) to 2^k - 1.
fn bin(number: u64) -> usize {
    (64 - number.leading_zeros()) as usize
}

impl Reuse {
    /// Starts a measurement for lines whose numbers are below `lines`.
    ///
    /// # Panics
    /// If there are more than 2^30 lines, whose slots would not fit 32 bits.
    pub fn new(lines: u64) -> Reuse {
        assert!(lines <= 1 << 30, "slots have 32 bits");
        let count = usize::try_from(lines).expect("at most 2^30");
        let slots = (2 * count).max(64);
        Reuse {
            slots: vec![NEVER; count],
            lines: vec![0; slots],
            live: vec![0; slots + 1],
            next: 0,
            distinct: 0,
            time: 0,
            last: vec![0; count],
            distances: [0; BINS],
            times: [(0, 0); BINS],
            edges: [(0, 0); BINS],
        }
    }

    /// Touches `line` and returns its distance; `None` for the first touch.
    #[inline]
    pub fn touch(&mut self, line: u64) -> Option<u64> {
        let index = usize::try_from(line).expect("below the number of lines");
        self.time += 1;
        let slot = self.slots[index];
        let distance = if slot == NEVER {
            self.distinct += 1;
            note(&mut self.edges, self.time);
            None
        } else if slot + 1 == self.next {
            // The line was also the last one touched: nothing moves.
            self.distances[0] += 1;
            note(&mut self.times, self.time - self.last[index]);
            self.last[index] = self.time;
            return Some(0);
        } else {
            let distance = self.distinct - self.live_through(slot);
            self.distances[bin(distance)] += 1;
            note(&mut self.times, self.time - self.last[index]);
            self.change(slot, u32::MAX);
            Some(distance)
        };
        self.last[index] = self.time;
        self.slots[index] = NEVER;
        if self.next as usize == self.lines.len() {
            self.gather();
        }
        self.slots[index] = self.next;
        self.lines[self.next as usize] = u32::try_from(line).expect("at most 2^30");
        self.change(self.next, 1);
        self.next += 1;
        distance
    }

    /// Returns the number of live slots up to `slot`, inclusive.
    fn live_through(&self, slot: u32) -> u64 {
        let mut at = slot as usize + 1;
        let mut sum = 0;
        while at > 0 {
            sum += u64::from(self.live[at]);
            at &= at - 1;
        }
        sum
    }

    /// Adds `more`, 1 or -1 modulo 2^32, to the tree's count at `slot`.
    fn change(&mut self, slot: u32, more: u32) {
        let mut at = slot as usize + 1;
        while at < self.live.len() {
            self.live[at] = self.live[at].wrapping_add(more);
            at += at & at.wrapping_neg();
        }
    }

    /// Moves the live slots to the front. The line that is being touched has no live slot at this moment.
    fn gather(&mut self) {
        let mut next = 0u32;
        for slot in 0..self.next {
            let line = self.lines[slot as usize];
            if self.slots[line as usize] == slot {
                self.slots[line as usize] = next;
                self.lines[next as usize] = line;
                next += 1;
            }
        }
        // In a tree over ones up to `next`, node i counts the slots of its range that are below `next`.
        for at in 1..self.live.len() {
            let low = at & (at - 1);
            let ones = at.min(next as usize).saturating_sub(low);
            self.live[at] = u32::try_from(ones).expect("below the number of slots");
        }
        self.next = next;
    }

    /// Returns the distances measured so far.
    pub fn figures(&self) -> ReuseFigures {
        let mut edges = self.edges;
        for &last in self.last.iter().filter(|&&last| last > 0) {
            note(&mut edges, self.time - last + 1);
        }
        let bins = self.distances.iter().rposition(|&count| count > 0).map_or(0, |last| last + 1);
        ReuseFigures {
            touches: self.time,
            distinct: self.distinct,
            distances: self.distances[..bins].to_vec(),
            times: self.times,
            edges,
        }
    }
}

/// Counts `time` in bins whose upper ends are powers of two, inclusive: bins above bin k hold times above 2^k.
fn note(bins: &mut [(u64, u64); BINS], time: u64) {
    let (count, sum) = &mut bins[bin(time - 1)];
    (*count, *sum) = (*count + 1, *sum + time);
}

impl ReuseFigures {
    /// Returns the misses of a fully associative LRU cache of 2^`power` lines that starts empty.
    pub fn misses(&self, power: usize) -> u64 {
        self.distinct + self.distances.iter().skip(power + 1).sum::<u64>()
    }

    /// Returns the miss ratios of caches of 1, 2, 4 ... lines, until only first touches miss.
    pub fn miss_ratios(&self) -> Vec<f64> {
        let ratio = |power| self.misses(power) as f64 / self.touches.max(1) as f64;
        (0..self.distances.len().max(1)).map(ratio).collect()
    }

    /// Returns the mean number of distinct lines in 2^`power` consecutive touches; `None` if the trace has fewer
    /// touches.
    ///
    /// Exact over all windows of that length. A line is missing from a window if two of its touches, or an end of the
    /// trace and a touch, enclose the window. So the times between touches suffice (Xiang, Bao, Ding and Gao 2011,
    /// equation 1).
    pub fn working_set(&self, power: usize) -> Option<f64> {
        let window = 1u64.checked_shl(u32::try_from(power).ok()?)?;
        let windows = (self.touches + 1).checked_sub(window).filter(|&windows| windows > 0 && power < BINS)?;
        let beyond = |bins: &[(u64, u64); BINS]| {
            bins[power + 1..].iter().map(|&(count, sum)| u128::from(sum) - u128::from(window) * u128::from(count)).sum()
        };
        let (inside, edges): (u128, u128) = (beyond(&self.times), beyond(&self.edges));
        Some(self.distinct as f64 - (inside + edges) as f64 / windows as f64)
    }
}
