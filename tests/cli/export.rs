//! `adj export`: what comes back from each dense format through the readers, what the other formats hold, what is
//! refused, and that nothing half-written is left.
//!
//! Cannot catch: a misreading of a format that the readers share. `tests/export_readers.py` asks readers of others.

use std::path::Path;

use adjsplat::Model;
use adjsplat::arena::layout::{Channels, Facts, Scales};
use adjsplat::arena::{Levels, Record, Region, Rows, TileOrder, Voxel};
use adjsplat::error::Result;
use adjsplat::file::{RowsOutput, write_rows};
use adjsplat::traverse::Viewpoint;
use adjsplat::volume::{Grid, Header, SampleType, Samples};
use adjsplat_readers::{OpenOptions, RawOptions, open};
use adjsplat_tests::{at_full, real_volume};
use serde_json::Value;

use super::harness::{Folder, RAW, Runs as _};

/// Endings of dense formats that the readers open.
const DENSE: [&str; 7] = ["nrrd", "nii", "nii.gz", "mha", "vti", "zarr", "raw"];

/// Position and value of each voxel of a file.
fn voxels(path: &Path) -> Vec<([u16; 3], f64)> {
    let model = Model::open(path).expect("it was built");
    let mut all = Vec::new();
    let view = Viewpoint::parallel([0.0, 0.0, 1.0]).expect("a direction");
    model.walk(&view, |voxels| all.extend(voxels.iter().map(|voxel| (voxel.position, voxel.value)))).expect("walks");
    all.sort_by_key(|(position, _)| *position);
    all
}

/// Reads a dense volume.
fn dense(path: &Path, told: &Value, grid: &Grid) -> (Header, Vec<f64>) {
    let mut options = OpenOptions::new();
    if path.extension().is_some_and(|ending| ending == "raw") {
        let named = |known: &SampleType| told["sample_type"] == known.name();
        let sample_type = SampleType::ALL.into_iter().find(named).expect("a type");
        options = options.raw(RawOptions::new(grid.dims.map(u64::from), sample_type));
    }
    let mut source = open(path, &options).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let header = source.header().clone();
    let mut slice = header.new_slice().expect("small");
    let mut samples = Vec::new();
    for _ in 0..header.grid.dims[2] {
        source.read_slice(&mut slice).expect("reads");
        samples.extend((0..slice.len()).map(|index| slice.get(index) * header.slope + header.intercept));
    }
    (header, samples)
}

fn near(a: [f64; 3], b: [f64; 3], tolerance: f64) -> bool {
    let scale = b.iter().fold(1.0f64, |most, c| most.max(c.abs()));
    a.iter().zip(b).all(|(a, b)| (a - b).abs() <= tolerance * scale)
}

/// Exports `name` to every dense format and reads it back: the visible voxels and no others, in the same place.
fn check_dense(folder: &Folder, name: &str) {
    let kept = voxels(&folder.file(name));
    let grid = Model::open(folder.file(name)).expect("it was built").grid().clone();
    for ending in DENSE {
        let out = format!("out.{ending}");
        let told = folder.adj(&format!("export {name} -o {out} --json")).json();
        assert_eq!(told["voxels"], kept.len(), "{ending}");
        let (header, samples) = dense(&folder.file(&out), &told, &grid);
        assert_eq!(header.sample_type.name(), told["sample_type"], "{ending}");
        assert_eq!(header.grid.dims, grid.dims, "{ending}");
        if ending != "raw" {
            let tolerance = if ending.starts_with("nii") { 1e-6 } else { 1e-12 };
            assert!(near(header.grid.spacing, grid.spacing, tolerance), "{ending}: {:?}", header.grid);
            assert!(near(header.grid.origin, grid.origin, tolerance), "{ending}: {:?}", header.grid);
            for (axis, right) in header.grid.direction.into_iter().zip(grid.direction) {
                assert!(near(axis, right, tolerance), "{ending}: {axis:?} {right:?}");
            }
        }
        let fill = told["fill"].as_f64().expect("a number");
        let mut expected = vec![fill; samples.len()];
        let [nx, ny, _] = grid.dims.map(|points| points as usize);
        let rounding = told["rounding"].as_f64().expect("a number");
        for (position, value) in &kept {
            let [x, y, z] = position.map(usize::from);
            expected[(z * ny + y) * nx + x] = *value;
        }
        let wrong = samples.iter().zip(&expected).find(|(found, right)| (*found - *right).abs() > rounding * 1.001);
        assert_eq!(wrong, None, "{ending}");
        let path = folder.file(&out);
        if path.is_dir() { std::fs::remove_dir_all(path) } else { std::fs::remove_file(path) }.expect("it was there");
    }
}

