//! The viewer of adjsplat, on the desktop and in the browser.
