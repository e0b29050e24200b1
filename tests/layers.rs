//! Imports point upstream only: volume -> classify -> arena <-> file -> traverse -> splat; `reference` judges splats from the volume alone,
//! `metrics` compares pictures; the program drives all.

use std::path::{Path, PathBuf};

/// Each module with those it may import; `error` and `limits` are everyone's.
const MAY_IMPORT: &[(&str, &[&str])] = &[
    ("error", &[]),
    ("limits", &[]),
    ("volume", &[]),
    ("classify", &["volume"]),
    ("arena", &["volume", "classify"]),
    ("file", &["volume", "arena"]),
    ("traverse", &["volume", "arena"]),
    ("splat", &["volume", "classify", "arena", "traverse"]),
    ("reference", &["volume", "classify", "splat"]),
    ("metrics", &["splat"]),
    ("study", &["volume", "classify", "arena", "file", "traverse", "splat", "reference", "metrics"]),
    ("cli", &["volume", "classify", "arena", "file", "traverse", "splat", "reference", "metrics", "study"]),
];

#[test]
fn imports_point_upstream() {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = 0;
    for (module, allowed) in MAY_IMPORT {
        for path in rust_files(&source, module) {
            files += 1;
            for (number, line) in std::fs::read_to_string(&path).unwrap().lines().enumerate() {
                for imported in imports(line) {
                    let fine = imported == *module
                        || imported == "error"
                        || imported == "limits"
                        || allowed.contains(&imported.as_str());
                    let known = MAY_IMPORT.iter().any(|(name, _)| *name == imported);
                    assert!(!known || fine, "{}:{}: {module} imports {imported}", path.display(), number + 1);
                }
            }
        }
    }
    assert!(files > 30, "only {files} files were read");
}

#[test]
fn every_module_is_in_the_table() {
    let lib = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("src/lib.rs")).unwrap();
    for line in lib.lines() {
        if let Some(name) = line.strip_prefix("pub mod ").and_then(|rest| rest.strip_suffix(';')) {
            assert!(MAY_IMPORT.iter().any(|(known, _)| *known == name), "{name} has no place in the order");
        }
    }
}

#[test]
fn unsafe_stays_in_its_files() {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    for path in rust_files(&source, "") {
        let name = path.strip_prefix(&source).unwrap().to_string_lossy().into_owned();
        let text = std::fs::read_to_string(&path).unwrap();
        let code = text.lines().filter(|line| !line.trim_start().starts_with("//"));
        let has_unsafe = code.into_iter().any(|line| line.contains("unsafe {") || line.contains("unsafe fn"));
        assert!(
            !has_unsafe || ["file/map.rs", "traverse/prefix.rs"].contains(&name.as_str()),
            "{name} has unsafe code"
        );
    }
}

#[test]
fn graphics_devices_stay_in_their_folder() {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    for path in rust_files(&source, "") {
        let name = path.strip_prefix(&source).unwrap().to_string_lossy().into_owned();
        let text = std::fs::read_to_string(&path).unwrap();
        let code = text.lines().filter(|line| !line.trim_start().starts_with("//"));
        let names_wgpu = code.clone().any(|line| line.contains("wgpu::") || line.contains("use wgpu"));
        assert!(!names_wgpu || name.starts_with("splat/gpu/"), "{name} names wgpu");
        let asks = code.into_iter().any(|line| line.contains("Instance::new(") || line.contains("request_device("));
        assert!(!asks || name == "splat/gpu/adapter.rs", "{name} asks the system for a device");
    }
}

/// Modules that a line names behind `crate::`, one or several in braces.
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