/// Writes a NRRD file of `samples` in an oblique, anisotropic frame with an origin.
fn oblique(folder: &Folder, name: &str, dims: [u32; 3], samples: &Samples) {
    let sample_type = match samples.sample_type() {
        SampleType::U8 => "uint8",
        SampleType::I8 => "int8",
        SampleType::U16 => "uint16",
        SampleType::I16 => "int16",
        SampleType::U32 => "uint32",
        SampleType::I32 => "int32",
        SampleType::F32 => "float",
        SampleType::F64 => "double",
    };
    let [nx, ny, nz] = dims;
    let header = format!(
        "NRRD0004\ntype: {sample_type}\ndimension: 3\nspace: RAS\nsizes: {nx} {ny} {nz}\n\
         space directions: (0.36,0.48,-0.8) (-1.6,1.2,0) (1.44,1.92,1.8)\nendian: {}\nencoding: raw\n\
         space origin: (12.5,-80.25,1e3)\n\n",
        if cfg!(target_endian = "big") { "big" } else { "little" }
    );
    folder.write(name, &[header.as_bytes(), samples.bytes()].concat());
}

#[test]
fn every_sample_type_comes_back_from_every_dense_format() {
    let dims = [70, 5, 67];
    let count = 70 * 5 * 67;
    // Values from 0 to 100, most of them in the middle, and whole slices and columns without visible ones.
    let level = |i: u32| if i / 350 % 5 == 2 || i % 70 > 66 { 0 } else { u8::try_from(i * 7919 % 101).expect("small") };
    let levels = || (0..count).map(level);
    let low = |level: u8| f64::from(level) - 50.0;
    let all = [
        (Samples::U8(levels().collect()), "--range 20..", "u8"),
        (Samples::I8(levels().map(|v| v.cast_signed() - 50).collect()), "--range -20..", "i8"),
        (Samples::U16(levels().map(|v| u16::from(v) * 600).collect()), "--range 20000..", "u16"),
        (Samples::I16(levels().map(|v| (i16::from(v) - 50) * 600).collect()), "--range ..-1", "i16"),
        (Samples::U32(levels().map(|v| u32::from(v) * 40_000_000).collect()), "--range 80000000..", "u32"),
        (Samples::I32(levels().map(|v| (i32::from(v) - 50) * 40_000_000).collect()), "--range 1..", "i32"),
        (Samples::F32(levels().map(|v| f32::from(v).sqrt()).collect()), "--range 3.. --value-bits 16", "f32"),
        (Samples::F64(levels().map(|v| low(v) * 1e6).collect()), "--range 1..", "f64"),
        // Codes of eight bits round it, and the export does not round again.
        (Samples::F64(levels().map(|v| (low(v) / 8.0).exp()).collect()), "--range 1..", "f64"),
    ];
    for (samples, flags, exported) in all {
        let folder = Folder::new();
        oblique(&folder, "v.nrrd", dims, &samples);
        folder.adj(&format!("build v.nrrd {flags} -o a.adj")).done();
        let told = folder.adj("export a.adj -o b.nrrd --json").json();
        assert_eq!(told["sample_type"], exported);
        assert_eq!(told["rounding"] == 0.0, exported != "f32", "{told}");
        check_dense(&folder, "a.adj");
        // The same flags make the same file of the export, but for normals, which depend on hidden voxels.
        folder.adj(&format!("build b.nrrd {flags} -o again.adj")).done();
        let (one, two) = (voxels(&folder.file("a.adj")), voxels(&folder.file("again.adj")));
        assert_eq!(one.len(), two.len(), "{exported}");
        let differ = one.iter().zip(&two).find(|(a, b)| a.0 != b.0 || (a.1 - b.1).abs() > 2e-7 * a.1.abs());
        assert_eq!(differ, None, "{exported}");
    }
}

