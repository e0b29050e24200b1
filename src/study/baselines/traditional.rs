//! Traditional splatting: every grid point is visited, in order, and what is visible is drawn.
//!
//! In: a subject. Out: the paper's 17 bytes for every grid point: value 1, colour 4, gradient 12. The test of
//! visibility reads one byte, the opacity.
//!
//! The three attributes are arrays of their own: as one 17-byte record the test would fetch all of it, and a walk of a
//! mostly empty volume takes as long as the memory that it fetches.
//!
//! Source: Westover, "Footprint Evaluation for Volume Rendering", SIGGRAPH 1990; sizes by Orchard and Möller 2001,
//! section 4.2.

use super::appearance::Appearance;
use super::room::{check, filled, product};
use super::{Normal, Receiver, Viewing, Walker, placed};
use crate::Subject;
use crate::trace::{Array, Trace};
use adjsplat::error::Result;

const VALUES: usize = 0;
const COLOURS: usize = 1;
const GRADIENTS: usize = 2;

/// A dense volume of values, colours and gradients.
#[derive(Debug)]
pub struct Traditional {
    dims: [usize; 3],
    values: Vec<u8>,
    /// Red, green, blue, opacity; opacity 0 is not visible.
    colours: Vec<[u8; 4]>,
    gradients: Vec<[f32; 3]>,
}

impl Traditional {
    /// The volume of `subject`; 17 bytes a grid point.
    ///
    /// # Errors
    /// [`Error::Limit`](adjsplat::Error::Limit) if memory cannot be had; as [`Subject::looks`].
    pub fn new(subject: &Subject) -> Result<Traditional> {
        let points = product(subject.dims().map(u64::from));
        check("the dense volume", points.saturating_mul(17))?;
        let mut volume = Traditional {
            dims: subject.dims().map(|d| d as usize),
            values: filled("the dense volume's values", points, 0)?,
            colours: filled("the dense volume's colours", points, [0; 4])?,
            gradients: filled("the dense volume's gradients", points, [0.0; 3])?,
        };
        let appearance = Appearance::of(subject)?;
        for voxel in &subject.voxels {
            let [x, y, z] = voxel.position.map(usize::from);
            let index = (z * volume.dims[1] + y) * volume.dims[0] + x;
            volume.values[index] = voxel.value;
            volume.colours[index] = appearance.colour(voxel);
            volume.gradients[index] = appearance.gradient(voxel);
        }
        Ok(volume)
    }
}

impl Walker for Traditional {
    fn method(&self) -> &'static str {
        "traditional"
    }

    fn arrays(&self) -> Vec<Array> {
        vec![
            Array::of("values", &self.values),
            Array::of("colours", &self.colours),
            Array::of("gradients", &self.gradients),
        ]
    }

    fn walk<R: Receiver, T: Trace>(&mut self, viewing: &Viewing, receiver: &mut R, trace: &mut T) {
        let order = &viewing.order;
        let stride = [1, self.dims[0], self.dims[0] * self.dims[1]];
        let coordinates = |axis: usize| (0..=u16::MAX).take(self.dims[axis]).collect::<Vec<u16>>();
        let [slow, medium, fast] = [order.slow, order.medium, order.fast].map(|axis| axis.index());
        let [slow_all, medium_all, fast_all] = [slow, medium, fast].map(coordinates);
        let mut position = [0; 3];
        order.along[slow].for_each_index(&slow_all, |s| {
            position[slow] = slow_all[s];
            order.along[medium].for_each_index(&medium_all, |m| {
                position[medium] = medium_all[m];
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
        });
    }
}
