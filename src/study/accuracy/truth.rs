//! Reference pictures of views.
//!
//! In: a reference renderer and a view. Out: a frame. Where voxels are finer than pixels, a point sample is not what a
//! pixel should show. Then each side gets four times as many pixels, which the Gaussian of EWA's low-pass filter blurs.

use super::view::JudgedView;
use adjsplat::error::Result;
use adjsplat::internals::{LOW_PASS, PixelMap, SPLAT_LOW_PASS, narrowest_sigma};
use adjsplat::splat::{Frame, Quality, View};
use adjsplat_judge::reference::{Judge, JudgeSettings, ReferencePicture};

/// Fine pixels along each side of a pixel.
const FINER: u32 = 4;

/// Returns the reference picture of a view.
pub(super) fn truth(judge: &Judge, view: &JudgedView, threads: usize) -> Result<Frame> {
    if !view.is_fine {
        return judge.draw(&view.camera, &settings(view.size, threads))?.to_frame();
    }
    let fine = judge.draw(&view.camera, &settings(view.size.map(|side| side * FINER), threads))?;
    let kernel = Quality::Reference.kernel();
    let coarse = View::new(&view.camera, judge.visible().grid(), view.size, kernel, None)?;
    let narrow = match coarse.map {
        PixelMap::Parallel { pixel_from_voxel, .. } => {
            #[expect(clippy::cast_possible_truncation, reason = "a width in pixels needs no more digits")]
            let rows = pixel_from_voxel.map(|map| [map[0] as f32, map[1] as f32, map[2] as f32]);
            f64::from(narrowest_sigma(rows, kernel.sigma))
        }
        PixelMap::Perspective { .. } => f64::from(LOW_PASS),
    };
    let added = (f64::from(LOW_PASS).powi(2) - narrow * narrow).max(0.0).sqrt();
    seen_through(&fine, view.size, f64::from(FINER) * added)
}

fn settings(size: [u32; 2], threads: usize) -> JudgeSettings {
    JudgeSettings { threads, low_pass: SPLAT_LOW_PASS.into(), ..JudgeSettings::new(size) }
}

/// Filters `fine` by a Gaussian of `sigma` fine pixels and keeps every [`FINER`]-th pixel.
/// Beyond its edge `fine` counts as empty.
fn seen_through(fine: &ReferencePicture, size: [u32; 2], sigma: f64) -> Result<Frame> {
    let columns = size[0] as usize;
    let [fine_columns, fine_rows] = fine.size().map(|side| side as usize);
    let taps = |at: usize, end: usize| taps(at, end, sigma);
    // Rows are filtered first, then columns.
    let mut narrow = vec![[0.0f64; 4]; columns * fine_rows];
    for column in 0..columns {
        let taps = taps(column, fine_columns);
        for row in 0..fine_rows {
            let line = &fine.pixels()[row * fine_columns..][..fine_columns];
            narrow[row * columns + column] = sum(taps.iter().map(|&(at, weight)| (line[at], weight)));
        }
    }
    let mut frame = Frame::transparent(size)?;
    for (row, out) in frame.pixels_mut().chunks_exact_mut(4 * columns).enumerate() {
        let taps = taps(row, fine_rows);
        for (column, pixel) in out.as_chunks_mut::<4>().0.iter_mut().enumerate() {
            let sum = sum(taps.iter().map(|&(at, weight)| (narrow[at * columns + column], weight)));
            #[expect(clippy::cast_possible_truncation, reason = "single precision is a frame's")]
            let single = sum.map(|value| value as f32);
            *pixel = single;
        }
    }
    Ok(frame)
}

/// Returns the indices below `end` and the weights of the fine pixels around the centre of pixel `at`.
/// Together with the weights beyond the edge they sum to 1.
fn taps(at: usize, end: usize, sigma: f64) -> Vec<(usize, f64)> {
    let finer = f64::from(FINER);
    let middle = at as f64 * finer + (finer - 1.0) / 2.0;
    let reach = (5.0 * sigma).max(1.0);
    let weight = |place: f64| (-0.5 * ((place - middle) / sigma).powi(2)).exp();
    #[expect(clippy::cast_possible_truncation, reason = "places in a picture")]
    let range = (middle - reach).ceil() as i64..=(middle + reach).floor() as i64;
    let total: f64 = range.clone().map(|place| weight(place as f64)).sum();
    let inside = range.filter_map(|place| usize::try_from(place).ok().filter(|&place| place < end));
    inside.map(|place| (place, weight(place as f64) / total)).collect()
}

fn sum(weighted: impl Iterator<Item = ([f64; 4], f64)>) -> [f64; 4] {
    weighted.fold([0.0; 4], |sum, (pixel, weight)| std::array::from_fn(|c| sum[c] + weight * pixel[c]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_lie_around_the_middle_and_add_up_to_one() {
        let inner = taps(3, 400, 1.7);
        let total: f64 = inner.iter().map(|(_, weight)| weight).sum();
        let mean: f64 = inner.iter().map(|&(at, weight)| at as f64 * weight).sum();
        // The tolerance covers the rounding of some twenty terms.
        assert!((total - 1.0).abs() < 1e-14 && (mean - 13.5).abs() < 1e-12, "{total} {mean}");
        // A pixel on the edge has half of its weight beyond the edge, less half the weight of the pixel itself.
        let edge: f64 = taps(0, 400, 1.7).iter().map(|(_, weight)| weight).sum();
        assert!(edge < 0.9, "{edge}");
    }
}
