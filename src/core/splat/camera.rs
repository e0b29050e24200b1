//! Cameras in world space: where the eye is, what it looks at, how it projects the world to the picture.
//!
//! In: an orbit (azimuth, elevation, zoom) around a box, or position, target and up. Out: a checked [`Camera`]. World
//! axes are right-handed. In an anatomical frame they are R, A, S, and an orbit at azimuth 0, elevation 0 looks at the
//! face: from the front (+y), the head (+z) up, the patient's right at the picture's left. Pictures are never mirrored.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::outline::Outline;
use super::{require, require_pixels, require_positive};
use crate::error::{Error, Result};
use crate::traverse::VoxelBox;
use crate::volume::{Axis, Grid};

/// A camera's projection.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Projection {
    /// All rays are parallel.
    Parallel {
        /// World length that the picture shows from its bottom to its top; finite and above 0.
        height: f64,
    },
    /// All rays come from the eye.
    Perspective {
        /// Vertical angle of view in degrees, above 0 and below 180.
        fov: f64,
    },
}

/// A camera, in world units.
///
/// As JSON: `{"position": [..], "target": [..], "up": [..], "fov": 30}`; a parallel one has
/// `"height"` instead of `"fov"`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "CameraDocument", into = "CameraDocument")]
pub struct Camera {
    position: DVec3,
    target: DVec3,
    up: DVec3,
    projection: Projection,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraDocument {
    position: [f64; 3],
    target: [f64; 3],
    up: [f64; 3],
    #[serde(default, skip_serializing_if = "Option::is_none")]
    fov: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    height: Option<f64>,
}

/// A camera on a sphere around the voxels, looking at their middle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Orbit {
    /// Degrees around the vertical, counter-clockwise seen from above (+z); 0 is in front (+y). Any finite number.
    pub azimuth: f64,
    /// Degrees above the horizontal plane; any finite number. Beyond 90 the camera passes over the top.
    pub elevation: f64,
    /// Magnification at the centre; finite and above 0. At 1, everything fits into the picture.
    pub zoom: f64,
    /// Vertical angle of view in degrees, above 0 and below 180; `None` for a parallel projection.
    pub fov: Option<f64>,
    /// The world axis that is upright in the picture, and that the azimuth turns around.
    pub up: Up,
}

impl Default for Orbit {
    fn default() -> Orbit {
        Orbit { azimuth: 0.0, elevation: 0.0, zoom: 1.0, fov: None, up: Up::default() }
    }
}

impl Orbit {
    /// Sets the magnification at the centre; finite and above 0.
    pub fn with_zoom(self, zoom: f64) -> Orbit {
        Orbit { zoom, ..self }
    }

    /// Sets a perspective projection with this vertical angle of view in degrees, above 0 and below 180.
    pub fn with_perspective(self, fov: f64) -> Orbit {
        Orbit { fov: Some(fov), ..self }
    }

    /// Sets the world axis that is upright in the picture.
    pub fn with_up(self, up: Up) -> Orbit {
        Orbit { up, ..self }
    }

    /// Returns unit world vectors to the picture's right, to its top, and toward the camera.
    ///
    /// # Errors
    /// [`Error::Input`] if a number of the orbit is out of its range.
    pub(super) fn axes(&self) -> Result<[DVec3; 3]> {
        let Orbit { azimuth, elevation, zoom, fov, up } = *self;
        for (name, angle) in [("azimuth", azimuth), ("elevation", elevation)] {
            require(angle.is_finite(), name, format_args!("is {angle}, but must be finite"))?;
        }
        require_positive(zoom, "zoom")?;
        fov.map_or(Ok(()), |fov| require_angle(fov, "angle of view"))?;
        let (sin_a, cos_a) = sin_cos_degrees(azimuth);
        let (sin_e, cos_e) = sin_cos_degrees(elevation);
        let [side, front, upright] = up.frame();
        let outward = side * (-sin_a * cos_e) + front * (cos_a * cos_e) + upright * sin_e;
        let up = side * (sin_a * sin_e) - front * (cos_a * sin_e) + upright * cos_e;
        Ok([up.cross(outward), up, outward])
    }
}

