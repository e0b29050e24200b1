//! The traced twin of our walk, held to the walk itself: the same batches, and the same tiles, line ends and lines in
//! the same sequence as the walk tells its pager.
//!
//! What they cannot catch: scratch arrays, which no pager is told of. That every batch which is handed over was written
//! where its reads say, the last test checks.

use std::sync::Mutex;

use adjsplat::arena::Record;
use adjsplat::arena::layout::line_end_bytes;
use adjsplat::arena::{Lane, OwnedLane, Pager, TileOrder};
use adjsplat::traverse::{AxisOrder, Batch, Order, Sense, SplitForm, Viewpoint, walk};
use adjsplat::volume::Axis;
use adjsplat_study::Trace;
use adjsplat_study::Walker;
use adjsplat_study::lane_walk::{CodesRead, OwnWalk};
use adjsplat_tests::scenes::{LIT, lane};
use adjsplat_tests::walks::parallel_orders;
use zerocopy::IntoBytes as _;

/// Lanes of a volume of which about one voxel in `sparsity` is visible, in clumps.
fn lanes(dims: [u32; 3], sparsity: u64, tile_order: TileOrder) -> [OwnedLane; 3] {
    let visible = |[x, y, z]: [u32; 3]| {
        let clump = u64::from(x / 3) << 40 | u64::from(y / 2) << 20 | u64::from(z / 2);
        let mixed = (clump ^ clump >> 17).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        (mixed >> 33).is_multiple_of(sparsity)
    };
    let record = Record { value: 7, normal: 9, magnitude: 0, coverage: 0 };
    Axis::ALL.map(|axis| lane(axis, dims, LIT, tile_order, |at| visible(at.map(u32::from)).then_some(record)))
}

/// What happens on a walk, as both can tell it.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Event {
    /// A tile's record is read.
    Tile(usize),
    /// Ends of lines of the tile with this first line are read.
    Ends(usize),
    /// A line's steps are read: its first record, and the records up to which reading may go.
    Steps(usize, usize),
    /// A batch: slice, mediums, coordinates, records.
    Batch(u16, Vec<u16>, Vec<u16>, Vec<usize>),
}

fn batch_event(batch: &Batch) -> Event {
    let records = (0..batch.len()).map(|index| batch.record_index(index)).collect();
    Event::Batch(batch.slow, batch.medium.to_vec(), batch.fast.to_vec(), records)
}

/// Notes what the walk tells, by where the bytes lie in the lane.
#[derive(Debug)]
struct Listener {
    /// Addresses at which tiles, line ends and steps start and end, and bytes of an end.
    tiles: (usize, usize),
    ends: (usize, usize),
    steps: (usize, usize),
    end_bytes: usize,
    events: Mutex<Vec<Event>>,
}

fn addresses(bytes: &[u8]) -> (usize, usize) {
    (bytes.as_ptr() as usize, bytes.as_ptr() as usize + bytes.len())
}

impl Pager for Listener {
    fn about_to_read(&self, bytes: &[u8]) {
        let (start, end) = addresses(bytes);
        let within = |range: (usize, usize)| range.0 <= start && end <= range.1 && start < end;
        let mut events = self.events.lock().unwrap();
        if within(self.tiles) {
            events.extend(((start - self.tiles.0) / 28..(end - self.tiles.0) / 28).map(Event::Tile));
        } else if within(self.ends) {
            events.push(Event::Ends((start - self.ends.0) / self.end_bytes));
        } else if within(self.steps) {
            events.push(Event::Steps(start - self.steps.0, end - self.steps.0));
        }
    }
}

/// What the walk itself tells.
fn told(lane: &Lane, order: &Order) -> Vec<Event> {
    let end_bytes = usize::from(line_end_bytes(lane.dims[lane.axis.index()]));
    let listener = Listener {
        tiles: addresses(lane.tiles.as_bytes()),
        ends: addresses(lane.line_ends.as_bytes()),
        steps: addresses(lane.steps),
        end_bytes,
        events: Mutex::default(),
    };
    let listened = Lane { pager: Some(&listener), ..*lane };
    walk(&listened, order, &mut |batch: &Batch| listener.events.lock().unwrap().push(batch_event(batch)));
    listener.events.into_inner().unwrap()
}

/// Notes what the twin tells of one lane's arrays.
struct Noted<'a> {
    lane: Lane<'a>,
    arrays: usize,
    /// The first line of each line's tile.
    first_lines: Vec<usize>,
    events: Vec<Event>,
    /// Records whose value and whose normal were read, in order.
    values: Vec<usize>,
    normals: Vec<usize>,
}