#[test]
fn real_volumes_come_back_from_every_dense_format() {
    for (file, flags) in [
        ("frogtissue/frogtissue.mhd", "--labels frog"),
        ("headsq-quarter/quarter.nhdr", "--range 500.. --value-bits 16"),
        ("SAG-anon", "--range 300.. --value-bits 16"),
        ("scivis-engine/engine.nii.gz", "--range 60.."),
        ("carotid/carotid.vtk", "--range 150.."),
        ("hydrogen/hydrogen.vti", "--range 0.05.."),
    ] {
        let Some(path) = real_volume(file) else { return };
        let folder = Folder::new();
        folder.adj(&format!("build {} {flags} -o a.adj", path.display())).done();
        check_dense(&folder, "a.adj");
    }
}

#[test]
fn a_crop_that_keeps_the_grid_and_a_transfer_function_are_exported_as_they_are() {
    let folder = Folder::new();
    folder.adj("build phantom:gyroid --dims 40x30x20 --spacing 1x2x0.5 -o a.adj").done();
    folder.adj("trim a.adj -o b.adj --crop 7..30,3..28,5..6 --keep-grid").done();
    check_dense(&folder, "b.adj");
    folder.adj("trim a.adj -o c.adj --crop 7..30,3..28,5..6").done();
    check_dense(&folder, "c.adj");
    let told = folder.adj("export a.adj -o all.nii --json").json();
    let few = folder.adj("export a.adj -o few.nii --range 130..138 --json").json();
    assert!(few["voxels"].as_u64() < told["voxels"].as_u64(), "{few} {told}");
    folder.adj("trim a.adj -o few.adj --range 130..138").done();
    folder.adj("export few.adj -o trimmed.nii").done();
    assert!(
        std::fs::read(folder.file("few.nii")).expect("it") == std::fs::read(folder.file("trimmed.nii")).expect("it")
    );
}

#[test]
fn hidden_points_get_a_value_that_is_hidden() {
    let folder = Folder::new();
    let samples = Samples::I16((-30..30).collect());
    oblique(&folder, "v.nrrd", [5, 4, 3], &samples);
    let exported = |build: &str, flags: &str| {
        folder.adj(&format!("build v.nrrd {build} -o a.adj")).done();
        let ran = folder.adj(&format!("export a.adj -o a.mha --json {flags}"));
        let warned = ran.stderr.clone();
        (ran.json()["fill"].as_f64().expect("a number"), warned)
    };
    assert_eq!(exported("--range 5..", "").0, 0.0);
    assert_eq!(exported("--range -10..10", "").0, -30.0);
    assert_eq!(exported("--range ..10", "").0, 32767.0);
    assert_eq!(exported("--range 5..", "--fill -7"), (-7.0, String::new()));
    let (fill, warned) = exported("--range 5..", "--fill 6");
    assert_eq!(fill, 6.0);
    assert!(warned.contains("warning: the fill value 6 is visible"), "{warned}");
    for fill in ["0.5", "40000", "nan"] {
        folder.adj(&format!("export a.adj -o b.mha --fill {fill}")).refused(&["--fill", "i16", "-32768 to 32767"]);
    }
    folder.adj("export a.adj -o b.ply --fill 0").refused(&["--fill", "only visible voxels"]);
    // Floating-point samples may be filled with NaN, which JSON spells.
    oblique(&folder, "f.nrrd", [5, 4, 3], &Samples::F32((0u16..60).map(|v| f32::from(v).sqrt()).collect()));
    folder.adj("build f.nrrd --range 2.. -o f.adj").done();
    for ending in ["nii", "zarr", "npz"] {
        let told = folder.adj(&format!("export f.adj -o f.{ending} --fill nan --json")).json();
        assert_eq!(told["fill"], "NaN");
    }
    let fill: Value =
        serde_json::from_slice(&std::fs::read(folder.file("f.zarr/0/.zarray")).expect("it")).expect("JSON");
    assert_eq!(fill["fill_value"], "NaN");
}

