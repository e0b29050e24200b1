//! Zarr arrays written here by hand; packed chunks are files that c-blosc, libzstd and liblz4 wrote.

use std::path::{Path, PathBuf};

use adjsplat::volume::SampleType;
use adjsplat_readers::{Endian, OpenOptions, open};
use serde_json::{Value, json};

use super::sample::{ENDIANS, Folder, Read, bytes, expect_known, expect_refused, gzip, known, read, read_with, zlib};

fn write(path: &Path, bytes: impl AsRef<[u8]>) {
    std::fs::create_dir_all(path.parent().expect("it is in a folder")).expect("the folder can be written");
    std::fs::write(path, bytes).expect("the folder can be written");
}

/// A `.zarray` of the known volume's shape, in one chunk.
fn array_2(dtype: &str) -> Value {
    json!({ "zarr_format": 2, "shape": [2, 3, 4], "chunks": [2, 3, 4], "dtype": dtype, "order": "C",
            "compressor": null, "filters": null, "fill_value": 0 })
}

/// Likewise a `zarr.json`.
fn array_3(data_type: &str, codecs: &Value) -> Value {
    json!({ "zarr_format": 3, "node_type": "array", "shape": [2, 3, 4], "data_type": data_type,
            "chunk_grid": { "name": "regular", "configuration": { "chunk_shape": [2, 3, 4] } },
            "chunk_key_encoding": { "name": "default", "configuration": { "separator": "/" } },
            "codecs": codecs, "fill_value": 0, "attributes": {} })
}

fn with(mut array: Value, field: &str, value: Value) -> Value {
    array[field] = value;
    array
}

fn little() -> Value {
    json!({ "name": "bytes", "configuration": { "endian": "little" } })
}

/// Writes a version 2 array with these chunks.
fn store_2(folder: &Folder, name: &str, array: &Value, chunks: &[(&str, &[u8])]) -> PathBuf {
    let path = folder.path().join(name);
    write(&path.join(".zarray"), array.to_string());
    for (key, bytes) in chunks {
        write(&path.join(key), bytes);
    }
    path
}

fn store_3(folder: &Folder, name: &str, array: &Value, chunks: &[(&str, &[u8])]) -> PathBuf {
    let path = folder.path().join(name);
    write(&path.join("zarr.json"), array.to_string());
    for (key, bytes) in chunks {
        write(&path.join(key), bytes);
    }
    path
}

fn refused(path: &Path, parts: &[&str]) {
    expect_refused(path, &OpenOptions::default(), parts);
}

fn samples(read: &Read) -> Vec<f64> {
    (0..read.samples.len()).map(|i| read.samples.get(i)).collect()
}

fn opened(path: &Path) -> Read {
    read(path).unwrap_or_else(|error| panic!("{error}"))
}

const TYPES: [(SampleType, &str, &str); 8] = [
    (SampleType::U8, "u1", "uint8"),
    (SampleType::I8, "i1", "int8"),
    (SampleType::U16, "u2", "uint16"),
    (SampleType::I16, "i2", "int16"),
    (SampleType::U32, "u4", "uint32"),
    (SampleType::I32, "i4", "int32"),
    (SampleType::F32, "f4", "float32"),
    (SampleType::F64, "f8", "float64"),
];

#[test]
fn every_type_and_byte_order_is_read_in_both_versions() {
    let folder = Folder::new();
    for (ty, second, third) in TYPES {
        for endian in ENDIANS {
            let content = bytes(&known(ty), endian);
            let big = endian == Endian::Big;
            let dtype = format!("{}{second}", if big { '>' } else { '<' });
            let path = store_2(&folder, &format!("2{dtype}"), &array_2(&dtype), &[("0.0.0", &content)]);
            assert_eq!(expect_known(&path, ty).format, "Zarr");
            let codec = json!([{ "name": "bytes", "configuration": { "endian": if big { "big" } else { "little" } } }]);
            let path = store_3(&folder, &format!("3{dtype}"), &array_3(third, &codec), &[("c/0/0/0", &content)]);
            expect_known(&path, ty);
        }
    }
}

