//! Volumes that cannot be read: exit code 2, one line that says what to do, and no file.

use super::harness::{Folder, RAW, Runs as _, adj, gzip, nrrd};

const BUILD_RAW: &str = "v.raw --type u8 --range 1.. -o out.adj";

#[test]
fn a_good_volume_is_built_in_every_format_here() {
    let folder = Folder::new();
    folder.write("v.raw", &RAW);
    folder.write("v.nrrd", &nrrd("raw", &RAW));
    folder.write("z.nrrd", &nrrd("gzip", &gzip(&RAW)));
    folder.write("v.raw.gz", &gzip(&RAW));
    let mut visible = Vec::new();
    for line in ["v.raw --dims 4x3x2 --type u8", "v.nrrd", "z.nrrd", "v.raw.gz --dims 4x3x2 --type u8"] {
        let told = folder.adj(&format!("build {line} --range 5.. -o out.adj --json")).json();
        visible.push(told["visible_voxels"].as_u64().expect("a count"));
        assert_eq!(told["samples"], 24);
        assert_eq!(told["bytes_total"], std::fs::metadata(folder.file("out.adj")).expect("it was built").len());
        folder.adj("verify out.adj").done();
    }
    assert_eq!(visible, [20; 4]);
}

#[test]
fn a_folder_of_tiff_files_is_built_like_one_file_of_pages() {
    use tiff::encoder::{TiffEncoder, colortype::Gray8};
    let folder = Folder::new();
    std::fs::create_dir(folder.file("stack")).expect("new");
    let create =
        |name: &str| TiffEncoder::new(std::fs::File::create(folder.file(name)).expect("new")).expect("a header");
    let mut pages = create("pages.tif");
    // Ten is behind two, as people count.
    for (name, slice) in ["stack/s2.tif", "stack/s10.tif"].iter().zip(RAW.chunks(12)) {
        create(name).write_image::<Gray8>(4, 3, slice).expect("can be written");
        pages.write_image::<Gray8>(4, 3, slice).expect("can be written");
    }
    for input in ["stack", "pages.tif"] {
        let told = folder.adj(&format!("build {input} --range 5.. --value-bits 8 -o {input}.adj --json")).json();
        assert_eq!((told["visible_voxels"].as_u64(), told["samples"].as_u64()), (Some(20), Some(24)));
    }
    let records = |name: &str| folder.adj(&format!("info {name} --json")).json()["lanes"].clone();
    assert_eq!(records("stack.adj"), records("pages.tif.adj"));
    let samples = folder.adj("info stack --json").json();
    assert_eq!(samples["dims"], serde_json::json!([4, 3, 2]));
    std::fs::remove_file(folder.file("stack/s10.tif")).expect("it is there");
    std::fs::write(folder.file("stack/s10.tif"), b"II*\0").expect("can be written");
    folder.build_refused("stack --range 1.. -o out.adj", &["s10.tif", "its end before"]);
}

#[test]
fn a_folder_of_adj_files_is_not_taken_for_raw_slices() {
    let folder = Folder::new();
    std::fs::create_dir(folder.file("built")).expect("new");
    for name in ["a", "b", "c", "d"] {
        folder.adj(&format!("build phantom:gyroid --dims 8x8x8 --range 0.. -q -o built/{name}.adj")).done();
    }
    folder.build_refused("built --range 1..", &["has .adj files, which are built already, such as a.adj"]);
}