/// The ends of this range are no numbers of single precision: 33.3 rounds to one below it, and 90.1 to one above.
#[test]
fn voxels_at_the_ends_of_a_range_are_visible_in_an_export_too() {
    let level = |i: u32| u16::try_from(i * 7919 % 1999).expect("small");
    let all = [
        Samples::F32((0..8000).map(|i| f32::from(level(i)) / 19.0).collect()),
        Samples::F64((0..8000).map(|i| f64::from(level(i)) / 19.0).collect()),
    ];
    for samples in all {
        let folder = Folder::new();
        oblique(&folder, "in.nrrd", [20; 3], &samples);
        folder.adj("build in.nrrd --range 33.3..90.1 -o in.adj").done();
        let kept = voxels(&folder.file("in.adj")).len();
        folder.adj("export in.adj -o out.nrrd").done();
        folder.adj("build out.nrrd --range 33.3..90.1 -o out.adj").done();
        assert_eq!(voxels(&folder.file("out.adj")).len(), kept, "{}", samples.sample_type().name());
    }
}

/// A volume of nothing but the fill had no chunk at all, and could not be read again.
#[test]
fn a_zarr_folder_of_nothing_but_the_fill_is_read_again() {
    let folder = Folder::new();
    folder.write("v.raw", &[0; 60]);
    folder.adj("build v.raw --dims 5x4x3 --type u8 --range 0.. -o a.adj").done();
    folder.adj("export a.adj -o a.zarr").done();
    let told = folder.adj("info a.zarr --json").json();
    assert_eq!((&told["lowest"], &told["highest"]), (&0.0.into(), &0.0.into()));
}

#[test]
fn label_maps_stay_label_maps() {
    let folder = Folder::new();
    let labels: Vec<u8> = (0u8..60).map(|i| if i % 3 == 0 { 0 } else { i % 5 + 1 }).collect();
    oblique(&folder, "v.nrrd", [5, 4, 3], &Samples::U8(labels));
    folder.adj("build v.nrrd --labels distinct -o a.adj").done();
    check_dense(&folder, "a.adj");
    folder.adj("export a.adj -o a.nii.gz").done();
    let told = folder.adj("info a.nii.gz --json").json();
    assert_eq!((&told["suggestion"], &told["sample_type"]), (&"--labels distinct".into(), &"u8".into()));
}

#[test]
fn axes_too_long_for_nifti_1_make_nifti_2() {
    let folder = Folder::new();
    folder.adj("build phantom:corners --dims 32767x2x2 -o a.adj").done();
    folder.adj("build phantom:corners --dims 32768x2x2 -o b.adj").done();
    folder.adj("export a.adj -o a.nii").done();
    folder.adj("export b.adj -o b.nii").done();
    assert_eq!(folder.adj("info a.nii --json").json()["format"], "NIfTI-1");
    assert_eq!(folder.adj("info b.nii --json").json()["format"], "NIfTI-2");
    check_dense(&folder, "b.adj");
}

#[test]
fn a_table_has_a_line_for_each_voxel() {
    let folder = Folder::new();
    folder.write("v.raw", &RAW);
    folder.adj("build v.raw --dims 4x3x2 --type u8 --spacing 1x2x3 --range 22.. --normals none -o a.adj").done();
    let told = folder.adj("export a.adj -o a.csv").done();
    assert!(told.starts_with("a.csv: 3 voxels; "), "{told}");
    let table = std::fs::read_to_string(folder.file("a.csv")).expect("it was written");
    assert_eq!(table, "i,j,k,x,y,z,value\n1,2,1,1,4,3,22\n2,2,1,2,4,3,23\n3,2,1,3,4,3,24\n");
    folder.adj("build v.raw --dims 4x3x2 --type u8 --iso 12 -o b.adj").done();
    folder.adj("export b.adj -o b.csv").done();
    let table = std::fs::read_to_string(folder.file("b.csv")).expect("it was written");
    assert!(table.starts_with("i,j,k,x,y,z,value,nx,ny,nz,gradient\n"), "{table}");
}

