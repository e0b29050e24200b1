// A copy, 16 bytes at a time; several times over where a single dispatch has to take long.

override ROUNDS: u32 = 1u;

@group(0) @binding(0) var<storage, read> source: array<vec4<u32>>;
@group(0) @binding(1) var<storage, read_write> copied: array<vec4<u32>>;

@compute @workgroup_size(256)
fn copy(@builtin(global_invocation_id) at: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    for (var round = 0u; round < ROUNDS; round++) {
        for (var k = at.x; k < arrayLength(&source); k += 256u * groups.x) {
            // Another value each round, so that none can be left out.
            copied[k] = source[k] + round;
        }
    }
}