#[test]
fn raw_slices_are_read_from_a_folder_a_list_and_a_pattern() {
    let folder = Folder::new();
    std::fs::create_dir(folder.file("head")).expect("new");
    // Twelve slices of 2 x 2; 10 is behind 9, as people count. A text lies beside them.
    for z in 1..=12u8 {
        folder.write(format!("head/CThead.{z}"), &[0, 100 + z].repeat(4));
    }
    folder.write("head/README", b"raw");
    folder.build_refused(
        "head --range 1..",
        &["its 12 files of 8 bytes each seem to be raw slices", "--dims 2x2x12 and --type u16 or i16"],
    );
    folder.build_refused(
        "head --range 1.. --dims 2x2x11 --type u16be",
        &["12 files of 8 bytes", "--dims need 11; --dims 2x2x12 would fit"],
    );
    let flags = "--dims 2x2x12 --type u16be";
    let list: Vec<String> = (1..=12).rev().map(|z| format!("head/CThead.{z}")).collect();
    let mut built = Vec::new();
    for (input, output) in
        [("head", "head.adj"), (&list.join(" "), "head/CThead.adj"), ("head/CThead.*", "head/CThead.adj")]
    {
        let ran = folder.adj(&format!("build {input} {flags} --range 1.."));
        assert_eq!(
            ran.stderr.contains("skipped 1 file that is not of 8 bytes (README)"),
            input == "head",
            "{}",
            ran.stderr
        );
        ran.done();
        built.push(std::fs::read(folder.file(output)).expect("it was built"));
        std::fs::remove_file(folder.file(output)).expect("it is there");
        folder.adj(&format!("raw {input} {flags} -o out.raw")).done();
        let want: Vec<u8> = (1..=12).flat_map(|z| [100 + z, 0].repeat(4)).collect();
        assert_eq!(std::fs::read(folder.file("out.raw")).expect("it was written"), want);
        assert_eq!(folder.adj(&format!("info {input} {flags} --json")).json()["highest"], 112.0);
        folder.adj(&format!("render {input} {flags} --range 1.. -o out.png --size 16x16")).done();
    }
    let len = built[0].len();
    assert!(built.iter().all(|file| file.len().abs_diff(len) < 16), "only the name differs");
}

#[test]
fn several_inputs_that_are_no_slices_are_refused() {
    let folder = Folder::new();
    folder.write("a.nrrd", &nrrd("raw", &RAW));
    folder.write("b.nrrd", &nrrd("raw", &RAW));
    std::fs::create_dir(folder.file("sub")).expect("new");
    folder.adj("build a.nrrd --range 1.. -o a.adj").done();
    folder.build_refused("a.nrrd b.nrrd --range 1.. -o out.adj", &["a.nrrd and 1 more: are no slices of one volume"]);
    folder.build_refused("a.nrrd sub --range 1.. -o out.adj", &["sub: is one of several inputs", "give one input"]);
    folder.build_refused("a.adj a.adj --range 1.. -o out.adj", &["are .adj files, which are no slices"]);
    folder.adj("info a.adj --spacing 1x1x2").refused(&["--spacing", "is for volumes"]);
    folder.adj("info a.adj --level 1").refused(&["--level", "is for volumes"]);
    folder.build_refused("*.tif --range 1.. -o out.adj", &["cannot open *.tif: no file matches"]);
    folder.build_refused("[*.tif --range 1.. -o out.adj", &["is no pattern"]);
}

/// What the first build writes beside the slices matches the pattern of the second.
#[test]
fn slices_are_built_again_by_the_same_pattern() {
    let folder = Folder::new();
    std::fs::create_dir(folder.file("head")).expect("new");
    for number in 1..=3 {
        folder.write(format!("head/CT.{number}"), &RAW[..12]);
    }
    let build = "build head/CT.* --dims 4x3x3 --type u8 --range 1..";
    folder.adj(build).done();
    let ran = folder.adj(build);
    assert!(ran.code == Some(0) && ran.stderr.contains("CT.adj is an .adj file, not a slice"), "{}", ran.stderr);
}

#[test]
fn a_file_of_several_volumes_says_which_is_read() {
    let folder = Folder::new();
    let header = "NRRD0004\ntype: uint8\ndimension: 4\nsizes: 4 3 1 2\nencoding: raw\n\n";
    folder.write("a.nrrd", &[header.as_bytes(), &RAW].concat());
    let told = folder.adj("info a.nrrd").stderr;
    assert!(told.contains("the first of 2 volumes is read (--volume chooses another)"), "{told}");
    assert_eq!(folder.adj("info a.nrrd --volume 1").stderr, "");
}