#[test]
fn chunks_are_unpacked_by_every_codec() {
    let folder = Folder::new();
    let content = bytes(&known(SampleType::U16), Endian::Little);
    for (id, packed) in [("gzip", gzip(&content)), ("zlib", zlib(&content))] {
        let array = with(array_2("<u2"), "compressor", json!({ "id": id, "level": 1 }));
        expect_known(&store_2(&folder, id, &array, &[("0.0.0", &packed)]), SampleType::U16);
        let codecs = json!([little(), { "name": id, "configuration": { "level": 1 } }]);
        let path = store_3(&folder, &format!("{id}3"), &array_3("uint16", &codecs), &[("c/0/0/0", &packed)]);
        expect_known(&path, SampleType::U16);
    }
    let summed = [&content[..], &crc32c(&content).to_le_bytes()].concat();
    let codecs = json!([little(), { "name": "crc32c" }, { "name": "gzip", "configuration": { "level": 1 } }]);
    let path = store_3(&folder, "crc", &array_3("uint16", &codecs), &[("c/0/0/0", &gzip(&summed))]);
    expect_known(&path, SampleType::U16);
    let mut wrong = summed;
    wrong[3] ^= 1;
    write(&path.join("c/0/0/0"), gzip(&wrong));
    refused(&path, &["Zarr chunk", "another checksum"]);
}

/// A bit at a time, as the standard defines it.
fn crc32c(bytes: &[u8]) -> u32 {
    let mut sum = u32::MAX;
    for byte in bytes {
        sum ^= u32::from(*byte);
        for _ in 0..8 {
            sum = if sum & 1 == 1 { sum >> 1 ^ 0x82f6_3b78 } else { sum >> 1 };
        }
    }
    !sum
}

fn packed(name: &str) -> Vec<u8> {
    std::fs::read(adjsplat_tests::repository().join("tests/readers/chunks").join(name)).expect("it is there")
}

fn packed_array(compressor: &str) -> Value {
    json!({ "zarr_format": 2, "shape": [2, 20, 40], "chunks": [2, 20, 40], "dtype": "<u2", "order": "C",
            "compressor": { "id": compressor }, "filters": null, "fill_value": 0 })
}

#[test]
fn chunks_of_other_writers_are_unpacked() {
    let folder = Folder::new();
    let want: Vec<f64> = (0..1600).map(|i| f64::from(i / 3 * 17 + i % 5)).collect();
    let mut files: Vec<(&str, String)> = vec![("zstd", "chunk.zst".into()), ("lz4", "chunk.lz4".into())];
    for codec in ["blosclz", "lz4", "zlib", "zstd"] {
        files.extend(["none", "bytes", "bits"].map(|shuffle| ("blosc", format!("{codec}-{shuffle}.blosc"))));
    }
    for (compressor, file) in &files {
        let path = store_2(&folder, file, &packed_array(compressor), &[("0.0.0", &packed(file))]);
        assert_eq!(samples(&opened(&path)), want, "{file}");
    }
}

#[test]
fn chunks_are_put_together_over_edges_and_missing_ones_are_filled() {
    let folder = Folder::new();
    // 3 x 3 x 5 samples in chunks of 2 x 2 x 2; sample = 100 z + 10 y + x. Beyond the edge there is padding.
    let chunk = |z: u8, y: u8, x: u8| -> Vec<u8> {
        let at = |k: u8| [2 * z + (k >> 2), 2 * y + (k >> 1 & 1), 2 * x + (k & 1)];
        (0..8).map(at).map(|[z, y, x]| if z < 3 && y < 3 && x < 5 { 100 * z + 10 * y + x } else { 255 }).collect()
    };
    let array = json!({ "zarr_format": 2, "shape": [3, 3, 5], "chunks": [2, 2, 2], "dtype": "|u1", "order": "C",
                        "compressor": null, "filters": [], "fill_value": 7, "dimension_separator": "/" });
    let path = store_2(&folder, "a", &array, &[]);
    let mut want = Vec::new();
    for z in 0..2 {
        for y in 0..2 {
            for x in 0..3 {
                if (z, y, x) != (1, 0, 1) {
                    write(&path.join(format!("{z}/{y}/{x}")), chunk(z, y, x));
                }
            }
        }
    }
    for (z, y, x) in (0..45).map(|i| (i / 15, i / 5 % 3, i % 5)) {
        let missing = z >= 2 && y < 2 && (2..4).contains(&x);
        want.push(if missing { 7.0 } else { f64::from(100 * z + 10 * y + x) });
    }
    assert_eq!(samples(&opened(&path)), want);
    let source = open(&path, &OpenOptions::default()).unwrap_or_else(|error| panic!("{error}"));
    // Two slices of 15, a few chunks of 8, and the list of the 11 chunks that are there.
    assert_eq!(source.buffer_bytes(), 30 + 3 * 8 + 11 * 8);
    let note = "warning: 1 of 12 chunks is absent and reads as the fill value 7: x 2..4, y 0..2, z 2..3; if";
    assert!(source.notes()[0].starts_with(note), "{:?}", source.notes());
}

