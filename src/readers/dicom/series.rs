//! Sorts frames into one stack: finds which frames belong together, their order, and their distances.
//!
//! In: the frames of all files. Out: the frames of one series, sorted along their normal, with the grid that they form
//! and notes on gaps and guesses. Frames belong together if they share series, size, sample type, orientation and pixel
//! spacing. If there are several such groups, the caller chooses one.
//!
//! ```text
//! t = position . (row x column), for each frame; sort by t
//! two at one t                       refused: they are other echoes or other times
//! gap = median of the steps in t     a step that differs by 1 % is noted, as missing slices or as uneven
//! z axis = from the first position to the last, so that a tilted gantry gives a sheared grid
//! ```
//!
//! Source: DICOM PS3.3, C.7.6.2.1.1 (position and orientation).

use super::elements;
use super::image::{DicomFrame, ImageFile, ImagePlane, circumstances};
use crate::frame::{FileFrame, IDENTITY, World, cross, dot, length};
use crate::open::file_name;
use adjsplat::error::{Error, Result};

/// The largest number of series that an error message lists.
const MOST_LISTED: usize = 12;

/// Directions whose components differ by less than this count as equal, because text in files is rounded.
const SAME_DIRECTION: f64 = 1e-3;

/// A step between slices gets a note if it differs from the median step by more than this fraction.
const UNEVEN: f64 = 0.01;

/// The sorted frames of a volume, and the grid that they form.
pub(super) struct FrameStack {
    /// The frames, in the order of slices.
    pub(super) frames: Vec<DicomFrame>,
    /// The position and the axes of the grid.
    pub(super) grid: FileFrame,
}

/// Returns the frames of the series that `choice` names; `None` chooses the only series.
///
/// # Errors
/// [`Error::Input`] about `what`, which lists the series, if there are several without a choice, or if none matches it.
pub(super) fn choose(
    what: &str,
    files: &[ImageFile],
    frames: Vec<DicomFrame>,
    choice: Option<&str>,
) -> Result<Vec<DicomFrame>> {
    let mut groups: Vec<Vec<DicomFrame>> = Vec::new();
    for frame in frames {
        match groups.iter_mut().find(|group| belong_together(files, &group[0], &frame)) {
            Some(group) => group.push(frame),
            None => groups.push(vec![frame]),
        }
    }
    let picked: Vec<usize> = match choice.map(str::trim) {
        None => (0..groups.len()).collect(),
        // A short number is an index of the list of series; identifiers are long and have dots.
        Some(choice) if choice.len() <= 4 && choice.parse::<usize>().is_ok() => {
            choice.parse().into_iter().filter(|number| *number < groups.len()).collect()
        }
        Some(choice) => {
            let uid = |group: &[DicomFrame]| files[group[0].file].series.uid.clone();
            (0..groups.len()).filter(|index| !choice.is_empty() && uid(&groups[*index]).ends_with(choice)).collect()
        }
    };
    match picked.as_slice() {
        [one] => Ok(groups.swap_remove(*one)),
        _ => {
            let listed = groups.iter().enumerate().take(MOST_LISTED);
            let listed: Vec<String> =
                listed.map(|(number, group)| format!("{number}: {}", described(files, group))).collect();
            let unlisted = groups.len().saturating_sub(MOST_LISTED);
            let more = if unlisted > 0 { format!("; and {unlisted} more") } else { String::new() };
            let listed = listed.join("; ") + &more;
            let why = match choice {
                None => format!("holds {} series; choose one with `OpenOptions::series`: {listed}", groups.len()),
                Some(choice) => {
                    let choice = choice.escape_debug();
                    let count = if picked.is_empty() { "no series" } else { "more than one series" };
                    let takes = "`OpenOptions::series` takes a number of this list or a UID's end";
                    format!("has {count} \"{choice}\"; {takes}: {listed}")
                }
            };
            Err(Error::input(what, why))
        }
    }
}

fn belong_together(files: &[ImageFile], a: &DicomFrame, b: &DicomFrame) -> bool {
    let close_to = |a: f64, b: f64, share: f64| (a - b).abs() <= share * a.abs().max(b.abs()).max(1.0);
    let same_spacing = match (a.spacing, b.spacing) {
        (Some(a), Some(b)) => (0..2).all(|axis| (a[axis] - b[axis]).abs() <= 1e-3 * a[axis].abs()),
        (a, b) => a == b,
    };
    let same_facing = match (a.place, b.place) {
        (Some(a), Some(b)) => {
            (0..2).all(|row| (0..3).all(|c| close_to(a.orientation[row][c], b.orientation[row][c], SAME_DIRECTION)))
        }
        (a, b) => a.is_none() && b.is_none(),
    };
    let (x, y) = (&files[a.file], &files[b.file]);
    let same_series = x.series.uid == y.series.uid && x.series.photometric == y.series.photometric;
    same_series && x.size == y.size && x.layout.sample_type == y.layout.sample_type && same_spacing && same_facing
}

