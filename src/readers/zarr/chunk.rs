//! Reads the chunks of a Zarr array, one at a time.
//!
//! In: an array, and the index of a chunk. Out: the chunk's bytes, in the array's byte order and storage order, or the
//! fact that it was never written. If chunks are shards (files of many chunks), the shard's index is read first, then
//! one chunk inside the shard. Below, "chunk" means this inner chunk.

use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use super::metadata::{Shard, ZarrArray};
use super::packing::{crc32c, unpack};
use crate::files::{File, exists, open_regular};
use adjsplat::error::{Error, Result};

/// The largest number of bytes by which packing may lengthen a chunk; no packing in use adds more.
const PACKED_SLACK: u64 = 1 << 16;

/// Reads chunks of one array.
pub(super) struct ChunkReader {
    array: ZarrArray,
    /// The path of the shard that was read last, and its file; `None` instead of the file if it was never written.
    shard: Option<(PathBuf, Option<ShardFile>)>,
}

struct ShardFile {
    file: File,
    len: u64,
    /// The offset and the length of each chunk in the shard, in bytes; both have all bits set for a chunk that was
    /// never written.
    entries: Vec<[u64; 2]>,
}

impl ChunkReader {
    pub(super) fn new(array: ZarrArray) -> ChunkReader {
        ChunkReader { array, shard: None }
    }

    pub(super) fn array(&self) -> &ZarrArray {
        &self.array
    }

    /// Returns the number of points of a chunk along each dimension.
    pub(super) fn shape(&self) -> &[u64] {
        self.array.shard.as_ref().map_or(&self.array.chunk, |shard| &shard.inner)
    }

    /// Returns the size of an unpacked chunk in bytes.
    pub(super) fn chunk_bytes(&self) -> u64 {
        self.shape().iter().product::<u64>() * self.array.sample_type.bytes() as u64
    }

    /// Returns the size of a shard's index in bytes; 0 if there are no shards.
    pub(super) fn index_bytes(&self) -> u64 {
        self.array.shard.as_ref().map_or(0, |shard| inner_count(&self.array, shard).saturating_mul(16))
    }

    /// Reads the chunk at `index`, its position among the chunks; `None` if it was never written.
    ///
    /// # Errors
    /// [`Error::Io`] if the chunk cannot be read; [`Error::Format`] if it is damaged.
    pub(super) fn read(&mut self, index: &[u64]) -> Result<Option<Vec<u8>>> {
        let Some(shard) = self.array.shard.clone() else {
            let path = chunk_path(&self.array, index);
            if !exists(&path).map_err(Error::io("open chunk", &path))? {
                return Ok(None);
            }
            let (file, len) = open_regular(&path, "open chunk")?;
            return self.take(&path, file, 0, len).map(Some);
        };
        let per_shard: Vec<u64> =
            self.array.chunk.iter().zip(&shard.inner).map(|(chunk, inner)| chunk / inner).collect();
        let outer: Vec<u64> = index.iter().zip(&per_shard).map(|(index, count)| index / count).collect();
        let inner = index.iter().zip(&per_shard).fold(0, |at, (index, count)| at * count + index % count);
        let path = chunk_path(&self.array, &outer);
        if self.shard.as_ref().is_none_or(|(last, _)| *last != path) {
            let content = self.open_shard(&path, &shard)?;
            self.shard = Some((path.clone(), content));
        }
        let Some((_, Some(ShardFile { file, len, entries }))) = &self.shard else {
            return Ok(None);
        };
        let [at, bytes] =
            usize::try_from(inner).ok().and_then(|inner| entries.get(inner)).copied().unwrap_or([u64::MAX; 2]);
        if [at, bytes] == [u64::MAX; 2] {
            return Ok(None);
        }
        if at.checked_add(bytes).is_none_or(|end| end > *len) {
            let got = format!("bytes {at} and {bytes} more");
            return Err(Error::format(&path, 0, "Zarr shard", format!("chunks in its {len} bytes"), got));
        }
        let file = file.try_clone().map_err(Error::io("open chunk", &path))?;
        self.take(&path, file, at, bytes).map(Some)
    }

    /// Reads `packed` bytes of `file` from byte `at` on, and unpacks them.
    fn take(&self, path: &Path, mut file: File, at: u64, packed: u64) -> Result<Vec<u8>> {
        let bytes = self.chunk_bytes();
        let most = bytes + bytes / 8 + PACKED_SLACK;
        if packed > most {
            let got = format!("{packed} packed bytes");
            return Err(Error::format(path, at, "Zarr chunk", format!("at most {most} for {bytes} bytes"), got));
        }
        let mut read = Vec::new();
        let done = file.seek(SeekFrom::Start(at)).and_then(|_| file.take(packed).read_to_end(&mut read));
        done.map_err(Error::io("read", path))?;
        let len = usize::try_from(bytes).unwrap_or(usize::MAX);
        unpack(&self.array.packings, read, len).map_err(|got| {
            let expected = format!("an intact chunk of {bytes} bytes (copy or download the file again)");
            Error::format(path, at, "Zarr chunk", expected, got)
        })
    }

    fn open_shard(&self, path: &Path, shard: &Shard) -> Result<Option<ShardFile>> {
        if !exists(path).map_err(Error::io("open shard", path))? {
            return Ok(None);
        }
        let (mut file, len) = open_regular(path, "open shard")?;
        let need = inner_count(&self.array, shard).saturating_mul(16);
        let summed = need.saturating_add(if shard.index_summed { 4 } else { 0 });
        let Some(start) = len.checked_sub(summed) else {
            let expected = format!("an index of {summed} bytes");
            return Err(Error::format(path, 0, "Zarr shard", expected, format!("a file of {len} bytes")));
        };
        let start = if shard.index_at_end { start } else { 0 };
        let mut index = Vec::new();
        let read = file.seek(SeekFrom::Start(start)).and_then(|_| file.by_ref().take(summed).read_to_end(&mut index));
        read.map_err(Error::io("read", path))?;
        if shard.index_summed {
            let sum = index.split_off(index.len().saturating_sub(4));
            if crc32c(&index).to_le_bytes() != sum[..] {
                let expected = "an index with its checksum (copy or download the file again)";
                return Err(Error::format(path, start, "Zarr shard", expected, "another checksum"));
            }
        }
        let number = |bytes: &[u8]| bytes.iter().rev().fold(0, |number, byte| number << 8 | u64::from(*byte));
        let entries = index.chunks_exact(16).map(|entry| [number(&entry[..8]), number(&entry[8..])]).collect();
        Ok(Some(ShardFile { file, len, entries }))
    }
}

/// Returns the number of chunks in a shard.
fn inner_count(array: &ZarrArray, shard: &Shard) -> u64 {
    let counts = array.chunk.iter().zip(&shard.inner).map(|(chunk, inner)| chunk / inner);
    counts.fold(1, u64::saturating_mul)
}

/// Returns the path of the file that holds chunk `index`: `0.0.0`, `0/0/0`, `c/0/0/0`.
fn chunk_path(array: &ZarrArray, index: &[u64]) -> PathBuf {
    let (before, separator) = array.key;
    let mut name = before.to_string();
    for (at, number) in index.iter().enumerate() {
        if at > 0 || !before.is_empty() {
            name.push(separator);
        }
        name += &number.to_string();
    }
    array.path.join(if name.is_empty() { "0" } else { &name })
}
