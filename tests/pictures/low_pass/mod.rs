//! A picture of finer pixels seen through the Gaussian that a pixel is, plainly: what small pictures are judged by.

#![expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "places in small pictures")]

use adjsplat::splat::Frame;

/// The middle of `fine`, of `finer` pixels for each along a side, seen through a Gaussian of `sigma` of them; beyond its edge there is
/// nothing.
pub(crate) fn seen_through(fine: &Frame, size: [u32; 2], finer: u32, sigma: f64) -> Frame {
    let mut out = Frame::transparent(size).unwrap();
    let reach = (4.0 * sigma).ceil() as i64;
    let around = [0, 1].map(|side: usize| f64::from(fine.size()[side] - finer * size[side]) / 2.0);
    for (index, pixel) in out.pixels_mut().chunks_exact_mut(4).enumerate() {
        let place = [index as u32 % size[0], index as u32 / size[0]];
        let middle =
            [0, 1].map(|side: usize| around[side] + f64::from(place[side] * finer) + f64::from(finer - 1) / 2.0);
        let (mut sum, mut weights) = ([0.0f64; 4], 0.0);
        for v in middle[1] as i64 - reach..=middle[1] as i64 + reach {
            for u in middle[0] as i64 - reach..=middle[0] as i64 + reach {
                let square = (u as f64 - middle[0]).powi(2) + (v as f64 - middle[1]).powi(2);
                let weight = (-square / (2.0 * sigma * sigma)).exp();
                weights += weight;
                if (0..i64::from(fine.size()[0])).contains(&u) && (0..i64::from(fine.size()[1])).contains(&v) {
                    let values = fine.pixel(u as u32, v as u32);
                    (0..4).for_each(|c| sum[c] += weight * f64::from(values[c]));
                }
            }
        }
        (0..4).for_each(|c| pixel[c] = (sum[c] / weights) as f32);
    }
    out
}
