// A stable radix sort of keys and their items, 8 bits at a time, lowest first: count, scan, scatter.
//
// A workgroup has ROUNDS x 256 neighbours. `count`: how many of them have each digit. `scan`: one workgroup a digit,
// how many come before each workgroup's. `scatter`: round by round each invocation sets its bit in the mask of its
// digit, so that the bits below its own are its rank among equals; nothing overtakes, so that equal keys keep their
// order.

override SHIFT: u32 = 0u;

@group(0) @binding(0) var<storage, read> distances: array<f32>;
@group(0) @binding(1) var<storage, read> keys: array<u32>;
@group(0) @binding(2) var<storage, read> items: array<u32>;
@group(0) @binding(3) var<storage, read_write> sorted_keys: array<u32>;
@group(0) @binding(4) var<storage, read_write> sorted_items: array<u32>;
// By digit, then by workgroup.
@group(0) @binding(5) var<storage, read_write> counts: array<u32>;
// By digit.
@group(0) @binding(6) var<storage, read_write> totals: array<u32>;

const SIZE: u32 = 256u;
const DIGITS: u32 = 256u;
const ROUNDS: u32 = 16u;
// Words of a mask of the invocations.
const WORDS: u32 = 8u;

var<workgroup> histogram: array<atomic<u32>, DIGITS>;
var<workgroup> sums: array<u32, SIZE>;
var<workgroup> next: array<u32, DIGITS>;
// Invocations that have the digit in this round: by word, then by digit.
var<workgroup> masks: array<atomic<u32>, 2048>;

fn digit_of(key: u32) -> u32 {
    return (key >> SHIFT) & 0xffu;
}

// The sum of `own` over the invocations up to this one; `sums` has all of them.
fn sum_up_to(local: u32, own: u32) -> u32 {
    sums[local] = own;
    workgroupBarrier();
    for (var reach = 1u; reach < SIZE; reach = 2u * reach) {
        var before = 0u;
        if local >= reach {
            before = sums[local - reach];
        }
        workgroupBarrier();
        sums[local] += before;
        workgroupBarrier();
    }
    return sums[local];
}

// Distances as words of the same order, each with its index.
@compute @workgroup_size(256)
fn key(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    for (var round = 0u; round < ROUNDS; round++) {
        let at = (group.x * ROUNDS + round) * SIZE + local;
        if at < arrayLength(&distances) {
            let bits = bitcast<u32>(distances[at]);
            sorted_keys[at] = bits ^ select(0x80000000u, 0xffffffffu, bits >= 0x80000000u);
            sorted_items[at] = at;
        }
    }
}

@compute @workgroup_size(256)
fn count(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    for (var round = 0u; round < ROUNDS; round++) {
        let at = (group.x * ROUNDS + round) * SIZE + local;
        if at < arrayLength(&keys) {
            atomicAdd(&histogram[digit_of(keys[at])], 1u);
        }
    }
    workgroupBarrier();
    counts[local * groups.x + group.x] = atomicLoad(&histogram[local]);
}

@compute @workgroup_size(256)
fn scan(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let groups = arrayLength(&counts) / DIGITS;
    let row = group.x * groups;
    var before = 0u;
    for (var first = 0u; first < groups; first += SIZE) {
        let at = first + local;
        var own = 0u;
        if at < groups {
            own = counts[row + at];
        }
        let through = sum_up_to(local, own);
        if at < groups {
            counts[row + at] = before + through - own;
        }
        before += sums[SIZE - 1u];
        workgroupBarrier();
    }
    if local == 0u {
        totals[group.x] = before;
    }
}

@compute @workgroup_size(256)
fn scatter(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let own = totals[local];
    next[local] = sum_up_to(local, own) - own + counts[local * groups.x + group.x];
    for (var round = 0u; round < ROUNDS; round++) {
        let at = (group.x * ROUNDS + round) * SIZE + local;
        let is_there = at < arrayLength(&keys);
        var sort_key = 0u;
        if is_there {
            sort_key = keys[at];
        }
        let digit = digit_of(sort_key);
        let word = local >> 5u;
        let bit = 1u << (local & 31u);
        if is_there {
            atomicOr(&masks[word * DIGITS + digit], bit);
        }
        workgroupBarrier();
        if is_there {
            var rank = countOneBits(atomicLoad(&masks[word * DIGITS + digit]) & (bit - 1u));
            for (var w = 0u; w < word; w++) {
                rank += countOneBits(atomicLoad(&masks[w * DIGITS + digit]));
            }
            let place = next[digit] + rank;
            sorted_keys[place] = sort_key;
            sorted_items[place] = items[at];
        }
        workgroupBarrier();
        var placed = 0u;
        for (var w = 0u; w < WORDS; w++) {
            placed += countOneBits(atomicExchange(&masks[w * DIGITS + local], 0u));
        }
        next[local] += placed;
        workgroupBarrier();
    }
}
