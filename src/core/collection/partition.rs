//! Partitions: a grid cut into boxes, the cells of a lattice.
//!
//! In: where to cut each axis. Out: the boxes, and their order from a viewpoint. A plane separates any two cells, so the
//! sum of a cell's ranks along the axes orders them: of two cells that one ray meets, the nearer one has the lower rank
//! along an axis, and along no axis a higher one.

use crate::arena::Region;
use crate::error::{Error, Result};
use crate::traverse::{AxisOrder, Order, Sense, SplitForm, Viewpoint};
use crate::volume::Axis;

/// Most boxes of a partition.
const MOST_BOXES: u64 = 1 << 20;

/// Checks that there are one to three partitions of what is named `whole`.
pub(super) fn check_count(whole: &str, partitions: usize) -> Result<()> {
    match partitions {
        1..=3 => Ok(()),
        count => Err(Error::input(whole, format!("has {count} partitions, but there are 1 to 3"))),
    }
}

/// A grid that is cut into boxes by planes across its axes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Partition {
    /// For each axis: the first coordinate of each layer of boxes, ascending from 0, and the number of points.
    cuts: [Vec<u32>; 3],
}

impl Partition {
    /// Cuts a grid of `dims` points into boxes of at most `size` points along x, y, z; 0 does not cut an axis.
    ///
    /// # Errors
    /// [`Error::Input`] if a dimension is 0; [`Error::Limit`] if there are more than a million boxes.
    pub fn into_boxes(dims: [u32; 3], size: [u32; 3]) -> Result<Partition> {
        if let Some(axis) = Axis::ALL.into_iter().find(|axis| dims[axis.index()] == 0) {
            return Err(Error::input(format!("dimension {}", axis.name()), "is 0, but must be at least 1"));
        }
        let along = |a: usize| {
            let step = if size[a] == 0 { dims[a] } else { size[a] };
            (0..dims[a]).step_by(step as usize).chain([dims[a]]).collect::<Vec<u32>>()
        };
        let counted = (0..3).map(|a| u64::from(dims[a].div_ceil(if size[a] == 0 { dims[a] } else { size[a] })));
        let need = counted.fold(1, u64::saturating_mul);
        if need > MOST_BOXES {
            return Err(Error::Limit {
                what: "bricks of a collection (take larger ones)".into(),
                need,
                have: MOST_BOXES,
            });
        }
        Ok(Partition { cuts: [along(0), along(1), along(2)] })
    }

    /// Cuts a grid of `dims` points into slabs of at most `thickness` slices across `axis`.
    ///
    /// # Errors
    /// The errors of [`Partition::into_boxes`].
    pub fn into_slabs(dims: [u32; 3], axis: Axis, thickness: u32) -> Result<Partition> {
        let mut size = [0; 3];
        size[axis.index()] = thickness;
        Partition::into_boxes(dims, size)
    }

    /// Returns the partition whose boxes are `boxes`, by ascending z, then y, then x; `None` if they are no cells of a
    /// lattice that fills a grid of `dims` points, each once and in this order.
    pub fn of_boxes(dims: [u32; 3], boxes: &[Region]) -> Option<Partition> {
        let mut cuts: [Vec<u32>; 3] = std::array::from_fn(|a| boxes.iter().map(|part| part.low()[a]).collect());
        for (cuts, points) in cuts.iter_mut().zip(dims) {
            cuts.push(points);
            cuts.sort_unstable();
            cuts.dedup();
        }
        let partition = Partition { cuts };
        (partition.len() == boxes.len() && partition.boxes().eq(boxes.iter().cloned())).then_some(partition)
    }

    /// Returns the partitions into slabs of at most `thickness` slices across z, across y and across x, in this order.
    /// With all three, pictures brick by brick are exact from every side.
    ///
    /// # Errors
    /// The errors of [`Partition::into_boxes`].
    pub fn into_slabs_of_all_axes(dims: [u32; 3], thickness: u32) -> Result<[Partition; 3]> {
        let across = |axis| Partition::into_slabs(dims, axis, thickness);
        Ok([across(Axis::Z)?, across(Axis::Y)?, across(Axis::X)?])
    }

