//! Adjacency data structure, implementation A: linked records beside a dense volume.
//!
//! Voxels are visited in exact slice order by following links. Voxels can be added and removed at any time.
//!
//! ```text
//! cells    (w+2)(h+2)(d+2) x 5 bytes: number of the cell's record 4, intensity 1
//! records  28 bytes for each visible or virtual voxel: colour 4, gradient 12, six neighbours of 2
//! ```
//!
//! A link holds only the neighbour's coordinate on its axis, so following it reads the neighbour's cell. Virtual voxels
//! ("caps") end scan lines on the box's faces, lines of caps on its edges, and edges at its corners, which always
//! exist. Adding a voxel adds the missing caps of its three lines; removing one removes the caps of lines that become
//! empty. Freed records are reused, the last one first.
//!
//! Coordinates count from the low cap, which is at 0, so voxels begin at 1.
//!
//! Source: Orchard and Möller 2001, sections 3 and 4.2.

mod walk;

use zerocopy::little_endian::U32;

use super::allocate::{counted, filled, product, push};
use super::appearance::Appearance;
use super::placed;
use crate::Subject;
use crate::subject::VisibleVoxel;
use adjsplat::error::{Error, Result};
use adjsplat::volume::Axis;

/// Marks a cell without a record, and the end of the list of freed records.
const NONE: u32 = u32::MAX;
/// Most grid points along an axis: with the caps at both ends, coordinates fit two bytes.
const MOST_POINTS: u32 = 65_534;

/// The cell of a grid point or of a cap (a virtual voxel at the end of a line).
#[derive(Debug, Clone, Copy)]
#[repr(C)]
struct GridCell {
    record: U32,
    intensity: u8,
}

const _: () = assert!(size_of::<GridCell>() == 5);

/// A visible or virtual voxel of the structure.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
struct RecordA {
    /// Red, green, blue, opacity; opacity 0 marks a virtual voxel. A freed record holds the number of the one freed
    /// before.
    colour: [u8; 4],
    gradient: [f32; 3],
    /// For each axis, the coordinates of the next voxel below and of the next one above.
    neighbours: [u16; 6],
}

const _: () = assert!(size_of::<RecordA>() == 28);

/// A cell's coordinates, where the low cap is at 0 and grid points begin at 1.
type CellPosition = [u16; 3];

/// Implementation A of the paper's adjacency structure: linked records beside a dense volume.
#[derive(Debug)]
pub struct AdjacencyA {
    /// The high cap's coordinate along each axis; the low cap's is 0.
    last: CellPosition,
    cells: Vec<GridCell>,
    records: Vec<RecordA>,
    /// The number of the record freed last, or [`NONE`].
    freed: u32,
    visible: u64,
    virtual_voxels: u64,
    appearance: Appearance,
}

impl AdjacencyA {
    /// Adds all voxels of `subject` in scan order; takes `5(w+2)(h+2)(d+2) + 28s` bytes for s visible and virtual
    /// voxels.
    ///
    /// # Errors
    /// Any error of [`AdjacencyA::empty`] and [`AdjacencyA::insert`].
    pub fn new(subject: &Subject) -> Result<AdjacencyA> {
        let mut structure = AdjacencyA::empty(subject)?;
        for voxel in &subject.voxels {
            structure.insert(voxel)?;
        }
        structure.records.shrink_to_fit();
        Ok(structure)
    }

    /// Returns a structure without voxels for the grid of `subject`.
    ///
    /// # Errors
    /// [`Error::Limit`] if an axis has more than 65,534 points or memory cannot be had; any error of
    /// [`Subject::looks`].
    pub fn empty(subject: &Subject) -> Result<AdjacencyA> {
        let last = last_places(subject.dims())?;
        let cell = GridCell { record: U32::new(NONE), intensity: 0 };
        let mut structure = AdjacencyA {
            last,
            cells: filled("adjacency A's cells", product(last.map(|last| u64::from(last) + 1)), cell)?,
            records: Vec::new(),
            freed: NONE,
            visible: 0,
            virtual_voxels: 0,
            appearance: Appearance::of(subject)?,
        };
        for corner in 0..8 {
            structure.link([0, 1, 2].map(|a| if corner >> a & 1 == 0 { 0 } else { last[a] }))?;
        }
        Ok(structure)
    }

    /// Returns the number of visible voxels.
    pub fn visible(&self) -> u64 {
        self.visible
    }

    /// Returns the number of virtual voxels, corners included.
    pub fn virtual_voxels(&self) -> u64 {
        self.virtual_voxels
    }

    /// Adds a voxel and the missing caps of its lines, or changes an existing voxel. O(1), except for the search for
    /// its neighbours, which starts at both ends of each of its three lines.
    ///
    /// # Errors
    /// [`Error::Input`] if it lies outside the grid, [`Error::Limit`] if memory cannot be had.
    pub fn insert(&mut self, voxel: &VisibleVoxel) -> Result<()> {
        let place = self.place_of(voxel.position)?;
        if !self.holds(place) {
            self.link(place)?;
        }
        let cell = self.cell(place);
        let record = self.cells[cell].record.get() as usize;
        self.cells[cell].intensity = voxel.value;
        self.records[record].colour = self.appearance.colour(voxel);
        self.records[record].gradient = self.appearance.gradient(voxel);
        Ok(())
    }

    /// Removes the voxel at `position` and the caps of lines that become empty; returns whether it existed.
    ///
    /// # Errors
    /// [`Error::Input`] if it lies outside the grid.
    pub fn remove(&mut self, position: [u16; 3]) -> Result<bool> {
        let place = self.place_of(position)?;
        let was_there = self.holds(place);
        if was_there {
            self.unlink(place);
        }
        Ok(was_there)
    }