#[test]
fn absent_chunks_are_counted_and_placed() {
    let folder = Folder::new();
    // Chunks of one point; a wedge of three of the 24 is absent. The channel beside it has all.
    let array = json!({ "zarr_format": 2, "shape": [2, 2, 3, 4], "chunks": [1, 1, 1, 1], "dtype": ">i2",
                        "order": "C", "compressor": null, "filters": null, "fill_value": -5 });
    let path = store_2(&folder, "wedge", &array, &[]);
    for (z, y, x) in (0..24).map(|i| (i / 12, i / 4 % 3, i % 4)) {
        write(&path.join(format!("1.{z}.{y}.{x}")), [0, 1]);
        if ![(1, 0, 1), (1, 0, 2), (1, 1, 1)].contains(&(z, y, x)) {
            write(&path.join(format!("0.{z}.{y}.{x}")), [0, 1]);
        }
    }
    // Names that are no chunks of the array count for nothing.
    for other in ["0.0.0", "0.1.00.1", "0.1.0.1.0", "0.9.0.1", ".hidden", "0.-1.0.1"] {
        write(&path.join(other), [0, 1]);
    }
    let notes = |volume| {
        let source = open(&path, &OpenOptions::new().volume_index(volume)).unwrap_or_else(|error| panic!("{error}"));
        source.notes().to_vec()
    };
    assert_eq!(
        notes(0),
        [
            "the first of 2 volumes is read (`OpenOptions::volume_index` chooses another)",
            "warning: 3 of 24 chunks are absent and read as the fill value -5: within x 1..3, y 0..2, z 1..2; if the \
             picture has a gap there, copy or download the folder again"
        ]
    );
    assert_eq!(notes(1), Vec::<String>::new());
    assert_eq!(samples(&opened(&path)).iter().filter(|sample| **sample == -5.0).count(), 3);
}

#[test]
fn chunks_that_were_never_written_take_no_time() {
    let folder = Folder::new();
    let array = json!({ "zarr_format": 2, "shape": [2000, 2000, 2000], "chunks": [1, 1, 1], "dtype": "|u1",
                        "order": "C", "compressor": null, "filters": null, "fill_value": 0 });
    let path = store_2(&folder, "a", &array, &[]);
    refused(&path, &["at least one of the volume's 8000000000 chunks", "none"]);
    write(&path.join("0.3.2"), [9]);
    let mut source = open(&path, &OpenOptions::new()).unwrap_or_else(|error| panic!("{error}"));
    assert!(source.notes()[0].contains("7999999999 of 8000000000 chunks"), "{:?}", source.notes());
    let mut slice = source.header().new_slice().expect("4 MB");
    // A look at each of the 4 million chunks of a slice would take minutes for these.
    for _ in 0..20 {
        source.read_slice(&mut slice).unwrap_or_else(|error| panic!("{error}"));
        if slice.get(3 * 2000 + 2) == 9.0 {
            slice.bytes_mut()[3 * 2000 + 2] = 0;
        }
        assert!(slice.bytes().iter().all(|sample| *sample == 0));
    }
}

