// Gather: z = scale · sum over segments, one workgroup per block; where the block would change by less than is seen, z stays
// what it was expanded from. Twin of src/cpu/project.rs and src/cpu/left.rs.

// One per component: the largest magnitude of its left factor per channel, and its scale; all 0 of those that fill a word.
@group(1) @binding(1) var<storage, read> components: array<vec4<f32>>;
@group(1) @binding(2) var<storage, read> partials: array<vec4<f32>>;
// What blocks are to be expanded from. The fourth component says whether that moved.
@group(1) @binding(3) var<storage, read_write> z: array<vec4<f32>>;

var<workgroup> behind: array<vec3<f32>, THREADS>;

@compute @workgroup_size(THREADS)
fn gather(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let block = blocks[id.x];
    let n_components = block.n_components;

    // How far any pixel of the block is behind, at most.
    var most = vec3<f32>(0.0);
    for (var component = thread; component < n_components; component += THREADS) {
        let at = block.z + component;
        most += components[at].xyz * abs(fresh(block, component) - z[at].xyz);
    }
    behind[thread] = most;
    workgroupBarrier();
    for (var half = THREADS / 2u; half > 0u; half /= 2u) {
        if thread < half {
            behind[thread] += behind[thread + half];
        }
        workgroupBarrier();
    }
    let is_seen = group.unseen < 0.0 || max(behind[0].x, max(behind[0].y, behind[0].z)) > group.unseen;

    for (var component = thread; component < n_components; component += THREADS) {
        let at = block.z + component;
        if is_seen {
            z[at] = vec4<f32>(fresh(block, component), 1.0);
        } else {
            z[at].w = 0.0;
        }
    }
}

// In the order of the segments, whatever was projected just now.
fn fresh(block: Block, component: u32) -> vec3<f32> {
    let first = block.z * group.n_segments + component;
    var sum = vec3<f32>(0.0);
    for (var segment = 0u; segment < group.n_segments; segment += 1u) {
        sum += partials[first + segment * block.n_components].xyz;
    }
    return components[block.z + component].w * sum;
}
