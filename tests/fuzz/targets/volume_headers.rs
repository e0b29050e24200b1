//! Any bytes as a volume file: opened by the reader that its first byte or its name asks for, and read.
//!
//! The input's last byte chooses the name, from which a reader is found where the content says nothing.
#![no_main]

use std::path::PathBuf;
use std::sync::LazyLock;

use adjsplat::volume::SampleType;
use adjsplat_readers::{OpenOptions, RawOptions, open};
use libfuzzer_sys::fuzz_target;

/// One name for each way into a reader.
const NAMES: [&str; 11] = [
    "v.nrrd", "v.nhdr", "v.mha", "v.mhd", "v.nii", "v.nii.gz", "v.hdr", "v.img", "v.vtk", "v.img.gz", "v.raw",
];
/// Headers may ask for slices of 34 GB, which compressed streams may even hold: reading those shows nothing more.
const MOST_BYTES: u64 = 1 << 22;
const MOST_SLICES: u32 = 40;

static FOLDER: LazyLock<tempfile::TempDir> = LazyLock::new(|| tempfile::tempdir().expect("a temporary folder"));

fuzz_target!(|input: &[u8]| {
    let Some((choice, bytes)) = input.split_last() else { return };
    let path: PathBuf = FOLDER.path().join(NAMES[usize::from(*choice) % NAMES.len()]);
    std::fs::write(&path, bytes).expect("the folder can be written");
    let mut options = OpenOptions::default();
    if path.extension().is_some_and(|extension| extension == "raw") {
        options = options.raw(RawOptions::new([u64::from(*choice), 3, 2], SampleType::U16));
    }
    options = options.volume_index(u32::from(*choice >> 6));
    if let Ok(mut source) = open(&path, &options) {
        let grid = &source.header().grid;
        grid.check().expect("what opens has a sound grid");
        let slices = grid.dims[2].min(MOST_SLICES);
        if grid.slice_len() * source.header().sample_type.bytes() as u64 <= MOST_BYTES {
            let mut slice = source.header().new_slice().expect("there is memory");
            for _ in 0..2 {
                for _ in 0..slices {
                    if source.read_slice(&mut slice).is_err() {
                        break;
                    }
                }
                if source.rewind().is_err() {
                    break;
                }
            }
        }
    }
    std::fs::remove_file(&path).expect("it is there");
});
