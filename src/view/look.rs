//! What a view shows, and from where: all that a picture of a model depends on, apart from its size.
//!
//! In: numbers that mouse, keys and panels change. Out: a [`Camera`] and [`Settings`] for the renderer.

use std::ops::RangeInclusive;

use adjsplat::error::{Error, Result};
use adjsplat::splat::{Camera, ClipPlane, Lighting, Mode, Orbit, Projection, Quality, Settings, Surround, Up};
use adjsplat::traverse::VoxelBox;
use adjsplat::{Model, volume::Grid};
use glam::DVec3;

/// The vertical angle of view with which perspective begins, in degrees.
const FIRST_FOV: f64 = 30.0;

/// Heights of the view that can be reached by zooming, in heights of the view that shows everything.
const ZOOMS: [f64; 2] = [1e-4, 20.0];

/// The same for the camera of a link, which may be of a narrow view, where everything takes a larger height.
const LINK_ZOOMS: [f64; 2] = [5e-5, 2000.0];

/// The vertical angles of view of a link, in degrees.
const LINK_FOVS: RangeInclusive<f64> = 1.0..=160.0;

/// A side from which a model is looked at: azimuth and elevation in degrees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Side {
    /// The name on the button.
    pub name: &'static str,
    pub(crate) azimuth: f64,
    pub(crate) elevation: f64,
}

/// The six sides, in the order of the keys 1 to 6.
pub const SIDES: [Side; 6] = [
    Side { name: "Front", azimuth: 0.0, elevation: 0.0 },
    Side { name: "Back", azimuth: 180.0, elevation: 0.0 },
    Side { name: "Right", azimuth: 90.0, elevation: 0.0 },
    Side { name: "Left", azimuth: -90.0, elevation: 0.0 },
    Side { name: "Top", azimuth: 0.0, elevation: 90.0 },
    Side { name: "Bottom", azimuth: 0.0, elevation: -90.0 },
];

/// The eye: where it is, where it looks, and how much it sees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Eye {
    /// The world point in the middle of the view.
    pub target: DVec3,
    /// Degrees around the vertical, as in [`Orbit`].
    pub azimuth: f64,
    /// Degrees above the horizontal plane, -90 to 90.
    pub elevation: f64,
    /// The world axis that is upright.
    pub up: Up,
    /// The world length from the bottom of the view to its top, at the target; above 0.
    pub height: f64,
    /// The vertical angle of view in degrees, above 0 and below 180; `None` for parallel rays.
    pub fov: Option<f64>,
    /// The height of the view that shows everything.
    pub full_height: f64,
}

impl Eye {
    /// Returns the eye that sees all visible voxels of `model`, which lie in `extent`, from a side, in a view of `size` pixels.
    ///
    /// # Errors
    /// The errors of [`Model::camera`].
    pub fn around(
        model: &Model,
        extent: Option<VoxelBox>,
        side: Side,
        up: Up,
        fov: Option<f64>,
        size: [u32; 2],
    ) -> Result<Eye> {
        let Side { azimuth, elevation, .. } = side;
        let orbit = Orbit { azimuth, elevation, zoom: 1.0, fov, up };
        let camera = model.camera(&orbit, &Settings::new(size).with_crop(extent))?;
        let centre = match extent {
            Some(bounds) => Surround::of_voxels(model.grid(), bounds.low, bounds.high),
            None => Surround::of_grid(model.grid()),
        };
        let (forward, anchor) = (camera.axes()[2], DVec3::from_array(camera.anchor()));
        let (target, height) = match camera.projection() {
            Projection::Parallel { height } => (anchor, height),
            Projection::Perspective { fov } => {
                let distance = (DVec3::from_array(centre.centre) - anchor).dot(forward);
                (anchor + forward * distance, 2.0 * distance * (fov.to_radians() / 2.0).tan())
            }
        };
        Ok(Eye { target, azimuth, elevation, up, height, fov, full_height: height })
    }

