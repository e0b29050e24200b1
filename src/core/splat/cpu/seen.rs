//! Which voxels a view shows.
//!
//! In: a frame's stages, between projection and drawing. Out: the records of the splats that find, at any pixel of
//! their footprint, a transmittance of at least the stopping threshold before they are drawn. Splats that are not
//! listed were not looked at only because all of their pixels were below it: such a view changes by less than the
//! threshold if all voxels go that it does not show.
//!
//! A block's splats are looked at before any of them is drawn, so that splats of one block do not hide each other:
//! that errs on the side of what is seen.

use super::planes::Planes;
use super::project::{Kind, Projector, Voxels};
use super::raster::{BLOCK, Centre, EllipseEach, Ellipses as _, Kernel, Limits, Splats};
use crate::arena::RecordSet;
use crate::splat::kernel::Ellipse;

/// Where a view notes what it shows: the records from `first` on of its lane.
#[derive(Debug, Clone, Copy)]
pub struct Seen<'a> {
    pub records: &'a RecordSet,
    pub first: usize,
}

impl Seen<'_> {
    /// Adds the shown ones of the splats of a block.
    #[inline(always)]
    pub(super) fn note(
        &self,
        projector: &Projector,
        voxels: &Voxels,
        splats: &Splats,
        each: &EllipseEach,
        planes: &Planes,
        limits: Limits,
    ) {
        for k in 0..splats.count.min(BLOCK) {
            let j = usize::from(splats.kept[k]) % BLOCK;
            let Some(record) = voxels.records[j].checked_sub(self.first) else { continue };
            if record >= self.records.len() || self.records.contains(record) {
                continue;
            }
            let ellipse = match &projector.kind {
                Kind::Parallel { ellipse, .. } => *ellipse,
                Kind::Perspective { .. } => each.at(j),
            };
            if shows(splats, j, ellipse, planes, limits) {
                self.records.insert(record);
            }
        }
    }
}

/// Whether a splat finds an open pixel.
#[inline(always)]
fn shows(splats: &Splats, j: usize, ellipse: Ellipse, planes: &Planes, limits: Limits) -> bool {
    let rect = planes.rect;
    let (low_x, high_x) = (splats.low_x[j].max(rect.x0), splats.high_x[j].min(rect.x1 - 1));
    let (low_y, high_y) = (splats.low_y[j].max(rect.y0), splats.high_y[j].min(rect.y1 - 1));
    let centre = Centre { x: splats.x[j], y: splats.y[j], rest_x: splats.rest_x[j], rest_y: splats.rest_y[j] };
    let kernel = Kernel { centre, ellipse, cut: limits.cut, peak: 1.0 };
    for y in low_y..=high_y {
        for x in low_x..=high_x {
            if planes.pixel(x, y)[3] >= limits.stop && kernel.depth(x, y) > 0.0 {
                return true;
            }
        }
    }
    false
}
