//! Room: memory for a method's arrays, asked for before it is taken.
//!
//! In: how many elements. Out: an empty array with room for exactly so many, or an error that says how much is missing.

use adjsplat::error::{Error, Result};

/// Whether the system has `need` bytes for `what` available; where it does not say so, it has.
///
/// # Errors
/// [`Error::Limit`] if not.
pub(super) fn check(what: &str, need: u64) -> Result<()> {
    // Systems grant more than they have, and end the process when it is used. So they are asked first; not for
    // small arrays, as asking takes as long as filling them.
    if need <= 1 << 24 {
        return Ok(());
    }
    match available_bytes().filter(|&available| need > available) {
        Some(available) => Err(refused(what, need, available)),
        None => Ok(()),
    }
}

fn refused(what: &str, need: u64, have: u64) -> Error {
    Error::Limit { what: format!("memory for {what} in bytes"), need, have }
}

/// An empty array with room for `count` elements and no more; `what` names it in the error.
///
/// # Errors
/// [`Error::Limit`] if that is more than the system has available, where it says so, or grants.
pub(super) fn room<T>(what: &str, count: u64) -> Result<Vec<T>> {
    let need = count.saturating_mul(size_of::<T>() as u64);
    check(what, need)?;
    let mut elements = Vec::new();
    let count = usize::try_from(count).map_err(|_| refused(what, need, usize::MAX as u64))?;
    elements.try_reserve_exact(count).map_err(|_| Error::out_of_memory(what, need))?;
    Ok(elements)
}

/// As [`room`], filled with `element`.
///
/// # Errors
/// As [`room`].
pub(super) fn filled<T: Clone>(what: &str, count: u64, element: T) -> Result<Vec<T>> {
    let mut elements = room(what, count)?;
    elements.resize(usize::try_from(count).expect("there is room for as many"), element);
    Ok(elements)
}

/// Appends `element`; arrays whose length is known only in the end grow by this, and are shrunk then.
///
/// # Errors
/// As [`room`].
pub(super) fn push<T>(what: &str, elements: &mut Vec<T>, element: T) -> Result<()> {
    if elements.len() == elements.capacity() {
        // Growing doubles it, and the old one is there until the new one is filled.
        let need = (elements.len() as u64).saturating_mul(2 * size_of::<T>() as u64);
        check(what, need)?;
        elements.try_reserve(1).map_err(|_| Error::out_of_memory(what, need))?;
    }
    elements.push(element);
    Ok(())
}

/// Product of three sizes, which saturates: what is too large is refused by [`room`].
pub(super) fn product([x, y, z]: [u64; 3]) -> u64 {
    x.saturating_mul(y).saturating_mul(z)
}

/// Memory that the system could give now; `None` where it does not say.
fn available_bytes() -> Option<u64> {
    let memory = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = memory.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib * 1024)
}