/// The numbers of a PLY file's Gaussians, 26 each.
fn gaussians(path: &Path) -> Vec<Vec<f32>> {
    let bytes = std::fs::read(path).expect("it was written");
    let end = b"end_header\n";
    let at = bytes.windows(end.len()).position(|window| window == end).expect("a header") + end.len();
    let numbers = bytes[at..].chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    numbers.collect::<Vec<f32>>().chunks_exact(26).map(<[f32]>::to_vec).collect()
}

#[test]
fn gaussians_have_the_place_size_opacity_and_colour_of_their_voxels() {
    let folder = Folder::new();
    folder.write("v.raw", &RAW);
    let points = r##"{"kind":"points","shaded":SHADED,"points":[{"value":22,"colour":"#ff8000","opacity":0},
        {"value":24,"colour":"#ff8000","opacity":0.5}]}"##;
    folder.write("plain.json", points.replace("SHADED", "false").as_bytes());
    folder.write("lit.json", points.replace("SHADED", "true").as_bytes());
    let build = "build v.raw --dims 4x3x2 --type u8 --spacing 2x2x2";
    folder.adj(&format!("{build} --tf plain.json -o plain.adj")).done();
    folder.adj(&format!("{build} --tf lit.json -o lit.adj")).done();
    folder.adj("export plain.adj -o plain.ply").done();
    folder.adj("export lit.adj -o lit.ply").done();
    let plain = gaussians(&folder.file("plain.ply"));
    assert_eq!(plain.len(), 2);
    let last = &plain[1];
    assert_eq!(last[..6], [6.0, 4.0, 2.0, 0.0, 0.0, 0.0]);
    let close = |found: f32, right: f64| assert!((f64::from(found) - right).abs() < 1e-5, "{found} {right}");
    // sRGB 1, 128/255, 0 as coefficients of the constant harmonic; no linear ones.
    for (found, shown) in last[6..9].iter().zip([1.0, 128.0 / 255.0, 0.0]) {
        close(*found, (shown - 0.5) / 0.282_094_791_773_878);
    }
    assert_eq!(last[9..18], [0.0; 9]);
    // A voxel of opacity 0.5 has the optical depth ln 2; at the footprint's centre it is divided by 2 pi 0.7^2.
    let alpha = 1.0 - (-(2f64.ln()) / (std::f64::consts::TAU * 0.49)).exp();
    close(last[18], (alpha / (1.0 - alpha)).ln());
    last[19..22].iter().for_each(|scale| close(*scale, 1.4f64.ln()));
    assert_eq!(last[22..], [1.0, 0.0, 0.0, 0.0]);
    // Lit from the eye, the linear harmonics lie along the normal, which points out of the corner.
    let lit = &gaussians(&folder.file("lit.ply"))[1];
    let red = [-lit[11], -lit[9], lit[10]].map(|component| -component);
    assert!(red.iter().all(|component| *component > 0.1) || red.iter().all(|component| *component < -0.1), "{lit:?}");
    // Facing the eye, the colour is that of full light, but for the straight line.
    let normal = red.map(|c| f64::from(c) / red.iter().map(|c| f64::from(c * c)).sum::<f64>().sqrt());
    let facing = 0.5
        + 0.282_094_791_773_878 * f64::from(lit[6])
        + 0.488_602_511_902_92 * red.iter().zip(normal).map(|(c, n)| f64::from(*c) * n).sum::<f64>();
    assert!((facing - 1.0).abs() < 0.05, "{facing}");
}

