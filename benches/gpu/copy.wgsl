// A copy, 16 bytes at a time.

@group(0) @binding(0) var<storage, read> source: array<vec4<u32>>;
@group(0) @binding(1) var<storage, read_write> copied: array<vec4<u32>>;

@compute @workgroup_size(256)
fn copy(@builtin(global_invocation_id) at: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    for (var k = at.x; k < arrayLength(&source); k += 256u * groups.x) {
        copied[k] = source[k];
    }
}
