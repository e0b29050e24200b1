//! The builder: from a volume to lanes.
//!
//! In: a [`SlabSource`] and a [`TransferFunction`]. Out: the lanes of its visible voxels and what their codes mean.
//! Slices stream through once: a voxel is visible where its opacity is above 0; its value is quantised over the
//! visible range, its normal is the gradient's direction. The x lane is packed as slices come, the others are
//! transposed from it. The result depends on the input and the options alone.
//!
//! A first pass over the samples (a survey) is made only where the visible range or the largest gradient is not
//! known without it: [`BuildOptions::needs_survey`].

use std::ops::ControlFlow;

use super::curve::TileOrder;
use super::lane::OwnedLane;
use super::layout::{Facts, Scales};
use super::pack::LanePacker;
use super::plan::{CodeTable, Plan, Tally, nothing_visible};
use super::transpose::transpose;
use super::window::{Field, Window};
use crate::classify::{Neighbourhood, TransferFunction};
use crate::error::{Error, Result};
use crate::volume::{Axis, Header, Sample, SampleType, SlabSource};
use crate::with_samples;

/// What to build.
#[derive(Debug, Clone)]
pub struct BuildOptions {
    /// Which samples are visible, and whether their opacity needs the gradient's magnitude.
    pub transfer: TransferFunction,
    /// 1: x. 2: x and y. 3: x, y and z, so that no view needs a lane that is not there.
    pub lane_count: u8,
    /// Order of the tiles in memory.
    pub tile_order: TileOrder,
    /// Bits of a value: 8 or 16.
    pub value_bits: u8,
    /// Bits of each component of a normal: 0 for none, 8 or 16.
    pub normal_bits: u8,
}

/// What a build is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// Reading the samples for their range.
    Survey,
    /// Reading, classifying and packing.
    Pack,
    /// Making the lane along this axis.
    Transpose(Axis),
}

/// Told of a build's progress, and may stop it.
pub trait Observer {
    /// `done` of `total` slices (or lanes) are behind. `Break` stops the build with [`Error::Interrupted`].
    fn progress(&mut self, phase: Phase, done: u64, total: u64) -> ControlFlow<()>;
}

/// An observer that lets a build run.
#[derive(Debug, Clone, Copy, Default)]
pub struct Unobserved;

impl Observer for Unobserved {
    fn progress(&mut self, _phase: Phase, _done: u64, _total: u64) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }
}

/// What was found in the samples on the way.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Findings {
    /// Lowest finite sample, in its own unit; +infinity if there is none.
    pub lowest: f64,
    /// Highest finite sample, in its own unit; -infinity if there is none.
    pub highest: f64,
    /// Samples that are NaN or infinite: transparent.
    pub not_finite: u64,
    /// Whether the samples were read twice.
    pub surveyed: bool,
    /// Visible voxels whose code stands for a value that is transparent: too few bits for the transfer function's
    /// narrow features.
    pub blurred_away: u64,
}

/// Lanes in memory and what they mean.
#[derive(Debug, Clone)]
pub struct Built {
    /// The header's part.
    pub facts: Facts,
    /// Along x, then y, then z, as many as asked for.
    pub lanes: Vec<OwnedLane>,
    /// The transfer function with everything filled in that the volume decides.
    pub transfer: TransferFunction,
    /// Of the samples.
    pub findings: Findings,
}

/// Builds the lanes of `source`, which must be at its first slice.
///
/// # Errors
/// [`Error::Input`] if an option is out of range or nothing is visible; [`Error::Interrupted`] if the observer says
/// so; and what reading the source gives.
pub fn build(source: &mut dyn SlabSource, options: &BuildOptions, observer: &mut dyn Observer) -> Result<Built> {
    options.check()?;
    let header = source.header().clone();
    header.grid.check()?;
    let plan = Plan::new(source, &header, options, observer)?;
    let mut packer = LanePacker::new(Axis::X, header.grid.dims, plan.channels, options.tile_order);
    let findings = pack(source, &header, &plan, &mut packer, observer)?;
    if packer.visible() == 0 {
        return Err(nothing_visible(&findings));
    }
    let visible_voxels = packer.visible();
    let mut lanes = vec![packer.finish()];
    for axis in [Axis::Y, Axis::Z].into_iter().take(usize::from(options.lane_count) - 1) {
        go_on(observer, Phase::Transpose(axis), axis.index() as u64 - 1, options.lane_count.into())?;
        lanes.push(transpose(&lanes[0].view(), axis, options.tile_order));
    }
    let facts = Facts {
        grid: header.grid,
        channels: plan.channels,
        tile_order: options.tile_order,
        scales: Scales {
            value_low: plan.quantiser.low(),
            value_step: plan.quantiser.step(),
            magnitude_scale: plan.magnitudes.largest(),
        },
        visible_voxels,
    };
    let findings = Findings { surveyed: plan.surveyed, ..findings };
    Ok(Built { facts, lanes, transfer: plan.transfer, findings })
}

