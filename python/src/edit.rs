//! Edits: voxels added to a model and removed from it, written to a new file.

use std::path::PathBuf;

use adjsplat::arena::layout::{Channels, Facts};
use adjsplat::arena::{LaneSet, Overlay, Record};
use adjsplat::classify::MagnitudeCodec;
use adjsplat::classify::normal::{self, Coherence};
use adjsplat::error::{Error, Result};
use adjsplat::file::{RowsOutput, write_rows};
use adjsplat::internals::{add_change, description_object};
use adjsplat::volume::Grid;
use numpy::{PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use serde_json::json;

use crate::build::{Wanted, threads_or_all};
use crate::model::Model;
use crate::watch::{Raised, Watch};

/// One step of an edit, as Python gives it.
#[derive(FromPyObject)]
pub(crate) struct Step<'py> {
    /// z, y, x of each voxel.
    positions: PyReadonlyArray2<'py, u32>,
    /// What is added; without, the voxels are removed.
    values: Option<PyReadonlyArray1<'py, f64>>,
    normals: Option<PyReadonlyArray2<'py, f64>>,
    magnitudes: Option<PyReadonlyArray1<'py, f64>>,
}

/// A step whose numbers no longer belong to Python.
struct Change {
    positions: Vec<[u32; 3]>,
    added: Option<Added>,
}

struct Added {
    values: Vec<f64>,
    normals: Option<Vec<[f64; 3]>>,
    magnitudes: Option<Vec<f64>>,
}

/// Counts of an edit.
#[derive(Default)]
struct Counts {
    added: u64,
    replaced: u64,
    removed: u64,
    values: Option<[f64; 2]>,
}

impl Step<'_> {
    fn change(&self) -> PyResult<Change> {
        let contiguous = |_| PyValueError::new_err("arrays of an edit must be contiguous");
        let triples = |numbers: &[f64]| numbers.as_chunks::<3>().0.to_vec();
        let positions = self.positions.as_slice().map_err(contiguous)?;
        let positions: Vec<[u32; 3]> = positions.as_chunks::<3>().0.iter().map(|&[z, y, x]| [x, y, z]).collect();
        let Some(values) = &self.values else { return Ok(Change { positions, added: None }) };
        let numbers = |array: &PyReadonlyArray1<'_, f64>| array.as_slice().map(<[f64]>::to_vec).map_err(contiguous);
        let normals =
            self.normals.as_ref().map(|array| array.as_slice().map(triples).map_err(contiguous)).transpose()?;
        let magnitudes = self.magnitudes.as_ref().map(numbers).transpose()?;
        let added = Added { values: numbers(values)?, normals, magnitudes };
        let lengths =
            [Some(added.values.len()), added.normals.as_ref().map(Vec::len), added.magnitudes.as_ref().map(Vec::len)];
        if lengths.into_iter().flatten().any(|length| length != positions.len()) {
            return Err(PyValueError::new_err("each added voxel needs one position, one value and one of all others"));
        }
        Ok(Change { positions, added: Some(added) })
    }
}

/// Applies `steps` in their order to the voxels of `model`, and writes the file `out`. Returns also how many levels of detail
/// of the model's file were left out.
#[pyfunction]
pub(crate) fn save_edited(
    py: Python<'_>,
    model: &Model,
    out: PathBuf,
    steps: Vec<Step<'_>>,
    levels: Wanted,
    resources: (Option<u64>, Option<usize>),
    progress: Option<Py<PyAny>>,
) -> PyResult<(Model, u8)> {
    let (levels, (memory, threads)) = (levels.levels(), resources);
    let changes = steps.iter().map(Step::change).collect::<PyResult<Vec<Change>>>()?;
    let threads = threads_or_all(threads)?;
    let arena = model.arena()?;
    let left_out = if levels.is_none() { arena.level_count() } else { 0 };
    let raised = Raised::default();
    let mut watch = Watch::new(progress, raised.clone());
    let saved = py.detach(|| {
        let facts = arena.facts().clone();
        let lane_count = u8::try_from(arena.lanes().count()).expect("there are three axes");
        let lanes = LaneSet::new(arena, memory);
        let mut overlay = Overlay::new(&lanes);
        let mut counts = Counts::default();
        for change in changes {
            if !raised.may_go_on() {
                return Err(Error::Interrupted);
            }
            apply(&mut overlay, &facts, change, &mut counts)?;
        }
        let description = description(lanes.arena().description(), facts.visible_voxels, &counts);
        let output = RowsOutput { facts, description: &description, lane_count, memory, threads, levels };
        write_rows(&out, &overlay.rows()?, &output, &mut watch)?;
        adjsplat::Model::open(&out)
    });
    raised.or(saved).map(|saved| (Model::of(saved), left_out))
}

