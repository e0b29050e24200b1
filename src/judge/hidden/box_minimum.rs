//! The minimum over the square of cells around each cell of a plane.
//!
//! In: a plane of numbers, row by row, and how far squares reach. Out: the same plane, with the minima. Cells outside
//! the plane count as 0. Rows are done first, then columns.

/// Replaces each cell by the minimum over the `2 reach + 1` x `2 reach + 1` cells around it. `across` is scratch memory of
/// the plane's size.
pub(super) fn box_minimum<T: Copy + Default + PartialOrd>(
    plane: &mut [T],
    across: &mut [T],
    width: usize,
    reach: usize,
) {
    let height = plane.len() / width;
    if 2 * reach >= width || 2 * reach >= height {
        plane.fill(T::default());
        return;
    }
    for (row, to) in plane.chunks_exact(width).zip(across.chunks_exact_mut(width)) {
        to.fill(T::default());
        let inner = &mut to[reach..width - reach];
        inner.copy_from_slice(&row[..width - 2 * reach]);
        for shift in 1..=2 * reach {
            lower(inner, &row[shift..]);
        }
    }
    plane.fill(T::default());
    for y in reach..height - reach {
        let to = &mut plane[y * width..][..width];
        to.copy_from_slice(&across[(y - reach) * width..][..width]);
        for row in across[(y - reach + 1) * width..(y + reach + 1) * width].chunks_exact(width) {
            lower(to, row);
        }
    }
}

fn lower<T: Copy + PartialOrd>(least: &mut [T], others: &[T]) {
    for (least, next) in least.iter_mut().zip(others) {
        *least = if *next < *least { *next } else { *least };
    }
}