    /// Returns unit world vectors to the right of the view, to its top, and forward.
    pub fn axes(&self) -> [DVec3; 3] {
        let orbit = Orbit { azimuth: self.azimuth, elevation: self.elevation, zoom: 1.0, fov: None, up: self.up };
        let unit = Surround { centre: [0.0; 3], radius: 1.0 };
        Camera::orbiting(orbit, unit, [1, 1]).map_or([DVec3::X, DVec3::Z, DVec3::Y], |camera| camera.axes())
    }

    /// Returns the world distance from the eye to the target.
    pub fn distance(&self) -> f64 {
        match self.fov {
            None => 2.0 * self.full_height.max(self.height),
            Some(fov) => self.height / 2.0 / (fov.to_radians() / 2.0).tan(),
        }
    }

    /// Returns the position of the eye in the world.
    pub fn position(&self) -> DVec3 {
        self.target - self.axes()[2] * self.distance()
    }

    /// Returns the camera of the renderer.
    ///
    /// # Errors
    /// The errors of [`Camera::new`], if numbers are at their ends.
    pub fn camera(&self) -> Result<Camera> {
        let [_, up, forward] = self.axes();
        let projection = match self.fov {
            None => Projection::Parallel { height: self.height },
            Some(fov) => Projection::Perspective { fov },
        };
        let position = self.target - forward * self.distance();
        Camera::new(position.to_array(), self.target.to_array(), up.to_array(), projection)
    }

    /// Turns around the target, by degrees to the right and up.
    pub fn orbit(&mut self, [right, up]: [f64; 2]) {
        self.azimuth = (self.azimuth + right).rem_euclid(360.0);
        self.elevation = (self.elevation + up).clamp(-90.0, 90.0);
    }

    /// Turns the head: the position stays.
    pub fn turn(&mut self, angles: [f64; 2]) {
        let position = self.position();
        self.orbit(angles);
        self.target = position + self.axes()[2] * self.distance();
    }

    /// Moves eye and target by world lengths to the right, up and forward.
    pub fn shift(&mut self, steps: [f64; 3]) {
        self.target += self.axes().into_iter().zip(steps).map(|(axis, step)| axis * step).sum::<DVec3>();
    }

    /// Magnifies by `factor`; the point at `from_middle` (to the right and up, in heights of the view) stays where it is.
    pub fn zoom(&mut self, factor: f64, from_middle: [f64; 2]) {
        let [least, most] = ZOOMS.map(|zoom| zoom * self.full_height);
        let height = (self.height / factor).clamp(least, most);
        let moved = self.height - height;
        self.shift([moved * from_middle[0], moved * from_middle[1], 0.0]);
        self.height = height;
    }

    /// Returns the eye as seven numbers with commas between them: azimuth, elevation, height, angle of view (0 for parallel
    /// rays), and the target's x, y, z.
    pub fn to_text(&self) -> String {
        let [x, y, z] = self.target.to_array();
        let numbers = [self.azimuth, self.elevation, self.height, self.fov.unwrap_or(0.0), x, y, z];
        numbers.map(|number| number.to_string()).join(",")
    }