impl BuildOptions {
    fn check(&self) -> Result<()> {
        if !(1..=3).contains(&self.lane_count) {
            return Err(Error::input("lanes", "must be x, xy or xyz"));
        }
        for (what, bits, choices) in
            [("value bits", self.value_bits, &[8, 16][..]), ("normal bits", self.normal_bits, &[0, 8, 16])]
        {
            if !choices.contains(&bits) {
                return Err(Error::input(what, format!("are {bits}, but must be one of {choices:?}")));
            }
        }
        Ok(())
    }

    /// Whether a volume of `sample_type` must be read once before it is built.
    ///
    /// Samples of 8 bits never (but for region boundaries): all their values have codes. Others if the visible range
    /// is open at an end, or if the opacity depends on the gradient, whose largest magnitude is not known.
    pub fn needs_survey(&self, sample_type: SampleType) -> bool {
        let (low, high) = self.transfer.domain(f64::INFINITY);
        let open = low == f64::NEG_INFINITY || high == f64::INFINITY;
        self.needs_largest_magnitude() || (sample_type.bytes() > 1 && (open || self.transfer.uses_gradient()))
    }

    /// Whether the transfer function is relative to the largest gradient of the data.
    pub(super) fn needs_largest_magnitude(&self) -> bool {
        self.transfer.clone().with_largest_magnitude(2.0).is_ok_and(|filled| filled != self.transfer)
    }
}

pub(crate) fn go_on(observer: &mut dyn Observer, phase: Phase, done: u64, total: u64) -> Result<()> {
    match observer.progress(phase, done, total) {
        ControlFlow::Continue(()) => Ok(()),
        ControlFlow::Break(()) => Err(Error::Interrupted),
    }
}

fn pack(
    source: &mut dyn SlabSource,
    header: &Header,
    plan: &Plan,
    packer: &mut LanePacker,
    observer: &mut dyn Observer,
) -> Result<Findings> {
    let field = match (plan.needs_gradients(), plan.transfer.is_labels()) {
        (false, _) => Field::None,
        (true, false) => Field::Values,
        (true, true) => Field::Visibility,
    };
    let depth = header.grid.dims[2];
    let mut tally = Tally::default();
    let mut blurred_away = 0;
    let mut slices = Window::new(source, header, field, Some(&plan.transfer))?;
    let domain = (plan.quantiser.low(), plan.quantiser.high());
    let codes = CodeTable::new(header, plan, domain);
    for z in 0..depth {
        go_on(observer, Phase::Pack, z.into(), depth.into())?;
        slices.advance()?;
        tally.add(slices.samples(), header);
        let hood = slices.neighbourhood();
        let z = u16::try_from(z).expect("a grid has at most 65,535 slices");
        with_samples!(slices.samples(), samples => {
            blurred_away += pack_slice(samples, z, header, plan, &codes, hood.as_ref(), packer);
        });
    }
    let Tally { lowest, highest, not_finite } = tally;
    Ok(Findings { lowest, highest, not_finite, surveyed: false, blurred_away })
}

/// Packs a slice; gives how many of its voxels are [blurred away](Findings::blurred_away).
fn pack_slice<T: Sample>(
    samples: &[T],
    z: u16,
    header: &Header,
    plan: &Plan,
    codes: &CodeTable,
    hood: Option<&Neighbourhood>,
    packer: &mut LanePacker,
) -> u64 {
    let mut blurred_away = 0;
    let width = header.grid.dims[0] as usize;
    for (y, row) in (0u16..).zip(samples.chunks_exact(width)) {
        let voxels = row.iter().enumerate().filter_map(|(x, &sample)| {
            let code = codes.code(sample, plan)?;
            let value = codes.value(sample);
            let gradient = || hood.map_or([0.0; 3], |hood| hood.gradient(x, usize::from(y)));
            let record = plan.record(value, code, gradient)?;
            blurred_away += u64::from(plan.blurs_away(value, record));
            Some((u16::try_from(x).expect("a row has at most 65,535 samples"), record))
        });
        packer.line(y, z, voxels);
    }
    blurred_away
}
