//! Scratch arrays that trace each access to an element.

use crate::trace::Trace;

/// A scratch array, and the number by which a trace names it.
#[derive(Debug, Clone)]
pub(super) struct TracedVec<E> {
    array: usize,
    items: Vec<E>,
}

impl<E: Copy + Default> TracedVec<E> {
    /// Creates array number `array` with `len` elements.
    pub(super) fn new(array: usize, len: usize) -> TracedVec<E> {
        TracedVec { array, items: vec![E::default(); len] }
    }

    /// Returns the number of elements.
    pub(super) fn len(&self) -> usize {
        self.items.len()
    }

    /// Reads the element at `index`, and traces it.
    #[inline]
    pub(super) fn get<T: Trace>(&self, index: usize, trace: &mut T) -> E {
        self.read(index, 1, trace);
        self.items[index]
    }

    /// Writes the element at `index`, and traces it.
    #[inline]
    pub(super) fn set<T: Trace>(&mut self, index: usize, item: E, trace: &mut T) {
        self.write(index, 1, trace);
        self.items[index] = item;
    }

    /// Traces one read of `count` elements from `first` on.
    #[inline]
    pub(super) fn read<T: Trace>(&self, first: usize, count: usize, trace: &mut T) {
        trace.read(self.array, first * size_of::<E>(), count * size_of::<E>());
    }

    /// Traces one write of `count` elements from `first` on.
    #[inline]
    pub(super) fn write<T: Trace>(&self, first: usize, count: usize, trace: &mut T) {
        trace.write(self.array, first * size_of::<E>(), count * size_of::<E>());
    }

    /// Returns the elements; what the caller reads is not traced.
    pub(super) fn items(&self) -> &[E] {
        &self.items
    }

    /// Returns the elements for writing; what the caller reads or writes is not traced.
    pub(super) fn items_mut(&mut self) -> &mut [E] {
        &mut self.items
    }
}