    fn place_of(&self, position: [u16; 3]) -> Result<CellPosition> {
        if (0..3).any(|a| position[a] >= self.last[a] - 1) {
            let why = format!("lies outside a grid of {:?} points", self.last.map(|last| last - 1));
            return Err(Error::input(format!("voxel {position:?}"), why));
        }
        Ok(position.map(|c| c + 1))
    }

    fn cell(&self, place: CellPosition) -> usize {
        let [x, y, z] = place.map(usize::from);
        let [width, height, _] = self.last.map(|last| usize::from(last) + 1);
        (z * height + y) * width + x
    }

    fn holds(&self, place: CellPosition) -> bool {
        self.cells[self.cell(place)].record.get() != NONE
    }

    /// Returns the coordinate of the existing voxel's next voxel on `axis`: above it if `up`, else below it.
    fn neighbour(&mut self, place: CellPosition, axis: usize, up: bool) -> &mut u16 {
        let record = self.cells[self.cell(place)].record.get() as usize;
        &mut self.records[record].neighbours[2 * axis + usize::from(up)]
    }

    fn is_cap(&self, place: CellPosition, axis: usize) -> bool {
        place[axis] == 0 || place[axis] == self.last[axis]
    }

    fn is_virtual(&self, place: CellPosition) -> bool {
        (0..3).any(|axis| self.is_cap(place, axis))
    }

    /// Adds a new voxel to its three lines; missing caps of the lines are added first.
    fn link(&mut self, place: CellPosition) -> Result<()> {
        self.allocate(place)?;
        for axis in 0..3 {
            if self.is_cap(place, axis) {
                continue;
            }
            for end in [0, self.last[axis]] {
                let cap = placed(place, axis, end);
                if !self.holds(cap) {
                    self.link(cap)?;
                }
            }
            let [below, above] = self.neighbours(place, axis);
            *self.neighbour(placed(place, axis, below), axis, true) = place[axis];
            *self.neighbour(placed(place, axis, above), axis, false) = place[axis];
            *self.neighbour(place, axis, false) = below;
            *self.neighbour(place, axis, true) = above;
        }
        Ok(())
    }

    /// Takes a record for the voxel at `place`, whose neighbours are at first the caps of its lines.
    fn allocate(&mut self, place: CellPosition) -> Result<()> {
        let [x, y, z] = self.last;
        let record = RecordA { colour: [0; 4], gradient: [0.0; 3], neighbours: [0, x, 0, y, 0, z] };
        let index = if self.freed == NONE {
            let count = counted("voxels of adjacency A", self.records.len() as u64 + 1)?;
            push("adjacency A's records", &mut self.records, record)?;
            count - 1
        } else {
            let index = self.freed;
            let slot = &mut self.records[index as usize];
            self.freed = u32::from_le_bytes(slot.colour);
            *slot = record;
            index
        };
        let cell = self.cell(place);
        self.cells[cell].record.set(index);
        *if self.is_virtual(place) { &mut self.virtual_voxels } else { &mut self.visible } += 1;
        Ok(())
    }

    /// Removes an existing voxel from its three lines, and the caps of lines that become empty.
    fn unlink(&mut self, place: CellPosition) {
        for axis in 0..3 {
            if self.is_cap(place, axis) {
                continue;
            }
            let [below, above] = [false, true].map(|up| *self.neighbour(place, axis, up));
            if below == 0 && above == self.last[axis] {
                for end in [below, above] {
                    let cap = placed(place, axis, end);
                    // Corners stay. A cap of two lines is already gone if the other line became empty first.
                    if self.holds(cap) && !(0..3).all(|axis| self.is_cap(cap, axis)) {
                        self.unlink(cap);
                    }
                }
            }
            if self.holds(placed(place, axis, below)) {
                *self.neighbour(placed(place, axis, below), axis, true) = above;
                *self.neighbour(placed(place, axis, above), axis, false) = below;
            }
        }
        let cell = self.cell(place);
        let record = self.cells[cell].record.get();
        self.records[record as usize].colour = self.freed.to_le_bytes();
        self.freed = record;
        self.cells[cell] = GridCell { record: U32::new(NONE), intensity: 0 };
        *if self.is_virtual(place) { &mut self.virtual_voxels } else { &mut self.visible } -= 1;
    }

    /// Returns the coordinates of the new voxel's next voxels on its line, below and above. The search starts from both
    /// ends of the line, so that voxels that come in ascending or descending order take one step.
    fn neighbours(&mut self, place: CellPosition, axis: usize) -> [u16; 2] {
        let (mut below, mut above) = (0, self.last[axis]);
        loop {
            let next = *self.neighbour(placed(place, axis, below), axis, true);
            if next > place[axis] {
                return [below, next];
            }
            below = next;
            let next = *self.neighbour(placed(place, axis, above), axis, false);
            if next < place[axis] {
                return [next, above];
            }
            above = next;
        }
    }
}

/// Returns the high caps' coordinates for a grid of `dims` points, or an error if one does not fit two bytes.
pub(super) fn last_places(dims: [u32; 3]) -> Result<[u16; 3]> {
    let mut last = [0; 3];
    for axis in Axis::ALL {
        let points = dims[axis.index()];
        if points > MOST_POINTS {
            let what = format!("grid points along {} of an adjacency structure", axis.name());
            return Err(Error::Limit { what, need: points.into(), have: MOST_POINTS.into() });
        }
        last[axis.index()] = u16::try_from(points + 1).expect("bounded above");
    }
    Ok(last)
}
