//! Inside the library, imports point upstream only; between crates the compiler sees to it.

use std::path::{Path, PathBuf};

/// Each folder of the library with those that it may import; `error`, `limits`, `parallel` and `text` are everyone's.
const MAY_IMPORT: &[(&str, &[&str])] = &[
    ("error", &[]),
    ("limits", &[]),
    ("parallel", &[]),
    ("text", &[]),
    ("volume", &[]),
    ("classify", &["volume"]),
    ("arena", &["volume", "classify"]),
    ("build", &["volume", "classify", "arena"]),
    ("traverse", &["volume", "arena"]),
    ("splat", &["volume", "classify", "arena", "traverse"]),
    ("file", &["volume", "arena", "build", "splat"]),
    ("collection", &["volume", "classify", "arena", "build", "file", "traverse", "splat"]),
];

const EVERYONES: [&str; 4] = ["error", "limits", "parallel", "text"];

fn core() -> PathBuf {
    adjsplat_tests::repository().join("src/core")
}

#[test]
fn imports_point_upstream() {
    let mut files = 0;
    for (module, allowed) in MAY_IMPORT {
        for path in rust_files(&core(), module) {
            files += 1;
            let text = std::fs::read_to_string(&path).unwrap();
            // A file's own tests may use what lies downstream.
            let code = text.split("#[cfg(test)]").next().unwrap_or_default();
            for (number, line) in code.lines().enumerate() {
                for imported in imports(line) {
                    let may =
                        imported == *module || EVERYONES.contains(&imported.as_str()) || allowed.contains(&&*imported);
                    let is_module = MAY_IMPORT.iter().any(|(name, _)| *name == imported);
                    assert!(!is_module || may, "{}:{}: {module} imports {imported}", path.display(), number + 1);
                }
            }
        }
    }
    assert!(files > 30, "only {files} files were read");
}

#[test]
fn every_module_is_in_the_table() {
    let lib = std::fs::read_to_string(core().join("lib.rs")).unwrap();
    for line in lib.lines() {
        let name = line.trim_start_matches("pub ").strip_prefix("mod ").and_then(|name| name.strip_suffix(';'));
        if let Some(name) = name.filter(|name| !["internals", "model"].contains(name)) {
            assert!(MAY_IMPORT.iter().any(|(known, _)| *known == name), "{name} has no place in the order");
        }
    }
}

#[test]
fn unsafe_stays_in_its_files() {
    let source = adjsplat_tests::repository().join("src");
    for path in rust_files(&source, "") {
        let name = path.strip_prefix(&source).unwrap().to_string_lossy().into_owned();
        let text = std::fs::read_to_string(&path).unwrap();
        let code = text.lines().filter(|line| !line.trim_start().starts_with("//"));
        let has_unsafe = code.into_iter().any(|line| line.contains("unsafe {") || line.contains("unsafe fn"));
        let may = ["core/file/map.rs", "core/traverse/simd.rs"].contains(&name.as_str());
        assert!(!has_unsafe || may, "{name} has unsafe code");
    }
}

#[test]
fn graphics_devices_stay_in_their_folder() {
    let source = adjsplat_tests::repository().join("src");
    for path in rust_files(&source, "") {
        let name = path.strip_prefix(&source).unwrap().to_string_lossy().into_owned();
        let text = std::fs::read_to_string(&path).unwrap();
        let code = text.lines().filter(|line| !line.trim_start().starts_with("//"));
        // What egui calls its own settings is not wgpu's interface.
        let code = code.map(|line| line.replace("egui_wgpu::", ""));
        let names_wgpu = code.clone().any(|line| line.contains("wgpu::") || line.contains("use wgpu"));
        // One paints pictures into a window, on the window's own device.
        let may = name.starts_with("core/splat/gpu/") || name == "view/draw/texture.rs";
        assert!(!names_wgpu || may, "{name} names wgpu");
        let asks = code.clone().any(|line| line.contains("Instance::new(") || line.contains("request_device("));
        assert!(!asks || name == "core/splat/gpu/adapter.rs", "{name} asks the system for a device");
    }
}

/// Returns the modules that a line names behind `crate::`, one or several in braces.
fn imports(line: &str) -> Vec<String> {
    let line = line.split("//").next().unwrap_or_default();
    line.split("crate::").skip(1).flat_map(names).collect()
}

fn names(path: &str) -> Vec<String> {
    let name = |text: &str| text.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect::<String>();
    match path.strip_prefix('{') {
        Some(list) => list.split(',').map(|entry| name(entry.trim())).collect(),
        None => vec![name(path)],
    }
}

fn rust_files(source: &Path, module: &str) -> Vec<PathBuf> {
    let single = source.join(format!("{module}.rs"));
    let mut files: Vec<PathBuf> = single.is_file().then_some(single).into_iter().collect();
    let mut folders = vec![source.join(module)];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).into_iter().flatten() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                files.push(path);
            }
        }
    }
    files
}