fn apply(overlay: &mut Overlay<'_>, facts: &Facts, change: Change, counts: &mut Counts) -> Result<()> {
    let Some(added) = change.added else {
        for position in change.positions {
            counts.removed += u64::from(overlay.remove(position)?.is_some());
        }
        return Ok(());
    };
    let codes = Codes::new(facts, &added)?;
    for (index, position) in change.positions.into_iter().enumerate() {
        let before = overlay.insert(position, codes.record(&added, index)?)?;
        *if before.is_some() { &mut counts.replaced } else { &mut counts.added } += 1;
        let value = added.values[index];
        let [low, high] = counts.values.unwrap_or([value; 2]);
        counts.values = Some([low.min(value), high.max(value)]);
    }
    Ok(())
}

/// Turns what is added into codes of the file.
struct Codes {
    grid: Grid,
    channels: Channels,
    low: f64,
    step: f64,
    last: u16,
    magnitude: Option<MagnitudeCodec>,
}

impl Codes {
    fn new(facts: &Facts, added: &Added) -> Result<Codes> {
        let channels = facts.channels;
        let refuse = |what: &str, why: &str| Err(Error::input(what, why));
        if channels.magnitude_bits > 0 && added.magnitudes.is_none() {
            return refuse("magnitudes", "are missing: this file's opacities depend on gradient magnitudes");
        }
        if channels.normal_bits == 0 && added.normals.is_some() {
            return refuse("normals", "cannot be added: this file stores none");
        }
        if channels.magnitude_bits == 0 && added.magnitudes.is_some() {
            return refuse("magnitudes", "cannot be added: this file stores none");
        }
        let last = channels.last_value_code();
        let magnitude = match channels.magnitude_bits {
            0 => None,
            _ => Some(MagnitudeCodec::new(facts.scales.magnitude_scale)?),
        };
        Ok(Codes {
            grid: facts.grid.clone(),
            channels,
            low: facts.scales.value_low,
            step: facts.scales.value_step,
            last,
            magnitude,
        })
    }

    fn record(&self, added: &Added, index: usize) -> Result<Record> {
        let value = self.value(added.values[index])?;
        let gradient = |normal: [f64; 3]| self.grid.axes_from_world(normal).map(|part| -part);
        let bits = self.channels.normal_bits;
        let normal = match added.normals.as_ref().map(|normals| gradient(normals[index])) {
            None => normal::none(bits),
            // A normal points against the gradient.
            Some(gradient) if self.channels.coherence => normal::encode_coherent(gradient, Coherence::ONE, bits),
            Some(gradient) if bits == 8 => normal::encode8(gradient).into(),
            Some(gradient) => normal::encode16(gradient),
        };
        let magnitudes = self.magnitude.as_ref().zip(added.magnitudes.as_ref());
        let magnitude = magnitudes.map_or(0, |(codec, magnitudes)| codec.encode(magnitudes[index]));
        Ok(Record { value, normal, magnitude, coverage: 0 })
    }

    /// Returns the code nearest to `value`.
    fn value(&self, value: f64) -> Result<u16> {
        let high = self.low + f64::from(self.last) * self.step;
        let code = if self.step > 0.0 { (value - self.low) / self.step } else { 0.0 };
        let is_alone = self.step == 0.0 && value != self.low;
        if !value.is_finite() || is_alone || !(-0.5..=f64::from(self.last) + 0.5).contains(&code) {
            let why = format!("is outside {} to {high}, the values that this file can store", self.low);
            return Err(Error::input(format!("value {value}"), why));
        }
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "in range, and it saturates")]
        let code = (code + 0.5) as u16;
        Ok(code.min(self.last))
    }
}

/// Returns the file's description with an entry for this edit.
fn description(text: &[u8], visible_before: u64, counts: &Counts) -> String {
    let mut description = description_object(text);
    if let Some([low, high]) = counts.values {
        for (name, added, is_beyond) in [("lowest", low, f64::lt as fn(&f64, &f64) -> bool), ("highest", high, f64::gt)]
        {
            let known = description["values"][name].as_f64();
            if known.is_some_and(|known| is_beyond(&added, &known)) {
                description["values"][name] = json!(added);
            }
        }
    }
    let change = json!({ "added": counts.added, "replaced": counts.replaced, "removed": counts.removed });
    add_change(&mut description, "edited", visible_before, change);
    description.to_string()
}