#[test]
fn transposed_chunks_are_turned_back() {
    let folder = Folder::new();
    let content = known(SampleType::U8);
    // Stored x, z, y: the slowest first.
    let mut turned = Vec::new();
    for (x, z, y) in (0..24).map(|i| (i / 6, i / 3 % 2, i % 3)) {
        turned.push(content.bytes()[z * 12 + y * 4 + x]);
    }
    let turn = json!({ "name": "transpose", "configuration": { "order": [2, 0, 1] } });
    let codecs = json!([turn, { "name": "bytes" }]);
    let path = store_3(&folder, "a", &array_3("uint8", &codecs), &[("c/0/0/0", &turned)]);
    expect_known(&path, SampleType::U8);
    // Two turns, of which the first is as above.
    let codecs = json!([{ "name": "transpose", "configuration": { "order": [2, 0, 1] } },
                        { "name": "transpose", "configuration": { "order": [1, 2, 0] } }, { "name": "bytes" }]);
    let path = store_3(&folder, "b", &array_3("uint8", &codecs), &[("c/0/0/0", content.bytes())]);
    expect_known(&path, SampleType::U8);
    let mut reversed = Vec::new();
    for (x, y, z) in (0..24).map(|i| (i / 6, i / 2 % 3, i % 2)) {
        reversed.push(content.bytes()[z * 12 + y * 4 + x]);
    }
    let array = with(array_2("|u1"), "order", json!("F"));
    expect_known(&store_2(&folder, "c", &array, &[("0.0.0", &reversed)]), SampleType::U8);
    let names = with(array_3("uint8", &json!([{ "name": "bytes" }])), "dimension_names", json!(["x", "y", "z"]));
    let names = with(names, "shape", json!([4, 3, 2]));
    let grid = json!({ "name": "regular", "configuration": { "chunk_shape": [4, 3, 2] } });
    let path = store_3(&folder, "d", &with(names, "chunk_grid", grid), &[("c/0/0/0", &reversed)]);
    expect_known(&path, SampleType::U8);
}

/// A shard of the known volume in two chunks, one a slice, with the index before or behind.
fn shard(at_end: bool, missing: bool) -> (Value, Vec<u8>) {
    let content = known(SampleType::U8);
    let chunks = [gzip(&content.bytes()[..12]), gzip(&content.bytes()[12..])];
    let mut at: u64 = if at_end { 0 } else { 36 };
    let mut index = Vec::new();
    for (number, chunk) in chunks.iter().enumerate() {
        let entry = if missing && number == 1 { [u64::MAX; 2] } else { [at, chunk.len() as u64] };
        index.extend(entry.iter().flat_map(|number| number.to_le_bytes()));
        at += chunk.len() as u64;
    }
    let sum = crc32c(&index).to_le_bytes();
    let index = [&index[..], &sum].concat();
    let body = chunks.concat();
    let codecs = json!([{ "name": "sharding_indexed", "configuration": {
        "chunk_shape": [1, 3, 4],
        "codecs": [{ "name": "bytes" }, { "name": "gzip", "configuration": { "level": 5 } }],
        "index_codecs": [little(), { "name": "crc32c" }],
        "index_location": if at_end { "end" } else { "start" } } }]);
    (codecs, if at_end { [body, index].concat() } else { [index, body].concat() })
}

#[test]
fn shards_are_read_by_their_index() {
    let folder = Folder::new();
    for (name, at_end) in [("end", true), ("start", false)] {
        let (codecs, bytes) = shard(at_end, false);
        let path = store_3(&folder, name, &array_3("uint8", &codecs), &[("c/0/0/0", &bytes)]);
        expect_known(&path, SampleType::U8);
    }
    let (codecs, bytes) = shard(true, true);
    let array = with(array_3("uint8", &codecs), "fill_value", json!(9));
    let half = opened(&store_3(&folder, "half", &array, &[("c/0/0/0", &bytes)]));
    assert_eq!(samples(&half)[12..], [9.0; 12]);
    refused(&store_3(&folder, "none", &array, &[]), &["Zarr chunks", "at least one of the volume's 1 shard", "none"]);
    let mut wrong = bytes.clone();
    let len = wrong.len();
    wrong[len - 5] ^= 1;
    refused(&store_3(&folder, "sum", &array, &[("c/0/0/0", &wrong)]), &["Zarr shard", "another checksum"]);
    refused(&store_3(&folder, "cut", &array, &[("c/0/0/0", &bytes[..20])]), &["an index of 36 bytes", "20 bytes"]);
    let summed = |index: &[u8]| [index, &crc32c(index).to_le_bytes()].concat();
    for (entry, part) in [([5, 1 << 40], "5 and 1099511627776 more"), ([u64::MAX - 1, 7], "chunks in its 36 bytes")] {
        let index: Vec<u8> = entry.iter().chain(&entry).flat_map(|number: &u64| number.to_le_bytes()).collect();
        refused(&store_3(&folder, "lie", &array, &[("c/0/0/0", &summed(&index))]), &["Zarr shard", part]);
    }
}