/// A [`Camera`], or an [`Orbit`], which becomes a camera once it is known where the visible voxels are.
pub trait ToCamera {
    /// Returns the camera for a picture of `size` (columns, rows); an orbit frames `outline`.
    ///
    /// # Errors
    /// [`Error::Input`] if a number is out of its range.
    fn to_camera(&self, outline: &Outline, size: [u32; 2]) -> Result<Camera>;
}

impl ToCamera for Camera {
    fn to_camera(&self, _: &Outline, _: [u32; 2]) -> Result<Camera> {
        Ok(*self)
    }
}

impl ToCamera for Orbit {
    fn to_camera(&self, outline: &Outline, size: [u32; 2]) -> Result<Camera> {
        Ok(Camera::framing(&[*self], outline, size)?[0])
    }
}

/// The world axis that is upright in an orbit's picture. Volumes without an anatomical frame may lie any way.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Up {
    /// The positive direction of an axis. Azimuth 0 looks from +y, or from -z if y itself is up or down.
    Plus(Axis),
    /// The negative direction of an axis.
    Minus(Axis),
}

impl Default for Up {
    /// Returns +z: toward the head, if the world is anatomical.
    fn default() -> Up {
        Up::Plus(Axis::Z)
    }
}

impl Up {
    /// Returns the axis for a name such as `z` or `-y`.
    ///
    /// # Errors
    /// [`Error::Input`] for any other text.
    pub fn from_name(name: &str) -> Result<Up> {
        let (minus, letter) = name.strip_prefix('-').map_or((false, name), |letter| (true, letter));
        let axis = Axis::ALL.into_iter().find(|axis| axis.name() == letter);
        let axis =
            axis.ok_or_else(|| Error::input("up", format!("is \"{name}\", but must be x, -x, y, -y, z or -z")))?;
        Ok(if minus { Up::Minus(axis) } else { Up::Plus(axis) })
    }

    /// Returns the directions that replace the world's x, y and z in an orbit: right-handed, the last upright.
    fn frame(self) -> [DVec3; 3] {
        let upright = match self {
            Up::Plus(Axis::X) => DVec3::X,
            Up::Minus(Axis::X) => DVec3::NEG_X,
            Up::Plus(Axis::Y) => DVec3::Y,
            Up::Minus(Axis::Y) => DVec3::NEG_Y,
            Up::Minus(Axis::Z) => DVec3::NEG_Z,
            Up::Plus(Axis::Z) => DVec3::Z,
        };
        let front = if upright.y == 0.0 { DVec3::Y } else { DVec3::NEG_Z };
        [front.cross(upright), front, upright]
    }
}

/// A sphere in the world around a box of grid points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Surround {
    /// World position of the box's middle.
    pub centre: [f64; 3],
    /// World distance from the centre to a corner of the box, which is extended by half a voxel on each side; above 0.
    pub radius: f64,
}

impl Surround {
    /// Returns the sphere around the grid points `low..=high`, by x, y, z.
    pub fn of_voxels(grid: &Grid, low: [u16; 3], high: [u16; 3]) -> Surround {
        let frame = WorldFrame::of(grid);
        let middle: [f64; 3] = std::array::from_fn(|a| (f64::from(low[a]) + f64::from(high[a])) / 2.0);
        let centre = frame.world_from_voxel(middle);
        let mut radius = 0.0f64;
        for corner in 0..8 {
            let point = std::array::from_fn(|a| {
                if corner >> a & 1 == 1 { f64::from(high[a]) + 0.5 } else { f64::from(low[a]) - 0.5 }
            });
            radius = radius.max(frame.world_from_voxel(point).distance(centre));
        }
        Surround { centre: centre.to_array(), radius }
    }

    /// Returns the sphere around the whole grid.
    pub fn of_grid(grid: &Grid) -> Surround {
        let VoxelBox { low, high } = VoxelBox::of_dims(grid.dims);
        Surround::of_voxels(grid, low, high)
    }
}

