//! Scenes in memory, pictures of them, and what double precision makes of the same splats.

use adjsplat::arena::Record;
use adjsplat::build::Built;
use adjsplat::classify::TransferFunction;
use adjsplat::internals::PixelMap;
use adjsplat::splat::{Camera, Code, Frame, Projection, Settings, Stats, View, cpu};
use adjsplat::volume::Grid;
use adjsplat_tests::pictures::{alphas, bits};
use adjsplat_tests::scenes::{Draw as _, PLAIN, packed, transfer};

/// Returns the voxels of a grid that `value` gives a code.
pub(crate) fn coded(grid: Grid, transfer: TransferFunction, value: impl Fn([u16; 3]) -> Option<u16>) -> Built {
    packed(grid, PLAIN, transfer, |at| value(at).map(|value| Record { value, ..Record::default() }))
}

/// Returns every voxel of a grid, with code 1.
pub(crate) fn solid(dims: [u64; 3], spacing: [f64; 3], transfer: TransferFunction) -> Built {
    coded(Grid::new(dims, spacing).unwrap(), transfer, |_| Some(1))
}

/// How a structure is drawn and judged.
pub(crate) trait Judge {
    /// The picture: finite, and bit for bit the same of any code and any number of threads.
    fn draw(&self, camera: &Camera, settings: &Settings) -> (Frame, Stats);

    /// What drawing is refused with: one line.
    fn refusal(&self, camera: &Camera, settings: &Settings) -> String;

    /// Sums of optical depth at each pixel of a parallel view, in double precision, voxel after voxel; `depth` of a
    /// code: per mean voxel. And how many splats are at the pixel with the most.
    fn depths(&self, camera: &Camera, settings: &Settings, depth: impl Fn(u16) -> f64) -> (Vec<f64>, u64);
}

impl Judge for Built {
    fn draw(&self, camera: &Camera, settings: &Settings) -> (Frame, Stats) {
        let (frame, stats) = self.render(camera, settings);
        assert!(frame.pixels().iter().all(|value| value.is_finite()), "not finite: {camera:?} {settings:?}");
        for (code, threads) in [(Code::Plain, 1), (Code::Best, 3)] {
            let again = self.frame(camera, &settings.clone().with_code(code).with_threads(threads));
            assert!(bits(&again) == bits(&frame), "{code:?} with {threads} threads: {camera:?} {settings:?}");
        }
        (frame, stats)
    }

    fn refusal(&self, camera: &Camera, settings: &Settings) -> String {
        let error = cpu::render(&self.scene(), camera, settings).expect_err("this cannot be drawn").to_string();
        assert_eq!(error.lines().count(), 1, "{error}");
        error
    }

    fn depths(&self, camera: &Camera, settings: &Settings, depth: impl Fn(u16) -> f64) -> (Vec<f64>, u64) {
        let kernel = settings.kernel();
        let (sigma, cut) = (f64::from(kernel.sigma), f64::from(kernel.radius / kernel.sigma).powi(2));
        let kept = -(-cut / 2.0).exp_m1();
        let view = View::new(camera, &self.facts.grid, settings.size, kernel, settings.near).unwrap();
        let PixelMap::Parallel { pixel_from_voxel: [x, y], scale } = view.map else { panic!("a parallel view") };
        let sum = |a: [f64; 4], b: [f64; 4]| (0..3).map(|i| a[i] * b[i]).sum::<f64>();
        let square = sigma * sigma;
        let (xx, xy, yy) = (square * sum(x, x), square * sum(x, y), square * sum(y, y));
        let cross = [x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]];
        let determinant = square * square * cross.iter().map(|c| c * c).sum::<f64>();
        let root = ((xx - yy).powi(2) + 4.0 * xy * xy).sqrt();
        // The low-pass of kernel.rs.
        let added = (0.6f64.powi(2) - 2.0 * determinant / (xx + yy + root)).max(0.0);
        let determinant = determinant + added * (xx + yy + added);
        let (xx, yy) = (xx + added, yy + added);
        let weight = scale * scale / (std::f64::consts::TAU * determinant.sqrt() * kept);
        let [columns, rows] = settings.size;
        let mut depths = vec![(0.0, 0); (columns * rows) as usize];
        let lane = self.lanes[0].view();
        for line in lane.lines() {
            for (voxel_x, record) in lane.line_voxels(line.records.clone()) {
                let at = [voxel_x, line.u, line.v].map(f64::from);
                let place = |row: [f64; 4]| row[0] * at[0] + row[1] * at[1] + row[2] * at[2] + row[3];
                let (centre_x, centre_y) = (place(x), place(y));
                let peak = (depth(lane.value_code(record)) * weight).min(16.0);
                for row in 0..rows {
                    for column in 0..columns {
                        let (dx, dy) = (f64::from(column) - centre_x, f64::from(row) - centre_y);
                        let distance = (yy * dx * dx - 2.0 * xy * dx * dy + xx * dy * dy) / determinant;
                        if distance <= cut {
                            let pixel = &mut depths[(row * columns + column) as usize];
                            *pixel = (pixel.0 + peak * (-distance / 2.0).exp(), pixel.1 + 1);
                        }
                    }
                }
            }
        }
        let most = depths.iter().map(|(_, count)| *count).max().unwrap();
        (depths.into_iter().map(|(depth, _)| depth).collect(), most)
    }
}

/// One colour, one opacity; opacities are per `reference` world length.
pub(crate) fn constant(opacity: f64, reference: f64) -> TransferFunction {
    transfer(&format!(
        r##"{{"kind": "points", "points": [{{"value": 0, "colour": "#ffffff", "opacity": {opacity:e}}}],
            "reference_length": {reference:e}, "shaded": false}}"##
    ))
}

/// A parallel camera whose picture is `height` high and has `target` in its middle.
pub(crate) fn parallel(target: [f64; 3], along: [f64; 3], up: [f64; 3], height: f64) -> Camera {
    let position = std::array::from_fn(|a| target[a] - along[a]);
    Camera::new(position, target, up, Projection::Parallel { height }).unwrap()
}

/// World position of a grid's middle, where the grid lies along the world's axes.
pub(crate) fn middle(grid: &Grid) -> [f64; 3] {
    std::array::from_fn(|a| f64::from(grid.dims[a] - 1) / 2.0 * grid.spacing[a])
}

/// Largest difference between a frame's alpha and what sums of optical depth say.
pub(crate) fn worst(frame: &Frame, depths: &[f64]) -> f64 {
    alphas(frame).zip(depths).map(|(alpha, depth)| (alpha + (-depth).exp_m1()).abs()).fold(0.0, f64::max)
}

/// What a splat weighs at its centre, where it is wide enough: the kernel's integral along a line through it.
pub(crate) fn peak_weight(settings: &Settings) -> f64 {
    let kernel = settings.kernel();
    let (sigma, radius) = (f64::from(kernel.sigma), f64::from(kernel.radius));
    1.0 / (std::f64::consts::TAU * sigma * sigma * -(-0.5 * (radius / sigma).powi(2)).exp_m1())
}
