//! `adj serve` in a program without it; tests/page.py tests the server and the page.

use super::harness::{Folder, Runs as _};

#[test]
#[cfg(not(feature = "serve"))]
fn a_program_without_the_server_says_how_to_build_one_with_it() {
    let folder = Folder::new();
    folder.small_arena("a.adj");
    folder.adj("serve a.adj").refused(&["adj serve", "--features serve"]);
}
