//! The bytes of `.adj` files: what is accepted, what is refused, and that nothing else happens.
//!
//! Judged by frozen examples (`formats/examples`, results in `expected.txt`), by a plain oracle that shares only the
//! record structs, and by a reader in another language. Cannot catch: an error in the specification that the
//! library, the oracle and the reader share.
//!
//! `ADJ_BLESS=1 cargo test -p adjsplat-tests --test core examples` rewrites the examples and their results.
//! `ADJ_PYTHON=require` makes a missing Python or numpy a failure.

pub(crate) mod assemble;
mod consume;
mod damage;
mod examples;
mod mutants;
mod mutate;
mod oracle;
mod python;
mod refused;
mod scenes;
