//! Stretches a draft with fewer pixels to the size of its view, beside the interface: a window that the processor paints is
//! painted sooner if it need not interpolate.

use egui::{Color32, ColorImage};

/// A place between two texels: the one before it, the one behind it, and how much the latter counts, of 256.
struct Between {
    texels: [usize; 2],
    weight: u32,
}

/// Returns an opaque picture in `size` columns and rows: means of the nearest four pixels, as a graphics device's sampler computes.
pub(super) fn stretched(image: ColorImage, size: [usize; 2]) -> ColorImage {
    if image.size == size {
        return image;
    }
    let [columns, rows] = [0, 1].map(|axis| betweens(image.size[axis], size[axis]));
    let mut pixels = Vec::with_capacity(size[0] * size[1]);
    let mut mixed = vec![[0; 3]; image.size[0]];
    for row in rows {
        let [first, second] = row.texels.map(|row| &image.pixels[row * image.size[0]..][..image.size[0]]);
        for ((mixed, first), second) in mixed.iter_mut().zip(first).zip(second) {
            let [first, second] = [first, second].map(|pixel| [pixel.r(), pixel.g(), pixel.b()].map(u32::from));
            *mixed = mix(first, second, row.weight);
        }
        pixels.extend(columns.iter().map(|column| {
            let [first, second] = column.texels.map(|column| mixed[column]);
            // Of the products of two weights of 256, rounded.
            let [r, g, b] = mix(first, second, column.weight).map(|sum| (sum + (1 << 15)).to_le_bytes()[2]);
            Color32::from_rgb(r, g, b)
        }));
    }
    ColorImage::new(size, pixels)
}

#[inline(always)]
fn mix(first: [u32; 3], second: [u32; 3], weight: u32) -> [u32; 3] {
    std::array::from_fn(|channel| first[channel] * (256 - weight) + second[channel] * weight)
}

/// Returns where the middles of `count` pixels lie between `texels` texels.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "places inside a picture")]
fn betweens(texels: usize, count: usize) -> Vec<Between> {
    let place = |index: usize| (index as f64 + 0.5) * texels as f64 / count as f64 - 0.5;
    let between = |place: f64| {
        let before = place.max(0.0) as usize;
        let weight = ((place - before as f64).max(0.0) * 256.0).round() as u32;
        Between { texels: [before, (before + 1).min(texels - 1)], weight }
    };
    (0..count).map(|index| between(place(index))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ramp_stays_a_ramp() {
        let pixels = (0..15).flat_map(|row| (0..20).map(move |column| Color32::from_rgb(10 * column, 10 * row, 7)));
        let found = stretched(ColorImage::new([20, 15], pixels.collect()), [50, 45]);
        assert_eq!(found.size, [50, 45]);
        for (index, pixel) in found.pixels.iter().enumerate() {
            let expected = [(index % 50, 20.0, 50.0), (index / 50, 15.0, 45.0)].map(|(index, texels, count)| {
                10.0 * ((index as f64 + 0.5) * texels / count - 0.5_f64).clamp(0.0, texels - 1.0)
            });
            let found = [pixel.r(), pixel.g()].map(f64::from);
            assert!(
                (0..2).all(|axis| (found[axis] - expected[axis]).abs() < 0.55),
                "{index}: {found:?}, not {expected:?}"
            );
            assert_eq!((pixel.b(), pixel.a()), (7, 255));
        }
    }

    #[test]
    fn pixels_at_the_edge_are_those_of_the_picture() {
        let colours = [Color32::from_rgb(255, 0, 3), Color32::from_rgb(0, 255, 4)];
        let found = stretched(ColorImage::new([2, 1], colours.to_vec()), [8, 3]);
        let row: Vec<[u8; 4]> = found.pixels[..8].iter().map(Color32::to_array).collect();
        assert_eq!([row[0], row[1], row[7]], [[255, 0, 3, 255], [255, 0, 3, 255], [0, 255, 4, 255]]);
        // Eighths of the way from the middle of the one to the middle of the other.
        assert_eq!([row[2], row[3]], [[223, 32, 3, 255], [159, 96, 3, 255]]);
        assert_eq!(found.pixels[..8], found.pixels[16..]);
    }
}