/// An image of two levels, t c z y x; sample = 10 t + c at level 0, and 100 more at level 1.
fn image(folder: &Folder, version: u32) -> PathBuf {
    let path = folder.path().join(format!("image{version}"));
    let axis = |name: &str, kind: &str| json!({ "name": name, "type": kind });
    let space = |name: &str| json!({ "name": name, "type": "space", "unit": "micrometer" });
    let dataset = |name: &str, scale: f64, shift: f64| {
        json!({ "path": name, "coordinateTransformations": [
            { "type": "scale", "scale": [1, 1, 2.0 * scale, 0.5 * scale, 0.25 * scale] },
            { "type": "translation", "translation": [0, 0, 3.0, shift, 0] }] })
    };
    let scales = json!([{ "axes": [axis("t", "time"), axis("c", "channel"), space("z"), space("y"), space("x")],
        "datasets": [dataset("full", 1.0, 0.0), dataset("a/half", 2.0, 0.25)],
        "coordinateTransformations": [{ "type": "scale", "scale": [0.1, 1, 10, 10, 10] }],
        "name": "cells" }]);
    if version == 2 {
        write(&path.join(".zgroup"), json!({ "zarr_format": 2 }).to_string());
        write(&path.join(".zattrs"), json!({ "multiscales": scales }).to_string());
    } else {
        let attributes = json!({ "ome": { "version": "0.5", "multiscales": scales } });
        let group = json!({ "zarr_format": 3, "node_type": "group", "attributes": attributes });
        write(&path.join("zarr.json"), group.to_string());
    }
    for (level, name, side) in [(0u8, "full", 4), (1, "a/half", 2)] {
        let shape = json!([2, 3, side, side, side]);
        let chunk = json!([1, 1, side, side, side]);
        if version == 2 {
            let array = json!({ "zarr_format": 2, "shape": shape, "chunks": chunk, "dtype": "|u1", "order": "C",
                                "compressor": null, "filters": null, "fill_value": null });
            write(&path.join(name).join(".zarray"), array.to_string());
        } else {
            let array = with(array_3("uint8", &json!([{ "name": "bytes" }])), "shape", shape);
            let grid = json!({ "name": "regular", "configuration": { "chunk_shape": chunk } });
            write(&path.join(name).join("zarr.json"), with(array, "chunk_grid", grid).to_string());
        }
        for (t, c) in (0..6).map(|i| (i / 3, i % 3)) {
            let key = if version == 2 { format!("{t}.{c}.0.0.0") } else { format!("c/{t}/{c}/0/0/0") };
            write(&path.join(name).join(key), vec![100 * level + 10 * t + c; side * side * side]);
        }
    }
    path
}

#[test]
fn ome_images_are_read_by_level_and_volume() {
    let folder = Folder::new();
    for version in [2, 3] {
        let path = image(&folder, version);
        let at = |level, volume_index| {
            let options = OpenOptions::new().level(level).volume_index(volume_index);
            read_with(&path, &options).unwrap_or_else(|error| panic!("{error}"))
        };
        for (volume, value) in [(0, 0.0), (2, 2.0), (3, 10.0), (5, 12.0)] {
            assert_eq!(samples(&at(0, volume)), [value; 64], "version {version}");
            assert_eq!(samples(&at(1, volume)), [100.0 + value; 8], "version {version}");
        }
        let (fine, coarse) = (at(0, 0).header, at(1, 0).header);
        assert_eq!((fine.format, fine.grid.unit.as_deref()), ("OME-Zarr", Some("um")));
        assert_eq!((fine.grid.spacing, fine.grid.origin), ([2.5, 5.0, 20.0], [0.0, 0.0, 30.0]));
        assert_eq!((coarse.grid.spacing, coarse.grid.origin), ([5.0, 10.0, 40.0], [0.0, 2.5, 30.0]));
        let source = open(&path, &OpenOptions::default()).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(
            source.notes(),
            [
                "level 0 of 2 is read (`OpenOptions::level` chooses): 0: 2 x 3 x 4 x 4 x 4, 1: 2 x 3 x 2 x 2 x 2",
                "the first of 6 volumes is read (`OpenOptions::volume_index` chooses another)"
            ]
        );
        let beyond = OpenOptions::new().level(2);
        expect_refused(&path, &beyond, &["level", "is 2", "2 levels", "1: 2 x 3 x 2 x 2 x 2"]);
        let beyond = OpenOptions::new().volume_index(6);
        expect_refused(&path, &beyond, &["volume", "is 6", "6 volumes (t 2, c 3, the last fastest)"]);
        let series = OpenOptions::new().series("0");
        expect_refused(&path, &series, &["series", "DICOM"]);
    }
}