#[test]
fn samples_outside_a_folder_are_refused_with_the_flag_that_allows_them() {
    let folder = Folder::new();
    folder.write("v.raw", &RAW);
    std::fs::create_dir(folder.file("sub")).expect("new");
    let header = b"NRRD0001\ntype: uint8\ndimension: 3\nsizes: 4 3 2\nencoding: raw\ndata file: ../v.raw\n";
    folder.write("sub/v.nhdr", header);
    folder
        .build_refused("sub/v.nhdr --range 5.. -o out.adj", &["outside its folder", "allow this with --outside-files"]);
    folder.adj("build sub/v.nhdr --range 5.. -o out.adj --outside-files").done();
}

#[test]
fn no_volume_at_all() {
    let folder = Folder::new();
    std::fs::create_dir(folder.file("folder")).expect("new");
    folder.write("empty.raw", b"");
    folder.write("empty.nii", b"");
    folder.build_refused("missing.nii -o out.adj", &["cannot open missing.nii", "No such file"]);
    folder.build_refused("missing.nii --range 1.. -o out.adj", &["cannot open missing.nii"]);
    folder.build_refused("missing.adj --range 1.. -o out.adj", &["cannot open missing.adj"]);
    folder.build_refused("folder --range 1.. -o out.adj", &["folder", "is a folder"]);
    folder.build_refused("empty.raw --dims 4x3x2 --type u8 --range 1.. -o out.adj", &["empty.raw", "an empty file"]);
    folder.build_refused("empty.nii --range 1.. -o out.adj", &["empty.nii", "an empty file"]);
    folder.build_refused("phantom:gyro --range 1.. -o out.adj", &["gyro", "gyroid", "vessels"]);
    folder.build_refused("/dev/zero --dims 4x3x2 --type u8 --range 1.. -o out.adj", &["/dev/zero", "device"]);
}

#[test]
fn a_file_of_no_known_format_asks_for_what_a_raw_file_does_not_say() {
    let folder = Folder::new();
    folder.write("v.raw", &RAW);
    folder.write("v.xyz", b"some text that means nothing");
    folder.build_refused("v.raw --range 1.. -o out.adj", &["v.raw", "--dims", "--type"]);
    folder.build_refused("v.xyz --range 1.. -o out.adj", &["v.xyz", ".nrrd", "--dims"]);
    folder.build_refused("v.raw --dims 4x3x2 --range 1.. -o out.adj", &["--type"]);
    folder.build_refused("v.raw --type u8 --range 1.. -o out.adj", &["--dims"]);
    folder.build_refused("v.raw --skip 3 --range 1.. -o out.adj", &["--skip", "--dims"]);
    folder.build_refused("v.raw --dims 4x3x2 --type u9 --range 1.. -o out.adj", &["u9", "u8, i8, u16"]);
    folder.build_refused("v.raw --dims 4x3x2 --type i64 --range 1.. -o out.adj", &["i64", "f64"]);
}

#[test]
fn an_arena_is_no_volume() {
    let folder = Folder::new();
    folder.small_arena("a.adj");
    folder.build_refused("a.adj --range 1.. -o out.adj", &["a.adj", "is an .adj file", "the volume"]);
    std::fs::rename(folder.file("a.adj"), folder.file("a.raw")).expect("it is there");
    folder.build_refused("a.raw --range 1.. -o out.adj", &["is an .adj file"]);
}

