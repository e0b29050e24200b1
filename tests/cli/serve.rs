//! `adj serve` in a program without it; tests/page.py tests the server and the page.
#![cfg(not(feature = "serve"))]

use super::harness::{Folder, Runs as _};

#[test]
fn a_program_without_the_server_says_how_to_build_one_with_it() {
    let folder = Folder::new();
    folder.small_arena("a.adj");
    folder.adj("serve a.adj").refused(&["adj serve", "--features serve"]);
}