#[test]
fn packed_gaussians_have_bounds() {
    let folder = Folder::new();
    folder.adj("build phantom:corners --dims 9x9x9 --spacing 1e-5x1e-5x1e-5 -o tiny.adj").done();
    folder.adj("export tiny.adj -o a.spz").refused(&["4.6e-5 to 379", "use .ply"]);
    folder.adj("build phantom:corners --dims 60000x3x3 --spacing 300x300x300 -o far.adj").done();
    folder.adj("export far.adj -o a.spz").refused(&["8388607", "use .ply"]);
    let said = folder.adj("export tiny.adj -o a.vdb").refused(&["OpenVDB", "use another format"]);
    assert!(!said.contains("--volume"), "a flag that there is not: {said}");
    folder.adj("build phantom:corners --dims 9x9x9 -o a.adj").done();
    folder.adj("export a.adj -o a.spz").done();
    let packed = std::fs::read(folder.file("a.spz")).expect("it was written");
    let mut bytes = Vec::new();
    std::io::Read::read_to_end(&mut flate2::read::GzDecoder::new(&packed[..]), &mut bytes).expect("gzip");
    assert_eq!(bytes[..16], [0x4e, 0x47, 0x53, 0x50, 2, 0, 0, 0, 9, 0, 0, 0, 1, 19, 0, 0]);
    assert_eq!(bytes.len(), 16 + 9 * (9 + 1 + 3 + 3 + 3 + 9));
    // The second corner, x = 8, in fixed point.
    assert_eq!(bytes[16 + 9..16 + 12], (8u32 << 19).to_le_bytes()[..3]);
}

#[test]
fn what_cannot_be_exported_is_refused() {
    let folder = Folder::new();
    folder.small_arena("a.adj");
    folder.write("v.raw", &RAW);
    std::fs::create_dir(folder.file("old.zarr")).expect("new");
    std::fs::create_dir(folder.file("folder.nii")).expect("new");
    let refused = |line: &str, parts: &[&str]| {
        let before = folder.names();
        let told = folder.adj(&format!("export {line}")).refused(parts);
        assert_eq!(folder.names(), before, "{line}: {told}");
    };
    refused("a.adj -o a.stl", &["a.stl", "no ending", ".nii.gz", ".vdb"]);
    refused("a.adj -o a", &["no ending"]);
    refused("a.adj", &["--output <OUT>"]);
    refused("gone.adj -o a.nii", &["cannot open gone.adj"]);
    refused("v.raw -o a.nii", &["is no .adj file", "adj build"]);
    refused("a.adj -o old.zarr", &["old.zarr", "exists already"]);
    refused("a.adj -o old.zarr/", &["exists already"]);
    refused("a.adj -o folder.nii", &["is a folder"]);
    refused("a.adj -o gone/a.nii", &["gone", "create it first"]);
    refused("a.adj -o gone/a.zarr", &["gone", "create it first"]);
    refused("a.adj -o a.nii --range 900..", &["nothing is visible"]);
    refused("a.adj -o a.nii --iso 9", &["gradient magnitudes"]);
    refused(&format!("a.adj -o {}.zarr", "n".repeat(252)), &["name too long"]);
    if cfg!(target_os = "linux") {
        refused("a.adj -o /proc/a.nii", &["cannot create a file in /proc"]);
        refused("a.adj -o /proc/a.zarr", &["cannot create a folder in /proc"]);
        std::os::unix::fs::symlink("a.adj", folder.file("link.nii")).expect("new");
        refused("a.adj -o link.nii", &["--output", "is a.adj, which this call reads"]);
    }
}

#[test]
fn a_damaged_file_is_found_before_it_is_exported() {
    let folder = Folder::new();
    let good = std::fs::read(folder.small_arena("a.adj")).expect("it was built");
    for at in (0..good.len()).step_by(311) {
        let mut bytes = good.clone();
        bytes[at] ^= 1 << (at % 8);
        folder.write("b.adj", &bytes);
        folder.adj("export b.adj -o c.nii").refused(&["b.adj", "at byte"]);
        // Not checked it may be exported, wrongly or not, but there is nothing between an output and one line.
        for ending in ["nii", "zarr", "csv", "ply", "spz", "vdb"] {
            let ran = folder.adj(&format!("export b.adj -o c.{ending} --no-verify"));
            if ran.code == Some(0) {
                let path = folder.file(format!("c.{ending}"));
                if path.is_dir() { std::fs::remove_dir_all(path) } else { std::fs::remove_file(path) }.expect("there");
            } else {
                assert_eq!(ran.code, Some(2), "{}", ran.stderr);
                assert!(!ran.stderr.contains("panicked"), "{}", ran.stderr);
            }
        }
    }
    assert_eq!(folder.names(), ["a.adj", "b.adj"]);
}