#[test]
fn sizes_that_do_not_match() {
    let folder = Folder::new();
    folder.write("v.raw", &RAW);
    let dims = |dims: &str, parts: &[&str]| folder.build_refused(&format!("{BUILD_RAW} --dims {dims}"), parts);
    dims("4x3x3", &["v.raw", "36 bytes", "24 bytes", "--dims 4x3x2"]);
    dims("4x3x1", &["12 bytes", "24 bytes"]);
    dims("4x3", &["12 bytes", "24 bytes"]);
    dims("65535x65535x65535", &["281462092005375 bytes", "24 bytes"]);
    dims("65536x1x1", &["65536", "65535"]);
    dims("4000000000x4000000000x4000000000", &["4000000000", "65535"]);
    dims("99999999999999999999x1x1", &["99999999999999999999x1x1", "256x256x128"]);
    for bad in ["0x3x2", "4x0x2", "4x3x0"] {
        dims(bad, &["at least one point", "got 0 along"]);
    }
    for bad in ["-4x3x2", "4", "4x3x2x1", "axbxc", "4.5x3x2", "NaNx1x1"] {
        folder.build_refused(&format!("{BUILD_RAW} --dims={bad}"), &[bad, "256x256x128"]);
    }
    folder
        .build_refused("v.raw --dims 4x3x2 --type u16 --range 1.. -o out.adj", &["48 bytes", "24 bytes", "--type u8"]);
    folder.build_refused(&format!("{BUILD_RAW} --dims 4x3x2 --skip 1"), &["24 bytes after 1 skipped", "23 bytes"]);
    folder.build_refused(&format!("{BUILD_RAW} --dims 4x3x2 --skip 18446744073709551615"), &["v.raw"]);
    folder.build_refused(&format!("{BUILD_RAW} --dims 4x3x2 --volume 1"), &["volume", "1"]);
    folder.build_refused("phantom:noise --dims 70000x1x1 -o out.adj", &["70000", "65535"]);
}

#[test]
fn spacings_that_are_no_lengths() {
    let folder = Folder::new();
    folder.write("v.raw", &RAW);
    for bad in ["0x1x1", "-1x1x1", "1x1xNaN", "1xinfx1", "1x1", "1", "", "axbxc", "1e999x1x1"] {
        let flag = format!("--spacing={bad}");
        for input in [&["v.raw", "--dims", "4x3x2", "--type", "u8"][..], &["phantom:noise"]] {
            let mut line = vec!["build"];
            line.extend(input);
            line.extend([&flag, "--range", "1..", "-o"]);
            let output = folder.file("out.adj");
            let path = folder.file(input[0]);
            line[1] = if input[0] == "v.raw" { path.to_str().expect("UTF-8") } else { input[0] };
            line.push(output.to_str().expect("UTF-8"));
            adj(&line).refused(&["spacing", bad, "above 0"]);
            assert_eq!(folder.names(), ["v.raw"]);
        }
    }
    // Lengths that no picture can be computed of, in either direction.
    for bad in ["1e300x1x1", "1x1e-200x1"] {
        folder.build_refused(&format!("phantom:noise --spacing {bad} -o out.adj"), &["spacing", "1e-100 to 1e100"]);
        let raw = format!("v.raw --dims 4x3x2 --type u8 --range 1.. --spacing {bad} -o out.adj");
        folder.build_refused(&raw, &["v.raw", "spacing", "1e-100 to 1e100"]);
    }
    // A header's own.
    let bad = String::from_utf8(nrrd("raw", b"")).expect("text").replace("encoding", "spacings: 1 0 1\nencoding");
    folder.write("v.nrrd", &[bad.trim_end().as_bytes(), b"\n\n", &RAW].concat());
    folder.build_refused("v.nrrd --range 1.. -o out.adj", &["v.nrrd", "spacing"]);
}