/// The affine map from a grid into the world.
#[derive(Debug, Clone, Copy)]
pub struct WorldFrame {
    /// World position of the first grid point.
    pub origin: DVec3,
    /// World vectors from a grid point to its next neighbour along x, y, z.
    pub steps: [DVec3; 3],
}

impl WorldFrame {
    /// Returns the map from `grid` into the world.
    pub fn of(grid: &Grid) -> WorldFrame {
        let step = |a: usize| DVec3::from_array(grid.direction[a]) * grid.spacing[a];
        WorldFrame { origin: DVec3::from_array(grid.origin), steps: [step(0), step(1), step(2)] }
    }

    /// Returns the world position of a point in voxel coordinates.
    pub fn world_from_voxel(&self, voxel: [f64; 3]) -> DVec3 {
        self.origin + self.steps[0] * voxel[0] + self.steps[1] * voxel[1] + self.steps[2] * voxel[2]
    }

    /// Converts a vector from world to voxel coordinates.
    pub fn voxel_from_world_vector(&self, vector: DVec3) -> [f64; 3] {
        let [x, y, z] = self.steps;
        // Cramer's rule on unit vectors: a product of three spacings may overflow.
        let [ux, uy, uz] = [x.normalize(), y.normalize(), z.normalize()];
        let determinant = ux.dot(uy.cross(uz));
        [
            vector.dot(uy.cross(uz)) / determinant / x.length(),
            vector.dot(uz.cross(ux)) / determinant / y.length(),
            vector.dot(ux.cross(uy)) / determinant / z.length(),
        ]
    }
}

/// Range of vector lengths whose squares neither overflow nor lose precision.
pub(crate) const SOUND_LENGTHS: std::ops::RangeInclusive<f64> = 1e-150..=1e150;

/// Factor on the sphere's radius that leaves a margin between the sphere and the picture's edge.
const MARGIN: f64 = 1.04;

impl Camera {
    /// Returns an [`Orbit`]: a parallel view from `azimuth` and `elevation`, in degrees, with everything in the picture.
    pub fn orbit(azimuth: f64, elevation: f64) -> Orbit {
        Orbit { azimuth, elevation, ..Orbit::default() }
    }

    /// Returns a camera at `position` that looks at `target`, in world coordinates.
    ///
    /// If `up` is parallel to the view, the world axis farthest from the view replaces it.
    ///
    /// # Errors
    /// [`Error::Input`] if a number is not finite or out of range, position and target coincide, or up has length 0.
    pub fn new(position: [f64; 3], target: [f64; 3], up: [f64; 3], projection: Projection) -> Result<Camera> {
        for (name, vector) in [("camera position", position), ("camera target", target), ("camera up", up)] {
            let is_finite = vector.iter().all(|c| c.is_finite());
            require(is_finite, name, format_args!("is {vector:?}, but must be finite"))?;
        }
        let [position, target, up] = [position, target, up].map(DVec3::from_array);
        require(target != position, "camera target", "is where the camera is; it must look somewhere")?;
        let is_direction = SOUND_LENGTHS.contains(&(target - position).length());
        require(is_direction, "camera target", "is too near to the camera or too far from it for a direction")?;
        let why = "has length 0, or one beyond 1e-150 to 1e150";
        require(SOUND_LENGTHS.contains(&up.length()), "camera up", why)?;
        match projection {
            Projection::Parallel { height } => require_positive(height, "camera height")?,
            Projection::Perspective { fov } => require_angle(fov, "camera angle of view")?,
        }
        Ok(Camera { position, target, up, projection })
    }

    /// Returns the camera of an orbit: at zoom 1, all of `around` fits into a picture of `size` (columns, rows).
    ///
    /// # Errors
    /// [`Error::Input`] if a number of the orbit is out of its range or `size` is 0.
    pub fn orbiting(orbit: Orbit, around: Surround, size: [u32; 2]) -> Result<Camera> {
        require_pixels(size)?;
        let [_, up, outward] = orbit.axes()?;
        let Orbit { zoom, fov, .. } = orbit;
        let centre = DVec3::from_array(around.centre);
        let radius = around.radius * MARGIN;
        // The sphere fits the picture's smaller side.
        let tall = (f64::from(size[1]) / f64::from(size[0])).max(1.0);
        let (distance, projection) = match fov {
            None => (2.0 * radius, Projection::Parallel { height: 2.0 * radius * tall / zoom }),
            Some(fov) => {
                let tangent = (fov.to_radians() / 2.0).tan();
                let distance = radius / (tangent / tall).atan().sin();
                let zoomed = 2.0 * (tangent / zoom).atan().to_degrees();
                (distance, Projection::Perspective { fov: zoomed })
            }
        };
        Camera::new((centre + outward * distance).to_array(), around.centre, up.to_array(), projection)
    }

