//! Traces: the memory accesses of a walk, in order.

/// Receives each memory access of a walk.
pub trait Trace {
    /// Notes that `bytes` from `offset` on were read from the walker's array number `array`.
    fn read(&mut self, array: usize, offset: usize, bytes: usize);
    /// Notes that `bytes` from `offset` on were written to the walker's array number `array`.
    fn write(&mut self, array: usize, offset: usize, bytes: usize);
}

/// A trace that does nothing and costs nothing.
#[derive(Debug, Clone, Copy, Default)]
pub struct Untraced;

impl Trace for Untraced {
    #[inline(always)]
    fn read(&mut self, _: usize, _: usize, _: usize) {}
    #[inline(always)]
    fn write(&mut self, _: usize, _: usize, _: usize) {}
}

impl Trace for &mut dyn Trace {
    fn read(&mut self, array: usize, offset: usize, bytes: usize) {
        (**self).read(array, offset, bytes);
    }

    fn write(&mut self, array: usize, offset: usize, bytes: usize) {
        (**self).write(array, offset, bytes);
    }
}

/// An array that a walker allocates, whose number a trace uses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WalkerArray {
    /// Name of what the array holds.
    pub name: &'static str,
    /// Bytes that are allocated, whether used or not.
    pub bytes: u64,
    /// Whether the array is scratch memory, which holds nothing between frames.
    pub scratch: bool,
}

/// Makes names of arrays that exist along each axis: each of the names followed by x, by y, and by z.
macro_rules! along_axes {
    ($($name:literal),*) => {
        [[$(concat!($name, " x")),*], [$(concat!($name, " y")),*], [$(concat!($name, " z")),*]]
    };
}
pub(crate) use along_axes;

impl WalkerArray {
    /// Describes the allocation of `elements`, which are part of the structure.
    pub fn of<T>(name: &'static str, elements: &Vec<T>) -> WalkerArray {
        WalkerArray { name, bytes: (elements.capacity() * size_of::<T>()) as u64, scratch: false }
    }

    /// Describes the allocation of `elements` as scratch memory, which holds nothing between frames.
    pub fn scratch<T>(name: &'static str, elements: &Vec<T>) -> WalkerArray {
        WalkerArray { scratch: true, ..WalkerArray::of(name, elements) }
    }
}