    /// Returns this eye, moved to where the text of [`Eye::to_text`] says.
    ///
    /// # Errors
    /// [`Error::Input`] for another text, or a number out of its range.
    pub fn moved_to(self, text: &str) -> Result<Eye> {
        let [least, most] = LINK_ZOOMS.map(|zoom| zoom * self.full_height);
        let wrong = || {
            let (low, high) = (LINK_FOVS.start(), LINK_FOVS.end());
            let wanted = "azimuth,elevation,height,angle,x,y,z in numbers, with elevation from -90 to 90";
            let bounds = format!("height from {least:.1e} to {most:.1e}, angle 0 or from {low} to {high}");
            Error::input("view", format!("is \"{text}\", but must be {wanted}, {bounds}"))
        };
        let numbers: Vec<f64> =
            text.split(',').map(str::parse).collect::<std::result::Result<_, _>>().map_err(|_| wrong())?;
        let [azimuth, elevation, height, fov, x, y, z] = numbers[..] else { return Err(wrong()) };
        let is_right = numbers.iter().all(|number| number.is_finite())
            && elevation.abs() <= 90.0
            && (least..=most).contains(&height)
            && (fov == 0.0 || LINK_FOVS.contains(&fov));
        let eye =
            Eye { target: DVec3::new(x, y, z), azimuth, elevation, height, fov: (fov > 0.0).then_some(fov), ..self };
        // A camera of these numbers may still be impossible, such as one at infinity.
        if is_right { eye.camera().map(|_| eye) } else { Err(wrong()) }
    }

    /// Switches between parallel rays and perspective.
    pub fn toggle_perspective(&mut self) {
        self.fov = if self.fov.is_some() { None } else { Some(FIRST_FOV) };
    }
}

/// A clip plane that the user moves: the way it faces, and where along it the cut is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Clip {
    /// Unit world vector toward the side that is drawn.
    pub normal: DVec3,
    /// Where the plane is, from 0 (nothing is cut) to 1 (everything is).
    pub depth: f64,
}

/// What a view shows, and from where.
#[derive(Debug, Clone, PartialEq)]
pub struct ViewLook {
    /// The eye.
    pub eye: Eye,
    /// What a pixel shows of its ray.
    pub mode: Mode,
    /// Whether voxels are lit.
    pub is_lit: bool,
    /// How narrow splats are, 0 to 1.
    pub sharpness: f32,
    /// The box of voxels that is drawn.
    pub crop: Option<VoxelBox>,
    /// The plane that cuts the volume open.
    pub clip: Option<Clip>,
    /// The colour behind the volume, sRGB.
    pub background: [u8; 3],
}

impl ViewLook {
    /// Returns the first look at a model, whose voxels lie in `extent`: from the front and above, over a background of this
    /// colour.
    ///
    /// # Errors
    /// The errors of [`Eye::around`].
    pub fn first(model: &Model, extent: Option<VoxelBox>, background: [u8; 3], size: [u32; 2]) -> Result<ViewLook> {
        let side = Side { name: "", azimuth: 30.0, elevation: 20.0 };
        let eye = Eye::around(model, extent, side, Up::default(), None, size)?;
        let mode = Mode::Composite;
        Ok(ViewLook { eye, mode, is_lit: true, sharpness: 0.0, crop: None, clip: None, background })
    }

    /// Returns the settings for a picture of `size` pixels.
    ///
    /// # Errors
    /// [`adjsplat::Error::Input`] if the sharpness is out of range.
    pub fn settings(&self, grid: &Grid, size: [u32; 2], quality: Quality) -> Result<Settings> {
        let mut settings = Settings::new(size)
            .with_quality(quality)
            .with_mode(self.mode)
            .with_lighting(self.is_lit.then(Lighting::default))
            .with_crop(self.crop)
            .with_clip(self.clip.map(|clip| clip.plane(grid)));
        if self.sharpness > 0.0 {
            settings.kernel = Some(quality.kernel().sharpened(self.sharpness)?);
        }
        Ok(settings)
    }
}

