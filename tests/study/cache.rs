//! The cache model, judged by traces whose misses can be counted by hand, and by naive twins on random ones.
//!
//! What it cannot catch: a walk that tells a wrong address (`own_walk` does, for our own).

use adjsplat_study::Trace;
use adjsplat_study::cache::{Associativity, CacheFigures, CacheLevel, CacheModel, Geometry, Reuse};
use adjsplat_study::trace::WalkerArray;

/// One array of the structure.
fn array(bytes: u64) -> WalkerArray {
    WalkerArray { name: "array", bytes, scratch: false }
}

/// What the default hierarchy does on reads of one array of `bytes`.
fn figures(bytes: u64, reads: impl IntoIterator<Item = (usize, usize)>) -> CacheFigures {
    let mut model = CacheModel::new(&Geometry::default(), &[array(bytes)], true);
    reads.into_iter().for_each(|(offset, count)| model.read(0, offset, count));
    model.figures()
}

fn misses(figures: &CacheFigures) -> Vec<u64> {
    figures.levels.iter().map(|level| level.all).collect()
}

#[test]
fn a_scan_misses_once_a_line_and_once_a_page() {
    let bytes = 20 << 20;
    let found = figures(bytes, (0..bytes as usize).step_by(4).map(|offset| (offset, 4)));
    assert_eq!(misses(&found), [bytes / 64; 3]);
    assert_eq!(found.translation, [bytes / 4096; 2]);
    assert_eq!((found.accesses, found.touches), (bytes / 4, bytes / 4));
    assert_eq!((found.used_bytes, found.structure_lines), (bytes, bytes / 64));
    assert_eq!(found.compulsory_lines(), bytes / 64);
    assert_eq!((found.pages, found.large_pages), (bytes / 4096, 11), "from 4 KiB on, so in part of an eleventh");
    assert_eq!(found.levels[0].cold, bytes / 64);
    assert!((0..3).all(|level| found.overfetch(level) == 1.0));
}

#[test]
fn repeated_scans_hit_if_all_fits_and_miss_if_one_line_does_not() {
    for (level, bytes) in [(0, 32u64 << 10), (1, 1 << 20), (2, 8 << 20)] {
        let scans = |bytes: u64, times: usize| {
            let lines = (bytes / 64) as usize;
            figures(bytes, (0..times * lines).map(|i| (i % lines * 64, 64)))
        };
        let fits = scans(bytes, 5);
        assert_eq!(fits.levels[level].all, bytes / 64, "level {level}: {bytes} bytes fit");
        // One line more makes one set cycle through one line more than it has ways: it misses always, the others hit.
        let ways = [8, 16, 16][level];
        let exceeds = scans(bytes + 64, 5);
        let expected = bytes / 64 + 1 + 4 * (ways + 1);
        assert_eq!(exceeds.levels[level].all, expected, "level {level}: one line too many");
        let split = exceeds.levels[level];
        assert_eq!(split.cold + split.capacity + split.conflict, split.all);
        assert_eq!(split.conflict, 0, "a fully associative level of this size misses each time");
    }
    // Where there is one set, one line too many makes every touch a miss.
    let geometry = Geometry { line_bytes: 64, levels: vec![Associativity::full(512)], translation: vec![] };
    let mut model = CacheModel::new(&geometry, &[array(513 * 64)], false);
    (0..5 * 513).for_each(|i| model.read(0, i % 513 * 64, 1));
    assert_eq!(model.figures().levels[0].all, 5 * 513);
}

#[test]
fn strides_of_the_size_of_a_way_share_one_set() {
    // 64 sets of 64 bytes: addresses 4 KiB apart are of one set of eight ways.
    let rounds = |lines: usize| figures(64 << 12, (0..10 * lines).map(|i| (i % lines * 4096, 4)));
    assert_eq!(rounds(8).levels[0].all, 8);
    let nine = rounds(9);
    assert_eq!(nine.levels[0].all, 90);
    assert_eq!((nine.levels[0].cold, nine.levels[0].conflict, nine.levels[0].capacity), (9, 81, 0));
    assert_eq!(nine.levels[1].all, 9, "the second level has 1024 sets");
    assert_eq!(nine.overfetch(0), (90 * 64) as f64 / 36.0);
}

#[test]
fn translations_follow_pages() {
    let pages = |count: usize| figures(2000 << 12, (0..3 * count).map(|i| (i % count * 4096 + i % 61 * 64, 8)));
    assert_eq!(pages(64).translation, [64, 64]);
    assert_eq!(pages(65).translation, [3 * 65, 65], "65 pages in turn miss 64 places each time");
    assert_eq!(pages(1536).translation, [3 * 1536, 1536], "1536 pages fill each of 128 sets");
    assert_eq!(pages(1537).translation, [3 * 1537, 1537 + 2 * 13], "one set has a page too many");
}

#[test]
fn accesses_touch_every_line_that_they_lie_in() {
    let found = figures(1 << 12, [(60, 8), (0, 200), (127, 2)]);
    assert_eq!((found.accesses, found.touches), (3, 2 + 4 + 2));
    assert_eq!((found.used_bytes, found.structure_lines, found.compulsory_lines()), (200, 4, 4));
    assert_eq!(misses(&found), [4; 3]);
}

#[test]
fn arrays_lie_apart_from_the_start_of_a_page_each() {
    let arrays = [array(1), array(4097), WalkerArray { scratch: true, ..array(10) }];
    let mut model = CacheModel::new(&Geometry::default(), &arrays, false);
    model.read(0, 0, 1);
    model.write(1, 4096, 1);
    model.read(1, 0, 1);
    model.write(2, 0, 10);
    let found = model.figures();
    assert_eq!(found.pages, 4);
    assert_eq!((found.used_bytes, found.structure_lines), (3, 3), "scratch is no part of the structure");
    assert_eq!((found.levels[0].all, found.levels[0].structure), (4, 3));
}

