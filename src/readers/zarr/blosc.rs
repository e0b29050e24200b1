//! Unpacks Blosc frames, the default compression of Zarr chunks.
//!
//! In: a frame of version 1 or 2. Out: its unpacked bytes. A frame consists of blocks. The writer may have shuffled a
//! block (gathered the first bytes or bits of all elements, then the second ones, and so on) and split it into one
//! stream for each byte of an element. Each stream is packed by one of five codecs. The unpacked length is known
//! beforehand: a frame that states another length is refused, so no memory is allocated by the stated length.
//!
//! Source: c-blosc's `README_HEADER.rst` and `README_CHUNK_FORMAT.rst`; the layout of bits is that of bitshuffle
//! (Masui et al., "A compression scheme for radio data in high performance computing", 2015, section 3.2).

use super::packing::{ChunkFault, inflate, lz4, zstd};

const HEADER_BYTES: usize = 16;
/// A block is split into streams if it has at least the first number of elements, each of at most the second number of
/// bytes.
const SPLIT: (usize, usize) = (128, 16);

const BYTE_SHUFFLE: u8 = 1;
const PLAIN: u8 = 2;
const BIT_SHUFFLE: u8 = 4;
const UNSPLIT: u8 = 16;

/// Unpacks a frame, which must give `len` bytes.
///
/// # Errors
/// Returns a text that says what is wrong if the frame is damaged.
pub(super) fn unpack(frame: &[u8], len: usize) -> Result<Vec<u8>, ChunkFault> {
    let [version, _, flags, element, ..] = *frame else { return Err("a Blosc frame without a header".into()) };
    let stated_len = word(frame, 4)?;
    let block_len = word(frame, 8)?;
    if !(1..=2).contains(&version) {
        return Err(format!("a Blosc frame of version {version}"));
    }
    if stated_len != len {
        return Err(format!("a Blosc frame of {stated_len} bytes"));
    }
    if flags & PLAIN != 0 {
        let plain = frame.get(HEADER_BYTES..HEADER_BYTES + len);
        return plain.map(<[u8]>::to_vec).ok_or_else(|| "a Blosc frame that breaks off".into());
    }
    let element = usize::from(element).max(1);
    if block_len == 0 && len > 0 {
        return Err("a Blosc frame of empty blocks".into());
    }
    let mut out = vec![0; len];
    let mut shuffled_block = vec![0; block_len.min(len)];
    for (index, block) in out.chunks_mut(block_len.max(1)).enumerate() {
        let start = word(frame, HEADER_BYTES + 4 * index)?;
        let is_last_part = block.len() < block_len;
        let split = flags & UNSPLIT == 0
            && element <= SPLIT.1
            && block_len / element >= SPLIT.0
            && block.len().is_multiple_of(element)
            && !is_last_part;
        let shuffled = &mut shuffled_block[..block.len()];
        unpack_block(frame, start, shuffled, if split { element } else { 1 }, flags >> 5)?;
        if flags & BYTE_SHUFFLE != 0 && element > 1 {
            unshuffle_bytes(shuffled, block, element);
        } else if flags & BIT_SHUFFLE != 0 {
            unshuffle_bits(shuffled, block, element);
        } else {
            block.copy_from_slice(shuffled);
        }
    }
    Ok(out)
}

fn word(frame: &[u8], at: usize) -> Result<usize, ChunkFault> {
    let bytes = frame.get(at..at + 4).ok_or("a Blosc frame that breaks off")?;
    Ok(u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]) as usize)
}

/// Unpacks the streams of the block that starts at byte `start` of the frame.
fn unpack_block(frame: &[u8], start: usize, block: &mut [u8], streams: usize, codec: u8) -> Result<(), ChunkFault> {
    let mut at = start;
    let part_len = block.len() / streams;
    for part in block.chunks_mut(part_len.max(1)) {
        let packed_len = word(frame, at)?;
        let end = at.checked_add(4).and_then(|at| at.checked_add(packed_len));
        let packed = end.and_then(|end| frame.get(at + 4..end)).ok_or("a Blosc block that breaks off")?;
        at += 4 + packed_len;
        if packed_len == part.len() {
            part.copy_from_slice(packed);
            continue;
        }
        let unpacked = match codec {
            0 => {
                unpack_blosclz(packed, part)?;
                continue;
            }
            1 => lz4(packed, part.len())?,
            3 => inflate(packed, part.len())?,
            4 => zstd(packed, part.len())?,
            other => return Err(format!("a Blosc frame by codec {other} (snappy is 2)")),
        };
        if unpacked.len() != part.len() {
            return Err(format!("a Blosc block of {} bytes for {}", unpacked.len(), part.len()));
        }
        part.copy_from_slice(&unpacked);
    }
    Ok(())
}

