//! Three spellings, one layout: Rust's records, the shaders' as naga lays them out, the format's tables; constants too.

use std::mem::{offset_of, size_of};

use super::twin;
use adjsplat::arena::TileRecord;
use adjsplat::internals::gpu_stages::SHADERS;
use adjsplat::internals::gpu_stages::{
    AffineRow, BATCH, Chunk, FrameUniform, LINES, LineBlock, NO_RECORD, NOTHING, SUMMARY_WORDS, Splat, TILE_SIDE,
    VisitedVoxel,
};
use naga::valid::{Capabilities, ValidationFlags, Validator};
use naga::{AddressSpace, Expression, Literal, Module, TypeInner};

/// What WebGPU promises of every device.
const STORAGE_BUFFERS: usize = 8;
const WORKGROUP_BYTES: u32 = 16 << 10;
const INVOCATIONS: u32 = 256;

/// Name, offset, bytes.
type Field = (String, usize, usize);

fn module(stage: &str) -> Module {
    let (_, text) = SHADERS.iter().find(|(name, _)| *name == stage).expect("a stage of that name");
    naga::front::wgsl::parse_str(text).unwrap_or_else(|fault| panic!("{}", fault.emit_to_string(text)))
}

/// The fields of a shader's struct, and its size.
fn reflected(module: &Module, name: &str) -> (Vec<Field>, usize) {
    let (_, ty) = module.types.iter().find(|(_, ty)| ty.name.as_deref() == Some(name)).expect("a struct of that name");
    let TypeInner::Struct { members, span } = &ty.inner else { panic!("{name} is no struct") };
    let field = |member: &naga::StructMember| {
        let size = module.types[member.ty].inner.size(module.to_ctx());
        (member.name.clone().unwrap(), member.offset as usize, size as usize)
    };
    (members.iter().map(field).collect(), *span as usize)
}

/// The fields of a Rust struct, and its size: a field ends where the next one starts.
macro_rules! fields {
    ($record:ty: $($field:ident)*) => {{
        let starts = [$((stringify!($field), offset_of!($record, $field))),*];
        let ends = starts.iter().skip(1).map(|&(_, at)| at).chain([size_of::<$record>()]);
        let fields = starts.iter().zip(ends).map(|(&(name, at), end)| (name.to_owned(), at, end - at));
        (fields.collect::<Vec<Field>>(), size_of::<$record>())
    }};
}

#[test]
fn shaders_and_rust_lay_records_out_alike() {
    let records = [
        ("AffineRow", fields!(AffineRow: whole remainder)),
        (
            "FrameUniform",
            fields!(FrameUniform: rows shifts steps widths sample_rays eye light light_weights ellipse half_width centre focal near sigma cut_off cut_exponent
                termination max_depth initial_alpha window crop_low crop_high clip rays eye_voxel eye_rest nesting coverage_bits eye_ceil eye_twice fast_order is_back_to_front longest_line
                line_end_bytes value_bits normal_bits uses_magnitude is_perspective shininess tile_columns
                mask_words picture_rows near_sigma low_pass),
        ),
        ("Chunk", fields!(Chunk: first_block slot_count index is_first from_slice to_slice)),
        ("VisitedVoxel", fields!(VisitedVoxel: xy z_coverage record padding)),
        ("Splat", fields!(Splat: columns rows corner_x corner_y falloff_x falloff_y shear peak red green blue on_rays)),
    ];
    for (stage, _) in SHADERS {
        let module = module(stage);
        for (name, rust) in &records {
            assert_eq!(&reflected(&module, name), rust, "{name} of {stage}");
        }
    }
    let vectors = [
        ("place", offset_of!(Splat, columns)),
        ("shape", offset_of!(Splat, falloff_x)),
        ("colour", offset_of!(Splat, red)),
    ];
    let vectors = vectors.map(|(name, at)| (name.to_owned(), at, 16)).to_vec();
    assert_eq!(reflected(&module("tile"), "SplatVectors"), (vectors, size_of::<Splat>()));
    let walk = module("walk");
    assert_eq!(reflected(&walk, "LineBlock"), fields!(LineBlock: first_line line_count first_slot end_slot));
}

#[test]
fn elements_of_arrays_are_as_far_apart_as_in_rust() {
    let strides = [
        ("tiles", size_of::<TileRecord>()),
        ("blocks", size_of::<LineBlock>()),
        ("voxels", size_of::<VisitedVoxel>()),
        ("splats", size_of::<Splat>()),
        ("looks", 16),
        ("depths", 4),
        ("pixels", 16),
    ];
    for (stage, _) in SHADERS {
        let module = module(stage);
        for (_, variable) in module.global_variables.iter() {
            let known = strides.iter().find(|(name, _)| variable.name.as_deref() == Some(*name));
            if let (Some((name, size)), TypeInner::Array { stride, .. }) = (known, &module.types[variable.ty].inner) {
                assert_eq!(*stride as usize, *size, "{name} of {stage}");
            }
        }
    }
}

