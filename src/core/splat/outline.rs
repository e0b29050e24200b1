//! Outlines: how far visible voxels reach in any direction, and cameras that fit them into a picture.
//!
//! In: the lane along x (or those of several bricks, or boxes of voxels), and orbits. Out: cameras in which what is visible fills [`FILL`] of the
//! picture's width or height.

use glam::DVec3;

use super::camera::{Camera, Orbit, Projection, SOUND_LENGTHS, WorldFrame};
use super::{require, require_pixels};
use crate::arena::Lane;
use crate::arena::layout::TileRecord;
use crate::error::Result;
use crate::traverse::{VoxelBox, tile_bounds};
use crate::volume::Grid;

/// The share of the picture's width or height that a framed view fills at zoom 1; of the other it fills less.
pub const FILL: f64 = 0.9;
/// Least distance of the eye in perspective, and least height of a parallel picture, as a share of [`Outline::radius`].
const LEAST_SCALE: f64 = 0.01;

/// Most frames of a turn that are measured; the others lie between two of them, less than a degree apart.
const MEASURED: usize = 360;

/// What a camera is to fit into its picture: voxels, each with its whole cell.
#[derive(Debug, Clone)]
pub struct Outline<'a> {
    frame: WorldFrame,
    voxels: Voxels<'a>,
    /// Only voxels in this box count.
    within: VoxelBox,
    /// World position of the middle of the box around all voxels that count.
    centre: DVec3,
}

