//! The program, through its own binary: exit codes, what it prints where, and what it leaves behind.
#![cfg(feature = "cli")]

mod arenas;
mod harness;
mod hidden;
mod interrupt;
mod outputs;
mod transfer;
mod usage;
mod volumes;