/// Describes the series of `frames`: "MR "t1", 192 slices of 256 x 256 (...0285270.0.0.0)".
fn described(files: &[ImageFile], frames: &[DicomFrame]) -> String {
    let file = &files[frames[0].file];
    let [x, y] = file.size;
    let slices = if frames.len() == 1 { "slice" } else { "slices" };
    let (modality, description) = (&file.series.modality, &file.series.description);
    let name = format!("{} \"{}\"", modality.escape_debug(), description.escape_debug());
    let uid: Vec<char> = file.series.uid.chars().filter(|c| !c.is_control()).collect();
    let tail: String = uid[uid.len().saturating_sub(12)..].iter().collect();
    format!("{name}, {} {slices} of {x} x {y} (...{tail})", frames.len())
}

/// Sorts `frames`, which belong together, and finds the grid that they form.
pub(super) fn stack(
    what: &str,
    files: &[ImageFile],
    frames: Vec<DicomFrame>,
    notes: &mut Vec<String>,
) -> Result<FrameStack> {
    let [x, y] = frames[0].spacing.unwrap_or_else(|| {
        notes.push("warning: the files give no pixel spacing; 1 is taken (`OpenOptions::spacing` replaces it)".into());
        [1.0, 1.0]
    });
    match frames[0].place {
        Some(place) => stack_by_position(what, files, frames, place, [x, y], notes),
        None => Ok(stack_by_number(files, frames, [x, y], notes)),
    }
}

fn stack_by_number(
    files: &[ImageFile],
    mut frames: Vec<DicomFrame>,
    [x, y]: [f64; 2],
    notes: &mut Vec<String>,
) -> FrameStack {
    let first_name = file_name(&files[frames[0].file].path);
    if frames.len() > 1 {
        let how = if frames.iter().all(|frame| frame.file == frames[0].file) {
            "of its frames"
        } else if frames.iter().all(|frame| frame.number.is_some()) {
            frames.sort_by_key(|frame| (frame.number, frame.file, frame.index));
            "of instance numbers"
        } else {
            "of file names"
        };
        notes.push(format!(
            "warning: {first_name}: no position and orientation of slices; they are stacked in the order {how}"
        ));
    }
    let z = frames[0].depth.unwrap_or_else(|| guessed_depth(notes));
    let grid = FileFrame {
        spacing: [x, y, z],
        direction: IDENTITY,
        origin: [0.0; 3],
        world: World::LeftPosterior,
        unit: Some("mm".into()),
    };
    FrameStack { frames, grid }
}

fn guessed_depth(notes: &mut Vec<String>) -> f64 {
    notes.push(
        "warning: the file gives no distance between slices; 1 is taken (`OpenOptions::spacing` replaces it)".into(),
    );
    1.0
}

fn stack_by_position(
    what: &str,
    files: &[ImageFile],
    mut frames: Vec<DicomFrame>,
    place: ImagePlane,
    [x, y]: [f64; 2],
    notes: &mut Vec<String>,
) -> Result<FrameStack> {
    let [row, column] = place.orientation;
    let normal = cross(row, column);
    let position = |frame: &DicomFrame| frame.place.map_or([0.0; 3], |place| place.position);
    let height = |frame: &DicomFrame| dot(position(frame), normal);
    frames.sort_by(|a, b| height(a).total_cmp(&height(b)).then((a.file, a.index).cmp(&(b.file, b.index))));
    let origin = position(&frames[0]);
    let (spacing, axis) = if frames.len() == 1 {
        (frames[0].depth.unwrap_or_else(|| guessed_depth(notes)), normal)
    } else {
        let steps: Vec<f64> = frames.windows(2).map(|pair| height(&pair[1]) - height(&pair[0])).collect();
        let mut sorted = steps.clone();
        sorted.sort_by(f64::total_cmp);
        let (median, largest) = (sorted[sorted.len() / 2], sorted[sorted.len() - 1]);
        let least = UNEVEN * if median > 0.0 { median } else { largest };
        // The comparison is `<=` so that it also finds steps that are all 0.
        if let Some(at) = steps.iter().position(|step| *step <= least) {
            return Err(same_place(what, files, &frames, at));
        }
        tell_uneven(files, &frames, &steps, median, notes);
        let last = position(&frames[frames.len() - 1]);
        let whole = [0, 1, 2].map(|c| last[c] - origin[c]);
        slant(whole, normal, median, notes)
    };
    let grid = FileFrame {
        spacing: [x, y, spacing],
        direction: [row, column, axis],
        origin,
        world: World::LeftPosterior,
        unit: Some("mm".into()),
    };
    Ok(FrameStack { frames, grid })
}

