//! Traces: what a walk reads and writes, in order.
//!
//! In: each access of a walk, as an array of the walker's and bytes in it. Out: whatever a tracer makes of them.
//! [`Untraced`] makes nothing of them and costs nothing.

/// Told of each access of a walk.
pub trait Trace {
    /// `bytes` from `offset` on are read of the walker's array number `array`.
    fn read(&mut self, array: usize, offset: usize, bytes: usize);
    /// `bytes` from `offset` on are written of the walker's array number `array`.
    fn write(&mut self, array: usize, offset: usize, bytes: usize);
}

/// Nobody listens.
#[derive(Debug, Clone, Copy, Default)]
pub struct Untraced;

impl Trace for Untraced {
    #[inline(always)]
    fn read(&mut self, _: usize, _: usize, _: usize) {}
    #[inline(always)]
    fn write(&mut self, _: usize, _: usize, _: usize) {}
}

/// One allocation of a walker.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WalkerArray {
    /// What it holds.
    pub name: &'static str,
    /// Bytes that are allocated, used or not.
    pub bytes: u64,
    /// Whether a walk only works in it: it holds nothing between frames.
    pub scratch: bool,
}

impl WalkerArray {
    /// An array that holds the structure: all that `elements` has allocated.
    pub fn of<T>(name: &'static str, elements: &Vec<T>) -> WalkerArray {
        WalkerArray { name, bytes: (elements.capacity() * size_of::<T>()) as u64, scratch: false }
    }

    /// The same, of an array that holds nothing between frames.
    pub fn scratch<T>(name: &'static str, elements: &Vec<T>) -> WalkerArray {
        WalkerArray { scratch: true, ..WalkerArray::of(name, elements) }
    }
}