impl Clip {
    /// Returns the plane in the world; it passes the grid's corners at depths 0 and 1.
    pub fn plane(&self, grid: &Grid) -> ClipPlane {
        let around = Surround::of_grid(grid);
        let offset = (2.0 * self.depth - 1.0) * around.radius;
        let point = DVec3::from_array(around.centre) + self.normal * offset;
        ClipPlane { point: point.to_array(), normal: self.normal.to_array() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use adjsplat::{Build, TransferFunction, Volume};

    fn eye() -> Eye {
        let volume = Volume::new([20, 10, 30], vec![9u8; 6000]).unwrap();
        let model = Build::new(TransferFunction::range(1.0, 10.0).unwrap()).run(&volume).unwrap();
        Eye::around(&model, model.bounds().unwrap(), SIDES[0], Up::default(), None, [200, 100]).unwrap()
    }

    #[test]
    fn zooming_keeps_the_point_under_the_pointer() {
        for fov in [None, Some(40.0)] {
            let mut eye = Eye { fov, azimuth: 20.0, ..eye() };
            let under = |eye: &Eye| {
                let [right, up, _] = eye.axes();
                eye.target + (right * 0.3 - up * 0.2) * eye.height
            };
            let before = under(&eye);
            eye.zoom(2.5, [0.3, -0.2]);
            assert!(under(&eye).distance(before) < 1e-9 * eye.full_height);
            assert!((eye.height - eye.full_height / 2.5).abs() < 1e-9);
        }
    }

    #[test]
    fn an_eye_comes_back_from_its_text() {
        for fov in [None, Some(40.0)] {
            let mut eye = Eye { fov, ..eye() };
            eye.orbit([33.3, -12.5]);
            eye.zoom(1.7, [0.1, 0.2]);
            assert_eq!(self::eye().moved_to(&eye.to_text()).unwrap(), eye);
        }
        for text in
            ["", "1,2,3", "a,0,1,0,0,0,0", "0,91,1,0,0,0,0", "0,0,0,0,0,0,0", "0,0,1,180,0,0,0", "0,0,NaN,0,0,0,0"]
        {
            assert!(eye().moved_to(text).is_err(), "{text}");
        }
        assert!(eye().moved_to("0,0,1e308,1e-300,1e308,0,0").is_err());
    }

    #[test]
    fn a_link_whose_angle_or_height_would_hang_the_page_is_refused_with_the_bounds() {
        for text in ["0,0,90,179.999,0,0,0", "0,0,90,1e-9,0,0,0", "0,0,1e-308,0,0,0,0", "0,0,1e9,0,0,0,0"] {
            let fault = eye().moved_to(text).unwrap_err().to_string();
            assert!(fault.contains("angle 0 or from 1 to 160") && fault.contains("height from "), "{fault}");
        }
        for fov in [0.0, 1.0, 160.0] {
            assert!(eye().moved_to(&format!("0,0,{},{fov},0,0,0", eye().full_height)).is_ok(), "{fov}");
        }
    }

    #[test]
    fn turning_the_head_keeps_the_eye_where_it_is() {
        let mut eye = Eye { fov: Some(40.0), ..eye() };
        let position = eye.position();
        eye.turn([30.0, -10.0]);
        assert!(eye.position().distance(position) < 1e-9 * eye.full_height);
        assert_eq!(eye.azimuth, 30.0);
    }

    #[test]
    fn an_eye_is_the_camera_that_frames_the_model() {
        let volume = Volume::new([20, 10, 30], vec![9u8; 6000]).unwrap();
        let model = Build::new(TransferFunction::range(1.0, 10.0).unwrap()).run(&volume).unwrap();
        for fov in [None, Some(50.0)] {
            for side in SIDES {
                let eye = Eye::around(&model, model.bounds().unwrap(), side, Up::default(), fov, [300, 200]).unwrap();
                let orbit =
                    Orbit { azimuth: side.azimuth, elevation: side.elevation, zoom: 1.0, fov, up: Up::default() };
                let want = model.camera(&orbit, &Settings::new([300, 200])).unwrap();
                let camera = eye.camera().unwrap();
                assert!(camera.axes().iter().zip(want.axes()).all(|(a, b)| a.distance(b) < 1e-12));
                let (a, b) = (DVec3::from_array(camera.anchor()), DVec3::from_array(want.anchor()));
                assert!(a.distance(b) < 1e-9 * eye.full_height, "{side:?} {fov:?}: {a} {b}");
            }
        }
    }
}