    /// Returns the position of the eye.
    pub fn position(&self) -> [f64; 3] {
        self.position.to_array()
    }

    /// Returns a point of the axis of view from which places on the picture are measured: the eye, or the target of a
    /// parallel camera, whose eye may be so far away that differences from it have no digits.
    pub fn anchor(&self) -> [f64; 3] {
        match self.projection {
            Projection::Parallel { .. } => self.target.to_array(),
            Projection::Perspective { .. } => self.position.to_array(),
        }
    }

    /// Returns the projection.
    pub fn projection(&self) -> Projection {
        self.projection
    }

    /// Returns this camera with a view `ratio` times as high, for a picture with `ratio` times as many rows.
    pub(crate) fn with_height_times(self, ratio: f64) -> Camera {
        let projection = match self.projection {
            Projection::Parallel { height } => Projection::Parallel { height: ratio * height },
            Projection::Perspective { fov } => {
                Projection::Perspective { fov: 2.0 * (ratio * (fov.to_radians() / 2.0).tan()).atan().to_degrees() }
            }
        };
        Camera { projection, ..self }
    }

    /// Returns unit world vectors to the picture's right, to its top, and forward along the view.
    pub fn axes(&self) -> [DVec3; 3] {
        let forward = (self.target - self.position).normalize();
        let up = self.up.normalize();
        let right = forward.cross(up);
        let right = if right.length() > 1e-9 {
            right.normalize()
        } else {
            let farthest = [DVec3::Z, DVec3::Y, DVec3::X]
                .into_iter()
                .min_by(|a, b| forward.dot(*a).abs().total_cmp(&forward.dot(*b).abs()));
            forward.cross(farthest.unwrap_or(DVec3::Z)).normalize()
        };
        [right, right.cross(forward), forward]
    }
}

/// Returns an input error that names `what`, unless the angle of view is above 0 and below 180 degrees.
fn require_angle(fov: f64, what: &str) -> Result<()> {
    require(fov > 0.0 && fov < 180.0, what, format_args!("is {fov} degrees, but must be above 0 and below 180"))
}

/// Returns the sine and cosine of an angle in degrees: exact at multiples of 90, the same after whole turns.
fn sin_cos_degrees(angle: f64) -> (f64, f64) {
    let turned = angle.rem_euclid(360.0);
    let quarter = (turned / 90.0).round();
    let (sin, cos) = (turned - 90.0 * quarter).to_radians().sin_cos();
    match quarter {
        1.0 => (cos, -sin),
        2.0 => (-sin, -cos),
        3.0 => (-cos, sin),
        _ => (sin, cos),
    }
}

impl TryFrom<CameraDocument> for Camera {
    type Error = Error;

    fn try_from(document: CameraDocument) -> Result<Camera> {
        let projection = match (document.fov, document.height) {
            (Some(fov), None) => Projection::Perspective { fov },
            (None, Some(height)) => Projection::Parallel { height },
            _ => return Err(Error::input("camera", "needs one of two: `fov` in degrees or `height` in world length")),
        };
        Camera::new(document.position, document.target, document.up, projection)
    }
}

impl From<Camera> for CameraDocument {
    fn from(camera: Camera) -> CameraDocument {
        let (fov, height) = match camera.projection {
            Projection::Parallel { height } => (None, Some(height)),
            Projection::Perspective { fov } => (Some(fov), None),
        };
        CameraDocument {
            position: camera.position.to_array(),
            target: camera.target.to_array(),
            up: camera.up.to_array(),
            fov,
            height,
        }
    }
}
