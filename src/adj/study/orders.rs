//! Orders by name: `+z-y+x` is slow z ascending, medium y descending, fast x ascending.

use adjsplat::error::{Error, Result};
use adjsplat::traverse::{AxisOrder, Order};
use adjsplat_study::walks::{ORDERS, order};

/// The name of an order of a parallel view.
pub(super) fn name(order: &Order) -> String {
    let axes = [order.slow, order.medium, order.fast];
    let part = |axis: adjsplat::volume::Axis| {
        let sign = if matches!(order.along[axis.index()], AxisOrder::Ascending) { '+' } else { '-' };
        format!("{sign}{}", axis.name())
    };
    axes.map(part).concat()
}

/// The orders that `text` means: `all`, a number of them, evenly among the 48, or names with commas between.
///
/// # Errors
/// [`Error::Input`] for anything else.
pub(super) fn parse(text: &str) -> Result<Vec<Order>> {
    let all = || (0..ORDERS).map(order);
    if text == "all" {
        return Ok(all().collect());
    }
    if let Ok(count) = text.parse::<usize>() {
        if !(1..=ORDERS).contains(&count) {
            return Err(Error::input("--orders", format!("are {count}, but must be 1 to {ORDERS}")));
        }
        // A stride that is odd meets both directions of every axis.
        return Ok((0..count).map(|index| order(index * ORDERS / count)).collect());
    }
    let named = |wanted: &str| {
        let why = || format!("has {wanted}, but must be all, a number, or names such as +z-y+x with commas between");
        all().find(|order| name(order) == wanted).ok_or_else(|| Error::input("--orders", why()))
    };
    text.split(',').map(|wanted| named(wanted.trim())).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_return_and_numbers_spread() {
        for order in parse("all").unwrap() {
            assert_eq!(parse(&name(&order)).unwrap(), [order]);
        }
        assert_eq!(parse("all").unwrap().len(), 48);
        assert_eq!(parse("+z+y+x, -x-y-z").unwrap().len(), 2);
        assert_eq!(parse("5").unwrap().len(), 5);
        for wrong in ["0", "49", "zyx", "", "+z+y"] {
            assert!(parse(wrong).unwrap_err().to_string().contains("--orders"), "{wrong}");
        }
    }
}
