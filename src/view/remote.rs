//! A file elsewhere, whose voxels go to the graphics device part after part: no copy of them stays in memory.
//!
//! In: the file's directory, and where its bytes come from. Out: lanes on the device, each fetched when a picture first needs
//! it; how far that is, and how often each value has arrived. Of a file with levels of detail, coarser levels are fetched first, so
//! that there is something to see while a finer one arrives.

use std::ops::{Range, RangeInclusive};
use std::pin::Pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

use adjsplat::Model;
use adjsplat::arena::{CodeCounts, Directory};
use adjsplat::error::{Error, Result};
use adjsplat::splat::Lanes as _;
use adjsplat::volume::Axis;
use egui::Context;
use web_time::Instant;

use crate::background;
use crate::draw::OnDevice;
use crate::look::ViewLook;

/// Bytes of the first part of the voxels and of the largest one; progress is shown after each.
pub const PARTS: RangeInclusive<u64> = 256 << 10..=4 << 20;
/// Seconds after which what has arrived is shown for the first time, and again when this time has doubled.
const PATIENCE: f64 = 0.7;

/// What a [`Source`] reads: the bytes of each range.
pub type Reading<'a> = Pin<Box<dyn Future<Output = Result<Vec<Vec<u8>>>> + 'a>>;

/// Where a file's bytes come from.
pub trait Source: Send + Sync {
    /// Reads some ranges of bytes.
    fn read<'a>(&'a self, ranges: &'a [Range<u64>]) -> Reading<'a>;

    /// Returns whether the file is on this machine, not on a server.
    fn is_local(&self) -> bool {
        false
    }
}

/// A lane of a level of detail: all its voxels, on the scan lines along an axis. Level 0 has the voxels themselves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LaneOf {
    /// The level.
    pub level: usize,
    /// The axis.
    pub axis: Axis,
}

/// A file elsewhere.
pub struct Remote {
    /// The name that messages call it by.
    name: String,
    directory: Arc<Directory>,
    source: Box<dyn Source>,
    context: Context,
    /// Held while a lane is fetched.
    turn: Arc<async_lock::Mutex<()>>,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    /// The lane that is being fetched; how many of its bytes have arrived, and all.
    fetching: Option<(LaneOf, [u64; 2])>,
    /// Bytes of the file that have been fetched.
    fetched: u64,
    /// The codes of the voxels of each level that have arrived, level 0 first; of all, once a lane is complete.
    codes: Vec<CodeCounts>,
    /// The finest level of which a lane is complete.
    finest: Option<usize>,
    has_news: bool,
    has_arrived: bool,
    /// Why no more can be fetched, until it was told.
    fault: Option<String>,
    has_failed: bool,
    /// Whether what was fetched last did not fit the file. It is not fetched again.
    is_damaged: bool,
    /// The look whose picture needed what could not be fetched. Another one tries again.
    failed_look: Option<ViewLook>,
}

impl Remote {
    /// Creates a file of which `fetched` bytes have been read; it wakes `context` when more has arrived.
    pub fn new(
        name: &str,
        directory: Arc<Directory>,
        source: impl Source + 'static,
        fetched: u64,
        context: &Context,
    ) -> Remote {
        let state = Mutex::new(State { fetched, ..State::default() });
        let (name, source, context) = (name.to_owned(), Box::new(source), context.clone());
        Remote { name, directory, source, context, turn: Arc::default(), state }
    }

    /// Returns a model that counts the codes of the voxels that have arrived. Before those of level 0 have, it counts those of the
    /// finest level instead.
    ///
    /// # Errors
    /// The errors of [`Model::from_directory`].
    pub fn model(&self) -> Result<Model> {
        let mut codes = self.state().codes.clone();
        if let Some(finest) = codes.iter().position(|codes| !codes.by_value().is_empty()) {
            codes[0] = codes[finest].clone();
        }
        Model::from_directory(self.directory.clone(), codes, &self.name)
    }

    /// Returns whether more has arrived since the last call.
    pub fn has_news(&self) -> bool {
        std::mem::take(&mut self.state().has_news)
    }

