//! How mutants are made: see [`crate::format::mutants`] for the three kinds.

use std::ops::Range;

use adjsplat::arena::Arena;
use adjsplat_tests::random::Random;
use xxhash_rust::xxh3::xxh3_64;

use crate::format::assemble::{Part, Parts, repair_header};

const HEADER: usize = 256;
const ENTRY: usize = 32;

/// A file that something happened to: nothing is repaired.
pub(crate) fn damaged(example: &[u8], others: &[Vec<u8>], random: &mut Random) -> Vec<u8> {
    let mut file = example.to_vec();
    // Most damage is one thing; bytes after the table are most of a real file, so most of it happens there.
    for _ in 0..=random.below(3).saturating_sub(1) {
        let other = &others[random.index(others.len())];
        if file.is_empty() {
            return file;
        }
        let at = if random.below(3) == 0 { random.index(file.len()) } else { behind_table(&file, random) };
        let longest = [4, 64, 1_024][random.index(3)];
        let len = 1 + random.index(longest).min(file.len() - at - 1);
        match random.below(12) {
            0..3 => file[at] ^= 1 << random.below(8),
            3 => file[at] = random.byte(),
            4 => (0..1 + random.below(8)).for_each(|_| {
                let at = behind_table(&file, random);
                file[at] ^= 1 << random.below(8);
            }),
            5 => file[at..at + len].fill([0x00, 0xff][random.index(2)]),
            6 => {
                let to = random.index(file.len() - len + 1);
                file.copy_within(at..at + len, to);
            }
            7 => {
                // Bytes of another example, from the same place or another one.
                let from = if random.below(2) == 0 { at } else { random.index(other.len()) };
                let source = other.get(from..).unwrap_or_default();
                let len = len.min(source.len());
                file[at..at + len].copy_from_slice(&source[..len]);
            }
            8 => {
                // The head of one and the tail of another.
                file.truncate(at);
                file.extend(other.get(at..).unwrap_or_default());
            }
            9 => file.truncate(at),
            10 => {
                let more: Vec<u8> = (0..len).map(|_| random.byte()).collect();
                file.splice(at..at, more);
            }
            _ => drop(file.drain(at..at + len)),
        }
    }
    if file == example {
        // Zeros among the zeros that fill up, for one.
        let at = random.index(file.len());
        file[at] ^= 1 << random.below(8);
    }
    file
}

/// A byte behind the section table; any if there is none.
fn behind_table(file: &[u8], random: &mut Random) -> usize {
    let table = HEADER + ENTRY * section_count(file);
    if table < file.len() { table + random.index(file.len() - table) } else { random.index(file.len()) }
}

/// As many sections as the file says and has room for.
fn section_count(file: &[u8]) -> usize {
    let said = file.get(12..16).map_or(0, |field| u32::from_le_bytes(field.try_into().unwrap()) as usize);
    said.min(file.len().saturating_sub(HEADER) / ENTRY)
}

/// A file whose header or section table lies; the header's checksum is right.
pub(crate) fn lying(example: &[u8], random: &mut Random) -> Vec<u8> {
    loop {
        let mutant = perhaps_lying(example, random);
        if mutant != example {
            return mutant;
        }
    }
}

/// As [`lying`]; what is set may have been so. Of a file with levels of detail, one of these lies as often as not.
fn perhaps_lying(example: &[u8], random: &mut Random) -> Vec<u8> {
    let mut file = example.to_vec();
    let levels = levels(&file);
    if !levels.is_empty() && random.below(2) == 0 {
        let place = levels[random.index(levels.len())].clone();
        let mut level = perhaps_lying(&example[place.clone()], random);
        level.resize(place.len(), 0);
        file[place].copy_from_slice(&level);
        repair_sections(&mut file);
        repair_header(&mut file);
        return file;
    }
    for _ in 0..=random.below(2) {
        match random.below(8) {
            0..2 => lie_in_header(&mut file, random),
            2..7 => lie_in_table(&mut file, random),
            _ => {
                // What the header describes is changed behind its back, or cut with the length put right.
                let at = behind_table(&file, random).max(HEADER);
                if random.below(2) == 0 {
                    file[at] = file[at].wrapping_add(random.byte());
                } else {
                    file.truncate(at.next_multiple_of([1, 256][random.index(2)]));
                    let len = file.len() as u64;
                    file[16..24].copy_from_slice(&len.to_le_bytes());
                }
            }
        }
    }
    if random.below(2) == 0 {
        repair_sections(&mut file);
    }
    repair_header(&mut file);
    file
}

