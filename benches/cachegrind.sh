#!/bin/sh
# The cache model beside cachegrind, on the same walks: benches/cachegrind.sh [PHANTOM [EDGE]]
#
# valgrind counts a program that builds and walks once, and one that builds and does not walk. What differs is the
# walk: here with the geometry of both, 32 KiB of 8 ways and 1 MiB of 16. Both start the walk with warm caches, so the
# difference lacks first touches of what building left behind; the model starts empty.
# Needs valgrind; a few minutes. ADJ names the program, target/debug/adj unless given.
set -eu
phantom=${1:-gyroid}
edge=${2:-128}
adj=${ADJ:-target/debug/adj}
methods=${METHODS:-adjsplat bricks adjacency_b traditional}
orders=${ORDERS:-+z+y+x -y+z+x +x-y+z}

folder=$(mktemp -d)
trap 'rm -r "$folder"' EXIT
set="$folder/$phantom.adj"
"$adj" build "phantom:$phantom" --dims "${edge}x${edge}x$edge" --quiet -o "$set" >/dev/null

# Events of a run with WALKS walks of METHOD in ORDER: reads and writes, first-level misses, last-level misses.
counted() {
    valgrind --tool=cachegrind --cache-sim=yes --D1=32768,8,64 --LL=1048576,16,64 \
        --cachegrind-out-file="$folder/out" "$adj" study cache "$set" --quiet \
        --methods "$1" "--orders=$2" --walks "$3" >/dev/null 2>&1
    # Ir I1mr ILmr Dr D1mr DLmr Dw D1mw DLmw
    awk '/^summary:/ { print $5 + $8, $6 + $9, $7 + $10 }' "$folder/out"
}

echo "set method order: data accesses, D1 misses, LL misses (cachegrind) | accesses, L1, L2 misses (model)"
for method in $methods; do
    without=$(counted "$method" +z+y+x 0)
    for order in $orders; do
        with=$(counted "$method" "$order" 1)
        "$adj" study cache "$set" --quiet --methods "$method" "--orders=$order" --l3 none \
            --csv "$folder/model.csv" >/dev/null
        # Columns by name: misses of L1 and L2, and accesses.
        model=$(awk -F, 'NR == 1 { for (i = 1; i <= NF; i++) at[$i] = i; next }
            { misses[NR] = $at["misses"]; accesses = $at["accesses"] }
            END { print accesses, misses[2], misses[3] }' "$folder/model.csv")
        echo "$phantom $edge^3 $method $order: $(echo "$without $with" | awk '{ print $4 - $1, $5 - $2, $6 - $3 }') | $model"
    done
done
