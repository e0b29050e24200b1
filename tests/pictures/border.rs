//! Pictures that cut the volume: a pixel at the border is what it is in a larger picture, which goes on there.

use adjsplat::splat::{Camera, Frame, Mode, Projection, Quality, Settings};
use adjsplat_tests::pictures::{decibels, shows};
use adjsplat_tests::scenes::{Draw as _, built_phantom};

/// Pixels that the larger picture has more on each side.
const MORE: u32 = 16;
const SIZE: [u32; 2] = [26, 22];

/// Looks at the middle of the grid, in a picture that is taller than [`SIZE`] by this ratio. Near its middle, a perspective has as many
/// pixels a voxel as a parallel view.
fn camera(middle: [f64; 3], [azimuth, elevation]: [f64; 2], pixels: f64, fov: Option<f64>, ratio: f64) -> Camera {
    let ((sin, cos), (rise, level)) = (azimuth.to_radians().sin_cos(), elevation.to_radians().sin_cos());
    let height = f64::from(SIZE[1]) / pixels;
    let (distance, projection) = match fov {
        None => (500.0, Projection::Parallel { height: ratio * height }),
        Some(fov) => {
            let tangent = (fov.to_radians() / 2.0).tan();
            (height / 2.0 / tangent, Projection::Perspective { fov: 2.0 * (ratio * tangent).atan().to_degrees() })
        }
    };
    let eye = [sin * level, -cos * level, rise];
    let eye = [0, 1, 2].map(|a| middle[a] + distance * eye[a]);
    Camera::new(eye, middle, [0.0, 0.0, 1.0], projection).unwrap()
}

/// Returns the part of a larger picture that the picture shows.
fn cut(larger: &Frame) -> Frame {
    let mut frame = Frame::transparent(SIZE).unwrap();
    for y in 0..SIZE[1] {
        for x in 0..SIZE[0] {
            let at = (4 * (y * SIZE[0] + x)) as usize;
            frame.pixels_mut()[at..at + 4].copy_from_slice(&larger.pixel(x + MORE, y + MORE));
        }
    }
    frame
}

/// The filter of supersamples had weight 1 within the picture alone: borders of pictures of small voxels had 27 to 45 dB at `high` and
/// `reference`.
#[test]
fn what_a_picture_shows_does_not_depend_on_where_its_border_is() {
    for name in ["gyroid", "shells"] {
        let built = built_phantom(name, [96, 80, 88], [0.5, 0.9]);
        let middle = built.surround().centre;
        let larger = SIZE.map(|side| side + 2 * MORE);
        let ratio = f64::from(larger[1]) / f64::from(SIZE[1]);
        for pixels in [2.0, 0.9, 0.6, 0.4, 0.3] {
            for (direction, fov) in [([0.0, 0.0], None), ([35.0, 20.0], None), ([35.0, 20.0], Some(25.0))] {
                for mode in [Mode::Composite, Mode::Additive, Mode::Maximum] {
                    for quality in Quality::ALL {
                        let draw = |size, ratio| {
                            let camera = camera(middle, direction, pixels, fov, ratio);
                            built.frame(&camera, &Settings::new(size).with_quality(quality).with_mode(mode))
                        };
                        let (picture, part) = (draw(SIZE, 1.0), cut(&draw(larger, ratio)));
                        assert!(shows(&picture));
                        let db = decibels(&picture, &part, 1e-3);
                        let least = match quality {
                            // Lattices are cut off a little beyond the border; measured: 54.9 dB and more.
                            Quality::Draft | Quality::Standard => 50.0,
                            Quality::High | Quality::Reference => 110.0,
                        };
                        let what = format!("{name} {pixels} {direction:?} {fov:?} {mode:?} {quality:?}");
                        assert!(db > least, "{what}: {db:.1} dB");
                    }
                }
            }
        }
    }
}