impl Trace for Noted<'_> {
    fn read(&mut self, array: usize, offset: usize, bytes: usize) {
        if array >= 15 {
            return;
        }
        match array - self.arrays {
            0 => self.events.push(Event::Tile(offset / 28)),
            1 => self.events.push(Event::Ends(self.first_lines[offset / bytes])),
            2 => match self.events.last_mut() {
                // Sixteen more of the line at hand: the walk's next line never starts where sixteen steps end, unless
                // it does, and then the batches tell them apart.
                Some(Event::Steps(_, end)) if *end == offset => *end = offset + bytes,
                _ => self.events.push(Event::Steps(offset, offset + bytes)),
            },
            3 => self.values.push(offset),
            4 => self.normals.push(offset / 2),
            _ => panic!("array {array} is another lane's"),
        }
        assert!(offset + bytes <= self.lane.tiles.len() * 28 + self.lane.steps.len() * 4 + self.first_lines.len() * 4);
    }

    fn write(&mut self, array: usize, _: usize, _: usize) {
        assert!(array >= 15, "a walk does not write array {array}");
    }
}

/// Each event once where it comes several times in a row; lines of steps as the set of records that they cover, by
/// batch, because the walk tells of a group's lines first and decodes them then.
fn essence(events: Vec<Event>) -> (Vec<Event>, Vec<Vec<usize>>) {
    let mut directory: Vec<Event> = Vec::new();
    let mut covered: Vec<Vec<usize>> = vec![Vec::new()];
    for event in events {
        match event {
            Event::Steps(start, end) => covered.last_mut().unwrap().extend(start..end),
            event => {
                if matches!(event, Event::Batch(..)) {
                    covered.push(Vec::new());
                }
                if directory.last() != Some(&event) {
                    directory.push(event);
                }
            }
        }
    }
    for records in &mut covered {
        records.sort_unstable();
        records.dedup();
    }
    (directory, covered)
}

fn orders(dims: [u32; 3]) -> impl Iterator<Item = Order> {
    let eye = dims.map(|points| f64::from(points) * 0.4);
    let perspective = [SplitForm::Split, SplitForm::Interleaved].into_iter().flat_map(move |form| {
        [Sense::BackToFront, Sense::FrontToBack].into_iter().flat_map(move |sense| {
            [[3.0, 2.0, 1.0], [1.0, 3.0, 2.0], [-2.0, 1.0, 3.0]]
                .map(|toward| Order::new(Viewpoint::Perspective { eye, toward }, dims, sense, form).unwrap())
        })
    });
    parallel_orders().chain(perspective)
}

/// Small enough for a pager not to cut groups of lines: lanes of less than 2^16 records, or two such pieces.
fn scenes() -> [([u32; 3], u64, TileOrder); 4] {
    [
        ([40, 33, 50], 5, TileOrder::Morton),
        ([61, 24, 17], 40, TileOrder::Rows),
        ([9, 900, 11], 300, TileOrder::Hilbert),
        ([1200, 20, 3], 9, TileOrder::Morton),
    ]
}

#[test]
fn the_twin_reads_what_the_walk_tells_its_pager() {
    for (dims, sparsity, tile_order) in scenes() {
        let lanes = lanes(dims, sparsity, tile_order);
        let views = lanes.each_ref().map(OwnedLane::view);
        for order in orders(dims) {
            let lane = views[order.fast.index()];
            let mut first_lines = vec![0; lane.line_ends.len()];
            for tile in lane.tiles {
                let first = tile.first_line.get() as usize;
                first_lines[first..first + tile.occupancy.get().count_ones() as usize].fill(first);
            }
            let arrays = 5 * order.fast.index();
            let mut noted = Noted { lane, arrays, first_lines, events: vec![], values: vec![], normals: vec![] };
            let mut batches = Vec::new();
            let own = OwnWalk::new(views, CodesRead::ValuesAndNormals);
            own.walk_batches(&order, &mut noted, &mut |batch| batches.push(batch_event(batch)));
            // Reads of channels come after each batch is handed over; steps, ends and tiles before.
            let told = told(&lane, &order);
            let walked: Vec<Event> = told.iter().filter(|e| matches!(e, Event::Batch(..))).cloned().collect();
            assert_eq!(batches, walked, "{dims:?} {order:?}: batches");

            let records: Vec<usize> = walked
                .iter()
                .flat_map(|event| if let Event::Batch(.., records) = event { records.clone() } else { vec![] })
                .collect();
            assert_eq!(noted.values, records, "{dims:?} {order:?}: values are read in visit order");
            assert_eq!(noted.normals, records, "{dims:?} {order:?}: normals are read in visit order");

            let (of_walk, steps_of_walk) = essence(told);
            let of_walk: Vec<Event> = of_walk.into_iter().filter(|e| !matches!(e, Event::Batch(..))).collect();
            let (of_twin, steps_of_twin) = essence(noted.events);
            assert_eq!(once_in_a_row(of_twin), once_in_a_row(of_walk), "{dims:?} {order:?}: tiles and ends");
            // The walk tells of up to sixteen steps past a line, the twin reads whole sixteens that hold the line.
            let all = |groups: Vec<Vec<usize>>| groups.into_iter().flatten().collect::<std::collections::BTreeSet<_>>();
            let (of_walk, of_twin) = (all(steps_of_walk), all(steps_of_twin));
            assert!(of_twin.is_subset(&of_walk), "{dims:?} {order:?}: steps");
            assert!(
                of_twin.len() >= lane.steps.len() && of_twin.len() == of_walk.len(),
                "{dims:?} {order:?}: all steps"
            );
        }
    }
}

