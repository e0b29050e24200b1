#!/usr/bin/env bash
# What a card makes of it: measures the renderer on graphics devices and writes a table and JSON (docs/studies/gpu.md).
#
#   benches/gpu_study.sh                          on a machine with a graphics driver and Rust: builds, then measures
#   benches/gpu_study.sh --binary ./gpu_study     on a bare machine: runs what was built elsewhere
#   benches/gpu_study.sh --build ./gpu_study      only builds, and puts the binary there for a bare machine
#
# --out FOLDER: where gpu_study.txt and gpu_study.json go (default: here). Everything else is for the study:
# --quick (small scenes), --scene gyroid:512, --size 1920x1080, --frames 48; its head in benches/gpu/main.rs has all.
# WGPU_ADAPTER_NAME chooses the device. A binary needs the C library of the machine that built it, or a newer one.
set -euo pipefail

binary='' build_to='' out=. words=()
while (($#)); do
    case $1 in
        --binary) binary=${2:?--binary needs a file}; shift 2 ;;
        --build) build_to=${2:?--build needs a file}; shift 2 ;;
        --out) out=${2:?--out needs a folder}; shift 2 ;;
        *) words+=("$1"); shift ;;
    esac
done

if [[ -z $binary ]]; then
    root=$(cd "$(dirname "$0")/.." && pwd)
    # Cargo names the binary by a hash and says where it is: Executable benches/gpu/main.rs (/.../gpu_study-0123).
    said=$(cd "$root" && cargo bench --locked --no-run --bench gpu_study 2>&1 | tee /dev/stderr)
    binary=$(sed -n 's/.*(\(.*gpu_study-[0-9a-f]*\(\.exe\)\{0,1\}\)).*/\1/p' <<<"$said" | tail -n 1)
    [[ $binary == /* ]] || binary=$root/$binary
fi
[[ $binary == */* ]] || binary=./$binary
if [[ -n $build_to ]]; then
    cp -- "$binary" "$build_to"
    echo "$build_to" >&2
    exit
fi

mkdir -p -- "$out"
# Without a device this fails instead of skipping.
ADJ_GPU=require "$binary" ${words[@]+"${words[@]}"} --json "$out/gpu_study.json" | tee -- "$out/gpu_study.txt"
echo "wrote $out/gpu_study.txt and $out/gpu_study.json" >&2
