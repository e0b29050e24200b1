//! Allocates arrays whose size depends on the input: too large a size is an error.

use adjsplat::error::{Error, Result};

/// Returns `count` copies of `element`; `what` names them in errors.
///
/// # Errors
/// [`Error::OutOfMemory`].
pub(crate) fn filled<T: Clone>(what: &str, count: u64, element: T) -> Result<Vec<T>> {
    let refused = || Error::out_of_memory(what, count.saturating_mul(size_of::<T>() as u64));
    let count = usize::try_from(count).map_err(|_| refused())?;
    let mut elements = Vec::new();
    elements.try_reserve_exact(count).map_err(|_| refused())?;
    elements.resize(count, element);
    Ok(elements)
}
