//! The program, through its own binary: exit codes, what it prints where, and what it leaves behind.

mod arenas;
mod brick;
mod budgets;
mod cache;
mod collection;
mod compare;
#[cfg(target_os = "linux")]
mod cut;
mod devices;
mod export;
mod harness;
mod hidden;
mod interrupt;
mod killed;
mod levels;
mod library;
#[cfg(target_os = "linux")]
mod limits;
mod memory;
mod outputs;
mod serve;
mod stdout;
mod study;
mod transfer;
mod trim;
mod usage;
#[cfg(unix)]
mod view;
mod volumes;
