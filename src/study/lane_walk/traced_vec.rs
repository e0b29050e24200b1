//! TracedVec arrays that tell a trace of each element.

use crate::trace::Trace;

/// A walker's array: elements, and its number.
#[derive(Debug, Clone)]
pub(super) struct TracedVec<E> {
    array: usize,
    items: Vec<E>,
}

impl<E: Copy + Default> TracedVec<E> {
    /// WalkerArray number `array`, of `len` elements.
    pub(super) fn new(array: usize, len: usize) -> TracedVec<E> {
        TracedVec { array, items: vec![E::default(); len] }
    }

    /// How many elements.
    pub(super) fn len(&self) -> usize {
        self.items.len()
    }

    /// Reads an element.
    #[inline]
    pub(super) fn get<T: Trace>(&self, index: usize, trace: &mut T) -> E {
        self.read(index, 1, trace);
        self.items[index]
    }

    /// Writes an element.
    #[inline]
    pub(super) fn set<T: Trace>(&mut self, index: usize, item: E, trace: &mut T) {
        self.write(index, 1, trace);
        self.items[index] = item;
    }

    /// Tells of a read of `count` elements at once.
    #[inline]
    pub(super) fn read<T: Trace>(&self, first: usize, count: usize, trace: &mut T) {
        trace.read(self.array, first * size_of::<E>(), count * size_of::<E>());
    }

    /// Tells of a write of `count` elements at once.
    #[inline]
    pub(super) fn write<T: Trace>(&self, first: usize, count: usize, trace: &mut T) {
        trace.write(self.array, first * size_of::<E>(), count * size_of::<E>());
    }

    /// The elements; nothing is told.
    pub(super) fn items(&self) -> &[E] {
        &self.items
    }

    /// The elements, for writing; nothing is told.
    pub(super) fn items_mut(&mut self) -> &mut [E] {
        &mut self.items
    }
}