fn once_in_a_row(mut events: Vec<Event>) -> Vec<Event> {
    events.dedup();
    events
}

/// The lines of steps of each batch, in the sequence in which they are decoded, by their first record.
#[test]
fn lines_are_decoded_in_the_order_of_the_walk() {
    for (dims, sparsity, tile_order) in scenes() {
        let lanes = lanes(dims, sparsity, tile_order);
        let views = lanes.each_ref().map(OwnedLane::view);
        for order in orders(dims) {
            let lane = views[order.fast.index()];
            // First records of lines, as the walk tells of them.
            let mut expected = Vec::new();
            let mut group = Vec::new();
            let along = order.along[order.fast.index()];
            for event in told(&lane, &order) {
                match event {
                    Event::Steps(start, _) => group.push(start),
                    Event::Batch(..) => {
                        match along {
                            AxisOrder::Descending => group.reverse(),
                            // Batches are filled from their end, four lines at a time.
                            AxisOrder::TwoSided { sense: Sense::FrontToBack, .. } => {
                                group = group.rchunks(4).flatten().copied().collect();
                            }
                            _ => {}
                        }
                        expected.append(&mut group);
                    }
                    _ => {}
                }
            }
            let starts: std::collections::BTreeSet<usize> = lane.lines().map(|line| line.records.start).collect();
            let mut reads = StepReads { array: 5 * order.fast.index() + 2, starts: vec![], lines: starts, next: None };
            OwnWalk::new(views, CodesRead::Nothing).walk_batches(&order, &mut reads, &mut |_| {});
            // With the eye inside, a line with stepping voxels is read twice.
            reads.starts.dedup();
            assert_eq!(reads.starts, expected, "{dims:?} {order:?}");
        }
    }
}

/// Notes reads of steps that start a line: all but those that go on sixteen further.
struct StepReads {
    array: usize,
    starts: Vec<usize>,
    lines: std::collections::BTreeSet<usize>,
    next: Option<usize>,
}

impl Trace for StepReads {
    fn read(&mut self, array: usize, offset: usize, _: usize) {
        if array == self.array {
            // A line may start where sixteen steps of the one before end: it goes on only inside its line.
            if self.next != Some(offset) || self.lines.contains(&offset) {
                self.starts.push(offset);
            }
            self.next = Some(offset + 16);
        }
    }

    fn write(&mut self, _: usize, _: usize, _: usize) {}
}

#[test]
fn scratch_is_written_before_it_is_read() {
    /// A mark for each byte that was written.
    struct Written(Vec<Vec<bool>>);
    impl Trace for Written {
        fn read(&mut self, array: usize, offset: usize, bytes: usize) {
            // Counters of a sort start as zeros without being written by the walk's own loops.
            if array >= 15 && !(18..22).contains(&array) {
                assert!(self.0[array][offset..offset + bytes].iter().all(|&w| w), "array {array} at {offset}");
            }
        }
        fn write(&mut self, array: usize, offset: usize, bytes: usize) {
            self.0[array][offset..offset + bytes].fill(true);
        }
    }
    for (dims, sparsity, tile_order) in scenes() {
        let lanes = lanes(dims, sparsity, tile_order);
        let own = OwnWalk::new(lanes.each_ref().map(OwnedLane::view), CodesRead::ValuesAndNormals);
        for order in orders(dims) {
            let mut written = Written(own.arrays().iter().map(|array| vec![false; array.bytes as usize]).collect());
            own.walk_batches(&order, &mut written, &mut |_| {});
        }
    }
}
