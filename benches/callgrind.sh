#!/usr/bin/env bash
# Has a stage got more expensive? Counts instructions and simulated cache misses, which other programs do not disturb.
#
#   benches/callgrind.sh             counts every stage of benches/callgrind.rs, compares with benches/record/callgrind.csv
#   benches/callgrind.sh --accept    likewise, then stores the counts there
#
# Exit code 0: no count moved by more than 1 %; 1: some did, and are marked; 2: trouble or usage. Needs valgrind.
# The caches are fixed: 32 KiB of 8 ways for instructions and as much for content, a last level of 256 KiB of 16 ways (as
# small as the inputs), lines of 64 bytes. Counts hold for one compiler, one C library and one set of vector
# instructions: valgrind 3.19 knows AVX2 and no AVX-512. The record names them.
set -euo pipefail
trap 'exit 2' ERR
cd "$(dirname "$0")/.."

accept=''
case ${1:-} in
    '') ;;
    --accept) accept=yes ;;
    *) sed -n '2,/^set/{/^set/d;s/^# \{0,1\}//;p}' "$0" >&2; exit 2 ;;
esac
command -v valgrind >/dev/null || { echo 'callgrind.sh: there is no valgrind; install it' >&2; exit 2; }

record=benches/record/callgrind.csv
work=$(mktemp -d)
trap 'rm -rf -- "$work"' EXIT

# Cargo names the binary by a hash and says where it is: Executable benches/callgrind.rs (/.../callgrind-0123).
said=$(cargo bench --locked --no-run --bench callgrind 2>&1 | tee /dev/stderr)
binary=$(sed -n 's/.*(\(.*callgrind-[0-9a-f]*\)).*/\1/p' <<<"$said" | tail -n 1)
# Under one name: the path is on the program's stack and moves what lies below it.
cp -- "$binary" "$work/callgrind"

# A run without callgrind names the stages, and asserts that each is right.
"$work/callgrind" >"$work/stages"
vectors=$(grep -qw avx2 /proc/cpuinfo && echo AVX2 || echo 'no AVX2')
{
    echo "# date: $(date -u +%F)"
    echo "# commit: $(git rev-parse --short HEAD)$(git diff --quiet HEAD -- . ':!benches/record' || echo ' and changes')"
    echo "# machine: $(uname -m), $vectors"
    echo "# compiler: $(rustc --version)"
    echo "# C library: $(getconf GNU_LIBC_VERSION), $(valgrind --version)"
    echo 'stage,instructions,l1_misses,last_level_misses'
    for stage in $(cut -d : -f 1 "$work/stages"); do
        # An empty environment: its size would move the stack.
        (cd "$work" && env -i PATH="$PATH" valgrind --tool=callgrind --cache-sim=yes --I1=32768,8,64 \
            --D1=32768,8,64 --LL=262144,16,64 --collect-atstart=no --toggle-collect='*::counted' \
            --callgrind-out-file=counts ./callgrind "$stage" >said 2>&1) || { cat "$work/said" >&2; exit 2; }
        # Events are named once: Ir Dr Dw I1mr D1mr D1mw ILmr DLmr DLmw.
        awk -v stage="$stage" '
            /^events:/ { for (i = 2; i <= NF; i++) column[$i] = i }
            /^totals:/ { printf "%s,%d,%d,%d\n", stage, $column["Ir"], $column["D1mr"] + $column["D1mw"],
                         $column["DLmr"] + $column["DLmw"] }' "$work/counts"
    done
} >"$work/now.csv"

status=0
if [[ -f $record ]]; then
    for line in machine compiler 'C library'; do
        if [[ $(grep "^# $line:" "$record") != $(grep "^# $line:" "$work/now.csv") ]]; then
            echo "another $line than the record's: $(grep "^# $line:" "$record")" >&2
        fi
    done
    # A cache line more or less is where the allocator put something: 64 of them are a page.
    awk -F, -v page=64 '
        /^#/ || /^stage,/ { next }
        NR == FNR { for (i = 2; i <= 4; i++) was[$1, i] = $i; known[$1] = 1; next }
        FNR != NR && !titled++ { printf "%-12s %27s %27s %27s\n", "stage", "instructions", "L1 misses", "last-level misses" }
        {
            printf "%-12s", $1
            for (i = 2; i <= 4; i++) {
                if (!(($1, i) in was)) { printf " %14d %12s", $i, "new"; moved = 1; continue }
                by = $i - was[$1, i]
                mark = (by > 0 ? by : -by) > 0.01 * was[$1, i] && (i == 2 || by > page || by < -page) ? "*" : " "
                if (mark == "*") moved = 1
                printf " %14d %+10.2f%%%s", $i, was[$1, i] ? 100 * by / was[$1, i] : 0, mark
            }
            print ""
            delete known[$1]
        }
        END {
            for (stage in known) { print stage ": in the record only"; moved = 1 }
            if (moved) print "* moved by more than 1 %"
            exit moved
        }' "$record" "$work/now.csv" || status=1
else
    column -s, -t "$work/now.csv"
    echo "no record yet; --accept makes one" >&2
    [[ $accept ]] || status=1
fi
if [[ $accept ]]; then
    mkdir -p benches/record
    cp -- "$work/now.csv" "$record"
    echo "stored in $record" >&2
    status=0
fi
exit $status