/// A few voxels in a large grid.
struct Sparse {
    dims: [u32; 3],
    voxels: Vec<[u16; 3]>,
}

impl Rows for Sparse {
    fn dims(&self) -> [u32; 3] {
        self.dims
    }

    fn channels(&self) -> Channels {
        Channels { value_bits: 8, normal_bits: 0, magnitude_bits: 0, coverage_bits: 0, coherence: false }
    }

    fn read(&self, region: Region, row: &mut dyn FnMut(u16, u16, &[Voxel])) -> Result<()> {
        let is_in = |range: &std::ops::Range<u32>, at: u16| range.contains(&at.into());
        for &[x, y, z] in &self.voxels {
            if is_in(&region.xs, x) && is_in(&region.ys, y) && is_in(&region.zs, z) {
                row(y, z, &[Voxel { x, record: Record { value: 200, ..Record::default() } }]);
            }
        }
        Ok(())
    }
}

/// Writes a file of 2048 x 2048 x `depth` points with some hundred voxels.
fn sparse(folder: &Folder, name: &str, depth: u16) {
    let dims = [2048, 2048, depth.into()];
    let mut voxels: Vec<[u16; 3]> = (0..512u16).map(|i| [i * 4, i * 3 + 7, (i / 8).min(depth - 1)]).collect();
    voxels.push([2047, 2047, depth - 1]);
    let facts = Facts {
        grid: Grid::new(dims.map(u64::from), [1.0; 3]).expect("a grid"),
        channels: Channels { value_bits: 8, normal_bits: 0, magnitude_bits: 0, coverage_bits: 0, coherence: false },
        tile_order: TileOrder::Rows,
        scales: Scales { value_low: 0.0, value_step: 1.0, magnitude_scale: 0.0 },
        visible_voxels: voxels.len() as u64,
    };
    let description = r#"{"source":{"sample_type":"u8"},"transfer_function":{"kind":"range","low":100,"opacity":1}}"#;
    let output = RowsOutput { facts, description, lane_count: 1, memory: None, threads: 1, levels: Levels::default() };
    let rows = Sparse { dims, voxels };
    write_rows(&folder.file(name), &rows, &output, &mut adjsplat::build::Unobserved).expect("writes");
    folder.adj(&format!("verify {name}")).done();
}

#[test]
#[cfg(target_os = "linux")]
fn a_large_sparse_file_takes_the_memory_of_a_few_slices() {
    use std::process::Stdio;
    let folder = Folder::new();
    // 2 GiB of samples, or 192 MiB.
    sparse(&folder, "a.adj", at_full(512, 48));
    for ending in ["nii.gz", "nrrd", "npz", "zarr", "csv", "spz", "vdb"] {
        let mut child = super::harness::program()
            .current_dir(folder.path())
            .args(["export", "a.adj", "-o", &format!("out.{ending}"), "-q"])
            .stdout(Stdio::null())
            .spawn()
            .expect("the program was built");
        let mut peak = 0;
        // The peak only grows, so the last look counts.
        while child.try_wait().expect("it is ours").is_none() {
            let status = std::fs::read_to_string(format!("/proc/{}/status", child.id())).unwrap_or_default();
            let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
            let kilobytes = line.and_then(|line| line.trim().trim_end_matches(" kB").parse::<u64>().ok());
            peak = peak.max(kilobytes.unwrap_or(0));
            std::thread::sleep(std::time::Duration::from_millis(1));
        }
        assert!(child.wait().expect("it is ours").success(), "{ending}");
        assert!(peak < 48 << 10, "{ending}: {peak} kB for slices of 4 MiB");
    }
    // Chunks without voxels have no files.
    let chunks = std::fs::read_dir(folder.file("out.zarr/0")).expect("a folder").count();
    assert!((2..200).contains(&chunks), "{chunks}");
}