#[test]
#[should_panic(expected = "array 0 has 16 bytes")]
fn a_walk_outside_its_arrays_is_found_out() {
    figures(16, [(12, 8)]);
}

#[test]
fn a_cycle_of_lines_has_one_distance() {
    let mut reuse = Reuse::new(100);
    for round in 0..10 {
        for line in 0..100 {
            assert_eq!(reuse.touch(line), (round > 0).then_some(99));
        }
    }
    let found = reuse.figures();
    assert_eq!((found.touches, found.distinct), (1000, 100));
    assert_eq!(found.distances[7], 900, "64 to 127");
    assert_eq!((found.misses(6), found.misses(7)), (1000, 100));
    assert_eq!(found.miss_ratios(), [1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.1]);
    for (power, distinct) in [(0, 1.0), (3, 8.0), (6, 64.0), (7, 100.0), (9, 100.0)] {
        assert_eq!(found.working_set(power), Some(distinct), "windows of 2^{power} touches");
    }
    assert_eq!(found.working_set(10), None);
}

/// Numbers that look random, some much likelier than others.
fn random_lines(count: usize, lines: u64, seed: u64) -> Vec<u64> {
    let mut state = seed;
    let mut next = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        state >> 33
    };
    (0..count)
        .map(|_| {
            let range = lines >> (next() % 8);
            next() % range.max(1)
        })
        .collect()
}

/// The slow twin of a level: a list a set.
fn naive_misses(trace: &[u64], shape: Associativity) -> Vec<u64> {
    let sets = shape.places / shape.ways;
    let mut lists = vec![Vec::<u64>::new(); sets as usize];
    let mut missed = Vec::new();
    for &line in trace {
        let list = &mut lists[(line % sets) as usize];
        match list.iter().position(|&other| other == line) {
            Some(at) => drop(list.remove(at)),
            None => missed.push(line),
        }
        list.insert(0, line);
        list.truncate(shape.ways as usize);
    }
    missed
}

#[test]
fn levels_equal_lists() {
    for (seed, (places, ways)) in (1..).zip([(64, 1), (64, 2), (96, 8), (60, 12), (128, 128), (1, 1)]) {
        let shape = Associativity { places, ways };
        let trace = random_lines(20_000, 500, seed);
        let mut level = CacheLevel::new(shape);
        let missed: Vec<u64> = trace.iter().copied().filter(|&line| !level.touch(line)).collect();
        assert_eq!(missed, naive_misses(&trace, shape), "{places} places, {ways} ways");
    }
}

#[test]
fn a_chain_of_levels_equals_lists_fed_with_misses() {
    let shapes = [(16, 4), (64, 8), (256, 16)].map(|(places, ways)| Associativity { places, ways });
    let geometry = Geometry { line_bytes: 64, levels: shapes.to_vec(), translation: vec![Associativity::full(2)] };
    let trace = random_lines(50_000, 2_000, 9);
    let mut model = CacheModel::new(&geometry, &[array(2_000 * 64)], true);
    trace.iter().for_each(|&line| model.read(0, line as usize * 64 + 7, 9));
    let found = model.figures();
    // The array starts at line 64; sets are counted from there.
    let mut asked: Vec<u64> = trace.iter().map(|line| line + 64).collect();
    for (shape, level) in shapes.into_iter().zip(&found.levels) {
        asked = naive_misses(&asked, shape);
        assert_eq!(level.all, asked.len() as u64);
        assert_eq!(level.cold, found.structure_lines);
        assert_eq!(level.all, level.cold + level.capacity + level.conflict);
    }
    let pages: Vec<u64> = trace.iter().map(|line| (line + 64) / 64).collect();
    assert_eq!(found.translation[0], naive_misses(&pages, Associativity::full(2)).len() as u64);
}

#[test]
fn distances_and_curves_equal_what_is_simulated() {
    for (seed, lines) in [(3, 40), (4, 300), (5, 3_000)] {
        let trace = random_lines(30_000, lines, seed);
        let mut reuse = Reuse::new(lines);
        let mut stack: Vec<u64> = Vec::new();
        for &line in &trace {
            let place = stack.iter().position(|&other| other == line);
            assert_eq!(reuse.touch(line), place.map(|place| place as u64));
            place.map(|place| stack.remove(place));
            stack.insert(0, line);
        }
        let found = reuse.figures();
        for power in 0..14 {
            let simulated = naive_misses(&trace, Associativity::full(1 << power)).len() as u64;
            assert_eq!(found.misses(power), simulated, "2^{power} lines, {lines} in all");
        }
    }
}

#[test]
fn working_sets_equal_counts_over_all_windows() {
    let trace = random_lines(3_000, 200, 6);
    let mut reuse = Reuse::new(200);
    trace.iter().for_each(|&line| assert!(reuse.touch(line).is_none_or(|d| d < 200)));
    let found = reuse.figures();
    for power in 0..12 {
        let windows = trace.windows(1 << power);
        let count = windows.len() as f64;
        let distinct = |window: &[u64]| window.iter().collect::<std::collections::BTreeSet<_>>().len() as f64;
        let mean = windows.map(distinct).sum::<f64>() / count;
        let counted = found.working_set(power).expect("windows are shorter than the trace");
        // Both are sums of whole numbers below 2^53 and one division.
        assert!((counted - mean).abs() < 1e-9, "windows of 2^{power}: {counted}, counted {mean}");
    }
}