    /// Returns the partition of the grid of which `factors` points along each axis become one.
    ///
    /// `None` if boxes share such points, or if a box is so thin that it would not be halved by itself.
    pub(super) fn coarser(&self, factors: [u32; 3]) -> Option<Partition> {
        let mut coarse = self.clone();
        for (cuts, factor) in coarse.cuts.iter_mut().zip(factors) {
            let (end, is_cut) = (*cuts.last()?, cuts.len() > 2);
            let is_shared = cuts.iter().any(|&cut| cut != end && cut % factor != 0);
            let is_thin = is_cut && cuts.windows(2).any(|ends| ends[1] - ends[0] < factor);
            if is_shared || is_thin {
                return None;
            }
            cuts.iter_mut().for_each(|cut| *cut = cut.div_ceil(factor));
        }
        Some(coarse)
    }

    /// Returns the number of points of the grid.
    pub(super) fn dims(&self) -> [u32; 3] {
        self.cuts.each_ref().map(|cuts| *cuts.last().expect("every axis ends"))
    }

    /// Returns whether no axis but `axis` is cut.
    pub(super) fn cuts_only(&self, axis: Axis) -> bool {
        axis.others().into_iter().all(|other| self.cuts[other.index()].len() == 2)
    }

    /// Returns the number of boxes.
    #[expect(clippy::len_without_is_empty, reason = "a grid has at least one point, so there is a box")]
    pub fn len(&self) -> usize {
        self.cuts.iter().map(|cuts| cuts.len().saturating_sub(1)).fold(1, usize::saturating_mul)
    }

    /// Iterates over the boxes by ascending z, then y, then x.
    pub fn boxes(&self) -> impl Iterator<Item = Region> + '_ {
        let [xs, ys, zs] = self.cuts.each_ref().map(|cuts| cuts.windows(2).map(|ends| ends[0]..ends[1]));
        zs.flat_map(move |zs| {
            let xs = xs.clone();
            ys.clone().flat_map(move |ys| {
                let zs = zs.clone();
                xs.clone().map(move |xs| Region { xs, ys: ys.clone(), zs: zs.clone() })
            })
        })
    }

    /// Returns the indices of all boxes, nearest first, in an order in which no box hides an earlier one.
    ///
    /// # Errors
    /// [`Error::Input`] if the viewpoint cannot be used.
    pub fn front_to_back(&self, viewpoint: Viewpoint) -> Result<Vec<usize>> {
        let order = Order::new(viewpoint, self.dims(), Sense::FrontToBack, SplitForm::default())?;
        let ranks: [Vec<usize>; 3] = std::array::from_fn(|a| {
            let layers = self.cuts[a].len() - 1;
            match order.along[a] {
                AxisOrder::Ascending => (0..layers).collect(),
                AxisOrder::Descending => (0..layers).rev().collect(),
                AxisOrder::TwoSided { eye, .. } => {
                    // A box ends half-way between its last point and the next box's first.
                    let before = self.cuts[a][..layers].partition_point(|&cut| f64::from(cut) - 0.5 <= eye);
                    let own = before.saturating_sub(1);
                    (0..layers).map(|layer| layer.abs_diff(own)).collect()
                }
            }
        });
        let [columns, rows] = [ranks[0].len(), ranks[1].len()];
        let rank = |index: &usize| {
            let layers = [index % columns, index / columns % rows, index / (columns * rows)];
            (0..3).map(|a| ranks[a][layers[a]]).sum::<usize>()
        };
        let mut indices: Vec<usize> = (0..self.len()).collect();
        indices.sort_by_key(rank);
        Ok(indices)
    }
}
