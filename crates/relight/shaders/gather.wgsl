// Gather: fresh z = scale · sum over segments, a few threads per block; and by how much each tile would miss what that expands
// to if it stayed as it is, added up over the groups. Twin of src/cpu/project.rs and src/cpu/left.rs; expand.wgsl decides.

@group(0) @binding(1) var<storage, read> coefficients: array<vec4<f32>>;
// One per tile of the frame.
@group(0) @binding(2) var<storage, read_write> behind: array<f32>;

@group(1) @binding(0) var<storage, read> blocks: array<Block>;
// One per component: the largest magnitude of its left factor per channel, and its scale.
@group(1) @binding(1) var<storage, read> components: array<vec4<f32>>;
// Segment by segment as long as z, then the fresh z, and then the z that blocks were expanded from.
@group(1) @binding(2) var<storage, read_write> partials: array<vec4<f32>>;
// As in expand.wgsl.
@group(1) @binding(3) var<storage, read> sparse: array<u32>;

// More than anybody overlooks.
const FAR: f32 = 1e30;

var<workgroup> shares: array<vec3<f32>, THREADS>;

@compute @workgroup_size(THREADS)
fn gather(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let at = id.x * (THREADS / PER_BLOCK) + thread / PER_BLOCK;
    let lane = thread % PER_BLOCK;
    let is_there = at < arrayLength(&blocks);
    var share = vec3<f32>(0.0);
    if is_there {
        share = gathered(blocks[at], lane);
    }
    shares[thread] = share;
    workgroupBarrier();
    if is_there && lane == 0u {
        var most = vec3<f32>(0.0);
        for (var i = 0u; i < PER_BLOCK; i += 1u) {
            most += shares[thread + i];
        }
        behind[blocks[at].tile] += max(most.x, max(most.y, most.z));
    }
}

// How far any pixel of the block is behind, at most: the share of this thread.
fn gathered(block: Block, lane: u32) -> vec3<f32> {
    let stride = arrayLength(&partials) / (group.n_segments + 2u);
    var most = vec3<f32>(0.0);
    for (var component = lane; component < block.n_components; component += PER_BLOCK) {
        let place = block.z + component;
        var sum = vec3<f32>(0.0);
        // Those that fill a word stay 0. In the order of the segments, whatever was projected just now.
        if component < block.rank {
            var segment = 0u;
            // Four at a time, so that a device waits for memory once for all of them.
            for (; segment + 4u <= group.n_segments; segment += 4u) {
                let at = segment * stride + place;
                let a = partials[at].xyz;
                let b = partials[at + stride].xyz;
                let c = partials[at + 2u * stride].xyz;
                let d = partials[at + 3u * stride].xyz;
                sum += (a + b) + (c + d);
            }
            for (; segment < group.n_segments; segment += 1u) {
                sum += partials[segment * stride + place].xyz;
            }
            sum *= components[place].w;
        }
        let fresh = group.n_segments * stride + place;
        partials[fresh] = vec4<f32>(sum, 0.0);
        most += components[place].xyz * abs(sum - partials[fresh + stride].xyz);
    }
    // An entry that no low rank holds carries another coefficient past z.
    let terms = block.sparse + block.n_pixels + 1u;
    for (var i = lane; i < block.n_sparse; i += PER_BLOCK) {
        if coefficients[sparse[terms + 2u * i] & 0x3fffffffu].w != 0.0 {
            most = vec3<f32>(FAR);
        }
    }
    return most;
}