    /// Returns whether enough has arrived for a first picture.
    pub fn has_arrived(&self) -> bool {
        self.state().has_arrived
    }

    /// Returns whether fetching has failed, and has not succeeded since.
    pub fn has_failed(&self) -> bool {
        self.state().has_failed
    }

    /// Returns why no more can be fetched, once.
    pub fn fault(&self) -> Option<String> {
        self.state().fault.take()
    }

    /// Returns the lane that is being fetched, and which share of it has arrived.
    pub fn fetching(&self) -> Option<(LaneOf, f32)> {
        let (lane, [done, total]) = self.state().fetching?;
        Some((lane, done as f32 / total.max(1) as f32))
    }

    /// Returns the number of bytes of the file that have been fetched.
    pub fn fetched(&self) -> u64 {
        self.state().fetched
    }

    /// Returns the number of coarser levels of detail that can be fetched.
    pub(crate) fn level_count(&self) -> usize {
        self.directory.level_count()
    }

    /// Returns whether nothing of a lane has to be fetched: `device` has it, or it has no voxels.
    pub(crate) fn is_there(&self, lane: LaneOf, device: &OnDevice) -> bool {
        device.has_lane(lane) || self.directory.level(lane.level).is_some_and(|level| level.records(lane.axis) == 0)
    }

    /// Returns the lane to fetch next for a picture that needs `wanted`; `finest` is the finest level of which the device has a
    /// lane. That is a coarser level that takes at most a third of the bytes, if there is nothing finer to see meanwhile.
    fn next(&self, wanted: LaneOf, finest: Option<usize>) -> LaneOf {
        let bytes = |level| self.directory.level(level).map_or(0, |level| level.channel_bytes(wanted.axis));
        let levels = wanted.level + 1..finest.unwrap_or(self.directory.level_count() + 1);
        let mut coarser = levels.rev().filter(|level| bytes(*level) <= bytes(wanted.level) / 3);
        LaneOf { level: coarser.next().unwrap_or(wanted.level), ..wanted }
    }

    /// Returns whether a picture of `look` may fetch: not after a failure for the same look, or of a damaged file.
    pub(crate) fn may_fetch(&self, look: &ViewLook) -> bool {
        let state = self.state();
        !state.is_damaged && state.failed_look.as_ref() != Some(look)
    }

    /// Begins to fetch what a picture of `look` that needs the lane `wanted` shows next, unless something is being fetched;
    /// `finest` is the finest level of which the device has a lane.
    pub(crate) fn begin(
        self: &Arc<Remote>,
        wanted: LaneOf,
        finest: Option<usize>,
        device: &Arc<async_lock::Mutex<OnDevice>>,
        look: &ViewLook,
    ) {
        if !self.may_fetch(look) {
            return;
        }
        let lane = self.next(wanted, finest);
        let mut state = self.state();
        if state.fetching.is_some() {
            return;
        }
        (state.fetching, state.has_failed) = (Some((lane, [0, 1])), false);
        drop(state);
        let look = look.clone();
        // A document that is closed stops what it fetches.
        let (remote, device, turn) = (Arc::downgrade(self), Arc::downgrade(device), self.turn.clone());
        background::run(async move || {
            let _turn = turn.lock().await;
            let fetched = fetch(&remote, lane, &device).await;
            if let Some((remote, device)) = remote.upgrade().zip(device.upgrade()) {
                // The fault is shown.
                let _ = remote.end(fetched, lane, device, Some(look)).await;
            }
        });
    }

    /// Fetches a lane for a device, unless that has it. `look`: of the picture on the screen that needs it.
    ///
    /// # Errors
    /// The errors of the source and of the device.
    pub(crate) async fn fetch(
        self: &Arc<Remote>,
        lane: LaneOf,
        device: &Arc<async_lock::Mutex<OnDevice>>,
        look: Option<&ViewLook>,
    ) -> Result<()> {
        let _turn = self.turn.lock().await;
        if self.is_there(lane, &*device.lock().await) {
            return Ok(());
        }
        if look.is_some_and(|look| !self.may_fetch(look)) {
            return Err(Error::input(&self.name, "has voxels that could not be fetched"));
        }
        let fetched = fetch(&Arc::downgrade(self), lane, &Arc::downgrade(device)).await;
        self.end(fetched, lane, device.clone(), look.cloned()).await
    }