/// Unpacks BloscLZ: runs of up to 32 plain bytes, and copies of earlier bytes.
///
/// ```text
/// 000nnnnn                     n + 1 bytes follow
/// lllddddd [l...] d [D D]      copy l + 2 bytes from d + 1 back; l = 7 goes on while bytes are 255;
///                              the largest d means that the distance is 8192 more than the two bytes D say
/// ```
fn unpack_blosclz(packed: &[u8], out: &mut [u8]) -> Result<(), ChunkFault> {
    let fault = || ChunkFault::from("a damaged BloscLZ stream");
    let mut bytes = packed.iter().copied();
    let mut at = 0;
    let mut first = true;
    while let Some(control) = bytes.next() {
        // The first code is a run, whatever its upper bits: they hold the version of the stream.
        let control = if std::mem::take(&mut first) { control & 31 } else { control };
        if control < 32 {
            let run = usize::from(control) + 1;
            let into = out.get_mut(at..at + run).ok_or_else(fault)?;
            for byte in into {
                *byte = bytes.next().ok_or_else(fault)?;
            }
            at += run;
            continue;
        }
        let mut len = usize::from(control >> 5) + 2;
        if len == 9 {
            loop {
                let more = bytes.next().ok_or_else(fault)?;
                len += usize::from(more);
                if more != 255 {
                    break;
                }
            }
        }
        let low = bytes.next().ok_or_else(fault)?;
        let mut distance = (usize::from(control & 31) << 8) + usize::from(low) + 1;
        if control & 31 == 31 && low == 255 {
            let (high, low) = (bytes.next().ok_or_else(fault)?, bytes.next().ok_or_else(fault)?);
            distance = (usize::from(high) << 8) + usize::from(low) + 8192;
        }
        if distance > at || len > out.len() - at {
            return Err(fault());
        }
        for _ in 0..len {
            out[at] = out[at - distance];
            at += 1;
        }
    }
    if at == out.len() { Ok(()) } else { Err(fault()) }
}

/// Undoes the shuffle of bytes; `from` holds the first bytes of all elements, then the second ones, and so on, then the
/// bytes of an incomplete element.
fn unshuffle_bytes(from: &[u8], to: &mut [u8], element: usize) {
    let count = from.len() / element;
    for (index, cell) in to.chunks_exact_mut(element).enumerate() {
        for (byte, value) in cell.iter_mut().enumerate() {
            *value = from[byte * count + index];
        }
    }
    let whole = count * element;
    to[whole..].copy_from_slice(&from[whole..]);
}

/// Undoes the shuffle of bits; `from` holds the lowest bits of the first bytes of all elements, then the second bits,
/// and so on.
///
/// Blocks whose number of elements is not a multiple of 8 are not shuffled.
fn unshuffle_bits(from: &[u8], to: &mut [u8], element: usize) {
    let count = from.len() / element;
    if !count.is_multiple_of(8) {
        to.copy_from_slice(from);
        return;
    }
    let row = count / 8;
    for (index, cell) in to.chunks_exact_mut(element).enumerate() {
        for (byte, value) in cell.iter_mut().enumerate() {
            *value =
                (0..8).fold(0, |bits, bit| bits | (from[(byte * 8 + bit) * row + index / 8] >> (index % 8) & 1) << bit);
        }
    }
    let whole = count * element;
    to[whole..].copy_from_slice(&from[whole..]);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_and_bytes_come_back_to_their_elements() {
        let cells: Vec<u8> = (0..48u8).map(|i| i.wrapping_mul(37).wrapping_add(11)).collect();
        let mut bytes = vec![0; 50];
        let mut bits = vec![0; 48];
        for element in 0..24 {
            for byte in 0..2 {
                bytes[byte * 25 + element] = cells[element * 2 + byte];
                for bit in 0..8 {
                    let set = cells[element * 2 + byte] >> bit & 1;
                    bits[(byte * 8 + bit) * 3 + element / 8] |= set << (element % 8);
                }
            }
        }
        let mut out = vec![0; 48];
        unshuffle_bits(&bits, &mut out, 2);
        assert_eq!(out, cells);
        let mut out = vec![0; 50];
        unshuffle_bytes(&bytes, &mut out, 2);
        assert_eq!(out[..48], cells[..]);
    }

    #[test]
    fn copies_may_overlap_what_they_write() {
        let mut out = vec![0; 12];
        // The codes mean: "ab", then copy ten bytes from two bytes back; 7 + 1 plus the 2 of every copy make the length
        // 10.
        unpack_blosclz(&[1, b'a', b'b', 7 << 5, 1, 1], &mut out).expect("it is whole");
        assert_eq!(out, b"abababababab");
        for broken in [&[1, b'a'][..], &[0, b'a', 1 << 5, 1], &[7 << 5, 255], &[]] {
            assert!(unpack_blosclz(broken, &mut out).is_err());
        }
    }
}