/// Returns the distance between slices along the z axis, and this axis: the normal, unless the slices drift to the
/// side.
fn slant(whole: [f64; 3], normal: [f64; 3], step: f64, notes: &mut Vec<String>) -> (f64, [f64; 3]) {
    let axis = whole.map(|c| c / length(whole));
    let cosine = dot(axis, normal);
    let sideways = length([0, 1, 2].map(|c| axis[c] - cosine * normal[c]));
    if sideways <= SAME_DIRECTION {
        return (step, normal);
    }
    let degrees = sideways.atan2(cosine).to_degrees();
    notes.push(format!("slices are {degrees:.1} degrees off their normal (a tilted gantry); the grid is sheared"));
    (step / cosine, axis)
}

/// Returns the error for the frames `at` and the next, at one position; it says how they differ if that is known.
fn same_place(what: &str, files: &[ImageFile], frames: &[DicomFrame], at: usize) -> Error {
    let (a, b) = (&frames[at], &frames[at + 1]);
    let shown = |frame: &DicomFrame| {
        let path = file_name(&files[frame.file].path);
        if a.file == b.file { format!("frame {} of {path}", frame.index) } else { path }
    };
    let found = |frame: &DicomFrame| {
        let elements = elements::read(&files[frame.file].path).ok()?;
        Some(circumstances(&elements, frame.index))
    };
    let differ = found(a).zip(found(b)).and_then(|(a, b)| {
        let pair = a.iter().zip(&b).find(|(a, b)| a.1 != b.1);
        pair.map(|(a, _)| format!("; they differ in {}", a.0))
    });
    if differ.is_none() && frames.iter().all(|frame| (frame.file, frame.place) == (a.file, a.place)) {
        let why =
            "has one position for all its frames, and neither a Grid Frame Offset Vector nor a Spacing Between Slices";
        return Error::input(files[a.file].path.display().to_string(), why);
    }
    let why = format!(
        "{} and {} are at the same place{}; keep the files of one echo, time or copy in the folder",
        shown(a),
        shown(b),
        differ.unwrap_or_default()
    );
    Error::input(what, why)
}

/// Adds notes on steps that differ from the median step: missing slices, and uneven steps.
fn tell_uneven(files: &[ImageFile], frames: &[DicomFrame], steps: &[f64], median: f64, notes: &mut Vec<String>) {
    let (mut missing, mut gaps, mut uneven) = (0.0, 0, 0);
    let (mut first_gap, mut first_uneven) = (None, None);
    for (at, step) in steps.iter().enumerate() {
        let slices = (step / median).round();
        if (step - median).abs() <= UNEVEN * median {
            continue;
        }
        if slices >= 2.0 && (step - slices * median).abs() <= UNEVEN * step {
            missing += slices - 1.0;
            gaps += 1;
            first_gap.get_or_insert(at);
        } else {
            uneven += 1;
            first_uneven.get_or_insert(at);
        }
    }
    let between = |at: usize| {
        let name = |frame: &DicomFrame| file_name(&files[frame.file].path);
        let (a, b) = (&frames[at], &frames[at + 1]);
        let files = if a.file == b.file {
            format!("frames {} and {}", a.index, b.index)
        } else {
            format!("{} and {}", name(a), name(b))
        };
        format!("slices {at} and {} ({files})", at + 1)
    };
    if let Some(at) = first_gap {
        let are = if missing == 1.0 { "slice is" } else { "slices are" };
        let places = if gaps == 1 { "between" } else { "in several places, first between" };
        notes.push(format!(
            "warning: {missing} {are} missing {places} {}; the rest is stacked {median} mm apart as if it were not",
            between(at)
        ));
    }
    if let Some(at) = first_uneven {
        let steps_are = if uneven == 1 {
            "1 step between slices is".to_string()
        } else {
            format!("{uneven} steps between slices are")
        };
        notes.push(format!(
            "warning: {steps_are} not the usual {median} mm, first {} mm between {}; they are stacked evenly",
            steps[at],
            between(at)
        ));
    }
}