/// Where the levels of detail of a sound file lie.
fn levels(file: &[u8]) -> Vec<Range<usize>> {
    let number = |at: usize| u64::from_le_bytes(file[at..at + 8].try_into().unwrap());
    let entries = (0..section_count(file)).map(|index| HEADER + ENTRY * index);
    let of_levels =
        entries.filter(|&entry| (0x8001..=0x800f).contains(&u16::from_le_bytes([file[entry], file[entry + 1]])));
    let place = |entry: usize| {
        let [from, len] = [8, 16].map(|at| usize::try_from(number(entry + at)).unwrap());
        from..from + len
    };
    of_levels.map(place).collect()
}

/// A number that is near what was there, or far from all that makes sense.
fn lie(truth: u64, random: &mut Random) -> u64 {
    match random.below(8) {
        0 => truth.wrapping_add(1),
        1 => truth.wrapping_sub(1),
        2 => truth.wrapping_add(256),
        3 => truth.wrapping_sub(256),
        4 => truth ^ 1 << random.below(64),
        5 => [0, 1, 28, 256, 1 << 31, (1 << 32) - 1, 1 << 32, 1 << 40][random.index(8)],
        6 => u64::MAX - random.below(512),
        _ => truth.wrapping_mul(2),
    }
}

fn lie_in_header(file: &mut [u8], random: &mut Random) {
    // Offset and length of every field that adj-1.md names, but for those that R1 to R4 compare.
    const FIELDS: [(usize, usize); 22] = [
        (10, 2),
        (12, 4),
        (32, 2),
        (34, 2),
        (36, 2),
        (38, 1),
        (39, 1),
        (40, 1),
        (41, 1),
        (42, 6),
        (48, 8),
        (56, 8),
        (64, 8),
        (72, 8),
        (80, 8),
        (96, 8),
        (104, 8),
        (136, 8),
        (176, 8),
        (184, 8),
        (192, 8),
        (200, 56),
    ];
    if random.below(32) == 0 {
        // Magic, version, length, checksum.
        file[random.index(32)] ^= 1 << random.below(8);
        return;
    }
    let (at, len) = FIELDS[random.index(FIELDS.len())];
    let mut number = [0; 8];
    let width = len.min(8);
    number[..width].copy_from_slice(&file[at..at + width]);
    // Coordinates and scales are floating-point numbers from byte 56 to 200.
    let lied = if (56..200).contains(&at) {
        let wild =
            [0.0, -0.0, 1e-300, 1e300, f64::NAN, f64::INFINITY, -1.0, 5e-324, f64::MAX, 1e-3, 7.0][random.index(11)];
        wild.to_bits()
    } else {
        lie(u64::from_le_bytes(number), random)
    };
    file[at..at + width].copy_from_slice(&lied.to_le_bytes()[..width]);
}

fn lie_in_table(file: &mut [u8], random: &mut Random) {
    let count = section_count(file);
    if count == 0 {
        return;
    }
    let entry = |index: usize| HEADER + ENTRY * index;
    let (a, b) = (entry(random.index(count)), entry(random.index(count)));
    // Kind, axis, element's bytes, reserved, offset, length, checksum.
    let (at, width) = [(0, 2), (2, 1), (3, 1), (4, 4), (8, 8), (16, 8), (16, 8), (24, 8)][random.index(8)];
    match random.below(4) {
        0 => (0..ENTRY).for_each(|byte| file.swap(a + byte, b + byte)),
        1 => (0..width).for_each(|byte| file[a + at + byte] = file[b + at + byte]),
        _ => {
            let mut number = [0; 8];
            number[..width].copy_from_slice(&file[a + at..a + at + width]);
            let lied = lie(u64::from_le_bytes(number), random);
            file[a + at..a + at + width].copy_from_slice(&lied.to_le_bytes()[..width]);
        }
    }
}

