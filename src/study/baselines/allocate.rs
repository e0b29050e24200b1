//! Allocates memory for a method's arrays: the size is checked first, and too large a size is an error.

use adjsplat::error::{Error, Result};

/// Returns an error if the system says that it has less than `need` bytes of memory available.
pub(super) fn check(what: &str, need: u64) -> Result<()> {
    // Systems grant more memory than they have, and end a process that uses it. So the system is asked first. Small
    // arrays are not checked, as that takes as long as filling them.
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

/// Returns `count`, a number of elements that have numbers of 32 bits; `what` names them in errors.
pub(super) fn counted(what: &str, count: u64) -> Result<u32> {
    u32::try_from(count).map_err(|_| Error::Limit { what: what.into(), need: count, have: u32::MAX.into() })
}

/// Returns an empty array with room for exactly `count` elements; `what` names it in errors.
pub(super) fn reserved<T>(what: &str, count: u64) -> Result<Vec<T>> {
    let need = count.saturating_mul(size_of::<T>() as u64);
    check(what, need)?;
    let mut elements = Vec::new();
    let count = usize::try_from(count).map_err(|_| refused(what, need, usize::MAX as u64))?;
    elements.try_reserve_exact(count).map_err(|_| Error::out_of_memory(what, need))?;
    Ok(elements)
}

/// Returns an array of `count` copies of `element`; `what` names it in errors.
pub(super) fn filled<T: Clone>(what: &str, count: u64, element: T) -> Result<Vec<T>> {
    let mut elements = reserved(what, count)?;
    elements.resize(usize::try_from(count).expect("there is room for as many"), element);
    Ok(elements)
}

/// Appends `element` to an array whose final length is not known in advance; `what` names the array in errors.
pub(super) fn push<T>(what: &str, elements: &mut Vec<T>, element: T) -> Result<()> {
    if elements.len() == elements.capacity() {
        // Growing doubles the array, and the old one exists until it is copied, so both count.
        let need = (elements.len() as u64).saturating_mul(2 * size_of::<T>() as u64);
        check(what, need)?;
        elements.try_reserve(1).map_err(|_| Error::out_of_memory(what, need))?;
    }
    elements.push(element);
    Ok(())
}

/// Returns the product of three sizes, or the largest number on overflow, which [`reserved`] refuses.
pub(super) fn product([x, y, z]: [u64; 3]) -> u64 {
    x.saturating_mul(y).saturating_mul(z)
}

/// Returns the bytes of memory that the system can give now; `None` if it does not say.
fn available_bytes() -> Option<u64> {
    let memory = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = memory.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib * 1024)
}
