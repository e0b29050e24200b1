//! Finds which files of a volume's chunks are there, by listing folders.
//!
//! In: an array, and which chunks a volume needs. Out: the positions of the files that are there, sorted, so that
//! neither reading nor counting looks at chunks that were never written: an array may have more of them than can be
//! looked up. With shards, a file is a shard.

use std::path::{Path, PathBuf};

use super::metadata::ZarrArray;
use crate::files;
use adjsplat::error::{Error, Result};

/// The largest number of files that a volume's chunks may be in.
const MOST_FILES: usize = 1 << 24;

/// The files of a volume's chunks.
pub(super) struct ChunkFiles {
    /// The number of files along x, y, z that the volume has if none is absent.
    counts: [u64; 3],
    /// The indices of the files that are there, in ascending order: `(z * counts[1] + y) * counts[0] + x`.
    present: Vec<u64>,
}

impl ChunkFiles {
    /// Lists the files of `array` that hold chunks of one volume.
    ///
    /// `space` has the indices of the dimensions along x, y, z; `index` is the volume's index along the others.
    ///
    /// # Errors
    /// [`Error::Io`] if a folder cannot be listed; [`Error::Limit`] above 2^24 files.
    pub(super) fn list(array: &ZarrArray, space: [Option<usize>; 3], index: &[u64]) -> Result<ChunkFiles> {
        let count = |at: usize| array.shape[at].div_ceil(array.chunk[at]);
        let counts = space.map(|dimension| dimension.map_or(1, count));
        let wanted = (0..array.shape.len()).map(|at| match space.iter().position(|axis| *axis == Some(at)) {
            Some(axis) => Position::Any { axis, count: counts[axis] },
            None => Position::Only(index[at] / array.chunk[at]),
        });
        let (before, separator) = array.key;
        let mut listing = Listing { wanted: wanted.collect(), counts, present: Vec::new() };
        if separator == '/' {
            listing.folders(&array.path.join(before), 0, [0; 3])?;
        } else {
            listing.flat(&array.path, before, separator)?;
        }
        let mut present = listing.present;
        present.sort_unstable();
        present.shrink_to_fit();
        Ok(ChunkFiles { counts, present })
    }

    /// Returns the positions along x, y, z of the files that are there and whose position along z is `z`.
    pub(super) fn layer(&self, z: u64) -> impl Iterator<Item = [u64; 3]> {
        let [nx, ny, _] = self.counts;
        let start = self.present.partition_point(|at| *at < z * ny * nx);
        let end = self.present.partition_point(|at| *at < (z + 1) * ny * nx);
        self.present[start..end].iter().map(|at| self.position(*at))
    }

    /// Returns the memory of the list in bytes.
    pub(super) fn bytes(&self) -> u64 {
        self.present.capacity() as u64 * 8
    }

    /// Returns the number of files that are absent, and the number that there are if none is.
    pub(super) fn absent(&self) -> (u64, u64) {
        // Each axis of a volume has at most 65,535 points, so that this cannot overflow.
        let all: u64 = self.counts.iter().product();
        (all - self.present.len() as u64, all)
    }

    /// Returns the smallest box around the absent files: the first position along x, y, z, and the one after the last.
    pub(super) fn absent_box(&self) -> [[u64; 2]; 3] {
        let [nx, ny, nz] = self.counts;
        [(0, ny * nz), (1, nx * nz), (2, nx * ny)].map(|(axis, full)| {
            // A plane of files that are all there has none of the absent ones.
            let len = usize::try_from(self.counts[axis]).unwrap_or(0);
            let mut planes = vec![0; len];
            for at in &self.present {
                planes[usize::try_from(self.position(*at)[axis]).unwrap_or(0)] += 1;
            }
            let lacking = |count: &u64| *count < full;
            let first = planes.iter().position(lacking).unwrap_or(len);
            let last = planes.iter().rposition(lacking).map_or(first, |last| last + 1);
            [first as u64, last as u64]
        })
    }

    fn position(&self, at: u64) -> [u64; 3] {
        let [nx, ny, _] = self.counts;
        [at % nx, at / nx % ny, at / nx / ny]
    }
}

/// The positions along one dimension at which a volume has chunks.
enum Position {
    /// All positions below `count`, along x, y or z.
    Any { axis: usize, count: u64 },
    /// One position, of the volume's time or channel.
    Only(u64),
}

/// The files found so far.
struct Listing {
    /// What the volume needs along each dimension.
    wanted: Vec<Position>,
    counts: [u64; 3],
    present: Vec<u64>,
}

impl Listing {
    /// Lists one folder of all files, such as `0.0.0`, or `c.0.0.0` where `before` is `c`.
    fn flat(&mut self, folder: &Path, before: &str, separator: char) -> Result<()> {
        for name in names(folder)? {
            let name = name?;
            let numbers = match before {
                "" => Some(name.as_str()),
                _ => name.strip_prefix(before).and_then(|name| name.strip_prefix(separator)),
            };
            let Some(numbers) = numbers else { continue };
            let mut place = [0; 3];
            let mut parts = numbers.split(separator);
            let fits =
                (0..self.wanted.len()).all(|at| parts.next().is_some_and(|part| self.place(at, part, &mut place)));
            if fits && parts.next().is_none() {
                self.add(folder, place)?;
            }
        }
        Ok(())
    }

    /// Lists the folders of dimension `at` and of those after it: `0/0/0`.
    fn folders(&mut self, folder: &Path, at: usize, place: [u64; 3]) -> Result<()> {
        for name in names(folder)? {
            let (name, mut place) = (name?, place);
            if !self.place(at, &name, &mut place) {
                continue;
            }
            if at + 1 == self.wanted.len() {
                self.add(folder, place)?;
            } else {
                self.folders(&folder.join(name), at + 1, place)?;
            }
        }
        Ok(())
    }

    /// Returns whether `number`, the text of a position along dimension `at`, is one that the volume needs; puts it
    /// into `place`.
    fn place(&self, at: usize, number: &str, place: &mut [u64; 3]) -> bool {
        let parsed = number.parse().ok().filter(|parsed: &u64| parsed.to_string() == number);
        match (parsed, &self.wanted[at]) {
            (Some(parsed), Position::Any { axis, count }) if parsed < *count => {
                place[*axis] = parsed;
                true
            }
            (Some(parsed), Position::Only(only)) => parsed == *only,
            _ => false,
        }
    }

    fn add(&mut self, folder: &Path, [x, y, z]: [u64; 3]) -> Result<()> {
        if self.present.len() == MOST_FILES {
            let what = format!("{}: files of chunks (save it with larger chunks)", folder.display());
            return Err(Error::Limit { what, need: MOST_FILES as u64 + 1, have: MOST_FILES as u64 });
        }
        let [nx, ny, _] = self.counts;
        self.present.push((z * ny + y) * nx + x);
        Ok(())
    }
}

/// Returns the names in the folder at `path`; none if there is no such folder. Names that are no text are left out.
fn names(path: &Path) -> Result<impl Iterator<Item = Result<String>> + use<>> {
    let path = PathBuf::from(path);
    let entries = match files::names(&path) {
        Ok(entries) => Some(entries),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => None,
        Err(error) => return Err(Error::io("list", &path)(error)),
    };
    Ok(entries.into_iter().flatten().filter_map(move |entry| match entry {
        Ok(name) => name.into_string().ok().map(Ok),
        Err(error) => Some(Err(Error::io("list", &path)(error))),
    }))
}
