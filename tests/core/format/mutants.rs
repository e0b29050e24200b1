//! Mutants: 200,000 files that were sound before something was done to them.
//!
//! Each lies in an allocation of exactly its length and is opened (also as one on a server, with the same verdict), checked
//! and, if it opens, walked, transposed and drawn ([`crate::format::consume`]): no panic, no read outside, and bounded work, as
//! no walk visits more records than there are. There are three kinds ([`crate::format::mutate`]):
//!
//! * *Damage*, half of all: bits flip, bytes go, come and move, examples are spliced. No checksum is repaired.
//!   **Detects** means: opening or the check refuses every file that is not byte for byte one of the examples.
//! * *Lies*: fields of the header and of the section table, of the file or of a level of detail, in place. The header's
//!   checksum is repaired, in some the sections' too, so that the rules behind checksums are reached.
//! * *Rebuilt*: parts are changed and put together anew with every offset, length and checksum right.
//!
//! A lie or a rebuilt file may well be sound: then it is no fault to accept it. **Detects** means for them, and is
//! held for all three: the check accepts a file that opens if and only if the sections' checksums and filling are
//! right, which is computed here again, and the oracle finds the lanes sound. (The oracle does not read the
//! description, so that a refusal by R22 is taken as it is.)
//!
//! Cannot catch: a read outside the file that lands in other memory of the process and does no harm there;
//! AddressSanitizer does, see docs/DEVELOPING.md.

use std::collections::{BTreeMap, BTreeSet};
use std::time::{Duration, Instant};

use adjsplat::arena::Arena;
use adjsplat_tests::at_full;
use adjsplat_tests::random::Random;
use xxhash_rust::xxh3::xxh3_64;

use crate::directory::opened_from_afar;
use crate::format::assemble::Parts;
use crate::format::consume::{Looks, use_up};
use crate::format::mutate::{damaged, lying, rebuilt};
use crate::format::oracle;
use crate::format::scenes::scenes;

/// Fewest mutants that say whether mutants test what they are meant to test; ten times as many with `ADJ_FULL=1`.
/// `ADJ_MUTANTS=10000000` makes a long run, `ADJ_MUTANTS=2000` one for slow tools.
const MUTANTS: u64 = 25_000;

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Kind {
    Damaged,
    Lying,
    Rebuilt,
}

/// What a run of mutants came to.
#[derive(Debug, Default)]
struct Tally {
    made: BTreeMap<Kind, u64>,
    /// Another example's bytes.
    examples: u64,
    opened: BTreeMap<Kind, u64>,
    sound: BTreeMap<Kind, u64>,
    rules: BTreeSet<&'static str>,
    /// Orders in which lanes were walked: bits of 48, twice for the two sides of an eye inside.
    orders: BTreeSet<String>,
    pictures: u64,
    slowest: Duration,
}

impl Tally {
    fn merge(&mut self, other: Tally) {
        for (into, from) in
            [(&mut self.made, other.made), (&mut self.opened, other.opened), (&mut self.sound, other.sound)]
        {
            from.into_iter().for_each(|(kind, count)| *into.entry(kind).or_default() += count);
        }
        self.examples += other.examples;
        self.rules.extend(other.rules);
        self.orders.extend(other.orders);
        self.pictures += other.pictures;
        self.slowest = self.slowest.max(other.slowest);
    }
}

/// The examples, small ones first.
struct Examples {
    parts: Vec<Parts>,
    files: Vec<Vec<u8>>,
}

impl Examples {
    fn new() -> Examples {
        let mut all: Vec<(Vec<u8>, Parts)> =
            scenes().iter().map(Parts::of_scene).map(|parts| (parts.file(), parts)).collect();
        // The longest line needs the widest buffers.
        all.sort_by_key(|(file, parts)| (parts.header.dims.map(|dim| dim.get()).into_iter().max(), file.len()));
        let (files, parts) = all.into_iter().unzip();
        Examples { parts, files }
    }

    /// One of them; a small one most of the time.
    fn index(&self, random: &mut Random) -> usize {
        let count = self.files.len();
        random.index(count).min(random.index(count)).min(random.index(count))
    }
}

/// Names the seed of a mutant that makes something panic.
struct Named(u64);

impl Drop for Named {
    fn drop(&mut self) {
        if std::thread::panicking() {
            eprintln!("the mutant of seed {}", self.0);
        }
    }
}