#[derive(Debug, Clone)]
enum Voxels<'a> {
    /// All voxels of these boxes.
    Boxes(Vec<VoxelBox>),
    /// The visible voxels of lanes along x, each with the place of its lowest point in the grid.
    Lanes(Vec<([u16; 3], Lane<'a>)>),
}

impl<'a> Outline<'a> {
    /// Returns the outline of all voxels in `boxes`, which lie in `grid`; of the whole grid if there are none.
    pub fn of_boxes(grid: &Grid, boxes: impl IntoIterator<Item = VoxelBox>) -> Outline<'a> {
        let mut boxes: Vec<VoxelBox> = boxes.into_iter().collect();
        if boxes.is_empty() {
            boxes.push(VoxelBox::of_dims(grid.dims));
        }
        let around = boxes.iter().copied().reduce(around).expect("there is a box");
        Outline::new(grid, Voxels::Boxes(boxes), around)
    }

    /// Returns the outline of the visible voxels of `lane`, which runs along x; with a `crop`, of those in that box.
    ///
    /// If there are none, all voxels of the grid or of the crop count.
    pub fn of_lane(grid: &Grid, lane: Lane<'a>, crop: Option<VoxelBox>) -> Outline<'a> {
        Outline::of_lanes(grid, vec![([0; 3], lane)], crop)
    }

    /// Returns the outline of the visible voxels of several lanes along x, as [`Outline::of_lane`] does; with each lane comes
    /// the place of its lowest point in `grid`.
    pub fn of_lanes(grid: &Grid, lanes: Vec<([u16; 3], Lane<'a>)>, crop: Option<VoxelBox>) -> Outline<'a> {
        let of_lane =
            |(at, lane): &([u16; 3], Lane)| lane.bounds().map(|(low, high)| moved(VoxelBox { low, high }, *at));
        let visible = lanes.iter().filter_map(of_lane).reduce(around);
        let within = crop.or(visible).unwrap_or_else(|| VoxelBox::of_dims(grid.dims));
        let counted = visible.filter(|visible| visible.meets(&within)).and_then(|visible| match crop {
            None => Some(visible),
            Some(_) => Outline::new(grid, Voxels::Lanes(lanes.clone()), within).counted(&lanes),
        });
        match counted {
            Some(counted) => Outline::new(grid, Voxels::Lanes(lanes), counted),
            None => Outline::of_boxes(grid, [within]),
        }
    }

    /// Returns the smallest box around the visible voxels of `lanes` that count; `None` if there are none.
    fn counted(&self, lanes: &[([u16; 3], Lane)]) -> Option<VoxelBox> {
        let most = |farthest: &dyn Fn(&VoxelBox) -> f64| {
            let reached = lanes.iter().map(|(at, lane)| self.farthest_voxel(*at, lane, farthest));
            reached.fold(f64::NEG_INFINITY, f64::max)
        };
        let high = [0, 1, 2].map(|a: usize| most(&|part| f64::from(part.high[a])));
        let low = [0, 1, 2].map(|a: usize| -most(&|part| -f64::from(part.low[a])));
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "an index of a box")]
        let place = |at: f64| at as u16;
        high[0].is_finite().then(|| VoxelBox { low: low.map(place), high: high.map(place) })
    }

    fn new(grid: &Grid, voxels: Voxels<'a>, within: VoxelBox) -> Outline<'a> {
        let frame = WorldFrame::of(grid);
        let middle = std::array::from_fn(|a| f64::midpoint(within.low[a].into(), within.high[a].into()));
        Outline { frame, voxels, within, centre: frame.world_from_voxel(middle) }
    }

    /// Returns a distance from the centre within which all voxels lie.
    fn radius(&self) -> f64 {
        let VoxelBox { low, high } = self.within;
        let voxels = |a: usize| (f64::from(high[a]) - f64::from(low[a])).abs() + 1.0;
        (0..3).map(|a| self.frame.steps[a].length() * voxels(a) / 2.0).sum()
    }

    /// Returns how far the voxels reach from the centre along `direction`, in units of its length.
    fn reach(&self, direction: DVec3) -> f64 {
        let slope = self.frame.steps.map(|step| step.dot(direction));
        let farthest = |part: &VoxelBox| {
            (0..3).map(|a| (slope[a] * f64::from(part.low[a])).max(slope[a] * f64::from(part.high[a]))).sum::<f64>()
        };
        let reached = match &self.voxels {
            Voxels::Boxes(boxes) => boxes.iter().map(farthest).fold(f64::NEG_INFINITY, f64::max),
            Voxels::Lanes(lanes) => {
                let farthest = lanes.iter().map(|(at, lane)| self.farthest_voxel(*at, lane, &farthest));
                farthest.fold(f64::NEG_INFINITY, f64::max)
            }
        };
        let reached = if reached.is_finite() { reached } else { farthest(&self.within) };
        let cell = slope.iter().map(|part| part.abs() / 2.0).sum::<f64>();
        reached + cell + (self.frame.origin - self.centre).dot(direction)
    }

    /// Returns the largest `farthest` of a voxel. Only those lines are read whose boxes reach farther than the voxels found so far,
    /// first those of the tile that reaches farthest: O(tiles), and O(lines) of tiles at the outline.
    fn farthest_voxel(&self, at: [u16; 3], lane: &Lane, farthest: &dyn Fn(&VoxelBox) -> f64) -> f64 {
        let bound = |part: VoxelBox| self.within.and(&part).map(|part| farthest(&part));
        // Lines of a damaged lane may share records. The first tile is read twice.
        let mut left = 2 * lane.record_count();
        let mut in_tile = |reached: f64, tile: &TileRecord| {
            let (bounds, most) = (tile_bounds(lane, tile), lane.dims[0] as usize);
            let lines = lane.tile_lines(tile, u64::MAX).filter(|line| line.records.len() <= most);
            lines.fold(reached, |reached, line| {
                let place = |c: u32| u16::try_from(c).unwrap_or(u16::MAX);
                let [y, z] = [line.u, line.v].map(place);
                let part = |[low, high]: [u16; 2]| moved(VoxelBox { low: [low, y, z], high: [high, y, z] }, at);
                if bound(part([bounds.low[0], bounds.high[0]])).is_none_or(|bound| bound <= reached) {
                    return reached;
                }
                let Some(after) = left.checked_sub(line.records.len() as u64) else { return reached };
                left = after;
                let counts = |x, record| lane.shows(record) && self.within.and(&part([place(x); 2])).is_some();
                let extent = lane.line_extent(line.records, counts);
                extent.map_or(reached, |extent| reached.max(farthest(&part(extent.map(place)))))
            })
        };
        let of_tile = |tile| bound(moved(tile_bounds(lane, tile), at));
        let bounded = lane.sweep_tiles().filter_map(|tile| Some((of_tile(tile)?, tile)));
        let Some((_, first)) = bounded.max_by(|(a, _), (b, _)| a.total_cmp(b)) else { return f64::NEG_INFINITY };
        lane.sweep_tiles().fold(in_tile(f64::NEG_INFINITY, first), |reached, tile| match of_tile(tile) {
            Some(bound) if bound > reached => in_tile(reached, tile),
            _ => reached,
        })
    }
}

/// Returns a box moved by `at`; in damaged files it ends where coordinates do.
fn moved(VoxelBox { low, high }: VoxelBox, at: [u16; 3]) -> VoxelBox {
    let moved = |corner: [u16; 3]| std::array::from_fn(|a| corner[a].saturating_add(at[a]));
    VoxelBox { low: moved(low), high: moved(high) }
}

/// Returns the smallest box around two.
fn around(one: VoxelBox, other: VoxelBox) -> VoxelBox {
    VoxelBox {
        low: std::array::from_fn(|a| one.low[a].min(other.low[a])),
        high: std::array::from_fn(|a| one.high[a].max(other.high[a])),
    }
}

impl Camera {
    /// Returns the cameras of `orbits`, for pictures of `size` (columns, rows) of what `outline` encloses.
    ///
    /// At zoom 1 it fills [`FILL`] of the picture's width or height. One orbit has it in the middle of the picture.
    /// Several, such as the frames of a turn, look at one point and have one scale, at which all of them fit.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if a number of an orbit is out of its range or `size` is 0.
    pub fn framing(orbits: &[Orbit], outline: &Outline, size: [u32; 2]) -> Result<Vec<Camera>> {
        require_pixels(size)?;
        let Some(first) = orbits.first() else { return Ok(Vec::new()) };
        let axes = orbits.iter().map(Orbit::axes).collect::<Result<Vec<_>>>()?;
        let wide = f64::from(size[0]) / f64::from(size[1]);
        // Half the picture's width and height, in units of its distance; of a parallel one, of its height.
        let tangent = first.fov.map_or(0.5, |fov| (fov.to_radians() / 2.0).tan());
        let [across, upright] = [tangent * wide * FILL, tangent * FILL];
        // A point on the edge of a picture in perspective may lie the farther out, the farther away it is.
        let bounds = |&[right, up, outward]: &[DVec3; 3]| {
            let toward = if first.fov.is_some() { outward } else { DVec3::ZERO };
            [[right, -right].map(|side| side / across + toward), [up, -up].map(|side| side / upright + toward)]
        };
        let mut offset = DVec3::ZERO;
        if let [only] = &axes[..] {
            let uneven = |[plus, minus]: [DVec3; 2]| (outline.reach(plus) - outline.reach(minus)) / 2.0;
            let [x, y] = bounds(only).map(uneven);
            offset = only[0] * (x * across) + only[1] * (y * upright);
        }
        let target = outline.centre + offset;
        let reach = |direction: DVec3| outline.reach(direction) - offset.dot(direction);
        let measured = axes.iter().step_by(orbits.len().div_ceil(MEASURED));
        // A wide angle may see all of it even from the target.
        let least = LEAST_SCALE * outline.radius();
        let scale = measured.flat_map(bounds).flatten().map(reach).fold(least, f64::max);
        // Of a parallel view the eye may be anywhere outside.
        let outside = 2.0 * (outline.radius() + offset.length());
        orbits
            .iter()
            .zip(&axes)
            .map(|(orbit, &[_, up, outward])| {
                let (distance, projection) = match orbit.fov {
                    None => (outside, Projection::Parallel { height: scale / orbit.zoom }),
                    Some(fov) => {
                        let zoomed = 2.0 * (tangent / orbit.zoom).atan().to_degrees();
                        let why = format_args!("is {:?}, which leaves no angle of view", orbit.zoom);
                        require(zoomed > 0.0 && zoomed < 180.0, "zoom", why)?;
                        let is_sound = SOUND_LENGTHS.contains(&scale) || !SOUND_LENGTHS.contains(&outline.radius());
                        let why = format_args!("is {fov:?} degrees, which is too narrow to see everything");
                        require(is_sound, "angle of view", why)?;
                        (scale, Projection::Perspective { fov: zoomed })
                    }
                };
                Camera::new((target + outward * distance).to_array(), target.to_array(), up.to_array(), projection)
            })
            .collect()
    }
}
