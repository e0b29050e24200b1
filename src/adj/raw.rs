//! `adj raw`: writes a volume's voxels as a raw file, for tools that read no other format.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use super::input::{Input, InputArguments};
use super::progress::{Progress, interrupted};
use super::{Answer, check_output, print_line};
use adjsplat::error::Result;
use adjsplat::file::write_atomically_unless;

/// Write a volume's voxels as a raw file: no header, x fastest, little endian
///
/// Reads every format that adj build reads. Voxels are written as stored, without slope and intercept.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  adj raw head.nii.gz -o head.raw\n  adj raw phantom:gyroid --dims 2048x2048x1024 -o gyroid.raw"
)]
pub(super) struct Arguments {
    /// The volume: a file, a folder of slices, several files of slices ('slices/*.tif', in the order of the numbers in
    /// their names), or phantom:NAME
    #[arg(value_name = "IN", required = true)]
    input: Vec<PathBuf>,
    /// The raw file to write
    #[arg(short, long, value_name = "OUT.raw")]
    output: PathBuf,
    /// Print the result as JSON
    #[arg(long)]
    json: bool,
    /// Show no progress bar
    #[arg(long, short)]
    quiet: bool,
    #[command(flatten)]
    reading: InputArguments,
}

pub(super) fn run(arguments: &Arguments) -> Result<Answer> {
    let input = Input::find(&arguments.input)?;
    let mut source = arguments.reading.open(&input)?;
    check_output("--output", &arguments.output, input.all_files(&source))?;
    let header = source.header().clone();
    let mut slice = header.new_slice()?;
    let mut progress = Progress::new(arguments.quiet);
    let depth = header.grid.dims[2];
    let mut failed = None;
    let written = write_atomically_unless(&interrupted, &arguments.output, |out| {
        for z in 0..depth {
            let _ = progress.show("raw", z.into(), depth.into());
            if let Err(error) = source.read_slice(&mut slice) {
                failed = Some(error);
                return Err(std::io::Error::other("the volume cannot be read"));
            }
            if cfg!(target_endian = "big") {
                slice.swap_bytes();
            }
            out.write_all(slice.bytes())?;
        }
        Ok(())
    });
    drop(progress);
    if let Some(error) = failed {
        return Err(error);
    }
    written?;
    let [x, y, z] = header.grid.dims;
    let [dx, dy, dz] = header.grid.spacing;
    let name = header.sample_type.name();
    let path = arguments.output.display();
    print_line(&if arguments.json {
        json!({ "output": path.to_string(), "dims": header.grid.dims, "type": name, "spacing": header.grid.spacing,
                "slope": header.slope, "intercept": header.intercept })
        .to_string()
    } else {
        format!("{path}: read it with --dims {x}x{y}x{z} --type {name} --spacing {dx}x{dy}x{dz}")
    });
    Ok(Answer::Yes)
}