#[test]
fn ome_axes_with_several_units_of_length_have_that_of_x() {
    let folder = Folder::new();
    let path = image(&folder, 2).join(".zattrs");
    for (unit, spacing, origin, name) in [
        ("nanometer", [2.5, 5000.0, 20_000.0], [0.0, 0.0, 30_000.0], Some("nm")),
        ("millimeter", [2.5, 0.005, 0.02], [0.0, 0.0, 0.03], Some("mm")),
        ("furlong", [2.5, 5.0, 20.0], [0.0, 0.0, 30.0], None),
    ] {
        let attributes = std::fs::read_to_string(&path).expect("just written");
        let mut attributes: Value = serde_json::from_str(&attributes).expect("just written");
        attributes["multiscales"][0]["axes"][4]["unit"] = unit.into();
        write(&path, attributes.to_string());
        let grid = opened(path.parent().expect("it is in a folder")).header.grid;
        assert_eq!((grid.spacing, grid.origin, grid.unit.as_deref()), (spacing, origin, name));
    }
}

#[test]
fn volumes_of_axes_without_names_are_counted() {
    let folder = Folder::new();
    let array = with(with(array_2("|u1"), "shape", json!([2, 3, 2, 3, 4])), "chunks", json!([1, 1, 2, 3, 4]));
    let path = store_2(&folder, "a", &array, &[("0.0.0.0.0", known(SampleType::U8).bytes())]);
    expect_refused(&path, &OpenOptions::new().volume_index(6), &["holds 6 volumes (2, 3, the last fastest)"]);
}

#[test]
fn groups_are_looked_into_as_far_as_there_is_one_image() {
    let folder = Folder::new();
    let inner = image(&folder, 2);
    let outer = Folder::new();
    write(&outer.path().join(".zgroup"), "{\"zarr_format\": 2}");
    write(&outer.path().join("OME/.zgroup"), "{\"zarr_format\": 2}");
    refused(outer.path(), &["group without arrays"]);
    std::fs::rename(inner, outer.path().join("0")).expect("both are in the temporary folder");
    assert_eq!(opened(outer.path()).header.grid.dims, [4, 4, 4]);
    write(&outer.path().join("1/.zgroup"), "{\"zarr_format\": 2}");
    refused(outer.path(), &["a Zarr group of several", "0, 1"]);
}