/// Makes the mutant of `seed` and holds the library to its promises.
fn judge(seed: u64, examples: &Examples, looks: &Looks, tally: &mut Tally) {
    let _named = Named(seed);
    let mut random = Random(seed);
    let index = examples.index(&mut random);
    let (kind, file) = match seed % 10 {
        0..5 => (Kind::Damaged, damaged(&examples.files[index], &examples.files, &mut random)),
        5..7 => (Kind::Lying, lying(&examples.files[index], &mut random)),
        _ => (Kind::Rebuilt, rebuilt(&examples.parts[index], &examples.files[index], &mut random)),
    };
    let file: Box<[u8]> = file.into();
    *tally.made.entry(kind).or_default() += 1;
    let is_example = examples.files.iter().any(|example| **example == *file);
    tally.examples += u64::from(is_example);
    let start = Instant::now();
    let from_afar = opened_from_afar(&file);
    let opened = Arena::new(&file);
    assert_eq!(from_afar.is_ok(), opened.is_ok(), "seed {seed}: {from_afar:?}, but as a whole {opened:?}");
    let arena = match opened {
        Ok(arena) => arena,
        Err(fault) => {
            assert!(!is_example, "seed {seed}: an example is refused: {fault}");
            tally.rules.insert(fault.rule);
            return;
        }
    };
    *tally.opened.entry(kind).or_default() += 1;
    let verdict = arena.check().map_err(|fault| fault.rule);
    let expected = is_whole(&file, &arena) && oracle::sound(&arena);
    assert!(
        verdict.is_ok() == expected || verdict == Err("R22"),
        "seed {seed}, {kind:?}: the check says {verdict:?}, the oracle {expected}"
    );
    match verdict {
        Ok(_) => {
            *tally.sound.entry(kind).or_default() += 1;
            assert!(kind != Kind::Damaged || is_example, "seed {seed}: damage passes");
        }
        Err(rule) => {
            assert!(!is_example, "seed {seed}: an example breaks {rule}");
            tally.rules.insert(rule);
        }
    }
    let used = use_up(&arena, looks, &mut random);
    tally.orders.extend(used.orders);
    tally.pictures += u64::from(used.drew);
    tally.slowest = tally.slowest.max(start.elapsed());
}

/// Whether all that the file says of its sections' bytes is true, and each of its levels: R12, and R21.
pub(crate) fn is_whole(file: &[u8], arena: &Arena) -> bool {
    let mut filling = vec![true; file.len()];
    filling[..256 + 32 * arena.sections().len()].fill(false);
    let sums_are_right = arena.sections().iter().all(|section| {
        let from = usize::try_from(section.offset.get()).unwrap();
        let range = from..from + usize::try_from(section.bytes.get()).unwrap();
        filling[range.clone()].fill(false);
        xxh3_64(&file[range]) == section.xxh3.get()
    });
    let levels_are_whole = || {
        (1..=arena.level_count()).filter_map(|level| arena.level(level)).all(|level| is_whole(level.bytes(), &level))
    };
    sums_are_right && file.iter().zip(filling).all(|(&byte, fills)| !fills || byte == 0) && levels_are_whole()
}

#[test]
fn mutants_harm_nothing_and_none_passes_unseen() {
    let mutants = std::env::var("ADJ_MUTANTS").ok().map(|count| count.parse().expect("ADJ_MUTANTS is a number"));
    let mutants = mutants.unwrap_or(at_full(10 * MUTANTS, MUTANTS));
    let (examples, looks) = (Examples::new(), Looks::new());
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let mut tally = Tally::default();
    std::thread::scope(|scope| {
        let (examples, looks) = (&examples, &looks);
        let workers: Vec<_> = (0..threads as u64)
            .map(|first| {
                scope.spawn(move || {
                    let mut tally = Tally::default();
                    let seeds = (first..mutants).step_by(threads);
                    seeds.for_each(|seed| judge(seed, examples, looks, &mut tally));
                    tally
                })
            })
            .collect();
        for worker in workers {
            tally.merge(worker.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)));
        }
    });
    let count = |of: &BTreeMap<Kind, u64>, kind| of.get(&kind).copied().unwrap_or(0);
    if mutants < MUTANTS {
        return;
    }
    // What follows says that the mutants test what they are meant to test.
    assert!(tally.examples < mutants / 100, "{} are examples", tally.examples);
    for (kind, share) in [(Kind::Damaged, 3), (Kind::Lying, 8), (Kind::Rebuilt, 3)] {
        let (made, opened) = (count(&tally.made, kind), count(&tally.opened, kind));
        assert!(opened > made / share, "{kind:?}: only {opened} of {made} open");
        assert!(opened < made, "{kind:?}: all {made} open");
    }
    for (kind, share) in [(Kind::Lying, 10), (Kind::Rebuilt, 2)] {
        let (opened, sound) = (count(&tally.opened, kind), count(&tally.sound, kind));
        assert!(sound > mutants / 200 && opened - sound > opened / share, "{kind:?}: {sound} of {opened} are sound");
    }
    for rule in 1..=27 {
        assert!(tally.rules.contains(format!("R{rule}").as_str()), "no mutant breaks R{rule}");
    }
    assert_eq!(tally.orders.len(), 48, "parallel orders: {:?}", tally.orders);
    assert!(tally.pictures > mutants / 10, "only {} pictures", tally.pictures);
    // Far above what a slow machine takes; what it would catch is a walk or a table that the file's size does not
    // bound.
    assert!(tally.slowest < Duration::from_secs(20), "the slowest took {:?}", tally.slowest);
}