#[test]
fn data_that_was_cut() {
    let folder = Folder::new();
    folder.write("cut.nrrd", &nrrd("raw", &RAW[..23]));
    folder.write("short.nrrd", &nrrd("raw", b""));
    let packed = gzip(&RAW);
    folder.write("cut-gzip.nrrd", &nrrd("gzip", &packed[..packed.len() / 2]));
    folder.write("cut-sum.nrrd", &nrrd("gzip", &packed[..packed.len() - 3]));
    folder.write("cut.raw.gz", &packed[..packed.len() / 2]);
    folder.write("few.nrrd", &nrrd("gzip", &gzip(&RAW[..20])));
    folder.write("no-gzip.nrrd", &nrrd("gzip", &RAW));
    for name in ["cut.nrrd", "short.nrrd", "cut-gzip.nrrd", "cut-sum.nrrd", "few.nrrd", "no-gzip.nrrd"] {
        folder.build_refused(&format!("{name} --range 1.. -o out.adj"), &[name, "expected", "got"]);
    }
    folder
        .build_refused("cut.raw.gz --dims 4x3x2 --type u8 --range 1.. -o out.adj", &["cut.raw.gz", "expected", "got"]);
    // A header alone, and a header cut anywhere: an error, whatever it says.
    let whole = nrrd("raw", &RAW);
    for cut in 1..whole.len() {
        folder.write("cut.nrrd", &whole[..cut]);
        folder.build_refused("cut.nrrd --range 1.. -o out.adj", &["cut.nrrd"]);
    }
}

#[test]
fn a_header_that_lies_about_its_compressed_size_is_read_by_what_the_data_says() {
    let folder = Folder::new();
    let mut zlib = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::default());
    std::io::Write::write_all(&mut zlib, &RAW).expect("writes to memory");
    folder.write("v.zraw", &zlib.finish().expect("writes to memory"));
    let header = |dims: &str| {
        format!(
            "ObjectType = Image\nNDims = 3\nDimSize = {dims}\nElementType = MET_UCHAR\nCompressedData = True\n\
             CompressedDataSize = 7\nElementDataFile = v.zraw\n"
        )
    };
    folder.write("v.mhd", header("4 3 2").as_bytes());
    folder.adj("build v.mhd --range 1.. -o out.adj --quiet").done();
    std::fs::remove_file(folder.file("out.adj")).expect("it was built");
    // More samples than the stream has, then more than any stream of that length can have.
    folder.write("v.mhd", header("4 3 3").as_bytes());
    folder.build_refused("v.mhd --range 1.. -o out.adj", &["v.zraw", "36 bytes", "24 bytes"]);
    folder.write("v.mhd", header("4000 3000 2000").as_bytes());
    folder.build_refused("v.mhd --range 1.. -o out.adj", &["v.zraw", "24000000000", "at most"]);
    folder.write("v.mhd", header("4 3 2").replace("v.zraw", "gone.zraw").as_bytes());
    folder.build_refused("v.mhd --range 1.. -o out.adj", &["gone.zraw", "No such file"]);
}

#[test]
fn nothing_visible_says_what_there_is() {
    let folder = Folder::new();
    folder.write("v.raw", &RAW);
    let raw = "v.raw --dims 4x3x2 --type u8 -o out.adj";
    folder.build_refused(&format!("{raw} --range 25.."), &["nothing is visible", "from 1 to 24", "--range 12.5..24"]);
    folder.build_refused(&format!("{raw} --range 300..400"), &["nothing is visible", "from 1 to 24"]);
    folder.build_refused(&format!("{raw} --iso 500"), &["nothing is visible", "from 1 to 24"]);
    let floats: Vec<u8> = [f32::NAN; 24].iter().flat_map(|f| f.to_le_bytes()).collect();
    folder.write("v.raw", &floats);
    folder
        .build_refused("v.raw --dims 4x3x2 --type f32 -o out.adj --range 1..2", &["nothing is visible", "24 are not"]);
}

#[test]
fn samples_that_are_no_numbers_are_told_as_a_warning() {
    let folder = Folder::new();
    let floats: Vec<u8> =
        (0..24).map(|i| if i < 3 { f32::NAN } else { 5.0 }).flat_map(|f: f32| f.to_le_bytes()).collect();
    folder.write("v.raw", &floats);
    let ran = folder.adj("build v.raw --dims 4x3x2 --type f32 -o out.adj --range 1..9 --json");
    assert_eq!(ran.stderr, "adj: warning: 3 samples are NaN or infinite; they are transparent\n");
    let told = ran.json();
    assert_eq!((&told["not_finite"], &told["visible_voxels"]), (&3.into(), &21.into()));
}