#[test]
fn metadata_that_cannot_be_read_here_are_named() {
    let folder = Folder::new();
    let bytes = || json!([{ "name": "bytes" }]);
    let sharded = |field: &str, value: Value| {
        let mut codecs = shard(true, false).0;
        codecs[0]["configuration"][field] = value;
        array_3("uint8", &codecs)
    };
    for (number, (array, parts)) in [
        (with(array_2("<u2"), "dtype", json!("<i8")), ["\"dtype\"", "<i8"]),
        (with(array_2("<u2"), "dtype", json!([["r", "|u1"]])), ["\"dtype\"", "|u1"]),
        (with(array_2("<u2"), "dtype", json!("é1")), ["\"dtype\"", "u1, i1"]),
        (with(array_2("<u2"), "shape", json!([0, 3, 4])), ["\"shape\"", "at least 1"]),
        (with(array_2("<u2"), "shape", json!([2, 3, -4])), ["\"shape\"", "-4"]),
        (with(array_2("<u2"), "shape", json!(vec![1; 99])), ["\"shape\"", "at most 16"]),
        (with(array_2("<u2"), "shape", json!([70_000, 3, 4])), ["points along z", "65535"]),
        (with(array_2("<u2"), "shape", json!([4])), ["\"chunks\"", "3 and 3 of 1 dimensions"]),
        (with(array_2("<u2"), "chunks", json!([65_536, 65_536, 4])), ["bytes of a chunk", "2147483648"]),
        (with(array_2("<u2"), "chunks", json!([u64::MAX, u64::MAX, 4])), ["bytes of a chunk", "2147483648"]),
        (with(array_2("<u2"), "chunks", json!([2, 0, 4])), ["\"chunks\"", "at least 1"]),
        (with(array_2("<u2"), "order", json!("K")), ["\"order\"", "got K"]),
        (with(array_2("<u2"), "filters", json!([{ "id": "delta" }])), ["\"filters\"", "delta"]),
        (with(array_2("<u2"), "compressor", json!({ "id": "lzma" })), ["\"compressor\"", "lzma"]),
        (with(array_2("<u2"), "compressor", json!({})), ["\"compressor\"", "an \"id\""]),
        (with(array_2("<u2"), "fill_value", json!(65_536)), ["\"fill_value\"", "a value of u16"]),
        (with(array_2("<u2"), "fill_value", json!(1.5)), ["\"fill_value\"", "1.5"]),
        (with(array_2("<u2"), "fill_value", json!("NaN")), ["\"fill_value\"", "NaN"]),
        (with(array_2("<u2"), "dimension_separator", json!("-")), ["\"dimension_separator\"", "got -"]),
        (json!([1, 2]), ["a JSON object", "[1,2]"]),
        (with(array_3("int64", &bytes()), "x", json!(0)), ["\"data_type\"", "int64"]),
        (array_3("uint8", &json!([])), ["a codec that makes bytes", "none"]),
        (array_3("uint8", &json!([{ "name": "gzip" }])), ["transpose, bytes", "gzip"]),
        (array_3("uint8", &json!([{ "name": "bytes" }, { "name": "pcodec" }])), ["gzip, zlib, blosc", "pcodec"]),
        (
            array_3("uint8", &json!([{ "name": "transpose", "configuration": { "order": [0, 0, 1] } }])),
            ["each dimension once", "[0,0,1]"],
        ),
        (with(array_3("uint8", &bytes()), "chunk_grid", json!({ "name": "rectilinear" })), ["regular", "rectilinear"]),
        (with(array_3("uint8", &bytes()), "storage_transformers", json!([1])), ["storage_transformers", "[1]"]),
        (with(array_3("uint8", &bytes()), "chunk_key_encoding", json!("odd")), ["chunk_key_encoding", "odd"]),
        (with(array_3("uint8", &bytes()), "node_type", json!("x")), ["node_type", "\"group\" or \"array\""]),
        (with(array_3("uint8", &bytes()), "dimension_names", json!(["a", "y", "b"])), ["axes x and y", "a, y, b"]),
        (sharded("chunk_shape", json!([2, 2, 4])), ["inner chunks that divide", "others"]),
        (sharded("chunk_shape", json!([1, 3])), ["as many numbers", "3 and 2 of 3"]),
        (sharded("index_codecs", json!([{ "name": "bytes" }, { "name": "gzip" }])), ["index_codecs", "crc32c"]),
        (sharded("index_location", json!("middle")), ["index_location", "middle"]),
        (sharded("codecs", shard(true, false).0), ["shards that hold no shards", "such"]),
    ]
    .into_iter()
    .enumerate()
    {
        let is_third = array.get("node_type").is_some();
        let store = if is_third { store_3 } else { store_2 };
        refused(&store(&folder, &number.to_string(), &array, &[]), &parts);
    }
    write(&folder.path().join("j/.zarray"), "{\"zarr_format\":");
    refused(&folder.path().join("j"), &["Zarr metadata", "a JSON object", "EOF"]);
    for (number, (field, value, part)) in [
        ("axes", json!([{ "name": "x" }]), "each scale"),
        ("axes", json!([1, 2]), "axes with names"),
        ("axes", json!([]), "axes with names"),
        ("datasets", json!([]), "1 to 64 datasets"),
        ("datasets", json!([{ "path": "../../etc" }]), "a path inside the group"),
        ("datasets", json!([{ "path": 7 }]), "a path inside the group"),
        ("datasets", json!([{ "path": "gone" }]), "there is no Zarr array"),
        ("coordinateTransformations", json!([{ "type": "affine" }]), "scale, translation or identity"),
        ("coordinateTransformations", json!([{ "type": "scale", "scale": [1, 1, 1, 1, 0] }]), "spacings above 0"),
    ]
    .into_iter()
    .enumerate()
    {
        let folder = Folder::new();
        let path = image(&folder, 2);
        let text = std::fs::read_to_string(path.join(".zattrs")).expect("it was written");
        let mut attributes: Value = serde_json::from_str(&text).expect("it was written");
        attributes["multiscales"][0][field] = value;
        write(&path.join(".zattrs"), attributes.to_string());
        expect_refused(&path, &OpenOptions::default(), &[part]);
        assert!(number < 9);
    }
}