    /// Ends fetching a lane; what has arrived of one that is damaged or cut is dropped.
    async fn end(
        &self,
        fetched: Result<()>,
        lane: LaneOf,
        device: Arc<async_lock::Mutex<OnDevice>>,
        look: Option<ViewLook>,
    ) -> Result<()> {
        if fetched.is_err() {
            device.lock().await.forget(lane);
        }
        // The device is not closed by the thread that fetched.
        drop(device);
        let mut state = self.state();
        (state.fetching, state.has_news) = (None, true);
        (state.has_failed, state.failed_look) = (fetched.is_err(), look.filter(|_| fetched.is_err()));
        let is_damaged = state.is_damaged;
        let again = if self.source.is_local() { "open the file again" } else { "load the page again" };
        let told = |fault: String| match is_damaged || fault.ends_with(again) {
            true => fault,
            false => format!("{fault}; move the view to try again, or {again}"),
        };
        state.fault = fetched.as_ref().err().map(ToString::to_string).map(told);
        self.context.request_repaint();
        fetched
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    /// Counts the codes of the voxels of a level that have arrived.
    fn count(&mut self, level: usize, codes: CodeCounts) {
        if self.codes.len() <= level {
            self.codes.resize(level + 1, CodeCounts::default());
        }
        self.codes[level] = codes;
    }
}

/// Fetches a lane and hands it to a device that lacks it; stops when file or device are dropped.
async fn fetch(remote: &Weak<Remote>, wanted: LaneOf, device: &Weak<async_lock::Mutex<OnDevice>>) -> Result<()> {
    let LaneOf { level, axis } = wanted;
    let Some(file) = remote.upgrade() else { return Ok(()) };
    let (whole, model) = (file.directory.clone(), file.model()?);
    drop(file);
    match device.upgrade() {
        Some(device) if !device.lock().await.has_lane(wanted) => {}
        _ => return Ok(()),
    }
    let lane = model.lane_of(level, axis)?;
    let Some(directory) = whole.level(level) else { return Ok(()) };
    let parts = directory.parts(axis, PARTS);
    let total = lane.record_count() * lane.channels.record_bytes();
    let (mut check, mut codes, mut done) = (directory.channel_check(axis), CodeCounts::default(), 0);
    let (start, mut patience) = (Instant::now(), PATIENCE);
    for part in parts {
        let Some((remote, device)) = remote.upgrade().zip(device.upgrade()) else { return Ok(()) };
        let read = remote.source.read(&part.ranges).await?;
        let channels: [&[u8]; 5] = std::array::from_fn(|channel| &read[channel][..]);
        let bytes = channels.iter().map(|channel| channel.len() as u64).sum::<u64>();
        remote.state().fetched += bytes;
        device.lock().await.receive(level, &lane, part.first, channels).await?;
        check.add(channels);
        codes.add(lane.channels, channels);
        done += bytes;
        let mut state = remote.state();
        state.fetching = Some((wanted, [done, total]));
        // A part of a lane is only shown while there is nothing whole to see.
        if done < total && start.elapsed().as_secs_f64() > patience && state.finest.is_none() {
            state.count(level, codes.clone());
            (state.has_news, state.has_arrived) = (true, true);
            patience = 2.0 * start.elapsed().as_secs_f64();
        }
        remote.context.request_repaint();
    }
    let Some(remote) = remote.upgrade() else { return Ok(()) };
    let checked = check.finish(&remote.name);
    remote.state().is_damaged = checked.is_err();
    checked.map_err(|fault| match remote.source.is_local() {
        true => Error::input(&remote.name, "is damaged, or changed since it was opened; run adj verify on it"),
        false => fault,
    })?;
    let mut state = remote.state();
    state.count(level, codes);
    state.finest = Some(state.finest.map_or(level, |finest| finest.min(level)));
    state.has_arrived = true;
    Ok(())
}