#[test]
fn a_dicom_folder_is_built_and_what_was_left_out_is_told() {
    let folder = Folder::new();
    std::fs::create_dir(folder.file("series")).expect("the folder can be written");
    let slices = adjsplat_tests::repository().join("tests/readers/compressed/multi-rle.dcm");
    std::fs::copy(slices, folder.file("series/IM 1")).expect("it is there");
    folder.write("series/readme.txt", b"hello");
    let ran = folder.adj("info series --json");
    assert!(ran.stderr.contains("adj: skipped 1 file that is no DICOM (readme.txt)\n"), "{}", ran.stderr);
    assert_eq!(ran.json()["dims"], serde_json::json!([12, 10, 3]));
    folder.adj("build series --range 100.. -o out.adj --quiet").done();
    folder.adj("build series --series 0 --range 100.. -o out.adj --quiet").done();
    folder.build_refused("series --series 1 --range 1.. -o new.adj", &["series", "no series \"1\"", "3 slices"]);
    folder.build_refused("series --level 1 --range 1.. -o new.adj", &["level", "only OME-Zarr"]);
    folder.build_refused("phantom:noise --series 1 -o new.adj", &["--series", "a phantom"]);
    folder.build_refused("phantom:noise --dims 9x9x9 --volume 1 -o new.adj", &["--volume", "a phantom"]);
    // The same output again is no mistake, also in the folder that is read; a slice is.
    folder.adj("raw series -o series/all.raw").done();
    folder.adj("raw series -o series/all.raw").done();
    let words = ["raw".into(), folder.file("series"), "-o".into(), folder.file("series/IM 1")];
    let ran = super::harness::adj(words);
    assert!(ran.code == Some(2) && ran.stderr.contains("IM 1, which this call reads or writes"), "{}", ran.stderr);
    std::fs::remove_file(folder.file("series/all.raw")).expect("it is there");
    folder.build_refused("phantom:noise --level 1 -o new.adj", &["--level", "a phantom"]);
    folder.write("v.raw", &RAW);
    folder.build_refused("v.raw --dims 4x3x2 --type u8 --series 1 --range 1.. -o new.adj", &["series", "DICOM"]);
    folder.build_refused(". --range 1.. -o new.adj", &["is a folder", "subfolders, such as series"]);
}

#[test]
fn a_zarr_array_is_built_by_its_folder() {
    let folder = Folder::new();
    std::fs::create_dir(folder.file("a.zarr")).expect("the folder can be written");
    let array = "{\"zarr_format\": 2, \"shape\": [2, 3, 4], \"chunks\": [2, 3, 4], \"dtype\": \"|u1\", \"order\": \"C\", \
                 \"compressor\": null, \"filters\": null, \"fill_value\": 0}";
    folder.write("a.zarr/.zarray", array.as_bytes());
    folder.write("a.zarr/0.0.0", &RAW);
    let told = folder.adj("build a.zarr --range 1.. -o out.adj --json --quiet").json();
    assert_eq!(told["visible_voxels"], 24);
    folder.build_refused("a.zarr --level 1 --range 1.. -o new.adj", &["level", "there is 1 level"]);
    folder.build_refused("a.zarr --volume 1 --range 1.. -o new.adj", &["volume", "holds 1 volume"]);
    folder.write("a.zarr/0.0.0", &RAW[..9]);
    folder.build_refused("a.zarr --range 1.. -o new.adj", &["0.0.0", "intact chunk of 24 bytes", "9 bytes"]);
}