/// Makes the checksums right of all sections that lie in the file, wherever the table says they are.
fn repair_sections(file: &mut [u8]) {
    for entry in (0..section_count(file)).map(|index| HEADER + ENTRY * index) {
        let number = |at: usize| u64::from_le_bytes(file[entry + at..entry + at + 8].try_into().unwrap());
        let (from, len) = (number(8), number(16));
        let range = usize::try_from(from).ok().zip(from.checked_add(len).and_then(|to| usize::try_from(to).ok()));
        if let Some(bytes) = range.and_then(|(from, to)| file.get(from..to)) {
            let sum = xxh3_64(bytes);
            file[entry + 24..entry + 32].copy_from_slice(&sum.to_le_bytes());
        }
    }
}

/// A file of changed parts, with all checksums right.
pub(crate) fn rebuilt(example: &Parts, file: &[u8], random: &mut Random) -> Vec<u8> {
    loop {
        let mut parts = example.clone();
        for _ in 0..=random.below(3) {
            mutate(&mut parts, random);
        }
        let mutant = parts.file();
        if mutant != file {
            return mutant;
        }
    }
}

/// Changes one thing of `parts`.
fn mutate(parts: &mut Parts, random: &mut Random) {
    match random.below(10) {
        0 => mutate_header(parts, random),
        1 => {
            let (a, b) = (random.index(parts.sections.len()), random.index(parts.sections.len()));
            let bytes = parts.sections[a].bytes.clone();
            parts.sections[b].bytes = bytes;
        }
        2 => {
            // A record of a lane goes, in all channels: lengths stay in agreement.
            let axis = parts.sections[random.index(parts.sections.len())].axis;
            let records = parts.sections.iter().find(|s| s.kind == 4 && s.axis == axis).map_or(0, |s| s.bytes.len());
            if records > 0 {
                let record = random.index(records);
                for part in parts.sections.iter_mut().filter(|s| s.axis == axis && s.kind >= 4) {
                    remove_element(part, record);
                }
            }
        }
        _ => {
            let index = random.index(parts.sections.len());
            let part = &mut parts.sections[index];
            if (0x8001..=0x800f).contains(&part.kind) && random.below(8) != 0 && Arena::new(&part.bytes).is_ok() {
                // A level is a file: one thing of that changes.
                let mut level = Parts::of_file(&part.bytes);
                mutate(&mut level, random);
                part.bytes = level.file();
            } else {
                mutate_section(part, random);
            }
        }
    }
}

fn mutate_header(parts: &mut Parts, random: &mut Random) {
    let header = &mut parts.header;
    match random.below(6) {
        0 => {
            let axis = random.index(3);
            let dim = header.dims[axis].get();
            let wild = [1, 8, 9, 65_535][random.index(4)];
            header.dims[axis].set([dim.saturating_sub(1), dim.saturating_add(1), wild][random.index(3)]);
        }
        1 => header.visible_voxels.set(header.visible_voxels.get().wrapping_add(random.below(3)).wrapping_sub(1)),
        2 => header.tile_order = u8::try_from(random.below(3)).unwrap(),
        3 => header.value_bits = 24 - header.value_bits,
        4 => header.dims.swap(0, 1),
        _ => header.normal_bits = [0, 8, 16][random.index(3)],
    }
}

/// Another change may have taken the element already.
fn remove_element(part: &mut Part, index: usize) {
    let width = usize::from(part.element_bytes);
    if (index + 1) * width <= part.bytes.len() {
        part.bytes.drain(index * width..(index + 1) * width);
    }
}

fn mutate_section(part: &mut Part, random: &mut Random) {
    let width = usize::from(part.element_bytes);
    let elements = part.bytes.len() / width;
    if elements == 0 {
        return;
    }
    let (a, b) = (random.index(elements), random.index(elements));
    let byte = random.index(part.bytes.len());
    match random.below(8) {
        0 => part.bytes[byte] ^= 1 << random.below(8),
        1 => part.bytes[byte] = random.byte(),
        2 => part.bytes[byte] = [0, 1, 254, 255][random.index(4)],
        3 => {
            // One field of a few bytes at its end: an index or length far away.
            let len = [2, 4, 8][random.index(3)].min(part.bytes.len() - byte);
            part.bytes[byte..byte + len].fill(0xff);
        }
        4 => {
            for i in 0..width {
                part.bytes.swap(a * width + i, b * width + i);
            }
        }
        5 => remove_element(part, a),
        6 => {
            let element = part.bytes[a * width..(a + 1) * width].to_vec();
            part.bytes.splice(b * width..b * width, element);
        }
        _ => part.bytes[byte] = part.bytes[byte].wrapping_add([1, 255][random.index(2)]),
    }
}
