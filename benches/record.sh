#!/usr/bin/env bash
# Runs the five stages' benches and writes what they gave to benches/record, a file a date and stage.
#
#   benches/record.sh                                all five, a quarter of an hour on a quiet machine
#   benches/record.sh traverse splat_cpu             these
#   benches/record.sh --note 'a build ran beside'    says so on the record
#
# A file's head has the date, commit, processor, compiler and load; then a line a benchmark, sorted: mean in
# nanoseconds, the ends of its 95 % interval by criterion's bootstrap, and voxels, samples, records, splats or files a
# second. A second run on a day replaces the first. Two records compare with `diff -y`. Needs Python 3.
set -euo pipefail
cd "$(dirname "$0")/.."

note='nothing said' stages=()
while (($#)); do
    case $1 in
        --note) note=${2:?--note needs a text}; shift 2 ;;
        build | open | traverse | splat_cpu | splat_gpu) stages+=("$1"); shift ;;
        *) sed -n '2,/^set/{/^set/d;s/^# \{0,1\}//;p}' "$0" >&2; exit 2 ;;
    esac
done
((${#stages[@]})) || stages=(build open traverse splat_cpu splat_gpu)

work=$(mktemp -d)
trap 'rm -rf -- "$work"' EXIT
commit=$(git rev-parse --short HEAD)$(git diff --quiet HEAD -- . ':!benches/record' || echo ' and changes')
for stage in "${stages[@]}"; do
    cargo bench --locked --no-run --bench "$stage"
done
mkdir -p benches/record
for stage in "${stages[@]}"; do
    day=$(date -u +%F) load=$(cut -d ' ' -f 1-3 /proc/loadavg)
    # Criterion's files go to a folder of their own: estimates of earlier runs must not be taken for this one's.
    CRITERION_HOME=$work/$stage cargo bench --locked --bench "$stage" -- --noplot | tee "$work/said"
    {
        echo "stage:      $stage"
        echo "date:       $day"
        echo "commit:     $commit"
        echo "processor:  $(sed -n 's/^model name[^:]*: //p' /proc/cpuinfo | head -n 1), $(nproc) cores, $(uname -m)"
        echo "compiler:   $(rustc --version)"
        echo "load:       $load before, $(cut -d ' ' -f 1-3 /proc/loadavg) after (1, 5, 15 minutes)"
        echo "beside it:  $note"
        sed -n 's/^device: /device:     /p' "$work/said"
        echo
        python3 - "$work/$stage" <<'PYTHON'
import json, pathlib, sys

rows = []
for found in pathlib.Path(sys.argv[1]).glob("**/new/estimates.json"):
    mean = json.loads(found.read_text())["mean"]
    benchmark = json.loads((found.parent / "benchmark.json").read_text())
    throughput = benchmark["throughput"] or {}
    # {"Elements": n} or {"ElementsAndBytes": {"elements": n, "bytes": m}}.
    elements = throughput.get("Elements") or throughput["ElementsAndBytes"]["elements"]
    interval = mean["confidence_interval"]
    rate = elements * 1e9 / mean["point_estimate"]
    rows.append((benchmark["full_id"], mean["point_estimate"], interval["lower_bound"], interval["upper_bound"], rate))
if not rows:
    sys.exit("no estimates: nothing was measured")
width = max(len(row[0]) for row in rows)
print(f"{'benchmark':<{width}}  {'mean, ns':>15}  {'from':>15}  {'to':>15}  {'million a second':>16}")
for name, point, low, high, rate in sorted(rows):
    print(f"{name:<{width}}  {point:15,.0f}  {low:15,.0f}  {high:15,.0f}  {rate / 1e6:16,.4g}")
PYTHON
    } >"$work/record"
    cp -- "$work/record" "benches/record/$day-$stage.txt"
    echo "wrote benches/record/$day-$stage.txt" >&2
done
