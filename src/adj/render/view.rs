//! The flags for where the camera is: `--azimuth`, `--camera` and others.

use std::path::Path;

use clap::Args;

use super::super::values::{Crop, clip_plane, crop, library, number, picture_size};
use adjsplat::error::{Error, Result};
use adjsplat::internals::read_text;
use adjsplat::splat::{Camera, ClipPlane, Orbit, Outline, Up};

/// Most bytes of a camera's file.
const CAMERA_BYTES: u64 = 1 << 20;

/// The flags for where the camera is.
#[derive(Debug, Args)]
#[command(next_help_heading = "View")]
pub(super) struct ViewArguments {
    /// Columns and rows of the picture, 1 to 16384 each
    #[arg(long, value_name = "WxH", default_value = "800x800", allow_hyphen_values = true, value_parser = picture_size)]
    pub(super) size: [u32; 2],
    /// Degrees around the vertical: 0 looks from the front (at a face), 90 from the right of the picture
    #[arg(long, value_name = "DEGREES", default_value_t = 0.0, allow_hyphen_values = true)]
    azimuth: f64,
    /// Degrees above the horizontal
    #[arg(long, value_name = "DEGREES", default_value_t = 0.0, allow_hyphen_values = true)]
    elevation: f64,
    /// World axis that points up, and that --azimuth turns around: x, -x, y, -y, z or -z
    #[arg(long, value_name = "AXIS", default_value = "z", allow_hyphen_values = true, value_parser = library(Up::from_name))]
    up: Up,
    /// Magnification, above 0; at 1 what is visible fills 90 % of the picture's width or height
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, allow_hyphen_values = true)]
    zoom: f64,
    /// Draw in perspective, with this vertical angle of view (above 0, below 180); parallel by default
    #[arg(long, value_name = "DEGREES", allow_hyphen_values = true)]
    pub(super) perspective: Option<f64>,
    /// Camera in world coordinates, as JSON or a file of it: position, target, up, and fov or height
    #[arg(long, value_name = "JSON|FILE", conflicts_with_all = ["azimuth", "elevation", "up", "zoom", "perspective"])]
    pub(super) camera: Option<String>,
    /// Frames of a full turn around the vertical, 1 to 100000: numbered files, or one .apng
    #[arg(long, value_name = "N", default_value_t = 1, allow_hyphen_values = true, value_parser = number(1..=100_000u32))]
    pub(super) frames: u32,
    /// Draw only voxels in this box of indices, ends included: 0..127,..63,10..
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = crop)]
    pub(super) crop: Option<Crop>,
    /// Draw only voxels in front of a plane: a point of it, and the direction to the side that is drawn, both in world
    /// coordinates (`adj info` shows the origin and the spacing): 0,0,40,0,0,1
    #[arg(long, value_name = "X,Y,Z,NX,NY,NZ", value_parser = clip_plane, allow_hyphen_values = true)]
    pub(super) clip: Option<ClipPlane>,
}

/// Returns the camera of every frame: all frame `outline` at one scale, or are the one of `--camera`.
pub(super) fn cameras(view: &ViewArguments, outline: &Outline, size: [u32; 2]) -> Result<Vec<Camera>> {
    if let Some(camera) = &view.camera {
        if view.frames > 1 {
            return Err(Error::input("--camera", "is one view; leave out --frames, or use --azimuth and --elevation"));
        }
        let (text, name) = match camera.trim_start().starts_with('{') {
            true => (camera.clone(), "--camera"),
            false => (read_text(Path::new(camera), CAMERA_BYTES)?, camera.as_str()),
        };
        return serde_json::from_str(&text)
            .map(|camera| vec![camera])
            .map_err(|fault| Error::input(name, fault.to_string()));
    }
    let orbit = |frame_index| Orbit {
        azimuth: view.azimuth + 360.0 * f64::from(frame_index) / f64::from(view.frames),
        elevation: view.elevation,
        zoom: view.zoom,
        fov: view.perspective,
        up: view.up,
    };
    Camera::framing(&(0..view.frames).map(orbit).collect::<Vec<_>>(), outline, size)
}
