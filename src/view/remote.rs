//! A file elsewhere, whose voxels go to the graphics device part after part: no copy of them stays in memory.
//!
//! In: the file's directory, and where its bytes come from. Out: lanes on the device, each fetched when a picture first needs
//! it; how far that is, and how often each value has arrived.

use std::ops::{Range, RangeInclusive};
use std::pin::Pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

use adjsplat::Model;
use adjsplat::arena::{CodeCounts, Directory};
use adjsplat::error::Result;
use adjsplat::splat::Lanes as _;
use adjsplat::volume::Axis;
use egui::Context;
use web_time::Instant;

use crate::background;
use crate::draw::OnDevice;

/// Bytes of the first part of the voxels and of the largest one; progress is shown after each.
pub const PARTS: RangeInclusive<u64> = 256 << 10..=4 << 20;
/// What has arrived is shown after so many seconds, and again when this time has doubled.
const PATIENCE: f64 = 0.7;

/// What a [`Source`] reads: the bytes of each range.
pub type Reading<'a> = Pin<Box<dyn Future<Output = Result<Vec<Vec<u8>>>> + 'a>>;

/// Where a file's bytes come from.
pub trait Source: Send + Sync {
    /// Reads some ranges of bytes.
    fn read<'a>(&'a self, ranges: &'a [Range<u64>]) -> Reading<'a>;
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
    fetching: Option<(Axis, [u64; 2])>,
    /// Bytes of the file that have been fetched.
    fetched: u64,
    /// The codes of the voxels that have arrived; of all, once a lane is complete.
    codes: CodeCounts,
    has_all_codes: bool,
    has_news: bool,
    has_arrived: bool,
    /// Why no more can be fetched, until it was told.
    fault: Option<String>,
    has_failed: bool,
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

    /// Returns a model that counts the codes of the voxels that have arrived.
    ///
    /// # Errors
    /// The errors of [`Model::from_directory`].
    pub fn model(&self) -> Result<Model> {
        Model::from_directory(self.directory.clone(), self.state().codes.clone(), &self.name)
    }

    /// Returns whether more has arrived since the last call.
    pub fn has_news(&self) -> bool {
        std::mem::take(&mut self.state().has_news)
    }

    /// Returns whether enough has arrived for a first picture.
    pub fn has_arrived(&self) -> bool {
        self.state().has_arrived
    }

    /// Returns whether fetching has failed.
    pub fn has_failed(&self) -> bool {
        self.state().has_failed
    }

    /// Returns why no more can be fetched, once.
    pub fn fault(&self) -> Option<String> {
        self.state().fault.take()
    }

    /// Returns the lane that is being fetched, and which share of it has arrived.
    pub fn fetching(&self) -> Option<(Axis, f32)> {
        let (axis, [done, total]) = self.state().fetching?;
        Some((axis, done as f32 / total.max(1) as f32))
    }

    /// Returns the number of bytes of the file that have been fetched.
    pub fn fetched(&self) -> u64 {
        self.state().fetched
    }

    /// Begins to fetch the lane along `axis` for a device, unless a lane is being fetched.
    pub(crate) fn begin(self: &Arc<Remote>, axis: Axis, device: &Arc<async_lock::Mutex<OnDevice>>) {
        let mut state = self.state();
        if state.fetching.is_some() || state.has_failed {
            return;
        }
        state.fetching = Some((axis, [0, 1]));
        drop(state);
        // A document that is closed stops what it fetches.
        let (remote, device, turn) = (Arc::downgrade(self), Arc::downgrade(device), self.turn.clone());
        background::run(async move || {
            let _turn = turn.lock().await;
            let fetched = fetch(&remote, axis, &device).await;
            if let Some((remote, device)) = remote.upgrade().zip(device.upgrade()) {
                // The fault is shown.
                let _ = remote.end(fetched, axis, device).await;
            }
        });
    }

    /// Fetches the lane along `axis` for a device, unless that has it.
    ///
    /// # Errors
    /// The errors of the source and of the device.
    pub(crate) async fn fetch(self: &Arc<Remote>, axis: Axis, device: &Arc<async_lock::Mutex<OnDevice>>) -> Result<()> {
        let _turn = self.turn.lock().await;
        if device.lock().await.has_lane(axis) {
            return Ok(());
        }
        let fetched = fetch(&Arc::downgrade(self), axis, &Arc::downgrade(device)).await;
        self.end(fetched, axis, device.clone()).await
    }

    /// Ends fetching a lane; what has arrived of one that is damaged or cut is dropped.
    async fn end(&self, fetched: Result<()>, axis: Axis, device: Arc<async_lock::Mutex<OnDevice>>) -> Result<()> {
        if fetched.is_err() {
            device.lock().await.forget(axis);
        }
        // The device is not closed by the thread that fetched.
        drop(device);
        let mut state = self.state();
        (state.fetching, state.has_news) = (None, true);
        state.has_failed = fetched.is_err();
        state.fault = fetched.as_ref().err().map(ToString::to_string);
        self.context.request_repaint();
        fetched
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Fetches a lane and hands it to a device that lacks it; stops when file or device are dropped.
async fn fetch(remote: &Weak<Remote>, axis: Axis, device: &Weak<async_lock::Mutex<OnDevice>>) -> Result<()> {
    let Some(file) = remote.upgrade() else { return Ok(()) };
    let (directory, model) = (file.directory.clone(), file.model()?);
    drop(file);
    match device.upgrade() {
        Some(device) if !device.lock().await.has_lane(axis) => {}
        _ => return Ok(()),
    }
    let (lane, parts) = (model.lane(axis)?, directory.parts(axis, PARTS));
    let total = lane.record_count() * lane.channels.record_bytes();
    let (mut check, mut codes, mut done) = (directory.channel_check(axis), CodeCounts::default(), 0);
    let (start, mut patience) = (Instant::now(), PATIENCE);
    for part in parts {
        let Some((remote, device)) = remote.upgrade().zip(device.upgrade()) else { return Ok(()) };
        let read = remote.source.read(&part.ranges).await?;
        let channels: [&[u8]; 5] = std::array::from_fn(|channel| &read[channel][..]);
        device.lock().await.receive(&lane, part.first, channels).await?;
        check.add(channels);
        codes.add(lane.channels, channels);
        let bytes = channels.iter().map(|channel| channel.len() as u64).sum::<u64>();
        done += bytes;
        let mut state = remote.state();
        state.fetched += bytes;
        state.fetching = Some((axis, [done, total]));
        if done < total && start.elapsed().as_secs_f64() > patience && !state.has_all_codes {
            state.codes = codes.clone();
            (state.has_news, state.has_arrived) = (true, true);
            patience = 2.0 * start.elapsed().as_secs_f64();
        }
        remote.context.request_repaint();
    }
    let Some(remote) = remote.upgrade() else { return Ok(()) };
    check.finish(&remote.name)?;
    let mut state = remote.state();
    (state.codes, state.has_all_codes, state.has_arrived) = (codes, true, true);
    Ok(())
}