#[test]
#[cfg(unix)]
fn a_stopped_export_leaves_nothing() {
    use std::process::{Command, Stdio};
    let folder = Folder::new();
    sparse(&folder, "a.adj", 2000);
    for (ending, signals) in [("raw", 1), ("nii.gz", 1), ("zarr", 1), ("zarr", 2), ("raw", 2), ("zarr", 0)] {
        let mut child = super::harness::program()
            .current_dir(folder.path())
            .args(["export", "a.adj", "-o", &format!("out.{ending}"), "-q", "--no-verify"])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("the program was built");
        let is_writing = || folder.names().iter().any(|name| name.starts_with(".adj-"));
        while !is_writing() && child.try_wait().expect("it is ours").is_none() {
            std::thread::sleep(std::time::Duration::from_micros(200));
        }
        if signals == 0 {
            // Killed: what it left is gone after the next run.
            child.kill().expect("it is ours");
            child.wait().expect("it is ours");
            folder.adj("export a.adj -o few.csv -q").done();
            let names = folder.names();
            assert!(!names.iter().any(|name| name.starts_with(".adj-")), "{names:?}");
            continue;
        }
        for _ in 0..signals {
            let _ = Command::new("kill").args(["-INT", &child.id().to_string()]).stderr(Stdio::null()).status();
        }
        let code = child.wait().expect("it is ours").code();
        if code == Some(0) {
            // It was done before the signal came.
            let path = folder.file(format!("out.{ending}"));
            if path.is_dir() { std::fs::remove_dir_all(path) } else { std::fs::remove_file(path) }.expect("there");
        } else {
            assert!(matches!(code, Some(2 | 130)), "{ending}: {code:?}");
        }
        assert_eq!(folder.names(), ["a.adj"], "{ending}");
    }
}

/// Writes 2 x 2 x 2 samples of `ty`, 0.001 apart, whose first point is at `origin`.
fn small_volume(folder: &Folder, ty: &str, samples: &[u8], origin: &str) {
    let header = format!(
        "NRRD0004\ntype: {ty}\ndimension: 3\nspace: right-anterior-superior\nsizes: 2 2 2\nencoding: raw\nendian: little\n\
         space directions: (0.001,0,0) (0,0.001,0) (0,0,0.001)\nspace origin: ({origin},0,0)\n\n"
    );
    folder.write("v.nrrd", &[header.as_bytes(), samples].concat());
    folder.adj("build v.nrrd --range 1.. -q -o v.adj").done();
}

/// They became infinite without a word.
#[test]
fn values_beyond_single_precision_are_refused_by_vdb() {
    let folder = Folder::new();
    small_volume(
        &folder,
        "double",
        &[1.0, 2.0, 3e300, 4.0, 5.0, 6.0, 7.0, 8e300f64].map(f64::to_le_bytes).concat(),
        "0",
    );
    folder.adj("export v.adj -o v.vdb").refused(&["values", "beyond single precision", ".nrrd"]);
    assert_eq!(folder.names(), ["v.adj", "v.nrrd"]);
    folder.adj("export v.adj -o v.csv").done();
}

/// Voxels fell onto each other without a word; and .spz advised .ply, which is no better.
#[test]
fn places_that_gaussians_round_are_told() {
    let folder = Folder::new();
    let export = |origin: &str, name: &str| {
        small_volume(&folder, "uint8", &[1, 2, 3, 4, 5, 6, 7, 8], origin);
        folder.adj(&format!("export v.adj -o {name}"))
    };
    assert_eq!(export("0", "v.ply").stderr, "");
    for ending in ["ply", "spz"] {
        let told = export("1e6", &format!("v.{ending}")).stderr;
        let warning = format!("warning: .{ending} rounds positions by up to ");
        assert!(told.contains(&warning) && told.contains("use .csv or .npz"), "{told}");
    }
    export("1e9", "v.spz").refused(&["8388607", "use .csv or .npz"]);
}

#[test]
fn a_fraction_as_fill_is_the_nearest_single() {
    let folder = Folder::new();
    small_volume(&folder, "float", &[0.5, 1.5, 2.5, 3.5, 4.5, 5.5, 6.5, 7.5f32].map(f32::to_le_bytes).concat(), "0");
    assert!(folder.adj("export v.adj -o v.nrrd --fill 0.1").done().contains("0.10000000149011612 elsewhere"));
    folder.adj("export v.adj -o v.nrrd --fill 1e39").refused(&["--fill", "3.4e38"]);
}