#[test]
fn bytes_after_the_samples_are_warned_about() {
    let folder = Folder::new();
    let surplus = [&RAW[..], &[0; 40]].concat();
    folder.write("a.nrrd", &nrrd("raw", &surplus));
    let header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 3 2\nencoding: raw\ndata file: a.raw\n";
    folder.write("b.nhdr", header.as_bytes());
    folder.write("a.raw", &surplus);
    let header = "NDims = 3\nDimSize = 4 3 2\nElementType = MET_UCHAR\nElementDataFile = ";
    folder.write("c.mhd", format!("{header}a.raw\n").as_bytes());
    folder.write("d.mha", &[format!("{header}LOCAL\n").as_bytes(), &surplus].concat());
    let header = "# vtk DataFile Version 3.0\n\nBINARY\nDATASET STRUCTURED_POINTS\nDIMENSIONS 4 3 2\nORIGIN 0 0 0\n\
                  SPACING 1 1 1\nPOINT_DATA 24\nSCALARS v unsigned_char 1\nLOOKUP_TABLE default\n";
    folder.write("e.vtk", &[header.as_bytes(), &surplus].concat());
    for name in ["a.nrrd", "b.nhdr", "c.mhd", "d.mha", "e.vtk"] {
        let ran = folder.adj(&format!("info {name}"));
        let told = "40 bytes after the samples (4 x 3 x 2 of u8) are not read; if the picture looks wrong, check";
        assert!(ran.stderr.starts_with("adj: warning: ") && ran.stderr.contains(told), "{name}: {}", ran.stderr);
        ran.done();
    }
    // Other arrays of a VTK file are no surprise.
    let vectors = [&b"\nVECTORS w float\n"[..], &[0; 288]].concat();
    folder.write("e.vtk", &[header.as_bytes(), &RAW, &vectors].concat());
    assert_eq!(folder.adj("info e.vtk").stderr, "");
    let appended = format!(
        "<VTKFile type=\"ImageData\" byte_order=\"LittleEndian\" header_type=\"UInt32\"><ImageData \
         WholeExtent=\"0 3 0 2 0 1\"><Piece Extent=\"0 3 0 2 0 1\"><PointData><DataArray type=\"UInt8\" Name=\"v\" \
         format=\"appended\" offset=\"0\"/></PointData></Piece></ImageData><AppendedData encoding=\"raw\">_{}",
        "\u{18}\0\0\0"
    );
    folder.write("f.vti", &[appended.as_bytes(), &RAW, b"</AppendedData></VTKFile>"].concat());
    let ran = folder.adj("info f.vti");
    assert_eq!(ran.stderr, "");
    ran.done();
    // A line break at the end is usual.
    folder.write("e.vtk", &[header.as_bytes(), &RAW, b"\n"].concat());
    assert_eq!(folder.adj("info e.vtk").stderr, "");
}

#[test]
fn slices_that_run_the_other_way_can_be_flipped() {
    let folder = Folder::new();
    let flags = "--dims 4x3x2 --type u8 --spacing 1x1.5x2 --range 5..";
    let mut reversed = RAW;
    reversed.reverse();
    folder.write("a.raw", &RAW);
    folder.write("b.raw", &reversed);
    folder.adj(&format!("build a.raw {flags} -o a.adj")).done();
    folder.adj(&format!("build b.raw {flags} --flip x,y,z -o b.adj")).done();
    let info = folder.adj("info b.adj --json").json();
    assert_eq!(info["origin"], serde_json::json!([3.0, 3.0, 2.0]));
    for view in ["--azimuth 20 --elevation 30", "--azimuth 200 --elevation -40 --perspective 30"] {
        for name in ["a", "b"] {
            folder.adj(&format!("render {name}.adj -o {name}.exr --size 60x60 --renderer cpu {view}")).done();
        }
        // Voxels at the same distance may come in another order.
        folder.adj("compare a.exr b.exr --metric psnr --max-error 45").done();
    }
    folder.adj("render a.adj -o a.png --flip z").refused(&["--flip", "is for volumes"]);
    folder.adj(&format!("build a.raw {flags} --flip w -o c.adj")).refused(&["'w'", "x, y, z"]);
}