/// The walk reads a tile as words: each begins where the format's field begins, or in the middle of a wide one.
#[test]
fn the_walk_reads_tiles_as_the_format_has_them() {
    let rust = fields!(TileRecord: tile_u tile_v first_line first_record occupancy low high);
    let text = adjsplat_tests::repository().join("formats/adj-1.md");
    let text = std::fs::read_to_string(text).unwrap();
    let section = text.split_once("### 5.1 Tiles").unwrap().1.split("\n## ").next().unwrap();
    let rows = section.lines().skip_while(|line| !line.starts_with("| field |")).skip(2);
    let specified: Vec<Field> = rows
        .take_while(|line| line.starts_with('|'))
        .map(|line| {
            let cells: Vec<&str> = line.trim_matches('|').split('|').map(str::trim).collect();
            (cells[0].to_owned(), cells[1].parse().unwrap(), cells[2].parse().unwrap())
        })
        .collect();
    assert_eq!(specified, rust.0, "the format's table");
    let place = |name: &str| rust.0.iter().find(|(field, ..)| field == name).unwrap().1;
    let words: Vec<Field> = [
        ("tile_uv", place("tile_u")),
        ("first_line", place("first_line")),
        ("first_record", place("first_record")),
        ("first_record_high", place("first_record") + 4),
        ("occupancy", place("occupancy")),
        ("occupancy_high", place("occupancy") + 4),
        ("low_high", place("low")),
    ]
    .map(|(name, at)| (name.to_owned(), at, 4))
    .to_vec();
    assert_eq!(reflected(&module("walk"), "Tile"), (words, size_of::<TileRecord>()));
    assert_eq!((place("tile_v"), place("high")), (place("tile_u") + 2, place("low") + 2), "halves of their words");
}

/// A constant of a shader as a number.
fn constant(module: &Module, name: &str) -> Option<f64> {
    let (_, constant) = module.constants.iter().find(|(_, constant)| constant.name.as_deref() == Some(name))?;
    Some(match module.global_expressions[constant.init] {
        Expression::Literal(Literal::F32(value)) => value.into(),
        Expression::Literal(Literal::I32(value)) => value.into(),
        Expression::Literal(Literal::U32(value)) => value.into(),
        ref other => panic!("{name} is {other:?}"),
    })
}

#[test]
fn shaders_and_rust_know_the_same_constants() {
    let constants = [
        ("LINES", f64::from(LINES), 1),
        ("BATCH", f64::from(BATCH), 5),
        ("TILE_SIDE", f64::from(TILE_SIDE), 5),
        ("SUMMARY_WORDS", f64::from(SUMMARY_WORDS), 5),
        ("NOTHING", f64::from(NOTHING), 5),
        ("NO_RECORD", f64::from(NO_RECORD), 5),
        ("STEPPING", f64::from(twin::walk::STEPPING), 1),
        ("REACH", f64::from(twin::REACH), 1),
        ("TINY", f64::from(f32::MIN_POSITIVE), 1),
        ("LN_2", f64::from(std::f32::consts::LN_2), 5),
        ("LOG2_E", f64::from(std::f32::consts::LOG2_E), 5),
    ];
    for (name, rust, stages) in constants {
        let found: Vec<f64> = SHADERS.iter().filter_map(|(stage, _)| constant(&module(stage), name)).collect();
        assert_eq!(found, vec![rust; stages], "{name}");
    }
}

/// Numbers with a point in the body of a function of a source file.
fn numbers(text: &str, function: &str) -> Vec<f32> {
    let body = text.split_once(function).unwrap_or_else(|| panic!("no {function}")).1;
    let body = body.split_once("\n}").unwrap().0.replace('_', "");
    let is_part = |c: char| c.is_ascii_digit() || c == '.' || c == '-' || c == 'e';
    let words = body.split(|c: char| !is_part(c)).filter(|word| word.contains('.'));
    words.filter_map(|word| word.parse().ok()).filter(|&number: &f32| number != 1.0).collect()
}

/// The polynomial of 1 - 2^-x: five numbers beside ln 2, in one order.
#[test]
fn the_device_computes_exponentials_with_the_processors_polynomial() {
    let path = adjsplat_tests::repository().join("src/core/splat/arith.rs");
    let processor = numbers(&std::fs::read_to_string(path).unwrap(), "fn loss_ratio(");
    assert_eq!(processor.len(), 5, "{processor:?}");
    for (stage, text) in SHADERS {
        assert_eq!(numbers(text, "fn absorbed("), processor, "{stage}");
    }
}

/// The polynomial of a kernel's tail behind the eye.
#[test]
fn the_device_cuts_kernels_at_the_eye_with_the_processors_polynomial() {
    let path = adjsplat_tests::repository().join("src/core/splat/near.rs");
    let processor = numbers(&std::fs::read_to_string(path).unwrap(), "fn tail_ratio(");
    assert_eq!(processor.len(), 8, "{processor:?}");
    for stage in ["tile", "splat"] {
        let (_, text) = SHADERS.iter().find(|(name, _)| *name == stage).unwrap();
        assert_eq!(numbers(text, "fn tail_ratio("), processor, "{stage}");
    }
}

#[test]
fn every_shader_is_valid_and_within_the_limits_of_every_device() {
    for (stage, text) in SHADERS {
        let module = module(stage);
        let mut validator = Validator::new(ValidationFlags::all(), Capabilities::empty());
        validator.validate(&module).unwrap_or_else(|fault| panic!("{}", fault.emit_to_string(text)));
        let of = |space: fn(&AddressSpace) -> bool| {
            module.global_variables.iter().filter(move |(_, variable)| space(&variable.space)).map(|(_, v)| v)
        };
        let buffers = of(|space| matches!(space, AddressSpace::Storage { .. })).count();
        assert!(buffers <= STORAGE_BUFFERS, "{stage} binds {buffers} storage buffers");
        let shared: u32 = of(|space| *space == AddressSpace::WorkGroup)
            .map(|variable| module.types[variable.ty].inner.size(module.to_ctx()).next_multiple_of(16))
            .sum();
        assert!(shared <= WORKGROUP_BYTES, "{stage} shares {shared} bytes");
        for entry in &module.entry_points {
            let invocations: u32 = entry.workgroup_size.iter().product();
            assert!(invocations <= INVOCATIONS, "{stage} has {invocations} invocations");
        }
    }
}
