//! CPU
pub(crate) mod arith;
pub(crate) mod blend;
pub(crate) mod dispatch;
pub(crate) mod freeze;
pub(crate) mod planes;
pub(crate) mod raster;
