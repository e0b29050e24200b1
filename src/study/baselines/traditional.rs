//! Traditional splatting: every grid point is visited in slice order, and visible ones are drawn.
//!
//! Each grid point has the paper's 17 bytes: value 1, colour 4, gradient 12. The test for visibility reads only
//! opacity.
//!
//! The attributes are separate arrays. With a 17-byte record the test would fetch all of it, and a walk of a mostly
//! empty volume takes as long as fetching its memory.
//!
//! Source: Westover, "Footprint Evaluation for Volume Rendering", SIGGRAPH 1990; sizes by Orchard and Möller 2001,
//! section 4.2.

use super::allocate::{check, filled, product};
use super::appearance::Appearance;
use super::{Normal, Receiver, Viewing, Walker, coordinates, for_each_line, narrow, nesting, placed};
use crate::Subject;
use crate::trace::{Trace, WalkerArray};
use adjsplat::error::Result;

const VALUES: usize = 0;
const COLOURS: usize = 1;
const GRADIENTS: usize = 2;

/// A dense volume of values, colours and gradients.
#[derive(Debug)]
pub struct Traditional {
    dims: [u32; 3],
    values: Vec<u8>,
    /// Red, green, blue, opacity; opacity 0 marks an invisible grid point.
    colours: Vec<[u8; 4]>,
    gradients: Vec<[f32; 3]>,
}

impl Traditional {
    /// Fills the volume from `subject`; takes 17 bytes per grid point.
    ///
    /// # Errors
    /// [`Error::Limit`](adjsplat::Error::Limit) if memory cannot be had; any error of [`Subject::looks`].
    pub fn new(subject: &Subject) -> Result<Traditional> {
        let points = product(subject.dims().map(u64::from));
        check("the dense volume", points.saturating_mul(17))?;
        let mut volume = Traditional {
            dims: subject.dims(),
            values: filled("the dense volume's values", points, 0)?,
            colours: filled("the dense volume's colours", points, [0; 4])?,
            gradients: filled("the dense volume's gradients", points, [0.0; 3])?,
        };
        let [width, height, _] = volume.dims.map(|points| points as usize);
        let appearance = Appearance::of(subject)?;
        for voxel in &subject.voxels {
            let [x, y, z] = voxel.position.map(usize::from);
            let index = (z * height + y) * width + x;
            volume.values[index] = voxel.value;
            volume.colours[index] = appearance.colour(voxel);
            volume.gradients[index] = appearance.gradient(voxel);
        }
        Ok(volume)
    }
}

impl Walker for Traditional {
    fn arrays(&self) -> Vec<WalkerArray> {
        vec![
            WalkerArray::of("values", &self.values),
            WalkerArray::of("colours", &self.colours),
            WalkerArray::of("gradients", &self.gradients),
        ]
    }

    fn walk<R: Receiver, T: Trace>(&mut self, viewing: &Viewing, receiver: &mut R, trace: &mut T) {
        let order = &viewing.order;
        let [width, height, _] = self.dims.map(|points| points as usize);
        let stride = [1, width, width * height];
        let [slow, medium, fast] = nesting(order);
        let fast_all = coordinates(self.dims[fast]);
        for_each_line(order, [slow, medium], self.dims, |s, m| {
            let position = placed(placed([0; 3], slow, narrow(s)), medium, narrow(m));
            let line = s * stride[slow] + m * stride[medium];
            order.along[fast].for_each_index(&fast_all, |f| {
                let index = line + f * stride[fast];
                trace.read(COLOURS, 4 * index + 3, 1);
                if self.colours[index][3] != 0 {
                    trace.read(VALUES, index, 1);
                    trace.read(GRADIENTS, 12 * index, 12);
                    let position = placed(position, fast, fast_all[f]);
                    receiver.voxel(position, self.values[index], Normal::Vector(self.gradients[index]));
                }
            });
        });
    }
}