#[test]
fn chunks_that_are_not_what_their_array_says_are_refused() {
    let folder = Folder::new();
    let zipped = with(array_2("<u2"), "compressor", json!({ "id": "gzip" }));
    let fails = |array: &Value, chunk: &[u8], parts: &[&str]| {
        refused(&store_2(&folder, "a", array, &[("0.0.0", chunk)]), parts);
    };
    fails(&array_2("<u2"), &[0; 47], &["Zarr chunk", "an intact chunk of 48 bytes", "47 bytes"]);
    fails(&array_2("<u2"), &[0; 49], &["Zarr chunk", "49 bytes"]);
    fails(&array_2("<u2"), &[0; 70_000], &["at most", "70000 packed bytes"]);
    fails(&zipped, &gzip(&[0; 1 << 20]), &["more than 48 bytes"]);
    fails(&zipped, &gzip(&[0; 7]), &["7 bytes"]);
    fails(&zipped, &gzip(&[0; 48])[..12], &["intact chunk"]);
    fails(&zipped, b"hello", &["intact chunk"]);
    let blosc = packed_array("blosc");
    let whole = packed("lz4-bytes.blosc");
    let mut lie = whole.clone();
    lie[4..8].copy_from_slice(&0x7fff_ffff_u32.to_le_bytes());
    fails(&blosc, &lie, &["a Blosc frame of 2147483647 bytes"]);
    fails(&blosc, &whole[..whole.len() - 9], &["breaks off"]);
    fails(&blosc, &whole[..7], &["Blosc frame"]);
    let path = store_2(&folder, "b", &array_2("<u2"), &[]);
    write(&path.join("0.0.0/file"), "");
    refused(&path, &["is a folder"]);
}

#[test]
fn damaged_stores_never_panic() {
    let mut random = 0x9e37_79b9_7f4a_7c15_u64;
    let mut next = |below: usize| {
        random ^= random << 13;
        random ^= random >> 7;
        random ^= random << 17;
        usize::try_from(random >> 33).unwrap_or(0) % below
    };
    let mut damage = |bytes: &[u8]| {
        let mut bytes = bytes.to_vec();
        for _ in 0..=next(3) {
            let at = next(bytes.len());
            bytes[at] = match next(4) {
                0 => b'9',
                1 => 0xff,
                2 => bytes[at] ^ (1 << next(8)),
                _ => u8::try_from(next(256)).expect("below 256"),
            };
        }
        if next(8) == 0 {
            bytes.truncate(next(bytes.len()));
        }
        bytes
    };
    let folder = Folder::new();
    let (mut taken, mut tries) = (0, 0);
    let mut check = |path: &Path| {
        tries += 1;
        match read(path) {
            Ok(_) => taken += 1,
            Err(error) => assert!(!error.to_string().contains('\n'), "{error}"),
        }
    };
    // Writing over a file makes some systems wait for the disk.
    let rewrite = |path: &Path, bytes: &[u8]| {
        let _ = std::fs::remove_file(path);
        write(path, bytes);
    };
    for (compressor, file) in [
        ("blosc", "blosclz-bytes.blosc"),
        ("blosc", "lz4-bits.blosc"),
        ("blosc", "zlib-none.blosc"),
        ("blosc", "zstd-bytes.blosc"),
        ("zstd", "chunk.zst"),
        ("lz4", "chunk.lz4"),
    ] {
        let whole = packed(file);
        let path = store_2(&folder, file, &packed_array(compressor), &[]);
        for _ in 0..250 {
            rewrite(&path.join("0.0.0"), &damage(&whole));
            check(&path);
        }
    }
    let (codecs, bytes) = shard(true, false);
    let array = array_3("uint8", &codecs);
    let path = store_3(&folder, "shard", &array, &[("c/0/0/0", &bytes)]);
    for _ in 0..250 {
        rewrite(&path.join("c/0/0/0"), &damage(&bytes));
        check(&path);
    }
    rewrite(&path.join("c/0/0/0"), &bytes);
    for _ in 0..500 {
        rewrite(&path.join("zarr.json"), &damage(array.to_string().as_bytes()));
        check(&path);
    }
    let path = image(&folder, 2);
    for name in [".zattrs", "full/.zarray"] {
        let whole = std::fs::read(path.join(name)).expect("it was written");
        for _ in 0..300 {
            rewrite(&path.join(name), &damage(&whole));
            check(&path);
        }
        rewrite(&path.join(name), &whole);
    }
    assert!(taken > tries / 20, "only {taken} of {tries} damaged stores were read");
}
