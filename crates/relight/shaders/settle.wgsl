// Settle: z becomes what was gathered, but in tiles that would change by less than is seen.

@group(0) @binding(1) var<storage, read> behind: array<f32>;

@group(1) @binding(0) var<storage, read> blocks: array<Block>;
// As in gather.wgsl.
@group(1) @binding(1) var<storage, read> partials: array<vec4<f32>>;
@group(1) @binding(2) var<storage, read_write> z: array<vec4<f32>>;

@compute @workgroup_size(THREADS)
fn settle(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let at = id.x * (THREADS / PER_BLOCK) + thread / PER_BLOCK;
    if at >= arrayLength(&blocks) {
        return;
    }
    let block = blocks[at];
    if group.unseen >= 0.0 && behind[block.tile] <= group.unseen {
        return;
    }
    let fresh = group.n_segments * (arrayLength(&partials) / (group.n_segments + 1u)) + block.z;
    for (var component = thread % PER_BLOCK; component < block.n_components; component += PER_BLOCK) {
        z[block.z + component] = partials[fresh + component];
    }
}
