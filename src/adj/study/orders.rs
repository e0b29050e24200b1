//! Names of orders: `+z-y+x` is z ascending (slowest), y descending, x ascending (fastest).

use adjsplat::error::{Error, Result};
use adjsplat::traverse::{AxisOrder, Order};
use adjsplat_study::walks::{ORDERS, order};

/// Returns the name of an order of a parallel view.
pub(super) fn name(order: &Order) -> String {
    let axes = [order.slow, order.medium, order.fast];
    let signed = |axis: adjsplat::volume::Axis| {
        let sign = if matches!(order.along[axis.index()], AxisOrder::Ascending) { '+' } else { '-' };
        format!("{sign}{}", axis.name())
    };
    axes.map(signed).concat()
}

/// A list of orders of parallel views.
#[derive(Debug, Clone)]
pub(super) struct Orders(pub(super) Vec<Order>);

/// Parses `all`, a number of orders (spread evenly over the 48), or names with commas between.
pub(super) fn parse(text: &str) -> Result<Orders> {
    let all = || (0..ORDERS).map(order);
    if text == "all" {
        return Ok(Orders(all().collect()));
    }
    if let Ok(count) = text.parse::<usize>() {
        if !(1..=ORDERS).contains(&count) {
            return Err(Error::input("orders", format!("must be 1 to {ORDERS}")));
        }
        // The stride is odd, so that both directions of every axis occur.
        return Ok(Orders((0..count).map(|index| order(index * ORDERS / count)).collect()));
    }
    let named = |wanted: &str| {
        let why = "must be all, a number, or names such as +z-y+x with commas between";
        all().find(|order| name(order) == wanted).ok_or_else(|| Error::input("orders", why))
    };
    text.split(',').map(|wanted| named(wanted.trim())).collect::<Result<_>>().map(Orders)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_return_and_numbers_spread() {
        let parsed = |text: &str| parse(text).unwrap().0;
        for order in parsed("all") {
            assert_eq!(parsed(&name(&order)), [order]);
        }
        assert_eq!(["all", "+z+y+x, -x-y-z", "5"].map(|text| parsed(text).len()), [48, 2, 5]);
        for wrong in ["0", "49", "zyx", "", "+z+y"] {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
    }
}
