//! `adj`: build, inspect, verify and render `.adj` files.

use std::process::ExitCode;

fn main() -> ExitCode {
    adjsplat::cli::main()
}
