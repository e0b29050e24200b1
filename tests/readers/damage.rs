//! What damage may do to a reader: have a file refused, never a panic.

use std::path::Path;

use adjsplat::volume::SampleType;
use adjsplat_readers::{OpenOptions, open};

use super::sample::{known, read};

/// Writes a file in the place of another. Not over it: for that some file systems wait for the disk.
pub(crate) fn rewrite(path: &Path, bytes: &[u8]) {
    let _ = std::fs::remove_file(path);
    std::fs::write(path, bytes).expect("can be written");
}

/// Changes a few bytes of the good file at `path`, again and again, and reads what that gives.
pub(crate) fn expect_no_panic(path: &Path, rounds: u32) {
    expect_no_panic_with(path, &OpenOptions::default(), rounds);
}

pub(crate) fn expect_no_panic_with(path: &Path, options: &OpenOptions, rounds: u32) {
    let whole = std::fs::read(path).expect("just written");
    // xorshift32; any seed does.
    let mut state = 0x9e37_79b9_u32;
    let mut random = move |below: usize| {
        state ^= state << 13;
        state ^= state >> 17;
        state ^= state << 5;
        state as usize % below
    };
    let marks = [0, 1, 0xff, 0x7f, 0x80, b'\n', b'9', b'-', b'"', b'<', b'>', b'=', b'%', b' ', b'('];
    for _ in 0..rounds {
        let mut bad = whole.clone();
        for _ in 0..1 + random(4) {
            let at = random(bad.len());
            bad[at] = if random(2) == 0 { marks[random(marks.len())] } else { bad[at] ^ (1 << random(8)) };
        }
        rewrite(path, &bad);
        // Damage may give a larger volume only as far as the file's bytes go.
        let Ok(mut source) = open(path, options) else { continue };
        let Ok(mut slice) = source.header().new_slice() else { continue };
        for _ in 0..source.header().grid.dims[2] {
            if source.read_slice(&mut slice).is_err() {
                break;
            }
        }
    }
    rewrite(path, &whole);
}

/// Cuts the good file at `path` at every length. Below `needed` bytes each must be refused; a longer one may be read,
/// and must then be the known volume of `ty`.
pub(crate) fn expect_truncations_refused(path: &Path, needed: usize, ty: SampleType) {
    let whole = std::fs::read(path).expect("just written");
    for len in 0..whole.len() {
        rewrite(path, &whole[..len]);
        // Of numbers as text the last may lose its last digits.
        if let Ok(got) = read(path) {
            assert!(len + 6 >= needed && got.samples.get(0) == known(ty).get(0), "{len} of {needed}");
        }
    }
    rewrite(path, &whole);
}
